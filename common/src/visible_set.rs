//! A visible set: which leaves a view may see, as sorted ranges of leaf numbers.
//!
//! Leaves are numbered depth first, so that a subtree is one range and a set is a short list of them.

use serde::{Deserialize, Serialize};

/// Leaves `start..end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct LeafRange {
    /// First leaf.
    pub start: u32,
    /// One past the last leaf; greater than `start` in a set.
    pub end: u32,
}

impl LeafRange {
    /// The range `start..end`.
    pub fn new(start: u32, end: u32) -> Self {
        Self { start, end }
    }

    /// How many leaves it holds.
    pub fn len(&self) -> u32 {
        self.end.saturating_sub(self.start)
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.end <= self.start
    }
}

/// A conservative set of leaves. Its ranges are sorted, not empty, and neither overlap nor touch.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct VisibleSet {
    ranges: Vec<LeafRange>,
}

impl Clone for VisibleSet {
    fn clone(&self) -> Self {
        Self { ranges: self.ranges.clone() }
    }

    /// Reuses this set's memory.
    fn clone_from(&mut self, other: &Self) {
        self.ranges.clone_from(&other.ranges);
    }
}

impl VisibleSet {
    /// The set of leaves `0..leaf_count`.
    pub fn all(leaf_count: u32) -> Self {
        let mut set = Self::default();
        set.push(LeafRange::new(0, leaf_count));
        set
    }

    /// The set that holds the leaves of all `ranges`, given in any order.
    pub fn from_ranges(ranges: impl IntoIterator<Item = LeafRange>) -> Self {
        let mut set = Self { ranges: ranges.into_iter().collect() };
        set.normalize();
        set
    }

    /// Its ranges, sorted.
    pub fn ranges(&self) -> &[LeafRange] {
        &self.ranges
    }

    /// Number of leaves.
    pub fn len(&self) -> u32 {
        self.ranges.iter().map(LeafRange::len).sum()
    }

    /// Whether it holds no leaf.
    pub fn is_empty(&self) -> bool {
        self.ranges.is_empty()
    }

    /// Its leaves in ascending order.
    pub fn leaves(&self) -> impl Iterator<Item = u32> + '_ {
        self.ranges.iter().flat_map(|r| r.start..r.end)
    }

    /// Whether it holds the leaf.
    pub fn contains(&self, leaf: u32) -> bool {
        let after = self.ranges.partition_point(|r| r.start <= leaf);
        after > 0 && self.ranges[after - 1].end > leaf
    }

    /// Empties it and keeps its memory.
    pub fn clear(&mut self) {
        self.ranges.clear();
    }

    /// Adds a range that starts at or after the start of the last one. Cheap; out of order, use
    /// [`VisibleSet::push_unordered`] and [`VisibleSet::normalize`].
    #[inline]
    pub fn push(&mut self, range: LeafRange) {
        if range.is_empty() {
            return;
        }
        match self.ranges.last_mut() {
            Some(last) if range.start <= last.end => {
                debug_assert!(range.start >= last.start, "ranges out of order");
                last.end = last.end.max(range.end);
            }
            _ => self.ranges.push(range),
        }
    }

    /// Adds the ranges of a set that starts at or after the start of this one's last range.
    pub fn append(&mut self, after: &Self) {
        if let [first, rest @ ..] = after.ranges.as_slice() {
            self.push(*first);
            self.ranges.extend_from_slice(rest);
        }
    }

    /// Adds a range in any order; the set is valid again after [`VisibleSet::normalize`].
    pub fn push_unordered(&mut self, range: LeafRange) {
        match self.ranges.last_mut() {
            _ if range.is_empty() => {}
            Some(last) if range.start >= last.start && range.start <= last.end => last.end = last.end.max(range.end),
            _ => self.ranges.push(range),
        }
    }

    /// Sorts and merges the ranges in place, without allocating.
    pub fn normalize(&mut self) {
        if self.ranges.is_sorted_by(|a, b| a.end < b.start) && !self.ranges.iter().any(LeafRange::is_empty) {
            return;
        }
        self.ranges.retain(|r| !r.is_empty());
        self.ranges.sort_unstable();
        let mut kept = 0;
        for i in 1..self.ranges.len() {
            let range = self.ranges[i];
            if range.start <= self.ranges[kept].end {
                self.ranges[kept].end = self.ranges[kept].end.max(range.end);
            } else {
                kept += 1;
                self.ranges[kept] = range;
            }
        }
        self.ranges.truncate(kept + 1);
    }

    /// `out` becomes the leaves of either set.
    pub fn union_into(&self, other: &Self, out: &mut Self) {
        out.clear();
        let (mut a, mut b) = (self.ranges.iter().peekable(), other.ranges.iter().peekable());
        loop {
            let next = match (a.peek(), b.peek()) {
                (Some(x), Some(y)) if x.start <= y.start => a.next(),
                (_, Some(_)) => b.next(),
                (Some(_), None) => a.next(),
                (None, None) => return,
            };
            if let Some(range) = next {
                out.push(*range);
            }
        }
    }

    /// `out` becomes the leaves of this set that `other` lacks.
    pub fn difference_into(&self, other: &Self, out: &mut Self) {
        out.clear();
        let mut holes = other.ranges.as_slice();
        for range in &self.ranges {
            let mut start = range.start;
            while let Some(hole) = holes.first() {
                if hole.end <= start {
                    holes = &holes[1..];
                } else if hole.start >= range.end {
                    break;
                } else {
                    out.push(LeafRange::new(start, hole.start.max(start)));
                    start = hole.end;
                    if hole.end > range.end {
                        break;
                    }
                }
            }
            out.push(LeafRange::new(start.min(range.end), range.end));
        }
    }

    /// Whether every leaf of `other` is in this set.
    pub fn is_superset_of(&self, other: &Self) -> bool {
        let mut missing = Self::default();
        other.difference_into(self, &mut missing);
        missing.is_empty()
    }
}

