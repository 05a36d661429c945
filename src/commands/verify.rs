//! `mullion verify`: proves on this machine, with this GPU, that culling changes no picture.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};
use mullion_client::gpu::{Gpu, GpuOptions};
use mullion_server::cull::Algorithm;

use super::prepare::HowToPrepare;
use crate::files::{open_scene, write_json};
use crate::pixels::{self, Grid, SceneVerdict};
use crate::say::say;

/// What to verify.
#[derive(clap::Args)]
pub struct Options {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Every tile drawn from its visible set equals the tile drawn from the whole scene, bit for bit, and the tiles
    /// together are the picture of the whole wall.
    Pixels(PixelOptions),
}

#[derive(clap::Args)]
struct PixelOptions {
    /// glTF, GLB or package files.
    scenes: Vec<PathBuf>,
    /// Also every .glb and .gltf in this folder and in the folders right below it, but for one called `edge`.
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
    /// Walls of the same size divided into so many tiles.
    #[arg(long, value_name = "COLUMNSxROWS", value_delimiter = ',', default_value = "1x1,2x2,3x2,4x4", value_parser = Grid::parse)]
    grids: Vec<Grid>,
    /// How to cull.
    #[arg(long, default_value = "adaptive")]
    algorithm: Algorithm,
    /// Write what was found (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the whole wall of each scene and eye as a picture into this folder, and what differs.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let What::Pixels(options) = &options.what;
    let mut scenes = options.scenes.clone();
    if let Some(folder) = &options.models {
        scenes.extend(scenes_in(folder)?);
    }
    ensure!(!scenes.is_empty(), "verify pixels: name scenes, or a folder of them with --models");
    options.grids.iter().try_for_each(|grid| grid.wall().map(drop)).context("--grids")?;
    let gpu = Gpu::open(GpuOptions::default())?;
    say!("{}", gpu.describe());
    say!(
        "{:28} {:>7} {:>8} {:>6} {:>7} {:>8} {:>9} {:>8}  verdict",
        "scene",
        "leaves",
        "objects",
        "tiles",
        "culled",
        "tiles ≠",
        "pixels ≠",
        "missing"
    );
    let mut verdicts = Vec::new();
    for path in &scenes {
        let name = path.file_stem().map_or_else(|| path.display().to_string(), |stem| stem.to_string_lossy().into_owned());
        let package = open_scene(path, &options.how.options()?)?;
        let verdict = pixels::verify(&gpu, &name, &package, &options.grids, options.algorithm, options.pictures.as_deref())
            .with_context(|| path.display().to_string())?;
        print_verdict(&verdict);
        verdicts.push(verdict);
    }
    if let Some(path) = &options.json {
        write_json(&verdicts, path)?;
    }
    let failed: Vec<&str> = verdicts.iter().filter(|v| !v.holds()).map(|v| v.scene.as_str()).collect();
    if failed.is_empty() { Ok(()) } else { Err(anyhow!("culling changed the picture of {}", failed.join(", "))) }
}

fn print_verdict(v: &SceneVerdict) {
    say!(
        "{:28} {:7} {:8} {:6} {:6.1}% {:8} {:8.4}% {:8}  {}",
        v.scene,
        v.leaves,
        v.objects_seen,
        v.tiles_compared,
        v.culled_percent,
        v.tiles_that_differ,
        v.worst_differing_percent,
        v.objects_missing,
        if v.holds() { "holds" } else { "DIFFERS" }
    );
}

/// Scene files in a folder and its subfolders, sorted.
fn scenes_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let list = |folder: &Path| -> Result<Vec<PathBuf>> {
        let entries = folder.read_dir().with_context(|| folder.display().to_string())?;
        entries.map(|entry| Ok(entry?.path())).collect()
    };
    let is_scene = |path: &PathBuf| path.extension().is_some_and(|e| e == "glb" || e == "gltf");
    let mut scenes = Vec::new();
    for path in list(folder)? {
        if path.is_dir() && path.file_name().is_some_and(|name| name != "edge") {
            scenes.extend(list(&path)?.into_iter().filter(is_scene));
        } else if is_scene(&path) {
            scenes.push(path);
        }
    }
    scenes.sort();
    Ok(scenes)
}
