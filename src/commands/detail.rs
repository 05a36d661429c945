//! How finely `serve` and `demo` draw what has hierarchies of detail.

use std::fmt::Display;

use anyhow::{Result, ensure};
use mullion_common::scene::{LodForm, Package};
use mullion_common::wire::{Detail, DetailWeight};
use mullion_server::prepare::lod::LodOptions;
use mullion_server::service::ShowOptions;

/// A level of detail for the wall, or all of it.
#[derive(clap::Args, Clone, Copy)]
#[group(skip)]
pub struct DetailOptions {
    /// Draw objects with hierarchies of detail as coarsely as their surfaces may be wrong by so many pixels. The scene needs hierarchies (`mullion
    /// prepare --lod`).
    #[arg(long, value_name = "PIXELS", allow_negative_numbers = true, value_parser = pixels)]
    pixel_error: Option<f32>,
    /// Draw them with so many triangles at most, all tiles together. Where that is not enough for all of them, the smallest are left out.
    #[arg(long, value_name = "TRIANGLES", value_parser = clap::value_parser!(u32).range(1..))]
    lod_triangles: Option<u32>,
    /// Draw what others hide as finely as what is seen (with --pixel-error or --lod-triangles).
    #[arg(long)]
    no_lod_occlusion: bool,
    /// What comes first in the triangles of --lod-triangles: none takes all objects alike, nohc those first of whose boxes more is seen, plp
    /// those of whose triangles more are likely seen, for which the scene needs a tessellation.
    #[arg(long, value_name = "WEIGHT", default_value_t)]
    lod_weight: DetailWeight,
}

impl DetailOptions {
    /// Whether there is one.
    pub fn is_set(&self) -> bool {
        self.name().is_some()
    }

    /// Sets the pixels by which surfaces may be wrong, more than 0, where no level is set.
    pub fn set_pixel_error(&mut self, pixels: f32) {
        self.pixel_error = Some(pixels);
    }

    /// As users write what was chosen.
    pub fn name(&self) -> Option<&'static str> {
        match (self.pixel_error, self.lod_triangles) {
            (Some(_), _) => Some("--pixel-error"),
            (None, Some(_)) => Some("--lod-triangles"),
            (None, None) => None,
        }
    }

    /// Whether the options go together.
    ///
    /// # Errors
    /// When they ask for nothing.
    pub fn check(&self) -> Result<()> {
        ensure!(self.is_set() || !self.no_lod_occlusion, "--no-lod-occlusion: give --pixel-error or --lod-triangles, too");
        if self.lod_weight != DetailWeight::None {
            ensure!(
                self.lod_triangles.is_some(),
                "--lod-weight: give --lod-triangles, too: without it, all is as good as it should be"
            );
            ensure!(
                !self.no_lod_occlusion,
                "--lod-weight, --no-lod-occlusion: without occlusion nothing is known of what is seen"
            );
        }
        ensure!(
            self.pixel_error != Some(0.0) || self.lod_triangles.is_some(),
            "--pixel-error 0: no surface is wrong where all triangles are drawn, as they are without it; give more than 0, or --lod-triangles, too"
        );
        Ok(())
    }

    /// The form of hierarchies that is best for them, if they need some.
    pub fn form(&self) -> Option<LodForm> {
        self.detail().map(|detail| detail.form())
    }

    /// Whether they need a tessellation.
    pub fn needs_tessellation(&self) -> bool {
        self.lod_weight == DetailWeight::Plp
    }

    /// Whether a scene has the tessellation that they may need.
    ///
    /// # Errors
    /// When it has none.
    pub fn check_tessellation(&self, package: &Package, scene: impl Display) -> Result<()> {
        ensure!(
            !self.needs_tessellation() || package.scene.tessellation.is_some(),
            "--lod-weight plp: {scene} has no tessellation: prepare it with `mullion prepare --plp --lod`"
        );
        Ok(())
    }

    /// Whether a scene has what they are for.
    ///
    /// # Errors
    /// When it has no hierarchies.
    pub fn check_scene(&self, package: &Package, scene: impl Display) -> Result<()> {
        let Some(option) = self.name() else { return Ok(()) };
        ensure!(
            !package.scene.hierarchies.is_empty(),
            "{option}: {scene} has no hierarchies of detail: prepare it with `mullion prepare --lod`; meshes of fewer than {} triangles get none",
            LodOptions::default().least_triangles
        );
        Ok(())
    }

    /// Puts what was chosen into a show's options.
    pub fn apply_to(&self, options: &mut ShowOptions) {
        options.detail = self.detail();
    }

    fn detail(&self) -> Option<Detail> {
        let Self { pixel_error, lod_triangles: triangles, no_lod_occlusion, lod_weight: weight } = *self;
        self.is_set().then(|| Detail { triangles, least_pixels: pixel_error.unwrap_or(0.0), hides: !no_lod_occlusion, weight })
    }
}

fn pixels(text: &str) -> Result<f32, String> {
    let pixels: f32 = text.parse().map_err(|_| "it is no number".to_owned())?;
    if pixels.is_finite() && pixels >= 0.0 { Ok(pixels) } else { Err("an error is 0 pixels or more".to_owned()) }
}
