//! `mullion bench plp`.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use mullion_client::plp::{Solidity, Traversal};
use mullion_common::camera_path::CameraPath;
use mullion_common::wall::WallConfig;
use mullion_server::prepare::plp::{TessellateOptions, TessellationStatistics};
use serde::Serialize;

use super::machine::Machine;
use crate::camera::PathSource;
use crate::commands::prepare::{HowToPrepare, add_tessellation};
use crate::files::{claim, is_standard_output, open_named_scene, write_json};
use crate::plp::{Judge, Verdict, change};
use crate::say::say;

/// Budgets, as shares of all triangles: the paper's.
const BUDGETS: [f64; 4] = [0.01, 0.02, 0.05, 0.1];
/// At which of them popping is measured.
const POPPING: usize = 2;
/// Width and height of the picture.
const SIZE_PX: u32 = 1024;

/// The camera paths of the paper's scenes.
const PATHS: [(&str, &str); 2] = [
    ("plp-city", include_str!("../../../benches/paths/plp_city.path")),
    ("cars", include_str!("../../../benches/paths/cars.path")),
];

/// What to estimate, and how.
#[derive(clap::Args)]
pub struct Options {
    /// glTF, GLB or package files, or names of generated scenes; those of the paper if none is named.
    #[arg(long = "scene", value_name = "NAME|FILE", value_delimiter = ',', default_value = "plp-city,cars")]
    scenes: Vec<String>,
    /// Camera path: a file, or a walk made for the scene. If left out, a scene of the paper has its own, any other the interior walk.
    #[arg(long, value_name = "NAME|FILE")]
    path: Option<String>,
    /// Frames to measure, spread over the path.
    #[arg(long, default_value_t = 40, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    frames: u64,
    /// Divide space down to this share of the scene's longest side.
    #[arg(long, value_name = "SHARE", default_value_t = TessellateOptions::default().leaf_share)]
    plp_leaf: f64,
    /// Write every figure and what machine this is (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

/// What was found at one budget, all frames together.
#[derive(Clone, Copy, Debug, Default, Serialize)]
struct Row {
    coverage: f64,
    worst_coverage: f64,
    wrong_pixels: f64,
    worst_wrong_pixels: f64,
}

#[derive(Serialize)]
struct Estimate {
    name: &'static str,
    budgets: Vec<Row>,
    /// The greatest change of the estimate between two frames 0.1 degrees apart, beyond that of the visible set.
    popping: Option<f64>,
    /// Milliseconds a frame, up to the largest budget.
    time_ms: f64,
}

#[derive(Serialize)]
struct Table {
    scene: String,
    path: String,
    triangles: usize,
    cells: u64,
    references_per_triangle: f64,
    /// Mean size of the visible set.
    visible: f64,
    /// The best that any way could do.
    bounds: Vec<f64>,
    estimates: Vec<Estimate>,
}

#[derive(Serialize)]
struct Report<'a> {
    machine: Machine,
    tables: &'a [Table],
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    options.json.as_deref().map_or(Ok(()), claim)?;
    let is_piped = options.json.as_deref().is_some_and(is_standard_output);
    let machine = Machine::this();
    if !is_piped {
        say!("{machine}\n");
    }
    let mut tables = Vec::new();
    for scene in &options.scenes {
        let table = measure(options, scene)?;
        if !is_piped {
            table.print();
        }
        tables.push(table);
    }
    options.json.as_ref().map_or(Ok(()), |path| write_json(&Report { machine, tables: &tables }, path))
}

