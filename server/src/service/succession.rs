//! How a show goes from one master to the next: what the service knows of it, and whoever steers the show must.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use mullion_common::scene::Package;
use mullion_common::wire::Course;

/// Shared by a show's service, its camera, and who takes commands for it.
#[derive(Clone, Debug, Default)]
pub struct Succession(Arc<State>);

#[derive(Debug, Default)]
struct State {
    is_standing_by: AtomicBool,
    reign: AtomicU64,
    /// Whether there is a heritage: a frame that has none takes no lock.
    is_heir: AtomicBool,
    heritage: Mutex<Option<Heritage>>,
}

/// What a master goes on from.
#[derive(Clone, Debug)]
pub struct Heritage {
    /// With all that moved, came or went.
    pub course: Course,
    /// The scene as it has grown.
    pub package: Arc<Package>,
}

impl Succession {
    /// Whether another master drives the show.
    pub fn is_standing_by(&self) -> bool {
        self.0.is_standing_by.load(Ordering::Acquire)
    }

    /// How often this master began to stand by: commands of an earlier reign hold no more.
    pub fn reign(&self) -> u64 {
        self.0.reign.load(Ordering::Acquire)
    }

    /// Another master drives the show from now on.
    pub fn stand_by(&self) {
        self.0.is_standing_by.store(true, Ordering::Release);
        // Who read the new number finds that this master stands by.
        self.0.reign.fetch_add(1, Ordering::AcqRel);
    }

    /// This master drives the show from its next frame on, and goes on from there.
    pub fn take_over(&self, heritage: Heritage) {
        *self.0.heritage.lock().unwrap_or_else(PoisonError::into_inner) = Some(heritage);
        self.0.is_heir.store(true, Ordering::Release);
    }

    /// The camera goes on from what it inherited, and commands are checked by that: they may come.
    pub(crate) fn drive(&self) {
        self.0.is_standing_by.store(false, Ordering::Release);
    }

    /// What the camera goes on from; once.
    pub(crate) fn heritage(&self) -> Option<Heritage> {
        if !self.0.is_heir.swap(false, Ordering::AcqRel) {
            return None;
        }
        self.0.heritage.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
