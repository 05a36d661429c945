//! The paper's adaptive traversal of both hierarchies (section 4.2).

use mullion_common::geometry::Containment;
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::VisibleSet;

use super::oh::{self, Open};
use super::{CullStats, FrustumHierarchy, FrustumNode};

/// Culls the object hierarchy to the frustum hierarchy.
///
/// First to the primary frustum: a node that its planes cut is unfolded, one outside is dropped. What is left meets
/// the frustum hierarchy: where a bisection plane misses the node, only that side of the frustum hierarchy goes on
/// with it whole; where the plane cuts it, the object hierarchy unfolds, and each child is classified in turn (the
/// paper's L, C, R). A leaf that is cut goes to both sides. At the frustum hierarchy's leaves the object hierarchy alone goes
/// on, with the view's planes: the terminal visibility check that walls with gaps and overlaps need.
///
/// The paper's Algorithm 2 classifies a node's *children*, which loses nodes that have none; its prose, followed
/// here, lets the frustum hierarchy alone descend at the object hierarchy's leaves.
pub(super) fn cull(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    stack: &mut Vec<(u32, u32)>,
    descent: &mut Vec<Open>,
    sets: &mut [VisibleSet],
) -> CullStats {
    let mut stats = CullStats::default();
    let nodes = hierarchy.nodes();
    let primary = frusta.primary();
    let mut at = 0;
    while at < nodes.len() as u32 {
        let node = &nodes[at as usize];
        stats.nodes_visited += 1;
        let mut containment = Containment::Inside;
        for (plane, eye) in primary {
            stats.plane_tests += 1;
            match plane.classify(&node.bound, *eye) {
                Containment::Inside => {}
                Containment::Cut => containment = Containment::Cut,
                Containment::Outside => {
                    containment = Containment::Outside;
                    break;
                }
            }
        }
        let is_leaf = node.subtree_end == at + 1;
        if containment == Containment::Cut && !is_leaf {
            at += 1;
            continue;
        }
        if containment != Containment::Outside {
            cull_both(hierarchy, frusta, at, stack, descent, sets, &mut stats);
        }
        at = node.subtree_end;
    }
    // Where views overlap, a view may have been reached on two ways, and its ranges stand out of order.
    sets.iter_mut().for_each(VisibleSet::normalize);
    stats
}

fn cull_both(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    node: u32,
    stack: &mut Vec<(u32, u32)>,
    descent: &mut Vec<Open>,
    sets: &mut [VisibleSet],
    stats: &mut CullStats,
) {
    stack.clear();
    stack.push((node, 0));
    while let Some((at, fh)) = stack.pop() {
        match *frusta.node(fh) {
            FrustumNode::Views { start, end } => {
                for &view in frusta.views_of(start, end) {
                    let set = &mut sets[usize::from(view)];
                    let frustum = &frusta.views()[usize::from(view)];
                    oh::descend(hierarchy, at, frustum, descent, stats, &mut |leaves| set.push_unordered(leaves));
                }
            }
            FrustumNode::Split { view, side, negative, positive } => {
                let current = &hierarchy.nodes()[at as usize];
                let frustum = &frusta.views()[usize::from(view)];
                stats.nodes_visited += 1;
                stats.plane_tests += 1;
                match frustum.plane(side).classify(&current.bound, frustum.eye) {
                    Containment::Inside => stack.push((at, positive)),
                    Containment::Outside => stack.push((at, negative)),
                    Containment::Cut if current.subtree_end == at + 1 => stack.extend([(at, positive), (at, negative)]),
                    Containment::Cut => {
                        // Children are visited in order: they are pushed in order, then turned round.
                        let first = stack.len();
                        let mut child = at + 1;
                        while child < current.subtree_end {
                            stack.push((child, fh));
                            child = hierarchy.nodes()[child as usize].subtree_end;
                        }
                        stack[first..].reverse();
                    }
                }
            }
        }
    }
}
