//! Temporal slack: what cannot have changed since the last frame is not looked at.
//!
//! Every test of a box against a plane has a margin: how far the plane must move, near the box, before the answer can
//! change. Of each node that the sweep visits, the answers are kept with the least margin, and with the least margin
//! of everything below. A frame adds up how far planes may have moved at most; only subtrees whose margin is used up are
//! looked at, and what changes there is taken out of the last frame's sets and put into them. The sets are
//! those of the full sweep, to the bit.
//!
//! A plane that moves with its eye by δ and turns by an angle θ moves by no more than δ + θ·ρ within a distance ρ of the eye. How
//! far it has come is summed for distances in small steps ([`Travel`]).

use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::classify::{Boxes, Found, LanePlanes, Looked, Margins, State};
use super::kernel::Visit;
use super::lanes::{Kernel, Lanes};
use super::lattice::Lattice;
use crate::cull::CullStats;
use crate::tree::{LANES, WideTree};

/// What is kept of a node.
#[derive(Clone, Debug, Default)]
#[repr(C, align(64))]
struct Kept {
    /// Travel at which the answers of each lane may no longer hold.
    own: [f32; LANES],
    /// The same for what is below the lane, if it is open.
    below: [f32; LANES],
    found: Found,
    slots: [u16; 4],
    /// Which keeping this belongs to.
    round: u32,
    mask: u8,
    /// Which of [`Travel`]'s sums counts.
    band: u16,
}

/// How far planes have moved, for steps of the distance from the eye: eight for each power of two.
#[derive(Clone, Debug)]
struct Travel {
    metres: Box<[f64; Travel::BANDS]>,
}

/// Answers are kept while the eye moves by no more than this share of the distance.
const MOST_MOVED: f32 = 1.0 / 8.0;

impl Travel {
    /// Of an `f32` without its sign, the exponent and three more digits; up to the greatest.
    const BANDS: usize = 0x7f8;
    const SHIFT: u32 = 20;

    fn none() -> Self {
        Self { metres: Box::new([0.0; Self::BANDS]) }
    }

    /// The band of boxes within `far_m` of an eye that moves on by at most [`MOST_MOVED`] of that.
    fn band(far_m: f32) -> u16 {
        let farthest_m = far_m * (1.0 + MOST_MOVED);
        (farthest_m.to_bits() >> Self::SHIFT).min(Self::BANDS as u32 - 2) as u16 + 1
    }

    /// What a band's boxes are within, metres.
    fn limit_m(band: u16) -> f32 {
        f32::from_bits(u32::from(band) << Self::SHIFT)
    }

    /// Adds a frame in which eyes moved by `moved_m` and planes turned by `turned`, radians.
    fn add(&mut self, moved_m: f64, turned: f64) {
        // Rounding, and the slack of the tests, which grows with the distance.
        const MORE: f64 = 1.0 + 1.0 / 65_536.0;
        for (metres, band) in self.metres.iter_mut().zip(0..) {
            *metres += (moved_m + turned * f64::from(Self::limit_m(band))) * MORE;
        }
    }

    /// So far, rounded up.
    fn so_far(&self, band: u16) -> f32 {
        let metres = self.metres[usize::from(band)] as f32;
        metres.next_up()
    }

    /// The travel in `band` at which `margin_m` is used up, rounded down.
    fn after(&self, band: u16, margin_m: f32) -> f32 {
        ((self.metres[usize::from(band)] + f64::from(margin_m)) as f32).next_down()
    }
}

/// A lattice's answers, kept from frame to frame.
pub(super) struct Slack {
    kept: Vec<Kept>,
    round: u32,
    /// Whether the answers of this round belong to the last frame.
    is_current: bool,
    travel: Travel,
    frames_in_round: u32,
    /// The lattice as it was in the last frame.
    before: Option<Lattice>,
    /// The last frame's sets.
    sets: Vec<VisibleSet>,
    edits: Vec<Edits>,
    stack: Vec<Step>,
    planes: LanePlanes,
    full_visits: u64,
    /// Movement that was too fast to keep up with, and frames since.
    too_fast: Option<(f64, f64, u32)>,
}

/// What one view gains and loses.
#[derive(Default)]
struct Edits {
    removed: VisibleSet,
    added: VisibleSet,
}

/// A round ends after so many frames: sums of travel lose digits.
const MAX_FRAMES_IN_ROUND: u32 = 1 << 14;
/// After this many frames, movement that was too fast is tried again.
const RETRY_AFTER: u32 = 120;

