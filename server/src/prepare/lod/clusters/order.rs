//! Groups in the order of their errors, the greatest first: what is needed has no less, and was made later. Then clusters and vertices in the
//! order in which groups need them.

use std::cmp::Reverse;

use mullion_common::scene::{
    ClusterBase, ClusterBlock, ClusterId, ClusterParts, GroupRecord, MAX_BLOCK_GROUPS, MAX_CLUSTER_VERTICES,
};

use super::super::source::LodMesh;
use super::{Cluster, Group, NONE};

/// The base, and the groups in blocks of about so many vertices.
pub(super) fn blocks(
    mesh: &LodMesh,
    roots: Vec<Cluster>,
    groups: Vec<Group>,
    block_vertices: u32,
) -> (ClusterBase, Vec<ClusterBlock>) {
    let mut order: Vec<usize> = (0..groups.len()).collect();
    // Errors are no less than 0: their bits ascend as they do.
    order.sort_unstable_by_key(|group| Reverse((groups[*group].error_m.to_bits(), *group)));
    let clusters = roots.iter().chain(order.iter().flat_map(|group| &groups[*group].members));
    let mut results: Vec<Vec<ClusterId>> = vec![Vec::new(); groups.len()];
    for (id, cluster) in (0..).map(ClusterId).zip(clusters) {
        if cluster.maker != NONE {
            results[cluster.maker as usize].push(id);
        }
    }
    let mut numbering = Numbering { numbers: vec![NONE; mesh.positions.len()], vertices: Vec::new() };
    let mut base = ClusterBase { materials: mesh.materials.clone(), attributes: mesh.attributes(), ..ClusterBase::default() };
    roots.iter().for_each(|root| numbering.push(&mut base.roots, root));
    base.vertices = mesh.vertex_data(&numbering.vertices);

    let mut blocks = Vec::new();
    let mut block = ClusterBlock::default();
    let mut first_vertex = numbering.vertices.len();
    for (number, group) in (0..).zip(order) {
        let Group { members, bounds, .. } = &groups[group];
        let vertices = numbering.vertices.len() - first_vertex + numbering.missing(members);
        let is_full = vertices > block_vertices as usize || block.groups.len() >= MAX_BLOCK_GROUPS as usize;
        if is_full && !block.groups.is_empty() {
            block.vertices = mesh.vertex_data(&numbering.vertices[first_vertex..]);
            first_vertex = numbering.vertices.len();
            blocks.push(std::mem::replace(&mut block, ClusterBlock { first: number, ..ClusterBlock::default() }));
        }
        members.iter().for_each(|member| numbering.push(&mut block.members, member));
        block.groups.push(GroupRecord {
            center: bounds.center.to_array(),
            bounds: bounds.packed,
            // Both fit: groups of more are not made.
            members: members.len() as u8,
            results: results[group].len() as u16,
        });
        block.results.append(&mut results[group]);
    }
    if !block.groups.is_empty() {
        block.vertices = mesh.vertex_data(&numbering.vertices[first_vertex..]);
        blocks.push(block);
    }
    let (local_min, local_max) = mesh.bounds();
    (base.local_min, base.local_max) = (local_min.to_array(), local_max.to_array());
    base.vertex_total = numbering.vertices.len() as u32;
    base.triangle_total = mesh.triangles.len() as u32;
    base.group_total = groups.len() as u32;
    base.block_count = blocks.len() as u32;
    (base, blocks)
}

/// Vertices by when they are needed first.
struct Numbering {
    /// For each vertex of the mesh its number, or [`NONE`].
    numbers: Vec<u32>,
    /// By number.
    vertices: Vec<u32>,
}

impl Numbering {
    /// How many vertices of clusters have no number yet.
    fn missing(&self, clusters: &[Cluster]) -> usize {
        let corners = clusters.iter().flat_map(|cluster| cluster.triangles.as_flattened());
        let mut missing: Vec<u32> = corners.copied().filter(|v| self.numbers[*v as usize] == NONE).collect();
        missing.sort_unstable();
        missing.dedup();
        missing.len()
    }

    fn push(&mut self, parts: &mut ClusterParts, cluster: &Cluster) {
        let mut vertices: Vec<u32> = Vec::with_capacity(MAX_CLUSTER_VERTICES as usize);
        let mut place = |v: u32| {
            let number = &mut self.numbers[v as usize];
            if *number == NONE {
                *number = self.vertices.len() as u32;
                self.vertices.push(v);
            }
            let found = vertices.iter().position(|other| other == number);
            found.unwrap_or_else(|| {
                vertices.push(*number);
                vertices.len() - 1
            }) as u8
        };
        let triangles: Vec<[u8; 3]> = cluster.triangles.iter().map(|t| t.map(&mut place)).collect();
        parts.push(vertices.into_iter(), &triangles);
    }
}
