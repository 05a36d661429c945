//! A node's estimates: from a frame's budget to what each of its views draws.
//!
//! ```text
//! the wall's budget ─→ one traversal from the shared eye ─┬─→ every view's estimate
//! a tile's own budget ─→ a traversal of its view ─────────┘        │ where the camera rests
//!                                                          completed, view by view
//! ```
//! All nodes follow the same order to the same cut, so what crosses a seam is drawn on both sides or on neither. A tile's own budget promises
//! no such thing.

use std::sync::Arc;

use glam::DVec3;
use mullion_common::geometry::Frustum;
use mullion_common::scene::{SceneManifest, Tessellation, Transform};
use mullion_common::throughput::Throughput;
use mullion_common::wall::pixels_per_radian;
use mullion_common::wire::{Budget, ViewSpec};

use crate::frame::{Completer, FrameInput, ViewInput};
use crate::gpu::{GpuError, Renderer};
use crate::plp::{Estimate, Frame, Sight, Solidity, Traversal};
use crate::tile_session::{FrameToDraw, ViewToDraw};

/// What a painter keeps for them.
pub(crate) struct Estimating {
    tessellation: Arc<Tessellation>,
    /// By place in the tessellation: whose objects have moved.
    left_out: Vec<bool>,
    wall: Traversal,
    /// Whether the wall's budget left something out in this frame.
    pub is_cut: bool,
    /// By place of the view.
    views: Vec<OfView>,
}

#[derive(Default)]
struct OfView {
    own: Traversal,
    completer: Completer,
    found: Found,
    /// Of how many microseconds, and what that allows.
    throughput: Option<(u32, Throughput)>,
    /// Whether its time left something out in this frame.
    is_cut: bool,
}

/// Where a view's estimate comes from in this frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Found {
    /// All that it sees is drawn.
    #[default]
    Nowhere,
    Wall,
    Own,
    Completer,
}

/// A view as its own eye sees it.
struct Look {
    frustum: Frustum,
    pixels_per_radian: f32,
}

impl Look {
    fn of(spec: &ViewSpec, view: &ViewToDraw, frame: &FrameToDraw) -> Self {
        let corners = spec.corners.map(DVec3::from);
        Self {
            frustum: Frustum::through_rectangle(view.eye, corners, spec.near_m).transformed(&frame.world_from_room),
            pixels_per_radian: (pixels_per_radian(view.eye, corners, spec.size_px) as f32).max(f32::MIN_POSITIVE),
        }
    }

    fn sight(&self) -> Sight<'_> {
        Sight { eye: self.frustum.eye, planes: &self.frustum.planes, pixels_per_radian: self.pixels_per_radian }
    }
}

impl OfView {
    /// How many triangles a tile's own budget allows; `None`: it has none.
    fn own_budget(&mut self, budget: &Budget, scene_triangles: u32) -> Option<u32> {
        match (budget.gpu_us, &self.throughput) {
            (Some(time_us), Some((known, _))) if time_us == *known => {}
            (time_us, _) => self.throughput = time_us.map(|us| (us, Throughput::new(us, scene_triangles))),
        }
        let in_time = self.throughput.as_ref().map(|(_, throughput)| throughput.triangles());
        budget.triangles.into_iter().chain(in_time).min()
    }
}

impl Estimating {
    pub fn new(tessellation: Arc<Tessellation>, views: usize) -> Self {
        Self {
            tessellation,
            left_out: Vec::new(),
            wall: Traversal::new(),
            is_cut: false,
            views: (0..views).map(|_| OfView::default()).collect(),
        }
    }

    /// What they are found in.
    pub fn tessellation(&self) -> &Tessellation {
        &self.tessellation
    }

    /// Objects stand elsewhere: those that moved are not the tessellation's business until they are back.
    pub fn leave_out_moved(&mut self, manifest: &SceneManifest, transforms: &[Transform]) {
        let has_moved = |leaf: &u32| {
            let object = manifest.leaves[*leaf as usize].object.0 as usize;
            manifest.transforms[object] != transforms[object]
        };
        self.left_out.clear();
        self.left_out.extend(self.tessellation.leaves().iter().map(has_moved));
    }

