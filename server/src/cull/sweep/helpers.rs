//! Threads that sweep a share of the tree each.
//!
//! They live as long as the culler. What a share needs travels to its thread and back in one piece, so that nothing is
//! allocated, borrowed or locked in between.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use mullion_common::visible_set::VisibleSet;

use super::kernel::{Memory, Sweep, ToSets, Visit};
use super::lanes;
use super::lattice::Lattice;
use crate::cull::CullStats;
use crate::tree::WideTree;

/// A share of a sweep, and what came of it.
#[derive(Default)]
pub(super) struct Share {
    pub tree: Option<Arc<WideTree>>,
    pub lattice: Lattice,
    pub start: Vec<Visit>,
    pub sets: Vec<VisibleSet>,
    pub stats: CullStats,
    memory: Memory,
}

impl Share {
    /// Sweeps it. Lets go of the tree.
    fn run(&mut self) {
        let Some(tree) = self.tree.take() else {
            return;
        };
        self.sets.iter_mut().for_each(VisibleSet::clear);
        let sink = ToSets { lattice: &self.lattice, sets: &mut self.sets };
        let (lattice, start, memory) = (&self.lattice, self.start.as_slice(), &mut self.memory);
        self.stats = lanes::run_on_best(Sweep { tree: &tree, lattice, start, memory, sink });
    }
}

/// A thread that waits for shares.
pub(super) struct Helper {
    to: Option<SyncSender<Box<Share>>>,
    from: Receiver<Box<Share>>,
    /// Here while the thread does not have it.
    share: Option<Box<Share>>,
    thread: Option<JoinHandle<()>>,
}

impl Helper {
    /// Starts a thread.
    ///
    /// # Errors
    /// When the system gives none.
    pub(super) fn start() -> std::io::Result<Self> {
        let (to, jobs) = sync_channel::<Box<Share>>(1);
        let (done, from) = sync_channel(1);
        let thread = thread::Builder::new().name("cull".to_owned()).spawn(move || {
            while let Ok(mut share) = jobs.recv() {
                share.run();
                if done.send(share).is_err() {
                    return;
                }
            }
        })?;
        Ok(Self { to: Some(to), from, share: Some(Box::default()), thread: Some(thread) })
    }

    /// Fills the share and sends it off.
    pub(super) fn send(&mut self, fill: impl FnOnce(&mut Share)) {
        let mut share = self.share.take().unwrap_or_default();
        fill(&mut share);
        if let Some(to) = &self.to {
            // A thread that is gone leaves its share here, to be swept on this one.
            self.share = to.send(share).err().map(|unsent| unsent.0);
        }
    }

    /// Waits for the share that was sent.
    pub(super) fn wait(&mut self) -> &Share {
        let mut share = match self.share.take() {
            Some(unsent) => unsent,
            None => match self.from.recv() {
                Ok(share) => share,
                // Its thread panicked, and the share is lost with it: as if this thread had.
                Err(_) => match self.thread.take().map(JoinHandle::join) {
                    Some(Err(panic)) => std::panic::resume_unwind(panic),
                    _ => Box::default(),
                },
            },
        };
        share.run(); // what no thread has done
        self.share.insert(share)
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        self.to = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // a panic there was passed on by `wait`
        }
    }
}
