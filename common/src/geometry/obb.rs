//! Oriented boxes from the eigenvectors of a covariance (Nirnimesh, Harish, Narayanan 2006, Algorithm 1).

use glam::{DAffine3, DMat3, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::Aabb;

/// An oriented box: its middle, and the way from there to the middle of three of its faces.
///
/// Fitted boxes have right angles. A box moved by a transform with shear is a parallelepiped, and all that is said
/// here holds for it too.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Obb {
    /// Middle of the box, metres.
    pub center: DVec3,
    /// Half of each edge, metres; zero where the box is flat.
    pub half_axes: [DVec3; 3],
}

impl Obb {
    /// A box around points, with the eigenvectors of their covariance as its axes; `None` without points.
    ///
    /// The points are visited twice. Every point lies inside the box, up to rounding that the box's own
    /// growth covers. Degenerate sets (one point, a line, a plane) give a valid box with zero half-lengths. Where
    /// the axis-aligned box has less surface the axes are the world's: a cloud without a preferred direction has
    /// arbitrary eigenvectors.
    pub fn around<I>(points: I) -> Option<Self>
    where
        I: Iterator<Item = DVec3> + Clone,
    {
        let aabb = Aabb::of_points(points.clone());
        if aabb.is_empty() {
            return None;
        }
        let axes = principal_axes(points.clone(), aabb.center());
        let fitted = Self::with_axes(axes, points);
        let aligned = Self::from(aabb);
        Some(if fitted.size_measure() < aligned.size_measure() { fitted } else { aligned })
    }

    /// The least box with the given orthonormal `axes` that holds all `points` (at least one).
    pub fn with_axes<I>(axes: [DVec3; 3], points: I) -> Self
    where
        I: Iterator<Item = DVec3>,
    {
        let to_axes = DMat3::from_cols(axes[0], axes[1], axes[2]).transpose();
        let local = Aabb::of_points(points.map(|p| to_axes * p));
        // A product of three terms at the magnitude of the coordinates rounds by a few ulps of that magnitude.
        let magnitude = local.min.abs().max(local.max.abs()).max_element();
        let growth = DVec3::splat(magnitude * 8.0 * f64::EPSILON);
        let center = to_axes.transpose() * local.center();
        let half_m = local.size() * 0.5 + growth;
        Self { center, half_axes: [axes[0] * half_m.x, axes[1] * half_m.y, axes[2] * half_m.z] }
    }

    /// The box of one point.
    pub fn of_point(center: DVec3) -> Self {
        Self { center, half_axes: [DVec3::ZERO; 3] }
    }

    /// The box after an affine transform; exact for every transform.
    #[inline]
    pub fn transformed(&self, to_from_here: &DAffine3) -> Self {
        Self {
            center: to_from_here.transform_point3(self.center),
            half_axes: self.half_axes.map(|h| to_from_here.transform_vector3(h)),
        }
    }

    /// Whether every number in it is finite.
    pub fn is_finite(&self) -> bool {
        self.center.is_finite() && self.half_axes.iter().all(|h| h.is_finite())
    }

    /// Half the box's extent along the unit direction `normal`, metres.
    #[inline]
    pub fn radius_along(&self, normal: DVec3) -> f64 {
        let [x, y, z] = self.half_axes.map(|h| h.dot(normal).abs());
        x + y + z
    }

