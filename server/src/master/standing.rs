//! How the nodes of a master stand.

use mullion_common::wall::ViewId;
use mullion_common::wire::{Bye, ByeCode, Counted, Stats};

use super::{Contributions, Master, Peer, PeerId};
use crate::swap_barrier::{NodeIndex, Standing};

impl Master {
    /// How many nodes are connected.
    pub fn connected(&self) -> usize {
        self.nodes.iter().filter(|n| n.connection.is_some()).count()
    }

    /// What a node is to the barrier.
    pub fn standing(&self, node: NodeIndex) -> Standing {
        self.barrier.standing(node)
    }

    /// Bytes of each node's last frame message, by `NodeIndex`; 0 for one that is not connected.
    pub fn frame_bytes(&self) -> impl ExactSizeIterator<Item = u32> + '_ {
        self.nodes.iter().map(|n| n.frame_bytes)
    }

    /// How often each node was passed over, by `NodeIndex`.
    pub fn times_passed_over(&self) -> impl ExactSizeIterator<Item = u64> + '_ {
        self.nodes.iter().map(|n| n.passed_over)
    }

    /// What each node last said of itself, by `NodeIndex`.
    pub fn stats(&self) -> impl ExactSizeIterator<Item = Stats> + '_ {
        self.nodes.iter().map(|n| n.stats)
    }

    /// Objects that no view draws in the newest frame, though some see them.
    pub fn dropped_objects(&self) -> u32 {
        self.contributions.as_ref().map_or(0, Contributions::dropped_objects)
    }

    /// A node says what it counted.
    pub(super) fn handle_counted(&mut self, peer: PeerId, node: NodeIndex, counted: &Counted) {
        let newest = self.history.newest();
        let (Some(newest), true) = (newest.filter(|newest| counted.frame <= *newest), self.has_view(node, counted.view)) else {
            let reason = format!("counted in view {} of frame {}, but the newest is {newest:?}", counted.view.0, counted.frame);
            return self.dismiss(peer, Bye::new(ByeCode::Malformed, reason));
        };
        if let Some(contributions) = &mut self.contributions {
            contributions.take(counted, newest);
        }
    }

    fn has_view(&self, node: NodeIndex, view: ViewId) -> bool {
        self.nodes[usize::from(node.0)].views.contains(&view)
    }

    /// What the node of a connection is called.
    pub fn name_of(&self, peer: PeerId) -> Option<&str> {
        match self.peers.get(&peer)? {
            Peer::Unnamed { .. } => None,
            Peer::Spare => self.spare_name(peer),
            Peer::Standby => Some("standby"),
            Peer::Node(node) | Peer::Chunks(node) => Some(&self.nodes[usize::from(node.0)].name),
        }
    }
}
