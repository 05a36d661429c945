//! What makes a base and blocks a hierarchy: the splits are made one after the other, and each must find the triangles that it takes.

use super::{
    BaseMesh, BlockParts, Link, LinkShape, MAX_BASE_TRIANGLES, MAX_BLOCK_VERTICES, MAX_HIERARCHY_VERTICES, MAX_LINK, MAX_PARTS,
    Split, TrianglePlace, VertexAttributes, VertexData, VertexHierarchy, VertexHierarchyError, VertexId, VertexRecord,
    greatest_first,
};

type Error = VertexHierarchyError;

impl VertexData {
    /// Whether every vertex has what all have, and no more.
    pub(in crate::scene) fn check(&self, attributes: VertexAttributes, materials: usize) -> Result<(), Error> {
        let count = self.positions.len();
        let expected =
            |present: bool, found: usize, what| check_count(what, found as u64, if present { count as u64 } else { 0 });
        expected(attributes.uvs, self.uvs.len(), "texture coordinates")?;
        expected(attributes.colors, self.colors.len(), "colours")?;
        expected(materials > 1, self.parts.len(), "parts")?;
        if !self.positions.iter().flatten().chain(self.uvs.iter().flatten()).all(|x| x.is_finite()) {
            return Err(Error::NotFinite);
        }
        match self.parts.iter().find(|part| usize::from(**part) >= materials) {
            Some(_) => Err(Error::Header { what: "part", value: materials as u32, allowed: "places of materials" }),
            None => Ok(()),
        }
    }

    pub(in crate::scene) fn append(&mut self, mut more: Self) {
        self.positions.append(&mut more.positions);
        self.uvs.append(&mut more.uvs);
        self.colors.append(&mut more.colors);
        self.parts.append(&mut more.parts);
    }

    pub(in crate::scene) fn truncate(&mut self, count: usize) {
        self.positions.truncate(count);
        self.uvs.truncate(count);
        self.colors.truncate(count);
        self.parts.truncate(count);
    }
}

pub(in crate::scene) fn check_count(what: &'static str, found: u64, expected: u64) -> Result<(), Error> {
    if found == expected { Ok(()) } else { Err(Error::Count { what, found, expected }) }
}

pub(in crate::scene) fn check_cap(what: &'static str, value: usize, cap: u32, allowed: &'static str) -> Result<(), Error> {
    if value <= cap as usize { Ok(()) } else { Err(Error::Header { what, value: value as u32, allowed }) }
}

impl VertexHierarchy {
    /// The hierarchy of a base alone.
    ///
    /// # Errors
    /// When a number names what is not there, or triangles do not ascend.
    pub fn new(base: BaseMesh) -> Result<Self, Error> {
        let count = base.vertices.positions.len();
        check_cap("vertex count", base.vertex_total as usize, MAX_HIERARCHY_VERTICES, "0 to 67108864")?;
        check_cap("base vertex count", count, base.vertex_total, "no more than of the whole")?;
        check_cap("base triangle count", base.triangles.len(), MAX_BASE_TRIANGLES, "0 to 134217728")?;
        check_cap("block count", base.block_count as usize, base.vertex_total - count as u32, "no more than vertices")?;
        if !(1..=MAX_PARTS as usize).contains(&base.materials.len()) {
            return Err(Error::Header { what: "material count", value: base.materials.len() as u32, allowed: "1 to 256" });
        }
        base.vertices.check(base.attributes, base.materials.len())?;
        if !base.local_min.iter().chain(&base.local_max).all(|x| x.is_finite()) {
            return Err(Error::NotFinite);
        }
        let base_starts = base_starts(&base.triangles, count)?;
        let hierarchy = Self {
            base_count: count as u32,
            blocks: 0,
            vertices: base.vertices.clone(),
            records: (0..count as u32).map(|v| VertexRecord::new(v, Split::default())).collect(),
            links: Vec::new(),
            base_starts,
            finest_base: vec![true; base.triangles.len()],
            triangle_count: base.triangles.len() as u32,
            base,
        };
        hierarchy.check_total()?;
        Ok(hierarchy)
    }

    /// Puts the next block behind what is there. Where that fails, nothing changes.
    ///
    /// # Errors
    /// When it is not the next one, a number names what is not there, or a split does not find the triangles that it takes.
    pub fn append(&mut self, block: BlockParts) -> Result<(), Error> {
        let BlockParts { first, vertices, splits, links } = block;
        let (before, count) = (self.vertex_count(), vertices.positions.len());
        check_count("first vertex of the block", first.into(), before.into())?;
        if self.is_complete() {
            return Err(Error::Count {
                what: "blocks",
                found: u64::from(self.blocks) + 1,
                expected: self.base.block_count.into(),
            });
        }
        check_cap("vertex count of the block", count, MAX_BLOCK_VERTICES, "1 to 65536")?;
        check_cap("vertex count with the block", before as usize + count, self.base.vertex_total, "no more than of the whole")?;
        check_count("splits", splits.len() as u64, count as u64)?;
        vertices.check(self.base.attributes, self.base.materials.len())?;
        let named: usize = splits.iter().map(|split| split.link.length()).sum();
        check_count("words of links", links.len() as u64, named as u64)?;
        if u32::try_from(self.links.len() + links.len()).is_err() {
            return Err(Error::Header { what: "words of links", value: u32::MAX, allowed: "fewer than 2^32" });
        }

        let links_before = self.links.len();
        self.vertices.append(vertices);
        self.records.extend((before..).zip(splits).map(|(v, split)| VertexRecord::new(v, split)));
        self.links.extend(links);
        let mut taken = Vec::new();
        let made = (before..before + count as u32).try_for_each(|v| self.make(VertexId(v), before, &mut taken));
        self.blocks += 1;
        let checked = made.and_then(|()| self.check_total());
        if checked.is_err() {
            self.blocks -= 1;
            self.undo(&taken, before, links_before);
        }
        checked
    }

