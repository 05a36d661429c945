//! Which chunks to fetch before a frame needs them: those that the camera's motion will show next, then by distance. Pure.
//!
//! Leaves are looked through a few thousand a frame, always from one aim, until all have been seen; the best of them are the queue from
//! which chunks are asked for. Another round begins when the queue is used up, or when the aim has moved. Where there is nothing left to
//! ask for, or no room, nothing is looked at until a chunk is evicted.

use std::collections::HashSet;
use std::ops::Range;

use glam::{DAffine3, DVec3};
use mullion_common::scene::{ChunkId, ChunkKind, ChunkRecord, SceneManifest, Transform};
use mullion_common::wire::ViewSpec;

use crate::hierarchies::Hierarchies;
use crate::motion::Pose;
use crate::residency::{Residency, chunks_of};

/// Most blobs on their way that no frame needs yet: what comes into view waits for no more of them.
pub const PREFETCH_WINDOW: usize = 4;
/// Most bytes on their way that no frame needs yet, but for a single larger blob.
pub const PREFETCH_WINDOW_BYTES: u64 = 2 << 20;
/// Blobs of more bytes are fetched when a frame needs them: one alone would be in its way for too long.
pub const PREFETCH_LARGEST_BYTES: u64 = 8 << 20;
/// How far ahead the camera's motion is carried on, seconds.
pub const AHEAD_S: f64 = 1.0;
/// Leaves looked at in a frame: a small part of its time, and a million leaves are through in four seconds at 60 Hz.
const LEAVES_PER_FRAME: u32 = 4096;
/// Leaves of one round that are asked for. Few enough to sort at once, and enough that rounds of large scenes are worth their time.
const QUEUE_LEAVES: usize = 512;
/// By how much the cone of what is ahead is wider than the views, radians.
const MARGIN_RAD: f64 = 0.2;
/// A round is of an old aim when the eye has moved by more than this share of the way to the farthest leaf in the queue.
const MOVED_SHARE: f64 = 0.125;
/// Or when its axis has turned by more than an angle of this cosine: the margin.
const TURNED_COS: f64 = 0.98;
/// What geometry takes on the GPU, at most, in lengths of its blob.
const GEOMETRY_GROWS: u64 = 2;
/// What a texture takes on the GPU with its mipmaps, in lengths of its file: that of a well compressed photograph.
const TEXTURE_GROWS: u64 = 16;

/// Bytes that prefetched chunks and all others may take together: the rest is for what comes into view meanwhile.
pub fn share_of(cap_bytes: u64) -> u64 {
    cap_bytes - cap_bytes / 4
}

/// A cone around all that a node's views will see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Its tip, world space, metres.
    pub eye: DVec3,
    /// Where it points, of length 1, world space; any direction where `cos_half_angle` is −1.
    pub axis: DVec3,
    /// −1 is all around.
    pub cos_half_angle: f64,
}

/// What is on its way that no frame needs yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Load {
    /// How many blobs.
    pub count: usize,
    /// Their bytes.
    pub bytes: u64,
    /// What they may take on the GPU, bytes.
    pub room: u64,
}

/// What the choice depends on.
#[derive(Clone, Copy)]
#[allow(missing_docs)]
pub struct Known<'a> {
    pub manifest: &'a SceneManifest,
    /// The objects' newest, by `ObjectId`.
    pub transforms: &'a [Transform],
    /// Those that are drawn in the place of geometry, if any are.
    pub hierarchies: Option<&'a Hierarchies>,
    pub residency: &'a Residency,
}

/// A leaf to ask for.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    is_ahead: bool,
    distance_squared: f64,
    leaf: u32,
}

/// Chooses chunks of one scene.
#[derive(Debug)]
pub struct Prefetch {
    /// By `ChunkId`: in which frame it was last asked for, as [`Residency::frame`] counts; 0 for never.
    asked_in: Vec<u64>,
    /// The best of the last whole round; the first to ask for last.
    queue: Vec<Candidate>,
    /// From where the queue was made.
    aim: Option<Aim>,
    /// The round that is under way: its aim and its next leaf.
    round: Option<(Aim, u32)>,
    /// What that round has found.
    found: Vec<Candidate>,
    /// What keeps the next round from beginning.
    rest: Option<Rest>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rest {
    /// There is nothing to ask for.
    Done,
    /// The next chunk does not fit.
    Full,
}

impl Aim {
    /// Around the rectangles that views look through, from a pose. `eyes`: the views' own, room space, metres.
    pub fn through(views: &[ViewSpec], eyes: impl Iterator<Item = DVec3> + Clone, pose: &Pose) -> Self {
        let corner_rays = views.iter().zip(eyes).flat_map(|(view, eye)| {
            let [bottom_left, bottom_right, top_left] = view.corners.map(DVec3::from);
            let top_right = bottom_right + top_left - bottom_left;
            [bottom_left, bottom_right, top_left, top_right].map(|corner| (corner - eye).normalize_or_zero())
        });
        let axis = corner_rays.clone().sum::<DVec3>().normalize_or_zero();
        let widest = corner_rays.map(|ray| ray.dot(axis)).fold(1.0, f64::min);
        let is_narrow = axis != DVec3::ZERO && widest.is_finite();
        let half_angle = if is_narrow { widest.clamp(-1.0, 1.0).acos() + MARGIN_RAD } else { std::f64::consts::PI };
        let cos_half_angle = half_angle.min(std::f64::consts::PI).cos();
        Self { eye: pose.eye, axis: pose.world_from_room * axis, cos_half_angle }
    }

