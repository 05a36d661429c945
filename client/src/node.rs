//! The shell around a [`TileSession`]: sockets on a thread of their own, the painter on the caller's.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use std::{io, thread};

use futures_util::StreamExt;
use mullion_common::scene::{ChunkHash, ChunkId, ObjectId, SceneManifest, Tessellation};
use mullion_common::wire::{
    ALIVE_EVERY, Bye, ByeCode, ChunkHello, ChunkReply, MAX_CHUNK_REPLY_BYTES, MAX_TO_TILE_BYTES, MAX_WANTED, Moved, ObjectCount,
    Opening, Part, SILENCE_LIMIT, Stats, ToMaster, ToTile, ViewSpec, Want,
};
use thiserror::Error;
use tokio::io::AsyncWriteExt;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::timeout;

use crate::connection::{End, framed, keep_connected, stopped, write_message};
use crate::disk_cache::DiskCache;
use crate::master_clock::{MasterClock, PING_EVERY};
use crate::missing::WhenMissing;
use crate::tile_session::{Action, Assembly, CountOrder, DrawStats, EndedBy, FrameToDraw, PieceError, TileSession};
use crate::transport::{connect, describe};

/// Messages and blobs that may wait for the painter. Blobs are bounded by what the session asks for at once.
const MAX_EVENTS: usize = 64;
/// Messages that may wait to be written.
const MAX_UNSENT: usize = 64;

/// What draws: a GPU, or a recorder in tests. Called from the thread that called [`run`].
pub trait Painter {
    /// A new scene or new views: forget all chunks and hierarchies. The picture that is shown stays.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn open_scene(&mut self, manifest: &Arc<SceneManifest>, views: &[ViewSpec]) -> Result<(), PaintError>;
    /// The tessellation of the scene that was just opened, for estimates of what is visible; it stays when the scene grows. Who needs none does
    /// nothing.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn take_tessellation(&mut self, _tessellation: &Arc<Tessellation>) -> Result<(), PaintError> {
        Ok(())
    }
    /// Take the next blob of a hierarchy of detail, whose hash is right, for frames that are drawn in detail: once for each, in their order, the
    /// base first. `number` is the same for all of a hierarchy, `objects` are those in whose leaves' place it is drawn, from the base on. It
    /// stays until it is forgotten, or a scene is opened. Gives how many bytes the hierarchy takes as far as it has come; none where the blob is no part of one
    /// after those before: then nothing more comes of it, and its objects are drawn from their leaves. Who draws no hierarchies gives none.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn take_hierarchy(&mut self, _number: u32, _objects: &[ObjectId], _blob: &[u8]) -> Result<Option<u64>, PaintError> {
        Ok(None)
    }
    /// Forget a hierarchy, if any of it was taken: what follows does not come, and its objects are drawn from their leaves.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn forget_hierarchy(&mut self, _number: u32) -> Result<(), PaintError> {
        Ok(())
    }
    /// The scene has more objects, leaves, materials and chunks, behind those that it had: what was taken and told stays.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn grow_scene(&mut self, manifest: &Arc<SceneManifest>) -> Result<(), PaintError>;
    /// Take a chunk's bytes, which bear the chunk's hash. Gives how many bytes it takes now.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn upload(&mut self, chunk: ChunkId, bytes: &[u8]) -> Result<u64, PaintError>;
    /// Forget a chunk.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn evict(&mut self, chunk: ChunkId) -> Result<(), PaintError>;
    /// An object has another place from the next frame on.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn set_transform(&mut self, moved: &Moved) -> Result<(), PaintError>;
    /// Draw and keep the picture back. The chunks of all leaves that are not listed as missing have been uploaded; where the frame is drawn in
    /// detail, of leaves whose object has a hierarchy the texture has, and the hierarchy's base has been taken.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn draw(&mut self, frame: &FrameToDraw) -> Result<DrawStats, PaintError>;
    /// Count how much of some objects' boxes is to be seen in the picture that was drawn last, which is of this frame. A painter that cannot
    /// gives nothing: then all that its views see is drawn.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn count(&mut self, _frame: &FrameToDraw, _order: &CountOrder) -> Result<Vec<ObjectCount>, PaintError> {
        Ok(Vec::new())
    }
    /// Show the picture drawn last.
    ///
    /// # Errors
    /// See [`PaintError`].
    fn show(&mut self, frame: u64) -> Result<(), PaintError>;
}

