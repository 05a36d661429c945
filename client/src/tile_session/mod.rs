//! A node's side of the protocol: messages and blobs in, actions out. No sockets, no clock, no GPU.
//!
//! ```text
//! Frame(n) → sets by delta → what is missing? → Fetch … blobs → Upload → Draw(n) → drawn → Ready(n) … Swap(n) → Show(n)
//! ```
//! It works on the newest frame: one that came while another was drawn or fetched for takes its place. Whether a frame waits for its
//! chunks is a setting ([`WhenMissing`]); once nothing lacks, chunks that later frames will need are fetched. Chunks stay
//! across frames and, while the scene stays the same, across connections; so does the picture that is shown.

mod assembly;
mod counting;
mod detail;
mod on_the_way;
mod planning;
mod scene;

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use mullion_common::scene::{BlobRef, ChunkHash, ChunkId, ObjectId, PackageError, SceneManifest, Tessellation, Transform};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::ViewId;
use mullion_common::wire::{
    BASE_WINDOW, Budget, Bye, ByeCode, Detail, Estimate, Frame, Hello, MAX_PARTS, MAX_WANTED, Manifest, Moved, Part, Primary,
    SectionRef, Shown, Stats, ToMaster, ToTile, ViewSpec, Welcome,
};

use crate::hierarchies::Hierarchies;
use crate::missing::WhenMissing;
use crate::motion::Motion;
use crate::prefetch::{PREFETCH_WINDOW, Prefetch};
use crate::residency::Residency;

pub use assembly::{Assembly, PieceError};
pub use counting::CountOrder;
use counting::Counting;
use on_the_way::OnTheWay;
use planning::Lack;
use scene::{Announced, Growth, OpenScene, Sections};

/// How often a blob that came damaged is asked for again.
pub const MAX_REFETCHES: u32 = 3;
/// Most blobs on their way at once that a frame needs: few, so that what is needed most does not queue behind what was.
pub const FETCH_WINDOW: usize = 64;
/// Most bytes on their way at once, but for a single larger blob.
pub const FETCH_WINDOW_BYTES: u64 = 8 << 20;
const _: () = assert!(FETCH_WINDOW + PREFETCH_WINDOW <= MAX_WANTED, "the master takes full windows");

/// What one view draws.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewToDraw {
    /// Which view of the wall.
    pub view: ViewId,
    /// Where its eye is, room space, metres.
    pub eye: DVec3,
    /// What it may spend.
    pub budget: Budget,
    /// What it sees; all of it is in the manifest. What the frame drops is not drawn all the same.
    pub leaves: VisibleSet,
    /// Those of them that lack a chunk yet, or the base of the hierarchy that is drawn in the place of their geometry; none where the frame was
    /// to wait for them.
    pub missing: VisibleSet,
}

/// A frame to be drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameToDraw {
    /// Its number.
    pub number: u64,
    /// Which manifest it is of.
    pub epoch: u32,
    /// Time in the scene, seconds.
    pub scene_time_s: f64,
    /// Where the room is in the world.
    pub world_from_room: DAffine3,
    /// The eye that all views share for what must agree across seams, world space.
    pub shared_eye: DVec3,
    /// In the order of the welcome.
    pub views: Vec<ViewToDraw>,
    /// Leaves that no view of the wall draws, though some see them: their objects hardly contribute.
    pub dropped: VisibleSet,
    /// Where the wall looks, from the shared eye; there where an estimate or a detail is ordered.
    pub primary: Option<Primary>,
    /// To which budget an estimate of what is visible is drawn; `None`: all that is seen is drawn.
    pub estimate: Option<Estimate>,
    /// How finely hierarchies are drawn, as far as they have come, in the place of their objects' leaves; `None`: leaves are drawn.
    pub detail: Option<Detail>,
    /// The leaves of objects with hierarchies that are out of the scene, where a detail is ordered.
    pub away: VisibleSet,
    /// What to do with leaves that are missing.
    pub when_missing: WhenMissing,
}

