//! What a frustum cuts out of a scene's box.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use mullion_common::geometry::{Aabb, Frustum, Plane};

use super::canvas::hull;

/// Rays of tiles of one eye that lie within this of their middle are one cone, as a cosine.
const ONE_CONE: f64 = 0.25;
/// Corners of a cone whose directions are so near are one.
const SAME_DIRECTION: f64 = 1e-3;
/// The box is this much larger, as a share of its diagonal: its faces do not lie in those of leaves.
const MARGIN: f64 = 0.002;

/// An eye, and the directions of its convex cone's edges in order.
pub struct Cone {
    pub eye: DVec3,
    rays: Vec<DVec3>,
}

/// A cone as far as it goes through a scene's box.
pub struct Wedge {
    pub eye: DVec3,
    /// Of what it has in common with the box.
    pub edges: Vec<[DVec3; 2]>,
    /// From an eye outside to the box, or past it to its middle, and there from one to the next.
    pub approach: Vec<[DVec3; 2]>,
}

/// The frusta's cones. Those of one eye that look roughly alike are one: a wall of tiles in a plane has four edges.
pub fn cones(frusta: &[Frustum]) -> Vec<Cone> {
    let mut cones: Vec<Cone> = Vec::new();
    for (at, frustum) in frusta.iter().enumerate() {
        if frusta[..at].iter().any(|before| before.eye == frustum.eye) {
            continue; // this eye had its turn
        }
        let of_eye: Vec<[DVec3; 4]> = frusta[at..].iter().filter(|other| other.eye == frustum.eye).map(|f| f.rays).collect();
        match around(of_eye.iter().flatten()) {
            Some(rays) => cones.push(Cone { eye: frustum.eye, rays }),
            None => cones.extend(of_eye.iter().map(|rays| Cone { eye: frustum.eye, rays: rays.to_vec() })),
        }
    }
    cones
}

/// The edges of the cone around some rays; none where they go too far apart.
fn around<'a>(rays: impl Iterator<Item = &'a DVec3> + Clone) -> Option<Vec<DVec3>> {
    let middle = rays.clone().map(|ray| ray.normalize()).sum::<DVec3>().try_normalize()?;
    if rays.clone().any(|ray| ray.normalize().dot(middle) < ONE_CONE) {
        return None;
    }
    let (right, up) = middle.any_orthonormal_pair();
    // Where they meet a plane before the eye: straight lines stay straight.
    let points: Vec<DVec2> = rays.map(|ray| DVec2::new(ray.dot(right), ray.dot(up)) / ray.dot(middle)).collect();
    let corners = without_straight(&hull(points));
    (corners.len() >= 3).then(|| corners.iter().map(|at| middle + right * at.x + up * at.y).collect())
}

/// A polygon without corners that are none, but for rounding.
fn without_straight(polygon: &[DVec2]) -> Vec<DVec2> {
    let count = polygon.len();
    let turns = |at: &usize| {
        let (before, here, after) = (polygon[(at + count - 1) % count], polygon[*at], polygon[(at + 1) % count]);
        (here - before).perp_dot(after - here).abs() > SAME_DIRECTION * (here - before).length() * (after - here).length()
    };
    (0..count).filter(turns).map(|at| polygon[at]).collect()
}

impl Cone {
    /// What it cuts out of a box. Nothing where it holds all of it: then it is told by its own edges alone.
    pub fn within(&self, bounds: &Aabb) -> Wedge {
        let margin = DVec3::splat(bounds.size().length() * MARGIN + 1e-6);
        let bounds = Aabb { min: bounds.min - margin, max: bounds.max + margin };
        let sides: Vec<Plane> = self.planes().collect();
        let mut edges = Vec::new();
        if bounds.corners().iter().any(|corner| sides.iter().any(|side| side.distance_m(*corner) < 0.0)) {
            let planes: Vec<Plane> = sides.into_iter().chain(faces(&bounds)).collect();
            let reach_m = bounds.size().length() + bounds.center().distance(self.eye);
            for (at, plane) in planes.iter().enumerate() {
                let others = planes.iter().enumerate().filter(|(other, _)| *other != at);
                let polygon = others.fold(square(plane, bounds.center(), reach_m), |polygon, (_, other)| cut(&polygon, other));
                edges.extend((0..polygon.len()).map(|k| [polygon[k], polygon[(k + 1) % polygon.len()]]));
            }
        }
        Wedge { eye: self.eye, edges, approach: self.approach(&bounds) }
    }

    fn approach(&self, bounds: &Aabb) -> Vec<[DVec3; 2]> {
        let middle = self.rays.iter().map(|ray| ray.normalize()).sum::<DVec3>().normalize_or_zero();
        let is_outside = (self.eye.cmplt(bounds.min) | self.eye.cmpgt(bounds.max)).any();
        let ahead_m = (bounds.center() - self.eye).dot(middle);
        if !is_outside || ahead_m <= 0.0 {
            return Vec::new();
        }
        let past = |ray: &DVec3| self.eye + *ray * (ahead_m / ray.dot(middle));
        let ends: Vec<(DVec3, bool)> = self
            .rays
            .iter()
            .map(|ray| entry(self.eye, *ray, bounds).map_or_else(|| (past(ray), false), |at| (at, true)))
            .collect();
        let mut lines: Vec<[DVec3; 2]> = ends.iter().map(|(end, _)| [self.eye, *end]).collect();
        for (k, (end, enters)) in ends.iter().enumerate() {
            let (next, next_enters) = ends[(k + 1) % ends.len()];
            if !enters && !next_enters {
                lines.push([*end, next]);
            }
        }
        lines
    }

