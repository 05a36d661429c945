//! When the occluder is drawn anew, kept, or not asked at all: by a frame's number, so that nodes of a wall agree. One that comes late, or missed
//! the frame in which the others drew theirs, agrees from the next turn on.

use super::{OccluderFrom, Refinement};

/// An occluder that hides something is drawn anew every so many frames.
const KEPT_FRAMES: u64 = 16;
/// Whether one would hide something is found out every so many frames.
const ASKED_AGAIN: u64 = 64;
/// Of what it is asked it must hide such a share to be kept. Below it improves what is seen by less than 5 % (`mullion bench lod`).
const LEAST_HIDDEN: f32 = 0.06;

/// The course of an occluder from frame to frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct OccluderCourse {
    is_worth: bool,
    /// The frame that drew it last.
    drawn: Option<u64>,
}

impl OccluderCourse {
    /// Where a frame's occluder comes from; `None`: nothing is taken to be hidden in it.
    pub fn at(&self, frame: u64) -> Option<OccluderFrom> {
        let period = if self.is_worth { KEPT_FRAMES } else { ASKED_AGAIN };
        let is_turn = self.drawn.is_none_or(|drawn| drawn / period != frame / period);
        match (is_turn, self.is_worth) {
            (true, _) => Some(OccluderFrom::ThisFrame),
            (false, true) => Some(OccluderFrom::EarlierFrame),
            (false, false) => None,
        }
    }

    /// Learns from a frame that drew its occluder.
    pub fn note(&mut self, frame: u64, found: &Refinement) {
        self.drawn = Some(frame);
        self.is_worth = found.hidden_share() >= LEAST_HIDDEN;
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
        assert_eq!([80, 81, 97].map(|frame| course(true).at(frame)), [Some(OccluderFrom::ThisFrame); 3], "one may be missed");
        let mut learning = course(true);
        learning.note(96, &Refinement::new());
        assert_eq!(learning.at(112), None, "nothing was hidden");
    }
}