impl FrameToDraw {
    /// Whether another frame has the same picture, as long as no object moves and no chunk comes that this one lacks.
    pub fn shows_the_same(&self, other: &Self) -> bool {
        let Self { number: _, epoch, scene_time_s: _, world_from_room, shared_eye, views, dropped, .. } = self;
        let Self { primary, estimate, detail, away, when_missing, .. } = self;
        (epoch, world_from_room, shared_eye, when_missing)
            == (&other.epoch, &other.world_from_room, &other.shared_eye, &other.when_missing)
            && (views, dropped, away) == (&other.views, &other.dropped, &other.away)
            && (primary, detail) == (&other.primary, &other.detail)
            && match (estimate, &other.estimate) {
                // Whatever they might spend.
                (Some(a), Some(b)) if a.is_complete && b.is_complete => true,
                (a, b) => a == b,
            }
    }
}

/// What drawing a frame took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DrawStats {
    /// Time it took, microseconds.
    pub draw_us: u32,
    /// Leaves drawn, all views together.
    pub leaves: u32,
    /// Triangles drawn, all views together.
    pub triangles: u64,
    /// Whether the wall's budget left something out of the estimate.
    pub is_cut: bool,
}

/// What the shell is to do, in order.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Send it on the control connection.
    Send(ToMaster),
    /// Want these blobs, of these lengths, in this order.
    Fetch(Vec<(ChunkHash, u64)>),
    /// A new scene or new views: forget all chunks.
    OpenScene(Arc<SceneManifest>, Arc<[ViewSpec]>),
    /// The tessellation of the scene that was just opened, which a scene without one lacks. It stays when the scene grows.
    TakeTessellation(Arc<Tessellation>),
    /// The next blob of a hierarchy of detail of the open scene, whose hash is right: the base first. Call [`TileSession::hierarchy_taken`].
    TakeHierarchy {
        /// Which hierarchy.
        number: u32,
        /// The objects that it stands for.
        objects: Arc<[ObjectId]>,
        /// The base, or the block behind those before.
        blob: Vec<u8>,
    },
    /// Forget a hierarchy, of which more does not come: its objects are drawn from their leaves.
    ForgetHierarchy(u32),
    /// The scene has more: what it had keeps its numbers, and chunks stay.
    GrowScene(Arc<SceneManifest>),
    /// Take a chunk's bytes, whose hash is right.
    Upload {
        /// Which chunk.
        chunk: ChunkId,
        /// Its bytes.
        bytes: Vec<u8>,
    },
    /// Forget a chunk: nothing in view needs it, and memory is short.
    Evict(ChunkId),
    /// An object moved.
    SetTransform(Moved),
    /// Draw, keep the picture back, and call [`TileSession::drawn`].
    Draw(Arc<FrameToDraw>),
    /// Count boxes against the picture of the frame that was drawn last, which is shown, and call [`TileSession::counted`].
    Count(Arc<FrameToDraw>, CountOrder),
    /// Show the picture drawn last; [`TileSession::note_shown`] may then be told when that was.
    Show {
        /// Number of its frame.
        frame: u64,
    },
    /// Say goodbye, where it is not the master that said it, and close both connections.
    Close {
        /// Why.
        bye: Bye,
        /// Which side ends it.
        by: EndedBy,
    },
}

/// Which side ended a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum EndedBy {
    Master,
    Node,
}

/// What a node needs before it draws a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Needs {
    /// The scene, and the chunks of all that it sees.
    Scene,
    /// Nothing: it does not draw.
    Nothing,
}

