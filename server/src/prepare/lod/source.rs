//! Meshes as the package's leaves hold them: joined again where they were divided, vertices that look the same made one.

use std::collections::HashMap;

use glam::Vec3;
use mullion_common::scene::{
    AlphaMode, ChunkId, GeometryChunk, MAX_HIERARCHY_VERTICES, MAX_PARTS, MaterialId, ObjectId, Package, VertexAttributes,
    VertexData,
};

/// Most triangles of a mesh that is simplified: their corners have 32 bits.
pub const MAX_LOD_TRIANGLES: usize = 1 << 27;

/// Objects with the same leaves.
pub(super) struct Group {
    /// Ascending.
    pub objects: Vec<ObjectId>,
    pub leaves: Vec<(ChunkId, MaterialId)>,
}

/// The objects that are worth a hierarchy, by what they show, in the order of the first of each.
pub(super) fn groups(package: &Package, least_triangles: u32) -> Vec<Group> {
    let manifest = &package.scene.manifest;
    let mut leaves: Vec<(ObjectId, ChunkId, MaterialId, u32)> =
        manifest.leaves.iter().map(|leaf| (leaf.object, leaf.chunk, leaf.material, leaf.triangle_count)).collect();
    leaves.sort_unstable();
    let mut places: HashMap<Vec<(ChunkId, MaterialId)>, usize> = HashMap::new();
    let mut groups: Vec<Group> = Vec::new();
    for own in leaves.chunk_by(|a, b| a.0 == b.0) {
        let triangles: u64 = own.iter().map(|leaf| u64::from(leaf.3)).sum();
        let blends =
            |leaf: &(ObjectId, ChunkId, MaterialId, u32)| manifest.materials[leaf.2.0 as usize].alpha == AlphaMode::Blend;
        if triangles < u64::from(least_triangles) || triangles > MAX_LOD_TRIANGLES as u64 || own.iter().any(blends) {
            continue;
        }
        let key: Vec<(ChunkId, MaterialId)> = own.iter().map(|leaf| (leaf.1, leaf.2)).collect();
        let place = *places.entry(key).or_insert_with_key(|key| {
            groups.push(Group { objects: Vec::new(), leaves: key.clone() });
            groups.len() - 1
        });
        groups[place].objects.push(own[0].0);
    }
    groups
}

/// A mesh to simplify, in local space. Vertices are in one place if their welds are the same.
#[derive(Clone, Debug, Default)]
pub struct LodMesh {
    pub(super) positions: Vec<Vec3>,
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) colors: Vec<[u8; 4]>,
    pub(super) parts: Vec<u8>,
    pub(super) materials: Vec<MaterialId>,
    /// Counterclockwise from the front; no two corners in one place.
    pub(super) triangles: Vec<[u32; 3]>,
    /// For each vertex the first one in its place.
    pub(super) welds: Vec<u32>,
    /// For each vertex the next one in its place, and after the last the first. Empty where all places differ.
    pub(super) wedges: Vec<u32>,
}

impl LodMesh {
    /// A mesh of positions alone, welded.
    pub fn of_triangles(positions: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let mut welder = Welder::new(positions.len(), VertexAttributes::default(), vec![MaterialId(0)]);
        let vertices: Vec<u32> = positions.iter().map(|p| welder.vertex(*p, [0.0; 2], [0; 4], 0)).collect();
        triangles.iter().for_each(|t| welder.triangle(t.map(|corner| vertices[corner as usize])));
        welder.finish()
    }

    /// Positions of its vertices.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Its triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// For each vertex the first one in its place.
    pub fn welds(&self) -> &[u32] {
        &self.welds
    }

    /// The vertices in a vertex's place, itself first.
    pub(super) fn wedges_of(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let next = move |v: &u32| self.wedges.get(*v as usize).copied().filter(|next| *next != vertex);
        std::iter::successors(Some(vertex), next)
    }

