//! The sweep: one walk of the wide tree finds the tiles of a whole grid.
//!
//! A box meets a contiguous range of a lattice's columns and one of its rows. The walk carries that rectangle of slots, and
//! which of its outer sides may still cut the box, down the tree; of a node's eight children it tests
//! only the planes inside the rectangle and the sides left. What lies in one slot and is cut by nothing goes out whole, as
//! (leaf range × rectangle of tiles), in ascending order. Leaves that are cut are tested again as oriented boxes.
//! Subtrees that one plane cuts each way at most are put aside and walked together.
//! Walls of several screens or eyes are swept lattice by lattice.

mod classify;
mod cuts;
mod helpers;
mod kernel;
mod lanes;
mod lattice;
mod pending;
mod slack;

use glam::DAffine3;
use mullion_common::geometry::Frustum;
use mullion_common::visible_set::VisibleSet;

use super::CullStats;
use crate::tree::CullTree;
use helpers::Helper;
use kernel::{Memory, Sweep, ToSets, ToVisits, Visit};
use lattice::Lattice;
use slack::Slack;

/// Scenes of fewer leaves are swept by one thread: waking another one would take longer.
const MIN_LEAVES_TO_SHARE: u32 = 1 << 15;
/// Into about how many parts a tree is taken apart to be shared out evenly.
const PARTS: u32 = 512;

/// Sweeps frame after frame, reusing its memory.
pub(super) struct Sweeper {
    lattices: Vec<Lattice>,
    memory: Memory,
    helpers: Vec<Helper>,
    /// Of the last shared frame, for each lattice, how the work was spread over the leaves.
    balance: Vec<Balance>,
    parts: Vec<Visit>,
    /// For each lattice, where slack is used.
    slack: Option<Vec<Slack>>,
    /// Of the tree last culled.
    stamp: u64,
}

impl Sweeper {
    /// A sweeper for views given in room space, by `ViewId`.
    pub(super) fn new(room: &[Frustum]) -> Self {
        let lattices = Lattice::of_views(room);
        let balance = vec![Balance::default(); lattices.len()];
        Self { lattices, memory: Memory::default(), helpers: Vec::new(), balance, parts: Vec::new(), slack: None, stamp: 0 }
    }

    /// Sweeps large scenes on so many threads, the caller's among them.
    ///
    /// # Errors
    /// When the system gives no more.
    pub(super) fn set_threads(&mut self, threads: usize) -> std::io::Result<()> {
        self.helpers.truncate(threads.saturating_sub(1));
        while self.helpers.len() + 1 < threads {
            self.helpers.push(Helper::start()?);
        }
        Ok(())
    }

    /// Uses temporal slack, or does not.
    pub(super) fn set_slack(&mut self, is_used: bool) {
        self.slack = is_used.then(|| self.lattices.iter().map(|_| Slack::new()).collect());
    }

    /// Takes the views' new frusta in room space, after an eye has moved. Allocates only where views that shared an eye no
    /// longer do.
    pub(super) fn update(&mut self, room: &[Frustum]) {
        if !self.lattices.iter_mut().all(|lattice| lattice.update(room)) {
            self.lattices = Lattice::of_views(room);
            self.balance.resize(self.lattices.len(), Balance::default());
            self.set_slack(self.slack.is_some());
        }
    }

    /// Finds what each view may see. `sets` must be empty.
    pub(super) fn cull(&mut self, tree: &CullTree, world_from_room: &DAffine3, sets: &mut [VisibleSet]) -> CullStats {
        let mut stats = CullStats::default();
        let is_shared = !self.helpers.is_empty() && tree.wide().leaf_count() >= MIN_LEAVES_TO_SHARE;
        if self.stamp != tree.stamp() {
            self.stamp = tree.stamp();
            self.slack.iter_mut().flatten().for_each(Slack::forget);
        }
        for at in 0..self.lattices.len() {
            self.lattices[at].place(world_from_room);
            let slack = self.slack.as_mut().map(|slack| &mut slack[at]);
            let updated = slack.and_then(|slack| slack.cull(tree.wide(), &self.lattices[at], sets));
            if let Some(update) = updated {
                stats += update;
            } else if is_shared {
                stats += self.cull_shared(at, tree, sets);
            } else {
                let start = [Visit::all(tree.wide(), &self.lattices[at])];
                stats += sweep(tree, &self.lattices[at], &start, &mut self.memory, sets);
            }
        }
        stats
    }

