//! Paints a node's tiles with the GPU: the session's orders in, pictures out.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DVec3};
use image::RgbaImage;
use mullion_common::geometry::Aabb;
use mullion_common::scene::{ChunkId, ObjectId, SceneManifest, Tessellation};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::Projection;
use mullion_common::wire::{Moved, ObjectCount, ViewSpec};

use crate::detailing::Detailing;
use crate::estimating::Estimating;
use crate::frame::{FrameInput, Planner, ViewInput};
use crate::gpu::{Attachments, Gpu, GpuError, Renderer, ViewTarget};
use crate::lod::Tessellated;
use crate::node::{PaintError, Painter};
use crate::occlusion::Occlusion;
use crate::occlusion::unit::{Counts, Footprint};
use crate::output::headless::write_png;
use crate::output::layout;
use crate::output::window::WindowFeed;
use crate::tile_session::{CountOrder, DrawStats, FrameToDraw};

/// Where shown pictures go.
#[derive(Clone, Debug)]
pub enum Output {
    /// Nowhere: whoever owns the painter asks for them.
    Keep,
    /// A PNG file for each tile, named by it, written anew every so many frames shown (0: only when asked).
    #[allow(missing_docs)]
    Folder { folder: PathBuf, every: u64 },
    /// A window that others have laid out.
    Window(WindowFeed),
    /// A window of the node's own: its tiles as they stand on the wall, or in a row where they do not lie in one plane.
    OwnWindow(WindowFeed),
}

/// A painter that draws with wgpu.
pub struct GpuPainter {
    gpu: Arc<Gpu>,
    output: Output,
    scene: Option<OpenScene>,
    occlusion: Occlusion,
    /// It is not left off where it does not pay.
    always: bool,
    planner: Planner,
    shown: u64,
}

struct OpenScene {
    manifest: Arc<SceneManifest>,
    views: Vec<ViewSpec>,
    renderer: Renderer,
    /// Something stands elsewhere than in the frame before.
    has_changed: bool,
    /// What each view sees without what is dropped.
    drawn: Vec<VisibleSet>,
    counting: Counting,
    /// Where the scene has a tessellation.
    estimating: Option<Estimating>,
    detailing: Detailing,
    /// By place of the view: triangles drawn in this frame.
    triangles: Vec<u64>,
    /// The last frame, if all that is seen of it was drawn within its estimate, and what that took.
    complete: Option<(FrameToDraw, DrawStats)>,
}

/// How boxes are counted.
#[derive(Default)]
struct Counting {
    /// By object: the box around its own leaves, in its space. Found when the first is counted.
    bounds: Vec<Aabb>,
    footprints: Vec<Footprint>,
    /// The GPU does not count views as large as these.
    is_off: bool,
}

impl Counting {
    fn find_bounds(&mut self, manifest: &SceneManifest) {
        if self.bounds.len() != manifest.transforms.len() {
            self.bounds.clear();
            self.bounds.resize(manifest.transforms.len(), Aabb::EMPTY);
            for leaf in &manifest.leaves {
                let bounds = &mut self.bounds[leaf.object.0 as usize];
                *bounds = bounds.union(&leaf.local_aabb());
            }
        }
    }
}

/// How a view of a frame projects.
fn projection(spec: &ViewSpec, eye: DVec3, world_from_room: &DAffine3) -> Projection {
    Projection::through_rectangle(eye, spec.corners.map(DVec3::from), spec.near_m, world_from_room)
}

impl GpuPainter {
    /// A painter without a scene.
    pub fn new(gpu: Arc<Gpu>, output: Output) -> Self {
        Self { gpu, output, scene: None, occlusion: Occlusion::Off, always: false, planner: Planner::new(), shown: 0 }
    }

    /// The same with occlusion culling.
    #[must_use]
    pub fn culling(self, occlusion: Occlusion) -> Self {
        Self { occlusion, ..self }
    }

    /// The same, that does not leave it off where it does not pay.
    #[must_use]
    pub fn always(self) -> Self {
        Self { always: true, ..self }
    }

    /// What each tile shows, by name; none before the first frame was shown.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn pictures(&self) -> Result<Vec<(String, RgbaImage)>, GpuError> {
        let mut pictures = Vec::new();
        let Some(scene) = &self.scene else { return Ok(pictures) };
        for spec in &scene.views {
            if let Some(picture) = scene.renderer.read_shown(spec.view)? {
                pictures.push((spec.tile_name.clone(), picture));
            }
        }
        Ok(pictures)
    }

    /// Writes what each tile shows to its file; nothing where the output is no folder.
    ///
    /// # Errors
    /// When the GPU or the file system fails.
    pub fn write_pictures(&self) -> Result<(), PaintError> {
        let Output::Folder { folder, .. } = &self.output else { return Ok(()) };
        for (tile, picture) in self.pictures().map_err(failed)? {
            write_png(&folder.join(format!("{tile}.png")), &picture).map_err(failed)?;
        }
        Ok(())
    }

    fn scene(&mut self) -> Result<&mut OpenScene, PaintError> {
        self.scene.as_mut().ok_or_else(|| PaintError::Failed("an order before there is a scene".to_owned()))
    }
}

