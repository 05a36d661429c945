//! Visible sets as bytes: a count, then for each range its distance from the end of the one before, and its length.
//!
//! All numbers are `uvarint`s: LEB128, low group first. Ranges of a set neither overlap nor touch nor are empty, so
//! every distance but the first is stored less one, and every length too: no bytes describe an invalid set.

use super::WireError;
use crate::visible_set::{LeafRange, VisibleSet};

const BULK: WireError = WireError::Bulk { what: "leaf ranges" };

/// Appends the set.
pub(super) fn put_set(out: &mut Vec<u8>, set: &VisibleSet) {
    put_uvarint(out, set.ranges().len() as u32);
    let mut before = None;
    for range in set.ranges() {
        // The next range starts at least one leaf further on.
        put_uvarint(out, range.start - before.map_or(0, |end| end + 1));
        put_uvarint(out, range.len() - 1);
        before = Some(range.end);
    }
}

/// Takes a set off the front of `bytes`.
pub(super) fn take_set(bytes: &mut &[u8], set: &mut VisibleSet) -> Result<(), WireError> {
    set.clear();
    let count = take_uvarint(bytes)?; // a claim: memory grows with the ranges that are there
    let mut before = None;
    for _ in 0..count {
        let from = before.map_or(Some(0), |end: u32| end.checked_add(1)).ok_or(BULK)?;
        let start = from.checked_add(take_uvarint(bytes)?).ok_or(BULK)?;
        let end = take_uvarint(bytes)?.checked_add(1).and_then(|len| start.checked_add(len)).ok_or(BULK)?;
        set.push(LeafRange::new(start, end));
        before = Some(end);
    }
    Ok(())
}

fn put_uvarint(out: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn take_uvarint(bytes: &mut &[u8]) -> Result<u32, WireError> {
    let mut value = 0u32;
    for shift in [0, 7, 14, 21, 28] {
        let (&byte, rest) = bytes.split_first().ok_or(BULK)?;
        *bytes = rest;
        let group = u32::from(byte & 0x7f);
        if shift == 28 && group > 0xf {
            return Err(BULK);
        }
        value |= group << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err(BULK)
}
