//! How long the GPU was busy with what, by its own clock.

use super::device::{Gpu, GpuError};

/// Which of a view's two render passes is measured.
#[derive(Clone, Copy, Debug)]
pub(super) enum Pass {
    Draws = 0,
    /// Boxes, or what waited for them.
    Second = 2,
}

const STAMPS: u32 = 4;
const BYTES: u64 = STAMPS as u64 * 8;

/// Stamps of one view's pass.
pub(super) struct Timer {
    stamps: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read: wgpu::Buffer,
    us_per_tick: f64,
}

impl Timer {
    /// None where the GPU has no clock.
    pub fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        use wgpu::BufferUsages as Use;
        let buffer = |usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("times"),
                size: BYTES,
                usage,
                mapped_at_creation: false,
            })
        };
        let stamps = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("times"),
            ty: wgpu::QueryType::Timestamp,
            count: STAMPS,
        });
        let us_per_tick = f64::from(gpu.queue.get_timestamp_period()) / 1e3;
        Some(Self {
            stamps,
            resolved: buffer(Use::QUERY_RESOLVE | Use::COPY_SRC),
            read: buffer(Use::COPY_DST | Use::MAP_READ),
            us_per_tick,
        })
    }

    /// Begin and end of a render pass.
    pub fn stamps(&self, pass: Pass) -> wgpu::RenderPassTimestampWrites<'_> {
        wgpu::RenderPassTimestampWrites {
            query_set: &self.stamps,
            beginning_of_pass_write_index: Some(pass as u32),
            end_of_pass_write_index: Some(pass as u32 + 1),
        }
    }

    /// Fetches the stamps of one or both passes once what was encoded is done. Stamps that were not made never come.
    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder, passes: u32) {
        encoder.resolve_query_set(&self.stamps, 0..2 * passes, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read, 0, BYTES);
    }

    /// Asks for the stamps, to be there after the next wait.
    pub fn ask(&self) {
        self.read.map_async(wgpu::MapMode::Read, .., |_| {}); // a failure shows when the range is asked for
    }

    /// Microseconds from the first stamp to each of the others. After [`Timer::ask`] and a wait.
    pub fn times_us(&self) -> Result<[f64; 3], GpuError> {
        let mapped = self.read.get_mapped_range(..).map_err(|e| GpuError::Refused(e.to_string()))?;
        let mut ticks = [0_u64; STAMPS as usize];
        ticks
            .iter_mut()
            .zip(mapped.chunks_exact(size_of::<u64>()))
            .for_each(|(tick, bytes)| *tick = bytemuck::pod_read_unaligned(bytes));
        drop(mapped);
        self.read.unmap();
        Ok([1, 2, 3].map(|k| ticks[k].saturating_sub(ticks[0]) as f64 * self.us_per_tick))
    }
}
