//! `mullion bench occlusion`.

mod contest;
mod figures;
mod table;

use std::path::PathBuf;

use anyhow::{Context, Result, anyhow};
use clap::ValueEnum;
use mullion_client::frame::Planner;
use mullion_client::gpu::{Gpu, GpuOptions};
use mullion_client::occlusion::unit::ViewPlane;
use mullion_client::occlusion::{Adaptive, Occlusion};
use mullion_common::camera_path::CameraPath;
use mullion_common::wall::{Wall, WallConfig};
use serde::Serialize;

use self::contest::Contest;
use self::table::Table;
use super::machine::Machine;
use crate::birdseye::{self, Flight};
use crate::camera::PathSource;
use crate::commands::prepare::HowToPrepare;
use crate::files::{is_standard_output, open_named_scene, write_json};
use crate::say::say;

/// What to draw, and how.
#[derive(clap::Args)]
pub struct Options {
    /// glTF, GLB or package files, or names of generated scenes; those of the paper if none is named.
    #[arg(long = "scene", value_name = "NAME|FILE", value_delimiter = ',', default_value = "cathedrals,city,forest,garbage")]
    scenes: Vec<String>,
    /// Camera path: a file, or a walk made for the scene: orbit, whole, interior, flythrough, pan. If left out, a scene of the paper has its
    /// own (benches/paths), any other the interior walk.
    #[arg(long, value_name = "NAME|FILE")]
    path: Option<String>,
    /// Ways to draw, beside frustum culling alone.
    #[arg(
        long = "mode",
        value_name = "MODE",
        value_delimiter = ',',
        default_value = "perfect,paper,sampled,cost-adaptive,query,hiz,default,adaptive"
    )]
    modes: Vec<Mode>,
    /// With the mode adaptive: what contributes less is left out (equation 1), as a share of the view plane's pixels. Several: a row each.
    #[arg(long, value_name = "SHARES", value_delimiter = ',', default_value = "0.01", value_parser = parse_share)]
    threshold: Vec<f64>,
    /// With the mode adaptive: equation 1 as it is printed, which counts all pixels of a bound, hidden or not.
    #[arg(long, value_name = "printed")]
    adaptive: Option<Printed>,
    /// Frames to measure.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    frames: u64,
    /// Width and height of the picture, pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "650x650", value_parser = parse_size)]
    size: [u32; 2],
    /// Write every figure and what machine this is (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Draw the paper's figures 5, 7 and 9: frame rate and share culled, frame by frame (SVG), into this folder.
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
    /// Draw the scene from above into this file (PNG): the last frame's frustum in red, and in yellow the bounds of leaves in it that were
    /// left out. In the mode hiz if it is measured, else in the first that leaves out what is hidden; in none nothing is yellow. The last
    /// frames are drawn again for it, also where culling does not pay. Of several scenes each has a file, to whose name the scene's is added.
    #[arg(long, value_name = "FILE")]
    birdseye: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

/// Which form of equation 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Printed {
    /// As it is printed.
    Printed,
}

/// A mode with what it needs to know.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    mode: Mode,
    adaptive: Option<Adaptive>,
}

impl Way {
    fn name(&self) -> String {
        match self.adaptive {
            Some(Adaptive { threshold, as_printed: false, .. }) => format!("adaptive {threshold}"),
            Some(Adaptive { threshold, .. }) => format!("printed {threshold}"),
            None => self.mode.name().to_owned(),
        }
    }

    fn planner(&self) -> Planner {
        match self.adaptive {
            Some(adaptive) => Planner::new().adaptive(adaptive),
            None if self.mode == Mode::Default => Planner::new().culling(Occlusion::Hiz).while_worth(),
            None => Planner::new().culling(self.mode.occlusion()),
        }
    }
}

/// A way to draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// All of the scene.
    None,
    /// What is in the view. Always measured.
    Frustum,
    /// The leaves of which a pixel is seen, known beforehand: what no culling of leaves can surpass.
    Perfect,
    /// The paper's loop, front to back.
    Paper,
    /// The same, a tenth of each bound looked at while the camera moves: an estimate.
    Sampled,
    /// The paper's loop within its share of the time (equation 2).
    CostAdaptive,
    /// Hardware occlusion queries.
    Query,
    /// Two passes and a pyramid of depths.
    Hiz,
    /// As tiles draw by default: hiz, left off for a while where it costs more than it saves.
    Default,
    /// The paper's loop, without what hardly contributes: an estimate.
    Adaptive,
}

impl Mode {
    /// As users write it.
    fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Frustum => "frustum",
            Self::Perfect => "perfect",
            Self::Default => "default",
            _ => self.occlusion().name(),
        }
    }

    fn occlusion(self) -> Occlusion {
        match self {
            Self::None | Self::Frustum | Self::Perfect => Occlusion::Off,
            Self::Paper => Occlusion::Paper,
            Self::Sampled => Occlusion::Sampled,
            Self::CostAdaptive => Occlusion::CostAdaptive,
            Self::Query => Occlusion::Query,
            Self::Hiz | Self::Default => Occlusion::Hiz,
            Self::Adaptive => Occlusion::Adaptive,
        }
    }
}

/// Height of the screen that the picture is on, metres.
const SCREEN_M: f64 = 2.0;

/// The camera paths of the paper's scenes.
const PATHS: [(&str, &str); 4] = [
    ("cathedrals", include_str!("../../../../benches/paths/cathedrals.path")),
    ("city", include_str!("../../../../benches/paths/city.path")),
    ("forest", include_str!("../../../../benches/paths/forest.path")),
    ("garbage", include_str!("../../../../benches/paths/garbage.path")),
];

