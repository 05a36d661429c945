//! Which blobs of a scene's hierarchies of detail have come, what is asked for next, and for which objects they stand. Pure.
//!
//! The bases of all come before any block, then block k of all before block k + 1 of any, the longest hierarchy first. Blobs of a hierarchy are handed on in their order: one
//! that comes before its turn waits. A hierarchy of which a blob is no part of one is given up, and stands for nothing any more.

use std::cmp::Reverse;
use std::sync::Arc;

use glam::DVec3;
use mullion_common::scene::{BlobRef, ChunkHash, HierarchyIndex, IndexedHierarchy, ObjectId, SceneManifest, Transform};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wire::MAX_WANTED;

/// Of an object without a hierarchy.
const NONE: u32 = u32::MAX;

/// A blob of a hierarchy. In the order in which they are asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// 0 is the base.
    pub blob: u32,
    /// By its place in the index.
    pub hierarchy: u32,
}

/// What is known of one.
#[derive(Debug)]
struct Known {
    indexed: IndexedHierarchy,
    /// How many of its blobs were handed on.
    taken: u32,
    is_given_up: bool,
    is_listed: bool,
    /// What it takes of memory.
    bytes: u64,
}

/// All hierarchies of a scene.
#[derive(Debug, Default)]
pub struct Hierarchies {
    all: Vec<Known>,
    /// By `ObjectId`: which hierarchy stands for it, or [`NONE`].
    of_object: Vec<u32>,
    /// What was asked for and has not come.
    asked: Vec<(ChunkHash, Place)>,
    /// What came before its turn.
    early: Vec<(Place, Vec<u8>)>,
    /// The next to ask for, or one before that; its hierarchy by its place among those by length.
    next: Place,
    /// Hierarchies by how many blobs they have, most first.
    by_length: Vec<u32>,
    /// How many are not given up and have no base.
    without_base: usize,
    bytes: u64,
    /// Hierarchies whose bases a frame lacks, by the squared distance of a leaf from the eye.
    lacking: Vec<(f64, u32)>,
}

impl Hierarchies {
    /// For a scene of so many objects, of which the index has been checked against them. Nothing has come.
    pub fn new(index: HierarchyIndex, object_count: usize) -> Self {
        let mut of_object = vec![NONE; object_count];
        for (hierarchy, indexed) in (0..).zip(&index.hierarchies) {
            indexed.objects.iter().for_each(|object| of_object[object.0 as usize] = hierarchy);
        }
        let mut by_length: Vec<u32> = (0..index.hierarchies.len() as u32).collect();
        by_length.sort_by_key(|hierarchy| Reverse(index.hierarchies[*hierarchy as usize].blobs.len()));
        let known = |indexed| Known { indexed, taken: 0, is_given_up: false, is_listed: false, bytes: 0 };
        let all: Vec<Known> = index.hierarchies.into_iter().map(known).collect();
        Self { without_base: all.len(), all, of_object, by_length, ..Self::default() }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.all.len()
    }

    fn of(&self, object: ObjectId) -> Option<&Known> {
        let hierarchy = *self.of_object.get(object.0 as usize)?;
        self.all.get(hierarchy as usize).filter(|known| !known.is_given_up)
    }

    /// Whether one stands for an object's own leaves. False for an object that came later.
    pub fn stand_for(&self, object: ObjectId) -> bool {
        self.of(object).is_some()
    }

    /// Whether one stands for an object's own leaves whose base has not come.
    pub fn lack_base_of(&self, object: ObjectId) -> bool {
        self.of(object).is_some_and(|known| known.taken == 0)
    }

