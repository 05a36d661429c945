//! The object hierarchy (OH): the tree that the cull walks.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::geometry::Obb;
use crate::visible_set::LeafRange;

/// A node's place in an [`ObjectHierarchy`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct NodeId(pub u32);

/// A node of the object hierarchy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OhNode {
    /// World-space bound; encloses the bounds of all children, or all vertices of a leaf.
    pub bound: Obb,
    /// One past the last node of its subtree; its own id plus one for a leaf.
    pub subtree_end: u32,
    /// The leaves below it, or the leaf that it is.
    pub leaves: LeafRange,
}

/// The object hierarchy in depth-first order: a node's children follow it, a subtree is one range of nodes and one
/// range of leaves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectHierarchy {
    nodes: Vec<OhNode>,
}

/// Why nodes are no hierarchy.
#[derive(Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum HierarchyError {
    #[error("node {node}: its subtree ends at {subtree_end}, outside {node}+1..={limit}")]
    SubtreeEnd { node: u32, subtree_end: u32, limit: u32 },
    #[error("node {node}: its leaves {start}..{end} do not follow on those before it or are not its children's")]
    Leaves { node: u32, start: u32, end: u32 },
    #[error("node {node}: its bound is not finite")]
    Bound { node: u32 },
}

impl ObjectHierarchy {
    /// Checks and takes nodes in depth-first order: one tree, subtrees nested, leaves numbered as they come.
    ///
    /// # Errors
    /// When the nodes do not form such a tree. An empty list is the hierarchy of an empty scene.
    pub fn new(nodes: Vec<OhNode>) -> Result<Self, HierarchyError> {
        let mut open_ends: Vec<(u32, u32)> = Vec::new(); // (node, subtree end)
        let mut next_leaf = 0;
        for (i, node) in nodes.iter().enumerate() {
            let id = i as u32;
            while let Some(&(parent, end)) = open_ends.last()
                && end == id
            {
                Self::check_closed(parent, &nodes, next_leaf)?;
                open_ends.pop();
            }
            let limit = match open_ends.last() {
                Some(&(_, end)) => end,
                None if i == 0 => nodes.len() as u32,
                None => id, // a second root
            };
            if node.subtree_end <= id || node.subtree_end > limit || (i == 0 && node.subtree_end != limit) {
                return Err(HierarchyError::SubtreeEnd { node: id, subtree_end: node.subtree_end, limit });
            }
            if !node.bound.is_finite() {
                return Err(HierarchyError::Bound { node: id });
            }
            if node.leaves.start != next_leaf {
                return Err(HierarchyError::Leaves { node: id, start: node.leaves.start, end: node.leaves.end });
            }
            if node.subtree_end == id + 1 {
                next_leaf += 1;
            }
            open_ends.push((id, node.subtree_end));
        }
        while let Some((parent, _)) = open_ends.pop() {
            Self::check_closed(parent, &nodes, next_leaf)?;
        }
        Ok(Self { nodes })
    }

    fn check_closed(node: u32, nodes: &[OhNode], next_leaf: u32) -> Result<(), HierarchyError> {
        let leaves = nodes[node as usize].leaves;
        if leaves.end == next_leaf { Ok(()) } else { Err(HierarchyError::Leaves { node, start: leaves.start, end: leaves.end }) }
    }

    /// All nodes, depth first.
    pub fn nodes(&self) -> &[OhNode] {
        &self.nodes
    }

    /// The root, unless the scene is empty.
    pub fn root(&self) -> Option<NodeId> {
        (!self.nodes.is_empty()).then_some(NodeId(0))
    }

    /// The node with that id.
    pub fn node(&self, id: NodeId) -> &OhNode {
        &self.nodes[id.0 as usize]
    }

    /// Gives a node another bound, which must be finite. The caller sees to it that bounds go on enclosing those below.
    pub fn set_bound(&mut self, id: NodeId, bound: Obb) {
        debug_assert!(bound.is_finite());
        self.nodes[id.0 as usize].bound = bound;
    }

