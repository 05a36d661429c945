//! How good the pictures of `serve` and `demo` are, in a word, or by the options that it stands for.

use std::fmt::Display;

use anyhow::{Context, Result, bail, ensure};
use clap::ValueEnum;
use mullion_common::scene::{LodForm, Package};
use mullion_server::service::ShowOptions;

use super::budget::BudgetOptions;
use super::detail::DetailOptions;

/// Of a frame's time so much is a budget's; the rest is for what is not drawing.
const SHARE_OF_FRAME: f64 = 0.8;
/// A surface may be wrong by so many pixels.
const PIXEL_ERROR: f32 = 1.0;

/// A quality, budgets and levels of detail.
#[derive(clap::Args, Clone, Copy)]
#[group(skip)]
pub struct QualityOptions {
    /// What pictures may lack. exact: nothing, as without any option. budget: what is not likely to be seen, within --budget-ms of 80 % of a
    /// frame, or the budget that is given. lod: what is finer than --pixel-error 1.0, or than the level of detail that is given.
    #[arg(long, value_name = "QUALITY")]
    quality: Option<Quality>,
    #[command(flatten)]
    budget: BudgetOptions,
    #[command(flatten)]
    detail: DetailOptions,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Quality {
    Exact,
    Budget,
    Lod,
}

impl QualityOptions {
    /// With the options that the quality stands for, at so many frames a second; 0: as many as there can be.
    ///
    /// # Errors
    /// When options do not go together.
    pub fn chosen(mut self, rate_hz: f64) -> Result<Self> {
        match self.quality {
            Some(Quality::Exact) => {
                if let Some(given) = self.budget.name().or(self.detail.name()) {
                    bail!("--quality exact: {given} leaves out something: give one of both");
                }
            }
            Some(Quality::Budget) if !self.budget.is_set() => {
                ensure!(
                    rate_hz > 0.0,
                    "--quality budget: frames as fast as can be have no time of their own: give --budget-ms, too"
                );
                self.budget.set_ms(SHARE_OF_FRAME * 1000.0 / rate_hz);
            }
            Some(Quality::Lod) if !self.detail.is_set() => self.detail.set_pixel_error(PIXEL_ERROR),
            _ => {}
        }
        self.detail.check()?;
        Ok(self)
    }

    /// The form of hierarchies that is best for a level of detail, if there is one.
    pub fn form(&self) -> Option<LodForm> {
        self.detail.form()
    }

    /// Whether there is a budget, or a level of detail by estimates.
    pub fn needs_tessellation(&self) -> bool {
        self.budget.is_set() || self.detail.needs_tessellation()
    }

    /// Whether a scene has what a budget needs, and a level of detail by estimates.
    ///
    /// # Errors
    /// When it has no tessellation.
    pub fn check_tessellation(&self, package: &Package, scene: impl Display) -> Result<()> {
        self.of_quality(self.budget.check_scene(package, &scene))?;
        self.detail.check_tessellation(package, scene)
    }

    /// Whether a scene has what a level of detail needs.
    ///
    /// # Errors
    /// When it has no hierarchies.
    pub fn check_hierarchies(&self, package: &Package, scene: impl Display) -> Result<()> {
        self.of_quality(self.detail.check_scene(package, scene))
    }

    /// Puts what was chosen into a show's options.
    pub fn apply_to(&self, options: &mut ShowOptions) {
        self.budget.apply_to(options);
        self.detail.apply_to(options);
    }

    /// Names what the user wrote where the option that failed may be none of it.
    fn of_quality(&self, checked: Result<()>) -> Result<()> {
        match self.quality {
            Some(Quality::Exact) | None => checked,
            Some(Quality::Budget) => checked.context("--quality budget"),
            Some(Quality::Lod) => checked.context("--quality lod"),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use mullion_common::wall::WallConfig;
    use mullion_common::wire::Detail;
    use mullion_server::service::ShowBudget;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        quality: QualityOptions,
    }

    fn shown(options: &str, rate_hz: f64) -> (Option<ShowBudget>, Option<Detail>) {
        let wall = WallConfig::parse("[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n").expect("a wall");
        let mut show = ShowOptions::for_wall(&wall);
        let command = Command::try_parse_from(["mullion"].into_iter().chain(options.split_whitespace())).expect("options");
        command.quality.chosen(rate_hz).expect("they go together").apply_to(&mut show);
        (show.budget, show.detail)
    }

    #[test]
    fn a_word_stands_for_options() {
        let detail = |triangles, least_pixels| Some(Detail { triangles, least_pixels, hides: true, ..Detail::default() });
        let budget = |budget| (Some(budget), None);
        for nothing in ["", "--quality exact"] {
            assert_eq!(shown(nothing, 50.0), (None, None), "{nothing}");
        }
        assert_eq!(shown("--quality budget", 50.0), budget(ShowBudget::TimeUs(16_000)));
        assert_eq!(shown("--quality budget", 0.001), budget(ShowBudget::TimeUs(60_000_000)), "no more than may be given");
        assert_eq!(shown("--quality budget --budget-triangles 5", 0.0), budget(ShowBudget::Triangles(5)));
        assert_eq!(shown("--quality lod", 50.0), (None, detail(None, 1.0)));
        assert_eq!(shown("--quality lod --pixel-error 2.5", 50.0), (None, detail(None, 2.5)));
        let both = (Some(ShowBudget::Percent(5.0)), detail(Some(900), 0.0));
        assert_eq!(shown("--quality lod --lod-triangles 900 --budget-percent 5", 50.0), both);
    }
}
