//! A view's culling, from frame to frame and round to round.

use glam::DAffine3;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{Projection, ViewId};

use super::rounds::{Order, Round, Rounds, Subject};
use super::turns::InTurns;
use super::unit::{Counts, Footprint, contribution, contribution_as_printed};
use super::worth::{Budget, Worth};
use super::{Adaptive, BoxTest, Occlusion};
use crate::frame::{FrameInput, PassPlan, PassResult, Times};

/// While something moves, one of so many spans of a bound is looked at (section 4.2).
const SAMPLING: u32 = 10;

/// The culling of one view.
#[derive(Debug)]
pub struct CulledView {
    view: ViewId,
    occlusion: Occlusion,
    last: Option<Look>,
    /// Frames since something last moved.
    still: u32,
    state: State,
}

/// What a picture depends on, but for where objects stand.
#[derive(Debug)]
struct Look {
    projection: Projection,
    opaque: VisibleSet,
    blended: Vec<u32>,
}

#[derive(Debug)]
enum State {
    /// Two turns, and rarely another pass.
    Turns(Box<InTurns>),
    Rounds(Box<InRounds>),
}

#[derive(Debug)]
struct InRounds {
    rounds: Rounds,
    adaptive: Option<Adaptive>,
    /// Of what was asked for, with adaptive culling.
    footprints: Vec<Footprint>,
    is_seen: Vec<bool>,
    budget: Budget,
    times: Option<Times>,
    /// What is drawn after all else.
    blended: Vec<u32>,
    boxes: Vec<u32>,
}

impl CulledView {
    /// Of a view of which nothing is known. `occlusion` must not be [`Occlusion::Off`].
    /// `worth`: judges whether two turns are left off for a while.
    pub fn new(view: ViewId, occlusion: Occlusion, worth: Option<Worth>, adaptive: Option<Adaptive>) -> Self {
        let state = match occlusion {
            Occlusion::Off | Occlusion::Hiz => State::Turns(Box::new(InTurns::new(worth))),
            _ => State::Rounds(Box::new(InRounds {
                rounds: Rounds::default(),
                adaptive,
                footprints: Vec::new(),
                is_seen: Vec::new(),
                budget: Budget::default(),
                times: None,
                blended: Vec::new(),
                boxes: Vec::new(),
            })),
        };
        Self { view, occlusion, last: None, still: 0, state }
    }

    /// Whose it is.
    pub fn view(&self) -> ViewId {
        self.view
    }

    /// Turns a pass that draws all into one that begins with less.
    pub fn begin(&mut self, input: &FrameInput<'_>, pass: &mut PassPlan) {
        if let State::Rounds(_) = self.state {
            self.look(input.has_changed, pass);
        }
        let first = pass.first.take();
        match &mut self.state {
            State::Turns(state) => {
                let of_view = input.views.iter().find(|view| view.view == self.view);
                state.begin(input, of_view.and_then(|view| view.occluders), first.unwrap_or_default(), pass);
            }
            State::Rounds(state) => {
                let subject = Subject {
                    opaque: &pass.opaque,
                    blended: &pass.blended,
                    records: &input.manifest.leaves,
                    transforms: input.transforms,
                    eye: pass.projection.eye,
                    is_still: self.still > 0,
                    in_world: self.occlusion == Occlusion::Adaptive,
                };
                let order = match self.occlusion {
                    Occlusion::Query => Order::Seen,
                    Occlusion::CostAdaptive => Order::Depth { budget_us: state.budget.us() },
                    _ => Order::Depth { budget_us: f64::INFINITY },
                };
                state.times = None;
                state.rounds.begin(order, &subject);
                pass.test = match self.occlusion {
                    Occlusion::Query => BoxTest::Queried,
                    Occlusion::Adaptive => BoxTest::Counted,
                    Occlusion::Sampled => BoxTest::Sampled { every: SAMPLING, phase: self.still % SAMPLING },
                    _ => BoxTest::Drawn,
                };
                std::mem::swap(&mut pass.blended, &mut state.blended);
                std::mem::swap(&mut pass.boxes, &mut state.boxes);
                state.fill(pass);
            }
        }
    }

    /// Takes what came of a round. Whether there is another, which the pass then is.
    pub fn go_on(&mut self, result: &PassResult, pass: &mut PassPlan) -> bool {
        match &mut self.state {
            State::Turns(state) => state.go_on(result, pass),
            State::Rounds(state) => {
                if let Some(times) = result.times {
                    *state.times.get_or_insert_default() += times;
                }
                state.take(result);
                result.seen.as_ref().inspect(|with_pixel| state.rounds.note_pixels(with_pixel));
                let is_next = state.rounds.next(&state.is_seen, result.times);
                if is_next {
                    state.fill(pass);
                } else if let Some(times) = state.times {
                    state.budget.note(times);
                }
                is_next
            }
        }
    }

    /// Notes whether a picture is as the last.
    fn look(&mut self, has_changed: bool, pass: &PassPlan) {
        let is_same = self
            .last
            .as_ref()
            .is_some_and(|last| last.projection == pass.projection && last.opaque == pass.opaque && last.blended == pass.blended);
        self.still = if is_same && !has_changed { self.still.saturating_add(1) } else { 0 };
        if !is_same {
            let last = self.last.get_or_insert_with(|| Look {
                projection: pass.projection,
                opaque: VisibleSet::default(),
                blended: Vec::new(),
            });
            last.projection = pass.projection;
            last.opaque.clone_from(&pass.opaque);
            last.blended.clone_from(&pass.blended);
        }
    }
}

impl InRounds {
    /// Takes whether what was asked for is seen, or contributes enough.
    fn take(&mut self, result: &PassResult) {
        self.is_seen.clear();
        let Some(Adaptive { threshold, as_printed, plane, .. }) = self.adaptive else {
            self.is_seen.extend_from_slice(&result.bounds_seen);
            return;
        };
        let contributes = |(counts, footprint): (&Counts, &Footprint)| {
            let object_m = footprint.distance_m() - plane.eye_m;
            let share = if as_printed {
                contribution_as_printed(counts, &plane, object_m)
            } else {
                contribution(counts.visible, &plane, object_m)
            };
            counts.visible > 0 && share >= threshold
        };
        self.is_seen.extend(result.counts.iter().zip(&self.footprints).map(contributes));
    }

    /// Makes a pass the round that is next.
    fn fill(&mut self, pass: &mut PassPlan) {
        let Round { number, opaque, bounds, is_last } = self.rounds.round();
        pass.round = *number;
        pass.opaque.clone_from(opaque);
        pass.bounds.clear();
        pass.look_for.clear();
        if let (true, Some(drawn)) = (*is_last, self.rounds.looked_for()) {
            pass.look_for.clone_from(drawn);
        }
        pass.footprints.clear();
        match self.adaptive {
            None => pass.bounds.extend_from_slice(bounds),
            Some(Adaptive { size_px, .. }) => {
                let whole = bounds.iter().filter_map(|bound| bound.in_world());
                let footprint = |bound| Footprint::of(&pass.projection, size_px, &bound, &DAffine3::IDENTITY);
                pass.footprints.extend(whole.map(footprint));
                self.footprints.clone_from(&pass.footprints);
            }
        }
        pass.blended.clear();
        if pass.round > 0 {
            pass.cuts.clear();
        }
        pass.boxes.clear();
        if *is_last {
            pass.blended.extend(self.blended.iter().filter(|leaf| self.rounds.kept().contains(**leaf)));
            pass.boxes.extend_from_slice(&self.boxes);
        }
    }
}
