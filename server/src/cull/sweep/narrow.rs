//! Visits of at most two slots across and up that several planes may cut.
//!
//! What a test says of eight boxes is as good as random, and a processor that guesses it wrong loses as much time as the test
//! took. So little here branches on a single lane: which lanes a cell sees is a mask, put together from what the
//! planes say, and what a cell sees of a node is one range or a few.

use mullion_common::visible_set::LeafRange;

use super::classify::{BOTTOM, Boxes, LEFT, LanePlane, LanePlanes, NEAR, RIGHT, TOP};
use super::kernel::Visit;
use super::lanes::Lanes;
use super::lattice::Lattice;
use super::pending::Pending;
use crate::cull::CullStats;
use crate::tree::{LANES, LeafAxes, WideNode, WideTree};

/// There is one plane between slots here, or none.
const MAX_SLOTS: u16 = 2;

/// Whether a visit is narrow.
#[inline(always)]
pub(super) fn takes(visit: &Visit, lattice: &Lattice) -> bool {
    let [left, right, bottom, top] = visit.slots;
    right - left <= MAX_SLOTS && top - bottom <= MAX_SLOTS && lattice.is_simple()
}

/// What the planes of one axis say of the lanes.
#[derive(Clone, Copy, Default)]
struct Axis {
    /// Wholly on the negative side of the plane between the two slots, and on its positive side.
    negative: u8,
    positive: u8,
    /// In one slot.
    single: u8,
    /// May be cut by the first slot's outer side, and by the last one's.
    first_cuts: u8,
    last_cuts: u8,
}

impl Axis {
    /// The lanes that are seen between two edges of the lattice, where the slots begin at `low`.
    #[inline(always)]
    fn between(&self, [first, last]: [u16; 2], low: u16) -> u8 {
        let starts_there = if first > low { self.negative } else { 0 };
        let ends_there = if last == low + 1 { self.positive } else { 0 };
        !(starts_there | ends_there)
    }

    /// The lanes that are seen in a slot, where the first one is `low`.
    #[inline(always)]
    fn of_slot(&self, slot: u16, low: u16) -> u8 {
        !if slot == low { self.positive } else { self.negative }
    }

    /// The slots of a lane.
    #[inline(always)]
    fn slots(&self, lane: u32, [low, high]: [u16; 2]) -> [u16; 2] {
        [low + u16::from(self.positive >> lane & 1), high - u16::from(self.negative >> lane & 1)]
    }
}

