//! Occlusion culling in rounds: what a round draws hides what the next ones ask for. Of one view.

use std::cmp::{Ordering, Reverse};
use std::collections::{BinaryHeap, HashSet};

use glam::DVec3;
use mullion_common::geometry::Aabb;
use mullion_common::scene::{LeafRecord, Transform};
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::ROUNDED_BITS;
use super::tree::{NodeId, VisibleTree};
use crate::frame::{Bound, Times};

/// Most bounds of a round in order of depth: those behind are asked for when more is drawn.
const DEPTH_LIST_BOUNDS: usize = 32;
/// Most bounds of a round of queries: as many as a set of them holds.
pub const MAX_QUERIES: usize = 4096;
/// After so many rounds all that is left is drawn: between rounds, depths that tie are told apart by as many bits.
const MAX_ROUNDS: u32 = 200;
const _: () = assert!(MAX_ROUNDS < 1 << ROUNDED_BITS);

/// How the rounds go.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs)]
pub enum Order {
    /// Front to back: what comes to the head of the list is asked for, and if it is seen a leaf is drawn, a node makes way for its children
    /// (Bartz, Meißner, Hüttner 1999, section 4.4). Once testing took so many microseconds in a frame, all that is left is drawn.
    Depth { budget_us: f64 },
    /// What was seen before is drawn at once, and all else asked for in groups (Mattausch, Bittner, Wimmer 2008). There what is seen is asked
    /// for again now and then; here the picture tells in every frame what has a pixel, and no query is spent on it.
    Seen,
}

impl Default for Order {
    fn default() -> Self {
        Self::Depth { budget_us: f64::INFINITY }
    }
}

/// What a view may see in a frame.
#[allow(missing_docs)]
pub struct Subject<'a> {
    /// Opaque and masked leaves.
    pub opaque: &'a VisibleSet,
    /// Blended ones, in any order.
    pub blended: &'a [u32],
    pub records: &'a [LeafRecord],
    pub transforms: &'a [Transform],
    pub eye: DVec3,
    /// Nothing moved since the last frame, neither the eye nor what it sees.
    pub is_still: bool,
    /// Also leaves are asked for by their boxes in the world.
    pub in_world: bool,
}

/// What a round draws, and what it asks for. All that is blended is drawn in the last.
#[derive(Debug, Default)]
#[allow(missing_docs)]
pub struct Round {
    pub number: u32,
    pub opaque: VisibleSet,
    pub bounds: Vec<Bound>,
    pub is_last: bool,
}

/// A node in the list, nearest first.
#[derive(Debug, PartialEq)]
struct Entry {
    distance_squared: f64,
    node: NodeId,
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.distance_squared.total_cmp(&other.distance_squared).then(self.node.cmp(&other.node))
    }
}

/// The rounds of one view, from frame to frame.
#[derive(Debug, Default)]
pub struct Rounds {
    order: Order,
    tree: VisibleTree,
    eye: DVec3,
    in_world: bool,
    list: BinaryHeap<Reverse<Entry>>,
    asked: Vec<NodeId>,
    /// Nodes that wait for a round with room.
    waiting: Vec<NodeId>,
    round: Round,
    used_us: f64,
    blended: VisibleSet,
    /// Blended leaves that are not hidden.
    kept: VisibleSet,
    /// Names of nodes that were seen since something last moved.
    known: HashSet<(u32, u32)>,
    /// What is drawn, with [`Order::Seen`] to be drawn at once in the next frame; none before the first.
    seen: Option<VisibleSet>,
    is_still: bool,
    scratch: VisibleSet,
}

impl Rounds {
    /// Begins a frame.
    pub fn begin(&mut self, order: Order, subject: &Subject<'_>) {
        (self.order, self.eye, self.used_us, self.round.number) = (order, subject.eye, 0.0, 0);
        self.in_world = subject.in_world;
        self.list.clear();
        self.waiting.clear();
        self.kept.clear();
        self.is_still = subject.is_still;
        // A frame before that was not complete leaves these.
        self.asked.clear();
        if !subject.is_still {
            self.known.clear();
        }
        self.blended.clear();
        subject.blended.iter().for_each(|&leaf| self.blended.push_unordered(one(leaf)));
        self.blended.normalize();
        let mut all = std::mem::take(&mut self.scratch);
        subject.opaque.union_into(&self.blended, &mut all);
        self.tree.build(all.leaves(), subject.records, subject.transforms);
        self.scratch = all;
        self.clear_round();
        match (order, self.seen.take()) {
            (Order::Seen, Some(mut seen)) => {
                self.begin_with_seen(subject, &seen);
                seen.clear();
                self.seen = Some(seen);
            }
            (order, _) => {
                // Also where it is not known yet what is seen.
                if order == Order::Seen {
                    (self.order, self.seen) = (Order::default(), Some(VisibleSet::default()));
                }
                self.tree.roots().for_each(|root| self.enlist(root));
                self.take_from_list();
            }
        }
        self.finish_round();
    }

    /// Takes what was asked for: whether each of the last round's bounds is seen; empty where nobody knows, then all are. Whether there is
    /// another.
    pub fn next(&mut self, is_seen: &[bool], times: Option<Times>) -> bool {
        if self.round.is_last {
            return false;
        }
        self.used_us += times.map_or(0.0, |times| times.test_us);
        self.round.number += 1;
        let asked = std::mem::take(&mut self.asked);
        self.clear_round();
        for (at, node) in asked.iter().enumerate() {
            if is_seen.get(at).copied().unwrap_or(true) {
                self.see(*node);
            }
        }
        self.asked = asked;
        self.asked.clear();
        if self.is_out_of_budget() {
            self.draw_all_that_is_left();
        } else if matches!(self.order, Order::Depth { .. }) {
            self.take_from_list();
        } else {
            self.ask_waiting();
        }
        self.finish_round();
        true
    }

