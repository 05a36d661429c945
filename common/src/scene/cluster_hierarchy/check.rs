//! What makes a base and blocks a hierarchy: every number names what is there, and groups need only what comes before them.

use glam::Vec3;

use super::{
    Cluster, ClusterBase, ClusterBlock, ClusterHierarchy, ClusterId, ClusterParts, Group, GroupId, GroupRecord, MAX_BLOCK_GROUPS,
    MAX_CLUSTER_TRIANGLES, MAX_CLUSTER_VERTICES, MAX_CLUSTERS, NONE,
};
use crate::scene::vertex_hierarchy::{
    MAX_BLOCK_VERTICES, MAX_HIERARCHY_VERTICES, MAX_PARTS, NodeAxis, NodeExtent, PackedBounds, VertexHierarchyError, check_cap,
    check_count,
};

type Error = VertexHierarchyError;

/// What rounding may add to a length.
const SLACK: f32 = 1.0 + 1e-5;

impl ClusterHierarchy {
    /// The hierarchy of a base alone.
    ///
    /// # Errors
    /// When a number names what is not there.
    pub fn new(mut base: ClusterBase) -> Result<Self, Error> {
        let vertices = std::mem::take(&mut base.vertices);
        let roots = std::mem::take(&mut base.roots);
        let count = vertices.positions.len();
        check_cap("vertex count", base.vertex_total as usize, MAX_HIERARCHY_VERTICES, "0 to 67108864")?;
        check_cap("base vertex count", count, base.vertex_total, "no more than of the whole")?;
        check_cap("group count", base.group_total as usize, MAX_CLUSTERS, "0 to 16777216")?;
        check_cap("block count", base.block_count as usize, base.group_total, "no more than groups")?;
        if !(1..=MAX_PARTS as usize).contains(&base.materials.len()) {
            return Err(Error::Header { what: "material count", value: base.materials.len() as u32, allowed: "1 to 256" });
        }
        vertices.check(base.attributes, base.materials.len())?;
        if !base.local_min.iter().chain(&base.local_max).all(|x| x.is_finite()) {
            return Err(Error::NotFinite);
        }
        let mut hierarchy = Self { base, vertices, below_starts: vec![0], ..Self::default() };
        hierarchy.add_clusters(roots)?;
        hierarchy.root_count = hierarchy.cluster_count();
        hierarchy.root_triangles = hierarchy.local_triangles.len() as u32;
        hierarchy.triangle_count = hierarchy.root_triangles;
        hierarchy.check_total()?;
        Ok(hierarchy)
    }

    /// Puts the next block behind what is there. Where that fails, nothing changes.
    ///
    /// # Errors
    /// When it is not the next one, a number names what is not there or what is no one's to take, or an error is greater than that of a group
    /// that is needed.
    pub fn append(&mut self, block: ClusterBlock) -> Result<(), Error> {
        check_count("first group of the block", block.first.into(), self.group_count().into())?;
        if self.is_complete() {
            let (found, expected) = (u64::from(self.blocks) + 1, self.base.block_count.into());
            return Err(Error::Count { what: "blocks", found, expected });
        }
        let (groups, vertices) = (block.groups.len(), block.vertices.positions.len());
        if groups == 0 {
            return Err(Error::Header { what: "group count of the block", value: 0, allowed: "1 to 65536" });
        }
        check_cap("group count of the block", groups, MAX_BLOCK_GROUPS, "1 to 65536")?;
        check_cap("group count with the block", self.groups.len() + groups, self.base.group_total, "no more than of the whole")?;
        check_cap("vertex count of the block", vertices, MAX_BLOCK_VERTICES, "0 to 65536")?;
        let vertices_before = self.vertices.positions.len();
        check_cap(
            "vertex count with the block",
            vertices_before + vertices,
            self.base.vertex_total,
            "no more than of the whole",
        )?;
        block.vertices.check(self.base.attributes, self.base.materials.len())?;

        let before = self.mark();
        self.vertices.append(block.vertices);
        self.blocks += 1;
        let added = self.add_clusters(block.members);
        let checked = added.and_then(|()| self.add_groups(&block.groups, &block.results)).and_then(|()| self.check_total());
        match checked {
            Ok(()) => self.link_below(),
            Err(_) => self.undo(&before),
        }
        checked
    }

    fn mark(&self) -> Mark {
        Mark {
            vertices: self.vertices.positions.len(),
            clusters: self.clusters.len(),
            cluster_vertices: self.cluster_vertices.len(),
            local_triangles: self.local_triangles.len(),
            groups: self.groups.len(),
            results: self.results.len(),
            needs: self.needs.len(),
            first_groups: self.first_groups.len(),
            triangle_count: self.triangle_count,
        }
    }

