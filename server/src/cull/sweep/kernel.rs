//! The sweep of one lattice over the wide tree.

use glam::DVec3;
use mullion_common::geometry::{Obb, RELATIVE_SLACK};
use mullion_common::scene::{NodeId, ObjectHierarchy};
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::lanes::{Kernel, Lanes};
use super::lattice::{Lattice, RelativePlane};
use crate::cull::CullStats;
use crate::tree::{LANES, WideNode, WideTree};

/// Bits of a mask: outer sides of a rectangle of slots, and the near plane, that still may cut a box. Bottom and top stand
/// two bits above left and right.
const LEFT: u8 = 1;
const RIGHT: u8 = 2;
const NEAR: u8 = 16;
/// All of them.
const ALL: u8 = 31;

/// Share of the distances that counts as rounding: what culling in `f64` takes, and as much again for the sums in `f32`,
/// whose error stays below 2⁻²¹ of the same distances.
const SLACK: f32 = (RELATIVE_SLACK * 2.0) as f32;

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
        Self { node: 0, leaves: LeafRange::new(0, tree.leaf_count()), slots: [0, across, 0, up], mask: ALL }
    }

    /// Whether leaves are to be emitted, not a node to be visited.
    pub(super) fn is_emission(&self) -> bool {
        self.node == Self::EMIT
    }
}

/// A plane for the lanes, relative to the eye.
#[derive(Clone, Copy, Debug, Default)]
struct LanePlane {
    normal: [f32; 3],
    offset_m: f32,
    /// The normal's coordinates without their signs.
    absolute: [f32; 3],
}

impl From<&RelativePlane> for LanePlane {
    fn from(plane: &RelativePlane) -> Self {
        let normal = plane.normal.as_vec3();
        Self { normal: normal.to_array(), offset_m: plane.offset_m as f32, absolute: normal.abs().to_array() }
    }
}

/// What a sweep needs, kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Memory {
    stack: Vec<Visit>,
    near: LanePlane,
    planes: [Vec<LanePlane>; 2],
    /// For each plane inside the rectangle, the lanes wholly on its negative side.
    negative: Vec<u8>,
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
        memory.near = lattice.near().into();
        for (own, planes) in memory.planes.iter_mut().zip(lattice.planes()) {
            own.clear();
            own.extend(planes.iter().map(LanePlane::from));
        }
        memory.negative.resize(memory.planes[0].len().max(memory.planes[1].len()), 0);
        let mut stats = CullStats::default();
        let offset = tree.origin() - lattice.eye();
        let Memory { stack, near, planes, negative } = memory;
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
            let boxes = Boxes::of(lanes, node, offset, near.offset_m);
            let found = boxes.classify(lanes, &visit, near, planes, negative, &mut stats);
            let first_new = stack.len();
            let mut alive = found.alive;
            while alive != 0 {
                let lane = alive.trailing_zeros() as usize;
                alive &= alive - 1;
                let (mut slots, mask) = found.lane(lane, &visit);
                if slots[0] >= slots[1] || slots[2] >= slots[3] {
                    continue;
                }
                let end = if lane + 1 < LANES { node.first_leaf[lane + 1].min(visit.leaves.end) } else { visit.leaves.end };
                let leaves = LeafRange::new(node.first_leaf[lane], end);
                let child = node.child[lane];
                let is_settled = mask == 0 && slots[1] - slots[0] == 1 && slots[3] - slots[2] == 1;
                if !is_settled {
                    if child & WideNode::LEAF == 0 {
                        lanes.prefetch(&tree.nodes()[child as usize]);
                        stack.push(Visit { node: child, leaves, slots, mask });
                        continue;
                    }
                    if child & WideNode::ORIENTED != 0 {
                        let bound = &hierarchy.node(NodeId(child & WideNode::NODE)).bound;
                        if !refine(bound, lattice, &mut slots, mask, &mut stats) {
                            continue;
                        }
                    }
                }
                let cells = lattice.cells(slots);
                if cells[0] >= cells[1] || cells[2] >= cells[3] {
                    continue; // in a gap
                }
                if stack.len() == first_new {
                    sink.emit(leaves, cells);
                } else {
                    stack.push(Visit { node: Visit::EMIT, leaves, slots: cells, mask });
                }
            }
            stack[first_new..].reverse();
        }
        sink.finish();
        stats
    }
}

