//! How many triangles there is time for: from what drawing took, to the triangles of the next frame. Of a wall, the slowest node counts.
//!
//! What a frame takes grows with its triangles, from some fixed time on. So the triangles that would take the time that is aimed at are
//! sought in proportion: `wished = drawn · aim / took`, which is right where nothing is fixed, and goes the right way, too short, where
//! something is: from there on the next frames go on. The median of the last three wishes is followed, so that one hiccup is none: at once
//! where it is far away, slowly where it may be noise, and ever more where it stays on one side. What is given out moves in steps of a
//! sixteenth of an octave, and only where it is off by most of one: a picture at rest stays what it is.
//!
//! Where times scatter a margin comes off: as much as the second longest of the last frames would have been over with all that is followed, beyond
//! what is allowed. It is there at once, and goes slowly. While costs are followed at full pace they have changed, and earlier frames tell nothing.
//! What is followed is what takes that much less than the time aimed at: where most of that goes whatever is drawn, few triangles are left.

/// What is aimed at, as a share of the time there is: times differ by a few percent from frame to frame.
pub const AIM: f64 = 0.9;
/// The least triangles that are asked for, where the scene has so many: what does not fit the time with these has something else to blame.
pub const LEAST_TRIANGLES: u32 = 1024;
/// The triangles of the first frame, before anything is known.
pub const FIRST_TRIANGLES: u32 = 20_000;
/// A step of what is given out: log of the triangles, 4.4 %.
const STEP: f64 = std::f64::consts::LN_2 / 16.0;
/// By how many steps that must be off before it moves.
const STAYS_WITHIN: f64 = 0.75;
/// Wishes further away than that are followed at once: log of the triangles, 15 %.
const FAR: f64 = 0.15;
/// Nearer ones are followed by a share. It grows with each that is on the same side as the one before, but for the first few: what is fixed
/// makes wishes too short.
const SHARE_WHEN_NEAR: f64 = 0.1;
const SAME_BY_CHANCE: u32 = 6;
/// Frames of which the margin is found, by the second longest: a lone hiccup among them is none.
const REMEMBERED: usize = 32;
/// What a frame may take before the margin grows, as a share of the time that there is.
const ALLOWED: f64 = 1.05;
/// Most of the margin: log of the time, to a half. More than noise needs another cure.
const MOST_MARGIN: f64 = std::f64::consts::LN_2;
/// What a frame takes off the margin that is not needed any more, as a share.
const MARGIN_FALLS_BY: f64 = 0.05;
/// Most that a frame moves down and up: log of the triangles, to a half and by a half.
const MOST_DOWN: f64 = std::f64::consts::LN_2;
const MOST_UP: f64 = 0.405;

/// Finds the triangles that a time allows. All in the logarithm of triangles.
#[derive(Clone, Debug)]
pub struct Throughput {
    /// Of the time aimed at, microseconds.
    aim: f64,
    /// Least and most.
    range: (f64, f64),
    /// What is followed: what would take the time aimed at, if time went by triangles.
    level: f64,
    /// What is given out less than that.
    margin: f64,
    /// How far below what was followed the last wishes were, since costs have changed.
    overs: [f64; REMEMBERED],
    /// Where the next one goes.
    next: usize,
    /// What is given out, in steps.
    given: f64,
    /// The last wishes, the newest last.
    wishes: [f64; 3],
    known: usize,
    /// How many wishes in a row were on the side of the last one.
    same: u32,
    side: f64,
    /// The smallest wish since a frame ended, and whether there was more to draw for anybody.
    newest: Option<(f64, bool)>,
}

impl Throughput {
    /// For frames that take so long, more than 0, of a scene that has so many triangles.
    pub fn new(time_us: u32, scene_triangles: u32) -> Self {
        let aim = (f64::from(time_us.max(1)) * AIM).ln();
        let level = f64::from(FIRST_TRIANGLES).ln();
        let mut new = Self {
            aim,
            range: (0.0, 0.0),
            level,
            margin: 0.0,
            overs: [0.0; REMEMBERED],
            next: 0,
            given: 0.0,
            wishes: [0.0; 3],
            known: 0,
            same: 0,
            side: 0.0,
            newest: None,
        };
        new.set_most(scene_triangles);
        new.given = (new.level / STEP).round();
        new
    }