    /// Finds the hierarchies whose bases these sets lack, each once, the nearest leaves' first. All leaves must be in the manifest.
    ///
    /// `transforms` are the objects' newest, by `ObjectId`; `eye` in world space, metres.
    pub fn list_lacking<'a>(
        &mut self,
        manifest: &SceneManifest,
        transforms: &[Transform],
        sets: impl Iterator<Item = &'a VisibleSet>,
        eye: DVec3,
        out: &mut Vec<u32>,
    ) {
        out.clear();
        self.lacking.clear();
        if self.without_base == 0 {
            return;
        }
        for leaf in sets.flat_map(VisibleSet::leaves) {
            let record = &manifest.leaves[leaf as usize];
            if self.lack_base_of(record.object) {
                let middle = record.local_aabb().center();
                let place = transforms[record.object.0 as usize].affine().transform_point3(middle);
                self.lacking.push((place.distance_squared(eye), self.of_object[record.object.0 as usize]));
            }
        }
        self.lacking.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (_, hierarchy) in &self.lacking {
            if !std::mem::replace(&mut self.all[*hierarchy as usize].is_listed, true) {
                out.push(*hierarchy);
            }
        }
        out.iter().for_each(|hierarchy| self.all[*hierarchy as usize].is_listed = false);
    }

    /// The base of a hierarchy, if it is to be asked for.
    pub fn base_to_ask(&self, hierarchy: u32) -> Option<(Place, BlobRef)> {
        self.to_ask(Place { blob: 0, hierarchy })
    }

    /// The next blob to ask for before a frame lacks it; `None` where none is left, and where
    /// [`MAX_WANTED`] have not come.
    pub fn next_to_ask(&mut self) -> Option<(Place, BlobRef)> {
        while self.asked.len() < MAX_WANTED {
            // Those that are long enough come first.
            let hierarchy = self.by_length.get(self.next.hierarchy as usize).copied();
            let is_long = |known: &Known| known.indexed.blobs.len() > self.next.blob as usize;
            match hierarchy.filter(|hierarchy| is_long(&self.all[*hierarchy as usize])) {
                Some(hierarchy) => {
                    if let Some(found) = self.to_ask(Place { hierarchy, ..self.next }) {
                        return Some(found);
                    }
                    self.next.hierarchy += 1;
                }
                None if self.next.hierarchy == 0 => return None,
                None => self.next = Place { blob: self.next.blob + 1, hierarchy: 0 },
            }
        }
        None
    }

    fn to_ask(&self, place: Place) -> Option<(Place, BlobRef)> {
        let known = self.all.get(place.hierarchy as usize).filter(|known| !known.is_given_up)?;
        let blob = known.indexed.blobs.get(place.blob as usize)?;
        let is_here = place.blob < known.taken || self.early.iter().any(|(early, _)| *early == place);
        let is_asked = self.asked.iter().any(|(_, asked)| *asked == place);
        (!is_here && !is_asked).then_some((place, *blob))
    }

    /// A blob is asked for.
    pub fn note_asked(&mut self, place: Place) {
        let blob = &self.all[place.hierarchy as usize].indexed.blobs[place.blob as usize];
        self.asked.push((blob.hash, place));
    }

    /// Whether a blob is the one that those behind it wait for.
    pub fn is_next(&self, place: Place) -> bool {
        self.all.get(place.hierarchy as usize).is_some_and(|known| known.taken == place.blob)
    }

    /// How many blobs wait for their turn.
    pub fn early(&self) -> usize {
        self.early.len()
    }

    /// A blob has come; gives what is to be handed on, in this order: the hierarchy, its objects, and the blob's place and bytes.
    pub fn take(&mut self, hash: ChunkHash, bytes: &[u8]) -> Vec<(Place, Arc<[ObjectId]>, Vec<u8>)> {
        let mut handed_on = Vec::new();
        while let Some(at) = self.asked.iter().position(|(asked, _)| *asked == hash) {
            let (_, place) = self.asked.swap_remove(at);
            self.early.push((place, bytes.to_vec()));
            let known = &mut self.all[place.hierarchy as usize];
            let is_next = |early: &(Place, Vec<u8>), taken| early.0 == Place { blob: taken, ..place };
            while let Some(at) = self.early.iter().position(|early| is_next(early, known.taken)) {
                let (place, bytes) = self.early.swap_remove(at);
                self.without_base -= usize::from(known.taken == 0);
                known.taken += 1;
                known.bytes += bytes.len() as u64;
                self.bytes += bytes.len() as u64;
                handed_on.push((place, Arc::clone(&known.indexed.objects), bytes));
            }
        }
        handed_on
    }

    /// A hierarchy takes so many bytes of memory, as far as it has come.
    pub fn resize(&mut self, hierarchy: u32, bytes: u64) {
        if let Some(known) = self.all.get_mut(hierarchy as usize).filter(|known| !known.is_given_up) {
            self.bytes = self.bytes - known.bytes + bytes;
            known.bytes = bytes;
        }
    }

    /// What all of them take of memory.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// A hierarchy is none, or does not come.
    pub fn give_up(&mut self, hierarchy: u32) {
        self.resize(hierarchy, 0);
        if let Some(known) = self.all.get_mut(hierarchy as usize).filter(|known| !known.is_given_up) {
            known.is_given_up = true;
            self.without_base -= usize::from(known.taken == 0);
            self.asked.retain(|(_, place)| place.hierarchy != hierarchy);
            self.early.retain(|(place, _)| place.hierarchy != hierarchy);
        }
    }

    /// A blob does not come: gives up the hierarchies whose it is, and gives which they are.
    pub fn give_up_asked(&mut self, hash: ChunkHash) -> Vec<u32> {
        let mut given_up = Vec::new();
        while let Some(hierarchy) = self.asked.iter().find(|(asked, _)| *asked == hash).map(|(_, place)| place.hierarchy) {
            self.give_up(hierarchy);
            given_up.push(hierarchy);
        }
        given_up
    }

    /// What was asked for will not come: the connection is gone.
    pub fn forget_asked(&mut self) {
        self.asked.clear();
        self.next = Place::default();
    }
}

