//! Whether occlusion culling is worth what it costs, and how much of a frame it may take.

use crate::frame::Times;

/// Frames that are looked at before a judgement.
const WINDOW: u32 = 3;
/// So many frames later it is on again after a first judgement, and at most: each further one doubles them.
const FIRST_PAUSE: u32 = 96;
const LONGEST_PAUSE: u32 = 768;
const _: () = assert!(MEASURED < FIRST_PAUSE);
/// So many times as long as without: then two frames that were looked at are enough.
const FAR_TOO_LONG: f64 = 1.25;
/// Of the time of a pause what is lost by looking after it, at most: the longer it takes, the rarer it is looked.
const LOST: f64 = 0.02;
/// Frames after a pause that say nothing: in the first all is drawn, to know what is seen.
const WARM_UP: u32 = 1;
/// Of a pause the last frames, in which it is measured what a frame takes without: the quickest is believed, others were disturbed.
const MEASURED: u32 = 3;
/// It is measured anew where there are so many times as many triangles as then: what a frame takes at least was counted for each of few. So
/// that happens a few times at most, as a scene comes.
const MANY_MORE: f64 = 2.0;
/// And after so many frames with it, where less than this share is saved: then nobody sees it.
const RENEWED: u32 = 512;
const LITTLE: f64 = 0.2;
/// Where the GPU has no clock: the share of triangles that must be hidden.
const LEAST_HIDDEN: f64 = 0.25;

/// Learns to leave it off where frames take longer with it, and looks again now and then.
///
/// What a frame would have taken without is known from frames that were drawn so before, and goes with the triangles in the view. It is not
/// more than if those that are hidden took as long as those that were drawn: they are the farther ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worth {
    /// It is on again so many frames later.
    pause: u32,
    last_pause: u32,
    /// Frames with it since the last pause, or the last judgement.
    frames: u32,
    /// Frames with it since the last pause.
    since_pause: u32,
    /// Of frames without.
    known: Option<Known>,
    /// Of the frames that are looked at, which are disturbed, too: the least share of what one takes without.
    least: f64,
}

/// What is known of frames without.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Known {
    us_per_triangle: f64,
    triangles: u64,
}

impl Default for Worth {
    /// Begins with frames without.
    fn default() -> Self {
        Self { pause: MEASURED + 1, last_pause: 0, frames: 0, since_pause: 0, known: None, least: f64::INFINITY }
    }
}

/// What a frame with occlusion culling came to.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Triangles drawn.
    pub drawn: u64,
    /// Triangles in the view.
    pub all: u64,
    /// Where the GPU has a clock.
    pub times: Option<Times>,
}

impl Worth {
    /// Whether the next frame is drawn with occlusion culling.
    pub fn is_on(&mut self) -> bool {
        self.pause = self.pause.saturating_sub(1);
        self.pause == 0
    }

    /// Whether the next frame, which is drawn without, is to be measured.
    pub fn is_measured(&self) -> bool {
        self.pause <= MEASURED
    }

    /// Takes what a frame took that was drawn without.
    pub fn note_without(&mut self, triangles: u64, times: Times) {
        let us_per_triangle = times.all_us() / triangles.max(1) as f64;
        let before = self.known.filter(|_| self.pause < MEASURED);
        let quickest = before.map_or(us_per_triangle, |before| before.us_per_triangle.min(us_per_triangle));
        self.known = Some(Known { us_per_triangle: quickest, triangles });
    }

    /// Takes what came of a frame that was drawn with it.
    pub fn note(&mut self, outcome: Outcome) {
        self.frames += 1;
        self.since_pause += 1;
        if self.frames <= WARM_UP {
            return;
        }
        let (drawn, all) = (outcome.drawn as f64, outcome.all as f64);
        let (with_us, without_us) = match outcome.times {
            Some(times) => {
                let alike_us = times.plan_us + times.draw_us * all / drawn.max(1.0);
                (times.all_us(), self.known.map_or(alike_us, |known| alike_us.min(known.us_per_triangle * all)))
            }
            None => (drawn + all * LEAST_HIDDEN, all),
        };
        self.least = self.least.min(with_us / without_us);
        let looked_at = self.frames - WARM_UP;
        if looked_at < WINDOW && (looked_at == 1 || self.least < FAR_TOO_LONG) {
            return;
        }
        let least = std::mem::replace(&mut self.least, f64::INFINITY);
        let many_more = |known: Known| all > known.triangles as f64 * MANY_MORE;
        if least < 1.0 {
            self.last_pause = 0;
            self.frames = WARM_UP;
            if self.known.is_some_and(many_more) || self.since_pause >= RENEWED && least > 1.0 - LITTLE {
                self.leave_off(MEASURED + 1);
            }
        } else {
            // Where there is nothing to be drawn, nothing is known.
            let looking = if least.is_finite() { f64::from(self.frames) * (least - 1.0) } else { 0.0 };
            self.last_pause = (self.last_pause * 2).max((looking / LOST) as u32).clamp(FIRST_PAUSE, LONGEST_PAUSE);
            self.leave_off(self.last_pause);
        }
    }