fn failed(error: impl std::fmt::Display) -> PaintError {
    PaintError::Failed(error.to_string())
}

impl Painter for GpuPainter {
    fn open_scene(&mut self, manifest: &Arc<SceneManifest>, views: &[ViewSpec]) -> Result<(), PaintError> {
        let targets: Vec<ViewTarget> = views.iter().map(|v| ViewTarget { view: v.view, size_px: v.size_px }).collect();
        let mut renderer =
            Renderer::new(Arc::clone(&self.gpu), Arc::clone(manifest), &targets, Attachments::Color).map_err(failed)?;
        // The one that was here knows another scene's leaves.
        let occlusion = if renderer.can_cull() { self.occlusion } else { Occlusion::Off };
        if occlusion == Occlusion::Hiz {
            renderer.keep_pieces();
        }
        let planner = Planner::new().culling(occlusion);
        self.planner = if self.always { planner } else { planner.while_worth() };
        if let Output::OwnWindow(feed) = &self.output {
            feed.lay_out(layout::lay_out(views)).map_err(|_| PaintError::Closed)?;
        }
        self.scene = Some(OpenScene {
            manifest: Arc::clone(manifest),
            views: views.to_vec(),
            renderer,
            has_changed: true,
            drawn: vec![VisibleSet::default(); views.len()],
            counting: Counting::default(),
            estimating: None,
            detailing: Detailing::default(),
            triangles: vec![0; views.len()],
            complete: None,
        });
        Ok(())
    }

    fn take_tessellation(&mut self, tessellation: &Arc<Tessellation>) -> Result<(), PaintError> {
        let scene = self.scene()?;
        scene.renderer.keep_indices();
        scene.estimating = Some(Estimating::new(Arc::clone(tessellation), scene.views.len()));
        Ok(())
    }

    fn take_hierarchy(&mut self, number: u32, objects: &[ObjectId], blob: &[u8]) -> Result<Option<u64>, PaintError> {
        let scene = self.scene()?;
        scene.complete = None;
        Ok(scene.detailing.take(&scene.manifest, (number, objects), blob))
    }

    fn forget_hierarchy(&mut self, number: u32) -> Result<(), PaintError> {
        let scene = self.scene()?;
        scene.complete = None;
        scene.detailing.forget(number);
        Ok(())
    }

    fn grow_scene(&mut self, manifest: &Arc<SceneManifest>) -> Result<(), PaintError> {
        let scene = self.scene()?;
        scene.renderer.grow(Arc::clone(manifest)).map_err(failed)?;
        scene.manifest = Arc::clone(manifest);
        scene.complete = None;
        Ok(())
    }

    fn upload(&mut self, chunk: ChunkId, bytes: &[u8]) -> Result<u64, PaintError> {
        // A chunk that cannot be read costs its own leaves, not the tile: it is left out, or drawn as a checker.
        let scene = self.scene()?;
        // What comes ahead of its time is in no picture yet.
        scene.complete.take_if(|(frame, _)| frame.views.iter().any(|view| !view.missing.is_empty()));
        Ok(scene.renderer.upload(chunk, bytes).unwrap_or_else(|error| {
            tracing::warn!("chunk {}: {error}", chunk.0);
            bytes.len() as u64
        }))
    }

    fn evict(&mut self, chunk: ChunkId) -> Result<(), PaintError> {
        self.scene()?.renderer.evict(chunk);
        Ok(())
    }

    fn set_transform(&mut self, moved: &Moved) -> Result<(), PaintError> {
        let scene = self.scene()?;
        scene.renderer.set_transform(moved.object, moved.transform);
        scene.detailing.note_moved(moved.object);
        scene.has_changed = true;
        Ok(())
    }