fn measure(options: &Options, scene: &str) -> Result<Table> {
    let mut package = open_named_scene(scene, &options.how.options()?)?;
    add_tessellation(&mut package, &TessellateOptions { leaf_share: options.plp_leaf })?;
    let text = format!("[grid]\ncolumns = 1\nrows = 1\ntile_px = [{SIZE_PX}, {SIZE_PX}]\ntile_m = [2.0, 2.0]\n");
    let wall = WallConfig::parse(&text).map_err(|e| anyhow!("a wall of one tile: {e}"))?;
    let (path_name, path) = match (&options.path, PATHS.iter().find(|(of, _)| *of == scene)) {
        (None, Some((of, text))) => ((*of).to_owned(), CameraPath::parse(text).context("a path of this program")?),
        (source, _) => {
            let source = PathSource::open(source.as_deref().unwrap_or("interior")).context("--path")?;
            (source.to_string(), source.path(&package, &wall, Some(options.frames))?)
        }
    };
    let statistics = TessellationStatistics::of(&package).context("the scene was tessellated")?;
    let tessellation = package.scene.tessellation.clone().context("the scene was tessellated")?;
    let mut judge = Judge::new(&package, &tessellation, &wall, [SIZE_PX; 2]);
    let triangles = judge.triangles();
    let budgets = BUDGETS.map(|share| (share * triangles as f64) as u32);
    let mut sums = Solidity::ALL.map(|solidity| Sum::new(solidity.name()));
    let mut nearest = Sum::new("nearest");
    let mut bounds = [0.0; BUDGETS.len()];
    let mut visible = 0;
    for k in 0..options.frames {
        let pose = path.pose(k * path.poses().len() as u64 / options.frames);
        let (seen, next) = (judge.look(&pose), judge.look(&judge.turned(&pose)));
        visible += seen.visible().len();
        for (bound, budget) in bounds.iter_mut().zip(budgets) {
            *bound += (f64::from(budget) / seen.visible().len().max(1) as f64).min(1.0) / options.frames as f64;
        }
        for (solidity, sum) in Solidity::ALL.into_iter().zip(&mut sums) {
            let mut traversal = Traversal::new();
            sum.time += judge.begin(&mut traversal, &seen, solidity);
            let mut held = Vec::new();
            for (at, budget) in budgets.into_iter().enumerate() {
                sum.time += judge.project(&mut traversal, &seen, budget);
                sum.add(at, judge.judge(&seen, |slot| traversal.drawn().holds(slot)));
                if at == POPPING {
                    held = slots(&traversal, triangles);
                }
            }
            judge.begin(&mut traversal, &next, solidity);
            judge.project(&mut traversal, &next, budgets[POPPING]);
            let popping = change(&held, &slots(&traversal, triangles)) - change(seen.visible(), next.visible());
            sum.popping = Some(sum.popping.map_or(popping, |worst: f64| worst.max(popping)));
        }
        for (at, budget) in budgets.into_iter().enumerate() {
            let held = judge.nearest(&seen, budget);
            nearest.add(at, judge.judge(&seen, |slot| held[slot as usize]));
        }
    }
    Ok(Table {
        scene: scene.to_owned(),
        path: path_name,
        triangles,
        cells: statistics.cells,
        references_per_triangle: statistics.references_per_triangle(),
        visible: visible as f64 / options.frames as f64,
        bounds: bounds.to_vec(),
        estimates: sums.into_iter().chain([nearest]).map(|sum| sum.mean(options.frames)).collect(),
    })
}

fn slots(traversal: &Traversal, triangles: usize) -> Vec<u32> {
    (0..triangles as u32).filter(|slot| traversal.drawn().holds(*slot)).collect()
}

/// What is found, frame by frame.
struct Sum {
    name: &'static str,
    rows: [Row; BUDGETS.len()],
    popping: Option<f64>,
    time: Duration,
}

impl Sum {
    fn new(name: &'static str) -> Self {
        let row = Row { worst_coverage: 1.0, ..Row::default() };
        Self { name, rows: [row; BUDGETS.len()], popping: None, time: Duration::ZERO }
    }

    fn add(&mut self, at: usize, verdict: Verdict) {
        let row = &mut self.rows[at];
        row.coverage += verdict.coverage;
        row.worst_coverage = row.worst_coverage.min(verdict.coverage);
        row.wrong_pixels += verdict.wrong_pixels;
        row.worst_wrong_pixels = row.worst_wrong_pixels.max(verdict.wrong_pixels);
    }

    fn mean(self, frames: u64) -> Estimate {
        let frames = frames as f64;
        let mean = |row: Row| Row { coverage: row.coverage / frames, wrong_pixels: row.wrong_pixels / frames, ..row };
        Estimate {
            name: self.name,
            budgets: self.rows.map(mean).to_vec(),
            popping: self.popping,
            time_ms: self.time.as_secs_f64() * 1e3 / frames,
        }
    }
}

impl Table {
    fn print(&self) {
        say!(
            "{}, path {}: {} triangles, {:.0} of them visible; {} cells, {:.2} references a triangle",
            self.scene,
            self.path,
            self.triangles,
            self.visible,
            self.cells,
            self.references_per_triangle
        );
        let line = |name: &str, of: &dyn Fn(usize) -> f64, rest: &str| {
            let cells: Vec<String> = (0..BUDGETS.len()).map(|at| format!("{:>7.1}", of(at) * 100.0)).collect();
            say!("{name:<28}{}{rest}", cells.join(""));
        };
        line("budget, %", &|at| BUDGETS[at], "");
        line("at best", &|at| self.bounds[at], "");
        for estimate in &self.estimates {
            let popping = estimate.popping.map(|share| format!("   popping {:.2} %, {:.1} ms", share * 100.0, estimate.time_ms));
            line(&format!("{}: found", estimate.name), &|at| estimate.budgets[at].coverage, &popping.unwrap_or_default());
            line("  in the worst frame", &|at| estimate.budgets[at].worst_coverage, "");
            line("  wrong pixels", &|at| estimate.budgets[at].wrong_pixels, "");
            line("  in the worst frame", &|at| estimate.budgets[at].worst_wrong_pixels, "");
        }
        say!("");
    }
}
