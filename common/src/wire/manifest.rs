//! Which scene the frames are of: its tables, by the names of their bytes.
//!
//! A scene has parts: the one that a show began with, and one for each time that it grew. A part has one section of each kind in
//! [`SectionKind::FOR_TILES`]; sections of one kind are joined in the order in which they are named. What is in one part keeps its
//! numbers when another comes. A tessellation and hierarchies of detail are of the first part, and hold for the scene that it has become.

use serde::{Deserialize, Serialize};

use super::{MAX_SECTIONS, MAX_TILE_SECTION_BYTES, WireError, codec, within};
use crate::scene::{BlobRef, ChunkHash, SectionKind};

/// A section of the scene that tiles need, fetched as a blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SectionRef {
    /// What it holds.
    pub kind: SectionKind,
    /// Name of its bytes.
    pub hash: ChunkHash,
    /// How many bytes.
    pub length: u64,
}

/// Which scene the frames are of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// Frames of this epoch speak of this scene. Of a connection's manifests, each has one more than the one before.
    pub epoch: u32,
    /// What to fetch before anything can be drawn. On one connection, each manifest begins with the sections of the one before.
    #[serde(deserialize_with = "codec::list")]
    pub sections: Vec<SectionRef>,
    /// The tessellation of the scene that the show began with, where it has one; the same in all manifests of a connection.
    pub tessellation: Option<SectionRef>,
    /// The bytes of the [`HierarchyIndex`](crate::scene::HierarchyIndex) of the scene that the show began with, where it has hierarchies of detail; the
    /// same in all manifests of a connection.
    pub hierarchies: Option<BlobRef>,
}

impl Manifest {
    pub(super) fn check(&self) -> Result<(), WireError> {
        within("sections", self.sections.len(), MAX_SECTIONS)?;
        let index = self.hierarchies.map(|blob| blob.length.into());
        let longest = self.sections.iter().chain(&self.tessellation).map(|s| s.length).chain(index).max().unwrap_or(0);
        if longest > MAX_TILE_SECTION_BYTES {
            return Err(WireError::Limit { what: "bytes of a section", value: longest, cap: MAX_TILE_SECTION_BYTES });
        }
        let is_one = self.tessellation.is_none_or(|section| section.kind == SectionKind::Tessellation);
        if is_one { Ok(()) } else { Err(WireError::Bulk { what: "tessellation" }) }
    }

    /// The sections of each part, in the order of [`SectionKind::FOR_TILES`].
    ///
    /// # Errors
    /// When there is no part, or one lacks a section.
    pub fn parts(&self) -> Result<Vec<[SectionRef; 4]>, String> {
        let of_kind = |kind| self.sections.iter().filter(move |section| section.kind == kind);
        let count = SectionKind::FOR_TILES.into_iter().map(|kind| of_kind(kind).count()).max().unwrap_or(0);
        let mut parts = Vec::with_capacity(count);
        let mut kinds = SectionKind::FOR_TILES.map(of_kind);
        for _ in 0..count.max(1) {
            let [a, b, c, d] = kinds.each_mut().map(Iterator::next);
            let [Some(a), Some(b), Some(c), Some(d)] = [a, b, c, d] else {
                let lacking = [a, b, c, d].iter().position(Option::is_none).unwrap_or_default();
                return Err(format!("the manifest lacks section {:?}", SectionKind::FOR_TILES[lacking]));
            };
            parts.push([*a, *b, *c, *d]);
        }
        Ok(parts)
    }
}
