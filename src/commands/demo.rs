//! `mullion demo`: a master and all tiles of a wall on this machine, over real sockets.

use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow};
use image::RgbaImage;
use mullion_client::gpu::{Gpu, GpuOptions, TileRect};
use mullion_client::gpu_painter::{GpuPainter, Output};
use mullion_client::missing::WhenMissing;
use mullion_client::node::{self, Connector, DEFAULT_MEMORY_BYTES, NodeError, NodeOptions, NodeReport, Reconnect, Security};
use mullion_client::occlusion::Occlusion;
use mullion_client::output::headless::write_png;
use mullion_client::output::window::{Cover, Display, WindowOptions};
use mullion_common::camera_path::CameraPath;
use mullion_common::scene::Package;
use mullion_common::wall::{Wall, WallConfig};
use mullion_common::wire::Part;
use mullion_server::cull::Algorithm;
use mullion_server::prepare::plp::TessellateOptions;
use mullion_server::service::{self, Rate, Show, ShowOptions, ShowReport};
use tokio::sync::watch;

use super::prepare::{HowToPrepare, add_tessellation, simplify};
use super::quality::QualityOptions;
use crate::birdseye::{self, Flight};
use crate::camera::PathSource;
use crate::composite::WallLayout;
use crate::files::{open_scene, open_wall, scene_file, write_json};
use crate::pixels::Grid;
use crate::progress::Progress;
use crate::say::say;
use crate::show::{self, Record};

/// Which wall, which scene, and where pictures go.
#[derive(clap::Args)]
pub struct Options {
    #[command(flatten)]
    wall: WallChoice,
    /// A glTF, GLB or package file, or the name of a generated scene: city, plp-city, cars, plant, palace, cathedrals, forest, garbage, boxes or
    /// boxes:LEAVES.
    #[arg(long, value_name = "FILE|NAME", default_value = "city")]
    scene: String,
    /// Camera path: a file, or a walk made for the scene: orbit, whole, interior, flythrough, pan.
    #[arg(long, value_name = "FILE|NAME", default_value = "orbit")]
    path: String,
    /// Length of the show, and of a walk made for the scene.
    #[arg(long, default_value_t = 48, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    frames: u64,
    /// Folder for wall.png, tiles/*.png and report.json.
    #[arg(long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,
    /// Show the wall in a window, too.
    #[arg(long)]
    window: bool,
    /// How to leave out what others hide: none, paper, sampled, cost-adaptive, query or hiz. The pictures are the same, but of sampled while
    /// something moves. hiz is left off by itself where it does not pay.
    #[arg(long, value_name = "MODE", default_value_t = Occlusion::Hiz)]
    occlusion: Occlusion,
    /// Leave out, on all tiles alike, objects that hardly contribute: whose boxes' visible pixels, on all tiles together and weighted by
    /// distance, are less than this share of the wall's (0.0001: a pixel in ten thousand). Pictures change a little.
    #[arg(long, allow_negative_numbers = true, value_name = "THRESHOLD", value_parser = show::share_of_wall)]
    adaptive: Option<f64>,
    #[command(flatten)]
    quality: QualityOptions,
    /// Draw the scene from above into this file (PNG): the wall's frusta at the last frame shown in red, and in yellow the bounds of leaves
    /// in them that no tile drew. With --occlusion none all are drawn, and nothing is yellow.
    #[arg(long, value_name = "FILE")]
    birdseye: Option<PathBuf>,
    /// sweep, adaptive, adaptive-grouped, oh, fh, oh-plain or naive.
    #[arg(long, default_value = "sweep")]
    algorithm: Algorithm,
    #[command(flatten)]
    how: HowToPrepare,
}

/// A wall, by its size or from a file.
#[derive(clap::Args)]
pub struct WallChoice {
    /// Columns and rows of the wall.
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "4x4", value_parser = Grid::parse, conflicts_with = "wall")]
    grid: Grid,
    /// A wall file instead of a grid.
    #[arg(long, value_name = "FILE")]
    wall: Option<PathBuf>,
}

impl WallChoice {
    /// The wall.
    ///
    /// # Errors
    /// When the file is no wall.
    pub fn open(&self) -> Result<Wall> {
        self.wall.as_deref().map_or_else(|| grid_wall(self.grid, BEZEL_PX, GRID_HZ), open_wall)
    }
}

