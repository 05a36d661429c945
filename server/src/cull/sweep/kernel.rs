//! The sweep of one lattice over the wide tree.

use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::classify::{ALL_SIDES, Boxes, LanePlanes, State};
use super::lanes::{Kernel, Lanes};
use super::lattice::Lattice;
use crate::cull::CullStats;
use crate::tree::{LANES, WideTree};

/// A node to visit, or leaves to emit when those before them are done.
#[derive(Clone, Copy, Debug)]
pub(super) struct Visit {
    /// The wide node, or [`Visit::EMIT`].
    pub node: u32,
    /// Leaves below it.
    pub leaves: LeafRange,
    /// Slots that it may meet: left, right, bottom, top, ends exclusive. Of leaves to emit, cells instead of slots.
    pub slots: [u16; 4],
    /// Sides that may cut it.
    pub mask: u8,
}

impl Visit {
    const EMIT: u32 = u32::MAX;

    /// The whole tree before the whole lattice.
    pub(super) fn all(tree: &WideTree, lattice: &Lattice) -> Self {
        let [across, up] = lattice.slots();
        Self { node: tree.root(), leaves: LeafRange::new(0, tree.leaf_count()), slots: [0, across, 0, up], mask: ALL_SIDES }
    }

    /// Whether leaves are to be emitted, not a node to be visited.
    pub(super) fn is_emission(&self) -> bool {
        self.node == Self::EMIT
    }
}

/// What a sweep needs, kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Memory {
    stack: Vec<Visit>,
    planes: LanePlanes,
}

/// One sweep: a lattice, the tree, where to start, and where what is found goes.
pub(super) struct Sweep<'a, S> {
    pub tree: &'a WideTree,
    pub hierarchy: &'a ObjectHierarchy,
    pub lattice: &'a Lattice,
    pub start: &'a [Visit],
    pub memory: &'a mut Memory,
    pub sink: S,
}

/// Where a sweep's findings go.
pub(super) trait Sink {
    /// Whether the sink takes a node as it is, unvisited.
    fn takes(&mut self, visit: &Visit) -> bool;
    /// Leaves that all cells may see. Calls come in ascending order of leaves.
    fn emit(&mut self, leaves: LeafRange, cells: [u16; 4]);
    /// Nothing follows.
    fn finish(&mut self);
}

impl<S: Sink> Kernel for Sweep<'_, S> {
    type Output = CullStats;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> CullStats {
        let Self { tree, hierarchy, lattice, start, memory, mut sink } = self;
        let Memory { stack, planes } = memory;
        planes.set(lattice);
        let mut stats = CullStats::default();
        let offset = tree.origin() - lattice.eye();
        stack.clear();
        stack.extend(start.iter().rev());
        while let Some(visit) = stack.pop() {
            if visit.node == Visit::EMIT {
                sink.emit(visit.leaves, visit.slots);
                continue;
            }
            if sink.takes(&visit) {
                continue;
            }
            let node = &tree.nodes()[visit.node as usize];
            let boxes = Boxes::of(lanes, node, offset, planes);
            let found = boxes.classify(lanes, visit.slots, visit.mask, planes, &mut (), &mut stats);
            let end = visit.leaves.end;
            // Before the first lane that is to be opened, leaves are emitted at once; from there on, things wait their turn.
            let open = found.alive & !found.settled & !node.leaf_lanes;
            let first_open = open.trailing_zeros().min(LANES as u32);
            let follows = u32::from(found.follows());
            let mut now = u32::from(found.alive) & ((1 << first_open) - 1);
            while now != 0 {
                let lane = now.trailing_zeros() as usize;
                let mut run = 1;
                if found.settled & (1 << lane) != 0 {
                    run += (follows >> (lane + 1)).trailing_ones();
                    let first = node.leaves(lane, end);
                    let last = node.leaves(lane + run as usize - 1, end);
                    let cells = lattice.cells(found.settled_slot(lane, visit.slots));
                    sink.emit(LeafRange::new(first.start, last.end), cells);
                } else if let State::Seen(slots) =
                    found.state::<L>(lane, visit.slots, node, hierarchy, lattice, &mut (), &mut stats)
                {
                    sink.emit(node.leaves(lane, end), lattice.cells(slots));
                }
                now &= !(((1 << run) - 1) << lane);
            }
            let mut later = u32::from(found.alive) >> first_open << first_open;
            while later != 0 {
                let lane = later.ilog2() as usize;
                later ^= 1 << lane;
                let leaves = node.leaves(lane, end);
                match found.state::<L>(lane, visit.slots, node, hierarchy, lattice, &mut (), &mut stats) {
                    State::Unseen => {}
                    State::Seen(slots) => {
                        stack.push(Visit { node: Visit::EMIT, leaves, slots: lattice.cells(slots), mask: 0 });
                    }
                    State::Open(slots, mask) => {
                        let child = node.child[lane];
                        lanes.prefetch(&tree.nodes()[child as usize]);
                        stack.push(Visit { node: child, leaves, slots, mask });
                    }
                }
            }
        }
        sink.finish();
        stats
    }
}

/// Puts ranges into the views' sets. Those that follow on one another in the same cells are joined first.
pub(super) struct ToSets<'a> {
    lattice: &'a Lattice,
    sets: &'a mut [VisibleSet],
    pending: LeafRange,
    cells: [u16; 4],
}

impl<'a> ToSets<'a> {
    /// Adds to `sets`, by `ViewId`.
    pub(super) fn new(lattice: &'a Lattice, sets: &'a mut [VisibleSet]) -> Self {
        Self { lattice, sets, pending: LeafRange::new(0, 0), cells: [0; 4] }
    }
}

impl Sink for ToSets<'_> {
    #[inline(always)]
    fn takes(&mut self, _: &Visit) -> bool {
        false
    }

    #[inline(always)]
    fn emit(&mut self, leaves: LeafRange, cells: [u16; 4]) {
        if cells == self.cells && leaves.start == self.pending.end {
            self.pending.end = leaves.end;
        } else {
            self.finish();
            self.pending = leaves;
            self.cells = cells;
        }
    }

    #[inline(always)]
    fn finish(&mut self) {
        let [left, right, bottom, top] = self.cells;
        for row in bottom..top {
            for view in self.lattice.row(row, left..right) {
                self.sets[usize::from(*view)].push(self.pending);
            }
        }
    }
}

/// Keeps the nodes of at most `grain` leaves for later, and in order with them what is found above.
pub(super) struct ToVisits<'a> {
    pub visits: &'a mut Vec<Visit>,
    pub grain: u32,
}

impl Sink for ToVisits<'_> {
    #[inline(always)]
    fn takes(&mut self, visit: &Visit) -> bool {
        let takes = visit.leaves.len() <= self.grain;
        if takes {
            self.visits.push(*visit);
        }
        takes
    }

    #[inline(always)]
    fn emit(&mut self, leaves: LeafRange, cells: [u16; 4]) {
        self.visits.push(Visit { node: Visit::EMIT, leaves, slots: cells, mask: 0 });
    }

    #[inline(always)]
    fn finish(&mut self) {}
}