#[cfg(test)]
mod tests {
    use mullion_common::scene::{ChunkId, LeafRecord, MaterialId};

    use super::*;

    /// Three hierarchies with 3, 1 and 4 blobs, for objects 0, 2 and 3.
    fn hierarchies() -> Hierarchies {
        let hierarchy = |object: u32, blobs: u8| IndexedHierarchy {
            objects: [ObjectId(object)].into(),
            blobs: (0..blobs).map(|blob| blob_of(object, blob)).collect(),
        };
        let index = HierarchyIndex { hierarchies: vec![hierarchy(0, 3), hierarchy(2, 1), hierarchy(3, 4)] };
        Hierarchies::new(index, 5)
    }

    fn bytes_of(object: u32, blob: u8) -> Vec<u8> {
        vec![object as u8, blob]
    }

    fn blob_of(object: u32, blob: u8) -> BlobRef {
        let bytes = bytes_of(object, blob);
        BlobRef { hash: ChunkHash::of(&bytes), length: bytes.len() as u32 }
    }

    fn ask_all(hierarchies: &mut Hierarchies) -> Vec<(u32, u32)> {
        let mut asked = Vec::new();
        while let Some((place, _)) = hierarchies.next_to_ask() {
            hierarchies.note_asked(place);
            asked.push((place.blob, place.hierarchy));
        }
        asked
    }

    fn take(hierarchies: &mut Hierarchies, object: u32, blob: u8) -> Vec<(u32, u32)> {
        let handed_on = hierarchies.take(blob_of(object, blob).hash, &bytes_of(object, blob));
        handed_on.iter().map(|(place, ..)| (place.blob, place.hierarchy)).collect()
    }

    #[test]
    fn bases_come_first_and_then_block_by_block_of_all() {
        let mut hierarchies = hierarchies();
        let (base, _) = hierarchies.base_to_ask(2).expect("nobody has asked for it");
        hierarchies.note_asked(base);
        assert_eq!(hierarchies.base_to_ask(2), None);
        assert_eq!(ask_all(&mut hierarchies), [(0, 0), (0, 1), (1, 2), (1, 0), (2, 2), (2, 0), (3, 2)]);
        assert_eq!(hierarchies.next_to_ask(), None);
        // A lost connection loses what had not come.
        assert_eq!(take(&mut hierarchies, 0, 0), [(0, 0)]);
        assert_eq!(take(&mut hierarchies, 3, 1), []);
        hierarchies.forget_asked();
        assert_eq!(ask_all(&mut hierarchies), [(0, 2), (0, 1), (1, 0), (2, 2), (2, 0), (3, 2)]);
        assert_eq!(take(&mut hierarchies, 3, 0), [(0, 2), (1, 2)], "the early one had come");
    }

