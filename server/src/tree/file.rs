//! The file's own tree: what the paper's algorithms walk where nothing is regrouped.

use mullion_common::geometry::Obb;
use mullion_common::scene::{ObjectHierarchy, OhNode, Scene};
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::build::fitted;

/// The hierarchy as the source file has it: a node for each node of the file that has leaves below it, with all its children,
/// however many they are. Its leaves are the scene's under numbers of its own.
#[derive(Clone, Debug, Default)]
pub struct FileTree {
    /// The tree.
    pub hierarchy: ObjectHierarchy,
    /// Of each of its leaves, the leaf of the scene.
    pub leaves: Vec<u32>,
}

impl FileTree {
    /// The tree of a scene's file. An object that is one leaf and nothing else is that leaf; roots stand below one
    /// node.
    pub fn of(scene: &Scene) -> Self {
        let bounds: Vec<Obb> = scene.hierarchy.leaf_nodes().map(|node| node.bound).collect();
        let count = scene.objects.len();
        // Of each object, its leaves and the objects below it that have some; one past the last stands above the roots.
        let mut own: Vec<Vec<u32>> = vec![Vec::new(); count + 1];
        for (leaf, record) in (0..).zip(&scene.manifest.leaves) {
            own[record.object.0 as usize].push(leaf);
        }
        let mut below: Vec<Vec<u32>> = vec![Vec::new(); count + 1];
        for (id, object) in scene.objects.iter().enumerate().rev() {
            below[id].reverse(); // they came last to first
            if !own[id].is_empty() || !below[id].is_empty() {
                below[object.parent.map_or(count, |parent| parent.0 as usize)].push(id as u32);
            }
        }
        below[count].reverse();

        let mut tree = Self::default();
        let mut nodes: Vec<OhNode> = Vec::new();
        let start = match below[count][..] {
            [only] => only as usize,
            _ => count,
        };
        let mut open = if bounds.is_empty() { Vec::new() } else { vec![Step::Object(start)] };
        while let Some(step) = open.pop() {
            let id = nodes.len();
            let first = tree.leaves.len() as u32;
            match step {
                Step::Object(object) if below[object].is_empty() && own[object].len() == 1 => {
                    open.push(Step::Leaf(own[object][0]));
                }
                Step::Object(object) => {
                    let (bound, leaves) = (Obb::of_point(glam::DVec3::ZERO), LeafRange::new(first, first));
                    nodes.push(OhNode { bound, subtree_end: 0, leaves });
                    open.push(Step::Leave(id));
                    open.extend(below[object].iter().rev().map(|child| Step::Object(*child as usize)));
                    open.extend(own[object].iter().rev().map(|leaf| Step::Leaf(*leaf)));
                }
                Step::Leaf(leaf) => {
                    let leaves = LeafRange::new(first, first + 1);
                    nodes.push(OhNode { bound: bounds[leaf as usize], subtree_end: id as u32 + 1, leaves });
                    tree.leaves.push(leaf);
                }
                Step::Leave(id) => {
                    nodes[id].subtree_end = nodes.len() as u32;
                    nodes[id].leaves.end = first;
                    nodes[id].bound = fitted(&nodes, id);
                }
            }
        }
        // Depth first, nested and numbered in order, as the steps have it.
        tree.hierarchy = ObjectHierarchy::new(nodes).expect("a tree");
        tree
    }

    /// `out` becomes the scene's leaves of a set of this tree's leaves.
    pub fn in_scene(&self, set: &VisibleSet, out: &mut VisibleSet) {
        out.clear();
        for leaf in set.leaves().map(|leaf| self.leaves[leaf as usize]) {
            out.push_unordered(LeafRange::new(leaf, leaf + 1));
        }
        out.normalize();
    }
}

enum Step {
    /// An object with what is below it.
    Object(usize),
    /// A leaf of the scene.
    Leaf(u32),
    /// A node of the tree whose subtree is complete.
    Leave(usize),
}
