//! The scene's tables: fetched, opened, and joined to those that are there when the scene grows.
//!
//! What grows is taken in while frames of the old epoch go on: all numbers stay, and what is new is in none of their sets. `Prepared` is
//! said when the new tables are there, and with them the chunks of what the views would see of it.

use std::collections::HashSet;

use mullion_common::scene::HierarchyIndex;

use super::on_the_way::Purpose;
use super::*;
use crate::prefetch::{Aim, Known, seen_of};

/// New leaves looked through for what the views would see; the others are fetched when they are seen, or ahead of that.
const MAX_LEAVES_LOOKED_AT: u32 = 1 << 16;

/// Sections asked for at once, at most, so that they and all chunks stay below [`MAX_WANTED`].
const SECTIONS_WINDOW: usize = 128;
const _: () = assert!(SECTIONS_WINDOW + 4 + 2 + FETCH_WINDOW + PREFETCH_WINDOW < MAX_WANTED, "all may be on their way");

/// A scene that is being drawn.
#[derive(Debug)]
pub(super) struct OpenScene {
    pub manifest: Arc<SceneManifest>,
    /// The sections that it came from.
    pub parts: Vec<[SectionRef; 4]>,
    pub tessellation: Option<SectionRef>,
    pub index: Option<BlobRef>,
    pub hierarchies: Hierarchies,
    pub transforms: Vec<Transform>,
    pub residency: Residency,
    pub prefetch: Prefetch,
    /// All chunks, sorted by their hashes.
    pub by_hash: Vec<ChunkId>,
}

/// An epoch that the master has told of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Announced {
    pub epoch: u32,
    /// How many of the parts that are known its scene has.
    pub parts: usize,
}

/// A part's sections, and what has come of them.
type PartOnTheWay = ([SectionRef; 4], [Option<Vec<u8>>; 4]);

/// The parts that follow on those of the open scene.
#[derive(Debug, Default)]
pub(super) struct Sections {
    parts: Vec<PartOnTheWay>,
    /// Where the scene is not open yet: its tessellation, and what has come of it.
    tessellation: Option<(SectionRef, Option<Vec<u8>>)>,
    /// And the index of its hierarchies.
    index: Option<(BlobRef, Option<Vec<u8>>)>,
}

/// What is fetched of a scene that has grown before its epoch begins.
#[derive(Debug, Default)]
pub(super) struct Growth {
    /// The epoch that the master waits for.
    owed: Option<u32>,
    /// In order of need; asked for so far as `asked`.
    chunks: Vec<ChunkId>,
    asked: usize,
    /// Those that have not come.
    awaited: HashSet<ChunkId>,
}

impl TileSession {
    pub(super) fn take_manifest(&mut self, manifest: &Manifest) -> Result<(), String> {
        let (parts, tessellation, index) = match self.needs {
            Needs::Scene => (manifest.parts()?, manifest.tessellation, manifest.hierarchies),
            Needs::Nothing => (Vec::new(), None, None),
        };
        let announced = Announced { epoch: manifest.epoch, parts: parts.len() };
        match self.announced.back() {
            None => {
                self.pending = None;
                self.lack.frame = None;
                self.acknowledged.clear();
                self.moved_early.clear();
                let is_of = |scene: &OpenScene| {
                    parts.starts_with(&scene.parts) && (scene.tessellation, scene.index) == (tessellation, index)
                };
                let is_known = self.scene.as_ref().is_some_and(is_of) && !self.views_changed;
                if is_known {
                    self.put_back()
                } else {
                    self.scene = None;
                    // What comes of them is said of the scene that is open then.
                    let is_of_them =
                        |action: &Action| matches!(action, Action::TakeHierarchy { .. } | Action::ForgetHierarchy(_));
                    self.actions.retain(|action| !is_of_them(action));
                }
                (self.tessellation, self.index) = (tessellation, index);
            }
            Some(before) => {
                let goes_on = before.epoch.checked_add(1) == Some(manifest.epoch) && self.announced.len() < MAX_PARTS;
                let grows = self.needs == Needs::Nothing || parts.len() > self.parts.len() && parts.starts_with(&self.parts);
                if !goes_on || !grows {
                    return Err(format!("the scene of epoch {} is not that of epoch {} and more", manifest.epoch, before.epoch));
                }
                if tessellation != self.tessellation {
                    return Err(format!("epoch {} has another tessellation than epoch {}", manifest.epoch, before.epoch));
                }
                if index != self.index {
                    return Err(format!("epoch {} has other hierarchies of detail than epoch {}", manifest.epoch, before.epoch));
                }
                self.growth.owed = Some(manifest.epoch);
            }
        }
        self.announced.push_back(announced);
        self.parts = parts;
        self.fetch_sections();
        self.say_prepared();
        Ok(())
    }

