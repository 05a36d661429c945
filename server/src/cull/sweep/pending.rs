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
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
struct OnePlane {
    plane: LanePlane,
    /// Rows of the views on the negative side and on the positive one.
    rows: [usize; 2],
    /// For each of them all lanes where there is a view, and none where not.
    kept: [u8; 2],
    /// From a leaf's number to its bit, modulo 2³².
    bit_from_leaf: u32,
}

/// Two planes for nodes of an area.
#[derive(Clone, Copy, Debug, Default)]
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
#[derive(Debug)]
struct Queue {
    nodes: [u32; Queue::PLACES],
    /// Of each node, one past its last leaf.
    ends: [u32; Queue::PLACES],
    /// Of each node, what cuts it.
    of: [u32; Queue::PLACES],
    /// Those that wait. What walks the queue has them with it meanwhile.
    waiting: Waiting,
    /// Those that find no place, out of turn: seldom any.
    more: Vec<[u32; 3]>,
}

/// Places of the nodes that wait in a queue.
#[derive(Clone, Copy, Debug, Default)]
struct Waiting {
    /// The next one's.
    at: usize,
    /// One past the last one's.
    end: usize,
}

/// Where ranges of one view begin and end.
#[derive(Debug)]
struct Found([u32; Found::LEN + Found::OF_WORD]);

/// A list of at most `N`, a power of two, so that no look-up is checked.
#[derive(Debug)]
struct Table<T, const N: usize> {
    places: Box<[T; N]>,
    len: usize,
}

/// See above. Reuses its memory.
#[derive(Debug, Default)]
pub(super) struct Pending {
    areas: Vec<Area>,
    between: Vec<Between>,
    one: Table<OnePlane, { 4 * Pending::AREAS }>,
    two: Table<TwoPlanes, { Pending::AREAS }>,
    by_one: Box<Queue>,
    by_two: Box<Queue>,
    marks: Marks,
    found: Found,
}

/// For each leaf of the areas, and one past the last of each, whether leaves begin or end to be seen there, view by view.
#[derive(Debug, Default)]
struct Marks {
    /// Zero where nothing is pending.
    words: Vec<[u64; ROWS]>,
    /// How many are given to areas.
    used: usize,
}

impl<T: Copy + Default, const N: usize> Default for Table<T, N> {
    fn default() -> Self {
        Self { places: Box::new([T::default(); N]), len: 0 }
    }
}

impl<T, const N: usize> Table<T, N> {
    fn push(&mut self, value: T) {
        self.places[self.len % N] = value;
        self.len += 1;
    }

    #[inline(always)]
    fn at(&self, place: u32) -> &T {
        &self.places[place as usize % N]
    }
}

impl Default for Queue {
    fn default() -> Self {
        let none = [0; Self::PLACES];
        Self { nodes: none, ends: none, of: none, waiting: Waiting::default(), more: Vec::new() }
    }
}

impl Found {
    /// More than so many numbers are handed on before another word is read.
    const LEN: usize = 192;
    /// Most that come from one word.
    const OF_WORD: usize = 64;
}

impl Default for Found {
    fn default() -> Self {
        Self([0; Self::LEN + Self::OF_WORD])
    }
}

impl Queue {
    /// Most nodes that wait in place.
    const LEN: usize = 1024;
    /// Some more, into which all lanes are written though few of them count.
    const PLACES: usize = Self::LEN + LANES;
    /// How many nodes ahead memory is asked for.
    const AHEAD: usize = 8;

    /// Adds children of a node.
    #[inline(always)]
    fn push<L: Lanes>(&mut self, lanes: L, waiting: &mut Waiting, [children, ends, of]: [L::Words; 3], which: u8) {
        if waiting.end > Self::LEN - LANES {
            *waiting = self.make_room(*waiting);
        }
        let at = waiting.end % Self::LEN;
        for (list, words) in [(&mut self.nodes, children), (&mut self.ends, ends), (&mut self.of, of)] {
            if let Some((places, _)) = list[at..].split_first_chunk_mut() {
                lanes.pack(words, which, places);
            }
        }
        waiting.end = at + which.count_ones() as usize;
    }