    /// Its eight corners; bit k of the index chooses the side along half-axis k.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let along = |bit: usize, h: DVec3| if i & bit == 0 { -h } else { h };
            let [x, y, z] = self.half_axes;
            self.center + along(1, x) + along(2, y) + along(4, z)
        })
    }

    /// The least axis-aligned box around it.
    #[inline]
    pub fn aabb(&self) -> Aabb {
        let [x, y, z] = self.half_axes.map(DVec3::abs);
        let half_m = x + y + z;
        Aabb { min: self.center - half_m, max: self.center + half_m }
    }

    /// The same box, every face `by_m` further out.
    pub fn grown(&self, by_m: f64) -> Self {
        let mut half_axes = self.half_axes;
        for ((h, normal), thickness_m) in half_axes.iter_mut().zip(self.face_normals()).zip(self.thickness_m()) {
            *h = if thickness_m > 0.0 { *h * (1.0 + by_m / thickness_m) } else { normal * by_m };
        }
        Self { half_axes, ..*self }
    }

    /// Whether `point` is inside or within `tolerance_m` of every face.
    pub fn contains(&self, point: DVec3, tolerance_m: f64) -> bool {
        let d = point - self.center;
        let within = |(normal, thickness_m): (DVec3, f64)| d.dot(normal).abs() <= thickness_m + tolerance_m;
        self.face_normals().into_iter().zip(self.thickness_m()).all(within)
    }

    /// Unit normals of the faces that the half-axes point to; a frame is made up where the box is flat.
    pub fn face_normals(&self) -> [DVec3; 3] {
        let [x, y, z] = self.half_axes.map(DVec3::normalize_or_zero);
        let zero = DVec3::ZERO;
        let pair = |a: DVec3| (a.any_orthonormal_vector(), a.cross(a.any_orthonormal_vector()));
        let (x, y, z) = match (x != zero, y != zero, z != zero) {
            (true, true, true) => (x, y, z),
            (false, true, true) => (y.cross(z), y, z),
            (true, false, true) => (x, z.cross(x), z),
            (true, true, false) => (x, y, x.cross(y)),
            (true, false, false) => (x, pair(x).0, pair(x).1),
            (false, true, false) => (pair(y).1, y, pair(y).0),
            (false, false, true) => (pair(z).0, pair(z).1, z),
            (false, false, false) => (DVec3::X, DVec3::Y, DVec3::Z),
        };
        let towards = |normal: DVec3, axis: DVec3| {
            let normal = normal.try_normalize().unwrap_or(axis);
            if normal.dot(axis) < 0.0 { -normal } else { normal }
        };
        [towards(y.cross(z), x), towards(z.cross(x), y), towards(x.cross(y), z)]
    }

    /// Half the distance between each pair of faces.
    fn thickness_m(&self) -> [f64; 3] {
        let normals = self.face_normals();
        std::array::from_fn(|k| self.half_axes[k].dot(normals[k]))
    }

    /// An eighth of the surface area: compares flat boxes too, which a volume cannot.
    pub fn size_measure(&self) -> f64 {
        let [x, y, z] = self.half_axes;
        x.cross(y).length() + y.cross(z).length() + z.cross(x).length()
    }
}

impl From<Aabb> for Obb {
    fn from(aabb: Aabb) -> Self {
        let half_m = (aabb.size() * 0.5).max(DVec3::ZERO);
        Self { center: aabb.center(), half_axes: [DVec3::X * half_m.x, DVec3::Y * half_m.y, DVec3::Z * half_m.z] }
    }
}

