//! A mesh as a hierarchy of vertices: half-edge collapses in reverse, so that any part of it can be drawn as coarsely as it may be (Hoppe:
//! *View-Dependent Refinement of Progressive Meshes*, 1997; Birkholz, Rahn: *Adaptive Level of Detail with Occlusion Culling*).
//!
//! ```text
//! base mesh ─ split ─ split ─ … ─→ the mesh          coarse first: the vertices so far are a mesh at any time
//!
//!      w1                  w1        v's link: u, w0, w1, w2. Its split takes the fan of u between w0 and w2, the *floor*,
//!     ╱│╲                 ╱│╲        and puts the fan of v in its place, the *ceiling*.
//!   w0 │ w2     ───→    w0─v─w2
//!     ╲│╱                 ╲│╱
//!      u                   u
//! ```
//! A collapse moves a vertex onto a neighbour: no vertex is new. Vertices are numbered in an order of their splits, so the greatest of a
//! triangle's three made it, and a split can be made as soon as all of its link is there. Whatever set of splits is made, if each has its link,
//! gives one mesh, in whichever order: of triangles that preparation has looked at, each once, closed where the mesh is closed. *Proof*: an
//! edge goes only with one of its ends, so two fans can hold the same edge only if they did so when they were made, and preparation refuses
//! that; so a split replaces a disk by a disk with the same rim, and no more.
//!
//! Vertices differ where texture coordinates, colours or materials do, though they are in one place. Where two of them are, each has an open
//! link, and they split *together*: a lead, and its follower behind it. A split is a *node*: what the lead's parent is before it.

mod bounds;
mod bytes;
mod check;
mod index;
mod link;
mod table;

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::MaterialId;
use crate::geometry::Aabb;

pub use bounds::{NodeAxis, NodeBounds, NodeExtent, PackedBounds};
pub use bytes::{BlockParts, VertexHierarchyError};
pub(super) use bytes::{VertexLayout, check_length, check_materials, padded, split_header};
pub(super) use check::{check_cap, check_count};
pub use index::{BlobRef, HierarchyIndex, IndexedHierarchy, MAX_HIERARCHY_BLOB_BYTES};
pub use link::{Link, LinkShape, MAX_LINK};
pub use table::{HierarchyEntry, HierarchyTable, MAX_HIERARCHIES};

/// Most vertices of a hierarchy.
pub const MAX_HIERARCHY_VERTICES: u32 = 1 << 26;
/// Most triangles of a base mesh.
pub const MAX_BASE_TRIANGLES: u32 = 1 << 27;
/// Most vertices of a block.
pub const MAX_BLOCK_VERTICES: u32 = 1 << 16;
/// Most materials of a hierarchy: a vertex's takes a byte.
pub const MAX_PARTS: u32 = 256;

/// A vertex's place in its hierarchy, coarse first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Pod, Zeroable)]
#[repr(transparent)]
pub struct VertexId(pub u32);

impl VertexId {
    /// As an index.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// What is stored of a split beside its link. 14 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Split {
    bounds: PackedBounds,
    /// See [`link::LinkHead`].
    link: link::LinkHead,
}
const _: () = assert!(size_of::<Split>() == 14);

impl Split {
    /// Packs what is known of a split: its node's bounds, the number of vertices in its link, and whether it goes with the one before it.
    pub fn new(bounds: PackedBounds, link_length: usize, shape: LinkShape, is_follower: bool) -> Self {
        Self { bounds, link: link::LinkHead::new(link_length, shape, is_follower) }
    }
}

/// What is asked of a vertex, together: half a line of cache.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(32))]
struct VertexRecord {
    /// Of a vertex of the base, one without a link.
    split: Split,
    /// Where its link starts.
    link_start: u32,
    /// Its last child, or itself.
    last_child: u32,
    /// The sibling after it, and after the last the first.
    next_sibling: u32,
    /// Which of the triangles that it makes are left once all is split: a bit each. Nothing of the base.
    finest: u32,
}
const _: () = assert!(size_of::<VertexRecord>() == 32);

impl VertexRecord {
    fn new(vertex: u32, split: Split) -> Self {
        Self { split, link_start: 0, last_child: vertex, next_sibling: vertex, finest: 0 }
    }

    /// Where its link ends.
    #[inline]
    fn link_end(&self) -> usize {
        self.link_start as usize + self.split.link.length()
    }
}

/// A triangle by the vertex that made it: the greatest of its three.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TrianglePlace {
    /// Its greatest vertex.
    pub maker: VertexId,
    /// Which of the triangles that this one made. Below [`MAX_LINK`] where it is no vertex of the base.
    pub number: u32,
}

/// What every vertex has beside its position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VertexAttributes {
    /// Texture coordinates.
    pub uvs: bool,
    /// Colours.
    pub colors: bool,
}

