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
}
