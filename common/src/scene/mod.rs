//! A prepared scene: objects, leaves, materials, the object hierarchy, and the package that holds them.
//!
//! ```text
//! leaf ──→ object ──→ world_from_local (f64)
//!   ├────→ chunk: geometry in the object's local space, named by its hash, shared by instances
//!   └────→ material ──→ texture chunk
//! ```

mod arrays;
mod chunk;
mod chunk_data;
mod cluster_hierarchy;
mod growth;
mod hierarchy;
mod leaf;
mod lod_hierarchy;
mod material;
mod package;
mod tessellation;
mod vertex_hierarchy;

pub use chunk::{ChunkError, ChunkHash, GeometryChunk, MAX_CHUNK_BYTES, MAX_CHUNK_VERTICES};
pub use cluster_hierarchy::{
    ClusterBase, ClusterBlock, ClusterHierarchy, ClusterId, ClusterParts, ClusterSize, GroupId, GroupRecord, MAX_BLOCK_GROUPS,
    MAX_CLUSTER_TRIANGLES, MAX_CLUSTER_VERTICES, MAX_CLUSTERS, MAX_GROUP_MEMBERS, MAX_GROUP_RESULTS,
};
pub use growth::SceneSize;
pub use hierarchy::{HierarchyError, NodeId, ObjectHierarchy, OhNode};
pub use leaf::{ChunkId, LeafRecord, Object, ObjectId, Presence, Transform};
pub use lod_hierarchy::{Hierarchy, LodForm, LodTables, UnknownForm};
pub use material::{AlphaMode, Filter, Material, MaterialId, TextureRef, Wrap};
pub use package::{
    ChunkKind, ChunkRecord, LeafSource, MAX_PACKAGE_BYTES, PACKAGE_VERSION, Package, PackageError, Scene, SceneManifest,
    SectionKind, Sources,
};
pub use tessellation::{
    Cell, CellId, Cover, Exposure, ExposureWeights, FACES, Facing, FacingEye, LeafRun, MAX_CELLS, MAX_COVERED_TRIANGLES,
    NumberRows, Tessellation, TessellationError, TessellationParts, push_numbers,
};
pub use vertex_hierarchy::{
    BaseMesh, BlobRef, BlockParts, HierarchyEntry, HierarchyIndex, HierarchyTable, IndexedHierarchy, Link, LinkShape,
    MAX_BASE_TRIANGLES, MAX_BLOCK_VERTICES, MAX_HIERARCHIES, MAX_HIERARCHY_BLOB_BYTES, MAX_HIERARCHY_VERTICES, MAX_LINK,
    MAX_PARTS, NodeAxis, NodeBounds, NodeExtent, PackedBounds, Split, TrianglePlace, VertexAttributes, VertexData,
    VertexHierarchy, VertexHierarchyError, VertexId, greatest_first,
};
