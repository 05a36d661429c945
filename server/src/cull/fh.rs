//! Every leaf down the frustum hierarchy.

use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::VisibleSet;

use super::adaptive::{Pair, cull_both};
use super::oh::{self, Open};
use super::{CullStats, FrustumHierarchy};

/// "FH without OH" (section 4.2): each leaf starts at the frustum hierarchy's root, and a bisection plane that misses it
/// rules out half of the views. O(n log m).
pub(super) fn cull(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    (stack, descent): (&mut Vec<Pair>, &mut Vec<Open>),
    sets: &mut [VisibleSet],
) -> CullStats {
    let mut stats = CullStats::default();
    let primary = frusta.primary();
    let all_primary = ((1u32 << primary.len()) - 1) as u8;
    for (at, node) in (0..).zip(hierarchy.nodes()).filter(|(at, node)| node.subtree_end == at + 1) {
        stats.nodes_visited += 1;
        if let Some(cut) = oh::cut_planes(|k| (&primary[k].0, primary[k].1), all_primary, &node.bound, &mut stats) {
            cull_both(hierarchy, frusta, (at, cut), stack, descent, sets, &mut stats);
        }
    }
    // Where views overlap, a view may have been reached on two ways.
    sets.iter_mut().for_each(VisibleSet::normalize);
    stats
}
