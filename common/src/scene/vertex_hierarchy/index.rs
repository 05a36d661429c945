//! The hierarchies of a scene without their bytes, as whoever fetches them knows them: which objects each stands for, and of its base and
//! blocks the names and lengths.
//!
//! ```text
//! "MLI1"  hierarchies u32  objects u32  blobs u32
//! per hierarchy: objects u32  blobs u32
//! the objects u32, and the blobs: hash 32 bytes, length u32; hierarchy by hierarchy
//! ```

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use super::table::{HierarchyEntry, HierarchyTable, Owners};
use super::{MAX_HIERARCHIES, VertexHierarchyError};
use crate::scene::arrays::{put, take};
use crate::scene::{ChunkHash, ObjectId};

const MAGIC: u32 = u32::from_le_bytes(*b"MLI1");
/// Most bytes of a base or block that travels.
pub const MAX_HIERARCHY_BLOB_BYTES: u32 = 1 << 30;

/// A blob by name. 36 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C)]
pub struct BlobRef {
    /// Name of its bytes.
    pub hash: ChunkHash,
    /// How many bytes.
    pub length: u32,
}
const _: () = assert!(size_of::<BlobRef>() == 36);

/// A hierarchy by its blobs' names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IndexedHierarchy {
    /// The objects that it stands for, ascending: all of their own leaves, and nothing else.
    pub objects: Arc<[ObjectId]>,
    /// The base, and behind it the blocks, coarse first.
    pub blobs: Vec<BlobRef>,
}

