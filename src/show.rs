//! What `demo` and `serve` share: the parts of a show, and what is written down of it.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use anyhow::{Context, Result};
use mullion_common::camera_path::CameraPath;
use mullion_common::scene::Package;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::Wall;
use mullion_server::control::LiveScene;
use mullion_server::cull::Algorithm;
use mullion_server::master::Spent;
use mullion_server::service::{Camera, Cull, FrameReport, Pose, ShowReport};
use serde::Serialize;
use tokio::sync::watch;

use crate::say::say;

/// Frames whose times are kept for medians: the last ones.
const FRAMES_KEPT: usize = 10_000;

/// A camera on its path, with the wall's own eyes.
pub fn camera(path: CameraPath, wall: &Wall) -> Camera {
    let eyes = wall.default_eyes();
    let rate_hz = wall.rate_hz();
    Box::new(move |frame| Pose {
        scene_time_s: frame as f64 / rate_hz,
        world_from_room: path.pose(frame),
        eyes: eyes.clone(),
        ..Pose::default()
    })
}

/// Culls a scene whose objects stand where poses say.
pub fn culler(algorithm: Algorithm, wall: &Arc<Wall>, package: &Arc<Package>) -> Cull {
    let mut scene = LiveScene::new(algorithm, wall, package);
    Box::new(move |pose, sets| scene.cull(pose, sets))
}

/// Turns true when the user presses Ctrl-C, or when the caller makes it; pressed again, the process ends at once.
pub fn stop_on_interrupt() -> Result<watch::Sender<bool>> {
    const INTERRUPTED: i32 = 130;
    let stop = watch::Sender::new(false);
    let interrupted = stop.clone();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context("cannot wait for signals")?;
    std::thread::spawn(move || {
        runtime.block_on(async move {
            if tokio::signal::ctrl_c().await.is_ok() {
                interrupted.send_replace(true);
                let _ = tokio::signal::ctrl_c().await;
                std::process::exit(INTERRUPTED);
            }
            std::future::pending::<()>().await;
        });
    });
    Ok(stop)
}

/// What `--adaptive` takes: more than 0, at most 1.
pub fn share_of_wall(text: &str) -> Result<f64, String> {
    let share: f64 = text.parse().map_err(|_| "it is no number".to_owned())?;
    if share > 0.0 && share <= 1.0 { Ok(share) } else { Err("a share of the wall is more than 0, and at most 1".to_owned()) }
}

/// What is written down while a show runs.
#[derive(Clone)]
pub struct Record(Arc<Mutex<Data>>);

struct Data {
    /// The scene that is shown, and one that it is to become.
    package: Arc<Package>,
    offered: Option<Arc<Package>>,
    /// Leaves of the scene, summed over the frames.
    leaves: u64,
    last_frame: Option<Instant>,
    cull_us: VecDeque<f64>,
    frame_ms: VecDeque<f64>,
    /// By `NodeIndex`.
    frame_bytes: Vec<u64>,
    /// The last frame's.
    dropped_objects: u32,
    /// Of frames that were drawn to a budget.
    budget: Option<BudgetSummary>,
    /// The last frame's, by `ViewId`.
    sets: Vec<VisibleSet>,
    /// Leaves seen by each view, summed over the frames.
    leaves_seen: Vec<u64>,
}

impl Record {
    /// An empty record.
    pub fn new(wall: &Wall, package: &Arc<Package>) -> Self {
        Self(Arc::new(Mutex::new(Data {
            package: Arc::clone(package),
            offered: None,
            leaves: 0,
            last_frame: None,
            cull_us: VecDeque::new(),
            frame_ms: VecDeque::new(),
            frame_bytes: vec![0; wall.nodes().len()],
            dropped_objects: 0,
            budget: None,
            sets: vec![VisibleSet::default(); wall.views().len()],
            leaves_seen: vec![0; wall.views().len()],
        })))
    }

