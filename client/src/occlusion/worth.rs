//! Whether occlusion culling is worth what it costs, and how much of a frame it may take.

use crate::frame::Times;

/// Frames that are looked at before a judgement.
const WINDOW: u32 = 3;
/// Frames that it is left off after a first judgement, and at most: each further one doubles them.
const FIRST_PAUSE: u32 = 48;
const LONGEST_PAUSE: u32 = 768;
/// Frames after a pause that say nothing: in the first all is drawn, to know what is seen.
const WARM_UP: u32 = 1;
/// Where the GPU has no clock: the share of triangles that must be hidden.
const LEAST_HIDDEN: f64 = 0.25;

/// Learns to leave it off where little is hidden, and looks again now and then.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Worth {
    /// Frames for which it is left off still.
    pause: u32,
    last_pause: u32,
    frames: u32,
    saved_us: f64,
    spent_us: f64,
}

/// What a frame with occlusion culling came to.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Triangles drawn.
    pub drawn: u64,
    /// Triangles left out.
    pub hidden: u64,
    /// Where the GPU has a clock.
    pub times: Option<Times>,
}

impl Worth {
    /// Whether the next frame is drawn with occlusion culling.
    pub fn is_on(&mut self) -> bool {
        self.pause = self.pause.saturating_sub(1);
        self.pause == 0
    }

    /// Takes what came of a frame that was.
    pub fn note(&mut self, outcome: Outcome) {
        self.frames += 1;
        if self.frames <= WARM_UP {
            return;
        }
        let (drawn, hidden) = (outcome.drawn as f64, outcome.hidden as f64);
        let times = outcome.times.unwrap_or(Times { draw_us: drawn, test_us: (drawn + hidden) * LEAST_HIDDEN });
        self.saved_us += times.draw_us * hidden / drawn.max(1.0);
        self.spent_us += times.test_us;
        if self.frames == WARM_UP + WINDOW {
            let is_worth = self.saved_us > self.spent_us;
            *self = if is_worth {
                Self { frames: WARM_UP, ..Self::default() }
            } else {
                let pause = (self.last_pause * 2).clamp(FIRST_PAUSE, LONGEST_PAUSE);
                Self { pause, last_pause: pause, ..Self::default() }
            };
        }
    }
}

/// How many microseconds of a frame may go into tests: equation 2, T_culling = T_render × F.
///
/// F depends on the machine (section 4.4). Here it is found by going up or down with it as long as frames get shorter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    fraction: f64,
    is_rising: bool,
    render_us: f64,
    frames: u32,
    sum_us: f64,
    last_us: f64,
}

/// Frames that each fraction is tried for.
const TRIAL: u32 = 8;
/// What a frame counts for in the render time of equation 2. The last one alone would swing: where much was culled little is left to be
/// drawn, so that the next frame could test little and would draw all.
const SMOOTHING: f64 = 0.125;
/// From one fraction to the next.
const STRIDE: f64 = 1.5;
/// What the paper found for its machine: a place to start from.
const PAPERS_FRACTION: f64 = 1.0 / 3.0;
const FRACTIONS: [f64; 2] = [0.02, 8.0];

impl Default for Budget {
    fn default() -> Self {
        Self {
            fraction: PAPERS_FRACTION,
            is_rising: true,
            render_us: f64::INFINITY,
            frames: 0,
            sum_us: 0.0,
            last_us: f64::INFINITY,
        }
    }
}

impl Budget {
    /// Of the next frame. Without end before the first.
    pub fn us(&self) -> f64 {
        self.render_us * self.fraction
    }

    /// F.
    pub fn fraction(&self) -> f64 {
        self.fraction
    }

    /// Takes how long a frame was drawn and tested.
    pub fn note(&mut self, times: Times) {
        self.render_us = match self.render_us {
            before if before.is_finite() => before + (times.draw_us - before) * SMOOTHING,
            _ => times.draw_us,
        };
        self.sum_us += times.draw_us + times.test_us;
        self.frames += 1;
        if self.frames < TRIAL {
            return;
        }
        if self.sum_us > self.last_us {
            self.is_rising = !self.is_rising;
        }
        let factor = if self.is_rising { STRIDE } else { 1.0 / STRIDE };
        self.fraction = (self.fraction * factor).clamp(FRACTIONS[0], FRACTIONS[1]);
        (self.last_us, self.sum_us, self.frames) = (self.sum_us, 0.0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(hidden: u64, test_us: f64) -> Outcome {
        let times = Some(Times { draw_us: (1000 - hidden) as f64, test_us });
        Outcome { drawn: 1000 - hidden, hidden, times }
    }

    /// Of 4000 frames, how many are drawn with it.
    fn share(outcome: Outcome) -> f64 {
        let mut worth = Worth::default();
        let mut on = 0;
        for _ in 0..4000 {
            if worth.is_on() {
                on += 1;
                worth.note(outcome);
            }
        }
        f64::from(on) / 4000.0
    }

    #[test]
    fn it_stays_on_where_it_saves_more_than_it_costs() {
        assert_eq!(share(outcome(600, 100.0)), 1.0);
        assert_eq!(share(Outcome { times: None, ..outcome(600, 0.0) }), 1.0);
    }

    #[test]
    fn it_is_left_off_where_it_costs_more_but_for_a_look_now_and_then() {
        for outcome in [outcome(50, 100.0), outcome(0, 1.0), Outcome { times: None, ..outcome(100, 0.0) }] {
            let share = share(outcome);
            assert!(share > 0.005 && share < 0.03, "{share}");
        }
    }

    #[test]
    fn it_is_back_when_things_begin_to_hide_others() {
        let mut worth = Worth::default();
        for _ in 0..2000 {
            if worth.is_on() {
                worth.note(outcome(0, 50.0));
            }
        }
        let waited = (0..2000).take_while(|_| !worth.is_on()).count();
        assert!(waited < LONGEST_PAUSE as usize);
        for _ in 0..500 {
            assert!(worth.is_on());
            worth.note(outcome(600, 50.0));
        }
    }

    #[test]
    fn a_budget_that_suffices_goes_on_to() {
        // All is drawn in 1000 microseconds, a tenth of it where tests may take 300.
        let mut budget = Budget::default();
        let mut enough = 0;
        for frame in 0..400 {
            let suffices = budget.us() >= 300.0;
            enough += u32::from(suffices && frame >= 200);
            budget.note(if suffices {
                Times { draw_us: 100.0, test_us: 300.0 }
            } else {
                Times { draw_us: 1000.0, test_us: budget.us() }
            });
        }
        assert!(enough > 180, "{enough} of 200 frames");
    }

    #[test]
    fn the_fraction_goes_where_frames_are_shortest() {
        // Tests pay up to half the time of drawing, then no more.
        for best in [0.1, 1.0, 4.0] {
            let mut budget = Budget::default();
            assert_eq!(budget.us(), f64::INFINITY);
            for _ in 0..400 {
                let fraction: f64 = budget.fraction();
                let draw_us = 1000.0 * (1.0 + (fraction / best).ln().abs());
                budget.note(Times { draw_us, test_us: 0.0 });
            }
            assert!((budget.fraction() / best).ln().abs() < 1.0, "{} for {best}", budget.fraction());
        }
    }
}
