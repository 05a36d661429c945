//! Boxes, planes and frusta, in `f64` metres. Right-handed, Y up.
//!
//! Every test that culls is *conservative*: where rounding leaves a doubt, the answer is "not outside".

mod aabb;
mod frustum;
mod obb;
mod plane;

pub use aabb::{Aabb, axis_lengths};
pub use frustum::{Frustum, FrustumSide};
pub use obb::Obb;
pub use plane::{ABSOLUTE_ROUNDING, BoxTerms, Clearance, Plane};

/// Where a volume lies in relation to another one, or to a plane's positive half-space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Containment {
    /// No point of it is inside.
    Outside,
    /// It may have points on both sides.
    Cut,
    /// Every point of it is inside.
    Inside,
}

/// Share of a distance that counts as rounding: a volume that is outside by less than this share of the
/// lengths that took part in the test counts as cut.
///
/// The GPU transforms positions in `f32`; four products and three sums cost at most about 2⁻²² of the sum of
/// magnitudes, so 2⁻²⁰ keeps every leaf of which a driver may rasterise a pixel.
pub const RELATIVE_SLACK: f64 = 1.0 / (1 << 20) as f64;
