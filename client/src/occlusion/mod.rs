//! Leaving out what others hide (Bartz, Meißner, Hüttner 1999). Pure: what is to be drawn and asked for, no GPU.

pub mod rounds;
pub mod tree;
pub mod view;
pub mod worth;

pub mod unit;

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// How leaves that others hide are left out of a tile's picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Occlusion {
    /// They are not.
    #[default]
    Off,
    /// The paper's loop (section 4.4): nodes of a tree front to back, whole subtrees dropped, leaves drawn as they are found.
    Paper,
    /// The same, but while something moves only a tenth of each bound is looked at (section 4.2): not conservative until all is still.
    Sampled,
    /// The paper's loop within equation 2's share of the time: what is left then is drawn.
    CostAdaptive,
    /// What was seen is drawn at once, and all else asked for in groups, by the GPU's occlusion queries (Mattausch, Bittner, Wimmer 2008).
    Query,
    /// What was seen in the last frame is drawn at once; boxes of all else are tested against a pyramid of its depths on the GPU, those that
    /// it leaves open are drawn against them, and what is seen is drawn after it. Where the GPU cannot, all is drawn.
    Hiz,
}

/// How boxes are tested against what is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BoxTest {
    /// They are drawn.
    #[default]
    Drawn,
    /// Those are drawn that a pyramid of depths leaves open.
    Sifted,
    /// They are drawn, and every so many spans of the picture are looked at, from a phase on, less than that. Not conservative.
    #[allow(missing_docs)]
    Sampled { every: u32, phase: u32 },
    /// By the GPU's occlusion queries.
    Queried,
}

/// That is none of [`Occlusion::ALL`].
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{0:?} is no way to cull what is hidden; there are none, paper, sampled, cost-adaptive, query and hiz")]
pub struct UnknownOcclusion(String);

impl Occlusion {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Off, Self::Paper, Self::Sampled, Self::CostAdaptive, Self::Query, Self::Hiz];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "none",
            Self::Paper => "paper",
            Self::Sampled => "sampled",
            Self::CostAdaptive => "cost-adaptive",
            Self::Query => "query",
            Self::Hiz => "hiz",
        }
    }

    /// Whether every picture is the same as without.
    pub fn is_exact(self) -> bool {
        self != Self::Sampled
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
        let error = "hizzz".parse::<Occlusion>().unwrap_err().to_string();
        assert!(Occlusion::ALL.iter().all(|way| error.contains(way.name())), "{error}");
    }
}
