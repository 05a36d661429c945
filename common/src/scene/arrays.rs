//! Arrays of plain numbers in sections, one behind the other, each padded to 4 bytes.

use bytemuck::Pod;

/// Appends an array and what pads it.
pub(super) fn put(bytes: &mut Vec<u8>, array: &[u8]) {
    bytes.extend_from_slice(array);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
}

/// Splits `count` elements and what pads them off the front of `rest`, which the caller has checked to be long enough.
pub(super) fn take<T: Pod>(rest: &mut &[u8], count: u32) -> Vec<T> {
    let length = count as usize * size_of::<T>();
    let (head, tail) = rest.split_at(length.next_multiple_of(4));
    *rest = tail;
    bytemuck::pod_collect_to_vec(&head[..length])
}
