//! `mullion verify cull`: every algorithm against the exact answer, on random scenes, rooms and poses.
//!
//! A *round* is a scene, a room, and a few frames, all made from one seed; between frames leaves move, go and come, the
//! room moves and heads turn. A *case* is one leaf and one view in one frame. A leaf that the oracle sees and an
//! algorithm does not is *dropped*: there must be none. What an algorithm has beyond the oracle's is its excess.

mod random;
mod rooms;
mod scenes;

use std::sync::Arc;

use anyhow::Result;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use mullion_common::geometry::{Frustum, Obb};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::ViewId;
use mullion_server::cull::{Algorithm, Culler, Overlap, oracle};
use mullion_server::tree::{Bounds, CullTree, RebuildStep, TreeForm};
use serde::Serialize;

use random::Random;
use rooms::Room;
use scenes::{Scene, Shape};

/// Most cases of a frame in an ordinary round: many small rounds see more kinds of things than few large ones.
const MAX_CASES_A_FRAME: u32 = 60_000;
const MAX_LEAVES: u32 = 4000;
/// One round in so many has a scene that is large enough for threads to share.
const LARGE_ONE_IN: u64 = 16;
const LARGE_LEAVES: u32 = 36_000;
const LARGE_VIEWS: u32 = 6;
const LARGE_FRAMES: u32 = 4;
/// Frames of a round.
const FRAMES: [u32; 4] = [1, 4, 8, 24];

/// What was found.
#[derive(Debug, Serialize)]
pub struct Report {
    pub seed: u64,
    pub rounds: u64,
    pub frames: u64,
    /// Cases that each contestant was given.
    pub cases: u64,
    /// Cases in which the view sees the leaf's box.
    pub visible: u64,
    pub contestants: Vec<Standing>,
    /// One for each round in which something was dropped.
    pub drops: Vec<Drop>,
}

/// How one way to cull has done.
#[derive(Debug, Serialize)]
pub struct Standing {
    pub name: String,
    /// Cases that it says may be visible.
    pub found: u64,
    pub dropped: u64,
    /// What it finds too many, in percent of what is visible.
    pub excess_percent: f64,
}

/// The first leaf of a round that a view sees and that was left out.
#[derive(Debug, Serialize)]
pub struct Drop {
    /// Makes this round again, as the first one.
    pub seed: u64,
    pub scene: String,
    pub room: String,
    pub frame: u32,
    /// Who has dropped a leaf in this round. The first one has dropped this.
    pub contestants: Vec<String>,
    pub leaf: u32,
    pub view: u16,
    pub bound: Obb,
    pub eye: DVec3,
    pub rays: [DVec3; 4],
    /// Unit normal and offset of each plane.
    pub planes: [(DVec3, f64); 5],
}

/// Runs rounds until `cases` have been seen. `show` is told how many have.
///
/// # Errors
/// When the system gives no second thread.
pub fn verify(seed: u64, cases: u64, show: &dyn Fn(u64)) -> Result<Report> {
    let contestants =
        CONTESTANTS.iter().map(|contestant| Standing { name: contestant.name(), found: 0, dropped: 0, excess_percent: 0.0 });
    let contestants = contestants.collect();
    let mut report = Report { seed, rounds: 0, frames: 0, cases: 0, visible: 0, contestants, drops: Vec::new() };
    while report.cases < cases {
        let mut round = Round::new(seed.wrapping_add(report.rounds))?;
        for frame in 0..round.frames {
            round.check_frame(frame, &mut report);
            show(report.cases.min(cases));
        }
        report.rounds += 1;
    }
    for standing in &mut report.contestants {
        let excess = (standing.found + standing.dropped).saturating_sub(report.visible);
        standing.excess_percent = excess as f64 * 100.0 / report.visible.max(1) as f64;
    }
    Ok(report)
}

/// A way to cull that is held against the oracle.
#[derive(Clone, Copy)]
enum Contestant {
    Plain(Algorithm),
    Slack,
    Threads(usize),
    OwnFrusta(Algorithm),
}

const CONTESTANTS: [Contestant; Algorithm::ALL.len() + 4] = {
    let mut all = [Contestant::Slack; Algorithm::ALL.len() + 4];
    let mut at = 0;
    while at < Algorithm::ALL.len() {
        all[at] = Contestant::Plain(Algorithm::ALL[at]);
        at += 1;
    }
    all[at + 1] = Contestant::Threads(2);
    all[at + 2] = Contestant::OwnFrusta(Algorithm::Adaptive);
    all[at + 3] = Contestant::OwnFrusta(Algorithm::AdaptiveGrouped);
    all
};