/// Vertices as they are drawn, in a mesh's local space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VertexData {
    /// Positions, metres.
    pub positions: Vec<[f32; 3]>,
    /// Base colour texture coordinates, or empty.
    pub uvs: Vec<[f32; 2]>,
    /// Colours, linear RGBA, unsigned normalised, or empty.
    pub colors: Vec<[u8; 4]>,
    /// Places in [`BaseMesh::materials`], or empty where there is only one.
    pub parts: Vec<u8>,
}

impl VertexData {
    /// What it takes of memory, bytes.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&self.positions[..]) + size_of_val(&self.uvs[..]) + size_of_val(&self.colors[..]) + self.parts.len()
    }
}

/// The coarsest mesh of a hierarchy, and what is known of the whole.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BaseMesh {
    /// Its vertices.
    pub vertices: VertexData,
    /// Its triangles, counterclockwise from the front, the greatest vertex first; ascending.
    pub triangles: Vec<[u32; 3]>,
    /// What triangles look like, by the part of their greatest vertex. One at least.
    pub materials: Vec<MaterialId>,
    /// What vertices have.
    pub attributes: VertexAttributes,
    /// Vertices of the whole hierarchy.
    pub vertex_total: u32,
    /// Triangles once every split is made.
    pub triangle_total: u32,
    /// Blocks in which the other vertices come.
    pub block_count: u32,
    /// Least coordinates of the whole mesh.
    pub local_min: [f32; 3],
    /// Greatest coordinates of the whole mesh.
    pub local_max: [f32; 3],
}

/// A hierarchy as far as it is there: the base and the first blocks. Whatever it names is there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VertexHierarchy {
    base: BaseMesh,
    base_count: u32,
    blocks: u32,
    /// All vertices that are there, the base's too.
    vertices: VertexData,
    /// Of all vertices.
    records: Vec<VertexRecord>,
    links: Vec<u32>,
    /// Where the base triangles of each base vertex start, and once more.
    base_starts: Vec<u32>,
    finest_base: Vec<bool>,
    triangle_count: u32,
}

impl VertexHierarchy {
    /// What is known from the start. Its vertices are the first ones of [`VertexHierarchy::vertices`].
    pub fn base(&self) -> &BaseMesh {
        &self.base
    }

    /// Vertices of the base.
    pub fn base_count(&self) -> u32 {
        self.base_count
    }

    /// Vertices that are there.
    pub fn vertex_count(&self) -> u32 {
        self.vertices.positions.len() as u32
    }

    /// Triangles once every split that is there is made.
    pub fn triangle_count(&self) -> u32 {
        self.triangle_count
    }

    /// Blocks that are there.
    pub fn block_count(&self) -> u32 {
        self.blocks
    }

    /// Whether all of it is there.
    pub fn is_complete(&self) -> bool {
        self.blocks == self.base.block_count
    }

    /// All vertices that are there.
    pub fn vertices(&self) -> &VertexData {
        &self.vertices
    }

    /// Where a vertex is, metres.
    #[inline]
    pub fn position(&self, vertex: VertexId) -> Vec3 {
        Vec3::from(self.vertices.positions[vertex.index()])
    }

    /// The material of the triangles that a vertex makes.
    pub fn material(&self, maker: VertexId) -> MaterialId {
        let part = self.vertices.parts.get(maker.index()).copied().unwrap_or(0);
        self.base.materials[usize::from(part)]
    }

    /// Whether a vertex is of the base: it is always there.
    #[inline]
    pub fn is_base(&self, vertex: VertexId) -> bool {
        vertex.0 < self.base_count
    }

    #[inline]
    fn split(&self, vertex: VertexId) -> &Split {
        &self.records[vertex.index()].split
    }

