//! Which objects are counted when, so that the master may find what hardly contributes to the wall's picture.
//!
//! In each view some objects every so many frames, as the welcome says: those that it sees, in turn, and before them those of these that are
//! dropped, in a turn of their own, so that they come back soon. What is counted is the picture of a frame
//! that is shown, while there is nothing else to do: no swap waits for it.

use mullion_common::visible_set::VisibleSet;
use mullion_common::wire::{Counted, MAX_COUNTED, ObjectCount};

use super::*;

/// Most objects counted a view and time that are dropped.
const MAX_DROPPED_COUNTED: usize = MAX_COUNTED / 2;
/// Leaves looked through for objects to count, at most, a view and time.
const MAX_LEAVES_LOOKED_AT: usize = 4096;

/// What is to be counted in one view.
#[derive(Clone, Debug, PartialEq)]
pub struct CountOrder {
    /// Which view, by its place in the frame.
    pub place: usize,
    /// Whose boxes: ascending, each once, at most [`MAX_COUNTED`].
    pub objects: Vec<ObjectId>,
}

/// When what is counted.
#[derive(Debug, Default)]
pub(super) struct Counting {
    /// 0: never.
    pub every: u32,
    views: Vec<Turns>,
    drawn: VisibleSet,
    dropped: VisibleSet,
}

/// A view's.
#[derive(Debug, Default)]
struct Turns {
    /// The frame that is counted next, or one after it.
    due: Option<u64>,
    drawn: Turn,
    dropped: Turn,
}

/// A way through a set that changes, from object to object.
#[derive(Debug, Default)]
struct Turn {
    next_leaf: u32,
    number: u32,
    /// By object: the last turn in which it was taken, plus one.
    taken: Vec<u32>,
}

impl Counting {
    /// Another master, or another scene.
    pub fn begin_anew(&mut self) {
        self.views.clear();
    }

    /// What is to be counted of a frame that is shown.
    pub fn orders(&mut self, frame: &FrameToDraw, manifest: &SceneManifest, orders: &mut Vec<CountOrder>) {
        if self.every == 0 {
            return;
        }
        let every = u64::from(self.every);
        self.views.resize_with(frame.views.len(), Turns::default);
        for (place, (view, turns)) in frame.views.iter().zip(&mut self.views).enumerate() {
            // Not all views of a wall in the same frame.
            let due = *turns.due.get_or_insert(frame.number + u64::from(view.view.0) % every);
            // What lacks hides nothing, and its box in its place too much.
            if frame.number < due || !view.missing.is_empty() {
                continue;
            }
            turns.due = Some(frame.number + every);
            view.leaves.intersection_into(&frame.dropped, &mut self.dropped);
            view.leaves.difference_into(&frame.dropped, &mut self.drawn);
            let mut objects = Vec::new();
            turns.dropped.take(&self.dropped, manifest, MAX_DROPPED_COUNTED, &mut objects);
            turns.drawn.take(&self.drawn, manifest, MAX_COUNTED, &mut objects);
            objects.sort_unstable();
            objects.dedup();
            if !objects.is_empty() {
                orders.push(CountOrder { place, objects });
            }
        }
    }
}

impl Turn {
    /// Takes the next objects of a set, until there are so many; each once in a turn, which begins anew when the set is at its end.
    fn take(&mut self, set: &VisibleSet, manifest: &SceneManifest, most: usize, objects: &mut Vec<ObjectId>) {
        self.taken.resize(manifest.transforms.len(), 0);
        let ranges = set.ranges();
        let rest = &ranges[ranges.partition_point(|range| range.end <= self.next_leaf)..];
        let next_leaf = self.next_leaf;
        let left = rest.iter().flat_map(|range| range.start.max(next_leaf)..range.end);
        for (looked_at, leaf) in left.enumerate() {
            if objects.len() == most || looked_at == MAX_LEAVES_LOOKED_AT {
                self.next_leaf = leaf;
                return;
            }
            let object = manifest.leaves[leaf as usize].object;
            if std::mem::replace(&mut self.taken[object.0 as usize], self.number + 1) != self.number + 1 {
                objects.push(object);
            }
        }
        (self.next_leaf, self.number) = (0, self.number.wrapping_add(1));
    }
}

impl TileSession {
    /// Orders what is to be counted of the frame that was drawn last, before another one is. Where objects have moved meanwhile for the next
    /// one, their boxes are counted where they stand now.
    pub(super) fn order_counts(&mut self, frame: u64) {
        let drawn = self.acknowledged.back().filter(|drawn| drawn.number == frame);
        let (Some(scene), Some(drawn)) = (&self.scene, drawn) else { return };
        let mut orders = Vec::new();
        self.counting.orders(drawn, &scene.manifest, &mut orders);
        self.actions.extend(orders.into_iter().map(|order| Action::Count(Arc::clone(drawn), order)));
    }

