//! Whether a wall and a scene can do what a command says.

use std::sync::{Arc, PoisonError, RwLock};

use glam::{DAffine3, DQuat, DVec3};
use mullion_common::camera_path::CameraPose;
use mullion_common::control::{Command, Insert, MAX_COMMANDS, MAX_REQUEST_BYTES, MovesError, ObjectKey};
use mullion_common::scene::{ObjectId, Package};
use mullion_common::wall::{TileId, Wall};
use mullion_common::wire::{Budget, Moved};
use thiserror::Error;

use super::grafter::MAX_INSERTIONS;
use crate::library::check_name;
use crate::tree::{MAX_TRANSFORM, Presence};

const LIMITS: std::ops::RangeInclusive<f64> = -MAX_TRANSFORM..=MAX_TRANSFORM;
/// Most frames in a step.
const MAX_STEPS: u32 = 1_000_000;

/// Why a command is not done, in one line.
#[derive(Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum ControlError {
    #[error("command {command}: {problem}")]
    Command { command: usize, problem: String },
    #[error("move {place}: {problem}")]
    Move { place: usize, problem: String },
    #[error(transparent)]
    Moves(#[from] MovesError),
    #[error("commands: {0}, at most {MAX_COMMANDS} are allowed in a request")]
    TooMany(usize),
    #[error("{0} bytes; a request has at most {MAX_REQUEST_BYTES}")]
    TooLong(usize),
    #[error("not a request: {0}")]
    Malformed(String),
    #[error("the queue is full: {queued} changes wait for the next frame, at most {cap} are allowed; send less, or less often")]
    Full { queued: usize, cap: usize },
    #[error("the show does not begin a frame: what was sent waits for one")]
    Late,
    #[error("the insertion takes long: it goes on, and nobody tells when it is seen")]
    LateInsertion,
    #[error("the show is over")]
    Over,
    #[error("this master stands by: steer the one that drives the wall")]
    StandingBy,
    #[error("object {object}: the scene has {count}, from 0 on")]
    NoObject { object: u32, count: usize },
    #[error("object {name:?}: no object of the scene has that name")]
    NoObjectNamed { name: String },
    #[error("object {name:?}: {count} objects have that name; give a number, as {first}")]
    Ambiguous { name: String, count: usize, first: u32 },
    #[error("insert: this show has no library; start it with --library")]
    NoLibrary,
    #[error("insert: {MAX_INSERTIONS} insertions wait already; try again when one is seen")]
    ManyInsertions,
    #[error("insert: {problem}")]
    Insertion { problem: String },
    #[error("tile {tile:?}: the wall has {known}")]
    NoTile { tile: String, known: String },
}

/// A command that can be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// The room stands here.
    Camera(DAffine3),
    /// The room is on its path.
    FollowPath,
    /// Each view's eye, room space, metres.
    Eyes(Vec<DVec3>),
    /// An object stands elsewhere.
    Move(Moved),
    /// An object and all below it come or go.
    Presence(ObjectId, Presence),
    /// Time stands still.
    Pause,
    /// Time passes.
    Resume,
    /// Time passes for so many frames.
    Step(u32),
    /// What the views of a tile, or all, may spend.
    Budget(Option<TileId>, Budget),
}

impl Change {
    /// What it counts for in a bounded queue.
    pub(super) fn weight(&self) -> usize {
        match self {
            Self::Eyes(eyes) => eyes.len().max(1),
            _ => 1,
        }
    }
}

/// An insertion that can be tried.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Wanted {
    pub package: String,
    pub under: Option<ObjectId>,
    pub world_from_root: DAffine3,
}

/// Knows the wall and the scene that commands are for. Clones know of the same scene when it grows.
#[derive(Clone, Debug)]
pub struct Checker {
    wall: Arc<Wall>,
    package: Arc<RwLock<Arc<Package>>>,
}

impl Checker {
    /// For a wall that shows a package.
    pub fn new(wall: Arc<Wall>, package: Arc<Package>) -> Self {
        Self { wall, package: Arc::new(RwLock::new(package)) }
    }

    /// The wall.
    pub fn wall(&self) -> &Wall {
        &self.wall
    }

