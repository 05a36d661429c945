//! Inserts packages of a library into the scene, one after the other, on a thread of its own.

use std::io;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;

use mullion_common::control::{Inserted, ObjectRange};

use super::check::{Checker, ControlError, Wanted};
use crate::library::Library;
use crate::service::{Offer, Outcome, Succession};

/// Most insertions that wait for the one before.
pub const MAX_INSERTIONS: usize = 8;

/// Why what was wanted before another master drove the show is not inserted.
pub(super) const OTHER_REIGN: &str = "another master drove the show meanwhile";

/// Is told what became of an insertion.
pub type OnInserted = Box<dyn FnOnce(Result<Inserted, ControlError>) + Send>;

/// What is wanted, and in which reign of this master.
pub(super) type WantedIn = (Wanted, u64);

/// Where insertions wait.
#[derive(Clone)]
pub(super) struct Grafter {
    queue: SyncSender<(WantedIn, OnInserted)>,
}

impl Grafter {
    /// Starts the thread. It ends when nobody can ask it any more.
    pub fn start(
        library: Library,
        (checker, succession): (Checker, Succession),
        offers: SyncSender<(Arc<Offer>, u64)>,
    ) -> io::Result<Self> {
        let (queue, wanted) = sync_channel(MAX_INSERTIONS);
        let work = move || Work { packages: library, checker, succession, offers }.run(&wanted);
        thread::Builder::new().name("insert".to_owned()).spawn(work)?;
        Ok(Self { queue })
    }

    /// Queues an insertion.
    pub fn insert(&self, wanted: WantedIn, on_inserted: OnInserted) -> Result<(), ControlError> {
        self.queue.try_send((wanted, on_inserted)).map_err(|error| match error {
            TrySendError::Full(_) => ControlError::ManyInsertions,
            TrySendError::Disconnected(_) => ControlError::Over,
        })
    }
}

struct Work {
    packages: Library,
    checker: Checker,
    succession: Succession,
    offers: SyncSender<(Arc<Offer>, u64)>,
}

impl Work {
    fn run(&self, queue: &Receiver<(WantedIn, OnInserted)>) {
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
    fn insert(&self, (wanted, reign): &WantedIn) -> Result<(Inserted, Receiver<Outcome>), ControlError> {
        let Wanted { package, under, world_from_root } = wanted;
        let refused = |problem: String| ControlError::Insertion { problem };
        if *reign != self.succession.reign() {
            return Err(refused(OTHER_REIGN.to_owned()));
        }
        let added = self.packages.read(package).map_err(|error| refused(error.to_string()))?;
        let base = self.checker.package();
        let (offer, outcomes) =
            Offer::new(&base, &added, package, *under, *world_from_root).map_err(|error| refused(error.to_string()))?;
        drop((added, base));
        let (objects, grown) = (offer.objects(), Arc::clone(offer.package()));
        self.offers.send((Arc::new(offer), *reign)).map_err(|_| ControlError::Over)?;
        let frame = match outcomes.recv() {
            Ok(Outcome::Begun(frame)) => frame,
            Ok(Outcome::Refused(problem, _)) => return Err(refused(problem)),
            Ok(Outcome::Retired(_)) | Err(_) => return Err(ControlError::Over),
        };
        if *reign == self.succession.reign() {
            self.checker.grow(grown);
        }
        let objects = ObjectRange { first: objects.start, count: objects.len() as u32 };
        Ok((Inserted { frame, objects }, outcomes))
    }
}
