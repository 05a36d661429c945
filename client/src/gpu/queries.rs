//! Boxes tested by the GPU's own occlusion queries: each says whether any fragment of a box passes the depth test.

use super::device::{Gpu, GpuError};
use crate::occlusion::rounds::MAX_QUERIES;

const RESULT_BYTES: u64 = 8;
const BYTES: u64 = MAX_QUERIES as u64 * RESULT_BYTES;

/// The queries of one view.
pub(super) struct Queries {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read: wgpu::Buffer,
    /// How many were asked last.
    count: u32,
}

impl Queries {
    pub fn new(gpu: &Gpu) -> Self {
        use wgpu::BufferUsages as Use;
        let buffer = |usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("queries"),
                size: BYTES,
                usage,
                mapped_at_creation: false,
            })
        };
        let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("queries"),
            ty: wgpu::QueryType::Occlusion,
            count: MAX_QUERIES as u32,
        });
        let (resolved, read) = (buffer(Use::QUERY_RESOLVE | Use::COPY_SRC), buffer(Use::COPY_DST | Use::MAP_READ));
        Self { set, resolved, read, count: 0 }
    }

    /// The pass that they are asked in needs it.
    pub fn set(&self) -> &wgpu::QuerySet {
        &self.set
    }

    /// Asks for each of the first boxes, as `draw` draws them.
    pub fn ask(&mut self, pass: &mut wgpu::RenderPass<'_>, count: u32, draw: impl Fn(&mut wgpu::RenderPass<'_>, u32)) {
        self.count = count.min(MAX_QUERIES as u32);
        for at in 0..self.count {
            pass.begin_occlusion_query(at);
            draw(pass, at);
            pass.end_occlusion_query();
        }
    }

    /// Fetches the results once what was encoded is done.
    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.resolve_query_set(&self.set, 0..self.count, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read, 0, u64::from(self.count) * RESULT_BYTES);
    }

    /// Asks for the results, to be there after the next wait.
    pub fn want(&self) {
        let range = 0..u64::from(self.count) * RESULT_BYTES;
        self.read.map_async(wgpu::MapMode::Read, range, |_| {}); // a failure shows when the range is asked for
    }

    /// Which boxes are seen. After [`Queries::want`] and a wait.
    pub fn take(&self, seen: &mut Vec<u32>) -> Result<(), GpuError> {
        let range = 0..u64::from(self.count) * RESULT_BYTES;
        let mapped = self.read.get_mapped_range(range).map_err(|e| GpuError::Refused(e.to_string()))?;
        seen.extend(
            mapped.chunks_exact(size_of::<u64>()).map(|result| u32::from(bytemuck::pod_read_unaligned::<u64>(result) != 0)),
        );
        drop(mapped);
        self.read.unmap();
        Ok(())
    }
}
