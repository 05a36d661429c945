//! A tree built anew while the old one is in use.
//!
//! Leaves' bounds are copied, so many a frame; the tree is built over the copies in a thread of its own; what was edited
//! since the copying began is then done again to the new tree.

use std::sync::Arc;
use std::thread::{self, JoinHandle};

use mullion_common::geometry::Obb;
use mullion_common::scene::ObjectHierarchy;

use super::build::hierarchy_over;
use super::{Bounds, CullTree, RebuildStep};

/// Leaves copied in a frame: about a millisecond's work.
const LEAVES_A_STEP: u32 = 1 << 14;

/// Not a leaf.
const NONE: u32 = u32::MAX;

/// A rebuild on its way.
#[derive(Debug)]
pub(super) struct Rebuild {
    leaf_count: u32,
    /// Leaves looked at so far.
    copied: u32,
    /// Those of them that were there, with their bounds.
    leaves: Vec<u32>,
    bounds: Vec<Obb>,
    /// Leaves edited since the start, each once, and a bit for each.
    edited: Vec<u32>,
    is_edited: Vec<u64>,
    work: Option<JoinHandle<Built>>,
}

impl Rebuild {
    /// Starts with a tree of so many leaves.
    pub(super) fn new(leaf_count: u32) -> Self {
        let none = Self {
            leaf_count,
            copied: 0,
            leaves: Vec::new(),
            bounds: Vec::new(),
            edited: Vec::new(),
            is_edited: Vec::new(),
            work: None,
        };
        let count = leaf_count as usize;
        Self {
            leaves: Vec::with_capacity(count),
            bounds: Vec::with_capacity(count),
            is_edited: vec![0; count.div_ceil(64)],
            ..none
        }
    }

    /// Takes down that a leaf was edited.
    pub(super) fn note(&mut self, leaf: u32) {
        let word = leaf as usize / 64;
        if word >= self.is_edited.len() {
            self.is_edited.resize(word + 1, 0);
        }
        if self.is_edited[word] & (1 << (leaf % 64)) == 0 {
            self.is_edited[word] |= 1 << (leaf % 64);
            self.edited.push(leaf);
        }
    }

    /// The leaves edited since the start.
    pub(super) fn edited(&mut self) -> &[u32] {
        // Added ones get their new numbers in the order of the old ones.
        self.edited.sort_unstable();
        &self.edited
    }

    /// Goes on; the new tree when it is there. `leaf` tells a leaf's bound, and none for a removed one.
    pub(super) fn step(&mut self, step: RebuildStep, kind: Bounds, leaf: impl Fn(u32) -> Option<Obb>) -> Option<Built> {
        let limit = if step == RebuildStep::Finish { u32::MAX } else { LEAVES_A_STEP };
        if self.copied < self.leaf_count {
            let end = self.copied.saturating_add(limit).min(self.leaf_count);
            for (at, bound) in (self.copied..end).filter_map(|at| Some((at, leaf(at)?))) {
                self.leaves.push(at);
                self.bounds.push(bound);
            }
            self.copied = end;
            if end < self.leaf_count {
                return None;
            }
        }
        if self.work.is_none() {
            let (leaves, bounds, old_count) =
                (std::mem::take(&mut self.leaves), std::mem::take(&mut self.bounds), self.leaf_count);
            let build = move || Built::new(&leaves, &bounds, old_count, kind);
            match thread::Builder::new().name("rebuild".to_owned()).spawn(build) {
                Ok(work) => self.work = Some(work),
                // No thread to be had: the tree stays as it is until one is.
                Err(_) => self.copied = 0,
            }
            if step == RebuildStep::Some {
                return None;
            }
        }
        let is_due = self.work.as_ref().is_some_and(|work| step == RebuildStep::Finish || work.is_finished());
        // A thread that panicked leaves no tree: the copying begins again.
        let built = self.work.take_if(|_| is_due)?.join().ok();
        if built.is_none() {
            self.copied = 0;
        }
        built
    }
}

/// A new tree.
#[derive(Debug)]
pub(super) struct Built {
    pub tree: CullTree,
    /// Of each of its leaves, the leaf of the old tree.
    pub old_of_new: Vec<u32>,
    /// Of each leaf of the old tree, the new one.
    new_of_old: Vec<u32>,
}

impl Built {
    fn new(leaves: &[u32], bounds: &[Obb], old_count: u32, kind: Bounds) -> Self {
        let (nodes, order) = hierarchy_over(bounds);
        // Depth first, nested and numbered in order: what `hierarchy_over` gives.
        let hierarchy = ObjectHierarchy::new(nodes).expect("a tree");
        let old_of_new: Vec<u32> = order.iter().map(|at| leaves[*at as usize]).collect();
        let mut new_of_old = vec![NONE; old_count as usize];
        for (new, old) in (0..).zip(&old_of_new) {
            new_of_old[*old as usize] = new;
        }
        Self { tree: CullTree::editable(Arc::new(hierarchy), kind), old_of_new, new_of_old }
    }

    /// Does again what was done to leaves of the old tree, given in ascending order. `now` tells a leaf's bound, and none for a removed
    /// one.
    pub(super) fn replay<'a>(&mut self, edited: &[u32], now: impl Fn(u32) -> Option<&'a Obb>) {
        let mut added = Vec::new();
        for leaf in edited {
            let new = self.new_of_old.get(*leaf as usize).copied().filter(|new| *new != NONE);
            match (new, now(*leaf)) {
                (Some(new), Some(bound)) => self.tree.move_leaf(new, bound),
                (Some(new), None) => self.tree.remove_leaf(new),
                (None, Some(bound)) => {
                    added.push(*bound);
                    self.old_of_new.push(*leaf);
                }
                (None, None) => {}
            }
        }
        if !added.is_empty() {
            self.tree.add_leaves(&added);
        }
    }
}
