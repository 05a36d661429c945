//! Objects move before every frame: edit, refit and cull (Nirnimesh, Harish, Narayanan 2006, section 5, Fig. 6).

use std::fmt::Write;
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DQuat, DVec3};
use mullion_common::camera_path::CameraPath;
use mullion_common::geometry::Obb;
use mullion_common::scene::{ObjectId, Package};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::Wall;
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::tree::{Bounds, DynamicScene};
use serde::Serialize;

use super::measure::{BLOCK_FRAMES, WARM_UP_FRAMES};
use crate::say::say;
use crate::show::Spread;

/// What culls a moving scene: the paper's algorithm, and ours.
const ALGORITHMS: [Algorithm; 2] = [Algorithm::Adaptive, Algorithm::Sweep];

/// A scene, a wall, and how many objects move.
pub struct MovingCase<'a> {
    pub package: &'a Arc<Package>,
    pub wall: &'a Wall,
    pub path: &'a CameraPath,
    pub frames: u64,
    /// Of the objects that have triangles.
    pub percent: u8,
}

/// One share of moving objects, measured.
#[derive(Clone, Debug, Serialize)]
pub struct MovingTable {
    pub scene: String,
    pub grid: String,
    pub percent: u8,
    /// How many that is.
    pub moving_objects: usize,
    pub frames: u64,
    pub rows: Vec<MovingRow>,
}

/// What one algorithm needed with one kind of bounds. Microseconds a frame.
#[derive(Clone, Debug, Serialize)]
pub struct MovingRow {
    pub name: String,
    pub total_us: Spread,
    pub edit_us: Spread,
    pub refit_us: Spread,
    pub cull_us: Spread,
    /// Mean number of (leaf, tile) pairs in the sets of a frame.
    pub leaf_tile_pairs: f64,
}

struct Runner {
    name: String,
    algorithm: Algorithm,
    scene: DynamicScene,
    culler: Culler,
    sets: Vec<VisibleSet>,
    /// Edit, refit, cull.
    times_us: [Vec<f64>; 3],
    pairs: u64,
}

/// Moves, refits and culls, every algorithm with every kind of bounds on the same frames, block by block in turn.
pub fn measure(case: &MovingCase<'_>) -> (usize, Vec<MovingRow>) {
    let movers = Movers::of(case.package, case.percent);
    let mut runners: Vec<Runner> =
        ALGORITHMS.iter().flat_map(|algorithm| Bounds::ALL.map(|bounds| Runner::new(case, *algorithm, bounds))).collect();
    let eyes = case.wall.default_eyes();
    let mut moves: Vec<(ObjectId, DAffine3)> = Vec::with_capacity(movers.objects.len());
    let all_frames = WARM_UP_FRAMES + case.frames;
    for block in 0..all_frames.div_ceil(BLOCK_FRAMES) {
        for turn in 0..runners.len() {
            let at = (turn + block as usize) % runners.len();
            for frame in block * BLOCK_FRAMES..((block + 1) * BLOCK_FRAMES).min(all_frames) {
                moves.clear();
                moves.extend(movers.at(frame));
                let is_measured = frame >= WARM_UP_FRAMES;
                runners[at].run(&moves, case.wall, &eyes, &case.path.pose(frame), is_measured);
            }
        }
    }
    (movers.objects.len(), runners.into_iter().map(Runner::finish).collect())
}

impl Runner {
    fn new(case: &MovingCase<'_>, algorithm: Algorithm, bounds: Bounds) -> Self {
        Self {
            name: format!("{algorithm} {}", bounds.name()),
            algorithm,
            scene: DynamicScene::new(Arc::clone(case.package), bounds),
            culler: Culler::new(algorithm, case.wall),
            sets: vec![VisibleSet::default(); case.wall.views().len()],
            times_us: [0; 3].map(|_| Vec::with_capacity(case.frames as usize)),
            pairs: 0,
        }
    }

