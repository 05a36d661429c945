//! Level of detail that knows what is hidden (Birkholz, Rahn: *Adaptive Level of Detail with Occlusion Culling*), without a GPU: which vertices
//! of each object's hierarchy are split, within a budget of triangles.
//!
//! ```text
//! base meshes ─→ queue by error in pixels ─ first ─→ in sight? ─→ question ─→ answer: visible ─→ split ─→ triangles
//!                  ↑        outside, away: not further ┘ parent seen: none ┘   │ occluded        │
//!                  └── after the occluder was drawn anew ─────────────────────┘   next nodes ←───┘
//! ```
//! Questions are bounds to hold against depths; whoever draws answers them in their order, whenever it knows. Nothing is told to be hidden
//! that was not asked, and whatever the answers: a closed mesh is drawn closed, and never a triangle above the budget.

mod coherence;
mod cut;
mod heap;
mod refinement;
mod sight;

pub use cut::Cut;
pub use refinement::{LodOptions, Occlusion, Progress, Question, Refinement, Start, StepLimit, Visibility};
pub use sight::{LodSight, NodeSight};

use glam::DAffine3;
use mullion_common::scene::VertexHierarchy;

/// An object that is drawn by its hierarchy.
#[derive(Clone, Copy, Debug)]
pub struct LodObject<'a> {
    /// As far as it has arrived.
    pub hierarchy: &'a VertexHierarchy,
    /// Where it is.
    pub world_from_local: DAffine3,
    /// Whether triangles are seen from behind, too: then none faces away.
    pub is_double_sided: bool,
}
