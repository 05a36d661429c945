//! What waits for the next frame.
//!
//! Bounded by count, and so by bytes: a change has a fixed size. Taking from an empty queue is a few atomic reads.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use mullion_common::control::{Command, Insert, MAX_MOVES, decode_moves};
use mullion_common::scene::{ObjectId, Package};
use mullion_common::wall::{TileId, Wall};

use super::check::{Change, Checker, ControlError};
use super::grafter::{Grafter, OTHER_REIGN, OnInserted};
use super::why::Snapshot;
use crate::library::Library;
use crate::service::{Offer, Succession};

/// Most changes that wait for a frame, each eye counted.
pub const MAX_QUEUED: usize = 262_144;
/// Most batches of them.
const MAX_BATCHES: usize = 1024;
/// Most questions that wait for a frame.
const MAX_QUESTIONS: usize = 64;
const _: () = assert!(MAX_MOVES <= MAX_QUEUED, "a full message fits the queue");
const _: () = assert!(MAX_QUEUED * size_of::<Change>() <= 64 << 20, "the queue takes at most 64 MiB");

/// Is told the frame that takes a batch. Must be quick: the wall waits.
pub type OnTaken = Box<dyn FnOnce(u64) + Send>;
/// Is given what a question needs. Must be quick: the wall waits.
pub type OnSnapshot = Box<dyn FnOnce(Snapshot) + Send>;

struct Batch {
    changes: Vec<Change>,
    weight: usize,
    /// In which reign of this master it came in.
    reign: u64,
    on_taken: OnTaken,
}

/// What a question is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// An object and a tile.
    Tile(ObjectId, TileId),
    /// An object and the whole wall.
    Wall(ObjectId),
}

/// Where commands and questions come in.
#[derive(Clone)]
pub struct Inlet {
    checker: Checker,
    batches: SyncSender<Batch>,
    questions: SyncSender<Asked>,
    queued: Arc<AtomicUsize>,
    succession: Succession,
    offers: SyncSender<(Arc<Offer>, u64)>,
    grafter: Option<Grafter>,
}

/// Where frames take commands.
pub struct Batches {
    checker: Checker,
    receiver: Receiver<Batch>,
    queued: Arc<AtomicUsize>,
    succession: Succession,
    offers: Receiver<(Arc<Offer>, u64)>,
}

struct Asked {
    subject: Subject,
    /// In which reign of this master.
    reign: u64,
    on_snapshot: OnSnapshot,
}

/// Where frames take questions.
pub struct Questions {
    receiver: Receiver<Asked>,
    succession: Succession,
}

/// A queue for a wall that shows a package.
pub fn channel(wall: &Arc<Wall>, package: &Arc<Package>) -> (Inlet, Batches, Questions) {
    let (batches, batch_receiver) = sync_channel(MAX_BATCHES);
    let (questions, question_receiver) = sync_channel(MAX_QUESTIONS);
    let (offers, offer_receiver) = sync_channel(1);
    let queued = Arc::new(AtomicUsize::new(0));
    let checker = Checker::new(Arc::clone(wall), Arc::clone(package));
    let succession = Succession::default();
    let (queue, heirs, of_questions) = (Arc::clone(&queued), succession.clone(), succession.clone());
    let checks = checker.clone();
    let inlet = Inlet { checker, batches, questions, queued: queue, succession: heirs, offers, grafter: None };
    let batches = Batches { checker: checks, receiver: batch_receiver, queued, succession, offers: offer_receiver };
    (inlet, batches, Questions { receiver: question_receiver, succession: of_questions })
}

impl Inlet {
    /// What it checks by.
    pub fn checker(&self) -> &Checker {
        &self.checker
    }

