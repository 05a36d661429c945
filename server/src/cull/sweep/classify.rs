//! A node's eight boxes against the planes of a lattice.

use glam::DVec3;
use mullion_common::geometry::{ABSOLUTE_ROUNDING, RELATIVE_SLACK};

use super::lanes::Lanes;
use super::lattice::{Lattice, RelativePlane};
use crate::cull::CullStats;
use crate::tree::{LANES, LeafAxes, WideNode};

/// Bits of a mask: outer sides of a rectangle of slots, and the near plane, that still may cut a box. Bottom and top stand
/// two bits above left and right.
pub(super) const LEFT: u8 = 1;
pub(super) const RIGHT: u8 = 2;
pub(super) const BOTTOM: u8 = LEFT << 2;
pub(super) const TOP: u8 = RIGHT << 2;
pub(super) const NEAR: u8 = 16;
/// All of them.
pub(super) const ALL_SIDES: u8 = 31;

/// Share of the distances that counts as rounding: what culling in `f64` takes, and as much again for the sums in `f32`,
/// whose error stays below 2⁻²¹ of the same distances.
const SLACK: f32 = (RELATIVE_SLACK * 2.0) as f32;

/// A plane for the lanes, relative to the eye.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LanePlane {
    normal: [f32; 3],
    offset_m: f32,
    /// The normal's coordinates without their signs.
    absolute: [f32; 3],
    /// The normal's coordinates by [`LeafAxes::PARTS`].
    by_parts: [f32; 3],
}

impl From<&RelativePlane> for LanePlane {
    fn from(plane: &RelativePlane) -> Self {
        let normal = plane.normal.as_vec3();
        Self {
            normal: normal.to_array(),
            offset_m: plane.offset_m as f32,
            absolute: normal.abs().to_array(),
            by_parts: normal.to_array().map(|part| part / LeafAxes::PARTS),
        }
    }
}

/// The planes of a lattice for the lanes.
#[derive(Debug, Default)]
pub(super) struct LanePlanes {
    near: LanePlane,
    /// Columns and rows.
    axes: [Vec<LanePlane>; 2],
    /// What absolute coordinates of eye and tree round, metres.
    absolute_m: f32,
    /// Memory of [`Boxes::classify`]: for each plane inside the slots, the lanes wholly on its negative side.
    negative: Vec<u8>,
}

impl LanePlanes {
    /// Takes the planes of a placed lattice, for a tree whose boxes are relative to `origin`.
    pub(super) fn set(&mut self, lattice: &Lattice, origin: DVec3) {
        let absolute_m = lattice.eye().abs().element_sum() + origin.abs().element_sum();
        self.absolute_m = (absolute_m * ABSOLUTE_ROUNDING) as f32;
        self.near = lattice.near().into();
        for (own, planes) in self.axes.iter_mut().zip(lattice.planes()) {
            own.clear();
            own.extend(planes.iter().map(LanePlane::from));
        }
        self.negative.resize(self.axes[0].len().max(self.axes[1].len()), 0);
    }

    /// The near plane.
    #[inline(always)]
    pub(super) fn near(&self) -> &LanePlane {
        &self.near
    }

    /// Columns' planes, or rows'.
    #[inline(always)]
    pub(super) fn of_axis(&self, axis: usize) -> &[LanePlane] {
        &self.axes[axis]
    }
}

/// Told how far from another answer each test was.
pub(super) trait Margins<L: Lanes> {
    /// A plane was tested: `high` and `low` are the boxes' greatest and least signed distances, metres, and the answers change
    /// at `-slack_m` and `slack_m`.
    fn tested(&mut self, lanes: L, high: L::Wide, low: L::Wide, slack_m: f32);
    /// The last plane tested leaves these lanes unseen, whatever the others say.
    fn decided(&mut self, lanes: L, unseen: u8);
    /// A plane was tested against one leaf's oriented box.
    fn tested_leaf(&mut self, high_m: f32, low_m: f32, slack_m: f32);
}

