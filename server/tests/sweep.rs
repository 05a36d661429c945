//! The sweep: it drops nothing that may be seen, and neither slack nor threads change its sets by a bit.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use mullion_common::geometry::{Aabb, Frustum, Obb};
use mullion_common::scene::{ObjectHierarchy, OhNode};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{ViewId, Wall, WallConfig};
use mullion_server::cull::{Algorithm, CullStats, Culler};
use mullion_server::tree::CullTree;
use proptest::prelude::*;

fn walls() -> Vec<Wall> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs");
    let mut paths: Vec<_> = std::fs::read_dir(folder).expect("configs").map(|e| e.expect("an entry").path()).collect();
    paths.sort();
    let read = |path: &std::path::PathBuf| WallConfig::parse(&std::fs::read_to_string(path).expect("readable")).expect("a wall");
    paths.iter().map(read).collect()
}

/// A hierarchy over boxes: halved along the longest axis, `branching` at a time.
fn hierarchy(mut boxes: Vec<Obb>, branching: usize) -> ObjectHierarchy {
    fn add(nodes: &mut Vec<OhNode>, leaves: &mut u32, boxes: &mut [Obb], branching: usize) {
        let at = nodes.len();
        let bound = match boxes {
            [only] => *only,
            _ => Obb::around(boxes.iter().flat_map(Obb::corners)).expect("boxes"),
        };
        nodes.push(OhNode { bound, subtree_end: 0, leaves: LeafRange::new(*leaves, 0) });
        if boxes.len() == 1 {
            *leaves += 1;
        } else {
            let all = Aabb::of_points(boxes.iter().map(|b| b.center)).size();
            let axis = (0..3).max_by(|a, b| all[*a].total_cmp(&all[*b])).expect("three");
            boxes.sort_by(|a, b| a.center[axis].total_cmp(&b.center[axis]));
            let each = boxes.len().div_ceil(branching);
            boxes.chunks_mut(each).for_each(|part| add(nodes, leaves, part, branching));
        }
        nodes[at].subtree_end = nodes.len() as u32;
        nodes[at].leaves.end = *leaves;
    }
    let mut nodes = Vec::new();
    if !boxes.is_empty() {
        add(&mut nodes, &mut 0, &mut boxes, branching);
    }
    ObjectHierarchy::new(nodes).expect("a tree")
}

/// Boxes of all sizes in clusters, as pseudo-random as `seed` says.
fn boxes(count: usize, seed: u64) -> Vec<Obb> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut point = move |scale: f64| DVec3::new(random() - 0.5, random() - 0.5, random() - 0.5) * scale;
    let clusters: Vec<DVec3> = (0..8).map(|_| point(40.0)).collect();
    (0..count)
        .map(|i| {
            let size = (point(1.0).x * 5.0).exp() * 0.3;
            let half = (point(1.0).abs() + 0.05) * size;
            let turn = if i % 2 == 0 { DQuat::IDENTITY } else { DQuat::from_scaled_axis(point(6.0)) };
            let center = clusters[i % clusters.len()] + point(12.0);
            Obb::from(Aabb { min: -half, max: half }).transformed(&DAffine3::from_rotation_translation(turn, center))
        })
        .collect()
}

/// Whether a corner, the middle or a point between is inside all planes by more than rounding.
fn is_surely_seen(bound: &Obb, frustum: &Frustum) -> bool {
    let inside = |point: DVec3| frustum.planes.iter().all(|plane| plane.distance_m(point) > 1e-9 * (1.0 + point.length()));
    (0..125).any(|i| {
        let at = |k: i32| f64::from(k) / 2.0 - 1.0;
        let [x, y, z] = bound.half_axes;
        inside(bound.center + x * at(i % 5) + y * at(i / 5 % 5) + z * at(i / 25))
    })
}

fn leaf_bounds(tree: &CullTree) -> Vec<Obb> {
    tree.hierarchy().leaf_nodes().map(|node| node.bound).collect()
}

fn assert_drops_nothing(tree: &CullTree, wall: &Wall, eyes: &[DVec3], room: &DAffine3, sets: &[VisibleSet]) {
    let bounds = leaf_bounds(tree);
    for (view, set) in sets.iter().enumerate() {
        let frustum = wall.frustum(ViewId(view as u16), eyes[view], room);
        for (leaf, bound) in bounds.iter().enumerate() {
            let is_kept = set.contains(leaf as u32);
            assert!(is_kept || !is_surely_seen(bound, &frustum), "{} view {view} leaf {leaf}: {bound:?}", wall.name());
        }
    }
}

