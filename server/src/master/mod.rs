//! The master: who is connected, what each node is sent, and when a frame is shown.
//!
//! A state machine without sockets or a clock: `handle_*` take events and the time since any fixed start, `poll_output`
//! gives what is to be done, `next_timeout` says when to call [`Master::handle_timeout`] at the latest. What a peer does
//! wrong ends that peer's connection, with a code and a reason, and nothing else.
//!
//! ```text
//! WantFrame(n) → begin_frame(n) → Send(Frame) to every node … Ready(n) … → Send(Swap), FrameReleased(n) → WantFrame(n+1)
//! ```

mod adaptive;
mod admission;
mod away;
mod epochs;
mod estimates;
mod history;
mod interface;
mod last_words;
mod object_leaves;
mod outbox;
mod rivals;
mod sessions;
mod spares;
mod standbys;
mod standing;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use glam::DVec3;
use mullion_common::identity::Bearer;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{ViewId, Wall};
use mullion_common::wire::{
    ALIVE_EVERY, Bye, ByeCode, Course, Detail, Frame, Hello, MAX_PRIMARY_PLANES, OPENING_LIMIT, Opening, PROTOCOL_VERSION, Part,
    Pong, Primary, SILENCE_LIMIT, Stats, ToMaster, ToTile, ViewSpec, Welcome, WireError,
};

use crate::swap_barrier::{NodeIndex, ShowNow, SwapBarrier};
use adaptive::Contributions;
pub use adaptive::{Adaptive, COUNT_EVERY, COUNT_HOLDS_FRAMES, DROPS_BELOW, ENTERING_FRAMES, MAX_DROPPED_OBJECTS};
pub use admission::Admission;
use admission::Claim;
use away::Away;
pub use away::HierarchyLeaves;
use epochs::NextEpoch;
pub use epochs::{EPOCH_WAIT, EpochError};
use estimates::Estimates;
pub use estimates::{COMPLETE_WAIT, EstimateOptions, LATE_ANSWERS, REST_FRAMES, Spent, WallBudget};
use history::History;
pub use interface::{FrameInput, FrameReleased, Hierarchies, MasterOptions, Output, Pace, Stage};
pub(crate) use last_words::LastWords;
pub use object_leaves::ObjectLeaves;
pub use outbox::{Full, Kind, MAX_QUEUED, MAX_WAITING, Message, Outbox};
use rivals::Pulse;
pub use spares::SPARE_AFTER;
use spares::Spare;
use standbys::Standby;
pub use standbys::{MAX_STANDBYS, TELL_STANDBYS_EVERY};

/// Most connections that have not said yet who they are, beside one for each node of the wall.
pub const MAX_UNNAMED: usize = 64;
/// How long a node must have said nothing before a new connection may take its name.
pub const TAKEOVER_AFTER: Duration = Duration::from_secs(3);
/// Most message buffers kept for reuse.
const MAX_POOLED: usize = 64;

/// A connection's number; never used twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PeerId(pub u64);

#[derive(Clone, Debug, PartialEq, Eq)]
enum Peer {
    /// With whom its certificate is for.
    Unnamed {
        deadline: Duration,
        identity: Option<Bearer>,
    },
    Node(NodeIndex),
    Chunks(NodeIndex),
    /// Waits for a place.
    Spare,
    Standby,
}

/// Who has a node's place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Holder {
    Own,
    Spare,
}

#[derive(Debug)]
struct NodeState {
    name: String,
    views: Vec<ViewId>,
    connection: Option<Connection>,
    /// When it was last heard of, or the show began.
    absent_since: Duration,
    /// Bytes of its last frame message.
    frame_bytes: u32,
    passed_over: u64,
    stats: Stats,
}

#[derive(Debug)]
struct Connection {
    peer: PeerId,
    holder: Holder,
    /// Whom its certificate is for.
    identity: Option<Bearer>,
    chunk_peer: Option<PeerId>,
    session: u64,
    heard: Duration,
    said: Duration,
    acked: Option<u64>,
    /// The newest epoch whose scene it holds, or which it was greeted with.
    prepared: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Idle { due: Duration },
    Wanted,
    Running,
    Over,
}

