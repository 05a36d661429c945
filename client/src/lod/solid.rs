//! A node's bounds as a solid to be drawn: where it is, and a convex mesh around it.

use glam::{Vec2, Vec3};
use mullion_common::scene::{Hierarchy, NodeBounds, VertexHierarchy};

use super::Hidden;
use super::occluder::{BoundsKind, OCTAGON, link_vertices};
use super::steps::StepId;

/// What encloses a node: what a mesh of [`SolidMesh`] is, moved, turned and stretched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// In the object's space, metres.
    pub middle: Vec3,
    /// Of length 1, at right angles to each other. A cylinder's own is the last.
    pub axes: [Vec3; 3],
    /// How far it reaches along these from its middle, metres.
    pub half: Vec3,
}

impl Solid {
    /// What is asked about before a step, and what is hidden where all of it is.
    ///
    /// Bounds of a kind enclose all that comes below; those of a link, as a box along the normal, the vertices around the split and its own. Of a
    /// group, which has no link, its box.
    pub fn of(kind: BoundsKind, hierarchy: &Hierarchy, step: StepId) -> (Self, Hidden) {
        match (hierarchy, kind) {
            (Hierarchy::Vertices(hierarchy), BoundsKind::Link) => (Self::around_link(hierarchy, step), Hidden::Split),
            (Hierarchy::Vertices(hierarchy), _) => (Self::around(kind, &hierarchy.bounds(step.lead())), Hidden::Node),
            (Hierarchy::Clusters(hierarchy), _) => (Self::around(kind, &hierarchy.bounds(step.group())), Hidden::Node),
        }
    }

    fn around(kind: BoundsKind, NodeBounds { center, extent, .. }: &NodeBounds) -> Self {
        match kind {
            BoundsKind::Sphere => Self { middle: *center, axes: Vec3::AXES, half: Vec3::splat(extent.radius) },
            BoundsKind::Box | BoundsKind::Link => Self { middle: *center, axes: Vec3::AXES, half: extent.half_box },
            BoundsKind::Cylinder => {
                let axis = extent.axis.direction();
                let (below, above) = (extent.cylinder_below, extent.cylinder_above);
                let half = Vec2::splat(extent.cylinder_radius).extend((below + above) / 2.0);
                Self { middle: *center + axis * ((above - below) / 2.0), axes: along(axis), half }
            }
        }
    }

    fn around_link(hierarchy: &VertexHierarchy, step: StepId) -> Self {
        let lead = step.lead();
        let axes = along(hierarchy.bounds(lead).extent.axis.direction());
        let origin = hierarchy.position(lead);
        let (mut low, mut high) = (Vec3::ZERO, Vec3::ZERO);
        for vertex in link_vertices(hierarchy, lead) {
            let way = hierarchy.position(vertex) - origin;
            let at = Vec3::from(axes.map(|axis| axis.dot(way)));
            (low, high) = (low.min(at), high.max(at));
        }
        let [x, y, z] = axes;
        let middle = (low + high) / 2.0;
        Self { middle: origin + x * middle.x + y * middle.y + z * middle.z, axes, half: (high - low) / 2.0 }
    }
}

/// Two axes across a third.
fn along(axis: Vec3) -> [Vec3; 3] {
    let (side, other) = axis.any_orthonormal_pair();
    [side, other, axis]
}

/// A convex mesh, counterclockwise from outside, that holds a cube from −1 to 1 on all axes, the cylinder within it about the last, or the
/// sphere within it. The same if the first axis is turned around.
#[derive(Clone, Debug, Default)]
pub struct SolidMesh {
    /// Corners.
    pub positions: Vec<[f32; 3]>,
    /// Three a triangle.
    pub indices: Vec<u16>,
}

/// Around a circle; the paper's cylinders and ours.
const SIDES: u16 = 16;
/// Corners are so much further out, lest rounding takes them in.
const OUTWARDS: f32 = 1.0 + 1e-6;

impl SolidMesh {
    /// A box of 12 triangles, a prism of 16 sides around the cylinder (60), and around the sphere what an octagon sweeps in 16 steps (124).
    pub fn of(kind: BoundsKind) -> Self {
        let edge = [[1.0, -1.0], [1.0, 1.0]];
        match kind {
            BoundsKind::Sphere => Self::swept(SIDES, &[[OCTAGON, -1.0], [1.0, -OCTAGON], [1.0, OCTAGON], [OCTAGON, 1.0]]),
            BoundsKind::Cylinder => Self::swept(SIDES, &edge),
            BoundsKind::Box | BoundsKind::Link => Self::swept(4, &edge),
        }
    }

    /// What lies within an outline, turned about the last axis: around each of its corners, distance and height, ascending, a polygon of an
    /// even number of sides.
    fn swept(sides: u16, outline: &[[f32; 2]]) -> Self {
        let step = std::f32::consts::TAU / f32::from(sides);
        let mut mesh = Self::default();
        for [distance, height] in outline {
            let corner = distance / (step / 2.0).cos() * OUTWARDS;
            mesh.positions.extend((0..sides).map(|side| {
                let (sin, cos) = ((f32::from(side) + 0.5) * step).sin_cos();
                [corner * cos, corner * sin, height * OUTWARDS]
            }));
        }
        let last = (outline.len() as u16 - 1) * sides;
        for ring in (0..last).step_by(usize::from(sides)) {
            for side in 0..sides {
                let [a, b] = [side, (side + 1) % sides].map(|side| ring + side);
                mesh.indices.extend([a, b, b + sides, a, b + sides, a + sides]);
            }
        }
        for side in 1..sides - 1 {
            mesh.indices.extend([0, side + 1, side, last, last + side, last + side + 1]);
        }
        mesh
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn meshes_have_their_triangles() {
        let triangles = [BoundsKind::Box, BoundsKind::Link, BoundsKind::Cylinder, BoundsKind::Sphere]
            .map(|kind| SolidMesh::of(kind).indices.len() / 3);
        assert_eq!(triangles, [12, 12, 60, 124]);
    }

    proptest! {
        /// A point of the solid is behind all faces, one well outside before some.
        #[test]
        fn meshes_enclose(direction in [-1.0..1.0f32, -1.0..1.0f32, -1.0..1.0f32]) {
            let direction = Vec3::from(direction);
            prop_assume!(direction.length() > 0.1);
            for (kind, reach) in [
                (BoundsKind::Box, direction.abs().max_element()),
                (BoundsKind::Cylinder, direction.truncate().length().max(direction.z.abs())),
                (BoundsKind::Sphere, direction.length()),
            ] {
                let SolidMesh { positions, indices } = SolidMesh::of(kind);
                let at = direction / reach;
                let before = |point: Vec3| {
                    let faces = indices.chunks_exact(3).map(|t| [0, 1, 2].map(|k| Vec3::from(positions[usize::from(t[k])])));
                    faces.filter(|[a, b, c]| (*b - *a).cross(*c - *a).dot(point - *a) > 1e-7).count()
                };
                prop_assert_eq!(before(at), 0, "{:?}: {} is of it", kind, at);
                prop_assert!(before(at * 1.12) > 0, "{kind:?}: {at} is its edge");
            }
        }
    }
}
