//! What a wall spends on estimates of what is visible: one budget of triangles a frame, the same order for all nodes.
//!
//! A budget is so many triangles, or so much time. Then nodes' times are followed: of those that were ready in time, the slowest counts. One
//! that was passed over, or has come, counts for its next few answers, however late: it may be late for the triangles' sake. One that stays
//! late has something else to blame, and the others do not go without for it.

use std::collections::VecDeque;
use std::time::Duration;

use mullion_common::throughput::Throughput;
use mullion_common::wire::Estimate;

use crate::swap_barrier::{NodeIndex, ShowNow};

/// After so many frames in which nothing moved, all that is seen is drawn: half a second at 60 Hz.
pub const REST_FRAMES: u32 = 30;
/// How long the first of those frames is waited for at least: while all stands still, nobody sees it come late, but everybody that tiles show it
/// one by one.
pub const COMPLETE_WAIT: Duration = Duration::from_secs(1);
/// How many late answers of a node count after it was passed over, or has come.
pub const LATE_ANSWERS: u8 = 8;
/// How many frames back an answer still tells something.
const REMEMBERED: usize = 16;

/// What a wall may spend on a frame's estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WallBudget {
    /// So many triangles.
    Triangles(u32),
    /// As many as the slowest node draws in so many microseconds.
    TimeUs(u32),
}

/// How estimates are drawn.
#[derive(Clone, Debug)]
pub struct EstimateOptions {
    /// What each frame may spend.
    pub budget: WallBudget,
    /// Triangles of the scene: no frame spends more.
    pub scene_triangles: u32,
    /// Whether all that is seen is drawn when the camera rests.
    pub completes: bool,
}

/// What a frame spent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spent {
    /// Most triangles of the wall's estimate.
    pub triangles: u32,
    /// All that is seen was drawn: the camera rests.
    pub is_complete: bool,
    /// Time that the slowest node took of those that were ready in time, microseconds; 0: none said.
    pub slowest_us: u32,
    /// Whether that is more than there was; never of a frame that is complete.
    pub is_over: bool,
}

/// A frame that nodes may still answer.
#[derive(Clone, Copy, Debug)]
struct Begun {
    number: u64,
    at: Duration,
    triangles: u32,
    is_complete: bool,
}

/// How the triangles of a frame are found.
#[derive(Debug)]
enum Way {
    Given(u32),
    /// Of so many microseconds.
    Timed(u32, Box<Throughput>),
}

/// Decides what is spent.
#[derive(Debug)]
pub(super) struct Estimates {
    way: Way,
    scene_triangles: u32,
    completes: bool,
    /// Frames in a row that are as the one before.
    rested: u32,
    order: Estimate,
    /// The newest last.
    begun: VecDeque<Begun>,
    /// By `NodeIndex`.
    late_answers: Vec<u8>,
    /// By `NodeIndex`: one past the last frame that it answered.
    answered: Vec<u64>,
    /// Of the newest frame, in time.
    slowest_us: u32,
}

impl Estimates {
    pub fn new(options: EstimateOptions, nodes: usize) -> Self {
        let EstimateOptions { budget, scene_triangles, completes } = options;
        let way = match budget {
            WallBudget::Triangles(triangles) => Way::Given(triangles),
            WallBudget::TimeUs(time_us) => Way::Timed(time_us, Box::new(Throughput::new(time_us, scene_triangles))),
        };
        Self {
            way,
            scene_triangles,
            completes,
            rested: 0,
            order: Estimate::default(),
            begun: VecDeque::with_capacity(REMEMBERED),
            late_answers: vec![0; nodes],
            answered: vec![0; nodes],
            slowest_us: 0,
        }
    }

    /// The scene has grown, and what it may spend perhaps with it. What is known of nodes' times stays.
    pub fn grow(&mut self, budget: WallBudget, scene_triangles: u32) {
        self.scene_triangles = scene_triangles;
        self.rested = 0;
        match (&mut self.way, budget) {
            (Way::Timed(time_us, throughput), WallBudget::TimeUs(of_now)) if *time_us == of_now => {
                throughput.set_most(scene_triangles);
            }
            (way, WallBudget::TimeUs(time_us)) => *way = Way::Timed(time_us, Box::new(Throughput::new(time_us, scene_triangles))),
            (way, WallBudget::Triangles(triangles)) => *way = Way::Given(triangles),
        }
    }

    /// A node has come.
    pub fn join(&mut self, node: NodeIndex) {
        self.late_answers[usize::from(node.0)] = LATE_ANSWERS;
        self.answered[usize::from(node.0)] = 0;
    }

    /// Makes the order of a frame. `is_as_before`: nothing has moved since the frame before.
    pub fn begin(&mut self, number: u64, is_as_before: bool, now: Duration) {
        self.rested = if is_as_before { self.rested.saturating_add(1) } else { 0 };
        let triangles = match &self.way {
            Way::Given(triangles) => self.scene_triangles.min(*triangles),
            Way::Timed(_, throughput) => throughput.triangles(),
        };
        self.order = Estimate { triangles, is_complete: self.completes && self.rested >= REST_FRAMES };
        if self.begun.len() == REMEMBERED {
            self.begun.pop_front();
        }
        self.begun.push_back(Begun { number, at: now, triangles, is_complete: self.order.is_complete });
        self.slowest_us = 0;
    }

    /// How long the newest frame is waited for at least.
    pub fn patience(&self) -> Duration {
        if self.order.is_complete && self.rested == REST_FRAMES { COMPLETE_WAIT } else { Duration::ZERO }
    }

    /// What nodes are told with the newest frame.
    pub fn order(&self) -> Estimate {
        self.order
    }

    /// A node is ready, in time or after the frame was shown.
    pub fn take_ready(&mut self, node: NodeIndex, frame: u64, (draw_us, is_cut): (u32, bool), show_now: ShowNow, now: Duration) {
        let Some(begun) = self.begun.iter().rev().find(|begun| begun.number == frame) else { return };
        let answered = &mut self.answered[usize::from(node.0)];
        if frame < *answered {
            return; // said before
        }
        *answered = frame + 1;
        // Whatever it says: it did not begin before it was told.
        let draw_us = draw_us.min(u32::try_from(now.saturating_sub(begun.at).as_micros()).unwrap_or(u32::MAX));
        let is_in_time = show_now == ShowNow::No && self.begun.back().is_some_and(|newest| newest.number == frame);
        let late_answers = &mut self.late_answers[usize::from(node.0)];
        if draw_us == 0 || !is_in_time && *late_answers == 0 {
            return;
        }
        if is_in_time {
            self.slowest_us = self.slowest_us.max(draw_us);
        } else {
            *late_answers -= 1;
        }
        if let Way::Timed(_, throughput) = &mut self.way
            && !begun.is_complete
        {
            throughput.take(begun.triangles, draw_us, is_cut);
        }
    }

    /// The newest frame is shown, without those that are passed over; what it spent.
    pub fn release(&mut self, passed_over: &[NodeIndex]) -> Spent {
        passed_over.iter().for_each(|node| self.late_answers[usize::from(node.0)] = LATE_ANSWERS);
        let Estimate { triangles, is_complete } = self.order;
        let slowest_us = self.slowest_us;
        let is_late = match &mut self.way {
            Way::Given(_) => false,
            Way::Timed(time_us, throughput) => {
                throughput.follow();
                slowest_us > *time_us
            }
        };
        Spent { triangles, is_complete, slowest_us, is_over: is_late && !is_complete }
    }
}
