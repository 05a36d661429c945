//! What a sweep has found in order, and is still to be looked at or to go out: subtrees that one plane cuts each way at most, and
//! leaves between them.
//!
//! What a test says of eight boxes is as good as random, and a processor that guesses it wrong loses as much time as the test
//! took. So nothing here branches on a lane, and nothing goes out at once: subtrees are collected and walked together, breadth
//! first, so that each node's memory is asked for long before its turn. Where leaves seen in a view begin and end is marked in a
//! row of bits; in the end these are read in order, and with them goes out what was found between the subtrees.

use glam::DVec3;
use mullion_common::visible_set::LeafRange;

use super::classify::{Boxes, LanePlane, LanePlanes};
use super::cuts::{Cuts, NO_VIEW, Views};
use super::kernel::{Sink, Visit};
use super::lanes::Lanes;
use crate::cull::CullStats;
use crate::tree::{LANES, WideNode, WideTree};

/// Rows of marks, one a view.
const ROWS: usize = 4;

/// Leaves below one node, and who may see them.
#[derive(Clone, Copy, Debug)]
struct Area {
    leaves: LeafRange,
    views: Views,
}

/// A plane for nodes of an area that no other one cuts.
#[derive(Clone, Copy, Debug)]
struct OnePlane {
    plane: LanePlane,
    /// Rows of the views on the negative side and on the positive one.
    rows: [u8; 2],
    /// For each of them all lanes where there is a view, and none where not.
    kept: [u8; 2],
    /// From a leaf's number to its bit, modulo 2³².
    bit_from_leaf: u32,
}

/// Two planes for nodes of an area.
#[derive(Clone, Copy, Debug)]
struct TwoPlanes {
    planes: [LanePlane; 2],
    kept: [u8; ROWS],
    bit_from_leaf: u32,
    /// The area's first [`OnePlane`]: of the columns' plane below and above the rows', of the rows' left and right of the columns'.
    first_one: u32,
}

/// Leaves to go out when the areas before them have.
#[derive(Clone, Copy, Debug)]
struct Between {
    leaves: LeafRange,
    cells: [u16; 4],
    /// How many areas come before.
    areas: u32,
}

/// Nodes to visit, first in, first out.
#[derive(Debug, Default)]
struct Queue {
    /// Longer than what is in use; all three alike.
    nodes: Vec<u32>,
    /// Of each node, one past its last leaf.
    ends: Vec<u32>,
    /// Of each node, what cuts it.
    of: Vec<u32>,
    len: usize,
}

/// See above. Reuses its memory.
#[derive(Debug, Default)]
pub(super) struct Pending {
    areas: Vec<Area>,
    between: Vec<Between>,
    one: Vec<OnePlane>,
    two: Vec<TwoPlanes>,
    by_one: Queue,
    by_two: Queue,
    marks: Marks,
    /// Where ranges begin and end.
    found: Vec<u32>,
}

/// For each leaf of the areas, and one past the last of each, whether leaves begin or end to be seen there, view by view.
#[derive(Debug, Default)]
struct Marks {
    /// Zero where nothing is pending.
    words: Vec<[u64; ROWS]>,
    /// How many are given to areas.
    used: usize,
}

impl Queue {
    /// Adds children of a node.
    #[inline(always)]
    fn push<L: Lanes>(&mut self, lanes: L, children: L::Words, ends: L::Words, of: L::Words, which: u8) {
        let at = self.len;
        if self.nodes.len() < at + LANES {
            self.grow();
        }
        if let Some((places, _)) = self.nodes[at..].split_first_chunk_mut() {
            lanes.pack(children, which, places);
        }
        if let Some((places, _)) = self.ends[at..].split_first_chunk_mut() {
            lanes.pack(ends, which, places);
        }
        if let Some((places, _)) = self.of[at..].split_first_chunk_mut() {
            lanes.pack(of, which, places);
        }
        self.len = at + which.count_ones() as usize;
    }

    /// Adds one node.
    #[inline(always)]
    fn push_one(&mut self, node: u32, end: u32, of: u32) {
        let at = self.len;
        if self.nodes.len() <= at {
            self.grow();
        }
        (self.nodes[at], self.ends[at], self.of[at]) = (node, end, of);
        self.len = at + 1;
    }

