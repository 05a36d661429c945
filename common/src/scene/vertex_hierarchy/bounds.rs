//! What encloses a node, in thirteen bytes: a sphere, a box, a cylinder along the normal, a cone of normals; and its error.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// An error as the upper half of an `f32`, rounded up, and lengths as shares of a radius, rounded up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct PackedBounds {
    error: [u8; 2],
    radius: [u8; 2],
    axis: NodeAxis,
    cone: u8,
    cylinder: [u8; 3],
    half_box: [u8; 3],
}
const _: () = assert!(size_of::<PackedBounds>() == 13);

/// Stands for a cone that no eye is behind.
const ALL_AROUND: u8 = 255;
const CONE_STEPS: f32 = 254.0;
const SHARE_STEPS: f32 = 255.0;

/// The direction of a cylinder and a cone, on an octahedron (Meyer et al., *On Floating-Point Normal Vectors*, 2010), a byte a coordinate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct NodeAxis([u8; 2]);

impl NodeAxis {
    /// The axis closest to a direction; some axis for one without length.
    pub fn along(direction: Vec3) -> Self {
        const STEPS: f32 = 127.0;
        let normal = direction.normalize_or(Vec3::Z);
        let sum = normal.abs().element_sum();
        let (mut u, mut v) = (normal.x / sum, normal.y / sum);
        if normal.z < 0.0 {
            (u, v) = ((1.0 - v.abs()) * 1f32.copysign(u), (1.0 - u.abs()) * 1f32.copysign(v));
        }
        Self([u, v].map(|x| (x * STEPS).round().clamp(-STEPS, STEPS) as i8 as u8))
    }

    /// As a unit vector.
    #[inline]
    pub fn direction(self) -> Vec3 {
        const STEPS: f32 = 127.0;
        let [u, v] = self.0.map(|byte| f32::from(byte as i8) / STEPS);
        let z = 1.0 - u.abs() - v.abs();
        let fold = (-z).max(0.0);
        let on_octahedron = Vec3::new(u - fold.copysign(u), v - fold.copysign(v), z);
        // Its coordinates sum up to about 1.
        on_octahedron / on_octahedron.length()
    }
}

/// How far a node reaches from its centre, exactly: what is packed encloses it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NodeExtent {
    /// Metres between its surface before the split and the mesh. At least that of all nodes below.
    pub error: f32,
    /// Of the sphere about the centre, metres.
    pub radius: f32,
    /// Of the cylinder.
    pub axis: NodeAxis,
    /// The cylinder's radius about the axis through the centre, metres.
    pub cylinder_radius: f32,
    /// How far it reaches against the axis, metres; at least 0.
    pub cylinder_below: f32,
    /// How far it reaches along the axis, metres; at least 0.
    pub cylinder_above: f32,
    /// Half the sides of the box about the centre, metres.
    pub half_box: Vec3,
    /// Least cosine between the axis and a normal.
    pub least_cosine: f32,
}

/// What encloses a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeBounds {
    /// Where the node's vertex is: the middle of the sphere and of the box; the cylinder's axis goes through it.
    pub center: Vec3,
    /// How far it reaches. The cosine is that of the cone, at most 0 where no eye is behind it.
    pub extent: NodeExtent,
    /// The sine of the angle between the axis and the normal furthest from it; `None` where no eye is behind all triangles.
    pub cone_sine: Option<f32>,
}

impl PackedBounds {
    /// Packs an extent. Whatever that encloses, what comes out encloses.
    pub fn new(extent: &NodeExtent) -> Self {
        let radius_bytes = rounded_up(extent.radius);
        let radius = widened(radius_bytes);
        let share = |length: f32| {
            let steps = if radius > 0.0 { (length / radius * SHARE_STEPS).ceil().clamp(0.0, SHARE_STEPS) } else { 0.0 };
            let is_short = steps / SHARE_STEPS * radius < length && steps < SHARE_STEPS;
            steps as u8 + u8::from(is_short)
        };
        let cosine = extent.least_cosine;
        // Rounding in the sum of three products, twice.
        const COSINE_SLACK: f32 = 1e-5;
        let cone = if cosine > COSINE_SLACK {
            let cosine = cosine - COSINE_SLACK;
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            (sine * CONE_STEPS).ceil().min(CONE_STEPS) as u8
        } else {
            ALL_AROUND
        };
        Self {
            error: rounded_up(extent.error),
            radius: radius_bytes,
            axis: extent.axis,
            cone,
            cylinder: [extent.cylinder_radius, extent.cylinder_below, extent.cylinder_above].map(share),
            half_box: extent.half_box.to_array().map(share),
        }
    }

