//! `interior`: a walk through a scene at walking pace.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{Stand, Subject};

/// Length of the walk if nobody says: ten seconds at 60 Hz.
pub const FRAMES: usize = 600;
/// Metres of the room that someone walks in a second.
const PACE_M_PER_S: f64 = 1.4;
/// Least half-axis of the round, metres of the room.
const MIN_HALF_M: f64 = 1.0;
/// The round's shorter half-axis is at least this share of the longer: turns at its ends stay smooth.
const MIN_ROUNDNESS: f64 = 0.5;
/// Pieces that the round is measured in.
const PIECES: usize = 4096;

/// Along an ellipse through the populated places, the corners of which are those of the middle half of the leaves, at eye
/// height over the scene's floor and looking ahead. At 1.4 m/s of the room whatever the number of frames; it knows no walls
/// and goes through them, as the cull does.
pub fn walk(subject: &Subject, rate_hz: f64) -> impl Fn(usize) -> Stand + use<> {
    let half_m = subject.core().size() * 0.5;
    let least_m = (half_m.x.max(half_m.z) * MIN_ROUNDNESS).max(MIN_HALF_M * subject.scale());
    let (across_m, along_m) = (half_m.x.max(least_m), half_m.z.max(least_m));
    let middle = DVec3 { y: subject.eye_height_y(), ..subject.core().center() };
    let at = move |angle: f64| middle + DVec3::new(angle.sin() * across_m, 0.0, angle.cos() * along_m);
    // How far it is to the end of each piece: equal angles are no equal lengths.
    let angle_of = |piece: usize| TAU * piece as f64 / PIECES as f64;
    let length_m = |piece: usize| at(angle_of(piece)).distance(at(angle_of(piece + 1)));
    let ends_m: Vec<f64> = (0..PIECES)
        .scan(0.0, |sum, piece| {
            *sum += length_m(piece);
            Some(*sum)
        })
        .collect();
    let round_m = ends_m[PIECES - 1];
    let step_m = PACE_M_PER_S * subject.scale() / rate_hz;
    move |frame| {
        let walked_m = (frame as f64 * step_m) % round_m;
        let piece = ends_m.partition_point(|end| *end <= walked_m).min(PIECES - 1);
        let start_m = if piece == 0 { 0.0 } else { ends_m[piece - 1] };
        let share = (walked_m - start_m) / (ends_m[piece] - start_m);
        let angle = TAU * (piece as f64 + share) / PIECES as f64;
        Stand::looking(at(angle), DVec3::new(angle.cos() * across_m, 0.0, -angle.sin() * along_m))
    }
}