    /// Culls, and writes down what each view sees.
    pub fn culler(&self, mut cull: Cull) -> Cull {
        let record = self.clone();
        Box::new(move |pose, sets| {
            let start = Instant::now();
            cull(pose, sets);
            let cull_us = start.elapsed().as_secs_f64() * 1e6;
            let mut data = record.0.lock().unwrap_or_else(PoisonError::into_inner);
            keep(&mut data.cull_us, cull_us);
            if let Some(fresh) = &pose.begins_with {
                (data.package, data.offered) = (Arc::clone(fresh.package()), None);
            }
            if let Some(grown) = data.offered.take_if(|_| pose.grows) {
                data.package = grown;
            }
            if let Some(offer) = &pose.offer {
                data.offered = Some(Arc::clone(offer.package()));
            }
            data.leaves += u64::from(data.package.scene.leaf_count());
            let Data { sets: last, leaves_seen, .. } = &mut *data;
            for ((set, last), seen) in sets.iter().zip(last).zip(leaves_seen) {
                last.clone_from(set);
                *seen += u64::from(set.len());
            }
        })
    }

    /// Writes down a frame.
    pub fn note(&self, frame: &FrameReport) {
        let mut data = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        let frame_ms = data.last_frame.replace(now).map(|last| (now - last).as_secs_f64() * 1e3);
        frame_ms.into_iter().for_each(|ms| keep(&mut data.frame_ms, ms));
        for (sum, bytes) in data.frame_bytes.iter_mut().zip(&frame.frame_bytes) {
            *sum += u64::from(*bytes);
        }
        data.dropped_objects = frame.dropped_objects;
        if let Some(spent) = &frame.spent {
            data.budget.get_or_insert_default().add(spent);
        }
    }

    /// All of it.
    pub fn summary(&self, scene: &str, wall: &Wall, report: &ShowReport) -> Summary {
        let data = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let package = &data.package;
        let leaves = &package.scene.manifest.leaves;
        let triangles = |leaf: u32| u64::from(leaves[leaf as usize].triangle_count);
        let tiles = wall.tiles().iter().enumerate().map(|(index, tile)| {
            let views = wall.views().iter().enumerate().filter(|(_, v)| usize::from(v.tile.0) == index).map(|(i, _)| i);
            let node = wall.nodes().iter().position(|n| n.tiles.iter().any(|t| usize::from(t.0) == index));
            let all = data.leaves * views.clone().count() as u64;
            let seen: u64 = views.clone().map(|v| data.leaves_seen[v]).sum();
            TileSummary {
                tile: tile.name.clone(),
                node: node.map_or_else(String::new, |n| wall.nodes()[n].name.clone()),
                visible_leaves: views.clone().map(|v| data.sets[v].len()).sum(),
                visible_triangles: views.flat_map(|v| data.sets[v].leaves()).map(triangles).sum(),
                culled_percent: if all == 0 { 0.0 } else { 100.0 - 100.0 * seen as f64 / all as f64 },
                frame_bytes: node.map_or(0, |n| data.frame_bytes[n]),
                passed_over: node.and_then(|n| report.passed_over.get(n).copied()).unwrap_or(0),
            }
        });
        Summary {
            scene: scene.to_owned(),
            wall: wall.name().to_owned(),
            objects: package.scene.objects.len() as u64,
            leaves: leaves.len() as u64,
            triangles: (0..leaves.len() as u32).map(triangles).sum(),
            frames: report.frames,
            cull_us: Spread::of(data.cull_us.iter().copied()),
            frame_ms: Spread::of(data.frame_ms.iter().copied()),
            frame_bytes: data.frame_bytes.iter().sum(),
            dropped_objects: data.dropped_objects,
            budget: data.budget,
            chunk_bytes: report.chunk_bytes,
            connections_refused: report.refused,
            tiles: tiles.collect(),
        }
    }
}

fn keep(values: &mut VecDeque<f64>, value: f64) {
    if values.len() == FRAMES_KEPT {
        values.pop_front();
    }
    values.push_back(value);
}

/// Median, 99th and 99.9th percentile, and greatest of some values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    pub median: f64,
    pub p99: f64,
    pub p999: f64,
    pub max: f64,
}