    /// Whether the cone holds part of a sphere. Conservative: may say so where it passes close by.
    ///
    /// A point of the sphere is at most `radius` less far along the axis than its middle, and at most `radius` nearer or farther.
    fn meets(&self, center: DVec3, radius: f64) -> bool {
        let offset = center - self.eye;
        let distance = offset.length();
        let margin = radius * (1.0 + self.cos_half_angle.abs());
        distance <= radius || offset.dot(self.axis) + margin >= self.cos_half_angle * distance
    }

    fn is_far_from(&self, other: &Self, reach_m: f64) -> bool {
        let moved = self.eye.distance(other.eye) > MOVED_SHARE * reach_m;
        moved || (self.axis.dot(other.axis) < TURNED_COS && self.cos_half_angle > -1.0)
    }
}

impl Candidate {
    /// What is asked for first is least.
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        let ahead_first = other.is_ahead.cmp(&self.is_ahead);
        ahead_first.then(self.distance_squared.total_cmp(&other.distance_squared)).then(self.leaf.cmp(&other.leaf))
    }
}

impl Prefetch {
    /// For a scene of `chunk_count` chunks of which none was asked for.
    pub fn new(chunk_count: usize) -> Self {
        Self { asked_in: vec![0; chunk_count], queue: Vec::new(), aim: None, round: None, found: Vec::new(), rest: None }
    }

    /// The scene has so many chunks now, and more leaves.
    pub fn grow(&mut self, chunk_count: usize) {
        self.asked_in.resize(chunk_count, 0);
        self.rest = None;
    }

    /// Whether [`Prefetch::look`] may have something to do; a node at rest need not even find its aim.
    pub fn is_looking(&self, residency: &Residency) -> bool {
        self.rest.is_none() && residency.resident_bytes() < share_of(residency.cap_bytes())
    }

    /// Goes on looking for chunks, through as many leaves as one frame may take. Allocates nothing at the steady state.
    pub fn look(&mut self, aim: &Aim, known: Known<'_>) {
        if !self.is_looking(known.residency) {
            return;
        }
        let (from, start) = match self.round {
            Some(round) => round,
            None if self.is_queue_of(aim) => return,
            None => (*aim, 0),
        };
        let leaf_count = known.manifest.leaves.len() as u32;
        let end = start.saturating_add(LEAVES_PER_FRAME).min(leaf_count);
        for leaf in start..end {
            if self.chunks_to_ask(leaf, known).next().is_some() {
                self.found.push(candidate(leaf, &from, known));
                if self.found.len() == 2 * QUEUE_LEAVES {
                    self.keep_the_best();
                }
            }
        }
        self.round = Some((from, end));
        if end == leaf_count {
            self.keep_the_best();
            self.found.sort_unstable_by(|a, b| b.order(a));
            std::mem::swap(&mut self.queue, &mut self.found);
            self.found.clear();
            (self.round, self.aim) = (None, Some(from));
            self.rest = self.queue.is_empty().then_some(Rest::Done);
        }
    }

    /// The next chunk to ask for, and what it may take on the GPU, bytes; it counts as asked for. `None` where enough is on its way,
    /// where the next does not fit, and where nothing is left.
    ///
    /// Only for moments when nothing is missing that a frame needs. `load`: what was asked for here and has not come.
    pub fn next(
        &mut self,
        known: Known<'_>,
        load: &Load,
        is_on_the_way: impl Fn(&ChunkRecord) -> bool,
    ) -> Option<(ChunkId, u64)> {
        let Known { manifest, residency, .. } = known;
        if self.rest.is_some() || load.count >= PREFETCH_WINDOW {
            return None;
        }
        while let Some(candidate) = self.queue.last().copied() {
            let record = |chunk: ChunkId| &manifest.chunks[chunk.0 as usize];
            let Some(chunk) = self.chunks_to_ask(candidate.leaf, known).find(|chunk| !is_on_the_way(record(*chunk))) else {
                self.queue.pop();
                continue;
            };
            let room = room_of(record(chunk));
            if load.count > 0 && load.bytes + u64::from(record(chunk).length) > PREFETCH_WINDOW_BYTES {
                return None;
            }
            let taken = residency.resident_bytes().saturating_add(load.room).saturating_add(room);
            if taken > share_of(residency.cap_bytes()) {
                // What is on its way may take less than it might.
                self.rest = (load.count == 0).then_some(Rest::Full);
                return None;
            }
            self.asked_in[chunk.0 as usize] = residency.frame();
            return Some((chunk, room));
        }
        None
    }