/// Why a painter goes no further.
#[derive(Debug, Error)]
pub enum PaintError {
    /// The user closed it: no error.
    #[error("closed")]
    Closed,
    /// It cannot go on.
    #[error("{0}")]
    Failed(String),
}

pub use crate::connection::Reconnect;
pub use crate::transport::{Connecting, Connector, NodeTls, Reader, Security, SecurityError, Stream, Writer};

/// Which node to be, and of which master.
#[derive(Clone, Debug)]
pub struct NodeOptions {
    /// Hosts and ports: the master's, and those of masters that stand by for it. At least one.
    pub masters: Vec<String>,
    /// How they are reached.
    pub connector: Connector,
    /// How connections are secured.
    pub security: Security,
    /// Its name in the wall, or a spare's own.
    pub node: String,
    /// Whether it has a place of its own.
    pub part: Part,
    /// What proves it.
    pub credentials: Option<Vec<u8>>,
    /// What chunks may take on the GPU before those that were not needed for longest go, bytes. Chunks that no frame needs yet are fetched
    /// up to three quarters of it.
    pub memory_bytes: u64,
    /// What is shown of what has not come yet.
    pub when_missing: WhenMissing,
    /// Where blobs are looked for first, and kept.
    pub cache: Option<Arc<DiskCache>>,
    /// When to try again.
    pub reconnect: Reconnect,
    /// Turns true when the node is to stop.
    pub stop: Option<watch::Receiver<bool>>,
}

/// How long a master may say nothing before a node that has others looks at those. It says something every second.
const PATIENCE_WITH_STANDBYS: Duration = Duration::from_secs(3);
const _: () = assert!(PATIENCE_WITH_STANDBYS.as_secs() > 2 * ALIVE_EVERY.as_secs(), "a lost sign of life is no death");

impl NodeOptions {
    /// Of a node with a place of its own that finds its master over plain sockets, holds pictures until all has come, and keeps nothing.
    pub fn plain(node: &str, master: String) -> Self {
        Self {
            masters: vec![master],
            connector: Connector::default(),
            security: Security::Plain,
            node: node.to_owned(),
            part: Part::Own,
            credentials: None,
            memory_bytes: DEFAULT_MEMORY_BYTES,
            when_missing: WhenMissing::Hold,
            cache: None,
            reconnect: Reconnect::default(),
            stop: None,
        }
    }

    /// How long the master may say nothing before it counts as gone.
    pub(crate) fn patience(&self) -> Duration {
        if self.masters.len() > 1 { PATIENCE_WITH_STANDBYS } else { SILENCE_LIMIT }
    }
}

/// A choice for [`NodeOptions::memory_bytes`] that leaves room on common GPUs.
pub const DEFAULT_MEMORY_BYTES: u64 = 4 << 30;

/// What a node did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NodeReport {
    /// Frames drawn.
    pub drawn: u64,
    /// Frames shown.
    pub shown: u64,
    /// Connections that were greeted.
    pub connections: u32,
    /// Bytes of blobs received.
    pub blob_bytes: u64,
    /// Bytes of blobs found in the cache.
    pub cached_bytes: u64,
}

/// Why a node ended before the show did.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum NodeError {
    #[error("the master refused: {0}")]
    Refused(Bye),
    #[error("no connection to {master} for {seconds:.1} s: {last}")]
    Unreachable { master: String, seconds: f64, last: String },
    #[error("cannot draw: {0}")]
    Paint(String),
    #[error("cannot start the network: {0}")]
    Start(#[from] io::Error),
}

/// Names and lengths of blobs, in order of need.
type Wanted = Vec<(ChunkHash, u64)>;

/// From the network to the painter's thread.
enum Event {
    Connected {
        control: mpsc::Sender<ToMaster>,
        wants: mpsc::Sender<Wanted>,
    },
    /// With when it came in, since the node's start.
    Message(Box<ToTile>, Duration),
    Blob(ChunkHash, Vec<u8>),
    /// A blob that was in the cache.
    Cached(ChunkHash, Vec<u8>),
    Absent(ChunkHash),
    Disconnected,
    Ended(Result<(), NodeError>),
}

