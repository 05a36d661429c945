//! The occluder as the paper has it (Birkholz, Rahn, sections 3.1 and 3.3): coarse versions of the objects in a depth buffer, and occlusion
//! queries of the GPU for solids around nodes, whose answers come late.
//!
//! ```text
//! draw: cuts ─→ depth          hides: a solid ─→ a batch of queries ─ full ─→ in flight, a few at a time ─→ answers
//! ```
//! Bounds are drawn as [`crate::lod::SolidMesh`] has them: boxes, prisms of 16 sides around cylinders, solids of 124 triangles around spheres; of
//! links oriented boxes. An answer is exact for the middles of the picture's pixels, and conservative for what bounds hold: solids are grown by
//! an eighth of a pixel, and what reaches the near plane is seen. When it comes depends on the GPU, and so does what is refined: this is for
//! comparing (`mullion bench lod --answers queries`), not for walls, whose nodes must agree.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::{DVec3, Mat4, Vec3};
use mullion_common::geometry::Aabb;
use mullion_common::scene::Hierarchy;
use mullion_common::wall::Projection;

use super::device::{Gpu, GpuError};
use super::queries::Queries;
use super::query_passes::{Asking, Drawing, Placed};
use super::targets::{DEPTH_FORMAT, texture, view_of};
use super::test_box::{Grower, LocalScale, is_clear};
use crate::lod::{BoundsKind, Cut, Hidden, LodObject, Occluder, Solid, StepId, Wait};

/// So many nodes are asked about at once.
const BATCH: usize = 64;
/// Most batches that the GPU has at a time. The next one waits for the first of them: else nodes far down in the queue would be asked about, which
/// a budget may never come to.
const MOST_IN_FLIGHT: usize = 4;

/// Depths on the GPU, and queries against them.
pub struct QueryOccluder {
    gpu: Arc<Gpu>,
    kind: BoundsKind,
    size_px: [u32; 2],
    projection: Option<Projection>,
    depth: wgpu::TextureView,
    drawing: Drawing,
    asking: Asking,
    /// By object, as it was drawn.
    placed: Vec<Placed>,
    grower: Option<Grower>,
    /// Takes the next questions.
    open: Batch,
    in_flight: VecDeque<Batch>,
    unused: Vec<Batch>,
    answers: Vec<(usize, StepId, Hidden)>,
    /// Words of the batch that is read.
    seen: Vec<u32>,
    error: Option<GpuError>,
}

/// Questions that are asked at once.
struct Batch {
    queries: Queries,
    /// None, where nobody waits for the answers any more.
    asked: Vec<(usize, StepId, Hidden)>,
    instances: Vec<[f32; 16]>,
    submission: Option<wgpu::SubmissionIndex>,
}

impl QueryOccluder {
    /// An occluder in a picture of this size, pixels.
    ///
    /// # Errors
    /// Where the GPU has no such queries, or the picture is larger than it takes.
    pub fn new(gpu: &Arc<Gpu>, size_px: [u32; 2], kind: BoundsKind) -> Result<Self, GpuError> {
        if !gpu.can_cull() {
            return Err(GpuError::NoCulling);
        }
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if let Some(edge) = size_px.into_iter().find(|edge| *edge == 0 || *edge > limit) {
            return Err(GpuError::Limit { what: "edge of an occluder in pixels", value: edge.into(), limit: limit.into() });
        }
        let depth = texture(gpu, "occluder", size_px, DEPTH_FORMAT, wgpu::TextureUsages::RENDER_ATTACHMENT);
        Ok(Self {
            kind,
            size_px,
            projection: None,
            depth: view_of(&depth),
            drawing: Drawing::new(gpu),
            asking: Asking::new(gpu, kind)?,
            placed: Vec::new(),
            grower: None,
            open: Batch::new(gpu),
            in_flight: VecDeque::new(),
            unused: Vec::new(),
            answers: Vec::new(),
            seen: Vec::new(),
            error: None,
            gpu: Arc::clone(gpu),
        })
    }

    /// From where the next frame is seen.
    pub fn look(&mut self, projection: &Projection) {
        self.projection = Some(*projection);
    }

    /// What went wrong since the last call: from then on nothing was taken to be hidden.
    ///
    /// # Errors
    /// That.
    pub fn check(&mut self) -> Result<(), GpuError> {
        self.error.take().map_or(Ok(()), Err)
    }

    /// Nobody waits for answers any more.
    fn forget(&mut self) {
        self.answers.clear();
        self.open.clear();
        self.in_flight.iter_mut().for_each(Batch::clear);
    }

