//! Where everything is in a frame: a camera's path, and what commands say instead.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use glam::{DAffine3, DVec3};
use mullion_common::camera_path::CameraPath;
use mullion_common::scene::ObjectId;
use mullion_common::wall::Wall;
use mullion_common::wire::{Budget, Course, Moved, Steering};

use super::check::Change;
use super::queue::Batches;
use crate::service::{Heritage, Pose, Succession};
use crate::tree::Presence;

/// How a show's time stands; read by whoever tells of it.
#[derive(Debug, Default)]
pub struct Clock {
    path_frame: AtomicU64,
    is_paused: AtomicBool,
    succession: Succession,
}

impl Clock {
    /// The newest frame's place on the path and in the scene's time, frames.
    pub fn path_frame(&self) -> u64 {
        self.path_frame.load(Ordering::Relaxed)
    }

    /// Whether time is held.
    pub fn is_paused(&self) -> bool {
        self.is_paused.load(Ordering::Relaxed)
    }

    /// Whether another master drives the show.
    pub(super) fn is_standing_by(&self) -> bool {
        self.succession.is_standing_by()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pace {
    Running,
    /// Held, after so many more frames.
    Stepping(u32),
}

/// Gives a show its poses, and does between frames what commands say.
pub struct Driver {
    batches: Batches,
    clock: Arc<Clock>,
    path: CameraPath,
    steered: Steered,
}

/// What commands change.
struct Steered {
    wall: Arc<Wall>,
    pace: Pace,
    /// The place on the path; none before the first frame, whose number is its place.
    path_frame: Option<u64>,
    /// Instead of the path.
    camera: Option<DAffine3>,
    eyes: Vec<DVec3>,
    budgets: Vec<Budget>,
    moved: Vec<Moved>,
    place_of: HashMap<ObjectId, usize>,
    presence: Vec<(ObjectId, Presence)>,
}

impl Driver {
    /// For a wall whose camera is on a path until it is told otherwise.
    pub fn new(wall: Arc<Wall>, path: CameraPath, batches: Batches) -> Self {
        let steered = Steered {
            eyes: wall.default_eyes(),
            wall,
            pace: Pace::Running,
            path_frame: None,
            camera: None,
            budgets: Vec::new(),
            moved: Vec::new(),
            place_of: HashMap::new(),
            presence: Vec::new(),
        };
        let clock = Arc::new(Clock { succession: batches.succession().clone(), ..Clock::default() });
        Self { batches, clock, path, steered }
    }

    /// How its time stands.
    pub fn clock(&self) -> Arc<Clock> {
        Arc::clone(&self.clock)
    }

    /// For the options of its show: who steers must know when this master stands by, and what it goes on from.
    pub fn succession(&self) -> Succession {
        self.clock.succession.clone()
    }

    /// The pose of a frame; each frame is asked for once. Time passes before a frame, but for the first: a pause holds what was shown
    /// last, and a step of one shows what comes next. Where this master took another's place, that one's last frame came before. What
    /// moved, came or went before is the service's to tell.
    pub fn pose(&mut self, frame: u64) -> Pose {
        let steered = &mut self.steered;
        if let Some(Heritage { course, package }) = self.clock.succession.heritage() {
            self.batches.checker().grow(package);
            steered.inherit(course);
            self.clock.succession.drive();
        }
        self.batches.take(frame, |change| steered.apply(change));
        let path_frame = steered.pass(frame);
        self.clock.path_frame.store(path_frame, Ordering::Relaxed);
        self.clock.is_paused.store(steered.pace == Pace::Stepping(0), Ordering::Relaxed);
        steered.place_of.clear();
        Pose {
            number: frame,
            scene_time_s: path_frame as f64 / steered.wall.rate_hz(),
            world_from_room: steered.camera.unwrap_or_else(|| self.path.pose(path_frame)),
            eyes: steered.eyes.clone(),
            moved: std::mem::take(&mut steered.moved),
            presence: std::mem::take(&mut steered.presence),
            budgets: steered.budgets.clone(),
            steering: steered.steering(path_frame),
            offer: self.batches.take_offer(),
            grows: false,
            begins_with: None,
        }
    }
}

impl Steered {
    /// Goes on from a frame of another master.
    fn inherit(&mut self, before: Course) {
        let Steering { path_frame, held_after, is_off_path } = before.steering;
        self.pace = held_after.map_or(Pace::Running, Pace::Stepping);
        self.path_frame = Some(path_frame);
        self.camera = is_off_path.then_some(before.world_from_room);
        self.eyes = before.eyes;
        self.budgets = before.budgets;
        self.moved.clear();
        self.presence.clear();
    }

    fn steering(&self, path_frame: u64) -> Steering {
        let held_after = match self.pace {
            Pace::Running => None,
            Pace::Stepping(left) => Some(left),
        };
        Steering { path_frame, held_after, is_off_path: self.camera.is_some() }
    }

    /// Lets time pass, where it passes, and tells the place on the path.
    fn pass(&mut self, frame: u64) -> u64 {
        let passes = match &mut self.pace {
            Pace::Running => true,
            Pace::Stepping(0) => false,
            Pace::Stepping(left) => {
                *left -= 1;
                true
            }
        };
        let place = self.path_frame.map_or(frame, |place| place + u64::from(passes));
        self.path_frame = Some(place);
        place
    }

    fn apply(&mut self, change: Change) {
        match change {
            Change::Camera(world_from_room) => self.camera = Some(world_from_room),
            Change::FollowPath => self.camera = None,
            Change::Eyes(eyes) => self.eyes = eyes,
            Change::Move(moved) => {
                let place = *self.place_of.entry(moved.object).or_insert(self.moved.len());
                match self.moved.get_mut(place) {
                    Some(before) => *before = moved,
                    None => self.moved.push(moved),
                }
            }
            Change::Presence(object, presence) => self.presence.push((object, presence)),
            Change::Pause => self.pace = Pace::Stepping(0),
            Change::Resume => self.pace = Pace::Running,
            Change::Step(frames) => {
                let left = if let Pace::Stepping(left) = self.pace { left } else { 0 };
                self.pace = Pace::Stepping(left.saturating_add(frames));
            }
            Change::Budget(tile, budget) => {
                self.budgets.resize(self.wall.views().len(), Budget::default());
                for (view, kept) in self.budgets.iter_mut().enumerate() {
                    if tile.is_none_or(|tile| self.wall.views()[view].tile == tile) {
                        *kept = budget;
                    }
                }
            }
        }
    }
}
