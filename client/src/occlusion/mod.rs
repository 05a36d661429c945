//! Leaving out what others hide (Bartz, Meißner, Hüttner 1999). Pure: what is to be drawn and asked for, no GPU.

mod groups;
pub mod pieces;
pub mod rounds;
pub mod tree;
mod turns;
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
    /// The paper's loop within equation 2's share of the time: what is left then is drawn. The same as the paper's loop where the GPU has no
    /// clock.
    CostAdaptive,
    /// What was seen is drawn at once, and all else asked for in groups, by the GPU's occlusion queries (Mattausch, Bittner, Wimmer 2008).
    Query,
    /// The paper's loop, and what contributes less than a threshold is left out too (section 4.3): an estimate of what matters, no visible
    /// set. [`Planner::adaptive`](crate::frame::Planner::adaptive) says how; tiles do not offer it, for neighbours would decide
    /// differently about the same object: of a wall the master decides, by what tiles count
    /// ([`TileSession::counted`](crate::tile_session::TileSession::counted)).
    Adaptive,
    /// What had a pixel in the last frame is drawn at once; boxes of all else are tested against a pyramid of its depths on the GPU, those that
    /// it leaves open are drawn against them, and what is seen is drawn after it. Of many leaves those that stay hidden are tested
    /// together; where they come out after all, that takes a further pass. Where the GPU cannot, all is drawn.
    Hiz,
}

/// Bits of a depth's mantissa that rounding leaves free, and that tell rounds apart whose depths tie.
pub const ROUNDED_BITS: u32 = 8;
/// By how much of itself a box's depth is taken nearer: more than what interpolation in `f32` may be off between it and what it holds.
pub const DEPTH_SLACK: f64 = 1.0 + 1.0 / 16384.0;

/// How boxes are tested against what is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BoxTest {
    /// They are drawn.
    #[default]
    Drawn,
    /// Of what waits, those are drawn that a pyramid of depths leaves open; and the picture tells of which leaves there is a pixel.
    Sifted,
    /// They are drawn, and every so many spans of the picture are looked at, from a phase on, less than that. Not conservative.
    #[allow(missing_docs)]
    Sampled { every: u32, phase: u32 },
    /// By the GPU's occlusion queries.
    Queried,
    /// Their pixels are counted.
    Counted,
}

/// What [`Occlusion::Adaptive`] leaves out: bounds whose contribution (equation 1) is less than a threshold. For a wall of one view, whose
/// screen is the view plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adaptive {
    /// Shares of the view plane's pixels, weighted by distance: see [`unit::contribution`].
    pub threshold: f64,
    /// With the pixels of the bound's projection in the place of those of them that are seen, as the equation is printed.
    pub as_printed: bool,
    /// The wall.
    pub plane: unit::ViewPlane,
    /// Width and height of the view.
    pub size_px: [u32; 2],
}

/// That is none of [`Occlusion::ALL`].
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{0:?} is no way to cull what is hidden; there are none, paper, sampled, cost-adaptive, query and hiz")]
pub struct UnknownOcclusion(String);

impl Occlusion {
    /// Those that tiles offer.
    pub const ALL: [Self; 6] = [Self::Off, Self::Paper, Self::Sampled, Self::CostAdaptive, Self::Query, Self::Hiz];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "none",
            Self::Paper => "paper",
            Self::Sampled => "sampled",
            Self::CostAdaptive => "cost-adaptive",
            Self::Query => "query",
            Self::Adaptive => "adaptive",
            Self::Hiz => "hiz",
        }
    }

    /// Whether every picture is the same as without.
    pub fn is_exact(self) -> bool {
        !matches!(self, Self::Sampled | Self::Adaptive)
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