    fn undo(&mut self, taken: &[TrianglePlace], vertices: u32, links: usize) {
        for place in taken {
            self.set_left(*place, true);
        }
        self.vertices.truncate(vertices as usize);
        self.records.truncate(vertices as usize);
        self.links.truncate(links);
        for (number, record) in (0..).zip(&mut self.records) {
            (record.last_child, record.next_sibling) = (number, number);
        }
        (self.base_count..vertices).for_each(|v| self.add_to_tree(VertexId(v)));
        let left: u32 = self.records.iter().map(|record| record.finest.count_ones()).sum();
        self.triangle_count = left + self.finest_base.iter().filter(|left| **left).count() as u32;
    }

    fn check_total(&self) -> Result<(), Error> {
        if !self.is_complete() {
            return Ok(());
        }
        check_count("vertices", self.vertex_count().into(), self.base.vertex_total.into())?;
        check_count("triangles", self.triangle_count.into(), self.base.triangle_total.into())
    }

    /// Makes one split of a block that begins at `block`.
    fn make(&mut self, vertex: VertexId, block: u32, taken: &mut Vec<TrianglePlace>) -> Result<(), Error> {
        let refuse = |problem| Err(Error::Split { vertex: vertex.0, problem });
        let head = self.split(vertex).link;
        // Links are in the order of their vertices; those of the base have none.
        let start = vertex.index().checked_sub(1).map_or(0, |last| self.records[last].link_end());
        let end = start + head.length();
        let Some(shape) = head.checked_shape() else { return refuse("its link has no shape") };
        self.records[vertex.index()].link_start = start as u32;
        let is_follower = head.is_follower();
        if is_follower {
            if vertex.0 == block || self.is_follower(VertexId(vertex.0 - 1)) {
                return refuse("it follows no lead of its block");
            }
            let lead = VertexId(vertex.0 - 1);
            let is_path = shape != LinkShape::Ring && self.split(lead).link.shape() != LinkShape::Ring;
            if !is_path || self.position(lead) != self.position(vertex) {
                return refuse("it is not where its lead is, or a link is no path");
            }
        }
        if !self.split(vertex).bounds.is_finite() {
            return Err(Error::NotFinite);
        }
        let mut path = [0; MAX_LINK];
        let path = &mut path[..head.length()];
        path.copy_from_slice(&self.links[start..end]);
        if path.len() < if shape == LinkShape::Ring { 3 } else { 2 } {
            return refuse("its link is too short");
        }
        let end_of_old = vertex.0 - u32::from(is_follower);
        let is_old = |(at, v): (usize, &u32)| *v < end_of_old && !path[..at].contains(v);
        if !path.iter().enumerate().all(is_old) {
            return refuse("its link names a vertex twice, or one that is not there");
        }
        let link = Link::new(path, shape);
        let parent = link.parent();
        for (a, b) in link.floor() {
            let place = self.places([parent, a, b]).find(|place| self.is_left(*place));
            let Some(place) = place else { return refuse("a triangle that it takes is not there") };
            self.set_left(place, false);
            taken.push(place);
        }
        self.records[vertex.index()].finest = ((1u64 << link.edges().len()) - 1) as u32;
        self.triangle_count += link.added_triangles();
        self.add_to_tree(vertex);
        Ok(())
    }

    fn is_left(&self, place: TrianglePlace) -> bool {
        if self.is_base(place.maker) {
            self.finest_base[self.base_range(place.maker).start + place.number as usize]
        } else {
            self.records[place.maker.index()].finest >> place.number & 1 != 0
        }
    }

    fn set_left(&mut self, place: TrianglePlace, left: bool) {
        if self.is_base(place.maker) {
            let at = self.base_range(place.maker).start + place.number as usize;
            self.finest_base[at] = left;
        } else {
            let mask = &mut self.records[place.maker.index()].finest;
            *mask = *mask & !(1 << place.number) | u32::from(left) << place.number;
        }
    }

    /// Leads become children of their parents; siblings ascend.
    fn add_to_tree(&mut self, vertex: VertexId) {
        if self.is_follower(vertex) {
            return;
        }
        let parent = self.parent(vertex).index();
        let last = self.records[parent].last_child as usize;
        if last != parent {
            self.records[vertex.index()].next_sibling = self.records[last].next_sibling;
            self.records[last].next_sibling = vertex.0;
        }
        self.records[parent].last_child = vertex.0;
    }
}

/// For each vertex of the base where its triangles start, and once more.
fn base_starts(triangles: &[[u32; 3]], vertices: usize) -> Result<Vec<u32>, Error> {
    let mut starts = Vec::with_capacity(vertices + 1);
    for (number, triangle) in triangles.iter().enumerate() {
        let refuse = |problem| Err(Error::BaseTriangle { triangle: number as u32, problem });
        let [a, b, c] = *triangle;
        if a as usize >= vertices || a == b || b == c || c == a {
            return refuse("a vertex is not there, or there twice");
        }
        if greatest_first(*triangle) != *triangle {
            return refuse("its greatest vertex is not first");
        }
        if number > 0 && triangles[number - 1] > *triangle {
            return refuse("triangles do not ascend");
        }
        while starts.len() <= a as usize {
            starts.push(number as u32);
        }
    }
    starts.resize(vertices + 1, triangles.len() as u32);
    Ok(starts)
}
