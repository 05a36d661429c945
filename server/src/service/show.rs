//! What a show is made of, and how it runs.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use mullion_common::scene::{Package, PackageError, SectionKind};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::Wall;
use mullion_common::wire::{Bye, Detail, DetailWeight, MAX_TILE_SECTION_BYTES, Shown};
use thiserror::Error;
use tokio::sync::watch;

use super::{Connector, FrameReport, NodeEvent, Pose, Security, Succession};
use crate::library::Library;
use crate::master::WallBudget;
use crate::swap_barrier::NodeIndex;

/// What the bounded wait gives beyond a frame's time, for the way there and back.
pub const BARRIER_GRACE: Duration = Duration::from_millis(4);

/// Frames a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// As many as the nodes can show.
    AsFastAsPossible,
    /// So many, evenly; more than 0.
    Hz(f64),
}

/// What a wall may spend on a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShowBudget {
    /// So many triangles, more than 0.
    Triangles(u32),
    /// So many percent of the scene's triangles: more than 0, at most 100.
    Percent(f64),
    /// As many triangles as the slowest node draws in so many microseconds, more than 0.
    TimeUs(u32),
}

impl ShowBudget {
    fn check(self) -> Result<(), ServiceError> {
        match self {
            Self::Triangles(0) => Err(ServiceError::Budget("0 triangles; there must be more".to_owned())),
            Self::TimeUs(0) => Err(ServiceError::Budget("0 µs; there must be more".to_owned())),
            Self::Percent(percent) if !(percent > 0.0 && percent <= 100.0) => {
                Err(ServiceError::Budget(format!("{percent} %; it must be more than 0, and at most 100")))
            }
            Self::Triangles(_) | Self::TimeUs(_) | Self::Percent(_) => Ok(()),
        }
    }

    /// Of a scene with so many triangles.
    pub(super) fn of(self, scene_triangles: u32) -> WallBudget {
        match self {
            Self::Triangles(triangles) => WallBudget::Triangles(triangles),
            Self::Percent(percent) => WallBudget::Triangles((f64::from(scene_triangles) * percent / 100.0).max(1.0) as u32),
            Self::TimeUs(time_us) => WallBudget::TimeUs(time_us),
        }
    }
}

fn check_detail(detail: Detail) -> Result<(), ServiceError> {
    match detail {
        _ if !detail.is_valid() => Err(ServiceError::Detail(format!("{} pixels; it must be 0 or more", detail.least_pixels))),
        Detail { triangles: Some(0), .. } => Err(ServiceError::Detail("0 triangles; there must be more".to_owned())),
        Detail { triangles: None, least_pixels: 0.0, .. } => {
            Err(ServiceError::Detail("0 pixels and any number of triangles; that is all there is".to_owned()))
        }
        Detail { triangles, hides, weight, .. } if weight != DetailWeight::None && !(hides && triangles.is_some()) => {
            let problem = format!("weight {weight}; it needs a number of triangles, and what hides others");
            Err(ServiceError::Detail(problem))
        }
        _ => Ok(()),
    }
}

/// How a show runs.
#[derive(Clone, Debug)]
pub struct ShowOptions {
    /// How connections are secured.
    pub security: Security,
    /// Longest wait for live nodes, from the moment a frame began.
    pub barrier_wait: Duration,
    /// Longest wait of the first frame for the nodes of `start_nodes`.
    pub start_wait: Duration,
    /// Nodes that the first frame waits for.
    pub start_nodes: Vec<NodeIndex>,
    /// How many frames; `None`: until it is stopped.
    pub frames: Option<u64>,
    /// How many a second.
    pub rate: Rate,
    /// Host and port of a master to stand by for: the show begins when that one is gone.
    pub standby_of: Option<String>,
    /// How that one is reached.
    pub connector: Connector,
    /// What contributes less to the wall's picture than this share of its pixels, weighted by distance, is drawn on no tile: more than 0, at
    /// most 1. `None`: all that is seen is drawn.
    pub adaptive: Option<f64>,
    /// What the wall may spend on a frame's estimate of what is visible, for packages with a tessellation. `None`: all that is seen is drawn.
    pub budget: Option<ShowBudget>,
    /// Whether all that is seen is drawn when the camera rests, whatever the budget.
    pub completes: bool,
    /// How finely objects with hierarchies of detail are drawn, for packages that have some: triangles more than 0, or pixels. `None`: all
    /// of their triangles are.
    pub detail: Option<Detail>,
    /// Packages that other masters may insert: a standby must have what its master's scene grows by.
    pub insert_from: Option<Library>,
    /// Makes session numbers unguessable; `None`: random bytes, fresh for each run. Fixed ones let a simulation be run again.
    pub session_seed: Option<[u8; 32]>,
    /// Tells whoever steers the show when this master stands by, and what it goes on from.
    pub succession: Succession,
}

