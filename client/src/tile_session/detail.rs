//! Vertex hierarchies: what is fetched of them while frames are drawn in detail, and what the painter is given.
//!
//! ```text
//! bases that the frame lacks → chunks that it lacks → all other bases → the first blocks of all → the second … → chunks of later frames
//! ```
//! What a leaf needs while its object has a hierarchy is the base, and its texture. Nothing of a hierarchy is evicted.

use super::on_the_way::Purpose;
use super::*;
use crate::prefetch::{geometry_room, share_of};

impl TileSession {
    /// Asks for the bases that the newest frame lacks, as far as may be on their way at once; whether none is left to ask for.
    pub(super) fn fetch_bases(&mut self, fetch: &mut Vec<(ChunkHash, u64)>) -> bool {
        let Some(scene) = &mut self.scene else { return false };
        while let Some(hierarchy) = self.lack.bases.get(self.lack.bases_asked) {
            if let Some((place, blob)) = scene.hierarchies.base_to_ask(*hierarchy) {
                let length = u64::from(blob.length);
                if !self.on_the_way.holds(&blob.hash) {
                    if !self.on_the_way.has_room_for(length) {
                        return false;
                    }
                    self.on_the_way.insert(blob.hash, length, Purpose::Need);
                    fetch.push((blob.hash, length));
                }
                scene.hierarchies.note_asked(place);
            }
            self.lack.bases_asked += 1;
        }
        true
    }

    /// Asks for what no frame lacks yet of hierarchies, as far as may be on its way and has room; whether more of it is to be asked for soon.
    pub(super) fn fetch_detail(&mut self, fetch: &mut Vec<(ChunkHash, u64)>) -> bool {
        let Some(scene) = self.scene.as_mut().filter(|_| self.lack.is_detailed) else { return false };
        while let Some((place, blob)) = scene.hierarchies.next_to_ask() {
            let (length, room) = (u64::from(blob.length), geometry_room(blob.length));
            let on_the_way = &mut self.on_the_way;
            if !on_the_way.holds(&blob.hash) {
                let taken = scene.residency.resident_bytes().saturating_add(on_the_way.ahead().room).saturating_add(room);
                if taken > share_of(scene.residency.cap_bytes()) {
                    return false;
                }
                // Those that wait for their turn are here, and still in the way.
                let waits_behind = scene.hierarchies.early() >= PREFETCH_WINDOW && !scene.hierarchies.is_next(place);
                if !on_the_way.has_room_ahead_for(length) || waits_behind {
                    return true;
                }
                on_the_way.insert(blob.hash, length, Purpose::Ahead { room });
                fetch.push((blob.hash, length));
            }
            scene.hierarchies.note_asked(place);
        }
        false
    }

    /// Takes a blob, if it is of hierarchies.
    pub(super) fn take_hierarchies(&mut self, hash: ChunkHash, bytes: &[u8]) {
        let Some(scene) = &mut self.scene else { return };
        for (place, objects, blob) in scene.hierarchies.take(hash, bytes) {
            let number = place.hierarchy;
            if place.blob == 0 && self.lack.is_base_awaited.get_mut(number as usize).is_some_and(std::mem::take) {
                self.lack.left -= 1;
            }
            self.actions.push_back(Action::TakeHierarchy { number, objects, blob });
        }
        scene.residency.set_lasting(scene.hierarchies.bytes());
    }

    /// The painter has taken a hierarchy's blob, and so many bytes are taken by the whole hierarchy there; `None`: it is no hierarchy, and its
    /// objects are drawn from their leaves.
    pub fn hierarchy_taken(&mut self, number: u32, bytes: Option<u64>) {
        let Some(scene) = &mut self.scene else { return };
        match bytes {
            Some(bytes) => scene.hierarchies.resize(number, bytes),
            None => {
                scene.hierarchies.give_up(number);
                self.fall_back(number);
            }
        }
        if let Some(scene) = &mut self.scene {
            scene.residency.set_lasting(scene.hierarchies.bytes());
        }
    }

    /// A blob came damaged too often: the objects of its hierarchies are drawn from their leaves. Whether it is of any.
    pub(super) fn give_up_hierarchies(&mut self, hash: ChunkHash) -> bool {
        let Some(scene) = &mut self.scene else { return false };
        let given_up = scene.hierarchies.give_up_asked(hash);
        scene.residency.set_lasting(scene.hierarchies.bytes());
        for number in &given_up {
            self.fall_back(*number);
            self.actions.push_back(Action::ForgetHierarchy(*number));
        }
        !given_up.is_empty()
    }

    /// Nothing comes of a hierarchy any more, and frames lack other chunks than was found.
    fn fall_back(&mut self, given_up: u32) {
        self.actions.retain(|action| !matches!(action, Action::TakeHierarchy { number, .. } if *number == given_up));
        self.lack.is_outdated = true;
        if let Some(scene) = &mut self.scene {
            scene.prefetch.look_again();
        }
    }
}