    #[test]
    fn blobs_are_handed_on_in_their_order_and_count() {
        let mut hierarchies = hierarchies();
        ask_all(&mut hierarchies);
        assert!(hierarchies.stand_for(ObjectId(3)) && hierarchies.lack_base_of(ObjectId(3)));
        assert_eq!(take(&mut hierarchies, 3, 2), []);
        assert_eq!((take(&mut hierarchies, 3, 1), hierarchies.early()), (vec![], 2));
        assert_eq!(take(&mut hierarchies, 3, 0), [(0, 2), (1, 2), (2, 2)]);
        assert_eq!(take(&mut hierarchies, 3, 0), [], "nobody asked for it again");
        assert!(hierarchies.stand_for(ObjectId(3)) && !hierarchies.lack_base_of(ObjectId(3)));
        assert_eq!((hierarchies.early(), hierarchies.bytes()), (0, 6));
        hierarchies.resize(2, 100);
        assert_eq!(take(&mut hierarchies, 0, 0), [(0, 0)]);
        assert_eq!(hierarchies.bytes(), 102);
        for object in [1, 4, 5] {
            assert!(!hierarchies.stand_for(ObjectId(object)) && !hierarchies.lack_base_of(ObjectId(object)));
        }
    }

    #[test]
    fn what_a_frame_lacks_is_listed_once_and_the_nearest_first() {
        let leaf = |object: u32, x: f32| LeafRecord {
            object: ObjectId(object),
            chunk: ChunkId(0),
            material: MaterialId(0),
            triangle_count: 1,
            local_min: [x, 0.0, 0.0],
            local_max: [x + 1.0, 2.0, 3.0],
        };
        let leaves = vec![leaf(0, 9.0), leaf(3, 5.0), leaf(1, 0.0), leaf(0, 4.0), leaf(2, 7.0)];
        let transforms = vec![Transform::from(glam::DAffine3::IDENTITY); 5];
        let manifest = SceneManifest { leaves, transforms: transforms.clone(), ..SceneManifest::default() };
        let mut hierarchies = hierarchies();
        let listed = |hierarchies: &mut Hierarchies| {
            let (sets, mut out) = ([VisibleSet::all(4), VisibleSet::all(5)], vec![7]);
            hierarchies.list_lacking(&manifest, &transforms, sets.iter(), DVec3::ZERO, &mut out);
            out
        };
        assert_eq!(listed(&mut hierarchies), [0, 2, 1]);
        ask_all(&mut hierarchies);
        take(&mut hierarchies, 0, 0);
        assert_eq!(listed(&mut hierarchies), [2, 1]);
        hierarchies.give_up(2);
        hierarchies.give_up(2);
        assert_eq!(listed(&mut hierarchies), [1]);
        take(&mut hierarchies, 2, 0);
        assert_eq!(listed(&mut hierarchies), []);
    }

    #[test]
    fn one_that_is_given_up_stands_for_nothing_and_takes_nothing() {
        let mut hierarchies = hierarchies();
        ask_all(&mut hierarchies);
        take(&mut hierarchies, 0, 0);
        take(&mut hierarchies, 0, 2);
        hierarchies.give_up(0);
        assert!(!hierarchies.stand_for(ObjectId(0)) && !hierarchies.lack_base_of(ObjectId(0)));
        assert_eq!((hierarchies.early(), hierarchies.bytes()), (0, 0));
        assert_eq!(take(&mut hierarchies, 0, 1), []);
        hierarchies.resize(0, 50);
        assert_eq!(hierarchies.bytes(), 0, "what the painter says late changes nothing");
        assert_eq!([(), ()].map(|()| hierarchies.give_up_asked(blob_of(3, 2).hash)), [vec![2], vec![]]);
        hierarchies.forget_asked();
        assert_eq!(ask_all(&mut hierarchies), [(0, 1)]);
    }

    #[test]
    fn equal_blobs_are_asked_for_by_one_name_and_come_to_all() {
        let hierarchy = |object, blobs: &[u8]| IndexedHierarchy {
            objects: [ObjectId(object)].into(),
            blobs: blobs.iter().map(|blob| blob_of(9, *blob)).collect(),
        };
        let index = HierarchyIndex { hierarchies: vec![hierarchy(0, &[1, 2, 2]), hierarchy(1, &[1])] };
        let mut hierarchies = Hierarchies::new(index, 2);
        ask_all(&mut hierarchies);
        let mut handed_on = take(&mut hierarchies, 9, 1);
        handed_on.sort_unstable();
        assert_eq!(handed_on, [(0, 0), (0, 1)]);
        assert_eq!(take(&mut hierarchies, 9, 2), [(1, 0), (2, 0)]);
    }
}
