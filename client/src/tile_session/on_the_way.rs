//! Blobs that were asked for and have not come: those that a frame needs, and those fetched ahead of one. Neither queues by the other's
//! measure.

use std::collections::HashMap;

use mullion_common::scene::ChunkHash;

use super::{FETCH_WINDOW, FETCH_WINDOW_BYTES};
use crate::prefetch::{Load, PREFETCH_WINDOW, PREFETCH_WINDOW_BYTES};

/// Why a blob was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// A frame needed it, or the scene is not open without it.
    Need,
    /// It is of a scene that has grown, and no frame speaks of it yet.
    Growth,
    /// No frame needed it yet.
    Ahead {
        /// What it may take on the GPU, bytes.
        room: u64,
    },
}

#[derive(Debug, Default)]
pub(super) struct OnTheWay {
    blobs: HashMap<ChunkHash, (u64, Purpose)>,
    needed: Load,
    growth: Load,
    ahead: Load,
}

impl OnTheWay {
    pub fn holds(&self, hash: &ChunkHash) -> bool {
        self.blobs.contains_key(hash)
    }

    /// Whether a blob of so many bytes that a frame needs may be asked for.
    pub fn has_room_for(&self, length: u64) -> bool {
        self.needed.count < FETCH_WINDOW && (self.needed.count == 0 || self.needed.bytes + length <= FETCH_WINDOW_BYTES)
    }

    /// Whether a blob of so many bytes that no frame needs yet may be asked for.
    pub fn has_room_ahead_for(&self, length: u64) -> bool {
        let Load { count, bytes, .. } = self.ahead;
        count < PREFETCH_WINDOW && (count == 0 || bytes + length <= PREFETCH_WINDOW_BYTES)
    }

    /// What was fetched ahead.
    pub fn ahead(&self) -> &Load {
        &self.ahead
    }

    pub fn insert(&mut self, hash: ChunkHash, length: u64, purpose: Purpose) {
        self.remove(&hash);
        self.blobs.insert(hash, (length, purpose));
        let (load, room) = self.load_of(purpose);
        (load.count, load.bytes, load.room) = (load.count + 1, load.bytes + length, load.room + room);
    }

    /// Its length and purpose, if it was on its way.
    pub fn remove(&mut self, hash: &ChunkHash) -> Option<(u64, Purpose)> {
        let (length, purpose) = self.blobs.remove(hash)?;
        let (load, room) = self.load_of(purpose);
        (load.count, load.bytes, load.room) = (load.count - 1, load.bytes - length, load.room - room);
        Some((length, purpose))
    }

    pub fn clear(&mut self) {
        self.blobs.clear();
        (self.needed, self.growth, self.ahead) = Default::default();
    }

    fn load_of(&mut self, purpose: Purpose) -> (&mut Load, u64) {
        match purpose {
            Purpose::Need => (&mut self.needed, 0),
            Purpose::Growth => (&mut self.growth, 0),
            Purpose::Ahead { room } => (&mut self.ahead, room),
        }
    }
}