/// The boxes of a node, relative to the eye, metres.
struct Boxes<L: Lanes> {
    middle: [L::Wide; 3],
    /// Half of each edge.
    half: [L::Wide; 3],
    slack_m: f32,
    alive: u8,
}

impl<L: Lanes> Boxes<L> {
    #[inline(always)]
    fn of(lanes: L, node: &WideNode, offset: DVec3, near_m: f32) -> Self {
        let offset = [
            (offset.x + f64::from(node.origin[0])) as f32,
            (offset.y + f64::from(node.origin[1])) as f32,
            (offset.z + f64::from(node.origin[2])) as f32,
        ];
        let half_step = node.step_m().map(|step| step * 0.5);
        let reach = |axis: usize| offset[axis].abs() + 510.0 * half_step[axis];
        let slack_m = (reach(0) + reach(1) + reach(2) + near_m.abs()) * SLACK;
        let x = Self::span(lanes, &node.min[0], &node.max[0], half_step[0], offset[0]);
        let y = Self::span(lanes, &node.min[1], &node.max[1], half_step[1], offset[1]);
        let z = Self::span(lanes, &node.min[2], &node.max[2], half_step[2], offset[2]);
        let is_empty = lanes.below(x.1, lanes.splat(0.0));
        Self { middle: [x.0, y.0, z.0], half: [x.1, y.1, z.1], slack_m, alive: !is_empty }
    }

    /// Middle and half length along one axis.
    #[inline(always)]
    fn span(lanes: L, min: &[u8; LANES], max: &[u8; LANES], half_step: f32, offset: f32) -> (L::Wide, L::Wide) {
        let (low, high) = (lanes.widen(min), lanes.widen(max));
        let step = lanes.splat(half_step);
        let middle = lanes.add(lanes.mul(lanes.add(low, high), step), lanes.splat(offset));
        (middle, lanes.mul(lanes.sub(high, low), step))
    }

    /// v · n of each lane.
    #[inline(always)]
    fn dot(lanes: L, v: &[L::Wide; 3], n: &[f32; 3]) -> L::Wide {
        let xy = lanes.add(lanes.mul(v[0], lanes.splat(n[0])), lanes.mul(v[1], lanes.splat(n[1])));
        lanes.add(xy, lanes.mul(v[2], lanes.splat(n[2])))
    }

    /// The lanes wholly on the negative side of a plane, and those wholly on the positive one.
    #[inline(always)]
    fn sides(&self, lanes: L, plane: &LanePlane) -> (u8, u8) {
        let middle = lanes.add(Self::dot(lanes, &self.middle, &plane.normal), lanes.splat(plane.offset_m));
        let radius = Self::dot(lanes, &self.half, &plane.absolute);
        let negative = lanes.below(lanes.add(middle, radius), lanes.splat(-self.slack_m));
        let positive = lanes.below(lanes.splat(self.slack_m), lanes.sub(middle, radius));
        (negative, positive)
    }

    #[inline(always)]
    fn classify(
        &self,
        lanes: L,
        visit: &Visit,
        near: &LanePlane,
        planes: &[Vec<LanePlane>; 2],
        negatives: &mut [u8],
        stats: &mut CullStats,
    ) -> Found {
        let mut found = Found { alive: self.alive, low: [0; 2], high: [0; 2], masks: 0 };
        let mut tests = 0;
        if visit.mask & NEAR != 0 {
            let (negative, positive) = self.sides(lanes, near);
            found.alive &= !negative;
            found.masks |= SPREAD[usize::from(!positive)] * u64::from(NEAR);
            tests += 1;
        }
        for axis in 0..2 {
            let [low, high] = [visit.slots[axis * 2], visit.slots[axis * 2 + 1]].map(usize::from);
            let planes = &planes[axis][..];
            // Lanes that leave out the first slot, and those that leave out the last one.
            let (mut after_first, mut before_last) = (0, 0);
            if high - low > 1 {
                let mut beyond = !0u8;
                for k in low + 1..high {
                    let (negative, positive) = self.sides(lanes, &planes[k]);
                    negatives[k] = negative;
                    if k - low <= MAX_LEFT_OUT {
                        beyond &= positive;
                        found.low[axis] += SPREAD[usize::from(beyond)];
                        if k == low + 1 {
                            after_first = beyond;
                        }
                    }
                }
                let mut before = !0u8;
                for k in (low + 1..high).rev().take(MAX_LEFT_OUT) {
                    before &= negatives[k];
                    found.high[axis] += SPREAD[usize::from(before)];
                    if k == high - 1 {
                        before_last = before;
                    }
                }
                tests += (high - low - 1) as u64;
            }
            if visit.mask & (LEFT << (2 * axis)) != 0 {
                let (negative, positive) = self.sides(lanes, &planes[low]);
                found.alive &= !negative;
                found.masks |= SPREAD[usize::from(!positive & !after_first)] * u64::from(LEFT << (2 * axis));
                tests += 1;
            }
            if visit.mask & (RIGHT << (2 * axis)) != 0 {
                let (negative, positive) = self.sides(lanes, &planes[high]);
                found.alive &= !positive;
                found.masks |= SPREAD[usize::from(!negative & !before_last)] * u64::from(RIGHT << (2 * axis));
                tests += 1;
            }
        }
        stats.nodes_visited += u64::from(self.alive.count_ones());
        stats.plane_tests += tests * u64::from(self.alive.count_ones());
        found
    }
}

