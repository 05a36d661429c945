//! The object hierarchy against each view, without what makes it fast.

use mullion_common::geometry::{Containment, Frustum};
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::VisibleSet;

use super::CullStats;

/// "OH without FH" as the paper's traditional way has it (section 4.2): every node on the way down is tested against all
/// planes, and a node that is wholly inside is unfolded like any other.
pub(super) fn cull(hierarchy: &ObjectHierarchy, views: &[Frustum], sets: &mut [VisibleSet]) -> CullStats {
    let mut stats = CullStats::default();
    let nodes = hierarchy.nodes();
    for (frustum, set) in views.iter().zip(sets) {
        let mut at = 0;
        while at < nodes.len() as u32 {
            let node = &nodes[at as usize];
            stats.nodes_visited += 1;
            let is_outside = frustum.planes.iter().any(|plane| {
                stats.plane_tests += 1;
                plane.classify(&node.bound, frustum.eye) == Containment::Outside
            });
            if is_outside {
                at = node.subtree_end;
                continue;
            }
            if node.subtree_end == at + 1 {
                set.push(node.leaves);
            }
            at += 1;
        }
    }
    stats
}