/// All hierarchies of a scene, in the order of its [`HierarchyTable`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HierarchyIndex {
    /// Them.
    pub hierarchies: Vec<IndexedHierarchy>,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Header {
    magic: u32,
    hierarchies: u32,
    objects: u32,
    blobs: u32,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Counts {
    objects: u32,
    blobs: u32,
}

impl HierarchyIndex {
    /// Of a table. Takes as long as hashing all of its bytes.
    ///
    /// # Errors
    /// When a blob has more than [`MAX_HIERARCHY_BLOB_BYTES`].
    pub fn of(table: &HierarchyTable) -> Result<Self, VertexHierarchyError> {
        let hierarchy = |(at, entry): (usize, &HierarchyEntry)| {
            let blob = |bytes: &[u8]| match u32::try_from(bytes.len()) {
                Ok(length) if length <= MAX_HIERARCHY_BLOB_BYTES => Ok(BlobRef { hash: ChunkHash::of(bytes), length }),
                _ => Err(VertexHierarchyError::Entry { hierarchy: at as u32, problem: "a blob is longer than nodes take" }),
            };
            let blobs = table.blobs(at).map(blob).collect::<Result<_, _>>()?;
            Ok(IndexedHierarchy { objects: entry.objects.as_slice().into(), blobs })
        };
        Ok(Self { hierarchies: table.entries().iter().enumerate().map(hierarchy).collect::<Result<_, _>>()? })
    }

    /// Its bytes. The same index gives the same bytes.
    pub fn encode(&self) -> Vec<u8> {
        let (mut counts, mut objects, mut blobs) = (Vec::new(), Vec::new(), Vec::new());
        for hierarchy in &self.hierarchies {
            counts.push(Counts { objects: hierarchy.objects.len() as u32, blobs: hierarchy.blobs.len() as u32 });
            objects.extend_from_slice(&hierarchy.objects);
            blobs.extend_from_slice(&hierarchy.blobs);
        }
        let [hierarchies, object_count, blob_count] = [counts.len(), objects.len(), blobs.len()].map(|count| count as u32);
        let header = Header { magic: MAGIC, hierarchies, objects: object_count, blobs: blob_count };
        let mut bytes = bytemuck::bytes_of(&header).to_vec();
        put(&mut bytes, bytemuck::cast_slice(&counts));
        put(&mut bytes, bytemuck::cast_slice(&objects));
        put(&mut bytes, bytemuck::cast_slice(&blobs));
        bytes
    }

    /// Reads an index from outside and checks it against its scene, or one that grew from that, by its number of objects. Takes no more memory
    /// than a few times the bytes' length, and a byte for each object.
    ///
    /// # Errors
    /// When bytes are cut off or left over, a hierarchy has no base, a blob is too long, or an object is not there or in two hierarchies.
    pub fn decode(bytes: &[u8], object_count: u32) -> Result<Self, VertexHierarchyError> {
        let wrong_length = |expected: u64| VertexHierarchyError::Length { found: bytes.len(), expected };
        let Some((head, mut rest)) = bytes.split_at_checked(size_of::<Header>()) else {
            return Err(wrong_length(size_of::<Header>() as u64));
        };
        let header: Header = bytemuck::pod_read_unaligned(head);
        if header.magic != MAGIC {
            return Err(VertexHierarchyError::Header { what: "magic", value: header.magic, allowed: "MLI1" });
        }
        if header.hierarchies > MAX_HIERARCHIES {
            let what = "hierarchy count";
            return Err(VertexHierarchyError::Header { what, value: header.hierarchies, allowed: "0 to 16777216" });
        }
        // Cannot overflow: counts of 32 bits, 36 bytes each.
        let arrays = u64::from(header.hierarchies) * 8 + u64::from(header.objects) * 4 + u64::from(header.blobs) * 36;
        if rest.len() as u64 != arrays {
            return Err(wrong_length(size_of::<Header>() as u64 + arrays));
        }
        let counts: Vec<Counts> = take(&mut rest, header.hierarchies);
        let objects: Vec<ObjectId> = take(&mut rest, header.objects);
        let blobs: Vec<BlobRef> = take(&mut rest, header.blobs);
        let (mut objects, mut blobs) = (objects.as_slice(), blobs.as_slice());
        let mut owners = Owners::new(object_count as usize);
        let mut hierarchies = Vec::with_capacity(counts.len());
        for (hierarchy, counts) in (0..).zip(counts) {
            let refuse = |problem| VertexHierarchyError::Entry { hierarchy, problem };
            let own_objects = objects.split_off(..counts.objects as usize).ok_or(refuse("it has objects that are not there"))?;
            let own_blobs = blobs.split_off(..counts.blobs as usize).ok_or(refuse("it has blobs that are not there"))?;
            owners.claim(own_objects).map_err(refuse)?;
            if own_blobs.is_empty() || own_blobs.iter().any(|blob| blob.length > MAX_HIERARCHY_BLOB_BYTES) {
                return Err(refuse("it has no base, or a blob is too long"));
            }
            hierarchies.push(IndexedHierarchy { objects: own_objects.into(), blobs: own_blobs.to_vec() });
        }
        if objects.is_empty() && blobs.is_empty() {
            Ok(Self { hierarchies })
        } else {
            let (what, found, expected) = ("objects and blobs of no hierarchy", objects.len() + blobs.len(), 0);
            Err(VertexHierarchyError::Count { what, found: found as u64, expected })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> HierarchyTable {
        let mut table = HierarchyTable::default();
        table.push(vec![ObjectId(1), ObjectId(4)], &[vec![1; 8], vec![2; 12], vec![3; 4]]);
        table.push(vec![ObjectId(0)], &[vec![4; 20]]);
        table
    }

    fn index() -> HierarchyIndex {
        HierarchyIndex::of(&table()).unwrap()
    }

    #[test]
    fn it_names_what_the_table_holds_and_goes_round() {
        let index = index();
        let names = |at: usize| index.hierarchies[at].blobs.iter().map(|blob| (blob.hash, blob.length as usize));
        for at in 0..2 {
            assert!(names(at).eq(table().blobs(at).map(|bytes| (ChunkHash::of(bytes), bytes.len()))));
            assert_eq!(*index.hierarchies[at].objects, table().entries()[at].objects[..]);
        }
        assert_eq!(HierarchyIndex::decode(&index.encode(), 5), Ok(index));
        let empty = HierarchyIndex::default();
        assert_eq!(HierarchyIndex::decode(&empty.encode(), 0), Ok(empty));
    }

    #[test]
    fn what_is_no_index_is_refused() {
        let refused = |change: fn(&mut HierarchyIndex), problem: &str| {
            let mut bad = index();
            change(&mut bad);
            let error = HierarchyIndex::decode(&bad.encode(), 5).unwrap_err().to_string();
            assert!(error.contains(problem), "{error}");
        };
        refused(|index| index.hierarchies[1].objects = [ObjectId(5)].into(), "hierarchy 1: an object is not there");
        refused(
            |index| index.hierarchies[1].objects = [ObjectId(4)].into(),
            "hierarchy 1: an object is not there, has another one",
        );
        refused(|index| index.hierarchies[0].objects = [ObjectId(4), ObjectId(1)].into(), "hierarchy 0: an object");
        refused(|index| index.hierarchies[1].blobs.clear(), "hierarchy 1: it has no base");
        refused(|index| index.hierarchies[0].blobs[2].length = MAX_HIERARCHY_BLOB_BYTES + 1, "a blob is too long");
        let bytes = index().encode();
        for cut in 0..bytes.len() {
            assert!(HierarchyIndex::decode(&bytes[..cut], 5).is_err(), "{cut} bytes");
        }
        assert!(HierarchyIndex::decode(&[&bytes[..], &[0; 4]].concat(), 5).is_err());
        for at in (0..bytes.len()).step_by(4) {
            for value in [0, 1, 2, 5, 1 << 24, u32::MAX - 1, u32::MAX] {
                let mut bent = bytes.clone();
                bent[at..at + 4].copy_from_slice(&value.to_le_bytes());
                if let Ok(index) = HierarchyIndex::decode(&bent, 5) {
                    assert_eq!(index.encode(), bent, "what is read is what is written");
                }
            }
        }
        let spoiled = |at: usize, value: u32| {
            let mut bytes = bytes.clone();
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
            HierarchyIndex::decode(&bytes, 5).unwrap_err()
        };
        assert!(matches!(spoiled(0, 7), VertexHierarchyError::Header { what: "magic", .. }));
        assert!(matches!(spoiled(4, u32::MAX), VertexHierarchyError::Header { what: "hierarchy count", .. }));
        assert!(matches!(spoiled(12, u32::MAX), VertexHierarchyError::Length { .. }));
        assert!(matches!(spoiled(16, 3), VertexHierarchyError::Entry { .. }), "one object for two");
        assert!(matches!(spoiled(16, u32::MAX), VertexHierarchyError::Entry { hierarchy: 0, .. }));
        assert!(matches!(spoiled(24, 0), VertexHierarchyError::Count { found: 1, .. }));
        assert!(matches!(spoiled(28, 0), VertexHierarchyError::Entry { hierarchy: 1, .. }));
    }
}
