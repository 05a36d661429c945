//! A scene as poses change it, and what each view sees of it.

use std::sync::Arc;
use std::thread;

use mullion_common::scene::Package;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::Wall;

use super::queue::Questions;
use super::why::Snapshot;
use crate::cull::{Algorithm, Culler};
use crate::service::{Offer, Outcome, Pose};
use crate::tree::{Bounds, CarryOver, DynamicScene};

/// Questions answered in one frame: each takes a copy of what some views see.
const MAX_ANSWERS: usize = 4;

struct Next {
    offer: Arc<Offer>,
    scene: DynamicScene,
    carry: CarryOver,
}

/// Culls a scene whose objects stand, come and go as poses say. The same poses give the same sets, bit for bit.
pub struct LiveScene {
    algorithm: Algorithm,
    wall: Arc<Wall>,
    scene: DynamicScene,
    /// A scene that has grown from it and is not shown yet.
    next: Option<Next>,
    culler: Culler,
    questions: Option<Questions>,
}

impl LiveScene {
    /// A package's scene before its first frame.
    pub fn new(algorithm: Algorithm, wall: &Arc<Wall>, package: &Arc<Package>) -> Self {
        let culler = Culler::new(algorithm, wall);
        let scene = DynamicScene::new(Arc::clone(package), Bounds::default());
        Self { algorithm, wall: Arc::clone(wall), scene, next: None, culler, questions: None }
    }

    /// Answers questions after each frame.
    #[must_use]
    pub fn answering(mut self, questions: Questions) -> Self {
        self.questions = Some(questions);
        self
    }

    /// Does what a pose says, and finds what each view sees; `sets` by `ViewId`.
    pub fn cull(&mut self, pose: &Pose, sets: &mut [VisibleSet]) {
        self.grow(pose);
        change(&mut self.scene, pose);
        self.scene.refit(self.algorithm.tree_form());
        if let Some(next) = &mut self.next {
            change(&mut next.scene, pose);
            if next.carry.step(&self.scene, &mut next.scene) {
                next.offer.note_followed();
            }
            next.scene.refit(self.algorithm.tree_form());
        }
        self.culler.cull(self.scene.tree(), &self.wall, &pose.eyes, &pose.world_from_room, sets);
        if let Some(questions) = &self.questions {
            for (subject, on_snapshot) in std::iter::from_fn(|| questions.next()).take(MAX_ANSWERS) {
                let view = (pose.eyes.as_slice(), &pose.world_from_room);
                on_snapshot(Snapshot::take(subject, pose.number, &self.wall, &self.scene, view, sets));
            }
        }
    }

    /// Begins with the scene that was offered or inherited, where its time has come, and takes what is offered.
    fn grow(&mut self, pose: &Pose) {
        if let Some(scene) = pose.begins_with.as_ref().and_then(|fresh| fresh.take()) {
            let before = (std::mem::replace(&mut self.scene, scene), self.next.take());
            // Its memory takes time to be given back.
            let _ = thread::Builder::new().name("retire".to_owned()).spawn(move || drop(before)); // without a thread, here and now
        }
        if let Some(Next { offer, scene, .. }) = self.next.take_if(|_| pose.grows) {
            let before = std::mem::replace(&mut self.scene, scene);
            offer.tell(Outcome::Retired(Box::new(before)));
        }
        if let Some(offer) = &pose.offer {
            let next = |scene| Next { offer: Arc::clone(offer), scene, carry: CarryOver::default() };
            self.next = offer.take_scene().map(next);
        }
    }
}

/// Does to a scene what a pose says.
fn change(scene: &mut DynamicScene, pose: &Pose) {
    pose.presence.iter().for_each(|(object, presence)| scene.set_presence(*object, *presence));
    pose.moved.iter().for_each(|moved| scene.move_object(moved.object, &moved.transform.affine()));
}
