//! Which chunks the views need, which of them are missing, and which may go when memory runs short. Pure.

use glam::DVec3;
use mullion_common::scene::{ChunkId, SceneManifest, Transform};
use mullion_common::visible_set::{LeafRange, VisibleSet};

use crate::hierarchies::Hierarchies;

/// What is known of one chunk.
#[derive(Clone, Copy, Debug, Default)]
struct Entry {
    /// Bytes that it takes while it is resident.
    bytes: Option<u64>,
    /// The last frame that needed it; 0 for never.
    needed_in: u64,
    /// The last frame whose missing chunks it was among.
    listed_in: u64,
}

/// Keeps account of chunks: needed, resident, to be evicted.
#[derive(Debug)]
pub struct Residency {
    entries: Vec<Entry>,
    cap_bytes: u64,
    resident_bytes: u64,
    /// The part of them that stays whatever is short.
    lasting_bytes: u64,
    frame: u64,
    /// Leaves that lack a chunk, by their squared distance from the eye.
    lacking: Vec<(f64, u32)>,
}

impl Residency {
    /// For a scene of `chunk_count` chunks, nothing resident.
    ///
    /// `cap_bytes`: what resident chunks may take. Too low a cap for what one frame needs is exceeded, not obeyed:
    /// see [`Residency::evict`].
    pub fn new(chunk_count: usize, cap_bytes: u64) -> Self {
        let entries = vec![Entry::default(); chunk_count];
        Self { entries, cap_bytes, resident_bytes: 0, lasting_bytes: 0, frame: 0, lacking: Vec::new() }
    }

    /// The scene has so many chunks now; what is known of the first ones stays.
    pub fn grow(&mut self, chunk_count: usize) {
        self.entries.resize(chunk_count, Entry::default());
    }

    /// Starts a frame that draws these sets, and finds the chunks that it lacks, each once, those needed most in front:
    /// leaves by their distance from `eye` (world space, metres), of each leaf the geometry, then the texture.
    ///
    /// `transforms` are the objects' newest, by `ObjectId`. `hierarchies`: those that are drawn in the place of geometry, if any are. All leaves
    /// must be in the manifest.
    pub fn begin_frame<'a>(
        &mut self,
        manifest: &SceneManifest,
        transforms: &[Transform],
        hierarchies: Option<&Hierarchies>,
        sets: impl Iterator<Item = &'a VisibleSet>,
        eye: DVec3,
        missing: &mut Vec<ChunkId>,
    ) {
        self.frame += 1;
        self.lacking.clear();
        for leaf in sets.flat_map(VisibleSet::leaves) {
            let chunks = chunks_of(manifest, hierarchies, leaf);
            let mut lacks = false;
            for chunk in chunks.into_iter().flatten() {
                let entry = &mut self.entries[chunk.0 as usize];
                entry.needed_in = self.frame;
                lacks |= entry.bytes.is_none();
            }
            if lacks {
                let record = &manifest.leaves[leaf as usize];
                let middle = record.local_aabb().center();
                let place = transforms[record.object.0 as usize].affine().transform_point3(middle);
                self.lacking.push((place.distance_squared(eye), leaf));
            }
        }
        self.lacking.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        missing.clear();
        for (_, leaf) in &self.lacking {
            for chunk in chunks_of(manifest, hierarchies, *leaf).into_iter().flatten() {
                let entry = &mut self.entries[chunk.0 as usize];
                if entry.bytes.is_none() && entry.listed_in != self.frame {
                    entry.listed_in = self.frame;
                    missing.push(chunk);
                }
            }
        }
    }

    /// Those leaves of a set that lack a chunk, geometry or texture, or the base of a hierarchy in the place of geometry. All leaves must be
    /// in the manifest.
    pub fn missing_of(
        &self,
        manifest: &SceneManifest,
        hierarchies: Option<&Hierarchies>,
        set: &VisibleSet,
        out: &mut VisibleSet,
    ) {
        out.clear();
        for leaf in set.leaves() {
            let lacks_base = hierarchies.is_some_and(|them| them.lack_base_of(manifest.leaves[leaf as usize].object));
            let mut chunks = chunks_of(manifest, hierarchies, leaf).into_iter().flatten();
            if lacks_base || chunks.any(|chunk| !self.is_resident(chunk)) {
                out.push(LeafRange::new(leaf, leaf + 1));
            }
        }
    }

    /// Whether the chunk is resident. False for a chunk that the scene does not have.
    pub fn is_resident(&self, chunk: ChunkId) -> bool {
        self.entries.get(chunk.0 as usize).is_some_and(|entry| entry.bytes.is_some())
    }

    /// Notes that a chunk has become resident and takes `bytes`. Again for the same chunk: its bytes changed.
    pub fn loaded(&mut self, chunk: ChunkId, bytes: u64) {
        let Some(entry) = self.entries.get_mut(chunk.0 as usize) else { return };
        self.resident_bytes = self.resident_bytes - entry.bytes.unwrap_or(0) + bytes;
        entry.bytes = Some(bytes);
    }

    /// Notes that what is no chunk takes so many bytes, which no eviction gives back.
    pub fn set_lasting(&mut self, bytes: u64) {
        self.resident_bytes = self.resident_bytes - self.lasting_bytes + bytes;
        self.lasting_bytes = bytes;
    }

    /// Chooses the chunks to evict so that the rest stays under the cap, and counts them as gone: those needed longest
    /// ago first, never one that the current frame needs. `out` becomes the chosen chunks, least recent first.
    pub fn evict(&mut self, out: &mut Vec<ChunkId>) {
        out.clear();
        if self.resident_bytes <= self.cap_bytes {
            return;
        }
        let idle = |(_, entry): &(usize, &Entry)| entry.bytes.is_some_and(|bytes| bytes > 0) && entry.needed_in < self.frame;
        out.extend(self.entries.iter().enumerate().filter(idle).map(|(i, _)| ChunkId(i as u32)));
        out.sort_unstable_by_key(|chunk| (self.entries[chunk.0 as usize].needed_in, *chunk));
        let mut kept = out.len();
        for (i, chunk) in out.iter().enumerate() {
            if self.resident_bytes <= self.cap_bytes {
                kept = i;
                break;
            }
            self.resident_bytes -= self.entries[chunk.0 as usize].bytes.take().unwrap_or(0);
        }
        out.truncate(kept);
    }

    /// How many frames were begun.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// The last frame that needed the chunk, as [`Residency::frame`] counts; 0 for never.
    pub fn needed_in(&self, chunk: ChunkId) -> u64 {
        self.entries.get(chunk.0 as usize).map_or(0, |entry| entry.needed_in)
    }

    /// What resident chunks may take, bytes.
    pub fn cap_bytes(&self) -> u64 {
        self.cap_bytes
    }

    /// Bytes of all that is resident.
    pub fn resident_bytes(&self) -> u64 {
        self.resident_bytes
    }
}

