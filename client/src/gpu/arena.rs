//! Geometry of resident chunks: a few pages, each a vertex and an index buffer, shared by many chunks.
//!
//! Draws from one page need no change of state. Pages double in size up to a cap, so that small scenes stay small
//! and large ones need few pages. What is freed is used again; pages themselves stay.

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};

use super::device::Gpu;

/// A vertex as the shader gets it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Vertex {
    pub position: [f32; 3],
    pub uv: [f32; 2],
    pub color: [u8; 4],
}
const _: () = assert!(size_of::<Vertex>() == 24);

/// Vertices in the first page; each next one has twice as many, up to the cap.
const FIRST_PAGE_VERTICES: u32 = 1 << 16;
/// Vertices in the largest regular page: 96 MiB.
const LARGEST_PAGE_VERTICES: u32 = 1 << 22;
/// Indices that a page has room for, per vertex.
const INDICES_PER_VERTEX: u32 = 4;
/// Bytes gathered before they are handed to the GPU.
const PENDING_BYTES: usize = 4 << 20;
/// Bytes handed over before the GPU is told to take them, so that staging memory is freed.
const SUBMIT_BYTES: usize = 64 << 20;

/// Where a chunk's geometry lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slot {
    pub page: u32,
    pub first_vertex: u32,
    pub vertex_count: u32,
    pub first_index: u32,
    pub index_count: u32,
}

impl Slot {
    /// Bytes that the geometry takes.
    pub fn bytes(&self) -> u64 {
        u64::from(self.vertex_count) * size_of::<Vertex>() as u64 + u64::from(padded(self.index_count)) * 2
    }
}

/// Buffer writes come in multiples of four bytes: two indices.
fn padded(index_count: u32) -> u32 {
    index_count.next_multiple_of(2)
}

/// Why there is no room: the chunk needs a buffer of that size.
#[derive(Debug)]
pub(super) struct TooLarge {
    pub bytes: u64,
    pub limit: u64,
}

pub(super) struct Page {
    pub vertices: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    free_vertices: FreeList,
    free_indices: FreeList,
}

/// All pages, and what waits to be written into them.
pub(super) struct Arena {
    pages: Vec<Page>,
    pending: Pending,
}

#[derive(Default)]
struct Pending {
    page: u32,
    first_vertex: u32,
    first_index: u32,
    vertices: Vec<Vertex>,
    indices: Vec<u16>,
    /// Handed over since the last submission.
    unsubmitted_bytes: usize,
}

impl Arena {
    pub fn new() -> Self {
        Self { pages: Vec::new(), pending: Pending::default() }
    }

    pub fn page(&self, page: u32) -> &Page {
        &self.pages[page as usize]
    }

    /// Finds room and queues the bytes; they are on the GPU after [`Arena::flush`].
    pub fn insert(
        &mut self,
        gpu: &Gpu,
        vertices: impl ExactSizeIterator<Item = Vertex>,
        indices: &[u16],
    ) -> Result<Slot, TooLarge> {
        let slot = self.allocate(gpu, vertices.len() as u32, indices.len() as u32)?;
        let follows = slot.page == self.pending.page
            && slot.first_vertex == self.pending.first_vertex + self.pending.vertices.len() as u32
            && slot.first_index == self.pending.first_index + self.pending.indices.len() as u32;
        if !follows {
            self.write_pending(gpu);
            (self.pending.page, self.pending.first_vertex, self.pending.first_index) =
                (slot.page, slot.first_vertex, slot.first_index);
        }
        self.pending.vertices.extend(vertices);
        self.pending.indices.extend_from_slice(indices);
        self.pending.indices.resize(self.pending.indices.len().next_multiple_of(2), 0);
        if size_of_val(self.pending.vertices.as_slice()) + size_of_val(self.pending.indices.as_slice()) > PENDING_BYTES {
            self.write_pending(gpu);
        }
        Ok(slot)
    }

    /// Frees a chunk's room.
    pub fn remove(&mut self, slot: Slot) {
        let page = &mut self.pages[slot.page as usize];
        page.free_vertices.give(slot.first_vertex, slot.vertex_count);
        page.free_indices.give(slot.first_index, padded(slot.index_count));
    }

    /// Hands everything queued to the GPU: commands submitted from now on see it.
    pub fn flush(&mut self, gpu: &Gpu) {
        self.write_pending(gpu);
        self.pending.unsubmitted_bytes = 0;
    }

    fn write_pending(&mut self, gpu: &Gpu) {
        let pending = &mut self.pending;
        if pending.vertices.is_empty() && pending.indices.is_empty() {
            return;
        }
        let page = &self.pages[pending.page as usize];
        let vertices: &[u8] = bytemuck::cast_slice(&pending.vertices);
        let indices: &[u8] = bytemuck::cast_slice(&pending.indices);
        gpu.queue.write_buffer(&page.vertices, u64::from(pending.first_vertex) * size_of::<Vertex>() as u64, vertices);
        gpu.queue.write_buffer(&page.indices, u64::from(pending.first_index) * 2, indices);
        pending.unsubmitted_bytes += vertices.len() + indices.len();
        pending.first_vertex += pending.vertices.len() as u32;
        pending.first_index += pending.indices.len() as u32;
        pending.vertices.clear();
        pending.indices.clear();
        if pending.unsubmitted_bytes > SUBMIT_BYTES {
            pending.unsubmitted_bytes = 0;
            gpu.submit(None);
        }
    }

