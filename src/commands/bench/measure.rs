//! Every contestant culls the same frames, in turn frame by frame.

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use glam::{DAffine3, DVec3};
use mullion_common::camera_path::CameraPath;
use mullion_common::scene::Package;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::Wall;
use mullion_server::cull::{Algorithm, CullStats, Culler};
use mullion_server::tree::CullTree;
use serde::Serialize;

use crate::show::Spread;

/// Frames culled before measuring starts, so that memory has grown and caches are warm.
pub const WARM_UP_FRAMES: u64 = 8;

/// An algorithm and how it is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contestant {
    pub algorithm: Algorithm,
    pub variant: Variant,
}

/// How an algorithm is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// On one thread, each frame anew.
    Plain,
    /// On so many threads.
    Threads(u8),
    /// With temporal slack.
    Slack,
}

impl Contestant {
    fn culler(self, wall: &Wall) -> Result<Culler> {
        let culler = Culler::new(self.algorithm, wall);
        match self.variant {
            Variant::Plain => Ok(culler),
            Variant::Threads(threads) => culler.with_threads(threads.into()).with_context(|| format!("{threads} threads")),
            Variant::Slack => Ok(culler.with_slack(true)),
        }
    }
}

impl fmt::Display for Contestant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.variant {
            Variant::Plain => write!(f, "{}", self.algorithm),
            Variant::Threads(threads) => write!(f, "{}/{threads}", self.algorithm),
            Variant::Slack => write!(f, "{}+slack", self.algorithm),
        }
    }
}

/// What one contestant needed and found.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// As [`Contestant`] shows itself.
    pub name: String,
    /// All tiles together, microseconds a frame.
    pub cull_us: Spread,
    /// Mean of a frame, each visit counted.
    pub nodes_visited: f64,
    /// Mean of a frame.
    pub plane_tests: f64,
    /// Mean number of (leaf, tile) pairs in the sets of a frame.
    pub leaf_tile_pairs: f64,
    /// Mean number of ranges in the sets of a frame.
    pub ranges: f64,
    /// Mean share of those pairs that cannot be seen; `None` where nothing checks it.
    pub excess_percent: Option<f64>,
    /// Frame by frame, microseconds.
    pub frame_us: Vec<f64>,
}

/// What all contestants cull.
pub struct Case<'a> {
    pub package: &'a Package,
    pub wall: &'a Wall,
    pub path: &'a CameraPath,
    pub frames: u64,
}

struct Runner {
    name: String,
    culler: Culler,
    sets: Vec<VisibleSet>,
    frame_us: Vec<f64>,
    stats: CullStats,
    pairs: u64,
    ranges: u64,
    excess_percent: Option<f64>,
}

/// Measures all contestants on a case. In each frame another one begins, so that drift of the machine and what one leaves in
/// the caches meet all alike. Between two readings of the clock there is one cull and nothing else.
///
/// # Errors
/// When the system gives no threads, or a set lacks what is in view.
pub fn measure(case: &Case<'_>, contestants: &[Contestant]) -> Result<Vec<Row>> {
    let eyes = case.wall.default_eyes();
    let tree = tree_of(case.package);
    let mut runners: Vec<Runner> = contestants.iter().map(|contestant| Runner::new(*contestant, case)).collect::<Result<_>>()?;
    let mut cull_all = |frame: u64, is_measured: bool| -> Result<()> {
        let pose = case.path.pose(frame);
        for turn in 0..runners.len() {
            let at = (turn + (frame % contestants.len() as u64) as usize) % contestants.len();
            let Runner { culler, sets, .. } = &mut runners[at];
            let start = Instant::now();
            let stats = culler.cull(&tree, case.wall, &eyes, &pose, sets);
            let took = start.elapsed();
            if is_measured {
                runners[at].note(took.as_secs_f64() * 1e6, stats);
            }
        }
        for runner in runners.iter_mut().filter(|_| is_measured) {
            let excess = excess_percent(case.package, case.wall, &eyes, &pose, &runner.sets)
                .with_context(|| format!("{} at frame {frame}", runner.name))?;
            runner.excess_percent = excess.map(|percent| runner.excess_percent.unwrap_or(0.0) + percent);
        }
        Ok(())
    };
    // Backwards towards the first frame, so that the camera does not jump where measuring starts.
    (1..=WARM_UP_FRAMES).rev().try_for_each(|frame| cull_all(frame, false))?;
    (0..case.frames).try_for_each(|frame| cull_all(frame, true))?;
    Ok(runners.into_iter().map(Runner::finish).collect())
}

/// The tree that algorithms walk.
fn tree_of(package: &Package) -> CullTree {
    CullTree::new(Arc::clone(&package.scene.hierarchy))
}

/// What an exact check says of one frame's sets, by `ViewId`: which share of their pairs, in percent, cannot be seen. `None`
/// while no such check is built in.
///
/// # Errors
/// When a set lacks a leaf that is inside its view.
fn excess_percent(
    _package: &Package,
    _wall: &Wall,
    _eyes: &[DVec3],
    _world_from_room: &DAffine3,
    _sets: &[VisibleSet],
) -> Result<Option<f64>> {
    Ok(None)
}

impl Runner {
    fn new(contestant: Contestant, case: &Case<'_>) -> Result<Self> {
        Ok(Self {
            name: contestant.to_string(),
            culler: contestant.culler(case.wall)?,
            sets: vec![VisibleSet::default(); case.wall.views().len()],
            frame_us: Vec::with_capacity(case.frames as usize),
            stats: CullStats::default(),
            pairs: 0,
            ranges: 0,
            excess_percent: None,
        })
    }

    fn note(&mut self, cull_us: f64, stats: CullStats) {
        self.frame_us.push(cull_us);
        self.stats += stats;
        self.pairs += self.sets.iter().map(|set| u64::from(set.len())).sum::<u64>();
        self.ranges += self.sets.iter().map(|set| set.ranges().len() as u64).sum::<u64>();
    }

    fn finish(self) -> Row {
        let frames = self.frame_us.len().max(1) as f64;
        let mean = |sum: u64| sum as f64 / frames;
        Row {
            name: self.name,
            cull_us: Spread::of(self.frame_us.iter().copied()),
            nodes_visited: mean(self.stats.nodes_visited),
            plane_tests: mean(self.stats.plane_tests),
            leaf_tile_pairs: mean(self.pairs),
            ranges: mean(self.ranges),
            excess_percent: self.excess_percent.map(|sum| sum / frames),
            frame_us: self.frame_us,
        }
    }
}
