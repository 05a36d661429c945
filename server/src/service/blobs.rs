//! Bytes by their names: the chunks of a package and the sections that tiles need.

use std::collections::HashMap;
use std::sync::Arc;

use mullion_common::scene::{ChunkHash, ChunkId, Package, PackageError, SectionKind};
use mullion_common::wire::SectionRef;

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
    pub fn new(package: Arc<Package>) -> Result<(Self, Vec<SectionRef>), PackageError> {
        let mut refs = Vec::new();
        let mut sections = Vec::new();
        let chunks = package.scene.manifest.chunks.iter().enumerate();
        let mut places: HashMap<_, _> = chunks.map(|(i, c)| (c.hash, Place::Chunk(ChunkId(i as u32)))).collect();
        for kind in SectionKind::FOR_TILES {
            let bytes = package.scene.section_bytes(kind)?;
            let hash = ChunkHash::of(&bytes);
            refs.push(SectionRef { kind, hash, length: bytes.len() as u64 });
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