    fn undo(&mut self, mark: &Mark) {
        for group in (mark.groups..self.groups.len()).map(|group| GroupId(group as u32)) {
            let Group { first_result, record, .. } = self.groups[group.index()];
            for result in &self.results[first_result as usize..][..usize::from(record.results)] {
                self.clusters[result.index()].maker = NONE;
            }
        }
        self.blocks -= 1;
        self.vertices.truncate(mark.vertices);
        self.clusters.truncate(mark.clusters);
        self.cluster_vertices.truncate(mark.cluster_vertices);
        self.local_triangles.truncate(mark.local_triangles);
        self.groups.truncate(mark.groups);
        self.results.truncate(mark.results);
        self.needs.truncate(mark.needs);
        self.first_groups.truncate(mark.first_groups);
        self.triangle_count = mark.triangle_count;
    }

    fn check_total(&self) -> Result<(), Error> {
        if !self.is_complete() {
            return Ok(());
        }
        check_count("vertices", self.vertex_count().into(), self.base.vertex_total.into())?;
        check_count("groups", self.group_count().into(), self.base.group_total.into())?;
        check_count("triangles", self.triangle_count.into(), self.base.triangle_total.into())
    }

    /// Puts clusters that are no group's behind the others.
    fn add_clusters(&mut self, parts: ClusterParts) -> Result<(), Error> {
        let ClusterParts { sizes, vertices, triangles } = parts;
        check_cap("cluster count", self.clusters.len() + sizes.len(), MAX_CLUSTERS, "0 to 16777216")?;
        let sum = |of: fn(u8, u8) -> u8| sizes.iter().map(|size| u64::from(of(size.vertices, size.triangles))).sum();
        check_count("vertices of clusters", vertices.len() as u64, sum(|vertices, _| vertices))?;
        check_count("triangles of clusters", triangles.len() as u64, sum(|_, triangles| triangles))?;
        let (mut first_vertex, mut first_triangle) = (self.cluster_vertices.len(), self.local_triangles.len());
        self.cluster_vertices.extend(vertices);
        self.local_triangles.extend(triangles);
        for size in sizes {
            let (own_vertices, own_triangles) = (usize::from(size.vertices), usize::from(size.triangles));
            let cluster = self.clusters.len() as u32;
            let refuse = |problem| Err(Error::Cluster { cluster, problem });
            if !(1..=MAX_CLUSTER_VERTICES as usize).contains(&own_vertices)
                || !(1..=MAX_CLUSTER_TRIANGLES as usize).contains(&own_triangles)
            {
                return refuse("it has no vertices or triangles, or too many");
            }
            let vertices = &self.cluster_vertices[first_vertex..][..own_vertices];
            let triangles = &self.local_triangles[first_triangle..][..own_triangles];
            if vertices.iter().any(|v| *v as usize >= self.vertices.positions.len()) {
                return refuse("it names a vertex that is not there");
            }
            let part = |vertex: u32| self.vertices.parts.get(vertex as usize);
            if vertices.iter().any(|v| part(*v) != part(vertices[0])) {
                return refuse("it is of several materials");
            }
            let is_good = |[a, b, c]: [u8; 3]| a.max(b).max(c) < size.vertices && a != b && b != c && c != a;
            if !triangles.iter().all(|triangle| is_good(*triangle)) {
                return refuse("a corner is not there, or there twice");
            }
            let corners = |t: &[u8; 3]| t.map(|place| self.position(vertices[usize::from(place)]));
            let (center, bounds) = enclose(triangles.iter().map(corners));
            // Fit: clusters and what each has are capped.
            let (vertex, triangle) = (first_vertex as u32, first_triangle as u32);
            self.clusters.push(Cluster {
                first_vertex: vertex,
                first_triangle: triangle,
                size,
                group: NONE,
                maker: NONE,
                center,
                bounds,
            });
            first_vertex += own_vertices;
            first_triangle += own_triangles;
        }
        Ok(())
    }

    /// Gives the clusters that are no group's to groups.
    fn add_groups(&mut self, records: &[GroupRecord], results: &[ClusterId]) -> Result<(), Error> {
        let members: usize = records.iter().map(|record| usize::from(record.members)).sum();
        let mut first_member = self.groups.last().map_or(self.root_count, Group::end_member) as usize;
        check_count("members", (self.clusters.len() - first_member) as u64, members as u64)?;
        let named: usize = records.iter().map(|record| usize::from(record.results)).sum();
        check_count("results", results.len() as u64, named as u64)?;
        let mut results = results;
        for record in records {
            let (own, rest) = results.split_at(usize::from(record.results));
            results = rest;
            self.add_group(record, first_member, own)?;
            first_member += usize::from(record.members);
        }
        Ok(())
    }

