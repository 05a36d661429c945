//! From the newest frame to what is fetched, and to the order to draw.

use super::on_the_way::Purpose;
use super::*;
use crate::prefetch::{AHEAD_S, Aim, Known, room_of};

/// What the newest frame that was looked at lacks.
#[derive(Debug, Default)]
pub(super) struct Lack {
    /// Which frame; `None` where that is not worked out. Stays when the frame is drawn, until the next.
    pub frame: Option<u64>,
    /// Its leaves are drawn from their hierarchies, where they have some.
    pub is_detailed: bool,
    /// Bases of hierarchies, in order of need; they come before chunks.
    pub bases: Vec<u32>,
    /// How many of them from the front have been asked for, or are there.
    pub bases_asked: usize,
    /// By hierarchy: whether its base is in `bases` and not there.
    pub is_base_awaited: Vec<bool>,
    /// In order of need.
    chunks: Vec<ChunkId>,
    /// How many of them from the front have been asked for, or are there.
    asked: usize,
    /// By `ChunkId`: whether it is in `chunks` and not there.
    is_awaited: Vec<bool>,
    /// How many are awaited, chunks and bases.
    pub left: usize,
    /// Something is not there any more that was counted on.
    pub is_outdated: bool,
}

impl TileSession {
    pub(super) fn take_damaged(&mut self, hash: ChunkHash, length: u64, purpose: Purpose) {
        let times = self.damaged.get(&hash).map_or(1, |times| times + 1);
        self.damaged.insert(hash, times);
        if times > MAX_REFETCHES {
            if self.give_up_hierarchies(hash) {
                return;
            }
            return self.fail(format!("blob {hash} came damaged {times} times"));
        }
        self.fetch(vec![(hash, length)], purpose);
    }

    pub(super) fn take_chunk(&mut self, hash: ChunkHash, bytes: Vec<u8>) {
        let Some(scene) = &mut self.scene else { return };
        let hash_of = |id: &ChunkId| scene.manifest.chunks[id.0 as usize].hash;
        let first = scene.by_hash.partition_point(|id| hash_of(id) < hash);
        let same = scene.by_hash[first..].iter().copied().take_while(|id| hash_of(id) == hash);
        let same: Vec<ChunkId> = same.collect();
        for chunk in same.iter().copied() {
            let at = chunk.0 as usize;
            if !scene.residency.is_resident(chunk) {
                scene.residency.loaded(chunk, bytes.len() as u64);
                self.actions.push_back(Action::Upload { chunk, bytes: bytes.clone() });
                if self.lack.is_awaited.get_mut(at).is_some_and(std::mem::take) {
                    self.lack.left -= 1;
                }
            }
        }
        same.into_iter().for_each(|chunk| self.note_chunk(chunk));
    }

    /// Finds out what the newest frame lacks, and goes on from there.
    pub(super) fn plan(&mut self) {
        if self.closed || self.drawing.is_some() {
            return;
        }
        if self.needs == Needs::Nothing {
            self.lack.frame = self.pending.as_ref().map(|pending| pending.number);
            self.moved_early.clear();
            return;
        }
        if self.pending.as_ref().is_none_or(|pending| !self.holds_epoch(pending.epoch)) {
            return;
        }
        let (Some(scene), Some(pending)) = (&mut self.scene, &self.pending) else { return };
        let leaf_count = scene.manifest.leaves.len() as u32;
        let beyond = pending.views.iter().filter_map(|v| v.leaves.ranges().last()).find(|r| r.end > leaf_count);
        if let Some(range) = beyond {
            let reason = format!("frame {}: leaf {} of {leaf_count}", pending.number, range.end - 1);
            return self.fail(reason);
        }
        if let Some(object) = self.moved_early.keys().find(|o| o.0 as usize >= scene.transforms.len()) {
            let reason = format!("frame {}: object {} moved, which is not there", pending.number, object.0);
            return self.fail(reason);
        }
        for (object, transform) in self.moved_early.drain() {
            let known = &mut scene.transforms[object.0 as usize];
            if *known != transform {
                *known = transform;
                self.actions.push_back(Action::SetTransform(Moved { object, transform }));
            }
        }
        let OpenScene { manifest, transforms, residency, prefetch, hierarchies, .. } = scene;
        let (sets, eye) = (pending.views.iter().map(|v| &v.leaves), pending.shared_eye);
        if self.lack.is_detailed != pending.detail.is_some() {
            self.lack.is_detailed = pending.detail.is_some();
            prefetch.look_again();
        }
        self.lack.bases.clear();
        self.lack.bases_asked = 0;
        if self.lack.is_detailed {
            hierarchies.list_lacking(manifest, transforms, sets.clone(), eye, &mut self.lack.bases);
        }
        let hierarchies = self.lack.is_detailed.then_some(&*hierarchies);
        residency.begin_frame(manifest, transforms, hierarchies, sets, eye, &mut self.lack.chunks);
        residency.evict(&mut self.evicted);
        self.actions.extend(self.evicted.iter().map(|chunk| Action::Evict(*chunk)));
        if !self.evicted.is_empty() {
            prefetch.look_again();
        }
        self.lack.frame = Some(pending.number);
        self.lack.asked = 0;
        self.lack.left = self.lack.bases.len() + self.lack.chunks.len();
        self.lack.is_base_awaited.clear();
        self.lack.is_base_awaited.resize(hierarchies.map_or(0, Hierarchies::count), false);
        for base in &self.lack.bases {
            self.lack.is_base_awaited[*base as usize] = true;
        }
        self.lack.is_awaited.clear();
        self.lack.is_awaited.resize(manifest.chunks.len(), false);
        for chunk in &self.lack.chunks {
            self.lack.is_awaited[chunk.0 as usize] = true;
        }
        self.motion.note(pending.number, self.rate_hz, pending.shared_eye, &pending.world_from_room);
        if self.lack.left == 0
            && prefetch.is_looking(residency)
            && let Some(pose) = self.motion.ahead(AHEAD_S, self.rate_hz)
        {
            let aim = Aim::through(&self.views, pending.views.iter().map(|view| view.eye), &pose);
            prefetch.look(&aim, Known { manifest, transforms, hierarchies, residency });
        }
        self.fetch_missing();
    }