/// Drives a node until the show ends, its `stop` turns true, or it cannot go on. While the master is away, the picture
/// stays and the node tries again. Blocks; must not be called from within an async runtime.
///
/// # Errors
/// When the master refuses the node for good, stays out of reach, or the painter fails.
pub fn run(options: NodeOptions, painter: &mut dyn Painter) -> Result<NodeReport, NodeError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (events, inbox) = mpsc::channel(MAX_EVENTS);
    let stats = Arc::new(Mutex::new(Stats::default()));
    let NodeOptions { node, part, credentials, memory_bytes, when_missing, .. } = options.clone();
    let session = TileSession::new(node, credentials, memory_bytes, when_missing).taking_part_as(part);
    let started = Instant::now();
    let clock = MasterClock::default();
    let (report, waiting) = (NodeReport::default(), VecDeque::with_capacity(MAX_EVENTS));
    let mut easel = Easel { session, painter, report, inbox, waiting, link: None, clock, started };
    let hello = Opening::Control(easel.session.hello());
    let network = Network { hello, options, events, stats: Arc::clone(&stats), started };
    let thread = thread::Builder::new().name("mullion-network".into()).spawn(move || runtime.block_on(network.run()))?;
    let result = easel.run(&stats);
    let Easel { report, inbox, waiting, link, .. } = easel;
    // Without an inbox and a link, in this order, the network thread ends as soon as what is queued is written.
    drop((inbox, waiting));
    drop(link);
    if thread.join().is_err() {
        return Err(NodeError::Start(io::Error::other("the network thread panicked")));
    }
    result.map(|()| report)
}

/// The painter's side.
struct Easel<'a> {
    session: TileSession,
    painter: &'a mut dyn Painter,
    report: NodeReport,
    inbox: mpsc::Receiver<Event>,
    /// What came in while a frame was drawn.
    waiting: VecDeque<Event>,
    link: Option<(mpsc::Sender<ToMaster>, mpsc::Sender<Wanted>)>,
    clock: MasterClock,
    started: Instant,
}

