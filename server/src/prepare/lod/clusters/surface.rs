//! What a piece's surface is, by places: vertices in one place are one. And where another surface is none that may stand in for it.
//!
//! That may be, if edges between places that others share have as many triangles on either side as before, none has several on one side
//! that had not, none is open that is not on an open border, and whatever hung together is still there. *Proof* that then no set of pieces makes
//! an edge of three triangles: a new edge has an end that nothing else has, so only this piece holds triangles at it.

use std::collections::HashMap;

use glam::Vec3;

use super::super::source::LodMesh;

/// An edge by its lower and higher place, whether a triangle has it upwards, and whether that is a triangle of the piece itself.
type Side = (usize, usize, bool, bool);

pub(super) struct Surface<'a> {
    mesh: &'a LodMesh,
    /// The mesh's vertices.
    vertices: &'a [u32],
    /// For each vertex the first one in its place.
    places: Vec<usize>,
    /// By place: whether others share it, whether it is on an open border.
    shared: Vec<bool>,
    open: Vec<bool>,
    sides: Vec<Side>,
    /// How often triangles are there, by their places, sorted.
    triangles: HashMap<[usize; 3], usize>,
    /// By place: one of those that it hangs together with.
    components: Vec<usize>,
}

impl<'a> Surface<'a> {
    /// Of a piece with vertices of its own.
    pub fn new(
        mesh: &'a LodMesh,
        vertices: &'a [u32],
        welds: &[u32],
        triangles: &[[u32; 3]],
        is_shared: impl Fn(u32) -> bool,
    ) -> Self {
        let mut first = HashMap::with_capacity(welds.len());
        let places: Vec<usize> = (0..).zip(welds).map(|(at, weld)| *first.entry(*weld).or_insert(at)).collect();
        let mut surface = Self {
            mesh,
            vertices,
            shared: welds.iter().map(|weld| is_shared(*weld)).collect(),
            open: vec![false; welds.len()],
            sides: Vec::with_capacity(3 * triangles.len()),
            triangles: HashMap::with_capacity(triangles.len()),
            components: (0..welds.len()).collect(),
            places,
        };
        for t in triangles {
            let [a, b, c] = t.map(|v| surface.place(v));
            surface.sides.extend(sides([a, b, c], true));
            *surface.triangles.entry(sorted([a, b, c])).or_default() += 1;
            surface.join(a, b);
            surface.join(b, c);
        }
        let mut sides = surface.sides.clone();
        sides.sort_unstable();
        for edge in sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (low, high, ..) = edge[0];
            let [up, down] = counts(edge, true);
            if up != down && !(surface.shared[low] && surface.shared[high]) {
                (surface.open[low], surface.open[high]) = (true, true);
            }
        }
        surface
    }

    /// Which places others share.
    pub fn shared(&self) -> &[bool] {
        &self.shared
    }

    /// A vertex's place.
    pub fn place(&self, vertex: u32) -> usize {
        self.places[vertex as usize]
    }

    fn root(&self, mut place: usize) -> usize {
        while self.components[place] != place {
            place = self.components[place];
        }
        place
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        let (low, high) = (a.min(b), a.max(b));
        self.components[high] = low;
    }

    /// Places around which other triangles may not stand in for these: none where all may.
    pub fn wrong(&self, triangles: &[[u32; 3]]) -> Vec<bool> {
        let mut wrong = vec![false; self.places.len()];
        let mut sides_of_both = self.sides.clone();
        let mut found: HashMap<[usize; 3], usize> = HashMap::with_capacity(triangles.len());
        let mut is_there = vec![false; self.places.len()];
        for t in triangles {
            let corners = t.map(|v| self.place(v));
            sides_of_both.extend(sides(corners, false));
            is_there[self.root(corners[0])] = true;
            let count = found.entry(sorted(corners)).or_default();
            *count += 1;
            if !self.may_be(t, corners, *count) {
                corners.iter().for_each(|place| wrong[*place] = true);
            }
        }
        sides_of_both.sort_unstable();
        for edge in sides_of_both.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (low, high, ..) = edge[0];
            let ([up_before, down_before], [up, down]) = (counts(edge, true), counts(edge, false));
            let is_wrong = if self.shared[low] && self.shared[high] {
                up > up_before || down > down_before || up + down_before != down + up_before
            } else {
                let is_open = up != down && !(self.open[low] && self.open[high]);
                up > up_before.max(1) || down > down_before.max(1) || is_open
            };
            if is_wrong {
                (wrong[low], wrong[high]) = (true, true);
            }
        }
        for corners in self.triangles.keys().filter(|corners| !is_there[self.root(corners[0])]) {
            corners.iter().for_each(|place| wrong[*place] = true);
        }
        wrong
    }

    /// Whether a triangle may be there so often, whichever way it faces.
    fn may_be(&self, triangle: &[u32; 3], corners: [usize; 3], count: usize) -> bool {
        let before = self.triangles.get(&sorted(corners)).copied().unwrap_or(0);
        if before > 0 {
            return count <= before;
        }
        let [a, b, c] = corners;
        let is_new = count == 1 && a != b && b != c && c != a && !corners.iter().all(|place| self.shared[*place]);
        let part = |v: u32| self.mesh.parts.get(self.vertices[v as usize] as usize);
        let [p, q, r] = triangle.map(|v| self.mesh.positions[self.vertices[v as usize] as usize]);
        let has_area = (q - p).cross(r - p) != Vec3::ZERO;
        is_new && has_area && triangle.iter().all(|v| part(*v) == part(triangle[0]))
    }
}

fn sorted(mut corners: [usize; 3]) -> [usize; 3] {
    corners.sort_unstable();
    corners
}

fn sides([a, b, c]: [usize; 3], is_own: bool) -> [Side; 3] {
    [(a, b), (b, c), (c, a)].map(|(from, to)| (from.min(to), from.max(to), from < to, is_own))
}

/// How many triangles have an edge upwards, and how many downwards: of the piece itself, or the others.
fn counts(edge: &[Side], is_own: bool) -> [usize; 2] {
    [true, false].map(|up| edge.iter().filter(|side| side.2 == up && side.3 == is_own).count())
}