    #[cold]
    fn grow(&mut self) {
        let len = (self.nodes.len() * 2).max(1024);
        for list in [&mut self.nodes, &mut self.ends, &mut self.of] {
            list.resize(len, 0);
        }
    }

    /// The node at `at`, one past its last leaf, and what cuts it. Asks for the memory of one that comes later.
    #[inline(always)]
    fn get<L: Lanes>(&self, lanes: L, at: usize, tree: &WideTree) -> (u32, u32, u32) {
        /// How many nodes ahead memory is asked for.
        const AHEAD: usize = 6;
        let soon = self.nodes[(at + AHEAD).min(self.len - 1)] as usize;
        lanes.prefetch_at(tree.nodes(), soon);
        lanes.prefetch_at(tree.axes(), soon);
        (self.nodes[at], self.ends[at], self.of[at])
    }
}

impl Marks {
    /// Gives words to an area. Returns what leads from its leaves' numbers to their bits.
    #[inline(always)]
    fn give(&mut self, leaves: LeafRange) -> u32 {
        let bit_from_leaf = (self.used as u32 * u64::BITS).wrapping_sub(leaves.start);
        self.used += words_of(leaves);
        // One more, so that what is marked in two words has both.
        if self.words.len() <= self.used {
            self.words.resize((self.used + 1).next_power_of_two(), [0; ROWS]);
        }
        bit_from_leaf
    }

    /// Marks where the leaves of lanes begin and end to be seen: `seen` by rows.
    #[inline(always)]
    fn add<L: Lanes, const N: usize>(
        &mut self,
        lanes: L,
        node: &WideNode,
        end: u32,
        bit_from_leaf: u32,
        seen: [u8; N],
        rows: [u8; N],
    ) {
        let first = node.first_leaf[0];
        // A lane that is seen otherwise than the one before it begins where leaves begin or end to be seen.
        let changes = seen.map(|seen| u64::from(seen) ^ (u64::from(seen) << 1));
        if end - first < u64::BITS {
            let starts = lanes.at_most(lanes.words(&node.first_leaf), end);
            let places = lanes.marks(starts, first) | (1 << (end - first));
            let bit = first.wrapping_add(bit_from_leaf);
            let (word, shift) = (bit as usize / 64, bit % 64);
            if let Some([low, high, ..]) = self.words.get_mut(word..word + 2) {
                for k in 0..N {
                    let (row, changes) = (usize::from(rows[k]) % ROWS, lanes.deposit(changes[k], places));
                    low[row] ^= changes << shift;
                    high[row] ^= (changes >> 1) >> (63 - shift);
                }
            }
            return;
        }
        for k in 0..N {
            let mut left = changes[k];
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let leaf = if lane < LANES { node.first_leaf[lane].min(end) } else { end };
                let bit = leaf.wrapping_add(bit_from_leaf);
                self.words[bit as usize / 64][usize::from(rows[k]) % ROWS] ^= 1 << (bit % 64);
            }
        }
    }
}

/// How many words of marks the leaves of an area take, and the place behind them.
fn words_of(leaves: LeafRange) -> usize {
    leaves.len() as usize / 64 + 1
}

/// All lanes where there is a view.
#[inline(always)]
fn kept(view: u16) -> u8 {
    if view == NO_VIEW { 0 } else { !0 }
}

impl Pending {
    /// Areas that are walked together: enough to have some nodes on their way from memory at any time.
    const AREAS: usize = 64;
    /// Most words of marks, but for one larger area: what the first-level cache holds.
    const WORDS: usize = 512;
    /// Most ranges in between.
    const BETWEEN: usize = 1024;
    /// Length of `found`, and most numbers in it that come from one word.
    const FOUND: usize = 256;
    const OF_WORD: usize = 64;

    /// Leaves that all cells may see.
    #[inline(always)]
    pub(super) fn emit(&mut self, leaves: LeafRange, cells: [u16; 4]) {
        self.between.push(Between { leaves, cells, areas: self.areas.len() as u32 });
    }

