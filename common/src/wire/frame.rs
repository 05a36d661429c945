//! The frame: what every view of a node sees, and from where.

use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

use super::{
    Detail, Estimate, MAX_AWAY_RANGES, MAX_DROPPED_RANGES, MAX_TO_TILE_BYTES, MAX_VIEWS, Primary, WireError, codec, framed,
    message::tag,
    primary::PrimaryHead,
    ranges::{put_set, take_set},
    within,
};
use crate::scene::{ObjectId, Transform};
use crate::visible_set::{VisibleDelta, VisibleSet};

/// What a view may spend on a frame. Nothing said, nothing limited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Budget {
    /// Most triangles.
    pub triangles: Option<u32>,
    /// Most time on the GPU, microseconds.
    pub gpu_us: Option<u32>,
}

/// One view's part of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameView {
    /// Where its eye is, room space, metres.
    pub eye: DVec3,
    /// What it may spend.
    pub budget: Budget,
    /// What it sees, against the frame's base.
    pub leaves: VisibleDelta,
    /// [`VisibleSet::digest`](crate::visible_set::VisibleSet::digest) of all that it sees.
    pub digest: u64,
}

/// An object's new place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved {
    /// Which object.
    pub object: ObjectId,
    /// Its `world_from_local`.
    pub transform: Transform,
}

/// A frame for one node.
///
/// As bytes after the tag: number u64, epoch u32, scene time f64, `world_from_room` 12 × f64 (three columns and the
/// translation), shared eye 3 × f64, base `Option<u64>`, digest u64 of all that is dropped, where the wall looks as an `Option` of pixels per
/// radian f32 and count of planes u32, the estimate as an `Option` of triangles u32 and complete u8, the detail as an `Option` of triangles `Option<u32>`, least
/// pixels f32, hides u8 and weight u8, view count u32, count of moved objects u32; for each of these planes: normal 3 × f64, offset f64; for each view: eye
/// 3 × f64, budget `Option<u32>` triangles, `Option<u32>` microseconds, digest u64 of the whole set; for each view: the set of leaves removed, the set
/// of leaves added (a set is a uvarint count, then per range the uvarint distance from one past the end of the range
/// before, or from 0, and the uvarint length less one); in the same way what is dropped no more, what is dropped, and what is away; for each
/// moved object: id u32, 12 × f64.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Its number: one more than that of the frame before.
    pub number: u64,
    /// Which manifest its leaves and objects are of.
    pub epoch: u32,
    /// Time in the scene, seconds.
    pub scene_time_s: f64,
    /// Where the room is in the world.
    pub world_from_room: DAffine3,
    /// The eye that all views share for what must agree across seams, as the order of blended leaves; world space.
    pub shared_eye: DVec3,
    /// The frame that the deltas are against; `None`: against empty sets.
    pub base: Option<u64>,
    /// In the order of the views in the welcome.
    pub views: Vec<FrameView>,
    /// Leaves that no view of the wall draws, though some see them: their objects hardly contribute. Against the frame's base. An estimate,
    /// and no part of any visible set; the same for all nodes.
    pub dropped: VisibleDelta,
    /// [`VisibleSet::digest`](crate::visible_set::VisibleSet::digest) of all that is dropped.
    pub dropped_digest: u64,
    /// Where the wall looks, the same for all nodes; there where an estimate or a detail is ordered.
    pub primary: Option<Box<Primary>>,
    /// To which budget an estimate of what is visible is drawn, the same for all nodes; `None`: all that is seen is drawn.
    pub estimate: Option<Estimate>,
    /// How finely hierarchies of detail are drawn, the same for all nodes; `None`: they are not, and leaves are.
    pub detail: Option<Detail>,
    /// The leaves of objects with hierarchies of detail that are out of the scene: all of them, against no base; the same for all nodes. Only a
    /// detail is for them.
    pub away: VisibleSet,
    /// Every object that moved since the base, or since the manifest where there is no base.
    pub moved: Vec<Moved>,
}

#[derive(Serialize, Deserialize)]
struct Head {
    number: u64,
    epoch: u32,
    scene_time_s: f64,
    world_from_room: [f64; 12],
    shared_eye: [f64; 3],
    base: Option<u64>,
    dropped_digest: u64,
    primary: Option<PrimaryHead>,
    estimate: Option<Estimate>,
    detail: Option<Detail>,
    views: u32,
    moved: u32,
}

#[derive(Serialize, Deserialize)]
struct ViewHead {
    eye: [f64; 3],
    budget: Budget,
    digest: u64,
}

const HEAD_CAP: usize = 256;
/// A view's bytes at least: an eye, no budget, a digest.
const LEAST_VIEW_BYTES: usize = 34;
const MOVED_BYTES: usize = 4 + size_of::<Transform>();

