//! The tree of what a view may see: a sloppy n-ary space partitioning tree (Bartz, Meißner, Hüttner 1999, section 3.1) whose leaves are the
//! scene's.
//!
//! Leaves are numbered depth first in the tree that the cull walks, so that eight consecutive ones are close together: a node of level k
//! stands for the visible ones of 8^k, beginning with a multiple of that. It is made anew for each frame from where things stand in it, so
//! that nothing that moves leaves a stale bound.

use glam::DAffine3;
use mullion_common::geometry::{Aabb, axis_lengths};
use mullion_common::scene::{LeafRecord, Transform};

const LEVEL_BITS: u32 = 3;

/// A node, by its place in the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(u32);

#[derive(Clone, Copy, Debug)]
struct Node {
    /// In the world, metres.
    bounds: Aabb,
    /// Of a leaf its number; else the first child's place.
    first: u32,
    /// 0 for a leaf.
    children: u32,
    /// The same node has the same key in every frame, among those of its level.
    key: u32,
    level: u32,
}

/// A tree of visible leaves. Keeps its memory.
#[derive(Debug, Default)]
pub struct VisibleTree {
    nodes: Vec<Node>,
    /// Where the uppermost nodes begin: there are at most eight.
    roots: u32,
}

impl VisibleTree {
    /// Makes the tree of some leaves, in ascending order.
    pub fn build(&mut self, leaves: impl Iterator<Item = u32>, records: &[LeafRecord], transforms: &[Transform]) {
        self.nodes.clear();
        self.nodes.extend(leaves.map(|leaf| {
            let bounds = leaf_bounds(&records[leaf as usize], transforms);
            Node { bounds, first: leaf, children: 0, key: leaf, level: 0 }
        }));
        let (mut begin, mut level) = (0, 0);
        while self.nodes.len() - begin > 1 << LEVEL_BITS {
            level += 1;
            let end = self.nodes.len();
            let mut at = begin;
            while at < end {
                let key = self.nodes[at].key >> LEVEL_BITS;
                let children = self.nodes[at..end].iter().take_while(|node| node.key >> LEVEL_BITS == key).count();
                let bounds = self.nodes[at..at + children].iter().fold(Aabb::EMPTY, |all, node| all.union(&node.bounds));
                self.nodes.push(Node { bounds, first: at as u32, children: children as u32, key, level });
                at += children;
            }
            begin = end;
        }
        self.roots = begin as u32;
    }

    /// The uppermost nodes.
    pub fn roots(&self) -> impl Iterator<Item = NodeId> + use<> {
        (self.roots..self.nodes.len() as u32).map(NodeId)
    }

    /// A node's children; none for a leaf.
    pub fn children(&self, node: NodeId) -> impl Iterator<Item = NodeId> + use<> {
        let node = &self.nodes[node.0 as usize];
        let (first, count) = if node.children == 0 { (0, 0) } else { (node.first, node.children) };
        (first..first + count).map(NodeId)
    }

    /// The scene's leaf that a node is, if it is one.
    pub fn leaf(&self, node: NodeId) -> Option<u32> {
        let node = &self.nodes[node.0 as usize];
        (node.children == 0).then_some(node.first)
    }

    /// What a node holds is in here. In the world, metres.
    pub fn bounds(&self, node: NodeId) -> Aabb {
        self.nodes[node.0 as usize].bounds
    }

    /// Calls `each` with all leaves below a node, or itself.
    pub fn each_leaf(&self, node: NodeId, each: &mut impl FnMut(u32)) {
        match self.leaf(node) {
            Some(leaf) => each(leaf),
            None => self.children(node).for_each(|child| self.each_leaf(child, each)),
        }
    }

    /// The same node in another frame's tree has the same name.
    pub fn name(&self, node: NodeId) -> (u32, u32) {
        let node = &self.nodes[node.0 as usize];
        (node.level, node.key)
    }
}

/// What a leaf is in, in the world, metres.
pub(super) fn leaf_bounds(record: &LeafRecord, transforms: &[Transform]) -> Aabb {
    bounds_of(&record.local_aabb(), &transforms[record.object.0 as usize].affine())
}

/// In the world, larger by what a GPU may round the leaf's vertices.
fn bounds_of(local: &Aabb, world_from_local: &DAffine3) -> Aabb {
    let rounded_m = local.rounding_m(axis_lengths(&world_from_local.matrix3));
    let bounds = local.transformed(world_from_local);
    bounds.grown(rounded_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use mullion_common::scene::{ChunkId, MaterialId, ObjectId};

    fn record(k: u32) -> LeafRecord {
        let (object, chunk, material) = (ObjectId(k % 3), ChunkId(0), MaterialId(0));
        let at = k as f32;
        LeafRecord { object, chunk, material, triangle_count: 1, local_min: [at, 0.0, 0.0], local_max: [at + 0.5, 1.0, 2.0] }
    }

    #[test]
    fn every_leaf_hangs_once_below_bounds_that_hold_it() {
        let records: Vec<LeafRecord> = (0..2000).map(record).collect();
        let transforms = [0.0, 10.0, -5.0].map(|y| DAffine3::from_translation(DVec3::Y * y).into());
        let mut tree = VisibleTree::default();
        for stride in [1_usize, 3, 17, 900, 2001] {
            let leaves: Vec<u32> = (0..2000).step_by(stride).collect();
            tree.build(leaves.iter().copied(), &records, &transforms);
            assert!(tree.roots().count() <= 8);
            let mut found = Vec::new();
            tree.roots().for_each(|root| tree.each_leaf(root, &mut |leaf| found.push(leaf)));
            assert_eq!(found, leaves, "in ascending order");
            let mut open: Vec<NodeId> = tree.roots().collect();
            while let Some(node) = open.pop() {
                let bounds = tree.bounds(node);
                assert_eq!(tree.children(node).count() == 0, tree.leaf(node).is_some());
                for child in tree.children(node) {
                    assert_eq!(bounds.union(&tree.bounds(child)), bounds);
                    assert!(tree.name(child).1 >> 3 == tree.name(node).1 && tree.name(child).0 + 1 == tree.name(node).0);
                    open.push(child);
                }
            }
        }
        tree.build(std::iter::empty(), &records, &transforms);
        assert_eq!(tree.roots().count(), 0);
    }
}
