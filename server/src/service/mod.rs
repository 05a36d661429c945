//! The shell around a [`Master`]: sockets, timers, and the show that it runs.
//!
//! One loop owns the master; every connection has a task that reads, writes and serves chunks. Nothing between them is
//! unbounded: events wait in a channel that holds readers back, messages in an [`crate::master::Outbox`].

mod blobs;
mod complaints;
mod connection;
mod grown;
mod growth;
mod mailbox;
mod network;
mod pose;
mod report;
mod rival;
mod scenes;
mod show;
mod standby;
mod succession;
mod transport;

use std::collections::BTreeMap;
use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

use mullion_common::visible_set::VisibleSet;
use mullion_common::wire::{Bye, ByeCode, Course, StandbyHello};
use tokio::net::TcpListener;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::cull::PrimaryFrustum;
use crate::master::{
    Adaptive, Admission, EstimateOptions, FrameInput, FrameReleased, MAX_UNNAMED, Master, MasterOptions, Output, Pace, PeerId,
    Stage,
};
use crate::swap_barrier::{BarrierOptions, NodeIndex};
use blobs::Blobs;
use complaints::Complaints;
use connection::{Connection, Event, Role};
pub use grown::FreshScene;
use grown::Grown;
pub use growth::{Offer, OfferError, Outcome};
use mailbox::{Mailbox, Queued};
pub use network::{Connecting, Connector, Listener, Reader, Socket, Writer};
pub use pose::Pose;
pub use report::{FrameReport, NodeEvent, ShowReport};
use scenes::Scenes;
pub use show::{
    BARRIER_GRACE, Camera, Cull, NodeObserver, Observer, Rate, ServiceError, Show, ShowBudget, ShowOptions, ShownObserver,
};
pub use succession::{Heritage, Succession};
pub use transport::{MasterTls, Security, SecurityError};

/// Events that may wait for the master's loop; beyond, connections are not read.
const MAX_EVENTS: usize = 256;
/// How long connections may take to be told goodbye at the end.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// Runs a show on a thread of its own making: [`serve`] for callers without a runtime.
///
/// # Errors
/// As [`serve`].
pub fn run(listener: std::net::TcpListener, show: Show) -> Result<ShowReport, ServiceError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let report = runtime.block_on(async {
        listener.set_nonblocking(true)?;
        serve(TcpListener::from_std(listener)?, show).await
    });
    runtime.shutdown_background(); // what a standby prepares may take long, and nobody needs it
    report
}

/// Runs a show until its last frame, or until `stop` turns true. Camera and cull are called from the task that awaits
/// this; what peers do never ends it.
///
/// # Errors
/// When the scene's sections for tiles are missing or larger than tiles take, the rate is none, or the camera gives a pose
/// that nodes would leave over: not an eye for each view, a number that is not finite, an object that the scene lacks. The network's faults are the peers' and are logged.
pub async fn serve(listener: TcpListener, show: Show) -> Result<ShowReport, ServiceError> {
    serve_over(listener, show).await
}

/// The same over any network. All time is that of tokio's clock, but for what frames and messages took to make and write.
///
/// # Errors
/// As [`serve`].
pub async fn serve_over(mut listener: impl Listener, mut show: Show) -> Result<ShowReport, ServiceError> {
    let pace = match show.options.rate {
        Rate::AsFastAsPossible => Pace::AsFastAsPossible,
        Rate::Hz(hz) if hz.is_finite() && hz > 0.0 => Pace::Every(Duration::from_secs_f64(1.0 / hz)),
        Rate::Hz(hz) => return Err(ServiceError::Rate(hz)),
    };
    show.check()?;
    let first = Grown::new(Arc::clone(&show.package), show.options.detail.map(|detail| detail.form()))?;
    let identity = StandbyHello::of(&show.wall, first.sections()).map_err(io::Error::other)?;
    let mut other = show.options.standby_of.clone();
    let (mut report, mut own, mut grown) = (ShowReport::default(), None, first.clone());
    loop {
        let inherited = match &other {
            None => None,
            Some(master) => {
                let scenes = Scenes::new(&first, &grown, show.options.insert_from.clone());
                match standby::stand_by(&listener, master, &mut show, &identity, (scenes, own.clone())).await? {
                    Some(heard) => Some(standby::handed_on(own.take(), heard, &mut grown)),
                    None => return Ok(report), // the show ended before it was this master's turn
                }
            }
        };
        let heir_of = inherited.is_some().then(|| other.take()).flatten();
        let service = Service::new(show, pace, grown, (identity, heir_of), inherited);
        let reign = service.run(listener).await?;
        report.add(&reign.report);
        let Some(next) = reign.stepped_back else { return Ok(report) };
        (other, own, grown, listener, show) = (Some(next.master), next.course, next.grown, next.listener, next.show);
    }
}

