//! The sweep of one lattice over the wide tree.

use glam::DVec3;
use mullion_common::geometry::{Obb, RELATIVE_SLACK};
use mullion_common::scene::{NodeId, ObjectHierarchy};
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::lanes::{Kernel, Lanes};
use super::lattice::{Lattice, RelativePlane};
use crate::cull::CullStats;
use crate::tree::{WideNode, WideTree};

/// Bits of a mask: outer sides of a rectangle of slots, and the near plane, that still may cut a box. Bottom and top stand
/// two bits above left and right.
const LEFT: u8 = 1;
const RIGHT: u8 = 2;
const NEAR: u8 = 16;
/// All of them.
pub(super) const ALL: u8 = 31;

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
}

/// A plane for the lanes, relative to the eye.
#[derive(Clone, Copy, Debug, Default)]
struct LanePlane {
    normal: [f32; 3],
    offset_m: f32,
}

impl From<&RelativePlane> for LanePlane {
    fn from(plane: &RelativePlane) -> Self {
        Self { normal: plane.normal.as_vec3().to_array(), offset_m: plane.offset_m as f32 }
    }
}

/// What a sweep needs, kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Memory {
    stack: Vec<Visit>,
    near: LanePlane,
    planes: [Vec<LanePlane>; 2],
    /// For each plane inside the rectangle, the lanes wholly beyond it and those wholly before it.
    sides: [Vec<(u8, u8)>; 2],
}

/// One sweep: a lattice, the tree, and where to start.
pub(super) struct Sweep<'a> {
    pub tree: &'a WideTree,
    pub hierarchy: &'a ObjectHierarchy,
    pub lattice: &'a Lattice,
    pub start: &'a [Visit],
    pub memory: &'a mut Memory,
    pub sets: &'a mut [VisibleSet],
}

impl Kernel for Sweep<'_> {
    type Output = CullStats;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> CullStats {
        let Self { tree, hierarchy, lattice, start, memory, sets } = self;
        memory.near = lattice.near().into();
        for (own, planes) in memory.planes.iter_mut().zip(lattice.planes()) {
            own.clear();
            own.extend(planes.iter().map(LanePlane::from));
        }
        for (sides, planes) in memory.sides.iter_mut().zip(&memory.planes) {
            sides.resize(planes.len(), (0, 0));
        }
        let mut stats = CullStats::default();
        let mut out = Output { lattice, sets, pending: LeafRange::new(0, 0), cells: [0; 4] };
        let offset = tree.origin() - lattice.eye();
        let Memory { stack, near, planes, sides } = memory;
        stack.clear();
        stack.extend(start.iter().rev());
        while let Some(visit) = stack.pop() {
            if visit.node == Visit::EMIT {
                out.emit(visit.leaves, visit.slots);
                continue;
            }
            let node = &tree.nodes()[visit.node as usize];
            let boxes = Boxes::of(lanes, node, offset, near.offset_m);
            let found = boxes.classify(lanes, &visit, near, planes, sides, &mut stats);
            let first_new = stack.len();
            let mut alive = found.alive;
            while alive != 0 {
                let lane = alive.trailing_zeros() as usize;
                alive &= alive - 1;
                let (slots, mask) = found.lane(lane, &visit, sides);
                if slots[0] >= slots[1] || slots[2] >= slots[3] {
                    continue;
                }
                let end = if lane + 1 < usize::from(node.lanes) { node.first_leaf[lane + 1] } else { visit.leaves.end };
                let leaves = LeafRange::new(node.first_leaf[lane], end);
                let child = node.child[lane];
                let is_single = slots[1] - slots[0] == 1 && slots[3] - slots[2] == 1;
                let is_settled = mask == 0 && is_single;
                let slots = if child & WideNode::LEAF != 0 && !is_settled {
                    let bound = &hierarchy.node(NodeId(child & !WideNode::LEAF)).bound;
                    match refine(bound, lattice, slots, mask, &mut stats) {
                        Some(slots) => slots,
                        None => continue,
                    }
                } else {
                    slots
                };
                let cells = lattice.cells(slots);
                if cells[0] >= cells[1] || cells[2] >= cells[3] {
                    continue; // in a gap
                }
                if child & WideNode::LEAF == 0 && !is_settled {
                    stack.push(Visit { node: child, leaves, slots, mask });
                } else if stack.len() == first_new {
                    out.emit(leaves, cells);
                } else {
                    stack.push(Visit { node: Visit::EMIT, leaves, slots: cells, mask });
                }
            }
            stack[first_new..].reverse();
        }
        out.flush();
        stats
    }
}

