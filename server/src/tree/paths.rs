//! Which nodes have to be refitted: those of leaves that have changed, and on the ways up from them as far as boxes change.

use mullion_common::scene::ObjectHierarchy;

use super::wide::WideTree;
use super::wide_node::WideNode;

/// No node above.
const NONE: u32 = u32::MAX;

/// The ways up one tree, and what of it has changed.
#[derive(Clone, Debug, Default)]
pub(super) struct Paths {
    /// Of each node, the one above it.
    above: Vec<u32>,
    /// Of each leaf, the node to start from: the leaf's own, or the one that has it as a child.
    start: Vec<u32>,
    /// A bit for each node.
    dirty: Vec<u64>,
    /// Of each marked node of the wide tree, the lanes that have changed, a bit each.
    lanes: Vec<u8>,
}

/// All lanes of a node.
pub(super) const ALL_LANES: u8 = !0;

impl Paths {
    /// The ways up the hierarchy; a leaf's starts at its own node.
    pub(super) fn of_hierarchy(hierarchy: &ObjectHierarchy) -> Self {
        let mut paths = Self::default();
        paths.extend_with_hierarchy(hierarchy, 0);
        paths
    }

    /// Adds the ways up from nodes that were appended, `first` and all that follow.
    pub(super) fn extend_with_hierarchy(&mut self, hierarchy: &ObjectHierarchy, first: u32) {
        let nodes = hierarchy.nodes();
        self.resize(nodes.len());
        let mut open: Vec<u32> = if first > 0 { vec![0] } else { Vec::new() };
        for (at, node) in (0..).zip(nodes).skip(first as usize) {
            while open.last().is_some_and(|above| nodes[*above as usize].subtree_end <= at) {
                open.pop();
            }
            self.above[at as usize] = open.last().copied().unwrap_or(NONE);
            if node.subtree_end == at + 1 {
                self.start.push(at);
            } else {
                open.push(at);
            }
        }
    }

    /// The ways up the wide tree; a leaf's starts at the node that has it in a lane.
    pub(super) fn of_wide(tree: &WideTree) -> Self {
        let mut paths = Self::default();
        paths.extend_with_wide(tree, 0);
        paths
    }

    /// Adds the ways up from nodes that were appended, `first` and all that follow, below the tree's root.
    pub(super) fn extend_with_wide(&mut self, tree: &WideTree, first: u32) {
        self.resize(tree.nodes().len());
        self.start.resize(tree.leaf_count() as usize, NONE);
        let appended = (first..tree.nodes().len() as u32).chain(Some(tree.root()).filter(|root| *root < first));
        for at in appended {
            let node = &tree.nodes()[at as usize];
            for lane in 0..node.lane_count() {
                match node.child[lane] {
                    leaf if leaf & WideNode::LEAF != 0 => self.start[node.first_leaf[lane] as usize] = at,
                    child => self.above[child as usize] = at,
                }
            }
        }
    }

    fn resize(&mut self, nodes: usize) {
        self.above.resize(nodes, NONE);
        self.dirty.resize(nodes.div_ceil(64), 0);
        self.lanes.resize(nodes, 0);
    }

    /// The node at which a leaf's way starts.
    pub(super) fn start_of(&self, leaf: u32) -> u32 {
        self.start[leaf as usize]
    }

    /// Marks a node, in which these lanes have changed.
    pub(super) fn mark(&mut self, node: u32, lanes: u8) {
        self.dirty[node as usize / 64] |= 1 << (node % 64);
        self.lanes[node as usize] |= lanes;
    }

    /// The node above one, where that comes before it in the tree.
    pub(super) fn above(&self, node: u32) -> Option<u32> {
        Some(self.above[node as usize]).filter(|above| *above < node)
    }

    /// Takes the mark off the last marked node, and names it and its lanes; none is marked past the first `from` words, which is kept
    /// up to date.
    pub(super) fn take_last(&mut self, from: &mut usize) -> Option<(u32, u8)> {
        while *from > 0 {
            let word = &mut self.dirty[*from - 1];
            if *word != 0 {
                let bit = word.ilog2();
                *word ^= 1 << bit;
                let node = (*from as u32 - 1) * 64 + bit;
                return Some((node, std::mem::take(&mut self.lanes[node as usize])));
            }
            *from -= 1;
        }
        None
    }

    /// Where [`Paths::take_last`] starts from.
    pub(super) fn end(&self) -> usize {
        self.dirty.len()
    }

    /// Whether no node is marked.
    pub(super) fn is_clean(&self) -> bool {
        self.dirty.iter().all(|word| *word == 0)
    }
}
