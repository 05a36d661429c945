//! The bytes of a package's chunks, one after the other, in parts that packages share.

use std::sync::Arc;

/// Bytes by offset, as if all parts were one. No chunk lies in two parts.
#[derive(Clone, Debug, Default)]
pub(super) struct ChunkData {
    parts: Vec<Part>,
}

#[derive(Clone, Debug)]
struct Part {
    start: u64,
    bytes: Arc<Vec<u8>>,
}

impl ChunkData {
    /// How many bytes.
    pub fn len(&self) -> u64 {
        self.parts.last().map_or(0, |part| part.start + part.bytes.len() as u64)
    }

    /// The same, and `bytes` behind it.
    pub fn with(&self, bytes: Vec<u8>) -> Self {
        let mut grown = self.clone();
        if !bytes.is_empty() {
            grown.parts.push(Part { start: self.len(), bytes: Arc::new(bytes) });
        }
        grown
    }

    /// Bytes that lie in one part.
    pub fn get(&self, offset: u64, length: u32) -> Option<&[u8]> {
        let after = self.parts.partition_point(|part| part.start <= offset);
        let Some(part) = after.checked_sub(1).map(|at| &self.parts[at]) else {
            return (length == 0 && offset == 0).then_some(&[]);
        };
        let start = usize::try_from(offset - part.start).ok()?;
        part.bytes.get(start..start.checked_add(length as usize)?)
    }

    /// All bytes, part by part.
    pub fn slices(&self) -> impl Iterator<Item = &[u8]> {
        self.parts.iter().map(|part| part.bytes.as_slice())
    }
}

impl PartialEq for ChunkData {
    fn eq(&self, other: &Self) -> bool {
        self.len() == other.len() && self.slices().flatten().eq(other.slices().flatten())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_one_and_no_slice_spans_two() {
        let data = ChunkData::default().with(vec![1, 2, 3]).with(vec![]).with(vec![4, 5]);
        assert_eq!(data.len(), 5);
        assert_eq!(data.get(1, 2), Some(&[2, 3][..]));
        assert_eq!(data.get(3, 2), Some(&[4, 5][..]));
        assert_eq!([data.get(2, 2), data.get(4, 2), data.get(9, 1), data.get(u64::MAX, 1)], [None; 4]);
        assert_eq!((data.get(5, 0), ChunkData::default().get(0, 0)), (Some(&[][..]), Some(&[][..])));
        assert_eq!(data, ChunkData::default().with(vec![1, 2, 3, 4, 5]));
        assert_ne!(data, ChunkData::default().with(vec![1, 2, 3, 4, 6]));
    }
}
