//! An [`Outbox`] between the master's loop and the task that writes to one peer.

use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use crate::master::{Full, Message, Outbox};

#[derive(Debug, Default)]
struct Inner {
    outbox: Outbox,
    /// Memory of messages that were written, to be used again.
    spent: Option<Vec<u8>>,
    is_closed: bool,
}

/// What comes of a message that was queued.
pub(super) struct Queued {
    /// Memory to be used again.
    pub buffers: [Option<Vec<u8>>; 2],
    /// How many messages wait now.
    pub waiting: usize,
}

#[derive(Debug, Default)]
pub(super) struct Mailbox {
    inner: Mutex<Inner>,
    changed: Notify,
}

impl Mailbox {
    /// Queues a message.
    pub fn push(&self, message: Message) -> Result<Queued, Full> {
        let mut inner = self.lock();
        let replaced = inner.outbox.push(message)?;
        let (spent, waiting) = (inner.spent.take(), inner.outbox.waiting());
        drop(inner);
        self.changed.notify_one();
        Ok(Queued { buffers: [replaced.map(|m| m.bytes), spent], waiting })
    }

    /// What waits is written, then [`Mailbox::next`] ends.
    pub fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_one();
    }

    /// The next message to write; `None` after the last.
    pub async fn next(&self) -> Option<Message> {
        loop {
            {
                let mut inner = self.lock();
                if let Some(message) = inner.outbox.pop() {
                    return Some(message);
                }
                if inner.is_closed {
                    return None;
                }
            }
            self.changed.notified().await;
        }
    }

    /// Takes back the memory of a message that was written.
    pub fn spent(&self, bytes: Vec<u8>) {
        self.lock().spent = Some(bytes);
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Nothing that runs under the lock can panic halfway.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
