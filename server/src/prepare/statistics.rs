//! What a scene amounts to.

use std::collections::HashSet;

use mullion_common::geometry::Aabb;
use mullion_common::scene::{ChunkKind, ObjectHierarchy, Package};
use serde::Serialize;

use crate::tree::FileTree;

/// Counts of a prepared scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneStatistics {
    /// Objects: nodes of the file and instances.
    pub objects: u64,
    /// Nodes of the object hierarchy.
    pub nodes: u64,
    /// Nodes that have children.
    pub inner_nodes: u64,
    /// Nodes of the file that have leaves below them, leaves among them.
    pub file_nodes: u64,
    /// Those of them that have children.
    pub file_inner_nodes: u64,
    /// Mean number of children of one that has some.
    pub file_branching: f64,
    /// Leaves.
    pub leaves: u64,
    /// Longest path from the root, in nodes.
    pub depth: u32,
    /// Mean number of children of an inner node.
    pub average_branching: f64,
    /// Triangles in geometry chunks, each counted once.
    pub triangles_unique: u64,
    /// Triangles as drawn, instances counted each.
    pub triangles_instanced: u64,
    /// Materials.
    pub materials: u64,
    /// Geometry chunks.
    pub geometry_chunks: u64,
    /// Texture chunks.
    pub texture_chunks: u64,
    /// Bytes of all chunks.
    pub chunk_bytes: u64,
    /// Least and greatest coordinates in the world, metres; `None` for a scene without triangles.
    pub bounds_m: Option<[[f64; 3]; 2]>,
}

/// Counts what a package holds.
pub fn statistics(package: &Package) -> SceneStatistics {
    let scene = &package.scene;
    let manifest = &scene.manifest;
    let nodes = scene.hierarchy.nodes();
    let inner_of = |tree: &ObjectHierarchy| (tree.nodes().len() - tree.leaf_count() as usize) as u64;
    let branching_of = |tree: &ObjectHierarchy| (tree.nodes().len().saturating_sub(1)) as f64 / inner_of(tree).max(1) as f64;
    let file = FileTree::of(scene).hierarchy;
    let chunks_of = |kind: ChunkKind| manifest.chunks.iter().filter(|c| c.kind() == Some(kind)).count() as u64;
    let mut counted = HashSet::new();
    let unique = manifest.leaves.iter().filter(|leaf| counted.insert(leaf.chunk));
    SceneStatistics {
        objects: scene.objects.len() as u64,
        nodes: nodes.len() as u64,
        inner_nodes: inner_of(&scene.hierarchy),
        file_nodes: file.nodes().len() as u64,
        file_inner_nodes: inner_of(&file),
        file_branching: branching_of(&file),
        leaves: manifest.leaves.len() as u64,
        depth: scene.hierarchy.depth(),
        average_branching: branching_of(&scene.hierarchy),
        triangles_unique: unique.map(|leaf| u64::from(leaf.triangle_count)).sum(),
        triangles_instanced: manifest.leaves.iter().map(|leaf| u64::from(leaf.triangle_count)).sum(),
        materials: manifest.materials.len() as u64,
        geometry_chunks: chunks_of(ChunkKind::Geometry),
        texture_chunks: chunks_of(ChunkKind::Texture),
        chunk_bytes: package.chunk_bytes(),
        bounds_m: scene_bounds(package).map(|b| [b.min.to_array(), b.max.to_array()]),
    }
}

/// The box around all leaves in the world; `None` for a scene without triangles. Encloses, and is exact where objects
/// are not turned.
pub fn scene_bounds(package: &Package) -> Option<Aabb> {
    let scene = &package.scene;
    let leaf_bounds = scene.hierarchy.leaf_nodes().map(|n| n.bound.aabb());
    let mut all = Aabb::EMPTY;
    let mut fitted = Aabb::EMPTY;
    for (leaf, bound) in scene.manifest.leaves.iter().zip(leaf_bounds) {
        all = all.union(&leaf.local_aabb().transformed(&scene.manifest.transforms[leaf.object.0 as usize].affine()));
        fitted = fitted.union(&bound);
    }
    let tight = Aabb { min: all.min.max(fitted.min), max: all.max.min(fitted.max) };
    (!all.is_empty()).then_some(tight)
}