    /// Metres between the surface before the split and the mesh, or more.
    #[inline]
    pub fn error(&self) -> f32 {
        widened(self.error)
    }

    /// Of the sphere about the centre, metres.
    #[inline]
    pub fn radius(&self) -> f32 {
        widened(self.radius)
    }

    /// The axis of the cone of normals, and the sine of the angle to the normal furthest from it; `None` where no eye is behind all triangles.
    #[inline]
    pub fn cone(&self) -> Option<(NodeAxis, f32)> {
        (self.cone != ALL_AROUND).then(|| (self.axis, f32::from(self.cone) / CONE_STEPS))
    }

    pub(in crate::scene) fn is_finite(&self) -> bool {
        [self.error, self.radius].into_iter().all(|bytes| widened(bytes).is_finite() && widened(bytes) >= 0.0)
    }

    /// The bounds around a centre.
    #[inline]
    pub fn around(&self, center: Vec3) -> NodeBounds {
        let radius = self.radius();
        let [cylinder_radius, cylinder_below, cylinder_above] = self.cylinder.map(|q| f32::from(q) / SHARE_STEPS * radius);
        let cone_sine = self.cone().map(|(_, sine)| sine);
        let extent = NodeExtent {
            error: self.error(),
            radius,
            axis: self.axis,
            cylinder_radius,
            cylinder_below,
            cylinder_above,
            half_box: Vec3::from(self.half_box.map(|q| f32::from(q) / SHARE_STEPS * radius)),
            least_cosine: cone_sine.map_or(-1.0, |sine| (1.0 - sine * sine).max(0.0).sqrt()),
        };
        NodeBounds { center, extent, cone_sine }
    }
}

/// The upper half of the least number with an empty lower half that is no less. The number is no less than 0.
fn rounded_up(value: f32) -> [u8; 2] {
    const LARGEST: u32 = f32::MAX.to_bits() >> 16;
    let value = value.max(0.0); // also where it is no number
    let up = (value.to_bits().saturating_add(0xffff) >> 16).min(LARGEST);
    (up as u16).to_le_bytes()
}

#[inline]
fn widened(bytes: [u8; 2]) -> f32 {
    f32::from_bits(u32::from(u16::from_le_bytes(bytes)) << 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_packed_encloses(
            radius in prop_oneof![Just(0.0f32), 1e-6..1e-3f32, 0.1..2000.0f32],
            shares in [0.0..1.0f32, 0.0..1.0f32, 0.0..1.0f32, 0.0..1.0f32, 0.0..1.0f32, 0.0..1.0f32],
            error in 0.0..50.0f32,
            cosine in -1.0..1.0f32,
            direction in [-1.0..1.0f32, -1.0..1.0f32, -1.0..1.0f32],
        ) {
            let [a, b, c, d, e, f] = shares.map(|share| share * radius);
            let extent = NodeExtent {
                error,
                radius,
                axis: NodeAxis::along(Vec3::from(direction)),
                cylinder_radius: a,
                cylinder_below: b,
                cylinder_above: c,
                half_box: Vec3::new(d, e, f),
                least_cosine: cosine,
            };
            let out = PackedBounds::new(&extent).around(Vec3::ONE);
            let found = out.extent;
            prop_assert!(found.error >= error && found.error <= error * 1.01 + 1e-30);
            prop_assert!(found.radius >= radius && found.radius <= radius * 1.01);
            let pairs = [
                (found.cylinder_radius, a), (found.cylinder_below, b), (found.cylinder_above, c),
                (found.half_box.x, d), (found.half_box.y, e), (found.half_box.z, f),
            ];
            for (packed, exact) in pairs {
                prop_assert!(packed >= exact && packed <= exact + radius * 0.02, "{packed} for {exact} of {radius}");
            }
            prop_assert!(out.cone_sine.is_none_or(|sine| sine * sine >= 1.0 - cosine * cosine && cosine > 0.0));
            let axis = extent.axis.direction();
            prop_assert!((axis.length() - 1.0).abs() < 1e-6);
            let direction = Vec3::from(direction);
            prop_assert!(direction.length() < 0.01 || axis.distance(direction.normalize()) < 0.02);
        }
    }

    #[test]
    fn what_is_too_large_stays_finite() {
        let extent = NodeExtent { error: f32::INFINITY, radius: f32::MAX, ..NodeExtent::default() };
        assert!(PackedBounds::new(&extent).is_finite());
        let extent = NodeExtent { error: f32::NAN, radius: f32::NAN, ..NodeExtent::default() };
        assert!(PackedBounds::new(&extent).is_finite());
    }
}