impl Slack {
    pub(super) fn new() -> Self {
        Self {
            kept: Vec::new(),
            round: 0,
            is_current: false,
            travel: Travel::none(),
            frames_in_round: 0,
            before: None,
            sets: Vec::new(),
            edits: Vec::new(),
            stack: Vec::new(),
            planes: LanePlanes::default(),
            full_visits: 0,
            too_fast: None,
        }
    }

    /// Forgets everything: the tree or the views are others.
    pub(super) fn forget(&mut self) {
        self.is_current = false;
        self.before = None;
        self.too_fast = None;
    }

    /// Finds what each view of a placed lattice may see, or `None` when a full sweep will be faster. `sets` must be empty
    /// where the lattice has views.
    pub(super) fn cull(&mut self, wide: &WideTree, lattice: &Lattice, sets: &mut [VisibleSet]) -> Option<CullStats> {
        let movement = self.before.as_ref().and_then(|before| lattice.movement_since(before));
        match &mut self.before {
            Some(before) => before.clone_from(lattice),
            None => self.before = Some(lattice.clone()),
        }
        let is_countable = lattice.slots().into_iter().all(|slots| slots <= u16::from(u8::MAX));
        let Some((moved_m, turned)) = movement.filter(|_| is_countable) else {
            self.is_current = false;
            return None;
        };
        if let Some((too_far_m, too_much, frames)) = &mut self.too_fast {
            *frames += 1;
            if *frames < RETRY_AFTER && (moved_m * 2.0 > *too_far_m || turned * 2.0 > *too_much) {
                self.is_current = false;
                return None;
            }
            self.too_fast = None;
        }
        self.travel.add(moved_m, turned);
        self.frames_in_round += 1;
        let is_fresh = !self.is_current || self.frames_in_round > MAX_FRAMES_IN_ROUND;
        if is_fresh {
            self.start_round(wide, sets.len());
        }
        self.planes.set(lattice, wide.origin());
        let stats = super::lanes::run_on_best(Update { slack: self, wide, lattice, is_fresh });
        self.finish(lattice, sets);
        if is_fresh {
            self.full_visits = stats.nodes_visited;
        } else if stats.nodes_visited * 2 > self.full_visits {
            self.too_fast = Some((moved_m, turned, 0));
        }
        Some(stats)
    }

    fn start_round(&mut self, wide: &WideTree, views: usize) {
        self.is_current = true;
        self.round = self.round.wrapping_add(1).max(1);
        self.travel.metres.fill(0.0);
        self.frames_in_round = 0;
        self.kept.resize(wide.nodes().len(), Kept::default());
        self.sets.resize_with(views, VisibleSet::default);
        self.edits.resize_with(views, Edits::default);
        self.sets.iter_mut().for_each(VisibleSet::clear);
    }

    /// Makes this frame's sets of the last frame's.
    fn finish(&mut self, lattice: &Lattice, sets: &mut [VisibleSet]) {
        for view in lattice.views().iter().map(|view| usize::from(*view)) {
            let (kept, Edits { removed, added }) = (&mut self.sets[view], &mut self.edits[view]);
            if removed.is_empty() && added.is_empty() {
                sets[view].clone_from(kept);
                continue;
            }
            removed.normalize();
            added.normalize();
            kept.patch_into(removed, added, &mut sets[view]);
            kept.clone_from(&sets[view]);
            removed.clear();
            added.clear();
        }
    }
}

/// What remains to be done.
#[derive(Clone, Copy)]
enum Step {
    /// Brings a node up to date. Its parent has it in a lane; nothing of a fresh one is in the sets.
    Enter { visit: Visit, parent: u32, lane: u8, is_fresh: bool },
    /// Tells its parent how long it holds.
    Leave { node: u32, parent: u32, lane: u8 },
}

/// No parent.
const ROOT: u32 = u32::MAX;

/// One frame's update.
struct Update<'a> {
    slack: &'a mut Slack,
    wide: &'a WideTree,
    lattice: &'a Lattice,
    is_fresh: bool,
}

