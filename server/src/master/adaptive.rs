//! What hardly contributes to the picture of the wall, and so is drawn on none of its tiles: equation 1 (Bartz, Meißner, Hüttner 1999,
//! section 4.3), decided for each object once, of what all tiles count.
//!
//! ```text
//! Counted → counts by object and view … begin_frame → decide → what is dropped in that frame, the same for all nodes
//! ```
//! An estimate, apart from all visible sets. An object is dropped when every view that sees it has a count of its box that still holds, and in
//! no eye's picture of the wall the sum reaches the threshold. Nothing is dropped for want of a count: what a node leaves out, or a node that
//! is gone, leaves objects drawn that its views see. A node that claims too much does the same, one that claims too little takes from an
//! object what its own tiles show of it. A frame costs a bounded number of looks, whatever nodes say.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::DVec3;
use mullion_common::contribution::{ViewPlane, contribution};
use mullion_common::scene::ObjectId;
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{View, ViewId, Wall};
use mullion_common::wire::{Counted, MAX_COUNTED, MAX_DROPPED_RANGES};

use super::object_leaves::ObjectLeaves;

/// Each view counts some objects every so many frames.
pub const COUNT_EVERY: u32 = 4;
/// Frames for which a count holds.
pub const COUNT_HOLDS_FRAMES: u64 = 256;
/// Frames for which what is dropped may come into a further view before that one has counted it.
pub const ENTERING_FRAMES: u64 = 32;
/// Share of the threshold below which an object is dropped. It is drawn again where it reaches the threshold, and does not flicker between.
pub const DROPS_BELOW: f64 = 0.75;
/// Most objects that are dropped: as many as each view can count again before a count of theirs holds no more.
pub const MAX_DROPPED_OBJECTS: usize = 8192;
/// Most ranges of leaves that an object may have to be dropped.
const MAX_RANGES_OF_OBJECT: usize = 64;
/// Most objects of which a view's counts are kept: all that it can count while they hold.
const MAX_COUNTED_OF_VIEW: u32 = 16384;
/// How often a frame looks whether a view sees an object.
const MAX_LOOKS: usize = 1 << 14;
/// Objects whose old counts a frame throws away.
const SWEPT_PER_FRAME: usize = 1024;

const ROUNDS: usize = COUNT_HOLDS_FRAMES as usize / COUNT_EVERY as usize;
const _: () = assert!(ROUNDS * MAX_COUNTED == MAX_COUNTED_OF_VIEW as usize, "no honest count is thrown away");
const _: () = assert!(ROUNDS / 2 * MAX_COUNTED >= MAX_DROPPED_OBJECTS, "half of what a view counts is for what is dropped");
const _: () = assert!(MAX_RANGES_OF_OBJECT < MAX_DROPPED_RANGES);

/// How objects that hardly contribute are left out.
#[derive(Clone, Debug)]
pub struct Adaptive {
    /// Share of the wall's pixels, weighted by distance: see [`contribution`]. More than 0, at most 1.
    pub threshold: f64,
    /// The scene's.
    pub objects: Arc<ObjectLeaves>,
}

/// Where a count comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Node,
    /// The box came into view, and nothing of it can have been there.
    Entering,
}

/// What is known of an object in a view.
#[derive(Clone, Copy, Debug)]
struct Count {
    view: ViewId,
    source: Source,
    visible_px: u32,
    distance_m: f32,
    frame: u64,
}

impl Count {
    /// `since`: when the view's node came.
    fn holds(&self, since: u64, number: u64) -> bool {
        let frames = match self.source {
            Source::Node => COUNT_HOLDS_FRAMES,
            Source::Entering => ENTERING_FRAMES,
        };
        self.frame >= since && number.saturating_sub(self.frame) <= frames
    }
}

/// What is known of an object.
#[derive(Clone, Debug)]
struct Tally {
    /// At most one a view.
    counts: Vec<Count>,
    /// Its place in the list of what is dropped.
    place: Option<u32>,
    is_asked: bool,
}