impl Contestant {
    fn name(self) -> String {
        match self {
            Self::Plain(algorithm) => algorithm.to_string(),
            Self::Slack => "sweep, slack".to_owned(),
            Self::Threads(threads) => format!("sweep, {threads} threads"),
            Self::OwnFrusta(algorithm) => format!("{algorithm}, own frusta"),
        }
    }

    fn culler(self, room: &Room) -> Result<Culler> {
        let of = |algorithm| Culler::new(algorithm, room.wall());
        Ok(match self {
            Self::Plain(algorithm) => of(algorithm),
            Self::Slack => of(Algorithm::Sweep).with_slack(true),
            Self::Threads(threads) => of(Algorithm::Sweep).with_threads(threads)?,
            Self::OwnFrusta(algorithm) => of(algorithm).with_overlap(Overlap::OwnFrusta),
        })
    }
}

/// How much changes between frames.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Pace {
    /// The scene stays as it is; room and heads move little, or not at all: what temporal slack is for.
    Calm,
    /// The scene may be edited, room and heads may jump.
    Lively,
}

/// Frames of one scene in one room.
struct Round {
    seed: u64,
    random: Random,
    scene: Scene,
    tree: CullTree,
    /// By leaf number: its box, and none where it was removed.
    boxes: Vec<Option<Obb>>,
    room: Room,
    heads: Vec<DVec3>,
    world_from_room: DAffine3,
    frames: u32,
    pace: Pace,
    cullers: Vec<Culler>,
    exact: Vec<VisibleSet>,
    found: Vec<VisibleSet>,
}

impl Round {
    fn new(seed: u64) -> Result<Self> {
        let mut random = Random::new(seed);
        let is_large = random.chance(LARGE_ONE_IN);
        let (scene, room) = if is_large {
            let branching = random.count(2, 40);
            let shape = random.pick(&[Shape::Compact { branching }, Shape::Spanning { branching }, Shape::Flat]);
            (Scene::of_shape(&mut random, shape, LARGE_LEAVES), Room::random(&mut random, LARGE_VIEWS))
        } else {
            let max_views = random.count(1, 256);
            let room = Room::random(&mut random, max_views);
            let views = room.wall().views().len() as u32;
            (Scene::random(&mut random, (MAX_CASES_A_FRAME / views).min(MAX_LEAVES)), room)
        };
        let cullers = CONTESTANTS.iter().map(|contestant| contestant.culler(&room)).collect::<Result<_>>()?;
        let heads = room.heads(&mut random);
        let sets = || vec![VisibleSet::default(); room.wall().views().len()];
        Ok(Self {
            seed,
            tree: CullTree::editable(
                Arc::new(scene.hierarchy()),
                random.pick(&[Bounds::Obb, Bounds::Obb, Bounds::Hybrid, Bounds::Aabb]),
            ),
            boxes: scene.leaves().iter().copied().map(Some).collect(),
            world_from_room: pose(&mut random, &scene, heads[0]),
            frames: if is_large { LARGE_FRAMES } else { random.pick(&FRAMES) },
            pace: random.pick(&[Pace::Calm, Pace::Lively]),
            heads,
            cullers,
            exact: sets(),
            found: sets(),
            random,
            scene,
            room,
        })
    }

    /// What happens to the scene before a frame: leaves move, go and come, and the tree is built anew.
    fn edit_tree(&mut self, frame: u32, frusta: &[Frustum]) {
        let Self { random, scene, tree, boxes, pace, .. } = self;
        if random.chance(2) || (frame > 0 && *pace == Pace::Calm) {
            return;
        }
        let one_in = u64::from(random.count(1, 50));
        match random.next() % 8 {
            0 => {
                for (leaf, bound) in (0..).zip(boxes.iter_mut()).filter(|(_, bound)| bound.is_some()) {
                    if random.chance(one_in * 20) {
                        *bound = None;
                        tree.remove_leaf(leaf);
                    }
                }
            }
            1 => {
                let added: Vec<Obb> = (0..random.count(1, 20)).map(|_| scene.another_box(random)).collect();
                tree.add_leaves(&added);
                boxes.extend(added.into_iter().map(Some));
            }
            what => {
                let step_m = random.magnitude(1e-3, scenes::REACH) * scene.unit_m();
                for (leaf, bound) in (0..).zip(boxes.iter_mut()).filter_map(|(leaf, bound)| Some((leaf, bound.as_mut()?))) {
                    if random.chance(one_in) {
                        *bound = match what % 2 {
                            0 => Scene::moved(random, bound, step_m),
                            _ => Scene::touching(random, bound, frusta),
                        };
                        tree.move_leaf(leaf, bound);
                    }
                }
            }
        }
        // A rebuild begun before is done now; what happened in between is done to its tree again.
        if let Some(old_of_new) = tree.rebuild_step(RebuildStep::Finish) {
            *boxes = old_of_new.iter().map(|old| boxes[*old as usize]).collect();
        } else if random.chance(4) {
            tree.start_rebuild();
            tree.rebuild_step(RebuildStep::Some);
        }
        tree.refit(TreeForm::Hierarchy);
        tree.refit(TreeForm::Wide);
    }

