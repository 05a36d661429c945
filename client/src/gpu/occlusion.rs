//! Whether leaves are seen beyond what was drawn first: their boxes are drawn against its depth, and draws that wait are let through, all
//! on the GPU.
//!
//! ```text
//! first draws → copies of depth and leaf ids → boxes → is_seen, a word for each draw → release: instance counts → late draws
//! ```
//! A box is drawn larger than it is by [`GROWN_PX`], so that what it holds covers no pixel that it does not. One that reaches the near
//! plane is seen. Conservative but for that: a leaf is taken for hidden only where its whole box is.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Mat4, Vec3};
use mullion_common::geometry::Aabb;
use mullion_common::wall::Projection;

use super::culled::Tested;
use super::device::{Gpu, GpuError};
use super::draws::GrowingBuffer;
use super::targets::{COLOR_FORMAT, DEPTH_FORMAT, IDS_FORMAT, texture, view_of};

/// By how much of a pixel a box is grown on every side: more than the 1/256 to which rasterisers round.
const GROWN_PX: f64 = 1.0 / 8.0;
const WORKGROUP: u32 = 64;

/// A box as the shaders take it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct TestBox {
    min: [f32; 3],
    record: u32,
    max: [f32; 3],
    draw: u32,
    is_mirrored: u32,
    is_late: u32,
    unused: [u32; 2],
}
const _: () = assert!(size_of::<TestBox>() == 48);

/// Grows boxes for one view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grower {
    /// World units by which a box at distance 1 along the view must grow.
    grown_m: f64,
}

/// How an object turns world distances into its own, axis by axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalScale(DVec3);

impl LocalScale {
    pub fn of(world_from_local: &glam::DAffine3) -> Self {
        let local_from_world = world_from_local.matrix3.inverse();
        Self(DVec3::from_array([0, 1, 2].map(|row| local_from_world.row(row).length())))
    }
}

impl Grower {
    pub fn new(projection: &Projection, size_px: [u32; 2]) -> Self {
        let row = |row: usize| projection.clip_from_offset.row(row).truncate();
        let (along, half_px) = (row(3), size_px.map(|edge| f64::from(edge) / 2.0));
        // What moves a point across the screen is the part of the row that is across the view.
        let across = |axis: DVec3| (axis - along * (axis.dot(along) / along.length_squared())).length();
        let px_per_m = (across(row(0)) * half_px[0]).min(across(row(1)) * half_px[1]);
        Self { grown_m: GROWN_PX / px_per_m }
    }

    /// A leaf's box, grown; none where it reaches the near plane or cannot be placed: then it is seen.
    pub fn test(&self, bounds: &Aabb, clip_from_local: &Mat4, scale: &LocalScale) -> Option<(Vec3, Vec3)> {
        let (z, w) = (clip_from_local.row(2).as_dvec4(), clip_from_local.row(3).as_dvec4());
        let (center, half) = (bounds.center(), bounds.size() / 2.0);
        let reach = |row: glam::DVec4| row.truncate().abs().dot(half);
        let (w_center, w_reach) = (w.truncate().dot(center) + w.w, reach(w));
        let grown = scale.0 * (self.grown_m * (w_center + w_reach));
        let (min, max) = ((bounds.min - grown).as_vec3(), (bounds.max + grown).as_vec3());
        let reach_grown = reach(w) + w.truncate().abs().dot(grown);
        let z_max = z.truncate().dot(center) + z.w + reach(z) + z.truncate().abs().dot(grown);
        // Behind the near plane z > w; a little earlier, lest rounding takes a corner there.
        let is_clear = (w_center - reach_grown) * 0.999 > z_max;
        (is_clear && min.is_finite() && max.is_finite()).then_some((min, max))
    }
}

impl TestBox {
    pub fn new((min, max): (Vec3, Vec3), record: u32, draw: u32, is_mirrored: bool, is_late: bool) -> Self {
        let (is_mirrored, is_late) = (u32::from(is_mirrored), u32::from(is_late));
        Self { min: min.to_array(), record, max: max.to_array(), draw, is_mirrored, is_late, unused: [0; 2] }
    }
}

/// What tests boxes.
pub(super) struct BoxTester {
    /// What was drawn first: depth, leaf ids.
    pub first_layout: wgpu::BindGroupLayout,
    boxes_layout: wgpu::BindGroupLayout,
    boxes_pipeline: wgpu::RenderPipeline,
    release_layout: wgpu::BindGroupLayout,
    release_pipeline: wgpu::ComputePipeline,
}

