//! What hierarchies take beside the geometry that they are of.

use mullion_common::scene::{BaseMesh, BlockParts, ClusterBase, ClusterBlock, Split};

/// How large the hierarchies of a package are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LodStatistics {
    /// Hierarchies.
    pub hierarchies: u64,
    /// Vertices of all of them.
    pub vertices: u64,
    /// Triangles of all of them, whole.
    pub triangles: u64,
    /// Triangles of their bases: of their roots, where they are of clusters.
    pub base_triangles: u64,
    /// What they take beside positions, texture coordinates and colours, bytes.
    pub structure_bytes: u64,
    /// Groups of clusters.
    pub groups: u64,
    /// Clusters, roots too.
    pub clusters: u64,
}

impl LodStatistics {
    pub(super) fn add(&mut self, base: &BaseMesh, blocks: &[BlockParts]) {
        let of_block = |block: &BlockParts| {
            size_of::<Split>() * block.splits.len() + size_of_val(&block.links[..]) + block.vertices.parts.len()
        };
        let structure = blocks.iter().map(of_block).sum::<usize>() + size_of_val(&base.triangles[..]) + base.vertices.parts.len();
        self.hierarchies += 1;
        self.vertices += u64::from(base.vertex_total);
        self.triangles += u64::from(base.triangle_total);
        self.base_triangles += base.triangles.len() as u64;
        self.structure_bytes += structure as u64;
    }

    pub(super) fn add_clusters(&mut self, base: &ClusterBase, blocks: &[ClusterBlock]) {
        let of_block = |block: &ClusterBlock| {
            let groups = size_of_val(&block.groups[..]) + size_of_val(&block.results[..]);
            groups + block.members.structure_bytes() + block.vertices.parts.len()
        };
        let of_base = base.roots.structure_bytes() + base.vertices.parts.len();
        self.hierarchies += 1;
        self.vertices += u64::from(base.vertex_total);
        self.triangles += u64::from(base.triangle_total);
        self.base_triangles += base.roots.triangles.len() as u64;
        self.structure_bytes += (blocks.iter().map(of_block).sum::<usize>() + of_base) as u64;
        self.groups += u64::from(base.group_total);
        let members = blocks.iter().map(|block| block.members.sizes.len()).sum::<usize>();
        self.clusters += (base.roots.sizes.len() + members) as u64;
    }

    /// What they take beside the geometry, bytes a vertex.
    pub fn bytes_per_vertex(&self) -> f64 {
        self.structure_bytes as f64 / self.vertices.max(1) as f64
    }
}
