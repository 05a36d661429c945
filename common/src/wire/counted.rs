//! What a node counted: how much of objects' boxes is to be seen on a tile.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use super::frame::take_head;
use super::message::tag;
use super::{MAX_COUNTED, MAX_TO_MASTER_BYTES, WireError, codec, framed, within};
use crate::scene::ObjectId;
use crate::wall::ViewId;

/// How much of an object's box is to be seen in one view: the box around all of the object's own leaves, along the axes of its own space.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ObjectCount {
    /// Which object.
    pub object: ObjectId,
    /// Pixels in which nothing is before the box (NOHC).
    pub visible_px: u32,
    /// From the eye to the box's nearest point beyond the near plane, along the view, metres of the room; 0 where nothing is.
    pub distance_m: f32,
}
const _: () = assert!(size_of::<ObjectCount>() == 12);

/// What a node counted in one view of a frame that it drew. An estimate, of which the master makes what it likes.
#[derive(Clone, Debug, PartialEq)]
pub struct Counted {
    /// The frame.
    pub frame: u64,
    /// The view.
    pub view: ViewId,
    /// At most [`MAX_COUNTED`], by ascending objects, each once.
    pub objects: Vec<ObjectCount>,
}

#[derive(Serialize, Deserialize)]
struct Head {
    frame: u64,
    view: ViewId,
}

impl Counted {
    pub(super) fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        within("objects counted", self.objects.len(), MAX_COUNTED)?;
        framed(out, tag::COUNTED, MAX_TO_MASTER_BYTES, |out| {
            codec::encode_into(&Head { frame: self.frame, view: self.view }, out)?;
            out.extend_from_slice(bytemuck::cast_slice(&self.objects));
            Ok(())
        })
    }

    pub(super) fn decode(mut bytes: &[u8]) -> Result<Self, WireError> {
        let Head { frame, view } = take_head(&mut bytes)?;
        let (counts, rest) = bytes.as_chunks::<{ size_of::<ObjectCount>() }>();
        within("objects counted", counts.len(), MAX_COUNTED)?;
        let objects: Vec<ObjectCount> = counts.iter().map(|count| bytemuck::pod_read_unaligned(count)).collect();
        if !rest.is_empty() || !objects.is_sorted_by(|a, b| a.object < b.object) {
            return Err(WireError::Bulk { what: "objects counted" });
        }
        if !objects.iter().all(|count| count.distance_m.is_finite()) {
            return Err(WireError::NotFinite { what: "an object's distance" });
        }
        Ok(Self { frame, view, objects })
    }
}
