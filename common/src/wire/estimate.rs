//! To which budget a frame's estimate of what is visible is drawn, and where it looks: the same for all nodes.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{MAX_PRIMARY_PLANES, WireError, within};
use crate::geometry::Plane;

/// What a frame spends on an estimate of what is visible, and into which part of space that looks. The eye is the frame's
/// [`shared_eye`](super::Frame::shared_eye). It takes from visible sets, and is no part of them.
#[derive(Debug, Default, PartialEq)]
pub struct Estimate {
    /// Most triangles of the estimate: one cut for all tiles of the wall.
    pub triangles: u32,
    /// The camera rests: all that is seen is drawn, whatever the budget.
    pub is_complete: bool,
    /// Pixels that a length as far away as it is long covers on the wall's finest tile: above 0.
    pub pixels_per_radian: f32,
    /// The planes of the primary frustum in the world, with all that the wall sees on their positive side; at most
    /// [`MAX_PRIMARY_PLANES`]. None: the wall looks all around.
    pub planes: Vec<Plane>,
}

impl Clone for Estimate {
    fn clone(&self) -> Self {
        Self { planes: self.planes.clone(), ..*self }
    }

    /// Keeps the memory of planes: a frame takes none.
    fn clone_from(&mut self, source: &Self) {
        let Self { triangles, is_complete, pixels_per_radian, ref planes } = *source;
        (self.triangles, self.is_complete, self.pixels_per_radian) = (triangles, is_complete, pixels_per_radian);
        self.planes.clone_from(planes);
    }
}

/// The part of it that stands in a frame's head.
#[derive(Serialize, Deserialize)]
pub(super) struct EstimateHead {
    triangles: u32,
    is_complete: bool,
    pixels_per_radian: f32,
    planes: u32,
}

/// Normal and offset.
const PLANE_BYTES: usize = size_of::<[f64; 4]>();

impl Estimate {
    /// # Errors
    /// When there are too many planes.
    pub(super) fn head(&self) -> Result<EstimateHead, WireError> {
        let Self { triangles, is_complete, pixels_per_radian, ref planes } = *self;
        within("planes of the primary frustum", planes.len(), MAX_PRIMARY_PLANES)?;
        Ok(EstimateHead { triangles, is_complete, pixels_per_radian, planes: planes.len() as u32 })
    }

    pub(super) fn put_planes(&self, out: &mut Vec<u8>) {
        for Plane { normal, offset_m } in &self.planes {
            out.extend_from_slice(bytemuck::bytes_of(&[normal.x, normal.y, normal.z, *offset_m]));
        }
    }

    /// Reads the planes that stand behind a head.
    pub(super) fn take(head: &EstimateHead, bytes: &mut &[u8]) -> Result<Self, WireError> {
        let EstimateHead { triangles, is_complete, pixels_per_radian, planes } = *head;
        within("planes of the primary frustum", planes as usize, MAX_PRIMARY_PLANES)?;
        if !(pixels_per_radian.is_finite() && pixels_per_radian > 0.0) {
            return Err(WireError::NotFinite { what: "pixels per radian" });
        }
        let Some((own, rest)) = bytes.split_at_checked(planes as usize * PLANE_BYTES) else {
            return Err(WireError::Bulk { what: "planes of the primary frustum" });
        };
        *bytes = rest;
        let plane = |bytes: &[u8]| {
            let [x, y, z, offset_m]: [f64; 4] = bytemuck::pod_read_unaligned(bytes);
            Plane { normal: DVec3::new(x, y, z), offset_m }
        };
        let planes: Vec<Plane> = own.chunks_exact(PLANE_BYTES).map(plane).collect();
        if planes.iter().all(|plane| plane.normal.is_finite() && plane.offset_m.is_finite()) {
            Ok(Self { triangles, is_complete, pixels_per_radian, planes })
        } else {
            Err(WireError::NotFinite { what: "a plane of the primary frustum" })
        }
    }
}