    /// Links the vertices that are in one place.
    pub(super) fn link_wedges(&mut self) {
        self.wedges = (0..self.positions.len() as u32).collect();
        for v in 0..self.positions.len() {
            let first = self.welds[v] as usize;
            if first != v {
                self.wedges[v] = self.wedges[first];
                self.wedges[first] = v as u32;
            }
        }
    }

    pub(super) fn attributes(&self) -> VertexAttributes {
        VertexAttributes { uvs: !self.uvs.is_empty(), colors: !self.colors.is_empty() }
    }

    pub(super) fn bounds(&self) -> (Vec3, Vec3) {
        match self.positions.split_first() {
            Some((first, rest)) => rest.iter().fold((*first, *first), |(low, high), p| (low.min(*p), high.max(*p))),
            None => (Vec3::ZERO, Vec3::ZERO),
        }
    }

    /// What is drawn of some vertices, in their order.
    pub(super) fn vertex_data(&self, vertices: &[u32]) -> VertexData {
        VertexData {
            positions: vertices.iter().map(|v| self.positions[*v as usize].to_array()).collect(),
            uvs: pick(&self.uvs, vertices),
            colors: pick(&self.colors, vertices),
            parts: pick(&self.parts, vertices),
        }
    }
}

/// What is known of some vertices, where anything is.
pub(super) fn pick<T: Copy>(all: &[T], vertices: &[u32]) -> Vec<T> {
    if all.is_empty() { Vec::new() } else { vertices.iter().map(|v| all[*v as usize]).collect() }
}

/// The mesh of a group's leaves; `None` where a hierarchy cannot hold it or nothing is left of it.
pub(super) fn mesh(package: &Package, group: &Group) -> Option<LodMesh> {
    let mut materials: Vec<MaterialId> = group.leaves.iter().map(|leaf| leaf.1).collect();
    materials.sort_unstable();
    materials.dedup();
    if materials.len() > MAX_PARTS as usize {
        return None;
    }
    let (mut vertices, mut attributes) = (0, VertexAttributes::default());
    for (chunk, _) in &group.leaves {
        let (count, found) = GeometryChunk::vertices_and_attributes(package.chunk(*chunk));
        vertices += count as usize;
        attributes.uvs |= found.uvs;
        attributes.colors |= found.colors;
    }
    let mut welder = Welder::new(vertices, attributes, materials);
    for (chunk, material) in &group.leaves {
        let chunk = GeometryChunk::decode(package.chunk(*chunk)).ok()?;
        let part = welder.mesh.materials.iter().position(|m| m == material)? as u8;
        let of = |k: usize, p: &[f32; 3]| {
            let uv = chunk.uvs.get(k).copied().unwrap_or_default();
            (Vec3::from(*p), uv, chunk.colors.get(k).copied().unwrap_or([255; 4]), part)
        };
        let vertices: Vec<u32> = chunk
            .positions
            .iter()
            .enumerate()
            .map(|(k, p)| of(k, p))
            .map(|(position, uv, color, part)| welder.vertex(position, uv, color, part))
            .collect();
        for t in chunk.indices.chunks_exact(3) {
            welder.triangle([t[0], t[1], t[2]].map(|k| vertices[usize::from(k)]));
        }
    }
    let mesh = welder.finish();
    (!mesh.triangles.is_empty() && mesh.positions.len() <= MAX_HIERARCHY_VERTICES as usize).then_some(mesh)
}

/// Joins vertices that are the same in all that is drawn of them. Those that only are in one place are linked.
pub(super) struct Welder {
    mesh: LodMesh,
    attributes: VertexAttributes,
    /// Vertices by a hash of their position; open addressing.
    table: Vec<u32>,
    has_seams: bool,
}

const EMPTY: u32 = u32::MAX;

impl Welder {
    pub fn new(vertices: usize, attributes: VertexAttributes, materials: Vec<MaterialId>) -> Self {
        let mesh = LodMesh { materials, ..LodMesh::default() };
        Self { mesh, attributes, table: vec![EMPTY; (vertices.max(4) * 3 / 2).next_power_of_two()], has_seams: false }
    }