    /// Its sides, positive inside.
    fn planes(&self) -> impl Iterator<Item = Plane> {
        let middle: DVec3 = self.rays.iter().map(|ray| ray.normalize()).sum();
        let count = self.rays.len();
        (0..count).map(move |k| {
            let normal = self.rays[k].cross(self.rays[(k + 1) % count]).normalize();
            Plane::through(self.eye, if normal.dot(middle) < 0.0 { -normal } else { normal })
        })
    }
}

/// A box's sides, positive inside.
fn faces(bounds: &Aabb) -> impl Iterator<Item = Plane> {
    let (min, max) = (bounds.min, bounds.max);
    DVec3::AXES.into_iter().flat_map(move |axis| [Plane::through(min, axis), Plane::through(max, -axis)])
}

/// A square in a plane that holds all of it within `reach_m` of a point, or more.
fn square(plane: &Plane, near: DVec3, reach_m: f64) -> Vec<DVec3> {
    let (a, b) = plane.normal.any_orthonormal_pair();
    let middle = near - plane.normal * plane.distance_m(near);
    let corner = |k: u32| DVec2::from_angle(TAU * f64::from(k) / 4.0) * (2.0 * reach_m);
    (0..4).map(corner).map(|at| middle + a * at.x + b * at.y).collect()
}

/// The part of a convex polygon on a plane's positive side.
fn cut(polygon: &[DVec3], plane: &Plane) -> Vec<DVec3> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (k, &here) in polygon.iter().enumerate() {
        let next = polygon[(k + 1) % polygon.len()];
        let [here_m, next_m] = [here, next].map(|point| plane.distance_m(point));
        if here_m >= 0.0 {
            kept.push(here);
        }
        if (here_m >= 0.0) != (next_m >= 0.0) {
            kept.push(here + (next - here) * (here_m / (here_m - next_m)));
        }
    }
    kept
}

/// Where a ray from outside enters a box.
fn entry(eye: DVec3, ray: DVec3, bounds: &Aabb) -> Option<DVec3> {
    let ends = [(bounds.min - eye) / ray, (bounds.max - eye) / ray];
    let enters = ends[0].min(ends[1]).max_element();
    let leaves = ends[0].max(ends[1]).min_element();
    (enters > 0.0 && enters <= leaves).then(|| eye + ray * enters)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mullion_common::wall::{ViewId, Wall, WallConfig};

    fn frusta(wall: &Wall) -> Vec<Frustum> {
        let eyes = wall.default_eyes();
        (0..).zip(&eyes).map(|(view, eye)| wall.frustum(ViewId(view), *eye, &glam::DAffine3::IDENTITY)).collect()
    }

    fn shipped(file: &str) -> Wall {
        let text = std::fs::read_to_string(format!("{}/configs/{file}", env!("CARGO_MANIFEST_DIR"))).expect("it ships");
        WallConfig::parse(&text).expect("a wall")
    }

    #[test]
    fn tiles_in_a_plane_are_one_cone_and_walls_around_are_several() {
        let flat = cones(&frusta(&shipped("wall_4x4.toml")));
        assert_eq!(flat.iter().map(|cone| cone.rays.len()).collect::<Vec<_>>(), [4]);
        assert!(cones(&frusta(&shipped("cave_4.toml"))).len() >= 4);
    }

    #[test]
    fn a_wedge_lies_in_the_box_and_in_the_cone() {
        let cone = &cones(&frusta(&shipped("wall_4x4.toml")))[0];
        let room = Aabb { min: cone.eye - DVec3::new(9.0, 2.0, 30.0), max: cone.eye + DVec3::new(5.0, 8.0, 2.0) };
        let Wedge { edges, approach, .. } = cone.within(&room);
        assert!(edges.len() >= 12 && approach.is_empty(), "{edges:?} {approach:?}");
        for point in edges.iter().flatten() {
            assert!(cone.planes().all(|plane| plane.distance_m(*point) > -1e-6), "{point}");
            assert!((*point - room.min).min_element() > -0.1 && (room.max - *point).min_element() > -0.1, "{point}");
        }
    }

    #[test]
    fn an_eye_outside_is_joined_with_the_box() {
        let cone = &cones(&frusta(&shipped("wall_4x4.toml")))[0];
        let ahead = cone.eye + DVec3::NEG_Z * 60.0;
        let large = cone.within(&Aabb { min: ahead - 50.0, max: ahead + 50.0 });
        assert_eq!(large.approach.len(), 4, "as far as to its face");
        assert!(!large.edges.is_empty());
        let small = cone.within(&Aabb { min: ahead - 1.0, max: ahead + 1.0 });
        assert_eq!((small.edges.len(), small.approach.len()), (0, 8), "a pyramid round it");
        let behind = cone.within(&Aabb { min: cone.eye + 50.0, max: cone.eye + 60.0 });
        assert_eq!((behind.edges.len(), behind.approach.len()), (0, 0));
    }
}
