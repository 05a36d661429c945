//! The trees that the cull walks, and how they follow what moves.

mod build;
mod carry;
mod dynamic;
mod file;
mod paths;
mod rebuild;
pub(crate) mod regroup;
#[cfg(test)]
mod tests;
mod wide;
mod wide_node;

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{NodeId, ObjectHierarchy};
use mullion_common::visible_set::{LeafRange, VisibleSet};

pub(crate) use build::fitted;
pub use build::hierarchy_over;
pub use carry::CarryOver;
pub use dynamic::{DynamicScene, MAX_TRANSFORM};
pub use file::FileTree;
pub use mullion_common::scene::Presence;
use paths::{ALL_LANES, Paths};
use rebuild::Rebuild;
pub use wide::WideTree;
pub use wide_node::{LANES, LeafAxes, WideNode};

/// The object hierarchy in every form that an algorithm walks.
///
/// Shares the hierarchy with the package that holds it, until something moves. Edits take effect for a form of the tree when that is
/// refitted: [`CullTree::refit`], once a frame, after the frame's edits.
#[derive(Debug, Default)]
pub struct CullTree {
    hierarchy: Arc<ObjectHierarchy>,
    wide: Arc<WideTree>,
    stamp: u64,
    bounds: Bounds,
    /// From the first edit on.
    edits: Option<Box<Edits>>,
}

/// What an edited tree keeps.
#[derive(Debug)]
struct Edits {
    hierarchy_paths: Paths,
    wide_paths: Paths,
    /// Leaves that are gone.
    removed: VisibleSet,
    /// Of each of them, the bound that it would have.
    away: HashMap<u32, Obb>,
    /// [`WideTree::visits`] when the tree was built.
    built_visits: f64,
    rebuild: Option<Rebuild>,
}

impl Edits {
    fn of(hierarchy: &ObjectHierarchy, wide: &WideTree) -> Self {
        Self {
            hierarchy_paths: Paths::of_hierarchy(hierarchy),
            wide_paths: Paths::of_wide(wide),
            removed: VisibleSet::default(),
            away: HashMap::new(),
            built_visits: wide.visits(),
            rebuild: None,
        }
    }

    /// Marks what has to be refitted since a leaf has changed.
    fn mark(&mut self, leaf: u32, wide: &WideTree) {
        self.hierarchy_paths.mark(self.hierarchy_paths.start_of(leaf), 0);
        let node = self.wide_paths.start_of(leaf);
        self.wide_paths.mark(node, wide.nodes()[node as usize].lane_from(leaf));
        if let Some(rebuild) = &mut self.rebuild {
            rebuild.note(leaf);
        }
    }
}

/// Which boxes moving leaves, and the nodes above them, get (Nirnimesh, Harish, Narayanan 2006, section 5, Fig. 6). The wide
/// tree's inner boxes are axis-aligned whatever is chosen here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bounds {
    /// Oriented ones for all: tight, the slowest to refit.
    Obb,
    /// Axis-aligned ones for what has moved and all above it, oriented ones for the rest.
    #[default]
    Hybrid,
    /// Axis-aligned ones for all: loose, fast.
    Aabb,
}

impl Bounds {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Obb, Self::Aabb, Self::Hybrid];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Obb => "obb",
            Self::Aabb => "aabb",
            Self::Hybrid => "hybrid",
        }
    }
}

/// A form of the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeForm {
    /// The object hierarchy, which the paper's algorithms walk.
    Hierarchy,
    /// Wide nodes, which the sweep walks.
    Wide,
}

/// Stamps given so far.
static STAMPS: AtomicU64 = AtomicU64::new(1);

fn new_stamp() -> u64 {
    STAMPS.fetch_add(1, Ordering::Relaxed)
}

impl CullTree {
    /// The tree over a hierarchy.
    pub fn new(hierarchy: Arc<ObjectHierarchy>) -> Self {
        let wide = Arc::new(WideTree::new(&hierarchy));
        Self { hierarchy, wide, stamp: new_stamp(), bounds: Bounds::default(), edits: None }
    }

    /// The tree over a hierarchy, ready to be edited: the first edit costs no more than later ones.
    pub fn editable(hierarchy: Arc<ObjectHierarchy>, bounds: Bounds) -> Self {
        let mut nodes = Arc::unwrap_or_clone(hierarchy);
        if bounds == Bounds::Aabb {
            for id in (0..nodes.nodes().len() as u32).map(NodeId) {
                nodes.set_bound(id, nodes.node(id).bound.aabb().into());
            }
        }
        let mut tree = Self { bounds, ..Self::new(Arc::new(nodes)) };
        tree.edits();
        tree
    }

    /// The object hierarchy, which the paper's algorithms walk.
    pub fn hierarchy(&self) -> &ObjectHierarchy {
        &self.hierarchy
    }

    /// The same as wide nodes, which the sweep walks.
    pub fn wide(&self) -> &WideTree {
        &self.wide
    }

