//! Masters that stand by to take this one's place: they are told where the show stands, frame by frame.

use std::time::Duration;

use mullion_common::wire::{Bye, ByeCode, Insertions, SILENCE_LIMIT, StandbyHello, ToMaster, ToStandby, WireError};

use super::admission::Claim;
use super::{Kind, Master, Message, Output, Peer, PeerId, TAKEOVER_AFTER};

/// Most standbys at once: two would both take this one's place. A further one stands by for the standby.
pub const MAX_STANDBYS: usize = 1;

/// How often a standby is told something at least, so that it soon finds that this master is gone.
pub const TELL_STANDBYS_EVERY: Duration = Duration::from_millis(100);

#[derive(Debug)]
pub(super) struct Standby {
    peer: PeerId,
    heard: Duration,
    said: Duration,
    acked: Option<u64>,
    /// The newest epoch that it can take over, 0 before it has said so.
    prepared: u32,
}

impl Master {
    pub(super) fn greet_standby(&mut self, peer: PeerId, hello: &StandbyHello, now: Duration) {
        if let Err(bye) = self.admit(peer, Claim::Master) {
            return self.dismiss(peer, bye);
        }
        if let Some(bye) = self.other_show(hello) {
            return self.dismiss(peer, bye);
        }
        // One that is connected again may be heard before its old connection is found to be lost.
        if let Some(silent) = self.standbys.iter().find(|s| now >= s.heard + TAKEOVER_AFTER).map(|s| s.peer) {
            self.dismiss(silent, Bye::new(ByeCode::Timeout, "silent, and another standby took its place"));
        }
        if self.standbys.len() >= MAX_STANDBYS {
            let reason = "a master stands by already: stand by for that one";
            return self.dismiss(peer, Bye::new(ByeCode::TooMany, reason));
        }
        self.peers.insert(peer, Peer::Standby);
        self.standbys.push(Standby { peer, heard: now, said: now, acked: None, prepared: 0 });
        self.send_insertions(now);
        self.send_courses(now);
    }

    /// Why a master with another wall or scene is not listened to.
    pub(super) fn other_show(&self, hello: &StandbyHello) -> Option<Bye> {
        match StandbyHello::of(&self.wall, self.first_sections()) {
            Err(error) => Some(Bye::new(ByeCode::Failed, error.to_string())),
            Ok(own) if own.wall != hello.wall => Some(Bye::new(ByeCode::Refused, "the two masters have different walls")),
            Ok(own) if own.scene != hello.scene => Some(Bye::new(ByeCode::Refused, "the two masters have different scenes")),
            Ok(_) => None,
        }
    }

    /// A message of a standby came in.
    pub(super) fn handle_standby(&mut self, peer: PeerId, message: ToMaster, now: Duration) {
        let newest = self.epoch + u32::from(self.next_insertion().is_some());
        let Some(standby) = self.standbys.iter_mut().find(|s| s.peer == peer) else { return };
        standby.heard = now;
        match message {
            ToMaster::Ready { frame, .. } => standby.acked = standby.acked.max(Some(frame)),
            ToMaster::Prepared { epoch } | ToMaster::Unprepared { epoch, .. } if epoch > newest => {
                let reason = format!("it speaks of epoch {epoch}, but the newest is {newest}");
                self.dismiss(peer, Bye::new(ByeCode::Malformed, reason));
            }
            ToMaster::Prepared { epoch } => standby.prepared = epoch,
            ToMaster::Unprepared { epoch, reason } => {
                let refusal = format!("the master that stands by cannot follow: {reason}");
                if epoch <= self.epoch || !self.refuse_epoch(refusal) {
                    self.dismiss(peer, Bye::new(ByeCode::Refused, reason));
                }
            }
            ToMaster::Ping(_) | ToMaster::Stats(_) | ToMaster::Counted(_) => {}
            ToMaster::Bye(bye) => self.drop_peer(peer, bye),
        }
    }

    /// Tells every standby what the scene grew by, and what it is to grow by next.
    pub(super) fn send_insertions(&mut self, now: Duration) {
        let entered = self.options.insertions.len() as u32;
        let list = self.options.insertions.iter().chain(self.next_insertion()).cloned().collect();
        let insertions = ToStandby::Insertions(Insertions { entered, list });
        for at in 0..self.standbys.len() {
            // What it prepared for and was refused is another scene than the next.
            self.standbys[at].prepared = self.standbys[at].prepared.min(self.epoch);
            let mut bytes = self.pool.pop().unwrap_or_default();
            let encoded = insertions.encode(&mut bytes);
            self.put_to_standby(at, encoded, Message { kind: Kind::Control, bytes }, now);
        }
    }

    pub(super) fn are_standbys_prepared(&self, epoch: u32) -> bool {
        self.standbys.iter().all(|standby| standby.prepared >= epoch)
    }

    /// Tells every standby where the show stands, if it has begun.
    pub(super) fn send_courses(&mut self, now: Duration) {
        for at in 0..self.standbys.len() {
            if self.history.course(self.standbys[at].acked, self.epoch, &mut self.course) {
                let mut bytes = self.pool.pop().unwrap_or_default();
                let encoded = self.course.encode(&mut bytes);
                self.put_to_standby(at, encoded, Message { kind: Kind::Frame, bytes }, now);
            }
        }
    }

    /// Lets go of silent standbys, and says something to the others.
    pub(super) fn mind_standbys(&mut self, now: Duration) {
        while let Some(silent) = self.standbys.iter().find(|s| now >= s.heard + SILENCE_LIMIT).map(|s| s.peer) {
            let reason = format!("silent for {} s", SILENCE_LIMIT.as_secs());
            self.dismiss(silent, Bye::new(ByeCode::Timeout, reason));
        }
        for at in 0..self.standbys.len() {
            if now >= self.standbys[at].said + TELL_STANDBYS_EVERY {
                let mut bytes = self.pool.pop().unwrap_or_default();
                let encoded = ToStandby::Alive.encode(&mut bytes);
                self.put_to_standby(at, encoded, Message { kind: Kind::Alive, bytes }, now);
            }
        }
    }

    /// When [`Master::mind_standbys`] has something to do.
    pub(super) fn standbys_timeout(&self) -> Option<Duration> {
        self.standbys.iter().map(|s| (s.heard + SILENCE_LIMIT).min(s.said + TELL_STANDBYS_EVERY)).min()
    }

    pub(super) fn forget_standby(&mut self, peer: PeerId) {
        self.standbys.retain(|s| s.peer != peer);
    }

    fn put_to_standby(&mut self, at: usize, encoded: Result<(), WireError>, message: Message, now: Duration) {
        let standby = &mut self.standbys[at];
        match encoded {
            Ok(()) => {
                standby.said = now;
                self.outputs.push_back(Output::Send { peer: standby.peer, message });
            }
            // Too many moved objects for one message: it stands by with what it has.
            Err(error) => tracing::warn!("cannot tell the standby where the show stands: {error}"),
        }
    }
}