/// The boxes of a node, relative to the eye.
struct Boxes<L: Lanes> {
    /// Of each axis, twice the lanes' middles and sizes, in steps.
    middle: [L::Wide; 3],
    size: [L::Wide; 3],
    /// Half a step, metres.
    half_step_m: [f32; 3],
    /// From the eye to the node's origin.
    offset: [f32; 3],
    slack_m: f32,
    alive: u8,
    lanes_in_use: u8,
}

impl<L: Lanes> Boxes<L> {
    #[inline(always)]
    fn of(lanes: L, node: &WideNode, offset: DVec3, near_m: f32) -> Self {
        let half_step_m = node.step_m().map(|step| step * 0.5);
        let offset = [
            (offset.x + f64::from(node.origin[0])) as f32,
            (offset.y + f64::from(node.origin[1])) as f32,
            (offset.z + f64::from(node.origin[2])) as f32,
        ];
        let low = [lanes.widen(&node.min[0]), lanes.widen(&node.min[1]), lanes.widen(&node.min[2])];
        let high = [lanes.widen(&node.max[0]), lanes.widen(&node.max[1]), lanes.widen(&node.max[2])];
        let is_empty = lanes.below(high[0], low[0]);
        let sum = |v: [f32; 3]| v[0].abs() + v[1].abs() + v[2].abs();
        Self {
            middle: [lanes.add(low[0], high[0]), lanes.add(low[1], high[1]), lanes.add(low[2], high[2])],
            size: [lanes.sub(high[0], low[0]), lanes.sub(high[1], low[1]), lanes.sub(high[2], low[2])],
            half_step_m,
            offset,
            slack_m: (sum(offset) + 510.0 * sum(half_step_m) + near_m.abs()) * SLACK,
            alive: !is_empty,
            lanes_in_use: node.lanes,
        }
    }

    /// The lanes wholly on the negative side of a plane, and those wholly on the positive one.
    #[inline(always)]
    fn sides(&self, lanes: L, plane: &LanePlane) -> (u8, u8) {
        let n = plane.normal;
        let o = self.offset;
        let a = [n[0] * self.half_step_m[0], n[1] * self.half_step_m[1], n[2] * self.half_step_m[2]];
        let base = n[0] * o[0] + n[1] * o[1] + n[2] * o[2] + plane.offset_m;
        let middle = lanes.add(
            lanes.add(lanes.mul(self.middle[0], lanes.splat(a[0])), lanes.mul(self.middle[1], lanes.splat(a[1]))),
            lanes.add(lanes.mul(self.middle[2], lanes.splat(a[2])), lanes.splat(base)),
        );
        let radius = lanes.add(
            lanes.add(lanes.mul(self.size[0], lanes.splat(a[0].abs())), lanes.mul(self.size[1], lanes.splat(a[1].abs()))),
            lanes.mul(self.size[2], lanes.splat(a[2].abs())),
        );
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
        sides: &mut [Vec<(u8, u8)>; 2],
        stats: &mut CullStats,
    ) -> Found {
        let mut alive = self.alive;
        let mut tests = 0;
        let mut cut = [0u8; 5];
        if visit.mask & NEAR != 0 {
            let (negative, positive) = self.sides(lanes, near);
            alive &= !negative;
            cut[4] = !positive;
            tests += 1;
        }
        for axis in 0..2 {
            let [low, high] = [visit.slots[axis * 2], visit.slots[axis * 2 + 1]].map(usize::from);
            let planes = &planes[axis][..];
            let sides = &mut sides[axis][..];
            if visit.mask & (LEFT << (2 * axis)) != 0 {
                let (negative, positive) = self.sides(lanes, &planes[low]);
                alive &= !negative;
                cut[axis * 2] = !positive;
                tests += 1;
            }
            if visit.mask & (RIGHT << (2 * axis)) != 0 {
                let (negative, positive) = self.sides(lanes, &planes[high]);
                alive &= !positive;
                cut[axis * 2 + 1] = !negative;
                tests += 1;
            }
            if alive == 0 {
                break;
            }
            for k in low + 1..high {
                sides[k] = self.sides(lanes, &planes[k]);
                tests += 1;
            }
        }
        stats.nodes_visited += u64::from(self.lanes_in_use);
        stats.plane_tests += tests * u64::from(self.lanes_in_use);
        Found { alive, cut }
    }
}

