//! A scene as poses change it, and what each view sees of it.

use std::sync::Arc;

use mullion_common::scene::Package;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::Wall;

use super::queue::Questions;
use super::why::Snapshot;
use crate::cull::{Algorithm, Culler};
use crate::service::Pose;
use crate::tree::{Bounds, DynamicScene};

/// Questions answered in one frame: each takes a copy of what some views see.
const MAX_ANSWERS: usize = 4;

/// Culls a scene whose objects stand, come and go as poses say. The same poses give the same sets, bit for bit.
pub struct LiveScene {
    algorithm: Algorithm,
    wall: Arc<Wall>,
    scene: DynamicScene,
    culler: Culler,
    questions: Option<Questions>,
}

impl LiveScene {
    /// A package's scene before its first frame.
    pub fn new(algorithm: Algorithm, wall: &Arc<Wall>, package: &Arc<Package>) -> Self {
        let culler = Culler::new(algorithm, wall);
        let scene = DynamicScene::new(Arc::clone(package), Bounds::default());
        Self { algorithm, wall: Arc::clone(wall), scene, culler, questions: None }
    }

    /// Answers questions after each frame.
    #[must_use]
    pub fn answering(mut self, questions: Questions) -> Self {
        self.questions = Some(questions);
        self
    }

    /// Does what a pose says, and finds what each view sees; `sets` by `ViewId`.
    pub fn cull(&mut self, pose: &Pose, sets: &mut [VisibleSet]) {
        pose.presence.iter().for_each(|(object, presence)| self.scene.set_presence(*object, *presence));
        pose.moved.iter().for_each(|moved| self.scene.move_object(moved.object, &moved.transform.affine()));
        self.scene.refit(self.algorithm.tree_form());
        self.culler.cull(self.scene.tree(), &self.wall, &pose.eyes, &pose.world_from_room, sets);
        if let Some(questions) = &self.questions {
            for (subject, on_snapshot) in std::iter::from_fn(|| questions.next()).take(MAX_ANSWERS) {
                let view = (pose.eyes.as_slice(), &pose.world_from_room);
                on_snapshot(Snapshot::take(subject, pose.number, &self.wall, &self.scene, view, sets));
            }
        }
    }
}
