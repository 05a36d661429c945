//! A whole scene on the GPU, its views drawn round by round, and which leaves that took.

use std::sync::Arc;

use anyhow::{Context, Result};
use mullion_client::frame::{FrameInput, PassPlan, PassResult, Planner, ViewInput};
use mullion_client::gpu::{Attachments, Gpu, Renderer, ViewTarget};
use mullion_client::missing::WhenMissing;
use mullion_client::plp::Estimate;
use mullion_common::scene::{ChunkId, ObjectId, Package};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Projection, ViewId};

/// A renderer with all of a scene.
///
/// # Errors
/// When the GPU fails, or a chunk cannot be read.
pub fn upload(gpu: &Arc<Gpu>, package: &Package, targets: &[ViewTarget], attachments: Attachments) -> Result<Renderer> {
    let manifest = Arc::new(package.scene.manifest.clone());
    with_chunks(Renderer::new(Arc::clone(gpu), manifest, targets, attachments)?, package)
}

/// The same, that can draw parts of leaves.
///
/// # Errors
/// When the GPU fails, or a chunk cannot be read.
pub fn upload_with_indices(
    gpu: &Arc<Gpu>,
    package: &Package,
    targets: &[ViewTarget],
    attachments: Attachments,
) -> Result<Renderer> {
    let manifest = Arc::new(package.scene.manifest.clone());
    let mut renderer = Renderer::new(Arc::clone(gpu), manifest, targets, attachments)?;
    renderer.keep_indices();
    with_chunks(renderer, package)
}

fn with_chunks(mut renderer: Renderer, package: &Package) -> Result<Renderer> {
    renderer.keep_pieces();
    for chunk in (0..package.scene.manifest.chunks.len() as u32).map(ChunkId) {
        renderer.upload(chunk, package.chunk(chunk)).with_context(|| format!("chunk {}", chunk.0))?;
    }
    Ok(renderer)
}

/// What came of a frame.
#[derive(Debug, Default)]
pub struct Drawn {
    /// Leaves that were drawn.
    pub leaves: VisibleSet,
    /// Triangles, in all rounds.
    pub triangles: u64,
    /// Boxes that were tested or counted.
    pub tests: u32,
    /// How long the GPU was drawing, where it has a clock and something was tested or timed.
    pub draw_us: Option<f64>,
    /// And how long it was testing.
    pub test_us: f64,
}

/// Draws a frame of one view into a target, all its rounds.
///
/// # Errors
/// When the GPU fails.
pub fn draw(
    renderer: &mut Renderer,
    planner: &mut Planner,
    package: &Package,
    view: (ViewId, Projection, &VisibleSet),
) -> Result<Drawn> {
    draw_with(renderer, planner, package, view, Hints::default())
}

/// What is known of a view beside what it sees.
#[derive(Clone, Copy, Default)]
pub struct Hints<'a> {
    /// What limits its picture.
    pub estimate: Option<Estimate<'a>>,
    /// What is drawn first, with occlusion culling.
    pub occluders: Option<&'a VisibleSet>,
    /// Objects that are drawn by their cuts, ascending.
    pub cuts: &'a [ObjectId],
}

/// The same with hints.
///
/// # Errors
/// When the GPU fails.
pub fn draw_with(
    renderer: &mut Renderer,
    planner: &mut Planner,
    package: &Package,
    (target, projection, visible): (ViewId, Projection, &VisibleSet),
    Hints { estimate, occluders, cuts }: Hints<'_>,
) -> Result<Drawn> {
    let missing = VisibleSet::default();
    let views = [ViewInput { view: target, projection, visible, missing: &missing, estimate, occluders, cuts }];
    let mut drawn = Drawn::default();
    let mut round = Some(planner.begin(FrameInput {
        views: &views,
        shared_eye: projection.eye,
        manifest: &package.scene.manifest,
        transforms: renderer.transforms(),
        resident: &|_| true,
        when_missing: WhenMissing::Hold,
        has_changed: false,
    }));
    while let Some(plan) = round {
        let results = renderer.draw(plan)?;
        plan.passes.iter().zip(&results.passes).for_each(|(pass, result)| drawn.note(pass, result));
        round = planner.feed(&results);
    }
    drawn.leaves.normalize();
    Ok(drawn)
}

impl Drawn {
    /// What is first is drawn whatever is found of it. Without tests of boxes, all that was planned is.
    fn note(&mut self, pass: &PassPlan, result: &PassResult) {
        let mut add = |ranges: &[LeafRange]| ranges.iter().for_each(|range| self.leaves.push_unordered(*range));
        if let (Some(first), Some(_)) = (&pass.first, &result.seen) {
            add(first.ranges());
            add(result.late.ranges());
            self.tests += pass.opaque.len() + (pass.blended.len() + pass.bounds.len()) as u32;
        } else {
            add(pass.opaque.ranges());
            pass.blended.iter().for_each(|leaf| add(&[LeafRange::new(*leaf, leaf + 1)]));
            self.tests += (pass.bounds.len() + pass.footprints.len()) as u32;
        }
        self.triangles += result.triangles;
        if let Some(times) = result.times {
            *self.draw_us.get_or_insert_default() += times.draw_us;
            self.test_us += times.test_us;
        }
    }
}
