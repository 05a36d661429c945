//! Numbers of triangles, ascending, as words of 16 bits: what lies together in a mesh lies together in its file.
//!
//! A word below 2¹⁵ is a number. Any other is the first of a row of consecutive numbers, and the word after it is the last.

use std::ops::RangeInclusive;

use super::MAX_COVERED_TRIANGLES;

const ROW: u16 = 1 << 15;
const _: () = assert!(MAX_COVERED_TRIANGLES == ROW as u32);

/// Appends the words of numbers, which ascend and are below [`MAX_COVERED_TRIANGLES`].
pub fn push_numbers(words: &mut Vec<u16>, numbers: &[u16]) {
    const WORTH_A_ROW: usize = 3;
    for row in numbers.chunk_by(|a, b| a + 1 == *b) {
        if row.len() >= WORTH_A_ROW {
            words.extend([row[0] | ROW, row[row.len() - 1]]);
        } else {
            words.extend_from_slice(row);
        }
    }
}

/// The rows of consecutive numbers that words stand for; single numbers are rows of one.
#[derive(Clone, Debug)]
pub struct NumberRows<'a>(pub(super) &'a [u16]);

impl Iterator for NumberRows<'_> {
    type Item = RangeInclusive<u16>;

    #[inline]
    fn next(&mut self) -> Option<RangeInclusive<u16>> {
        let (first, rest) = self.0.split_first()?;
        if first & ROW == 0 {
            self.0 = rest;
            return Some(*first..=*first);
        }
        let (last, rest) = rest.split_first()?;
        self.0 = rest;
        Some(first & !ROW..=*last)
    }
}

impl NumberRows<'_> {
    /// How many numbers there are, if they ascend, are below `end`, and each row has its last.
    pub(super) fn checked_count(&self, end: u32) -> Option<u32> {
        let mut next = 0;
        let mut count = 0;
        let mut rows = self.clone();
        while !rows.0.is_empty() {
            let row = rows.next()?;
            let (first, last) = (u32::from(*row.start()), u32::from(*row.end()));
            if first < next || last < first || last >= end {
                return None;
            }
            count += last + 1 - first;
            next = last + 1;
        }
        Some(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_go_round(numbers in proptest::collection::btree_set(prop_oneof![0..40u16, 0..0x8000u16], 0..60)) {
            let numbers: Vec<u16> = numbers.into_iter().collect();
            let mut words = Vec::new();
            push_numbers(&mut words, &numbers);
            prop_assert!(words.len() <= numbers.len());
            prop_assert_eq!(NumberRows(&words).flatten().collect::<Vec<_>>(), numbers.clone());
            prop_assert_eq!(NumberRows(&words).checked_count(0x8000), Some(numbers.len() as u32));
            if let Some(last) = numbers.last() {
                prop_assert_eq!(NumberRows(&words).checked_count(u32::from(*last)), None);
            }
        }

        #[test]
        fn any_words_are_read_or_refused(words in proptest::collection::vec(prop_oneof![any::<u16>(), 0..9u16, 0x8000..0x8009u16], 0..9)) {
            let rows = NumberRows(&words);
            if let Some(count) = rows.checked_count(0x8000) {
                let numbers: Vec<u16> = rows.flatten().collect();
                prop_assert_eq!(numbers.len() as u32, count);
                prop_assert!(numbers.is_sorted_by(|a, b| a < b));
            }
        }
    }
}