/// The protocol state of a node.
#[derive(Debug)]
pub struct TileSession {
    node: String,
    part: Part,
    credentials: Option<Vec<u8>>,
    needs: Needs,
    memory_bytes: u64,
    when_missing: WhenMissing,
    evicted: Vec<ChunkId>,
    views: Arc<[ViewSpec]>,
    views_changed: bool,
    /// The epochs of this connection that frames may be of: the last frame's, and those that follow.
    announced: VecDeque<Announced>,
    /// The parts of the newest one's scene.
    parts: Vec<[SectionRef; 4]>,
    /// Of the scene that the show began with.
    tessellation: Option<SectionRef>,
    /// The index of its hierarchies of detail.
    index: Option<BlobRef>,
    sections: Option<Sections>,
    scene: Option<OpenScene>,
    growth: Growth,
    on_the_way: OnTheWay,
    damaged: HashMap<ChunkHash, u32>,
    /// Frames that were acknowledged on this connection; the newest last.
    acknowledged: VecDeque<Arc<FrameToDraw>>,
    /// The newest frame, not drawn yet.
    pending: Option<FrameToDraw>,
    /// Moved objects that came before the scene was open.
    moved_early: HashMap<ObjectId, Transform>,
    drawing: Option<Arc<FrameToDraw>>,
    drawn: Option<u64>,
    /// Newer frames came while `drawn` was drawn: whether that one may be shown is heard first, unless so many more frames come before.
    behind: u32,
    /// The frame of this connection that is shown.
    shown: Option<u64>,
    /// When that was, until the master has been told.
    shown_at: Option<Shown>,
    last_stats: DrawStats,
    closed: bool,
    actions: VecDeque<Action>,
    lack: Lack,
    /// Frames a second, as the master says.
    rate_hz: f64,
    motion: Motion,
    counting: Counting,
}

impl TileSession {
    /// A node of that name, not connected yet.
    ///
    /// `memory_bytes`: what chunks may take on the GPU before those that were not needed for longest go. `when_missing`: whether frames wait for chunks.
    pub fn new(node: impl Into<String>, credentials: Option<Vec<u8>>, memory_bytes: u64, when_missing: WhenMissing) -> Self {
        Self {
            node: node.into(),
            part: Part::Own,
            credentials,
            needs: Needs::Scene,
            memory_bytes,
            when_missing,
            evicted: Vec::new(),
            views: Arc::new([]),
            views_changed: true,
            announced: VecDeque::new(),
            parts: Vec::new(),
            tessellation: None,
            index: None,
            sections: None,
            scene: None,
            growth: Growth::default(),
            on_the_way: OnTheWay::default(),
            damaged: HashMap::new(),
            acknowledged: VecDeque::new(),
            pending: None,
            moved_early: HashMap::new(),
            drawing: None,
            behind: 0,
            drawn: None,
            shown: None,
            shown_at: None,
            last_stats: DrawStats::default(),
            closed: true,
            actions: VecDeque::new(),
            lack: Lack::default(),
            rate_hz: 0.0,
            motion: Motion::default(),
            counting: Counting::default(),
        }
    }

    /// A node that takes part in everything but fetches and draws nothing: every frame is to be drawn as soon as it is there. For
    /// loading a master.
    pub fn without_scene(node: impl Into<String>, credentials: Option<Vec<u8>>) -> Self {
        Self { needs: Needs::Nothing, ..Self::new(node, credentials, 0, WhenMissing::Hold) }
    }

    /// The same as a spare, or with a place of its own.
    pub fn taking_part_as(mut self, part: Part) -> Self {
        self.part = part;
        self
    }

    /// The greeting of every connection.
    pub fn hello(&self) -> Hello {
        Hello { node: self.node.clone(), part: self.part, credentials: self.credentials.clone(), cached: Vec::new() }
    }

    /// A connection is there and the greeting is sent.
    pub fn connected(&mut self) {
        self.closed = false;
    }