    fn leave_off(&mut self, pause: u32) {
        (self.pause, self.frames, self.since_pause) = (pause, 0, 0);
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

    /// A scene of 1000 triangles, each of which takes a microsecond beyond what all frames take.
    #[derive(Clone, Copy)]
    struct Drawing {
        hidden: u64,
        always_us: f64,
        plan_us: f64,
        test_us: f64,
        has_clock: bool,
    }

    const DRAWING: Drawing = Drawing { hidden: 0, always_us: 0.0, plan_us: 0.0, test_us: 0.0, has_clock: true };

    impl Drawing {
        /// Draws a frame. Whether it was drawn with occlusion culling.
        fn draw(self, worth: &mut Worth) -> bool {
            let is_on = worth.is_on();
            let drawn = if is_on { 1000 - self.hidden } else { 1000 };
            let draw_us = self.always_us + drawn as f64;
            if is_on {
                let times = self.has_clock.then_some(Times { plan_us: self.plan_us, draw_us, test_us: self.test_us });
                worth.note(Outcome { drawn, all: 1000, times });
            } else if worth.is_measured() && self.has_clock {
                worth.note_without(drawn, Times { draw_us, ..Times::default() });
            }
            is_on
        }

        /// Of 4000 frames, how many are drawn with it.
        fn share(self) -> f64 {
            let mut worth = Worth::default();
            let on = (0..4000).filter(|_| self.draw(&mut worth)).count();
            on as f64 / 4000.0
        }
    }

    #[test]
    fn it_stays_on_where_it_saves_more_than_it_costs() {
        let much = Drawing { hidden: 600, test_us: 100.0, ..DRAWING };
        assert_eq!(much.share(), 1.0 - f64::from(MEASURED) / 4000.0);
        assert_eq!(Drawing { has_clock: false, ..much }.share(), much.share());
        // Where it saves little it is measured again what is saved.
        let little = Drawing { hidden: 200, test_us: 100.0, ..DRAWING };
        assert!(little.share() > 0.99 && little.share() < much.share(), "{}", little.share());
    }

    #[test]
    fn it_is_left_off_where_it_costs_more_but_for_a_look_now_and_then() {
        for drawing in [
            Drawing { hidden: 50, test_us: 100.0, ..DRAWING },
            Drawing { hidden: 0, test_us: 1.0, ..DRAWING },
            Drawing { hidden: 100, has_clock: false, ..DRAWING },
            // Much is hidden, but that is not what takes long.
            Drawing { hidden: 800, always_us: 10_000.0, test_us: 1000.0, ..DRAWING },
            // It costs the GPU little, and the CPU more than is saved.
            Drawing { hidden: 800, plan_us: 1000.0, ..DRAWING },
        ] {
            let share = drawing.share();
            assert!(share > 0.005 && share < 0.03, "{share}");
        }
    }

    #[test]
    fn what_takes_far_too_long_is_looked_at_rarely() {
        let mut worth = Worth::default();
        let dear = Drawing { test_us: 3000.0, ..DRAWING };
        assert_eq!((0..400).filter(|_| dear.draw(&mut worth)).count(), 3);
        // But not where there was nothing to be drawn.
        let mut worth = Worth::default();
        let nothing = Outcome { drawn: 0, all: 0, times: Some(Times::default()) };
        let on = (0..400).filter(|_| worth.is_on()).count();
        assert_eq!(on, 400 - MEASURED as usize);
        (0..4).for_each(|_| worth.note(nothing));
        assert_eq!((0..FIRST_PAUSE).filter(|_| worth.is_on()).count(), 1);
    }

    #[test]
    fn it_is_back_when_things_begin_to_hide_others() {
        let mut worth = Worth::default();
        let nothing = Drawing { test_us: 50.0, ..DRAWING };
        (0..2000).for_each(|_| _ = nothing.draw(&mut worth));
        let much = Drawing { hidden: 600, ..nothing };
        let waited = (0..2000).take_while(|_| !much.draw(&mut worth)).count();
        assert!(waited < LONGEST_PAUSE as usize);
        assert!((0..500).all(|_| much.draw(&mut worth)));
    }

    #[test]
    fn a_scene_that_comes_late_is_measured_once_it_is_there() {
        // What always takes long was counted for twelve triangles.
        let mut worth = Worth::default();
        for _ in 0..=MEASURED {
            if !worth.is_on() {
                worth.note_without(12, Times { draw_us: 10_012.0, ..Times::default() });
            }
        }
        let costly = Drawing { hidden: 800, always_us: 10_000.0, test_us: 1000.0, ..DRAWING };
        let on = (0..4000).filter(|_| costly.draw(&mut worth)).count();
        assert!(on < 100, "{on}");
    }

    #[test]
    fn one_frame_that_was_disturbed_is_not_believed() {
        let mut worth = Worth::default();
        let costly = Drawing { hidden: 800, always_us: 10_000.0, test_us: 1000.0, ..DRAWING };
        let disturbed = Drawing { always_us: 100_000.0, ..costly };
        let on = (0..4000).filter(|frame| if *frame == 0 { disturbed } else { costly }.draw(&mut worth)).count();
        assert!(on < 100, "{on}");
        // Nor one with it.
        let much = Drawing { hidden: 600, test_us: 100.0, ..DRAWING };
        let disturbed = Drawing { always_us: 100_000.0, ..much };
        let mut worth = Worth::default();
        let on = (0..4000).filter(|frame| if frame % 7 == 0 { disturbed } else { much }.draw(&mut worth)).count();
        assert_eq!(on, 4000 - MEASURED as usize);
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
                Times { draw_us: 100.0, test_us: 300.0, ..Times::default() }
            } else {
                Times { draw_us: 1000.0, test_us: budget.us(), ..Times::default() }
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
                budget.note(Times { draw_us, ..Times::default() });
            }
            assert!((budget.fraction() / best).ln().abs() < 1.0, "{} for {best}", budget.fraction());
        }
    }
}
