//! A hierarchy as bytes: a base, and blocks behind it. Arrays are padded to 4 bytes. All numbers little-endian.
//!
//! ```text
//! base:  "MLC1"  attributes u32  vertices in all u32  triangles in all u32  groups in all u32  blocks u32
//!        vertices u32  materials u32  roots u32  their vertices u32  their triangles u32  least and greatest coordinates 6 × f32
//!        vertices   clusters   materials u32
//! block: "MLCB"  first group u32  groups u32  vertices u32  results u32  clusters u32  their vertices u32  their triangles u32
//!        vertices   groups 28 bytes   results u32   clusters
//! clusters: sizes 2 × u8   vertices u32   triangles 3 × u8
//! vertices: as in a vertex hierarchy
//! ```

use bytemuck::{Pod, Zeroable};

use super::{ClusterBase, ClusterBlock, ClusterHierarchy, ClusterId, ClusterParts, ClusterSize, GroupRecord, MAX_BLOCK_GROUPS};
use crate::scene::MaterialId;
use crate::scene::arrays::{put, take};
use crate::scene::vertex_hierarchy::{
    MAX_BLOCK_VERTICES, VertexHierarchyError, VertexLayout, check_length, check_materials, padded, split_header,
};

type Error = VertexHierarchyError;

const BASE_MAGIC: u32 = u32::from_le_bytes(*b"MLC1");
const BLOCK_MAGIC: u32 = u32::from_le_bytes(*b"MLCB");

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct BaseHeader {
    magic: u32,
    attributes: u32,
    vertex_total: u32,
    triangle_total: u32,
    group_total: u32,
    blocks: u32,
    vertices: u32,
    materials: u32,
    roots: PartCounts,
    local_min: [f32; 3],
    local_max: [f32; 3],
}
const _: () = assert!(size_of::<BaseHeader>() == 68);

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct BlockHeader {
    magic: u32,
    first: u32,
    groups: u32,
    vertices: u32,
    results: u32,
    members: PartCounts,
}
const _: () = assert!(size_of::<BlockHeader>() == 32);

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct PartCounts {
    clusters: u32,
    vertices: u32,
    triangles: u32,
}

impl PartCounts {
    /// Bytes of so many. Cannot overflow: counts of 32 bits, 4 bytes each.
    fn length(self) -> u64 {
        padded(u64::from(self.clusters) * 2) + u64::from(self.vertices) * 4 + padded(u64::from(self.triangles) * 3)
    }

    fn take(self, rest: &mut &[u8]) -> ClusterParts {
        ClusterParts {
            sizes: take::<ClusterSize>(rest, self.clusters),
            vertices: take(rest, self.vertices),
            triangles: take(rest, self.triangles),
        }
    }
}

impl ClusterParts {
    fn counts(&self) -> PartCounts {
        let [clusters, vertices, triangles] =
            [self.sizes.len(), self.vertices.len(), self.triangles.len()].map(|count| count as u32);
        PartCounts { clusters, vertices, triangles }
    }

    fn write(&self, bytes: &mut Vec<u8>) {
        put(bytes, bytemuck::cast_slice(&self.sizes));
        put(bytes, bytemuck::cast_slice(&self.vertices));
        put(bytes, bytemuck::cast_slice(&self.triangles));
    }
}

impl ClusterBase {
    /// Its bytes. The same base gives the same bytes.
    pub fn encode(&self) -> Vec<u8> {
        let header = BaseHeader {
            magic: BASE_MAGIC,
            attributes: VertexLayout::word(self.attributes),
            vertex_total: self.vertex_total,
            triangle_total: self.triangle_total,
            group_total: self.group_total,
            blocks: self.block_count,
            vertices: self.vertices.positions.len() as u32,
            materials: self.materials.len() as u32,
            roots: self.roots.counts(),
            local_min: self.local_min,
            local_max: self.local_max,
        };
        let mut bytes = bytemuck::bytes_of(&header).to_vec();
        VertexLayout::ALL.write(&self.vertices, &mut bytes);
        self.roots.write(&mut bytes);
        put(&mut bytes, bytemuck::cast_slice(&self.materials));
        bytes
    }
}