/// Nobody asks.
impl<L: Lanes> Margins<L> for () {
    #[inline(always)]
    fn tested(&mut self, _: L, _: L::Wide, _: L::Wide, _: f32) {}
    #[inline(always)]
    fn decided(&mut self, _: L, _: u8) {}
    #[inline(always)]
    fn tested_leaf(&mut self, _: f32, _: f32, _: f32) {}
}

/// The boxes of a node, relative to the eye, metres.
pub(super) struct Boxes<L: Lanes> {
    middle: [L::Wide; 3],
    /// Half of each edge.
    half: [L::Wide; 3],
    /// Greatest distance of any of them from the eye along each axis.
    far_m: [f32; 3],
    /// Half of a step of the node along each axis.
    half_step_m: L::Axes,
    slack_m: f32,
    /// Lanes with something in them.
    pub alive: u8,
}

impl<L: Lanes> Boxes<L> {
    /// `offset` leads from the eye to the tree's origin.
    #[inline(always)]
    pub(super) fn of(lanes: L, node: &WideNode, offset: DVec3, planes: &LanePlanes) -> Self {
        let [offset, half_step_m] = lanes.place(node, &[offset.x, offset.y, offset.z, 0.0]);
        let far_m = lanes.reach(offset, half_step_m, 510.0);
        let reach_m = far_m[0] + far_m[1] + far_m[2] + planes.near.offset_m.abs();
        let (offset, half_step) = (lanes.spread(offset), lanes.spread(half_step_m));
        let x = Self::span(lanes, &node.min[0], &node.max[0], half_step[0], offset[0]);
        let y = Self::span(lanes, &node.min[1], &node.max[1], half_step[1], offset[1]);
        let z = Self::span(lanes, &node.min[2], &node.max[2], half_step[2], offset[2]);
        Self {
            middle: [x.0, y.0, z.0],
            half: [x.1, y.1, z.1],
            far_m,
            half_step_m,
            slack_m: reach_m * SLACK + planes.absolute_m,
            // Empty ones end before they begin.
            alive: !lanes.negative(x.1),
        }
    }

    /// Distance from the eye within which all of them lie, rounded up.
    pub(super) fn far_m(&self) -> f32 {
        const UP: f32 = 1.0 + 1e-5;
        let [x, y, z] = self.far_m;
        (x * x + y * y + z * z).sqrt() * UP
    }

    /// Middle and half length along one axis.
    #[inline(always)]
    fn span(lanes: L, min: &[u8; LANES], max: &[u8; LANES], half_step: L::Wide, offset: L::Wide) -> (L::Wide, L::Wide) {
        let (low, high) = (lanes.widen(min), lanes.widen(max));
        let middle = lanes.add(lanes.mul(lanes.add(low, high), half_step), offset);
        (middle, lanes.mul(lanes.sub(high, low), half_step))
    }

    /// v · n of each lane.
    #[inline(always)]
    fn dot(lanes: L, v: &[L::Wide; 3], n: &[f32; 3]) -> L::Wide {
        let xy = lanes.add(lanes.mul(v[0], lanes.splat(n[0])), lanes.mul(v[1], lanes.splat(n[1])));
        lanes.add(xy, lanes.mul(v[2], lanes.splat(n[2])))
    }

    /// The lanes wholly on the negative side of a plane, and those wholly on the positive one.
    #[inline(always)]
    pub(super) fn sides(&self, lanes: L, plane: &LanePlane, margins: &mut impl Margins<L>) -> (u8, u8) {
        let middle = lanes.add(Self::dot(lanes, &self.middle, &plane.normal), lanes.splat(plane.offset_m));
        let radius = Self::dot(lanes, &self.half, &plane.absolute);
        let (high, low) = (lanes.add(middle, radius), lanes.sub(middle, radius));
        margins.tested(lanes, high, low, self.slack_m);
        let negative = lanes.below(high, lanes.splat(-self.slack_m));
        let positive = lanes.below(lanes.splat(self.slack_m), low);
        (negative, positive)
    }

