//! Cells and leaves as an eye sees them.

use glam::{DVec3, Vec3, Vec4, Vec4Swizzles};
use mullion_common::geometry::Plane;
use mullion_common::scene::{CellId, FACES, Facing, FacingEye, SceneManifest, Tessellation};

use super::{Shown, Sight};

/// What rounding in `f32` may cost, as a share of a corner's distance: a cell that is outside by less is inside.
const SLACK: f32 = 1e-4;

/// Less of a cell on a plane's inner side counts as much.
const LEAST_SHARE: f32 = 1e-6;

/// A sight in the tessellation's space, in `f32`.
#[derive(Debug, Default)]
pub(super) struct CellSight {
    /// Metres from the tessellation's origin.
    pub eye: Vec3,
    /// Normals, and how far the eye is inside.
    planes: Vec<(Vec3, f32)>,
    pub pixels_per_radian: f32,
}

impl CellSight {
    pub fn set(&mut self, sight: &Sight<'_>, tessellation: &Tessellation) {
        self.eye = (sight.eye - tessellation.origin()).as_vec3();
        self.planes.clear();
        // Moved back to the eye where it is outside, as of a near plane: light comes from there, through cells.
        let from_eye = |plane: &Plane| (plane.normal.as_vec3(), plane.distance_m(sight.eye).max(0.0) as f32);
        self.planes.extend(sight.planes.iter().map(from_eye));
        self.pixels_per_radian = sight.pixels_per_radian;
    }

    /// What share of a cell's volume the frustum holds: as if its planes knew nothing of each other. 0 where it holds none, surely; else above
    /// 0, and 1 where it holds all.
    #[inline]
    pub fn share_in_sight(&self, tessellation: &Tessellation, cell: CellId) -> f32 {
        let Corners { x, y, z } = self.lanes_from_eye(tessellation, cell);
        let slack = SLACK * (x.abs() + y.abs() + z.abs());
        let mut share = 1.0;
        for (normal, eye_m) in &self.planes {
            let heights = x * normal.x + y * normal.y + z * normal.z + *eye_m + slack;
            if heights.max_element() < 0.0 {
                return 0.0;
            }
            if heights.min_element() < 0.0 {
                share *= share_above(heights.to_array()).max(LEAST_SHARE);
            }
        }
        share.max(f32::MIN_POSITIVE) // of many planes
    }

    /// The cell that the eye is in, by a walk from the first one: the same whatever was seen before. `None` outside the hull.
    pub fn eye_cell(&self, tessellation: &Tessellation) -> Option<CellId> {
        let mut cell = CellId(0);
        // A walk in a Delaunay mesh ends; where rounding leads it around, any cell on the way is as good.
        for _ in 0..tessellation.cells().len() {
            let from_eye = self.corners_from_eye(tessellation, cell);
            let Some(beyond) = (0..4).find(|k| is_before(&from_eye, *k)) else { return Some(cell) };
            cell = tessellation.cell(cell).neighbours[beyond].get()?;
        }
        Some(cell)
    }

    /// Whether the eye is before a face of a cell that is on the hull: light comes in there.
    pub fn is_entry(&self, tessellation: &Tessellation, cell: CellId) -> bool {
        let neighbours = tessellation.cell(cell).neighbours;
        if !neighbours.contains(&CellId::NONE) {
            return false;
        }
        let from_eye = self.corners_from_eye(tessellation, cell);
        (0..4).any(|k| neighbours[k] == CellId::NONE && is_before(&from_eye, k))
    }

    /// A cell's corners from the eye.
    #[inline]
    pub fn corners_from_eye(&self, tessellation: &Tessellation, cell: CellId) -> [Vec3; 4] {
        tessellation.corners(cell).map(|corner| corner - self.eye)
    }

    /// The same, a corner a lane.
    #[inline]
    fn lanes_from_eye(&self, tessellation: &Tessellation, cell: CellId) -> Corners {
        let Corners { x, y, z } = Corners::from(tessellation.corners(cell));
        Corners { x: x - self.eye.x, y: y - self.eye.y, z: z - self.eye.z }
    }

    /// About the solid angle of each of a cell's faces: above 0 where the way out of the cell leads away from the eye.
    #[inline]
    pub fn solid_angles(&self, tessellation: &Tessellation, cell: CellId) -> [f32; 4] {
        solid_angles(self.lanes_from_eye(tessellation, cell))
    }
}

