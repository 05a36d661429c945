//! Which collapses may be: those after which the surface is what it was, only coarser.
//!
//! The *link condition* (Dey, Edelsbrunner, Guha, Nekhayev: *Topology Preserving Edge Contraction*, 1999) is asked of places, not of vertices:
//! a seam of texture coordinates is no border. A border counts as joined to one vertex far away.

use glam::Vec3;
use mullion_common::scene::MAX_LINK;

use super::looks;
use super::source::LodMesh;
use super::surface::{Fan, Surface};

/// Most triangles that a vertex has after a collapse onto it: large fans make thin triangles and long links.
const MAX_VALENCE: usize = 24;
/// Vertices with more triangles than this take none: asking them each time would cost the square of it.
const MAX_ASKED: usize = 64;
/// Least cosine between a triangle and the one that it stands for.
const LEAST_TURN: f32 = 0.25;
/// Between the normals of two triangles: an edge with less is sharp.
const SHARP: f32 = 0.9;
/// Least height of a triangle, as a share of its longest side: twice the area over the side squared. One that stands for a lower one may be half
/// as high as that was.
const LEAST_HEIGHT: f32 = 0.02;
/// No triangle is lower than this.
const NO_HEIGHT: f32 = 1e-4;

/// What is around a place that may be given up.
pub(super) enum Star {
    /// All around.
    Inner(u32, Fan),
    /// On a border.
    Border(u32, Fan),
    /// On a seam: two vertices in one place, each with one side.
    Seam([u32; 2], [Fan; 2]),
}

/// Where the vertices of a place go: as many as it has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Target {
    /// For each vertex of the star, in its order.
    pub onto: [u32; 2],
    pub cost: f32,
}

impl Star {
    /// Its vertices with their fans.
    pub fn sides(&self) -> impl Iterator<Item = (u32, &Fan)> {
        let (vertices, fans): (&[u32], &[Fan]) = match self {
            Self::Inner(vertex, fan) | Self::Border(vertex, fan) => (std::slice::from_ref(vertex), std::slice::from_ref(fan)),
            Self::Seam(vertices, fans) => (vertices, fans),
        };
        vertices.iter().copied().zip(fans)
    }

    /// Where it may go, as far as its own star tells.
    pub fn targets(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let all: &[u32] = match self {
            Self::Inner(_, fan) => fan.path(),
            _ => &[],
        };
        let ends = match self {
            Self::Inner(..) => [None; 2],
            Self::Border(_, fan) => [fan.path()[0], fan.path()[fan.path().len() - 1]].map(|end| Some([end; 2])),
            Self::Seam(_, [a, b]) => {
                let (a, b) = (a.path(), b.path());
                [Some([a[0], b[b.len() - 1]]), Some([a[a.len() - 1], b[0]])]
            }
        };
        all.iter().map(|onto| [*onto; 2]).chain(ends.into_iter().flatten())
    }
}

/// Asks stars; remembers nothing but memory.
pub(super) struct Fitness<'a> {
    pub mesh: &'a LodMesh,
    /// By place: the normal of the mesh there, of any length; zero where not every triangle around is seen from its tip.
    pub normals: Vec<Vec3>,
    /// By place: whether it has triangles that are not here, too, and stays. Empty where none has.
    pub fixed: Vec<bool>,
    /// By place: the number of the star that it is around, doubled, plus one once it has been counted.
    marks: Vec<u32>,
    star: u32,
}

impl<'a> Fitness<'a> {
    pub fn new(mesh: &'a LodMesh, normals: Vec<Vec3>) -> Self {
        Self { mesh, normals, fixed: Vec::new(), marks: vec![0; mesh.positions.len()], star: 0 }
    }

    fn weld(&self, vertex: u32) -> u32 {
        self.mesh.welds[vertex as usize]
    }

    fn position(&self, vertex: u32) -> Vec3 {
        self.mesh.positions[vertex as usize]
    }

    /// The star of a place, given its first vertex; `None` where that must stay.
    pub fn star(mesh: &LodMesh, surface: &Surface, place: u32) -> Option<Star> {
        let fits = |fan: &Fan| fan.path().len() <= MAX_LINK;
        let mut wedges = mesh.wedges_of(place);
        let first = wedges.next()?;
        let a = surface.fan(first).filter(fits)?;
        let weld = |vertex: u32| mesh.welds[vertex as usize];
        let ends = |fan: &Fan| (weld(fan.path()[0]), weld(fan.path()[fan.path().len() - 1]));
        match (wedges.next(), wedges.next()) {
            (None, _) if a.is_ring() => Some(Star::Inner(first, a)),
            (None, _) => (ends(&a).0 != ends(&a).1).then_some(Star::Border(first, a)),
            (Some(second), None) => {
                let b = surface.fan(second).filter(fits)?;
                let are_sides = !a.is_ring() && !b.is_ring() && ends(&a).0 == ends(&b).1 && ends(&a).1 == ends(&b).0;
                are_sides.then_some(Star::Seam([first, second], [a, b]))
            }
            _ => None,
        }
    }

