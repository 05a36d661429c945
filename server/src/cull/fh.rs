//! Every leaf down the frustum hierarchy.

use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::VisibleSet;

use super::adaptive::{Memory, Place, Traversal, for_each_in_primary};
use super::oh::Open;
use super::{CullStats, FrustumHierarchy};

/// "FH without OH" (section 4.2): after the first level, which drops what is outside the primary frustum, each leaf starts
/// at the frustum hierarchy's root, and a bisection plane that misses it rules out half of the views. O(n log m).
pub(super) fn cull(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    (open, memory): (&mut Vec<Open>, &mut Memory),
    sets: &mut [VisibleSet],
) -> CullStats {
    let mut stats = CullStats::default();
    let nodes = hierarchy.nodes();
    let mut traversal = Traversal { hierarchy, frusta, memory, sets };
    for_each_in_primary(hierarchy, frusta, open, &mut stats, |node, cut, stats| {
        let end = nodes[node as usize].subtree_end;
        for leaf in (node..end).filter(|at| nodes[*at as usize].subtree_end == at + 1) {
            traversal.meet_leaf(leaf, cut, Place::default(), stats);
        }
    });
    // Where views overlap, a view may have been reached on two ways.
    sets.iter_mut().for_each(VisibleSet::normalize);
    stats
}