/// Software rendering may take long: a demo shows every frame on every tile.
const BARRIER_WAIT: Duration = Duration::from_secs(20);
const START_WAIT: Duration = Duration::from_secs(60);
const TILE_PX: [u32; 2] = [320, 180];
const TILE_M: [f64; 2] = [1.024, 0.576];
const BEZEL_PX: u32 = 4;
/// Frames a second of walls made from a grid.
pub const GRID_HZ: f64 = 60.0;

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let wall = Arc::new(options.wall.open()?);
    let quality = options.quality.chosen(wall.rate_hz())?;
    let layout = WallLayout::new(&wall)?;
    let path = PathSource::open(&options.path).context("--path")?;
    fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    options.birdseye.as_deref().map_or(Ok(()), birdseye::claim)?;
    let scene = scene_file(&options.scene, &options.out)?;
    let mut package = open_scene(&scene, &options.how.options()?)?;
    if let Some(form) = quality.form().filter(|_| package.scene.hierarchies.is_empty()) {
        simplify(&mut package, form)?;
    }
    quality.check_hierarchies(&package, &options.scene)?;
    if quality.needs_tessellation() && package.scene.tessellation.is_none() {
        add_tessellation(&mut package, &TessellateOptions::default())?;
    }
    let package = Arc::new(package);
    let path = path.path(&package, &wall, Some(options.frames))?;
    let display = options.window.then(Display::open).transpose()?;
    let gpu = Gpu::open(GpuOptions { display: display.as_ref().map(Display::handle), ..GpuOptions::default() })?;
    say!("{} tiles on {}", wall.tiles().len(), gpu.describe());

    let record = Record::new(&wall, &package);
    let (stop, stopped) = watch::channel(false);
    let listener = TcpListener::bind(("127.0.0.1", 0)).context("cannot listen on the loopback")?;
    let address = listener.local_addr()?.to_string();
    let started = Instant::now();
    let master = start_master(listener, (options, &quality), path.clone(), &wall, &package, &record, stopped.clone());
    let feed = display.as_ref().map(Display::feed);
    let nodes: Vec<NodeThread> = wall
        .nodes()
        .iter()
        .map(|node| {
            let output = feed.clone().map_or(Output::Keep, Output::Window);
            let painter = GpuPainter::new(Arc::clone(&gpu), output).culling(options.occlusion);
            start_node(node.name.clone(), address.clone(), painter, stop.clone(), stopped.clone())
        })
        .collect();
    let finish = move || -> Result<(ShowReport, Vec<NodeOutcome>)> {
        let show = master.join().map_err(|_| anyhow!("the master's thread ended unexpectedly"))??;
        let outcomes = nodes.into_iter().map(|n| n.join().map_err(|_| anyhow!("a node's thread ended unexpectedly")));
        Ok((show, outcomes.collect::<Result<_>>()?))
    };
    let (show_report, outcomes) = match display {
        None => finish()?,
        Some(display) => {
            let feed = display.feed();
            let finisher = std::thread::spawn(move || {
                let result = finish();
                feed.close();
                result
            });
            let window = display.run(Arc::clone(&gpu), window_options(&wall, &layout));
            stop.send_replace(true);
            window?;
            finisher.join().map_err(|_| anyhow!("the show's thread ended unexpectedly"))??
        }
    };
    let summary = record.summary(&options.scene, &wall, &show_report);
    let mut pictures = Vec::new();
    for (painter, result) in outcomes {
        result?;
        pictures.extend(painter.pictures()?);
    }
    write_pictures(&options.out, &wall, &layout, pictures)?;
    write_json(&summary, &options.out.join("report.json"))?;
    summary.print();
    say!("took           {:.1} s", started.elapsed().as_secs_f64());
    say!("wrote          {}", options.out.join("wall.png").display());
    if let Some(file) = &options.birdseye {
        let last = show_report.frames.saturating_sub(1);
        let flight = Flight { package: &package, wall: &wall, path: &path, last, occlusion: options.occlusion };
        say!("from above     {}: {}", file.display(), flight.write(&gpu, file)?);
    }
    Ok(())
}