    fn allocate(&mut self, gpu: &Gpu, vertex_count: u32, index_count: u32) -> Result<Slot, TooLarge> {
        let found = (self.pages.iter_mut().enumerate())
            .find_map(|(i, page)| page.allocate(vertex_count, index_count).map(|(v, x)| (i as u32, v, x)));
        let (page, first_vertex, first_index) = match found {
            Some(found) => found,
            None => {
                let mut page = self.new_page(gpu, vertex_count, index_count)?;
                // A new page has room for what it was made for.
                let (first_vertex, first_index) = page.allocate(vertex_count, index_count).unwrap_or_default();
                self.pages.push(page);
                (self.pages.len() as u32 - 1, first_vertex, first_index)
            }
        };
        Ok(Slot { page, first_vertex, vertex_count, first_index, index_count })
    }

    fn new_page(&self, gpu: &Gpu, vertex_count: u32, index_count: u32) -> Result<Page, TooLarge> {
        let limit = gpu.device.limits().max_buffer_size;
        let most = u32::try_from(limit / size_of::<Vertex>() as u64).unwrap_or(u32::MAX);
        let regular = page_vertices(self.pages.len()).min(most);
        let vertices = regular.max(vertex_count);
        let indices = (regular * INDICES_PER_VERTEX).max(padded(index_count));
        let buffer = |label, bytes: u64, usage| {
            if bytes > limit {
                return Err(TooLarge { bytes, limit });
            }
            let usage = usage | wgpu::BufferUsages::COPY_DST;
            let descriptor = wgpu::BufferDescriptor { label: Some(label), size: bytes, usage, mapped_at_creation: false };
            Ok(gpu.device.create_buffer(&descriptor))
        };
        Ok(Page {
            vertices: buffer("vertices", u64::from(vertices) * size_of::<Vertex>() as u64, wgpu::BufferUsages::VERTEX)?,
            indices: buffer("indices", u64::from(indices) * 2, wgpu::BufferUsages::INDEX)?,
            free_vertices: FreeList::new(vertices),
            free_indices: FreeList::new(indices),
        })
    }
}

/// Vertices of the page that follows so many.
fn page_vertices(pages: usize) -> u32 {
    const DOUBLINGS: usize = (LARGEST_PAGE_VERTICES / FIRST_PAGE_VERTICES).ilog2() as usize;
    const _: () = assert!(FIRST_PAGE_VERTICES << DOUBLINGS == LARGEST_PAGE_VERTICES, "doubling meets the cap");
    FIRST_PAGE_VERTICES << pages.min(DOUBLINGS)
}

impl Page {
    fn allocate(&mut self, vertex_count: u32, index_count: u32) -> Option<(u32, u32)> {
        let first_vertex = self.free_vertices.take(vertex_count)?;
        let Some(first_index) = self.free_indices.take(padded(index_count)) else {
            self.free_vertices.give(first_vertex, vertex_count);
            return None;
        };
        Some((first_vertex, first_index))
    }
}

/// Free ranges of a page, by start; neighbours are merged. First fit: low addresses fill up first.
#[derive(Debug)]
struct FreeList {
    ranges: BTreeMap<u32, u32>,
    /// No free range is longer. Spares the search of a full page.
    longest: u32,
}

impl FreeList {
    fn new(count: u32) -> Self {
        Self { ranges: BTreeMap::from([(0, count)]), longest: count }
    }

    fn take(&mut self, count: u32) -> Option<u32> {
        if count == 0 {
            return Some(0);
        }
        if count > self.longest {
            return None;
        }
        let Some((&start, &len)) = self.ranges.iter().find(|&(_, &len)| len >= count) else {
            self.longest = count - 1;
            return None;
        };
        self.ranges.remove(&start);
        if len > count {
            self.ranges.insert(start + count, len - count);
        }
        Some(start)
    }

    fn give(&mut self, mut start: u32, mut count: u32) {
        if count == 0 {
            return;
        }
        if let Some(after) = self.ranges.remove(&(start + count)) {
            count += after;
        }
        if let Some((&before, len)) = self.ranges.range_mut(..start).next_back()
            && before + *len == start
        {
            *len += count;
            (start, count) = (before, *len);
        } else {
            self.ranges.insert(start, count);
        }
        debug_assert_eq!(self.ranges.get(&start), Some(&count));
        self.longest = self.longest.max(count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn pages_double_up_to_the_cap_and_stay_there() {
        assert_eq!([0, 1, 5].map(page_vertices), [1 << 16, 1 << 17, 1 << 21]);
        assert_eq!([6, 15, 16, 40, usize::MAX].map(page_vertices), [LARGEST_PAGE_VERTICES; 5]);
    }

    proptest! {
        /// Against a map of who owns each place.
        #[test]
        fn ranges_are_lent_to_one_at_a_time(steps in proptest::collection::vec((1..9u32, any::<bool>()), 1..60)) {
            let mut list = FreeList::new(40);
            let mut lent: Vec<(u32, u32)> = Vec::new();
            let mut taken = [false; 40];
            for (count, give_back) in steps {
                if give_back && !lent.is_empty() {
                    let (start, count) = lent.swap_remove(count as usize % lent.len());
                    list.give(start, count);
                    taken[start as usize..][..count as usize].fill(false);
                } else {
                    let fits = taken.windows(count as usize).position(|w| w.iter().all(|t| !t));
                    prop_assert_eq!(list.take(count), fits.map(|f| f as u32));
                    if let Some(start) = fits {
                        lent.push((start as u32, count));
                        taken[start..][..count as usize].fill(true);
                    }
                }
            }
            for (start, count) in lent.drain(..) {
                list.give(start, count);
            }
            prop_assert_eq!(&list.ranges, &BTreeMap::from([(0, 40)]));
        }
    }
}
