//! `mullion bench occlusion`.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, anyhow};
use mullion_client::frame::{FrameInput, FramePlan, PassResult, Planner, ViewInput};
use mullion_client::gpu::{Attachments, Gpu, GpuOptions, Renderer, ViewTarget};
use mullion_client::missing::WhenMissing;
use mullion_client::occlusion::Occlusion;
use mullion_common::camera_path::CameraPath;
use mullion_common::scene::{ChunkId, Package};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{Projection, ViewId, Wall, WallConfig};
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::tree::CullTree;
use serde::Serialize;

use super::machine::Machine;
use crate::camera::PathSource;
use crate::commands::prepare::HowToPrepare;
use crate::files::{claim, is_standard_output, open_named_scene, write_json};
use crate::say::say;
use crate::show::Spread;

/// What to draw, and how.
#[derive(clap::Args)]
pub struct Options {
    /// glTF, GLB or package files, or names of generated scenes; the city if none is named.
    #[arg(long = "scene", value_name = "NAME|FILE", default_value = "city")]
    scenes: Vec<String>,
    /// Camera path: a file, or a walk made for the scene: orbit, whole, interior, flythrough, pan.
    #[arg(long, value_name = "NAME|FILE", default_value = "interior")]
    path: String,
    /// Frames to measure.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    frames: u64,
    /// Width and height of the picture, pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "650x650", value_parser = parse_size)]
    size: [u32; 2],
    /// Write every figure and what machine this is (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

/// Height of the screen that the picture is on, metres.
const SCREEN_M: f64 = 2.0;
const VIEW: ViewId = ViewId(0);

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some([w.parse::<u32>().ok()?, h.parse::<u32>().ok()?]));
    parsed
        .filter(|size| size.iter().all(|edge| (1..=8192).contains(edge)))
        .ok_or_else(|| format!("{text:?} is no size: width x height, each 1 to 8192 pixels, as in 650x650"))
}

#[derive(Serialize)]
struct Report {
    machine: Machine,
    gpu: String,
    size_px: [u32; 2],
    tables: Vec<Table>,
}

/// One scene. Shares are of its triangles, means of all frames.
#[derive(Serialize)]
struct Table {
    scene: String,
    path: String,
    frames: u64,
    triangles: u64,
    leaves: u32,
    frustum_culled_percent: f64,
    culled_percent: f64,
    frustum_ms: Spread,
    culled_ms: Spread,
    /// All frames with frustum culling alone, over all frames with occlusion culling.
    speed_up: f64,
    /// The same of triangles: those in the frustum over those of leaves of which a pixel is seen.
    bound: f64,
    /// Of the leaves whose whole box is hidden in the final picture, those that were left out.
    hidden_culled_percent: f64,
    /// Of the leaves that were drawn, those of which no pixel is seen.
    false_visible_percent: f64,
    wrong_pixels: u64,
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let source = PathSource::open(&options.path).context("--path")?;
    let how = options.how.options()?;
    options.json.as_deref().map_or(Ok(()), claim)?;
    let is_piped = options.json.as_deref().is_some_and(is_standard_output);
    let (machine, gpu) = (Machine::this(), Gpu::open(GpuOptions::default())?);
    if !is_piped {
        say!("{machine}\n{}\n", gpu.describe());
    }
    let wall = wall(options.size)?;
    let mut tables = Vec::new();
    for scene in &options.scenes {
        let package = open_named_scene(scene, &how)?;
        let path = source.path(&package, &wall, Some(options.frames))?;
        let name = PathBuf::from(scene).file_stem().map_or_else(|| scene.clone(), |stem| stem.to_string_lossy().into_owned());
        let table = Bench::new(&gpu, &package, &wall)?.measure((name, source.to_string()), &path, options.frames)?;
        if !is_piped {
            table.print();
        }
        tables.push(table);
    }
    let report = Report { machine, gpu: gpu.describe(), size_px: options.size, tables };
    options.json.as_ref().map_or(Ok(()), |path| write_json(&report, path))
}

/// A wall of one tile.
fn wall([width, height]: [u32; 2]) -> Result<Wall> {
    let width_m = SCREEN_M * f64::from(width) / f64::from(height);
    let text = format!("[grid]\ncolumns = 1\nrows = 1\ntile_px = [{width}, {height}]\ntile_m = [{width_m:?}, {SCREEN_M:?}]\n");
    WallConfig::parse(&text).map_err(|e| anyhow!("--size: {e}"))
}

/// A scene twice on the GPU: without occlusion culling as it is drawn fastest, and with it.
struct Bench<'a> {
    package: &'a Package,
    wall: &'a Wall,
    plain: (Renderer, Planner),
    culled: (Renderer, Planner),
}

