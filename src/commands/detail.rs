//! How finely `serve` and `demo` draw what has vertex hierarchies.

use std::fmt::Display;

use anyhow::{Result, ensure};
use mullion_common::scene::Package;
use mullion_common::wire::Detail;
use mullion_server::service::ShowOptions;

/// A level of detail for the wall, or all of it.
#[derive(clap::Args, Clone, Copy)]
#[group(skip)]
pub struct DetailOptions {
    /// Draw objects with vertex hierarchies as coarsely as their surfaces may be wrong by so many pixels. The scene needs hierarchies (`mullion
    /// prepare --lod`).
    #[arg(long, value_name = "PIXELS", allow_negative_numbers = true, value_parser = pixels)]
    pixel_error: Option<f32>,
    /// Draw them with so many triangles at most, all tiles together. Where that is not enough for all of them, the smallest are left out.
    #[arg(long, value_name = "TRIANGLES", value_parser = clap::value_parser!(u32).range(1..))]
    lod_triangles: Option<u32>,
    /// Draw what others hide as finely as what is seen (with --pixel-error or --lod-triangles).
    #[arg(long)]
    no_lod_occlusion: bool,
}

impl DetailOptions {
    /// Whether the options go together.
    ///
    /// # Errors
    /// When they ask for nothing.
    pub fn check(&self) -> Result<()> {
        let is_set = self.detail().is_some();
        ensure!(is_set || !self.no_lod_occlusion, "--no-lod-occlusion: give --pixel-error or --lod-triangles, too");
        ensure!(
            self.pixel_error != Some(0.0) || self.lod_triangles.is_some(),
            "--pixel-error 0: no surface is wrong where all triangles are drawn, as they are without it; give more than 0, or --lod-triangles, too"
        );
        Ok(())
    }

    /// Whether a scene has what they are for.
    ///
    /// # Errors
    /// When it has no hierarchies.
    pub fn check_scene(&self, package: &Package, scene: impl Display) -> Result<()> {
        let option = if self.pixel_error.is_some() { "--pixel-error" } else { "--lod-triangles" };
        ensure!(
            self.detail().is_none() || package.scene.hierarchies().is_some(),
            "{option}: {scene} has no vertex hierarchies: prepare it with `mullion prepare --lod`"
        );
        Ok(())
    }

    /// Puts what was chosen into a show's options.
    pub fn apply_to(&self, options: &mut ShowOptions) {
        options.detail = self.detail();
    }

    fn detail(&self) -> Option<Detail> {
        let Self { pixel_error, lod_triangles: triangles, no_lod_occlusion } = *self;
        let is_set = pixel_error.is_some() || triangles.is_some();
        is_set.then(|| Detail { triangles, least_pixels: pixel_error.unwrap_or(0.0), hides: !no_lod_occlusion })
    }
}

fn pixels(text: &str) -> Result<f32, String> {
    let pixels: f32 = text.parse().map_err(|_| "it is no number".to_owned())?;
    if pixels.is_finite() && pixels >= 0.0 { Ok(pixels) } else { Err("an error is 0 pixels or more".to_owned()) }
}