impl Kernel for Update<'_> {
    type Output = CullStats;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> CullStats {
        let Self { slack, wide, lattice, is_fresh } = self;
        let Slack { kept: all_kept, round, travel, edits, stack, planes, .. } = slack;
        let mut stats = CullStats::default();
        let offset = wide.origin() - lattice.eye();
        stack.clear();
        stack.push(Step::Enter { visit: Visit::all(wide, lattice), parent: ROOT, lane: 0, is_fresh });
        while let Some(step) = stack.pop() {
            let (visit, parent, lane, is_fresh) = match step {
                Step::Enter { visit, parent, lane, is_fresh } => (visit, parent, lane, is_fresh),
                Step::Leave { node, parent, lane } => {
                    if parent != ROOT {
                        let holds_m = holds_for(&all_kept[node as usize], travel);
                        let child_band = all_kept[node as usize].band;
                        let parent = &mut all_kept[parent as usize];
                        // In the parent's band planes move at least as fast, but where rounding put the child further away.
                        let stretch = (Travel::limit_m(parent.band) / Travel::limit_m(child_band)).min(1.0);
                        parent.below[usize::from(lane)] = travel.after(parent.band, (holds_m * stretch).next_down());
                    }
                    continue;
                }
            };
            let id = visit.node as usize;
            let node = &wide.nodes()[id];
            let kept = &mut all_kept[id];
            let is_known = !is_fresh && kept.round == *round;
            let so_far = travel.so_far(kept.band);
            stack.push(Step::Leave { node: visit.node, parent, lane });
            let is_same_question = is_known && kept.slots == visit.slots && kept.mask == visit.mask;
            if is_same_question && kept.own.iter().all(|own| *own > so_far) {
                let mut alive = kept.found.alive;
                while alive != 0 {
                    let lane = alive.trailing_zeros() as usize;
                    alive &= alive - 1;
                    if kept.below[lane] > so_far {
                        continue;
                    }
                    if let State::Open(slots, mask) = kept.found.kept_state(lane, visit.slots, node) {
                        let leaves = node.leaves(lane, visit.leaves.end);
                        let visit = Visit { node: node.child[lane], leaves, slots, mask };
                        stack.push(Step::Enter { visit, parent: id as u32, lane: lane as u8, is_fresh: false });
                    }
                }
                continue;
            }

            let boxes = Boxes::of(lanes, node, offset, planes);
            let far_m = boxes.far_m();
            let mut margins =
                LeastMargins { least: lanes.splat(far_m), last: lanes.splat(0.0), of_lane: [0.0; LANES], unseen: 0 };
            let mut found = boxes.classify(lanes, visit.slots, visit.mask, planes, &mut margins, &mut stats);
            let mut of_lane = margins.finish(lanes, found.alive, far_m * MOST_MOVED);
            let looked = Looked { node, axes: &wide.axes()[id], boxes: &boxes, lattice, planes };
            let (was, was_slots) = (kept.found, kept.slots);
            let band = Travel::band(far_m);
            let slots = visit.slots;
            for (lane, margin_m) in of_lane.iter_mut().enumerate() {
                let leaves = node.leaves(lane, visit.leaves.end);
                kept.below[lane] = f32::INFINITY;
                if leaves.is_empty() {
                    *margin_m = f32::INFINITY; // an unused lane
                    continue;
                }
                let mut leaf_margin = LeafMargin { least_m: f32::INFINITY };
                let bit = 1 << lane;
                let old = if is_known { was.kept_state(lane, was_slots, node) } else { State::Unseen };
                let new = if found.alive & bit != 0 {
                    found.state(lanes, lane, slots, &looked, &mut leaf_margin, &mut stats)
                } else {
                    State::Unseen
                };
                *margin_m = margin_m.min(leaf_margin.least_m);
                found.keep(lane, slots, &new);
                if old != new {
                    let opens = |state: &State| matches!(state, State::Open(..));
                    if !(opens(&old) && opens(&new)) {
                        change(edits, lattice, leaves, &old, &new);
                    }
                }
                if let State::Open(slots, mask) = new {
                    let is_fresh = !matches!(old, State::Open(..));
                    let visit = Visit { node: node.child[lane], leaves, slots, mask };
                    lanes.prefetch(&wide.nodes()[visit.node as usize]);
                    stack.push(Step::Enter { visit, parent: id as u32, lane: lane as u8, is_fresh });
                }
            }
            kept.own = of_lane.map(|margin_m| travel.after(band, margin_m));
            kept.found = found;
            kept.slots = slots;
            kept.mask = visit.mask;
            kept.band = band;
            kept.round = *round;
        }
        stats
    }
}

