//! `mullion path`.

use std::path::PathBuf;

use anyhow::Result;

use super::demo::WallChoice;
use super::prepare::HowToPrepare;
use crate::camera::Walk;
use crate::files::{is_standard_output, open_named_scene, write_text};
use crate::say::say;

/// Which walk, through what, and where to.
#[derive(clap::Args)]
pub struct Options {
    /// Which walk.
    walk: Walk,
    /// A glTF, GLB or package file, or the name of a generated scene: city, plp-city, cars, plant, palace, cathedrals, forest, garbage, boxes or
    /// boxes:LEAVES.
    #[arg(value_name = "FILE|NAME")]
    scene: String,
    #[command(flatten)]
    wall: WallChoice,
    /// Length of the walk; some seconds to a minute, depending on the walk, if left out.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    frames: Option<u64>,
    /// The file to write, a line a frame (`-` for standard output).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    how: HowToPrepare,
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let wall = options.wall.open()?;
    let package = open_named_scene(&options.scene, &options.how.options()?)?;
    let path = options.walk.path(&package, &wall, options.frames)?;
    write_text(&path.to_string(), &options.out)?;
    if !is_standard_output(&options.out) {
        let frames = path.poses().len();
        say!("{}: {frames} frames, {:.1} s at {} Hz", options.out.display(), frames as f64 / wall.rate_hz(), wall.rate_hz());
    }
    Ok(())
}
