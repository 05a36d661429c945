//! One scene and its views: takes chunks, executes plans.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use glam::DAffine3;
use mullion_common::geometry::Aabb;
use mullion_common::scene::{ChunkId, ChunkKind, LeafRecord, MaterialId, ObjectId, SceneManifest, Transform};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::ViewId;

use super::arena::{Arena, Slot};
use super::by_chunk::ByChunk;
use super::culled::Culling;
use super::cuts::Cuts;
use super::device::{Gpu, GpuError};
use super::draws::{DrawBuffers, DrawList, Indices, State};
use super::pipelines::{Coverage, PipelineKey, Pipelines, Sides, Surface, Turn};
use super::targets::{Attachments, CLEAR_COLOR, Shown, Target};
use super::timer::Pass;
use super::unit::Unit;
use super::upload::{self, Materials, UploadError};
use crate::frame::{FramePlan, PassPlan, PassResult, PassResults};
use crate::occlusion::pieces::pieces;

/// Most leaves and bounds of a view that are drawn with occlusion culling: their boxes fit any GPU's buffers and dispatches. More are drawn
/// without.
const MAX_CULLED: usize = 1 << 21;

/// A view to draw, and how large.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub struct ViewTarget {
    pub view: ViewId,
    pub size_px: [u32; 2],
}

/// Draws the views of one scene.
pub struct Renderer {
    pub(super) gpu: Arc<Gpu>,
    pub(super) targets: Vec<Target>,
    pub(super) manifest: Arc<SceneManifest>,
    pub(super) transforms: Vec<Transform>,
    /// Whether an object's transform turns the winding around.
    pub(super) mirrored: Vec<bool>,
    arena: Arena,
    /// Resident geometry, by `ChunkId`.
    geometry: Vec<Option<Slot>>,
    /// The indices of that geometry, where parts of leaves are drawn.
    indices: ByChunk<u16>,
    /// Boxes around its pieces, where leaves are tested piece by piece.
    pub(super) pieces: ByChunk<Aabb>,
    pub(super) cuts: Cuts,
    /// What boxes are drawn with.
    cube: Slot,
    pub(super) materials: Materials,
    pub(super) pipelines: Pipelines,
    pub(super) list: DrawList,
    pub(super) buffers: DrawBuffers,
    /// For each object the pass that last made it a record, and that record.
    pub(super) recorded: Vec<(u64, u32)>,
    pub(super) pass: u64,
    pub(super) culling: Culling,
    pub(super) unit: Unit,
    pub(super) last_submission: Option<wgpu::SubmissionIndex>,
}

impl Renderer {
    /// A renderer with nothing resident. `manifest` must be one that passes its own check.
    ///
    /// # Errors
    /// When a view's size is not one that the GPU takes, or the GPU fails.
    pub fn new(
        gpu: Arc<Gpu>,
        manifest: Arc<SceneManifest>,
        views: &[ViewTarget],
        attachments: Attachments,
    ) -> Result<Self, GpuError> {
        let pipelines = Pipelines::new(&gpu, attachments);
        let targets = views.iter().map(|v| Target::new(&gpu, v.view, v.size_px, attachments)).collect::<Result<_, _>>()?;
        let materials = Materials::new(&gpu, &manifest, &pipelines.texture_layout);
        let buffers = DrawBuffers::new(&gpu);
        let cuts = Cuts::new(&gpu);
        let mut arena = Arena::new();
        let cube = upload::unit_cube(&gpu, &mut arena)?;
        gpu.check()?;
        Ok(Self {
            targets,
            transforms: manifest.transforms.clone(),
            mirrored: manifest.transforms.iter().map(Transform::is_mirrored).collect(),
            arena,
            cube,
            geometry: vec![None; manifest.chunks.len()],
            indices: ByChunk::default(),
            pieces: ByChunk::default(),
            cuts,
            materials,
            pipelines,
            list: DrawList::default(),
            buffers,
            recorded: vec![(0, 0); manifest.transforms.len()],
            pass: 0,
            culling: Culling::default(),
            unit: Unit::default(),
            last_submission: None,
            manifest,
            gpu,
        })
    }

