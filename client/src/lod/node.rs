//! Nodes by how many pixels they are wrong.

use std::cmp::Ordering;

use mullion_common::scene::VertexId;

use super::steps::StepId;

/// A node: an object's step, and how many pixels the surface is wrong where it is not made, by the object's weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// No less than 0.
    pub pixels: f32,
    pub object: u32,
    pub step: StepId,
    /// What splits in it, if a vertex does.
    pub parent: VertexId,
    /// Whether what it comes from was asked and found visible: then it is not asked.
    pub is_seen: bool,
    /// Whether what its vertex splits into next has been offered.
    pub is_followed: bool,
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Node {}

impl Ord for Node {
    /// By pixels; of equal ones the coarser is the greater: one order on every machine.
    fn cmp(&self, other: &Self) -> Ordering {
        // The bits of numbers that are not negative are in their order.
        let key = |node: &Self| u64::from(node.pixels.to_bits()) << 32 | u64::from(!node.step.0);
        key(self).cmp(&key(other)).then_with(|| other.object.cmp(&self.object))
    }
}

impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