    /// The scene has so many triangles now.
    pub fn set_most(&mut self, scene_triangles: u32) {
        let most = scene_triangles.max(1);
        self.range = (f64::from(most.min(LEAST_TRIANGLES)).ln(), f64::from(most).ln());
        self.level = self.level.clamp(self.range.0, self.range.1);
    }

    /// The triangles of the next frame.
    pub fn triangles(&self) -> u32 {
        (self.given * STEP).clamp(self.range.0, self.range.1).exp().round() as u32
    }

    /// A node took so long for a frame of so many triangles: of those of a frame, the one that wishes for least counts.
    pub fn take(&mut self, triangles: u32, draw_us: u32, is_cut: bool) {
        let wish = f64::from(triangles.max(1)).ln() + self.aim - f64::from(draw_us.max(1)).ln();
        // Where all there was fitted, nobody knows what more would take.
        let wish = if is_cut { wish } else { wish.min(self.level) };
        let (least, is_any_cut) = self.newest.unwrap_or((wish, false));
        self.newest = Some((least.min(wish), is_any_cut || is_cut));
    }

    /// A frame is over: follows what was taken since the last one, if anything was.
    pub fn follow(&mut self) {
        let Some((wish, tells_all)) = self.newest.take() else { return };
        self.wishes.rotate_left(1);
        self.wishes[2] = wish;
        self.known = (self.known + 1).min(self.wishes.len());
        let mut sorted = self.wishes;
        let sorted = &mut sorted[self.wishes.len() - self.known..];
        sorted.sort_unstable_by(f64::total_cmp);
        let away = sorted[(self.known - 1) / 2] - self.level;
        self.same = if self.side == away.signum() { self.same.saturating_add(1) } else { 0 };
        self.side = away.signum();
        let is_far = away.abs() > FAR;
        let share_when_near = SHARE_WHEN_NEAR * f64::from(1 + self.same.saturating_sub(SAME_BY_CHANCE));
        let share = if is_far { 1.0 } else { share_when_near.min(1.0) };
        let over = self.level - wish;
        self.level = (self.level + (share * away).clamp(-MOST_DOWN, MOST_UP)).clamp(self.range.0, self.range.1);
        if !(-MOST_DOWN..MOST_UP).contains(&away) {
            self.overs = [0.0; REMEMBERED];
        } else if tells_all || over > 0.0 {
            self.overs[self.next] = over;
            self.next = (self.next + 1) % REMEMBERED;
        }
        self.find_margin();
        let level = (self.level - self.margin).clamp(self.range.0, self.range.1);
        let steps = level / STEP - self.given;
        if level == self.range.0 || level == self.range.1 {
            self.given += steps; // all there is, not almost all
        } else if steps.abs() > STAYS_WITHIN {
            self.given += if is_far || steps < -1.0 { steps.round() } else { steps.signum() };
        }
    }

