//! A view that is drawn in two turns: what was seen in the last frame, and what of the rest is seen beyond it.

use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::BoxTest;
use super::groups::{Groups, Standing};
use super::worth::{Outcome, Worth};
use crate::frame::{FrameInput, PassPlan, PassResult, Times};

/// Leaves whose boxes say too little of them: those were seen, but no pixel of the leaves.
#[derive(Debug, Default)]
struct Coarse {
    leaves: VisibleSet,
    turn: u32,
    /// What is left of them and of those that were drawn without a pixel.
    left: VisibleSet,
}

impl Coarse {
    /// One in so many is tested by its box again, frame by frame: that may be enough by now.
    const PERIOD: u32 = 32;

    /// Takes what was drawn, at once and late, and of what there was a pixel.
    fn note(&mut self, first: Option<&VisibleSet>, late: &VisibleSet, seen: &VisibleSet) {
        self.turn = (self.turn + 1) % Self::PERIOD;
        let drawn = first.into_iter().chain([late]).flat_map(VisibleSet::ranges);
        drawn.for_each(|range| self.leaves.push_unordered(*range));
        self.leaves.normalize();
        self.leaves.difference_into(seen, &mut self.left);
        self.leaves.clear();
        let kept = self.left.leaves().filter(|leaf| leaf % Self::PERIOD != self.turn);
        kept.for_each(|leaf| self.leaves.push(LeafRange::new(leaf, leaf + 1)));
    }
}

/// What is known of such a view.
#[derive(Debug, Default)]
pub struct InTurns {
    /// In the last frame, where that is known.
    seen: Option<VisibleSet>,
    /// What was seen, and what is likely to be.
    likely: VisibleSet,
    coarse: Coarse,
    groups: Groups,
    so_far: SoFar,
    /// None: it is always on.
    worth: Option<Worth>,
}

/// What there is of a frame so far.
#[derive(Debug, Default)]
struct SoFar {
    /// Sleeping leaves that might be seen: of them there is a further pass.
    woken: VisibleSet,
    /// Leaves that were seen before that.
    seen: VisibleSet,
    spare: VisibleSet,
    passes: u32,
    drawn_triangles: u64,
    all_triangles: u64,
    times: Times,
}

impl InTurns {
    /// Of a view of which nothing is known. `worth`: judges whether it is left off for a while.
    pub fn new(worth: Option<Worth>) -> Self {
        Self { worth, ..Self::default() }
    }

    /// Turns a pass that draws all into one that begins with less. `occluders`: what it begins with beside what was seen. `first`: memory.
    pub fn begin(&mut self, input: &FrameInput<'_>, occluders: Option<&VisibleSet>, mut first: VisibleSet, pass: &mut PassPlan) {
        let Self { seen, likely, coarse, groups, so_far, worth } = self;
        if let Some(worth) = worth
            && !worth.is_on()
        {
            *seen = None;
            coarse.leaves.clear();
            groups.clear();
            pass.is_timed = worth.is_measured();
            return;
        }
        match (seen, occluders) {
            (Some(seen), Some(occluders)) => {
                seen.union_into(occluders, likely);
                pass.opaque.intersection_into(likely, &mut first);
            }
            (Some(known), None) => pass.opaque.intersection_into(known, &mut first),
            (None, Some(likely)) => pass.opaque.intersection_into(likely, &mut first),
            // All at once in the first frame: what they hide is known in the next.
            (None, None) => first.clone_from(&pass.opaque),
        }
        let records = &input.manifest.leaves;
        let standing = Standing { records, transforms: input.transforms, eye: pass.projection.eye };
        groups.begin(standing, &mut pass.opaque, &first, &mut pass.bounds);
        so_far.begin(groups.triangles(records));
        pass.in_pieces.clone_from(&coarse.leaves);
        (pass.first, pass.test) = (Some(first), BoxTest::Sifted);
    }

    /// Takes what came of a pass. Whether there is another, which it then is.
    pub fn go_on(&mut self, result: &PassResult, pass: &mut PassPlan) -> bool {
        let Self { seen, coarse, groups, so_far, worth, .. } = self;
        so_far.note(result);
        if pass.first.is_some() {
            groups.note(&result.bounds_seen, &mut so_far.woken);
            if !so_far.woken.is_empty() {
                so_far.go_on(result, pass);
                return true;
            }
        }
        if let Some(now) = &result.seen {
            coarse.note(pass.first.as_ref(), &result.late, now);
            so_far.seen.union_into(now, seen.get_or_insert_default());
            if let Some(worth) = worth {
                let SoFar { drawn_triangles, all_triangles, times, .. } = *so_far;
                worth.note(Outcome { drawn: drawn_triangles, all: all_triangles, times: result.times.map(|_| times) });
            }
        } else if let (Some(worth), Some(times)) = (worth, result.times) {
            worth.note_without(result.triangles, times);
        }
        false
    }
}

impl SoFar {
    fn begin(&mut self, asleep_triangles: u64) {
        self.seen.clear();
        (self.passes, self.drawn_triangles, self.all_triangles, self.times) = (0, 0, asleep_triangles, Times::default());
    }

    fn note(&mut self, result: &PassResult) {
        if self.passes == 0 {
            self.all_triangles += result.triangles + result.hidden_triangles;
        }
        self.passes += 1;
        self.drawn_triangles += result.triangles;
        self.times += result.times.unwrap_or_default();
    }

    /// Makes a pass one that draws what is woken beyond what is there, as far as that is seen. Leaves come before boxes and what is
    /// blended: where there is any of that, what was drawn is drawn once more.
    fn go_on(&mut self, result: &PassResult, pass: &mut PassPlan) {
        let first = pass.first.get_or_insert_default();
        pass.bounds.clear();
        match &result.seen {
            Some(seen) if pass.blended.is_empty() && pass.boxes.is_empty() => {
                self.seen.clone_from(seen);
                pass.round += 1;
                first.clear();
                pass.opaque.clone_from(&self.woken);
                pass.cuts.clear();
            }
            Some(_) => {
                first.union_into(&result.late, &mut self.spare);
                self.spare.intersection_into(&pass.opaque, first);
                first.union_into(&self.woken, &mut pass.opaque);
                pass.blended.retain(|leaf| result.late.contains(*leaf));
            }
            // Nothing was tested: all that was listed was drawn.
            None => {
                first.clone_from(&pass.opaque);
                first.union_into(&self.woken, &mut pass.opaque);
            }
        }
    }
}