const UNKNOWN: Tally = Tally { counts: Vec::new(), place: None, is_asked: false };

/// What is known of a view.
#[derive(Debug)]
struct ViewState {
    pixels: u32,
    /// Which eye's picture it is part of.
    picture: usize,
    /// A point of its tile, and the tile's normal, room space.
    tile: (DVec3, DVec3),
    /// The wall before its eye.
    plane: ViewPlane,
    /// The first frame that its node may have drawn; none is there before one comes.
    since: u64,
    /// The frame that was the newest when it was last heard.
    heard: Option<u64>,
    /// Its counts that are kept.
    held: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Draw,
    Drop,
}

/// What tiles count, and what is dropped for it.
#[derive(Debug)]
pub(super) struct Contributions {
    adaptive: Adaptive,
    views: Vec<ViewState>,
    near_m: f64,
    /// By object.
    tallies: Vec<Tally>,
    /// Objects of which something new is known, each once.
    asked: VecDeque<ObjectId>,
    dropped: Vec<ObjectId>,
    /// Ranges of their leaves.
    dropped_ranges: usize,
    /// Which of them is looked at next.
    turn: usize,
    /// Which object's old counts are thrown away next.
    swept: usize,
    /// Views whose counts were of a node that is gone.
    voided: Vec<usize>,
    set: VisibleSet,
    removed: VisibleSet,
    added: VisibleSet,
    scratch: VisibleSet,
    /// An object's contribution to each picture.
    sums: Vec<f64>,
}

impl Contributions {
    pub fn new(wall: &Wall, adaptive: Adaptive) -> Self {
        let (mut pictures, mut pixels) = (Vec::new(), Vec::new());
        let of_view = |view: &View| {
            let tile = wall.tile(view.tile);
            let of_tile = tile.size_px.map(u64::from).iter().product::<u64>();
            let eye = (view.observer, view.eye);
            let picture = pictures.iter().position(|known| *known == eye).unwrap_or_else(|| {
                pictures.push(eye);
                pixels.push(0);
                pictures.len() - 1
            });
            pixels[picture] += of_tile;
            let [corner, right, top] = tile.corners;
            ViewState {
                pixels: u32::try_from(of_tile).unwrap_or(u32::MAX),
                picture,
                tile: (corner, (right - corner).cross(top - corner).normalize()),
                plane: ViewPlane { pixels: 1, eye_m: 1.0 },
                since: u64::MAX,
                heard: None,
                held: 0,
            }
        };
        let mut views: Vec<ViewState> = wall.views().iter().map(of_view).collect();
        views.iter_mut().for_each(|view| view.plane.pixels = pixels[view.picture]);
        Self {
            tallies: vec![UNKNOWN; adaptive.objects.len()],
            adaptive,
            views,
            near_m: wall.near_m(),
            asked: VecDeque::new(),
            dropped: Vec::new(),
            dropped_ranges: 0,
            turn: 0,
            swept: 0,
            voided: Vec::new(),
            set: VisibleSet::default(),
            removed: VisibleSet::default(),
            added: VisibleSet::default(),
            scratch: VisibleSet::default(),
            sums: vec![0.0; pixels.len()],
        }
    }

    /// The scene has more objects behind those that it had.
    pub fn grow(&mut self, objects: Arc<ObjectLeaves>) {
        self.tallies.resize(objects.len().max(self.tallies.len()), UNKNOWN);
        self.adaptive.objects = objects;
    }

    /// A node has come, whose first frame is `next`.
    pub fn join(&mut self, views: &[ViewId], next: u64) {
        views.iter().for_each(|view| self.views[usize::from(view.0)].since = next);
    }

    /// A node is gone, and what it counted says no more.
    pub fn leave(&mut self, views: &[ViewId]) {
        for view in views.iter().map(|view| usize::from(view.0)) {
            self.views[view].since = u64::MAX;
            if !self.voided.contains(&view) {
                self.voided.push(view);
            }
        }
    }

