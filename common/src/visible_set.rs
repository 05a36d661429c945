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

/// A set of leaves: of what a view sees, a conservative one. Its ranges are sorted, not empty, and neither overlap nor touch.
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

    /// A digest of it, by which two sides tell whether they have the same set: h = 0xcbf29ce484222325, then for each range
    /// h = (h xor (start + end·2³²))·0x9e3779b97f4a7c15 modulo 2⁶⁴, h = h xor ⌊h/2³²⌋. No proof against intent.
    pub fn digest(&self) -> u64 {
        self.ranges.iter().fold(0xcbf2_9ce4_8422_2325, |digest: u64, range| {
            let mixed = (digest ^ (u64::from(range.start) | u64::from(range.end) << 32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            mixed ^ (mixed >> 32)
        })
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

    /// Adds a set whose leaves all come after those of this one. Cheap.
    pub fn append(&mut self, after: &Self) {
        let end = |set: &Self| set.ranges.last().map_or(0, |last| last.end);
        debug_assert!(after.ranges.first().is_none_or(|first| first.start >= end(self)), "sets out of order");
        self.append_ranges(&after.ranges);
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
        out.push_either(self.ranges.iter().copied(), other.ranges.iter().copied());
    }

    /// `out` becomes the leaves of this set that `other` lacks.
    pub fn difference_into(&self, other: &Self, out: &mut Self) {
        out.clear();
        Difference { ranges: &self.ranges, holes: &other.ranges, start: 0 }.for_each(|range| out.push(range));
    }

    /// `out` becomes the leaves of both sets.
    pub fn intersection_into(&self, other: &Self, out: &mut Self) {
        out.clear();
        let mut others = &other.ranges[..];
        for range in &self.ranges {
            others = &others[others.partition_point(|other| other.end <= range.start)..];
            let within = others.iter().take_while(|other| other.start < range.end);
            within.for_each(|other| out.push(LeafRange::new(other.start.max(range.start), other.end.min(range.end))));
        }
    }

    /// `out` becomes this set without the leaves of `removed`, then with those of `added`. What neither touches is copied in
    /// one piece.
    pub fn patch_into(&self, removed: &Self, added: &Self, out: &mut Self) {
        out.clear();
        let [mut kept, mut holes, mut more] = [&self.ranges[..], &removed.ranges[..], &added.ranges[..]];
        while let Some(start) = [holes, more].iter().filter_map(|list| list.first()).map(|range| range.start).min() {
            let (before, rest) = kept.split_at(kept.partition_point(|range| range.end < start));
            out.append_ranges(before);
            kept = rest;
            // All that overlaps or touches from here on.
            let mut end = start;
            let mut counts = [0; 3];
            while let Some((list, range)) = [kept, holes, more]
                .iter()
                .enumerate()
                .find_map(|(list, ranges)| ranges.get(counts[list]).filter(|range| range.start <= end).map(|range| (list, range)))
            {
                end = end.max(range.end);
                counts[list] += 1;
            }
            let ranges;
            let holes_here;
            let more_here;
            (ranges, kept) = kept.split_at(counts[0]);
            (holes_here, holes) = holes.split_at(counts[1]);
            (more_here, more) = more.split_at(counts[2]);
            out.push_either(Difference { ranges, holes: holes_here, start: 0 }, more_here.iter().copied());
        }
        out.append_ranges(kept);
    }

    /// Adds the ranges of both, each given in ascending order.
    fn push_either(&mut self, a: impl Iterator<Item = LeafRange>, b: impl Iterator<Item = LeafRange>) {
        let (mut a, mut b) = (a.peekable(), b.peekable());
        loop {
            let next = match (a.peek(), b.peek()) {
                (Some(x), Some(y)) if x.start <= y.start => a.next(),
                (_, Some(_)) => b.next(),
                (Some(_), None) => a.next(),
                (None, None) => return,
            };
            if let Some(range) = next {
                self.push(range);
            }
        }
    }

    /// Adds ranges that stand as they do in a set, but for the first, which may be empty. They start at or after the
    /// start of this set's last one.
    #[inline]
    pub fn append_ranges(&mut self, ranges: &[LeafRange]) {
        if let [first, rest @ ..] = ranges {
            self.push(*first);
            self.ranges.extend_from_slice(rest);
        }
    }

    /// The same, given starts and ends.
    #[inline]
    pub fn append_pairs(&mut self, ranges: &[[u32; 2]]) {
        if let [[start, end], rest @ ..] = ranges {
            self.push(LeafRange::new(*start, *end));
            self.ranges.extend(rest.iter().map(|[start, end]| LeafRange::new(*start, *end)));
        }
    }

    /// Whether any leaf is in both sets.
    pub fn meets(&self, other: &Self) -> bool {
        other.ranges.iter().any(|range| {
            let at = self.ranges.partition_point(|own| own.end <= range.start);
            self.ranges.get(at).is_some_and(|own| own.start < range.end)
        })
    }

    /// Whether every leaf of `other` is in this set.
    pub fn is_superset_of(&self, other: &Self) -> bool {
        let mut missing = Self::default();
        other.difference_into(self, &mut missing);
        missing.is_empty()
    }
}

/// The leaves of `ranges` that are in no hole, in order.
struct Difference<'a> {
    ranges: &'a [LeafRange],
    holes: &'a [LeafRange],
    /// Of the first range, what lies before this is done.
    start: u32,
}

impl Iterator for Difference<'_> {
    type Item = LeafRange;

    fn next(&mut self) -> Option<LeafRange> {
        while let Some(range) = self.ranges.first() {
            let start = self.start.max(range.start);
            while self.holes.first().is_some_and(|hole| hole.end <= start) {
                self.holes = &self.holes[1..];
            }
            let hole = self.holes.first().filter(|hole| hole.start < range.end);
            let found = LeafRange::new(start, hole.map_or(range.end, |hole| hole.start));
            match hole {
                Some(hole) if hole.end < range.end => self.start = hole.end,
                _ => self.ranges = &self.ranges[1..],
            }
            if !found.is_empty() {
                return Some(found);
            }
        }
        None
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
        fn operations_match_sets_of_numbers(a in ranges(), b in ranges(), c in ranges()) {
            let (oracle_a, oracle_b, oracle_c) = (numbers(&a), numbers(&b), numbers(&c));
            let [a, b, c] = [a, b, c].map(VisibleSet::from_ranges);
            let mut out = VisibleSet::default();
            for set in [&a, &b, &c] {
                assert_valid(set);
            }
            prop_assert_eq!(a.leaves().collect::<BTreeSet<_>>(), oracle_a.clone());
            prop_assert_eq!(a.len() as usize, oracle_a.len());
            prop_assert!((0..70).all(|leaf| a.contains(leaf) == oracle_a.contains(&leaf)));

            a.union_into(&b, &mut out);
            assert_valid(&out);
            prop_assert_eq!(out.leaves().collect::<BTreeSet<_>>(), &oracle_a | &oracle_b);

            // Right behind the last leaf, or further.
            let end = a.ranges().last().map_or(0, |last| last.end);
            let after = VisibleSet::from_ranges(b.ranges().iter().map(|r| LeafRange::new(r.start + end, r.end + end)));
            let mut appended = a.clone();
            appended.append(&after);
            a.union_into(&after, &mut out);
            prop_assert_eq!(&appended, &out);

            a.patch_into(&b, &c, &mut out);
            assert_valid(&out);
            prop_assert_eq!(out.leaves().collect::<BTreeSet<_>>(), &(&oracle_a - &oracle_b) | &oracle_c);

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
