//! Bytes by their names: the chunks of a package and the sections that tiles need.

use std::collections::HashMap;
use std::sync::Arc;

use mullion_common::scene::{ChunkHash, ChunkId, Package, SectionKind};
use mullion_common::wire::{MAX_TILE_SECTION_BYTES, SectionRef};

use super::ServiceError;

#[derive(Clone, Copy, Debug)]
enum Place {
    Chunk(ChunkId),
    Section(usize),
}

/// All blobs of a scene. Holds the package by reference, and only the small sections twice.
#[derive(Debug)]
pub(super) struct Blobs {
    package: Arc<Package>,
    sections: Vec<Vec<u8>>,
    places: HashMap<ChunkHash, Place>,
}

impl Blobs {
    /// # Errors
    /// When a section is missing, or larger than nodes take.
    pub fn new(package: Arc<Package>) -> Result<(Self, Vec<SectionRef>), ServiceError> {
        let mut refs = Vec::new();
        let mut sections = Vec::new();
        let chunks = package.scene.manifest.chunks.iter().enumerate();
        let mut places: HashMap<_, _> = chunks.map(|(i, c)| (c.hash, Place::Chunk(ChunkId(i as u32)))).collect();
        for kind in SectionKind::FOR_TILES {
            let bytes = package.scene.section_bytes(kind)?;
            let length = sendable(kind, bytes.len() as u64)?;
            let hash = ChunkHash::of(&bytes);
            refs.push(SectionRef { kind, hash, length });
            places.insert(hash, Place::Section(sections.len()));
            sections.push(bytes);
        }
        Ok((Self { package, sections, places }, refs))
    }

    pub fn get(&self, hash: ChunkHash) -> Option<&[u8]> {
        Some(match *self.places.get(&hash)? {
            Place::Chunk(id) => self.package.chunk(id),
            Place::Section(i) => &self.sections[i],
        })
    }
}

/// The length of a section that nodes take. They would leave at the manifest, again and again, for a larger one.
fn sendable(kind: SectionKind, length: u64) -> Result<u64, ServiceError> {
    if length <= MAX_TILE_SECTION_BYTES { Ok(length) } else { Err(ServiceError::SectionTooLarge { kind, length }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_that_no_node_takes_is_an_error_before_the_show() {
        assert_eq!(sendable(SectionKind::Leaves, MAX_TILE_SECTION_BYTES).unwrap(), MAX_TILE_SECTION_BYTES);
        let error = sendable(SectionKind::Leaves, MAX_TILE_SECTION_BYTES + 1).unwrap_err();
        assert_eq!(
            error.to_string(),
            "scene: its section Leaves has 1073741825 bytes; nodes take at most 1073741824: prepare it with fewer, larger leaves"
        );
    }
}