    /// Greatest and least signed distances of the oriented boxes in the lanes from a plane: no less than they are, and no more.
    #[inline(always)]
    fn oriented_extent(&self, lanes: L, plane: &LanePlane, axes: &LeafAxes) -> (L::Wide, L::Wide) {
        // Half a part for each of three half-axes, and what the sums here round.
        const OFF: f32 = 1.6 / LeafAxes::PARTS;
        let middle = lanes.add(Self::dot(lanes, &self.middle, &plane.normal), lanes.splat(plane.offset_m));
        let radius = Self::dot(lanes, &self.half, &plane.absolute);
        // Half a step for the middle.
        let [x, y, z] = lanes.to_three(self.half_step_m);
        let step_off = (plane.absolute[0] * x + plane.absolute[1] * y + plane.absolute[2] * z) * (2.0 * 0.51);
        let off = lanes.add(lanes.mul(radius, lanes.splat(OFF)), lanes.splat(step_off));
        let part = [
            lanes.mul(self.half[0], lanes.splat(plane.by_parts[0])),
            lanes.mul(self.half[1], lanes.splat(plane.by_parts[1])),
            lanes.mul(self.half[2], lanes.splat(plane.by_parts[2])),
        ];
        let mut radius = off;
        for shares in &axes.shares {
            let x = lanes.mul(lanes.widen_signed(&shares[0]), part[0]);
            let y = lanes.mul(lanes.widen_signed(&shares[1]), part[1]);
            let z = lanes.mul(lanes.widen_signed(&shares[2]), part[2]);
            radius = lanes.add(radius, lanes.abs(lanes.add(lanes.add(x, y), z)));
        }
        (lanes.add(middle, radius), lanes.sub(middle, radius))
    }

    /// The lanes whose oriented boxes lie wholly on the negative side of a plane, and wholly on the positive one.
    #[inline(always)]
    pub(super) fn oriented_sides(&self, lanes: L, plane: &LanePlane, axes: &LeafAxes) -> (u8, u8) {
        let (high, low) = self.oriented_extent(lanes, plane, axes);
        (lanes.below(high, lanes.splat(-self.slack_m)), lanes.below(lanes.splat(self.slack_m), low))
    }

    /// The same of one lane: −1, 1, or 0 where the plane may cut it.
    #[inline(always)]
    fn oriented_side(&self, lanes: L, plane: &LanePlane, axes: &LeafAxes, lane: usize, margins: &mut impl Margins<L>) -> i8 {
        let (high, low) = self.oriented_extent(lanes, plane, axes);
        margins.tested_leaf(lanes.to_array(high)[lane], lanes.to_array(low)[lane], self.slack_m);
        let negative = lanes.below(high, lanes.splat(-self.slack_m));
        let positive = lanes.below(lanes.splat(self.slack_m), low);
        ((positive >> lane) & 1) as i8 - ((negative >> lane) & 1) as i8
    }

