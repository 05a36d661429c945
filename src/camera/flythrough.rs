//! `flythrough`: from outside through the middle of a scene and out again.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{Stand, Subject};

/// How long a flight takes where that gives a sensible speed, seconds.
const FLIGHT_S: f64 = 12.0;
/// Sensible speeds, metres of the room a second.
const MIN_M_PER_S: f64 = 20.0;
const MAX_M_PER_S: f64 = 50.0;
/// Where the flight starts and ends: so many half diagonals of the scene from its middle.
const OUTSIDE: f64 = 1.5;
/// How much higher it is there, and how far it swings aside on the way, in half diagonals.
const LIFT: f64 = 0.3;
const SWING: f64 = 0.15;

/// Frames of a flight of 12 s, or of as many as make it no slower than 20 and no faster than 50 m/s of the room.
pub fn frames(subject: &Subject, rate_hz: f64) -> usize {
    let length_m = 2.0 * OUTSIDE * subject.radius_m() / subject.scale();
    let speed_m_per_s = (length_m / FLIGHT_S).clamp(MIN_M_PER_S, MAX_M_PER_S);
    (length_m / speed_m_per_s * rate_hz).ceil() as usize + 1
}

/// The flight in so many frames, along the scene's longer horizontal axis: down from outside, through the middle at the
/// middle of the flight, and up and out again, looking ahead.
pub fn walk(subject: &Subject, frames: usize) -> impl Fn(usize) -> Stand + use<> {
    let (center, size, radius_m) = (subject.center(), subject.size(), subject.radius_m());
    let (along, aside) = if size.x > size.z { (DVec3::X, DVec3::Z) } else { (DVec3::NEG_Z, DVec3::X) };
    let last = frames.max(2) - 1;
    move |frame| {
        let t = 2.0 * frame as f64 / last as f64 - 1.0;
        let phase = TAU * t / 2.0;
        let eye = center + (along * OUTSIDE * t + DVec3::Y * LIFT * t * t + aside * SWING * phase.sin()) * radius_m;
        let ahead = along * OUTSIDE + DVec3::Y * LIFT * 2.0 * t + aside * SWING * phase.cos() * TAU / 2.0;
        Stand::looking(eye, ahead)
    }
}