/// What is summed over the frames.
#[derive(Default)]
struct Sums {
    frustum_ms: Vec<f64>,
    culled_ms: Vec<f64>,
    in_frustum: u64,
    drawn: u64,
    seen: u64,
    hidden: u64,
    hidden_culled: u64,
    drawn_leaves: u64,
    false_visible: u64,
    wrong_pixels: u64,
}

impl<'a> Bench<'a> {
    fn new(gpu: &Arc<Gpu>, package: &'a Package, wall: &'a Wall) -> Result<Self> {
        let renderer = |attachments| -> Result<Renderer> {
            let manifest = Arc::new(package.scene.manifest.clone());
            let targets = [ViewTarget { view: VIEW, size_px: wall.tiles()[0].size_px }];
            let mut renderer = Renderer::new(Arc::clone(gpu), manifest, &targets, attachments)?;
            for chunk in (0..package.scene.manifest.chunks.len() as u32).map(ChunkId) {
                renderer.upload(chunk, package.chunk(chunk)).with_context(|| format!("chunk {}", chunk.0))?;
            }
            Ok(renderer)
        };
        let plain = (renderer(Attachments::Color)?, Planner::new());
        let culled = (renderer(Attachments::ColorAndIds)?, Planner::new().culling(Occlusion::TwoPass));
        Ok(Self { package, wall, plain, culled })
    }

    fn measure(&mut self, (scene, named_path): (String, String), path: &CameraPath, frames: u64) -> Result<Table> {
        let mut culler = Culler::new(Algorithm::Sweep, self.wall);
        let tree = CullTree::new(Arc::clone(&self.package.scene.hierarchy));
        let (eyes, mut sets) = (self.wall.default_eyes(), vec![VisibleSet::default(); 1]);
        let mut sums = Sums::default();
        // The first frame twice before it counts: buffers grow, and what is seen becomes known.
        let warm_up = std::iter::repeat_n((0, false), 2);
        for (frame, counts) in warm_up.chain((0..frames).map(|frame| (frame, true))) {
            let world_from_room = path.pose(frame);
            sets[0].clear();
            culler.cull(&tree, self.wall, &eyes, &world_from_room, &mut sets);
            let projection = self.wall.projection(VIEW, eyes[0], &world_from_room);
            let drawn = self.draw(&projection, &sets[0], frame)?;
            if counts {
                self.add(&projection, &sets[0], &drawn, &mut sums)?;
            }
        }
        let manifest = &self.package.scene.manifest;
        let triangles: u64 = manifest.leaves.iter().map(|leaf| u64::from(leaf.triangle_count)).sum();
        let all = triangles * sums.frustum_ms.len() as u64;
        let percent = |part: u64, whole: u64| if whole == 0 { 0.0 } else { 100.0 * part as f64 / whole as f64 };
        Ok(Table {
            scene,
            path: named_path,
            frames,
            triangles,
            leaves: manifest.leaves.len() as u32,
            frustum_culled_percent: 100.0 - percent(sums.in_frustum, all),
            culled_percent: 100.0 - percent(sums.drawn, all),
            speed_up: sums.frustum_ms.iter().sum::<f64>() / sums.culled_ms.iter().sum::<f64>(),
            bound: sums.in_frustum as f64 / sums.seen.max(1) as f64,
            frustum_ms: Spread::of(sums.frustum_ms.iter().copied()),
            culled_ms: Spread::of(sums.culled_ms.iter().copied()),
            hidden_culled_percent: percent(sums.hidden_culled, sums.hidden),
            false_visible_percent: percent(sums.false_visible, sums.drawn_leaves),
            wrong_pixels: sums.wrong_pixels,
        })
    }
}

/// One frame, both ways.
struct Drawn {
    frustum_ms: f64,
    culled_ms: f64,
    in_frustum: PassResult,
    culled: PassResult,
    /// What was drawn with occlusion culling.
    leaves: VisibleSet,
}

