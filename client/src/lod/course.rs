//! When the occluder is drawn anew, kept, or not asked at all: by a frame's number, so that nodes of a wall which follow it agree, those that
//! come late from the next turn on.

use super::{OccluderFrom, Refinement};

/// An occluder that hides something is drawn anew in frames whose number is a multiple of this.
const KEPT_FRAMES: u64 = 8;
/// Whether one would hide something is found out in frames whose number is a multiple of this.
const ASKED_AGAIN: u64 = 32;
/// Of what it is asked it must hide such a share to be kept: where little is hidden, questions cost more than they save.
const LEAST_HIDDEN: f32 = 0.06;

/// The course of an occluder from frame to frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct OccluderCourse {
    is_worth: bool,
}

impl OccluderCourse {
    /// Where a frame's occluder comes from; `None`: nothing is taken to be hidden in it.
    pub fn at(&self, frame: u64) -> Option<OccluderFrom> {
        let is_turn = frame.is_multiple_of(if self.is_worth { KEPT_FRAMES } else { ASKED_AGAIN });
        match (is_turn, self.is_worth) {
            (true, _) => Some(OccluderFrom::ThisFrame),
            (false, true) => Some(OccluderFrom::EarlierFrame),
            (false, false) => None,
        }
    }

    /// Learns from a frame that drew its occluder.
    pub fn note(&mut self, found: &Refinement) {
        self.is_worth = found.hidden_share() >= LEAST_HIDDEN;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_come_by_the_frame() {
        let course = |is_worth| OccluderCourse { is_worth };
        assert_eq!([0, 32, 96].map(|frame| course(false).at(frame)), [Some(OccluderFrom::ThisFrame); 3]);
        assert_eq!([1, 8, 31].map(|frame| course(false).at(frame)), [None; 3]);
        assert_eq!([0, 8, 40].map(|frame| course(true).at(frame)), [Some(OccluderFrom::ThisFrame); 3]);
        assert_eq!([1, 7, 33].map(|frame| course(true).at(frame)), [Some(OccluderFrom::EarlierFrame); 3]);
        let mut learning = course(true);
        learning.note(&Refinement::new());
        assert_eq!(learning.at(8), None, "nothing was hidden");
    }
}
