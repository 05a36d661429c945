//! A mesh as a hierarchy of clusters: groups of neighbouring clusters, each simplified as one with its border locked, so that any part of the
//! mesh can be drawn as coarsely as it may be, a cluster at a time (Ponchio: *Multiresolution structures for interactive visualization of very
//! large 3D datasets*, 2009; Karis, Stubbe, Wihlidal: *A Deep Dive into Nanite*, 2021).
//!
//! ```text
//! roots ─ group ─ group ─ … ─→ the mesh          coarse first: the groups so far are a mesh at any time
//!
//!   members  ▒▒▒▒▒▒▒▒   ── simplified, border locked ──→   ▓▓▓▓  results: members of coarser groups, or roots
//!            ▒▒▒▒▒▒▒▒   ←──────── refined ─────────────    ▓▓▓▓
//! ```
//! A *cluster* is at most [`MAX_CLUSTER_TRIANGLES`] triangles of one material. To *refine* a group is to draw its members in place of its
//! results. A group *needs* those that hold its results as members: they are refined before it, and have lower numbers. A set of groups is
//! *closed* if it has whatever any of it needs. What a closed set draws are the clusters that are roots or in a refined group, and were not made by
//! a refined group. *Proof* that it has no cracks: groups are refined one after the other, and each takes a piece of surface and puts one with the
//! same border in its place.

mod bytes;
mod check;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::MaterialId;
use super::vertex_hierarchy::{NodeBounds, PackedBounds, VertexAttributes, VertexData};
use crate::geometry::Aabb;

pub use bytes::is_cluster_base;

/// Most triangles of a cluster.
pub const MAX_CLUSTER_TRIANGLES: u32 = 128;
/// Most vertices of a cluster.
pub const MAX_CLUSTER_VERTICES: u32 = 128;
/// Most clusters of a hierarchy.
pub const MAX_CLUSTERS: u32 = 1 << 24;
/// Most members of a group.
pub const MAX_GROUP_MEMBERS: u32 = 255;
/// Most results of a group.
pub const MAX_GROUP_RESULTS: u32 = 65_535;
/// Most groups of a block.
pub const MAX_BLOCK_GROUPS: u32 = 1 << 16;

const NONE: u32 = u32::MAX;

/// A group's place in its hierarchy, coarse first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Pod, Zeroable)]
#[repr(transparent)]
pub struct GroupId(pub u32);

impl GroupId {
    /// As an index.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// A cluster's place in its hierarchy: roots first, then group by group its members.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Pod, Zeroable)]
#[repr(transparent)]
pub struct ClusterId(pub u32);

impl ClusterId {
    /// As an index.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// How large a cluster is. 2 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ClusterSize {
    /// Its vertices, 1 to [`MAX_CLUSTER_VERTICES`].
    pub vertices: u8,
    /// Its triangles, 1 to [`MAX_CLUSTER_TRIANGLES`].
    pub triangles: u8,
}

/// Clusters, one behind the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClusterParts {
    /// One for each.
    pub sizes: Vec<ClusterSize>,
    /// The vertices of each, all of one part.
    pub vertices: Vec<u32>,
    /// The triangles of each by places among its vertices, counterclockwise from the front.
    pub triangles: Vec<[u8; 3]>,
}

/// What is stored of a group beside its clusters. 28 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GroupRecord {
    /// The middle of its sphere and of its box, metres.
    pub center: [f32; 3],
    /// What encloses its members and everything finer, and the error of its results.
    pub bounds: PackedBounds,
    /// How many members, 1 to [`MAX_GROUP_MEMBERS`].
    pub members: u8,
    /// How many results, 1 to [`MAX_GROUP_RESULTS`].
    pub results: u16,
}
const _: () = assert!(size_of::<GroupRecord>() == 28);

/// The roots of a hierarchy, and what is known of the whole.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClusterBase {
    /// The roots' vertices.
    pub vertices: VertexData,
    /// The roots.
    pub roots: ClusterParts,
    /// What clusters look like, by their vertices' part. One at least.
    pub materials: Vec<MaterialId>,
    /// What vertices have.
    pub attributes: VertexAttributes,
    /// Vertices of the whole hierarchy.
    pub vertex_total: u32,
    /// Triangles once every group is refined.
    pub triangle_total: u32,
    /// Groups of the whole hierarchy.
    pub group_total: u32,
    /// Blocks in which groups come.
    pub block_count: u32,
    /// Least coordinates of the whole mesh.
    pub local_min: [f32; 3],
    /// Greatest coordinates of the whole mesh.
    pub local_max: [f32; 3],
}

/// Groups that come together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClusterBlock {
    /// The first of them.
    pub first: u32,
    /// The vertices that they need and that were not needed before.
    pub vertices: VertexData,
    /// One for each.
    pub groups: Vec<GroupRecord>,
    /// Their results, group by group.
    pub results: Vec<ClusterId>,
    /// Their members, group by group.
    pub members: ClusterParts,
}

