//! Nodes by how many pixels they are wrong.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use mullion_common::scene::VertexId;

/// A node: an object's lead, and how many pixels the surface is wrong where it is not split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Node {
    /// No less than 0.
    pub pixels: f32,
    pub object: u32,
    pub lead: VertexId,
}

impl Eq for Node {}

impl Ord for Node {
    /// By pixels; of equal ones the coarser is the greater: one order on every machine.
    fn cmp(&self, other: &Self) -> Ordering {
        let by_place = (other.object, other.lead).cmp(&(self.object, self.lead));
        self.pixels.total_cmp(&other.pixels).then(by_place)
    }
}

impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// What may be split, the most wrong first. Nodes may be in it that mean nothing any more.
pub(super) type SplitHeap = BinaryHeap<Node>;

/// What may be taken back, the least wrong first. Nodes may be in it that mean nothing any more.
pub(super) type CollapseHeap = BinaryHeap<std::cmp::Reverse<Node>>;