/// The master.
#[derive(Debug)]
pub struct Master {
    wall: Arc<Wall>,
    options: MasterOptions,
    admission: Admission,
    epoch: u32,
    next_epoch: Option<NextEpoch>,
    peers: BTreeMap<PeerId, Peer>,
    nodes: Vec<NodeState>,
    spares: Vec<Spare>,
    standbys: Vec<Standby>,
    barrier: SwapBarrier,
    history: History,
    contributions: Option<Contributions>,
    estimates: Option<Estimates>,
    /// Where there are hierarchies, and something is drawn by them.
    away: Option<Away>,
    /// Of the newest frame, where anything is ordered by it.
    primary: Primary,
    phase: Phase,
    pulse: Pulse,
    /// When the newest frame was due.
    beat: Duration,
    next_frame: u64,
    sessions: u64,
    outputs: VecDeque<Output>,
    pool: Vec<Vec<u8>>,
    scratch: Frame,
    course: Course,
}

impl Master {
    /// A master whose first frame is due at `now`.
    pub fn new(wall: Arc<Wall>, options: MasterOptions, now: Duration) -> Self {
        let node_of = |node: &mullion_common::wall::Node| NodeState {
            name: node.name.clone(),
            views: node.tiles.iter().flat_map(|tile| wall.views_of(*tile)).collect(),
            connection: None,
            absent_since: now,
            frame_bytes: 0,
            passed_over: 0,
            stats: Stats::default(),
        };
        let nodes: Vec<NodeState> = wall.nodes().iter().map(node_of).collect();
        Self {
            barrier: SwapBarrier::new(nodes.len(), options.barrier.clone()),
            estimates: options.estimates.clone().map(|estimates| Estimates::new(estimates, nodes.len())),
            contributions: options.adaptive.clone().map(|adaptive| Contributions::new(&wall, adaptive)),
            away: options.detail.and(options.hierarchies.as_ref()).map(|hierarchies| Away::new(Arc::clone(&hierarchies.leaves))),
            primary: Primary::default(),
            wall,
            admission: Admission::default(),
            epoch: 1 + options.insertions.len() as u32,
            next_epoch: None,
            peers: BTreeMap::new(),
            nodes,
            spares: Vec::new(),
            standbys: Vec::new(),
            history: History::default(),
            phase: Phase::Idle { due: now },
            pulse: Pulse::new(now),
            beat: now,
            next_frame: options.first_frame,
            sessions: 0,
            outputs: VecDeque::new(),
            pool: Vec::new(),
            scratch: Frame::default(),
            course: Course::default(),
            options,
        }
    }

    /// A connection came in.
    pub fn handle_connected(&mut self, peer: PeerId, now: Duration) {
        let unnamed = self.peers.values().filter(|p| matches!(p, Peer::Unnamed { .. })).count();
        self.peers.insert(peer, Peer::Unnamed { deadline: now + OPENING_LIMIT, identity: None });
        if self.phase == Phase::Over {
            self.dismiss(peer, Bye::new(ByeCode::EndOfShow, "the show is over"));
        } else if unnamed >= MAX_UNNAMED + self.nodes.len() {
            // A wall that is switched on greets from all its nodes at once.
            self.dismiss(peer, Bye::new(ByeCode::TooMany, format!("{unnamed} connections have not said who they are")));
        }
    }

    /// A message's body came in.
    pub fn handle_body(&mut self, peer: PeerId, body: &[u8], now: Duration) {
        let result = match self.peers.get(&peer) {
            Some(Peer::Unnamed { .. }) => Opening::decode(body).map(|opening| self.handle_opening(peer, opening, now)),
            Some(Peer::Node(_) | Peer::Spare | Peer::Standby) => {
                ToMaster::decode(body).map(|message| self.handle_message(peer, message, now))
            }
            Some(Peer::Chunks(_)) | None => Ok(()),
        };
        if let Err(error) = result {
            self.handle_fault(peer, &error, now);
        }
    }

    /// What came in is no message.
    pub fn handle_fault(&mut self, peer: PeerId, error: &WireError, now: Duration) {
        let bye = match error {
            WireError::Version { theirs } => Bye::new(
                ByeCode::VersionMismatch,
                format!(
                    "the master speaks protocol version {PROTOCOL_VERSION}, the node version {theirs}: install the same release on both"
                ),
            ),
            other => Bye::for_error(other),
        };
        self.dismiss(peer, bye);
        self.advance(now);
    }