impl ShowOptions {
    /// For a wall: its rate, a wait of one frame and a grace, no start gate, no end.
    pub fn for_wall(wall: &Wall) -> Self {
        Self {
            security: Security::Plain,
            barrier_wait: Duration::from_secs_f64(1.0 / wall.rate_hz()) + BARRIER_GRACE,
            start_wait: Duration::ZERO,
            start_nodes: Vec::new(),
            frames: None,
            rate: Rate::Hz(wall.rate_hz()),
            standby_of: None,
            connector: Connector::default(),
            adaptive: None,
            budget: None,
            completes: true,
            detail: None,
            insert_from: None,
            session_seed: None,
            succession: Succession::default(),
        }
    }

    /// With a first frame that waits so long for every node of the wall.
    pub fn starting_together(mut self, wall: &Wall, wait: Duration) -> Self {
        self.start_nodes = (0..wall.nodes().len() as u16).map(NodeIndex).collect();
        self.start_wait = wait;
        self
    }
}

impl Show {
    /// Whether its numbers are in their ranges, and its scene is one for them.
    pub(super) fn check(&self) -> Result<(), ServiceError> {
        let ShowOptions { adaptive, budget, detail, .. } = &self.options;
        if let Some(threshold) = adaptive.filter(|threshold| !(*threshold > 0.0 && *threshold <= 1.0)) {
            return Err(ServiceError::Adaptive(threshold));
        }
        budget.map_or(Ok(()), ShowBudget::check)?;
        if budget.is_some() && self.package.scene.tessellation.is_none() {
            return Err(ServiceError::NoTessellation);
        }
        detail.map_or(Ok(()), check_detail)?;
        let is_by_estimate = detail.is_some_and(|detail| detail.weight == DetailWeight::Plp);
        if is_by_estimate && self.package.scene.tessellation.is_none() {
            return Err(ServiceError::NoEstimates);
        }
        if detail.is_none() || !self.package.scene.hierarchies.is_empty() { Ok(()) } else { Err(ServiceError::NoHierarchies) }
    }
}

/// Where everything is in a frame, by its number.
pub type Camera = Box<dyn FnMut(u64) -> Pose + Send>;
/// What every view sees, by `ViewId`. The sets come empty.
pub type Cull = Box<dyn FnMut(&Pose, &mut [VisibleSet]) + Send>;
/// Is told of every frame. Must be quick: the wall waits.
pub type Observer = Box<dyn FnMut(&FrameReport) + Send>;

/// Is told of nodes that come and go. Must be quick: the wall waits.
pub type NodeObserver = Box<dyn FnMut(&NodeEvent) + Send>;

/// Is told when a node showed a frame, as the node says. Must be quick: the wall waits.
pub type ShownObserver = Box<dyn FnMut(NodeIndex, &Shown) + Send>;

/// All that a show needs.
pub struct Show {
    /// The wall.
    pub wall: Arc<Wall>,
    /// The scene.
    pub package: Arc<Package>,
    /// How it runs.
    pub options: ShowOptions,
    /// Where everything is.
    pub camera: Camera,
    /// What is seen.
    pub cull: Cull,
    /// Who is told of frames.
    pub observer: Observer,
    /// Who is told of nodes.
    pub node_observer: NodeObserver,
    /// Who is told when nodes showed what.
    pub shown_observer: ShownObserver,
    /// Turns true when the show is to end.
    pub stop: Option<watch::Receiver<bool>>,
}

/// Why a show could not run.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum ServiceError {
    #[error("scene: {0}")]
    Package(#[from] PackageError),
    #[error(
        "scene: its section {kind:?} has {length} bytes; nodes take at most {MAX_TILE_SECTION_BYTES}: prepare it with fewer, larger leaves"
    )]
    SectionTooLarge { kind: SectionKind, length: u64 },
    #[error(
        "scene: its tessellation has {length} bytes; nodes take at most {MAX_TILE_SECTION_BYTES}: prepare it with a larger --plp-leaf"
    )]
    TessellationTooLarge { length: u64 },
    #[error(
        "scene: the index of its hierarchies has {length} bytes; nodes take at most {MAX_TILE_SECTION_BYTES}: prepare it without --lod"
    )]
    IndexTooLarge { length: u64 },
    #[error("rate: {0} frames a second; it must be more than 0")]
    Rate(f64),
    #[error("adaptive: {0} of the wall; it must be more than 0, and at most 1")]
    Adaptive(f64),
    #[error("budget: {0}")]
    Budget(String),
    #[error("budget: the scene has no tessellation; prepare it with --plp")]
    NoTessellation,
    #[error("detail: {0}")]
    Detail(String),
    #[error("detail: the scene has no hierarchies of detail; prepare it with --lod")]
    NoHierarchies,
    #[error("detail: the scene has no tessellation to weigh objects by; prepare it with --plp")]
    NoEstimates,
    #[error("frame {frame}: {problem}")]
    Pose { frame: u64, problem: String },
    #[error("the master to stand by for refused: {0}")]
    Standby(Bye),
    #[error("network: {0}")]
    Network(#[from] io::Error),
}