    /// Takes a subtree.
    #[inline(always)]
    pub(super) fn take(&mut self, visit: &Visit, cuts: &Cuts<'_>) {
        let bit_from_leaf = self.marks.give(visit.leaves);
        let one = |plane: &LanePlane, rows: [u8; 2], views: &Views| {
            let kept = rows.map(|row| kept(views[usize::from(row)]));
            OnePlane { plane: *plane, rows, kept, bit_from_leaf }
        };
        let of_one = self.one.len() as u32;
        let (Cuts::One(_, views) | Cuts::Two(_, views)) = cuts;
        self.areas.push(Area { leaves: visit.leaves, views: *views });
        match cuts {
            Cuts::One(plane, views) => {
                self.by_one.push_one(visit.node, visit.leaves.end, of_one);
                self.one.push(one(plane, [0, 1], views));
            }
            Cuts::Two([x, y], views) => {
                self.by_two.push_one(visit.node, visit.leaves.end, self.two.len() as u32);
                self.two.push(TwoPlanes { planes: [**x, **y], kept: views.map(kept), bit_from_leaf, first_one: of_one });
                self.one.extend([one(x, [0, 1], views), one(x, [2, 3], views), one(y, [0, 2], views), one(y, [1, 3], views)]);
            }
        }
    }

    /// Whether it is time for [`Pending::finish`].
    #[inline(always)]
    pub(super) fn is_full(&self) -> bool {
        self.areas.len() >= Self::AREAS || self.marks.used >= Self::WORDS || self.between.len() >= Self::BETWEEN
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
        self.walk_by_two(lanes, tree, offset, planes, stats);
        self.walk_by_one(lanes, tree, offset, planes, stats);
        self.hand_on(sink);
        self.areas.clear();
        self.between.clear();
        self.one.clear();
        self.two.clear();
        (self.by_one.len, self.by_two.len, self.marks.used) = (0, 0, 0);
    }

    /// Visits the nodes that two planes may cut. Adds those below that only one does.
    #[inline(always)]
    fn walk_by_two<L: Lanes>(&mut self, lanes: L, tree: &WideTree, offset: DVec3, planes: &LanePlanes, stats: &mut CullStats) {
        let Self { two, by_one, by_two, marks, .. } = self;
        let (mut at, mut visited, mut tests) = (0, 0, 0);
        while at < by_two.len {
            let (id, end, of) = by_two.get(lanes, at, tree);
            at += 1;
            let TwoPlanes { planes: [across, up], kept, bit_from_leaf, first_one } = &two[of as usize];
            let node = &tree.nodes()[id as usize];
            let boxes = Boxes::of(lanes, node, offset, planes);
            let (mut left, mut right) = boxes.sides(lanes, across, &mut ());
            let (mut below, mut above) = boxes.sides(lanes, up, &mut ());
            visited += u64::from(boxes.alive.count_ones());
            tests += 2;
            let oriented = boxes.alive
                & !((left | right) & (below | above))
                & node.leaf_lanes
                & lanes.with_bit(&node.child, WideNode::ORIENTED.ilog2());
            if oriented != 0 {
                // Lanes whose oriented boxes are much smaller than their own may tell more.
                let axes = &tree.axes()[id as usize];
                let cut = oriented & !(left | right);
                let (negative, positive) = boxes.oriented_sides(lanes, across, axes);
                (left, right) = (left | (negative & cut), right | (positive & cut));
                let cut = oriented & !(below | above);
                let (negative, positive) = boxes.oriented_sides(lanes, up, axes);
                (below, above) = (below | (negative & cut), above | (positive & cut));
                tests += 2;
            }
            let (left_to, right_to, low_to, high_to) = (!right, !left, !above, !below);
            let seen = [
                left_to & low_to & kept[0],
                right_to & low_to & kept[1],
                left_to & high_to & kept[2],
                right_to & high_to & kept[3],
            ];
            let (is_cut_across, is_cut_up) = (!(left | right), !(below | above));
            let open = boxes.alive & (seen[0] | seen[1] | seen[2] | seen[3]) & (is_cut_across | is_cut_up) & !node.leaf_lanes;

            let children = lanes.words(&node.child);
            let ends = lanes.next(lanes.at_most(lanes.words(&node.first_leaf), end), end);
            by_two.push(lanes, children, ends, lanes.repeat(of), open & is_cut_across & is_cut_up);
            let of_across = lanes.choose(above, lanes.repeat(first_one + 1), lanes.repeat(*first_one));
            let of_up = lanes.choose(right, lanes.repeat(first_one + 3), lanes.repeat(first_one + 2));
            let of_one = lanes.choose(is_cut_across, of_across, of_up);
            by_one.push(lanes, children, ends, of_one, open & !(is_cut_across & is_cut_up));
            let seen = seen.map(|seen| seen & boxes.alive & !open);
            marks.add(lanes, node, end, *bit_from_leaf, seen, [0, 1, 2, 3]);
        }
        stats.nodes_visited += visited;
        stats.plane_tests += tests * LANES as u64;
    }