fn parse_share(text: &str) -> Result<f64, String> {
    let parsed = text.parse().ok().filter(|share: &f64| share.is_finite() && *share >= 0.0);
    parsed.ok_or_else(|| format!("{text:?} is no share: a number from 0 on, as in 0.01"))
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some([w.parse::<u32>().ok()?, h.parse::<u32>().ok()?]));
    parsed
        .filter(|size| size.iter().all(|edge| (1..=8192).contains(edge)))
        .ok_or_else(|| format!("{text:?} is no size: width x height, each 1 to 8192 pixels, as in 650x650"))
}

#[derive(Serialize)]
struct Report<'a> {
    machine: Machine,
    gpu: String,
    size_px: [u32; 2],
    tables: &'a [Table],
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let source = options.path.as_deref().map(PathSource::open).transpose().context("--path")?;
    let how = options.how.options()?;
    super::claim_outputs(options.json.as_deref(), options.plots.as_deref())?;
    let birdseyes = options.birdseyes();
    birdseyes.iter().try_for_each(|file| birdseye::claim(file))?;
    let is_piped = options.json.as_deref().is_some_and(is_standard_output);
    let (machine, gpu) = (Machine::this(), Gpu::open(GpuOptions::default())?);
    if !is_piped {
        say!("{machine}\n{}\n", gpu.describe());
    }
    let wall = wall(options.size)?;
    let ways = ways(options, &wall);
    let mut tables = Vec::new();
    for (at, scene) in options.scenes.iter().enumerate() {
        let package = open_named_scene(scene, &how)?;
        let name = stem(scene);
        let (path_name, path) = match (&source, PATHS.iter().find(|(of, _)| of == scene)) {
            (Some(source), _) => (source.to_string(), source.path(&package, &wall, Some(options.frames))?),
            (None, Some((of, text))) => {
                (format!("benches/paths/{of}.path"), CameraPath::parse(text).context("a path of this program")?)
            }
            (None, None) => {
                let source = PathSource::open("interior")?;
                (source.to_string(), source.path(&package, &wall, Some(options.frames))?)
            }
        };
        let table = Contest::new(&gpu, &package, &wall, &ways)?.measure((name, path_name), &path, options.frames)?;
        if !is_piped {
            table.print();
        }
        tables.push(table);
        if let Some(file) = birdseyes.get(at) {
            let flight = Flight {
                package: &package,
                wall: &wall,
                path: &path,
                last: options.frames - 1,
                occlusion: culling(&options.modes),
            };
            let left_out = flight.write(&gpu, file)?;
            if !is_piped {
                say!("{}: {left_out}\n", file.display());
            }
        }
    }
    if let Some(folder) = &options.plots {
        for file in figures::draw(&tables, folder)? {
            if !is_piped {
                say!("{}", file.display());
            }
        }
    }
    let report = Report { machine, gpu: gpu.describe(), size_px: options.size, tables: &tables };
    options.json.as_ref().map_or(Ok(()), |path| write_json(&report, path))
}

/// All that is measured beside frustum culling.
fn ways(options: &Options, wall: &Wall) -> Vec<Way> {
    let eye_m = wall.default_eyes().first().map_or(1.0, |eye| eye.z);
    let plane = ViewPlane { pixels: options.size.iter().map(|edge| u64::from(*edge)).product(), eye_m };
    let adaptive = |threshold| {
        let as_printed = options.adaptive.is_some();
        Way { mode: Mode::Adaptive, adaptive: Some(Adaptive { threshold, as_printed, plane, size_px: options.size }) }
    };
    let mut ways = Vec::new();
    for &mode in options.modes.iter().filter(|mode| **mode != Mode::Frustum) {
        match mode {
            Mode::Adaptive => ways.extend(options.threshold.iter().copied().map(adaptive)),
            _ => ways.push(Way { mode, adaptive: None }),
        }
    }
    ways
}

impl Options {
    /// A file for each scene; none where there shall be none.
    fn birdseyes(&self) -> Vec<PathBuf> {
        match (&self.birdseye, &self.scenes[..]) {
            (None, _) => Vec::new(),
            (Some(file), [_]) => vec![file.clone()],
            (Some(file), scenes) => scenes.iter().map(|scene| birdseye::file_of(file, &stem(scene))).collect(),
        }
    }
}

/// What a scene is called: a file's name without what it ends in.
fn stem(scene: &str) -> String {
    PathBuf::from(scene).file_stem().map_or_else(|| scene.to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// What a picture from above is drawn with.
fn culling(modes: &[Mode]) -> Occlusion {
    let mut ways = modes.iter().map(|mode| mode.occlusion()).filter(|way| Occlusion::ALL.contains(way) && *way != Occlusion::Off);
    let first = ways.next().unwrap_or_default();
    if ways.any(|way| way == Occlusion::Hiz) { Occlusion::Hiz } else { first }
}

/// A wall of one tile.
fn wall([width, height]: [u32; 2]) -> Result<Wall> {
    let width_m = SCREEN_M * f64::from(width) / f64::from(height);
    let text = format!("[grid]\ncolumns = 1\nrows = 1\ntile_px = [{width}, {height}]\ntile_m = [{width_m:?}, {SCREEN_M:?}]\n");
    WallConfig::parse(&text).map_err(|e| anyhow!("--size: {e}"))
}
