//! `interior`: a walk through a scene at walking pace.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use mullion_common::geometry::Aabb;

use super::{Stand, Subject};

/// Length of the walk if nobody says: [`OPEN_S`] at 60 Hz.
pub const FRAMES: usize = 600;
/// Metres of the room that someone walks in a second.
const PACE_M_PER_S: f64 = 1.4;
/// How long the walk's start keeps away from things, as far as the round allows.
const OPEN_S: f64 = 10.0;
/// Places on the round where it may start.
const STARTS: usize = 256;
/// Least half-axis of the round, metres of the room.
const MIN_HALF_M: f64 = 1.0;
/// The round's shorter half-axis is at least this share of the longer: turns at its ends stay smooth.
const MIN_ROUNDNESS: f64 = 0.5;
/// Pieces that the round is measured in.
const PIECES: usize = 4096;

/// Along the [`Round`] at 1.4 m/s of the room, whatever the number of frames, looking ahead.
pub fn walk(subject: &Subject, rate_hz: f64) -> impl Fn(usize) -> Stand + use<> {
    let round = Round::through(subject);
    let step_m = PACE_M_PER_S * subject.scale() / rate_hz;
    move |frame| round.stand(frame as f64 * step_m)
}

/// An ellipse through the populated places, level, at eye height over the scene's floor: in the box of the middle half of
/// the leaves. It knows no walls and goes through them, as the cull does; only its start is chosen in the open.
pub struct Round {
    middle: DVec3,
    across_m: f64,
    along_m: f64,
    /// How far it is to the end of each piece: equal angles are no equal lengths.
    ends_m: Vec<f64>,
    start_m: f64,
}

impl Round {
    /// The round of a scene.
    pub fn through(subject: &Subject) -> Self {
        let half_m = subject.core().size() * 0.5;
        let least_m = (half_m.x.max(half_m.z) * MIN_ROUNDNESS).max(MIN_HALF_M * subject.scale());
        let middle = DVec3 { y: subject.eye_height_y(), ..subject.core().center() };
        let (across_m, along_m) = (half_m.x.max(least_m), half_m.z.max(least_m));
        let mut round = Self { middle, across_m, along_m, ends_m: Vec::with_capacity(PIECES), start_m: 0.0 };
        let mut sum_m = 0.0;
        for piece in 0..PIECES {
            sum_m += round.at(angle_of(piece, 0.0)).distance(round.at(angle_of(piece, 1.0)));
            round.ends_m.push(sum_m);
        }
        round.start_m = round.open_start_m(subject);
        round
    }

    /// Who has walked so far from the start, metres of the world, looking ahead.
    pub fn stand(&self, walked_m: f64) -> Stand {
        let angle = self.angle(self.start_m + walked_m);
        Stand::looking(self.at(angle), DVec3::new(angle.cos() * self.across_m, 0.0, -angle.sin() * self.along_m))
    }

    fn at(&self, angle: f64) -> DVec3 {
        self.middle + DVec3::new(angle.sin() * self.across_m, 0.0, angle.cos() * self.along_m)
    }

    fn length_m(&self) -> f64 {
        self.ends_m[PIECES - 1]
    }

    fn angle(&self, along_m: f64) -> f64 {
        let along_m = along_m % self.length_m();
        let piece = self.ends_m.partition_point(|end| *end <= along_m).min(PIECES - 1);
        let piece_starts_m = if piece == 0 { 0.0 } else { self.ends_m[piece - 1] };
        angle_of(piece, (along_m - piece_starts_m) / (self.ends_m[piece] - piece_starts_m))
    }

    /// Of all starts the first whose first seconds keep furthest away from things at eye height.
    fn open_start_m(&self, subject: &Subject) -> f64 {
        let spacing_m = self.length_m() / STARTS as f64;
        let obstacles: Vec<&Aabb> = subject.at_eye_height().collect();
        let clear_m: Vec<f64> = (0..STARTS).map(|k| clearance_m(self.at(self.angle(k as f64 * spacing_m)), &obstacles)).collect();
        let window = (PACE_M_PER_S * OPEN_S * subject.scale() / spacing_m).ceil().clamp(1.0, STARTS as f64) as usize;
        let least_m = |k: usize| (k..=k + window).map(|k| clear_m[k % STARTS]).fold(f64::INFINITY, f64::min);
        let best = (0..STARTS).rev().max_by(|a, b| least_m(*a).total_cmp(&least_m(*b))).unwrap_or(0);
        best as f64 * spacing_m
    }
}

fn angle_of(piece: usize, share: f64) -> f64 {
    TAU * (piece as f64 + share) / PIECES as f64
}

/// How far away the nearest of the boxes is, seen from above; 0 inside one.
fn clearance_m(place: DVec3, boxes: &[&Aabb]) -> f64 {
    let away = |aabb: &&Aabb| {
        let beyond = (aabb.min - place).max(place - aabb.max);
        DVec2::new(beyond.x, beyond.z).max(DVec2::ZERO).length()
    };
    boxes.iter().map(away).fold(f64::INFINITY, f64::min)
}
