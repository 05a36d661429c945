//! The algorithms agree on every kind of wall: `oh` and `oh-plain` make the tests of `naive` and find its sets; `fh` and
//! `adaptive` also test against the planes of neighbouring views, and leave out only what cannot be seen.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use mullion_common::geometry::Frustum;
use mullion_common::scene::Package;
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{ViewId, Wall, WallConfig};
use mullion_server::cull::{Algorithm, CullStats, Culler, FrustumHierarchy, FrustumNode, Overlap};
use mullion_server::prepare::gltf::{SourceMesh, SourceNode, SourcePrimitive, SourceScene};
use mullion_server::prepare::{PrepareOptions, prepare};
use mullion_server::tree::CullTree;
use proptest::prelude::*;

fn configs() -> Vec<Wall> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs");
    let mut paths: Vec<_> = std::fs::read_dir(folder).expect("configs").map(|e| e.expect("an entry").path()).collect();
    paths.sort();
    let read = |path: &std::path::PathBuf| WallConfig::parse(&std::fs::read_to_string(path).expect("readable")).expect("a wall");
    paths.iter().map(read).collect()
}

fn source(nodes: Vec<SourceNode>, meshes: Vec<SourceMesh>) -> SourceScene {
    let roots = (0..nodes.len() as u32).filter(|i| nodes[*i as usize].parent.is_none()).collect();
    SourceScene { nodes, roots, meshes, materials: Vec::new(), images: Vec::new(), warnings: Vec::new() }
}

/// A scene of 1 × 2 × 3 boxes with the given places, turns and sizes, grouped as `parents` says: a node's parent is an
/// earlier node or none.
fn scene(boxes: &[(DVec3, f64, f64)], parents: &[u32]) -> Package {
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32 * 2.0, (i >> 2) as f32 * 3.0);
    let primitive = SourcePrimitive {
        gltf_primitive: 0,
        positions: (0..8).map(corner).collect(),
        normals: None,
        uvs: None,
        colors: None,
        indices: vec![0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6],
        material: None,
    };
    let mut nodes: Vec<SourceNode> = Vec::new();
    for (i, (place, turn, size)) in boxes.iter().enumerate() {
        let parent = (i > 0).then(|| parents[i] % (i as u32 + 1)).filter(|p| *p < i as u32);
        let turned = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), *turn);
        nodes.push(SourceNode {
            name: None,
            parent,
            children: Vec::new(),
            parent_from_local: DAffine3::from_scale_rotation_translation(DVec3::splat(*size), turned, *place),
            mesh: Some(0),
            instances: Vec::new(),
        });
        if let Some(parent) = parent {
            nodes[parent as usize].children.push(i as u32);
        }
    }
    let mesh = SourceMesh { name: None, gltf_mesh: 0, primitives: vec![primitive] };
    prepare(source(nodes, vec![mesh]), &PrepareOptions::default(), &|_, _, _| {}).expect("a scene").package
}

fn tree(package: &Package) -> CullTree {
    CullTree::new(Arc::clone(&package.scene.hierarchy))
}

fn sets(algorithm: Algorithm, package: &Package, wall: &Wall, eyes: &[DVec3], room: &DAffine3) -> (Vec<VisibleSet>, CullStats) {
    let mut sets = vec![VisibleSet::default(); wall.views().len()];
    let stats = Culler::new(algorithm, wall).cull(&tree(package), wall, eyes, room, &mut sets);
    (sets, stats)
}

/// `found` is within `naive`, and what it lacks has no point in view.
fn assert_only_unseen_leaves_missing(
    package: &Package,
    wall: &Wall,
    eyes: &[DVec3],
    room: &DAffine3,
    naive: &[VisibleSet],
    found: &[VisibleSet],
) {
    for ((found, naive), view) in found.iter().zip(naive).zip(0..) {
        assert!(naive.is_superset_of(found), "{} view {view}", wall.name());
        for leaf in naive.leaves().filter(|leaf| !found.contains(*leaf)) {
            let frustum = wall.frustum(ViewId(view), eyes[usize::from(view)], room);
            assert!(!is_seen(package, leaf, &frustum), "{} view {view} leaf {leaf}", wall.name());
        }
    }
}

