//! `pan`: standing in a scene and turning.

use glam::DVec3;

use super::{Stand, Subject};

/// Length of the turn if nobody says: once round.
pub const FRAMES: usize = 360;

/// In the middle of the populated places, at eye height over the scene's floor, turning left by one degree a frame.
pub fn walk(subject: &Subject) -> impl Fn(usize) -> Stand + use<> {
    let eye = DVec3 { y: subject.eye_height_y(), ..subject.core().center() };
    move |frame| {
        let angle = ((frame % FRAMES) as f64).to_radians();
        Stand::looking(eye, DVec3::new(-angle.sin(), 0.0, -angle.cos()))
    }
}
