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
    let mut from = 0;
    for range in set.ranges() {
        put_uvarint(out, range.start - from);
        put_uvarint(out, range.len() - 1);
        from = range.end + 1; // the next range starts at least one leaf further on
    }
}

/// Takes a set off the front of `bytes`.
pub(super) fn take_set(bytes: &mut &[u8], set: &mut VisibleSet) -> Result<(), WireError> {
    set.clear();
    let count = take_uvarint(bytes)?;
    if count as usize > bytes.len() / 2 {
        return Err(BULK);
    }
    let mut from = 0u32;
    for i in 0..count {
        let start = from.checked_add(take_uvarint(bytes)?).ok_or(BULK)?;
        let end = take_uvarint(bytes)?.checked_add(1).and_then(|len| start.checked_add(len)).ok_or(BULK)?;
        set.push(LeafRange::new(start, end));
        if i + 1 < count {
            from = end.checked_add(1).ok_or(BULK)?;
        }
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
