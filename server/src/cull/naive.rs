//! Every leaf against every view.

use mullion_common::geometry::{Containment, Frustum};
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::VisibleSet;

use super::CullStats;

/// The paper's naive approach, O(m n) (section 4.2).
pub(super) fn cull(hierarchy: &ObjectHierarchy, views: &[Frustum], sets: &mut [VisibleSet]) -> CullStats {
    let mut stats = CullStats::default();
    for node in hierarchy.nodes().iter().enumerate().filter(|(i, n)| n.subtree_end as usize == i + 1).map(|(_, n)| n) {
        for (frustum, set) in views.iter().zip(sets.iter_mut()) {
            stats.nodes_visited += 1;
            stats.plane_tests += frustum.planes.len() as u64;
            if frustum.classify(&node.bound) != Containment::Outside {
                set.push(node.leaves);
            }
        }
    }
    stats
}