    /// The round that is being drawn.
    pub fn round(&self) -> &Round {
        &self.round
    }

    /// What is drawn of a frame whose last round this is, where the next one begins with what of it has a pixel. While nothing moves, nothing
    /// that was seen is asked for again, with a pixel or without.
    pub fn looked_for(&self) -> Option<&VisibleSet> {
        self.seen.as_ref().filter(|_| !self.is_still)
    }

    /// Takes what of it has a pixel.
    pub fn note_pixels(&mut self, with_pixel: &VisibleSet) {
        if let Some(seen) = &mut self.seen {
            seen.clone_from(with_pixel);
        }
    }

    /// Blended leaves that are drawn after all else.
    pub fn kept(&self) -> &VisibleSet {
        &self.kept
    }

    fn is_out_of_budget(&self) -> bool {
        let spent = matches!(self.order, Order::Depth { budget_us } if self.used_us > budget_us);
        spent || self.round.number >= MAX_ROUNDS
    }

    fn clear_round(&mut self) {
        self.round.opaque.clear();
        self.round.bounds.clear();
    }

    fn finish_round(&mut self) {
        self.round.opaque.normalize();
        self.kept.normalize();
        if let Some(seen) = &mut self.seen {
            seen.union_into(&self.round.opaque, &mut self.scratch);
            std::mem::swap(seen, &mut self.scratch);
        }
        self.round.is_last = self.round.bounds.is_empty();
    }

    fn draw(&mut self, leaf: u32) {
        let to = if self.blended.contains(leaf) { &mut self.kept } else { &mut self.round.opaque };
        to.push_unordered(one(leaf));
    }

    fn ask(&mut self, node: NodeId) {
        self.asked.push(node);
        self.round.bounds.push(match self.tree.leaf(node) {
            Some(leaf) if !self.in_world => Bound::Leaf(leaf),
            _ => Bound::World(self.tree.bounds(node)),
        });
    }

    /// A node is seen: its children are next.
    fn see(&mut self, node: NodeId) {
        if let Order::Depth { .. } = self.order {
            self.known.insert(self.tree.name(node));
        }
        if let Some(leaf) = self.tree.leaf(node) {
            self.draw(leaf);
            return;
        }
        for child in self.tree.children(node) {
            match self.order {
                Order::Depth { .. } => self.enlist(child),
                Order::Seen => self.waiting.push(child),
            }
        }
    }

    fn enlist(&mut self, node: NodeId) {
        let distance_squared = distance_squared(&self.tree.bounds(node), self.eye);
        self.list.push(Reverse(Entry { distance_squared, node }));
    }

    /// Asks for what is nearest. What is known to be seen need not be asked for.
    fn take_from_list(&mut self) {
        while self.asked.len() < DEPTH_LIST_BOUNDS {
            let Some(Reverse(Entry { node, .. })) = self.list.pop() else { break };
            if self.known.contains(&self.tree.name(node)) {
                self.see(node);
            } else {
                self.ask(node);
            }
        }
    }

    fn draw_all_that_is_left(&mut self) {
        let mut left: Vec<NodeId> = self.list.drain().map(|Reverse(entry)| entry.node).collect();
        left.append(&mut self.waiting);
        let mut leaves = Vec::new();
        left.into_iter().for_each(|node| self.tree.each_leaf(node, &mut |leaf| leaves.push(leaf)));
        leaves.into_iter().for_each(|leaf| self.draw(leaf));
    }

    fn begin_with_seen(&mut self, subject: &Subject<'_>, seen: &VisibleSet) {
        subject.opaque.intersection_into(seen, &mut self.round.opaque);
        let drawn = std::mem::take(&mut self.round.opaque);
        for root in self.tree.roots() {
            self.await_hidden(root, &drawn);
        }
        self.round.opaque = drawn;
        self.ask_waiting();
    }

    /// Lists the largest nodes of which nothing is drawn. Gives whether that is all of this one.
    fn await_hidden(&mut self, node: NodeId, drawn: &VisibleSet) -> bool {
        if let Some(leaf) = self.tree.leaf(node) {
            let is_hidden = !drawn.contains(leaf);
            if is_hidden {
                self.waiting.push(node);
            }
            return is_hidden;
        }
        let before = self.waiting.len();
        let mut all = true;
        for child in self.tree.children(node) {
            all &= self.await_hidden(child, drawn);
        }
        if all {
            self.waiting.truncate(before);
            self.waiting.push(node);
        }
        all
    }

    fn ask_waiting(&mut self) {
        let room = MAX_QUERIES.saturating_sub(self.asked.len()).min(self.waiting.len());
        let nodes: Vec<NodeId> = self.waiting.drain(..room).collect();
        nodes.into_iter().for_each(|node| self.ask(node));
    }
}

fn one(leaf: u32) -> LeafRange {
    LeafRange::new(leaf, leaf + 1)
}

/// From a point to a box; 0 inside.
fn distance_squared(bounds: &Aabb, from: DVec3) -> f64 {
    (bounds.min - from).max(from - bounds.max).max(DVec3::ZERO).length_squared()
}