    /// The room stands still, goes on a little or jumps, and so do the heads.
    fn move_on(&mut self) {
        let (furthest, widest) = if self.pace == Pace::Calm { (1e-2, 1e-3) } else { (1.0, 0.1) };
        match self.random.next() % 8 {
            0 => {}
            1 if self.pace == Pace::Lively => self.world_from_room = pose(&mut self.random, &self.scene, self.heads[0]),
            _ => {
                let step_m = self.random.magnitude(1e-6, furthest) * self.scene.unit_m();
                let turn = self.random.magnitude(1e-7, widest);
                self.world_from_room.translation += self.random.point(step_m);
                self.world_from_room.matrix3 *= DMat3::from_quat(DQuat::from_scaled_axis(self.random.point(turn)));
            }
        }
        match self.random.next() % 4 {
            0 => {
                let step_m = self.random.magnitude(1e-6, furthest);
                self.heads.iter_mut().for_each(|head| *head += self.random.point(step_m));
            }
            1 if self.pace == Pace::Lively => self.heads = self.room.heads(&mut self.random),
            _ => {}
        }
    }

    fn check_frame(&mut self, frame: u32, report: &mut Report) {
        if frame > 0 {
            self.move_on();
        }
        let eyes = self.room.eyes(&self.heads);
        let frustum = |(view, eye): (usize, &DVec3)| self.room.wall().frustum(ViewId(view as u16), *eye, &self.world_from_room);
        let frusta: Vec<Frustum> = eyes.iter().enumerate().map(frustum).collect();
        self.edit_tree(frame, &frusta);
        for (frustum, set) in frusta.iter().zip(&mut self.exact) {
            set.clear();
            let boxes = (0..).zip(&self.boxes).filter_map(|(leaf, bound)| Some((leaf, bound.as_ref()?)));
            oracle::visible_boxes(boxes, frustum, set);
            report.visible += u64::from(set.len());
        }
        report.frames += 1;
        report.cases += self.boxes.iter().flatten().count() as u64 * frusta.len() as u64;
        let mut missing = VisibleSet::default();
        for contestant in 0..self.cullers.len() {
            let culler = &mut self.cullers[contestant];
            culler.cull(&self.tree, self.room.wall(), &eyes, &self.world_from_room, &mut self.found);
            let standing = &mut report.contestants[contestant];
            let mut first = None;
            for (view, (found, exact)) in self.found.iter().zip(&self.exact).enumerate() {
                standing.found += u64::from(found.len());
                exact.difference_into(found, &mut missing);
                standing.dropped += u64::from(missing.len());
                first = first.or_else(|| missing.leaves().next().map(|leaf| (leaf, view)));
            }
            let Some((leaf, view)) = first else { continue };
            let name = standing.name.clone();
            match report.drops.last_mut() {
                Some(drop) if drop.seed == self.seed => {
                    if !drop.contestants.contains(&name) {
                        drop.contestants.push(name);
                    }
                }
                _ => report.drops.push(self.drop_of(frame, name, leaf, view, &frusta[view])),
            }
        }
    }

    fn drop_of(&self, frame: u32, contestant: String, leaf: u32, view: usize, frustum: &Frustum) -> Drop {
        Drop {
            seed: self.seed,
            scene: self.scene.describe(),
            room: self.room.describe(),
            frame,
            contestants: vec![contestant],
            leaf,
            view: view as u16,
            // A leaf that a view sees was not removed.
            bound: self.boxes[leaf as usize].unwrap_or(Obb::of_point(DVec3::NAN)),
            eye: frustum.eye,
            rays: frustum.rays,
            planes: frustum.planes.map(|plane| (plane.normal, plane.offset_m)),
        }
    }
}

/// Where the room stands: an eye inside a leaf's box, near the scene or off it; of a size from doll's house to city; turned
/// anyhow or towards a leaf.
fn pose(random: &mut Random, scene: &Scene, eye: DVec3) -> DAffine3 {
    let scale = DVec3::splat(random.magnitude(0.1, 20.0) * scene.unit_m());
    let stand = if random.chance(2) { random.pick(scene.leaves()).center } else { scene.point_near(random) };
    let ahead = (random.pick(scene.leaves()).center - stand).try_normalize();
    let turn = match ahead {
        Some(ahead) if !random.chance(4) => DQuat::from_rotation_arc(DVec3::NEG_Z, ahead),
        _ => random.turn(),
    };
    let turned = DAffine3::from_scale_rotation_translation(scale, turn, DVec3::ZERO);
    DAffine3 { translation: stand - turned.transform_point3(eye), ..turned }
}
