//! The front F: a priority queue with decrease-key, as a heap of four children a node that knows where each entry is.

use mullion_common::scene::CellId;

const CHILDREN: usize = 4;
const NOWHERE: u32 = u32::MAX;

/// What waits in the front: a cell, or a part of one's triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Entry(pub u32);

/// Entries in order of their keys, and of their numbers where keys are equal: one order on every machine.
#[derive(Debug, Default)]
pub(super) struct Front {
    heap: Vec<(f32, Entry)>,
    /// Where each entry is in the heap.
    places: Vec<u32>,
}

impl Front {
    /// Empties it and makes room for entries below `entries`; takes memory only where there was less.
    pub fn clear(&mut self, entries: usize) {
        for (_, entry) in self.heap.drain(..) {
            self.places[entry.0 as usize] = NOWHERE;
        }
        if self.places.len() != entries {
            self.places.clear();
            self.places.resize(entries, NOWHERE);
        }
    }

    /// Enqueues an entry, or moves it to its new key.
    pub fn enqueue(&mut self, entry: Entry, key: f32) {
        let place = self.places[entry.0 as usize];
        if place == NOWHERE {
            self.heap.push((key, entry));
            self.rise(self.heap.len() - 1);
        } else if less((key, entry), self.heap[place as usize]) {
            self.heap[place as usize].0 = key;
            self.rise(place as usize);
        } else {
            self.heap[place as usize].0 = key;
            self.sink(place as usize);
        }
    }

    /// min(F), taken out.
    pub fn pop(&mut self) -> Option<(f32, Entry)> {
        let last = self.heap.pop()?;
        let first = match self.heap.first_mut() {
            Some(first) => {
                let first = std::mem::replace(first, last);
                self.sink(0);
                first
            }
            None => last,
        };
        self.places[first.1.0 as usize] = NOWHERE;
        Some(first)
    }

    /// All entries, in no order.
    pub fn entries(&self) -> impl Iterator<Item = Entry> {
        self.heap.iter().map(|(_, entry)| *entry)
    }

    fn rise(&mut self, mut at: usize) {
        let item = self.heap[at];
        while at > 0 {
            let parent = (at - 1) / CHILDREN;
            if !less(item, self.heap[parent]) {
                break;
            }
            self.put(at, self.heap[parent]);
            at = parent;
        }
        self.put(at, item);
    }

    fn sink(&mut self, mut at: usize) {
        let item = self.heap[at];
        loop {
            let first = CHILDREN * at + 1;
            let Some(children) = self.heap.get(first..(first + CHILDREN).min(self.heap.len())) else { break };
            let mut least = 0;
            for k in 1..children.len() {
                if less(children[k], children[least]) {
                    least = k;
                }
            }
            if children.is_empty() || !less(children[least], item) {
                break;
            }
            let child = children[least];
            self.put(at, child);
            at = first + least;
        }
        self.put(at, item);
    }

    fn put(&mut self, at: usize, item: (f32, Entry)) {
        self.heap[at] = item;
        self.places[item.1.0 as usize] = at as u32;
    }
}

/// The order of keys, then entries. Keys are never NaN.
#[inline]
fn less(a: (f32, Entry), b: (f32, Entry)) -> bool {
    a.0 < b.0 || a.0 == b.0 && a.1 < b.1
}

impl From<CellId> for Entry {
    fn from(cell: CellId) -> Self {
        Self(cell.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        /// Goal: the heap is a queue. Method: every operation on a plain map, too.
        #[test]
        fn it_does_what_a_map_would(steps in proptest::collection::vec((0..40u32, 0..9u8, prop::bool::weighted(0.3)), 1..300)) {
            let mut front = Front::default();
            front.clear(40);
            let mut map: BTreeMap<u32, f32> = BTreeMap::new();
            for (entry, key, is_pop) in steps {
                if is_pop {
                    let least = map.iter().min_by(|a, b| a.1.total_cmp(b.1).then(a.0.cmp(b.0))).map(|(e, k)| (*k, Entry(*e)));
                    prop_assert_eq!(front.pop(), least);
                    least.map(|(_, entry)| map.remove(&entry.0));
                } else {
                    front.enqueue(Entry(entry), key.into());
                    map.insert(entry, key.into());
                }
                let mut entries: Vec<u32> = front.entries().map(|entry| entry.0).collect();
                entries.sort_unstable();
                prop_assert_eq!(entries, map.keys().copied().collect::<Vec<_>>());
            }
            front.clear(40);
            prop_assert_eq!(front.pop(), None);
        }
    }
}
