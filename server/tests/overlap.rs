//! Views that overlap, both ways: told apart at the end of the frustum hierarchy, or divided into frusta of their own. Neither
//! drops a leaf that a view sees.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use mullion_common::geometry::{Aabb, Frustum, Obb};
use mullion_common::scene::{ObjectHierarchy, OhNode};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{ViewId, Wall, WallConfig};
use mullion_server::cull::{Algorithm, CullStats, Culler, FrustumHierarchy, FrustumNode, Overlap, oracle};
use mullion_server::tree::CullTree;

fn wall(file: &str) -> Wall {
    let path = format!("{}/../configs/{file}", env!("CARGO_MANIFEST_DIR"));
    WallConfig::parse(&std::fs::read_to_string(path).expect("it ships")).expect("a wall")
}

fn frusta(wall: &Wall, eyes: &[DVec3]) -> Vec<Frustum> {
    eyes.iter().enumerate().map(|(view, eye)| wall.frustum(ViewId(view as u16), *eye, &DAffine3::IDENTITY)).collect()
}

/// 12 × 10 × 8 boxes of 1:2:3 around and behind the wall, in groups of 8 and of 80.
fn tree() -> CullTree {
    let boxes: Vec<Obb> = (0..960)
        .map(|i| {
            let [z, x, y] = [i % 8, i / 8 % 12, i / 96].map(f64::from);
            let center = DVec3::new(x - 5.7, y * 0.7 - 1.9, 1.3 - z * 1.7);
            let half = DVec3::new(0.05, 0.1, 0.15) * (1.0 + x * 0.2);
            let turned = DAffine3::from_rotation_x(0.3 * f64::from(i)) * DAffine3::from_rotation_y(z);
            Obb::from(Aabb { min: -half, max: half }).transformed(&(DAffine3::from_translation(center) * turned))
        })
        .collect();
    let around = |boxes: &[Obb]| Obb::around(boxes.iter().flat_map(Obb::corners)).expect("boxes");
    let mut nodes = vec![OhNode { bound: around(&boxes), subtree_end: 0, leaves: LeafRange::new(0, 960) }];
    for (group, members) in (0..).zip(boxes.chunks(8)) {
        let (at, first) = (nodes.len() as u32, group * 8);
        nodes.push(OhNode { bound: around(members), subtree_end: at + 9, leaves: LeafRange::new(first, first + 8) });
        for (bound, leaf) in members.iter().zip(first..) {
            let subtree_end = nodes.len() as u32 + 1;
            nodes.push(OhNode { bound: *bound, subtree_end, leaves: LeafRange::new(leaf, leaf + 1) });
        }
    }
    nodes[0].subtree_end = nodes.len() as u32;
    CullTree::new(Arc::new(ObjectHierarchy::new(nodes).expect("a tree")))
}

/// Where heads stand: in front, to the side, close, and back again.
fn walk(wall: &Wall) -> Vec<Vec<DVec3>> {
    let steps = [DVec3::ZERO, DVec3::new(0.02, 0.01, 0.03), DVec3::new(4.0, -0.8, -3.0), DVec3::new(-1.2, 0.9, 2.0), DVec3::ZERO];
    steps.iter().map(|step| wall.default_eyes().iter().map(|eye| *eye + *step).collect()).collect()
}

#[test]
fn projectors_become_cells_that_do_not_overlap() {
    let wall = wall("projectors_3x2.toml");
    let mut hierarchy = FrustumHierarchy::new(frusta(&wall, &wall.default_eyes()), Overlap::OwnFrusta);
    hierarchy.place(&DAffine3::IDENTITY);
    // Three columns with two overlaps by two rows with one: 5 × 3.
    assert_eq!(hierarchy.cells().len(), 15);
    let mut views: Vec<usize> = (0..15).map(|cell| hierarchy.views_through(cell).len()).collect();
    views.sort_unstable();
    assert_eq!(views, [1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 4, 4], "two views overlap along an edge, four where edges cross");
    let mut open = vec![0];
    let mut seen = 0;
    while let Some(node) = open.pop() {
        match *hierarchy.node(node) {
            FrustumNode::Cells { start, end } => seen += end - start,
            FrustumNode::Split { negative, positive, .. } => open.extend([negative, positive]),
        }
    }
    assert_eq!(seen, 15, "no plane cuts a cell");
    for eyes in walk(&wall) {
        hierarchy.update(frusta(&wall, &eyes).into_iter());
    }
    assert_eq!(hierarchy.builds(), 1, "the cells lie on the wall as they did, wherever the head is");
}

#[test]
fn views_that_do_not_overlap_stay_whole() {
    for (file, views) in [("wall_4x4.toml", 16), ("cave_4.toml", 4)] {
        let wall = wall(file);
        let hierarchy = FrustumHierarchy::new(frusta(&wall, &wall.default_eyes()), Overlap::OwnFrusta);
        assert_eq!(hierarchy.cells(), hierarchy.views(), "{file}");
        assert!((0..views).all(|view| hierarchy.views_through(view) == [view]), "{file}");
    }
    // Two eyes see the same screen differently: nothing is shared.
    let wall = wall("projectors_3x2.toml");
    let mut eyes = wall.default_eyes();
    (0..).zip(&mut eyes).for_each(|(view, eye)| eye.x += f64::from(view) * 0.01);
    let hierarchy = FrustumHierarchy::new(frusta(&wall, &eyes), Overlap::OwnFrusta);
    assert_eq!(hierarchy.cells(), hierarchy.views());
}

#[test]
fn both_ways_drop_nothing() {
    let (wall, tree) = (wall("projectors_3x2.toml"), tree());
    let algorithms = [Algorithm::Fh, Algorithm::Adaptive, Algorithm::AdaptiveGrouped];
    for (algorithm, overlap) in algorithms.into_iter().flat_map(|a| [Overlap::TerminalCheck, Overlap::OwnFrusta].map(|o| (a, o)))
    {
        let mut culler = Culler::new(algorithm, &wall).with_overlap(overlap);
        let (mut found, mut exact, mut unseen) = (vec![VisibleSet::default(); 6], VisibleSet::default(), VisibleSet::default());
        let (mut stats, mut visible, mut excess) = (CullStats::default(), 0, 0);
        for eyes in walk(&wall) {
            stats += culler.cull(&tree, &wall, &eyes, &DAffine3::IDENTITY, &mut found);
            for (frustum, found) in frusta(&wall, &eyes).iter().zip(&found) {
                exact.clear();
                oracle::visible_leaves(tree.hierarchy(), frustum, &mut exact);
                assert!(found.is_superset_of(&exact), "{algorithm} {overlap:?}");
                found.difference_into(&exact, &mut unseen);
                visible += exact.len();
                excess += unseen.len();
            }
        }
        println!("{algorithm} {overlap:?}: {stats:?}, {visible} visible, {excess} too many");
        assert!(visible > 1000 && excess * 10 < visible, "{algorithm} {overlap:?}: {visible}, {excess}");
    }
}
