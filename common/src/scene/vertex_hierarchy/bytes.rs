//! A hierarchy as bytes: a base, and blocks behind it. Arrays are padded to 4 bytes. All numbers little-endian.
//!
//! ```text
//! base:  "MLV1"  attributes u32  vertices in all u32  triangles in all u32  blocks u32
//!        base vertices u32  base triangles u32  materials u32  least and greatest coordinates 6 × f32
//!        vertices   triangles 3 × u32   materials u32
//! block: "MLVB"  first vertex u32  vertices u32  words of links u32
//!        vertices   splits 14 bytes   links u32
//! vertices: positions 3 × f32   texture coordinates 2 × f32   colours 4 × u8   parts u8: what there is of them
//! ```

use bytemuck::{Pod, Zeroable};
use thiserror::Error;

use super::{BaseMesh, MAX_BLOCK_VERTICES, MAX_PARTS, Split, VertexAttributes, VertexData, VertexHierarchy};
use crate::scene::MaterialId;
use crate::scene::arrays::{put, take};

const BASE_MAGIC: u32 = u32::from_le_bytes(*b"MLV1");
const BLOCK_MAGIC: u32 = u32::from_le_bytes(*b"MLVB");
const HAS_UVS: u32 = 1;
const HAS_COLORS: u32 = 2;