    /// A vertex's link. Not of the base.
    #[inline]
    pub fn link(&self, vertex: VertexId) -> Link<'_> {
        let record = &self.records[vertex.index()];
        Link::new(&self.links[record.link_start as usize..record.link_end()], record.split.link.shape())
    }

    /// The vertex from which a vertex splits. Not of the base.
    #[inline]
    pub fn parent(&self, vertex: VertexId) -> VertexId {
        VertexId(self.link(vertex).parent())
    }

    /// The vertices that split together with a lead, itself first: one or two.
    #[inline]
    pub fn together(&self, lead: VertexId) -> impl Iterator<Item = VertexId> + use<> {
        let next = VertexId(lead.0 + 1);
        let has_follower = next.0 < self.vertex_count() && self.is_follower(next);
        (lead.0..lead.0 + 1 + u32::from(has_follower)).map(VertexId)
    }

    /// Whether a vertex splits together with the one before it.
    #[inline]
    pub fn is_follower(&self, vertex: VertexId) -> bool {
        self.split(vertex).link.is_follower()
    }

    /// The lead that a vertex splits with: itself, if it follows none.
    #[inline]
    pub fn lead(&self, vertex: VertexId) -> VertexId {
        VertexId(vertex.0 - u32::from(self.is_follower(vertex)))
    }

    /// How many triangles more there are once a lead is split: at least 1, at most 2.
    #[inline]
    pub fn added_triangles(&self, lead: VertexId) -> u32 {
        self.together(lead).map(|vertex| self.link(vertex).added_triangles()).sum()
    }

    /// The coarsest of the leads that split from a vertex.
    #[inline]
    pub fn first_child(&self, vertex: VertexId) -> Option<VertexId> {
        let last = self.records[vertex.index()].last_child;
        (last != vertex.0).then(|| VertexId(self.records[last as usize].next_sibling))
    }

    /// The next finer of the leads that split from the same vertex.
    #[inline]
    pub fn next_sibling(&self, lead: VertexId) -> Option<VertexId> {
        // Siblings ascend, and after the last comes the first.
        let next = self.records[lead.index()].next_sibling;
        (next > lead.0).then_some(VertexId(next))
    }

    /// What encloses a lead's node: everything that its parent turns into by this split and later ones, down to the triangles of the mesh.
    #[inline]
    pub fn bounds(&self, lead: VertexId) -> NodeBounds {
        self.packed_bounds(lead).around(self.position(self.parent(lead)))
    }

    /// The same as it is stored; its centre is the parent's position.
    #[inline]
    pub fn packed_bounds(&self, lead: VertexId) -> &PackedBounds {
        &self.split(lead).bounds
    }

    /// Only the error of [`VertexHierarchy::bounds`], metres.
    #[inline]
    pub fn error(&self, lead: VertexId) -> f32 {
        self.split(lead).bounds.error()
    }

    /// Places in [`BaseMesh::triangles`] of those that a vertex of the base makes.
    #[inline]
    pub fn base_range(&self, maker: VertexId) -> Range<usize> {
        self.base_starts[maker.index()] as usize..self.base_starts[maker.index() + 1] as usize
    }

    /// How many triangles a vertex makes.
    #[inline]
    pub fn made_count(&self, maker: VertexId) -> u32 {
        if self.is_base(maker) { self.base_range(maker).len() as u32 } else { self.link(maker).edges().count() as u32 }
    }

    /// A triangle's vertices, the greatest first.
    #[inline]
    pub fn triangle(&self, place: TrianglePlace) -> [VertexId; 3] {
        if self.is_base(place.maker) {
            return self.base.triangles[self.base_range(place.maker).start + place.number as usize].map(VertexId);
        }
        let (a, b) = self.link(place.maker).edge(place.number);
        [place.maker, VertexId(a), VertexId(b)]
    }

    /// The triangles with these vertices, counterclockwise: at most one, but of the base, where a file may have several.
    #[inline]
    pub fn places(&self, corners: [u32; 3]) -> impl Iterator<Item = TrianglePlace> + '_ {
        let [maker, a, b] = greatest_first(corners);
        let maker = VertexId(maker);
        let range = if self.is_base(maker) { self.base_range(maker) } else { 0..0 };
        let of_base = self.base.triangles[range].iter().enumerate().filter(move |(_, t)| t[1] == a && t[2] == b);
        let made = if self.is_base(maker) { None } else { self.link(maker).number_of(a, b) };
        of_base.map(|(number, _)| number as u32).chain(made).map(move |number| TrianglePlace { maker, number })
    }

    /// What encloses whatever is drawn of it.
    pub fn local_aabb(&self) -> Aabb {
        let corner = |p: [f32; 3]| DVec3::from(p.map(f64::from));
        Aabb { min: corner(self.base.local_min), max: corner(self.base.local_max) }
    }

    /// What it takes of memory as far as it is there, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let Self { base, vertices, records, links, base_starts, .. } = self;
        let words = [links, base_starts].map(|array| size_of_val(&array[..]));
        let of_vertices = [&base.vertices, vertices].map(VertexData::memory_bytes);
        let others = size_of_val(&records[..]) + size_of_val(&base.triangles[..]);
        (words.iter().sum::<usize>() + of_vertices.iter().sum::<usize>() + others) as u64
    }

    /// What the hierarchy takes beside the vertices' positions, texture coordinates and colours, as bytes that are stored.
    pub fn structure_bytes(&self) -> u64 {
        let arrays = [
            size_of::<Split>() * (self.vertex_count() - self.base_count) as usize,
            size_of_val(&self.links[..]),
            size_of_val(&self.base.triangles[..]),
            size_of_val(&self.vertices.parts[..]),
        ];
        arrays.into_iter().map(|bytes| bytes as u64).sum()
    }
}

/// The same triangle, turned until its greatest vertex is first.
#[inline]
pub fn greatest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a >= b && a >= c {
        [a, b, c]
    } else if b >= c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

#[cfg(test)]
mod tests;
