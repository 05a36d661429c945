//! The truth that algorithms are held against: whether a box and what a view sees have a point in common.
//!
//! Plane tests alone call a box near an edge of a frustum visible though it is not. Here every direction is tried along which
//! two convex polyhedra can be parted (the separating axis theorem; Gottschalk, Lin, Manocha: *OBBTree*, 1996, section 5):
//! the answer is exact, up to the rounding of `f64`.

use glam::DVec3;
use mullion_common::geometry::{Frustum, FrustumSide, Obb};
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::{LeafRange, VisibleSet};

/// Whether a box (any parallelepiped, flat or a point, too) and the space that a view sees have a point in common; touching
/// counts. Neither conservative nor greedy: errs only within the rounding of `f64`, in proportion to the distance from the
/// eye and the size of the box.
pub fn intersects(frustum: &Frustum, obb: &Obb) -> bool {
    Volume::of(frustum).meets(obb)
}

/// The plane of the frustum that a box lies farthest outside of, and its signed distance to the box's nearest point, metres: less than 0. None
/// where no plane parts the two, by the same arithmetic as [`intersects`].
pub fn parting_side(frustum: &Frustum, obb: &Obb) -> Option<(FrustumSide, f64)> {
    const SIDES: [FrustumSide; 5] =
        [FrustumSide::Left, FrustumSide::Right, FrustumSide::Bottom, FrustumSide::Top, FrustumSide::Near];
    let volume = Volume::of(frustum);
    let distances_m = volume.distances_m(obb);
    let outside = SIDES.into_iter().zip(distances_m).filter(|(_, distance_m)| *distance_m < 0.0);
    outside.min_by(|(_, a), (_, b)| a.total_cmp(b))
}

/// Adds to `set` the leaves whose boxes [`intersects`] the frustum, in ascending order; `set` must be empty. Tests every
/// leaf: what encloses leaves in the tree may be wrong, and shall not hide it.
pub fn visible_leaves(hierarchy: &ObjectHierarchy, frustum: &Frustum, set: &mut VisibleSet) {
    visible_boxes((0..).zip(hierarchy.leaf_nodes().map(|node| &node.bound)), frustum, set);
}

/// The same of leaves with these boxes, given by ascending number.
pub fn visible_boxes<'a>(boxes: impl Iterator<Item = (u32, &'a Obb)>, frustum: &Frustum, set: &mut VisibleSet) {
    let volume = Volume::of(frustum);
    for (leaf, _) in boxes.filter(|(_, bound)| volume.meets(bound)) {
        set.push(LeafRange::new(leaf, leaf + 1));
    }
}

/// What a view sees: a convex polyhedron without end. It is spanned by the corners of its near rectangle and by four rays,
/// along which it goes on for ever.
struct Volume {
    eye: DVec3,
    /// The planes' normals, inwards; all but the last plane pass through the eye.
    normals: [DVec3; 5],
    /// Distance of the near plane from the eye, metres.
    near_m: f64,
    /// Unit vectors.
    rays: [DVec3; 4],
    /// Of the near rectangle, relative to the eye.
    corners: [DVec3; 4],
    /// Unit vectors along the near rectangle's sides.
    sides: [DVec3; 2],
}

/// No ray is known to be at a right angle to the axis.
const NO_RAY: usize = usize::MAX;

impl Volume {
    fn of(frustum: &Frustum) -> Self {
        let near = frustum.plane(FrustumSide::Near);
        let near_m = -near.distance_m(frustum.eye);
        let [bottom_left, bottom_right, _, top_left] = frustum.rays;
        Self {
            eye: frustum.eye,
            normals: frustum.planes.map(|plane| plane.normal),
            near_m,
            rays: frustum.rays.map(DVec3::normalize),
            corners: frustum.rays.map(|ray| ray * (near_m / near.normal.dot(ray))),
            sides: [(bottom_right - bottom_left).normalize(), (top_left - bottom_left).normalize()],
        }
    }

    /// Signed distance of a box's nearest point from each plane, metres.
    fn distances_m(&self, obb: &Obb) -> [f64; 5] {
        let (center, limits_m) = (obb.center - self.eye, self.limits_m());
        std::array::from_fn(|side| {
            let normal = self.normals[side];
            normal.dot(center) + obb.radius_along(normal) - limits_m[side]
        })
    }

    /// Distance of each plane from the eye, metres.
    fn limits_m(&self) -> [f64; 5] {
        [0.0, 0.0, 0.0, 0.0, self.near_m]
    }

    fn meets(&self, obb: &Obb) -> bool {
        if self.distances_m(obb).iter().any(|distance_m| *distance_m < 0.0) {
            return false;
        }
        let center = obb.center - self.eye;
        let holds_center = self.normals.iter().zip(self.limits_m()).all(|(normal, limit_m)| normal.dot(center) >= limit_m);
        holds_center || !self.is_apart(center, &obb.half_axes)
    }

    /// Whether an axis that is no normal of the frustum parts the two: normals of the box's faces, and directions at right
    /// angles to an edge of each. An edge that the box lacks gives none, nor does one that is parallel to the other.
    fn is_apart(&self, center: DVec3, half_axes: &[DVec3; 3]) -> bool {
        let edges = half_axes.map(DVec3::normalize_or_zero);
        let is_parted = |axis: Option<DVec3>, ray| axis.is_some_and(|axis| self.is_parted_along(axis, ray, center, half_axes));
        let faces = [(0, 1), (1, 2), (2, 0)];
        faces.iter().any(|(a, b)| is_parted(edges[*a].cross(edges[*b]).try_normalize(), NO_RAY))
            || edges.iter().any(|edge| {
                self.rays.iter().enumerate().any(|(ray, along)| is_parted(across(*along, *edge), ray))
                    || self.sides.iter().any(|side| is_parted(side.cross(*edge).try_normalize(), NO_RAY))
            })
    }

    /// Whether the two have no common shadow on an axis to which `right_angled`, an index of `rays`, stands at a right angle.
    /// What rounding leaves of that ray's shadow is not to be taken for a way to infinity.
    fn is_parted_along(&self, axis: DVec3, right_angled: usize, center: DVec3, half_axes: &[DVec3; 3]) -> bool {
        let mut low_m = f64::INFINITY;
        let mut high_m = f64::NEG_INFINITY;
        for (ray, (along, corner)) in self.rays.iter().zip(&self.corners).enumerate() {
            let at_m = axis.dot(*corner);
            low_m = low_m.min(at_m);
            high_m = high_m.max(at_m);
            let slope = if ray == right_angled { 0.0 } else { axis.dot(*along) };
            if slope < 0.0 {
                low_m = f64::NEG_INFINITY;
            } else if slope > 0.0 {
                high_m = f64::INFINITY;
            }
        }
        let middle_m = axis.dot(center);
        let radius_m: f64 = half_axes.iter().map(|half| axis.dot(*half).abs()).sum();
        middle_m + radius_m < low_m || middle_m - radius_m > high_m
    }
}

/// The direction at right angles to a ray and to an edge, both of unit length. Where the two are almost parallel their
/// product is mostly rounding; what it has along the ray is taken out, since any axis may part, but the ray must not lean.
fn across(ray: DVec3, edge: DVec3) -> Option<DVec3> {
    let axis = ray.cross(edge).try_normalize()?;
    (axis - ray * ray.dot(axis)).try_normalize()
}