/// Random bytes from the standard library's hash keys, which the system seeds.
fn random_bytes() -> [u8; 32] {
    let mut bytes = [0; 32];
    for (i, word) in bytes.chunks_exact_mut(8).enumerate() {
        let mut hasher = RandomState::new().build_hasher();
        hasher.write_usize(i);
        word.copy_from_slice(&hasher.finish().to_le_bytes());
    }
    bytes
}

/// The loop's side of a connection.
struct Link {
    address: SocketAddr,
    mailbox: Arc<Mailbox>,
    role: Option<oneshot::Sender<Role>>,
    /// Whose control connection it is.
    node: Option<String>,
}

struct Service {
    master: Master,
    /// Of its wall and scene, for other masters.
    identity: StandbyHello,
    /// The master whose place it took.
    heir_of: Option<String>,
    /// Whether another master is being asked whether it drives the show.
    is_asking: bool,
    /// The master that it steps back for.
    stands_by_for: Option<String>,
    session_seed: [u8; 32],
    live_nodes: Arc<AtomicU32>,
    started: Instant,
    sets: Vec<VisibleSet>,
    /// Where frames order something by it.
    primary: Option<PrimaryFrustum>,
    max_connections: usize,
    links: BTreeMap<PeerId, Link>,
    tasks: JoinSet<()>,
    next_peer: u64,
    events: mpsc::Sender<Event>,
    /// Until it runs.
    inbox: Option<mpsc::Receiver<Event>>,
    blobs: Arc<Blobs>,
    chunk_bytes: Arc<AtomicU64>,
    write_ns: Arc<AtomicU64>,
    frame: FrameReport,
    report: ShowReport,
    is_finished: bool,
    /// Why the show ends early, where this side is to blame.
    fault: Option<ServiceError>,
    wanted: Option<u64>,
    complaints: Complaints,
    /// Where the show stood under the master before.
    inherited: Option<Inherited>,
    /// The scene that is shown.
    grown: Grown,
    /// The scene that standbys are preparing for.
    proposed: Option<Arc<Offer>>,
    /// The scene that nodes are preparing for.
    offered: Option<Arc<Offer>>,
    show: Show,
}

/// What the first frame of a master that took another's place begins with.
struct Inherited {
    course: Course,
    /// Where it is another scene than the show's cull holds.
    fresh: Option<Arc<FreshScene>>,
}

/// How a master's turn ended.
struct Reign<L> {
    report: ShowReport,
    stepped_back: Option<SteppedBack<L>>,
}

/// What goes on where a master stepped back.
struct SteppedBack<L> {
    /// Whom it stands by for.
    master: String,
    /// Where its own show stood.
    course: Option<Course>,
    grown: Grown,
    listener: L,
    show: Show,
}

impl Service {
    /// For a show that begins, or goes on from another master's course.
    fn new(
        show: Show,
        pace: Pace,
        grown: Grown,
        (identity, heir_of): (StandbyHello, Option<String>),
        inherited: Option<Inherited>,
    ) -> Self {
        let (wait, mut start_wait) = (show.options.barrier_wait, show.options.start_wait);
        let mut start_nodes = show.options.start_nodes.clone();
        if inherited.is_some() {
            (start_wait, start_nodes) = (Duration::ZERO, Vec::new()); // the show runs already
        }
        let session_seed = show.options.session_seed.unwrap_or_else(random_bytes);
        let barrier = BarrierOptions { wait, start_wait, start_nodes };
        let options = MasterOptions {
            barrier,
            pace,
            first_frame: inherited.as_ref().map_or(0, |inherited| inherited.course.number + 1),
            frames: show.options.frames,
            sections: grown.sections().to_vec(),
            tessellation: grown.tessellation(),
            hierarchies: grown.hierarchies(),
            insertions: grown.insertions().to_vec(),
            adaptive: show.options.adaptive.map(|threshold| Adaptive { threshold, objects: grown.object_leaves() }),
            estimates: show.options.budget.map(|budget| {
                let (scene_triangles, completes) = (grown.triangles(), show.options.completes);
                EstimateOptions { budget: budget.of(scene_triangles), scene_triangles, completes }
            }),
            detail: show.options.detail,
            session_seed,
        };
        let looks = options.estimates.is_some() || options.detail.is_some();
        let admission = match show.options.security {
            Security::Plain => Admission::ByName,
            Security::Tls(_) => Admission::ByCertificate,
        };
        let (events, inbox) = mpsc::channel(MAX_EVENTS);
        Self {
            master: Master::new(Arc::clone(&show.wall), options, Duration::ZERO).admitting(admission),
            identity,
            heir_of,
            is_asking: false,
            stands_by_for: None,
            session_seed,
            live_nodes: Arc::default(),
            started: Instant::now(),
            sets: vec![VisibleSet::default(); show.wall.views().len()],
            primary: looks.then(|| PrimaryFrustum::new(&show.wall)),
            max_connections: MAX_UNNAMED + 3 * show.wall.nodes().len(),
            links: BTreeMap::new(),
            tasks: JoinSet::new(),
            next_peer: 0,
            events,
            inbox: Some(inbox),
            blobs: Arc::new(grown.blobs()),
            chunk_bytes: Arc::default(),
            write_ns: Arc::default(),
            frame: FrameReport::default(),
            report: ShowReport::default(),
            is_finished: false,
            fault: None,
            wanted: None,
            complaints: Complaints::default(),
            inherited,
            grown,
            proposed: None,
            offered: None,
            show,
        }
    }