impl Easel<'_> {
    fn run(&mut self, stats: &Mutex<Stats>) -> Result<(), NodeError> {
        loop {
            let acted = match self.take_all() {
                Ok(None) => self.act(),
                Ok(Some(end)) => return end,
                Err(error) => Err(error),
            };
            match acted {
                Ok(()) => {}
                Err(PaintError::Closed) => {
                    self.say(ToMaster::Bye(Bye::new(ByeCode::Leaving, "closed")));
                    return Ok(());
                }
                Err(PaintError::Failed(reason)) => {
                    self.say(ToMaster::Bye(Bye::new(ByeCode::Failed, reason.as_str())));
                    return Err(NodeError::Paint(reason));
                }
            }
            if let Ok(mut stats) = stats.lock() {
                *stats = self.session.stats();
            }
        }
    }

    /// Waits for an event and takes all that have come in before anything is drawn: the newest frame wins. Gives the
    /// node's end, if it has come.
    fn take_all(&mut self) -> Result<Option<Result<(), NodeError>>, PaintError> {
        let mut next = self.waiting.pop_front().or_else(|| self.inbox.blocking_recv());
        if next.is_none() {
            return Ok(Some(Ok(())));
        }
        while let Some(event) = next {
            match event {
                // What the master said before the end still counts: the last frame's swap comes just before it.
                Event::Disconnected | Event::Ended(_) => self.act()?,
                _ => {}
            }
            match event {
                Event::Ended(end) => return Ok(Some(end)),
                event => self.take(event),
            }
            next = self.waiting.pop_front().or_else(|| self.inbox.try_recv().ok());
        }
        Ok(None)
    }

    /// How many newer frames came in while one was drawn. Nothing is done with them before the master has been told of that one.
    fn newer_frames(&mut self) -> u32 {
        while self.waiting.len() < MAX_EVENTS
            && let Ok(event) = self.inbox.try_recv()
        {
            self.waiting.push_back(event);
        }
        let is_frame = |event: &&Event| matches!(event, Event::Message(message, _) if matches!(**message, ToTile::Frame(_)));
        self.waiting.iter().filter(is_frame).count() as u32
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Connected { control, wants } => {
                self.report.connections += 1;
                self.link = Some((control, wants));
                self.session.connected();
            }
            Event::Message(message, at) => match *message {
                ToTile::Pong(pong) => self.clock.take(&pong, at),
                message => self.session.handle_message(message),
            },
            Event::Blob(hash, bytes) => {
                self.report.blob_bytes += bytes.len() as u64;
                self.session.handle_blob(hash, bytes);
            }
            Event::Cached(hash, bytes) => {
                self.report.cached_bytes += bytes.len() as u64;
                self.session.handle_blob(hash, bytes);
            }
            Event::Absent(hash) => self.session.handle_absent(hash),
            Event::Disconnected | Event::Ended(_) => {
                self.link = None;
                self.clock.forget();
                self.session.disconnected();
            }
        }
    }

    fn act(&mut self) -> Result<(), PaintError> {
        while let Some(action) = self.session.poll_action() {
            match action {
                Action::Send(message) => self.say(message),
                Action::Fetch(blobs) => {
                    // A full or closed queue means that the connection is ending; the next one asks again.
                    if let Some((_, wants)) = &self.link
                        && wants.try_send(blobs).is_err()
                    {
                        self.link = None;
                    }
                }
                Action::OpenScene(manifest, views) => self.painter.open_scene(&manifest, &views)?,
                Action::TakeTessellation(tessellation) => self.painter.take_tessellation(&tessellation)?,
                Action::TakeHierarchy { number, objects, blob } => {
                    let taken = self.painter.take_hierarchy(number, &objects, &blob)?;
                    self.session.hierarchy_taken(number, taken);
                }
                Action::ForgetHierarchy(number) => self.painter.forget_hierarchy(number)?,
                Action::GrowScene(manifest) => self.painter.grow_scene(&manifest)?,
                Action::Upload { chunk, bytes } => {
                    let taken = self.painter.upload(chunk, &bytes)?;
                    self.session.uploaded(chunk, taken);
                }
                Action::Evict(chunk) => self.painter.evict(chunk)?,
                Action::SetTransform(moved) => self.painter.set_transform(&moved)?,
                Action::Draw(frame) => {
                    let stats = self.painter.draw(&frame)?;
                    self.report.drawn += 1;
                    let newer = self.newer_frames();
                    self.session.drawn_behind(frame.number, stats, newer);
                }
                Action::Count(frame, order) => {
                    let counts = self.painter.count(&frame, &order)?;
                    self.session.counted(frame.number, frame.views[order.place].view, counts);
                }
                Action::Show { frame } => {
                    self.painter.show(frame)?;
                    self.report.shown += 1;
                    if let Some(at_us) = self.clock.master_us(self.started.elapsed()) {
                        self.session.note_shown(frame, at_us);
                    }
                }
                Action::Close { bye, by } => {
                    if by == EndedBy::Node {
                        tracing::warn!("leaving the master: {bye}");
                        self.say(ToMaster::Bye(bye));
                    }
                    self.link = None;
                }
            }
        }
        Ok(())
    }

    fn say(&mut self, message: ToMaster) {
        if let Some((control, _)) = &self.link
            && control.try_send(message).is_err()
        {
            self.link = None;
        }
    }
}

/// The sockets' side.
struct Network {
    hello: Opening,
    options: NodeOptions,
    events: mpsc::Sender<Event>,
    stats: Arc<Mutex<Stats>>,
    started: Instant,
}

impl Network {
    async fn run(self) {
        let stop = self.options.stop.clone();
        let converse = async |stream, master: &str| {
            let end = self.converse(stream, master).await;
            if self.events.send(Event::Disconnected).await.is_err() { End::NobodyThere } else { end }
        };
        let result = tokio::select! {
            result = keep_connected(&self.options, async || self.events.closed().await, converse) => result,
            () = stopped(stop) => Ok(()),
        };
        let _ = self.events.send(Event::Ended(result)).await; // nobody there: nobody to tell
    }

