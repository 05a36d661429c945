//! When the occluder is drawn anew, renewed, kept, or not asked at all: by a frame's number, so that nodes of a wall agree. One that comes late, or
//! missed the frame in which the others drew or renewed theirs, agrees from the next turn on: with the frame that draws it from nothing.

use super::{OccluderFrom, Refinement};

/// An occluder is drawn anew every so many frames: whether it would hide something, too, is found out then.
const TURN_FRAMES: u64 = 64;
/// One that hides something is renewed every so many frames: that takes a third to two thirds of what a turn does (`mullion bench lod`).
const KEPT_FRAMES: u64 = 16;
/// One in which something has moved far is drawn anew at the next of every so many frames: movers cost one such frame in four at most.
const MOVED_FRAMES: u64 = 4;
/// Of what it is asked it must hide such a share to be kept. Below it improves what is seen by less than 5 % (`mullion bench lod`).
const LEAST_HIDDEN: f32 = 0.06;

/// The course of an occluder from frame to frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct OccluderCourse {
    is_worth: bool,
    /// The frame that drew or renewed it last.
    drawn: Option<u64>,
}

impl OccluderCourse {
    /// Where a frame's occluder comes from; `None`: nothing is taken to be hidden in it.
    pub fn at(&self, frame: u64) -> Option<OccluderFrom> {
        match self.is_worth {
            _ if self.is_past(TURN_FRAMES, frame) => Some(OccluderFrom::ThisFrame),
            true if self.is_past(KEPT_FRAMES, frame) => Some(OccluderFrom::EarlierFrameRenewed),
            true => Some(OccluderFrom::EarlierFrame),
            false => None,
        }
    }

    /// Whether an occluder in which something has moved is drawn anew in a frame.
    pub fn follows_at(&self, frame: u64) -> bool {
        self.is_worth && self.is_past(MOVED_FRAMES, frame)
    }

    /// Whether a multiple of a period came since the occluder was drawn.
    fn is_past(&self, period: u64, frame: u64) -> bool {
        self.drawn.is_none_or(|drawn| drawn / period != frame / period)
    }

    /// Learns from a frame that drew its occluder.
    pub fn note(&mut self, frame: u64, found: &Refinement) {
        self.is_worth = found.hidden_share() >= LEAST_HIDDEN;
        self.note_renewed(frame);
    }

    /// A frame has renewed it. That tells nothing of its worth: what was answered earlier is not asked.
    pub fn note_renewed(&mut self, frame: u64) {
        self.drawn = Some(frame);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_come_by_the_frame() {
        let course = |is_worth| OccluderCourse { is_worth, drawn: Some(65) };
        assert_eq!(OccluderCourse::default().at(5), Some(OccluderFrom::ThisFrame), "it comes late");
        assert_eq!([66, 80, 127].map(|frame| course(false).at(frame)), [None; 3]);
        assert_eq!([128, 129, 193].map(|frame| course(false).at(frame)), [Some(OccluderFrom::ThisFrame); 3]);
        assert_eq!([66, 79].map(|frame| course(true).at(frame)), [Some(OccluderFrom::EarlierFrame); 2]);
        let renewed = [80, 81, 97].map(|frame| course(true).at(frame));
        assert_eq!(renewed, [Some(OccluderFrom::EarlierFrameRenewed); 3], "one may be missed");
        assert_eq!([128, 130, 192].map(|frame| course(true).at(frame)), [Some(OccluderFrom::ThisFrame); 3]);
        assert_eq!([66, 67, 68, 75].map(|frame| course(true).follows_at(frame)), [false, false, true, true]);
        assert!(!course(false).follows_at(68), "what hides nothing need not follow");
        let mut learning = course(true);
        learning.note_renewed(96);
        assert_eq!(
            [97, 112].map(|frame| learning.at(frame)),
            [OccluderFrom::EarlierFrame, OccluderFrom::EarlierFrameRenewed].map(Some)
        );
        learning.note(96, &Refinement::new());
        assert_eq!(learning.at(112), None, "nothing was hidden");
    }
}