    /// Takes what a node counted in one of its views: once a view and frame. Objects that are unknown are left aside, and nothing counts for
    /// more than its tile.
    pub fn take(&mut self, counted: &Counted, newest: u64) {
        let state = &mut self.views[usize::from(counted.view.0)];
        if state.heard.replace(newest) == Some(newest) {
            return;
        }
        for count in &counted.objects {
            let Some(tally) = self.tallies.get_mut(count.object.0 as usize) else { return }; // ascending: the others are unknown, too
            let visible_px = count.visible_px.min(state.pixels);
            let (view, distance_m, frame) = (counted.view, count.distance_m, counted.frame);
            let news = Count { view, source: Source::Node, visible_px, distance_m, frame };
            match tally.counts.iter_mut().find(|known| known.view == view) {
                Some(known) if known.source == Source::Node && known.frame > frame => continue,
                Some(known) => *known = news,
                None if state.held < MAX_COUNTED_OF_VIEW => {
                    tally.counts.push(news);
                    state.held += 1;
                }
                None => continue,
            }
            let alone = state.contribution(&news);
            let is_of_interest = tally.place.is_some() || alone < self.adaptive.threshold * DROPS_BELOW;
            if is_of_interest && !std::mem::replace(&mut tally.is_asked, true) {
                self.asked.push_back(count.object);
            }
        }
    }

    /// Decides what is dropped in a frame. `eyes` and `sets` by view.
    pub fn decide(&mut self, number: u64, eyes: &[DVec3], sets: &[VisibleSet]) {
        for (state, eye) in self.views.iter_mut().zip(eyes) {
            let (point, normal) = state.tile;
            state.plane.eye_m = (*eye - point).dot(normal).abs().max(self.near_m);
        }
        self.removed.clear();
        self.added.clear();
        self.let_go_of_voided(sets);
        let each = (MAX_LOOKS / self.views.len().max(1) / 2).max(1);
        for _ in 0..each {
            let Some(object) = self.asked.pop_front() else { break };
            self.tallies[object.0 as usize].is_asked = false;
            let verdict = self.examine(object, number, sets);
            self.note(object, verdict);
        }
        for _ in 0..each.min(self.dropped.len()) {
            self.turn = if self.turn < self.dropped.len() { self.turn } else { 0 };
            let Some(object) = self.dropped.get(self.turn).copied() else { break };
            let verdict = self.examine(object, number, sets);
            self.note(object, verdict);
            self.turn += usize::from(verdict == Verdict::Drop); // else another one has its place now
        }
        self.sweep(number);
        if !self.removed.is_empty() || !self.added.is_empty() {
            self.removed.normalize();
            self.added.normalize();
            self.set.patch_into(&self.removed, &self.added, &mut self.scratch);
            std::mem::swap(&mut self.set, &mut self.scratch);
        }
    }

    /// Leaves that are dropped in the frame that was decided last.
    pub fn dropped(&self) -> &VisibleSet {
        &self.set
    }

    /// How many objects that are.
    pub fn dropped_objects(&self) -> u32 {
        self.dropped.len() as u32
    }

    /// Draws all that is seen by views whose node is gone, or is another now.
    fn let_go_of_voided(&mut self, sets: &[VisibleSet]) {
        if self.voided.is_empty() {
            return;
        }
        for at in (0..self.dropped.len()).rev() {
            let object = self.dropped[at];
            let ranges = self.adaptive.objects.ranges(object);
            if self.voided.iter().any(|view| meets(&sets[*view], ranges)) {
                self.note(object, Verdict::Draw);
            }
        }
        self.voided.clear();
    }

