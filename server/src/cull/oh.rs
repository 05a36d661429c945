//! The object hierarchy against one convex volume, with plane masks and the fully-inside shortcut.

use mullion_common::geometry::{Containment, Frustum, Obb, Plane};
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::{LeafRange, VisibleSet};

use glam::DVec3;

use super::CullStats;

/// An ancestor whose subtree is being walked: where it ends, and the planes that still cut it.
pub(super) type Open = (u32, u8);

/// Culls view by view: "OH without FH" (section 4.2), as a scene graph library does it.
pub(super) fn cull(
    hierarchy: &ObjectHierarchy,
    views: &[Frustum],
    descent: &mut Vec<Open>,
    sets: &mut [VisibleSet],
) -> CullStats {
    let mut stats = CullStats::default();
    for (frustum, set) in views.iter().zip(sets) {
        descend(hierarchy, 0, frustum, ALL_PLANES, descent, &mut stats, &mut |leaves| set.push(leaves));
    }
    stats
}

/// A bit for each of a frustum's planes.
pub(super) const ALL_PLANES: u8 = (1 << 5) - 1;

/// Emits the leaves below `node` that a view may see, in ascending order. `mask`: the planes that may cut the node; it is
/// known to be inside the others.
pub(super) fn descend(
    hierarchy: &ObjectHierarchy,
    node: u32,
    frustum: &Frustum,
    mask: u8,
    open: &mut Vec<Open>,
    stats: &mut CullStats,
    emit: &mut impl FnMut(LeafRange),
) {
    let nodes = hierarchy.nodes();
    let end = nodes[node as usize].subtree_end;
    let mut at = node;
    open.clear();
    open.push((end, mask));
    while at < end {
        while open.last().is_some_and(|(subtree_end, _)| *subtree_end <= at) {
            open.pop();
        }
        let mask = open.last().map_or(mask, |(_, mask)| *mask);
        let current = &nodes[at as usize];
        stats.nodes_visited += 1;
        let left = cut_planes(|k| (&frustum.planes[k], frustum.eye), mask, &current.bound, stats);
        at = match left {
            None => current.subtree_end,
            Some(cut) if cut == 0 || current.subtree_end == at + 1 => {
                emit(current.leaves);
                current.subtree_end
            }
            Some(cut) => {
                open.push((current.subtree_end, cut));
                at + 1
            }
        };
    }
}

/// The planes of `mask` that cut the box; `None` when it is outside one. `plane` gives a plane and its eye.
pub(super) fn cut_planes<'a>(
    plane: impl Fn(usize) -> (&'a Plane, DVec3),
    mask: u8,
    bound: &Obb,
    stats: &mut CullStats,
) -> Option<u8> {
    let mut cut = 0;
    let mut left = mask;
    while left != 0 {
        let bit = left & left.wrapping_neg();
        left ^= bit;
        stats.plane_tests += 1;
        let (plane, eye) = plane(bit.trailing_zeros() as usize);
        match plane.classify(bound, eye) {
            Containment::Outside => return None,
            Containment::Cut => cut |= bit,
            Containment::Inside => {}
        }
    }
    Some(cut)
}