    /// Both connections are gone. Chunks and the shown picture stay.
    pub fn disconnected(&mut self) {
        self.closed = true;
        // What the painter holds must stay what this session believes it holds.
        use Action as A;
        let is_kept = |action: &A| {
            matches!(action, A::OpenScene(..) | A::TakeTessellation(_) | A::GrowScene(_))
                || matches!(action, A::TakeHierarchy { .. } | A::ForgetHierarchy(_))
                || matches!(action, A::Upload { .. } | A::Evict(_) | A::SetTransform(_))
        };
        self.actions.retain(is_kept);
        self.forget_growth();
        self.pending = None;
        self.lack.frame = None;
        self.drawing = None;
        (self.drawn, self.behind) = (None, 0);
        (self.shown, self.shown_at) = (None, None); // another master may count its frames anew
        self.acknowledged.clear();
        self.damaged.clear();
        self.on_the_way.clear();
        self.motion = Motion::default();
        self.counting.begin_anew();
        if let Some(scene) = &mut self.scene {
            scene.prefetch.forget_asked();
            scene.hierarchies.forget_asked();
        }
    }

    /// A message came in.
    pub fn handle_message(&mut self, message: ToTile) {
        if self.closed {
            return;
        }
        let result = match message {
            ToTile::Welcome(welcome) => {
                self.take_welcome(welcome);
                Ok(())
            }
            ToTile::Manifest(manifest) => self.take_manifest(&manifest),
            ToTile::Frame(frame) => self.take_frame(frame),
            ToTile::Swap { frame } => {
                if self.drawn == Some(frame) && self.shown != Some(frame) {
                    (self.shown, self.behind) = (Some(frame), 0);
                    self.actions.push_back(Action::Show { frame });
                    self.order_counts(frame);
                }
                Ok(())
            }
            ToTile::Alive | ToTile::Pong(_) => Ok(()), // clocks are the shell's
            ToTile::Bye(bye) => {
                self.close(bye, EndedBy::Master);
                Ok(())
            }
        };
        if let Err(reason) = result {
            self.fail(reason);
        }
    }

    /// A blob came in whole.
    pub fn handle_blob(&mut self, hash: ChunkHash, bytes: Vec<u8>) {
        let Some((length, purpose)) = self.on_the_way.remove(&hash).filter(|_| !self.closed) else { return };
        if ChunkHash::of(&bytes) != hash {
            return self.take_damaged(hash, length, purpose);
        }
        if self.take_section(hash, &bytes) {
            self.plan();
        } else {
            self.take_hierarchies(hash, &bytes);
            self.take_chunk(hash, bytes);
            self.fetch_missing();
        }
    }

    /// The master says that it has no such blob.
    pub fn handle_absent(&mut self, hash: ChunkHash) {
        self.fail(format!("the master has no blob {hash}, though its manifest names it"));
    }

    /// The frame of the last [`Action::Draw`] is drawn.
    pub fn drawn(&mut self, frame: u64, stats: DrawStats) {
        if self.drawing.as_ref().is_none_or(|drawing| drawing.number != frame) {
            return; // of a connection that is gone
        }
        if let Some(drawing) = self.drawing.take() {
            if self.acknowledged.len() == BASE_WINDOW {
                self.acknowledged.pop_front();
            }
            self.acknowledged.push_back(drawing);
        }
        self.drawn = Some(frame);
        self.behind = u32::from(self.pending.is_some());
        self.last_stats = stats;
        let shown = self.shown_at.take();
        self.actions.push_back(Action::Send(ToMaster::Ready { frame, draw_us: stats.draw_us, is_cut: stats.is_cut, shown }));
        self.plan();
    }

    /// As [`Self::drawn`], where so many newer frames came in meanwhile that the session has not been given yet.
    pub fn drawn_behind(&mut self, frame: u64, stats: DrawStats, newer: u32) {
        self.drawn(frame, stats);
        if newer > 0 && self.drawn == Some(frame) {
            self.behind = newer + 1;
        }
    }

    /// A frame was shown when the master's clock showed `at_us`, microseconds.
    pub fn note_shown(&mut self, frame: u64, at_us: u64) {
        self.shown_at = Some(Shown { frame, at_us }).filter(|_| self.shown == Some(frame));
    }

