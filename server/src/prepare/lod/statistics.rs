//! What hierarchies take beside the geometry that they are of.

use mullion_common::scene::{BaseMesh, BlockParts, Split};

use super::source::LodMesh;

/// How large the hierarchies of a package are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LodStatistics {
    /// Hierarchies.
    pub hierarchies: u64,
    /// Vertices of all of them.
    pub vertices: u64,
    /// Triangles of all of them, whole.
    pub triangles: u64,
    /// Triangles of their bases.
    pub base_triangles: u64,
    /// What they take beside positions, texture coordinates and colours, bytes.
    pub structure_bytes: u64,
}

impl LodStatistics {
    pub(super) fn add(&mut self, mesh: &LodMesh, base: &BaseMesh, blocks: &[BlockParts]) {
        let of_block = |block: &BlockParts| {
            size_of::<Split>() * block.splits.len() + size_of_val(&block.links[..]) + block.vertices.parts.len()
        };
        let structure = blocks.iter().map(of_block).sum::<usize>() + size_of_val(&base.triangles[..]) + base.vertices.parts.len();
        self.hierarchies += 1;
        self.vertices += u64::from(base.vertex_total);
        self.triangles += mesh.triangles.len() as u64;
        self.base_triangles += base.triangles.len() as u64;
        self.structure_bytes += structure as u64;
    }

    /// What they take beside the geometry, bytes a vertex.
    pub fn bytes_per_vertex(&self) -> f64 {
        self.structure_bytes as f64 / self.vertices.max(1) as f64
    }
}