    /// Adds one node.
    fn push_one(&mut self, [node, end, of]: [u32; 3]) {
        if self.waiting.end >= Self::LEN {
            self.waiting = self.make_room(self.waiting);
        }
        let at = self.waiting.end % Self::LEN;
        (self.nodes[at], self.ends[at], self.of[at]) = (node, end, of);
        self.waiting.end = at + 1;
    }

    /// Gives the places of nodes that have been visited to those that wait, and sets aside what still is too much.
    #[cold]
    #[inline(never)]
    fn make_room(&mut self, waiting: Waiting) -> Waiting {
        for list in [&mut self.nodes, &mut self.ends, &mut self.of] {
            list.copy_within(waiting.at..waiting.end, 0);
        }
        let mut end = waiting.end - waiting.at;
        while end > Self::LEN / 2 {
            end -= 1;
            self.more.push([self.nodes[end], self.ends[end], self.of[end]]);
        }
        Waiting { at: 0, end }
    }

    /// Gives places to nodes that were set aside, now that no other one waits.
    #[cold]
    #[inline(never)]
    fn refill(&mut self) -> Waiting {
        self.waiting = Waiting::default();
        while self.waiting.end < Self::LEN / 2
            && let Some(node) = self.more.pop()
        {
            self.push_one(node);
        }
        self.waiting
    }

