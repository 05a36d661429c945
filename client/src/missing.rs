//! What a tile shows while chunks of a frame are still on their way.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// What is done with leaves that lack a chunk. A leaf that lacks its texture alone counts as one that lacks its geometry: it changes once,
/// when all of it is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WhenMissing {
    /// The frame is drawn at once; such a leaf is a solid box, its oriented bounds, in its material's base colour.
    #[default]
    Box,
    /// The frame is not drawn before all chunks are there; the last picture stays. Every picture is exact.
    Hold,
    /// The frame is drawn at once, without such leaves.
    Nothing,
}

/// That is none of [`WhenMissing::ALL`].
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{0:?} is no way to show what is missing; there are box, hold and nothing")]
pub struct UnknownWay(String);

impl WhenMissing {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Box, Self::Hold, Self::Nothing];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Box => "box",
            Self::Hold => "hold",
            Self::Nothing => "nothing",
        }
    }
}

impl fmt::Display for WhenMissing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for WhenMissing {
    type Err = UnknownWay;

    fn from_str(name: &str) -> Result<Self, UnknownWay> {
        Self::ALL.into_iter().find(|way| way.name() == name).ok_or_else(|| UnknownWay(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for way in WhenMissing::ALL {
            assert_eq!(way.to_string().parse(), Ok(way));
        }
        let error = "boxes".parse::<WhenMissing>().unwrap_err().to_string();
        assert!(WhenMissing::ALL.iter().all(|way| error.contains(way.name())), "{error}");
    }
}