    /// Marks the places around; whether no two of them are one.
    fn mark_around(&mut self, star: &Star) -> bool {
        // Numbers begin anew before they run out of bits.
        if self.star >= u32::MAX / 2 - 1 {
            self.marks.fill(0);
            self.star = 0;
        }
        self.star += 1;
        let mut distinct = 0;
        let mut named = 0;
        for vertex in star.sides().flat_map(|(_, fan)| fan.path()) {
            named += 1;
            let mark = &mut self.marks[self.mesh.welds[*vertex as usize] as usize];
            distinct += usize::from(*mark != 2 * self.star);
            *mark = 2 * self.star;
        }
        distinct == if matches!(star, Star::Seam(..)) { named - 2 } else { named }
    }

    /// Whether the star may go there, and how far the surface then is from what it was, at the vertex and in the middle of its sharp edges, or how
    /// far off it looks, in the middle of all.
    pub fn deviation(&mut self, surface: &Surface, star: &Star, target: &Target) -> Option<f32> {
        if !self.mark_around(star) || !self.keeps_topology(surface, star, target) {
            return None;
        }
        for ((vertex, fan), onto) in star.sides().zip(target.onto) {
            if floor(fan, onto).any(|(a, b)| !self.keeps_facing(vertex, onto, a, b)) {
                return None;
            }
        }
        let place = self.position(star.sides().next().map_or(0, |side| side.0));
        let mut deviation = self.distance_to_floor(star, target, place).max(looks::deviation(self.mesh, star, target.onto));
        for ((vertex, fan), onto) in star.sides().zip(target.onto) {
            let from = self.position(vertex);
            let normal = |(a, b): (u32, u32)| (self.position(a) - from).cross(self.position(b) - from).normalize_or_zero();
            // Where a fan is open, its ends are as sharp as can be.
            let mut before = fan.edges().last().filter(|_| fan.is_ring()).map_or(Vec3::ZERO, normal);
            let end = fan.path().last().filter(|_| !fan.is_ring()).map(|end| (*end, Vec3::ZERO));
            for (around, after) in fan.edges().map(|edge| (edge.0, normal(edge))).chain(end) {
                if around != onto && before.dot(after) < SHARP {
                    deviation = deviation.max(self.distance_to_floor(star, target, (from + self.position(around)) * 0.5));
                }
                before = after;
            }
        }
        Some(deviation)
    }

    /// How far a point is from what stands for the star once it is there.
    fn distance_to_floor(&self, star: &Star, target: &Target, p: Vec3) -> f32 {
        let mut least = f32::INFINITY;
        for ((_, fan), onto) in star.sides().zip(target.onto) {
            let to = self.position(onto);
            for (a, b) in floor(fan, onto) {
                least = least.min(distance_to_triangle(p, to, self.position(a), self.position(b)));
            }
            if floor(fan, onto).next().is_none() {
                let other = fan.path().iter().find(|v| **v != onto).copied().unwrap_or(onto);
                least = least.min(distance_to_segment(p, to, self.position(other)));
            }
        }
        least
    }

