//! How a show goes from one master to the next: what the service knows of it, and whoever steers the show must.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

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
    heritage: Mutex<Option<Course>>,
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

    /// This master drives the show from now on, and goes on from there: a course with all that moved, came or went.
    pub fn take_over(&self, course: Course) {
        *self.0.heritage.lock().unwrap_or_else(PoisonError::into_inner) = Some(course);
        self.0.is_heir.store(true, Ordering::Release);
        self.0.is_standing_by.store(false, Ordering::Release);
    }

    /// What the camera goes on from; once.
    pub(crate) fn heritage(&self) -> Option<Course> {
        if !self.0.is_heir.swap(false, Ordering::AcqRel) {
            return None;
        }
        self.0.heritage.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
