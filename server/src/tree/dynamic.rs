//! A scene whose objects move, and the tree that follows them.

use std::sync::Arc;

use glam::DAffine3;
use mullion_common::geometry::{Obb, axis_lengths};
use mullion_common::scene::{NodeId, ObjectId, Package, Presence, Scene};

use super::{Bounds, CullTree, TreeForm};

/// Greatest number in a transform: what a leaf's box becomes with it stays finite.
pub const MAX_TRANSFORM: f64 = 1e15;

/// A package's scene with objects that move (Nirnimesh, Harish, Narayanan 2006, section 5).
///
/// Leaves keep their numbers: sets of its tree are sets of the package's leaves.
#[derive(Debug)]
pub struct DynamicScene {
    package: Arc<Package>,
    tree: CullTree,
    /// Nodes of the package's hierarchy, by leaf.
    nodes: Vec<NodeId>,
    /// Leaves, object by object.
    leaves: Vec<u32>,
    /// Of each object, where its leaves start; one more at the end.
    starts: Vec<u32>,
    /// Objects with leaves that have moved, and where they stand.
    placed: Vec<(ObjectId, DAffine3)>,
    /// Of each object, its place in `placed`.
    place_of: Vec<u32>,
}

/// Not a place.
const NONE: u32 = u32::MAX;

impl DynamicScene {
    /// A scene in which everything is where the package has it.
    pub fn new(package: Arc<Package>, bounds: Bounds) -> Self {
        let scene = &package.scene;
        let tree = CullTree::editable(Arc::clone(&scene.hierarchy), bounds);
        let nodes = (0..).zip(scene.hierarchy.nodes()).filter(|(id, node)| node.subtree_end == id + 1).map(|(id, _)| NodeId(id));
        let nodes = nodes.collect();
        let mut starts = vec![0; scene.objects.len() + 1];
        for leaf in &scene.manifest.leaves {
            starts[leaf.object.0 as usize + 1] += 1;
        }
        for at in 1..starts.len() {
            starts[at] += starts[at - 1];
        }
        let mut next = starts.clone();
        let mut leaves = vec![0; scene.manifest.leaves.len()];
        for (leaf, record) in (0..).zip(&scene.manifest.leaves) {
            let place = &mut next[record.object.0 as usize];
            leaves[*place as usize] = leaf;
            *place += 1;
        }
        let place_of = vec![NONE; scene.objects.len()];
        Self { tree, nodes, leaves, starts, placed: Vec::new(), place_of, package }
    }

    /// The package, as it was prepared.
    pub fn package(&self) -> &Arc<Package> {
        &self.package
    }

    /// The tree, to be culled once it is refitted.
    pub fn tree(&self) -> &CullTree {
        &self.tree
    }

    /// The objects that have moved, in the order in which they first did, and where they stand. Objects without leaves are left out.
    pub(super) fn placed(&self) -> &[(ObjectId, DAffine3)] {
        &self.placed
    }

    pub(super) fn tree_mut(&mut self) -> &mut CullTree {
        &mut self.tree
    }

    /// Brings a form of the tree up to date with all that moved.
    pub fn refit(&mut self, form: TreeForm) {
        self.tree.refit(form);
    }

    /// Takes an object and all below it in the source file out of what is seen, or brings them back, whatever took them away. They come
    /// back where they would be if they had stayed.
    pub fn set_presence(&mut self, object: ObjectId, presence: Presence) {
        let leaves = &self.package.scene.objects[object.0 as usize].leaves;
        match presence {
            Presence::There => self.tree.restore_leaves(leaves),
            Presence::Away => self.tree.remove_leaves(leaves),
        }
    }

    /// Puts an object where `world_from_local` says, which must be finite. Objects below it stay where they are: each has a
    /// transform of its own in the world.
    pub fn move_object(&mut self, object: ObjectId, world_from_local: &DAffine3) {
        let scene = &self.package.scene;
        let at = object.0 as usize;
        let own = &self.leaves[self.starts[at] as usize..self.starts[at + 1] as usize];
        if own.is_empty() {
            return;
        }
        match self.placed.get_mut(self.place_of[at] as usize) {
            Some((_, known)) => *known = *world_from_local,
            None => {
                self.place_of[at] = self.placed.len() as u32;
                self.placed.push((object, *world_from_local));
            }
        }
        let move_from_rest = *world_from_local * scene.manifest.transforms[at].affine().inverse();
        let is_similarity = is_similarity(&move_from_rest);
        for leaf in own {
            let bound = if is_similarity {
                scene.hierarchy.node(self.nodes[*leaf as usize]).bound.transformed(&move_from_rest)
            } else {
                bound_of_box(scene, *leaf, world_from_local)
            };
            self.tree.move_leaf(*leaf, &bound);
        }
    }
}

/// Whether a transform keeps angles, so that what a box was grown by for rounding grows with it in every direction. False where it is
/// not finite.
fn is_similarity(m: &DAffine3) -> bool {
    const TOLERANCE: f64 = 1e-6;
    let [x, y, z] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis];
    let square = x.length_squared();
    let is_small = |value: f64| value.abs() <= TOLERANCE * square;
    square > 0.0
        && m.is_finite()
        && [x.dot(y), y.dot(z), z.dot(x), y.length_squared() - square, z.length_squared() - square].into_iter().all(is_small)
}

/// The box around a leaf's local box, grown by what the GPU's `f32` may round.
fn bound_of_box(scene: &Scene, leaf: u32, world_from_local: &DAffine3) -> Obb {
    let local = scene.manifest.leaves[leaf as usize].local_aabb();
    let rounded_m = local.rounding_m(axis_lengths(&world_from_local.matrix3));
    Obb::from(local).transformed(world_from_local).grown(rounded_m)
}
