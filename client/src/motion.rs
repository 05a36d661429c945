//! Where the camera will be: the shared eye and the room's turn, carried on as they moved lately. Pure.

use glam::{DAffine3, DMat3, DQuat, DVec3};

/// Least time over which speed is measured: trackers tremble.
const MEASURED_OVER_S: f64 = 0.1;
/// Most that the room is thought to turn on, radians: what a quick turn will show next is to one side, not behind it.
const MOST_TURN_RAD: f64 = std::f64::consts::FRAC_PI_2;

/// An eye, and how the room around it is turned in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// World space, metres.
    pub eye: DVec3,
    /// The turn of `world_from_room`.
    pub world_from_room: DQuat,
}

/// The camera's way through the last frames. Forgets nothing by itself but what a newer sample replaces.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// The newest sample, and two from [`MEASURED_OVER_S`] apart, the older in front.
    newest: Option<(u64, Pose)>,
    samples: [Option<(u64, Pose)>; 2],
}

impl Motion {
    /// Takes a frame's pose. A pose that is not finite, or a room without size, is left out; a number below the last means that frames
    /// are counted anew.
    ///
    /// `rate_hz`: the show's, frames a second.
    pub fn note(&mut self, frame: u64, rate_hz: f64, eye: DVec3, world_from_room: &DAffine3) {
        let Some(turn) = turn_of(world_from_room).filter(|_| eye.is_finite()) else { return };
        if self.newest.is_some_and(|(newest, _)| frame <= newest) {
            *self = Self::default();
        }
        let sample = Some((frame, Pose { eye, world_from_room: turn }));
        self.newest = sample;
        if self.samples[1].is_none_or(|(last, _)| (frame - last) as f64 >= MEASURED_OVER_S * rate_hz) {
            self.samples = [self.samples[1], sample];
        }
    }

    /// Where the camera will be in `seconds` at the speed and the turn that it has; `None` before the first frame.
    ///
    /// `rate_hz`: the show's, frames a second; one that is not above 0 counts as no motion.
    pub fn ahead(&self, seconds: f64, rate_hz: f64) -> Option<Pose> {
        let (frame, now) = self.newest?;
        let (since, then) = self.samples[0].or(self.samples[1]).unwrap_or((frame, now));
        let passed_s = (frame - since) as f64 / rate_hz;
        if !(passed_s > 0.0 && passed_s.is_finite()) {
            return Some(now);
        }
        let share = seconds / passed_s;
        let mut turned = now.world_from_room * then.world_from_room.inverse();
        if turned.w < 0.0 {
            turned = -turned; // the shorter way round
        }
        let turn = (turned.to_scaled_axis() * share).clamp_length_max(MOST_TURN_RAD);
        let eye = now.eye + (now.eye - then.eye) * share;
        let world_from_room = (DQuat::from_scaled_axis(turn) * now.world_from_room).normalize();
        Some(Pose { eye, world_from_room }).filter(|pose| pose.eye.is_finite() && pose.world_from_room.is_finite()).or(Some(now))
    }
}

/// The turn of a similarity.
fn turn_of(world_from_room: &DAffine3) -> Option<DQuat> {
    let scale = world_from_room.matrix3.determinant().cbrt();
    let turn = DMat3::from_cols_array(&world_from_room.matrix3.to_cols_array().map(|v| v / scale));
    let turn = (scale > 0.0 && turn.is_finite()).then(|| DQuat::from_mat3(&turn).normalize())?;
    turn.is_finite().then_some(turn)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HZ: f64 = 60.0;

    fn walk(frames: std::ops::Range<u64>, pose: impl Fn(f64) -> (DVec3, DAffine3)) -> Motion {
        let mut motion = Motion::default();
        for frame in frames {
            let (eye, world_from_room) = pose(frame as f64 / HZ);
            motion.note(frame, HZ, eye, &world_from_room);
        }
        motion
    }

    #[test]
    fn a_steady_walk_and_turn_are_carried_on() {
        let pose = |t: f64| {
            let eye = DVec3::new(3.0 * t, 1.5, -2.0 * t);
            (eye, DAffine3::from_scale_rotation_translation(DVec3::splat(20.0), DQuat::from_rotation_y(0.4 * t), eye))
        };
        for last in [2, 7, 30, 200] {
            let (ahead, wanted) = (walk(0..last, pose).ahead(1.0, HZ).unwrap(), pose((last - 1) as f64 / HZ + 1.0));
            assert!(ahead.eye.distance(wanted.0) < 1e-9, "{last}: {}", ahead.eye);
            let turn = DQuat::from_rotation_y(0.4 * ((last - 1) as f64 / HZ + 1.0));
            assert!(ahead.world_from_room.angle_between(turn) < 1e-6, "{last}");
        }
    }

    #[test]
    fn what_rests_stays_and_quick_turns_are_bounded() {
        assert_eq!(Motion::default().ahead(1.0, HZ), None);
        let still = walk(0..20, |_| (DVec3::X, DAffine3::IDENTITY)).ahead(1.0, HZ).unwrap();
        assert_eq!((still.eye, still.world_from_room.angle_between(DQuat::IDENTITY)), (DVec3::X, 0.0));
        let quick = walk(0..20, |t| (DVec3::X, DAffine3::from_rotation_y(9.0 * t)));
        let turned = quick.ahead(1.0, HZ).unwrap().world_from_room.angle_between(DQuat::from_rotation_y(9.0 * 19.0 / HZ));
        assert!((turned - MOST_TURN_RAD).abs() < 1e-6, "{turned}");
    }

    #[test]
    fn poses_that_are_none_and_frames_counted_anew_do_no_harm() {
        let mut motion = walk(0..20, |t| (DVec3::X * t, DAffine3::IDENTITY));
        let before = motion.ahead(1.0, HZ);
        motion.note(20, HZ, DVec3::NAN, &DAffine3::IDENTITY);
        motion.note(20, HZ, DVec3::ZERO, &DAffine3::from_scale(DVec3::ZERO));
        assert_eq!(motion.ahead(1.0, HZ), before);
        for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(motion.ahead(1.0, rate_hz).is_some_and(|pose| pose.eye.is_finite()));
        }
        motion.note(0, HZ, DVec3::Y, &DAffine3::IDENTITY);
        assert_eq!(motion.ahead(1.0, HZ).map(|pose| pose.eye), Some(DVec3::Y), "another show's eye was elsewhere");
    }
}