/// A hierarchy as far as it is there: the base and the first blocks. Whatever it names is there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClusterHierarchy {
    /// Its vertices and roots are moved to the arrays below.
    base: ClusterBase,
    blocks: u32,
    root_count: u32,
    root_triangles: u32,
    vertices: VertexData,
    clusters: Vec<Cluster>,
    cluster_vertices: Vec<u32>,
    local_triangles: Vec<[u8; 3]>,
    groups: Vec<Group>,
    results: Vec<ClusterId>,
    needs: Vec<GroupId>,
    /// Groups that need nothing.
    first_groups: Vec<GroupId>,
    /// Where the groups below each group start, and once more.
    below_starts: Vec<u32>,
    below: Vec<GroupId>,
    triangle_count: u32,
}

/// Arrays end where the next cluster's begin.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cluster {
    first_vertex: u32,
    first_triangle: u32,
    size: ClusterSize,
    /// The group that it is a member of, or [`NONE`].
    group: u32,
    /// The group that made it, or [`NONE`].
    maker: u32,
    center: Vec3,
    bounds: PackedBounds,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Group {
    record: GroupRecord,
    first_member: u32,
    first_result: u32,
    first_need: u32,
    need_count: u32,
    added_triangles: u32,
}

impl Group {
    /// Where its members end.
    #[inline]
    fn end_member(&self) -> u32 {
        self.first_member + u32::from(self.record.members)
    }
}

impl ClusterHierarchy {
    /// Groups that are there.
    pub fn group_count(&self) -> u32 {
        self.groups.len() as u32
    }

    /// Clusters that are there, roots too.
    pub fn cluster_count(&self) -> u32 {
        self.clusters.len() as u32
    }

    /// Vertices that are there.
    pub fn vertex_count(&self) -> u32 {
        self.vertices.positions.len() as u32
    }

    /// Triangles once every group that is there is refined.
    pub fn triangle_count(&self) -> u32 {
        self.triangle_count
    }

    /// Triangles of the whole mesh, whatever of it is there.
    pub fn triangle_total(&self) -> u32 {
        self.base.triangle_total
    }

    /// Triangles of the roots.
    pub fn root_triangles(&self) -> u32 {
        self.root_triangles
    }

    /// Blocks that are there.
    pub fn block_count(&self) -> u32 {
        self.blocks
    }

    /// Blocks of the whole.
    pub fn block_total(&self) -> u32 {
        self.base.block_count
    }

    /// Whether all of it is there.
    pub fn is_complete(&self) -> bool {
        self.blocks == self.base.block_count
    }

    /// What its clusters look like. One at least.
    pub fn materials(&self) -> &[MaterialId] {
        &self.base.materials
    }

    /// All vertices that are there.
    pub fn vertices(&self) -> &VertexData {
        &self.vertices
    }

    /// Where a vertex is, metres.
    #[inline]
    pub fn position(&self, vertex: u32) -> Vec3 {
        Vec3::from(self.vertices.positions[vertex as usize])
    }

    /// The clusters of the coarsest mesh: no group's members.
    pub fn roots(&self) -> impl ExactSizeIterator<Item = ClusterId> + use<> {
        (0..self.root_count).map(ClusterId)
    }

    /// The groups that need no other, ascending.
    pub fn first_groups(&self) -> &[GroupId] {
        &self.first_groups
    }

    /// The groups that must be refined before a group, ascending: they hold its results.
    #[inline]
    pub fn needs(&self, group: GroupId) -> &[GroupId] {
        let Group { first_need, need_count, .. } = self.groups[group.index()];
        &self.needs[first_need as usize..][..need_count as usize]
    }

    /// The groups, as far as they are there, that need a group; ascending.
    #[inline]
    pub fn below(&self, group: GroupId) -> &[GroupId] {
        &self.below[self.below_starts[group.index()] as usize..self.below_starts[group.index() + 1] as usize]
    }

    /// The clusters that are drawn once a group is refined.
    #[inline]
    pub fn members(&self, group: GroupId) -> impl ExactSizeIterator<Item = ClusterId> + use<> {
        let group = &self.groups[group.index()];
        (group.first_member..group.end_member()).map(ClusterId)
    }

    /// The clusters that are drawn in their place until then. All are roots or members of groups with lower numbers.
    #[inline]
    pub fn results(&self, group: GroupId) -> &[ClusterId] {
        let group = &self.groups[group.index()];
        &self.results[group.first_result as usize..][..usize::from(group.record.results)]
    }

    /// How many triangles more there are once a group is refined.
    #[inline]
    pub fn added_triangles(&self, group: GroupId) -> u32 {
        self.groups[group.index()].added_triangles
    }

    /// How far a group's results may be from the mesh, metres: an estimate. At least that of every group that made a member.
    #[inline]
    pub fn error_m(&self, group: GroupId) -> f32 {
        self.groups[group.index()].record.bounds.error()
    }

    /// A sphere about a group's members and the spheres of the groups that made them: centre and radius, metres.
    #[inline]
    pub fn sphere(&self, group: GroupId) -> (Vec3, f32) {
        let record = &self.groups[group.index()].record;
        (Vec3::from(record.center), record.bounds.radius())
    }