    fn find_margin(&mut self) {
        let (_, second) = self.overs.iter().fold((0.0f64, 0.0f64), |(first, second), over| match *over {
            over if over > first => (over, first),
            over => (first, second.max(over)),
        });
        let needed = (second - (ALLOWED / AIM).ln()).clamp(0.0, MOST_MARGIN);
        self.margin = needed.max(self.margin + (needed - self.margin) * MARGIN_FALLS_BY);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIME_US: u32 = 10_000;
    const SCENE: u32 = 50_000_000;
    /// Frames in which a wall that begins, or whose costs have doubled, comes to keep its time.
    const KEEPS_TIME_WITHIN: usize = 8;
    /// Frames in which it has come as near to it as it will: long where almost all of the time is fixed.
    const SETTLES_WITHIN: usize = 200;
    /// Frames in which one that cannot keep its time comes to the least.
    const FALLS_WITHIN: usize = 25;
    const NOISE: f64 = 0.05;

    /// A node that takes a fixed time and more for each triangle, give or take 5 %.
    struct Model {
        state: u64,
        fixed_us: f64,
        triangle_us: f64,
    }

    impl Model {
        fn new(seed: u64, fixed_us: f64, triangle_us: f64) -> Self {
            Self { state: seed, fixed_us, triangle_us }
        }

        /// SplitMix64, from 0 up to 1.
        fn random(&mut self) -> f64 {
            self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (self.state ^ (self.state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            ((z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb) >> 11) as f64 / (1u64 << 53) as f64
        }

        fn draw_us(&mut self, triangles: u32) -> u32 {
            let noise = 1.0 + NOISE * (2.0 * self.random() - 1.0);
            ((self.fixed_us + self.triangle_us * f64::from(triangles)) * noise) as u32
        }

        /// Triangles and times of so many frames.
        fn draw(&mut self, throughput: &mut Throughput, frames: usize) -> Vec<(u32, u32)> {
            let mut frame = || {
                let triangles = throughput.triangles();
                let draw_us = self.draw_us(triangles);
                throughput.take(triangles, draw_us, true);
                throughput.follow();
                (triangles, draw_us)
            };
            (0..frames).map(|_| frame()).collect()
        }

        /// Frames of which every eighth takes twice as long, until that is settled.
        fn draw_with_hiccups(&mut self, throughput: &mut Throughput) {
            for frame in 0..SETTLES_WITHIN {
                let triangles = throughput.triangles();
                throughput.take(triangles, self.draw_us(triangles) * if frame % 8 == 0 { 2 } else { 1 }, true);
                throughput.follow();
            }
        }
    }

    /// Fixed time, time for a triangle, microseconds; the fixed time of the last is all but what is aimed at.
    const NODES: [(f64, f64); 5] = [(100.0, 0.05), (1000.0, 0.01), (5000.0, 0.002), (8000.0, 0.001), (8700.0, 0.0005)];

    fn is_over(draw_us: u32) -> bool {
        f64::from(draw_us) > 1.1 * f64::from(TIME_US)
    }

    #[test]
    fn the_time_is_used_and_kept() {
        for (fixed_us, triangle_us) in NODES {
            for seed in 0..50 {
                let mut throughput = Throughput::new(TIME_US, SCENE);
                let mut model = Model::new(seed, fixed_us, triangle_us);
                let frames = model.draw(&mut throughput, 2 * SETTLES_WITHIN);
                let node = format!("{fixed_us} + {triangle_us} a triangle, seed {seed}");
                let late = frames.iter().skip(KEEPS_TIME_WITHIN).position(|(_, draw_us)| is_over(*draw_us));
                assert_eq!(late, None, "{node}");
                let settled = &frames[SETTLES_WITHIN..];
                let mean = settled.iter().map(|(_, draw_us)| f64::from(*draw_us)).sum::<f64>() / settled.len() as f64;
                assert!((0.86..0.93).contains(&(mean / f64::from(TIME_US))), "{node}: {mean} us");
                assert!(settled.iter().all(|(_, draw_us)| *draw_us <= TIME_US), "{node}");
            }
        }
    }

    #[test]
    fn costs_that_double_are_met_within_a_few_frames() {
        for (fixed_us, triangle_us) in NODES {
            for seed in 0..50 {
                let mut throughput = Throughput::new(TIME_US, SCENE);
                let mut model = Model::new(seed, fixed_us, triangle_us);
                model.draw(&mut throughput, SETTLES_WITHIN);
                model.triangle_us *= 2.0;
                let after = model.draw(&mut throughput, SETTLES_WITHIN);
                let late = after.iter().skip(KEEPS_TIME_WITHIN).position(|(_, draw_us)| is_over(*draw_us));
                assert_eq!(late, None, "{fixed_us} + {triangle_us} a triangle, seed {seed}");
            }
        }
    }

    #[test]
    fn a_picture_whose_costs_stay_stays_too() {
        for (fixed_us, triangle_us) in NODES {
            let (mut changes, mut frames) = (0, 0);
            for seed in 0..50 {
                let mut throughput = Throughput::new(TIME_US, SCENE);
                let mut model = Model::new(seed, fixed_us, triangle_us);
                model.draw(&mut throughput, SETTLES_WITHIN);
                let settled = model.draw(&mut throughput, SETTLES_WITHIN);
                for pair in settled.windows(2) {
                    let [before, now] = [pair[0].0, pair[1].0].map(f64::from);
                    assert!((now / before - 1.0).abs() < 0.046, "{before} to {now}: {fixed_us}, seed {seed}");
                    changes += usize::from(before != now);
                    frames += 1;
                }
            }
            // Where triangles hardly cost anything, noise says as much as they do.
            let most = if fixed_us < 0.8 * f64::from(TIME_US) { frames / 100 } else { frames / 10 };
            assert!(changes < most, "{changes} changes in {frames} frames: {fixed_us} + {triangle_us} a triangle");
        }
    }

    /// How times scatter beyond the model's few percent: by what factor a frame takes longer, from numbers that scatter as 0, 1 does and
    /// from 0 to 1.
    type Scatter = fn(&mut f64, normal: f64, uniform: f64) -> f64;

    /// A name, the factor, the most frames over by more than a tenth, and the least mean use of the time.
    const SCATTERS: [(&str, Scatter, f64, f64); 5] = [
        ("a little", |_, normal, _| (0.1 * normal).exp(), 0.025, 0.84),
        ("much", |_, normal, _| (0.2 * normal).exp(), 0.04, 0.7),
        (
            "in spells",
            |spell, normal, _| {
                *spell = 0.8 * *spell + 0.6 * normal;
                (0.2 * *spell).exp()
            },
            0.035,
            0.76,
        ),
        ("a hiccup in thirty", |_, _, uniform| if uniform < 0.03 { 2.0 } else { 1.0 }, 0.0275, 0.75),
        ("a hiccup in ten", |_, _, uniform| if uniform < 0.1 { 1.8 } else { 1.0 }, 0.05, 0.64),
    ];

    /// Goal: frames keep their time on a machine that does other things, too, and the time is used. Method: fixed and triangles' costs, of
    /// which the latter rise and fall by a third as a camera's do, and noise from seeds; the share of frames over, once settled.
    #[test]
    fn times_that_scatter_are_kept_and_used() {
        const SEEDS: u64 = 20;
        for (name, scatter, most_over, least_use) in SCATTERS {
            let (mut frames, mut over, mut used) = (0usize, 0usize, 0.0);
            for seed in 0..SEEDS {
                let mut throughput = Throughput::new(TIME_US, SCENE);
                let (mut model, mut spell) = (Model::new(seed, 1000.0, 0.01), 0.0);
                for frame in 0..4 * SETTLES_WITHIN {
                    model.triangle_us = 0.01 * (0.3 * (frame as f64 / 60.0).sin()).exp();
                    // Twelve from 0 to 1 scatter about as what is normal does.
                    let normal = (0..12).map(|_| model.random()).sum::<f64>() - 6.0;
                    let uniform = model.random();
                    let triangles = throughput.triangles();
                    let draw_us = (f64::from(model.draw_us(triangles)) * scatter(&mut spell, normal, uniform)) as u32;
                    throughput.take(triangles, draw_us, true);
                    throughput.follow();
                    if frame >= SETTLES_WITHIN {
                        frames += 1;
                        over += usize::from(is_over(draw_us));
                        used += f64::from(draw_us) / f64::from(TIME_US);
                    }
                }
            }
            let (over, used) = (over as f64 / frames as f64, used / frames as f64);
            assert!(over <= most_over && used >= least_use, "{name}: {over} of all frames over, {used} of the time used");
        }
    }

    /// Goal: what an empty view takes says nothing of how times scatter in a full one. Method: scatter, then views that are empty.
    #[test]
    fn a_margin_stays_while_views_are_empty() {
        let mut throughput = Throughput::new(TIME_US, SCENE);
        let mut model = Model::new(1, 1000.0, 0.01);
        model.draw_with_hiccups(&mut throughput);
        let settled = throughput.triangles();
        for _ in 0..SETTLES_WITHIN {
            throughput.take(throughput.triangles(), model.draw_us(10), false);
            throughput.follow();
        }
        assert!(throughput.triangles() <= settled, "{} and {settled}", throughput.triangles());
    }

    #[test]
    fn a_margin_goes_once_times_are_even() {
        let mut throughput = Throughput::new(TIME_US, SCENE);
        let mut model = Model::new(1, 1000.0, 0.01);
        model.draw(&mut throughput, SETTLES_WITHIN);
        let even = f64::from(throughput.triangles());
        model.draw_with_hiccups(&mut throughput);
        assert!(f64::from(throughput.triangles()) < 0.8 * even);
        model.draw(&mut throughput, SETTLES_WITHIN);
        assert!((f64::from(throughput.triangles()) / even - 1.0).abs() < 0.1);
    }

    #[test]
    fn what_no_triangles_help_is_held_at_the_least() {
        for seed in 0..50 {
            let mut throughput = Throughput::new(TIME_US, SCENE);
            let mut model = Model::new(seed, 1.2 * f64::from(TIME_US), 0.001);
            model.draw(&mut throughput, FALLS_WITHIN);
            let after = model.draw(&mut throughput, SETTLES_WITHIN);
            assert!(after.iter().all(|(triangles, _)| *triangles == LEAST_TRIANGLES), "seed {seed}: {after:?}");
        }
    }

    #[test]
    fn what_an_empty_view_takes_says_nothing_of_a_full_one() {
        let mut throughput = Throughput::new(TIME_US, SCENE);
        let mut model = Model::new(3, 500.0, 0.05);
        model.draw(&mut throughput, SETTLES_WITHIN);
        let settled = throughput.triangles();
        for _ in 0..SETTLES_WITHIN {
            throughput.take(throughput.triangles(), model.draw_us(10), false);
            throughput.follow();
        }
        assert_eq!(throughput.triangles(), settled);
        assert!(!is_over(model.draw(&mut throughput, 1)[0].1), "the first full one keeps its time");
        // But what takes too long does, however little it is.
        (0..FALLS_WITHIN).for_each(|_| {
            throughput.take(throughput.triangles(), 3 * TIME_US, false);
            throughput.follow();
        });
        assert_eq!(throughput.triangles(), LEAST_TRIANGLES);
    }

    #[test]
    fn one_hiccup_is_none() {
        for seed in 0..50 {
            let mut throughput = Throughput::new(TIME_US, SCENE);
            let mut model = Model::new(seed, 1000.0, 0.01);
            model.draw(&mut throughput, SETTLES_WITHIN);
            let before = f64::from(throughput.triangles());
            throughput.take(throughput.triangles(), 8 * TIME_US, true);
            throughput.follow();
            let after = model.draw(&mut throughput, 5);
            assert!(after.iter().all(|(triangles, _)| (f64::from(*triangles) / before - 1.0).abs() < 0.046), "seed {seed}");
        }
    }

    #[test]
    fn the_slowest_counts_and_frames_without_a_word_change_nothing() {
        let mut throughput = Throughput::new(TIME_US, SCENE);
        for _ in 0..20 {
            let triangles = throughput.triangles();
            for draw_us in [triangles / 100, triangles / 10, triangles / 50] {
                throughput.take(triangles, draw_us, true);
            }
            throughput.follow();
        }
        let settled = throughput.triangles();
        assert!((85_000..95_000).contains(&settled), "{settled}");
        (0..50).for_each(|_| throughput.follow());
        assert_eq!(throughput.triangles(), settled);
    }

    #[test]
    fn no_more_is_asked_for_than_there_is() {
        for scene in [0, 1, 500, LEAST_TRIANGLES, 3600, 30_000] {
            let mut throughput = Throughput::new(TIME_US, scene);
            let frames = Model::new(1, 10.0, 0.000_1).draw(&mut throughput, 100);
            assert!(frames.iter().all(|(triangles, _)| (1..=scene.max(1)).contains(triangles)), "{scene}: {frames:?}");
            assert_eq!(throughput.triangles(), scene.max(1));
            throughput.set_most(100_000);
            Model::new(1, 10.0, 0.000_1).draw(&mut throughput, 100);
            assert_eq!(throughput.triangles(), 100_000, "it has grown");
        }
    }
}
