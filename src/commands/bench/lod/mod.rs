//! `mullion bench lod`.

mod contest;
mod figures;
mod table;
mod views;

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use clap::ValueEnum;
use glam::DVec3;
use mullion_client::lod::BoundsKind;
use mullion_common::scene::LodForm;
use mullion_common::wire::DetailWeight;
use mullion_server::prepare::plp::TessellateOptions;
use serde::Serialize;

use self::contest::Contest;
use self::table::Table;
use self::views::{VIEWS, View};
use super::machine::Machine;
use crate::camera::parse_point;
use crate::commands::prepare::{HowToPrepare, add_tessellation};
use crate::files::{is_standard_output, write_json};
use crate::lod::Subject;
use crate::say::say;

/// What to simplify, and from where it is seen.
#[derive(clap::Args)]
pub struct Options {
    /// Views to measure; all if none is named: armadillo, armadillo-group, dragon, armadillo-open, planet-full, planet-near. Scans are read
    /// from the folder that MULLION_MODELS names; where one is not there, the scene `organic` stands in.
    #[arg(long = "view", value_name = "NAME", value_delimiter = ',')]
    views: Vec<String>,
    /// Another scene: a glTF, GLB or package file, or the name of a generated scene. Seen from one side, or as the view that is named.
    #[arg(long, value_name = "NAME|FILE")]
    scene: Option<String>,
    /// The eye, in radii of the scene from its middle.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// What it looks at, likewise.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    at: Option<DVec3>,
    /// Most triangles of all objects together.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    triangles: u32,
    /// What hierarchies are made of: vertices, clusters; both: one behind the other [default: as the package has them, or of vertices]
    #[arg(long, value_name = "FORM", value_delimiter = ',')]
    form: Vec<LodForm>,
    /// What of a split is held against the occluder.
    #[arg(long, value_name = "KIND", value_delimiter = ',', default_value = "link,cylinder,box,sphere")]
    bounds: Vec<Bounds>,
    /// Who says what is hidden: depths on the CPU, kept over frames, or occlusion queries of the GPU, anew in each frame, as the paper has it. Both: one
    /// behind the other.
    #[arg(long, value_name = "WAY", value_delimiter = ',', default_value = "depths")]
    answers: Vec<Answers>,
    /// Splits after which the occluder is drawn, up to four, ascending.
    #[arg(long, value_name = "STEPS", value_delimiter = ',', default_value = "300,2500")]
    occluders: Vec<u32>,
    /// Ask about every other level only, as the paper does.
    #[arg(long)]
    odd_levels: bool,
    /// What objects weigh in the budget where the occluder is asked: all alike (none), as much of their boxes as is seen (nohc), or as many of
    /// their triangles as are likely seen (plp), by a tessellation that is made where the scene has none.
    #[arg(long, value_name = "WEIGHT", default_value_t)]
    lod_weight: DetailWeight,
    /// Width and height of the occluder's picture, pixels [default: 288 of depths; of queries those of the picture]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(8..=4096))]
    occluder_px: Option<u32>,
    /// Width and height of the picture, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(16..=8192))]
    size: u32,
    /// Frames, each half a degree from the one before.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    frames: u64,
    /// Go all frames so many times: of each the quickest run is told, on either side, so that what else the machine does is not taken for a cost;
    /// of the first frame the first run, when all is cold.
    #[arg(long, value_name = "TIMES", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    rounds: u32,
    /// Also refine until no surface is wrong by more pixels, whatever the budget, and compare that with the whole mesh.
    #[arg(long, value_name = "PIXELS", default_value_t = 1.0)]
    pixel_error: f32,
    /// Measure what is seen alone: nothing is drawn by the GPU.
    #[arg(long)]
    no_gpu: bool,
    /// Write every figure and what machine this is (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Draw the views, without occlusion and with, from the eye, from above and from the side, into this folder.
    #[arg(long, value_name = "FOLDER")]
    plots: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

#[derive(Clone, Copy, ValueEnum)]
enum Bounds {
    Sphere,
    Box,
    Cylinder,
    Link,
}

impl Bounds {
    fn kind(self) -> BoundsKind {
        match self {
            Self::Sphere => BoundsKind::Sphere,
            Self::Box => BoundsKind::Box,
            Self::Cylinder => BoundsKind::Cylinder,
            Self::Link => BoundsKind::Link,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Answers {
    Depths,
    Queries,
}

#[derive(Serialize)]
struct Report<'a> {
    machine: Machine,
    tables: &'a [Table],
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    ensure!(options.occluders.is_sorted_by(|a, b| a < b), "--occluders: they do not ascend");
    ensure!(options.occluders.len() <= 4, "--occluders: more than four");
    ensure!(options.pixel_error > 0.0 && options.pixel_error.is_finite(), "--pixel-error: not above 0");
    let has_queries = options.answers.contains(&Answers::Queries);
    let weighs = options.lod_weight != DetailWeight::None;
    ensure!(!(has_queries && weighs), "--lod-weight: objects weigh only where depths answer");
    ensure!(options.plots.is_none() || !options.no_gpu, "--plots: with --no-gpu nothing is drawn");
    super::claim_outputs(options.json.as_deref(), options.plots.as_deref())?;
    let is_piped = options.json.as_deref().is_some_and(is_standard_output);
    let machine = Machine::this();
    let gpu = if options.no_gpu { None } else { super::open_gpu(is_piped) };
    ensure!(gpu.is_some() || !has_queries, "--answers: queries are of the GPU");
    if !is_piped {
        say!("{machine}");
        gpu.as_ref().inspect(|gpu| say!("{}", gpu.describe()));
        say!("");
    }
    let views = match (&options.views[..], &options.scene) {
        ([], Some(_)) => vec![View::OTHER],
        ([], None) => VIEWS.to_vec(),
        (names, _) => views::named(names)?,
    };
    let mut tables = Vec::new();
    let mut subject: Option<(String, u32, Option<LodForm>, Subject)> = None;
    let forms = || if options.form.is_empty() { vec![None] } else { options.form.iter().copied().map(Some).collect() };
    for (view, form) in views.into_iter().flat_map(|view| forms().into_iter().map(move |form| (view, form))) {
        let view = view.from(options.eye, options.at);
        let scene = view.scene(options.scene.as_deref());
        // Views of one scene are next to each other: a planet is made once.
        if subject.as_ref().is_none_or(|(of, copies, is, _)| (of, *copies, *is) != (&scene, view.copies, form)) {
            drop(subject.take());
            subject = Some((scene.clone(), view.copies, form, view.open(&scene, &options.how.options()?, form)?));
        }
        let Some((.., subject)) = &mut subject else { continue };
        if options.lod_weight == DetailWeight::Plp && subject.tessellated().is_none() {
            if !is_piped {
                say!("{scene} has no tessellation as it stands here: one is made");
            }
            add_tessellation(&mut subject.package, &TessellateOptions::default())?;
        }
        let name = Path::new(&scene).file_name().map_or(scene.clone(), |name| name.to_string_lossy().into_owned());
        let name = form.map_or(name.clone(), |form| format!("{name} as {form}"));
        let table = Contest::new(options, &view, subject, gpu.as_ref())?.run(&name)?;
        if !is_piped {
            table.print();
        }
        if let Some(folder) = &options.plots {
            for file in figures::draw(&table, folder)? {
                if !is_piped {
                    say!("{}", file.display());
                }
            }
        }
        tables.push(table);
    }
    options.json.as_ref().map_or(Ok(()), |path| write_json(&Report { machine, tables: &tables }, path))
}
