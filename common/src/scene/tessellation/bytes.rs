//! A tessellation as bytes: a header, then the arrays of [`TessellationParts`], each padded to 4 bytes. All numbers little-endian.
//!
//! ```text
//! "MLP1"  vertices u32  cells u32  runs u32  words u32  leaves u32  exposures u32  facings u32  origin 3 × f64
//! vertices 3 × f32   cells 52 bytes   runs 8 bytes   words u16   leaves u32   exposures u16   facings 3 bytes
//! ```

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use thiserror::Error;

use super::{Cell, MAX_CELLS, Tessellation, TessellationParts};
use crate::scene::SceneManifest;
use crate::scene::arrays::{put, take};

const MAGIC: u32 = u32::from_le_bytes(*b"MLP1");

/// Why bytes are no tessellation, or none of a scene.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum TessellationError {
    #[error("{found} bytes where the header asks for {expected}")]
    Length { found: usize, expected: u64 },
    #[error("header: {what} is {value}, allowed are {allowed}")]
    Header { what: &'static str, value: u32, allowed: &'static str },
    #[error("a coordinate is not finite")]
    NotFinite,
    #[error("cell {cell}: {problem}")]
    Cell { cell: u32, problem: &'static str },
    #[error("run {run}: {problem}")]
    Run { run: u32, problem: &'static str },
    #[error("leaf {leaf}: {problem}")]
    Leaf { leaf: u32, problem: &'static str },
    #[error("{found} {what}, the scene asks for {expected}")]
    Count { what: &'static str, found: usize, expected: u64 },
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Header {
    magic: u32,
    vertices: u32,
    cells: u32,
    runs: u32,
    words: u32,
    leaves: u32,
    exposures: u32,
    facings: u32,
    origin: [f64; 3],
}
const _: () = assert!(size_of::<Header>() == 56);

impl Header {
    /// Bytes of header and arrays. Cannot overflow: seven counts of 32 bits, at most 52 bytes each.
    fn length(&self) -> u64 {
        let array = |count: u32, bytes: u64| (u64::from(count) * bytes).next_multiple_of(4);
        size_of::<Self>() as u64
            + array(self.vertices, 12)
            + array(self.cells, size_of::<Cell>() as u64)
            + array(self.runs, 8)
            + array(self.words, 2)
            + array(self.leaves, 4)
            + array(self.exposures, 2)
            + array(self.facings, 3)
    }
}

impl Tessellation {
    /// Its bytes. The same tessellation gives the same bytes.
    pub fn encode(&self) -> Vec<u8> {
        let header = Header {
            magic: MAGIC,
            vertices: self.vertices.len() as u32,
            cells: self.cells.len() as u32,
            runs: self.runs.len() as u32,
            words: self.words.len() as u32,
            leaves: self.leaves.len() as u32,
            exposures: self.exposures.len() as u32,
            facings: self.facings.len() as u32,
            origin: self.origin.to_array(),
        };
        let mut bytes = Vec::with_capacity(header.length() as usize);
        bytes.extend_from_slice(bytemuck::bytes_of(&header));
        let arrays: [&[u8]; 7] = [
            bytemuck::cast_slice(&self.vertices),
            bytemuck::cast_slice(&self.cells),
            bytemuck::cast_slice(&self.runs),
            bytemuck::cast_slice(&self.words),
            bytemuck::cast_slice(&self.leaves),
            bytemuck::cast_slice(&self.exposures),
            bytemuck::cast_slice(&self.facings),
        ];
        arrays.iter().for_each(|array| put(&mut bytes, array));
        bytes
    }

    /// Reads and checks bytes from outside against the scene that they are of, or one that grew from it. Takes no more memory than a few
    /// times their length.
    ///
    /// # Errors
    /// When they are cut off, or name what is not there.
    pub fn decode(bytes: &[u8], scene: &SceneManifest) -> Result<Self, TessellationError> {
        let length_error = |expected| TessellationError::Length { found: bytes.len(), expected };
        let (header, mut rest) = bytes.split_at_checked(size_of::<Header>()).ok_or(length_error(size_of::<Header>() as u64))?;
        let header: Header = bytemuck::pod_read_unaligned(header);
        if header.magic != MAGIC {
            return Err(TessellationError::Header { what: "magic", value: header.magic, allowed: "MLP1" });
        }
        if header.cells > MAX_CELLS {
            return Err(TessellationError::Header { what: "cell count", value: header.cells, allowed: "0 to 16777216" });
        }
        if bytes.len() as u64 != header.length() {
            return Err(length_error(header.length()));
        }
        let parts = TessellationParts {
            origin: DVec3::from(header.origin),
            vertices: take::<Vec3>(&mut rest, header.vertices),
            cells: take(&mut rest, header.cells),
            runs: take(&mut rest, header.runs),
            words: take(&mut rest, header.words),
            leaves: take(&mut rest, header.leaves),
            exposures: take(&mut rest, header.exposures),
            facings: take(&mut rest, header.facings),
        };
        Self::new(parts, scene)
    }
}
