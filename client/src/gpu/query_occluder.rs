//! The occluder as the paper has it (Birkholz, Rahn, sections 3.1 and 3.3): coarse versions of the objects in a depth buffer, and occlusion
//! queries of the GPU for solids around nodes, whose answers come late.
//!
//! ```text
//! draw: cuts ─→ depth          hides: a solid ─→ a batch of queries ─ full ─→ in flight, a few at a time ─→ answers
//! ```
//! An answer is exact for the middles of the picture's pixels, and conservative for what the solid holds: that is grown by an eighth of a pixel, and
//! what reaches the near plane is seen. But when it comes depends on the GPU, and so does what is refined: for comparing, not for walls, whose
//! nodes must agree.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::{DVec3, Mat4, Vec3};
use mullion_common::geometry::Aabb;
use mullion_common::scene::Hierarchy;
use mullion_common::wall::Projection;

use super::bindings::{module, pipeline_layout};
use super::device::{Gpu, GpuError};
use super::draws::GrowingBuffer;
use super::occlusion::read_only;
use super::pipelines::Sides;
use super::queries::Queries;
use super::targets::{DEPTH_FORMAT, texture, view_of};
use super::test_box::{Grower, LocalScale};
use crate::lod::{BoundsKind, Cut, Hidden, LodObject, Occluder, Solid, SolidMesh, StepId, Wait};
use crate::occlusion::DEPTH_SLACK;

/// So many nodes are asked about at once.
const BATCH: usize = 64;
/// Most batches that the GPU has at a time.
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

/// Where an object is.
#[derive(Clone, Copy, Debug)]
struct Placed {
    clip_from_local: Mat4,
    scale: LocalScale,
    is_mirrored: bool,
}

/// What draws cuts into depth.
struct Drawing {
    /// By [`Sides`].
    pipelines: [wgpu::RenderPipeline; 3],
    vertices: GrowingBuffer,
    indices: GrowingBuffer,
    instances: GrowingBuffer,
    draws: Vec<CutDraw>,
    staged_vertices: Vec<[f32; 3]>,
    staged_indices: Vec<u32>,
    staged_instances: Vec<[f32; 16]>,
}

/// An object's triangles.
#[derive(Clone, Copy, Debug)]
struct CutDraw {
    sides: Sides,
    first_vertex: u32,
    first_index: u32,
    index_end: u32,
}

/// What draws solids.
struct Asking {
    pipeline: wgpu::RenderPipeline,
    vertices: GrowingBuffer,
    indices: GrowingBuffer,
    index_count: u32,
    /// No corner is further out along any axis.
    reach: f32,
    instances: GrowingBuffer,
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
        // Behind the near plane z > w; a little earlier, lest rounding takes a corner there.
        let is_clear = (clip.w_axis.w - of_axes(3)) * 0.999 > clip.w_axis.z + of_axes(2);
        (is_clear && clip.is_finite()).then_some(clip)
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

    /// After an error nothing is asked.
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
        let drawn = self.draw_cuts(objects, cuts);
        self.note(drawn);
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

impl Drawing {
    fn new(gpu: &Gpu) -> Self {
        let pipelines = [Sides::Both, Sides::Front, Sides::FrontMirrored].map(|sides| pipeline(gpu, sides, Depths::Written));
        Self {
            pipelines,
            vertices: GrowingBuffer::new(gpu, "vertices of an occluder", wgpu::BufferUsages::VERTEX),
            indices: GrowingBuffer::new(gpu, "indices of an occluder", wgpu::BufferUsages::INDEX),
            instances: GrowingBuffer::new(gpu, "objects of an occluder", wgpu::BufferUsages::VERTEX),
            draws: Vec::new(),
            staged_vertices: Vec::new(),
            staged_indices: Vec::new(),
            staged_instances: Vec::new(),
        }
    }

    fn clear(&mut self) {
        self.draws.clear();
        self.staged_vertices.clear();
        self.staged_indices.clear();
        self.staged_instances.clear();
    }

    fn stage(&mut self, LodObject { hierarchy, is_double_sided, .. }: &LodObject<'_>, cut: &Cut, placed: &Placed) {
        let positions = &hierarchy.vertices().positions;
        let (first_vertex, first_index) = (self.staged_vertices.len() as u32, self.staged_indices.len() as u32);
        self.staged_vertices.extend(cut.vertices(hierarchy).map(|vertex| positions[vertex as usize]));
        self.staged_indices.extend(cut.placed_triangles(hierarchy).flatten());
        self.staged_instances.push(placed.clip_from_local.to_cols_array());
        let sides = Sides::of(*is_double_sided, placed.is_mirrored);
        self.draws.push(CutDraw { sides, first_vertex, first_index, index_end: self.staged_indices.len() as u32 });
    }