    /// The next node, one past its last leaf, and what cuts it. Asks for the memory of one that comes later.
    #[inline(always)]
    fn next<L: Lanes>(&mut self, lanes: L, waiting: &mut Waiting, tree: &WideTree) -> Option<[u32; 3]> {
        if waiting.at >= waiting.end {
            *waiting = self.refill();
            if waiting.end == 0 {
                return None;
            }
        }
        let soon = self.nodes[(waiting.at + Self::AHEAD).min(waiting.end - 1) % Self::LEN] as usize;
        lanes.prefetch_at(tree.nodes(), soon);
        lanes.prefetch_at(tree.axes(), soon);
        let at = waiting.at % Self::LEN;
        waiting.at = at + 1;
        Some([self.nodes[at], self.ends[at], self.of[at]])
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

    /// Marks where the leaves of lanes begin and end to be seen: which lanes are, row by row.
    #[inline(always)]
    fn add<L: Lanes, const N: usize>(
        &mut self,
        lanes: L,
        node: &WideNode,
        starts: L::Words,
        end: u32,
        bit_from_leaf: u32,
        seen: [(u8, usize); N],
    ) {
        let first = node.first_leaf[0];
        // A lane that is seen otherwise than the one before it begins where leaves begin or end to be seen.
        let changes = seen.map(|(lanes, row)| (u64::from(lanes) ^ (u64::from(lanes) << 1), row % ROWS));
        if end - first < u64::BITS {
            let places = lanes.marks(starts, first) | (1 << (end - first));
            let bit = first.wrapping_add(bit_from_leaf);
            let (word, shift) = (bit as usize / 64, bit % 64);
            if let Some([low, high, ..]) = self.words.get_mut(word..word + 2) {
                for (changes, row) in changes {
                    let changes = lanes.deposit(changes, places);
                    low[row] ^= changes << shift;
                    high[row] ^= (changes >> 1) >> (63 - shift);
                }
            }
            return;
        }
        // Far apart: one after the other, for all rows at once.
        let mut left = changes.iter().fold(0, |all, (changes, _)| all | changes);
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let leaf = if lane < LANES { node.first_leaf[lane].min(end) } else { end };
            let bit = leaf.wrapping_add(bit_from_leaf);
            let marks = &mut self.words[bit as usize / 64];
            for (changes, row) in changes {
                marks[row] ^= ((changes >> lane) & 1) << (bit % 64);
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

    /// Leaves that all cells may see.
    #[inline(always)]
    pub(super) fn emit(&mut self, leaves: LeafRange, cells: [u16; 4]) {
        self.between.push(Between { leaves, cells, areas: self.areas.len() as u32 });
    }

    /// Takes a subtree.
    #[inline(always)]
    pub(super) fn take(&mut self, visit: &Visit, cuts: &Cuts<'_>) {
        let bit_from_leaf = self.marks.give(visit.leaves);
        let one = |plane: &LanePlane, rows: [usize; 2], views: &Views| {
            let kept = rows.map(|row| kept(views[row]));
            OnePlane { plane: *plane, rows, kept, bit_from_leaf }
        };
        let of_one = self.one.len as u32;
        let (Cuts::One(_, views) | Cuts::Two(_, views)) = cuts;
        self.areas.push(Area { leaves: visit.leaves, views: *views });
        match cuts {
            Cuts::One(plane, views) => {
                self.by_one.push_one([visit.node, visit.leaves.end, of_one]);
                self.one.push(one(plane, [0, 1], views));
            }
            Cuts::Two([x, y], views) => {
                self.by_two.push_one([visit.node, visit.leaves.end, self.two.len as u32]);
                self.two.push(TwoPlanes { planes: [**x, **y], kept: views.map(kept), bit_from_leaf, first_one: of_one });
                for (plane, rows) in [(x, [0, 1]), (x, [2, 3]), (y, [0, 2]), (y, [1, 3])] {
                    self.one.push(one(plane, rows, views));
                }
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
        (self.one.len, self.two.len, self.marks.used) = (0, 0, 0);
    }

    /// Visits the nodes that two planes may cut. Adds those below that only one does.
    #[inline(always)]
    fn walk_by_two<L: Lanes>(&mut self, lanes: L, tree: &WideTree, offset: DVec3, planes: &LanePlanes, stats: &mut CullStats) {
        let Self { two, by_one, by_two, marks, .. } = self;
        let (mut waiting, mut by_one_waiting) = (by_two.waiting, by_one.waiting);
        let (mut visited, mut tests) = (0, 0);
        while let Some([id, end, of]) = by_two.next(lanes, &mut waiting, tree) {
            let TwoPlanes { planes: [across, up], kept, bit_from_leaf, first_one } = two.at(of);
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
            let starts = lanes.at_most(lanes.words(&node.first_leaf), end);
            let ends = lanes.next(starts, end);
            by_two.push(lanes, &mut waiting, [children, ends, lanes.repeat(of)], open & is_cut_across & is_cut_up);
            let of_across = lanes.choose(above, lanes.repeat(first_one + 1), lanes.repeat(*first_one));
            let of_up = lanes.choose(right, lanes.repeat(first_one + 3), lanes.repeat(first_one + 2));
            let of_one = lanes.choose(is_cut_across, of_across, of_up);
            by_one.push(lanes, &mut by_one_waiting, [children, ends, of_one], open & !(is_cut_across & is_cut_up));
            let closed = boxes.alive & !open;
            let seen = [(seen[0] & closed, 0), (seen[1] & closed, 1), (seen[2] & closed, 2), (seen[3] & closed, 3)];
            marks.add(lanes, node, starts, end, *bit_from_leaf, seen);
        }
        by_one.waiting = by_one_waiting;
        stats.nodes_visited += visited;
        stats.plane_tests += tests * LANES as u64;
    }

    /// Visits the nodes that one plane may cut.
    #[inline(always)]
    fn walk_by_one<L: Lanes>(&mut self, lanes: L, tree: &WideTree, offset: DVec3, planes: &LanePlanes, stats: &mut CullStats) {
        let Self { one, by_one, marks, .. } = self;
        let mut waiting = by_one.waiting;
        let (mut visited, mut tests) = (0, 0);
        while let Some([id, end, of]) = by_one.next(lanes, &mut waiting, tree) {
            let OnePlane { plane, rows, kept, bit_from_leaf } = one.at(of);
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
            let starts = lanes.at_most(lanes.words(&node.first_leaf), end);
            let ends = lanes.next(starts, end);
            by_one.push(lanes, &mut waiting, [lanes.words(&node.child), ends, lanes.repeat(of)], open);
            let seen = [(seen & !above & kept[0], rows[0]), (seen & !below & kept[1], rows[1])];
            marks.add(lanes, node, starts, end, *bit_from_leaf, seen);
        }
        stats.nodes_visited += visited;
        stats.plane_tests += tests * LANES as u64;
    }

    /// Hands on all in order, and leaves the marks clear.
    #[inline(always)]
    fn hand_on(&mut self, sink: &mut impl Sink) {
        let Self { areas, between, marks, found, .. } = self;
        let mut between = between.iter().peekable();
        let mut words = &mut marks.words[..];
        for (area, before) in areas.iter().zip(1..) {
            while let Some(Between { leaves, cells, .. }) = between.next_if(|between| between.areas < before) {
                sink.emit(*leaves, *cells);
            }
            let (of_area, rest) = words.split_at_mut(words_of(area.leaves));
            hand_on_area(area, of_area, found, sink);
            words = rest;
        }
        between.for_each(|Between { leaves, cells, .. }| sink.emit(*leaves, *cells));
    }
}

/// Hands on an area.
#[inline(always)]
fn hand_on_area(area: &Area, words: &mut [[u64; ROWS]], found: &mut Found, sink: &mut impl Sink) {
    for (row, view) in area.views.iter().enumerate() {
        if *view == NO_VIEW {
            continue;
        }
        let mut count = 0;
        let mut first = area.leaves.start;
        for marks in &mut *words {
            let mut left = std::mem::take(&mut marks[row]);
            let of_word = left.count_ones() as usize;
            if count > Found::LEN {
                sink.append_to_view(found.0[..count & !1].as_chunks().0, *view);
                // An odd one out begins a range that ends later.
                found.0[0] = found.0[count - 1];
                count &= 1;
            }
            if let Some((out, _)) = found.0[count..].split_first_chunk_mut::<{ Found::OF_WORD }>() {
                // Some more than there are, so that there is seldom a branch to guess.
                for places in out.as_chunks_mut::<4>().0 {
                    for place in places {
                        *place = first + left.trailing_zeros();
                        left &= left.wrapping_sub(1);
                    }
                    if left == 0 {
                        break;
                    }
                }
            }
            count += of_word;
            first += u64::BITS;
        }
        sink.append_to_view(found.0[..count].as_chunks().0, *view);
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::Plain;
    use super::*;

    #[test]
    fn each_node_of_a_queue_comes_once_however_many_wait() {
        const NODES: u32 = 20_000;
        let tree = WideTree::default();
        let mut queue = Queue::default();
        for round in 0..2 {
            queue.push_one([0, 1, 2]);
            let mut waiting = queue.waiting;
            let (mut known, mut came) = (1, vec![0; NODES as usize + LANES]);
            while let Some([node, end, of]) = queue.next(Plain, &mut waiting, &tree) {
                assert_eq!([end, of], [node + 1, 2 * node + 2]);
                came[node as usize] += 1;
                // Some lanes of a node, so that many more come than go, and then none.
                let which = if known < NODES { [0b1010_0110, 0b1111_1111, 0b0000_0001, 0][node as usize % 4] | 1 } else { 0 };
                let child = |lane: usize| known + (u32::from(which) & ((1 << lane) - 1)).count_ones();
                let children: [u32; LANES] = std::array::from_fn(child);
                let words = [children, children.map(|node| node + 1), children.map(|node| 2 * node + 2)];
                queue.push(Plain, &mut waiting, words, which);
                known += which.count_ones();
            }
            assert!(known >= NODES && queue.more.capacity() > 0, "{known} in round {round}");
            assert!(came[..known as usize].iter().all(|times| *times == 1));
        }
    }
}