    /// What came of an [`Action::Count`]; of a painter that cannot count, nothing.
    pub fn counted(&mut self, frame: u64, view: ViewId, objects: Vec<ObjectCount>) {
        if !self.closed && !objects.is_empty() {
            self.actions.push_back(Action::Send(ToMaster::Counted(Counted { frame, view, objects })));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mullion_common::scene::{LeafRecord, MaterialId};
    use mullion_common::visible_set::LeafRange;

    /// Three leaves an object, one after the other, and every tenth object's are apart.
    fn manifest(objects: u32) -> SceneManifest {
        let owner = |leaf: u32| if leaf % 30 == 17 { 0 } else { leaf / 3 };
        let leaf = |leaf: u32| LeafRecord {
            object: ObjectId(owner(leaf)),
            chunk: ChunkId(0),
            material: MaterialId(0),
            triangle_count: 1,
            local_min: [0.0; 3],
            local_max: [1.0; 3],
        };
        let transforms = vec![Transform::from(DAffine3::IDENTITY); objects as usize];
        SceneManifest { leaves: (0..3 * objects).map(leaf).collect(), transforms, ..SceneManifest::default() }
    }

    fn frame(number: u64, view: u16, dropped: &[(u32, u32)]) -> FrameToDraw {
        let view = ViewToDraw {
            view: ViewId(view),
            eye: DVec3::Z,
            budget: Budget::default(),
            leaves: VisibleSet::from_ranges([LeafRange::new(30, 900), LeafRange::new(1200, 2700)]),
            missing: VisibleSet::default(),
        };
        let dropped = VisibleSet::from_ranges(dropped.iter().map(|&(start, end)| LeafRange::new(start, end)));
        FrameToDraw { number, views: vec![view], dropped, ..FrameToDraw::default() }
    }

    #[test]
    fn every_object_in_view_has_its_turn_and_dropped_ones_more_often() {
        let manifest = manifest(1000);
        let mut counting = Counting { every: 4, ..Counting::default() };
        // Objects 20 to 29, and some that the view does not see.
        let dropped = [(60, 90), (900, 1100)];
        let (mut times, mut orders) = (vec![0; 1000], Vec::new());
        for number in 0..160 {
            orders.clear();
            counting.orders(&frame(number, 7, &dropped), &manifest, &mut orders);
            assert_eq!(orders.len(), usize::from(number % 4 == 3), "view 7 is counted three frames after view 0");
            for CountOrder { objects, .. } in &orders {
                assert!(objects.is_sorted_by(|a, b| a < b) && objects.len() <= MAX_COUNTED);
                objects.iter().for_each(|object| times[object.0 as usize] += 1);
            }
        }
        // 40 times the dropped ones; of 781 others 246 each time, four times a turn.
        let owners: std::collections::BTreeSet<u32> =
            (30..900).chain(1200..2700).map(|leaf| manifest.leaves[leaf as usize].object.0).collect();
        for (object, times) in (0..).zip(times) {
            let expected = if (20..30).contains(&object) { 40..=40 } else { 10..=10 };
            // Some of object 0's leaves are dropped, and some are not: so no master speaks.
            let is_as_expected = if object == 0 { times >= 10 } else { expected.contains(&times) };
            assert!(if owners.contains(&object) { is_as_expected } else { times == 0 }, "object {object}: {times} times");
        }
    }

    #[test]
    fn nothing_is_counted_where_something_lacks_or_nobody_asks() {
        let (manifest, mut orders) = (manifest(1000), Vec::new());
        Counting::default().orders(&frame(0, 0, &[]), &manifest, &mut orders);
        assert!(orders.is_empty());
        let mut counting = Counting { every: 1, ..Counting::default() };
        let mut lacking = frame(0, 0, &[]);
        lacking.views[0].missing = VisibleSet::from_ranges([LeafRange::new(30, 31)]);
        counting.orders(&lacking, &manifest, &mut orders);
        assert!(orders.is_empty());
        counting.orders(&frame(1, 0, &[]), &manifest, &mut orders);
        assert_eq!(orders.len(), 1);
    }

    /// A node that draws every fourth frame counts in each of them, whichever those are.
    #[test]
    fn a_slow_node_counts_all_the_same() {
        let (manifest, mut orders) = (manifest(1000), Vec::new());
        let mut counting = Counting { every: 4, ..Counting::default() };
        (0..10).for_each(|k| counting.orders(&frame(5 + 4 * k, 2, &[]), &manifest, &mut orders));
        assert_eq!(orders.len(), 9, "all but the first");
    }
}