/// A view's part in it.
pub(super) struct First {
    depth: wgpu::Texture,
    leaves: wgpu::Texture,
    pub bindings: wgpu::BindGroup,
    boxes: GrowingBuffer,
    /// A word for each draw.
    seen: GrowingBuffer,
    read: Option<wgpu::Buffer>,
    /// By draw; none for what is in the place of a leaf.
    pub tested: Vec<Option<Tested>>,
}

/// What a pass finds out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub boxes: u32,
    pub draws: u32,
}

impl BoxTester {
    /// None where fragment shaders cannot write, or draws take no counts from buffers.
    pub fn new(gpu: &Gpu) -> Option<Self> {
        let can = gpu.adapter.get_downlevel_capabilities().flags;
        if !gpu.indirect || !can.contains(wgpu::DownlevelFlags::FRAGMENT_WRITABLE_STORAGE) {
            return None;
        }
        use wgpu::ShaderStages as Stage;
        let device = &gpu.device;
        let boxes_layout =
            buffers_layout(device, "boxes", [(Stage::VERTEX, true), (Stage::VERTEX, true), (Stage::FRAGMENT, false)]);
        let release_layout =
            buffers_layout(device, "release", [(Stage::COMPUTE, true), (Stage::COMPUTE, true), (Stage::COMPUTE, false)]);
        let first_layout = first_layout(device);
        Some(Self {
            boxes_pipeline: boxes_pipeline(device, &boxes_layout, &first_layout),
            first_layout,
            boxes_layout,
            release_pipeline: release_pipeline(device, &release_layout),
            release_layout,
        })
    }

    /// Tests a view's boxes against what was drawn first, and lets draws through. `color` is drawn into, but nothing is written.
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (color, first): (&wgpu::TextureView, &First),
        (records, arguments): (&wgpu::Buffer, &wgpu::Buffer),
        extent: Extent,
    ) {
        let seen_bytes = u64::from(extent.draws) * 4;
        encoder.clear_buffer(&first.seen.buffer, 0, None);
        if extent.boxes > 0 {
            let boxes_bytes = u64::from(extent.boxes) * size_of::<TestBox>() as u64;
            let boxes = (&first.boxes.buffer, wgpu::BufferSize::new(boxes_bytes));
            let (records, seen, arguments) = ((records, None), (&first.seen.buffer, None), (arguments, None));
            let tested = bind(gpu, &self.boxes_layout, [records, boxes, seen]);
            let released = bind(gpu, &self.release_layout, [boxes, seen, arguments]);
            self.test(encoder, color, (&tested, &first.bindings), extent.boxes);
            let mut pass =
                encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("release"), timestamp_writes: None });
            pass.set_pipeline(&self.release_pipeline);
            pass.set_bind_group(0, &released, &[]);
            pass.dispatch_workgroups(extent.boxes.div_ceil(WORKGROUP), 1, 1);
        }
        if let Some(read) = first.read.as_ref().filter(|_| seen_bytes > 0) {
            encoder.copy_buffer_to_buffer(&first.seen.buffer, 0, read, 0, seen_bytes);
        }
    }

    fn test(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        color: &wgpu::TextureView,
        (boxes, first): (&wgpu::BindGroup, &wgpu::BindGroup),
        count: u32,
    ) {
        let attachment = wgpu::RenderPassColorAttachment {
            view: color,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
        };
        let color_attachments = &[Some(attachment)];
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("boxes"),
            color_attachments,
            ..Default::default()
        });
        pass.set_pipeline(&self.boxes_pipeline);
        pass.set_bind_group(0, boxes, &[]);
        pass.set_bind_group(1, first, &[]);
        pass.draw(0..36, 0..count);
    }
}