    /// Takes a scene that has more objects, leaves, materials and chunks behind those of the one that is here. What is resident stays, and
    /// so do objects that moved.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn grow(&mut self, manifest: Arc<SceneManifest>) -> Result<(), GpuError> {
        let added = &manifest.transforms[self.transforms.len().min(manifest.transforms.len())..];
        self.transforms.extend_from_slice(added);
        self.mirrored.extend(added.iter().map(Transform::is_mirrored));
        self.recorded.resize(manifest.transforms.len(), (0, 0));
        self.geometry.resize(manifest.chunks.len(), None);
        self.indices.grow(manifest.chunks.len());
        self.pieces.grow(manifest.chunks.len());
        self.materials.grow(&self.gpu, &manifest);
        self.manifest = manifest;
        self.gpu.check()
    }

    /// Decodes a chunk and makes it resident. Returns the bytes that it takes on the GPU. A chunk that is resident
    /// is not read again.
    ///
    /// # Errors
    /// When the bytes are malformed or too large. A texture that cannot be read becomes resident all the same, as a
    /// checker.
    pub fn upload(&mut self, chunk: ChunkId, bytes: &[u8]) -> Result<u64, UploadError> {
        let place = self.geometry.get_mut(chunk.0 as usize).ok_or(UploadError::Unknown(chunk.0))?;
        match self.manifest.chunks[chunk.0 as usize].kind() {
            Some(ChunkKind::Texture) => self.materials.insert(&self.gpu, chunk, bytes),
            Some(ChunkKind::Geometry) => {
                if let Some(slot) = *place {
                    return Ok(slot.bytes());
                }
                let (slot, geometry) = upload::geometry(&self.gpu, &mut self.arena, bytes)?;
                *place = Some(slot);
                self.pieces.put(chunk, || pieces(&geometry.positions, &geometry.indices));
                self.indices.put(chunk, || geometry.indices.into());
                Ok(slot.bytes())
            }
            None => Err(UploadError::Unknown(chunk.0)),
        }
    }

    /// From now on plans may draw parts of leaves: the indices of chunks that come are kept, 6 bytes a triangle. Chunks that are here
    /// already are drawn whole.
    pub fn keep_indices(&mut self) {
        self.indices.keep(self.geometry.len());
    }

    /// From now on plans may test leaves piece by piece: for chunks that come, boxes around their pieces are kept, up to 1536 bytes a chunk. Leaves of
    /// chunks that are here already are tested by one box.
    pub fn keep_pieces(&mut self) {
        self.pieces.keep(self.geometry.len());
    }

    /// Whether plans may test what is hidden. Where it cannot, those that begin with what was seen draw all, and those in rounds are
    /// errors.
    pub fn can_cull(&self) -> bool {
        self.gpu.can_cull()
    }

    /// Whether leaves can be drawn with this chunk.
    pub fn is_resident(&self, chunk: ChunkId) -> bool {
        self.geometry.get(chunk.0 as usize).is_some_and(Option::is_some) || self.materials.is_resident(chunk)
    }

    /// Whether all textures of these materials, which must be in the manifest, are there.
    pub fn has_textures(&self, materials: &[MaterialId]) -> bool {
        let textures = materials.iter().filter_map(|material| self.manifest.materials[material.0 as usize].texture.as_ref());
        textures.map(|texture| texture.chunk).all(|chunk| self.materials.is_resident(chunk))
    }

    /// Frees what the chunk takes on the GPU.
    pub fn evict(&mut self, chunk: ChunkId) {
        match self.geometry.get_mut(chunk.0 as usize).and_then(Option::take) {
            Some(slot) => {
                self.arena.remove(slot);
                self.indices.forget(chunk);
                self.pieces.forget(chunk);
            }
            None => self.materials.remove(&self.gpu, chunk),
        }
    }

    /// Moves an object, from the next draw on. A transform that is not finite, or of no object, is ignored.
    pub fn set_transform(&mut self, object: ObjectId, transform: Transform) {
        let at = object.0 as usize;
        if at < self.transforms.len() && transform.is_finite() {
            self.mirrored[at] = transform.is_mirrored();
            self.transforms[at] = transform;
        }
    }

    /// Where the objects stand now, by `ObjectId`: the planner wants to know.
    pub fn transforms(&self) -> &[Transform] {
        &self.transforms
    }

    /// Draws every pass of the plan. Returns when the GPU has its work, not when it is done: see
    /// [`Renderer::wait`]; with occlusion culling, or where it is timed, when it is done. Leaves whose geometry is not resident are skipped.
    ///
    /// # Errors
    /// When a pass names a view that is not this renderer's, is larger than the GPU's limits, or in rounds where [`Renderer::can_cull`] is
    /// not, or the GPU fails.
    pub fn draw(&mut self, plan: &FramePlan) -> Result<PassResults, GpuError> {
        self.arena.flush(&self.gpu);
        let started = Instant::now();
        let mut passes = Vec::with_capacity(plan.passes.len());
        let mut awaited = Vec::new();
        let can_cull = self.can_cull();
        for pass in &plan.passes {
            let began = Instant::now();
            let at = self.targets.iter().position(|t| t.view == pass.view).ok_or(GpuError::UnknownView(pass.view.0))?;
            let result = match &pass.first {
                Some(first) if can_cull && pass.opaque.len() as usize + pass.blended.len() + pass.bounds.len() <= MAX_CULLED => {
                    self.prepare_culling(at)?;
                    self.draw_culled(at, pass, first)?
                }
                None if pass.is_round() && !can_cull => return Err(GpuError::NoCulling),
                None if pass.is_round() => {
                    self.prepare_culling(at)?;
                    self.draw_round(at, pass)?
                }
                _ => self.draw_pass(at, pass)?,
            };
            if self.targets[at].is_culled || pass.is_timed {
                awaited.push((passes.len(), at, began.elapsed()));
            }
            passes.push(result);
        }
        for &(at, target, planned) in &awaited {
            let (pass, result) = (&plan.passes[at], &mut passes[at]);
            match pass.first {
                Some(_) if self.targets[target].is_culled => self.note_seen(target, pass.test, result)?,
                None if pass.is_round() => self.note_bounds(target, pass, result)?,
                _ => self.note_times(target, result)?,
            }
            result.times.iter_mut().for_each(|times| times.plan_us = planned.as_secs_f64() * 1e6);
        }
        if awaited.len() == passes.len() {
            share_the_rest(started.elapsed().as_secs_f64() * 1e6, &mut passes);
        }
        self.gpu.check()?;
        Ok(PassResults { passes })
    }

    /// Waits until everything drawn so far is in the pictures.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.gpu.wait(self.last_submission.clone())
    }

    /// Makes what was last drawn the picture to be seen, for all views at once.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn show(&mut self) -> Result<Vec<Shown>, GpuError> {
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("show") });
        let shown = self.targets.iter_mut().map(|target| target.show(&self.gpu, &mut encoder)).collect();
        self.last_submission = Some(self.gpu.submit(Some(encoder.finish())));
        self.gpu.check()?;
        Ok(shown)
    }

    fn draw_pass(&mut self, at: usize, pass: &PassPlan) -> Result<PassResult, GpuError> {
        self.list_draws(pass);
        self.hand_over(at, pass, false)?;
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("pass") });
        let measured = pass.is_timed.then_some(Pass::Draws);
        self.encode(&self.targets[at], &mut encoder, (Load::Clear, measured), 0..self.list.batches.len());
        if pass.is_timed {
            self.encode_times(at, &mut encoder, 1);
        }
        self.last_submission = Some(self.gpu.submit(Some(encoder.finish())));
        Ok(self.result(pass))
    }

    /// Hands what is listed to the GPU, and readies a target for it.
    pub(super) fn hand_over(&mut self, at: usize, pass: &PassPlan, is_culled: bool) -> Result<(), GpuError> {
        self.buffers.write(&self.gpu, &mut self.list)?;
        let (target, records) = (&mut self.targets[at], &self.buffers.records);
        target.begin(&self.gpu, is_culled);
        target.write_uniform(&self.gpu, &pass.projection);
        target.bind(&self.gpu, &self.pipelines.view_layout, (records.generation, &records.buffer));
        Ok(())
    }

    /// What is listed, all of it drawn.
    pub(super) fn result(&self, pass: &PassPlan) -> PassResult {
        PassResult {
            view: pass.view,
            leaves: self.list.arguments.len() as u32 - self.list.cut_draws - self.list.stand_ins.len() as u32,
            boxes: self.list.stand_ins.len() as u32,
            triangles: self.list.triangles,
            hidden_triangles: 0,
            batches: self.list.batches.len() as u32,
            seen: None,
            late: VisibleSet::default(),
            bounds_seen: Vec::new(),
            counts: Vec::new(),
            times: None,
        }
    }

    /// Fills the draw list: the plan's leaves in the plan's order.
    fn list_draws(&mut self, pass: &PassPlan) {
        self.list.clear();
        self.pass += 1;
        self.list_solid(pass, pass.opaque.leaves(), Turn::First);
        self.list_boxes(pass);
        self.list_leaves(pass, pass.blended.iter().copied(), Turn::First);
    }

    /// Boxes are the cube, stretched. Their inner sides are dropped: a box around the eye would hide everything.
    pub(super) fn list_boxes(&mut self, pass: &PassPlan) {
        let begin = self.list.arguments.len() as u32;
        for &number in &pass.boxes {
            let Some(leaf) = self.manifest.leaves.get(number as usize) else { continue };
            let object = leaf.object.0 as usize;
            let world_from_box = self.transforms[object].affine() * local_from_box(leaf);
            let record = self.list.records.len() as u32;
            self.list.records.push(pass.projection.clip_from_local(&world_from_box).to_cols_array());
            let sides = if self.mirrored[object] { Sides::FrontMirrored } else { Sides::Front };
            let pipeline = PipelineKey::new(Coverage::Opaque, Surface::Plain, sides);
            let state = State { pipeline, texture: Materials::NO_TEXTURE, page: self.cube.page, indices: Indices::Page };
            let instance = self.materials.states[leaf.material.0 as usize].instance(record, number);
            self.list.push(state, instance, (self.cube.first_index, self.cube.index_count), self.cube.first_vertex);
        }
        self.list.stand_ins = begin..self.list.arguments.len() as u32;
    }

    pub(super) fn list_leaves(&mut self, pass: &PassPlan, leaves: impl Iterator<Item = u32>, turn: Turn) {
        for leaf in leaves {
            let Some(record) = self.manifest.leaves.get(leaf as usize).copied() else { continue };
            let Some(slot) = self.geometry[record.chunk.0 as usize] else { continue };
            if slot.index_count == 0 {
                continue;
            }
            let of_object = self.record(pass, record.object);
            let material = self.materials.states[record.material.0 as usize];
            let sides = Sides::of(material.double_sided, self.mirrored[record.object.0 as usize]);
            let pipeline = PipelineKey::new(material.coverage, material.surface(), sides).in_turn(turn);
            let part = if pass.parts.is_empty() { None } else { pass.parts.of(leaf) };
            let kept = Some(self.indices.of(record.chunk)).filter(|kept| !kept.is_empty());
            let part = part.zip(kept).map(|(triangles, indices)| self.list.part_of(indices, triangles));
            let indices = if part.is_some() { Indices::Parts } else { Indices::Page };
            let state = State { pipeline, texture: material.texture, page: slot.page, indices };
            let instance = material.instance(of_object, leaf);
            self.list.push(state, instance, part.unwrap_or((slot.first_index, slot.index_count)), slot.first_vertex);
        }
    }

    /// The record of an object in this pass.
    pub(super) fn record(&mut self, pass: &PassPlan, object: ObjectId) -> u32 {
        let at = object.0 as usize;
        if self.recorded[at].0 != self.pass {
            self.recorded[at] = (self.pass, self.list.records.len() as u32);
            let clip_from_local = pass.projection.clip_from_local(&self.transforms[at].affine());
            self.list.records.push(clip_from_local.to_cols_array());
        }
        self.recorded[at].1
    }

    /// Draws some of what is listed into a target that has begun. `measured`: as which pass, if at all.
    pub(super) fn encode(
        &self,
        target: &Target,
        encoder: &mut wgpu::CommandEncoder,
        (load, measured): (Load, Option<Pass>),
        batches: Range<usize>,
    ) {
        let attachment = |view, clear| wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: load.of(clear), store: wgpu::StoreOp::Store },
        };
        let ids = target.ids.as_ref().filter(|_| target.ids_are_new).map(|(_, view)| attachment(view, wgpu::Color::TRANSPARENT));
        let color_attachments = [Some(attachment(&target.color_view, CLEAR_COLOR)), ids];
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("view"),
            color_attachments: if target.ids_are_new { &color_attachments } else { &color_attachments[..1] },
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &target.depth_view,
                // Reversed depth: 0 is infinitely far.
                depth_ops: Some(wgpu::Operations { load: load.of(0.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            timestamp_writes: target.timer.as_ref().zip(measured).map(|(timer, pass)| timer.stamps(pass)),
            ..Default::default()
        });
        let Some((_, bindings)) = &target.bindings else { return };
        pass.set_bind_group(0, bindings, &[]);
        if let (Load::Keep, Some(first)) = (load, &target.first) {
            pass.set_bind_group(2, &first.bindings, &[]);
        }
        pass.set_vertex_buffer(1, self.buffers.instances.buffer.slice(..));
        let mut bound: Option<State> = None;
        for batch in &self.list.batches[batches] {
            let state = batch.state;
            if bound.is_none_or(|b| b.pipeline != state.pipeline) {
                pass.set_pipeline(self.pipelines.get(state.pipeline, target.is_culled));
            }
            if bound.is_none_or(|b| b.texture != state.texture) {
                pass.set_bind_group(1, &self.materials.bindings[state.texture as usize], &[]);
            }
            if bound.is_none_or(|b| (b.page, b.indices) != (state.page, state.indices)) {
                let page = self.arena.page(state.page);
                let (vertices, indices, format) = match state.indices {
                    Indices::Page => (&page.vertices, &page.indices, wgpu::IndexFormat::Uint16),
                    Indices::Parts => (&page.vertices, &self.buffers.part_indices.buffer, wgpu::IndexFormat::Uint16),
                    Indices::Cuts => (&self.cuts.vertices.buffer, &self.cuts.indices.buffer, wgpu::IndexFormat::Uint32),
                };
                pass.set_vertex_buffer(0, vertices.slice(..));
                pass.set_index_buffer(indices.slice(..), format);
            }
            bound = Some(state);
            if self.gpu.indirect {
                let offset = u64::from(batch.start) * size_of::<super::draws::DrawArguments>() as u64;
                pass.multi_draw_indexed_indirect(&self.buffers.arguments.buffer, offset, batch.end - batch.start);
                continue;
            }
            for draw in &self.list.arguments[batch.start as usize..batch.end as usize] {
                let indices = draw.first_index..draw.first_index + draw.index_count;
                pass.draw_indexed(indices, draw.base_vertex, draw.first_instance..draw.first_instance + 1);
            }
        }
    }
}

/// Adds to what passes took what nobody measured of all they took together, the same to each: to look for pixels, to wait, to read.
fn share_the_rest(all_us: f64, passes: &mut [PassResult]) {
    let measured_us: f64 = passes.iter().filter_map(|pass| pass.times).map(|times| times.all_us()).sum();
    let rest_us = (all_us - measured_us).max(0.0) / passes.len().max(1) as f64;
    passes.iter_mut().filter_map(|pass| pass.times.as_mut()).for_each(|times| times.plan_us += rest_us);
}

/// What a pass begins with.
#[derive(Clone, Copy, Debug)]
pub(super) enum Load {
    Clear,
    Keep,
}

impl Load {
    fn of<V>(self, clear: V) -> wgpu::LoadOp<V> {
        match self {
            Self::Clear => wgpu::LoadOp::Clear(clear),
            Self::Keep => wgpu::LoadOp::Load,
        }
    }
}

/// From the unit cube to the leaf's bounds.
fn local_from_box(leaf: &LeafRecord) -> DAffine3 {
    let bounds = leaf.local_aabb();
    DAffine3 { matrix3: glam::DMat3::from_diagonal(bounds.size()), translation: bounds.min }
}
