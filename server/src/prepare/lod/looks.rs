//! How far off a coarser surface looks by its texture coordinates and colours, in metres, so that it counts like a distance.
//!
//! A texture is as far off as it slides: by the way, in texture coordinates, from those that a vertex had to those that the surface has there now,
//! in metres by the map from these to places that its edges come nearest to. A colour that is wrong by a share of the way from black to white is off by that share of the patch
//! that shows it. Neither is off by more than the patch is large.

use glam::{Vec2, Vec3};

use super::fitness::{Star, floor};
use super::source::LodMesh;
use super::surface::Fan;

/// At the vertices of a star that go onto others; 0 where nothing but places tells vertices apart.
pub(super) fn deviation_at_vertex(mesh: &LodMesh, star: &Star, onto: [u32; 2]) -> f32 {
    sides(mesh, star, onto).map(|side| side.off_at(side.vertex)).fold(0.0, f32::max)
}

/// There, and in the middle of their edges: what was given up before may have looked like these.
pub(super) fn deviation(mesh: &LodMesh, star: &Star, onto: [u32; 2]) -> f32 {
    let all = |side: Side<'_>| -> f32 {
        let around = side.fan.path().iter().filter(|around| **around != side.onto).copied();
        around.chain([side.vertex]).map(|end| side.off_at(end)).fold(0.0, f32::max)
    };
    sides(mesh, star, onto).map(all).fold(0.0, f32::max)
}

/// Of a star: a vertex with its fan, and where it goes.
struct Side<'a> {
    mesh: &'a LodMesh,
    vertex: u32,
    fan: &'a Fan,
    onto: u32,
    /// How far from the vertex its fan reaches, metres.
    extent: f32,
    way_from_uv: WayFromUv,
}

/// How texture coordinates that change by a little move across the surface, metres.
#[derive(Clone, Copy)]
enum WayFromUv {
    /// By the first one, and by the second.
    Map([Vec3; 2]),
    /// Along an edge of no area there: by so much at most.
    Scale(f32),
}

impl WayFromUv {
    /// Of the fewest squares over edges: what each spans of texture coordinates and of space.
    fn of(edges: impl Iterator<Item = (Vec2, Vec3)>, extent: f32) -> Self {
        /// Below this share of the squared sum of squares their area is rounding.
        const LEAST_AREA: f32 = 1e-6;
        let (mut uu, mut uv, mut vv, mut along_u, mut along_v, mut reach) = (0.0, 0.0, 0.0, Vec3::ZERO, Vec3::ZERO, 0f32);
        for (of_uv, way) in edges {
            (uu, uv, vv) = (uu + of_uv.x * of_uv.x, uv + of_uv.x * of_uv.y, vv + of_uv.y * of_uv.y);
            (along_u, along_v) = (along_u + way * of_uv.x, along_v + way * of_uv.y);
            reach = reach.max(of_uv.length());
        }
        // Stretched or not: each axis by its own measure.
        let area = uu * vv - uv * uv;
        if area > LEAST_AREA * uu * vv && area.is_finite() {
            return Self::Map([(along_u * vv - along_v * uv) / area, (along_v * uu - along_u * uv) / area]);
        }
        Self::Scale(if reach > 0.0 { extent / reach } else { 0.0 })
    }

    fn metres(self, slid: Vec2) -> f32 {
        match self {
            Self::Map([u, v]) => (u * slid.x + v * slid.y).length(),
            Self::Scale(metres) => slid.length() * metres,
        }
    }
}

fn sides<'a>(mesh: &'a LodMesh, star: &'a Star, onto: [u32; 2]) -> impl Iterator<Item = Side<'a>> {
    let looks_alike = mesh.uvs.is_empty() && mesh.colors.is_empty();
    let all = (!looks_alike).then(|| star.sides().zip(onto));
    all.into_iter().flatten().map(move |((vertex, fan), onto)| {
        let way = |v: u32| mesh.positions[v as usize] - mesh.positions[vertex as usize];
        let extent = fan.path().iter().map(|v| way(*v).length()).fold(0.0, f32::max);
        let uv = |v: u32| mesh.uvs.get(v as usize).map_or(Vec2::ZERO, |uv| Vec2::from(*uv));
        let way_from_uv = WayFromUv::of(fan.path().iter().map(|v| (uv(*v) - uv(vertex), way(*v))), extent);
        Side { mesh, vertex, fan, onto, extent, way_from_uv }
    })
}

