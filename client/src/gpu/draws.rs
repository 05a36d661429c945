//! A pass as the GPU takes it: a record per object, an instance and a draw per leaf, and runs of draws that share
//! their state.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::device::{Gpu, GpuError};
use super::pipelines::PipelineKey;

/// What the vertex shader knows of a leaf.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Instance {
    pub base_color: [f32; 4],
    /// Index of its `clip_from_local` among the records.
    pub record: u32,
    pub leaf: u32,
    /// Fragments of masked leaves with less alpha are dropped.
    pub alpha_cutoff: f32,
}
const _: () = assert!(size_of::<Instance>() == 28);

/// Arguments of an indexed draw, as Vulkan, Metal, DX12 and GL take them from a buffer.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct DrawArguments {
    pub index_count: u32,
    pub instance_count: u32,
    pub first_index: u32,
    pub base_vertex: i32,
    pub first_instance: u32,
}
const _: () = assert!(size_of::<DrawArguments>() == 20);

/// What consecutive draws share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct State {
    pub pipeline: PipelineKey,
    pub texture: u32,
    /// Of its vertices. Without meaning for cuts.
    pub page: u32,
    pub indices: Indices,
}

/// Where a draw's indices are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Indices {
    /// In the page of its vertices.
    Page,
    /// Among those of leaves that are not drawn whole; vertices are the page's.
    Parts,
    /// Beside the vertices of cuts; 32 bits each.
    Cuts,
}

/// Draws `start..end` of one state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Batch {
    pub state: State,
    pub start: u32,
    pub end: u32,
}

/// A pass, on the CPU. Its memory is kept from pass to pass.
#[derive(Default)]
pub(super) struct DrawList {
    /// `clip_from_local`, by column.
    pub records: Vec<[f32; 16]>,
    pub instances: Vec<Instance>,
    pub arguments: Vec<DrawArguments>,
    pub batches: Vec<Batch>,
    /// Indices of leaves that are not drawn whole, leaf by leaf.
    pub part_indices: Vec<u16>,
    pub triangles: u64,
    /// How many draws are cuts in the place of objects.
    pub cut_draws: u32,
    /// Draws that are boxes in the place of leaves.
    pub stand_ins: Range<u32>,
    /// Draws from here on share no batch with those before.
    turn_start: u32,
}

impl DrawList {
    pub fn clear(&mut self) {
        self.records.clear();
        self.instances.clear();
        self.arguments.clear();
        self.batches.clear();
        self.part_indices.clear();
        self.triangles = 0;
        self.cut_draws = 0;
        self.stand_ins = 0..0;
        self.turn_start = 0;
    }

    /// What follows shares no batch with what is there.
    pub fn next_turn(&mut self) {
        self.turn_start = self.arguments.len() as u32;
    }

    /// Notes the indices of some triangles of a leaf: where they are, and how many.
    pub fn part_of(&mut self, indices: &[u16], triangles: &[u16]) -> (u32, u32) {
        let first = self.part_indices.len() as u32;
        let corners = triangles.iter().filter_map(|number| indices.get(usize::from(*number) * 3..)?.first_chunk::<3>());
        self.part_indices.extend(corners.flatten());
        (first, self.part_indices.len() as u32 - first)
    }

    pub fn push(&mut self, state: State, instance: Instance, indices: (u32, u32), base_vertex: u32) {
        let draw = self.arguments.len() as u32;
        let (first_index, index_count) = indices;
        let base_vertex = base_vertex as i32; // pages are far smaller than 2³¹ vertices
        self.arguments.push(DrawArguments { index_count, instance_count: 1, first_index, base_vertex, first_instance: draw });
        self.instances.push(instance);
        self.triangles += u64::from(index_count / 3);
        match self.batches.last_mut() {
            Some(batch) if batch.state == state && batch.start >= self.turn_start => batch.end = draw + 1,
            _ => self.batches.push(Batch { state, start: draw, end: draw + 1 }),
        }
    }
}

/// A draw list's buffers on the GPU.
pub(super) struct DrawBuffers {
    pub records: GrowingBuffer,
    pub instances: GrowingBuffer,
    pub arguments: GrowingBuffer,
    pub part_indices: GrowingBuffer,
}

impl DrawBuffers {
    pub fn new(gpu: &Gpu) -> Self {
        use wgpu::BufferUsages as Use;
        Self {
            records: GrowingBuffer::new(gpu, "records", Use::STORAGE),
            instances: GrowingBuffer::new(gpu, "instances", Use::VERTEX),
            arguments: GrowingBuffer::new(gpu, "draws", Use::INDIRECT | Use::STORAGE),
            part_indices: GrowingBuffer::new(gpu, "indices of parts", Use::INDEX),
        }
    }

    pub fn write(&mut self, gpu: &Gpu, list: &mut DrawList) -> Result<(), GpuError> {
        let limits = gpu.device.limits();
        // Buffer writes come in multiples of four bytes: two indices.
        list.part_indices.resize(list.part_indices.len().next_multiple_of(2), 0);
        self.part_indices.write(gpu, bytemuck::cast_slice(&list.part_indices), limits.max_buffer_size)?;
        self.records.write(gpu, bytemuck::cast_slice(&list.records), limits.max_storage_buffer_binding_size)?;
        self.instances.write(gpu, bytemuck::cast_slice(&list.instances), limits.max_buffer_size)?;
        if gpu.indirect {
            self.arguments.write(gpu, bytemuck::cast_slice(&list.arguments), limits.max_buffer_size)?;
        }
        Ok(())
    }
}

/// A buffer that is replaced by a larger one when its content no longer fits.
pub(super) struct GrowingBuffer {
    label: &'static str,
    usage: wgpu::BufferUsages,
    pub buffer: wgpu::Buffer,
    /// Changes with the buffer.
    pub generation: u64,
}

impl GrowingBuffer {
    const LEAST_BYTES: u64 = 4096;

    pub fn new(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages) -> Self {
        let usage = usage | wgpu::BufferUsages::COPY_DST;
        Self { label, usage, buffer: create(gpu, label, Self::LEAST_BYTES, usage), generation: 0 }
    }

    pub fn write(&mut self, gpu: &Gpu, bytes: &[u8], limit: u64) -> Result<(), GpuError> {
        self.reserve(gpu, bytes.len() as u64, limit)?;
        if !bytes.is_empty() {
            gpu.queue.write_buffer(&self.buffer, 0, bytes);
        }
        Ok(())
    }

    /// Makes room, and forgets what was there where it must grow.
    pub fn reserve(&mut self, gpu: &Gpu, needed: u64, limit: u64) -> Result<(), GpuError> {
        if needed > limit {
            return Err(GpuError::Limit { what: self.label, value: needed, limit });
        }
        if needed > self.buffer.size() {
            let size = needed.next_power_of_two().min(limit & !3);
            self.buffer = create(gpu, self.label, size, self.usage);
            self.generation += 1;
        }
        Ok(())
    }
}

fn create(gpu: &Gpu, label: &str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
}