    /// Memory taken by the hierarchy and the wide nodes, bytes; what edits keep comes on top.
    pub fn bytes(&self) -> usize {
        size_of_val(self.hierarchy.nodes()) + self.wide.bytes()
    }

    /// The bound of a leaf.
    pub fn leaf_bound(&self, leaf: u32) -> &Obb {
        let known = self.edits.as_ref().map(|edits| NodeId(edits.hierarchy_paths.start_of(leaf)));
        &self.hierarchy.node(known.unwrap_or_else(|| self.hierarchy.leaf_node(leaf))).bound
    }

    /// Leaves that are gone: no visible set holds them.
    pub fn removed(&self) -> Option<&VisibleSet> {
        self.edits.as_ref().map(|edits| &edits.removed).filter(|removed| !removed.is_empty())
    }

    /// Never the same for two trees, nor for one before and after an edit.
    pub(crate) fn stamp(&self) -> u64 {
        self.stamp
    }

    /// The wide nodes for a thread of its own, which must let go of them before the next refit, lest that copies them.
    pub(crate) fn shared(&self) -> Arc<WideTree> {
        Arc::clone(&self.wide)
    }

    fn edits(&mut self) -> &mut Edits {
        self.edits.get_or_insert_with(|| Box::new(Edits::of(&self.hierarchy, &self.wide)))
    }

    /// Marks what has to be refitted since a leaf has changed.
    fn mark(&mut self, leaf: u32) {
        let edits = self.edits.get_or_insert_with(|| Box::new(Edits::of(&self.hierarchy, &self.wide)));
        edits.mark(leaf, &self.wide);
    }

    /// Gives a leaf the bound that encloses it from now on; it must be finite. Takes effect with [`CullTree::refit`], for a removed
    /// leaf once it is restored.
    pub fn move_leaf(&mut self, leaf: u32, bound: &Obb) {
        let bound = if self.bounds == Bounds::Obb { *bound } else { bound.aabb().into() };
        if let Some(away) = self.edits().away.get_mut(&leaf) {
            // It is seen there once it comes back; until then nothing gets larger for its sake.
            *away = bound;
            return;
        }
        self.mark(leaf);
        self.set_bound(leaf, bound);
    }

    fn set_bound(&mut self, leaf: u32, bound: Obb) {
        let node = NodeId(self.edits().hierarchy_paths.start_of(leaf));
        Arc::make_mut(&mut self.wide).mark_oriented(leaf, &bound);
        Arc::make_mut(&mut self.hierarchy).set_bound(node, bound);
    }

    /// Takes a leaf out of every visible set. Its number stays unused until it is restored or the tree is rebuilt.
    pub fn remove_leaf(&mut self, leaf: u32) {
        self.remove_leaves(&[LeafRange::new(leaf, leaf + 1)]);
    }

    /// Takes leaves out of every visible set; those that are gone stay so.
    pub fn remove_leaves(&mut self, leaves: &[LeafRange]) {
        for leaf in leaves.iter().flat_map(|range| range.start..range.end) {
            let bound = *self.leaf_bound(leaf);
            let edits = self.edits();
            if edits.away.contains_key(&leaf) {
                continue;
            }
            edits.away.insert(leaf, bound);
            edits.removed.push_unordered(LeafRange::new(leaf, leaf + 1));
            self.mark(leaf);
            // A point within what enclosed it: nothing gets larger for its sake.
            self.set_bound(leaf, Obb::of_point(bound.center));
        }
        self.edits().removed.normalize();
    }

    /// Brings removed leaves back to where they would be if they had stayed; those that are there stay so. Takes effect with
    /// [`CullTree::refit`].
    pub fn restore_leaves(&mut self, leaves: &[LeafRange]) {
        let mut back = VisibleSet::default();
        for leaf in leaves.iter().flat_map(|range| range.start..range.end) {
            let Some(bound) = self.edits().away.remove(&leaf) else { continue };
            back.push_unordered(LeafRange::new(leaf, leaf + 1));
            self.mark(leaf);
            self.set_bound(leaf, bound);
        }
        back.normalize();
        let edits = self.edits();
        let before = std::mem::take(&mut edits.removed);
        before.difference_into(&back, &mut edits.removed);
    }

    /// Adds leaves with these bounds and returns their numbers: the next ones, in the order given. They stand below
    /// the root until the tree is rebuilt.
    pub fn add_leaves(&mut self, bounds: &[Obb]) -> LeafRange {
        let first = self.hierarchy.leaf_count();
        if bounds.is_empty() {
            return LeafRange::new(first, first);
        }
        self.stamp = new_stamp();
        let has_inner_root = self.hierarchy.nodes().len() > 1;
        let edits = self.edits.get_or_insert_with(|| Box::new(Edits::of(&self.hierarchy, &self.wide)));
        let hierarchy = Arc::make_mut(&mut self.hierarchy);
        let id = hierarchy.append(&build::in_order(bounds));
        if has_inner_root {
            let wide = Arc::make_mut(&mut self.wide);
            let before = wide.append(hierarchy, id);
            edits.hierarchy_paths.extend_with_hierarchy(hierarchy, id.0);
            edits.wide_paths.extend_with_wide(wide, before);
        } else {
            self.wide = Arc::new(WideTree::new(hierarchy));
            edits.hierarchy_paths = Paths::of_hierarchy(hierarchy);
            edits.wide_paths = Paths::of_wide(&self.wide);
        }
        let leaves = LeafRange::new(first, hierarchy.leaf_count());
        // Below, all is up to date.
        (leaves.start..leaves.end).for_each(|leaf| edits.mark(leaf, &self.wide));
        edits.wide_paths.mark(self.wide.root(), ALL_LANES);
        leaves
    }

