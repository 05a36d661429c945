//! Chunks: immutable bytes named by their hash. A geometry chunk holds the triangles of one leaf.

use std::fmt;

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::VertexAttributes;

/// Most bytes in one chunk.
pub const MAX_CHUNK_BYTES: usize = 256 << 20;

/// Most vertices in one geometry chunk: its indices are 16 bits wide.
pub const MAX_CHUNK_VERTICES: usize = 1 << 16;

/// BLAKE3 hash of a chunk's bytes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Pod, Zeroable)]
#[repr(transparent)]
pub struct ChunkHash(pub [u8; 32]);

impl ChunkHash {
    /// The name of these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// The name of these bytes, one slice behind the other.
    pub fn of_slices<'a>(slices: impl Iterator<Item = &'a [u8]>) -> Self {
        let mut hasher = blake3::Hasher::new();
        for bytes in slices {
            hasher.update(bytes);
        }
        Self(*hasher.finalize().as_bytes())
    }
}

impl fmt::Display for ChunkHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for ChunkHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ChunkHash({self})")
    }
}

/// Why bytes are no geometry chunk.
#[derive(Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum ChunkError {
    #[error("chunk of {found} bytes where its header asks for {expected}")]
    Length { found: usize, expected: usize },
    #[error("chunk header: {what} is {value}, allowed are {allowed}")]
    Header { what: &'static str, value: u32, allowed: &'static str },
    #[error("index {index} of triangle {triangle} is past the chunk's {vertices} vertices")]
    Index { triangle: u32, index: u16, vertices: u32 },
}

/// Vertices and triangles of one leaf, in the object's local space.
///
/// As bytes: a header of four little-endian `u32` (magic `MLC1`, vertex count, index count, attributes present),
/// then the arrays in the order of the fields below, indices padded to 4 bytes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GeometryChunk {
    /// Positions, metres.
    pub positions: Vec<[f32; 3]>,
    /// For each vertex its number in the primitive that the leaf was cut from: leaves cut from one mesh share
    /// these numbers where they share a vertex.
    pub vertex_ids: Vec<u32>,
    /// Base colour texture coordinates, or empty.
    pub uvs: Vec<[f32; 2]>,
    /// Vertex colours, linear RGBA, unsigned normalised, or empty.
    pub colors: Vec<[u8; 4]>,
    /// Normals, signed normalised x, y, z and padding, or empty.
    pub normals: Vec<[i8; 4]>,
    /// Vertices of the triangles, three each.
    pub indices: Vec<u16>,
}

const MAGIC: u32 = u32::from_le_bytes(*b"MLC1");
const HAS_UVS: u32 = 1;
const HAS_COLORS: u32 = 2;
const HAS_NORMALS: u32 = 4;

