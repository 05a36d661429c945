//! The tessellation of a package for Prioritized-Layered Projection (Klosowski, Silva: *Rendering on a Budget*, 1999, section 3.1): an octree
//! over the vertices, a Delaunay tetrahedralisation of its leaves' middles, and for each cell the triangles that touch it.
//!
//! ```text
//! leaves ─ world ─→ octree ─→ points ─→ delaunay ─→ cells ─→ assign ─→ runs ─→ cover
//!            └───────────────────────────────────────────────→ exposure
//! ```
//! The box around the scene, a little larger, has its corners among the points: every triangle lies inside the hull.

mod assign;
mod cover;
mod delaunay;
mod exposure;
mod mesh;
mod octree;
mod rays;
mod statistics;
mod world;

use mullion_common::scene::{MAX_CELLS, Package, Tessellation, TessellationError, TessellationParts};
use thiserror::Error;

pub use statistics::TessellationStatistics;

use super::ProgressFn;
use crate::generate::Random;
use mesh::CellMesh;
use world::WorldLeaves;

/// Allowed for [`TessellateOptions::leaf_share`].
pub const LEAF_SHARES: std::ops::RangeInclusive<f64> = 0.002..=0.5;
/// The numbers that move the octree's middles a little come from this seed.
const SEED: u64 = 0x004d_756c_6c69_6f6e;
/// How often points are moved anew where they were degenerate all the same.
const ATTEMPTS: u64 = 4;

/// How space is tessellated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TessellateOptions {
    /// A node of the octree with a side below this share of the longest side of the scene's box is not divided: the finest have half of it.
    /// [`LEAF_SHARES`]; 0.05 by default, as in the paper. Smaller: more and smaller cells.
    pub leaf_share: f64,
}

impl Default for TessellateOptions {
    fn default() -> Self {
        Self { leaf_share: 0.05 }
    }
}

/// Why space was not tessellated.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum TessellateError {
    #[error("leaf share {found} is outside {} to {}", LEAF_SHARES.start(), LEAF_SHARES.end())]
    Share { found: f64 },
    #[error("Delaunay tetrahedralisation of {points} points: {problem}")]
    Delaunay { points: usize, problem: String },
    #[error("{found} {what}, at most {cap} are allowed")]
    TooMany { what: &'static str, found: u64, cap: u64 },
    #[error(transparent)]
    Tessellation(#[from] TessellationError),
}

/// Tessellates a package's space. The same package and options give the same tessellation.
///
/// Conservative: a triangle is listed by every cell that it touches or comes within rounding of. A scene without triangles has a
/// tessellation without cells.
///
/// # Errors
/// For an option out of range, for too many cells or triangles, and where no way of moving the points lets them be tetrahedralised.
pub fn tessellate(
    package: &Package,
    options: &TessellateOptions,
    progress: ProgressFn<'_>,
) -> Result<Tessellation, TessellateError> {
    if !LEAF_SHARES.contains(&options.leaf_share) {
        return Err(TessellateError::Share { found: options.leaf_share });
    }
    const STAGE: &str = "tessellating";
    const STEPS: u64 = 4;
    progress(STAGE, 0, STEPS);
    let manifest = &package.scene.manifest;
    let world = WorldLeaves::of(package);
    let slots: u64 = world.leaves.iter().map(|leaf| leaf.triangles.len() as u64).sum();
    if slots > u64::from(u32::MAX) {
        return Err(TessellateError::TooMany { what: "triangles", found: slots, cap: u32::MAX.into() });
    }
    if slots == 0 {
        return Ok(Tessellation::new(TessellationParts::default(), manifest)?);
    }
    let mesh = cell_mesh(&world, options.leaf_share)?;
    progress(STAGE, 1, STEPS);
    let assigned = assign::assign(&world, &mesh)?;
    progress(STAGE, 2, STEPS);
    let cells = cover::cells(&world, &mesh, &assigned);
    progress(STAGE, 3, STEPS);
    let exposures = exposure::exposures(&world, world.longest_m * options.leaf_share as f32);
    let parts = TessellationParts {
        origin: world.origin,
        vertices: mesh.vertices,
        cells,
        runs: assigned.runs,
        words: assigned.words,
        leaves: world.leaves.iter().map(|leaf| leaf.leaf).collect(),
        exposures,
        facings: world::facings(package, &world),
    };
    let tessellation = Tessellation::new(parts, manifest)?;
    progress(STAGE, STEPS, STEPS);
    Ok(tessellation)
}

fn cell_mesh(world: &WorldLeaves, leaf_share: f64) -> Result<CellMesh, TessellateError> {
    let middles = octree::leaf_middles(world, leaf_share)?;
    let mut problem = String::new();
    for attempt in 0..ATTEMPTS {
        let points = octree::moved(&middles, world, &mut Random::new(SEED + attempt));
        match delaunay::tetrahedra(&points) {
            Ok(mesh) if mesh.corners.len() > MAX_CELLS as usize => {
                let found = mesh.corners.len() as u64;
                return Err(TessellateError::TooMany { what: "cells", found, cap: MAX_CELLS.into() });
            }
            Ok(mesh) => return Ok(mesh),
            Err(error) => problem = error,
        }
    }
    Err(TessellateError::Delaunay { points: middles.len(), problem })
}