/// What is known of a node's lanes.
struct Found {
    /// Lanes that may be seen.
    alive: u8,
    /// For each side of the rectangle and the near plane, the lanes that it may cut.
    cut: [u8; 5],
}

impl Found {
    /// The slots that a lane may meet, and the sides that may cut it.
    ///
    /// A slot is left out only because the box lies wholly beyond its far edge or wholly before its near one, which holds
    /// for boxes that reach behind the eye, too.
    #[inline(always)]
    fn lane(&self, lane: usize, visit: &Visit, sides: &[Vec<(u8, u8)>; 2]) -> ([u16; 4], u8) {
        let bit = 1u8 << lane;
        let mut slots = visit.slots;
        let mut mask = 0;
        for (side, cut) in self.cut.iter().enumerate() {
            mask |= ((cut >> lane) & 1) << side;
        }
        for axis in 0..2 {
            let [mut low, mut high] = [slots[axis * 2], slots[axis * 2 + 1]];
            if high - low > 1 {
                let sides = &sides[axis];
                while low + 1 < high && sides[usize::from(low + 1)].1 & bit != 0 {
                    low += 1;
                }
                while high - 1 > low && sides[usize::from(high - 1)].0 & bit != 0 {
                    high -= 1;
                }
                if low != slots[axis * 2] {
                    mask &= !(LEFT << (2 * axis));
                }
                if high != slots[axis * 2 + 1] {
                    mask &= !(RIGHT << (2 * axis));
                }
                slots[axis * 2] = low;
                slots[axis * 2 + 1] = high;
            }
        }
        (slots, mask)
    }
}

/// The slots that a leaf's oriented box may meet, of those that its axis-aligned box may meet.
#[inline(always)]
fn refine(bound: &Obb, lattice: &Lattice, mut slots: [u16; 4], mask: u8, stats: &mut CullStats) -> Option<[u16; 4]> {
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
        return None;
    }
    for (axis, planes) in lattice.planes().into_iter().enumerate() {
        let [mut low, mut high] = [slots[axis * 2], slots[axis * 2 + 1]].map(usize::from);
        if mask & (LEFT << (2 * axis)) != 0 && side(&planes[low]) < 0 {
            return None;
        }
        if mask & (RIGHT << (2 * axis)) != 0 && side(&planes[high]) > 0 {
            return None;
        }
        while low + 1 < high && side(&planes[low + 1]) > 0 {
            low += 1;
        }
        while high - 1 > low && side(&planes[high - 1]) < 0 {
            high -= 1;
        }
        slots[axis * 2] = low as u16;
        slots[axis * 2 + 1] = high as u16;
    }
    Some(slots)
}

/// Where ranges go. Those that follow on one another in the same cells are joined first.
struct Output<'a> {
    lattice: &'a Lattice,
    sets: &'a mut [VisibleSet],
    pending: LeafRange,
    cells: [u16; 4],
}

impl Output<'_> {
    #[inline(always)]
    fn emit(&mut self, leaves: LeafRange, cells: [u16; 4]) {
        if cells == self.cells && leaves.start == self.pending.end {
            self.pending.end = leaves.end;
        } else {
            self.flush();
            self.pending = leaves;
            self.cells = cells;
        }
    }

    #[inline(always)]
    fn flush(&mut self) {
        let [left, right, bottom, top] = self.cells;
        for row in bottom..top {
            for view in self.lattice.row(row, left..right) {
                self.sets[usize::from(*view)].push(self.pending);
            }
        }
    }
}
