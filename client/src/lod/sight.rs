//! Where an eye sees a node, and how wrong it is there.

use glam::{DVec3, Vec3};
use mullion_common::geometry::{Aabb, Plane, axis_lengths};
use mullion_common::scene::PackedBounds;

use super::LodObject;

/// From where, and into which part of space, objects are seen.
#[derive(Clone, Copy, Debug)]
pub struct LodSight<'a> {
    /// The eye, metres of the world.
    pub eye: DVec3,
    /// Planes with all that is seen on their positive side: a tile's frustum, or a wall's. None: all around.
    pub planes: &'a [Plane],
    /// Pixels that a length as far away as it is long covers. Above 0.
    pub pixels_per_radian: f32,
    /// No node counts as nearer than this, metres of the world. Above 0.
    pub near_m: f32,
}

/// What an eye sees of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NodeSight {
    /// Nothing: it is outside.
    Outside,
    /// Nothing: all of it faces away.
    Away,
    /// As many pixels the surface may be wrong where the node is not split.
    Pixels(f32),
}

/// Of what is measured: so much may be lost by rounding.
const SLACK: f32 = 1e-5;
/// Most planes of a sight.
const MAX_PLANES: usize = 8;

/// A sight in an object's local space, where its nodes are.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LocalSight {
    eye: Vec3,
    /// Normals of length 1 and offsets.
    planes: [(Vec3, f32); MAX_PLANES],
    plane_count: usize,
    /// Pixels for an error of a local unit in a distance of one.
    pixels: f32,
    near: f32,
    is_double_sided: bool,
    /// The object's.
    pub weight: f32,
}

impl LocalSight {
    /// A sight of an object. Planes beyond the eighth are not asked.
    pub fn new(sight: &LodSight<'_>, object: &LodObject<'_>) -> Self {
        let affine = object.world_from_local;
        let local_from_world = affine.inverse();
        let lengths = axis_lengths(&affine.matrix3);
        let (longest, shortest) = (lengths.max_element(), lengths.min_element());
        // What is drawn out may be wrong by more than in its own space.
        let stretch = if shortest > 0.0 { (longest / shortest) as f32 } else { 1.0 };
        let eye = local_from_world.transform_point3(sight.eye);
        let mut local = Self {
            eye: if eye.is_finite() { eye.as_vec3() } else { Vec3::ZERO },
            pixels: sight.pixels_per_radian * stretch,
            near: if shortest > 0.0 { (f64::from(sight.near_m) / longest) as f32 } else { sight.near_m }.max(f32::MIN_POSITIVE),
            is_double_sided: object.is_double_sided,
            weight: object.weight,
            ..Self::default()
        };
        for plane in sight.planes.iter().take(MAX_PLANES) {
            // A plane's numbers go the other way than a point's.
            let normal = affine.matrix3.transpose() * plane.normal;
            let offset = plane.normal.dot(affine.translation) + plane.offset_m;
            let length = normal.length().max(f64::MIN_POSITIVE);
            local.planes[local.plane_count] = ((normal / length).as_vec3(), (offset / length) as f32);
            local.plane_count += 1;
        }
        local
    }

    /// How many pixels a box may be long, at most; `None` if it is outside. Conservative.
    pub fn of_box(&self, local: &Aabb) -> Option<f32> {
        let (center, half) = (local.center().as_vec3(), (local.size() * 0.5).as_vec3());
        let size = center.abs().element_sum() + half.element_sum();
        for (normal, offset) in &self.planes[..self.plane_count] {
            if normal.dot(center) + offset < -(normal.abs().dot(half) + (size + offset.abs()) * SLACK) {
                return None;
            }
        }
        let radius = half.length();
        Some(2.0 * radius * self.pixels / ((center - self.eye).length() - radius).max(self.near))
    }

    /// What the eye sees of a node, that is stored with its centre. Conservative but for its pixels, which are as good as the node's error.
    #[inline]
    pub fn of(&self, (center, bounds): (Vec3, &PackedBounds)) -> NodeSight {
        let radius = bounds.radius();
        let size = center.abs().element_sum() + radius;
        for (normal, offset) in &self.planes[..self.plane_count] {
            if normal.dot(center) + offset < -(radius + (size + offset.abs()) * SLACK) {
                return NodeSight::Outside;
            }
        }
        let way = center - self.eye;
        let distance = way.length();
        if !self.is_double_sided
            && let Some((axis, sine)) = bounds.cone()
        {
            // Every normal is within the cone, every point within the sphere.
            let least = (distance + radius) * (sine + SLACK) + radius;
            if least < distance && way.dot(axis.direction()) > least {
                return NodeSight::Away;
            }
        }
        NodeSight::Pixels(bounds.error() * self.pixels / (distance - radius).max(self.near))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DQuat};
    use mullion_common::scene::{Hierarchy, NodeAxis, NodeExtent, ObjectId, Presence, VertexHierarchy};
    use proptest::prelude::*;

    fn vector(size: f64) -> impl Strategy<Value = DVec3> {
        [-size..size, -size..size, -size..size].prop_map(DVec3::from)
    }

    proptest! {
        /// Triangles around a node, placed, stretched and seen from anywhere: where one is before the planes and shows its front, the node is
        /// seen.
        #[test]
        fn what_is_seen_is_not_left_out(
            triangle in [vector(1.0), vector(1.0), vector(1.0)],
            eye in vector(6.0),
            at in vector(3.0),
            scale in [0.2..3.0f64, 0.2..3.0f64, -3.0..-0.2f64],
            turn in vector(1.0),
            normal in vector(1.0),
            offset in -3.0..3.0f64,
        ) {
            prop_assume!(normal.length() > 0.1);
            let world_from_local = DAffine3::from_scale_rotation_translation(
                DVec3::from(scale),
                DQuat::from_scaled_axis(turn * 3.0),
                at,
            );
            let local = triangle.map(|p| p.as_vec3());
            let front = (local[1] - local[0]).cross(local[2] - local[0]);
            prop_assume!(front.length() > 1e-2);
            let axis = NodeAxis::along(front);
            let extent = NodeExtent {
                error: 0.25,
                radius: local.iter().map(|p| p.length()).fold(0.0, f32::max),
                axis,
                least_cosine: axis.direction().dot(front.normalize()),
                ..NodeExtent::default()
            };
            let bounds = PackedBounds::new(&extent);
            let plane = Plane { normal: normal.normalize(), offset_m: offset };
            let hierarchy = Hierarchy::Vertices(VertexHierarchy::default());
            let object = LodObject { id: ObjectId(0), hierarchy: &hierarchy, world_from_local, is_double_sided: false, is_solid: true, presence: Presence::There, weight: 1.0 };
            let planes = [plane];
            let sight = LodSight { eye, planes: &planes, pixels_per_radian: 1000.0, near_m: 0.1 };
            let found = LocalSight::new(&sight, &object).of((Vec3::ZERO, &bounds));
            let world = local.map(|p| world_from_local.transform_point3(p.as_dvec3()));
            let is_before = world.iter().any(|p| plane.distance_m(*p) > 1e-4);
            let local_eye = world_from_local.inverse().transform_point3(eye).as_vec3();
            let shows_front = front.normalize().dot(local_eye - local[0]) > 1e-4;
            prop_assert!(found != NodeSight::Outside || !is_before);
            prop_assert!(found != NodeSight::Away || !shows_front);
        }
    }
}