    /// One control connection and its chunk connection, until either ends.
    async fn converse(&self, stream: Stream, master: &str) -> End {
        let Stream { reader, mut writer } = stream;
        let mut buffer = Vec::new();
        if let Err(error) = write_message(&mut writer, &mut buffer, |out| self.hello.encode(out)).await {
            return End::Lost(error.to_string());
        }
        let (control, unsent) = mpsc::channel(MAX_UNSENT);
        let (wants, wanted) = mpsc::channel(MAX_WANTED);
        if self.events.send(Event::Connected { control, wants }).await.is_err() {
            return End::NobodyThere;
        }
        let (welcome, session) = oneshot::channel();
        tokio::select! {
            end = self.read_control(reader, welcome) => end,
            end = after_the_last_word(self.write_control(writer, unsent)) => end,
            end = after_the_last_word(self.fetch_chunks(master, session, wanted)) => end,
        }
    }

    async fn read_control(&self, reader: Reader, welcome: oneshot::Sender<u64>) -> End {
        let mut welcome = Some(welcome);
        let mut bodies = framed(reader, MAX_TO_TILE_BYTES);
        loop {
            let body = match timeout(self.options.patience(), bodies.next()).await {
                Ok(Some(Ok(body))) => body,
                Ok(Some(Err(error))) => return End::Lost(describe(&error)),
                Ok(None) => return End::Lost("the master closed the connection".into()),
                Err(_) => return End::Lost(format!("the master was silent for {} s", self.options.patience().as_secs())),
            };
            let message = match ToTile::decode(&body) {
                Ok(message) => message,
                Err(error) => return End::Lost(format!("the master sent what is no message: {error}")),
            };
            match &message {
                ToTile::Bye(bye) => return End::Bye(bye.clone()),
                ToTile::Welcome(w) => {
                    if let Some(welcome) = welcome.take() {
                        let _ = welcome.send(w.session); // the other side lives as long as this one
                    }
                }
                _ => {}
            }
            if self.events.send(Event::Message(Box::new(message), self.started.elapsed())).await.is_err() {
                tokio::time::sleep(ALIVE_EVERY).await; // the writer has this side's goodbye to send, and ends this
                return End::NobodyThere;
            }
        }
    }

    async fn write_control(&self, mut writer: Writer, mut unsent: mpsc::Receiver<ToMaster>) -> End {
        let mut buffer = Vec::new();
        let mut beat = tokio::time::interval(ALIVE_EVERY);
        let mut ask = tokio::time::interval(PING_EVERY);
        loop {
            let message = tokio::select! {
                message = unsent.recv() => match message {
                    Some(message) => message,
                    None => {
                        let _ = writer.shutdown().await; // the connection ends either way
                        let is_over = self.events.is_closed();
                        return if is_over { End::NobodyThere } else { End::Lost("this side ended the connection".into()) };
                    }
                },
                _ = beat.tick() => ToMaster::Stats(self.stats.lock().map(|stats| *stats).unwrap_or_default()),
                _ = ask.tick() => ToMaster::Ping(MasterClock::ping(self.started.elapsed())),
            };
            if let Err(error) = write_message(&mut writer, &mut buffer, |out| message.encode(out)).await {
                return End::Lost(error.to_string());
            }
        }
    }

    async fn fetch_chunks(&self, master: &str, session: oneshot::Receiver<u64>, wanted: mpsc::Receiver<Wanted>) -> End {
        let Ok(session) = session.await else { return std::future::pending().await };
        let Stream { reader, mut writer } = match connect(master, &self.options).await {
            Ok(stream) => stream,
            Err(error) => return End::Lost(format!("chunk connection: {}", describe(&error))),
        };
        let mut buffer = Vec::new();
        let hello = Opening::Chunks(ChunkHello { session });
        if let Err(error) = write_message(&mut writer, &mut buffer, |out| hello.encode(out)).await {
            return End::Lost(format!("chunk connection: {error}"));
        }
        let assembly = Mutex::new(Assembly::default());
        tokio::select! {
            end = self.read_chunks(reader, &assembly) => end,
            end = self.write_wants(writer, wanted, &assembly) => end,
        }
    }