    /// The first message of a connection came in.
    pub fn handle_opening(&mut self, peer: PeerId, opening: Opening, now: Duration) {
        if matches!(self.peers.get(&peer), Some(Peer::Unnamed { .. })) {
            match opening {
                Opening::Control(hello) if hello.part == Part::Spare => self.greet_spare(peer, &hello, now),
                Opening::Control(hello) => self.greet(peer, &hello, now),
                Opening::Standby(hello) => self.greet_standby(peer, &hello, now),
                Opening::Rival(hello) => self.greet_rival(peer, &hello, now),
                Opening::Chunks(hello) => self.open_chunks(peer, hello),
            }
            self.advance(now);
        }
    }

    /// A message of a node, a spare or a standby came in.
    pub fn handle_message(&mut self, peer: PeerId, message: ToMaster, now: Duration) {
        let node = match self.peers.get(&peer) {
            Some(Peer::Node(node)) => *node,
            Some(Peer::Spare) => {
                self.handle_spare(peer, &message, now);
                return self.advance(now);
            }
            Some(Peer::Standby) => return self.handle_standby(peer, message, now),
            Some(Peer::Unnamed { .. } | Peer::Chunks(_)) | None => return,
        };
        let state = &mut self.nodes[usize::from(node.0)];
        let Some(connection) = &mut state.connection else { return };
        connection.heard = now;
        match message {
            ToMaster::Ready { frame, draw_us, is_cut, shown } => match self.barrier.ready(node, frame, now) {
                Some(show_now) => {
                    if let Some(estimates) = &mut self.estimates {
                        estimates.take_ready(node, frame, (draw_us, is_cut), show_now, now);
                    }
                    self.outputs.extend(shown.map(|shown| Output::Shown { node, shown }));
                    connection.acked = connection.acked.max(Some(frame));
                    self.hold_back_unprepared(node);
                    if show_now == ShowNow::Yes {
                        self.send(node, &ToTile::Swap { frame }, Kind::Swap, now);
                    }
                }
                None => {
                    let newest = self.history.newest();
                    let reason = format!("ready with frame {frame}, but the newest is {newest:?}");
                    self.dismiss(peer, Bye::new(ByeCode::Malformed, reason));
                }
            },
            ToMaster::Prepared { epoch } => self.handle_prepared(peer, node, epoch),
            ToMaster::Unprepared { .. } => self.dismiss(peer, Bye::new(ByeCode::Malformed, "a node is no standby")),
            ToMaster::Ping(ping) => {
                let pong = Pong { at_us: ping.at_us, master_us: now.as_micros() as u64 };
                self.send(node, &ToTile::Pong(pong), Kind::Alive, now);
            }
            ToMaster::Stats(stats) => state.stats = stats,
            ToMaster::Counted(counted) => self.handle_counted(peer, node, &counted),
            ToMaster::Bye(bye) => self.drop_peer(peer, bye),
        }
        self.advance(now);
    }

    /// A connection ended.
    pub fn handle_disconnected(&mut self, peer: PeerId, now: Duration) {
        self.forget(peer);
        self.advance(now);
    }

    /// Time has passed.
    pub fn handle_timeout(&mut self, now: Duration) {
        self.pulse.beat(now);
        let late = |p: &Peer| matches!(p, Peer::Unnamed { deadline, .. } if *deadline <= now);
        while let Some(peer) = self.peers.iter().find(|(_, p)| late(p)).map(|(id, _)| *id) {
            let reason = format!("no greeting within {} s", OPENING_LIMIT.as_secs());
            self.dismiss(peer, Bye::new(ByeCode::Timeout, reason));
        }
        for i in 0..self.nodes.len() {
            let node = NodeIndex(i as u16);
            let Some(connection) = &self.nodes[i].connection else { continue };
            if now >= connection.heard + SILENCE_LIMIT {
                let (peer, reason) = (connection.peer, format!("silent for {} s", SILENCE_LIMIT.as_secs()));
                self.dismiss(peer, Bye::new(ByeCode::Timeout, reason));
            } else if now >= connection.said + ALIVE_EVERY {
                self.send(node, &ToTile::Alive, Kind::Alive, now);
            }
        }
        self.mind_spares(now);
        self.mind_standbys(now);
        self.advance(now);
    }