    /// Visits the nodes that one plane may cut.
    #[inline(always)]
    fn walk_by_one<L: Lanes>(&mut self, lanes: L, tree: &WideTree, offset: DVec3, planes: &LanePlanes, stats: &mut CullStats) {
        let Self { one, by_one, marks, .. } = self;
        let (mut at, mut visited, mut tests) = (0, 0, 0);
        while at < by_one.len {
            let (id, end, of) = by_one.get(lanes, at, tree);
            at += 1;
            let OnePlane { plane, rows, kept, bit_from_leaf } = &one[of as usize];
            let node = &tree.nodes()[id as usize];
            let boxes = Boxes::of(lanes, node, offset, planes);
            let (mut below, mut above) = boxes.sides(lanes, plane, &mut ());
            let cut = boxes.alive & !(below | above);
            visited += u64::from(boxes.alive.count_ones());
            tests += 1;
            let oriented = cut & node.leaf_lanes & lanes.with_bit(&node.child, WideNode::ORIENTED.ilog2());
            if oriented != 0 {
                let (negative, positive) = boxes.oriented_sides(lanes, plane, &tree.axes()[id as usize]);
                below |= negative & oriented;
                above |= positive & oriented;
                tests += 1;
            }
            let open = cut & !node.leaf_lanes;
            let seen = boxes.alive & !open;
            let ends = lanes.next(lanes.at_most(lanes.words(&node.first_leaf), end), end);
            by_one.push(lanes, lanes.words(&node.child), ends, lanes.repeat(of), open);
            marks.add(lanes, node, end, *bit_from_leaf, [seen & !above & kept[0], seen & !below & kept[1]], *rows);
        }
        stats.nodes_visited += visited;
        stats.plane_tests += tests * LANES as u64;
    }

    /// Hands on all in order, and leaves the marks clear.
    #[inline(always)]
    fn hand_on(&mut self, sink: &mut impl Sink) {
        self.found.resize(Self::FOUND, 0);
        let Self { areas, between, marks, found, .. } = self;
        let (mut next, mut word) = (0, 0);
        for between in &*between {
            while next < between.areas as usize {
                word = hand_on_area(&areas[next], &mut marks.words, word, found, sink);
                next += 1;
            }
            sink.emit(between.leaves, between.cells);
        }
        for area in &areas[next..] {
            word = hand_on_area(area, &mut marks.words, word, found, sink);
        }
    }
}

/// Hands on an area whose marks begin in `word`. Returns where the next one's do.
#[inline(always)]
fn hand_on_area(area: &Area, marks: &mut [[u64; ROWS]], word: usize, found: &mut [u32], sink: &mut impl Sink) -> usize {
    let end = word + words_of(area.leaves);
    for (row, view) in area.views.iter().enumerate() {
        if *view == NO_VIEW {
            continue;
        }
        let mut count = 0;
        let mut first = area.leaves.start;
        for marks in &mut marks[word..end] {
            let mut left = std::mem::take(&mut marks[row]);
            let of_word = left.count_ones() as usize;
            if count + Pending::OF_WORD > found.len() {
                sink.append_to_view(found[..count & !1].as_chunks().0, *view);
                // An odd one out begins a range that ends later.
                found[0] = found[count - 1];
                count &= 1;
            }
            let out = &mut found[count..count + Pending::OF_WORD];
            // Some more than there are, so that there is seldom a branch to guess.
            let mut written = 0;
            loop {
                for place in &mut out[written..written + 4] {
                    *place = first + left.trailing_zeros();
                    left &= left.wrapping_sub(1);
                }
                written += 4;
                if written >= of_word {
                    break;
                }
            }
            count += of_word;
            first += u64::BITS;
        }
        sink.append_to_view(found[..count].as_chunks().0, *view);
    }
    end
}
