//! Session numbers, and the chunk connections that they open.

use mullion_common::scene::ChunkHash;
use mullion_common::wire::{Bye, ByeCode, ChunkHello};

use super::admission::Claim;
use super::{Master, NodeState, Output, Peer, PeerId};
use crate::swap_barrier::NodeIndex;

impl Master {
    pub(super) fn open_chunks(&mut self, peer: PeerId, hello: ChunkHello) {
        let is_meant = |n: &NodeState| n.connection.as_ref().is_some_and(|c| c.session == hello.session);
        let Some(index) = self.nodes.iter().position(is_meant) else {
            return self.dismiss(peer, Bye::new(ByeCode::UnknownSession, "no node here has that session number"));
        };
        let holder = self.nodes[index].connection.as_ref().and_then(|c| c.identity.as_ref());
        if let Err(bye) = self.admit(peer, Claim::ChunksOf(&self.nodes[index].name, holder)) {
            return self.dismiss(peer, bye);
        }
        let Some(connection) = &mut self.nodes[index].connection else { return };
        let old = connection.chunk_peer.replace(peer);
        self.peers.insert(peer, Peer::Chunks(NodeIndex(index as u16)));
        if let Some(old) = old {
            self.peers.remove(&old);
            let bye = Bye::new(ByeCode::AlreadyConnected, "a newer chunk connection took its place");
            self.outputs.push_back(Output::Close { peer: old, bye });
        }
        self.outputs.push_back(Output::ServeChunks { peer });
    }

    pub(super) fn new_session(&mut self) -> u64 {
        self.sessions += 1;
        let mut bytes = [0; 40];
        bytes[..32].copy_from_slice(&self.options.session_seed);
        bytes[32..].copy_from_slice(&self.sessions.to_le_bytes());
        let [a, b, c, d, e, f, g, h, ..] = ChunkHash::of(&bytes).0;
        u64::from_le_bytes([a, b, c, d, e, f, g, h])
    }
}
