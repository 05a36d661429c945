//! Boxes and solids tested by the GPU's own occlusion queries: each says whether any fragment of one passes the depth test.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::device::{Gpu, GpuError};

const RESULT_BYTES: u64 = 8;

/// Queries that are asked and answered together.
pub(super) struct Queries {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read: wgpu::Buffer,
    /// How many were asked last.
    count: u32,
    /// Whether the results can be taken.
    are_answered: Arc<AtomicBool>,
}

impl Queries {
    /// So many at a time, at most.
    pub fn new(gpu: &Gpu, most: u32) -> Self {
        use wgpu::BufferUsages as Use;
        let buffer = |usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("queries"),
                size: u64::from(most) * RESULT_BYTES,
                usage,
                mapped_at_creation: false,
            })
        };
        let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("queries"),
            ty: wgpu::QueryType::Occlusion,
            count: most,
        });
        let (resolved, read) = (buffer(Use::QUERY_RESOLVE | Use::COPY_SRC), buffer(Use::COPY_DST | Use::MAP_READ));
        Self { set, resolved, read, count: 0, are_answered: Arc::default() }
    }

    /// The pass that they are asked in needs it.
    pub fn set(&self) -> &wgpu::QuerySet {
        &self.set
    }

    /// Asks for each of the first boxes or solids, as `draw` draws them.
    pub fn ask(&mut self, pass: &mut wgpu::RenderPass<'_>, count: u32, draw: impl Fn(&mut wgpu::RenderPass<'_>, u32)) {
        self.count = count.min(self.set.count());
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

    /// Asks for the results, to be there after the next wait, or once [`Queries::are_answered`] says so.
    pub fn want(&self) {
        let range = 0..u64::from(self.count) * RESULT_BYTES;
        let are_answered = Arc::clone(&self.are_answered);
        are_answered.store(false, Ordering::Relaxed);
        // A failure shows when the range is asked for.
        self.read.map_async(wgpu::MapMode::Read, range, move |_| are_answered.store(true, Ordering::Release));
    }

    /// Whether the results are there, as far as the GPU was polled.
    pub fn are_answered(&self) -> bool {
        self.are_answered.load(Ordering::Acquire)
    }

    /// Which are seen. After [`Queries::want`] and a wait.
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