    async fn run<L: Listener>(mut self, listener: L) -> Result<Reign<L>, ServiceError> {
        let mut stop = self.show.stop.clone();
        let Some(mut inbox) = self.inbox.take() else { unreachable!("a service runs once") };
        let (connector, security) = (self.show.options.connector.clone(), self.show.options.security.clone());
        let (live_nodes, port, seed) = (Arc::clone(&self.live_nodes), listener.port()?, self.session_seed);
        let about = (self.identity, &*live_nodes, port);
        let rival = rival::watch(self.heir_of.clone(), (&connector, &security), about, seed);
        tokio::pin!(rival);
        self.master.handle_timeout(Duration::ZERO);
        self.act();
        while !self.is_finished {
            let next = match (self.wanted, self.master.next_timeout()) {
                (Some(_), _) => Duration::ZERO,
                (None, Some(at)) => at.saturating_sub(self.now()),
                (None, None) => Duration::from_secs(1),
            };
            // In a fixed order, so that a simulation runs the same again; nobody starves: after each turn all that waits is taken.
            let event = tokio::select! {
                biased;
                (master, reason) = &mut rival, if self.may_step_back() => {
                    self.step_back(master, reason);
                    None
                }
                () = stopped(&mut stop) => {
                    self.master.handle_shutdown(&Bye::new(ByeCode::EndOfShow, "the show was stopped"));
                    None
                }
                accepted = listener.accept() => {
                    match accepted {
                        Ok((socket, address)) => self.accept(socket, address),
                        Err(error) => {
                            // Out of descriptors, most often: wait for some to be closed instead of spinning.
                            tracing::warn!("cannot accept a connection: {error}");
                            tokio::time::sleep(Duration::from_millis(10)).await;
                        }
                    }
                    None
                }
                event = inbox.recv() => event,
                () = tokio::time::sleep(next) => None,
            };
            let more = std::iter::from_fn(|| inbox.try_recv().ok()).take(MAX_EVENTS);
            for event in event.into_iter().chain(more) {
                self.take(event);
                self.put_all(); // a goodbye and the end behind it may come together
            }
            self.master.handle_timeout(self.now());
            self.act();
        }
        for offer in [self.proposed.take(), self.offered.take()].into_iter().flatten() {
            offer.refuse("the show ended before all were prepared".to_owned());
        }
        // Who is told that the show is over must find nobody here.
        let listener = self.stands_by_for.is_some().then_some(listener);
        let flush = async { while self.tasks.join_next().await.is_some() {} };
        // Events are not read any more: connections that wait to report end when the inbox does.
        drop(inbox);
        if tokio::time::timeout(LAST_WORDS, flush).await.is_err() {
            tracing::warn!("{} connections did not take their goodbye", self.tasks.len());
        }
        self.report.passed_over = self.master.times_passed_over().collect();
        self.report.chunk_bytes = self.chunk_bytes.load(Ordering::Relaxed);
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        let (course, grown, show) = (self.master.course(), self.grown, self.show);
        let next = self.stands_by_for.zip(listener);
        let stepped_back = next.map(|(master, listener)| SteppedBack { master, course, grown, listener, show });
        Ok(Reign { report: self.report, stepped_back })
    }

    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    fn accept(&mut self, socket: Socket, address: SocketAddr) {
        while self.tasks.try_join_next().is_some() {}
        if self.tasks.len() >= self.max_connections {
            self.report.refused += 1;
            let open = self.tasks.len();
            return self.complaints.warn(format_args!("{address}: refused: {open} connections are open"), self.started.elapsed());
        }
        let peer = PeerId(self.next_peer);
        self.next_peer += 1;
        let mailbox = Arc::new(Mailbox::default());
        self.links.insert(peer, Link { address, mailbox: Arc::clone(&mailbox), role: None, node: None });
        let (events, blobs, chunk_bytes) = (self.events.clone(), Arc::clone(&self.blobs), Arc::clone(&self.chunk_bytes));
        let write_ns = Arc::clone(&self.write_ns);
        let connection = Connection { peer, mailbox, events, blobs, chunk_bytes, write_ns };
        self.tasks.spawn(connection.run(socket, self.show.options.security.clone()));
        self.master.handle_connected(peer, self.now());
    }

