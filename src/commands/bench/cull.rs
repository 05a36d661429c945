//! `mullion bench cull`.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, ensure};
use mullion_common::scene::Package;
use mullion_server::cull::Algorithm;
use mullion_server::tree::TreeForm;
use serde::Serialize;

use super::figures;
use super::machine::Machine;
use super::measure::{Case, Contestant, Variant, WARM_UP_FRAMES, measure};
use super::moving::{self, MovingCase, MovingTable};
use super::table::{Table, compare};
use crate::camera::PathSource;
use crate::commands::demo::{GRID_HZ, grid_wall};
use crate::commands::prepare::HowToPrepare;
use crate::files::{claim, is_standard_output, open_named_scene, write_json};
use crate::pixels::Grid;
use crate::say::say;

/// What to cull, on which walls, and how.
#[derive(clap::Args)]
pub struct Options {
    /// glTF, GLB or package files, or names of generated scenes; the city if none is named.
    #[arg(value_name = "SCENE")]
    scenes: Vec<String>,
    /// Further scenes.
    #[arg(long = "scene", value_name = "NAME|FILE")]
    more_scenes: Vec<String>,
    /// Walls by columns and rows.
    #[arg(long, value_name = "COLUMNSxROWS", value_delimiter = ',', default_value = "4x4,8x8", value_parser = Grid::parse)]
    grid: Vec<Grid>,
    /// Width of the bezels, pixels of 320 across a tile; none, as in the paper's tight array, if left out.
    #[arg(long, value_name = "PIXELS", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=64))]
    bezel_px: u32,
    /// Camera path: a file, or a walk made for the scene: orbit, whole, interior, flythrough, pan.
    #[arg(long, value_name = "NAME|FILE", default_value = "whole")]
    path: String,
    /// Frames to measure; as many as the path has, but no more than 600, if left out.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=MAX_FRAMES))]
    frames: Option<u64>,
    /// Also run the sweep on so many threads, once for each number above 1.
    #[arg(long, value_name = "THREADS", value_delimiter = ',', value_parser = clap::value_parser!(u8).range(1..=64))]
    threads: Vec<u8>,
    /// Also run the sweep with temporal slack.
    #[arg(long)]
    slack: bool,
    /// Also run the paper's algorithms over the file's own tree, as nobody has regrouped it.
    #[arg(long)]
    file_tree: bool,
    /// Instead, move so many percent of the objects before every frame, and measure moving, refitting and culling.
    #[arg(long, value_name = "PERCENT,…", value_delimiter = ',', value_parser = clap::value_parser!(u8).range(0..=100))]
    moving: Vec<u8>,
    /// naive, oh-plain, fh, oh, adaptive, adaptive-grouped, sweep: some of them, or all.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', default_value = "all")]
    algorithm: Vec<String>,
    /// Write every figure and what machine this is (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Draw the figures into this folder, as SVG.
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

/// Most frames of a run, and most if nobody says: ten seconds at 60 Hz.
const MAX_FRAMES: u64 = 100_000;
const DEFAULT_MAX_FRAMES: u64 = 600;

/// All that was measured.
#[derive(Serialize)]
struct Report {
    machine: Machine,
    warm_up_frames: u64,
    tables: Vec<Table>,
    moving: Vec<MovingTable>,
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let contestants = contestants(options)?;
    let source = PathSource::open(&options.path).context("--path")?;
    let how = options.how.options()?;
    options.json.as_deref().map_or(Ok(()), claim)?;
    if let Some(folder) = &options.plots {
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let is_piped = options.json.as_deref().is_some_and(is_standard_output);
    let machine = Machine::this();
    if !is_piped {
        say!("{machine}\n");
    }
    let (mut tables, mut moving) = (Vec::new(), Vec::new());
    for (scene, name) in scenes(options)? {
        let package = Arc::new(open_named_scene(scene, &how)?);
        for grid in &options.grid {
            if options.moving.is_empty() {
                let table = measured(&name, &package, *grid, &source, options, &contestants)?;
                if !is_piped {
                    table.print();
                }
                tables.push(table);
            }
            for percent in &options.moving {
                let table = measured_moving(&name, &package, *grid, &source, options, *percent)?;
                if !is_piped {
                    table.print();
                }
                moving.push(table);
            }
        }
    }
    if let Some(folder) = &options.plots {
        for file in figures::draw(&tables, &moving, folder)?.iter().filter(|_| !is_piped) {
            say!("wrote {}", file.display());
        }
    }
    let report = Report { machine, warm_up_frames: WARM_UP_FRAMES, tables, moving };
    options.json.as_ref().map_or(Ok(()), |path| write_json(&report, path))
}

fn measured(
    name: &str,
    package: &Package,
    grid: Grid,
    source: &PathSource,
    options: &Options,
    contestants: &[Contestant],
) -> Result<Table> {
    let wall = grid_wall(grid, options.bezel_px, GRID_HZ)?;
    let path = source.path(package, &wall, options.frames)?;
    let frames = options.frames.unwrap_or((path.poses().len() as u64).min(DEFAULT_MAX_FRAMES));
    let (tree_bytes, rows) = measure(&Case { package, wall: &wall, path: &path, frames }, contestants)?;
    Ok(Table {
        scene: name.to_owned(),
        grid: grid.to_string(),
        tiles: wall.tiles().len() as u32,
        leaves: package.scene.leaf_count(),
        nodes: package.scene.hierarchy.nodes().len() as u32,
        tree_bytes,
        path: source.to_string(),
        frames,
        rows: compare(rows),
    })
}

fn measured_moving(
    name: &str,
    package: &Arc<Package>,
    grid: Grid,
    source: &PathSource,
    options: &Options,
    percent: u8,
) -> Result<MovingTable> {
    let wall = grid_wall(grid, options.bezel_px, GRID_HZ)?;
    let path = source.path(package, &wall, options.frames)?;
    let frames = options.frames.unwrap_or((path.poses().len() as u64).min(DEFAULT_MAX_FRAMES));
    let (moving_objects, rows) = moving::measure(&MovingCase { package, wall: &wall, path: &path, frames, percent });
    Ok(MovingTable { scene: name.to_owned(), grid: grid.to_string(), percent, moving_objects, frames, rows })
}

/// The chosen algorithms, and the variants of the sweep behind them.
fn contestants(options: &Options) -> Result<Vec<Contestant>> {
    let mut algorithms = Vec::new();
    for name in &options.algorithm {
        let named = match name.as_str() {
            "all" => Algorithm::ALL.to_vec(),
            name => vec![name.parse().map_err(|e| anyhow!("--algorithm: {e}, all"))?],
        };
        algorithms.extend(named.into_iter().filter(|a| !algorithms.contains(a)).collect::<Vec<_>>());
    }
    let mut variants: Vec<Variant> = Vec::new();
    for threads in options.threads.iter().copied().filter(|threads| *threads > 1) {
        if !variants.contains(&Variant::Threads(threads)) {
            variants.push(Variant::Threads(threads));
        }
    }
    variants.extend(options.slack.then_some(Variant::Slack));
    ensure!(
        variants.is_empty() || algorithms.contains(&Algorithm::Sweep),
        "--threads and --slack are the sweep's: name it with --algorithm, too"
    );
    let is_papers = |algorithm: &&Algorithm| algorithm.tree_form() == TreeForm::Hierarchy;
    let of_file = algorithms.iter().filter(is_papers).filter(|_| options.file_tree);
    let of_file = of_file.map(|algorithm| Contestant { algorithm: *algorithm, variant: Variant::FileTree });
    let plain = algorithms.iter().map(|algorithm| Contestant { algorithm: *algorithm, variant: Variant::Plain });
    let of_sweep = variants.into_iter().map(|variant| Contestant { algorithm: Algorithm::Sweep, variant });
    Ok(plain.chain(of_sweep).chain(of_file).collect())
}

/// Scenes as they were named, and what tables call them.
fn scenes(options: &Options) -> Result<Vec<(&str, String)>> {
    const DEFAULT: &str = "city";
    let mut named: Vec<&str> = options.scenes.iter().chain(&options.more_scenes).map(String::as_str).collect();
    if named.is_empty() {
        named.push(DEFAULT);
    }
    let mut taken = HashSet::new();
    let mut scenes = Vec::new();
    for scene in named {
        let path = Path::new(scene);
        let name = path.file_stem().map_or_else(|| scene.to_owned(), |stem| stem.to_string_lossy().into_owned());
        ensure!(
            taken.insert(name.clone()),
            "{scene}: two scenes are called {name:?}: tables and figures could not tell them apart"
        );
        scenes.push((scene, name));
    }
    Ok(scenes)
}
