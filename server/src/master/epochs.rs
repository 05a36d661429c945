//! A scene that grows while it is shown: nodes are told of the next epoch, and it begins on all of them with one frame.
//!
//! ```text
//! begin_epoch → Manifest to every node … Prepared … → is_epoch_due → enter_epoch, begin_frame
//! ```

use std::time::Duration;

use mullion_common::wire::{Bye, ByeCode, MAX_SECTIONS, Manifest, SectionRef, ToTile};
use thiserror::Error;

use super::{Kind, Master, PeerId, Phase};
use crate::swap_barrier::{NodeIndex, Standing};

/// How long live nodes may take to fetch what is new before the epoch begins without those that have not.
pub const EPOCH_WAIT: Duration = Duration::from_secs(10);

/// The epoch that nodes are preparing for.
#[derive(Debug)]
pub(super) struct NextEpoch {
    sections: Vec<SectionRef>,
    deadline: Duration,
}

/// Why a scene does not grow now.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum EpochError {
    #[error("a master stands by, and cannot follow: it does not have what is inserted")]
    Standby,
    #[error("nodes are preparing for another insertion")]
    Busy,
    #[error("the scene has grown as often as it may")]
    TooMany,
}

impl Master {
    /// Tells nodes that the scene grows by these sections, one of each kind. Frames go on as they are until [`Master::enter_epoch`].
    ///
    /// # Errors
    /// When that cannot be now; then nobody is told anything.
    pub fn begin_epoch(&mut self, added: &[SectionRef], now: Duration) -> Result<(), EpochError> {
        if !self.standbys.is_empty() {
            return Err(EpochError::Standby);
        }
        if self.next_epoch.is_some() {
            return Err(EpochError::Busy);
        }
        let sections: Vec<SectionRef> = self.options.sections.iter().chain(added).copied().collect();
        if sections.len() > MAX_SECTIONS {
            return Err(EpochError::TooMany);
        }
        self.next_epoch = Some(NextEpoch { sections, deadline: now + EPOCH_WAIT });
        for node in (0..self.nodes.len() as u16).map(NodeIndex) {
            self.send_next_epoch(node, now);
        }
        Ok(())
    }

    /// Whether the next epoch may begin: all live nodes are prepared for it, or the wait is over.
    pub fn is_epoch_due(&self, now: Duration) -> bool {
        let Some(next) = &self.next_epoch else { return false };
        let is_awaited =
            |node: NodeIndex| self.barrier.standing(node) == Standing::Live && !self.is_prepared(node, self.epoch + 1);
        now >= next.deadline || !(0..self.nodes.len() as u16).map(NodeIndex).any(is_awaited)
    }

    /// Begins the epoch that nodes were told of: the frame that is wanted is its first. A live node that is not prepared is not waited for
    /// until it is.
    ///
    /// # Panics
    /// When there is no such epoch, or no frame is wanted: the shell is wrong.
    pub fn enter_epoch(&mut self) {
        assert!(self.phase == Phase::Wanted, "an epoch begins with a frame");
        self.options.sections = self.next_epoch.take().expect("an epoch was begun").sections;
        self.epoch += 1;
        for node in (0..self.nodes.len() as u16).map(NodeIndex) {
            self.hold_back_unprepared(node);
        }
    }

    /// Tells a node which scene frames are of, and which comes next.
    pub(super) fn send_manifests(&mut self, node: NodeIndex, now: Duration) {
        let manifest = Manifest { epoch: self.epoch, sections: self.options.sections.clone() };
        self.send(node, &ToTile::Manifest(manifest), Kind::Control, now);
        self.send_next_epoch(node, now);
    }

    fn send_next_epoch(&mut self, node: NodeIndex, now: Duration) {
        if let Some(next) = &self.next_epoch {
            let manifest = Manifest { epoch: self.epoch + 1, sections: next.sections.clone() };
            self.send(node, &ToTile::Manifest(manifest), Kind::Control, now);
        }
    }

    /// A node says that it is prepared.
    pub(super) fn handle_prepared(&mut self, peer: PeerId, node: NodeIndex, epoch: u32) {
        let newest = self.epoch + u32::from(self.next_epoch.is_some());
        if epoch > newest {
            let reason = format!("prepared for epoch {epoch}, but the newest is {newest}");
            return self.dismiss(peer, Bye::new(ByeCode::Malformed, reason));
        }
        if let Some(connection) = &mut self.nodes[usize::from(node.0)].connection {
            connection.prepared = connection.prepared.max(epoch);
        }
    }

    /// Whether an epoch's first frame would find the node with all that it takes.
    fn is_prepared(&self, node: NodeIndex, epoch: u32) -> bool {
        self.nodes[usize::from(node.0)].connection.as_ref().is_some_and(|connection| connection.prepared >= epoch)
    }

    /// What a node says of old frames does not make it one that is waited for, as long as it cannot draw new ones.
    pub(super) fn hold_back_unprepared(&mut self, node: NodeIndex) {
        if !self.is_prepared(node, self.epoch) {
            self.barrier.hold_back(node);
        }
    }

    /// Whether nodes are preparing for an epoch.
    pub(super) fn is_growing(&self) -> bool {
        self.next_epoch.is_some()
    }
}