    fn take(&mut self, event: Event) {
        let now = self.now();
        match event {
            Event::Opening { peer, body, role } => {
                if let Some(link) = self.links.get_mut(&peer) {
                    link.role = Some(role);
                }
                self.master.handle_body(peer, &body, now);
                self.put_all();
                // Neither refused nor made a chunk connection: it is a node's control connection.
                if let Some(link) = self.links.get_mut(&peer)
                    && let Some(role) = link.role.take()
                {
                    let _ = role.send(Role::Control); // it ended meanwhile
                    let node = self.master.name_of(peer).unwrap_or_default().to_owned();
                    link.node = Some(node.clone());
                    (self.show.node_observer)(&NodeEvent::Joined { node, address: link.address });
                }
            }
            Event::Identity { peer, identity } => self.master.handle_identity(peer, identity),
            Event::NotAdmitted { peer, reason } => {
                if let Some(link) = self.links.remove(&peer) {
                    self.complaints.warn(format_args!("{}: closed: {reason}", link.address), now);
                    self.report.refused += 1;
                    self.master.handle_disconnected(peer, now);
                }
            }
            Event::Body { peer, body } => self.master.handle_body(peer, &body, now),
            Event::Fault { peer, error } => self.master.handle_fault(peer, &error, now),
            Event::Rival { drives } => {
                self.is_asking = false;
                if let Some(master) = drives.filter(|_| self.may_step_back()) {
                    self.step_back(master, "it has more live nodes".to_owned());
                }
            }
            Event::Ended { peer } => {
                if let Some(link) = self.links.remove(&peer) {
                    tracing::info!("{}: connection ended ({})", link.address, self.master.name_of(peer).unwrap_or("unnamed"));
                    self.end(link, "connection lost");
                    self.master.handle_disconnected(peer, now);
                }
            }
        }
    }

    /// Does what the master wants done. Begins one frame at most, so that connections get their turn.
    fn act(&mut self) {
        self.put_all();
        if let Some(number) = self.wanted.take() {
            self.begin_frame(number);
            self.put_all();
        }
    }

    fn put_all(&mut self) {
        while let Some(output) = self.master.poll_output() {
            self.put(output);
        }
    }

    fn put(&mut self, output: Output) {
        match output {
            Output::Send { peer, message } => {
                let Some(link) = self.links.get(&peer) else { return };
                match link.mailbox.push(message) {
                    Ok(Queued { buffers, waiting }) => {
                        self.frame.longest_queue = self.frame.longest_queue.max(waiting as u32);
                        buffers.into_iter().flatten().for_each(|buffer| self.master.recycle(buffer));
                    }
                    Err(_) => {
                        tracing::warn!("{}: closed: it does not read", link.address);
                        self.links.remove(&peer).into_iter().for_each(|link| self.end(link, "it does not read"));
                        self.master.handle_disconnected(peer, self.started.elapsed());
                    }
                }
            }
            Output::ServeChunks { peer } => {
                if let Some(role) = self.links.get_mut(&peer).and_then(|link| link.role.take()) {
                    let _ = role.send(Role::Chunks); // it ended meanwhile
                }
            }
            Output::Close { peer, bye } => {
                let Some(mut link) = self.links.remove(&peer) else { return };
                if !matches!(bye.code, ByeCode::EndOfShow | ByeCode::Leaving | ByeCode::OtherMaster) {
                    self.complaints.warn(format_args!("{}: closed: {bye}", link.address), self.started.elapsed());
                    self.report.refused += 1;
                }
                if let Some(role) = link.role.take() {
                    let _ = role.send(Role::Refused); // it ended meanwhile
                }
                if bye.code == ByeCode::EndOfShow {
                    link.node = None; // everyone leaves at the end
                }
                self.end(link, &bye.reason);
            }
            Output::FrameReleased(released) => self.report_frame(released),
            Output::Shown { node, shown } => (self.show.shown_observer)(node, &shown),
            Output::StoodIn { node, spare } => {
                let node = self.show.wall.nodes()[usize::from(node.0)].name.clone();
                (self.show.node_observer)(&NodeEvent::StoodIn { node, spare });
            }
            Output::Outnumbered { peer, port } => self.ask_rival(peer, port),
            Output::WantFrame { number } => self.wanted = Some(number),
            Output::Finished => self.is_finished = true,
        }
    }

