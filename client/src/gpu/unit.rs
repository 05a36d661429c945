//! The Occlusion Unit on the GPU (Bartz, Meißner, Hüttner 1999, section 6.2): what [`Footprint::count`] counts, for many boxes in one pass.
//!
//! ```text
//! copy of the view's depth → polygons, a fan of triangles for each box → a fragment for each pixel: atomic counts → read back
//! ```
//! Every number is the CPU's to the bit: corners reach the rasteriser without rounding, through a viewport whose edges are powers of two, and
//! depth is computed in the same steps.

use bytemuck::{Pod, Zeroable};
use mullion_common::wall::ViewId;

use super::device::{Gpu, GpuError};
use super::draws::GrowingBuffer;
use super::renderer::Renderer;
use super::targets::{COLOR_FORMAT, DEPTH_FORMAT, Target, texture, view_of};
use crate::occlusion::unit::{Counts, Footprint, GUARD_PX, LEAST_DEPTH, MAX_CORNERS, PixelRect, SUBPIXELS};

/// Corners of the fan around a polygon's first corner.
const FAN: u32 = 3 * (MAX_CORNERS as u32 - 2);
/// Where the viewport begins before the tile: polygons lie within.
const VIEWPORT_GUARD_PX: u32 = GUARD_PX as u32 + 1;

/// A face's plane as the shader takes it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct FrontRecord {
    right: f32,
    down: f32,
    at_anchor: f32,
    zero: u32,
}

/// A footprint as the shader takes it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Shape {
    corners: [[i32; 2]; MAX_CORNERS],
    fronts: [FrontRecord; 3],
    anchor_px: [i32; 2],
    nearest: f32,
    corner_count: u32,
}
const _: () = assert!(size_of::<Shape>() == 208 && std::mem::offset_of!(Shape, fronts) == 144);

/// What the shader counts.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct CountRecord {
    projected: u32,
    visible: u32,
    closest: u32,
    /// From the greatest number down.
    before_first: [u32; 2],
    last: [u32; 2],
    unused: u32,
}
const _: () = assert!(size_of::<CountRecord>() == 32);

impl From<&Footprint> for Shape {
    fn from(footprint: &Footprint) -> Self {
        let mut corners = [[0; 2]; MAX_CORNERS];
        corners[..footprint.corners().len()].copy_from_slice(footprint.corners());
        let fronts = footprint.fronts().map(|front| FrontRecord {
            right: front.right,
            down: front.down,
            at_anchor: front.at_anchor,
            zero: 0,
        });
        let corner_count = footprint.corners().len() as u32;
        Self { corners, fronts, anchor_px: footprint.anchor_px(), nearest: footprint.nearest(), corner_count }
    }
}

impl From<CountRecord> for Counts {
    fn from(record: CountRecord) -> Self {
        let rect = PixelRect { first: record.before_first.map(|before| !before), last: record.last };
        Self {
            projected: record.projected,
            visible: record.visible,
            closest: f32::from_bits(record.closest),
            rect: (record.visible > 0).then_some(rect),
        }
    }
}

/// What a renderer keeps for it.
#[derive(Default)]
pub(super) struct Unit {
    /// Made when something is first counted.
    counter: Option<Counter>,
    shapes: Vec<Shape>,
}

/// What counts. Its buffers are kept from call to call.
struct Counter {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
    shapes: GrowingBuffer,
    counts: GrowingBuffer,
    viewport: wgpu::Buffer,
    read: wgpu::Buffer,
    /// Depth of the view last counted in.
    depth: Option<wgpu::Texture>,
}