/// Why bytes or parts are no hierarchy, of vertices or of clusters.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum VertexHierarchyError {
    #[error("{found} bytes where the header asks for {expected}")]
    Length { found: usize, expected: u64 },
    #[error("header: {what} is {value}, allowed are {allowed}")]
    Header { what: &'static str, value: u32, allowed: &'static str },
    #[error("a coordinate is not finite")]
    NotFinite,
    #[error("{what}: {found}, expected are {expected}")]
    Count { what: &'static str, found: u64, expected: u64 },
    #[error("base triangle {triangle}: {problem}")]
    BaseTriangle { triangle: u32, problem: &'static str },
    #[error("vertex {vertex}: {problem}")]
    Split { vertex: u32, problem: &'static str },
    #[error("cluster {cluster}: {problem}")]
    Cluster { cluster: u32, problem: &'static str },
    #[error("group {group}: {problem}")]
    Group { group: u32, problem: &'static str },
    #[error("hierarchy {hierarchy}: {problem}")]
    Entry { hierarchy: u32, problem: &'static str },
}

/// Vertices that come together, as they lie in bytes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockParts {
    /// The first of them.
    pub first: u32,
    /// What is drawn of them.
    pub vertices: VertexData,
    /// One for each.
    pub splits: Vec<Split>,
    /// Their links, one behind the other.
    pub links: Vec<u32>,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct BaseHeader {
    magic: u32,
    attributes: u32,
    vertex_total: u32,
    triangle_total: u32,
    blocks: u32,
    vertices: u32,
    triangles: u32,
    materials: u32,
    local_min: [f32; 3],
    local_max: [f32; 3],
}
const _: () = assert!(size_of::<BaseHeader>() == 56);

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct BlockHeader {
    magic: u32,
    first: u32,
    vertices: u32,
    link_words: u32,
}
const _: () = assert!(size_of::<BlockHeader>() == 16);

/// What vertices have, as one word and the number of materials tell.
#[derive(Clone, Copy)]
pub(in crate::scene) struct VertexLayout {
    pub attributes: VertexAttributes,
    pub has_parts: bool,
}

impl VertexLayout {
    /// All that there may be: whatever is empty is not written.
    pub const ALL: Self = Self { attributes: VertexAttributes { uvs: true, colors: true }, has_parts: true };

    /// As a base names it.
    pub fn read(attributes: u32, materials: u32) -> Result<Self, VertexHierarchyError> {
        if attributes > HAS_UVS | HAS_COLORS {
            return Err(VertexHierarchyError::Header { what: "attributes", value: attributes, allowed: "0 to 3" });
        }
        if !(1..=MAX_PARTS).contains(&materials) {
            return Err(VertexHierarchyError::Header { what: "material count", value: materials, allowed: "1 to 256" });
        }
        let attributes = VertexAttributes { uvs: attributes & HAS_UVS != 0, colors: attributes & HAS_COLORS != 0 };
        Ok(Self { attributes, has_parts: materials > 1 })
    }

    /// The word that a base names it by.
    pub fn word(attributes: VertexAttributes) -> u32 {
        let flag = |present: bool, bit: u32| if present { bit } else { 0 };
        flag(attributes.uvs, HAS_UVS) | flag(attributes.colors, HAS_COLORS)
    }

    /// Bytes of so many vertices. Cannot overflow: a count of 32 bits, 25 bytes each.
    pub fn length(self, vertices: u32) -> u64 {
        let array = |present: bool, bytes: u64| if present { u64::from(vertices) * bytes } else { 0 };
        array(true, 12) + array(self.attributes.uvs, 8) + array(self.attributes.colors, 4) + padded(array(self.has_parts, 1))
    }

    pub fn write(self, vertices: &VertexData, bytes: &mut Vec<u8>) {
        let arrays: [&[u8]; 4] = [
            bytemuck::cast_slice(&vertices.positions),
            bytemuck::cast_slice(&vertices.uvs),
            bytemuck::cast_slice(&vertices.colors),
            &vertices.parts,
        ];
        arrays.into_iter().for_each(|array| put(bytes, array));
    }

    pub fn take(self, rest: &mut &[u8], vertices: u32) -> VertexData {
        let count = |present: bool| if present { vertices } else { 0 };
        VertexData {
            positions: take(rest, vertices),
            uvs: take(rest, count(self.attributes.uvs)),
            colors: take(rest, count(self.attributes.colors)),
            parts: take(rest, count(self.has_parts)),
        }
    }
}

impl BaseMesh {
    /// Its bytes. The same base gives the same bytes.
    pub fn encode(&self) -> Vec<u8> {
        let header = BaseHeader {
            magic: BASE_MAGIC,
            attributes: VertexLayout::word(self.attributes),
            vertex_total: self.vertex_total,
            triangle_total: self.triangle_total,
            blocks: self.block_count,
            vertices: self.vertices.positions.len() as u32,
            triangles: self.triangles.len() as u32,
            materials: self.materials.len() as u32,
            local_min: self.local_min,
            local_max: self.local_max,
        };
        let mut bytes = bytemuck::bytes_of(&header).to_vec();
        VertexLayout::ALL.write(&self.vertices, &mut bytes);
        put(&mut bytes, bytemuck::cast_slice(&self.triangles));
        put(&mut bytes, bytemuck::cast_slice(&self.materials));
        bytes
    }
}

impl BlockParts {
    /// Its bytes. The same block gives the same bytes.
    pub fn encode(&self) -> Vec<u8> {
        let header = BlockHeader {
            magic: BLOCK_MAGIC,
            first: self.first,
            vertices: self.vertices.positions.len() as u32,
            link_words: self.links.len() as u32,
        };
        let mut bytes = bytemuck::bytes_of(&header).to_vec();
        VertexLayout::ALL.write(&self.vertices, &mut bytes);
        put(&mut bytes, bytemuck::cast_slice(&self.splits));
        put(&mut bytes, bytemuck::cast_slice(&self.links));
        bytes
    }
}

impl VertexHierarchy {
    /// Reads and checks a base from outside; `material_count` is how many the scene has.
    ///
    /// # Errors
    /// When the bytes are cut off, or name what is not there.
    pub fn decode_base(bytes: &[u8], material_count: u32) -> Result<Self, VertexHierarchyError> {
        let (header, mut rest) = split_header::<BaseHeader>(bytes)?;
        if header.magic != BASE_MAGIC {
            return Err(VertexHierarchyError::Header { what: "magic", value: header.magic, allowed: "MLV1" });
        }
        let layout = VertexLayout::read(header.attributes, header.materials)?;
        let arrays = layout.length(header.vertices) + u64::from(header.triangles) * 12 + u64::from(header.materials) * 4;
        check_length(bytes, size_of::<BaseHeader>() as u64 + arrays)?;
        let base = BaseMesh {
            vertices: layout.take(&mut rest, header.vertices),
            triangles: take(&mut rest, header.triangles),
            materials: take::<MaterialId>(&mut rest, header.materials),
            attributes: layout.attributes,
            vertex_total: header.vertex_total,
            triangle_total: header.triangle_total,
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
    /// As [`VertexHierarchy::append`], and when the bytes are cut off.
    pub fn decode_block(&mut self, bytes: &[u8]) -> Result<(), VertexHierarchyError> {
        let (header, mut rest) = split_header::<BlockHeader>(bytes)?;
        if header.magic != BLOCK_MAGIC {
            return Err(VertexHierarchyError::Header { what: "magic", value: header.magic, allowed: "MLVB" });
        }
        if header.vertices > MAX_BLOCK_VERTICES {
            let what = "vertex count of the block";
            return Err(VertexHierarchyError::Header { what, value: header.vertices, allowed: "1 to 65536" });
        }
        let layout = VertexLayout { attributes: self.base.attributes, has_parts: self.base.materials.len() > 1 };
        let splits = padded(u64::from(header.vertices) * size_of::<Split>() as u64);
        let arrays = layout.length(header.vertices) + splits + u64::from(header.link_words) * 4;
        check_length(bytes, size_of::<BlockHeader>() as u64 + arrays)?;
        self.append(BlockParts {
            first: header.first,
            vertices: layout.take(&mut rest, header.vertices),
            splits: take(&mut rest, header.vertices),
            links: take(&mut rest, header.link_words),
        })
    }
}

pub(in crate::scene) fn padded(bytes: u64) -> u64 {
    bytes.next_multiple_of(4)
}

pub(in crate::scene) fn split_header<T: Pod>(bytes: &[u8]) -> Result<(T, &[u8]), VertexHierarchyError> {
    match bytes.split_at_checked(size_of::<T>()) {
        Some((header, rest)) => Ok((bytemuck::pod_read_unaligned(header), rest)),
        None => Err(VertexHierarchyError::Length { found: bytes.len(), expected: size_of::<T>() as u64 }),
    }
}

pub(in crate::scene) fn check_length(bytes: &[u8], expected: u64) -> Result<(), VertexHierarchyError> {
    if bytes.len() as u64 == expected { Ok(()) } else { Err(VertexHierarchyError::Length { found: bytes.len(), expected }) }
}

/// Whether the scene has these materials.
pub(in crate::scene) fn check_materials(materials: &[MaterialId], material_count: u32) -> Result<(), VertexHierarchyError> {
    match materials.iter().find(|material| material.0 >= material_count) {
        Some(MaterialId(value)) => {
            Err(VertexHierarchyError::Header { what: "material", value: *value, allowed: "materials of the scene" })
        }
        None => Ok(()),
    }
}
