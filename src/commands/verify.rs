//! `mullion verify`: proves on this machine that culling drops nothing and, with this GPU, that it changes no picture.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};
use mullion_client::gpu::{Gpu, GpuOptions};
use mullion_client::occlusion::{Occlusion, UnknownOcclusion};
use mullion_server::cull::Algorithm;

use super::prepare::HowToPrepare;
use crate::cull_cases::{self, Report};
use crate::files::{claim, is_standard_output, open_scene, write_json};
use crate::pixels::{self, Check, Grid, SceneVerdict};
use crate::progress::Progress;
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
    /// together are the picture of the whole wall. With --occlusion, so does the wall of tiles that leave out what is hidden.
    Pixels(PixelOptions),
    /// Every algorithm against the exact answer, on random scenes, walls and poses: nothing that a view sees is dropped.
    Cull(CullOptions),
}

#[derive(clap::Args)]
struct CullOptions {
    /// Go on until so many pairs of a leaf and a view have been looked at.
    #[arg(long, default_value_t = 10_000_000, value_parser = clap::value_parser!(u64).range(1..=MAX_CASES))]
    cases: u64,
    /// Where the random rounds start; each round that fails names its own.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write what was found (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

const MAX_CASES: u64 = 1_000_000_000;
/// Rounds of which a dropped leaf is printed; of the others only the seed.
const MAX_DROPS_TOLD: usize = 16;

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
    #[arg(long, default_value = "sweep")]
    algorithm: Algorithm,
    /// Also draw every tile with occlusion culling, in a few frames that lead to each eye, and hold them against the same without: paper,
    /// cost-adaptive, query or hiz.
    #[arg(long, value_name = "MODE", value_delimiter = ',', value_parser = parse_exact)]
    occlusion: Vec<Occlusion>,
    /// Write what was found (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the whole wall of each scene and eye as a picture into this folder, and what differs.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

/// A way of occlusion culling that promises to change nothing.
fn parse_exact(name: &str) -> Result<Occlusion, String> {
    let way: Occlusion = name.parse().map_err(|error: UnknownOcclusion| error.to_string())?;
    match way {
        Occlusion::Off => Err("none leaves nothing out: there is nothing to verify".to_owned()),
        way if !way.is_exact() => Err(format!("{way} is an estimate: its pictures may differ")),
        way => Ok(way),
    }
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    match &options.what {
        What::Pixels(options) => verify_pixels(options),
        What::Cull(options) => verify_cull(options),
    }
}

fn verify_cull(options: &CullOptions) -> Result<()> {
    if let Some(path) = &options.json {
        claim(path)?;
    }
    let progress = Progress::new();
    let report = cull_cases::verify(options.seed, options.cases, &|cases| progress.show("cases", cases, options.cases));
    progress.finish();
    let report = report?;
    if !options.json.as_deref().is_some_and(is_standard_output) {
        print_report(&report);
    }
    if let Some(path) = &options.json {
        write_json(&report, path)?;
    }
    let failed: Vec<&str> = report.contestants.iter().filter(|c| c.dropped > 0).map(|c| c.name.as_str()).collect();
    match report.drops.first() {
        None => Ok(()),
        Some(drop) => Err(anyhow!(
            "leaves that a view sees were dropped by {}; again with: mullion verify cull --seed {} --cases 1",
            failed.join("; "),
            drop.seed
        )),
    }
}

fn print_report(report: &Report) {
    let share = report.visible as f64 * 100.0 / report.cases.max(1) as f64;
    say!(
        "{} cases in {} rounds of {} frames from seed {}: {} visible ({share:.1}%)",
        report.cases,
        report.rounds,
        report.frames,
        report.seed,
        report.visible
    );
    say!("{:30} {:>12} {:>8} {:>9}", "algorithm", "found", "dropped", "excess");
    for c in &report.contestants {
        say!("{:30} {:12} {:8} {:8.3}%", c.name, c.found, c.dropped, c.excess_percent);
    }
    for drop in report.drops.iter().take(MAX_DROPS_TOLD) {
        say!("round with seed {}: in frame {}, dropped by {}", drop.seed, drop.frame, drop.contestants.join("; "));
        say!("  scene: {}; room: {}", drop.scene, drop.room);
        say!("  leaf {}: {:?}", drop.leaf, drop.bound);
        say!("  view {}: eye {:?}, rays {:?}, planes {:?}", drop.view, drop.eye, drop.rays, drop.planes);
    }
    for drop in report.drops.iter().skip(MAX_DROPS_TOLD) {
        say!("round with seed {}", drop.seed);
    }
}

fn verify_pixels(options: &PixelOptions) -> Result<()> {
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
        let check = Check {
            grids: &options.grids,
            algorithm: options.algorithm,
            occlusion: &options.occlusion,
            pictures: options.pictures.as_deref(),
        };
        let verdict = pixels::verify(&gpu, &name, &package, &check).with_context(|| path.display().to_string())?;
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
        if v.frustum_holds() { "holds" } else { "DIFFERS" }
    );
    for way in &v.occlusion {
        let verdict = match way.holds() {
            false => "DIFFERS",
            true if way.leaves_left_out == 0 => "holds, but nothing was left out",
            true => "holds",
        };
        say!(
            "{:28} {:>7} {:>8} {:6} {:6.1}% {:8} {:8.4}% {:>8}  {verdict}",
            format!("  of that, hidden: {}", way.occlusion),
            "",
            "",
            way.tiles_compared,
            way.left_out_percent(),
            way.tiles_that_differ,
            way.worst_differing_percent,
            "",
        );
    }
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
