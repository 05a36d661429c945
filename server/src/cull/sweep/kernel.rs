//! The sweep of one lattice over the wide tree.

use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::classify::{ALL_SIDES, Boxes, LanePlanes, Looked, State};
use super::cuts::Cuts;
use super::lanes::{Kernel, Lanes};
use super::lattice::Lattice;
use super::pending::Pending;
use crate::cull::CullStats;
use crate::tree::WideTree;

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
    /// In place of a node.
    pub const EMIT: u32 = u32::MAX;

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
    pending: Pending,
    planes: LanePlanes,
}

/// One sweep: a lattice, the tree, where to start, and where what is found goes.
pub(super) struct Sweep<'a, S> {
    pub tree: &'a WideTree,
    pub lattice: &'a Lattice,
    pub start: &'a [Visit],
    pub memory: &'a mut Memory,
    pub sink: S,
}

/// Where a sweep's findings go.
pub(super) trait Sink {
    /// Whether [`Sink::append_to_view`] may be called.
    const TAKES_VIEWS: bool;
    /// Whether the sink takes a node as it is, unvisited.
    fn takes(&mut self, visit: &Visit) -> bool;
    /// Leaves that all cells may see. Calls for a cell come in ascending order of leaves.
    fn emit(&mut self, leaves: LeafRange, cells: [u16; 4]);
    /// Leaves that one view may see, in the same order: several ranges, starts and ends, as [`VisibleSet::append_pairs`] takes them.
    fn append_to_view(&mut self, ranges: &[[u32; 2]], view: u16);
}

impl<S: Sink> Kernel for Sweep<'_, S> {
    type Output = CullStats;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> CullStats {
        let Self { tree, lattice, start, memory, mut sink } = self;
        let Memory { stack, pending, planes } = memory;
        planes.set(lattice, tree.origin());
        let mut stats = CullStats::default();
        let offset = tree.origin() - lattice.eye();
        stack.clear();
        stack.extend(start.iter().rev());
        loop {
            if S::TAKES_VIEWS && (stack.is_empty() || pending.is_full()) {
                pending.finish(lanes, tree, offset, planes, &mut sink, &mut stats);
            }
            let Some(visit) = stack.pop() else {
                return stats;
            };
            if visit.node == Visit::EMIT {
                emit(visit.leaves, visit.slots, pending, &mut sink);
                continue;
            }
            if sink.takes(&visit) {
                continue;
            }
            if S::TAKES_VIEWS
                && let Some(cuts) = Cuts::of(&visit, lattice, planes)
            {
                pending.take(&visit, &cuts);
                continue;
            }
            let node = &tree.nodes()[visit.node as usize];
            let boxes = Boxes::of(lanes, node, offset, planes);
            let found = boxes.classify(lanes, visit.slots, visit.mask, planes, &mut (), &mut stats);
            let axes = &tree.axes()[visit.node as usize];
            let looked = Looked { node, axes, boxes: &boxes, lattice, planes };
            let first_new = stack.len();
            let mut alive = found.alive;
            while alive != 0 {
                let lane = alive.trailing_zeros() as usize;
                alive &= alive - 1;
                let leaves = node.leaves(lane, visit.leaves.end);
                match found.state(lanes, lane, visit.slots, &looked, &mut (), &mut stats) {
                    State::Unseen => {}
                    State::Seen(slots) if stack.len() == first_new => emit(leaves, lattice.cells(slots), pending, &mut sink),
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
            stack[first_new..].reverse();
        }
    }
}

/// Emits leaves, where cells are taken behind what is pending.
#[inline(always)]
fn emit<S: Sink>(leaves: LeafRange, cells: [u16; 4], pending: &mut Pending, sink: &mut S) {
    if S::TAKES_VIEWS {
        pending.emit(leaves, cells);
    } else {
        sink.emit(leaves, cells);
    }
}

/// Puts ranges into the views' sets.
pub(super) struct ToSets<'a> {
    pub lattice: &'a Lattice,
    /// By `ViewId`.
    pub sets: &'a mut [VisibleSet],
}

