//! Oriented boxes from the eigenvectors of a covariance (Nirnimesh, Harish, Narayanan 2006, Algorithm 1).

use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::Aabb;

/// An oriented box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Obb {
    /// Middle of the box, metres.
    pub center: DVec3,
    /// Unit axes, orthogonal, right-handed.
    pub axes: [DVec3; 3],
    /// Half the edge length along each axis, metres; zero where the box is flat.
    pub half_m: DVec3,
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
        Self { center, axes, half_m: local.size() * 0.5 + growth }
    }

    /// Half the box's extent along the unit direction `normal`, metres.
    pub fn radius_along(&self, normal: DVec3) -> f64 {
        let along = DVec3::new(self.axes[0].dot(normal).abs(), self.axes[1].dot(normal).abs(), self.axes[2].dot(normal).abs());
        along.dot(self.half_m)
    }

    /// Its eight corners; bit k of the index chooses the side along axis k.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let sign = |bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
            self.center
                + self.axes[0] * (sign(1) * self.half_m.x)
                + self.axes[1] * (sign(2) * self.half_m.y)
                + self.axes[2] * (sign(4) * self.half_m.z)
        })
    }

    /// The least axis-aligned box around it.
    pub fn aabb(&self) -> Aabb {
        Aabb::of_points(self.corners())
    }

    /// The same box, `by_m` larger on every side.
    pub fn grown(&self, by_m: f64) -> Self {
        Self { half_m: self.half_m + DVec3::splat(by_m), ..*self }
    }

    /// Whether `point` is inside or within `tolerance_m` of it.
    pub fn contains(&self, point: DVec3, tolerance_m: f64) -> bool {
        let d = point - self.center;
        let limit = self.half_m + DVec3::splat(tolerance_m);
        (0..3).all(|k| d.dot(self.axes[k]).abs() <= limit[k])
    }

    /// Half the surface area: compares flat boxes too, which a volume cannot.
    fn size_measure(&self) -> f64 {
        let h = self.half_m;
        h.x * h.y + h.y * h.z + h.z * h.x
    }
}

impl From<Aabb> for Obb {
    fn from(aabb: Aabb) -> Self {
        Self { center: aabb.center(), axes: [DVec3::X, DVec3::Y, DVec3::Z], half_m: (aabb.size() * 0.5).max(DVec3::ZERO) }
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

    #[test]
    fn degenerate_sets_give_thin_boxes() {
        let point = box_around(&[DVec3::new(3.0, -2.0, 1e6)]);
        assert!(point.half_m.max_element() < 1e-6 && point.contains(DVec3::new(3.0, -2.0, 1e6), 0.0));
        let line = box_around(&[DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0)]);
        assert!(line.half_m.max_element() > 1.8 && line.half_m.min_element() < 1e-9, "{line:?}");
        let plane = [DVec3::ZERO, DVec3::new(3.0, 1.0, 0.0), DVec3::new(-1.0, 2.0, 1.0)];
        let flat = box_around(&plane);
        assert!(flat.half_m.min_element() < 1e-9, "{flat:?}");
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
            for k in 0..3 {
                proptest::prop_assert!((obb.axes[k].length() - 1.0).abs() < 1e-12);
                proptest::prop_assert!(obb.axes[k].dot(obb.axes[(k + 1) % 3]).abs() < 1e-12);
            }
        }
    }
}
