//! Subtrees that one plane cuts at most, be it between two slots or on the outside of one: almost all that a sweep visits.
//!
//! What a test says of eight boxes is as good as random, and a processor that guesses it wrong loses as much time as the test
//! took. So nothing here branches on a lane, and nothing goes out at once: subtrees are collected and walked together, breadth
//! first, so that each node's memory is asked for long before its turn. Where leaves seen in a cell begin and end is marked in a
//! row of bits; in the end these are read in order, and with them goes out what was found between the subtrees.

use glam::DVec3;
use mullion_common::visible_set::LeafRange;

use super::classify::{BOTTOM, Boxes, LEFT, LanePlane, LanePlanes, NEAR, RIGHT, TOP};
use super::kernel::{Sink, Visit};
use super::lanes::Lanes;
use super::lattice::Lattice;
use crate::cull::CullStats;
use crate::tree::{LANES, WideNode, WideTree};

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

/// A subtree to be walked.
#[derive(Clone, Copy, Debug)]
struct Subtree {
    plane: LanePlane,
    leaves: LeafRange,
    cells: [Option<(u16, u16)>; 2],
    /// Of either side, all lanes where it has a cell, and none where not.
    kept: [u8; 2],
    /// From a leaf's number to its bit, modulo 2³².
    bit_from_leaf: u32,
}

/// Leaves to go out when the subtrees before them have.
#[derive(Clone, Copy, Debug)]
struct Between {
    leaves: LeafRange,
    cells: [u16; 4],
    /// How many subtrees come before.
    subtrees: u32,
}

/// What has been found in order, and is still to be looked at or to go out. Reuses its memory.
#[derive(Debug, Default)]
pub(super) struct Pending {
    subtrees: Vec<Subtree>,
    between: Vec<Between>,
    /// Nodes to visit: number, one past the last leaf, subtree. Longer than what is in use.
    nodes: Vec<u32>,
    ends: Vec<u32>,
    of: Vec<u32>,
    /// For each leaf of the subtrees, and one past the last of each, whether leaves begin or end to be seen there: on the
    /// negative side and on the positive one. Zero in between.
    marks: Vec<[u64; 2]>,
    /// How many words of them are given to subtrees.
    words: usize,
    /// Where ranges begin and end.
    found: Vec<u32>,
}

impl Pending {
    /// Subtrees that are walked together: enough to have some nodes on their way from memory at any time.
    const SUBTREES: usize = 64;
    /// Most words of marks, but for one larger subtree: what the first-level cache holds.
    const WORDS: usize = 1024;
    /// Most ranges in between.
    const BETWEEN: usize = 1024;
    /// How many nodes ahead memory is asked for.
    const AHEAD: usize = 6;
    /// Most numbers in `found` that come from one word.
    const OF_WORD: usize = 64;
    const FOUND: usize = 256;

    /// Leaves that all cells may see.
    #[inline(always)]
    pub(super) fn emit(&mut self, leaves: LeafRange, cells: [u16; 4]) {
        self.between.push(Between { leaves, cells, subtrees: self.subtrees.len() as u32 });
    }

    /// Takes a subtree.
    #[inline(always)]
    pub(super) fn take(&mut self, visit: &Visit, one: &OnePlane<'_>) {
        let at = self.subtrees.len();
        if self.nodes.len() <= at {
            self.grow();
        }
        (self.nodes[at], self.ends[at], self.of[at]) = (visit.node, visit.leaves.end, at as u32);
        let words = visit.leaves.len() as usize / 64 + 1;
        self.subtrees.push(Subtree {
            plane: *one.plane,
            leaves: visit.leaves,
            cells: one.cells,
            kept: one.cells.map(|cell| if cell.is_some() { !0 } else { 0 }),
            bit_from_leaf: (self.words as u32 * 64).wrapping_sub(visit.leaves.start),
        });
        self.words += words;
        if self.marks.len() <= self.words {
            self.marks.resize((self.words + 1).next_power_of_two(), [0; 2]);
        }
    }

    /// Whether it is time for [`Pending::finish`].
    #[inline(always)]
    pub(super) fn is_full(&self) -> bool {
        self.subtrees.len() >= Self::SUBTREES || self.words >= Self::WORDS || self.between.len() >= Self::BETWEEN
    }

    #[cold]
    fn grow(&mut self) {
        let len = (self.nodes.len() * 2).max(1024);
        for list in [&mut self.nodes, &mut self.ends, &mut self.of] {
            list.resize(len, 0);
        }
    }

    /// Walks what is there, and hands it on.
    #[inline(always)]
    pub(super) fn finish<L: Lanes>(
        &mut self,
        lanes: L,
        tree: &WideTree,
        offset: DVec3,
        planes: &LanePlanes,
        sink: &mut impl Sink,
        stats: &mut CullStats,
    ) {
        self.walk(lanes, tree, offset, planes, stats);
        self.hand_on(sink);
        self.subtrees.clear();
        self.between.clear();
        self.words = 0;
    }

