//! Leaving out what others hide (Bartz, Meißner, Hüttner 1999): which way.

pub mod unit;

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// How leaves that others hide are left out of a tile's picture. No pixel changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Occlusion {
    /// They are not.
    #[default]
    Off,
    /// What was seen in the last frame is drawn at once; boxes of all else are tested against its depth on the GPU, and what is seen is
    /// drawn after it. Where the GPU cannot, all is drawn.
    TwoPass,
}

/// That is none of [`Occlusion::ALL`].
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{0:?} is no way to cull what is hidden; there are none and two-pass")]
pub struct UnknownOcclusion(String);

impl Occlusion {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Off, Self::TwoPass];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "none",
            Self::TwoPass => "two-pass",
        }
    }
}

impl fmt::Display for Occlusion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Occlusion {
    type Err = UnknownOcclusion;

    fn from_str(name: &str) -> Result<Self, UnknownOcclusion> {
        Self::ALL.into_iter().find(|way| way.name() == name).ok_or_else(|| UnknownOcclusion(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for way in Occlusion::ALL {
            assert_eq!(way.to_string().parse(), Ok(way));
        }
        let error = "hizz".parse::<Occlusion>().unwrap_err().to_string();
        assert!(Occlusion::ALL.iter().all(|way| error.contains(way.name())), "{error}");
    }
}