impl Spread {
    /// Of some values; zeros for none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted.get(((sorted.len().max(1) - 1) as f64 * share).ceil() as usize).copied().unwrap_or(0.0);
        Self { median: at(0.5), p99: at(0.99), p999: at(0.999), max: at(1.0) }
    }
}

/// What happened in a show.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    pub scene: String,
    pub wall: String,
    pub objects: u64,
    pub leaves: u64,
    /// With instances.
    pub triangles: u64,
    pub frames: u64,
    /// All tiles together, microseconds a frame.
    pub cull_us: Spread,
    /// From one frame's release to the next.
    pub frame_ms: Spread,
    /// Of all frame messages.
    pub frame_bytes: u64,
    /// In the last frame: those that tiles see and do not draw, for they hardly contribute.
    pub dropped_objects: u32,
    /// Where the wall drew to a budget.
    pub budget: Option<BudgetSummary>,
    /// Of geometry, textures and tables.
    pub chunk_bytes: u64,
    /// Connections closed for what they said or did not say.
    pub connections_refused: u64,
    pub tiles: Vec<TileSummary>,
}

/// How frames kept to a budget.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct BudgetSummary {
    /// Of the wall's estimate in the last frame.
    pub triangles: u32,
    /// Frames drawn to it; in all others the camera rested, and all was drawn.
    pub frames: u64,
    /// Those of them whose slowest node took longer than it was to.
    pub frames_over: u64,
    /// The same, percent of them.
    pub over_percent: f64,
}

impl BudgetSummary {
    fn add(&mut self, spent: &Spent) {
        self.triangles = spent.triangles;
        self.frames += u64::from(!spent.is_complete);
        self.frames_over += u64::from(spent.is_over);
        self.over_percent = 100.0 * self.frames_over as f64 / self.frames.max(1) as f64;
    }
}

/// What one tile saw.
#[derive(Clone, Debug, Serialize)]
pub struct TileSummary {
    pub tile: String,
    pub node: String,
    /// In the last frame.
    pub visible_leaves: u32,
    /// In the last frame.
    pub visible_triangles: u64,
    /// Share of leaves left out, mean over the frames.
    pub culled_percent: f64,
    /// Of all frame messages to the tile's node.
    pub frame_bytes: u64,
    /// Frames that went on without the tile's node.
    pub passed_over: u64,
}

impl Summary {
    /// Prints it as a table.
    pub fn print(&self) {
        say!("{} on {}: {} objects, {} leaves, {} triangles", self.scene, self.wall, self.objects, self.leaves, self.triangles);
        say!("{:>14} {:>9} {:>11} {:>8} {:>12} {:>11}", "tile", "leaves", "triangles", "culled", "frame bytes", "passed over");
        for t in &self.tiles {
            say!(
                "{:>14} {:9} {:11} {:7.1}% {:12} {:11}",
                t.tile,
                t.visible_leaves,
                t.visible_triangles,
                t.culled_percent,
                t.frame_bytes,
                t.passed_over
            );
        }
        let (cull, frame) = (self.cull_us, self.frame_ms);
        say!("frames         {}", self.frames);
        say!(
            "cull           {:.0} µs median, {:.0} µs p99, {:.0} µs p99.9, for all tiles together",
            cull.median,
            cull.p99,
            cull.p999
        );
        say!("frame          {:.1} ms median, {:.1} ms p99, {:.1} ms p99.9", frame.median, frame.p99, frame.p999);
        if self.dropped_objects > 0 {
            say!("dropped        {} objects in the last frame, which hardly contributed", self.dropped_objects);
        }
        if let Some(budget) = &self.budget {
            say!(
                "budget         {} triangles in the last frame; {} frames were drawn to it, {:.1} % of them over time",
                budget.triangles,
                budget.frames,
                budget.over_percent
            );
        }
        say!("sent           {} bytes of frames, {} bytes of scene", self.frame_bytes, self.chunk_bytes);
    }
}
