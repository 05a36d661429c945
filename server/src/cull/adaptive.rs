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
    (open, memory): (&mut Vec<Open>, &mut Memory),
    sets: &mut [VisibleSet],
) -> CullStats {
    let mut stats = CullStats::default();
    let mut traversal = Traversal { hierarchy, frusta, memory, sets };
    for_each_in_primary(hierarchy, frusta, open, &mut stats, |node, cut, stats| traversal.walk(node, cut, stats));
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

/// Where something has come to in the frustum hierarchy, and what is known of it there.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    /// Node of the frustum hierarchy.
    fh: u32,
    /// Its depth.
    depth: u8,
    /// Bit d: wholly on this side of the bisection plane of the ancestor at depth d.
    parted: u32,
}

/// What a traversal needs, kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Memory {
    /// The ancestors that bisection planes cut: where each one's subtree ends, and where its children start.
    unfolded: Vec<(u32, Place)>,
    /// Where a leaf still has to go.
    halves: Vec<Place>,
    descent: Vec<Open>,
}

/// Both hierarchies, and where what is found goes.
pub(super) struct Traversal<'a> {
    pub hierarchy: &'a ObjectHierarchy,
    pub frusta: &'a FrustumHierarchy,
    pub memory: &'a mut Memory,
    pub sets: &'a mut [VisibleSet],
}

impl Traversal<'_> {
    /// Takes one node of the object hierarchy, of which `primary_cut` has the planes of the primary frustum that cut it, and
    /// all below it through both hierarchies: depth first, as nodes stand in memory.
    fn walk(&mut self, node: u32, primary_cut: u8, stats: &mut CullStats) {
        let nodes = self.hierarchy.nodes();
        let end = nodes[node as usize].subtree_end;
        let mut at = node;
        self.memory.unfolded.clear();
        while at < end {
            while self.memory.unfolded.last().is_some_and(|(subtree_end, _)| *subtree_end <= at) {
                self.memory.unfolded.pop();
            }
            let place = self.memory.unfolded.last().map_or_else(Place::default, |(_, place)| *place);
            let subtree_end = nodes[at as usize].subtree_end;
            match self.meet(at, primary_cut, place, stats) {
                None => at = subtree_end,
                Some(place) => {
                    self.memory.unfolded.push((subtree_end, place));
                    at += 1;
                }
            }
        }
    }

    /// Takes a node down the frustum hierarchy from `place`. Returns where its children have to go on, if a plane cuts it.
    #[inline]
    pub(super) fn meet(&mut self, node: u32, primary_cut: u8, mut place: Place, stats: &mut CullStats) -> Option<Place> {
        let current = &self.hierarchy.nodes()[node as usize];
        let is_leaf = current.subtree_end == node + 1;
        self.memory.halves.clear();
        loop {
            // Where no plane cuts the node, the frustum hierarchy alone goes on.
            while let FrustumNode::Split { negative, positive, .. } = *self.frusta.node(place.fh) {
                let (plane, eye) = self.frusta.bisection(place.fh);
                stats.nodes_visited += 1;
                stats.plane_tests += 1;
                let depth = place.depth + 1;
                match plane.classify(&current.bound, *eye) {
                    Containment::Cut if !is_leaf => return Some(place),
                    Containment::Cut => {
                        self.memory.halves.push(Place { fh: positive, depth, ..place });
                        place = Place { fh: negative, depth, ..place };
                    }
                    // A choice that is guessed, not looked up: what comes next does not wait for this test.
                    side => {
                        let fh = if side == Containment::Inside { positive } else { negative };
                        place = Place { fh, depth, parted: place.parted | (1 << place.depth) };
                    }
                }
            }
            self.check(node, primary_cut, place, stats);
            place = self.memory.halves.pop()?;
        }
    }

    /// The terminal check: emits what the cells of a place may see of a node, tested against the planes that nothing on the
    /// way has settled.
    fn check(&mut self, node: u32, primary_cut: u8, place: Place, stats: &mut CullStats) {
        let Self { hierarchy, frusta, memory, sets } = self;
        let FrustumNode::Cells { start, end } = *frusta.node(place.fh) else {
            return;
        };
        for (cell, guards) in frusta.cells_of(start, end) {
            let views = frusta.views_through(cell);
            match guards.untested(primary_cut, place.parted) {
                0 => emit(sets, views, hierarchy.nodes()[node as usize].leaves),
                mask => {
                    let frustum = &frusta.cells()[usize::from(cell)];
                    let emit = &mut |leaves| emit(sets, views, leaves);
                    oh::descend(hierarchy, node, frustum, mask, &mut memory.descent, stats, emit);
                }
            }
        }
    }
}

/// Adds leaves to the sets of all `views`.
pub(super) fn emit(sets: &mut [VisibleSet], views: &[u16], leaves: LeafRange) {
    for view in views {
        sets[usize::from(*view)].push_unordered(leaves);
    }
}