    fn draw(&mut self, frame: &FrameToDraw) -> Result<DrawStats, PaintError> {
        let start = Instant::now();
        let Some(OpenScene { manifest, views, renderer, has_changed, drawn, estimating, detailing, triangles, complete, .. }) =
            &mut self.scene
        else {
            return Err(PaintError::Failed("a frame before there is a scene".to_owned()));
        };
        if let Some(stats) =
            complete.as_ref().filter(|(before, _)| !*has_changed && before.shows_the_same(frame)).map(|(_, s)| *s)
        {
            return Ok(DrawStats { draw_us: 0, ..stats });
        }
        for (drawn, view) in drawn.iter_mut().zip(&frame.views) {
            view.leaves.difference_into(&frame.dropped, drawn);
        }
        let tessellation = estimating.as_ref().map(Estimating::tessellation);
        let tessellated = tessellation.map(|tessellation| Tessellated { tessellation, scene: manifest });
        detailing.find(renderer, tessellated, views, frame, drawn).map_err(failed)?;
        let mut inputs: Vec<ViewInput<'_>> = views
            .iter()
            .zip(&frame.views)
            .zip(&*drawn)
            .map(|((spec, view), drawn)| {
                ViewInput::new(spec.view, projection(spec, view.eye, &frame.world_from_room), drawn, &view.missing)
            })
            .collect();
        inputs.iter_mut().enumerate().for_each(|(place, input)| input.cuts = detailing.of_view(place));
        if let Some(estimating) = estimating {
            if *has_changed {
                estimating.leave_out_moved(manifest, renderer.transforms());
            }
            estimating.find(manifest, views, frame);
            if frame.estimate.as_ref().is_some_and(|estimate| estimate.is_complete) {
                estimating.complete(renderer, manifest, (views, &inputs), frame).map_err(failed)?;
            }
            inputs.iter_mut().enumerate().for_each(|(place, input)| input.estimate = estimating.of_view(place));
        }
        let resident = |chunk| renderer.is_resident(chunk);
        let input = FrameInput {
            views: &inputs,
            shared_eye: frame.shared_eye,
            manifest,
            transforms: renderer.transforms(),
            resident: &resident,
            when_missing: frame.when_missing,
            has_changed: std::mem::take(has_changed),
        };
        triangles.fill(0);
        let mut stats = DrawStats::default();
        let mut round = Some(self.planner.begin(input));
        while let Some(plan) = round {
            let results = renderer.draw(plan).map_err(failed)?;
            for pass in &results.passes {
                stats.leaves += pass.leaves;
                stats.triangles += pass.triangles;
                let place = views.iter().position(|view| view.view == pass.view);
                place.into_iter().for_each(|place| triangles[place] += pass.triangles);
            }
            round = self.planner.feed(&results);
        }
        // Ready means that the picture is there, not that it was ordered.
        renderer.wait().map_err(failed)?;
        stats.draw_us = u32::try_from(start.elapsed().as_micros()).unwrap_or(u32::MAX);
        if let Some(estimating) = estimating {
            estimating.note(stats.draw_us, triangles.iter().copied());
            stats.is_cut = estimating.is_cut;
        }
        let is_complete =
            estimating.is_some() && detailing.is_final() && frame.estimate.as_ref().is_some_and(|estimate| estimate.is_complete);
        *complete = is_complete.then(|| (frame.clone(), stats));
        Ok(stats)
    }

    fn count(&mut self, frame: &FrameToDraw, order: &CountOrder) -> Result<Vec<ObjectCount>, PaintError> {
        let OpenScene { manifest, views, renderer, counting, .. } = self.scene()?;
        let (Some(spec), Some(view)) = (views.get(order.place), frame.views.get(order.place)) else { return Ok(Vec::new()) };
        if counting.is_off || !renderer.can_cull() {
            return Ok(Vec::new());
        }
        counting.find_bounds(manifest);
        let projection = projection(spec, view.eye, &frame.world_from_room);
        let footprint = |object: &ObjectId| {
            let (bounds, transform) = (&counting.bounds[object.0 as usize], &renderer.transforms()[object.0 as usize]);
            Footprint::of(&projection, spec.size_px, bounds, &transform.affine())
        };
        counting.footprints.clear();
        counting.footprints.extend(order.objects.iter().map(footprint));
        let counts = renderer.count_boxes(spec.view, &counting.footprints).unwrap_or_else(|error| {
            // What failed for good is found by the next draw; without counts, all that is seen is drawn.
            tracing::warn!("boxes are not counted any more: {error}");
            counting.is_off = true;
            Vec::new()
        });
        let of_object = |((object, footprint), counts): ((&ObjectId, &Footprint), &Counts)| {
            let distance_m = if counts.visible > 0 { footprint.distance_m() as f32 } else { 0.0 };
            ObjectCount { object: *object, visible_px: counts.visible, distance_m: distance_m.min(f32::MAX) }
        };
        Ok(order.objects.iter().zip(&counting.footprints).zip(&counts).map(of_object).collect())
    }

    fn show(&mut self, _frame: u64) -> Result<(), PaintError> {
        let shown = self.scene()?.renderer.show().map_err(failed)?;
        self.shown += 1;
        match &self.output {
            Output::Keep => {}
            Output::Folder { every, .. } if *every > 0 && self.shown.is_multiple_of(*every) => self.write_pictures()?,
            Output::Folder { .. } => {}
            Output::Window(feed) | Output::OwnWindow(feed) => {
                for picture in shown {
                    feed.show(picture).map_err(|_| PaintError::Closed)?;
                }
            }
        }
        Ok(())
    }
}