impl ClusterBlock {
    /// Its bytes. The same block gives the same bytes.
    pub fn encode(&self) -> Vec<u8> {
        let header = BlockHeader {
            magic: BLOCK_MAGIC,
            first: self.first,
            groups: self.groups.len() as u32,
            vertices: self.vertices.positions.len() as u32,
            results: self.results.len() as u32,
            members: self.members.counts(),
        };
        let mut bytes = bytemuck::bytes_of(&header).to_vec();
        VertexLayout::ALL.write(&self.vertices, &mut bytes);
        put(&mut bytes, bytemuck::cast_slice(&self.groups));
        put(&mut bytes, bytemuck::cast_slice(&self.results));
        self.members.write(&mut bytes);
        bytes
    }
}

/// Whether bytes begin as the base of a cluster hierarchy does.
pub fn is_cluster_base(bytes: &[u8]) -> bool {
    bytes.starts_with(&BASE_MAGIC.to_le_bytes())
}

impl ClusterHierarchy {
    /// Reads and checks a base from outside; `material_count` is how many the scene has.
    ///
    /// # Errors
    /// When the bytes are cut off, or name what is not there.
    pub fn decode_base(bytes: &[u8], material_count: u32) -> Result<Self, Error> {
        let (header, mut rest) = split_header::<BaseHeader>(bytes)?;
        if header.magic != BASE_MAGIC {
            return Err(Error::Header { what: "magic", value: header.magic, allowed: "MLC1" });
        }
        let layout = VertexLayout::read(header.attributes, header.materials)?;
        let arrays = layout.length(header.vertices) + header.roots.length() + u64::from(header.materials) * 4;
        check_length(bytes, size_of::<BaseHeader>() as u64 + arrays)?;
        let base = ClusterBase {
            vertices: layout.take(&mut rest, header.vertices),
            roots: header.roots.take(&mut rest),
            materials: take::<MaterialId>(&mut rest, header.materials),
            attributes: layout.attributes,
            vertex_total: header.vertex_total,
            triangle_total: header.triangle_total,
            group_total: header.group_total,
            block_count: header.blocks,
            local_min: header.local_min,
            local_max: header.local_max,
        };
        check_materials(&base.materials, material_count)?;
        Self::new(base)
    }

    /// Reads and checks the next block from outside, and puts it behind what is there. Where that fails, nothing changes. Takes no more memory
    /// than a few times the bytes' length, and what the arrays here grow by.
    ///
    /// # Errors
    /// As [`ClusterHierarchy::append`], and when the bytes are cut off.
    pub fn decode_block(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let (header, mut rest) = split_header::<BlockHeader>(bytes)?;
        if header.magic != BLOCK_MAGIC {
            return Err(Error::Header { what: "magic", value: header.magic, allowed: "MLCB" });
        }
        if header.groups > MAX_BLOCK_GROUPS {
            return Err(Error::Header { what: "group count of the block", value: header.groups, allowed: "1 to 65536" });
        }
        if header.vertices > MAX_BLOCK_VERTICES {
            return Err(Error::Header { what: "vertex count of the block", value: header.vertices, allowed: "0 to 65536" });
        }
        let layout = VertexLayout { attributes: self.base.attributes, has_parts: self.base.materials.len() > 1 };
        let groups = u64::from(header.groups) * size_of::<GroupRecord>() as u64;
        let arrays = layout.length(header.vertices) + groups + u64::from(header.results) * 4 + header.members.length();
        check_length(bytes, size_of::<BlockHeader>() as u64 + arrays)?;
        self.append(ClusterBlock {
            first: header.first,
            vertices: layout.take(&mut rest, header.vertices),
            groups: take(&mut rest, header.groups),
            results: take::<ClusterId>(&mut rest, header.results),
            members: header.members.take(&mut rest),
        })
    }
}