    /// Whether the open scene has all that frames of an epoch speak of.
    pub(super) fn holds_epoch(&self, epoch: u32) -> bool {
        let of_epoch = self.announced.iter().find(|announced| announced.epoch == epoch);
        self.scene.as_ref().zip(of_epoch).is_some_and(|(scene, announced)| scene.parts.len() >= announced.parts)
    }

    /// Forgets what a connection left half done.
    pub(super) fn forget_growth(&mut self) {
        self.announced.clear();
        self.sections = None;
        self.growth = Growth::default();
    }

    /// Objects may have moved back while nobody told us: starts from where the manifest has them.
    fn put_back(&mut self) {
        let Some(scene) = &mut self.scene else { return };
        for (i, transform) in scene.manifest.transforms.iter().enumerate() {
            if scene.transforms[i] != *transform {
                scene.transforms[i] = *transform;
                let moved = Moved { object: ObjectId(i as u32), transform: *transform };
                self.actions.push_back(Action::SetTransform(moved));
            }
        }
    }

    /// Asks for the sections of parts that are neither open nor on their way, as far as may be asked for at once.
    fn fetch_sections(&mut self) {
        let open = self.scene.as_ref().map_or(0, |scene| scene.parts.len());
        let sections = self.sections.get_or_insert_default();
        let mut fetch: Vec<(ChunkHash, u64)> = Vec::new();
        for part in &self.parts[(open + sections.parts.len()).min(self.parts.len())..] {
            if sections.missing() >= SECTIONS_WINDOW {
                break;
            }
            sections.parts.push((*part, [const { None }; 4]));
            for section in part {
                if !fetch.iter().any(|(hash, _)| *hash == section.hash) && !self.on_the_way.holds(&section.hash) {
                    fetch.push((section.hash, section.length));
                }
            }
        }
        if self.scene.is_none()
            && sections.tessellation.is_none()
            && let Some(section) = self.tessellation
        {
            sections.tessellation = Some((section, None));
            if !self.on_the_way.holds(&section.hash) {
                fetch.push((section.hash, section.length));
            }
        }
        if self.scene.is_none()
            && sections.index.is_none()
            && let Some(index) = self.index
        {
            sections.index = Some((index, None));
            if !self.on_the_way.holds(&index.hash) {
                fetch.push((index.hash, index.length.into()));
            }
        }
        if sections.parts.is_empty() {
            self.sections = None;
        }
        if !fetch.is_empty() {
            self.fetch(fetch, if open == 0 { Purpose::Need } else { Purpose::Growth });
        }
    }

    /// Takes a blob, if it is a section.
    pub(super) fn take_section(&mut self, hash: ChunkHash, bytes: &[u8]) -> bool {
        let is_taken = self.sections.as_mut().is_some_and(|sections| sections.take(hash, bytes));
        if is_taken {
            self.fetch_sections();
            self.open_when_whole();
        }
        is_taken
    }

    fn open_when_whole(&mut self) {
        let open = self.scene.as_ref().map_or(0, |scene| scene.parts.len());
        let is_whole = |sections: &mut Sections| sections.missing() == 0 && open + sections.parts.len() == self.parts.len();
        let Some(sections) = self.sections.take_if(is_whole) else { return };
        let result = match self.scene.take() {
            None => self.open(&sections),
            Some(scene) => self.grow(scene, &sections),
        };
        if let Err(error) = result {
            return self.fail(format!("the scene: {error}"));
        }
        self.say_prepared();
    }

    fn open(&mut self, sections: &Sections) -> Result<(), PackageError> {
        let mut manifest = SceneManifest::default();
        sections.join_to(&mut manifest)?;
        let manifest = Arc::new(manifest);
        let (tessellation, index) = (sections.tessellation(&manifest)?, sections.index(&manifest)?);
        self.views_changed = false;
        let mut scene = OpenScene {
            parts: sections.refs().collect(),
            tessellation: self.tessellation,
            index: self.index,
            hierarchies: Hierarchies::new(index, manifest.transforms.len()),
            transforms: manifest.transforms.clone(),
            residency: Residency::new(manifest.chunks.len(), self.memory_bytes),
            prefetch: Prefetch::new(manifest.chunks.len()),
            by_hash: Vec::new(),
            manifest: Arc::clone(&manifest),
        };
        scene.sort_chunks();
        self.scene = Some(scene);
        self.actions.push_back(Action::OpenScene(manifest, Arc::clone(&self.views)));
        self.actions.extend(tessellation.map(Action::TakeTessellation));
        Ok(())
    }

