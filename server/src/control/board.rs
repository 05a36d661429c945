//! How a show stands, for whoever wants to know.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, TryLockError};

use mullion_common::control::{NodeStanding, NodeStatus, Status};
use mullion_common::wall::Wall;
use tokio::sync::Notify;

use super::driver::Clock;
use crate::service::FrameReport;
use crate::swap_barrier::Standing;

/// The newest status. A frame that finds it being read leaves it as it is: the next one comes soon.
pub struct Board {
    clock: Arc<Clock>,
    latest: Mutex<Status>,
    /// How often frames went on without each node.
    passed_over: Vec<AtomicU64>,
    changed: Notify,
}

impl Board {
    /// Before the first frame.
    pub fn new(wall: &Wall, clock: Arc<Clock>) -> Self {
        let node = |name: &String| NodeStatus { name: name.clone(), standing: NodeStanding::Absent, passed_over: 0 };
        let nodes = wall.nodes().iter().map(|n| node(&n.name)).collect();
        let passed_over = wall.nodes().iter().map(|_| AtomicU64::new(0)).collect();
        let latest = Status { rate_hz: wall.rate_hz(), nodes, ..Status::default() };
        Self { clock, latest: Mutex::new(latest), passed_over, changed: Notify::new() }
    }

    /// Takes down a frame that was released. Never waits, and allocates nothing.
    pub fn note(&self, frame: &FrameReport) {
        for node in &frame.passed_over {
            self.passed_over[usize::from(node.0)].fetch_add(1, Ordering::Relaxed);
        }
        let mut status = match self.latest.try_lock() {
            Ok(status) => status,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return,
        };
        status.frame = frame.number;
        status.frames = frame.number + 1;
        status.path_frame = self.clock.path_frame();
        status.is_paused = self.clock.is_paused();
        status.connected = frame.connected;
        for (node, standing) in status.nodes.iter_mut().zip(&frame.standings) {
            node.standing = match standing {
                Standing::Absent => NodeStanding::Absent,
                Standing::Trying => NodeStanding::Trying,
                Standing::Live => NodeStanding::Live,
            };
        }
        for (node, count) in status.nodes.iter_mut().zip(&self.passed_over) {
            node.passed_over = count.load(Ordering::Relaxed);
        }
        drop(status);
        self.changed.notify_waiters();
    }

    /// The newest status.
    pub fn latest(&self) -> Status {
        let latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Status { is_standing_by: self.clock.is_standing_by(), ..latest }
    }

    /// The status of another frame than `seen`, the count of frames that the caller knows of. Counts go back where a master stepped back
    /// and takes over again.
    pub async fn after(&self, seen: u64) -> Status {
        loop {
            let changed = self.changed.notified();
            let status = self.latest();
            if status.frames != seen {
                return status;
            }
            changed.await;
        }
    }
}