    /// Adds a tree below the root, after all that is there; its leaves get the next numbers. Returns its root's id.
    ///
    /// Where there is no root, or it is a leaf, a new root comes first, and ids grow by one. Bounds above it are not
    /// touched.
    pub fn append(&mut self, tree: &Self) -> NodeId {
        if self.nodes.len() < 2 {
            self.nodes.iter_mut().for_each(|node| node.subtree_end += 1);
            let bound = self.nodes.iter().chain(&tree.nodes).map(|node| node.bound).next().unwrap_or(Obb::of_point(DVec3::ZERO));
            let leaves = LeafRange::new(0, self.leaf_count());
            self.nodes.insert(0, OhNode { bound, subtree_end: self.nodes.len() as u32 + 1, leaves });
        }
        let (first, first_leaf) = (self.nodes.len() as u32, self.leaf_count());
        self.nodes.extend(tree.nodes.iter().map(|node| OhNode {
            bound: node.bound,
            subtree_end: node.subtree_end + first,
            leaves: LeafRange::new(node.leaves.start + first_leaf, node.leaves.end + first_leaf),
        }));
        self.nodes[0].subtree_end = self.nodes.len() as u32;
        self.nodes[0].leaves.end = first_leaf + tree.leaf_count();
        NodeId(first)
    }

    /// Whether the node is a leaf.
    pub fn is_leaf(&self, id: NodeId) -> bool {
        self.node(id).subtree_end == id.0 + 1
    }

    /// The node's children, in order.
    pub fn children(&self, id: NodeId) -> impl Iterator<Item = NodeId> + '_ {
        let end = self.node(id).subtree_end;
        let mut next = id.0 + 1;
        std::iter::from_fn(move || {
            (next < end).then(|| {
                let child = NodeId(next);
                next = self.nodes[next as usize].subtree_end;
                child
            })
        })
    }

    /// The node of a leaf, which must be there.
    pub fn leaf_node(&self, leaf: u32) -> NodeId {
        let mut at = NodeId(0);
        while !self.is_leaf(at) {
            // Every leaf of a node is below one of its children.
            at = self.children(at).find(|child| leaf < self.node(*child).leaves.end).unwrap_or(NodeId(at.0 + 1));
        }
        at
    }

    /// The nodes that are leaves, by leaf number.
    pub fn leaf_nodes(&self) -> impl Iterator<Item = &OhNode> {
        self.nodes.iter().zip(1..).filter(|(node, next)| node.subtree_end == *next).map(|(node, _)| node)
    }

    /// Number of leaves.
    pub fn leaf_count(&self) -> u32 {
        self.nodes.first().map_or(0, |root| root.leaves.end)
    }

    /// Longest path from the root, in nodes; 0 when empty.
    pub fn depth(&self) -> u32 {
        let mut ends: Vec<u32> = Vec::new();
        let mut deepest = 0;
        for (i, node) in self.nodes.iter().enumerate() {
            while ends.last().is_some_and(|&end| end <= i as u32) {
                ends.pop();
            }
            ends.push(node.subtree_end);
            deepest = deepest.max(ends.len() as u32);
        }
        deepest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Aabb;

    fn node(subtree_end: u32, start: u32, end: u32) -> OhNode {
        let bound = Obb::from(Aabb { min: DVec3::ZERO, max: DVec3::new(1.0, 2.0, 3.0) });
        OhNode { bound, subtree_end, leaves: LeafRange::new(start, end) }
    }

    #[test]
    fn a_tree_is_walked_in_order() {
        // 0 ─ 1 ─ (2, 3), 4
        let nodes = vec![node(5, 0, 3), node(4, 0, 2), node(3, 0, 1), node(4, 1, 2), node(5, 2, 3)];
        let oh = ObjectHierarchy::new(nodes).expect("a tree");
        assert_eq!(oh.children(NodeId(0)).collect::<Vec<_>>(), [NodeId(1), NodeId(4)]);
        assert_eq!(oh.children(NodeId(1)).collect::<Vec<_>>(), [NodeId(2), NodeId(3)]);
        assert!(oh.is_leaf(NodeId(4)) && !oh.is_leaf(NodeId(1)));
        assert_eq!((oh.leaf_count(), oh.depth()), (3, 3));
        assert_eq!(ObjectHierarchy::new(Vec::new()).map(|oh| oh.leaf_count()), Ok(0));
    }

    #[test]
    fn what_is_no_tree_is_refused() {
        let broken = [
            vec![node(1, 0, 1), node(2, 1, 2)],                // two roots
            vec![node(3, 0, 1), node(4, 0, 1), node(3, 0, 1)], // a child past its parent
            vec![node(0, 0, 1)],                               // ends before itself
            vec![node(3, 0, 2), node(2, 0, 1), node(3, 0, 1)], // a leaf twice
            vec![node(3, 0, 5), node(2, 0, 1), node(3, 1, 2)], // more leaves than there are
        ];
        for nodes in broken {
            assert!(ObjectHierarchy::new(nodes.clone()).is_err(), "{nodes:?}");
        }
    }
}