/// A cell's corners, one a lane. Straight from where they are: a lane that is put together in memory waits for its parts.
#[derive(Clone, Copy, Debug)]
struct Corners {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

impl From<[Vec3; 4]> for Corners {
    #[inline]
    fn from([p, q, r, s]: [Vec3; 4]) -> Self {
        Self { x: Vec4::new(p.x, q.x, r.x, s.x), y: Vec4::new(p.y, q.y, r.y, s.y), z: Vec4::new(p.z, q.z, r.z, s.z) }
    }
}

/// What share of a tetrahedron lies above 0, by the heights of its corners, of which one at least is below and one is not.
fn share_above(mut heights: [f32; 4]) -> f32 {
    heights.sort_unstable_by(|a, b| b.total_cmp(a));
    let [a, b, c, d] = heights;
    // What share of the edge from the first to the second is on the first's side of 0.
    let cut = |from: f32, to: f32| from / (from - to);
    if a <= 0.0 {
        0.0
    } else if b <= 0.0 {
        cut(a, b) * cut(a, c) * cut(a, d)
    } else if c >= 0.0 {
        1.0 - cut(d, a) * cut(d, b) * cut(d, c)
    } else {
        // Three tetrahedra between the edge above and the four cuts.
        let (ac, ad, bc, bd) = (cut(a, c), cut(a, d), cut(b, c), cut(b, d));
        bc * bd + ac * ad * (1.0 - bd) + ac * (1.0 - bc) * bd
    }
}

/// The area and direction of a face, out of its cell, doubled; and a corner of it.
#[inline]
pub(super) fn face(corners: &[Vec3; 4], face: usize) -> (Vec3, [Vec3; 3]) {
    let [a, b, c] = FACES[face].map(|k| corners[k]);
    ((b - a).cross(c - a), [a, b, c])
}

/// Whether the eye, at the origin, is before a face, out of its cell.
#[inline]
pub(super) fn is_before(corners: &[Vec3; 4], k: usize) -> bool {
    let (normal, [a, ..]) = face(corners, k);
    normal.dot(a) < 0.0
}

/// The solid angles of faces for the eye, at the origin. A face a lane.
#[inline]
fn solid_angles(Corners { x, y, z }: Corners) -> [f32; 4] {
    const _: () = assert!(matches!(FACES, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]));
    let [ax, ay, az] = [x.yxxx(), y.yxxx(), z.yxxx()];
    let [bx, by, bz] = [x.zwyz(), y.zwyz(), z.zwyz()];
    let [cx, cy, cz] = [x.wzwy(), y.wzwy(), z.wzwy()];
    let [ux, uy, uz] = [bx - ax, by - ay, bz - az];
    let [vx, vy, vz] = [cx - ax, cy - ay, cz - az];
    let [nx, ny, nz] = [uy * vz - vy * uz, uz * vx - vz * ux, ux * vy - vx * uy];
    let [mx, my, mz] = [ax + bx + cx, ay + by + cy, az + bz + cz];
    let square = (mx * mx + my * my + mz * mz).max(Vec4::splat(f32::MIN_POSITIVE));
    ((nx * mx + ny * my + nz * mz) / (square * square.sqrt())).to_array()
}

/// How a leaf is seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct LeafSight {
    eye: FacingEye,
    pub shown: Shown,
}

impl LeafSight {
    /// Wherever it is: cells are held against the planes. Of a leaf at the frustum's edge all triangles would come and go at once.
    pub fn new(scene: &SceneManifest, leaf: u32, eye: DVec3) -> Self {
        let record = &scene.leaves[leaf as usize];
        let world_from_local = scene.transforms[record.object.0 as usize].affine();
        let eye_in_leaf = world_from_local.inverse().transform_point3(eye).as_vec3();
        let (middle, radius) = record.middle_and_radius();
        let is_double_sided = scene.materials[record.material.0 as usize].double_sided;
        // What has no inverse, or an eye too far for `f32`, tells nothing about fronts.
        let shown = if is_double_sided || !eye_in_leaf.is_finite() { Shown::All } else { Shown::Fronts };
        Self { eye: FacingEye::new(eye_in_leaf, middle, radius), shown }
    }

    /// A leaf that nobody has looked at.
    pub fn unseen() -> Self {
        Self { eye: FacingEye::new(Vec3::ZERO, Vec3::ZERO, 0.0), shown: Shown::None }
    }

    /// The sine of the angle, 0 to 1, at which a triangle of the leaf is looked at, from either side.
    #[inline]
    pub fn slope(&self, facing: Facing) -> f32 {
        facing.slope_towards(&self.eye)
    }

    /// Whether a triangle of the leaf is surely seen from behind.
    #[inline]
    pub fn is_away(&self, facing: Facing) -> bool {
        self.shown == Shown::Fronts && facing.is_away_from(&self.eye)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Goal: the share of a cut tetrahedron. Method: its points on a grid, counted; and what is above and below is all.
        #[test]
        fn shares_are_those_of_points(heights in proptest::array::uniform4(-3.0..2.0f32)) {
            prop_assume!(heights.iter().any(|h| *h < 0.0) && heights.iter().any(|h| *h >= 0.0));
            const STEPS: usize = 24;
            let (mut above, mut all) = (0usize, 0usize);
            for i in 0..STEPS {
                for j in 0..STEPS - i {
                    for k in 0..STEPS - i - j {
                        let shares = [i, j, k, STEPS - 1 - i - j - k].map(|share| (share as f32 + 0.25) / STEPS as f32);
                        let height: f32 = shares.iter().zip(heights).map(|(share, height)| share * height).sum();
                        (above, all) = (above + usize::from(height >= 0.0), all + 1);
                    }
                }
            }
            let (found, counted) = (share_above(heights), above as f32 / all as f32);
            prop_assert!((found - counted).abs() < 0.06, "{found}, of points {counted}");
            let below = share_above(heights.map(|height| -height));
            prop_assert!((found + below - 1.0).abs() < 1e-4, "{found} above and {below} below");
        }

        /// Goal: four lanes do what one face after another does, to the bit. Method: the plain formula.
        #[test]
        fn solid_angles_are_those_of_each_face(corners in proptest::array::uniform4([-9.0..9.0f32, -5.0..5.0, -2.0..2.0])) {
            let corners = corners.map(Vec3::from);
            for (k, found) in solid_angles(corners.into()).into_iter().enumerate() {
                let (normal, [a, b, c]) = face(&corners, k);
                let middle = a + b + c;
                let square = middle.length_squared().max(f32::MIN_POSITIVE);
                prop_assert_eq!(found, normal.dot(middle) / (square * square.sqrt()));
            }
        }
    }
}