    /// A chunk was evicted, or leaves are drawn from others than before: there is something to look for again.
    pub fn look_again(&mut self) {
        self.rest = None;
    }

    /// What was asked for will not come: the connection is gone.
    pub fn forget_asked(&mut self) {
        self.asked_in.fill(0);
        self.rest = None;
    }

    /// Whether the queue is still good.
    fn is_queue_of(&self, aim: &Aim) -> bool {
        let farthest = self.queue.iter().map(|c| c.distance_squared).fold(0.0, f64::max);
        !self.queue.is_empty() && self.aim.is_some_and(|of| !aim.is_far_from(&of, farthest.sqrt()))
    }

    fn keep_the_best(&mut self) {
        if self.found.len() > QUEUE_LEAVES {
            self.found.select_nth_unstable_by(QUEUE_LEAVES, Candidate::order);
            self.found.truncate(QUEUE_LEAVES);
        }
    }

    /// Those of the leaf's chunks that may be asked for. None that was asked for and not needed since: evicted, it would only be evicted
    /// again.
    fn chunks_to_ask(&self, leaf: u32, known: Known<'_>) -> impl Iterator<Item = ChunkId> {
        let Known { manifest, hierarchies, residency, .. } = known;
        chunks_of(manifest, hierarchies, leaf).into_iter().flatten().filter(move |chunk| {
            let asked_in = self.asked_in[chunk.0 as usize];
            let is_new = asked_in == 0 || residency.needed_in(*chunk) > asked_in;
            let is_small = u64::from(manifest.chunks[chunk.0 as usize].length) <= PREFETCH_LARGEST_BYTES;
            is_new && is_small && !residency.is_resident(*chunk)
        })
    }
}

/// Adds to `out` the chunks that lack of those leaves that an aim holds, each once, the nearest leaves' first, as far as there is room.
pub(crate) fn seen_of(leaves: Range<u32>, aim: &Aim, known: Known<'_>, out: &mut Vec<ChunkId>) {
    let Known { manifest, hierarchies, residency, .. } = known;
    let mut seen: Vec<Candidate> = leaves.map(|leaf| candidate(leaf, aim, known)).filter(|c| c.is_ahead).collect();
    seen.sort_unstable_by(Candidate::order);
    let mut listed: HashSet<ChunkId> = out.iter().copied().collect();
    let mut taken = residency.resident_bytes();
    for chunk in seen.iter().flat_map(|candidate| chunks_of(manifest, hierarchies, candidate.leaf)).flatten() {
        if residency.is_resident(chunk) || !listed.insert(chunk) {
            continue;
        }
        taken += room_of(&manifest.chunks[chunk.0 as usize]);
        if taken > share_of(residency.cap_bytes()) {
            return;
        }
        out.push(chunk);
    }
}

/// What a chunk may take on the GPU, bytes: its blob tells only roughly.
pub(crate) fn room_of(record: &ChunkRecord) -> u64 {
    let is_texture = record.kind() == Some(ChunkKind::Texture);
    if is_texture { u64::from(record.length) * TEXTURE_GROWS } else { geometry_room(record.length) }
}

/// What vertices and triangles that come in so many bytes may take on the GPU, bytes.
pub(crate) fn geometry_room(length: u32) -> u64 {
    u64::from(length) * GEOMETRY_GROWS
}

fn candidate(leaf: u32, aim: &Aim, known: Known<'_>) -> Candidate {
    let record = &known.manifest.leaves[leaf as usize];
    let DAffine3 { matrix3, translation } = known.transforms[record.object.0 as usize].affine();
    let bounds = record.local_aabb();
    let center = matrix3 * bounds.center() + translation;
    let half = bounds.size() * 0.5;
    // Along the box's own axes, which the transform may stretch.
    let halves = [matrix3.x_axis * half.x, matrix3.y_axis * half.y, matrix3.z_axis * half.z];
    let radius = halves.iter().map(|h| h.length_squared()).sum::<f64>().sqrt();
    Candidate { is_ahead: aim.meets(center, radius), distance_squared: center.distance_squared(aim.eye), leaf }
}

#[cfg(test)]
mod tests;
