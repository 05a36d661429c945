//! Two masters that drive the same wall, of which one is to stand by.

use std::time::Duration;

use mullion_common::wire::{ALIVE_EVERY, Bye, ByeCode, RivalHello};

use super::admission::Claim;
use super::{Master, Output, PeerId};
use crate::swap_barrier::{NodeIndex, Standing};

/// A master that was not heard of by its own shell for so long has hung, and knows nothing of its nodes until it has heard of them again.
const HUNG_AFTER: Duration = Duration::from_millis(1500);
/// How long that takes.
const RECOVERS_IN: Duration = Duration::from_secs(1);
const _: () =
    assert!(HUNG_AFTER.as_millis() > ALIVE_EVERY.as_millis(), "a shell that has nothing to do still calls once a second");

/// Whether a master has run without a break.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pulse {
    last: Duration,
    /// Since when it counts as recovered.
    steady_from: Duration,
}

impl Pulse {
    pub fn new(now: Duration) -> Self {
        Self { last: now, steady_from: now }
    }

    pub fn beat(&mut self, now: Duration) {
        if now >= self.last + HUNG_AFTER {
            self.steady_from = now + RECOVERS_IN;
        }
        self.last = now;
    }
}

impl Master {
    /// Nodes that frames wait for.
    pub fn live_nodes(&self) -> u32 {
        let nodes = (0..self.nodes.len() as u16).map(NodeIndex);
        nodes.filter(|node| self.barrier.standing(*node) == Standing::Live).count() as u32
    }

    /// Decides for both: who has fewer live nodes stands by, and where both have as many, who greets.
    pub(super) fn greet_rival(&mut self, peer: PeerId, hello: &RivalHello, now: Duration) {
        if let Err(bye) = self.admit(peer, Claim::Master) {
            return self.dismiss(peer, bye);
        }
        if let Some(bye) = self.other_show(&hello.show) {
            return self.dismiss(peer, bye);
        }
        self.pulse.beat(now);
        if self.is_growing() {
            return self.dismiss(peer, Bye::new(ByeCode::Timeout, "its scene grows: ask again"));
        }
        if now < self.pulse.steady_from {
            return self.dismiss(peer, Bye::new(ByeCode::Timeout, "it hung, and does not know yet who its nodes are: ask again"));
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
