//! Masters that stand by to take this one's place: they are told where the show stands, frame by frame.

use std::time::Duration;

use mullion_common::wire::{Bye, ByeCode, SILENCE_LIMIT, StandbyHello, ToMaster, ToStandby, WireError};

use super::{Admission, Kind, Master, Message, Output, Peer, PeerId};

/// Most standbys at once.
pub const MAX_STANDBYS: usize = 2;

/// How often a standby is told something at least, so that it soon finds that this master is gone.
pub const TELL_STANDBYS_EVERY: Duration = Duration::from_millis(100);

#[derive(Debug)]
pub(super) struct Standby {
    peer: PeerId,
    heard: Duration,
    said: Duration,
    acked: Option<u64>,
}

impl Master {
    pub(super) fn greet_standby(&mut self, peer: PeerId, hello: &StandbyHello, now: Duration) {
        if self.admission == Admission::ByCertificate {
            let reason = "this master takes nodes with certificates only, and a standby has none";
            return self.dismiss(peer, Bye::new(ByeCode::Refused, reason));
        }
        let refusal = match StandbyHello::of(&self.wall, &self.options.sections) {
            Err(error) => Some((ByeCode::Failed, error.to_string())),
            Ok(own) if own.wall != hello.wall => Some((ByeCode::Refused, "the standby has another wall than its master".into())),
            Ok(own) if own.scene != hello.scene => {
                Some((ByeCode::Refused, "the standby has another scene than its master".into()))
            }
            Ok(_) if self.is_growing() => {
                Some((ByeCode::Refused, "the scene of its master grows, and it would have another".into()))
            }
            Ok(_) if self.standbys.len() >= MAX_STANDBYS => {
                Some((ByeCode::TooMany, format!("{MAX_STANDBYS} masters stand by already")))
            }
            Ok(_) => None,
        };
        if let Some((code, reason)) = refusal {
            return self.dismiss(peer, Bye::new(code, reason));
        }
        self.peers.insert(peer, Peer::Standby);
        self.standbys.push(Standby { peer, heard: now, said: now, acked: None });
        self.send_courses(now);
    }

    /// A message of a standby came in.
    pub(super) fn handle_standby(&mut self, peer: PeerId, message: ToMaster, now: Duration) {
        let Some(standby) = self.standbys.iter_mut().find(|s| s.peer == peer) else { return };
        standby.heard = now;
        match message {
            ToMaster::Ready { frame, .. } => standby.acked = standby.acked.max(Some(frame)),
            ToMaster::Prepared { .. } | ToMaster::Ping(_) | ToMaster::Stats(_) => {}
            ToMaster::Bye(bye) => self.drop_peer(peer, bye),
        }
    }

    /// Tells every standby where the show stands, if it has begun.
    pub(super) fn send_courses(&mut self, now: Duration) {
        for at in 0..self.standbys.len() {
            if self.history.course(self.standbys[at].acked, &mut self.course) {
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
