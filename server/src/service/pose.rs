//! Where everything is in a frame, and whether nodes can be told.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use mullion_common::scene::ObjectId;
use mullion_common::wire::{Budget, Moved, Steering};

use super::{FreshScene, Offer};
use crate::tree::Presence;

/// Where everything is in one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pose {
    /// The frame's number. The service sets it, whatever the camera says.
    pub number: u64,
    /// Time in the scene, seconds.
    pub scene_time_s: f64,
    /// Where the room is in the world.
    pub world_from_room: DAffine3,
    /// Where each view's eye is, room space, metres; by `ViewId`. Each must pass
    /// [`Wall::check_eye`](mullion_common::wall::Wall::check_eye): from behind a screen, or from nearer than the near
    /// plane, there is no frustum through it, and cull and picture are wrong. The service does not check that.
    pub eyes: Vec<DVec3>,
    /// Objects that have another transform than in the frame before. Nodes draw them where they now stand; the show's cull must
    /// move them, too, as [`DynamicScene`](crate::tree::DynamicScene) does.
    pub moved: Vec<Moved>,
    /// Objects that come or go with all below them, in this order. For the show's cull alone: nodes are told by what views see.
    pub presence: Vec<(ObjectId, Presence)>,
    /// What each view may spend, by `ViewId`; empty: nothing is limited.
    pub budgets: Vec<Budget>,
    /// How commands hold time and room: for masters that stand by.
    pub steering: Steering,
    /// A scene that has grown from the one that is shown, or will be by the offer before: nodes prepare for it, and the show's cull must
    /// follow it, as [`LiveScene`](crate::control::LiveScene) does.
    pub offer: Option<Arc<Offer>>,
    /// Whether the scene offered last is seen from this frame on. The service's word, not the camera's.
    pub grows: bool,
    /// What the cull is to show from this frame on in the place of all before: the scene of a master whose place this one took. The
    /// service's word, too.
    pub begins_with: Option<Arc<FreshScene>>,
}

impl Pose {
    /// The eye that all views share: the middle of their eyes, in the world.
    pub fn shared_eye(&self) -> DVec3 {
        let sum: DVec3 = self.eyes.iter().sum();
        self.world_from_room.transform_point3(sum / self.eyes.len().max(1) as f64)
    }

    /// Whether nodes take it: an eye for each of `views` views, finite numbers, and objects that are among the first
    /// `objects`.
    ///
    /// # Errors
    /// Names what is wrong, in one line.
    pub fn check(&self, views: usize, objects: usize) -> Result<(), String> {
        if self.eyes.len() != views {
            return Err(format!("eyes: {}; the wall has {views} views", self.eyes.len()));
        }
        let finite = |what: &str, is_finite| if is_finite { Ok(()) } else { Err(format!("{what} is not finite")) };
        if !self.budgets.is_empty() && self.budgets.len() != views {
            return Err(format!("budgets: {}; the wall has {views} views", self.budgets.len()));
        }
        if let Some((object, _)) = self.presence.iter().find(|(object, _)| object.0 as usize >= objects) {
            return Err(format!("object {} comes or goes; the scene has {objects}", object.0));
        }
        finite("scene_time_s", self.scene_time_s.is_finite())?;
        finite("world_from_room", self.world_from_room.is_finite())?;
        for (view, eye) in self.eyes.iter().enumerate() {
            finite(&format!("the eye of view {view}"), eye.is_finite())?;
        }
        finite("the middle of the eyes in the world", self.shared_eye().is_finite())?;
        for Moved { object, transform } in &self.moved {
            if object.0 as usize >= objects {
                return Err(format!("object {} moved; the scene has {objects}", object.0));
            }
            finite(&format!("the transform of object {}", object.0), transform.is_finite())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mullion_common::scene::Transform;

    #[test]
    fn a_pose_that_nodes_would_leave_over_is_refused_by_name() {
        let moved = |object, x| {
            let transform = Transform::from(DAffine3::from_translation(DVec3::new(x, 1.0, 2.0)));
            Moved { object: ObjectId(object), transform }
        };
        let good = Pose { eyes: vec![DVec3::X, DVec3::Y], moved: vec![moved(2, 4.0)], ..Pose::default() };
        assert_eq!(good.check(2, 3), Ok(()));
        let far = DVec3::splat(f64::MAX);
        let bad = [
            (Pose { eyes: vec![DVec3::X], ..good.clone() }, "eyes: 1; the wall has 2 views"),
            (Pose { scene_time_s: f64::NAN, ..good.clone() }, "scene_time_s is not finite"),
            (
                Pose { world_from_room: DAffine3::from_translation(DVec3::Z * f64::INFINITY), ..good.clone() },
                "world_from_room is not finite",
            ),
            (Pose { eyes: vec![DVec3::X, DVec3::NAN], ..good.clone() }, "the eye of view 1 is not finite"),
            (Pose { eyes: vec![far, far], ..good.clone() }, "the middle of the eyes in the world is not finite"),
            (Pose { moved: vec![moved(0, 1.0), moved(3, 1.0)], ..good.clone() }, "object 3 moved; the scene has 3"),
            (Pose { budgets: vec![Budget::default(); 3], ..good.clone() }, "budgets: 3; the wall has 2 views"),
            (Pose { presence: vec![(ObjectId(3), Presence::Away)], ..good.clone() }, "object 3 comes or goes; the scene has 3"),
            (Pose { moved: vec![moved(1, f64::NAN)], ..good.clone() }, "the transform of object 1 is not finite"),
        ];
        for (pose, problem) in bad {
            assert_eq!(pose.check(2, 3), Err(problem.to_owned()));
        }
    }
}
