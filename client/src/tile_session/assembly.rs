//! Pieces of blobs joined to blobs. Takes memory only as bytes arrive, and only for what was asked for.

use std::collections::HashMap;

use mullion_common::scene::ChunkHash;
use mullion_common::wire::{MAX_WANTED, Piece};
use thiserror::Error;

/// Why a piece cannot be taken.
#[derive(Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum PieceError {
    #[error("a piece of {0}, which nobody asked for")]
    Unwanted(ChunkHash),
    #[error("a piece of {hash} at {offset}, where {expected} comes next")]
    Order { hash: ChunkHash, offset: u64, expected: u64 },
    #[error("{hash} has {found} bytes, the manifest says {expected}")]
    Length { hash: ChunkHash, found: u64, expected: u64 },
    #[error("more than {MAX_WANTED} blobs wanted at once")]
    TooMany,
}

/// The blobs that are on their way.
#[derive(Debug, Default)]
pub struct Assembly {
    open: HashMap<ChunkHash, (u64, Vec<u8>)>,
}

impl Assembly {
    /// Expects a blob of that length.
    ///
    /// # Errors
    /// When [`MAX_WANTED`] are on their way.
    pub fn expect(&mut self, hash: ChunkHash, length: u64) -> Result<(), PieceError> {
        if self.open.len() >= MAX_WANTED {
            return Err(PieceError::TooMany);
        }
        self.open.entry(hash).or_insert((length, Vec::new()));
        Ok(())
    }

    /// Nothing is expected any more of that blob.
    pub fn cancel(&mut self, hash: ChunkHash) {
        self.open.remove(&hash);
    }

    /// Takes a piece; gives the blob when it is whole.
    ///
    /// # Errors
    /// When nobody asked for it, pieces are out of order, or its length is another one than expected.
    pub fn take(&mut self, piece: &Piece<'_>) -> Result<Option<Vec<u8>>, PieceError> {
        let hash = piece.hash;
        let (length, bytes) = self.open.get_mut(&hash).ok_or(PieceError::Unwanted(hash))?;
        if piece.total != *length {
            return Err(PieceError::Length { hash, found: piece.total, expected: *length });
        }
        if piece.offset != bytes.len() as u64 {
            return Err(PieceError::Order { hash, offset: piece.offset, expected: bytes.len() as u64 });
        }
        bytes.extend_from_slice(piece.bytes);
        if (bytes.len() as u64) < *length {
            return Ok(None);
        }
        Ok(self.open.remove(&hash).map(|(_, bytes)| bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_join_and_strangers_are_refused() {
        let mut assembly = Assembly::default();
        let hash = ChunkHash::of(b"abcde");
        let piece = |offset, total, bytes| Piece { hash, offset, total, bytes };
        assert_eq!(assembly.take(&piece(0, 5, b"abc")), Err(PieceError::Unwanted(hash)));
        assembly.expect(hash, 5).unwrap();
        assert!(matches!(assembly.take(&piece(0, 6, b"abc")), Err(PieceError::Length { .. })));
        assert_eq!(assembly.take(&piece(0, 5, b"abc")), Ok(None));
        assert!(matches!(assembly.take(&piece(0, 5, b"abc")), Err(PieceError::Order { expected: 3, .. })));
        assert_eq!(assembly.take(&piece(3, 5, b"de")), Ok(Some(b"abcde".to_vec())));
        assert!(matches!(assembly.take(&piece(0, 5, b"abc")), Err(PieceError::Unwanted(_))));
    }
}