    /// The scene.
    pub fn package(&self) -> Arc<Package> {
        Arc::clone(&self.package.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// The scene has grown.
    pub(super) fn grow(&self, package: Arc<Package>) {
        *self.package.write().unwrap_or_else(PoisonError::into_inner) = package;
    }

    /// What is to be inserted where.
    ///
    /// # Errors
    /// When there is no such object, or the name or the place is none.
    pub(super) fn insertion(&self, insert: &Insert) -> Result<Wanted, ControlError> {
        let refused = |problem: String| ControlError::Insertion { problem };
        check_name(&insert.package).map_err(|error| refused(error.to_string()))?;
        let under = insert.under.map(|object| self.known(object)).transpose().map_err(|e| refused(format!("under: {e}")))?;
        if let Some(at) = insert.transform.iter().position(|number| !LIMITS.contains(number)) {
            let number = insert.transform[at];
            return Err(refused(format!("number {at} of the transform is {number}, outside ±{MAX_TRANSFORM:e}")));
        }
        Ok(Wanted { package: insert.package.clone(), under, world_from_root: DAffine3::from_cols_array(&insert.transform) })
    }

    /// What a frame is to do for these commands.
    ///
    /// # Errors
    /// For the first that cannot be done, by its place.
    pub fn changes(&self, commands: &[Command]) -> Result<Vec<Change>, ControlError> {
        if commands.len() > MAX_COMMANDS {
            return Err(ControlError::TooMany(commands.len()));
        }
        let mut changes = Vec::new();
        for (place, command) in commands.iter().enumerate() {
            self.change(command, &mut changes).map_err(|problem| ControlError::Command { command: place, problem })?;
        }
        Ok(changes)
    }

    /// The same of moves alone.
    ///
    /// # Errors
    /// For the first that cannot be done, by its place.
    pub fn moves(&self, moves: impl Iterator<Item = Moved>) -> Result<Vec<Change>, ControlError> {
        let check = |(place, moved): (usize, Moved)| match self.check_move(&moved) {
            Ok(()) => Ok(Change::Move(moved)),
            Err(problem) => Err(ControlError::Move { place, problem }),
        };
        moves.enumerate().map(check).collect()
    }

    /// The object that a key names.
    ///
    /// # Errors
    /// When none has the number or name, or several have the name.
    pub fn object(&self, key: &ObjectKey) -> Result<ObjectId, ControlError> {
        let package = self.package();
        let objects = &package.scene.objects;
        match key {
            ObjectKey::Number(object) if (*object as usize) < objects.len() => Ok(ObjectId(*object)),
            ObjectKey::Number(object) => Err(ControlError::NoObject { object: *object, count: objects.len() }),
            ObjectKey::Name(name) => {
                let mut named = (0..).zip(objects).filter(|(_, object)| object.name == *name).map(|(id, _)| id);
                match (named.next(), named.count()) {
                    (None, _) => Err(ControlError::NoObjectNamed { name: name.clone() }),
                    (Some(first), 0) => Ok(ObjectId(first)),
                    (Some(first), more) => Err(ControlError::Ambiguous { name: name.clone(), count: more + 1, first }),
                }
            }
        }
    }

    /// The tile of that name.
    ///
    /// # Errors
    /// When the wall has none.
    pub fn tile(&self, name: &str) -> Result<TileId, ControlError> {
        self.wall.tile_named(name).ok_or_else(|| {
            let known = self.wall.tiles().iter().take(8).map(|tile| tile.name.as_str()).collect::<Vec<_>>().join(", ");
            let more = if self.wall.tiles().len() > 8 { " …" } else { "" };
            ControlError::NoTile { tile: name.chars().take(64).collect(), known: known + more }
        })
    }

    fn change(&self, command: &Command, changes: &mut Vec<Change>) -> Result<(), String> {
        let change = match command {
            Command::Camera(at) => {
                let pose = CameraPose {
                    translation: DVec3::from(at.translation),
                    rotation: DQuat::from_array(at.rotation),
                    scale: at.scale,
                };
                pose.check().map_err(|problem| format!("camera: {problem}"))?;
                Change::Camera(pose.world_from_room())
            }
            Command::FollowPath => Change::FollowPath,
            Command::Eyes(eyes) => Change::Eyes(self.eyes(eyes)?),
            Command::Move(moves) => {
                for to in moves {
                    let transform = DAffine3::from_cols_array(&to.transform).into();
                    let moved = Moved { object: ObjectId(to.object), transform };
                    self.check_move(&moved)?;
                    changes.push(Change::Move(moved));
                }
                return Ok(());
            }
            Command::Remove(it) => Change::Presence(self.known(it.object)?, Presence::Away),
            Command::Add(it) => Change::Presence(self.known(it.object)?, Presence::There),
            Command::Insert(_) => return Err("insert: it stands alone in its request".to_owned()),
            Command::Pause => Change::Pause,
            Command::Resume => Change::Resume,
            Command::Step(steps) if (1..=MAX_STEPS).contains(&steps.frames) => Change::Step(steps.frames),
            Command::Step(steps) => return Err(format!("step: {} frames; 1 to {MAX_STEPS} are allowed", steps.frames)),
            Command::Budget(budget) => {
                let tile = budget.tile.as_deref().map(|name| self.tile(name)).transpose().map_err(|e| format!("budget: {e}"))?;
                Change::Budget(tile, Budget { triangles: budget.triangles, gpu_us: budget.gpu_us })
            }
        };
        changes.push(change);
        Ok(())
    }

    fn eyes(&self, eyes: &[[f64; 3]]) -> Result<Vec<DVec3>, String> {
        if eyes.is_empty() {
            return Ok(self.wall.default_eyes());
        }
        let views = self.wall.views();
        let observers = views.iter().map(|view| usize::from(view.observer.0) + 1).max().unwrap_or(0);
        if eyes.len() != observers {
            return Err(format!("eyes: {}; the wall has {observers} observers, and none stands for its own eyes", eyes.len()));
        }
        for (observer, eye) in eyes.iter().enumerate() {
            let eye = DVec3::from(*eye);
            if !LIMITS.contains(&eye.min_element()) || !LIMITS.contains(&eye.max_element()) || eye.is_nan() {
                return Err(format!("eyes: observer {observer}: a coordinate is outside ±{MAX_TRANSFORM:e} m"));
            }
            self.wall.check_eye(eye).map_err(|problem| format!("eyes: observer {observer}: {problem}"))?;
        }
        Ok(views.iter().map(|view| DVec3::from(eyes[usize::from(view.observer.0)])).collect())
    }

    fn known(&self, object: u32) -> Result<ObjectId, String> {
        self.object(&ObjectKey::Number(object)).map_err(|e| e.to_string())
    }

    fn check_move(&self, moved: &Moved) -> Result<(), String> {
        self.known(moved.object.0)?;
        let numbers = moved.transform.affine().to_cols_array();
        // A number that is not finite is not within the range, either.
        match numbers.iter().position(|number| !LIMITS.contains(number)) {
            None => Ok(()),
            Some(at) => {
                let (object, number) = (moved.object.0, numbers[at]);
                Err(format!("object {object}: number {at} of its transform is {number}, outside ±{MAX_TRANSFORM:e}"))
            }
        }
    }
}