/// A wall of so many equal panels with bezels of so many pixels' width.
pub fn grid_wall(grid: Grid, bezel_px: u32, rate_hz: f64) -> Result<Wall> {
    let bezel_m = [0, 1].map(|axis| TILE_M[axis] / f64::from(TILE_PX[axis]) * f64::from(bezel_px));
    let text = format!(
        "name = \"demo-{columns}x{rows}\"\nrate_hz = {rate_hz:?}\n[grid]\ncolumns = {columns}\nrows = {rows}\ntile_px = {TILE_PX:?}\ntile_m = {TILE_M:?}\nbezel_m = {bezel_m:?}\n",
        columns = grid.columns,
        rows = grid.rows,
    );
    WallConfig::parse(&text).map_err(|e| anyhow!("{e}"))
}

fn start_master(
    listener: TcpListener,
    (options, quality): (&Options, &QualityOptions),
    path: CameraPath,
    wall: &Arc<Wall>,
    package: &Arc<Package>,
    record: &Record,
    stopped: watch::Receiver<bool>,
) -> JoinHandle<Result<ShowReport, service::ServiceError>> {
    let frames = options.frames;
    let (progress, noted) = (Progress::new(), record.clone());
    let mut show_options = ShowOptions {
        barrier_wait: BARRIER_WAIT,
        frames: Some(frames),
        adaptive: options.adaptive,
        rate: Rate::AsFastAsPossible,
        ..ShowOptions::for_wall(wall).starting_together(wall, START_WAIT)
    };
    quality.apply_to(&mut show_options);
    let show = Show {
        wall: Arc::clone(wall),
        package: Arc::clone(package),
        options: show_options,
        camera: show::camera(path, wall),
        cull: record.culler(show::culler(options.algorithm, wall, package)),
        observer: Box::new(move |frame| {
            progress.show("frames", frame.number + 1, frames);
            noted.note(frame);
            if frame.number + 1 == frames {
                progress.finish();
            }
        }),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(|_, _| {}),
        stop: Some(stopped),
    };
    std::thread::spawn(move || service::run(listener, show))
}

type NodeOutcome = (GpuPainter, Result<NodeReport, NodeError>);
type NodeThread = JoinHandle<NodeOutcome>;

/// A node that fails ends the whole demo.
fn start_node(
    name: String,
    master: String,
    mut painter: GpuPainter,
    stop: watch::Sender<bool>,
    stopped: watch::Receiver<bool>,
) -> NodeThread {
    let reconnect = Reconnect { give_up_after: Some(START_WAIT), ..Reconnect::default() };
    let options = NodeOptions {
        masters: vec![master],
        connector: Connector::default(),
        node: name,
        part: Part::Own,
        credentials: None,
        security: Security::Plain,
        memory_bytes: DEFAULT_MEMORY_BYTES,
        // Every picture is to be exact.
        when_missing: WhenMissing::Hold,
        cache: None,
        reconnect,
        stop: Some(stopped),
    };
    std::thread::spawn(move || {
        let result = node::run(options, &mut painter);
        if result.is_err() {
            stop.send_replace(true);
        }
        (painter, result)
    })
}

fn window_options(wall: &Wall, layout: &WallLayout) -> WindowOptions {
    let tiles = wall.views().iter().zip(0..).map(|(view, id)| {
        let rect = layout.tiles[usize::from(view.tile.0)];
        let [x, y, w, h] = [rect.x, rect.y, rect.width, rect.height].map(|v| v as f32);
        TileRect { view: mullion_common::wall::ViewId(id), x, y, w, h }
    });
    WindowOptions {
        title: format!("Mullion: {}", wall.name()),
        size_px: layout.size_px,
        cover: Cover::Window,
        tiles: tiles.collect(),
    }
}

fn write_pictures(out: &Path, wall: &Wall, layout: &WallLayout, pictures: Vec<(String, RgbaImage)>) -> Result<()> {
    let mut by_tile: Vec<Option<RgbaImage>> = vec![None; wall.tiles().len()];
    for (name, picture) in pictures {
        write_png(&out.join("tiles").join(format!("{name}.png")), &picture)?;
        if let Some(tile) = wall.tile_named(&name) {
            by_tile[usize::from(tile.0)] = Some(picture);
        }
    }
    write_png(&out.join("wall.png"), &layout.compose(&by_tile))?;
    Ok(())
}
