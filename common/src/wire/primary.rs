//! Where a wall looks, and what it orders from there: estimates of what is visible, and levels of detail. The same for all nodes.

use std::fmt;
use std::str::FromStr;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{MAX_PRIMARY_PLANES, WireError, within};
use crate::geometry::Plane;
use crate::scene::LodForm;

/// Into which part of space a wall looks, and how finely. The eye is the frame's [`shared_eye`](super::Frame::shared_eye).
#[derive(Debug, Default, PartialEq)]
pub struct Primary {
    /// Pixels that a length as far away as it is long covers on the wall's finest tile: above 0.
    pub pixels_per_radian: f32,
    /// The planes of the primary frustum in the world, with all that the wall sees on their positive side; at most
    /// [`MAX_PRIMARY_PLANES`]. None: the wall looks all around.
    pub planes: Vec<Plane>,
}

/// What a frame spends on an estimate of what is visible. It takes from visible sets, and is no part of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Estimate {
    /// Most triangles of the estimate: one cut for all tiles of the wall.
    pub triangles: u32,
    /// The camera rests: all that is seen is drawn, whatever the budget.
    pub is_complete: bool,
}

/// By what the pixels of an object's errors count beside those of others, where a budget is not enough for all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "u8", try_from = "u8")]
pub enum DetailWeight {
    /// All alike.
    #[default]
    None,
    /// By the share of the object's box that is seen: pixels in which nothing is nearer, of all that it covers.
    Nohc,
    /// By the share of the object's triangles that an estimate of what is visible holds, of those in sight. For scenes with a tessellation.
    Plp,
}

/// A weight's name that is none.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("no weight is called {0:?}: {names}", names = DetailWeight::ALL.map(DetailWeight::name).join(", "))]
pub struct UnknownWeight(String);

impl DetailWeight {
    /// Every one, by its byte.
    pub const ALL: [Self; 3] = [Self::None, Self::Nohc, Self::Plp];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Nohc => "nohc",
            Self::Plp => "plp",
        }
    }
}

impl fmt::Display for DetailWeight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for DetailWeight {
    type Err = UnknownWeight;

    fn from_str(name: &str) -> Result<Self, UnknownWeight> {
        Self::ALL.into_iter().find(|weight| weight.name() == name).ok_or_else(|| UnknownWeight(name.to_owned()))
    }
}

/// How finely a frame draws what has hierarchies of detail. Visible sets stay what they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Detail {
    /// Most triangles of all that is simplified, all tiles of the wall together.
    pub triangles: Option<u32>,
    /// A surface may be wrong by so many pixels: 0 or more, finite.
    pub least_pixels: f32,
    /// Whether what is hidden stays coarse, but for what is left of the triangles where a surface may be wrong by 0 pixels.
    pub hides: bool,
    /// Which objects come first. Where nothing hides, all count alike.
    pub weight: DetailWeight,
}

impl Detail {
    /// The form of hierarchies that is best for it, where a scene has both. In a budget of triangles, that of which fewer make as good a
    /// picture; without one, that which takes next to no time to be found, though a picture as good takes three to five times as many
    /// (`mullion bench lod --form`).
    pub fn form(&self) -> LodForm {
        if self.triangles.is_some() { LodForm::Vertices } else { LodForm::Clusters }
    }
}

impl Clone for Primary {
    fn clone(&self) -> Self {
        Self { planes: self.planes.clone(), ..*self }
    }

    /// Keeps the memory of planes: a frame takes none.
    fn clone_from(&mut self, source: &Self) {
        let Self { pixels_per_radian, ref planes } = *source;
        self.pixels_per_radian = pixels_per_radian;
        self.planes.clone_from(planes);
    }
}

/// The part of it that stands in a frame's head.
#[derive(Serialize, Deserialize)]
pub(super) struct PrimaryHead {
    pixels_per_radian: f32,
    planes: u32,
}

/// Normal and offset.
const PLANE_BYTES: usize = size_of::<[f64; 4]>();

impl Primary {
    /// # Errors
    /// When there are too many planes.
    pub(super) fn head(&self) -> Result<PrimaryHead, WireError> {
        within("planes of the primary frustum", self.planes.len(), MAX_PRIMARY_PLANES)?;
        Ok(PrimaryHead { pixels_per_radian: self.pixels_per_radian, planes: self.planes.len() as u32 })
    }

    pub(super) fn put_planes(&self, out: &mut Vec<u8>) {
        for Plane { normal, offset_m } in &self.planes {
            out.extend_from_slice(bytemuck::bytes_of(&[normal.x, normal.y, normal.z, *offset_m]));
        }
    }

    /// Reads the planes that stand behind a head.
    pub(super) fn take(head: &PrimaryHead, bytes: &mut &[u8]) -> Result<Self, WireError> {
        let PrimaryHead { pixels_per_radian, planes } = *head;
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
            Ok(Self { pixels_per_radian, planes })
        } else {
            Err(WireError::NotFinite { what: "a plane of the primary frustum" })
        }
    }
}

impl From<DetailWeight> for u8 {
    fn from(weight: DetailWeight) -> Self {
        weight as u8
    }
}

impl TryFrom<u8> for DetailWeight {
    type Error = &'static str;

    fn try_from(byte: u8) -> Result<Self, Self::Error> {
        Self::ALL.get(usize::from(byte)).copied().ok_or("weight of the detail: none of 0, 1 and 2")
    }
}

impl Detail {
    /// Whether its pixels are in their range.
    pub fn is_valid(&self) -> bool {
        self.least_pixels.is_finite() && self.least_pixels >= 0.0
    }
}
