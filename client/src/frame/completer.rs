//! The rounds that complete an estimate: what they draw hides what is asked for next. Of one view at a time.

use mullion_common::scene::Tessellation;
use mullion_common::visible_set::LeafRange;

use super::{Bound, FrameInput, FramePlan, PassPlan, PassResults, Planner, ViewInput};
use crate::plp::{Completion, Estimate, Frame, Traversal};

/// Most boxes of a round: they fit any GPU's buffers. Cells beyond count as seen.
const MAX_ASKED: usize = 1 << 18;

/// Plans them. Keeps its memory from frame to frame.
///
/// They draw the same triangles as the exact picture, but round by round: that picture itself is drawn afterwards, in order, with
/// [`Completer::estimate`].
#[derive(Debug, Default)]
pub struct Completer {
    completion: Completion,
    planner: Planner,
    plan: FramePlan,
}

impl Completer {
    /// The first round: the estimate that a traversal has found, and what is asked for beyond. `frame` is as the view sees it.
    pub fn begin(
        &mut self,
        input: &FrameInput<'_>,
        view: &ViewInput<'_>,
        frame: &Frame<'_>,
        traversal: &Traversal,
    ) -> &FramePlan {
        self.completion.begin(frame, traversal);
        self.planner.spare_passes.append(&mut self.plan.passes);
        let view = ViewInput { estimate: Some(self.completion.estimate(frame.tessellation)), ..*view };
        let mut pass = self.planner.plan_pass(input, &view);
        pass.first = None;
        pass.blended.clear();
        self.ask(&mut pass, frame);
        self.plan.passes.push(pass);
        &self.plan
    }

    /// Takes what came of a round and gives the next; `None`: all that is seen has been found. `view` is that of the first.
    pub fn feed(&mut self, view: &ViewInput<'_>, frame: &Frame<'_>, results: &PassResults) -> Option<&FramePlan> {
        let seen = results.passes.first().map_or(&[][..], |pass| &pass.bounds_seen);
        if !self.completion.take(frame, seen) {
            return None;
        }
        let mut pass = self.plan.passes.pop()?;
        pass.round += 1;
        pass.opaque.clear();
        pass.parts.clear();
        pass.cuts.clear();
        pass.boxes.clear();
        for (place, own) in self.completion.added() {
            let leaf = frame.tessellation.leaves()[place as usize];
            if !view.visible.contains(leaf) || view.missing.contains(leaf) {
                // The picture lacks it, too: it hides nothing.
                continue;
            }
            let first = frame.tessellation.slots(place).start;
            pass.opaque.push(LeafRange::new(leaf, leaf + 1));
            pass.parts.push(leaf, own.iter().map(|(_, slot)| (slot - first) as u16));
        }
        self.ask(&mut pass, frame);
        self.plan.passes.push(pass);
        Some(&self.plan)
    }

    /// Once there is no further round: all that the view sees, and more.
    pub fn estimate<'a>(&'a self, tessellation: &'a Tessellation) -> Estimate<'a> {
        self.completion.estimate(tessellation)
    }

    fn ask(&self, pass: &mut PassPlan, frame: &Frame<'_>) {
        pass.bounds.clear();
        pass.bounds.extend(self.completion.bounds(frame.tessellation).take(MAX_ASKED).map(Bound::World));
    }
}