    /// What is to be known of lanes that may meet `slots` and be cut by the sides of `mask`.
    #[inline(always)]
    pub(super) fn classify(
        &self,
        lanes: L,
        slots: [u16; 4],
        mask: u8,
        planes: &mut LanePlanes,
        margins: &mut impl Margins<L>,
        stats: &mut CullStats,
    ) -> Found {
        let LanePlanes { near, axes, negative: negatives, .. } = planes;
        let mut found = Found { alive: self.alive, settled: 0, low: [0; 2], high: [0; 2], masks: 0 };
        let mut tests = 0;
        if mask & NEAR != 0 {
            let (negative, positive) = self.sides(lanes, near, margins);
            margins.decided(lanes, negative);
            found.alive &= !negative;
            found.masks |= SPREAD[usize::from(!positive)] * u64::from(NEAR);
            tests += 1;
        }
        for axis in 0..2 {
            let [low, high] = [slots[axis * 2], slots[axis * 2 + 1]].map(usize::from);
            let planes = &axes[axis][..];
            // Lanes that leave out the first slot, and those that leave out the last one.
            let (mut after_first, mut before_last) = (0, 0);
            if high - low > 1 {
                let mut beyond = !0u8;
                for k in low + 1..high {
                    let (negative, positive) = self.sides(lanes, &planes[k], margins);
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
            if mask & (LEFT << (2 * axis)) != 0 {
                let (negative, positive) = self.sides(lanes, &planes[low], margins);
                margins.decided(lanes, negative);
                found.alive &= !negative;
                found.masks |= SPREAD[usize::from(!positive & !after_first)] * u64::from(LEFT << (2 * axis));
                tests += 1;
            }
            if mask & (RIGHT << (2 * axis)) != 0 {
                let (negative, positive) = self.sides(lanes, &planes[high], margins);
                margins.decided(lanes, positive);
                found.alive &= !positive;
                found.masks |= SPREAD[usize::from(!negative & !before_last)] * u64::from(RIGHT << (2 * axis));
                tests += 1;
            }
        }
        stats.nodes_visited += u64::from(self.alive.count_ones());
        stats.plane_tests += tests * u64::from(self.alive.count_ones());
        found.settled = found.find_settled(slots);
        found
    }
}

/// Most slots that one visit leaves out at either end: both together are what a byte counts. The visits below leave out more.
const MAX_LEFT_OUT: usize = 127;

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
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    /// Lanes that may be seen.
    pub alive: u8,
    /// Of these, the lanes that lie in one slot and are cut by nothing.
    settled: u8,
    /// Slots left out at the low end of each axis, and at the high end.
    low: [u64; 2],
    high: [u64; 2],
    /// The sides that may cut it.
    masks: u64,
}

/// Where a lane stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    /// No view may see it.
    Unseen,
    /// All views in these slots may see all of it; there is one.
    Seen([u16; 4]),
    /// Its children are to be asked: with these slots, and these sides that may cut it.
    Open([u16; 4], u8),
}

impl Found {
    /// Where a lane stands, which was classified with `slots`.
    #[inline(always)]
    pub(super) fn state<L: Lanes>(
        &self,
        lanes: L,
        lane: usize,
        slots: [u16; 4],
        looked: &Looked<'_, L>,
        margins: &mut impl Margins<L>,
        stats: &mut CullStats,
    ) -> State {
        let (mut slots, mask) = self.slots(lane, slots);
        if self.settled & (1 << lane) == 0 {
            if slots[0] >= slots[1] || slots[2] >= slots[3] {
                return State::Unseen;
            }
            let child = looked.node.child[lane];
            if child & WideNode::LEAF == 0 {
                return State::Open(slots, mask);
            }
            if child & WideNode::ORIENTED != 0 {
                match looked.refine(lanes, lane, slots, mask, margins, stats) {
                    Some(refined) => slots = refined,
                    None => return State::Unseen,
                }
            }
        }
        let cells = looked.lattice.cells(slots);
        let is_in_gap = cells[0] >= cells[1] || cells[2] >= cells[3];
        if is_in_gap { State::Unseen } else { State::Seen(slots) }
    }

    /// The lanes that lie in one slot and are cut by nothing: bytes side by side, all lanes at once.
    #[inline(always)]
    fn find_settled(&self, [left, right, bottom, top]: [u16; 4]) -> u8 {
        const ONES: u64 = 0x0101_0101_0101_0101;
        let [across, up] = [right - left, top - bottom];
        if across > MAX_LEFT_OUT as u16 + 1 || up > MAX_LEFT_OUT as u16 + 1 {
            return 0; // does not fit a byte; the visits below will
        }
        // Zero in a lane that leaves out all slots but one, on both axes, and has no side that may cut it. Left out at either end
        // are at most as many as there are planes between slots: bytes do not run into one another.
        let rest = |axis: usize, slots: u16| (self.low[axis] + self.high[axis]) ^ (u64::from(slots - 1) * ONES);
        zero_bytes(rest(0, across) | rest(1, up) | self.masks)
    }