    fn end(&mut self, link: Link, reason: &str) {
        link.mailbox.close();
        if let Some(node) = link.node {
            (self.show.node_observer)(&NodeEvent::Left { node, reason: reason.to_owned() });
        }
    }

    fn begin_frame(&mut self, number: u64) {
        if self.is_finished {
            return;
        }
        let _frame = tracing::debug_span!("frame", number).entered();
        let mut pose = (self.show.camera)(number);
        pose.number = number;
        if let Some(Inherited { course, fresh }) = self.inherited.take() {
            pose.moved.splice(..0, course.moved);
            pose.presence.splice(..0, course.presence);
            pose.begins_with = fresh;
        }
        self.grow(number, &mut pose);
        if let Err(problem) = pose.check(self.show.wall.views().len(), self.grown.objects()) {
            let fault = ServiceError::Pose { frame: number, problem };
            self.master.handle_shutdown(&Bye::new(ByeCode::Failed, fault.to_string()));
            self.fault = Some(fault);
            return;
        }
        self.sets.iter_mut().for_each(VisibleSet::clear);
        let before_cull = std::time::Instant::now();
        tracing::debug_span!("cull").in_scope(|| (self.show.cull)(&pose, &mut self.sets));
        self.frame.cull = before_cull.elapsed();
        if let Some(primary) = &mut self.primary {
            primary.place(&self.show.wall, &pose.eyes, &pose.world_from_room);
        }
        let input = FrameInput {
            number,
            scene_time_s: pose.scene_time_s,
            world_from_room: pose.world_from_room,
            eyes: &pose.eyes,
            shared_eye: pose.shared_eye(),
            sets: &self.sets,
            moved: &pose.moved,
            primary: self.primary.as_ref().map_or(&[], PrimaryFrustum::planes),
            budgets: &pose.budgets,
            presence: &pose.presence,
            steering: pose.steering,
        };
        let _send = tracing::debug_span!("send").entered();
        let mut before = std::time::Instant::now();
        (self.frame.diff, self.frame.encode) = (Duration::ZERO, Duration::ZERO);
        self.master.begin_frame(&input, self.started.elapsed(), &mut |stage| {
            let now = std::time::Instant::now();
            let took = match stage {
                Stage::Diff => &mut self.frame.diff,
                Stage::Encode => &mut self.frame.encode,
            };
            *took += now - before;
            before = now;
        });
    }

    fn report_frame(&mut self, released: FrameReleased) {
        self.report.frames += 1;
        let frame = &mut self.frame;
        frame.number = released.number;
        frame.due = released.due;
        frame.send = Duration::from_nanos(self.write_ns.swap(0, Ordering::Relaxed));
        frame.waited = released.waited;
        frame.passed_over = released.passed_over;
        frame.shown_by = released.shown_by;
        frame.dropped_objects = self.master.dropped_objects();
        frame.spent = released.spent;
        frame.connected = self.master.connected() as u32;
        self.live_nodes.store(self.master.live_nodes(), Ordering::Relaxed);
        frame.standings.clear();
        frame.standings.extend((0..self.show.wall.nodes().len() as u16).map(|node| self.master.standing(NodeIndex(node))));
        frame.frame_bytes.clear();
        frame.frame_bytes.extend(self.master.frame_bytes());
        frame.node_stats.clear();
        frame.node_stats.extend(self.master.stats());
        frame.chunk_bytes = self.chunk_bytes.load(Ordering::Relaxed);
        for node in &frame.passed_over {
            tracing::info!("frame {}: passed over node {:?}", frame.number, self.show.wall.nodes()[usize::from(node.0)].name);
        }
        while self.tasks.try_join_next().is_some() {}
        frame.open = self.tasks.len() as u32;
        (self.show.observer)(frame);
        frame.longest_queue = 0;
    }
}

async fn stopped(stop: &mut Option<watch::Receiver<bool>>) {
    if let Some(receiver) = stop
        && receiver.wait_for(|stop| *stop).await.is_ok()
    {
        *stop = None;
        return;
    }
    std::future::pending().await // without a sender nothing stops the show
}