    fn draw_cuts(&mut self, objects: &[LodObject<'_>], cuts: &[Cut]) -> Result<(), GpuError> {
        let Some(projection) = self.projection else { return Ok(()) };
        self.grower = Some(Grower::new(&projection, self.size_px));
        self.placed.clear();
        self.placed.extend(objects.iter().map(|object| Placed {
            clip_from_local: projection.clip_from_local(&object.world_from_local),
            scale: LocalScale::of(&object.world_from_local),
            is_mirrored: object.world_from_local.matrix3.determinant() < 0.0,
        }));
        let drawing = &mut self.drawing;
        drawing.clear();
        for ((object, cut), placed) in objects.iter().zip(cuts).zip(&self.placed) {
            if object.is_solid {
                drawing.stage(object, cut, placed);
            }
        }
        drawing.draw(&self.gpu, &self.depth)
    }

    /// A node's solid in clip space, as it is drawn; `None` where that reaches the near plane.
    fn clip_from_solid(&self, placed: &Placed, solid: &Solid) -> Option<Mat4> {
        let Solid { middle, axes, half } = *solid;
        let reach = axes.map(Vec3::abs).into_iter().zip(half.to_array()).fold(Vec3::ZERO, |sum, (axis, half)| sum + axis * half);
        let [center, reach] = [middle, reach * self.asking.reach].map(Vec3::as_dvec3);
        let bounds = Aabb { min: center - reach, max: center + reach };
        let growth: DVec3 = self.grower?.growth(&bounds, &placed.clip_from_local, &placed.scale);
        let half = half + growth.max_element() as f32;
        let is_mirrored = axes[0].cross(axes[1]).dot(axes[2]) < 0.0;
        let first = if is_mirrored == placed.is_mirrored { axes[0] } else { -axes[0] };
        let column = |axis: Vec3, half: f32| (axis * half).extend(0.0);
        let local_from_solid =
            Mat4::from_cols(column(first, half.x), column(axes[1], half.y), column(axes[2], half.z), middle.extend(1.0));
        let clip = placed.clip_from_local * local_from_solid;
        let of_axes = |row: usize| clip.row(row).truncate().abs().element_sum() * self.asking.reach;
        let (least_w, most_z) = (clip.w_axis.w - of_axes(3), clip.w_axis.z + of_axes(2));
        (is_clear(least_w.into(), most_z.into()) && clip.is_finite()).then_some(clip)
    }

    /// Hands the open batch to the GPU, once that has room for it.
    fn submit(&mut self) -> Result<(), GpuError> {
        if self.in_flight.len() >= MOST_IN_FLIGHT {
            self.take_first()?;
        }
        let next = self.unused.pop().unwrap_or_else(|| Batch::new(&self.gpu));
        let mut batch = std::mem::replace(&mut self.open, next);
        batch.submit(&self.gpu, &mut self.asking, &self.depth)?;
        self.in_flight.push_back(batch);
        self.gpu.poll()?;
        while self.in_flight.front().is_some_and(|batch| batch.queries.are_answered()) {
            self.take_first()?;
        }
        Ok(())
    }

    /// Takes the answers of the batch that has been in flight the longest. Waits for them.
    fn take_first(&mut self) -> Result<(), GpuError> {
        let Some(mut batch) = self.in_flight.pop_front() else { return Ok(()) };
        if !batch.queries.are_answered() {
            self.gpu.wait(batch.submission.take())?;
        }
        self.seen.clear();
        batch.queries.take(&mut self.seen)?;
        let answers = batch.asked.iter().zip(&self.seen);
        self.answers.extend(
            answers.map(|((object, step, behind), seen)| (*object, *step, if *seen == 0 { *behind } else { Hidden::Nothing })),
        );
        batch.clear();
        self.unused.push(batch);
        Ok(())
    }

    /// Waits for an answer, if any is to come.
    fn wait_for_answers(&mut self) -> Result<(), GpuError> {
        if !self.open.asked.is_empty() {
            self.submit()?;
        }
        while self.answers.is_empty() && !self.in_flight.is_empty() {
            self.take_first()?;
        }
        Ok(())
    }

    /// After an error nothing is asked, until [`QueryOccluder::check`] has told of it.
    fn note(&mut self, done: Result<(), GpuError>) {
        if let Err(error) = done {
            self.error.get_or_insert(error);
            self.in_flight.clear();
            self.forget();
            self.placed.clear();
        }
    }
}

impl Occluder for QueryOccluder {
    fn draw(&mut self, objects: &[LodObject<'_>], cuts: &[Cut]) {
        self.forget();
        if self.error.is_none() {
            let drawn = self.draw_cuts(objects, cuts);
            self.note(drawn);
        }
    }

    fn hides(&mut self, object: usize, hierarchy: &Hierarchy, step: StepId) -> Option<Hidden> {
        let Some(placed) = self.placed.get(object) else { return Some(Hidden::Nothing) };
        let (solid, behind) = Solid::of(self.kind, hierarchy, step);
        let Some(clip_from_solid) = self.clip_from_solid(placed, &solid) else { return Some(Hidden::Nothing) };
        self.open.asked.push((object, step, behind));
        self.open.instances.push(clip_from_solid.to_cols_array());
        if self.open.asked.len() == BATCH {
            let submitted = self.submit();
            self.note(submitted);
        }
        None
    }

    fn answer_late(&mut self, wait: Wait, with: &mut dyn FnMut(usize, StepId, Hidden)) {
        if wait == Wait::ForSome && self.answers.is_empty() {
            let waited = self.wait_for_answers();
            self.note(waited);
        }
        self.answers.drain(..).for_each(|(object, step, hidden)| with(object, step, hidden));
    }
}

impl Batch {
    fn new(gpu: &Gpu) -> Self {
        let queries = Queries::new(gpu, BATCH as u32);
        Self { queries, asked: Vec::with_capacity(BATCH), instances: Vec::with_capacity(BATCH), submission: None }
    }

    fn clear(&mut self) {
        self.asked.clear();
        self.instances.clear();
    }

    /// Asks for each solid whether any of its pixels is before what is drawn.
    fn submit(&mut self, gpu: &Gpu, asking: &mut Asking, depth: &wgpu::TextureView) -> Result<(), GpuError> {
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("questions") });
        asking.encode(gpu, &mut encoder, (depth, &mut self.queries), &self.instances)?;
        self.queries.resolve(&mut encoder);
        self.submission = Some(gpu.submit(Some(encoder.finish())));
        self.queries.want();
        gpu.check()
    }
}