    /// The link condition, by the marks of the star; and no fan becomes too large or is all gone.
    fn keeps_topology(&mut self, surface: &Surface, star: &Star, target: &Target) -> bool {
        let place = self.weld(star.sides().next().map_or(0, |side| side.0));
        let onto_place = self.weld(target.onto[0]);
        if self.may_join_elsewhere(star, onto_place) {
            return false;
        }
        let triangles: usize = star.sides().map(|(_, fan)| fan.triangles()).sum();
        let is_tip = triangles == 3 && !matches!(star, Star::Border(..));
        let (marked, counted) = (2 * self.star, 2 * self.star + 1);
        let mut common = 0;
        let mut asked = 0;
        for wedge in self.mesh.wedges_of(onto_place) {
            for (a, b, _) in surface.around(wedge) {
                asked += 1;
                if asked > MAX_ASKED {
                    return false;
                }
                let (a, b) = (self.weld(a), self.weld(b));
                let is_around = |mark: u32| mark >= marked;
                // A triangle that closes three others: with them it is a tetrahedron.
                if is_tip && a != place && b != place && is_around(self.marks[a as usize]) && is_around(self.marks[b as usize]) {
                    return false;
                }
                for neighbour in [a, b] {
                    if neighbour != place && self.marks[neighbour as usize] == marked {
                        self.marks[neighbour as usize] = counted;
                        common += 1;
                    }
                }
            }
        }
        if common != if matches!(star, Star::Border(..)) { 1 } else { 2 } {
            return false;
        }
        star.sides().zip(target.onto).all(|((vertex, fan), onto)| {
            let mut others = 0;
            let mut has_other_edge = false;
            let third = fan.path().iter().find(|v| **v != onto).copied();
            for (a, b, _) in surface.around(onto).filter(|(a, b, _)| *a != vertex && *b != vertex) {
                others += 1;
                has_other_edge |= Some(a) == third || Some(b) == third;
            }
            if others + floor(fan, onto).count() > MAX_VALENCE {
                return false;
            }
            // A single triangle goes without another in its place: its two other vertices need some of their own.
            let is_single = fan.triangles() == 1;
            let third_has_other = || third.is_some_and(|v| surface.around(v).any(|(a, b, _)| a != vertex && b != vertex));
            !is_single || (others > 0 && third_has_other() && (has_other_edge || !matches!(star, Star::Border(..))))
        })
    }

    /// Whether a triangle that is not here may join the target to another place around the star: then they must not be joined here.
    fn may_join_elsewhere(&self, star: &Star, onto_place: u32) -> bool {
        let is_fixed = |place: u32| self.fixed.get(place as usize).is_some_and(|fixed| *fixed);
        let mut others = star.sides().flat_map(|(_, fan)| fan.path()).map(|v| self.weld(*v));
        is_fixed(onto_place) && others.any(|other| other != onto_place && is_fixed(other))
    }

    /// Whether (onto, a, b) may stand for (vertex, a, b): it is a triangle, is hardly turned, and faces as the mesh does at its corners.
    fn keeps_facing(&self, vertex: u32, onto: u32, a: u32, b: u32) -> bool {
        let [from, to, p, q] = [vertex, onto, a, b].map(|v| self.position(v));
        let (before, after) = ((p - from).cross(q - from), (p - to).cross(q - to));
        let height = |tip: Vec3, doubled_area: Vec3| {
            let longest = (p - tip).length_squared().max((q - tip).length_squared()).max((p - q).length_squared());
            doubled_area.length() / longest.max(f32::MIN_POSITIVE)
        };
        let least = (0.5 * height(from, before)).clamp(NO_HEIGHT, LEAST_HEIGHT);
        // Also where it is no number.
        if height(to, after).partial_cmp(&least).is_none_or(|order| order.is_lt()) {
            return false;
        }
        if before.dot(after) < LEAST_TURN * before.length() * after.length() {
            return false;
        }
        [onto, a, b].iter().all(|corner| {
            let normal = self.normals[self.weld(*corner) as usize];
            normal == Vec3::ZERO || normal.dot(after) > 0.0
        })
    }
}

/// The edges that make triangles with the vertex that a fan goes onto.
pub(super) fn floor(fan: &Fan, onto: u32) -> impl Iterator<Item = (u32, u32)> {
    fan.edges().filter(move |(a, b)| *a != onto && *b != onto)
}

fn distance_to_segment(p: Vec3, a: Vec3, b: Vec3) -> f32 {
    let along = b - a;
    let share = ((p - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    p.distance(a + along * share)
}

/// How far a point is from a triangle with an area.
fn distance_to_triangle(p: Vec3, a: Vec3, b: Vec3, c: Vec3) -> f32 {
    let normal = (b - a).cross(c - a);
    let is_beside = |from: Vec3, to: Vec3| (to - from).cross(p - from).dot(normal) < 0.0;
    if is_beside(a, b) || is_beside(b, c) || is_beside(c, a) {
        return distance_to_segment(p, a, b).min(distance_to_segment(p, b, c)).min(distance_to_segment(p, c, a));
    }
    ((p - a).dot(normal) / normal.length().max(f32::MIN_POSITIVE)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances() {
        let [a, b, c] = [Vec3::ZERO, Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.0, 2.0, 0.0)];
        assert_eq!(distance_to_triangle(Vec3::new(0.5, 0.5, -3.0), a, b, c), 3.0);
        assert_eq!(distance_to_triangle(Vec3::new(7.0, 0.0, 4.0), a, b, c), 5.0);
        assert_eq!(distance_to_triangle(Vec3::new(2.0, -2.0, 0.0), a, b, c), 2.0);
        assert_eq!(distance_to_segment(Vec3::new(-3.0, 4.0, 0.0), a, b), 5.0);
    }
}