/// How far planes may move until a node's answers, or those below, may change.
fn holds_for(kept: &Kept, travel: &Travel) -> f32 {
    let least = kept.own.iter().chain(&kept.below).fold(f32::INFINITY, |least, at| least.min(*at));
    (least - travel.so_far(kept.band)).next_down().max(0.0)
}

/// Notes for all views what it means that leaves stand otherwise than they did. What is open is in the sets below.
fn change(edits: &mut [Edits], lattice: &Lattice, leaves: LeafRange, old: &State, new: &State) {
    let gone = match old {
        State::Unseen => [0; 4],
        State::Seen(slots) | State::Open(slots, _) => lattice.cells(*slots),
    };
    let come = if let State::Seen(slots) = new { lattice.cells(*slots) } else { [0; 4] };
    let has =
        |cells: &[u16; 4], column: u16, row: u16| (cells[0]..cells[1]).contains(&column) && (cells[2]..cells[3]).contains(&row);
    // Leaves of an open node may be in any of its cells or in none.
    let was_whole = matches!(old, State::Seen(_));
    for_each_cell(&gone, |column, row| {
        if !(was_whole && has(&come, column, row)) {
            edits[usize::from(lattice.row(row, column..column + 1)[0])].removed.push_unordered(leaves);
        }
    });
    for_each_cell(&come, |column, row| {
        if !(was_whole && has(&gone, column, row)) {
            edits[usize::from(lattice.row(row, column..column + 1)[0])].added.push_unordered(leaves);
        }
    });
}

fn for_each_cell([left, right, bottom, top]: &[u16; 4], mut each: impl FnMut(u16, u16)) {
    for row in *bottom..*top {
        for column in *left..*right {
            each(column, row);
        }
    }
}

/// The least margin of each lane.
struct LeastMargins<L: Lanes> {
    least: L::Wide,
    last: L::Wide,
    /// Of lanes left unseen by one plane alone, the greatest margin of such a plane.
    of_lane: [f32; LANES],
    unseen: u8,
}

impl<L: Lanes> LeastMargins<L> {
    /// The margins, of lanes that are not `alive` those of the plane that decided.
    #[inline(always)]
    fn finish(self, lanes: L, alive: u8, most_m: f32) -> [f32; LANES] {
        let mut of_lane = lanes.to_array(self.least);
        for (lane, margin_m) in of_lane.iter_mut().enumerate() {
            if alive & (1 << lane) == 0 && self.unseen & (1 << lane) != 0 {
                *margin_m = self.of_lane[lane];
            }
            // Not a number where the scene is too large for one.
            *margin_m = if most_m.is_finite() { margin_m.clamp(0.0, most_m) } else { 0.0 };
        }
        of_lane
    }
}

impl<L: Lanes> Margins<L> for LeastMargins<L> {
    #[inline(always)]
    fn tested(&mut self, lanes: L, high: L::Wide, low: L::Wide, slack_m: f32) {
        let slack = lanes.splat(slack_m);
        let margin = lanes.min(lanes.abs(lanes.add(high, slack)), lanes.abs(lanes.sub(low, slack)));
        // Both this test and the one that it spares round, by less than the slack.
        self.last = lanes.sub(margin, lanes.splat(2.0 * slack_m));
        self.least = lanes.min(self.least, self.last);
    }

    #[inline(always)]
    fn decided(&mut self, lanes: L, unseen: u8) {
        if unseen == 0 {
            return;
        }
        let last = lanes.to_array(self.last);
        for (lane, (least, last)) in self.of_lane.iter_mut().zip(last).enumerate() {
            if unseen & (1 << lane) != 0 {
                *least = least.max(last);
            }
        }
        self.unseen |= unseen;
    }

    #[inline(always)]
    fn tested_leaf(&mut self, _: f32, _: f32, _: f32) {}
}

/// The least margin of a leaf's oriented box.
struct LeafMargin {
    least_m: f32,
}

impl<L: Lanes> Margins<L> for LeafMargin {
    #[inline(always)]
    fn tested(&mut self, _: L, _: L::Wide, _: L::Wide, _: f32) {}

    #[inline(always)]
    fn decided(&mut self, _: L, _: u8) {}

    #[inline(always)]
    fn tested_leaf(&mut self, high_m: f32, low_m: f32, slack_m: f32) {
        let margin_m = (high_m + slack_m).abs().min((low_m - slack_m).abs()) - 2.0 * slack_m;
        self.least_m = self.least_m.min(margin_m.max(0.0));
    }
}
