//! A plane with a side.

use glam::{DAffine3, DVec3};

use super::{Containment, Obb, RELATIVE_SLACK};

/// Share of absolute coordinates that rounding may cost: eye, plane and box are each placed in the world by about a dozen
/// operations of half an ulp.
pub const ABSOLUTE_ROUNDING: f64 = 16.0 * f64::EPSILON;

/// The plane `normal · p + offset_m = 0`; points with a positive value are inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal, towards the inside.
    pub normal: DVec3,
    /// Signed distance of the origin, metres.
    pub offset_m: f64,
}

impl Plane {
    /// The plane through `point` with the given unit `normal`.
    pub fn through(point: DVec3, normal: DVec3) -> Self {
        Self { normal, offset_m: -normal.dot(point) }
    }

    /// Signed distance of `point` in metres, positive inside.
    pub fn distance_m(&self, point: DVec3) -> f64 {
        self.normal.dot(point) + self.offset_m
    }

    /// The same plane with its sides swapped.
    pub fn flipped(&self) -> Self {
        Self { normal: -self.normal, offset_m: -self.offset_m }
    }

    /// The plane in another space. `to_from_here` must be a similarity (rotation, uniform scale, translation).
    pub fn transformed(&self, to_from_here: &DAffine3) -> Self {
        let point = to_from_here.transform_point3(-self.offset_m * self.normal);
        Self::through(point, to_from_here.transform_vector3(self.normal).normalize())
    }

    /// Classifies a box against the positive half-space. Conservative: within rounding of the plane it is `Cut`.
    ///
    /// The slack grows with the box's distance from the plane's own origin of rounding, `reference`, usually
    /// the eye: coordinates relative to it are what the GPU sees. What absolute coordinates round in `f64` is added: close to an
    /// eye that is far from the origin it is more.
    #[inline]
    pub fn classify(&self, obb: &Obb, reference: DVec3) -> Containment {
        let distance_m = self.normal.dot(obb.center) + self.offset_m;
        let radius_m = obb.radius_along(self.normal);
        let to_box = (obb.center - reference).abs();
        let absolute_m = obb.center.abs().element_sum() + self.offset_m.abs();
        let slack_m = (to_box.x + to_box.y + to_box.z + radius_m) * RELATIVE_SLACK + absolute_m * ABSOLUTE_ROUNDING;
        if distance_m + radius_m < -slack_m {
            Containment::Outside
        } else if distance_m - radius_m >= slack_m {
            Containment::Inside
        } else {
            Containment::Cut
        }
    }

    /// What [`Plane::classify`] compares, to the bit, for a box that meets many planes. `reach_m` is [`BoxTerms::reach_m`] of
    /// the reference.
    #[inline]
    pub fn clearance(&self, terms: &BoxTerms, reach_m: f64) -> Clearance {
        let [center_m, x, y, z] = terms.along(self.normal);
        let radius_m = x.abs() + y.abs() + z.abs();
        let absolute_m = terms.absolute_m + self.offset_m.abs();
        let slack_m = (reach_m + radius_m) * RELATIVE_SLACK + absolute_m * ABSOLUTE_ROUNDING;
        Clearance { distance_m: center_m + self.offset_m, radius_m, slack_m }
    }
}

/// Where a box lies in relation to a plane, in numbers: whoever asks only for what it wants to know, and branches on it,
/// has no third answer to sort out.
#[derive(Clone, Copy, Debug)]
pub struct Clearance {
    distance_m: f64,
    radius_m: f64,
    slack_m: f64,
}

impl Clearance {
    /// Whether it is [`Containment::Outside`].
    #[inline]
    pub fn is_outside(&self) -> bool {
        self.distance_m + self.radius_m < -self.slack_m
    }

    /// Whether it is [`Containment::Inside`], given that it is not outside.
    #[inline]
    pub fn is_inside(&self) -> bool {
        self.distance_m - self.radius_m >= self.slack_m
    }
}

/// A box as tests against one plane after another want it: turned so that its center and its half axes are multiplied by a
/// normal side by side, with the sums made that are the same for all planes.
#[derive(Clone, Copy, Debug)]
pub struct BoxTerms {
    /// X of the center, then of the half axes.
    x: [f64; 4],
    y: [f64; 4],
    z: [f64; 4],
    /// Sum of the center's absolute coordinates.
    absolute_m: f64,
}

impl BoxTerms {
    /// The terms of a box.
    #[inline]
    pub fn new(obb: &Obb) -> Self {
        let [a, b, c] = obb.half_axes;
        let all = [obb.center, a, b, c];
        Self { x: all.map(|v| v.x), y: all.map(|v| v.y), z: all.map(|v| v.z), absolute_m: obb.center.abs().element_sum() }
    }

    /// Length of the way from `reference` to the center, along the axes of the world.
    #[inline]
    pub fn reach_m(&self, reference: DVec3) -> f64 {
        let to_box = (DVec3::new(self.x[0], self.y[0], self.z[0]) - reference).abs();
        to_box.x + to_box.y + to_box.z
    }

    /// The center and the half axes along `normal`.
    #[inline]
    fn along(&self, normal: DVec3) -> [f64; 4] {
        std::array::from_fn(|k| self.x[k] * normal.x + self.y[k] * normal.y + self.z[k] * normal.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(size_m: f64) -> impl Strategy<Value = DVec3> {
        [-size_m..size_m, -size_m..size_m, -size_m..size_m].prop_map(DVec3::from)
    }

    proptest! {
        /// Boxes of all sizes, and planes that touch a corner or pass near by.
        #[test]
        fn clearance_tells_what_classify_does(
            center in vector(100.0),
            half_axes in [vector(5.0), vector(5.0), vector(0.5)],
            normal in vector(1.0),
            reference in vector(200.0),
            corner in 0..8usize,
            off_m in prop_oneof![Just(0.0), -1e-4..1e-4, -9.0..9.0],
        ) {
            let obb = Obb { center, half_axes };
            let normal = normal.normalize_or(DVec3::X);
            let plane = Plane::through(obb.corners()[corner] + normal * off_m, normal);
            let terms = BoxTerms::new(&obb);
            for plane in [plane, plane.flipped()] {
                let clearance = plane.clearance(&terms, terms.reach_m(reference));
                let containment = match (clearance.is_outside(), clearance.is_inside()) {
                    (true, _) => Containment::Outside,
                    (_, true) => Containment::Inside,
                    _ => Containment::Cut,
                };
                prop_assert_eq!(containment, plane.classify(&obb, reference));
            }
        }
    }
}