    /// The same, but what a library holds may be inserted.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn inserting_from(mut self, library: Library) -> io::Result<Self> {
        let checker = (self.checker.clone(), self.succession.clone());
        self.grafter = Some(Grafter::start(library, checker, self.offers.clone())?);
        Ok(self)
    }

    /// Queues an insertion, which takes many frames.
    ///
    /// # Errors
    /// When it cannot be done, too many wait, or another master drives the show.
    pub fn insert(&self, insert: &Insert, on_inserted: OnInserted) -> Result<(), ControlError> {
        let grafter = self.grafter.as_ref().ok_or(ControlError::NoLibrary)?;
        let reign = self.succession.reign();
        if self.succession.is_standing_by() {
            return Err(ControlError::StandingBy);
        }
        grafter.insert((self.checker.insertion(insert)?, reign), on_inserted)
    }

    /// Queues commands, all for one frame.
    ///
    /// # Errors
    /// When one of them cannot be done, the queue is full, or another master drives the show: then none is.
    pub fn submit(&self, commands: &[Command], on_taken: OnTaken) -> Result<(), ControlError> {
        self.queue(|checker| checker.changes(commands), on_taken)
    }

    /// Queues moves, as [`mullion_common::control::encode_moves`] wrote them, all for one frame.
    ///
    /// # Errors
    /// As [`Inlet::submit`].
    pub fn submit_moves(&self, bytes: &[u8], on_taken: OnTaken) -> Result<(), ControlError> {
        self.queue(|checker| checker.moves(decode_moves(bytes)?), on_taken)
    }

    /// Queues a question about the frame that comes next.
    ///
    /// # Errors
    /// When the queue is full, or another master drives the show.
    pub fn ask(&self, subject: Subject, on_snapshot: OnSnapshot) -> Result<(), ControlError> {
        let reign = self.succession.reign();
        if self.succession.is_standing_by() {
            return Err(ControlError::StandingBy);
        }
        self.questions.try_send(Asked { subject, reign, on_snapshot }).map_err(|error| match error {
            TrySendError::Full(_) => ControlError::Full { queued: MAX_QUESTIONS, cap: MAX_QUESTIONS },
            TrySendError::Disconnected(_) => ControlError::Over,
        })
    }

    fn queue(
        &self,
        check: impl FnOnce(&Checker) -> Result<Vec<Change>, ControlError>,
        on_taken: OnTaken,
    ) -> Result<(), ControlError> {
        // Before the question, and that before the check: what comes in between is of a reign that is over, with a scene of its own.
        let reign = self.succession.reign();
        if self.succession.is_standing_by() {
            return Err(ControlError::StandingBy);
        }
        let changes = check(&self.checker)?;
        let weight = changes.iter().map(Change::weight).sum();
        let before = self.queued.fetch_add(weight, Ordering::Relaxed);
        let full = |queued| ControlError::Full { queued, cap: MAX_QUEUED };
        let result = if before + weight > MAX_QUEUED {
            Err(full(before))
        } else {
            self.batches.try_send(Batch { changes, weight, reign, on_taken }).map_err(|error| match error {
                TrySendError::Full(_) => full(before),
                TrySendError::Disconnected(_) => ControlError::Over,
            })
        };
        if result.is_err() {
            self.queued.fetch_sub(weight, Ordering::Relaxed);
        }
        result
    }
}

impl Batches {
    /// Takes all that waits for this frame, in order.
    pub(super) fn take(&self, frame: u64, mut change: impl FnMut(Change)) {
        // What comes in meanwhile waits for the next one.
        let reign = self.succession.reign();
        for batch in self.receiver.try_iter().take(MAX_BATCHES) {
            self.queued.fetch_sub(batch.weight, Ordering::Relaxed);
            if batch.reign == reign {
                batch.changes.into_iter().for_each(&mut change);
                (batch.on_taken)(frame);
            }
        }
    }

    pub(super) fn succession(&self) -> &Succession {
        &self.succession
    }

    /// What commands are checked by.
    pub(super) fn checker(&self) -> &Checker {
        &self.checker
    }

    /// A scene that has grown, if one is there.
    pub(super) fn take_offer(&self) -> Option<Arc<Offer>> {
        let (offer, reign) = self.offers.try_recv().ok()?;
        if reign == self.succession.reign() {
            return Some(offer);
        }
        offer.refuse(OTHER_REIGN.to_owned());
        None
    }
}

impl Questions {
    /// The next question, if any waits.
    pub(super) fn next(&self) -> Option<(Subject, OnSnapshot)> {
        let reign = self.succession.reign();
        let asked = self.receiver.try_iter().find(|asked| asked.reign == reign)?;
        Some((asked.subject, asked.on_snapshot))
    }
}
