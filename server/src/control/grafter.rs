//! Inserts packages of a library into the scene, one after the other, on a thread of its own.

use std::io;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;

use mullion_common::control::{Inserted, ObjectRange};

use super::check::{Checker, ControlError, Wanted};
use crate::library::Library;
use crate::service::{Offer, Outcome};

/// Most insertions that wait for the one before.
pub const MAX_INSERTIONS: usize = 8;

/// Is told what became of an insertion.
pub type OnInserted = Box<dyn FnOnce(Result<Inserted, ControlError>) + Send>;

/// Where insertions wait.
#[derive(Clone)]
pub(super) struct Grafter {
    queue: SyncSender<(Wanted, OnInserted)>,
}

impl Grafter {
    /// Starts the thread. It ends when nobody can ask it any more.
    pub fn start(library: Library, checker: Checker, offers: SyncSender<Arc<Offer>>) -> io::Result<Self> {
        let (queue, wanted) = sync_channel(MAX_INSERTIONS);
        let work = move || Work { packages: library, checker, offers }.run(&wanted);
        thread::Builder::new().name("insert".to_owned()).spawn(work)?;
        Ok(Self { queue })
    }

    /// Queues an insertion.
    pub fn insert(&self, wanted: Wanted, on_inserted: OnInserted) -> Result<(), ControlError> {
        self.queue.try_send((wanted, on_inserted)).map_err(|error| match error {
            TrySendError::Full(_) => ControlError::ManyInsertions,
            TrySendError::Disconnected(_) => ControlError::Over,
        })
    }
}

struct Work {
    packages: Library,
    checker: Checker,
    offers: SyncSender<Arc<Offer>>,
}

impl Work {
    fn run(&self, queue: &Receiver<(Wanted, OnInserted)>) {
        for (wanted, on_inserted) in queue {
            let (result, outcomes) = match self.insert(&wanted) {
                Ok((inserted, outcomes)) => (Ok(inserted), Some(outcomes)),
                Err(error) => (Err(error), None),
            };
            on_inserted(result);
            // The old scene is dropped here, not between two frames.
            outcomes.into_iter().for_each(|outcomes| outcomes.iter().for_each(drop));
        }
    }

    /// Until it is seen, or is known not to be.
    fn insert(&self, wanted: &Wanted) -> Result<(Inserted, Receiver<Outcome>), ControlError> {
        let Wanted { package, under, world_from_root } = wanted;
        let refused = |problem: String| ControlError::Insertion { problem };
        let added = self.packages.read(package).map_err(|error| refused(error.to_string()))?;
        let base = self.checker.package();
        let (offer, outcomes) =
            Offer::new(&base, &added, package, *under, *world_from_root).map_err(|error| refused(error.to_string()))?;
        drop((added, base));
        let (objects, grown) = (offer.objects(), Arc::clone(offer.package()));
        self.offers.send(Arc::new(offer)).map_err(|_| ControlError::Over)?;
        let frame = match outcomes.recv() {
            Ok(Outcome::Begun(frame)) => frame,
            Ok(Outcome::Refused(problem, _)) => return Err(refused(problem)),
            Ok(Outcome::Retired(_)) | Err(_) => return Err(ControlError::Over),
        };
        self.checker.grow(grown);
        let objects = ObjectRange { first: objects.start, count: objects.len() as u32 };
        Ok((Inserted { frame, objects }, outcomes))
    }
}