    pub fn vertex(&mut self, position: Vec3, uv: [f32; 2], color: [u8; 4], part: u8) -> u32 {
        let position = position + 0.0; // −0 is the same place as 0
        let mask = self.table.len() - 1;
        let mut at = hash(position) as usize & mask;
        let mut in_place = EMPTY;
        while self.table[at] != EMPTY {
            let other = self.table[at];
            if self.mesh.positions[other as usize] == position {
                if self.looks_like(other as usize, uv, color, part) {
                    return other;
                }
                in_place = in_place.min(other);
            }
            at = (at + 1) & mask;
        }
        let id = self.mesh.positions.len() as u32;
        self.table[at] = id;
        self.mesh.positions.push(position);
        if self.attributes.uvs {
            self.mesh.uvs.push(uv);
        }
        if self.attributes.colors {
            self.mesh.colors.push(color);
        }
        if self.mesh.materials.len() > 1 {
            self.mesh.parts.push(part);
        }
        self.mesh.welds.push(in_place.min(id));
        self.has_seams |= in_place != EMPTY;
        id
    }

    fn looks_like(&self, other: usize, uv: [f32; 2], color: [u8; 4], part: u8) -> bool {
        self.mesh.uvs.get(other).is_none_or(|found| *found == uv)
            && self.mesh.colors.get(other).is_none_or(|found| *found == color)
            && self.mesh.parts.get(other).is_none_or(|found| *found == part)
    }

    /// Takes a triangle, unless two of its corners are in one place: nothing is drawn of it.
    pub fn triangle(&mut self, corners: [u32; 3]) {
        let [a, b, c] = corners.map(|v| self.mesh.welds[v as usize]);
        if a != b && b != c && c != a {
            self.mesh.triangles.push(corners);
        }
    }

    pub fn finish(self) -> LodMesh {
        let mut mesh = self.mesh;
        if self.has_seams {
            mesh.link_wedges();
        }
        mesh
    }
}

fn hash(position: Vec3) -> u64 {
    let [x, y, z] = position.to_array().map(|c| u64::from(c.to_bits()));
    let mixed = (x | y << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ z.wrapping_mul(0xc2b2_ae3d_27d4_eb4f).rotate_left(29);
    (mixed ^ mixed >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93) >> 24
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_looks_the_same_is_one_vertex() {
        let attributes = VertexAttributes { uvs: true, colors: false };
        let mut welder = Welder::new(6, attributes, vec![MaterialId(0)]);
        let a = welder.vertex(Vec3::ZERO, [0.0, 0.0], [1; 4], 0);
        let b = welder.vertex(Vec3::new(-0.0, 0.0, 0.0), [0.0, 0.0], [2; 4], 0);
        let c = welder.vertex(Vec3::ZERO, [0.5, 0.0], [1; 4], 0);
        let d = welder.vertex(Vec3::ZERO, [0.7, 0.0], [1; 4], 0);
        let e = welder.vertex(Vec3::X, [0.0, 0.0], [1; 4], 0);
        let f = welder.vertex(Vec3::Y, [0.0, 0.0], [1; 4], 0);
        assert_eq!((a, b), (0, 0));
        welder.triangle([a, c, e]);
        welder.triangle([d, e, f]);
        let mesh = welder.finish();
        assert_eq!(mesh.triangles, [[d, e, f]], "what lies between two vertices in one place is not drawn");
        assert_eq!(mesh.welds, [0, 0, 0, 3, 4]);
        let mut wedges: Vec<u32> = mesh.wedges_of(c).collect();
        assert_eq!(wedges[0], c);
        wedges.sort_unstable();
        assert_eq!(wedges, [a, c, d]);
        assert_eq!(mesh.wedges_of(e).count(), 1);
    }
}
