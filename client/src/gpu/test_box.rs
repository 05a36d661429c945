//! Boxes to be tested: grown by [`GROWN_PX`], so that what they hold covers no pixel that they do not.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Mat4, Vec3};
use mullion_common::geometry::{Aabb, axis_lengths};
use mullion_common::wall::Projection;

/// By how much of a pixel a box is grown on every side: more than the 1/256 to which rasterisers round.
const GROWN_PX: f64 = 1.0 / 8.0;

/// A box as the shaders take it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct TestBox {
    min: [f32; 3],
    record: u32,
    max: [f32; 3],
    draw: u32,
    is_mirrored: u32,
    waits: u32,
    leaf: u32,
    unused: u32,
}
const _: () = assert!(size_of::<TestBox>() == 48);

/// What waits for a box: the shaders' words.
const DRAW_WAITS: u32 = 1;
const ASKED: u32 = 2;

/// Grows boxes for one view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grower {
    /// World units by which a box at distance 1 along the view must grow.
    grown_m: f64,
}

/// How an object turns world distances into its own, axis by axis, and how far its own axes reach in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalScale {
    local_from_world: DVec3,
    world_from_local: DVec3,
}

impl LocalScale {
    /// Of what has world axes.
    pub const WORLD: Self = Self { local_from_world: DVec3::ONE, world_from_local: DVec3::ONE };

    pub fn of(world_from_local: &glam::DAffine3) -> Self {
        let (matrix, inverse) = (world_from_local.matrix3, world_from_local.matrix3.inverse());
        Self {
            local_from_world: DVec3::from_array([0, 1, 2].map(|row| inverse.row(row).length())),
            world_from_local: axis_lengths(&matrix),
        }
    }
}

impl Grower {
    pub fn new(projection: &Projection, size_px: [u32; 2]) -> Self {
        let row = |row: usize| projection.clip_from_offset.row(row).truncate();
        let (along, half_px) = (row(3), size_px.map(|edge| f64::from(edge) / 2.0));
        // What moves a point across the screen is the part of the row that is across the view.
        let across = |axis: DVec3| (axis - along * (axis.dot(along) / along.length_squared())).length();
        let px_per_m = (across(row(0)) * half_px[0]).min(across(row(1)) * half_px[1]);
        Self { grown_m: GROWN_PX / px_per_m }
    }

    /// By how much a box must grow on each side, in its object's space.
    pub fn growth(&self, bounds: &Aabb, clip_from_local: &Mat4, scale: &LocalScale) -> DVec3 {
        let w = clip_from_local.row(3).as_dvec4();
        self.growth_at(w.truncate().dot(bounds.center()) + w.w + w.truncate().abs().dot(bounds.size() / 2.0), bounds, scale)
    }

    /// The same for a box that is so far away at most.
    fn growth_at(&self, furthest: f64, bounds: &Aabb, scale: &LocalScale) -> DVec3 {
        scale.local_from_world * (self.grown_m * furthest + bounds.rounding_m(scale.world_from_local))
    }

    /// A leaf's box, grown; none where it reaches the near plane or cannot be placed: then it is seen.
    pub fn test(&self, bounds: &Aabb, clip_from_local: &Mat4, scale: &LocalScale) -> Option<(Vec3, Vec3)> {
        let (z, w) = (clip_from_local.row(2).as_dvec4(), clip_from_local.row(3).as_dvec4());
        let (center, half) = (bounds.center(), bounds.size() / 2.0);
        let reach = |row: glam::DVec4| row.truncate().abs().dot(half);
        let w_center = w.truncate().dot(center) + w.w;
        let grown = self.growth_at(w_center + reach(w), bounds, scale);
        let (min, max) = ((bounds.min - grown).as_vec3(), (bounds.max + grown).as_vec3());
        let reach_grown = reach(w) + w.truncate().abs().dot(grown);
        let z_max = z.truncate().dot(center) + z.w + reach(z) + z.truncate().abs().dot(grown);
        (is_clear(w_center - reach_grown, z_max) && min.is_finite() && max.is_finite()).then_some((min, max))
    }
}

/// Whether what has such w at least and such z at most stays clear of the near plane. Behind that z > w; a little earlier, lest rounding takes a
/// corner there.
pub(super) fn is_clear(least_w: f64, most_z: f64) -> bool {
    least_w * 0.999 > most_z
}

impl TestBox {
    /// A box of an object, by its place among the records. `draw`: what comes of it is said of that.
    pub fn new((min, max): (Vec3, Vec3), record: u32, draw: u32, is_mirrored: bool) -> Self {
        let is_mirrored = u32::from(is_mirrored);
        Self { min: min.to_array(), record, max: max.to_array(), draw, is_mirrored, ..Self::zeroed() }
    }

    /// In the place of one that is not tested.
    pub fn none(draw: u32) -> Self {
        Self { draw, ..Self::zeroed() }
    }

    /// For its own sake.
    pub fn asked(self) -> Self {
        Self { waits: ASKED, ..self }
    }

    /// Of a leaf, whose draw waits for what comes of it if it is late.
    pub fn of_leaf(self, leaf: u32, is_late: bool) -> Self {
        Self { leaf, waits: if is_late { DRAW_WAITS } else { 0 }, ..self }
    }
}