    /// Draws what is staged in place of what is there.
    fn draw(&mut self, gpu: &Gpu, depth: &wgpu::TextureView) -> Result<(), GpuError> {
        let limit = gpu.device.limits().max_buffer_size;
        self.vertices.write(gpu, bytemuck::cast_slice(&self.staged_vertices), limit)?;
        self.indices.write(gpu, bytemuck::cast_slice(&self.staged_indices), limit)?;
        self.instances.write(gpu, bytemuck::cast_slice(&self.staged_instances), limit)?;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("occluder") });
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("occluder"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                // Reversed depth: 0 is infinitely far.
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_vertex_buffer(0, self.vertices.buffer.slice(..));
        pass.set_vertex_buffer(1, self.instances.buffer.slice(..));
        pass.set_index_buffer(self.indices.buffer.slice(..), wgpu::IndexFormat::Uint32);
        for (at, draw) in (0..).zip(&self.draws) {
            pass.set_pipeline(&self.pipelines[draw.sides as usize]);
            pass.draw_indexed(draw.first_index..draw.index_end, draw.first_vertex as i32, at..at + 1);
        }
        drop(pass);
        gpu.submit(Some(encoder.finish()));
        gpu.check()
    }
}

impl Asking {
    fn new(gpu: &Gpu, kind: BoundsKind) -> Result<Self, GpuError> {
        let SolidMesh { positions, mut indices } = SolidMesh::of(kind);
        let index_count = indices.len() as u32;
        // Buffer writes come in multiples of four bytes: two indices.
        indices.resize(indices.len().next_multiple_of(2), 0);
        let written = |label, usage, bytes: &[u8]| {
            let mut buffer = GrowingBuffer::new(gpu, label, usage);
            buffer.write(gpu, bytes, u64::MAX).map(|()| buffer)
        };
        Ok(Self {
            pipeline: pipeline(gpu, Sides::Front, Depths::Asked),
            vertices: written("corners of solids", wgpu::BufferUsages::VERTEX, bytemuck::cast_slice(&positions))?,
            indices: written("indices of solids", wgpu::BufferUsages::INDEX, bytemuck::cast_slice(&indices))?,
            index_count,
            reach: positions.as_flattened().iter().fold(0.0, |most: f32, at| most.max(at.abs())),
            instances: GrowingBuffer::new(gpu, "solids", wgpu::BufferUsages::VERTEX),
        })
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
        asking.instances.write(gpu, bytemuck::cast_slice(&self.instances), gpu.device.limits().max_buffer_size)?;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("questions") });
        let set = self.queries.set().clone();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("questions"),
            depth_stencil_attachment: Some(read_only(depth)),
            occlusion_query_set: Some(&set),
            ..Default::default()
        });
        pass.set_pipeline(&asking.pipeline);
        pass.set_vertex_buffer(0, asking.vertices.buffer.slice(..));
        pass.set_vertex_buffer(1, asking.instances.buffer.slice(..));
        pass.set_index_buffer(asking.indices.buffer.slice(..), wgpu::IndexFormat::Uint16);
        let count = self.instances.len() as u32;
        self.queries.ask(&mut pass, count, |pass, at| pass.draw_indexed(0..asking.index_count, 0, at..at + 1));
        drop(pass);
        self.queries.resolve(&mut encoder);
        self.submission = Some(gpu.submit(Some(encoder.finish())));
        self.queries.want();
        gpu.check()
    }
}

/// What a pipeline does with depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Depths {
    Written,
    Asked,
}

fn pipeline(gpu: &Gpu, sides: Sides, depths: Depths) -> wgpu::RenderPipeline {
    let module = &module(&gpu.device, "placed", include_str!("shaders/placed.wgsl"));
    let (compare, slack) = match depths {
        Depths::Written => (wgpu::CompareFunction::Greater, 1.0),
        Depths::Asked => (wgpu::CompareFunction::GreaterEqual, DEPTH_SLACK),
    };
    let constants = &[("DEPTH_SLACK", slack)];
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("placed"),
        layout: Some(&pipeline_layout(&gpu.device, "placed", &[])),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
            buffers: &[
                Some(wgpu::VertexBufferLayout {
                    array_stride: size_of::<[f32; 3]>() as u64,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &wgpu::vertex_attr_array![0 => Float32x3],
                }),
                Some(wgpu::VertexBufferLayout {
                    array_stride: size_of::<[f32; 16]>() as u64,
                    step_mode: wgpu::VertexStepMode::Instance,
                    attributes: &wgpu::vertex_attr_array![1 => Float32x4, 2 => Float32x4, 3 => Float32x4, 4 => Float32x4],
                }),
            ],
        },
        primitive: sides.primitive(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(depths == Depths::Written),
            depth_compare: Some(compare),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: None,
        multiview_mask: None,
        cache: None,
    })
}
