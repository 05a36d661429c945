//! Builds the object hierarchy as the file groups it (Nirnimesh, Harish, Narayanan 2006, Algorithm 1): a node for each node of
//! the file, and groups between them where a node has many children.

use glam::DVec3;
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::OhNode;
use mullion_common::visible_set::LeafRange;

use crate::tree::regroup::{Tree, TreeNode};

/// A node with more children than this gets groups between it and them.
const MAX_CHILDREN: usize = 16;

/// A node of the hierarchy under construction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct DraftId(u32);

#[derive(Clone, Debug)]
struct Draft {
    bound: Obb,
    content: Content,
}

#[derive(Clone, Debug)]
enum Content {
    Leaf(u32),
    Children(Vec<DraftId>),
}

/// Builds bottom-up: leaves and children first.
#[derive(Default)]
pub(super) struct HierarchyBuilder {
    drafts: Vec<Draft>,
}

impl HierarchyBuilder {
    /// Adds a leaf. `leaf` is the caller's number for it.
    pub fn leaf(&mut self, leaf: u32, bound: Obb) -> DraftId {
        self.add(Draft { bound, content: Content::Leaf(leaf) })
    }

    /// Adds nodes as `tree` has them over `items`; gives the root of it. The tree must have nodes.
    pub fn tree(&mut self, tree: &[TreeNode], items: &[DraftId]) -> DraftId {
        let mut built: Vec<DraftId> = Vec::with_capacity(tree.len());
        // Backwards, children come before parents; the last two built are the ones next in order.
        for node in tree.iter().rev() {
            let id = match node.item {
                Some(item) => items[item as usize],
                None => {
                    let (first, second) = (built.pop(), built.pop());
                    self.group(first.into_iter().chain(second).collect())
                }
            };
            built.push(id);
        }
        built[0]
    }

    /// Adds the node of an object over its own leaves and its children; `None` where there are neither.
    ///
    /// An object that is just one leaf of its own *is* that leaf.
    pub fn object(&mut self, own: Vec<DraftId>, below: Vec<DraftId>) -> Option<DraftId> {
        if let ([only], []) = (own.as_slice(), below.as_slice()) {
            return Some(*only);
        }
        let mut children = own;
        children.extend(below);
        (!children.is_empty()).then(|| self.regrouped(children))
    }

    /// Adds a root over all that have no parent.
    pub fn root(&mut self, roots: Vec<DraftId>) -> Option<DraftId> {
        match roots.as_slice() {
            [] => None,
            [only] => Some(*only),
            _ => Some(self.regrouped(roots)),
        }
    }

    /// The hierarchy below `root`, depth first, and the caller's leaf numbers in the order of the new ones.
    pub fn finish(self, root: Option<DraftId>) -> (Vec<OhNode>, Vec<u32>) {
        enum Step {
            Enter(DraftId),
            Leave(usize),
        }
        let (mut nodes, mut leaves): (Vec<OhNode>, Vec<u32>) = (Vec::new(), Vec::new());
        let mut steps: Vec<Step> = root.map(Step::Enter).into_iter().collect();
        while let Some(step) = steps.pop() {
            match step {
                Step::Enter(id) => {
                    let draft = &self.drafts[id.0 as usize];
                    steps.push(Step::Leave(nodes.len()));
                    let start = leaves.len() as u32;
                    nodes.push(OhNode { bound: draft.bound, subtree_end: 0, leaves: LeafRange::new(start, start) });
                    match &draft.content {
                        Content::Leaf(leaf) => leaves.push(*leaf),
                        Content::Children(children) => steps.extend(children.iter().rev().map(|c| Step::Enter(*c))),
                    }
                }
                Step::Leave(at) => {
                    nodes[at].subtree_end = nodes.len() as u32;
                    nodes[at].leaves.end = leaves.len() as u32;
                }
            }
        }
        (nodes, leaves)
    }

    fn regrouped(&mut self, children: Vec<DraftId>) -> DraftId {
        if children.len() <= MAX_CHILDREN {
            return self.group(children);
        }
        let boxes: Vec<Aabb> = children.iter().map(|c| self.drafts[c.0 as usize].bound.aabb()).collect();
        self.tree(&Tree::over(&boxes).nodes, &children)
    }

    fn group(&mut self, children: Vec<DraftId>) -> DraftId {
        let corners = || children.iter().flat_map(|c| self.drafts[c.0 as usize].bound.corners());
        let bound = Obb::around(corners()).unwrap_or(Obb::from(Aabb { min: DVec3::ZERO, max: DVec3::ZERO }));
        self.add(Draft { bound, content: Content::Children(children) })
    }

    fn add(&mut self, draft: Draft) -> DraftId {
        self.drafts.push(draft);
        DraftId(self.drafts.len() as u32 - 1)
    }
}
