//! What `serve` and `demo` may spend on a frame.

use std::fmt::Display;

use anyhow::{Result, ensure};
use mullion_common::scene::Package;
use mullion_server::service::{ShowBudget, ShowOptions};

/// Longest time of a frame, milliseconds.
const MAX_MS: f64 = 60_000.0;

/// A budget for the wall, or none.
#[derive(clap::Args, Clone, Copy)]
#[group(skip)]
pub struct BudgetOptions {
    /// Draw an estimate of what is visible within so many triangles, all tiles together. The scene needs a tessellation. Pictures lack what is
    /// not likely to be seen until the camera rests.
    #[arg(long, group = "budget", value_name = "TRIANGLES", conflicts_with_all = ["budget_percent", "budget_ms"],
          value_parser = clap::value_parser!(u32).range(1..))]
    budget_triangles: Option<u32>,
    /// The same within so many percent of the scene's triangles.
    #[arg(long, group = "budget", value_name = "PERCENT", conflicts_with = "budget_ms", allow_negative_numbers = true, value_parser = percent)]
    budget_percent: Option<f64>,
    /// The same within as many triangles as the slowest tile draws in so many milliseconds.
    #[arg(long, group = "budget", value_name = "MS", allow_negative_numbers = true, value_parser = milliseconds)]
    budget_ms: Option<f64>,
    /// Keep to the budget when the camera rests, too.
    #[arg(long, requires = "budget")]
    no_complete: bool,
}

impl BudgetOptions {
    /// Whether there is one.
    pub fn is_set(&self) -> bool {
        self.budget().is_some()
    }

    /// Puts it into a show's options.
    pub fn apply_to(&self, options: &mut ShowOptions) {
        (options.budget, options.completes) = (self.budget(), !self.no_complete);
    }

    /// Sets a budget of time, where none is set: more than 0 ms, at most [`MAX_MS`], which more is taken for.
    pub fn set_ms(&mut self, ms: f64) {
        self.budget_ms = Some(ms.min(MAX_MS));
    }

    /// Whether a scene has what a budget needs.
    ///
    /// # Errors
    /// When it has no tessellation.
    pub fn check_scene(&self, package: &Package, scene: impl Display) -> Result<()> {
        let Some(option) = self.name() else { return Ok(()) };
        ensure!(
            package.scene.tessellation.is_some(),
            "{option}: {scene} has no tessellation: prepare it with `mullion prepare --plp`"
        );
        Ok(())
    }

    /// As users write what was chosen.
    pub fn name(&self) -> Option<&'static str> {
        self.budget().map(|budget| match budget {
            ShowBudget::Triangles(_) => "--budget-triangles",
            ShowBudget::Percent(_) => "--budget-percent",
            ShowBudget::TimeUs(_) => "--budget-ms",
        })
    }

    fn budget(&self) -> Option<ShowBudget> {
        let time_us = |ms: f64| (ms * 1000.0).ceil() as u32;
        let triangles = self.budget_triangles.map(ShowBudget::Triangles);
        let percent = self.budget_percent.map(ShowBudget::Percent);
        triangles.or(percent).or(self.budget_ms.map(time_us).map(ShowBudget::TimeUs))
    }
}

fn percent(text: &str) -> Result<f64, String> {
    let percent: f64 = text.parse().map_err(|_| "it is no number".to_owned())?;
    if percent > 0.0 && percent <= 100.0 { Ok(percent) } else { Err("a budget is more than 0 %, and at most 100 %".to_owned()) }
}

fn milliseconds(text: &str) -> Result<f64, String> {
    let ms: f64 = text.parse().map_err(|_| "it is no number".to_owned())?;
    if ms > 0.0 && ms <= MAX_MS { Ok(ms) } else { Err(format!("a budget is more than 0 ms, and at most {MAX_MS} ms")) }
}
