//! Subtrees that one plane cuts at most, be it between two slots or on the outside of one: almost all that a sweep visits.
//!
//! The plane, the two cells and what goes to each stay in registers all the way down, and what is found out of eight lanes are two
//! masks. As in `narrow.rs`, little branches on a single lane.

use glam::DVec3;

use super::classify::{BOTTOM, Boxes, LEFT, LanePlane, LanePlanes, NEAR, RIGHT, TOP};
use super::kernel::{Sink, Visit};
use super::lanes::Lanes;
use super::lattice::Lattice;
use crate::cull::CullStats;
use crate::tree::{LANES, WideNode, WideTree};

/// A node that has been looked at, and what of it is still to be done. A bit for each lane.
#[derive(Clone, Copy, Debug)]
struct Rest {
    node: u32,
    /// One past its last leaf.
    end: u32,
    /// Lanes whose leaves go out, on the negative side of the plane and on its positive one.
    seen: [u8; 2],
    /// Lanes to be visited.
    open: u8,
}

/// What a walk needs, kept from one to the next.
#[derive(Debug)]
pub(super) struct Memory {
    stack: Vec<Rest>,
    trails: [Ends; 2],
}

impl Default for Memory {
    fn default() -> Self {
        Self { stack: Vec::new(), trails: [[0; 2 * CAPACITY + LANES]; 2] }
    }
}

/// The one plane that may cut a node.
pub(super) struct OnePlane<'a> {
    plane: &'a LanePlane,
    /// The cells, column and row, on its negative side and on its positive one: `None` outside and in gaps.
    cells: [Option<(u16, u16)>; 2],
}

/// The plane of a visit that no more than one may cut, with a cell at most on either side.
#[inline(always)]
pub(super) fn plane_of<'a>(visit: &Visit, lattice: &Lattice, planes: &'a LanePlanes) -> Option<OnePlane<'a>> {
    let [left, right, bottom, top] = visit.slots;
    let (columns, rows) = (planes.of_axis(0), planes.of_axis(1));
    let [first, last] = [left, right].map(usize::from);
    let [low, high] = [bottom, top].map(usize::from);
    let all = Some(visit.slots);
    let (plane, slots) = match (right - left, top - bottom, visit.mask) {
        (2, 1, 0) => (&columns[first + 1], [Some([left, left + 1, bottom, top]), Some([left + 1, right, bottom, top])]),
        (1, 2, 0) => (&rows[low + 1], [Some([left, right, bottom, bottom + 1]), Some([left, right, bottom + 1, top])]),
        (1, 1, NEAR) => (planes.near(), [None, all]),
        (1, 1, LEFT) => (&columns[first], [None, all]),
        (1, 1, RIGHT) => (&columns[last], [all, None]),
        (1, 1, BOTTOM) => (&rows[low], [None, all]),
        (1, 1, TOP) => (&rows[high], [all, None]),
        _ => return None,
    };
    let mut cells = [None; 2];
    for (cell, slots) in cells.iter_mut().zip(slots) {
        let Some(slots) = slots else {
            continue;
        };
        let [first, end, low, high] = lattice.cells(slots);
        match end.saturating_sub(first) * high.saturating_sub(low) {
            0 => {}
            1 => *cell = Some((first, low)),
            _ => return None, // where tiles overlap
        }
    }
    Some(OnePlane { plane, cells })
}

