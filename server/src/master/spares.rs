//! Nodes that stand in for those that are missing, until these are back.

use std::time::Duration;

use mullion_common::identity::Bearer;
use mullion_common::wire::{ALIVE_EVERY, Bye, ByeCode, Hello, Pong, SILENCE_LIMIT, ToMaster, ToTile};

use super::admission::Claim;
use super::{Holder, Kind, Master, Message, Output, Peer, PeerId, TAKEOVER_AFTER};
use crate::swap_barrier::NodeIndex;

/// How long a node must have been missing before a spare takes its place: one that is started again at once keeps it.
pub const SPARE_AFTER: Duration = Duration::from_secs(1);

/// A spare that has no place.
#[derive(Debug)]
pub(super) struct Spare {
    peer: PeerId,
    name: String,
    /// Whom its certificate is for.
    identity: Option<Bearer>,
    heard: Duration,
    said: Duration,
}

impl Master {
    pub(super) fn greet_spare(&mut self, peer: PeerId, hello: &Hello, now: Duration) {
        if let Err(bye) = self.admit(peer, Claim::Spare(&hello.node)) {
            return self.dismiss(peer, bye);
        }
        if self.spares.len() >= self.nodes.len() {
            return self.dismiss(peer, Bye::new(ByeCode::TooMany, "there is a spare for every node already"));
        }
        let identity = self.shown_by(peer).cloned();
        self.peers.insert(peer, Peer::Spare);
        self.spares.push(Spare { peer, name: hello.node.clone(), identity, heard: now, said: now });
    }

    /// A message of a spare that has no place came in.
    pub(super) fn handle_spare(&mut self, peer: PeerId, message: &ToMaster, now: Duration) {
        let Some(spare) = self.spares.iter_mut().find(|s| s.peer == peer) else { return };
        spare.heard = now;
        match message {
            ToMaster::Ready { frame, .. } => {
                let reason = format!("ready with frame {frame}, but it has no place yet");
                self.dismiss(peer, Bye::new(ByeCode::Malformed, reason));
            }
            ToMaster::Ping(ping) => {
                let pong = Pong { at_us: ping.at_us, master_us: now.as_micros() as u64 };
                self.send_to_spare(peer, &ToTile::Pong(pong), now);
            }
            ToMaster::Unprepared { .. } => self.dismiss(peer, Bye::new(ByeCode::Malformed, "a spare is no standby")),
            ToMaster::Prepared { .. } | ToMaster::Stats(_) | ToMaster::Counted(_) => {}
            ToMaster::Bye(bye) => self.drop_peer(peer, bye.clone()),
        }
    }

    /// Keeps spares informed, lets go of silent ones, and fills places that have been empty long enough.
    pub(super) fn mind_spares(&mut self, now: Duration) {
        if self.spares.is_empty() {
            return;
        }
        while let Some(silent) = self.spares.iter().find(|s| now >= s.heard + SILENCE_LIMIT).map(|s| s.peer) {
            let reason = format!("silent for {} s", SILENCE_LIMIT.as_secs());
            self.dismiss(silent, Bye::new(ByeCode::Timeout, reason));
        }
        for index in 0..self.nodes.len() {
            if self.spares.is_empty() {
                return;
            }
            let node = &self.nodes[index];
            if now < node.missing_at() {
                continue;
            }
            if let Some(peer) = node.connection.as_ref().map(|c| c.peer) {
                self.dismiss(peer, Bye::new(ByeCode::Timeout, "silent, and a spare took its place"));
            }
            let Spare { peer, name, identity, .. } = self.spares.remove(0);
            let node = NodeIndex(index as u16);
            self.seat((peer, identity), node, Holder::Spare, now);
            self.outputs.push_back(Output::StoodIn { node, spare: name });
        }
        for quiet in 0..self.spares.len() {
            if now >= self.spares[quiet].said + ALIVE_EVERY {
                self.send_to_spare(self.spares[quiet].peer, &ToTile::Alive, now);
            }
        }
    }

    /// When [`Master::mind_spares`] has something to do.
    pub(super) fn spares_timeout(&self) -> Option<Duration> {
        if self.spares.is_empty() {
            return None;
        }
        let of_spares = self.spares.iter().map(|s| (s.heard + SILENCE_LIMIT).min(s.said + ALIVE_EVERY));
        of_spares.chain(self.nodes.iter().map(super::NodeState::missing_at)).min()
    }

    pub(super) fn forget_spare(&mut self, peer: PeerId) {
        self.spares.retain(|s| s.peer != peer);
    }

    pub(super) fn spare_name(&self, peer: PeerId) -> Option<&str> {
        self.spares.iter().find(|s| s.peer == peer).map(|s| s.name.as_str())
    }

    fn send_to_spare(&mut self, peer: PeerId, message: &ToTile, now: Duration) {
        let mut bytes = self.pool.pop().unwrap_or_default();
        if message.encode(&mut bytes).is_ok() {
            self.outputs.push_back(Output::Send { peer, message: Message { kind: Kind::Alive, bytes } });
            self.spares.iter_mut().filter(|s| s.peer == peer).for_each(|s| s.said = now);
        }
    }
}

impl super::NodeState {
    /// When a spare may take its place.
    fn missing_at(&self) -> Duration {
        match &self.connection {
            Some(connection) => connection.heard + TAKEOVER_AFTER,
            None => self.absent_since + SPARE_AFTER,
        }
    }
}
