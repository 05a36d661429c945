//! A mesh of several levels of detail, of either form: vertices or clusters. The base's magic tells which.

use super::MaterialId;
use super::cluster_hierarchy::{ClusterHierarchy, is_cluster_base};
use super::vertex_hierarchy::{VertexData, VertexHierarchy, VertexHierarchyError};
use crate::geometry::Aabb;

/// A hierarchy as far as it is there: the base and the first blocks.
#[derive(Clone, Debug, PartialEq)]
pub enum Hierarchy {
    /// Refined a vertex at a time.
    Vertices(VertexHierarchy),
    /// Refined a group of clusters at a time.
    Clusters(ClusterHierarchy),
}

impl Hierarchy {
    /// Reads and checks a base from outside; `material_count` is how many the scene has.
    ///
    /// # Errors
    /// When the bytes are cut off, or name what is not there.
    pub fn decode_base(bytes: &[u8], material_count: u32) -> Result<Self, VertexHierarchyError> {
        if is_cluster_base(bytes) {
            ClusterHierarchy::decode_base(bytes, material_count).map(Self::Clusters)
        } else {
            VertexHierarchy::decode_base(bytes, material_count).map(Self::Vertices)
        }
    }

    /// Reads and checks the next block from outside, and puts it behind what is there. Where that fails, nothing changes.
    ///
    /// # Errors
    /// As [`VertexHierarchy::decode_block`] and [`ClusterHierarchy::decode_block`].
    pub fn decode_block(&mut self, bytes: &[u8]) -> Result<(), VertexHierarchyError> {
        match self {
            Self::Vertices(hierarchy) => hierarchy.decode_block(bytes),
            Self::Clusters(hierarchy) => hierarchy.decode_block(bytes),
        }
    }

    /// What it takes of memory as far as it is there, bytes.
    pub fn memory_bytes(&self) -> u64 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.memory_bytes(),
            Self::Clusters(hierarchy) => hierarchy.memory_bytes(),
        }
    }

    /// Blocks that are there.
    pub fn block_count(&self) -> u32 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.block_count(),
            Self::Clusters(hierarchy) => hierarchy.block_count(),
        }
    }

    /// Blocks of the whole.
    pub fn block_total(&self) -> u32 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.base().block_count,
            Self::Clusters(hierarchy) => hierarchy.block_total(),
        }
    }

    /// What its triangles look like. One at least.
    pub fn materials(&self) -> &[MaterialId] {
        match self {
            Self::Vertices(hierarchy) => &hierarchy.base().materials,
            Self::Clusters(hierarchy) => hierarchy.materials(),
        }
    }

    /// All vertices that are there.
    pub fn vertices(&self) -> &VertexData {
        match self {
            Self::Vertices(hierarchy) => hierarchy.vertices(),
            Self::Clusters(hierarchy) => hierarchy.vertices(),
        }
    }

    /// What a triangle with this vertex looks like.
    pub fn material(&self, vertex: u32) -> MaterialId {
        let part = self.vertices().parts.get(vertex as usize).copied().unwrap_or(0);
        self.materials()[usize::from(part)]
    }

    /// What encloses whatever is drawn of it.
    pub fn local_aabb(&self) -> Aabb {
        match self {
            Self::Vertices(hierarchy) => hierarchy.local_aabb(),
            Self::Clusters(hierarchy) => hierarchy.local_aabb(),
        }
    }

    /// Triangles once all that is there is refined.
    pub fn triangle_count(&self) -> u32 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.triangle_count(),
            Self::Clusters(hierarchy) => hierarchy.triangle_count(),
        }
    }

    /// The hierarchy, if it is one of vertices.
    pub fn into_vertices(self) -> Option<VertexHierarchy> {
        match self {
            Self::Vertices(hierarchy) => Some(hierarchy),
            Self::Clusters(_) => None,
        }
    }

    /// The hierarchy, if it is one of clusters.
    pub fn into_clusters(self) -> Option<ClusterHierarchy> {
        match self {
            Self::Vertices(_) => None,
            Self::Clusters(hierarchy) => Some(hierarchy),
        }
    }
}