impl Frame {
    /// Writes the whole message to `out`, which it empties first. Allocates only where `out` must grow.
    ///
    /// # Errors
    /// When the frame passes a cap.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        within("views", self.views.len(), MAX_VIEWS)?;
        check_dropped(&self.dropped)?;
        check_away(&self.away)?;
        check_orders(self.primary.is_some(), self.estimate.as_ref(), self.detail.as_ref())?;
        let primary = self.primary.as_deref().map(Primary::head).transpose()?;
        framed(out, tag::FRAME, MAX_TO_TILE_BYTES, |out| {
            let head = Head {
                number: self.number,
                epoch: self.epoch,
                scene_time_s: self.scene_time_s,
                world_from_room: self.world_from_room.to_cols_array(),
                shared_eye: self.shared_eye.to_array(),
                base: self.base,
                dropped_digest: self.dropped_digest,
                primary,
                estimate: self.estimate,
                detail: self.detail,
                views: self.views.len() as u32,
                moved: self.moved.len() as u32,
            };
            codec::encode_into(&head, out)?;
            self.primary.iter().for_each(|primary| primary.put_planes(out));
            for view in &self.views {
                codec::encode_into(&ViewHead { eye: view.eye.to_array(), budget: view.budget, digest: view.digest }, out)?;
            }
            for view in &self.views {
                put_set(out, &view.leaves.removed);
                put_set(out, &view.leaves.added);
            }
            put_set(out, &self.dropped.removed);
            put_set(out, &self.dropped.added);
            put_set(out, &self.away);
            put_moved(out, &self.moved);
            Ok(())
        })
    }

    pub(super) fn decode(mut bytes: &[u8]) -> Result<Self, WireError> {
        let head: Head = take_head(&mut bytes)?;
        within("views", head.views as usize, MAX_VIEWS)?;
        let finite = |what, ok| if ok { Ok(()) } else { Err(WireError::NotFinite { what }) };
        let world_from_room = DAffine3::from_cols_array(&head.world_from_room);
        let shared_eye = DVec3::from(head.shared_eye);
        finite("scene time", head.scene_time_s.is_finite())?;
        finite("world_from_room", world_from_room.is_finite())?;
        finite("shared eye", shared_eye.is_finite())?;
        check_orders(head.primary.is_some(), head.estimate.as_ref(), head.detail.as_ref())?;
        let primary = head.primary.as_ref().map(|head| Primary::take(head, &mut bytes).map(Box::new)).transpose()?;
        // No memory for views that the body has no room for.
        let mut views = Vec::with_capacity((head.views as usize).min(bytes.len() / LEAST_VIEW_BYTES));
        for _ in 0..head.views {
            let ViewHead { eye, budget, digest } = take_head(&mut bytes)?;
            let eye = DVec3::from(eye);
            finite("eye", eye.is_finite())?;
            views.push(FrameView { eye, budget, leaves: VisibleDelta::default(), digest });
        }
        for view in &mut views {
            take_set(&mut bytes, &mut view.leaves.removed)?;
            take_set(&mut bytes, &mut view.leaves.added)?;
        }
        let mut dropped = VisibleDelta::default();
        take_set(&mut bytes, &mut dropped.removed)?;
        take_set(&mut bytes, &mut dropped.added)?;
        check_dropped(&dropped)?;
        let mut away = VisibleSet::default();
        take_set(&mut bytes, &mut away)?;
        check_away(&away)?;
        if head.base.is_some_and(|base| base >= head.number) {
            return Err(WireError::Bulk { what: "base" });
        }
        let moved = take_moved(bytes, head.moved)?;
        Ok(Self {
            number: head.number,
            epoch: head.epoch,
            scene_time_s: head.scene_time_s,
            world_from_room,
            shared_eye,
            base: head.base,
            views,
            dropped,
            dropped_digest: head.dropped_digest,
            primary,
            estimate: head.estimate,
            detail: head.detail,
            away,
            moved,
        })
    }
}

/// What is ordered is in its range, and says where the wall looks.
fn check_orders(has_primary: bool, estimate: Option<&Estimate>, detail: Option<&Detail>) -> Result<(), WireError> {
    if !has_primary && (estimate.is_some() || detail.is_some()) {
        return Err(WireError::Bulk { what: "primary frustum" });
    }
    let is_valid = detail.is_none_or(Detail::is_valid);
    if is_valid { Ok(()) } else { Err(WireError::NotFinite { what: "pixels of the detail" }) }
}

fn check_dropped(dropped: &VisibleDelta) -> Result<(), WireError> {
    let most = dropped.removed.ranges().len().max(dropped.added.ranges().len());
    within("ranges of leaves that are dropped", most, MAX_DROPPED_RANGES)
}

fn check_away(away: &VisibleSet) -> Result<(), WireError> {
    within("ranges of leaves that are away", away.ranges().len(), MAX_AWAY_RANGES)
}

/// Appends moved objects: of each its id and its transform.
pub(super) fn put_moved(out: &mut Vec<u8>, moved: &[Moved]) {
    for moved in moved {
        out.extend_from_slice(&moved.object.0.to_le_bytes());
        out.extend_from_slice(bytemuck::bytes_of(&moved.transform));
    }
}

/// Reads so many moved objects, which end the body.
pub(super) fn take_moved(bytes: &[u8], count: u32) -> Result<Vec<Moved>, WireError> {
    if (count as usize).checked_mul(MOVED_BYTES) != Some(bytes.len()) {
        return Err(WireError::Bulk { what: "moved objects" });
    }
    let moved = bytes.chunks_exact(MOVED_BYTES).map(|bytes| {
        let (object, transform) = bytes.split_at(4);
        Moved { object: ObjectId(bytemuck::pod_read_unaligned(object)), transform: bytemuck::pod_read_unaligned(transform) }
    });
    let moved: Vec<Moved> = moved.collect();
    let is_finite = moved.iter().all(|m| m.transform.is_finite());
    if is_finite { Ok(moved) } else { Err(WireError::NotFinite { what: "transform" }) }
}

pub(super) fn take_head<T: serde::de::DeserializeOwned>(bytes: &mut &[u8]) -> Result<T, WireError> {
    let (head, used) = codec::decode_prefix::<T, HEAD_CAP>(bytes)?;
    *bytes = &bytes[used..];
    Ok(head)
}