    /// What to do next, until there is nothing. Events that come before it is asked may replace the frame to draw.
    pub fn poll_action(&mut self) -> Option<Action> {
        if self.actions.is_empty() && std::mem::take(&mut self.lack.is_outdated) {
            self.plan();
        }
        self.actions.pop_front().or_else(|| self.next_draw())
    }

    /// The painter has taken a chunk, which takes so many bytes there.
    pub fn uploaded(&mut self, chunk: ChunkId, bytes: u64) {
        if let Some(scene) = self.scene.as_mut().filter(|scene| scene.residency.is_resident(chunk)) {
            scene.residency.loaded(chunk, bytes);
        }
    }

    /// What goes to the master every second.
    pub fn stats(&self) -> Stats {
        Stats {
            frame: self.drawn.unwrap_or(0),
            draw_us: self.last_stats.draw_us,
            leaves: self.last_stats.leaves,
            triangles: self.last_stats.triangles,
            resident_bytes: self.scene.as_ref().map_or(0, |s| s.residency.resident_bytes()),
        }
    }

    fn close(&mut self, bye: Bye, by: EndedBy) {
        if !self.closed {
            self.closed = true;
            self.actions.push_back(Action::Close { bye, by });
        }
    }

    fn fail(&mut self, reason: impl Into<String>) {
        self.close(Bye::new(ByeCode::Malformed, reason), EndedBy::Node);
    }

    fn take_welcome(&mut self, welcome: Welcome) {
        self.rate_hz = welcome.rate_hz;
        self.counting.every = welcome.count_every;
        if *self.views != *welcome.views {
            self.views = welcome.views.into();
            self.views_changed = true;
        }
    }

    fn take_frame(&mut self, frame: Frame) -> Result<(), String> {
        let epoch = self.announced.front().ok_or("a frame came before the manifest")?.epoch;
        let Some(place) = self.announced.iter().position(|announced| announced.epoch == frame.epoch) else {
            return Err(format!("frame {} is of epoch {}, the manifest of {epoch}", frame.number, frame.epoch));
        };
        self.announced.drain(..place);
        if frame.views.len() != self.views.len() {
            return Err(format!("frame {} has {} views, the welcome {}", frame.number, frame.views.len(), self.views.len()));
        }
        let base = match frame.base {
            None => None,
            Some(number) => {
                let known = self.acknowledged.iter().find(|f| f.number == number);
                Some(known.ok_or_else(|| format!("frame {} stands on frame {number}, which is not here", frame.number))?)
            }
        };
        let nothing = VisibleSet::default();
        let mut scratch = VisibleSet::default();
        let views = frame.views.iter().zip(self.views.iter()).enumerate().map(|(i, (view, spec))| {
            let mut leaves = VisibleSet::default();
            view.leaves.apply(base.map_or(&nothing, |base| &base.views[i].leaves), &mut scratch, &mut leaves);
            if leaves.digest() != view.digest {
                return Err(format!("frame {}: what view {} sees is not what the master says", frame.number, spec.view.0));
            }
            Ok(ViewToDraw { view: spec.view, eye: view.eye, budget: view.budget, leaves, missing: VisibleSet::default() })
        });
        let views = views.collect::<Result<_, String>>()?;
        let mut dropped = VisibleSet::default();
        frame.dropped.apply(base.map_or(&nothing, |base| &base.dropped), &mut scratch, &mut dropped);
        if dropped.digest() != frame.dropped_digest {
            return Err(format!("frame {}: what is dropped is not what the master says", frame.number));
        }
        let Frame { number, epoch, scene_time_s, world_from_room, shared_eye, primary, estimate, detail, away, .. } = frame;
        let when_missing = self.when_missing;
        self.behind = self.behind.saturating_sub(1);
        self.pending = Some(FrameToDraw {
            number,
            epoch,
            scene_time_s,
            world_from_room,
            shared_eye,
            views,
            dropped,
            primary: primary.map(|primary| *primary),
            estimate,
            detail,
            away,
            when_missing,
        });
        self.moved_early.extend(frame.moved.iter().map(|m| (m.object, m.transform)));
        self.plan();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