/// Sweeps a visit that [`plane_of`] takes, and all below it.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub(super) fn walk<L: Lanes>(
    lanes: L,
    visit: &Visit,
    one: &OnePlane<'_>,
    tree: &WideTree,
    offset: DVec3,
    planes: &LanePlanes,
    memory: &mut Memory,
    sink: &mut impl Sink,
    stats: &mut CullStats,
) {
    let plane = *one.plane;
    let [negative_cell, positive_cell] = one.cells;
    let Memory { stack, trails: [negative_ends, positive_ends] } = memory;
    let mut negative = Trail::new(visit.leaves.start, negative_ends);
    let mut positive = Trail::new(visit.leaves.start, positive_ends);
    let (mut nodes, mut tests) = (0, 0);
    stack.clear();
    let (mut id, mut end) = (visit.node, visit.leaves.end);
    loop {
        let node = &tree.nodes()[id as usize];
        let axes = &tree.axes()[id as usize];
        lanes.prefetch(axes);
        let boxes = Boxes::of(lanes, node, offset, planes);
        let (mut below, mut above) = boxes.sides(lanes, &plane, &mut ());
        let cut = boxes.alive & !(below | above);
        nodes += u64::from(boxes.alive.count_ones());
        tests += 1;
        let oriented = cut & node.leaf_lanes & lanes.with_bit(&node.child, WideNode::ORIENTED.ilog2());
        if oriented != 0 {
            // Lanes whose oriented boxes are much smaller than their own may tell more.
            let (negative, positive) = boxes.oriented_sides(lanes, &plane, axes);
            below |= negative & oriented;
            above |= positive & oriented;
            tests += 1;
        }
        let open = cut & !node.leaf_lanes;
        let seen = boxes.alive & !open;
        prefetch_first(lanes, tree, node, open);
        let mut rest = Rest { node: id, end, seen: [seen & !above, seen & !below], open };
        // Leaves come in ascending order: what follows a lane that is visited waits until that is done.
        loop {
            let node = &tree.nodes()[rest.node as usize];
            let next = rest.open.trailing_zeros(); // 8 where there is none
            let now = ((1u32 << next) - 1) as u8;
            if negative_cell.is_some() {
                negative.add(lanes, node, rest.end, rest.seen[0] & now);
                negative.flush_if_full(negative_cell, sink);
            }
            if positive_cell.is_some() {
                positive.add(lanes, node, rest.end, rest.seen[1] & now);
                positive.flush_if_full(positive_cell, sink);
            }
            if rest.open != 0 {
                let lane = next as usize % LANES;
                rest.seen = rest.seen.map(|seen| seen & !now);
                rest.open &= rest.open - 1;
                (id, end) = (node.child[lane], node.leaves(lane, rest.end).end);
                if rest.open | rest.seen[0] | rest.seen[1] != 0 {
                    // The next one comes when this one is done.
                    prefetch_first(lanes, tree, node, rest.open);
                    stack.push(rest);
                }
                break;
            }
            match stack.pop() {
                Some(above) => rest = above,
                None => {
                    negative.finish(negative_cell, sink);
                    positive.finish(positive_cell, sink);
                    stats.nodes_visited += nodes;
                    stats.plane_tests += tests * LANES as u64;
                    return;
                }
            }
        }
    }
}

/// Asks for the first of the lanes to be visited; where there is none, for some node or nothing.
#[inline(always)]
fn prefetch_first<L: Lanes>(lanes: L, tree: &WideTree, node: &WideNode, open: u8) {
    lanes.prefetch_at(tree.nodes(), node.child[open.trailing_zeros() as usize % LANES] as usize);
}

/// Most ranges on their way to one cell.
const CAPACITY: usize = 64;

/// Where ranges on their way to one cell begin and end, one after the other, and room for what a node adds.
type Ends = [u32; 2 * CAPACITY + LANES];

/// Ranges on their way to one cell.
struct Trail<'a> {
    /// How many numbers there are: two a range, the last of which may still grow.
    len: usize,
    ends: &'a mut Ends,
}

impl<'a> Trail<'a> {
    /// Nothing, before the leaf `start`.
    #[inline(always)]
    fn new(start: u32, ends: &'a mut Ends) -> Self {
        (ends[0], ends[1]) = (start, start);
        Self { len: 2, ends }
    }

    /// Adds the leaves of some lanes of a node that ends at `end`.
    ///
    /// Lanes that stand side by side have leaves that follow on one another: a range begins or ends before a lane that is seen otherwise
    /// than the one before it. All of them are packed at once, as branches on lanes would be guessed wrong as often as not.
    #[inline(always)]
    fn add<L: Lanes>(&mut self, lanes: L, node: &WideNode, end: u32, seen: u8) {
        let changes = seen ^ (seen << 1);
        let start = node.first_leaf[changes.trailing_zeros() as usize % LANES];
        let last = self.len - 1;
        // What begins where the last range ends makes it longer.
        let joins = (seen != 0) & (start == self.ends[last % (2 * CAPACITY)]);
        let (changes, at) = if joins { (changes & changes.wrapping_sub(1), last) } else { (changes, self.len) };
        let at = at % (2 * CAPACITY);
        if let Some((out, _)) = self.ends[at..].split_first_chunk_mut::<LANES>() {
            lanes.pack(&node.first_leaf, end, changes, out);
        }
        let at = at + changes.count_ones() as usize;
        self.ends[at] = end; // of the last lane, where that is seen
        self.len = at + usize::from(seen >> (LANES - 1));
    }

    /// Hands on what is there, but for the last range, when the next node might not find room.
    #[inline(always)]
    fn flush_if_full(&mut self, cell: Option<(u16, u16)>, sink: &mut impl Sink) {
        if self.len > 2 * CAPACITY - LANES {
            let last = self.len - 2;
            Self::hand_on(&self.ends[..last], cell, sink);
            (self.ends[0], self.ends[1]) = (self.ends[last], self.ends[last + 1]);
            self.len = 2;
        }
    }

    #[inline(always)]
    fn hand_on(ends: &[u32], cell: Option<(u16, u16)>, sink: &mut impl Sink) {
        if let Some((column, row)) = cell {
            sink.append_to_cell(ends.as_chunks().0, column, row);
        }
    }

    /// Hands on all.
    #[inline(always)]
    fn finish(self, cell: Option<(u16, u16)>, sink: &mut impl Sink) {
        Self::hand_on(&self.ends[..self.len], cell, sink);
    }
}