    /// What encloses a group's members and everything finer, about the middle of its sphere, with its error.
    #[inline]
    pub fn bounds(&self, group: GroupId) -> NodeBounds {
        let record = &self.groups[group.index()].record;
        record.bounds.around(Vec3::from(record.center))
    }

    /// The same as they are stored.
    #[inline]
    pub fn packed_bounds(&self, group: GroupId) -> (Vec3, &PackedBounds) {
        let record = &self.groups[group.index()].record;
        (Vec3::from(record.center), &record.bounds)
    }

    /// The box of [`ClusterHierarchy::bounds`].
    pub fn local_box(&self, group: GroupId) -> Aabb {
        let bounds = self.bounds(group);
        let (center, half) = (bounds.center.as_dvec3(), bounds.extent.half_box.as_dvec3());
        Aabb { min: center - half, max: center + half }
    }

    /// The cone of normals of a group's members and everything finer: its axis, and the sine of the angle to the normal furthest from it; `None`
    /// where no eye is behind all triangles.
    #[inline]
    pub fn cone(&self, group: GroupId) -> Option<(Vec3, f32)> {
        let cone = self.groups[group.index()].record.bounds.cone();
        cone.map(|(axis, sine)| (axis.direction(), sine))
    }

    /// The group that a cluster is a member of; `None` for roots.
    #[inline]
    pub fn group(&self, cluster: ClusterId) -> Option<GroupId> {
        let group = self.clusters[cluster.index()].group;
        (group != NONE).then_some(GroupId(group))
    }

    /// The group, if it is there, that a cluster is a result of.
    #[inline]
    pub fn maker(&self, cluster: ClusterId) -> Option<GroupId> {
        let maker = self.clusters[cluster.index()].maker;
        (maker != NONE).then_some(GroupId(maker))
    }

    /// What encloses a cluster's own triangles; its error is 0.
    #[inline]
    pub fn cluster_bounds(&self, cluster: ClusterId) -> NodeBounds {
        let cluster = &self.clusters[cluster.index()];
        cluster.bounds.around(cluster.center)
    }

    /// A cluster's vertices.
    #[inline]
    pub fn cluster_vertices(&self, cluster: ClusterId) -> &[u32] {
        let Cluster { first_vertex, size, .. } = self.clusters[cluster.index()];
        &self.cluster_vertices[first_vertex as usize..][..usize::from(size.vertices)]
    }

    /// A cluster's triangles by places among its vertices, counterclockwise from the front.
    #[inline]
    pub fn local_triangles(&self, cluster: ClusterId) -> &[[u8; 3]] {
        let Cluster { first_triangle, size, .. } = self.clusters[cluster.index()];
        &self.local_triangles[first_triangle as usize..][..usize::from(size.triangles)]
    }

    /// The same by vertices.
    #[inline]
    pub fn triangles(&self, cluster: ClusterId) -> impl ExactSizeIterator<Item = [u32; 3]> + '_ {
        let vertices = self.cluster_vertices(cluster);
        self.local_triangles(cluster).iter().map(|triangle| triangle.map(|place| vertices[usize::from(place)]))
    }

    /// What a cluster looks like.
    pub fn material(&self, cluster: ClusterId) -> MaterialId {
        let vertex = self.cluster_vertices(cluster)[0];
        let part = self.vertices.parts.get(vertex as usize).copied().unwrap_or(0);
        self.base.materials[usize::from(part)]
    }

    /// What encloses whatever is drawn of it.
    pub fn local_aabb(&self) -> Aabb {
        let corner = |p: [f32; 3]| DVec3::from(p.map(f64::from));
        Aabb { min: corner(self.base.local_min), max: corner(self.base.local_max) }
    }

    /// What it takes of memory as far as it is there, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let Self { cluster_vertices, results, needs, first_groups, below_starts, below, .. } = self;
        let words = cluster_vertices.len() + results.len() + needs.len() + first_groups.len() + below_starts.len() + below.len();
        let others = size_of_val(&self.clusters[..]) + size_of_val(&self.groups[..]) + size_of_val(&self.local_triangles[..]);
        (self.vertices.memory_bytes() + words * 4 + others) as u64
    }
}

impl ClusterParts {
    /// Puts a cluster behind the others: its vertices, and its triangles by places among them.
    ///
    /// # Panics
    /// When it has more of either than a cluster may have.
    pub fn push(&mut self, vertices: impl ExactSizeIterator<Item = u32>, triangles: &[[u8; 3]]) {
        let fits = vertices.len() <= MAX_CLUSTER_VERTICES as usize && triangles.len() <= MAX_CLUSTER_TRIANGLES as usize;
        assert!(fits, "a cluster of {} vertices and {} triangles", vertices.len(), triangles.len());
        self.sizes.push(ClusterSize { vertices: vertices.len() as u8, triangles: triangles.len() as u8 });
        self.vertices.extend(vertices);
        self.triangles.extend_from_slice(triangles);
    }

    /// What it takes as bytes, before they are padded.
    pub fn structure_bytes(&self) -> usize {
        size_of_val(&self.sizes[..]) + size_of_val(&self.vertices[..]) + size_of_val(&self.triangles[..])
    }
}

#[cfg(test)]
mod tests;