    /// Sweeps one lattice on all threads.
    fn cull_shared(&mut self, at: usize, tree: &CullTree, sets: &mut [VisibleSet]) -> CullStats {
        let lattice = &self.lattices[at];
        let wide = tree.wide();
        self.parts.clear();
        let sink = ToVisits { visits: &mut self.parts, grain: (wide.leaf_count() / PARTS).max(1) };
        let start = [Visit::all(wide, lattice)];
        let memory = &mut self.memory;
        let mut stats = lanes::run_on_best(Sweep { tree: wide, lattice, start: &start, memory, sink });

        let balance = &mut self.balance[at];
        balance.split(&self.parts, self.helpers.len() + 1);
        for (helper, k) in self.helpers.iter_mut().zip(1..) {
            helper.send(|share| {
                share.tree = Some(tree.shared());
                share.lattice.clone_from(lattice);
                share.start.clear();
                share.start.extend_from_slice(&self.parts[balance.share(k)]);
                share.sets.resize_with(sets.len(), VisibleSet::default);
            });
        }
        let own = sweep(tree, lattice, &self.parts[balance.share(0)], &mut self.memory, sets);
        balance.note(0, &self.parts, &own);
        stats += own;
        for (helper, k) in self.helpers.iter_mut().zip(1..) {
            let share = helper.wait();
            balance.note(k, &self.parts, &share.stats);
            stats += share.stats;
            for (set, more) in sets.iter_mut().zip(&share.sets) {
                set.append(more);
            }
        }
        stats
    }
}

/// Sweeps what `start` lists, on this thread.
fn sweep(tree: &CullTree, lattice: &Lattice, start: &[Visit], memory: &mut Memory, sets: &mut [VisibleSet]) -> CullStats {
    let sink = ToSets { lattice, sets };
    lanes::run_on_best(Sweep { tree: tree.wide(), lattice, start, memory, sink })
}

/// How a sweep is shared out: so that each share would have cost the same in the frame before.
#[derive(Clone, Default)]
struct Balance {
    /// Of each share, one past its last part.
    ends: Vec<usize>,
    /// Of each share of the frame before, one past its last leaf, and nodes visited for each leaf.
    measured: Vec<(u32, f64)>,
}

impl Balance {
    /// What a part will cost, by what its leaves cost in the frame before.
    fn cost(&self, part: &Visit) -> f64 {
        if part.is_emission() {
            return 0.0;
        }
        let share = self.measured.iter().find(|(end, _)| part.leaves.start < *end);
        // A node takes a visit, however little is below it.
        1.0 + share.map_or(1.0, |(_, density)| *density) * f64::from(part.leaves.len())
    }

    fn split(&mut self, parts: &[Visit], shares: usize) {
        let total: f64 = parts.iter().map(|part| self.cost(part)).sum();
        self.ends.clear();
        let (mut sum, mut end) = (0.0, 0);
        for k in 1..=shares {
            let goal = total * k as f64 / shares as f64;
            while end < parts.len() && (k == shares || sum < goal) {
                sum += self.cost(&parts[end]);
                end += 1;
            }
            self.ends.push(end);
        }
        self.measured.clear();
    }

    /// The parts of a share.
    fn share(&self, k: usize) -> std::ops::Range<usize> {
        let start = if k == 0 { 0 } else { self.ends[k - 1] };
        start..self.ends[k]
    }

    /// Takes down what share `k` cost; shares in ascending order.
    fn note(&mut self, k: usize, parts: &[Visit], stats: &CullStats) {
        let parts = &parts[self.share(k)];
        let leaves: u64 = parts.iter().filter(|p| !p.is_emission()).map(|p| u64::from(p.leaves.len())).sum();
        let density = stats.nodes_visited as f64 / leaves.max(1) as f64;
        self.measured.extend(parts.last().map(|last| (last.leaves.end, density)));
    }
}