    fn run(&mut self, moves: &[(ObjectId, DAffine3)], wall: &Wall, eyes: &[DVec3], pose: &DAffine3, is_measured: bool) {
        let start = Instant::now();
        for (object, world_from_local) in moves {
            self.scene.move_object(*object, world_from_local);
        }
        let edited = Instant::now();
        self.scene.refit(self.algorithm.tree_form());
        let refitted = Instant::now();
        self.culler.cull(self.scene.tree(), wall, eyes, pose, &mut self.sets);
        let culled = Instant::now();
        if is_measured {
            for (times, took) in self.times_us.iter_mut().zip([edited - start, refitted - edited, culled - refitted]) {
                times.push(took.as_secs_f64() * 1e6);
            }
            self.pairs += self.sets.iter().map(|set| u64::from(set.len())).sum::<u64>();
        }
    }

    fn finish(self) -> MovingRow {
        let [edit, refit, cull] = &self.times_us;
        let total = edit.iter().zip(refit).zip(cull).map(|((edit, refit), cull)| edit + refit + cull);
        let spread = |times: &[f64]| Spread::of(times.iter().copied());
        MovingRow {
            total_us: Spread::of(total),
            edit_us: spread(edit),
            refit_us: spread(refit),
            cull_us: spread(cull),
            leaf_tile_pairs: self.pairs as f64 / edit.len().max(1) as f64,
            name: self.name,
        }
    }
}

/// Objects that sway and turn about where they were, each in its own time: spread evenly over the scene's objects.
struct Movers {
    objects: Vec<Mover>,
}

struct Mover {
    object: ObjectId,
    rest: DAffine3,
    /// Half the length of its way, metres.
    sway_m: f64,
    phase: f64,
}

impl Movers {
    fn of(package: &Package, percent: u8) -> Self {
        let scene = &package.scene;
        // Of each object, the size of its first leaf.
        let mut sizes: Vec<Option<f64>> = vec![None; scene.objects.len()];
        for (leaf, node) in scene.manifest.leaves.iter().zip(scene.hierarchy.leaf_nodes()) {
            sizes[leaf.object.0 as usize].get_or_insert(size_m(&node.bound));
        }
        let drawn = (0..).zip(sizes).filter_map(|(object, size)| Some((ObjectId(object), size?)));
        let share = u64::from(percent);
        let chosen = (0..).zip(drawn).filter(|(at, _): &(u64, _)| (at + 1) * share / 100 > at * share / 100);
        let mover = |(at, (object, size)): (u64, (ObjectId, f64))| Mover {
            object,
            rest: scene.manifest.transforms[object.0 as usize].affine(),
            sway_m: size.clamp(0.05, 2.0),
            phase: at as f64,
        };
        Self { objects: chosen.map(mover).collect() }
    }

    fn at(&self, frame: u64) -> impl Iterator<Item = (ObjectId, DAffine3)> {
        let time_s = frame as f64 / 60.0;
        self.objects.iter().map(move |mover| {
            let angle = time_s + mover.phase;
            let sway = DVec3::new(angle.sin(), (angle * 1.3).sin() * 0.5, (angle * 0.7).cos()) * mover.sway_m;
            let turn = DQuat::from_rotation_y(angle.sin() * 0.5);
            let moved = DAffine3 {
                matrix3: glam::DMat3::from_quat(turn) * mover.rest.matrix3,
                translation: mover.rest.translation + sway,
            };
            (mover.object, moved)
        })
    }
}

fn size_m(bound: &Obb) -> f64 {
    bound.half_axes.iter().map(|half| half.length()).fold(0.0, f64::max)
}

impl MovingTable {
    /// Prints it.
    pub fn print(&self) {
        let Self { scene, grid, percent, moving_objects, frames, rows } = self;
        say!("{scene} on {grid}, {percent} % of the objects ({moving_objects}) move: {frames} frames, medians in µs");
        let mut lines =
            format!("{:16} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}\n", "", "edit", "refit", "cull", "total", "p99", "pairs");
        for row in rows {
            // Writing into a string does not fail.
            let _ = writeln!(
                lines,
                "{:16} {:9.1} {:9.1} {:9.1} {:9.1} {:9.1} {:9.0}",
                row.name,
                row.edit_us.median,
                row.refit_us.median,
                row.cull_us.median,
                row.total_us.median,
                row.total_us.p99,
                row.leaf_tile_pairs
            );
        }
        say!("{lines}");
    }
}
