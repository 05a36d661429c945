//! What encloses each group: its members, and everything finer.

use glam::{DVec3, Vec3};
use mullion_common::scene::{NodeAxis, NodeExtent, PackedBounds};

use super::super::bounds::{SLACK, cosine_of_sum};
use super::super::source::LodMesh;

/// The bounds of a group.
#[derive(Clone, Copy)]
pub(super) struct GroupBounds {
    /// The middle of its box and of its sphere.
    pub center: Vec3,
    pub packed: PackedBounds,
    low: Vec3,
    high: Vec3,
    axis: NodeAxis,
    least_cosine: f32,
}

impl GroupBounds {
    /// Of members' triangles, and of the groups that made members; `error_m` is no less than theirs.
    pub fn new(mesh: &LodMesh, triangles: impl Iterator<Item = [u32; 3]> + Clone, makers: &[Self], error_m: f32) -> Self {
        let corners = || triangles.clone().map(|t| t.map(|v| mesh.positions[v as usize]));
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let mut sum = DVec3::ZERO;
        for triangle in corners() {
            triangle.iter().for_each(|p| (low, high) = (low.min(*p), high.max(*p)));
            let [a, b, c] = triangle.map(Vec3::as_dvec3);
            sum += (b - a).cross(c - a);
        }
        for maker in makers {
            (low, high) = (low.min(maker.low), high.max(maker.high));
        }
        let center = low.midpoint(high);
        let axis = NodeAxis::along(sum.normalize_or_zero().as_vec3());
        let direction = axis.direction();
        let (mut radius, mut least_cosine) = (0.0f32, 1.0f32);
        for triangle @ [a, b, c] in corners() {
            radius = triangle.iter().map(|p| p.distance(center)).fold(radius, f32::max);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            if normal != Vec3::ZERO {
                least_cosine = least_cosine.min(direction.dot(normal));
            }
        }
        for maker in makers {
            radius = radius.max((maker.center.distance(center) + maker.packed.radius()) * SLACK);
            least_cosine = least_cosine.min(cosine_of_sum(direction.dot(maker.axis.direction()), maker.least_cosine));
        }
        radius *= SLACK;
        let extent = NodeExtent {
            error: error_m,
            radius,
            axis,
            cylinder_radius: radius,
            cylinder_below: radius,
            cylinder_above: radius,
            half_box: (high - center).max(center - low) * SLACK,
            least_cosine,
        };
        Self { center, packed: PackedBounds::new(&extent), low, high, axis, least_cosine }
    }
}
