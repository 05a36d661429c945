//! All hierarchies of a scene, as a section of its package: which objects each stands for, and its base and blocks as they are sent.
//!
//! ```text
//! "MLH1"  hierarchies u32
//! per hierarchy: objects u32  blobs u32, then the objects u32 and the blobs' lengths u32
//! the blobs, one behind the other
//! ```

use std::ops::Range;

use super::{MAX_HIERARCHY_VERTICES, VertexHierarchyError};
use crate::scene::{Hierarchy, ObjectId, SceneManifest};

const MAGIC: u32 = u32::from_le_bytes(*b"MLH1");
/// Most hierarchies of a scene.
pub const MAX_HIERARCHIES: u32 = 1 << 24;

type Error = VertexHierarchyError;

/// A hierarchy of a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HierarchyEntry {
    /// The objects that it stands for, ascending: all of their own leaves, and nothing else.
    pub objects: Vec<ObjectId>,
    /// Where the base lies among the table's bytes, and behind it the blocks.
    blobs: Vec<Range<usize>>,
}

/// Which objects have a hierarchy already.
pub(super) struct Owners {
    has_one: Vec<bool>,
}

impl Owners {
    /// In a scene of so many objects, none.
    pub fn new(object_count: usize) -> Self {
        Self { has_one: vec![false; object_count] }
    }

    /// Gives these objects to a hierarchy, or says why they cannot be its own.
    pub fn claim(&mut self, objects: &[ObjectId]) -> Result<(), &'static str> {
        let mut is_free =
            |object: &ObjectId| self.has_one.get_mut(object.0 as usize).is_some_and(|has_one| !std::mem::replace(has_one, true));
        let is_good = objects.is_sorted_by(|a, b| a.0 < b.0) && objects.iter().all(&mut is_free);
        if is_good { Ok(()) } else { Err("an object is not there, has another one, or does not ascend") }
    }
}

/// Hierarchies as bytes, of vertices or of clusters.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HierarchyTable {
    entries: Vec<HierarchyEntry>,
    bytes: Vec<u8>,
}

impl HierarchyTable {
    /// Puts a hierarchy behind the others. `blobs` are its base and its blocks; `objects` ascend and are in no other entry.
    pub fn push(&mut self, objects: Vec<ObjectId>, blobs: &[Vec<u8>]) {
        let blobs = blobs
            .iter()
            .map(|blob| {
                let start = self.bytes.len();
                self.bytes.extend_from_slice(blob);
                start..self.bytes.len()
            })
            .collect();
        self.entries.push(HierarchyEntry { objects, blobs });
    }

    /// All hierarchies.
    pub fn entries(&self) -> &[HierarchyEntry] {
        &self.entries
    }

    /// A hierarchy's base, and behind it its blocks, coarse first.
    pub fn blobs(&self, hierarchy: usize) -> impl ExactSizeIterator<Item = &[u8]> {
        self.entries[hierarchy].blobs.iter().map(|range| &self.bytes[range.clone()])
    }

    /// Reads a hierarchy with all of its blocks.
    ///
    /// # Errors
    /// When its bytes are none.
    pub fn decode(&self, hierarchy: usize, scene: &SceneManifest) -> Result<Hierarchy, Error> {
        let mut blobs = self.blobs(hierarchy);
        let base = blobs.next().unwrap_or_default();
        let mut decoded = Hierarchy::decode_base(base, scene.materials.len() as u32)?;
        blobs.try_for_each(|block| decoded.decode_block(block))?;
        let (found, expected) = (decoded.block_count().into(), decoded.block_total().into());
        if found == expected { Ok(decoded) } else { Err(Error::Count { what: "blocks", found, expected }) }
    }

    /// The section's bytes.
    pub fn section_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.bytes.len() + 64 * self.entries.len() + 8);
        let mut word = |value: u32| bytes.extend_from_slice(&value.to_le_bytes());
        word(MAGIC);
        word(self.entries.len() as u32);
        for entry in &self.entries {
            word(entry.objects.len() as u32);
            word(entry.blobs.len() as u32);
            entry.objects.iter().for_each(|object| word(object.0));
            entry.blobs.iter().for_each(|blob| word(blob.len() as u32));
        }
        bytes.extend_from_slice(&self.bytes);
        bytes
    }

    /// Reads a section and checks it against its scene, or one that grew from that. Hierarchies themselves are read where they are used.
    ///
    /// # Errors
    /// When bytes are cut off, or an object is not there or in two hierarchies.
    pub fn from_section(bytes: &[u8], scene: &SceneManifest) -> Result<Self, Error> {
        let mut at = 0;
        let mut word = || {
            let found = bytes.get(at..at + 4).ok_or(Error::Length { found: bytes.len(), expected: at as u64 + 4 })?;
            at += 4;
            Ok::<u32, Error>(bytemuck::pod_read_unaligned(found))
        };
        let (magic, count) = (word()?, word()?);
        if magic != MAGIC {
            return Err(Error::Header { what: "magic", value: magic, allowed: "MLH1" });
        }
        if count > MAX_HIERARCHIES {
            return Err(Error::Header { what: "hierarchy count", value: count, allowed: "0 to 16777216" });
        }
        let mut owners = Owners::new(scene.transforms.len());
        let mut entries: Vec<HierarchyEntry> = Vec::new();
        let mut length = 0usize;
        for hierarchy in 0..count {
            let refuse = |problem| Error::Entry { hierarchy, problem };
            let (object_count, blob_count) = (word()?, word()?);
            if blob_count == 0 || blob_count > MAX_HIERARCHY_VERTICES {
                return Err(refuse("it has no base, or too many blocks"));
            }
            let mut objects: Vec<ObjectId> = Vec::new();
            for _ in 0..object_count {
                objects.push(ObjectId(word()?));
            }
            owners.claim(&objects).map_err(refuse)?;
            let mut blobs = Vec::new();
            for _ in 0..blob_count {
                let end = length.checked_add(word()? as usize).ok_or(refuse("it is too long"))?;
                blobs.push(length..end);
                length = end;
            }
            entries.push(HierarchyEntry { objects, blobs });
        }
        if bytes.len() - at != length {
            return Err(Error::Length { found: bytes.len(), expected: at as u64 + length as u64 });
        }
        Ok(Self { entries, bytes: bytes[at..].to_vec() })
    }
}