    pub(super) fn next_draw(&mut self) -> Option<Action> {
        let planned = self.lack.frame.is_some() && self.lack.frame == self.pending.as_ref().map(|p| p.number);
        let waits = self.lack.left > 0 && self.when_missing == WhenMissing::Hold;
        if self.closed || self.drawing.is_some() || self.behind > 0 || !planned || waits {
            return None;
        }
        let mut frame = self.pending.take()?;
        if self.lack.left > 0
            && let Some(OpenScene { manifest, residency, hierarchies, .. }) = &self.scene
        {
            let hierarchies = frame.detail.is_some().then_some(hierarchies);
            for view in &mut frame.views {
                residency.missing_of(manifest, hierarchies, &view.leaves, &mut view.missing);
            }
        }
        // What it lacks is fetched on while it is drawn and shown.
        let frame = Arc::new(frame);
        self.drawing = Some(Arc::clone(&frame));
        self.drawn = None;
        Some(Action::Draw(frame))
    }

    /// Asks for what the newest frame lacks, as far as may be on its way at once; where it lacks nothing, for what the next ones will need.
    pub(super) fn fetch_missing(&mut self) {
        if self.closed || self.lack.frame.is_none() {
            return;
        }
        let mut fetch: Vec<(ChunkHash, u64)> = Vec::new();
        let has_asked_for_bases = self.fetch_bases(&mut fetch);
        let Some(scene) = self.scene.as_mut() else { return };
        while has_asked_for_bases && let Some(id) = self.lack.chunks.get(self.lack.asked) {
            let record = &scene.manifest.chunks[id.0 as usize];
            let length = u64::from(record.length);
            let is_asked = scene.residency.is_resident(*id) || self.on_the_way.holds(&record.hash);
            if !is_asked {
                if !self.on_the_way.has_room_for(length) {
                    break;
                }
                self.on_the_way.insert(record.hash, length, Purpose::Need);
                fetch.push((record.hash, length));
            }
            self.lack.asked += 1;
        }
        if self.lack.left == 0 && !self.fetch_growth(&mut fetch) && !self.fetch_detail(&mut fetch) {
            let Some(scene) = &mut self.scene else { return };
            let OpenScene { manifest, transforms, residency, prefetch, hierarchies, .. } = scene;
            let hierarchies = self.lack.is_detailed.then_some(&*hierarchies);
            let (known, on_the_way) = (Known { manifest, transforms, hierarchies, residency }, &mut self.on_the_way);
            while let Some((chunk, room)) = prefetch.next(known, on_the_way.ahead(), |record| on_the_way.holds(&record.hash)) {
                let record = &manifest.chunks[chunk.0 as usize];
                let length = u64::from(record.length);
                on_the_way.insert(record.hash, length, Purpose::Ahead { room });
                fetch.push((record.hash, length));
            }
        }
        if !fetch.is_empty() {
            self.actions.push_back(Action::Fetch(fetch));
        }
    }

    /// Asks for what would be seen of a scene that has grown, as far as may be on its way; whether more of it is to be asked for.
    fn fetch_growth(&mut self, fetch: &mut Vec<(ChunkHash, u64)>) -> bool {
        while let (Some(id), Some(scene)) = (self.next_of_growth(), &self.scene) {
            let record = scene.manifest.chunks[id.0 as usize];
            if scene.residency.is_resident(id) {
                self.note_chunk(id);
            } else if !self.on_the_way.holds(&record.hash) {
                let length = u64::from(record.length);
                if !self.on_the_way.has_room_ahead_for(length) {
                    return true;
                }
                self.on_the_way.insert(record.hash, length, Purpose::Ahead { room: room_of(&record) });
                fetch.push((record.hash, length));
            }
            self.asked_of_growth();
        }
        false
    }

    pub(super) fn fetch(&mut self, blobs: Vec<(ChunkHash, u64)>, purpose: Purpose) {
        for (hash, length) in &blobs {
            self.on_the_way.insert(*hash, *length, purpose);
        }
        self.actions.push_back(Action::Fetch(blobs));
    }
}
