//! `orbit`: round a scene and closer to it.

use glam::DVec3;

use super::{Stand, Subject};

/// Length of the walk if nobody says.
pub const FRAMES: usize = 1200;

/// A walk of so many frames round what fills most of the scene, with the whole of that in view at the start.
pub fn walk(subject: &Subject, frames: usize) -> impl Fn(usize) -> Stand + use<> {
    const START: f64 = -0.9;
    const TURN: f64 = 0.9;
    let (center, size, radius_m) = (subject.center(), subject.size(), subject.radius_m());
    let last = frames.max(2) - 1;
    move |frame| {
        let share = frame as f64 / last as f64;
        let mix = |from: f64, to: f64, share: f64| from + (to - from) * share;
        // A city is walked into; a statue is walked round.
        let flatness = size.y / size.x.max(size.z).max(f64::MIN_POSITIVE);
        let compact = ((flatness - 0.2) / 0.2).clamp(0.0, 1.0);
        let (first, last) = (mix(1.7, 4.2, compact), mix(0.95, 3.0, compact));
        let distance_m = radius_m * mix(first, last, share);
        let height_m = distance_m * mix(mix(0.47, 0.3, compact), mix(0.38, 0.2, compact), share);
        let angle = START + TURN * share;
        let eye = center + DVec3::new(angle.sin() * distance_m, height_m, angle.cos() * distance_m);
        Stand::looking(eye, center - eye)
    }
}