impl Bench<'_> {
    /// Draws a frame both ways, each of them first every other time.
    fn draw(&mut self, projection: &Projection, visible: &VisibleSet, frame: u64) -> Result<Drawn> {
        let manifest = &self.package.scene.manifest;
        let timed = |(renderer, planner): &mut (Renderer, Planner)| -> Result<(f64, PassResult, FramePlan)> {
            let missing = VisibleSet::default();
            let views = [ViewInput { view: VIEW, projection: *projection, visible, missing: &missing }];
            let started = Instant::now();
            let plan = planner.begin(FrameInput {
                views: &views,
                shared_eye: projection.eye,
                manifest,
                transforms: renderer.transforms(),
                resident: &|_| true,
                when_missing: WhenMissing::Hold,
            });
            let results = renderer.draw(plan)?;
            renderer.wait()?;
            let took_ms = started.elapsed().as_secs_f64() * 1e3;
            let plan = plan.clone();
            planner.feed(&results);
            Ok((took_ms, results.passes[0].clone(), plan))
        };
        let (plain, culled);
        if frame.is_multiple_of(2) {
            plain = timed(&mut self.plain)?;
            culled = timed(&mut self.culled)?;
        } else {
            culled = timed(&mut self.culled)?;
            plain = timed(&mut self.plain)?;
        }
        let mut leaves = VisibleSet::default();
        let (first, seen) = (culled.2.passes[0].first.as_ref(), culled.1.seen.as_ref());
        let (first, seen) =
            first.zip(seen).context("this GPU cannot test boxes: it lacks indirect draws or storage in fragments")?;
        first.union_into(seen, &mut leaves);
        Ok(Drawn { frustum_ms: plain.0, culled_ms: culled.0, in_frustum: plain.1, culled: culled.1, leaves })
    }

    /// Looks at what was drawn.
    fn add(&mut self, projection: &Projection, visible: &VisibleSet, drawn: &Drawn, sums: &mut Sums) -> Result<()> {
        let leaves = &self.package.scene.manifest.leaves;
        let (plain, culled) = (self.plain.0.read_color(VIEW)?, self.culled.0.read_color(VIEW)?);
        let wrong = plain.pixels().zip(culled.pixels()).filter(|(plain, culled)| plain != culled).count();
        let mut with_pixels = self.culled.0.read_leaves(VIEW)?;
        with_pixels.sort_unstable();
        with_pixels.dedup();
        let with_pixels: Vec<u32> = with_pixels.into_iter().filter_map(|id| id.checked_sub(1)).collect();
        // Against all that is in view.
        let (mut behind, mut kept) = (VisibleSet::default(), VisibleSet::default());
        visible.difference_into(&self.seen_beyond_all(projection, visible)?, &mut behind);
        behind.difference_into(&drawn.leaves, &mut kept);
        sums.frustum_ms.push(drawn.frustum_ms);
        sums.culled_ms.push(drawn.culled_ms);
        sums.in_frustum += drawn.in_frustum.triangles;
        sums.drawn += drawn.culled.triangles;
        sums.seen += with_pixels.iter().map(|leaf| u64::from(leaves[*leaf as usize].triangle_count)).sum::<u64>();
        sums.hidden += u64::from(behind.len());
        sums.hidden_culled += u64::from(kept.len());
        sums.drawn_leaves += u64::from(drawn.culled.leaves);
        sums.false_visible += u64::from(drawn.culled.leaves) - with_pixels.len() as u64;
        sums.wrong_pixels += wrong as u64;
        Ok(())
    }

    /// Leaves whose boxes are seen beyond the whole picture.
    fn seen_beyond_all(&mut self, projection: &Projection, visible: &VisibleSet) -> Result<VisibleSet> {
        let renderer = &mut self.culled.0;
        let missing = VisibleSet::default();
        let views = [ViewInput { view: VIEW, projection: *projection, visible, missing: &missing }];
        let mut planner = Planner::new().culling(Occlusion::TwoPass);
        let plan = planner.begin(FrameInput {
            views: &views,
            shared_eye: projection.eye,
            manifest: &self.package.scene.manifest,
            transforms: renderer.transforms(),
            resident: &|_| true,
            when_missing: WhenMissing::Hold,
        });
        let results = renderer.draw(plan)?;
        results.passes[0].seen.clone().context("it was drawn with occlusion culling")
    }
}

impl Table {
    fn print(&self) {
        let Self { scene, path, frames, triangles, leaves, .. } = self;
        say!("{scene}: {triangles} triangles in {leaves} leaves, {path}, {frames} frames");
        say!("{:18} {:>9} {:>12} {:>12}", "", "culled", "median ms", "p99 ms");
        let row = |name: &str, culled: f64, took: &Spread| {
            say!("{name:18} {culled:8.2}% {:12.2} {:12.2}", took.median, took.p99);
        };
        row("frustum", self.frustum_culled_percent, &self.frustum_ms);
        row("two-pass", self.culled_percent, &self.culled_ms);
        say!("speed-up           {:9.2} of {:.2} that triangles allow", self.speed_up, self.bound);
        say!("hidden boxes culled{:8.2}%", self.hidden_culled_percent);
        say!("false visibles     {:8.2}% of the leaves drawn", self.false_visible_percent);
        say!("wrong pixels       {:9}\n", self.wrong_pixels);
    }
}
