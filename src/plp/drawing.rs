//! Estimates on the GPU: how long they take to draw, and their completion.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use image::RgbaImage;
use mullion_client::frame::{Completer, FrameInput, FramePlan, PassPlan, Planner, ViewInput};
use mullion_client::gpu::{Attachments, Gpu, Renderer, ViewTarget};
use mullion_client::missing::WhenMissing;
use mullion_client::plp::{Estimate, Frame, Traversal};
use mullion_common::scene::Package;
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Projection, ViewId};

use crate::drawn::{self, Hints};

const VIEW: ViewId = ViewId(0);

/// What it takes to draw, and what came of it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    pub time: Duration,
    pub triangles: u64,
    /// Questions and answers before it.
    pub rounds: u32,
}

/// Draws one view of a scene.
pub struct Drawing<'a> {
    package: &'a Package,
    renderer: Renderer,
    planner: Planner,
    completer: Completer,
}

impl<'a> Drawing<'a> {
    /// Uploads the scene.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn new(gpu: &Arc<Gpu>, package: &'a Package, size_px: [u32; 2]) -> Result<Self> {
        let targets = [ViewTarget { view: VIEW, size_px }];
        let renderer = drawn::upload_with_indices(gpu, package, &targets, Attachments::Color)?;
        Ok(Self { package, renderer, planner: Planner::new(), completer: Completer::default() })
    }

    /// Draws leaves, whole or as far as an estimate has them.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn draw(&mut self, projection: &Projection, visible: &VisibleSet, estimate: Option<Estimate<'_>>) -> Result<Cost> {
        let view = (VIEW, *projection, visible);
        let hints = Hints { estimate, ..Hints::default() };
        let start = Instant::now();
        let drawn = drawn::draw_with(&mut self.renderer, &mut self.planner, self.package, view, hints)?;
        self.renderer.wait()?;
        Ok(Cost { time: start.elapsed(), triangles: drawn.triangles, rounds: 0 })
    }

    /// Draws all triangles of leaves, which are none of them blended, each by its number: to be compared with drawing leaves whole.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn draw_by_numbers(&mut self, projection: &Projection, visible: &VisibleSet) -> Result<Cost> {
        let leaves = &self.package.scene.manifest.leaves;
        let all = |leaf: u32| (leaf, (0..leaves[leaf as usize].triangle_count as u16).collect());
        let parts: Vec<(u32, Vec<u16>)> = visible.leaves().map(all).collect();
        self.draw_parts(projection, &parts)
    }

    /// Draws triangles by leaf, ascending.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn draw_parts(&mut self, projection: &Projection, of_leaves: &[(u32, Vec<u16>)]) -> Result<Cost> {
        let mut pass = PassPlan::new(VIEW, *projection);
        let start = Instant::now();
        for (leaf, numbers) in of_leaves {
            pass.opaque.push(LeafRange::new(*leaf, leaf + 1));
            pass.parts.push(*leaf, numbers.iter().copied());
        }
        let results = self.renderer.draw(&FramePlan { passes: vec![pass] })?;
        self.renderer.wait()?;
        Ok(Cost { time: start.elapsed(), triangles: results.passes[0].triangles, rounds: 0 })
    }

    /// Completes an estimate, and draws the exact picture.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn complete(
        &mut self,
        projection: &Projection,
        visible: &VisibleSet,
        frame: &Frame<'_>,
        traversal: &Traversal,
    ) -> Result<Cost> {
        let start = Instant::now();
        let missing = VisibleSet::default();
        let view = ViewInput::new(VIEW, *projection, visible, &missing);
        let input = FrameInput {
            views: &[],
            shared_eye: projection.eye,
            manifest: &self.package.scene.manifest,
            transforms: &self.package.scene.manifest.transforms,
            resident: &|_| true,
            when_missing: WhenMissing::Hold,
            has_changed: false,
        };
        let mut rounds = 0;
        let mut round = Some(self.completer.begin(&input, &view, frame, traversal));
        while let Some(plan) = round {
            rounds += 1;
            let results = self.renderer.draw(plan)?;
            round = self.completer.feed(&view, frame, &results);
        }
        let view = (VIEW, *projection, visible);
        let hints = Hints { estimate: Some(self.completer.estimate(frame.tessellation)), ..Hints::default() };
        let drawn = drawn::draw_with(&mut self.renderer, &mut self.planner, self.package, view, hints)?;
        self.renderer.wait()?;
        Ok(Cost { time: start.elapsed(), triangles: drawn.triangles, rounds })
    }

    /// Draws with a planner that culls what is hidden, and occluders.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn cull(
        &mut self,
        planner: &mut Planner,
        projection: &Projection,
        visible: &VisibleSet,
        occluders: Option<&VisibleSet>,
    ) -> Result<Cost> {
        let (view, hints) = ((VIEW, *projection, visible), Hints { occluders, ..Hints::default() });
        let start = Instant::now();
        let drawn = drawn::draw_with(&mut self.renderer, planner, self.package, view, hints)?;
        self.renderer.wait()?;
        Ok(Cost { time: start.elapsed(), triangles: drawn.triangles, rounds: 0 })
    }

    /// Whether estimates can be completed here.
    pub fn can_complete(&self) -> bool {
        self.renderer.can_cull()
    }

    /// What was drawn last.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn picture(&self) -> Result<RgbaImage> {
        Ok(self.renderer.read_color(VIEW)?)
    }
}