/// A leaf's geometry, where no hierarchy is drawn in its place, and its texture.
pub(crate) fn chunks_of(manifest: &SceneManifest, hierarchies: Option<&Hierarchies>, leaf: u32) -> [Option<ChunkId>; 2] {
    let record = &manifest.leaves[leaf as usize];
    let has_hierarchy = hierarchies.is_some_and(|them| them.stand_for(record.object));
    [(!has_hierarchy).then_some(record.chunk), manifest.materials[record.material.0 as usize].texture.map(|t| t.chunk)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use mullion_common::scene::{
        AlphaMode, ChunkHash, ChunkKind, ChunkRecord, Filter, LeafRecord, Material, MaterialId, ObjectId, TextureRef, Wrap,
    };
    use proptest::prelude::*;

    /// Eight leaves over chunks 0 to 3, two each; odd leaves have texture 4.
    fn manifest() -> SceneManifest {
        let record = |kind| ChunkRecord::new(ChunkHash([0; 32]), 0, 0, kind);
        let texture = TextureRef { chunk: ChunkId(4), wrap_u: Wrap::Repeat, wrap_v: Wrap::Clamp, filter: Filter::Linear };
        let material = |texture| Material { base_color: [1.0; 4], texture, alpha: AlphaMode::Opaque, double_sided: false };
        let leaf = |i: u32| LeafRecord {
            object: ObjectId(0),
            chunk: ChunkId(3 - i / 2),
            material: MaterialId(i % 2),
            triangle_count: 1,
            local_min: [0.0; 3],
            local_max: [1.0, 2.0, 3.0],
        };
        SceneManifest {
            transforms: vec![glam::DAffine3::IDENTITY.into()],
            leaves: (0..8).map(leaf).collect(),
            materials: vec![material(None), material(Some(texture))],
            chunks: [[ChunkKind::Geometry; 4].as_slice(), &[ChunkKind::Texture]].concat().into_iter().map(record).collect(),
        }
    }

    fn ids(numbers: &[u32]) -> Vec<ChunkId> {
        numbers.iter().copied().map(ChunkId).collect()
    }

    fn lacks(residency: &mut Residency, scene: &SceneManifest, sets: &[&VisibleSet]) -> Vec<ChunkId> {
        let mut missing = Vec::new();
        residency.begin_frame(scene, &scene.transforms, None, sets.iter().copied(), DVec3::ZERO, &mut missing);
        missing
    }

    #[test]
    fn what_is_missing_is_listed_once_and_the_nearest_first() {
        let (mut scene, mut residency) = (manifest(), Residency::new(5, 100));
        let (some, all) = (VisibleSet::from_ranges([LeafRange::new(2, 5)]), VisibleSet::all(8));
        assert_eq!(lacks(&mut residency, &scene, &[&some, &all]), ids(&[3, 4, 2, 1, 0]), "at one place, by leaf");
        scene.leaves[6].local_max = [-1.0, -2.0, -3.0];
        scene.leaves[6].local_min = [0.0; 3];
        scene.leaves[5].local_max = [0.5, 0.0, 0.0];
        assert_eq!(lacks(&mut residency, &scene, &[&some, &all]), ids(&[1, 4, 3, 2, 0]), "leaf 5 is nearest");
        residency.loaded(ChunkId(4), 10);
        residency.loaded(ChunkId(3), 10);
        assert_eq!(lacks(&mut residency, &scene, &[&some, &all]), ids(&[1, 2, 0]));
        assert_eq!(residency.resident_bytes(), 20);
    }

    #[test]
    fn the_longest_unused_go_first_and_the_needed_stay() {
        let (scene, mut residency) = (manifest(), Residency::new(5, 100));
        let frames = [(6, 7), (2, 4), (0, 2)].map(|(start, end)| VisibleSet::from_ranges([LeafRange::new(start, end)]));
        let mut gone = Vec::new();
        for set in &frames {
            for chunk in lacks(&mut residency, &scene, &[set]) {
                residency.loaded(chunk, 40);
            }
        }
        // Chunk 0 in frame 1, chunks 2 and 4 in frame 2, chunks 3 and 4 in frame 3.
        residency.evict(&mut gone);
        assert_eq!((gone.as_slice(), residency.resident_bytes()), (ids(&[0, 2]).as_slice(), 80));
        residency.loaded(ChunkId(3), 400);
        residency.evict(&mut gone);
        assert_eq!((gone.len(), residency.resident_bytes()), (0, 440), "what the frame needs stays, whatever the cap");
    }

    #[test]
    fn what_lasts_takes_from_the_cap_and_is_not_evicted() {
        let (scene, mut residency) = (manifest(), Residency::new(5, 100));
        for leaf in [6, 0] {
            let set = VisibleSet::from_ranges([LeafRange::new(leaf, leaf + 1)]);
            lacks(&mut residency, &scene, &[&set]).into_iter().for_each(|chunk| residency.loaded(chunk, 40));
        }
        let mut gone = Vec::new();
        residency.set_lasting(20);
        residency.evict(&mut gone);
        assert_eq!((gone.len(), residency.resident_bytes()), (0, 100));
        residency.set_lasting(30);
        residency.evict(&mut gone);
        assert_eq!((gone.as_slice(), residency.resident_bytes()), (ids(&[0]).as_slice(), 70));
        residency.set_lasting(0);
        assert_eq!(residency.resident_bytes(), 40);
    }

    proptest! {
        #[test]
        fn eviction_keeps_what_is_needed_and_no_more_than_fits(
            frames in proptest::collection::vec((0..8u32, 0..8u32, 1..60u64), 1..20),
        ) {
            let (scene, mut residency) = (manifest(), Residency::new(5, 100));
            let mut gone = Vec::new();
            for (start, len, bytes) in frames {
                let set = VisibleSet::from_ranges([LeafRange::new(start, (start + len).min(8))]);
                for chunk in lacks(&mut residency, &scene, &[&set]) {
                    residency.loaded(chunk, bytes);
                }
                residency.evict(&mut gone);
                prop_assert!(lacks(&mut residency, &scene, &[&set]).is_empty(), "what is needed stays");
                let needed: Vec<_> = set.leaves().flat_map(|leaf| chunks_of(&scene, None, leaf)).flatten().collect();
                let idle = (0..5).map(ChunkId).filter(|c| residency.is_resident(*c) && !needed.contains(c));
                prop_assert!(residency.resident_bytes() <= 100 || idle.count() == 0);
            }
        }
    }
}
