//! A scene that grows while it is shown: nodes are told of the next epoch, and it begins on all of them with one frame.
//!
//! ```text
//! propose_epoch → Insertions to the standby … Prepared … → standbys_follow
//!   → begin_epoch → Manifest to every node … Prepared … → is_epoch_due → enter_epoch, begin_frame
//! ```

use std::sync::Arc;
use std::time::Duration;

use mullion_common::scene::SectionKind;
use mullion_common::wire::{Bye, ByeCode, Insertion, MAX_SECTIONS, Manifest, SectionRef, ToTile};
use thiserror::Error;

use super::{Kind, Master, ObjectLeaves, PeerId, Phase, WallBudget};
use crate::swap_barrier::{NodeIndex, Standing};

/// How long a standby may take to prepare for an epoch before nodes are told of it nevertheless, and how long live nodes may take then
/// before it begins without those that have not fetched what is new.
pub const EPOCH_WAIT: Duration = Duration::from_secs(10);

/// The epoch that standbys, then nodes are preparing for.
#[derive(Debug)]
pub(super) struct NextEpoch {
    insertion: Insertion,
    /// Of the whole scene.
    sections: Vec<SectionRef>,
    stage: Stage,
    deadline: Duration,
}

#[derive(Debug, PartialEq, Eq)]
enum Stage {
    /// Standbys know of it.
    Proposed,
    /// One of them cannot follow.
    Refused(String),
    /// Nodes know of it.
    Begun,
}

/// Why a scene does not grow now.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum EpochError {
    #[error("the wall is preparing for another insertion")]
    Busy,
    #[error("the scene has grown as often as it may")]
    TooMany,
}

impl Master {
    /// Tells standbys that the scene is to grow by these sections, one of each kind. Frames go on as they are until [`Master::enter_epoch`].
    ///
    /// # Errors
    /// When that cannot be now; then nobody is told anything.
    pub fn propose_epoch(&mut self, insertion: Insertion, added: &[SectionRef], now: Duration) -> Result<(), EpochError> {
        if self.next_epoch.is_some() {
            return Err(EpochError::Busy);
        }
        let sections: Vec<SectionRef> = self.options.sections.iter().chain(added).copied().collect();
        if sections.len() > MAX_SECTIONS {
            return Err(EpochError::TooMany);
        }
        self.next_epoch = Some(NextEpoch { insertion, sections, stage: Stage::Proposed, deadline: now + EPOCH_WAIT });
        self.send_insertions(now);
        Ok(())
    }

    /// Whether standbys are prepared for what was proposed, or the wait for them is over; `None`: not yet.
    ///
    /// # Errors
    /// With the reason of the one that cannot follow. Then nothing is proposed any more.
    pub fn standbys_follow(&mut self, now: Duration) -> Option<Result<(), String>> {
        let next = self.next_epoch.take_if(|next| matches!(next.stage, Stage::Refused(_)));
        if let Some(NextEpoch { stage: Stage::Refused(reason), .. }) = next {
            return Some(Err(reason));
        }
        let next = self.next_epoch.as_ref()?;
        (now >= next.deadline || self.are_standbys_prepared(self.epoch + 1)).then_some(Ok(()))
    }

    /// Tells nodes of the epoch that was proposed.
    ///
    /// # Panics
    /// When there is no such epoch: the shell is wrong.
    pub fn begin_epoch(&mut self, now: Duration) {
        let is_alone = !self.are_standbys_prepared(self.epoch + 1);
        let next = self.next_epoch.as_mut().expect("an epoch was proposed");
        if is_alone {
            let (package, wait) = (&next.insertion.package, EPOCH_WAIT.as_secs());
            tracing::warn!("the standby was not prepared for {package:?} within {wait} s: it would take over without that");
        }
        (next.stage, next.deadline) = (Stage::Begun, now + EPOCH_WAIT);
        for node in (0..self.nodes.len() as u16).map(NodeIndex) {
            self.send_next_epoch(node, now);
        }
    }

    /// Whether the next epoch may begin: all live nodes are prepared for it, or the wait is over.
    pub fn is_epoch_due(&self, now: Duration) -> bool {
        let Some(next) = self.begun_epoch() else { return false };
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
        let next = self.next_epoch.take().filter(|next| next.stage == Stage::Begun).expect("an epoch was begun");
        self.options.sections = next.sections;
        self.options.insertions.push(next.insertion);
        self.epoch += 1;
        for node in (0..self.nodes.len() as u16).map(NodeIndex) {
            self.hold_back_unprepared(node);
        }
    }

    /// The scene that frames are of from now on has these objects.
    pub fn know_objects(&mut self, objects: Arc<ObjectLeaves>) {
        if let Some(contributions) = &mut self.contributions {
            contributions.grow(objects);
        }
    }

    /// The scene that frames are of from now on has so many triangles, and this budget.
    pub fn know_triangles(&mut self, budget: WallBudget, scene_triangles: u32) {
        if let Some(estimates) = &mut self.estimates {
            estimates.grow(budget, scene_triangles);
        }
    }

    /// Tells a node which scene frames are of, and which comes next.
    pub(super) fn send_manifests(&mut self, node: NodeIndex, now: Duration) {
        let manifest = self.manifest(self.epoch, &self.options.sections);
        self.send(node, &ToTile::Manifest(manifest), Kind::Control, now);
        self.send_next_epoch(node, now);
    }

    fn send_next_epoch(&mut self, node: NodeIndex, now: Duration) {
        if let Some(next) = self.begun_epoch() {
            let manifest = self.manifest(self.epoch + 1, &next.sections);
            self.send(node, &ToTile::Manifest(manifest), Kind::Control, now);
        }
    }

    fn manifest(&self, epoch: u32, sections: &[SectionRef]) -> Manifest {
        let tessellation = self.options.tessellation;
        let hierarchies = self.options.hierarchies.as_ref().map(|hierarchies| hierarchies.index);
        Manifest { epoch, sections: sections.to_vec(), tessellation, hierarchies }
    }

    /// A node says that it is prepared.
    pub(super) fn handle_prepared(&mut self, peer: PeerId, node: NodeIndex, epoch: u32) {
        let newest = self.epoch + u32::from(self.begun_epoch().is_some());
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

    /// A standby says that it cannot follow to the next epoch; whether that was still a question.
    pub(super) fn refuse_epoch(&mut self, reason: String) -> bool {
        let next = self.next_epoch.as_mut().filter(|next| next.stage == Stage::Proposed);
        next.map(|next| next.stage = Stage::Refused(reason)).is_some()
    }

    fn begun_epoch(&self) -> Option<&NextEpoch> {
        self.next_epoch.as_ref().filter(|next| next.stage == Stage::Begun)
    }

    /// What is to be inserted next, where nobody has refused it.
    pub(super) fn next_insertion(&self) -> Option<&Insertion> {
        self.next_epoch.as_ref().filter(|next| !matches!(next.stage, Stage::Refused(_))).map(|next| &next.insertion)
    }

    /// Sections of the scene that the show began with.
    pub(super) fn first_sections(&self) -> &[SectionRef] {
        let grown = self.options.insertions.len() * SectionKind::FOR_TILES.len();
        &self.options.sections[..self.options.sections.len() - grown]
    }

    /// Whether the wall is preparing for an epoch.
    pub(super) fn is_growing(&self) -> bool {
        self.next_epoch.is_some()
    }
}