/// Whether a point of the leaf's box is inside all planes: tried on a fine grid of points, coarse but independent.
fn is_seen(package: &Package, leaf: u32, frustum: &Frustum) -> bool {
    const STEPS: i32 = 24;
    let node = package.scene.hierarchy.nodes().iter().find(|n| n.leaves == LeafRange::new(leaf, leaf + 1));
    let bound = node.expect("the leaf has a node").bound;
    let at = |k: i32| f64::from(k * 2 - STEPS) / f64::from(STEPS);
    let steps = || 0..=STEPS;
    steps().flat_map(|x| steps().flat_map(move |y| steps().map(move |z| (x, y, z)))).any(|(x, y, z)| {
        let point = bound.center + bound.half_axes[0] * at(x) + bound.half_axes[1] * at(y) + bound.half_axes[2] * at(z);
        frustum.planes.iter().all(|plane| plane.distance_m(point) > 0.0)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
    #[test]
    fn algorithms_find_the_same_sets(
        boxes in proptest::collection::vec(((-9.0..9.0f64, -9.0..9.0f64, -9.0..9.0f64), 0.0..6.0f64, 0.05..1.5f64), 1..60),
        parents in proptest::collection::vec(any::<u32>(), 60),
        turn in 0.0..6.3f64,
        nudge in (-0.4..0.4f64, -0.4..0.4f64, -0.4..0.4f64),
    ) {
        let boxes: Vec<_> = boxes.into_iter().map(|(place, turn, size)| (DVec3::from(place), turn, size)).collect();
        let package = scene(&boxes, &parents);
        for wall in configs() {
            let eyes: Vec<DVec3> = wall.default_eyes().iter().map(|e| *e + DVec3::from(nudge)).collect();
            if wall.check_eye(eyes[0]).is_err() {
                continue;
            }
            let room = DAffine3::from_rotation_y(turn);
            let (naive, _) = sets(Algorithm::Naive, &package, &wall, &eyes, &room);
            for algorithm in [Algorithm::Oh, Algorithm::OhPlain] {
                let (found, _) = sets(algorithm, &package, &wall, &eyes, &room);
                prop_assert_eq!(&found, &naive, "{} on {}", algorithm, wall.name());
            }
            for algorithm in [Algorithm::Fh, Algorithm::Adaptive, Algorithm::AdaptiveGrouped] {
                let (found, _) = sets(algorithm, &package, &wall, &eyes, &room);
                assert_only_unseen_leaves_missing(&package, &wall, &eyes, &room, &naive, &found);
            }
        }
    }
}

#[test]
fn a_moving_head_drops_nothing() {
    let boxes: Vec<_> = (0..80)
        .map(|i| {
            let i = f64::from(i);
            (DVec3::new((i * 7.7).sin() * 6.0, (i * 3.1).cos() * 4.0, -5.0 + (i * 1.3).sin() * 8.0), i, 0.3)
        })
        .collect();
    let package = scene(&boxes, &[7; 80]);
    for wall in configs() {
        let mut culler = Culler::new(Algorithm::Adaptive, &wall);
        let mut found = vec![VisibleSet::default(); wall.views().len()];
        for step in 0..20 {
            let angle = f64::from(step) * 0.5;
            let away = DVec3::new(angle.sin() * 0.7, angle.cos() * 0.5, (angle * 2.0).sin() * 0.3);
            let eyes: Vec<DVec3> = wall.default_eyes().iter().map(|e| *e + away).collect();
            let room = DAffine3::from_translation(DVec3::X * f64::from(step) * 0.1);
            if wall.check_eye(eyes[0]).is_ok() {
                culler.cull(&tree(&package), &wall, &eyes, &room, &mut found);
                let naive = sets(Algorithm::Naive, &package, &wall, &eyes, &room).0;
                assert_only_unseen_leaves_missing(&package, &wall, &eyes, &room, &naive, &found);
            }
        }
    }
}

#[test]
fn a_grid_is_halved_down_to_single_tiles() {
    let wall = configs().into_iter().find(|w| w.name() == "wall-8x8").expect("it ships");
    let room = DAffine3::IDENTITY;
    let eyes = wall.default_eyes();
    let frusta = eyes.iter().enumerate().map(|(view, eye)| wall.frustum(ViewId(view as u16), *eye, &room)).collect();
    let mut hierarchy = FrustumHierarchy::new(frusta, Overlap::default());
    hierarchy.place(&room);
    assert_eq!(hierarchy.primary().len(), 5, "four sides and the near plane bound the whole wall");
    let (mut open, mut tiles, mut deepest) = (vec![(0, 0)], 0, 0);
    while let Some((node, depth)) = open.pop() {
        deepest = deepest.max(depth);
        match *hierarchy.node(node) {
            FrustumNode::Cells { start, end } => {
                assert_eq!(end - start, 1);
                tiles += 1;
            }
            FrustumNode::Split { negative, positive, .. } => open.extend([(negative, depth + 1), (positive, depth + 1)]),
        }
    }
    assert_eq!((tiles, deepest), (64, 6), "a balanced tree");
}

#[test]
fn a_head_that_moves_before_a_grid_rebuilds_nothing() {
    let wall = configs().into_iter().find(|w| w.name() == "wall-4x4").expect("it ships");
    let frusta = |eye: DVec3| (0..16).map(move |view| (view, eye));
    let of = |(view, eye): (u16, DVec3)| wall.frustum(ViewId(view), eye, &DAffine3::IDENTITY);
    let eye = wall.default_eyes()[0];
    let mut hierarchy = FrustumHierarchy::new(frusta(eye).map(of).collect(), Overlap::default());
    for step in 0..20 {
        let away = DVec3::new((f64::from(step) * 0.7).sin(), (f64::from(step) * 0.4).cos(), f64::from(step) * 0.05);
        hierarchy.update(frusta(eye + away).map(of));
    }
    assert_eq!(hierarchy.builds(), 1);
}

/// The reason to walk both hierarchies: far fewer tests than tile by tile.
#[test]
fn adaptive_tests_less_than_tile_by_tile() {
    let boxes: Vec<_> = (0..400)
        .map(|i| (DVec3::new(f64::from(i % 20) - 10.0, f64::from(i / 20) * 0.5 - 5.0, -8.0), f64::from(i), 0.1))
        .collect();
    // Each a root: no node before it is its parent.
    let package = scene(&boxes, &(0..400).collect::<Vec<_>>());
    let wall = configs().into_iter().find(|w| w.name() == "wall-8x8").expect("it ships");
    let cost = |algorithm| {
        let (found, stats) = sets(algorithm, &package, &wall, &wall.default_eyes(), &DAffine3::IDENTITY);
        assert!(found.iter().map(VisibleSet::len).sum::<u32>() >= 100, "the boxes are in view");
        stats.plane_tests
    };
    use Algorithm::{Adaptive, Fh, Naive, Oh, OhPlain};
    let [naive, plain, fh, oh, adaptive] = [Naive, OhPlain, Fh, Oh, Adaptive].map(cost);
    assert!(adaptive * 3 < oh * 2 && oh < plain && plain < naive, "naive {naive}, plain {plain}, oh {oh}, adaptive {adaptive}");
    assert!(adaptive < fh && fh < naive, "fh {fh}, adaptive {adaptive}");
}

#[test]
fn an_empty_scene_has_empty_sets() {
    let empty = prepare(source(Vec::new(), Vec::new()), &PrepareOptions::default(), &|_, _, _| {});
    let package = empty.expect("an empty scene").package;
    for (algorithm, wall) in Algorithm::ALL.into_iter().flat_map(|a| configs().into_iter().map(move |w| (a, w))) {
        let (found, _) = sets(algorithm, &package, &wall, &wall.default_eyes(), &DAffine3::IDENTITY);
        assert!(found.iter().all(VisibleSet::is_empty));
    }
}
