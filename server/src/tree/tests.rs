//! Trees follow edits: whatever was moved, added and removed, every box encloses what is below it.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{NodeId, ObjectHierarchy};
use proptest::prelude::*;

use super::{Bounds, CullTree, LANES, RebuildStep, TreeForm, WideNode, hierarchy_over};

/// A turned box of 1 × 2 × 3 parts, somewhere.
fn some_box(seed: u64) -> Obb {
    let part = |k: u64| (seed.wrapping_add(k).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f64 / (1u64 << 24) as f64;
    let half = DVec3::new(1.0, 2.0, 3.0) * (0.05 + part(1));
    let turn = if seed.is_multiple_of(3) {
        DQuat::IDENTITY
    } else {
        DQuat::from_scaled_axis(DVec3::new(part(2), part(3), part(4)) * 6.0)
    };
    let place = DVec3::new(part(5), part(6), part(7)) * DVec3::new(90.0, 9.0, 60.0);
    Obb::from(Aabb { min: -half, max: half }).transformed(&DAffine3::from_rotation_translation(turn, place))
}

fn tree(count: u32, bounds: Bounds) -> CullTree {
    let boxes: Vec<Obb> = (0..u64::from(count)).map(some_box).collect();
    let (nodes, _) = hierarchy_over(&boxes);
    CullTree::editable(Arc::new(ObjectHierarchy::new(nodes).expect("a tree")), bounds)
}

/// Whether `outer` holds `inner` but for rounding.
fn holds(outer: &Aabb, inner: &Aabb) -> bool {
    let slack = DVec3::splat(1e-9 * (1.0 + outer.min.abs().max(outer.max.abs()).max_element()));
    inner.is_empty() || (outer.min.cmple(inner.min + slack).all() && outer.max.cmpge(inner.max - slack).all())
}

/// The leaves' own boxes enclosed all the way up, in both forms.
fn assert_encloses(tree: &CullTree) {
    assert!(tree.is_refitted(TreeForm::Hierarchy) && tree.is_refitted(TreeForm::Wide));
    let hierarchy = tree.hierarchy();
    for id in (0..hierarchy.nodes().len() as u32).map(NodeId) {
        let bound = &hierarchy.node(id).bound;
        for corner in hierarchy.children(id).flat_map(|child| hierarchy.node(child).bound.corners()) {
            assert!(bound.contains(corner, 1e-9 * (1.0 + corner.length())), "{id:?}");
        }
    }
    let wide = tree.wide();
    let mut next = 0;
    if !wide.nodes().is_empty() {
        assert_lanes_hold(tree, wide.root(), wide.leaf_count(), &mut next);
    }
    assert_eq!(next, hierarchy.leaf_count());
}

/// What is below a wide node lies within its lanes, and its leaves follow on `next`.
fn assert_lanes_hold(tree: &CullTree, id: u32, end: u32, next: &mut u32) {
    let (hierarchy, wide) = (tree.hierarchy(), tree.wide());
    let node = &wide.nodes()[id as usize];
    for lane in 0..node.lane_count() {
        let at = |steps: &[[u8; LANES]; 3]| {
            let of = |axis: usize| f64::from(node.origin[axis]) + f64::from(steps[axis][lane]) * f64::from(node.step_m()[axis]);
            DVec3::new(of(0), of(1), of(2))
        };
        let lane_box = Aabb { min: at(&node.min), max: at(&node.max) };
        let leaves = node.leaves(lane, end);
        assert_eq!(leaves.start, *next, "leaves in order");
        if node.leaf_lanes & (1 << lane) == 0 {
            assert!(holds(&lane_box, &wide.nodes()[node.child[lane] as usize].bound()));
            assert_lanes_hold(tree, node.child[lane], leaves.end, next);
        } else {
            let leaf = NodeId(node.child[lane] & WideNode::NODE);
            assert_eq!((hierarchy.node(leaf).leaves, leaves.len()), (leaves, 1));
            let Aabb { min, max } = hierarchy.node(leaf).bound.aabb();
            assert!(holds(&lane_box, &Aabb { min: min - wide.origin(), max: max - wide.origin() }));
            *next += 1;
        }
        assert_eq!(*next, leaves.end);
    }
}

fn refit(tree: &mut CullTree) {
    tree.refit(TreeForm::Hierarchy);
    tree.refit(TreeForm::Wide);
}

/// What is done to a tree: a leaf is moved, one is removed, some are added, or the tree is built anew.
fn edit(tree: &mut CullTree, step: u64) {
    let count = u64::from(tree.hierarchy().leaf_count());
    let leaf = |k: u64| (step.wrapping_mul(0x2545_f491_4f6c_dd1d).wrapping_add(k * 7919) % count.max(1)) as u32;
    match step % 8 {
        _ if count == 0 => drop(tree.add_leaves(&[some_box(step)])),
        0 => tree.remove_leaf(leaf(0)),
        1 => drop(tree.add_leaves(&(0..1 + step % 20).map(|k| some_box(step + k)).collect::<Vec<_>>())),
        2 => tree.start_rebuild(),
        _ => (0..4).for_each(|k| tree.move_leaf(leaf(k), &some_box(step + k))),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]
    #[test]
    fn boxes_enclose_after_any_edits(count in 0..80u32, steps in proptest::collection::vec(any::<u32>(), 0..40)) {
        for bounds in Bounds::ALL {
            let mut tree = tree(count, bounds);
            refit(&mut tree);
            assert_encloses(&tree);
            for step in &steps {
                edit(&mut tree, u64::from(*step));
                tree.rebuild_step(if step % 3 == 0 { RebuildStep::Finish } else { RebuildStep::Some });
                refit(&mut tree);
                assert_encloses(&tree);
            }
        }
    }
}

#[test]
fn what_moves_and_comes_back_leaves_boxes_as_tight_as_they_were() {
    let mut tree = tree(500, Bounds::Obb);
    let (nodes, fresh) = (tree.hierarchy().nodes().to_vec(), tree.wide().nodes().to_vec());
    let movers: Vec<(u32, Obb)> = (0..500).step_by(7).map(|leaf| (leaf, *tree.leaf_bound(leaf))).collect();
    for frame in 1..=64 {
        for (leaf, bound) in &movers {
            // Out and back again, to the bit at last; one of them far away.
            let way_m = if *leaf == 77 { 500.0 } else { 0.5 };
            let away = way_m * (f64::from(frame % 64) / 64.0 * std::f64::consts::TAU + f64::from(*leaf)).sin();
            let moved = DAffine3::from_translation(DVec3::new(away, away * 0.3, -away));
            tree.move_leaf(*leaf, &if frame == 64 { *bound } else { bound.transformed(&moved) });
        }
        refit(&mut tree);
        assert_encloses(&tree);
    }
    assert_eq!(tree.hierarchy().nodes(), nodes);
    for (now, fresh) in tree.wide().nodes().iter().zip(&fresh) {
        let (size, fresh_size) = (now.bound().size(), fresh.bound().size());
        for axis in 0..3 {
            // Of a box below, of one's own, and of the one that stands where it stood.
            let steps_m = 4.0 * f64::from(now.step_m()[axis].min(fresh.step_m()[axis]));
            assert!(size[axis] <= fresh_size[axis] + steps_m, "{now:?} {fresh:?}");
        }
    }
    assert!(tree.degradation() < 1.03, "{}", tree.degradation());
}

#[test]
fn a_rebuilt_tree_has_what_the_old_one_had() {
    let mut tree = tree(300, Bounds::Obb);
    tree.remove_leaf(5);
    tree.start_rebuild();
    // Copied, being built, and edited meanwhile.
    assert_eq!(tree.rebuild_step(RebuildStep::Some), None);
    tree.remove_leaf(9);
    tree.move_leaf(10, &some_box(4321));
    let added = tree.add_leaves(&[some_box(7), some_box(8)]);
    tree.remove_leaf(added.end - 1);
    let bounds: Vec<Obb> = (0..tree.hierarchy().leaf_count()).map(|leaf| *tree.leaf_bound(leaf)).collect();
    let old_of_new = tree.rebuild_step(RebuildStep::Finish).expect("a new tree");
    let is_there = |new: &u32| tree.removed().is_none_or(|removed| !removed.contains(*new));
    let mut there: Vec<u32> = (0..tree.hierarchy().leaf_count()).filter(is_there).map(|new| old_of_new[new as usize]).collect();
    for (new, old) in (0..).zip(&old_of_new).filter(|(new, _)| is_there(new)) {
        assert_eq!(*tree.leaf_bound(new), bounds[*old as usize]);
    }
    there.sort_unstable();
    let expected: Vec<u32> = (0..added.end - 1).filter(|old| ![5, 9].contains(old)).collect();
    assert_eq!(there, expected);
    refit(&mut tree);
    assert_encloses(&tree);
    assert_eq!(tree.rebuild_step(RebuildStep::Finish), None, "nothing goes on");
}

#[test]
fn what_is_scattered_degrades_and_a_rebuild_mends_it() {
    let mut tree = tree(2000, Bounds::Hybrid);
    assert!((tree.degradation() - 1.0).abs() < 1e-9);
    for leaf in 0..1000 {
        tree.move_leaf(leaf, &some_box(u64::from(leaf) + 50_000));
    }
    refit(&mut tree);
    assert!(tree.degradation() > 2.0, "{}", tree.degradation());
    tree.start_rebuild();
    tree.rebuild_step(RebuildStep::Finish).expect("a new tree");
    assert!(tree.degradation() < 1.01, "{}", tree.degradation());
}