fn cull(culler: &mut Culler, tree: &CullTree, wall: &Wall, eyes: &[DVec3], room: &DAffine3) -> (Vec<VisibleSet>, CullStats) {
    let mut sets = vec![VisibleSet::default(); wall.views().len()];
    let stats = culler.cull(tree, wall, eyes, room, &mut sets);
    (sets, stats)
}

/// A walk with pauses, turns of the room, jumps, and heads that move.
fn pose(wall: &Wall, step: u32, seed: f64) -> (Vec<DVec3>, DAffine3) {
    let t = f64::from(step);
    let slow = t * 0.02 + seed;
    let jump = f64::from(step / 40) * 3.0;
    let turn = DQuat::from_rotation_y((slow * 0.3).sin() * 2.0 + jump) * DQuat::from_rotation_x((slow * 0.7).sin() * 0.2);
    let place = DVec3::new(slow.sin() * 6.0, (slow * 0.4).cos() * 3.0, slow.cos() * 6.0) + DVec3::splat(jump * 0.2);
    let scale = if step >= 80 { 3.0 } else { 1.0 };
    let room = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, place);
    let moves = if (20..30).contains(&(step % 40)) { 0.004 * t } else { 0.0 };
    let eyes: Vec<DVec3> = wall.default_eyes().iter().map(|eye| *eye + DVec3::new(moves, -moves * 0.5, moves)).collect();
    (eyes, room)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]
    #[test]
    fn nothing_that_may_be_seen_is_dropped(count in 0..300usize, seed in any::<u64>(), branching in 2..12usize, step in 0..120u32) {
        let tree = CullTree::new(Arc::new(hierarchy(boxes(count, seed), branching)));
        for wall in walls() {
            let (eyes, room) = pose(&wall, step, 0.3);
            let (sets, _) = cull(&mut Culler::new(Algorithm::Sweep, &wall), &tree, &wall, &eyes, &room);
            assert_drops_nothing(&tree, &wall, &eyes, &room, &sets);
        }
    }
}

#[test]
fn slack_changes_no_set() {
    for (wall, seed) in walls().into_iter().zip(1..) {
        let tree = CullTree::new(Arc::new(hierarchy(boxes(3000, seed), 4)));
        let other = CullTree::new(Arc::new(hierarchy(boxes(500, seed + 100), 3)));
        let mut full = Culler::new(Algorithm::Sweep, &wall);
        let mut slack = Culler::new(Algorithm::Sweep, &wall).with_slack(true);
        let mut pairs = 0;
        for step in 0..120 {
            let (eyes, room) = pose(&wall, step, seed as f64);
            let tree = if (60..63).contains(&step) { &other } else { &tree };
            let (wanted, _) = cull(&mut full, tree, &wall, &eyes, &room);
            let (found, _) = cull(&mut slack, tree, &wall, &eyes, &room);
            assert_eq!(found, wanted, "{} step {step}", wall.name());
            pairs += wanted.iter().map(VisibleSet::len).sum::<u32>();
        }
        assert!(pairs > 1000, "{}: something is in view", wall.name());
        // At rest, nothing is looked at but what lies within rounding of a plane.
        let (eyes, room) = pose(&wall, 119, seed as f64);
        let (wanted, all) = cull(&mut full, &tree, &wall, &eyes, &room);
        let mut rest = || cull(&mut slack, &tree, &wall, &eyes, &room);
        let (found, at_rest) = [rest(), rest(), rest()][2].clone();
        assert_eq!(found, wanted);
        assert!(at_rest.nodes_visited * 10 < all.nodes_visited, "{}: {at_rest:?}, {all:?}", wall.name());
    }
}

#[test]
fn threads_change_no_set() {
    let tree = CullTree::new(Arc::new(hierarchy(boxes(40_000, 5), 8)));
    for wall in walls() {
        let mut alone = Culler::new(Algorithm::Sweep, &wall);
        let mut shared = Culler::new(Algorithm::Sweep, &wall).with_threads(3).expect("threads");
        for step in [0, 1, 2, 50, 90] {
            let (eyes, room) = pose(&wall, step, 1.0);
            let (wanted, _) = cull(&mut alone, &tree, &wall, &eyes, &room);
            let (found, _) = cull(&mut shared, &tree, &wall, &eyes, &room);
            assert_eq!(found, wanted, "{} step {step}", wall.name());
        }
    }
}
