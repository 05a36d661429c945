//! `mullion bench plp`.

mod contest;
mod figures;
mod table;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, ensure};
use clap::ValueEnum;
use mullion_client::gpu::Gpu;
use mullion_client::plp::Solidity;
use mullion_common::camera_path::CameraPath;
use mullion_common::wall::WallConfig;
use mullion_server::prepare::plp::TessellateOptions;
use serde::Serialize;

use self::contest::Contest;
use self::table::Table;
use super::machine::Machine;
use crate::camera::PathSource;
use crate::commands::prepare::{HowToPrepare, add_tessellation};
use crate::files::{is_standard_output, open_named_scene, write_json};
use crate::say::say;

/// A scene of the paper: its name, its camera path, and how many frames the paper measured.
const SCENES: [(&str, &str, u64); 2] = [
    ("plp-city", include_str!("../../../../benches/paths/plp_city.path"), 160),
    ("cars", include_str!("../../../../benches/paths/cars.path"), 200),
];
/// Frames of any other scene.
const FRAMES: u64 = 40;

/// What to estimate, and how.
#[derive(clap::Args)]
pub struct Options {
    /// glTF, GLB or package files, or names of generated scenes; those of the paper if none is named.
    #[arg(long = "scene", value_name = "NAME|FILE", value_delimiter = ',', default_value = "plp-city,cars")]
    scenes: Vec<String>,
    /// Camera path: a file, or a walk made for the scene. If left out, a scene of the paper has its own, any other the interior walk.
    #[arg(long, value_name = "NAME|FILE")]
    path: Option<String>,
    /// Budgets, percent of all triangles, ascending.
    #[arg(long, value_name = "PERCENT", value_delimiter = ',', default_value = "1,2,5,10", value_parser = parse_percent)]
    budgets: Vec<f64>,
    /// How likely cells are taken to be hidden.
    #[arg(long = "solidity", value_name = "WAY", value_delimiter = ',', default_value = "paper,likelihood")]
    solidities: Vec<Way>,
    /// Frames to measure, spread over the path. If left out, as many as the paper of its scenes, 40 of any other.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    frames: Option<u64>,
    /// Divide space down to this share of the scene's longest side.
    #[arg(long, value_name = "SHARE", default_value_t = TessellateOptions::default().leaf_share)]
    plp_leaf: f64,
    /// Measure what is found alone: nothing is drawn by the GPU.
    #[arg(long)]
    no_gpu: bool,
    /// Write every figure and what machine this is (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Draw what was found and how long that took, frame by frame, and pictures, into this folder.
    #[arg(long, value_name = "FOLDER")]
    plots: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

#[derive(Clone, Copy, ValueEnum)]
enum Way {
    Paper,
    #[value(alias = "ours")]
    Likelihood,
}

impl Way {
    fn solidity(self) -> Solidity {
        match self {
            Self::Paper => Solidity::Paper,
            Self::Likelihood => Solidity::Likelihood,
        }
    }
}

fn parse_percent(text: &str) -> Result<f64, String> {
    let percent: f64 = text.trim().parse().map_err(|_| "not a number".to_owned())?;
    if percent > 0.0 && percent <= 100.0 { Ok(percent) } else { Err("not above 0, and at most 100".to_owned()) }
}

#[derive(Serialize)]
struct Report<'a> {
    machine: Machine,
    tables: &'a [Table],
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    ensure!(options.budgets.is_sorted_by(|a, b| a < b), "--budgets: they do not ascend");
    super::claim_outputs(options.json.as_deref(), options.plots.as_deref())?;
    let is_piped = options.json.as_deref().is_some_and(is_standard_output);
    let machine = Machine::this();
    let gpu = if options.no_gpu { None } else { super::open_gpu(is_piped) };
    if !is_piped {
        say!("{machine}");
        gpu.as_ref().inspect(|gpu| say!("{}", gpu.describe()));
        say!("");
    }
    let mut tables = Vec::new();
    for scene in &options.scenes {
        let table = measure(options, scene, gpu.as_ref())?;
        if !is_piped {
            table.print();
        }
        tables.push(table);
    }
    if let Some(folder) = &options.plots {
        for file in figures::draw(&tables, folder)? {
            if !is_piped {
                say!("{}", file.display());
            }
        }
    }
    options.json.as_ref().map_or(Ok(()), |path| write_json(&Report { machine, tables: &tables }, path))
}

fn measure(options: &Options, scene: &str, gpu: Option<&Arc<Gpu>>) -> Result<Table> {
    let mut package = open_named_scene(scene, &options.how.options()?)?;
    let preparation = std::time::Instant::now();
    add_tessellation(&mut package, &TessellateOptions { leaf_share: options.plp_leaf })?;
    let tessellation_ms = preparation.elapsed().as_secs_f64() * 1e3;
    let [width, height] = contest::SIZE_PX;
    let text = format!("[grid]\ncolumns = 1\nrows = 1\ntile_px = [{width}, {height}]\ntile_m = [2.0, 2.0]\n");
    let wall = WallConfig::parse(&text).map_err(|e| anyhow!("a wall of one tile: {e}"))?;
    let of_paper = SCENES.iter().find(|(of, ..)| *of == scene);
    let frames = options.frames.or(of_paper.map(|(.., frames)| *frames)).unwrap_or(FRAMES);
    let (path_name, path) = match (&options.path, of_paper) {
        (None, Some((of, text, _))) => ((*of).to_owned(), CameraPath::parse(text).context("a path of this program")?),
        (source, _) => {
            let source = PathSource::open(source.as_deref().unwrap_or("interior")).context("--path")?;
            (source.to_string(), source.path(&package, &wall, Some(frames))?)
        }
    };
    let solidities: Vec<Solidity> = options.solidities.iter().map(|way| way.solidity()).collect();
    let budgets: Vec<f64> = options.budgets.iter().map(|percent| percent / 100.0).collect();
    let mut contest = Contest::new(&package, &wall, gpu, (&solidities, &budgets))?;
    contest.pictures_of = options.plots.as_ref().map(|_| frames / 2);
    (0..frames).try_for_each(|k| contest.measure(k, &path.pose(k * path.poses().len() as u64 / frames)))?;
    contest.table((scene, &path_name), tessellation_ms)
}