    /// When [`Master::handle_timeout`] has something to do.
    pub fn next_timeout(&self) -> Option<Duration> {
        let unnamed = self.peers.values().filter_map(|p| match p {
            Peer::Unnamed { deadline, .. } => Some(*deadline),
            _ => None,
        });
        let connected = self.nodes.iter().filter_map(|n| n.connection.as_ref());
        let connected = connected.map(|c| (c.heard + SILENCE_LIMIT).min(c.said + ALIVE_EVERY));
        let beat = match self.phase {
            Phase::Idle { due } => Some(due),
            Phase::Running => self.barrier.deadline(),
            Phase::Wanted | Phase::Over => None,
        };
        unnamed.chain(connected).chain(beat).chain(self.spares_timeout()).chain(self.standbys_timeout()).min()
    }

    /// Begins the frame that was wanted, and sends it to every node. `is_done` is called whenever part of a stage is done, for those
    /// who have a clock.
    ///
    /// # Panics
    /// When the number is not the one wanted, or eyes and sets are not one for each view: the shell is wrong.
    pub fn begin_frame(&mut self, input: &FrameInput<'_>, now: Duration, is_done: &mut dyn FnMut(Stage)) {
        assert!(self.phase == Phase::Wanted && input.number == self.next_frame, "frame {} is not wanted", input.number);
        assert_eq!(input.sets.len(), self.wall.views().len(), "a set for each view");
        assert_eq!(input.eyes.len(), self.wall.views().len(), "an eye for each view");
        if let Some(contributions) = &mut self.contributions {
            contributions.decide(input.number, input.eyes, input.sets);
        }
        if let Some(estimates) = &mut self.estimates {
            estimates.begin(input.number, self.history.is_as_before(input), now);
        }
        if let Some(away) = &mut self.away {
            away.note(input.presence);
        }
        if self.estimates.is_some() || self.away.is_some() {
            self.look(input);
        }
        let nothing = VisibleSet::default();
        self.history.push(input, self.contributions.as_ref().map_or(&nothing, Contributions::dropped));
        self.next_frame += 1;
        self.phase = Phase::Running;
        let patience = self.estimates.as_ref().map_or(Duration::ZERO, Estimates::patience);
        self.barrier.begin_patiently(input.number, patience, now);
        for node in 0..self.nodes.len() as u16 {
            self.send_frame(NodeIndex(node), now, is_done);
        }
        self.send_courses(now);
        is_done(Stage::Encode);
        self.advance(now);
    }

    /// Notes where the wall looks in a frame.
    fn look(&mut self, input: &FrameInput<'_>) {
        let middle = input.eyes.iter().sum::<DVec3>() / input.eyes.len().max(1) as f64;
        let pixels_per_radian = self.wall.pixels_per_radian(middle) as f32;
        self.primary.pixels_per_radian = pixels_per_radian.clamp(f32::MIN_POSITIVE, f32::MAX);
        self.primary.planes.clear();
        self.primary.planes.extend(input.primary.iter().take(MAX_PRIMARY_PLANES)); // fewer hold more
    }

    /// How finely hierarchies of detail are drawn, and which of their leaves are away. Nothing where there are none, and where too much is away to be
    /// named: then leaves are drawn.
    fn detail(&self) -> Option<(Detail, &VisibleSet)> {
        self.options.detail.zip(self.away.as_ref().and_then(Away::set))
    }

    /// Ends the show early. [`Output::Finished`] follows.
    pub fn handle_shutdown(&mut self, bye: &Bye) {
        if self.phase == Phase::Over {
            return;
        }
        self.phase = Phase::Over;
        while let Some(peer) = self.peers.keys().next().copied() {
            self.dismiss(peer, bye.clone());
        }
        self.outputs.push_back(Output::Finished);
    }

    /// Where the show stands, as a standby that knows nothing is told it; `None` before the first frame.
    pub fn course(&self) -> Option<Course> {
        let mut course = Course::default();
        self.history.course(None, self.epoch, &mut course).then_some(course)
    }

    /// What to do next, until there is nothing.
    pub fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    /// Takes back a message's memory.
    pub fn recycle(&mut self, buffer: Vec<u8>) {
        if self.pool.len() < MAX_POOLED {
            self.pool.push(buffer);
        }
    }

