//! `pan`: standing in a scene and turning.

use glam::DVec3;

use super::interior::Round;
use super::{Stand, Subject};

/// Length of the turn if nobody says: once round.
pub const FRAMES: usize = 360;

/// At the start of the walk through the populated places, turning left by one degree a frame.
pub fn walk(subject: &Subject) -> impl Fn(usize) -> Stand + use<> {
    let eye = Round::through(subject).stand(0.0).eye;
    move |frame| {
        let angle = ((frame % FRAMES) as f64).to_radians();
        Stand::looking(eye, DVec3::new(-angle.sin(), 0.0, -angle.cos()))
    }
}
