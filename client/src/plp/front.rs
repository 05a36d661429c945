//! The front F: a priority queue with decrease-key, as a heap of four children a node that knows where each entry is.

use mullion_common::scene::CellId;

const CHILDREN: usize = 4;
const NOWHERE: u32 = u32::MAX;

/// Cells in order of their keys, and of their numbers where keys are equal: one order on every machine.
#[derive(Debug, Default)]
pub(super) struct Front {
    heap: Vec<Entry>,
    /// Where each cell is in the heap.
    places: Vec<u32>,
}

/// A key and its cell, as one number in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Entry(u64);

impl Entry {
    const SIGN: u32 = 1 << 31;

    /// Of a key that is not NaN.
    #[inline]
    fn new(key: f32, cell: CellId) -> Self {
        let bits = key.to_bits();
        let ascending = if bits & Self::SIGN == 0 { bits | Self::SIGN } else { !bits };
        Self(u64::from(ascending) << u32::BITS | u64::from(cell.0))
    }

    #[inline]
    fn cell(self) -> CellId {
        CellId(self.0 as u32)
    }

    #[inline]
    fn key(self) -> f32 {
        let ascending = (self.0 >> u32::BITS) as u32;
        f32::from_bits(if ascending & Self::SIGN == 0 { !ascending } else { ascending ^ Self::SIGN })
    }
}

impl Front {
    /// Empties it and makes room for `cells`; takes memory only where there was less.
    pub fn clear(&mut self, cells: usize) {
        for entry in self.heap.drain(..) {
            self.places[entry.cell().index()] = NOWHERE;
        }
        if self.places.len() != cells {
            self.places.clear();
            self.places.resize(cells, NOWHERE);
        }
    }

    /// enqueue(n, ρ): enqueues a cell, or moves it to its new key.
    pub fn enqueue(&mut self, cell: CellId, key: f32) {
        let (entry, place) = (Entry::new(key, cell), self.places[cell.index()]);
        if place == NOWHERE {
            self.heap.push(entry);
            self.rise(self.heap.len() - 1);
        } else {
            let before = std::mem::replace(&mut self.heap[place as usize], entry);
            if entry < before { self.rise(place as usize) } else { self.sink(place as usize) }
        }
    }

    /// Whether a cell is in it.
    pub fn holds(&self, cell: CellId) -> bool {
        self.places[cell.index()] != NOWHERE
    }

    /// The key of min(F).
    pub fn least(&self) -> Option<f32> {
        self.heap.first().map(|entry| entry.key())
    }

    /// min(F), taken out.
    pub fn pop(&mut self) -> Option<(f32, CellId)> {
        let last = self.heap.pop()?;
        let first = match self.heap.first_mut() {
            Some(first) => {
                let first = std::mem::replace(first, last);
                self.sink(0);
                first
            }
            None => last,
        };
        self.places[first.cell().index()] = NOWHERE;
        Some((first.key(), first.cell()))
    }

    /// All cells, in no order.
    pub fn cells(&self) -> impl Iterator<Item = CellId> {
        self.heap.iter().map(|entry| entry.cell())
    }

    fn rise(&mut self, mut at: usize) {
        let entry = self.heap[at];
        while at > 0 {
            let parent = (at - 1) / CHILDREN;
            if entry >= self.heap[parent] {
                break;
            }
            self.put(at, self.heap[parent]);
            at = parent;
        }
        self.put(at, entry);
    }

    fn sink(&mut self, mut at: usize) {
        let entry = self.heap[at];
        loop {
            let first = CHILDREN * at + 1;
            let least = match self.heap.get(first..first + CHILDREN) {
                Some(&[a, b, c, d]) => {
                    let (ab, cd) = (if b < a { 1 } else { 0 }, if d < c { 3 } else { 2 });
                    if c.min(d) < a.min(b) { cd } else { ab }
                }
                _ => match self.heap.get(first..).unwrap_or_default().iter().enumerate().min_by_key(|(_, child)| **child) {
                    Some((least, _)) => least,
                    None => break,
                },
            };
            let child = self.heap[first + least];
            if child >= entry {
                break;
            }
            self.put(at, child);
            at = first + least;
        }
        self.put(at, entry);
    }

    fn put(&mut self, at: usize, entry: Entry) {
        self.heap[at] = entry;
        self.places[entry.cell().index()] = at as u32;
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
        fn it_does_what_a_map_would(steps in proptest::collection::vec((0..40u32, -9..9i8, prop::bool::weighted(0.3)), 1..300)) {
            let mut front = Front::default();
            front.clear(40);
            let mut map: BTreeMap<u32, f32> = BTreeMap::new();
            for (cell, key, is_pop) in steps {
                if is_pop {
                    let least = map.iter().min_by(|a, b| a.1.total_cmp(b.1).then(a.0.cmp(b.0))).map(|(e, k)| (*k, CellId(*e)));
                    prop_assert_eq!(front.least(), least.map(|(key, _)| key));
                    prop_assert_eq!(front.pop(), least);
                    least.map(|(_, cell)| map.remove(&cell.0));
                } else {
                    front.enqueue(CellId(cell), key.into());
                    map.insert(cell, key.into());
                }
                let mut cells: Vec<u32> = front.cells().map(|cell| cell.0).collect();
                cells.sort_unstable();
                prop_assert_eq!(cells, map.keys().copied().collect::<Vec<_>>());
            }
            front.clear(40);
            prop_assert_eq!(front.pop(), None);
        }
    }
}