impl GeometryChunk {
    /// Its bytes. The same chunk gives the same bytes.
    ///
    /// # Panics
    /// When attributes have another count than positions: the chunk was built wrong.
    pub fn encode(&self) -> Vec<u8> {
        let vertices = self.positions.len();
        let flag = |present: bool, bit: u32| if present { bit } else { 0 };
        assert_eq!(self.vertex_ids.len(), vertices, "a vertex id for each vertex");
        assert!(self.uvs.is_empty() || self.uvs.len() == vertices, "texture coordinates for each vertex or none");
        assert!(self.colors.is_empty() || self.colors.len() == vertices, "a colour for each vertex or none");
        assert!(self.normals.is_empty() || self.normals.len() == vertices, "a normal for each vertex or none");
        let attributes = flag(!self.uvs.is_empty(), HAS_UVS)
            | flag(!self.colors.is_empty(), HAS_COLORS)
            | flag(!self.normals.is_empty(), HAS_NORMALS);
        let header = [MAGIC, vertices as u32, self.indices.len() as u32, attributes];
        let mut bytes = Vec::with_capacity(encoded_length(&header));
        bytes.extend_from_slice(bytemuck::cast_slice(&header));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.positions));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.vertex_ids));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.uvs));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.colors));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.normals));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.indices));
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        bytes
    }

    /// Triangles in an encoded chunk, from its header; 0 where there is none.
    pub fn triangle_count(bytes: &[u8]) -> u32 {
        bytes.get(8..12).map_or(0, |b| bytemuck::pod_read_unaligned::<u32>(b) / 3)
    }

    /// The positions in an encoded chunk; empty where its bytes are cut off.
    pub fn positions(bytes: &[u8]) -> Vec<[f32; 3]> {
        let count = bytes.get(4..8).map_or(0, |b| bytemuck::pod_read_unaligned::<u32>(b) as usize);
        bytes.get(16..16 + count * 12).map(bytemuck::pod_collect_to_vec).unwrap_or_default()
    }

    /// Vertices in an encoded chunk and what they have, from its header; none where there is none.
    pub fn vertices_and_attributes(bytes: &[u8]) -> (u32, VertexAttributes) {
        let word = |at: usize| bytes.get(at..at + 4).map_or(0, bytemuck::pod_read_unaligned::<u32>);
        (word(4), VertexAttributes { uvs: word(12) & HAS_UVS != 0, colors: word(12) & HAS_COLORS != 0 })
    }

    /// Reads and checks bytes from outside: lengths agree, triangles are whole, every index names a vertex.
    ///
    /// # Errors
    /// When they do not.
    pub fn decode(bytes: &[u8]) -> Result<Self, ChunkError> {
        const HEADER_BYTES: usize = 16;
        let Some((header, mut rest)) = bytes.split_at_checked(HEADER_BYTES) else {
            return Err(ChunkError::Length { found: bytes.len(), expected: HEADER_BYTES });
        };
        let header: [u32; 4] = bytemuck::pod_read_unaligned(header);
        let [magic, vertices, index_count, attributes] = header;
        let refuse = |what, value, allowed| Err(ChunkError::Header { what, value, allowed });
        if magic != MAGIC {
            return refuse("magic", magic, "MLC1");
        }
        if vertices as usize > MAX_CHUNK_VERTICES {
            return refuse("vertex count", vertices, "0 to 65536");
        }
        if !index_count.is_multiple_of(3) || index_count as usize > MAX_CHUNK_BYTES / 2 {
            return refuse("index count", index_count, "multiples of three up to the cap on a chunk");
        }
        if attributes > (HAS_UVS | HAS_COLORS | HAS_NORMALS) {
            return refuse("attributes", attributes, "0 to 7");
        }
        let expected = encoded_length(&header);
        if bytes.len() != expected {
            return Err(ChunkError::Length { found: bytes.len(), expected });
        }
        let count = |bit: u32| if attributes & bit == 0 { 0 } else { vertices as usize };
        let chunk = Self {
            positions: take(&mut rest, vertices as usize),
            vertex_ids: take(&mut rest, vertices as usize),
            uvs: take(&mut rest, count(HAS_UVS)),
            colors: take(&mut rest, count(HAS_COLORS)),
            normals: take(&mut rest, count(HAS_NORMALS)),
            indices: take(&mut rest, index_count as usize),
        };
        match chunk.indices.iter().position(|&i| u32::from(i) >= vertices) {
            Some(at) => Err(ChunkError::Index { triangle: at as u32 / 3, index: chunk.indices[at], vertices }),
            None => Ok(chunk),
        }
    }
}

/// Splits `count` elements off the front of `rest`, which the caller has checked to be long enough.
fn take<T: Pod>(rest: &mut &[u8], count: usize) -> Vec<T> {
    let (head, tail) = rest.split_at(count * size_of::<T>());
    *rest = tail;
    bytemuck::pod_collect_to_vec(head)
}

fn encoded_length(&[_, vertices, indices, attributes]: &[u32; 4]) -> usize {
    let optional = |bit: u32, bytes: usize| if attributes & bit == 0 { 0 } else { bytes };
    let per_vertex = 12 + 4 + optional(HAS_UVS, 8) + optional(HAS_COLORS, 4) + optional(HAS_NORMALS, 4);
    (16 + vertices as usize * per_vertex + indices as usize * 2).next_multiple_of(4)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> GeometryChunk {
        GeometryChunk {
            positions: vec![[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 9.0]],
            vertex_ids: vec![7, 8, 11],
            uvs: vec![[0.0, 0.5]; 3],
            colors: Vec::new(),
            normals: vec![[0, 0, 127, 0]; 3],
            indices: vec![0, 1, 2],
        }
    }

    #[test]
    fn bytes_go_round_and_bad_ones_are_refused() {
        let bytes = sample().encode();
        assert_eq!(GeometryChunk::decode(&bytes), Ok(sample()));
        for cut in 0..bytes.len() {
            assert!(GeometryChunk::decode(&bytes[..cut]).is_err(), "cut at {cut}");
        }
        let with_word = |word: usize, value: u32| {
            let mut bytes = bytes.clone();
            bytes[word * 4..][..4].copy_from_slice(&value.to_le_bytes());
            GeometryChunk::decode(&bytes)
        };
        assert!(matches!(with_word(0, 0), Err(ChunkError::Header { what: "magic", .. })));
        assert!(matches!(with_word(1, u32::MAX), Err(ChunkError::Header { what: "vertex count", .. })));
        assert!(matches!(with_word(2, 4), Err(ChunkError::Header { what: "index count", .. })));
        assert!(matches!(with_word(3, 8), Err(ChunkError::Header { what: "attributes", .. })));
        let mut past = sample();
        past.indices = vec![0, 1, 3];
        assert_eq!(GeometryChunk::decode(&past.encode()), Err(ChunkError::Index { triangle: 0, index: 3, vertices: 3 }));
    }

    #[test]
    fn the_name_is_blake3() {
        let name = ChunkHash::of(b"").to_string();
        assert_eq!(name, "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262");
    }
}
