//! The front F: a priority queue with decrease-key, as a heap of four children a node that knows where each entry is.

use mullion_common::scene::CellId;

const CHILDREN: usize = 4;
const NOWHERE: u32 = u32::MAX;

/// Cells in order of their keys, and of their numbers where keys are equal: one order on every machine.
#[derive(Debug, Default)]
pub(super) struct Front {
    heap: Vec<(f32, CellId)>,
    /// Where each cell is in the heap.
    places: Vec<u32>,
}

impl Front {
    /// Empties it and makes room for `cells`; takes memory only where there was less.
    pub fn clear(&mut self, cells: usize) {
        for (_, cell) in self.heap.drain(..) {
            self.places[cell.index()] = NOWHERE;
        }
        if self.places.len() != cells {
            self.places.clear();
            self.places.resize(cells, NOWHERE);
        }
    }

    /// enqueue(n, ρ): enqueues a cell, or moves it to its new key.
    pub fn enqueue(&mut self, cell: CellId, key: f32) {
        let place = self.places[cell.index()];
        if place == NOWHERE {
            self.heap.push((key, cell));
            self.rise(self.heap.len() - 1);
        } else if less((key, cell), self.heap[place as usize]) {
            self.heap[place as usize].0 = key;
            self.rise(place as usize);
        } else {
            self.heap[place as usize].0 = key;
            self.sink(place as usize);
        }
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
        self.places[first.1.index()] = NOWHERE;
        Some(first)
    }

    /// All cells, in no order.
    pub fn cells(&self) -> impl Iterator<Item = CellId> {
        self.heap.iter().map(|(_, cell)| *cell)
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

    fn put(&mut self, at: usize, item: (f32, CellId)) {
        self.heap[at] = item;
        self.places[item.1.index()] = at as u32;
    }
}

/// The order of keys, then cells. Keys are never NaN.
#[inline]
fn less(a: (f32, CellId), b: (f32, CellId)) -> bool {
    a.0 < b.0 || a.0 == b.0 && a.1 < b.1
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
            for (cell, key, is_pop) in steps {
                if is_pop {
                    let least = map.iter().min_by(|a, b| a.1.total_cmp(b.1).then(a.0.cmp(b.0))).map(|(e, k)| (*k, CellId(*e)));
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