    fn grow(&mut self, mut scene: OpenScene, sections: &Sections) -> Result<(), PackageError> {
        let before = scene.manifest.size();
        sections.join_to(Arc::make_mut(&mut scene.manifest))?;
        scene.parts.extend(sections.refs());
        scene.transforms.extend_from_slice(&scene.manifest.transforms[before.objects as usize..]);
        scene.residency.grow(scene.manifest.chunks.len());
        scene.prefetch.grow(scene.manifest.chunks.len());
        scene.sort_chunks();
        self.actions.push_back(Action::GrowScene(Arc::clone(&scene.manifest)));
        let mut new_leaves = before.new_leaves(&scene.manifest.size());
        new_leaves.end = new_leaves.end.min(new_leaves.start.saturating_add(MAX_LEAVES_LOOKED_AT));
        // What the node draws next, or drew last; before that, nobody knows what it will see.
        let frame = self.pending.as_ref().or(self.drawing.as_deref()).or(self.acknowledged.back().map(Arc::as_ref));
        if let Some((frame, pose)) = frame.zip(self.motion.ahead(0.0, self.rate_hz)) {
            let aim = Aim::through(&self.views, frame.views.iter().map(|view| view.eye), &pose);
            let OpenScene { manifest, transforms, residency, hierarchies, .. } = &scene;
            let hierarchies = frame.detail.is_some().then_some(hierarchies);
            self.growth.chunks.drain(..self.growth.asked);
            self.growth.asked = 0;
            seen_of(new_leaves, &aim, Known { manifest, transforms, hierarchies, residency }, &mut self.growth.chunks);
            self.growth.awaited.extend(&self.growth.chunks);
        }
        self.scene = Some(scene);
        Ok(())
    }

    /// The next chunk to ask for of what is new, if there is one.
    pub(super) fn next_of_growth(&mut self) -> Option<ChunkId> {
        self.growth.chunks.get(self.growth.asked).copied()
    }

    /// That chunk is asked for, or there already.
    pub(super) fn asked_of_growth(&mut self) {
        self.growth.asked += 1;
    }

    /// A chunk has come.
    pub(super) fn note_chunk(&mut self, chunk: ChunkId) {
        if self.growth.awaited.remove(&chunk) {
            self.say_prepared();
        }
    }

    /// Tells the master that the newest epoch may begin, once it may.
    fn say_prepared(&mut self) {
        let Some(epoch) = self.growth.owed else { return };
        if self.needs == Needs::Nothing || self.holds_epoch(epoch) && self.growth.awaited.is_empty() {
            self.growth = Growth::default();
            self.actions.push_back(Action::Send(ToMaster::Prepared { epoch }));
        }
    }
}

impl OpenScene {
    fn sort_chunks(&mut self) {
        self.by_hash.extend((self.by_hash.len() as u32..self.manifest.chunks.len() as u32).map(ChunkId));
        self.by_hash.sort_by_key(|id| self.manifest.chunks[id.0 as usize].hash);
    }
}

impl Sections {
    /// Sections may be equal, as empty ones are.
    fn take(&mut self, hash: ChunkHash, bytes: &[u8]) -> bool {
        let mut is_taken = false;
        for (refs, places) in &mut self.parts {
            for (section, place) in refs.iter().zip(places).filter(|(section, _)| section.hash == hash) {
                debug_assert_eq!(section.length, bytes.len() as u64);
                *place = Some(bytes.to_vec());
                is_taken = true;
            }
        }
        if let Some((_, place)) = self.tessellation.as_mut().filter(|(section, _)| section.hash == hash) {
            *place = Some(bytes.to_vec());
            is_taken = true;
        }
        if let Some((_, place)) = self.index.as_mut().filter(|(index, _)| index.hash == hash) {
            *place = Some(bytes.to_vec());
            is_taken = true;
        }
        is_taken
    }

    /// How many have not come.
    fn missing(&self) -> usize {
        let tessellation = self.tessellation.iter().map(|(_, bytes)| bytes);
        let beside = self.index.iter().map(|(_, bytes)| bytes).chain(tessellation);
        self.parts.iter().flat_map(|(_, bytes)| bytes).chain(beside).filter(|bytes| bytes.is_none()).count()
    }

    fn refs(&self) -> impl Iterator<Item = [SectionRef; 4]> {
        self.parts.iter().map(|(refs, _)| *refs)
    }

    /// Checked against the scene that it is of, or that it has become.
    fn tessellation(&self, manifest: &SceneManifest) -> Result<Option<Arc<Tessellation>>, PackageError> {
        let bytes = self.tessellation.as_ref().and_then(|(_, bytes)| bytes.as_deref());
        Ok(bytes.map(|bytes| Tessellation::decode(bytes, manifest)).transpose()?.map(Arc::new))
    }

    /// As the tessellation; one of nothing where there are no hierarchies.
    fn index(&self, manifest: &SceneManifest) -> Result<HierarchyIndex, PackageError> {
        let bytes = self.index.as_ref().and_then(|(_, bytes)| bytes.as_deref());
        let index = bytes.map(|bytes| HierarchyIndex::decode(bytes, manifest.transforms.len() as u32)).transpose()?;
        Ok(index.unwrap_or_default())
    }

    fn join_to(&self, manifest: &mut SceneManifest) -> Result<(), PackageError> {
        for (_, bytes) in &self.parts {
            manifest.grow(bytes.each_ref().map(|bytes| bytes.as_deref().unwrap_or_default()))?;
        }
        Ok(())
    }
}
