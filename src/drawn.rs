//! A whole scene on the GPU, its views drawn round by round, and which leaves that took.

use std::sync::Arc;

use anyhow::{Context, Result};
use mullion_client::frame::{FrameInput, PassPlan, PassResult, Planner, ViewInput};
use mullion_client::gpu::{Attachments, Gpu, Renderer, ViewTarget};
use mullion_client::missing::WhenMissing;
use mullion_common::scene::{ChunkId, Package};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Projection, ViewId};

/// A renderer with all of a scene.
///
/// # Errors
/// When the GPU fails, or a chunk cannot be read.
pub fn upload(gpu: &Arc<Gpu>, package: &Package, targets: &[ViewTarget], attachments: Attachments) -> Result<Renderer> {
    let manifest = Arc::new(package.scene.manifest.clone());
    let mut renderer = Renderer::new(Arc::clone(gpu), manifest, targets, attachments)?;
    for chunk in (0..package.scene.manifest.chunks.len() as u32).map(ChunkId) {
        renderer.upload(chunk, package.chunk(chunk)).with_context(|| format!("chunk {}", chunk.0))?;
    }
    Ok(renderer)
}

/// Draws a frame of one view into a target, all its rounds. Gives the leaves that were drawn.
///
/// # Errors
/// When the GPU fails.
pub fn draw(
    renderer: &mut Renderer,
    planner: &mut Planner,
    package: &Package,
    (target, projection, visible): (ViewId, Projection, &VisibleSet),
) -> Result<VisibleSet> {
    let views = [ViewInput { view: target, projection, visible, missing: &VisibleSet::default() }];
    let mut drawn = VisibleSet::default();
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
        plan.passes.iter().zip(&results.passes).for_each(|(pass, result)| note_drawn(pass, result, &mut drawn));
        round = planner.feed(&results);
    }
    drawn.normalize();
    Ok(drawn)
}

/// What is first is drawn whatever is found of it. Without tests of boxes, all that was planned is.
fn note_drawn(pass: &PassPlan, result: &PassResult, drawn: &mut VisibleSet) {
    let mut add = |ranges: &[LeafRange]| ranges.iter().for_each(|range| drawn.push_unordered(*range));
    if let (Some(first), Some(seen)) = (&pass.first, &result.seen) {
        add(first.ranges());
        add(seen.ranges());
    } else {
        add(pass.opaque.ranges());
        pass.blended.iter().for_each(|leaf| add(&[LeafRange::new(*leaf, leaf + 1)]));
    }
}
