//! `mullion cull`.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, anyhow, ensure};
use glam::{DAffine3, DVec3};
use mullion_common::scene::Package;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{Eye, Wall};
use mullion_server::cull::{Algorithm, CullStats, Culler};
use mullion_server::tree::CullTree;
use serde::Serialize;

use super::prepare::HowToPrepare;
use crate::camera::{PathSource, parse_point, place_room};
use crate::files::{is_standard_output, open_scene, open_wall, write_json};
use crate::say::say;

/// What to cull, from where, and how.
#[derive(clap::Args)]
pub struct Options {
    /// Package, glTF or GLB file.
    scene: PathBuf,
    /// Wall file.
    #[arg(long, value_name = "FILE")]
    wall: PathBuf,
    /// The observer's eye in the room, metres; the wall file's if left out.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    eye: Option<DVec3>,
    /// Where the room's origin stands in the scene, metres; at the scene's origin if left out.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    camera: Option<DVec3>,
    /// A point of the scene that the room's -Z axis faces.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    look_at: Option<DVec3>,
    /// The room where a camera path has it: a file, or a walk made for the scene: orbit, whole, interior, flythrough, pan.
    #[arg(long, value_name = "FILE|NAME", conflicts_with_all = ["camera", "look_at"])]
    path: Option<String>,
    /// Which frame of the path; past its end it begins anew.
    #[arg(long, requires = "path", default_value_t = 0)]
    frame: u64,
    /// sweep, adaptive, adaptive-grouped, oh, fh, oh-plain, naive, or all of them one beside the other.
    #[arg(long, default_value = "sweep")]
    algorithm: String,
    /// Cull so many times, algorithms in turn, and give the median time.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,
    /// Threads for the sweep.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=64))]
    threads: u8,
    /// Write each tile's corners, eye, leaf ranges and counts (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

/// One frame, culled.
#[derive(Serialize)]
struct CullReport {
    scene: String,
    wall: String,
    algorithm: &'static str,
    leaf_count: u32,
    median_us: f64,
    nodes_visited: u64,
    plane_tests: u64,
    views: Vec<ViewReport>,
}

/// What one view may see. Corners and eye in the world, metres.
#[derive(Serialize)]
struct ViewReport {
    tile: String,
    observer: u16,
    eye_kind: Eye,
    eye: DVec3,
    bottom_left: DVec3,
    bottom_right: DVec3,
    top_left: DVec3,
    near_m: f64,
    size_px: [u32; 2],
    leaves: u32,
    triangles: u64,
    /// Start, and one past the end, of each range.
    leaf_ranges: Vec<[u32; 2]>,
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let wall = open_wall(&options.wall)?;
    let algorithms = match options.algorithm.as_str() {
        "all" => Algorithm::ALL.to_vec(),
        name => vec![name.parse().map_err(|e| anyhow!("--algorithm: {e}, all"))?],
    };
    ensure!(options.json.is_none() || algorithms.len() == 1, "--json: choose one algorithm");
    let eyes = match options.eye {
        Some(eye) => {
            wall.check_eye(eye).map_err(|problem| anyhow!("--eye: {problem}"))?;
            vec![eye; wall.views().len()]
        }
        None => wall.default_eyes(),
    };
    let path = options.path.as_deref().map(PathSource::open).transpose().context("--path")?;
    let package = open_scene(&options.scene, &options.how.options()?)?;
    let world_from_room = match &path {
        Some(path) => path.path(&package, &wall, None)?.pose(options.frame),
        None => place_room(options.camera.unwrap_or_default(), options.look_at),
    };
    let runs = measure(&package, &wall, &eyes, &world_from_room, &algorithms, options.repeat, options.threads.into())?;
    let all = u64::from(package.scene.leaf_count()) * wall.views().len() as u64;
    let is_piped = options.json.as_deref().is_some_and(is_standard_output);
    for run in runs.iter().filter(|_| !is_piped) {
        let pairs: u64 = run.sets.iter().map(|s| u64::from(s.len())).sum();
        say!(
            "{:16} {:10.1} µs  {:9} nodes  {:10} plane tests  {pairs} of {all} (leaf, view) pairs may be visible",
            run.algorithm.name(),
            run.median_us,
            run.stats.nodes_visited,
            run.stats.plane_tests,
        );
    }
    if let (Some(path), [run]) = (&options.json, runs.as_slice()) {
        let report = report(options, &package, &wall, &eyes, &world_from_room, run);
        write_json(&report, path)?;
    }
    Ok(())
}

struct Run {
    algorithm: Algorithm,
    median_us: f64,
    stats: CullStats,
    sets: Vec<VisibleSet>,
}

/// Culls the same frame with every algorithm in turn, again and again, so that drift meets all alike.
fn measure(
    package: &Package,
    wall: &Wall,
    eyes: &[DVec3],
    world_from_room: &DAffine3,
    algorithms: &[Algorithm],
    repeat: u32,
    threads: usize,
) -> Result<Vec<Run>> {
    let mut runs: Vec<(Culler, Vec<f64>, Run)> = algorithms
        .iter()
        .map(|&algorithm| {
            let sets = vec![VisibleSet::default(); wall.views().len()];
            let run = Run { algorithm, median_us: 0.0, stats: CullStats::default(), sets };
            Ok((Culler::new(algorithm, wall).with_threads(threads)?, Vec::new(), run))
        })
        .collect::<Result<_>>()?;
    let tree = CullTree::new(Arc::clone(&package.scene.hierarchy));
    for _ in 0..repeat {
        for (culler, times_us, run) in &mut runs {
            let start = Instant::now();
            run.stats = culler.cull(&tree, wall, eyes, world_from_room, &mut run.sets);
            times_us.push(start.elapsed().as_secs_f64() * 1e6);
        }
    }
    let finish = |(_, mut times_us, run): (Culler, Vec<f64>, Run)| {
        times_us.sort_by(f64::total_cmp);
        Run { median_us: times_us[times_us.len() / 2], ..run }
    };
    Ok(runs.into_iter().map(finish).collect())
}

fn report(
    options: &Options,
    package: &Package,
    wall: &Wall,
    eyes: &[DVec3],
    world_from_room: &DAffine3,
    run: &Run,
) -> CullReport {
    let leaves = &package.scene.manifest.leaves;
    let views = wall.views().iter().zip(eyes).zip(&run.sets).map(|((view, eye), set)| {
        let tile = wall.tile(view.tile);
        let [bottom_left, bottom_right, top_left] = tile.corners.map(|c| world_from_room.transform_point3(c));
        ViewReport {
            tile: tile.name.clone(),
            observer: view.observer.0,
            eye_kind: view.eye,
            eye: world_from_room.transform_point3(*eye),
            bottom_left,
            bottom_right,
            top_left,
            near_m: wall.near_m(),
            size_px: tile.size_px,
            leaves: set.len(),
            triangles: set.leaves().map(|l| u64::from(leaves[l as usize].triangle_count)).sum(),
            leaf_ranges: set.ranges().iter().map(|r| [r.start, r.end]).collect(),
        }
    });
    CullReport {
        scene: options.scene.display().to_string(),
        wall: wall.name().to_owned(),
        algorithm: run.algorithm.name(),
        leaf_count: package.scene.leaf_count(),
        median_us: run.median_us,
        nodes_visited: run.stats.nodes_visited,
        plane_tests: run.stats.plane_tests,
        views: views.collect(),
    }
}