/// Right-handed unit eigenvectors of the points' covariance about their mean. Falls back to the world's axes
/// where the covariance is not finite or the result is not orthonormal.
fn principal_axes(points: impl Iterator<Item = DVec3> + Clone, near: DVec3) -> [DVec3; 3] {
    const WORLD: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut count = 0.0;
    let (mut sum, mut diagonal, mut off) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for p in points {
        // Relative to a point nearby: the squares of far coordinates would cancel.
        let d = p - near;
        count += 1.0;
        sum += d;
        diagonal += d * d;
        off += d * DVec3::new(d.y, d.z, d.x);
    }
    let mean = sum / count;
    let diagonal = diagonal / count - mean * mean;
    let off = off / count - mean * DVec3::new(mean.y, mean.z, mean.x);
    let covariance = Matrix3::new(
        diagonal.x, off.x, off.z, //
        off.x, diagonal.y, off.y, //
        off.z, off.y, diagonal.z,
    );
    let scale = diagonal.abs().max_element();
    if !(scale.is_finite() && scale > 0.0 && off.is_finite()) {
        return WORLD;
    }
    const MAX_SWEEPS: usize = 64;
    let Some(eigen) = SymmetricEigen::try_new(covariance / scale, f64::EPSILON, MAX_SWEEPS) else {
        return WORLD;
    };
    let column = |k: usize| DVec3::new(eigen.eigenvectors[(0, k)], eigen.eigenvectors[(1, k)], eigen.eigenvectors[(2, k)]);
    // Orthonormal to the last bit that matters: the box encloses only if its axes are.
    let x = column(0).normalize_or_zero();
    let y = (column(1) - x * x.dot(column(1))).normalize_or_zero();
    let z = x.cross(y);
    if x.is_normalized() && y.is_normalized() && z.is_normalized() { [x, y, z] } else { WORLD }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn box_around(points: &[DVec3]) -> Obb {
        Obb::around(points.iter().copied()).expect("there are points")
    }

    fn lengths(obb: &Obb) -> DVec3 {
        DVec3::from(obb.half_axes.map(DVec3::length))
    }

    #[test]
    fn degenerate_sets_give_thin_boxes() {
        let point = box_around(&[DVec3::new(3.0, -2.0, 1e6)]);
        assert!(lengths(&point).max_element() < 1e-6 && point.contains(DVec3::new(3.0, -2.0, 1e6), 0.0));
        let line = box_around(&[DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0)]);
        assert!(lengths(&line).max_element() > 1.8 && lengths(&line).min_element() < 1e-9, "{line:?}");
        let plane = [DVec3::ZERO, DVec3::new(3.0, 1.0, 0.0), DVec3::new(-1.0, 2.0, 1.0)];
        let flat = box_around(&plane);
        assert!(lengths(&flat).min_element() < 1e-9, "{flat:?}");
        assert!(Obb::around(std::iter::empty()).is_none());
    }

    #[test]
    fn a_slanted_stick_gets_a_tight_box() {
        let along = DVec3::new(1.0, 2.0, 3.0).normalize();
        let side = along.cross(DVec3::X).normalize();
        let points: Vec<_> = (0..100).map(|i| along * f64::from(i) * 0.1 + side * f64::from(i % 3) * 0.01).collect();
        let obb = box_around(&points);
        assert!(obb.size_measure() < 0.3, "{obb:?}");
    }

    proptest::proptest! {
        #[test]
        fn every_point_is_inside(
            points in proptest::collection::vec((-1e3..1e3f64, -1e1..1e1f64, -1e6..1e6f64), 1..40),
            flatten in 0..8u8,
        ) {
            let points: Vec<_> = points
                .into_iter()
                .map(|(x, y, z)| {
                    let keep = |bit: u8, v: f64| if flatten & bit == 0 { v } else { 0.0 };
                    DVec3::new(keep(1, x), keep(2, y), keep(4, z))
                })
                .collect();
            let obb = box_around(&points);
            for p in &points {
                proptest::prop_assert!(obb.contains(*p, 1e-9), "{p} outside {obb:?}");
            }
            let normals = obb.face_normals();
            for k in 0..3 {
                proptest::prop_assert!((normals[k].length() - 1.0).abs() < 1e-12);
                proptest::prop_assert!(normals[k].dot(normals[(k + 1) % 3]).abs() < 1e-9);
            }
        }

        #[test]
        fn a_moved_and_grown_box_holds_what_it_held(
            half in (0.0..3.0f64, 0.0..3.0f64, 0.0..3.0f64),
            columns in proptest::collection::vec((-2.0..2.0f64, -2.0..2.0f64, -2.0..2.0f64), 4),
            flatten in 0..8u8,
            at in (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64),
            away in (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64),
        ) {
            let keep = |bit: u8, v: f64| if flatten & bit == 0 { v } else { 0.0 };
            let half = DVec3::new(keep(1, half.0), keep(2, half.1), keep(4, half.2));
            let columns: Vec<DVec3> = columns.into_iter().map(DVec3::from).collect();
            let moved = DAffine3 { matrix3: DMat3::from_cols(columns[0], columns[1], columns[2]), translation: columns[3] };
            let obb = Obb::from(Aabb { min: -half, max: half }).transformed(&moved);
            let inside = moved.transform_point3(half * DVec3::from(at));
            let away = DVec3::from(away).normalize_or_zero() * 0.5;
            proptest::prop_assert!(obb.aabb().union(&Aabb::of_points([inside])).size().abs_diff_eq(obb.aabb().size(), 1e-9));
            let normal = away.normalize_or_zero();
            proptest::prop_assert!((inside - obb.center).dot(normal) <= obb.radius_along(normal) + 1e-9);
            // Almost flat and sheared, the made-up frame leaves no more than this of the promise.
            proptest::prop_assert!(obb.grown(0.5).contains(inside + away, 1e-6), "{obb:?} {inside} {away}");
        }
    }
}