    fn greet(&mut self, peer: PeerId, hello: &Hello, now: Duration) {
        if let Err(bye) = self.admit(peer, Claim::Node(&hello.node)) {
            return self.dismiss(peer, bye);
        }
        let Some(index) = self.nodes.iter().position(|n| n.name == hello.node) else {
            let known = self.nodes.iter().take(8).map(|n| n.name.as_str()).collect::<Vec<_>>().join(", ");
            let more = if self.nodes.len() > 8 { " …" } else { "" };
            let reason = format!("the wall has no node {:?}; it has {known}{more}", hello.node);
            return self.dismiss(peer, Bye::new(ByeCode::UnknownNode, reason));
        };
        if let Some(old) = &self.nodes[index].connection {
            let (old_peer, silent) = (old.peer, now.saturating_sub(old.heard));
            if old.holder == Holder::Own && silent < TAKEOVER_AFTER {
                let reason = format!("node {:?} is connected and alive", hello.node);
                return self.dismiss(peer, Bye::new(ByeCode::AlreadyConnected, reason));
            }
            let bye = match old.holder {
                Holder::Own => Bye::new(ByeCode::Timeout, "silent, and another connection took its name"),
                Holder::Spare => Bye::new(ByeCode::Leaving, format!("node {:?} is back", hello.node)),
            };
            self.dismiss(old_peer, bye);
        }
        let identity = self.shown_by(peer).cloned();
        self.seat((peer, identity), NodeIndex(index as u16), Holder::Own, now);
    }

    /// Gives a node's place to a connection, with what it has shown.
    fn seat(&mut self, (peer, identity): (PeerId, Option<Bearer>), node: NodeIndex, holder: Holder, now: Duration) {
        let index = usize::from(node.0);
        let session = self.new_session();
        self.peers.insert(peer, Peer::Node(node));
        let (heard, said, prepared) = (now, now, self.epoch);
        let connection = Connection { peer, holder, identity, chunk_peer: None, session, heard, said, acked: None, prepared };
        self.nodes[index].connection = Some(connection);
        self.barrier.join(node);
        if let Some(contributions) = &mut self.contributions {
            contributions.join(&self.nodes[index].views, self.next_frame);
        }
        if let Some(estimates) = &mut self.estimates {
            estimates.join(node);
        }
        let welcome = Welcome {
            version: PROTOCOL_VERSION,
            session,
            node: self.nodes[index].name.clone(),
            views: self.nodes[index].views.iter().map(|view| ViewSpec::of(&self.wall, *view)).collect(),
            rate_hz: self.wall.rate_hz(),
            next_frame: self.next_frame,
            count_every: if self.contributions.is_some() { COUNT_EVERY } else { 0 },
        };
        self.send(node, &ToTile::Welcome(welcome), Kind::Control, now);
        self.send_manifests(node, now);
        self.send_frame(node, now, &mut |_| {});
    }

    /// Releases the frame that may be released, wants the one that is due.
    fn advance(&mut self, now: Duration) {
        if self.phase == Phase::Running
            && let Some(release) = self.barrier.poll(now)
        {
            let mut shown_by = 0;
            for node in (0..self.nodes.len() as u16).map(NodeIndex) {
                if self.barrier.is_ready(node) {
                    shown_by += 1;
                    self.send(node, &ToTile::Swap { frame: release.number }, Kind::Swap, now);
                }
            }
            for node in &release.passed_over {
                self.nodes[usize::from(node.0)].passed_over += 1;
            }
            let (number, waited, passed_over) = (release.number, release.waited, release.passed_over);
            let spent = self.estimates.as_mut().map(|estimates| estimates.release(&passed_over));
            let due = self.beat;
            self.outputs.push_back(Output::FrameReleased(FrameReleased { number, due, waited, passed_over, shown_by, spent }));
            let due = match self.options.pace {
                Pace::AsFastAsPossible => now,
                Pace::Every(period) => (self.beat + period).max(now),
            };
            self.phase = Phase::Idle { due };
            if self.options.frames.is_some_and(|frames| self.next_frame >= frames) {
                self.handle_shutdown(&Bye::new(ByeCode::EndOfShow, "the show is over"));
            }
        }
        if let Phase::Idle { due } = self.phase
            && due <= now
        {
            self.phase = Phase::Wanted;
            // A shell that comes a little late does not shift the beat; one that comes a beat late does.
            self.beat = match self.options.pace {
                Pace::Every(period) if now < due + period => due,
                _ => now,
            };
            self.outputs.push_back(Output::WantFrame { number: self.next_frame });
        }
    }

