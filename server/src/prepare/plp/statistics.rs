//! What a tessellation takes beside the geometry that it is for.

use std::collections::BTreeSet;

use mullion_common::scene::{GeometryChunk, Package};

/// What a vertex takes on the GPU.
const VERTEX_BYTES: u64 = 24;
/// What a triangle takes there.
const TRIANGLE_BYTES: u64 = 6;

/// How large a tessellation is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TessellationStatistics {
    /// Tetrahedra.
    pub cells: u64,
    /// How many triangles all cells name together.
    pub references: u64,
    /// Triangles of all leaves that are covered.
    pub triangles: u64,
    /// What the tessellation takes in memory.
    pub bytes: u64,
    /// What the covered leaves' chunks take on the GPU, each once.
    pub geometry_bytes: u64,
    /// What they would take if every leaf had its own.
    pub instances_bytes: u64,
}

impl TessellationStatistics {
    /// Those of a package; `None` where it has no tessellation.
    pub fn of(package: &Package) -> Option<Self> {
        let tessellation = package.scene.tessellation.as_deref()?;
        let mut chunks = BTreeSet::new();
        let (mut geometry_bytes, mut instances_bytes) = (0, 0);
        for leaf in tessellation.leaves() {
            let record = &package.scene.manifest.leaves[*leaf as usize];
            let vertices = GeometryChunk::positions(package.chunk(record.chunk)).len() as u64;
            let bytes = vertices * VERTEX_BYTES + u64::from(record.triangle_count) * TRIANGLE_BYTES;
            instances_bytes += bytes;
            geometry_bytes += if chunks.insert(record.chunk) { bytes } else { 0 };
        }
        Some(Self {
            cells: tessellation.cells().len() as u64,
            references: tessellation.reference_count(),
            triangles: tessellation.slot_count().into(),
            bytes: tessellation.size_bytes(),
            geometry_bytes,
            instances_bytes,
        })
    }

    /// How many cells name a triangle on average.
    pub fn references_per_triangle(&self) -> f64 {
        self.references as f64 / self.triangles.max(1) as f64
    }

    /// Size, as a share of the geometry on the GPU.
    pub fn share_of_geometry(&self) -> f64 {
        self.bytes as f64 / self.geometry_bytes.max(1) as f64
    }

    /// Size, as a share of the geometry if no two leaves shared a chunk.
    pub fn share_of_instances(&self) -> f64 {
        self.bytes as f64 / self.instances_bytes.max(1) as f64
    }
}