impl Side<'_> {
    /// In the middle between the vertex and one of its fan, or at itself.
    fn off_at(&self, end: u32) -> f32 {
        let Self { mesh, vertex, fan, onto, extent, way_from_uv } = *self;
        let middle = |of: &dyn Fn(u32) -> Vec3| (of(vertex) + of(end)) * 0.5;
        let (corners, shares) = stand_in(mesh, middle(&|v| mesh.positions[v as usize]), fan, onto);
        let mixed = |of: &dyn Fn(u32) -> f32| -> f32 { corners.iter().zip(shares).map(|(v, share)| of(*v) * share).sum() };
        let change = |of: &dyn Fn(u32) -> f32| (of(vertex) + of(end)) * 0.5 - mixed(of);
        let mut off = 0f32;
        if !mesh.uvs.is_empty() {
            // From the vertex's own: far from 0 the differences would be rounding.
            let own = mesh.uvs[vertex as usize];
            off = way_from_uv.metres(Vec2::from([0, 1].map(|axis| change(&|v| mesh.uvs[v as usize][axis] - own[axis]))));
        }
        if !mesh.colors.is_empty() {
            let wrong = [0, 1, 2, 3].map(|channel| change(&|v| f32::from(mesh.colors[v as usize][channel])).abs());
            off = wrong.into_iter().fold(off, |off, wrong| off.max(wrong / 255.0 * extent));
        }
        off.min(extent)
    }
}

/// The triangle that is nearest to a point once a fan went onto a vertex, and how much of each corner is in what is nearest there. Of a single
/// triangle its edge is left.
fn stand_in(mesh: &LodMesh, p: Vec3, fan: &Fan, onto: u32) -> ([u32; 3], [f32; 3]) {
    let place = |v: u32| mesh.positions[v as usize];
    let other = fan.path().iter().find(|v| **v != onto).copied().unwrap_or(onto);
    let mut least = (f32::INFINITY, ([onto, other, other], [1.0, 0.0, 0.0]));
    let edge = floor(fan, onto).next().is_none().then_some((other, other));
    for (a, b) in floor(fan, onto).chain(edge) {
        let corners = [onto, a, b];
        let shares = nearest_in_triangle(p, corners.map(place));
        let nearest: Vec3 = corners.iter().zip(shares).map(|(v, share)| place(*v) * share).sum();
        let distance = nearest.distance_squared(p);
        if distance < least.0 {
            least = (distance, (corners, shares));
        }
    }
    least.1
}

/// How much of each corner is in the point of a triangle that is nearest to another; the triangle may be an edge.
fn nearest_in_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> [f32; 3] {
    let normal = (b - a).cross(c - a);
    let doubled = normal.length_squared();
    if doubled > 0.0 {
        let share = |from: Vec3, to: Vec3| (to - from).cross(p - from).dot(normal) / doubled;
        let shares = [share(b, c), share(c, a), share(a, b)];
        if shares.iter().all(|share| *share >= 0.0) {
            return shares;
        }
    }
    let along = |from: Vec3, to: Vec3| {
        let way = to - from;
        let share = ((p - from).dot(way) / way.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        (share, (from + way * share).distance_squared(p))
    };
    let (ab, bc, ca) = (along(a, b), along(b, c), along(c, a));
    if ab.1 <= bc.1 && ab.1 <= ca.1 {
        [1.0 - ab.0, ab.0, 0.0]
    } else if bc.1 <= ca.1 {
        [0.0, 1.0 - bc.0, bc.0]
    } else {
        [ca.0, 0.0, 1.0 - ca.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_of_a_triangle() {
        let corners = [Vec3::ZERO, Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.0, 2.0, 0.0)];
        assert_eq!(nearest_in_triangle(Vec3::new(1.0, 0.5, -3.0), corners), [0.5, 0.25, 0.25], "inside");
        assert_eq!(nearest_in_triangle(Vec3::new(1.0, -7.0, 0.0), corners), [0.75, 0.25, 0.0], "beside an edge");
        assert_eq!(nearest_in_triangle(Vec3::new(-1.0, -1.0, 2.0), corners), [1.0, 0.0, 0.0], "beyond a corner");
        let edge = [corners[0], corners[1], corners[1]];
        assert_eq!(nearest_in_triangle(Vec3::new(1.0, 5.0, 0.0), edge), [0.75, 0.25, 0.0], "no triangle");
    }
}
