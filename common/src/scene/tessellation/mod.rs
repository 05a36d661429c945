//! The tessellation of Prioritized-Layered Projection: the space around a scene's geometry as tetrahedra that know their neighbours and the
//! triangles that touch them (Klosowski, Silva: *Rendering on a Budget*, 1999, section 3.1).
//!
//! In the world, with every object where the package's transforms place it. Leaves of blended materials are not in it: they hide nothing and
//! are drawn after all else. An object that has moved since is where the tessellation does not know it: whoever draws leaves its leaves out
//! of the tessellation's business and draws them apart, and so for leaves that came later.
//!
//! A triangle has a *slot*: its place among all triangles of the leaves that are covered, leaf by leaf.

mod bytes;
mod check;
mod cover;
mod exposure;
mod facing;
mod numbers;

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

pub use bytes::TessellationError;
pub use cover::Cover;
pub use exposure::{Exposure, ExposureWeights};
pub use facing::{Facing, FacingEye};
pub use numbers::{NumberRows, push_numbers};

/// Most cells of a tessellation.
pub const MAX_CELLS: u32 = 1 << 24;
/// Most triangles of a leaf that a tessellation covers: their numbers have 15 bits.
pub const MAX_COVERED_TRIANGLES: u32 = 1 << 15;

/// A cell's place in [`Tessellation::cells`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
#[repr(transparent)]
pub struct CellId(pub u32);

impl CellId {
    /// Beyond the hull.
    pub const NONE: Self = Self(u32::MAX);

    /// The cell, if it is one.
    pub fn get(self) -> Option<Self> {
        (self != Self::NONE).then_some(self)
    }

    /// As an index.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// A tetrahedron. 52 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Cell {
    /// Places in [`Tessellation::vertices`]: (b − a) · ((c − a) × (d − a)) is above 0.
    pub corners: [u32; 4],
    /// The cell beyond each face; face k is the one without corner k.
    pub neighbours: [CellId; 4],
    /// One past its last run in [`Tessellation::runs`]; its first comes after the last of the cell before.
    pub run_end: u32,
    /// |c|: triangles that touch it.
    pub triangle_count: u32,
    /// What its triangles cover.
    pub cover: Cover,
}
const _: () = assert!(size_of::<Cell>() == 52);

/// Corners of face k, counterclockwise from outside.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Triangles of one leaf that touch one cell. 8 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct LeafRun {
    /// The leaf's place in [`Tessellation::leaves`]; ascending within a cell.
    pub place: u32,
    /// One past its last word in [`TessellationParts::words`]; the first comes after the last of the run before.
    pub end: u32,
}
const _: () = assert!(size_of::<LeafRun>() == 8);

/// A tessellation whose numbers have been checked: whatever it names is there.
#[derive(Clone, Debug, PartialEq)]
pub struct Tessellation {
    origin: DVec3,
    rho_mean: u32,
    vertices: Vec<Vec3>,
    cells: Vec<Cell>,
    runs: Vec<LeafRun>,
    words: Vec<u16>,
    leaves: Vec<u32>,
    exposures: Vec<Exposure>,
    facings: Vec<Facing>,
    /// For each of `leaves`, and once more: its first slot. Not among the bytes.
    first_slots: Vec<u32>,
    /// For each of `leaves`: where its chunk's facings start. Not among the bytes.
    first_facings: Vec<u32>,
}

/// What a tessellation is made of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TessellationParts {
    /// Where `vertices` are measured from, metres of the world.
    pub origin: DVec3,
    /// Corners of cells, metres.
    pub vertices: Vec<Vec3>,
    /// Cells, neighbours named mutually.
    pub cells: Vec<Cell>,
    /// Cell by cell.
    pub runs: Vec<LeafRun>,
    /// Run by run: numbers of triangles in their leaf, as [`push_numbers`] puts them.
    pub words: Vec<u16>,
    /// The leaves that are covered, ascending.
    pub leaves: Vec<u32>,
    /// For each slot.
    pub exposures: Vec<Exposure>,
    /// For each triangle of each chunk of a covered leaf, by [`super::ChunkId`]; in the chunk's local space.
    pub facings: Vec<Facing>,
}

impl Tessellation {
    /// Where vertices are measured from, metres of the world.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// How many triangles touch a cell that any touch, in the mean, rounded up; at least 1.
    pub fn rho_mean(&self) -> u32 {
        self.rho_mean
    }

    /// All cells, by [`CellId`].
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Corners of cells, metres from [`Tessellation::origin`].
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// A cell.
    #[inline]
    pub fn cell(&self, id: CellId) -> &Cell {
        &self.cells[id.index()]
    }

    /// A cell's corners, metres from [`Tessellation::origin`].
    #[inline]
    pub fn corners(&self, id: CellId) -> [Vec3; 4] {
        self.cells[id.index()].corners.map(|corner| self.vertices[corner as usize])
    }

    /// The runs of a cell: the leaf's place, and the numbers of its triangles.
    #[inline]
    pub fn runs(&self, id: CellId) -> impl Iterator<Item = (u32, NumberRows<'_>)> {
        let range = self.run_range(id);
        let mut start = range.start.checked_sub(1).map_or(0, |before| self.runs[before].end as usize);
        self.runs[range].iter().map(move |run| {
            let words = &self.words[start..run.end as usize];
            start = run.end as usize;
            (run.place, NumberRows(words))
        })
    }

    fn run_range(&self, id: CellId) -> Range<usize> {
        let start = id.index().checked_sub(1).map_or(0, |before| self.cells[before].run_end);
        start as usize..self.cells[id.index()].run_end as usize
    }

    /// The leaves that it covers, ascending.
    pub fn leaves(&self) -> &[u32] {
        &self.leaves
    }

    /// Slots of the triangles of the leaf at a place in [`Tessellation::leaves`].
    #[inline]
    pub fn slots(&self, place: u32) -> Range<u32> {
        self.first_slots[place as usize]..self.first_slots[place as usize + 1]
    }

    /// Triangles of all covered leaves.
    pub fn slot_count(&self) -> u32 {
        self.first_slots.last().copied().unwrap_or(0)
    }

    /// How far each triangle, by its slot, lies open.
    #[inline]
    pub fn exposures(&self) -> &[Exposure] {
        &self.exposures
    }

    /// Which way the triangles of the leaf at a place face, in the leaf's local space.
    #[inline]
    pub fn facings(&self, place: u32) -> &[Facing] {
        let first = self.first_facings[place as usize] as usize;
        &self.facings[first..first + self.slots(place).len()]
    }

    /// How many triangles all cells name together.
    pub fn reference_count(&self) -> u64 {
        self.cells.iter().map(|cell| u64::from(cell.triangle_count)).sum()
    }

    /// What its arrays take in memory, bytes.
    pub fn size_bytes(&self) -> u64 {
        let arrays = [
            size_of_val(&self.vertices[..]),
            size_of_val(&self.cells[..]),
            size_of_val(&self.runs[..]),
            size_of_val(&self.words[..]),
            size_of_val(&self.leaves[..]),
            size_of_val(&self.exposures[..]),
            size_of_val(&self.facings[..]),
            size_of_val(&self.first_slots[..]),
            size_of_val(&self.first_facings[..]),
        ];
        arrays.into_iter().map(|bytes| bytes as u64).sum()
    }
}

#[cfg(test)]
mod tests;