    /// Brings a form of the tree up to date with all edits so far: boxes on the ways from edited leaves to the root, bottom-up, of
    /// the wide tree only as far as they change.
    pub fn refit(&mut self, form: TreeForm) {
        let Some(edits) = &mut self.edits else {
            return;
        };
        let mut is_changed = false;
        match form {
            TreeForm::Hierarchy => {
                let hierarchy = Arc::make_mut(&mut self.hierarchy);
                let mut end = edits.hierarchy_paths.end();
                while let Some((at, _)) = edits.hierarchy_paths.take_last(&mut end) {
                    is_changed = true;
                    edits.hierarchy_paths.above(at).into_iter().for_each(|above| edits.hierarchy_paths.mark(above, 0));
                    if !hierarchy.is_leaf(NodeId(at)) {
                        let bound = match self.bounds {
                            Bounds::Obb => fitted(hierarchy.nodes(), at as usize),
                            Bounds::Aabb | Bounds::Hybrid => {
                                let children = hierarchy.children(NodeId(at)).map(|child| hierarchy.node(child).bound.aabb());
                                children.fold(Aabb::EMPTY, |all, b| all.union(&b)).into()
                            }
                        };
                        hierarchy.set_bound(NodeId(at), bound);
                    }
                }
            }
            TreeForm::Wide => {
                let wide = Arc::make_mut(&mut self.wide);
                let mut end = edits.wide_paths.end();
                while let Some((at, lanes)) = edits.wide_paths.take_last(&mut end) {
                    is_changed = true;
                    let is_larger_or_smaller = wide.refit(at, lanes, &self.hierarchy);
                    if let Some(above) = edits.wide_paths.above(at).filter(|_| is_larger_or_smaller) {
                        edits.wide_paths.mark(above, wide.nodes()[above as usize].lane_to(at));
                    }
                }
                if is_changed {
                    wide.refit_roots(&self.hierarchy);
                }
            }
        }
        if is_changed {
            self.stamp = new_stamp();
        }
    }

    /// Whether a form of the tree is up to date with all edits.
    pub fn is_refitted(&self, form: TreeForm) -> bool {
        self.edits.as_ref().is_none_or(|edits| match form {
            TreeForm::Hierarchy => edits.hierarchy_paths.is_clean(),
            TreeForm::Wide => edits.wide_paths.is_clean(),
        })
    }

    /// How many times as many nodes a walk of the wide tree visits as when it was built, by its boxes' sizes.
    pub fn degradation(&self) -> f64 {
        self.edits.as_ref().map_or(1.0, |edits| self.wide.visits() / edits.built_visits.max(1.0))
    }

    /// Starts to build the tree anew from the leaves as they are, unless that is going on. It comes to a result in
    /// [`CullTree::rebuild_step`].
    pub fn start_rebuild(&mut self) {
        let leaf_count = self.hierarchy.leaf_count();
        self.edits().rebuild.get_or_insert_with(|| Rebuild::new(leaf_count));
    }

    /// Does a bounded part of a rebuild, the rest of which goes on in a thread of its own: to be called once a frame, before the frame's edits are
    /// refitted. When the new tree is there it takes this one's place, with new leaf numbers: of each new one, the
    /// old one is returned. Removed leaves are gone then. With [`RebuildStep::Finish`] all of it is done at once.
    pub fn rebuild_step(&mut self, step: RebuildStep) -> Option<Vec<u32>> {
        let edits = self.edits.as_mut()?;
        let mut rebuild = edits.rebuild.take()?;
        let leaf = |leaf: u32| {
            let bound = self.hierarchy.node(NodeId(edits.hierarchy_paths.start_of(leaf))).bound;
            (!edits.removed.contains(leaf)).then_some(bound)
        };
        let Some(mut built) = rebuild.step(step, self.bounds, leaf) else {
            edits.rebuild = Some(rebuild);
            return None;
        };
        let (removed, before) = (std::mem::take(&mut edits.removed), std::mem::take(self));
        built.replay(rebuild.edited(), |leaf| (!removed.contains(leaf)).then(|| before.leaf_bound(leaf)));
        *self = built.tree;
        Some(built.old_of_new)
    }
}

/// How much of a rebuild to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RebuildStep {
    /// What a frame has time for.
    Some,
    /// All that remains, however long it takes.
    Finish,
}