impl First {
    pub fn new(gpu: &Gpu, tester: &BoxTester, size_px: [u32; 2]) -> Self {
        use wgpu::BufferUsages as Buffers;
        use wgpu::TextureUsages as Textures;
        let usage = Textures::COPY_DST | Textures::TEXTURE_BINDING;
        let depth = texture(gpu, "first depth", size_px, DEPTH_FORMAT, usage);
        let leaves = texture(gpu, "first leaf ids", size_px, IDS_FORMAT, usage);
        let views = [view_of(&depth), view_of(&leaves)];
        let entry =
            |at: usize| wgpu::BindGroupEntry { binding: at as u32, resource: wgpu::BindingResource::TextureView(&views[at]) };
        let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("first"),
            layout: &tester.first_layout,
            entries: &[entry(0), entry(1)],
        });
        let boxes = GrowingBuffer::new(gpu, "boxes", Buffers::STORAGE);
        let seen = GrowingBuffer::new(gpu, "is seen", Buffers::STORAGE | Buffers::COPY_SRC);
        Self { depth, leaves, bindings, boxes, seen, read: None, tested: Vec::new() }
    }

    /// Hands over the boxes of a pass, and makes room for what comes of them.
    pub fn write(&mut self, gpu: &Gpu, boxes: &[TestBox], draws: u32) -> Result<(), GpuError> {
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        self.boxes.write(gpu, bytemuck::cast_slice(boxes), limit)?;
        self.seen.reserve(gpu, u64::from(draws) * 4, limit)?;
        let size = self.seen.buffer.size();
        if self.read.as_ref().is_none_or(|read| read.size() != size) {
            let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
            let descriptor = wgpu::BufferDescriptor { label: Some("seen"), size, usage, mapped_at_creation: false };
            self.read = Some(gpu.device.create_buffer(&descriptor));
        }
        Ok(())
    }

    /// Keeps what a target holds now.
    pub fn keep(&self, encoder: &mut wgpu::CommandEncoder, depth: &wgpu::Texture, leaves: &wgpu::Texture) {
        for (from, to) in [(depth, &self.depth), (leaves, &self.leaves)] {
            encoder.copy_texture_to_texture(from.as_image_copy(), to.as_image_copy(), to.size());
        }
    }

    /// Which draws' boxes were seen, a word for each. Waits for the GPU.
    pub fn read_seen(&self, gpu: &Gpu, seen: &mut Vec<u32>) -> Result<(), GpuError> {
        seen.clear();
        let Some(read) = self.read.as_ref().filter(|_| !self.tested.is_empty()) else { return Ok(()) };
        let range = 0..self.tested.len() as u64 * 4;
        read.map_async(wgpu::MapMode::Read, range.clone(), |_| {}); // a failure shows when the range is asked for
        gpu.wait(None)?;
        let mapped = read.get_mapped_range(range).map_err(|e| GpuError::Refused(e.to_string()))?;
        seen.extend(mapped.chunks_exact(size_of::<u32>()).map(bytemuck::pod_read_unaligned::<u32>));
        drop(mapped);
        read.unmap();
        Ok(())
    }
}

fn bind(gpu: &Gpu, layout: &wgpu::BindGroupLayout, buffers: [(&wgpu::Buffer, Option<wgpu::BufferSize>); 3]) -> wgpu::BindGroup {
    let entry = |at: usize| {
        let (buffer, size) = buffers[at];
        let resource = wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size });
        wgpu::BindGroupEntry { binding: at as u32, resource }
    };
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &[entry(0), entry(1), entry(2)] })
}

fn buffers_layout(device: &wgpu::Device, label: &str, of: [(wgpu::ShaderStages, bool); 3]) -> wgpu::BindGroupLayout {
    let entry = |at: usize| {
        let (visibility, read_only) = of[at];
        let ty = wgpu::BufferBindingType::Storage { read_only };
        let ty = wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        wgpu::BindGroupLayoutEntry { binding: at as u32, visibility, ty, count: None }
    };
    let entries = &[entry(0), entry(1), entry(2)];
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries })
}

fn first_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let entry = |binding, sample_type| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty: wgpu::BindingType::Texture { sample_type, view_dimension: wgpu::TextureViewDimension::D2, multisampled: false },
        count: None,
    };
    let entries = &[entry(0, wgpu::TextureSampleType::Depth), entry(1, wgpu::TextureSampleType::Uint)];
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("first"), entries })
}

fn boxes_pipeline(device: &wgpu::Device, boxes: &wgpu::BindGroupLayout, first: &wgpu::BindGroupLayout) -> wgpu::RenderPipeline {
    let source = wgpu::ShaderSource::Wgsl(concat!(include_str!("shaders/box.wgsl"), include_str!("shaders/boxes.wgsl")).into());
    let module = &device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some("boxes"), source });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("boxes"),
        bind_group_layouts: &[Some(boxes), Some(first)],
        immediate_size: 0,
    });
    let nothing = wgpu::ColorTargetState { format: COLOR_FORMAT, blend: None, write_mask: wgpu::ColorWrites::empty() };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("boxes"),
        layout: Some(&layout),
        vertex: wgpu::VertexState { module, entry_point: Some("vertex"), compilation_options: Default::default(), buffers: &[] },
        primitive: wgpu::PrimitiveState { cull_mode: Some(wgpu::Face::Back), ..Default::default() },
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

fn release_pipeline(device: &wgpu::Device, layout: &wgpu::BindGroupLayout) -> wgpu::ComputePipeline {
    let source = wgpu::ShaderSource::Wgsl(concat!(include_str!("shaders/box.wgsl"), include_str!("shaders/release.wgsl")).into());
    let module = &device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some("release"), source });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("release"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("release"),
        layout: Some(&layout),
        module,
        entry_point: Some("release"),
        compilation_options: Default::default(),
        cache: None,
    })
}
