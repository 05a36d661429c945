//! Leaves and the objects that carry them.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::MaterialId;
use crate::geometry::Aabb;
use crate::visible_set::LeafRange;

/// An object: a node of the source file, or one instance of a node that is instanced. Stable for the life of a
/// scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Pod, Zeroable)]
#[repr(transparent)]
pub struct ObjectId(pub u32);

/// A chunk's place in the scene's table of chunks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Pod, Zeroable)]
#[repr(transparent)]
pub struct ChunkId(pub u32);

/// A leaf of the object hierarchy, as clients get it: what to draw, where, and how. 40 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LeafRecord {
    /// Whose transform places the leaf.
    pub object: ObjectId,
    /// Its geometry.
    pub chunk: ChunkId,
    /// How it looks.
    pub material: MaterialId,
    /// Triangles in the chunk.
    pub triangle_count: u32,
    /// Least coordinates of its vertices in the object's local space.
    pub local_min: [f32; 3],
    /// Greatest coordinates of its vertices in the object's local space.
    pub local_max: [f32; 3],
}
const _: () = assert!(size_of::<LeafRecord>() == 40);

impl LeafRecord {
    /// The bounds of its vertices in the object's local space.
    pub fn local_aabb(&self) -> Aabb {
        Aabb { min: Vec3::from(self.local_min).as_dvec3(), max: Vec3::from(self.local_max).as_dvec3() }
    }

    /// The middle of that box, and how far its corners are from there: what [`super::Facing`] is measured by.
    pub fn middle_and_radius(&self) -> (Vec3, f32) {
        let (low, high) = (Vec3::from(self.local_min), Vec3::from(self.local_max));
        (low * 0.5 + high * 0.5, ((high - low) * 0.5).length())
    }
}

/// Where an object stands: `world_from_local`, three columns and a translation, `f64`. 96 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Transform {
    columns: [[f64; 3]; 4],
}
const _: () = assert!(size_of::<Transform>() == 96);

impl From<DAffine3> for Transform {
    fn from(world_from_local: DAffine3) -> Self {
        Self { columns: world_from_local.to_cols_array_2d() }
    }
}

impl Transform {
    /// As a matrix, `world_from_local`.
    pub fn affine(&self) -> DAffine3 {
        DAffine3::from_cols_array_2d(&self.columns)
    }

    /// Whether every number in it is finite.
    pub fn is_finite(&self) -> bool {
        self.columns.iter().flatten().all(|v| v.is_finite())
    }

    /// Whether it turns the winding of triangles around.
    pub fn is_mirrored(&self) -> bool {
        DMat3::from_cols(DVec3::from(self.columns[0]), DVec3::from(self.columns[1]), DVec3::from(self.columns[2])).determinant()
            < 0.0
    }
}

/// What an object is called and where it came from. Stays on the master.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// The object above it, `None` for a root.
    pub parent: Option<ObjectId>,
    /// Name in the source file; may be empty.
    pub name: String,
    /// Index of the node in the source file.
    pub source_node: u32,
    /// Which instance of that node, where the node is instanced.
    pub instance: Option<u32>,
    /// Local transform, `parent_from_local`.
    pub parent_from_local: DAffine3,
    /// The leaves of its subtree, sorted.
    pub leaves: Vec<LeafRange>,
}

/// Whether an object is part of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Presence {
    /// It is culled, and drawn where it is seen.
    There,
    /// No view sees it.
    Away,
}
