//! Two masters that drive the same wall, of which one is to stand by.

use mullion_common::wire::{Bye, ByeCode, RivalHello};

use super::admission::Claim;
use super::{Master, Output, PeerId};
use crate::swap_barrier::{NodeIndex, Standing};

impl Master {
    /// Nodes that frames wait for.
    pub fn live_nodes(&self) -> u32 {
        let nodes = (0..self.nodes.len() as u16).map(NodeIndex);
        nodes.filter(|node| self.barrier.standing(*node) == Standing::Live).count() as u32
    }

    /// Decides for both: who has fewer live nodes stands by, and where both have as many, who greets.
    pub(super) fn greet_rival(&mut self, peer: PeerId, hello: &RivalHello) {
        if let Err(bye) = self.admit(peer, Claim::Master) {
            return self.dismiss(peer, bye);
        }
        if let Some(bye) = self.other_show(&hello.show) {
            return self.dismiss(peer, bye);
        }
        let (own, theirs) = (self.live_nodes(), hello.live_nodes);
        let is_true = theirs as usize <= self.nodes.len();
        if theirs > own && is_true {
            self.outputs.push_back(Output::Outnumbered { peer, port: hello.port });
            let reason = format!("this master has {own} live nodes: it stands by");
            self.dismiss(peer, Bye::new(ByeCode::Leaving, reason));
        } else {
            let reason = format!("it has {own} live nodes, to {theirs}");
            self.dismiss(peer, Bye::new(ByeCode::OtherMaster, reason));
        }
    }
}
