//! The paper's adaptive traversal of both hierarchies (section 4.2).

use mullion_common::geometry::Containment;
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::CullStats;
use super::frustum_hierarchy::{FrustumHierarchy, FrustumNode};
use super::oh::{self, Open};

/// Culls the object hierarchy to the frustum hierarchy.
///
/// First to the primary frustum: a node that its planes cut is unfolded, one outside is dropped. What is left meets
/// the frustum hierarchy: where a bisection plane misses the node, only that side of the frustum hierarchy goes on
/// with it whole; where the plane cuts it, the object hierarchy unfolds, and each child is classified in turn (the
/// paper's L, C, R). A leaf that is cut goes to both sides. At the frustum hierarchy's leaves the object hierarchy alone goes
/// on, with those of the view's planes that no test on the way has settled: the terminal visibility check that walls
/// with gaps and overlaps need.
///
/// The paper's Algorithm 2 classifies a node's *children*, which loses nodes that have none; its prose, followed
/// here, lets the frustum hierarchy alone descend at the object hierarchy's leaves.
pub(super) fn cull(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    (open, stack, descent): (&mut Vec<Open>, &mut Vec<Pair>, &mut Vec<Open>),
    sets: &mut [VisibleSet],
) -> CullStats {
    let mut stats = CullStats::default();
    for_each_in_primary(hierarchy, frusta, open, &mut stats, |node, cut, stats| {
        cull_both(hierarchy, frusta, (node, cut), stack, descent, sets, stats);
    });
    // Where views overlap, a view may have been reached on two ways, and its ranges stand out of order.
    sets.iter_mut().for_each(VisibleSet::normalize);
    stats
}

/// The first level: calls `meet` for the largest nodes that no plane of the primary frustum cuts, and for leaves that one
/// does, each with the planes that cut it; in ascending order.
pub(super) fn for_each_in_primary(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    open: &mut Vec<Open>,
    stats: &mut CullStats,
    mut meet: impl FnMut(u32, u8, &mut CullStats),
) {
    let nodes = hierarchy.nodes();
    let primary = frusta.primary();
    let all_primary = ((1u32 << primary.len()) - 1) as u8;
    let mut at = 0;
    open.clear();
    while at < nodes.len() as u32 {
        while open.last().is_some_and(|(subtree_end, _)| *subtree_end <= at) {
            open.pop();
        }
        let node = &nodes[at as usize];
        stats.nodes_visited += 1;
        let mask = open.last().map_or(all_primary, |(_, mask)| *mask);
        let cut = oh::cut_planes(|k| (&primary[k].0, primary[k].1), mask, &node.bound, stats);
        at = match cut {
            None => node.subtree_end,
            Some(cut) if cut == 0 || node.subtree_end == at + 1 => {
                meet(at, cut, stats);
                node.subtree_end
            }
            Some(cut) => {
                open.push((node.subtree_end, cut));
                at + 1
            }
        };
    }
}

/// A node of the object hierarchy, one of the frustum hierarchy that it meets, and what is known of the two.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    oh: u32,
    fh: u32,
    /// Depth of the frustum hierarchy's node.
    depth: u8,
    /// Bit d: the node is wholly on this side of the bisection plane of the ancestor at depth d.
    parted: u32,
}

/// Takes one node of the object hierarchy, of which `primary_cut` has the planes of the primary frustum that cut it, down
/// the frustum hierarchy.
pub(super) fn cull_both(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    (node, primary_cut): (u32, u8),
    stack: &mut Vec<Pair>,
    descent: &mut Vec<Open>,
    sets: &mut [VisibleSet],
    stats: &mut CullStats,
) {
    stack.clear();
    stack.push(Pair { oh: node, fh: 0, depth: 0, parted: 0 });
    while let Some(mut pair) = stack.pop() {
        let current = &hierarchy.nodes()[pair.oh as usize];
        // Where no plane cuts the node, the frustum hierarchy alone goes on.
        while let FrustumNode::Split { cell, side, negative, positive } = *frusta.node(pair.fh) {
            let frustum = &frusta.cells()[usize::from(cell)];
            stats.nodes_visited += 1;
            stats.plane_tests += 1;
            let containment = frustum.plane(side).classify(&current.bound, frustum.eye);
            if containment == Containment::Cut {
                if current.subtree_end > pair.oh + 1 {
                    break;
                }
                stack.push(Pair { fh: negative, depth: pair.depth + 1, ..pair });
                pair.fh = positive;
            } else {
                pair.fh = if containment == Containment::Inside { positive } else { negative };
                pair.parted |= 1 << pair.depth;
            }
            pair.depth += 1;
        }
        if let FrustumNode::Cells { start, end } = *frusta.node(pair.fh) {
            for (cell, guards) in frusta.cells_of(start, end) {
                let views = frusta.views_through(cell);
                match guards.untested(primary_cut, pair.parted) {
                    0 => emit(sets, views, current.leaves),
                    mask => {
                        let frustum = &frusta.cells()[usize::from(cell)];
                        let emit = &mut |leaves| emit(sets, views, leaves);
                        oh::descend(hierarchy, pair.oh, frustum, mask, descent, stats, emit);
                    }
                }
            }
            continue;
        }
        // Children are visited in order: they are pushed in order, then turned round.
        let first = stack.len();
        let mut child = pair.oh + 1;
        while child < current.subtree_end {
            stack.push(Pair { oh: child, ..pair });
            child = hierarchy.nodes()[child as usize].subtree_end;
        }
        stack[first..].reverse();
    }
}

/// Adds leaves to the sets of all `views`.
pub(super) fn emit(sets: &mut [VisibleSet], views: &[u16], leaves: LeafRange) {
    for view in views {
        sets[usize::from(*view)].push_unordered(leaves);
    }
}
