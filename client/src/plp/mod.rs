//! Prioritized-Layered Projection (Klosowski, Silva: *Rendering on a Budget*, 1999): an estimate of what is visible, within a budget of
//! triangles, without a GPU. An estimate is *not* conservative and never called a visible set.
//!
//! ```text
//! eye, primary frustum ─→ seeds ─→ front F ─ min(F) ─→ project ─→ triangles by leaf
//!                                    ↑                    │
//!                                    └─ update_solidity ──┘ neighbours
//! ```
//! All tiles of a wall see from one eye: one traversal over the wall's primary frustum gives one order and one cut for all of them.

mod completion;
mod drawn;
mod estimate;
mod front;
mod leaves;
mod likelihood;
mod paper;
mod sight;
mod traversal;

pub use completion::Completion;
pub use drawn::Drawn;
pub use estimate::{Estimate, Share, Shares};
pub use traversal::{Projected, Traversal};

use glam::DVec3;
use mullion_common::geometry::Plane;
use mullion_common::scene::{SceneManifest, Tessellation};

/// How likely a cell is taken to be hidden.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solidity {
    /// The paper's, section 3.2: the number of triangles on the least solid way from the eye.
    Paper,
    /// What light would come through the fronts of triangles on the way, how far each triangle lies open towards the eye, and how large it
    /// would appear.
    #[default]
    Likelihood,
}

impl Solidity {
    /// Every one, in the order in which users are told of them.
    pub const ALL: [Self; 2] = [Self::Paper, Self::Likelihood];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Likelihood => "likelihood",
        }
    }
}

/// From where, and into which part of space, an estimate looks.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// The eye, metres of the world.
    pub eye: DVec3,
    /// Planes with all that is seen on their positive side: the primary frustum's, of which the eye must not be outside by more than a near
    /// plane. None: all around.
    pub planes: &'a [Plane],
    /// Pixels that a length as far away as it is long covers: a tile's resolution, the finest of a wall's. Above 0.
    pub pixels_per_radian: f32,
}

/// What an estimate is of.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The cells.
    pub tessellation: &'a Tessellation,
    /// The scene that they are of.
    pub scene: &'a SceneManifest,
    /// From where.
    pub sight: Sight<'a>,
}

/// Which of a leaf's triangles may be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    /// None: it is not the tessellation's business any more.
    None,
    /// Those whose front is towards the eye.
    Fronts,
    /// All.
    All,
}

#[cfg(test)]
mod tests;