    async fn read_chunks(&self, reader: Reader, assembly: &Mutex<Assembly>) -> End {
        let mut bodies = framed(reader, MAX_CHUNK_REPLY_BYTES);
        loop {
            let body = match bodies.next().await {
                Some(Ok(body)) => body,
                Some(Err(error)) => return End::Lost(format!("chunk connection: {}", describe(&error))),
                None => return End::Lost("the master closed the chunk connection".into()),
            };
            let mut to_keep = None;
            let event = match ChunkReply::decode(&body) {
                Ok(ChunkReply::Piece(piece)) => {
                    let taken = locked(assembly, |a| a.take(&piece));
                    match taken {
                        Ok(None) => continue,
                        Ok(Some(bytes)) => {
                            to_keep = self.options.cache.as_ref().map(|cache| (Arc::clone(cache), piece.hash, bytes.clone()));
                            Event::Blob(piece.hash, bytes)
                        }
                        Err(error) => return End::Lost(format!("chunk connection: {error}")),
                    }
                }
                Ok(ChunkReply::Absent { hash }) => {
                    locked(assembly, |a| a.cancel(hash));
                    Event::Absent(hash)
                }
                Ok(ChunkReply::Bye(bye)) => return End::Lost(format!("chunk connection: {bye}")),
                Err(error) => return End::Lost(format!("chunk connection: {error}")),
            };
            if self.events.send(event).await.is_err() {
                return std::future::pending().await; // the control connection decides how this ends
            }
            // The painter has it; the disk has threads of its own, and holds back the connection only, where it is slower.
            if let Some((cache, hash, bytes)) = to_keep {
                let _ = tokio::task::spawn_blocking(move || cache.put(hash, &bytes)).await; // without it, it is fetched again
            }
        }
    }

    async fn write_wants(&self, mut writer: Writer, mut wanted: mpsc::Receiver<Wanted>, assembly: &Mutex<Assembly>) -> End {
        let mut buffer = Vec::new();
        while let Some(mut blobs) = wanted.recv().await {
            if let Some(cache) = &self.options.cache {
                let Some(missing) = self.take_cached(cache, blobs).await else {
                    return End::NobodyThere;
                };
                blobs = missing;
            }
            if blobs.is_empty() {
                continue;
            }
            let expected = locked(assembly, |a| blobs.iter().try_for_each(|(hash, length)| a.expect(*hash, *length)));
            if let Err(error @ PieceError::TooMany) = expected {
                return End::Lost(error.to_string());
            }
            let want = Want { hashes: blobs.into_iter().map(|(hash, _)| hash).collect() };
            if let Err(error) = write_message(&mut writer, &mut buffer, |out| want.encode(out)).await {
                return End::Lost(format!("chunk connection: {error}"));
            }
        }
        std::future::pending().await // the control connection decides how this ends
    }

    /// Hands the painter what the cache has of these blobs, and gives back the others; `None` when nobody takes them any more. The disk has
    /// threads of its own: frames do not wait for it.
    async fn take_cached(&self, cache: &Arc<DiskCache>, blobs: Wanted) -> Option<Wanted> {
        let mut missing = Wanted::new();
        for (hash, length) in blobs {
            let from = Arc::clone(cache);
            let found = tokio::task::spawn_blocking(move || from.get(hash, length)).await.ok().flatten();
            match found {
                Some(bytes) => self.events.send(Event::Cached(hash, bytes)).await.ok()?,
                None => missing.push((hash, length)),
            }
        }
        Some(missing)
    }
}

/// Where another half of the conversation fails first, the master may still be saying why on the control connection.
async fn after_the_last_word(half: impl Future<Output = End>) -> End {
    let end = half.await;
    if let End::Lost(_) = end {
        tokio::time::sleep(ALIVE_EVERY).await;
    }
    end
}

fn locked<T>(assembly: &Mutex<Assembly>, f: impl FnOnce(&mut Assembly) -> T) -> T {
    // Both halves run on one thread and hold the lock only here: it is never poisoned while one of them runs.
    f(&mut assembly.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
}