    /// Keeps what [`Found::state`] has found out of a lane.
    pub(super) fn keep(&mut self, lane: usize, slots: [u16; 4], state: &State) {
        match state {
            State::Unseen => self.alive &= !(1 << lane),
            State::Open(..) => {}
            State::Seen(seen) => {
                let set = |of: &mut u64, value: u16| *of = (*of & !(0xff << (8 * lane))) | (u64::from(value) << (8 * lane));
                for axis in 0..2 {
                    set(&mut self.low[axis], seen[axis * 2] - slots[axis * 2]);
                    set(&mut self.high[axis], slots[axis * 2 + 1] - seen[axis * 2 + 1]);
                }
            }
        }
    }

    /// Where a lane stands, after [`Found::keep`].
    pub(super) fn kept_state(&self, lane: usize, slots: [u16; 4], node: &WideNode) -> State {
        if self.alive & (1 << lane) == 0 {
            return State::Unseen;
        }
        let (slots, mask) = self.slots(lane, slots);
        let is_settled = mask == 0 && slots[1] - slots[0] == 1 && slots[3] - slots[2] == 1;
        if is_settled || node.child[lane] & WideNode::LEAF != 0 { State::Seen(slots) } else { State::Open(slots, mask) }
    }

    /// The slots that a lane may meet, of `slots`, and the sides that may cut it.
    #[inline(always)]
    fn slots(&self, lane: usize, [left, right, bottom, top]: [u16; 4]) -> ([u16; 4], u8) {
        let byte = |of: u64| (of >> (8 * lane)) as u8;
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

/// A bit for every byte that is zero.
#[inline(always)]
fn zero_bytes(bytes: u64) -> u8 {
    const SIGNS: u64 = 0x8080_8080_8080_8080;
    let zeros = !(((bytes & !SIGNS) + !SIGNS) | bytes | !SIGNS);
    // Gathers the bytes' high bits.
    (zeros >> 7).wrapping_mul(0x0102_0408_1020_4080).to_be_bytes()[0]
}

/// A node that is looked at, and what it is held against.
pub(super) struct Looked<'a, L: Lanes> {
    pub node: &'a WideNode,
    pub axes: &'a LeafAxes,
    pub boxes: &'a Boxes<L>,
    pub lattice: &'a Lattice,
    pub planes: &'a LanePlanes,
}

impl<L: Lanes> Looked<'_, L> {
    /// The slots that a leaf's oriented box may meet, of those that its axis-aligned box may meet; none when no view sees it.
    #[inline(always)]
    fn refine(
        &self,
        lanes: L,
        lane: usize,
        slots: [u16; 4],
        mask: u8,
        margins: &mut impl Margins<L>,
        stats: &mut CullStats,
    ) -> Option<[u16; 4]> {
        let Self { axes, boxes, planes, .. } = self;
        stats.plane_tests += u64::from(mask.count_ones()) + u64::from(slots[1] - slots[0] + slots[3] - slots[2] - 2);
        if mask & NEAR != 0 && boxes.oriented_side(lanes, planes.near(), axes, lane, margins) < 0 {
            return None;
        }
        let mut refined = [0; 4];
        for axis in 0..2 {
            let (planes, low, high) = (planes.of_axis(axis), slots[axis * 2], slots[axis * 2 + 1]);
            if mask & (LEFT << (2 * axis)) != 0 && boxes.oriented_side(lanes, &planes[usize::from(low)], axes, lane, margins) < 0
            {
                return None;
            }
            if mask & (RIGHT << (2 * axis)) != 0
                && boxes.oriented_side(lanes, &planes[usize::from(high)], axes, lane, margins) > 0
            {
                return None;
            }
            let (mut first, mut end) = (low, low + 1);
            let mut is_beyond = true;
            for k in low + 1..high {
                let side = boxes.oriented_side(lanes, &planes[usize::from(k)], axes, lane, margins);
                is_beyond &= side > 0;
                first += u16::from(is_beyond);
                end = if side < 0 { end } else { k + 1 };
            }
            refined[axis * 2] = first;
            refined[axis * 2 + 1] = end;
        }
        Some(refined)
    }
}