/// Emits what is seen of a node, cell by cell, and pushes what is to be visited or comes after that.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub(super) fn visit<L: Lanes>(
    lanes: L,
    boxes: &Boxes<L>,
    visit: &Visit,
    tree: &WideTree,
    lattice: &Lattice,
    planes: &LanePlanes,
    stack: &mut Vec<Visit>,
    pending: &mut Pending,
    stats: &mut CullStats,
) {
    let node = &tree.nodes()[visit.node as usize];
    let mut alive = boxes.alive;
    let tests = &mut 0;
    let mut near_cuts = 0;
    if visit.mask & NEAR != 0 {
        let (negative, positive) = boxes.sides(lanes, planes.near(), &mut ());
        alive &= !negative;
        near_cuts = !positive;
        *tests += 1;
    }
    let [left, right, bottom, top] = visit.slots;
    let mut x = axis(lanes, boxes, [left, right], visit.mask, planes.of_axis(0), &mut alive, tests);
    let mut y = axis(lanes, boxes, [bottom, top], visit.mask >> 2, planes.of_axis(1), &mut alive, tests);
    let cuts = near_cuts | x.first_cuts | x.last_cuts | y.first_cuts | y.last_cuts;
    let settled = x.single & y.single & !cuts;
    let open = alive & !settled & !node.leaf_lanes;
    // Lanes whose oriented boxes are much smaller than their own may tell more.
    let oriented = alive & !settled & node.leaf_lanes & lanes.with_bit(&node.child, WideNode::ORIENTED.ilog2());
    if oriented != 0 {
        let axes = &tree.axes()[visit.node as usize];
        if near_cuts & oriented != 0 {
            let (negative, _) = boxes.oriented_sides(lanes, planes.near(), axes);
            alive &= !(negative & near_cuts & oriented);
            *tests += 1;
        }
        refine(lanes, boxes, axes, [left, right], planes.of_axis(0), oriented, &mut x, &mut alive, tests);
        refine(lanes, boxes, axes, [bottom, top], planes.of_axis(1), oriented, &mut y, &mut alive, tests);
    }
    stats.nodes_visited += u64::from(boxes.alive.count_ones());
    stats.plane_tests += *tests * u64::from(boxes.alive.count_ones());

    // Leaves come before inner lanes where the tree was built for it, so that what has to wait is little.
    let end = visit.leaves.end;
    let first_open = open.trailing_zeros().min(LANES as u32);
    let now = alive & (((1u32 << first_open) - 1) as u8);
    let is_plain = lattice.is_plain();
    let [first_column, end_column, first_row, end_row] =
        if is_plain { [left, right, bottom, top] } else { lattice.cells(visit.slots) };
    for row in first_row..end_row {
        let of_row = now & if is_plain { y.of_slot(row, bottom) } else { y.between(lattice.row_span(row), bottom) };
        for column in first_column..end_column {
            let of_column = if is_plain { x.of_slot(column, left) } else { x.between(lattice.column_span(column), left) };
            let mut seen = u32::from(of_row & of_column);
            while seen != 0 {
                let lane = seen.trailing_zeros();
                let run = (seen >> lane).trailing_ones();
                // Lanes that stand side by side have leaves that follow on one another.
                let start = node.first_leaf[lane as usize % LANES];
                let last = node.leaves((lane + run - 1) as usize % LANES, end);
                pending.emit(LeafRange::new(start, last.end), [column, column + 1, row, row + 1]);
                seen &= seen + (1 << lane);
            }
        }
    }
    let mut later = alive ^ now;
    while later != 0 {
        let lane = later.ilog2();
        later ^= 1 << lane;
        let ([left, right], [bottom, top]) = (x.slots(lane, [left, right]), y.slots(lane, [bottom, top]));
        if left >= right || bottom >= top {
            continue;
        }
        let slots = [left, right, bottom, top];
        let leaves = node.leaves(lane as usize % LANES, end);
        if open & (1 << lane) != 0 {
            let bit = |cuts: u8, side: u8| (cuts >> lane & 1) * side;
            let mask = bit(near_cuts, NEAR)
                | bit(x.first_cuts, LEFT)
                | bit(x.last_cuts, RIGHT)
                | bit(y.first_cuts, BOTTOM)
                | bit(y.last_cuts, TOP);
            let child = node.child[lane as usize % LANES];
            lanes.prefetch(&tree.nodes()[child as usize]);
            lanes.prefetch(&tree.axes()[child as usize]);
            stack.push(Visit { node: child, leaves, slots, mask });
        } else {
            stack.push(Visit { node: Visit::EMIT, leaves, slots: lattice.cells(slots), mask: 0 });
        }
    }
}

/// Asks the planes of one axis, of which `mask` has the outer ones that count.
#[inline(always)]
fn axis<L: Lanes>(
    lanes: L,
    boxes: &Boxes<L>,
    [low, high]: [u16; 2],
    mask: u8,
    planes: &[LanePlane],
    alive: &mut u8,
    tests: &mut u64,
) -> Axis {
    let [low, high] = [usize::from(low), usize::from(high)];
    let mut axis = Axis { single: !0, ..Axis::default() };
    if high - low > 1 {
        (axis.negative, axis.positive) = boxes.sides(lanes, &planes[low + 1], &mut ());
        axis.single = axis.negative | axis.positive;
        *tests += 1;
    }
    if mask & LEFT != 0 {
        let (negative, positive) = boxes.sides(lanes, &planes[low], &mut ());
        *alive &= !negative;
        axis.first_cuts = !positive & !axis.positive;
        *tests += 1;
    }
    if mask & RIGHT != 0 {
        let (negative, positive) = boxes.sides(lanes, &planes[high], &mut ());
        *alive &= !positive;
        axis.last_cuts = !negative & !axis.negative;
        *tests += 1;
    }
    axis
}

/// Asks the planes of one axis again, for the oriented boxes that they cut.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn refine<L: Lanes>(
    lanes: L,
    boxes: &Boxes<L>,
    axes: &LeafAxes,
    [low, high]: [u16; 2],
    planes: &[LanePlane],
    oriented: u8,
    axis: &mut Axis,
    alive: &mut u8,
    tests: &mut u64,
) {
    let [low, high] = [usize::from(low), usize::from(high)];
    if axis.first_cuts & oriented != 0 {
        let (negative, _) = boxes.oriented_sides(lanes, &planes[low], axes);
        *alive &= !(negative & axis.first_cuts & oriented);
        *tests += 1;
    }
    if axis.last_cuts & oriented != 0 {
        let (_, positive) = boxes.oriented_sides(lanes, &planes[high], axes);
        *alive &= !(positive & axis.last_cuts & oriented);
        *tests += 1;
    }
    let cut = oriented & !axis.single;
    if cut != 0 {
        let (negative, positive) = boxes.oriented_sides(lanes, &planes[low + 1], axes);
        axis.negative |= negative & cut;
        axis.positive |= positive & cut;
        *tests += 1;
    }
}