impl Sink for ToSets<'_> {
    const TAKES_VIEWS: bool = true;

    #[inline(always)]
    fn takes(&mut self, _: &Visit) -> bool {
        false
    }

    #[inline(always)]
    fn emit(&mut self, leaves: LeafRange, [left, right, bottom, top]: [u16; 4]) {
        if right == left + 1 && top == bottom + 1 {
            self.sets[usize::from(self.lattice.view(left, bottom))].push(leaves);
            return;
        }
        for row in bottom..top {
            for view in self.lattice.row(row, left..right) {
                self.sets[usize::from(*view)].push(leaves);
            }
        }
    }

    #[inline(always)]
    fn append_to_view(&mut self, ranges: &[[u32; 2]], view: u16) {
        self.sets[usize::from(view)].append_pairs(ranges);
    }
}

/// Keeps the nodes of at most `grain` leaves for later, and in order with them what is found above.
pub(super) struct ToVisits<'a> {
    pub visits: &'a mut Vec<Visit>,
    pub grain: u32,
}

impl Sink for ToVisits<'_> {
    // Visits are shared out by leaves: they come in order whatever the cell.
    const TAKES_VIEWS: bool = false;

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
    fn append_to_view(&mut self, _: &[[u32; 2]], _: u16) {}
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DQuat, DVec3};
    use mullion_common::geometry::{Aabb, Obb};
    use mullion_common::scene::ObjectHierarchy;
    use mullion_common::wall::{ViewId, WallConfig};

    use super::super::lanes::{Plain, run_on_best};
    use super::*;
    use crate::tree::hierarchy_over;

    /// Boxes of all sizes, half of them turned, far and wide around the eye: areas of one word of marks and of many.
    fn tree() -> WideTree {
        let bound = |i: u32| {
            let at = |step: f64| (f64::from(i) * step).fract() * 80.0 - 40.0;
            let turn = if i.is_multiple_of(2) { DQuat::IDENTITY } else { DQuat::from_scaled_axis(DVec3::splat(f64::from(i))) };
            let half = DVec3::new(1.0, 2.0, 3.0) * (0.05 + f64::from(i % 17) * 0.02);
            let center = DVec3::new(at(0.754_877_67), at(0.569_840_29) * 0.5, at(0.430_159_71) - 30.0);
            Obb::from(Aabb { min: -half, max: half }).transformed(&DAffine3::from_rotation_translation(turn, center))
        };
        let (nodes, _) = hierarchy_over(&(0..20_000).map(bound).collect::<Vec<_>>());
        WideTree::new(&ObjectHierarchy::new(nodes).expect("a tree"))
    }

    #[test]
    fn vectors_and_plain_numbers_find_the_same_to_the_bit() {
        let tree = tree();
        let [mut memory, mut other] = [Memory::default(), Memory::default()];
        let mut seen = 0;
        for wall in [include_str!("../../../../configs/wall_4x4.toml"), include_str!("../../../../configs/cave_4.toml")] {
            let wall = WallConfig::parse(wall).expect("a wall");
            let eyes = wall.default_eyes();
            let frusta = |pose: &DAffine3| -> Vec<_> {
                eyes.iter().zip(0..).map(|(eye, view)| wall.frustum(ViewId(view), *eye, pose)).collect()
            };
            for mut lattice in Lattice::of_views(&frusta(&DAffine3::IDENTITY)) {
                for frame in 0..12 {
                    let pose = DAffine3::from_rotation_translation(
                        DQuat::from_rotation_y(f64::from(frame) * 0.55),
                        DVec3::new(1.0, 2.0, -3.0) * f64::from(frame),
                    );
                    lattice.place(&pose);
                    let start = [Visit::all(&tree, &lattice)];
                    let mut sets: [Vec<VisibleSet>; 2] = Default::default();
                    sets.iter_mut().for_each(|sets| sets.resize_with(eyes.len(), VisibleSet::default));
                    let [plain, best] = &mut sets;
                    let sink = ToSets { lattice: &lattice, sets: plain };
                    let sweep = Sweep { tree: &tree, lattice: &lattice, start: &start, memory: &mut memory, sink };
                    let plain_stats = Plain.run(sweep);
                    let sink = ToSets { lattice: &lattice, sets: best };
                    let sweep = Sweep { tree: &tree, lattice: &lattice, start: &start, memory: &mut other, sink };
                    assert_eq!(run_on_best(sweep), plain_stats);
                    assert_eq!(sets[0], sets[1]);
                    seen += sets[0].iter().map(VisibleSet::len).sum::<u32>();
                }
            }
        }
        assert!(seen > 100_000, "{seen}");
    }
}
