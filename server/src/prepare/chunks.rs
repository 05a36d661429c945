//! The table of chunks: equal bytes are kept once.

use std::collections::HashMap;

use mullion_common::scene::{ChunkHash, ChunkId, ChunkKind, ChunkRecord};

/// Chunks in the order in which they first came.
#[derive(Default)]
pub(super) struct ChunkTable {
    pub records: Vec<ChunkRecord>,
    pub data: Vec<u8>,
    by_hash: HashMap<ChunkHash, ChunkId>,
}

impl ChunkTable {
    /// The id of these bytes, added where they are new.
    pub fn add(&mut self, bytes: &[u8], kind: ChunkKind) -> ChunkId {
        let hash = ChunkHash::of(bytes);
        *self.by_hash.entry(hash).or_insert_with(|| {
            let id = ChunkId(self.records.len() as u32);
            self.records.push(ChunkRecord::new(hash, self.data.len() as u64, bytes.len() as u32, kind));
            self.data.extend_from_slice(bytes);
            id
        })
    }

    /// The bytes of a chunk.
    pub fn bytes(&self, id: ChunkId) -> &[u8] {
        let record = &self.records[id.0 as usize];
        &self.data[record.offset as usize..][..record.length as usize]
    }
}
