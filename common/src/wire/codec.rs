//! Headers as bytes. The only user of bincode.
//!
//! bincode 2 with its legacy configuration: little-endian, fixed-width integers, `u32` enum tags, `u64` lengths.
//! Bulk arrays never pass through here: they follow a header as raw little-endian bytes.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{DeserializeOwned, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use thiserror::Error;

/// Why bytes could not be read.
#[derive(Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum CodecError {
    #[error("malformed: {0}")]
    Malformed(String),
    #[error("{left} bytes follow the end of the message")]
    Trailing { left: usize },
    #[error("{len} bytes where at most {cap} are allowed")]
    TooLarge { len: usize, cap: usize },
}

/// A list whose memory grows with what is there: nothing is taken for what its count claims.
#[derive(Serialize)]
#[serde(transparent)]
pub struct List<T>(pub Vec<T>);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for List<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        list(deserializer).map(Self)
    }
}

/// Reads what [`List`] holds, for fields.
///
/// # Errors
/// The deserializer's.
pub fn list<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    struct Items<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for Items<T> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a list")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Vec<T>, A::Error> {
            let mut list = Vec::new();
            while let Some(item) = items.next_element()? {
                list.push(item);
            }
            Ok(list)
        }
    }
    deserializer.deserialize_seq(Items(PhantomData))
}

/// Reads a text as [`list`] does a list, for fields.
///
/// # Errors
/// The deserializer's; when it is not UTF-8.
pub fn text<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    String::from_utf8(list(deserializer)?).map_err(serde::de::Error::custom)
}

/// The bytes of `value`.
///
/// # Errors
/// When the value cannot be serialised, as a sequence of unknown length.
pub fn encode<T: Serialize>(value: &T) -> Result<Vec<u8>, CodecError> {
    bincode::serde::encode_to_vec(value, bincode::config::legacy()).map_err(|e| CodecError::Malformed(e.to_string()))
}

/// Appends the bytes of `value` to `out`. Allocates only where `out` must grow.
///
/// # Errors
/// As [`encode`].
pub fn encode_into<T: Serialize>(value: &T, out: &mut Vec<u8>) -> Result<(), CodecError> {
    let written = bincode::serde::encode_into_std_write(value, out, bincode::config::legacy());
    written.map(|_| ()).map_err(|e| CodecError::Malformed(e.to_string()))
}

/// Reads a value that takes all of `bytes`, and takes no more than `CAP` bytes of memory for lengths it reads.
///
/// # Errors
/// When the bytes are more than `CAP`, are malformed, or go on after the value.
pub fn decode<T: DeserializeOwned, const CAP: usize>(bytes: &[u8]) -> Result<T, CodecError> {
    let (value, used) = decode_prefix::<T, CAP>(bytes)?;
    match bytes.len() - used {
        0 => Ok(value),
        left => Err(CodecError::Trailing { left }),
    }
}

/// Reads a value from the start of `bytes`; also gives how many bytes it took.
///
/// # Errors
/// When the value takes more than `CAP` bytes or is malformed.
pub fn decode_prefix<T: DeserializeOwned, const CAP: usize>(bytes: &[u8]) -> Result<(T, usize), CodecError> {
    let config = bincode::config::legacy().with_limit::<CAP>();
    let head = &bytes[..bytes.len().min(CAP)];
    bincode::serde::decode_from_slice(head, config).map_err(|e| {
        if bytes.len() > CAP { CodecError::TooLarge { len: bytes.len(), cap: CAP } } else { CodecError::Malformed(e.to_string()) }
    })
}