    /// Marks what is seen of all subtrees.
    #[inline(always)]
    fn walk<L: Lanes>(&mut self, lanes: L, tree: &WideTree, offset: DVec3, planes: &LanePlanes, stats: &mut CullStats) {
        let (mut at, mut count) = (0, self.subtrees.len());
        let (mut visited, mut tests) = (0, 0);
        while at < count {
            if self.nodes.len() < count + LANES {
                self.grow();
            }
            let soon = self.nodes[(at + Self::AHEAD).min(count - 1)] as usize;
            lanes.prefetch_at(tree.nodes(), soon);
            lanes.prefetch_at(tree.axes(), soon);
            let (id, end, of) = (self.nodes[at] as usize, self.ends[at], self.of[at]);
            at += 1;
            let Subtree { plane, kept, bit_from_leaf, .. } = &self.subtrees[of as usize];
            let node = &tree.nodes()[id];
            let boxes = Boxes::of(lanes, node, offset, planes);
            let (mut below, mut above) = boxes.sides(lanes, plane, &mut ());
            let cut = boxes.alive & !(below | above);
            visited += u64::from(boxes.alive.count_ones());
            tests += 1;
            let oriented = cut & node.leaf_lanes & lanes.with_bit(&node.child, WideNode::ORIENTED.ilog2());
            if oriented != 0 {
                // Lanes whose oriented boxes are much smaller than their own may tell more.
                let (negative, positive) = boxes.oriented_sides(lanes, plane, &tree.axes()[id]);
                below |= negative & oriented;
                above |= positive & oriented;
                tests += 1;
            }
            let open = cut & !node.leaf_lanes;
            let seen = boxes.alive & !open;
            let seen = [seen & !above & kept[0], seen & !below & kept[1]];

            let starts = lanes.at_most(lanes.words(&node.first_leaf), end);
            if let Some((nodes, _)) = self.nodes[count..].split_first_chunk_mut()
                && let Some((ends, _)) = self.ends[count..].split_first_chunk_mut()
                && let Some((subtrees, _)) = self.of[count..].split_first_chunk_mut()
            {
                lanes.pack(lanes.words(&node.child), open, nodes);
                lanes.pack(lanes.next(starts, end), open, ends);
                *subtrees = [of; LANES];
            }
            count += open.count_ones() as usize;

            let first = node.first_leaf[0];
            let bit = first.wrapping_add(*bit_from_leaf);
            // A lane that is seen otherwise than the one before it begins where leaves begin or end to be seen.
            let changes = seen.map(|seen| u64::from(seen) ^ (u64::from(seen) << 1));
            if end - first < u64::BITS {
                let places = lanes.marks(starts, first) | (1 << (end - first));
                let changes = [lanes.deposit(changes[0], places), lanes.deposit(changes[1], places)];
                let (word, shift) = (bit as usize / 64, bit % 64);
                for side in 0..2 {
                    self.marks[word][side] ^= changes[side] << shift;
                    self.marks[word + 1][side] ^= (changes[side] >> 1) >> (63 - shift);
                }
            } else {
                for (side, mut left) in changes.into_iter().enumerate() {
                    while left != 0 {
                        let lane = left.trailing_zeros() as usize;
                        left &= left - 1;
                        let leaf = if lane < LANES { node.first_leaf[lane].min(end) } else { end };
                        let bit = leaf.wrapping_add(*bit_from_leaf);
                        self.marks[bit as usize / 64][side] ^= 1 << (bit % 64);
                    }
                }
            }
        }
        stats.nodes_visited += visited;
        stats.plane_tests += tests * LANES as u64;
    }

    /// Hands on all in order, and leaves the marks clear.
    #[inline(always)]
    fn hand_on(&mut self, sink: &mut impl Sink) {
        self.found.resize(Self::FOUND, 0);
        let Self { subtrees, between, marks, found, .. } = self;
        let mut next = 0;
        let mut word = 0;
        for between in &*between {
            while next < between.subtrees as usize {
                word = hand_on_subtree(&subtrees[next], marks, word, found, sink);
                next += 1;
            }
            sink.emit(between.leaves, between.cells);
        }
        while next < subtrees.len() {
            word = hand_on_subtree(&subtrees[next], marks, word, found, sink);
            next += 1;
        }
    }
}

/// Hands on a subtree whose marks begin in `word`. Returns where the next one's do.
#[inline(always)]
fn hand_on_subtree(subtree: &Subtree, marks: &mut [[u64; 2]], word: usize, found: &mut [u32], sink: &mut impl Sink) -> usize {
    let marks_end = word + subtree.leaves.len() as usize / 64 + 1;
    for (side, cell) in subtree.cells.iter().enumerate() {
        let Some((column, row)) = *cell else {
            continue;
        };
        let mut count = 0;
        let mut first = subtree.leaves.start;
        for marks in &mut marks[word..marks_end] {
            let mut left = std::mem::take(&mut marks[side]);
            let of_word = left.count_ones() as usize;
            if count + Pending::OF_WORD > found.len() {
                // An odd one out begins a range that ends later.
                let whole = count & !1;
                sink.append_to_cell(found[..whole].as_chunks().0, column, row);
                found[0] = found[count - 1];
                count &= 1;
            }
            let out = &mut found[count..count + Pending::OF_WORD];
            // Some more than there are, so that there is seldom a branch to guess.
            let mut written = 0;
            while written < of_word {
                for place in &mut out[written..written + 4] {
                    *place = first + left.trailing_zeros();
                    left &= left.wrapping_sub(1);
                }
                written += 4;
            }
            count += of_word;
            first += u64::BITS;
        }
        sink.append_to_cell(found[..count].as_chunks().0, column, row);
    }
    marks_end
}
