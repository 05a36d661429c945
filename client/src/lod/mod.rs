//! Level of detail that knows what is hidden (Birkholz, Rahn: *Adaptive Level of Detail with Occlusion Culling*), without a GPU: which vertices
//! of each object's hierarchy are split, or which groups of its clusters refined, within a budget of triangles.
//!
//! ```text
//! base meshes ─→ queue by error in pixels ─ first ─→ behind the occluder? ─ no ─→ chosen, with what it needs ─→ cuts ─→ triangles
//!                  ↑        outside, away: not further    │ yes                      │
//!                  └── once the occluder is drawn anew ───┘      next nodes ←────────┘
//! ```
//! An occluder may answer late: what waits stands aside, and comes back into the queue with its answer. Walls ask depths on the CPU, which answer at once.
//! Whatever the occluder says: a closed mesh is drawn closed, and never a triangle above the budget.

mod cluster_cut;
mod course;
mod cut;
mod kept;
mod node;
mod occluder;
mod refinement;
mod sight;
mod solid;
mod sparse;
mod steps;
mod vertex_cut;
mod weigher;

pub use cluster_cut::ClusterCut;
pub use cut::Cut;
pub use kept::KeptOccluder;
pub use occluder::{BoundsKind, DepthOccluder, OCCLUDER_PX};
pub use refinement::{Hidden, LodOptions, Occluder, OccluderFrom, Refinement, Wait};
pub use sight::{LodSight, NodeSight};
pub use solid::{Solid, SolidMesh};
pub use steps::StepId;
pub use vertex_cut::VertexCut;
pub use weigher::{Tessellated, Weigher};

use glam::DAffine3;
use mullion_common::scene::{Hierarchy, ObjectId, Presence};

/// An object that is drawn by its hierarchy.
#[derive(Clone, Copy, Debug)]
pub struct LodObject<'a> {
    /// Which it is of the scene.
    pub id: ObjectId,
    /// As far as it has arrived.
    pub hierarchy: &'a Hierarchy,
    /// Where it is.
    pub world_from_local: DAffine3,
    /// Whether triangles are seen from behind, too: then none faces away.
    pub is_double_sided: bool,
    /// Whether what is behind it is hidden: it has no holes that its triangles do not tell of.
    pub is_solid: bool,
    /// Whether it is in the scene. What is away is not drawn, costs nothing and hides nothing.
    pub presence: Presence,
    /// How much its pixels count beside those of other objects, above 0 and at most 1: the share of it that is seen, as far as that is known.
    pub weight: f32,
}
