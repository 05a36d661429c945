//! Which objects came and went, so that whoever hears it in order has the same of them.

use std::collections::{BTreeMap, HashMap};

use mullion_common::scene::{ObjectId, Presence};

/// The last word on each object, oldest first. An object comes and goes with all below it, so that the order counts between objects; an
/// earlier word on the same object does not, since the last one is on the same leaves. At most as many as the scene has objects.
#[derive(Debug, Default)]
pub(crate) struct LastWords {
    /// Object, presence, and the frame in which it was said; by when it was said.
    words: BTreeMap<u64, (ObjectId, Presence, u64)>,
    place_of: HashMap<ObjectId, u64>,
    next: u64,
}

impl LastWords {
    /// Takes a word; frames never go back.
    pub fn say(&mut self, object: ObjectId, presence: Presence, frame: u64) {
        if let Some(place) = self.place_of.insert(object, self.next) {
            self.words.remove(&place);
        }
        self.words.insert(self.next, (object, presence, frame));
        self.next += 1;
    }

    pub fn clear(&mut self) {
        self.words.clear();
        self.place_of.clear();
    }

    /// Makes `out` those that were said after a frame; all where there is none.
    pub fn since(&self, frame: Option<u64>, out: &mut Vec<(ObjectId, Presence)>) {
        out.clear();
        let newest_first = self.words.values().rev().take_while(|(_, _, said)| frame.is_none_or(|frame| *said > frame));
        out.extend(newest_first.map(|(object, presence, _)| (*object, *presence)));
        out.reverse();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Objects of a file's tree, by the leaves of each and all below it.
    const LEAVES: [std::ops::Range<usize>; 6] = [0..8, 0..4, 4..8, 0..1, 2..4, 7..8];

    fn away(words: &[(ObjectId, Presence)]) -> [bool; 8] {
        let mut away = [false; 8];
        for (object, presence) in words {
            away[LEAVES[object.0 as usize].clone()].fill(*presence == Presence::Away);
        }
        away
    }

    proptest! {
        #[test]
        fn whoever_hears_part_by_part_has_the_same_leaves(
            said in proptest::collection::vec((0..6u32, any::<bool>()), 0..40), each in 1..8usize, from in 0..40u64,
        ) {
            let said: Vec<(ObjectId, Presence)> = said.into_iter()
                .map(|(object, is_away)| (ObjectId(object), if is_away { Presence::Away } else { Presence::There }))
                .collect();
            let (mut master, mut standby, mut words) = (LastWords::default(), LastWords::default(), Vec::new());
            let frames = said.chunks(each).enumerate();
            for (frame, chunk) in frames.map(|(frame, chunk)| (frame as u64, chunk)) {
                chunk.iter().for_each(|(object, presence)| master.say(*object, *presence, frame));
                // Heard from its first frame on; before that, nothing.
                let base = frame.checked_sub(1).filter(|before| *before >= from);
                if frame >= from {
                    master.since(base, &mut words);
                    words.iter().for_each(|(object, presence)| standby.say(*object, *presence, frame));
                }
            }
            master.since(None, &mut words);
            prop_assert!(words.len() <= LEAVES.len());
            prop_assert_eq!(away(&words), away(&said));
            if said.chunks(each).len() as u64 > from {
                standby.since(None, &mut words);
                prop_assert_eq!(away(&words), away(&said));
            }
        }
    }
}