/// What turns one visible set into the next.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VisibleDelta {
    /// Leaves that went out of view.
    pub removed: VisibleSet,
    /// Leaves that came into view.
    pub added: VisibleSet,
}

impl VisibleDelta {
    /// Makes this the delta from `base` to `next`, reusing its memory.
    pub fn between(&mut self, base: &VisibleSet, next: &VisibleSet) {
        base.difference_into(next, &mut self.removed);
        next.difference_into(base, &mut self.added);
    }

    /// `out` becomes the set that this delta makes of `base`. `scratch` is overwritten.
    pub fn apply(&self, base: &VisibleSet, scratch: &mut VisibleSet, out: &mut VisibleSet) {
        base.difference_into(&self.removed, scratch);
        scratch.union_into(&self.added, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn ranges() -> impl Strategy<Value = Vec<LeafRange>> {
        proptest::collection::vec((0..60u32, 0..9u32), 0..12)
            .prop_map(|v| v.into_iter().map(|(start, len)| LeafRange::new(start, start + len)).collect())
    }

    /// The dull oracle: a set of numbers.
    fn numbers(ranges: &[LeafRange]) -> BTreeSet<u32> {
        ranges.iter().flat_map(|r| r.start..r.end).collect()
    }

    fn assert_valid(set: &VisibleSet) {
        assert!(set.ranges.iter().all(|r| r.start < r.end), "{set:?}");
        assert!(set.ranges.windows(2).all(|w| w[0].end < w[1].start), "{set:?}");
    }

    proptest! {
        #[test]
        fn operations_match_sets_of_numbers(a in ranges(), b in ranges()) {
            let (oracle_a, oracle_b) = (numbers(&a), numbers(&b));
            let (a, b) = (VisibleSet::from_ranges(a), VisibleSet::from_ranges(b));
            let mut out = VisibleSet::default();
            for set in [&a, &b] {
                assert_valid(set);
            }
            prop_assert_eq!(a.leaves().collect::<BTreeSet<_>>(), oracle_a.clone());
            prop_assert_eq!(a.len() as usize, oracle_a.len());
            prop_assert!((0..70).all(|leaf| a.contains(leaf) == oracle_a.contains(&leaf)));

            a.union_into(&b, &mut out);
            assert_valid(&out);
            prop_assert_eq!(out.leaves().collect::<BTreeSet<_>>(), &oracle_a | &oracle_b);

            let after = VisibleSet::from_ranges(b.ranges().iter().map(|r| LeafRange::new(r.start + 60, r.end + 60)));
            let mut appended = a.clone();
            appended.append(&after);
            a.union_into(&after, &mut out);
            prop_assert_eq!(&appended, &out);

            a.difference_into(&b, &mut out);
            assert_valid(&out);
            prop_assert_eq!(out.leaves().collect::<BTreeSet<_>>(), &oracle_a - &oracle_b);
            prop_assert_eq!(a.is_superset_of(&b), oracle_a.is_superset(&oracle_b));

            let (mut delta, mut scratch) = (VisibleDelta::default(), VisibleSet::default());
            delta.between(&a, &b);
            delta.apply(&a, &mut scratch, &mut out);
            prop_assert_eq!(&out, &b);
        }
    }
}