    /// Finds the estimates of a frame.
    pub fn find(&mut self, manifest: &SceneManifest, specs: &[ViewSpec], frame: &FrameToDraw) {
        let Self { tessellation, left_out, wall, is_cut, views } = self;
        *is_cut = false;
        let order = frame.estimate.zip(frame.primary.as_ref());
        let of_wall = order.filter(|_| frame.views.iter().any(|view| view.budget == Budget::default()));
        if let Some((order, primary)) = of_wall {
            let sight = Sight { eye: frame.shared_eye, planes: &primary.planes, pixels_per_radian: primary.pixels_per_radian };
            let of_wall = Frame { tessellation, scene: manifest, sight };
            wall.leave_out(left_out);
            wall.begin(&of_wall, Solidity::default());
            *is_cut = !wall.project(&of_wall, order.triangles).is_complete;
        }
        for ((kept, view), spec) in views.iter_mut().zip(&frame.views).zip(specs) {
            kept.found = match kept.own_budget(&view.budget, tessellation.slot_count()) {
                Some(budget) => {
                    let look = Look::of(spec, view, frame);
                    let of_view = Frame { tessellation, scene: manifest, sight: look.sight() };
                    kept.own.leave_out(left_out);
                    kept.own.begin(&of_view, Solidity::default());
                    let is_complete = kept.own.project(&of_view, budget).is_complete;
                    kept.is_cut = !is_complete && kept.throughput.as_ref().is_some_and(|(_, t)| t.triangles() == budget);
                    Found::Own
                }
                None if of_wall.is_some() => Found::Wall,
                None => Found::Nowhere,
            };
        }
    }

    /// Completes the estimates that were found, of views that have one.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn complete(
        &mut self,
        renderer: &mut Renderer,
        manifest: &SceneManifest,
        (specs, inputs): (&[ViewSpec], &[ViewInput<'_>]),
        frame: &FrameToDraw,
    ) -> Result<(), GpuError> {
        let Self { tessellation, wall, views, .. } = self;
        for (at, kept) in views.iter_mut().enumerate() {
            let (Some(view), Some(spec), Some(of_view)) = (frame.views.get(at), specs.get(at), inputs.get(at)) else { continue };
            let traversal = match kept.found {
                Found::Wall => &*wall,
                Found::Own => &kept.own,
                Found::Nowhere | Found::Completer => continue,
            };
            kept.found = Found::Nowhere;
            if !renderer.can_cull() {
                // Nobody tells what is hidden: all is drawn.
                continue;
            }
            let look = Look::of(spec, view, frame);
            let of = Frame { tessellation, scene: manifest, sight: look.sight() };
            let resident = |chunk| renderer.is_resident(chunk);
            let first = FrameInput {
                views: &[],
                shared_eye: frame.shared_eye,
                manifest,
                transforms: renderer.transforms(),
                resident: &resident,
                when_missing: frame.when_missing,
                has_changed: false,
            };
            let mut round = Some(kept.completer.begin(&first, of_view, &of, traversal));
            while let Some(plan) = round {
                let results = renderer.draw(plan)?;
                round = kept.completer.feed(of_view, &of, &results);
            }
            kept.found = Found::Completer;
        }
        Ok(())
    }

    /// What drawing took, and how many triangles there were of each view: their shares of the time.
    pub fn note(&mut self, draw_us: u32, triangles: impl Iterator<Item = u64> + Clone) {
        let all: u64 = triangles.clone().sum();
        for (view, own) in self.views.iter_mut().zip(triangles) {
            if let (Found::Own, Some((_, throughput))) = (view.found, &mut view.throughput) {
                let own_us = u64::from(draw_us) * own / all.max(1);
                throughput.take(throughput.triangles(), own_us as u32, view.is_cut); // at most draw_us
                throughput.follow();
            }
        }
    }

    /// What the view at a place draws; `None`: all that it sees.
    pub fn of_view(&self, place: usize) -> Option<Estimate<'_>> {
        let view = self.views.get(place)?;
        match view.found {
            Found::Nowhere => None,
            Found::Wall => Some(self.wall.estimate(&self.tessellation)),
            Found::Own => Some(view.own.estimate(&self.tessellation)),
            Found::Completer => Some(view.completer.estimate(&self.tessellation)),
        }
    }
}