    fn send_frame(&mut self, node: NodeIndex, now: Duration, is_done: &mut dyn FnMut(Stage)) {
        if self.history.newest().is_none() {
            return;
        }
        let state = &self.nodes[usize::from(node.0)];
        let Some(connection) = &state.connection else { return };
        let mut frame = std::mem::take(&mut self.scratch);
        self.history.write(&state.views, connection.acked, self.epoch, &mut frame);
        frame.estimate = self.estimates.as_ref().map(Estimates::order);
        frame.away.clear();
        frame.detail = None;
        if let Some((detail, away)) = self.detail() {
            frame.away.clone_from(away);
            frame.detail = Some(detail);
        }
        if frame.estimate.is_some() || frame.detail.is_some() {
            frame.primary.get_or_insert_default().as_mut().clone_from(&self.primary);
        } else {
            frame.primary = None;
        }
        is_done(Stage::Diff);
        let mut bytes = self.pool.pop().unwrap_or_default();
        let result = frame.encode(&mut bytes);
        self.scratch = frame;
        is_done(Stage::Encode);
        self.nodes[usize::from(node.0)].frame_bytes = bytes.len() as u32;
        self.send_encoded(node, result, Message { kind: Kind::Frame, bytes }, now);
    }

    fn send(&mut self, node: NodeIndex, message: &ToTile, kind: Kind, now: Duration) {
        let mut bytes = self.pool.pop().unwrap_or_default();
        let result = message.encode(&mut bytes);
        self.send_encoded(node, result, Message { kind, bytes }, now);
    }

    fn send_encoded(&mut self, node: NodeIndex, result: Result<(), WireError>, message: Message, now: Duration) {
        let Some(connection) = &mut self.nodes[usize::from(node.0)].connection else { return };
        let peer = connection.peer;
        match result {
            Ok(()) => {
                connection.said = now;
                self.outputs.push_back(Output::Send { peer, message });
            }
            Err(error) => self.dismiss(peer, Bye::new(ByeCode::Failed, format!("cannot send: {error}"))),
        }
    }

    /// Says goodbye and closes.
    fn dismiss(&mut self, peer: PeerId, bye: Bye) {
        if !self.peers.contains_key(&peer) {
            return;
        }
        let mut bytes = self.pool.pop().unwrap_or_default();
        // A chunk connection gets its goodbye as a `ChunkReply`, which has the same bytes.
        if ToTile::Bye(bye.clone()).encode(&mut bytes).is_ok() {
            self.outputs.push_back(Output::Send { peer, message: Message { kind: Kind::Bye, bytes } });
        }
        self.drop_peer(peer, bye);
    }

    fn drop_peer(&mut self, peer: PeerId, bye: Bye) {
        self.forget(peer);
        self.outputs.push_back(Output::Close { peer, bye });
    }

    /// Takes a connection off the books, and what hangs on it.
    fn forget(&mut self, peer: PeerId) {
        match self.peers.remove(&peer) {
            Some(Peer::Node(node)) => {
                let state = &mut self.nodes[usize::from(node.0)];
                state.frame_bytes = 0;
                let connection = state.connection.take();
                state.absent_since = connection.as_ref().map_or(state.absent_since, |c| c.heard);
                let chunk_peer = connection.and_then(|c| c.chunk_peer);
                self.barrier.leave(node);
                if let Some(contributions) = &mut self.contributions {
                    contributions.leave(&state.views);
                }
                if let Some(chunks) = chunk_peer.filter(|c| self.peers.remove(c).is_some()) {
                    let bye = Bye::new(ByeCode::Leaving, "the node's control connection ended");
                    self.outputs.push_back(Output::Close { peer: chunks, bye });
                }
            }
            Some(Peer::Chunks(node)) => {
                if let Some(connection) = &mut self.nodes[usize::from(node.0)].connection {
                    connection.chunk_peer = connection.chunk_peer.filter(|c| *c != peer);
                }
            }
            Some(Peer::Spare) => self.forget_spare(peer),
            Some(Peer::Standby) => self.forget_standby(peer),
            Some(Peer::Unnamed { .. }) | None => {}
        }
    }
}