impl Renderer {
    /// Counts boxes against what a view holds now, blended leaves aside: for each footprint what [`Footprint::count`] counts against
    /// [`Renderer::read_depth`], to the bit. Conservative as that is. Waits for the GPU.
    ///
    /// Footprints must be made for a tile of the view's size. Boxes do not hide each other.
    ///
    /// # Errors
    /// When the view is not this renderer's or its edge is longer than the largest texture's less a few pixels, the GPU's fragment shaders
    /// cannot write to buffers, footprints are more than its buffers hold, or the GPU fails.
    pub fn count_boxes(&mut self, view: ViewId, footprints: &[Footprint]) -> Result<Vec<Counts>, GpuError> {
        let target = self.targets.iter().find(|target| target.view == view).ok_or(GpuError::UnknownView(view.0))?;
        debug_assert!(footprints.iter().all(|footprint| footprint.size_px() == target.size_px), "made for another tile");
        if footprints.is_empty() {
            return Ok(Vec::new());
        }
        let viewport_px = viewport_px(&self.gpu, target.size_px)?;
        let counter = match &mut self.unit.counter {
            Some(counter) => counter,
            none => none.insert(Counter::new(&self.gpu).ok_or(GpuError::NoCounts)?),
        };
        self.unit.shapes.clear();
        self.unit.shapes.extend(footprints.iter().map(Shape::from));
        counter.write(&self.gpu, &self.unit.shapes)?;
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("count") });
        counter.encode(&self.gpu, &mut encoder, (target, viewport_px), footprints.len() as u32);
        self.last_submission = Some(self.gpu.submit(Some(encoder.finish())));
        counter.read(&self.gpu, footprints.len())
    }
}

impl Counter {
    /// None where fragment shaders cannot write.
    fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.can_cull() {
            return None;
        }
        use wgpu::BufferUsages as Use;
        let layout = layout(&gpu.device);
        let counts = GrowingBuffer::new(gpu, "counts", Use::STORAGE | Use::COPY_SRC);
        Some(Self {
            pipeline: pipeline(&gpu.device, &layout),
            layout,
            shapes: GrowingBuffer::new(gpu, "shapes", Use::STORAGE),
            viewport: buffer(gpu, "viewport", size_of::<[f32; 2]>() as u64, Use::UNIFORM | Use::COPY_DST),
            read: buffer(gpu, "counts read", counts.buffer.size(), Use::MAP_READ | Use::COPY_DST),
            counts,
            depth: None,
        })
    }

    /// Hands over the boxes, and makes room for what comes of them.
    fn write(&mut self, gpu: &Gpu, shapes: &[Shape]) -> Result<(), GpuError> {
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        self.shapes.write(gpu, bytemuck::cast_slice(shapes), limit)?;
        self.counts.reserve(gpu, size_of::<CountRecord>() as u64 * shapes.len() as u64, limit)?;
        let size = self.counts.buffer.size();
        if self.read.size() != size {
            self.read = buffer(gpu, "counts read", size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        }
        Ok(())
    }

    /// Counts against what a target holds. Its picture is drawn into, but nothing is written.
    fn encode(&mut self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, (target, viewport_px): (&Target, [u32; 2]), boxes: u32) {
        let depth = self.keep(gpu, encoder, target);
        let viewport_px = viewport_px.map(|edge| edge as f32);
        let ndc_per_step = viewport_px.map(|edge| 2.0 / (edge * SUBPIXELS as f32));
        gpu.queue.write_buffer(&self.viewport, 0, bytemuck::cast_slice(&ndc_per_step));
        encoder.clear_buffer(&self.counts.buffer, 0, None);
        let bindings = self.bind(gpu, &depth);
        let attachment = wgpu::RenderPassColorAttachment {
            view: &target.color_view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("count"),
            color_attachments: &[Some(attachment)],
            ..Default::default()
        });
        let before = -(VIEWPORT_GUARD_PX as f32);
        pass.set_viewport(before, before, viewport_px[0], viewport_px[1], 0.0, 1.0);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.draw(0..FAN, 0..boxes);
        drop(pass);
        let bytes = u64::from(boxes) * size_of::<CountRecord>() as u64;
        encoder.copy_buffer_to_buffer(&self.counts.buffer, 0, &self.read, 0, bytes);
    }

    /// Copies a target's depth to where it can be read while the target is drawn into.
    fn keep(&mut self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, target: &Target) -> wgpu::TextureView {
        use wgpu::TextureUsages as Use;
        if self.depth.as_ref().is_some_and(|depth| depth.size() != target.depth.size()) {
            self.depth = None;
        }
        let make = || texture(gpu, "counted depth", target.size_px, DEPTH_FORMAT, Use::COPY_DST | Use::TEXTURE_BINDING);
        let depth = self.depth.get_or_insert_with(make);
        encoder.copy_texture_to_texture(target.depth.as_image_copy(), depth.as_image_copy(), depth.size());
        view_of(depth)
    }

    fn bind(&self, gpu: &Gpu, depth: &wgpu::TextureView) -> wgpu::BindGroup {
        let resources = [
            self.shapes.buffer.as_entire_binding(),
            self.counts.buffer.as_entire_binding(),
            wgpu::BindingResource::TextureView(depth),
            self.viewport.as_entire_binding(),
        ];
        let mut binding = 0..;
        let entries = resources.map(|resource| wgpu::BindGroupEntry { binding: binding.next().unwrap_or(0), resource });
        let descriptor = wgpu::BindGroupDescriptor { label: Some("count"), layout: &self.layout, entries: &entries };
        gpu.device.create_bind_group(&descriptor)
    }

    /// What was counted. Waits for the GPU.
    fn read(&self, gpu: &Gpu, boxes: usize) -> Result<Vec<Counts>, GpuError> {
        let range = 0..(boxes * size_of::<CountRecord>()) as u64;
        self.read.map_async(wgpu::MapMode::Read, range.clone(), |_| {}); // a failure shows when the range is asked for
        gpu.wait(None)?;
        let mapped = self.read.get_mapped_range(range).map_err(|e| GpuError::Refused(e.to_string()))?;
        let records = mapped.chunks_exact(size_of::<CountRecord>()).map(bytemuck::pod_read_unaligned::<CountRecord>);
        let counts = records.map(Counts::from).collect();
        drop(mapped);
        self.read.unmap();
        Ok(counts)
    }
}