/// Most slots that one visit leaves out at either end: what a byte counts. The visits below leave out more.
const MAX_LEFT_OUT: usize = 255;

/// A mask's bits as bytes, 0 or 1.
const SPREAD: [u64; 256] = {
    let mut spread = [0; 256];
    let mut mask = 0;
    while mask < 256 {
        let mut lane = 0;
        while lane < 8 {
            spread[mask] |= ((mask as u64 >> lane) & 1) << (8 * lane);
            lane += 1;
        }
        mask += 1;
    }
    spread
};

/// What is known of a node's lanes. Of each `u64`, a byte a lane.
///
/// A slot is left out only because the box lies wholly beyond its far edge or wholly before its near one, which holds for
/// boxes that reach behind the eye, too.
struct Found {
    /// Lanes that may be seen.
    alive: u8,
    /// Slots left out at the low end of each axis, and at the high end.
    low: [u64; 2],
    high: [u64; 2],
    /// The sides that may cut it.
    masks: u64,
}

impl Found {
    /// The slots that a lane may meet, and the sides that may cut it.
    #[inline(always)]
    fn lane(&self, lane: usize, visit: &Visit) -> ([u16; 4], u8) {
        let byte = |of: u64| (of >> (8 * lane)) as u8;
        let [left, right, bottom, top] = visit.slots;
        // Both ends may leave out the same slots, and more than there are.
        let slots = [
            left + u16::from(byte(self.low[0])),
            right - u16::from(byte(self.high[0])),
            bottom + u16::from(byte(self.low[1])),
            top - u16::from(byte(self.high[1])),
        ];
        (slots, byte(self.masks))
    }
}

/// Whether a leaf's oriented box may be seen, and in which of the slots that its axis-aligned box may meet.
#[inline(always)]
fn refine(bound: &Obb, lattice: &Lattice, slots: &mut [u16; 4], mask: u8, stats: &mut CullStats) -> bool {
    let offset = bound.center - lattice.eye();
    let distance_m = offset.x.abs() + offset.y.abs() + offset.z.abs();
    // −1: wholly on the negative side, 1: wholly on the positive one.
    let mut side = |plane: &RelativePlane| {
        stats.plane_tests += 1;
        let middle_m = plane.normal.dot(offset) + plane.offset_m;
        let radius_m = bound.radius_along(plane.normal);
        let slack_m = (distance_m + radius_m) * RELATIVE_SLACK;
        i8::from(middle_m - radius_m > slack_m) - i8::from(middle_m + radius_m < -slack_m)
    };
    if mask & NEAR != 0 && side(lattice.near()) < 0 {
        return false;
    }
    for (axis, planes) in lattice.planes().into_iter().enumerate() {
        let [mut low, mut high] = [slots[axis * 2], slots[axis * 2 + 1]].map(usize::from);
        if mask & (LEFT << (2 * axis)) != 0 && side(&planes[low]) < 0 {
            return false;
        }
        if mask & (RIGHT << (2 * axis)) != 0 && side(&planes[high]) > 0 {
            return false;
        }
        let mut is_before_next = false;
        while low + 1 < high && !is_before_next {
            match side(&planes[low + 1]) {
                1 => low += 1,
                -1 => is_before_next = true,
                _ => break,
            }
        }
        while low + 2 < high && side(&planes[high - 1]) < 0 {
            high -= 1;
        }
        if is_before_next && low + 2 == high {
            high = low + 1;
        }
        slots[axis * 2] = low as u16;
        slots[axis * 2 + 1] = high as u16;
    }
    true
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
