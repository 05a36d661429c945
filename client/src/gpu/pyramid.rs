//! The farthest depth of squares of pixels (Greene, Kass, Miller 1993), and which boxes are behind all of it: those need not be drawn to
//! know that they are hidden. Conservative: a box is dropped only where every pixel around it is nearer.
//!
//! Level 1 has a texel for 2 by 2 pixels, and so on up to one texel for all of them. Sizes are rounded up, so that pixels along odd edges
//! count.

use bytemuck::{Pod, Zeroable};

use super::bindings::{Kind, bind, compute, layout, module};
use super::device::Gpu;
use crate::occlusion::DEPTH_SLACK;

/// Most levels: pictures of up to 65 536 pixels along an edge.
const MAX_LEVELS: usize = 16;
const WORKGROUP_PX: u32 = 8;
/// Bytes between steps in their buffer: what every GPU takes as an offset.
const STEP_BYTES: u64 = 256;

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Step {
    below: [u32; 3],
    unused: u32,
    made: [u32; 3],
    unused_too: u32,
}
const _: () = assert!(size_of::<Step>() == 32);

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Extent {
    size_px: [u32; 2],
    level_count: u32,
    unused: u32,
    table: [[u32; 4]; MAX_LEVELS],
}
const _: () = assert!(size_of::<Extent>() == 16 + 16 * MAX_LEVELS);

/// Where each level begins in the buffer, its width and its height, from level 1 on.
pub(super) fn levels(size_px: [u32; 2]) -> Vec<[u32; 3]> {
    let mut levels: Vec<[u32; 3]> = Vec::new();
    let (mut begin, [mut width, mut height]) = (0, size_px);
    loop {
        (width, height) = (width.div_ceil(2), height.div_ceil(2));
        levels.push([begin, width, height]);
        begin += width * height;
        if (width, height) == (1, 1) {
            return levels;
        }
    }
}

/// Makes pyramids, and sifts boxes by them.
pub(super) struct PyramidMaker {
    step_layout: wgpu::BindGroupLayout,
    extent_layout: wgpu::BindGroupLayout,
    first_level: wgpu::ComputePipeline,
    next_level: wgpu::ComputePipeline,
    sift: wgpu::ComputePipeline,
}

/// The pyramid of one view.
pub(super) struct Pyramid {
    /// Of each level's step, and how many workgroups it takes.
    steps: Vec<(wgpu::BindGroup, [u32; 2])>,
    extent: wgpu::BindGroup,
}

impl PyramidMaker {
    /// `boxes_layout`: what boxes are sifted from and into. `first_layout`: depth, among others.
    pub fn new(device: &wgpu::Device, boxes_layout: &wgpu::BindGroupLayout, first_layout: &wgpu::BindGroupLayout) -> Self {
        let on = wgpu::ShaderStages::COMPUTE;
        let step_layout = layout(device, "step", &[(on, Kind::Uniform), (on, Kind::Write)]);
        let extent_layout = layout(device, "extent", &[(on, Kind::Read), (on, Kind::Uniform)]);
        let pyramid = module(device, "pyramid", include_str!("shaders/pyramid.wgsl"));
        let sift = module(device, "sift", concat!(include_str!("shaders/box.wgsl"), include_str!("shaders/sift.wgsl")));
        let reduces = [&step_layout, first_layout];
        Self {
            first_level: compute(device, &pyramid, "reduce", &reduces, &[("of_picture", 1.0)]),
            next_level: compute(device, &pyramid, "reduce", &reduces, &[("of_picture", 0.0)]),
            sift: compute(device, &sift, "sift", &[boxes_layout, &extent_layout], &[("DEPTH_SLACK", DEPTH_SLACK)]),
            step_layout,
            extent_layout,
        }
    }

    /// The pyramid of a view of this size.
    pub fn pyramid(&self, gpu: &Gpu, size_px: [u32; 2]) -> Pyramid {
        let levels = levels(size_px);
        let texels = levels.iter().map(|[_, width, height]| u64::from(width * height)).sum::<u64>();
        let buffer = |label, size, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
        };
        use wgpu::BufferUsages as Use;
        let values = buffer("pyramid", texels * 4, Use::STORAGE);
        let steps = buffer("steps", levels.len() as u64 * STEP_BYTES, Use::UNIFORM | Use::COPY_DST);
        let extent = buffer("extent", size_of::<Extent>() as u64, Use::UNIFORM | Use::COPY_DST);
        let mut table = [[0; 4]; MAX_LEVELS];
        let mut below = [0, size_px[0], size_px[1]];
        let mut bound = Vec::new();
        for (at, &made) in levels.iter().enumerate() {
            table[at][..3].copy_from_slice(&made);
            let step = Step { below, unused: 0, made, unused_too: 0 };
            let offset = at as u64 * STEP_BYTES;
            gpu.queue.write_buffer(&steps, offset, bytemuck::bytes_of(&step));
            let size = wgpu::BufferSize::new(size_of::<Step>() as u64);
            let step = wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &steps, offset, size });
            let workgroups = [made[1], made[2]].map(|edge| edge.div_ceil(WORKGROUP_PX));
            bound.push((bind(gpu, &self.step_layout, &[step, values.as_entire_binding()]), workgroups));
            below = made;
        }
        let level_count = levels.len() as u32;
        gpu.queue.write_buffer(&extent, 0, bytemuck::bytes_of(&Extent { size_px, level_count, unused: 0, table }));
        Pyramid {
            steps: bound,
            extent: bind(gpu, &self.extent_layout, &[values.as_entire_binding(), extent.as_entire_binding()]),
        }
    }

    /// Builds the pyramid of what was drawn first, and sifts boxes by it.
    pub fn encode(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        pyramid: &Pyramid,
        first: &wgpu::BindGroup,
        boxes: (&wgpu::BindGroup, u32),
    ) {
        pass.set_bind_group(1, first, &[]);
        for (at, (step, [columns, rows])) in pyramid.steps.iter().enumerate() {
            if at < 2 {
                pass.set_pipeline(if at == 0 { &self.first_level } else { &self.next_level });
            }
            pass.set_bind_group(0, step, &[]);
            pass.dispatch_workgroups(*columns, *rows, 1);
        }
        let (boxes, workgroups) = boxes;
        pass.set_pipeline(&self.sift);
        pass.set_bind_group(0, boxes, &[]);
        pass.set_bind_group(1, &pyramid.extent, &[]);
        pass.dispatch_workgroups(workgroups, 1, 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_cover_odd_edges_up_to_one_texel() {
        assert_eq!(levels([5, 3]), [[0, 3, 2], [6, 2, 1], [8, 1, 1]]);
        assert_eq!(levels([1, 1]), [[0, 1, 1]]);
        assert!(levels([65_536, 1]).len() <= MAX_LEVELS);
        for size_px in [[143, 91], [650, 650], [1, 517], [8192, 3]] {
            let mut below = size_px;
            for [_, width, height] in levels(size_px) {
                assert!([width, height].iter().zip(below).all(|(edge, below)| 2 * edge >= below && *edge <= below.div_ceil(2)));
                below = [width, height];
            }
            assert_eq!(below, [1, 1]);
        }
    }
}