/// Edges of the viewport, which begins before the tile: powers of two that hold it and its guard. What is outside would be cut, with rounding.
fn viewport_px(gpu: &Gpu, size_px: [u32; 2]) -> Result<[u32; 2], GpuError> {
    let largest = 1 << gpu.device.limits().max_texture_dimension_2d.ilog2();
    let limit = largest - 2 * VIEWPORT_GUARD_PX;
    match size_px.into_iter().find(|edge| *edge > limit) {
        Some(edge) => {
            Err(GpuError::Limit { what: "edge of a view to count in, in pixels", value: edge.into(), limit: limit.into() })
        }
        None => Ok(size_px.map(|edge| (edge + 2 * VIEWPORT_GUARD_PX).next_power_of_two())),
    }
}

fn buffer(gpu: &Gpu, label: &str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
}

fn layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    use wgpu::ShaderStages as Stage;
    let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let storage = |read_only| buffer(wgpu::BufferBindingType::Storage { read_only });
    let depth = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Depth,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let entries = [
        entry(0, Stage::VERTEX_FRAGMENT, storage(true)),
        entry(1, Stage::FRAGMENT, storage(false)),
        entry(2, Stage::FRAGMENT, depth),
        entry(3, Stage::VERTEX, buffer(wgpu::BufferBindingType::Uniform)),
    ];
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("count"), entries: &entries })
}

fn pipeline(device: &wgpu::Device, layout: &wgpu::BindGroupLayout) -> wgpu::RenderPipeline {
    let guard_steps = VIEWPORT_GUARD_PX as i32 * SUBPIXELS;
    let constants = format!(
        "const MAX_CORNERS: u32 = {MAX_CORNERS}u;\nconst GUARD_STEPS: i32 = {guard_steps};\nconst LEAST_DEPTH: f32 = {LEAST_DEPTH:e};\n"
    );
    let source = wgpu::ShaderSource::Wgsl((constants + include_str!("shaders/unit.wgsl")).into());
    let module = &device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some("unit"), source });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("count"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    let nothing = wgpu::ColorTargetState { format: COLOR_FORMAT, blend: None, write_mask: wgpu::ColorWrites::empty() };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("count"),
        layout: Some(&layout),
        vertex: wgpu::VertexState { module, entry_point: Some("vertex"), compilation_options: Default::default(), buffers: &[] },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[Some(nothing)],
        }),
        multiview_mask: None,
        cache: None,
    })
}
