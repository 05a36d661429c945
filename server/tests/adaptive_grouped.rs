//! Pseudo-groups: the sets of `adaptive`, for fewer tests where nodes have many children.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{ObjectHierarchy, OhNode};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{ViewId, Wall, WallConfig};
use mullion_server::cull::{Algorithm, CullStats, Culler, oracle};
use mullion_server::tree::CullTree;

fn wall(file: &str) -> Wall {
    let path = format!("{}/../configs/{file}", env!("CARGO_MANIFEST_DIR"));
    WallConfig::parse(&std::fs::read_to_string(path).expect("it ships")).expect("a wall")
}

/// 4096 boxes of 1:2:3 before a wall, 16 × 16 × 16, halved by place until a node's parts are `branching`.
fn tree(branching: usize) -> CullTree {
    fn add(nodes: &mut Vec<OhNode>, leaves: &mut u32, boxes: &mut [Obb], branching: usize) {
        let at = nodes.len();
        let bound = Obb::around(boxes.iter().flat_map(Obb::corners)).expect("boxes");
        nodes.push(OhNode { bound, subtree_end: 0, leaves: LeafRange::new(*leaves, 0) });
        if boxes.len() == 1 {
            *leaves += 1;
        } else {
            halve(boxes, branching, &mut |part| add(nodes, leaves, part, branching));
        }
        nodes[at].subtree_end = nodes.len() as u32;
        nodes[at].leaves.end = *leaves;
    }
    fn halve(boxes: &mut [Obb], parts: usize, each: &mut impl FnMut(&mut [Obb])) {
        if parts == 1 || boxes.len() == 1 {
            return each(boxes);
        }
        let axis = Aabb::of_points(boxes.iter().map(|b| b.center)).size().max_position();
        boxes.sort_by(|a, b| a.center[axis].total_cmp(&b.center[axis]));
        let (low, high) = boxes.split_at_mut(boxes.len() / 2);
        halve(low, parts / 2, each);
        halve(high, parts / 2, each);
    }
    let at = |i: u32, k: u32| f64::from(i / k % 16) + (f64::from(i) * 7.7).sin() * 0.4;
    let mut boxes: Vec<Obb> = (0..4096)
        .map(|i| {
            let center = DVec3::new(at(i, 1) - 7.3, at(i, 16) * 0.6 - 4.4, -2.0 - at(i, 256));
            let half = DVec3::new(0.02, 0.04, 0.06);
            Obb::from(Aabb { min: center - half, max: center + half })
        })
        .collect();
    let mut nodes = Vec::new();
    add(&mut nodes, &mut 0, &mut boxes, branching);
    CullTree::new(Arc::new(ObjectHierarchy::new(nodes).expect("a tree")))
}

fn cull(algorithm: Algorithm, tree: &CullTree, wall: &Wall) -> (CullStats, Vec<VisibleSet>) {
    let mut sets = vec![VisibleSet::default(); wall.views().len()];
    let stats = Culler::new(algorithm, wall).cull(tree, wall, &wall.default_eyes(), &DAffine3::IDENTITY, &mut sets);
    (stats, sets)
}

#[test]
fn groups_spare_tests_and_no_leaf() {
    for file in ["wall_8x8.toml", "wall_4x4.toml"] {
        let wall = wall(file);
        for (branching, percent) in [(2, 100), (8, 95), (64, 90), (256, 90)] {
            let tree = tree(branching);
            let (alone, adaptive) = cull(Algorithm::Adaptive, &tree, &wall);
            let (grouped, sets) = cull(Algorithm::AdaptiveGrouped, &tree, &wall);
            println!("{file}, {branching} children: {alone:?}, grouped {grouped:?}");
            assert!(grouped.plane_tests * 100 <= alone.plane_tests * percent, "{file} {branching}: {alone:?}, {grouped:?}");
            let mut exact = VisibleSet::default();
            for ((view, found), adaptive) in (0..).zip(&sets).zip(&adaptive) {
                let frustum = wall.frustum(ViewId(view), wall.default_eyes()[0], &DAffine3::IDENTITY);
                exact.clear();
                oracle::visible_leaves(tree.hierarchy(), &frustum, &mut exact);
                assert!(found.is_superset_of(&exact) && !exact.is_empty(), "{file} {branching} view {view}");
                assert_eq!(found, adaptive, "the boxes of groups decide nothing that their members' would not");
            }
        }
    }
}
