//! What a [`super::QueryOccluder`] draws: cuts into depth, and solids around nodes that are held against it.

use glam::Mat4;

use super::bindings::{module, pipeline_layout};
use super::device::{Gpu, GpuError};
use super::draws::GrowingBuffer;
use super::occlusion::read_only;
use super::pipelines::Sides;
use super::queries::Queries;
use super::targets::DEPTH_FORMAT;
use super::test_box::LocalScale;
use crate::lod::{BoundsKind, Cut, LodObject, SolidMesh};
use crate::occlusion::DEPTH_SLACK;

/// Where an object is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub clip_from_local: Mat4,
    pub scale: LocalScale,
    pub is_mirrored: bool,
}

/// What draws cuts into depth.
pub(super) struct Drawing {
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
pub(super) struct Asking {
    pipeline: wgpu::RenderPipeline,
    vertices: GrowingBuffer,
    indices: GrowingBuffer,
    index_count: u32,
    /// No corner is further out along any axis.
    pub reach: f32,
    instances: GrowingBuffer,
}

impl Drawing {
    /// Nothing is staged.
    pub fn new(gpu: &Gpu) -> Self {
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

    /// Begins anew.
    pub fn clear(&mut self) {
        self.draws.clear();
        self.staged_vertices.clear();
        self.staged_indices.clear();
        self.staged_instances.clear();
    }

    /// Stages an object's triangles.
    pub fn stage(&mut self, LodObject { hierarchy, is_double_sided, .. }: &LodObject<'_>, cut: &Cut, placed: &Placed) {
        let positions = &hierarchy.vertices().positions;
        let (first_vertex, first_index) = (self.staged_vertices.len() as u32, self.staged_indices.len() as u32);
        self.staged_vertices.extend(cut.vertices(hierarchy).map(|vertex| positions[vertex as usize]));
        self.staged_indices.extend(cut.placed_triangles(hierarchy).flatten());
        self.staged_instances.push(placed.clip_from_local.to_cols_array());
        let sides = Sides::of(*is_double_sided, placed.is_mirrored);
        self.draws.push(CutDraw { sides, first_vertex, first_index, index_end: self.staged_indices.len() as u32 });
    }

    /// Draws what is staged in place of what is there.
    pub fn draw(&mut self, gpu: &Gpu, depth: &wgpu::TextureView) -> Result<(), GpuError> {
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
    /// What asks about bounds of a kind.
    pub fn new(gpu: &Gpu, kind: BoundsKind) -> Result<Self, GpuError> {
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

    /// Asks for each solid, as it is placed, whether any of its pixels is before what is drawn.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (depth, queries): (&wgpu::TextureView, &mut Queries),
        instances: &[[f32; 16]],
    ) -> Result<(), GpuError> {
        self.instances.write(gpu, bytemuck::cast_slice(instances), gpu.device.limits().max_buffer_size)?;
        let set = queries.set().clone();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("questions"),
            depth_stencil_attachment: Some(read_only(depth)),
            occlusion_query_set: Some(&set),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_vertex_buffer(0, self.vertices.buffer.slice(..));
        pass.set_vertex_buffer(1, self.instances.buffer.slice(..));
        pass.set_index_buffer(self.indices.buffer.slice(..), wgpu::IndexFormat::Uint16);
        let index_count = self.index_count;
        queries.ask(&mut pass, instances.len() as u32, |pass, at| pass.draw_indexed(0..index_count, 0, at..at + 1));
        Ok(())
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
