//! What is kept beside the GPU of each chunk that comes, once it is wanted.

use mullion_common::scene::ChunkId;

/// Nothing of any chunk until [`ByChunk::keep`].
#[derive(Debug)]
pub(super) struct ByChunk<T>(Option<Vec<Box<[T]>>>);

impl<T> Default for ByChunk<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T: Clone> ByChunk<T> {
    /// From now on it is kept, of so many chunks.
    pub fn keep(&mut self, chunks: usize) {
        self.0.get_or_insert_with(|| vec![Box::default(); chunks]);
    }

    /// There are so many chunks now.
    pub fn grow(&mut self, chunks: usize) {
        if let Some(kept) = &mut self.0 {
            kept.resize(chunks, Box::default());
        }
    }

    /// A chunk has come. What is kept of it is found only if it is.
    pub fn put(&mut self, chunk: ChunkId, find: impl FnOnce() -> Box<[T]>) {
        if let Some(kept) = &mut self.0 {
            kept[chunk.0 as usize] = find();
        }
    }

    /// What is kept of a chunk, which may be nothing.
    pub fn of(&self, chunk: ChunkId) -> &[T] {
        self.0.as_ref().map_or(&[], |kept| &kept[chunk.0 as usize])
    }

    /// A chunk has gone.
    pub fn forget(&mut self, chunk: ChunkId) {
        self.put(chunk, Box::default);
    }
}