    fn add_group(&mut self, record: &GroupRecord, first_member: usize, results: &[ClusterId]) -> Result<(), Error> {
        let group = self.group_count();
        let refuse = |problem| Err(Error::Group { group, problem });
        if record.members == 0 || record.results == 0 {
            return refuse("it has no members, or no results");
        }
        if !record.bounds.is_finite() || !record.center.iter().all(|x| x.is_finite()) {
            return Err(Error::NotFinite);
        }
        // What is wrong below is undone by the group's record.
        let first_need = self.needs.len();
        self.groups.push(Group {
            record: GroupRecord { results: 0, ..*record },
            first_member: first_member as u32,
            first_result: self.results.len() as u32,
            first_need: first_need as u32,
            need_count: 0,
            added_triangles: 0,
        });
        let count = |of: &[Cluster]| of.iter().map(|cluster| u32::from(cluster.size.triangles)).sum::<u32>();
        let mut made = 0;
        for result in results {
            let Some(cluster) = self.clusters[..first_member].get_mut(result.index()) else {
                return refuse("a result is not there before it");
            };
            if cluster.maker != NONE {
                return refuse("a result is of another group, or there twice");
            }
            cluster.maker = group;
            made += u32::from(cluster.size.triangles);
            if cluster.group != NONE {
                self.needs.push(GroupId(cluster.group));
            }
            self.results.push(*result);
            self.groups[group as usize].record.results += 1;
        }
        let members = &mut self.clusters[first_member..][..usize::from(record.members)];
        members.iter_mut().for_each(|cluster| cluster.group = group);
        let Some(added_triangles) = count(members).checked_sub(made) else {
            return refuse("it has fewer triangles than its results");
        };
        let needs = &mut self.needs[first_need..];
        needs.sort_unstable();
        let mut kept = 0;
        for at in 0..needs.len() {
            if at == 0 || needs[at] != needs[at - 1] {
                needs[kept] = needs[at];
                kept += 1;
            }
        }
        self.needs.truncate(first_need + kept);
        let error = record.bounds.error();
        if self.needs[first_need..].iter().any(|need| self.groups[need.index()].record.bounds.error() < error) {
            return refuse("its error is greater than that of a group that it needs");
        }
        if kept == 0 {
            self.first_groups.push(GroupId(group));
        }
        let added = &mut self.groups[group as usize];
        (added.need_count, added.added_triangles) = (kept as u32, added_triangles);
        self.triangle_count += added_triangles;
        Ok(())
    }

    /// Finds which groups are below each.
    fn link_below(&mut self) {
        let count = self.groups.len();
        self.below_starts.clear();
        self.below_starts.resize(count + 2, 0);
        // Counts two places on, then starts one place on; filling moves them to where they belong.
        self.needs.iter().for_each(|need| self.below_starts[need.index() + 2] += 1);
        for at in 1..self.below_starts.len() {
            self.below_starts[at] += self.below_starts[at - 1];
        }
        self.below.clear();
        self.below.resize(self.needs.len(), GroupId(0));
        for group in 0..count {
            let Group { first_need, need_count, .. } = self.groups[group];
            for need in &self.needs[first_need as usize..][..need_count as usize] {
                let place = &mut self.below_starts[need.index() + 1];
                self.below[*place as usize] = GroupId(group as u32);
                *place += 1;
            }
        }
        self.below_starts.truncate(count + 1);
    }
}

/// How long arrays were.
struct Mark {
    vertices: usize,
    clusters: usize,
    cluster_vertices: usize,
    local_triangles: usize,
    groups: usize,
    results: usize,
    needs: usize,
    first_groups: usize,
    triangle_count: u32,
}

/// What encloses some triangles, one at least, about the middle of their box.
fn enclose(triangles: impl Iterator<Item = [Vec3; 3]> + Clone) -> (Vec3, PackedBounds) {
    let (mut low, mut high, mut sum) = (Vec3::INFINITY, Vec3::NEG_INFINITY, Vec3::ZERO);
    for corners @ [a, b, c] in triangles.clone() {
        corners.iter().for_each(|p| (low, high) = (low.min(*p), high.max(*p)));
        sum += (b - a).cross(c - a);
    }
    let center = low.midpoint(high);
    let axis = NodeAxis::along(sum);
    let direction = axis.direction();
    let mut extent =
        NodeExtent { axis, least_cosine: 1.0, half_box: (high - center).max(center - low) * SLACK, ..NodeExtent::default() };
    for corners @ [a, b, c] in triangles {
        for way in corners.map(|p| p - center) {
            let height = way.dot(direction);
            extent.radius = extent.radius.max(way.length() * SLACK);
            extent.cylinder_radius = extent.cylinder_radius.max((way - direction * height).length() * SLACK);
            extent.cylinder_above = extent.cylinder_above.max(height * SLACK);
            extent.cylinder_below = extent.cylinder_below.max(-height * SLACK);
        }
        let normal = (b - a).cross(c - a).normalize_or_zero();
        if normal != Vec3::ZERO {
            extent.least_cosine = extent.least_cosine.min(direction.dot(normal));
        }
    }
    (center, PackedBounds::new(&extent))
}
