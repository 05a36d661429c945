//! Which leaves have a pixel in a view's picture of leaf ids.
//!
//! Exact, and cheaper than to draw the boxes of what was drawn: each pixel is looked at once.

use bytemuck::{Pod, Zeroable};

use super::bindings::{Kind, bind, compute, layout, module};
use super::device::{Gpu, GpuError};
use super::draws::GrowingBuffer;

/// Edge of a workgroup in threads, and the pixels of a row that are a thread's.
const WORKGROUP: u32 = 8;
const RUN_PX: u32 = 8;

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Glance {
    size_px: [u32; 2],
    number: u32,
    unused: u32,
}
const _: () = assert!(size_of::<Glance>() == 16);

/// Looks at pictures.
pub(super) struct Glancer {
    layout: wgpu::BindGroupLayout,
    look: wgpu::ComputePipeline,
    glance: wgpu::Buffer,
    /// By leaf: the number of the picture in which a pixel of it was last found. Shared by views, whose pictures are numbered as one.
    pub last_seen: GrowingBuffer,
}

impl Glancer {
    pub fn new(gpu: &Gpu) -> Self {
        let on = wgpu::ShaderStages::COMPUTE;
        let layout = layout(&gpu.device, "glance", &[(on, Kind::Uniform), (on, Kind::Write), (on, Kind::Numbers)]);
        let module = module(&gpu.device, "glance", include_str!("shaders/glance.wgsl"));
        let glance = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("glance"),
            size: size_of::<Glance>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Self {
            look: compute(&gpu.device, &module, "look", &[&layout], &[]),
            layout,
            glance,
            last_seen: GrowingBuffer::new(gpu, "last seen", wgpu::BufferUsages::STORAGE),
        }
    }

    /// Makes room for so many leaves.
    pub fn reserve(&mut self, gpu: &Gpu, leaves: usize) -> Result<(), GpuError> {
        self.last_seen.reserve(gpu, leaves as u64 * 4, gpu.device.limits().max_storage_buffer_binding_size)
    }

    /// Binds a picture of leaf ids.
    pub fn bind(&self, gpu: &Gpu, ids: &wgpu::TextureView) -> wgpu::BindGroup {
        let [glance, last_seen] = [&self.glance, &self.last_seen.buffer].map(wgpu::Buffer::as_entire_binding);
        bind(gpu, &self.layout, &[glance, last_seen, wgpu::BindingResource::TextureView(ids)])
    }

    /// Looks at a picture, by its number, of this size. One in a submission: what it takes is handed over as that begins.
    pub fn encode(&self, gpu: &Gpu, pass: &mut wgpu::ComputePass<'_>, picture: &wgpu::BindGroup, glance: (u32, [u32; 2])) {
        let (number, size_px) = glance;
        gpu.queue.write_buffer(&self.glance, 0, bytemuck::bytes_of(&Glance { size_px, number, unused: 0 }));
        pass.set_pipeline(&self.look);
        pass.set_bind_group(0, picture, &[]);
        pass.dispatch_workgroups(size_px[0].div_ceil(WORKGROUP * RUN_PX), size_px[1].div_ceil(WORKGROUP), 1);
    }
}
