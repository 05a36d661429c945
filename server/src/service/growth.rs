//! A scene that grows while it is shown.
//!
//! ```text
//! Offer::new, elsewhere → the camera's pose → propose_epoch … the standby prepares …
//!   → begin_epoch, the cull's pose … nodes prepare; the cull follows along … → Pose::grows, enter_epoch
//! ```
//! What is dear is done before, on another thread: the joined package, its tree, the bytes that nodes fetch.

use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

use glam::DAffine3;
use mullion_common::scene::{ObjectId, Package, PackageError};
use mullion_common::wire::Insertion;
use thiserror::Error;

use super::grown::Joined;
use super::{Pose, Service, ServiceError};
use crate::library::content_hash;
use crate::prepare::GraftError;
use crate::tree::{Bounds, DynamicScene, Presence};

/// What became of an offer.
#[derive(Debug)]
pub enum Outcome {
    /// It is seen from this frame on.
    Begun(u64),
    /// It is not, for a reason of one line. What was offered comes back: its memory takes time to be given back, and not between two frames.
    Refused(String, Arc<Offer>),
    /// The scene before: its memory takes time to be given back.
    Retired(Box<DynamicScene>),
}

/// Why there is nothing to offer.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum OfferError {
    #[error(transparent)]
    Graft(#[from] GraftError),
    #[error(transparent)]
    Package(#[from] PackageError),
    #[error(transparent)]
    Service(#[from] ServiceError),
}

/// A scene that has grown, ready to be shown in the place of the one that it grew from.
pub struct Offer {
    /// What it grew from.
    base: Arc<Package>,
    joined: Joined,
    scene: Mutex<Option<DynamicScene>>,
    is_followed: AtomicBool,
    outcomes: Sender<Outcome>,
}

impl Offer {
    /// Joins `added` to the scene that is shown. Takes long. What becomes of it comes to the receiver; nothing does where the show ends.
    ///
    /// # Errors
    /// When the two cannot be joined, or what is new is larger than nodes take.
    pub fn new(
        base: &Arc<Package>,
        added: &Package,
        name: &str,
        under: Option<ObjectId>,
        world_from_root: DAffine3,
    ) -> Result<(Self, Receiver<Outcome>), OfferError> {
        let (outcomes, receiver) = channel();
        let insertion = Insertion {
            package: name.to_owned(),
            hash: content_hash(added)?,
            under,
            world_from_root: world_from_root.to_cols_array(),
        };
        let joined = Joined::new(base, added, insertion)?;
        let scene = DynamicScene::new(Arc::clone(&joined.package), Bounds::default());
        let is_followed = AtomicBool::new(false);
        let offer = Self { base: Arc::clone(base), joined, scene: Mutex::new(Some(scene)), is_followed, outcomes };
        Ok((offer, receiver))
    }

    /// What is inserted.
    pub fn insertion(&self) -> &Insertion {
        &self.joined.insertion
    }

    /// The whole scene, with what is inserted.
    pub fn package(&self) -> &Arc<Package> {
        &self.joined.package
    }

    /// The numbers of the objects that are new; the first stands above the others.
    pub fn objects(&self) -> Range<u32> {
        self.joined.objects.clone()
    }

    /// The scene as it was prepared; once.
    pub fn take_scene(&self) -> Option<DynamicScene> {
        self.scene.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// All that was done to the scene before is done to this one, too, and goes on being so: it may be shown.
    pub fn note_followed(&self) {
        self.is_followed.store(true, Ordering::Relaxed);
    }

    /// Gives it back to whoever made it.
    pub(crate) fn refuse(self: Arc<Self>, reason: String) {
        let outcomes = self.outcomes.clone();
        let _ = outcomes.send(Outcome::Refused(reason, self)); // nobody wants to know
    }

    /// Tells what became of it, whoever still wants to know.
    pub fn tell(&self, outcome: Outcome) {
        let _ = self.outcomes.send(outcome);
    }
}

impl PartialEq for Offer {
    fn eq(&self, other: &Self) -> bool {
        self.joined.insertion == other.joined.insertion
    }
}

impl fmt::Debug for Offer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Offer").field("insertion", self.insertion()).field("objects", &self.objects()).finish_non_exhaustive()
    }
}

impl Service {
    /// Tells standbys of what a frame's pose offers, then nodes and the cull, and lets that scene begin with this frame, if all are
    /// prepared for it.
    pub(super) fn grow(&mut self, number: u64, pose: &mut Pose) {
        let now = self.now();
        if let Some(offer) = pose.offer.take() {
            if Arc::ptr_eq(&offer.base, self.grown.package()) {
                match self.master.propose_epoch(offer.insertion().clone(), &offer.joined.sections, now) {
                    Ok(()) => self.proposed = Some(offer),
                    Err(error) => offer.refuse(error.to_string()),
                }
            } else {
                offer.refuse("the scene is another one than it was joined to".to_owned());
            }
        }
        if self.proposed.is_some()
            && let Some(answer) = self.master.standbys_follow(now)
            && let Some(offer) = self.proposed.take()
        {
            match answer {
                Ok(()) => {
                    self.master.begin_epoch(now);
                    self.blobs.grow(Arc::clone(offer.package()), Arc::clone(&offer.joined.part));
                    self.offered = Some(Arc::clone(&offer));
                    pose.offer = Some(offer);
                }
                Err(reason) => offer.refuse(reason),
            }
        }
        let is_due = |offer: &mut Arc<Offer>| offer.is_followed.load(Ordering::Relaxed) && self.master.is_epoch_due(now);
        let begins = self.offered.take_if(is_due);
        pose.grows = begins.is_some();
        if let Some(offer) = begins {
            self.master.enter_epoch();
            self.master.know_objects(Arc::clone(&offer.joined.object_leaves));
            if let Some(budget) = self.show.options.budget {
                self.master.know_triangles(budget.of(offer.joined.triangles), offer.joined.triangles);
            }
            self.grown.grow(&offer.joined);
            // It is seen, whatever it is part of was removed; masters after this one hear of it.
            pose.presence.insert(0, (ObjectId(offer.objects().start), Presence::There));
            offer.tell(Outcome::Begun(number));
        }
    }
}
