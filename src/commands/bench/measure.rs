//! Every contestant culls the same frames, a few of them in turn.

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use glam::{DAffine3, DVec3};
use mullion_common::camera_path::CameraPath;
use mullion_common::geometry::Obb;
use mullion_common::scene::Package;
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{ViewId, Wall};
use mullion_server::cull::{Algorithm, CullStats, Culler, oracle};
use mullion_server::tree::{CullTree, FileTree};
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
    /// On one thread, over the file's own tree.
    FileTree,
}

impl Contestant {
    fn culler(self, wall: &Wall) -> Result<Culler> {
        let culler = Culler::new(self.algorithm, wall);
        match self.variant {
            Variant::Plain | Variant::FileTree => Ok(culler),
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
            Variant::FileTree => write!(f, "{}@file", self.algorithm),
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
    /// How many more pairs there are than boxes that meet a view, percent, over [`CHECKED_FRAMES`] of the frames.
    pub excess_percent: f64,
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

/// Most frames whose sets are checked: evenly spread over the run.
pub const CHECKED_FRAMES: u64 = 12;

struct Runner {
    name: String,
    culler: Culler,
    is_on_file_tree: bool,
    sets: Vec<VisibleSet>,
    frame_us: Vec<f64>,
    stats: CullStats,
    pairs: u64,
    ranges: u64,
    checked_pairs: u64,
    true_pairs: u64,
}

/// Frames that a contestant culls before the next one has its turn: so few that drift of the machine meets all alike, and so
/// many that most of them find in the caches what the contestant, not its rivals, left there.
pub const BLOCK_FRAMES: u64 = 8;

/// Measures all contestants on a case. They cull the same frames, block by block in turn, and in each block another one
/// begins. Between two readings of the clock there is one cull and nothing else. Also gives the memory of the tree, bytes.
///
/// # Errors
/// When the system gives no threads, or a set lacks what is in view.
pub fn measure(case: &Case<'_>, contestants: &[Contestant]) -> Result<(usize, Vec<Row>)> {
    let eyes = case.wall.default_eyes();
    let tree = CullTree::new(Arc::clone(&case.package.scene.hierarchy));
    let has_file_tree = contestants.iter().any(|contestant| contestant.variant == Variant::FileTree);
    let file = if has_file_tree { FileTree::of(&case.package.scene) } else { FileTree::default() };
    let file_tree = CullTree::new(Arc::new(file.hierarchy.clone()));
    let mut checker = Checker::new(case);
    let mut runners: Vec<Runner> = contestants.iter().map(|contestant| Runner::new(*contestant, case)).collect::<Result<_>>()?;
    let cull = |runner: &mut Runner, frame: u64| {
        let pose = case.path.pose(frame);
        let tree = if runner.is_on_file_tree { &file_tree } else { &tree };
        let start = Instant::now();
        let stats = runner.culler.cull(tree, case.wall, &eyes, &pose, &mut runner.sets);
        (start.elapsed().as_secs_f64() * 1e6, stats)
    };
    for runner in &mut runners {
        // Backwards towards the first frame, so that the camera does not jump where measuring starts.
        for frame in (1..=WARM_UP_FRAMES).rev() {
            cull(runner, frame);
        }
    }
    let blocks = case.frames.div_ceil(BLOCK_FRAMES);
    for block in 0..blocks {
        let frames = block * BLOCK_FRAMES..((block + 1) * BLOCK_FRAMES).min(case.frames);
        for turn in 0..runners.len() {
            let at = (turn + block as usize) % runners.len();
            for frame in frames.clone() {
                let (cull_us, stats) = cull(&mut runners[at], frame);
                runners[at].note(cull_us, stats);
            }
        }
        if block.is_multiple_of(blocks.div_ceil(CHECKED_FRAMES)) {
            let frame = frames.end - 1;
            checker.check(&mut runners, &file, &eyes, &case.path.pose(frame)).with_context(|| format!("frame {frame}"))?;
        }
    }
    Ok((tree.bytes(), runners.into_iter().map(Runner::finish).collect()))
}

/// Holds the sets of a frame against the truth: of all pairs that anybody found, those whose box meets the view.
struct Checker<'a> {
    case: &'a Case<'a>,
    /// Of each leaf.
    bounds: Vec<&'a Obb>,
    of_runner: VisibleSet,
    before: VisibleSet,
    any: VisibleSet,
    truth: VisibleSet,
}

impl<'a> Checker<'a> {
    fn new(case: &'a Case<'a>) -> Self {
        let bounds = case.package.scene.hierarchy.leaf_nodes().map(|node| &node.bound).collect();
        let [of_runner, before, any, truth] = Default::default();
        Self { case, bounds, of_runner, before, any, truth }
    }

    /// Counts pairs and true pairs.
    ///
    /// # Errors
    /// When a set lacks a pair that is in view.
    fn check(&mut self, runners: &mut [Runner], file: &FileTree, eyes: &[DVec3], pose: &DAffine3) -> Result<()> {
        for (view, eye) in eyes.iter().enumerate() {
            let frustum = self.case.wall.frustum(ViewId(view as u16), *eye, pose);
            self.any.clear();
            for runner in runners.iter() {
                self.take(runner, view, file);
                std::mem::swap(&mut self.any, &mut self.before);
                self.before.union_into(&self.of_runner, &mut self.any);
            }
            self.truth.clear();
            for leaf in self.any.leaves().filter(|leaf| oracle::intersects(&frustum, self.bounds[*leaf as usize])) {
                self.truth.push(LeafRange::new(leaf, leaf + 1));
            }
            for runner in runners.iter_mut() {
                self.take(runner, view, file);
                ensure!(self.of_runner.is_superset_of(&self.truth), "{} lacks a leaf that view {view} may see", runner.name);
                runner.checked_pairs += u64::from(self.of_runner.len());
                runner.true_pairs += u64::from(self.truth.len());
            }
        }
        Ok(())
    }

    /// What a runner found for a view, in the scene's numbers.
    fn take(&mut self, runner: &Runner, view: usize, file: &FileTree) {
        if runner.is_on_file_tree {
            file.in_scene(&runner.sets[view], &mut self.of_runner);
        } else {
            self.of_runner.clone_from(&runner.sets[view]);
        }
    }
}

impl Runner {
    fn new(contestant: Contestant, case: &Case<'_>) -> Result<Self> {
        Ok(Self {
            name: contestant.to_string(),
            culler: contestant.culler(case.wall)?,
            is_on_file_tree: contestant.variant == Variant::FileTree,
            sets: vec![VisibleSet::default(); case.wall.views().len()],
            frame_us: Vec::with_capacity(case.frames as usize),
            stats: CullStats::default(),
            pairs: 0,
            ranges: 0,
            checked_pairs: 0,
            true_pairs: 0,
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
            excess_percent: (self.checked_pairs - self.true_pairs) as f64 * 100.0 / self.true_pairs.max(1) as f64,
            frame_us: self.frame_us,
        }
    }
}
