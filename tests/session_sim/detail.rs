//! Walls that draw in detail, by the seed, and hierarchies that some scenes have. What nodes are given of them is made up, and one block is none.

use std::collections::BTreeSet;
use std::sync::Arc;

use mullion_client::tile_session::FrameToDraw;
use mullion_common::scene::{
    BlobRef, ChunkHash, ChunkId, HierarchyIndex, IndexedHierarchy, ObjectId, Presence, Scene, SceneManifest,
};
use mullion_common::wire::{Detail, DetailWeight};
use mullion_server::master::{Hierarchies, HierarchyLeaves};

use super::LEAVES;
use super::session_support::OBJECTS;

const DETAIL: Detail = Detail { triangles: Some(4000), least_pixels: 1.5, hides: true, weight: DetailWeight::Nohc };
/// The objects of each hierarchy. The scene's others have none.
const OBJECTS_OF: [&[u32]; 3] = [&[1], &[3, 5], &[6]];
/// How many blobs each has.
const BLOBS: [u8; 3] = [4, 1, 3];
/// The hierarchy whose block is none, and that block.
const BAD: (usize, u8) = (2, 1);
/// What a blob takes in the painter.
const TAKEN_BYTES: u64 = 70;

pub fn of_seed(seed: u64) -> Option<Detail> {
    (seed / 6 % 2 == 1).then_some(DETAIL)
}

fn blob(hierarchy: usize, number: u8) -> Vec<u8> {
    vec![100 + 16 * hierarchy as u8 + number; 50]
}

/// Who comes or goes with a frame of a master, in every run.
pub fn presence(number: u64) -> Option<(ObjectId, Presence)> {
    let turn = number / 7;
    let presence = if (turn / u64::from(OBJECTS)).is_multiple_of(2) { Presence::Away } else { Presence::There };
    number.is_multiple_of(7).then_some((ObjectId((turn % u64::from(OBJECTS)) as u32), presence))
}

/// The leaves that are away of what has hierarchies.
fn away(number: u64) -> Vec<u32> {
    let mut objects = BTreeSet::new();
    for (object, presence) in (0..=number).filter_map(presence).filter(|(object, _)| OBJECTS_OF.concat().contains(&object.0)) {
        match presence {
            Presence::Away => objects.insert(object.0),
            Presence::There => objects.remove(&object.0),
        };
    }
    (0..LEAVES).filter(|leaf| objects.contains(&(leaf % OBJECTS))).collect()
}

/// The index and what it is of, and all bytes: its own, and those that it names.
pub fn hierarchies(scene: &Scene) -> (Hierarchies, Vec<Vec<u8>>) {
    let name = |bytes: &[u8]| BlobRef { hash: ChunkHash::of(bytes), length: bytes.len() as u32 };
    let indexed = |hierarchy: usize| IndexedHierarchy {
        objects: OBJECTS_OF[hierarchy].iter().map(|object| ObjectId(*object)).collect(),
        blobs: (0..BLOBS[hierarchy]).map(|number| name(&blob(hierarchy, number))).collect(),
    };
    let index = HierarchyIndex { hierarchies: (0..3).map(indexed).collect() }.encode();
    let blobs = (0..3).flat_map(|hierarchy| (0..BLOBS[hierarchy]).map(move |number| blob(hierarchy, number)));
    let leaves = HierarchyLeaves::of(scene, OBJECTS_OF.concat().into_iter().map(ObjectId));
    let hierarchies = Hierarchies { index: name(&index), leaves: Arc::new(leaves) };
    (hierarchies, blobs.chain([index.clone()]).collect())
}

/// What a painter was given.
#[derive(Default)]
pub struct Taken {
    counts: [u8; 3],
    is_refused: [bool; 3],
}

impl Taken {
    pub fn take(&mut self, number: u32, objects: &[ObjectId], bytes: &[u8]) -> Option<u64> {
        let number = number as usize;
        assert!(objects.iter().map(|object| object.0).eq(OBJECTS_OF[number].iter().copied()));
        assert!(!self.is_refused[number], "nothing comes of what was refused");
        let count = &mut self.counts[number];
        assert_eq!(bytes, blob(number, *count), "hierarchy {number}: blobs come in their order");
        *count += 1;
        self.is_refused[number] = (number, *count - 1) == BAD;
        (!self.is_refused[number]).then_some(TAKEN_BYTES * u64::from(*count))
    }

    pub fn forget(&mut self, number: u32) {
        self.is_refused[number as usize] = true;
    }

    pub fn is_empty(&self) -> bool {
        self.counts == [0; 3]
    }

    /// Whether all has come that ever does.
    pub fn is_whole(&self) -> bool {
        (0..3).all(|number| self.is_refused[number] || self.counts[number] == BLOBS[number]) && self.is_refused[BAD.0]
    }

    fn of(&self, object: ObjectId) -> Option<usize> {
        (0..3).find(|number| OBJECTS_OF[*number].contains(&object.0) && !self.is_refused[*number])
    }

    /// The chunks that a leaf is drawn from, in detail or not.
    pub fn chunks_of(&self, manifest: &SceneManifest, leaf: u32, is_detailed: bool) -> impl Iterator<Item = ChunkId> + use<> {
        let record = &manifest.leaves[leaf as usize];
        let has_hierarchy = is_detailed && self.of(record.object).is_some();
        let texture = manifest.materials[record.material.0 as usize].texture.map(|texture| texture.chunk);
        [Some(record.chunk).filter(|_| !has_hierarchy), texture].into_iter().flatten()
    }

    /// Whether a leaf lacks anything that it is drawn from.
    pub fn lacks(&self, manifest: &SceneManifest, uploaded: &BTreeSet<u32>, leaf: u32, is_detailed: bool) -> bool {
        let number = self.of(manifest.leaves[leaf as usize].object).filter(|_| is_detailed);
        let lacks_base = number.is_some_and(|number| self.counts[number] == 0);
        lacks_base || self.chunks_of(manifest, leaf, is_detailed).any(|chunk| !uploaded.contains(&chunk.0))
    }
}

/// Whether a frame is ordered as it is to be.
pub fn check(asked: Option<Detail>, frame: &FrameToDraw, taken: &Taken) {
    assert_eq!(frame.detail, asked, "frame {}", frame.number);
    let away = if asked.is_some() { away(frame.number) } else { vec![] };
    assert_eq!(frame.away.leaves().collect::<Vec<_>>(), away, "frame {}", frame.number);
    assert!(asked.is_none() || frame.primary.is_some());
    assert!(asked.is_some() || taken.is_empty(), "frame {}: nobody asked for hierarchies", frame.number);
}
