//! Which way a triangle faces, in three bytes.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// How far a decoded normal may be from the true one: the greatest distance between unit vectors that become the same bytes is less.
const NORMAL_ERROR: f32 = 0.02;
const STEPS: f32 = 127.0;
/// What a normal's byte stands for: a look takes less than a division, and every triangle of a cell takes three.
static COORDINATES: [f32; 256] = bytes(true);
/// What a place's byte stands for, in radii.
static PLACES: [f32; 256] = bytes(false);

const fn bytes(signed: bool) -> [f32; 256] {
    let mut values = [0.0; 256];
    let mut k = 0;
    while k < 256 {
        values[k] = if signed { k as u8 as i8 as f32 / STEPS } else { k as f32 / STEPS - 1.0 };
        k += 1;
    }
    values
}

/// A triangle's plane in its leaf's local space: its normal on an octahedron (Meyer et al., *On Floating-Point Normal Vectors*, 2010), a byte a
/// coordinate, and how far along it the triangle lies in the leaf's box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Facing(pub [u8; 3]);

impl Facing {
    /// The facing of a triangle in a box with this middle, whose corners are `radius` from it.
    pub fn new(corners: [Vec3; 3], middle: Vec3, radius: f32) -> Self {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or(Vec3::Z);
        let sum = normal.abs().element_sum();
        let (mut u, mut v) = (normal.x / sum, normal.y / sum);
        if normal.z < 0.0 {
            (u, v) = ((1.0 - v.abs()) * 1f32.copysign(u), (1.0 - u.abs()) * 1f32.copysign(v));
        }
        let byte = |x: f32| (x * STEPS).round().clamp(-STEPS, STEPS) as i8 as u8;
        let (u, v) = (byte(u), byte(v));
        let coarse = decoded(u, v);
        let along = corners.iter().map(|p| coarse.dot(*p - middle)).fold(f32::NEG_INFINITY, f32::max);
        // Downwards: a triangle that lies lower is seen from more places.
        let place = if radius > 0.0 { ((along / radius + 1.0) * STEPS - 0.01).floor().clamp(0.0, 255.0) } else { 0.0 };
        Self([u, v, place as u8])
    }

    /// Whether an eye is behind the triangle. Conservative: where it is close to the plane, it is not.
    #[inline]
    pub fn is_away_from(self, eye: &FacingEye) -> bool {
        let [u, v, place] = self.0;
        let normal = direction(u, v);
        let plane = PLACES[usize::from(place)] * eye.radius;
        normal.dot(eye.to_eye) + normal.length() * (eye.slack - plane) < 0.0
    }

    /// The sine of the angle, 0 to 1, at which an eye looks at the triangle, from either side: within a few hundredths for an eye that is
    /// far from the leaf's box, and a guess for one that is not.
    #[inline]
    pub fn slope_towards(self, eye: &FacingEye) -> f32 {
        let [u, v, place] = self.0;
        let normal = direction(u, v);
        let length = normal.length();
        let height = normal.dot(eye.to_eye) - length * (PLACES[usize::from(place)] * eye.radius);
        (height.abs() / (length * eye.distance).max(f32::MIN_POSITIVE)).min(1.0)
    }
}

/// An eye in a leaf's local space, as many triangles are asked about it.
#[derive(Clone, Copy, Debug)]
pub struct FacingEye {
    to_eye: Vec3,
    distance: f32,
    radius: f32,
    slack: f32,
}

impl FacingEye {
    /// `middle` and `radius` as in [`Facing::new`].
    pub fn new(eye: Vec3, middle: Vec3, radius: f32) -> Self {
        let to_eye = eye - middle;
        let distance = to_eye.length();
        Self { to_eye, distance, radius, slack: NORMAL_ERROR * (distance + radius) }
    }
}

/// The unit normal that two bytes stand for.
fn decoded(u: u8, v: u8) -> Vec3 {
    direction(u, v).normalize()
}

/// The same, on the octahedron.
#[inline]
fn direction(u: u8, v: u8) -> Vec3 {
    let (u, v) = (COORDINATES[usize::from(u)], COORDINATES[usize::from(v)]);
    let z = 1.0 - u.abs() - v.abs();
    let fold = (-z).max(0.0);
    Vec3::new(u - fold.copysign(u), v - fold.copysign(v), z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(size: f32) -> impl Strategy<Value = Vec3> {
        [-size..size, -size..size, -size..size].prop_map(Vec3::from)
    }

    proptest! {
        /// Eyes near and far, triangles of all shapes in a box that is as large as they are or larger.
        #[test]
        fn only_triangles_that_an_eye_sees_from_behind_face_away(
            corners in [vector(1.0), vector(2.0), vector(3.0)],
            eye in prop_oneof![vector(4.0), vector(500.0)],
            larger in 1.0..3.0f32,
            far in prop_oneof![Just(0.0f32), 100.0..1000.0f32],
        ) {
            let offset = Vec3::new(far, -far, 2.0 * far);
            let corners = corners.map(|p| p + offset);
            let (low, high) = (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
            let (middle, radius) = ((low + high) / 2.0, (high - low).length() / 2.0 * larger);
            let eye = eye + offset;
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            prop_assume!(normal.length() > 1e-3);
            let height = normal.normalize().dot(eye - corners[0]);
            let away = Facing::new(corners, middle, radius).is_away_from(&FacingEye::new(eye, middle, radius));
            prop_assert!(!away || height < 1e-3, "it is {height} in front");
            // And they are found where they face clearly away.
            let reach = (eye - middle).length() + radius;
            prop_assert!(away || height > -0.06 * reach, "it is {height} of {reach} behind");
        }
    }

    #[test]
    fn slopes_are_those_of_the_view_on_the_plane() {
        let corners = [Vec3::ZERO, Vec3::new(2.0, 0.0, 1.0), Vec3::new(0.5, 3.0, 0.0)];
        let (middle, radius) = (Vec3::new(1.0, 1.5, 0.5), 2.0);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        let facing = Facing::new(corners, middle, radius);
        for eye in [normal * 90.0, Vec3::new(60.0, -20.0, 70.0), Vec3::new(-3.0, 80.0, 5.0), corners[1] * 40.0] {
            let right = normal.dot((eye - middle).normalize()).abs();
            let found = facing.slope_towards(&FacingEye::new(eye, middle, radius));
            assert!((found - right).abs() < 0.05, "{eye}: {found}, {right}");
        }
        assert!((0.0..=1.0).contains(&facing.slope_towards(&FacingEye::new(middle, middle, radius))));
        assert!((0.0..=1.0).contains(&facing.slope_towards(&FacingEye::new(Vec3::splat(0.1), middle, radius))));
    }

    #[test]
    fn a_point_has_some_facing() {
        let facing = Facing::new([Vec3::ONE; 3], Vec3::ONE, 0.0);
        assert!(!facing.is_away_from(&FacingEye::new(Vec3::ONE, Vec3::ONE, 0.0)));
    }
}