    /// Whether an object hardly contributes, by what is known of it.
    fn examine(&mut self, object: ObjectId, number: u64, sets: &[VisibleSet]) -> Verdict {
        let (ranges, tally) = (self.adaptive.objects.ranges(object), &mut self.tallies[object.0 as usize]);
        if ranges.is_empty() || ranges.len() > MAX_RANGES_OF_OBJECT {
            return Verdict::Draw;
        }
        let is_dropped = tally.place.is_some();
        let mut is_seen = false;
        self.sums.fill(0.0);
        for (at, (set, state)) in sets.iter().zip(&mut self.views).enumerate() {
            let view = ViewId(at as u16);
            let known = tally.counts.iter().position(|count| count.view == view);
            if !meets(set, ranges) {
                if let Some(known) = known {
                    tally.counts.swap_remove(known); // should it come back, it comes from the edge again
                    state.held -= 1;
                }
                continue;
            }
            is_seen = true;
            let known = match known {
                Some(known) => known,
                None if is_dropped && state.held < MAX_COUNTED_OF_VIEW => {
                    state.held += 1;
                    let source = Source::Entering;
                    tally.counts.push(Count { view, source, visible_px: 0, distance_m: 0.0, frame: number });
                    tally.counts.len() - 1
                }
                None => return Verdict::Draw,
            };
            let count = tally.counts[known];
            if !count.holds(state.since, number) {
                return Verdict::Draw;
            }
            self.sums[state.picture] += state.contribution(&count);
        }
        let threshold = self.adaptive.threshold * if is_dropped { 1.0 } else { DROPS_BELOW };
        let hardly_contributes = self.sums.iter().all(|sum| *sum < threshold);
        if is_seen && hardly_contributes { Verdict::Drop } else { Verdict::Draw }
    }

    /// Drops an object, or draws it again, where that is news and there is room.
    fn note(&mut self, object: ObjectId, verdict: Verdict) {
        let ranges = self.adaptive.objects.ranges(object);
        let tally = &mut self.tallies[object.0 as usize];
        match (verdict, tally.place) {
            (Verdict::Drop, None) => {
                if self.dropped.len() < MAX_DROPPED_OBJECTS && self.dropped_ranges + ranges.len() <= MAX_DROPPED_RANGES {
                    tally.place = Some(self.dropped.len() as u32);
                    self.dropped.push(object);
                    self.dropped_ranges += ranges.len();
                    ranges.iter().for_each(|range| self.added.push_unordered(*range));
                }
            }
            (Verdict::Draw, Some(place)) => {
                tally.place = None;
                self.dropped.swap_remove(place as usize);
                if let Some(moved) = self.dropped.get(place as usize) {
                    self.tallies[moved.0 as usize].place = Some(place);
                }
                self.dropped_ranges -= ranges.len();
                ranges.iter().for_each(|range| self.removed.push_unordered(*range));
            }
            (Verdict::Drop, Some(_)) | (Verdict::Draw, None) => {}
        }
    }

    /// Throws away some counts that hold no more. Those of what is dropped stay until it is looked at: they say that its view is not new.
    fn sweep(&mut self, number: u64) {
        for _ in 0..SWEPT_PER_FRAME.min(self.tallies.len()) {
            self.swept = if self.swept < self.tallies.len() { self.swept } else { 0 };
            let (tally, views) = (&mut self.tallies[self.swept], &mut self.views);
            if tally.place.is_none() {
                tally.counts.retain(|count| {
                    let state = &mut views[usize::from(count.view.0)];
                    let holds = count.holds(state.since, number);
                    state.held -= u32::from(!holds);
                    holds
                });
            }
            self.swept += 1;
        }
    }
}

impl ViewState {
    fn contribution(&self, count: &Count) -> f64 {
        contribution(count.visible_px, &self.plane, f64::from(count.distance_m) - self.plane.eye_m)
    }
}

/// Whether a set has a leaf of these ranges.
fn meets(set: &VisibleSet, ranges: &[LeafRange]) -> bool {
    let seen = set.ranges();
    ranges.iter().any(|range| {
        let first = seen.partition_point(|seen| seen.end <= range.start);
        seen.get(first).is_some_and(|seen| seen.start < range.end)
    })
}
