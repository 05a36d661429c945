//! Goal: the same promises over real sockets.
//! Method: a service and four nodes with recording painters on loopback. One node breaks off midway and comes back;
//! strangers send garbage, too much, another version, another node's name; one takes its welcome and never reads again.
//! The show goes on until all four are back in the picture. Nothing sleeps to synchronise; a watchdog bounds the time.

#[path = "support/painter.rs"]
mod painter;
mod session_support;

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use glam::{DAffine3, DVec3};
use mullion_client::disk_cache::DiskCache;
use mullion_client::node::{NodeError, NodeOptions, NodeReport, PaintError, Painter, Reconnect, run};
use mullion_client::tile_session::{DrawStats, FrameToDraw};
use mullion_common::scene::{ChunkId, Package, SceneManifest};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wire::{
    ByeCode, Hello, LENGTH_BYTES, Moved, Opening, PROTOCOL_VERSION, Part, Ping, ToMaster, ToTile, ViewSpec,
};
use mullion_server::service::{Pose, Rate, ServiceError, Show, ShowOptions, ShowReport, run as run_show};
use painter::{Blank, Witness};
use session_support::{chunks_of, package, visible, wall};

const LEAVES: u32 = 300;
const SEED: u64 = 3;
const FRAMES: u64 = 100;
const BREAK_OFF_AT: u64 = 30;
const PATIENCE: Duration = Duration::from_secs(60);

/// Checks what it is told to draw and show.
struct Recorder {
    package: Arc<Package>,
    released: Arc<AtomicU64>,
    break_off_at: Option<u64>,
    /// What a view sees in a frame.
    sees: fn(u64, usize) -> VisibleSet,
    scene: Option<Arc<SceneManifest>>,
    uploaded: BTreeSet<u32>,
    drawn: Option<u64>,
    shown: Vec<u64>,
}

impl Painter for Recorder {
    fn open_scene(&mut self, manifest: &Arc<SceneManifest>, views: &[ViewSpec]) -> Result<(), PaintError> {
        assert_eq!(**manifest, self.package.scene.manifest);
        assert_eq!(views.len(), 1);
        self.scene = Some(Arc::clone(manifest));
        self.uploaded.clear();
        Ok(())
    }

    fn grow_scene(&mut self, _: &Arc<SceneManifest>) -> Result<(), PaintError> {
        panic!("this scene does not grow")
    }

    fn upload(&mut self, chunk: ChunkId, bytes: &[u8]) -> Result<u64, PaintError> {
        assert_eq!(bytes, self.package.chunk(chunk));
        assert!(self.uploaded.insert(chunk.0), "a chunk is uploaded once");
        Ok(bytes.len() as u64)
    }

    fn evict(&mut self, chunk: ChunkId) -> Result<(), PaintError> {
        assert!(self.uploaded.remove(&chunk.0), "only what is there is evicted");
        Ok(())
    }

    fn set_transform(&mut self, _: &Moved) -> Result<(), PaintError> {
        panic!("nothing moves in this show")
    }

    fn draw(&mut self, frame: &FrameToDraw) -> Result<DrawStats, PaintError> {
        if self.break_off_at.is_some_and(|at| frame.number >= at) {
            return Err(PaintError::Failed("broke off".into()));
        }
        let view = &frame.views[0];
        assert_eq!(view.leaves, (self.sees)(frame.number, usize::from(view.view.0)), "frame {}", frame.number);
        let manifest = self.scene.as_ref().expect("a scene is open before anything is drawn");
        assert!(chunks_of(manifest, &view.leaves).all(|c| self.uploaded.contains(&c.0)));
        self.drawn = Some(frame.number);
        Ok(DrawStats { draw_us: 1, leaves: view.leaves.len(), triangles: 2 * u64::from(view.leaves.len()), is_cut: false })
    }

    fn show(&mut self, frame: u64) -> Result<(), PaintError> {
        assert_eq!(self.drawn, Some(frame), "only what was drawn last can be shown");
        assert!(self.released.load(Ordering::SeqCst) > frame, "frame {frame} is shown before its release");
        assert!(self.shown.last().is_none_or(|last| *last < frame), "frames are shown in order");
        self.shown.push(frame);
        Ok(())
    }
}

fn sees_some(frame: u64, view: usize) -> VisibleSet {
    visible(SEED, frame, view, LEAVES)
}

fn options(address: SocketAddr, node: &str) -> NodeOptions {
    let reconnect = Reconnect { give_up_after: Some(Duration::from_secs(5)), ..Reconnect::default() };
    NodeOptions { reconnect, ..NodeOptions::plain(node, address.to_string()) }
}

/// Sends bytes, then reads the master's messages until it closes.
fn speak(address: SocketAddr, bytes: &[u8]) -> Vec<ToTile> {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(bytes).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    messages_of(&answer)
}

fn messages_of(answer: &[u8]) -> Vec<ToTile> {
    let mut messages = Vec::new();
    let mut rest = answer;
    while let Some((length, after)) = rest.split_first_chunk::<LENGTH_BYTES>() {
        let (body, after) = after.split_at(u32::from_le_bytes(*length) as usize);
        messages.push(ToTile::decode(body).unwrap());
        rest = after;
    }
    messages
}

fn goodbye(messages: &[ToTile]) -> (ByeCode, &str) {
    match messages.last() {
        Some(ToTile::Bye(bye)) => (bye.code, &bye.reason),
        other => panic!("no goodbye but {other:?}"),
    }
}

fn hello(node: &str, version: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let hello = Hello { node: node.into(), part: Part::Own, credentials: None, cached: vec![] };
    Opening::Control(hello).encode_as_version(version, &mut bytes).unwrap();
    bytes
}

fn strangers(address: SocketAddr) {
    assert_eq!(goodbye(&speak(address, b"\x10\0\0\0GET / HTTP/1.1\r\n")).0, ByeCode::Malformed);
    let messages = speak(address, &[0xff; 64]);
    assert_eq!(goodbye(&messages), (ByeCode::TooLarge, "the message is longer than the 1024 bytes allowed"));
    assert_eq!(goodbye(&speak(address, &hello("nobody", PROTOCOL_VERSION))).0, ByeCode::UnknownNode);
    let messages = speak(address, &hello("t0x0", PROTOCOL_VERSION + 6));
    let (code, reason) = goodbye(&messages);
    assert_eq!(code, ByeCode::VersionMismatch);
    assert!(
        reason.contains(&format!("version {PROTOCOL_VERSION},")) && reason.contains(&format!("version {}", PROTOCOL_VERSION + 6))
    );
    // A welcome, then a lie: the connection ends, the wall goes on.
    let lie = [hello("t2x1", PROTOCOL_VERSION), [&9u32.to_le_bytes()[..], &[3], &u64::MAX.to_le_bytes()].concat()].concat();
    let messages = speak(address, &lie);
    assert!(matches!(messages.first(), Some(ToTile::Welcome(_))));
    assert_eq!(goodbye(&messages).0, ByeCode::Malformed);
    drop(TcpStream::connect(address).unwrap());
}

struct Outcome {
    show: ShowReport,
    nodes: Vec<(Result<NodeReport, NodeError>, Vec<u64>)>,
}

fn play() -> Outcome {
    let (wall, package) = (wall(3, 2), package(LEAVES));
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = tokio::sync::watch::channel(false);
    let released = Arc::new(AtomicU64::new(0));
    let (is_back, strangers_done) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
    let observer = {
        let (released, is_back, strangers_done) = (Arc::clone(&released), Arc::clone(&is_back), Arc::clone(&strangers_done));
        move |report: &mullion_server::service::FrameReport| {
            released.store(report.number + 1, Ordering::SeqCst);
            let all_done = is_back.load(Ordering::SeqCst) && strangers_done.load(Ordering::SeqCst);
            if report.number + 1 >= FRAMES && all_done && report.shown_by == 4 {
                stop.send_replace(true);
            }
        }
    };
    let eyes = wall.default_eyes();
    let show = Show {
        options: ShowOptions {
            barrier_wait: Duration::from_millis(400),
            rate: Rate::Hz(250.0),
            frames: Some(100_000),
            ..ShowOptions::for_wall(&wall)
        },
        wall,
        package: Arc::clone(&package),
        camera: Box::new(move |frame| Pose {
            scene_time_s: frame as f64,
            world_from_room: DAffine3::from_translation(DVec3::X * frame as f64),
            eyes: eyes.clone(),
            moved: Vec::new(),
            ..Pose::default()
        }),
        // The pose carries the frame's number as its time.
        cull: Box::new(|pose, sets| {
            for (view, set) in sets.iter_mut().enumerate() {
                *set = visible(SEED, pose.scene_time_s as u64, view, LEAVES);
            }
        }),
        observer: Box::new(observer),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(|_, _| {}),
        stop: Some(stopped),
    };
    let service = thread::spawn(move || run_show(listener, show).unwrap());
    let recorder = move |released: &Arc<AtomicU64>, break_off_at| Recorder {
        package: Arc::clone(&package),
        released: Arc::clone(released),
        break_off_at,
        sees: sees_some,
        scene: None,
        uploaded: BTreeSet::new(),
        drawn: None,
        shown: Vec::new(),
    };
    let play_node = move |name: &'static str, mut painter: Recorder| {
        thread::spawn(move || {
            let result = run(options(address, name), &mut painter);
            (result, painter.shown)
        })
    };
    let mut deaf = TcpStream::connect(address).unwrap();
    deaf.write_all(&hello("t1x1", PROTOCOL_VERSION)).unwrap();
    let steady: Vec<_> = ["t0x0", "t1x0", "t0x1"].map(|name| play_node(name, recorder(&released, None))).into();
    let broken = play_node("t2x0", recorder(&released, Some(BREAK_OFF_AT)));
    strangers(address);
    strangers_done.store(true, Ordering::SeqCst);
    let (result, _) = broken.join().unwrap();
    assert!(matches!(result, Err(NodeError::Paint(reason)) if reason == "broke off"));
    is_back.store(true, Ordering::SeqCst);
    let back = play_node("t2x0", recorder(&released, None));
    let nodes = steady.into_iter().chain([back]).map(|thread| thread.join().unwrap()).collect();
    Outcome { show: service.join().unwrap(), nodes }
}

#[test]
fn a_wall_over_sockets_survives_its_peers() {
    let (done, outcome) = mpsc::channel();
    thread::spawn(move || done.send(play()));
    let Outcome { show, nodes } = outcome.recv_timeout(PATIENCE).expect("the show ends in time, and nobody panics");
    assert!(show.frames >= FRAMES);
    assert_eq!(show.refused, 6, "four strangers, the lie, and the one that broke off");
    for (i, (result, shown)) in nodes.iter().enumerate() {
        let report = result.as_ref().unwrap_or_else(|e| panic!("node {i}: {e}"));
        assert_eq!(report.connections, 1, "node {i}");
        assert_eq!(report.shown, shown.len() as u64);
        assert_eq!(shown.last(), Some(&(show.frames - 1)), "node {i} is in the picture");
    }
}

/// What one node did in a show of three frames that show everything: nothing is left to fetch ahead.
fn short_show(cache: &Arc<DiskCache>) -> NodeReport {
    let (wall, package) = (wall(1, 1), package(LEAVES));
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let eyes = wall.default_eyes();
    let options_of_show = ShowOptions { frames: Some(3), barrier_wait: PATIENCE, ..ShowOptions::for_wall(&wall) };
    let released = Arc::new(AtomicU64::new(u64::MAX)); // this is no test of the barrier
    let show = Show {
        options: options_of_show.starting_together(&wall, PATIENCE),
        wall,
        package: Arc::clone(&package),
        camera: Box::new(move |frame| Pose { scene_time_s: frame as f64, eyes: eyes.clone(), ..Pose::default() }),
        cull: Box::new(|_, sets| sets[0] = VisibleSet::all(LEAVES)),
        observer: Box::new(|_| {}),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(|_, _| {}),
        stop: None,
    };
    let service = thread::spawn(move || run_show(listener, show).unwrap());
    let (scene, uploaded, shown) = (None, BTreeSet::new(), Vec::new());
    let mut painter = Recorder {
        package,
        released,
        break_off_at: None,
        sees: |_, _| VisibleSet::all(LEAVES),
        scene,
        uploaded,
        drawn: None,
        shown,
    };
    let report = run(NodeOptions { cache: Some(Arc::clone(cache)), ..options(address, "t0x0") }, &mut painter).unwrap();
    service.join().unwrap();
    report
}

#[test]
fn a_node_that_starts_again_fetches_only_what_it_has_not_kept() {
    let folder = tempfile::tempdir().unwrap();
    let cache = Arc::new(DiskCache::open(folder.path(), 1 << 30).unwrap());
    let first = short_show(&cache);
    assert!(first.blob_bytes > 0 && first.cached_bytes == 0, "{first:?}");
    let second = short_show(&cache);
    assert_eq!((second.blob_bytes, second.cached_bytes), (0, first.blob_bytes));
    // Damage on the disk costs a fetch, no more.
    let entry = walk(folder.path()).into_iter().max_by_key(|path| path.metadata().unwrap().len()).unwrap();
    let length = entry.metadata().unwrap().len();
    std::fs::write(&entry, b"damaged").unwrap();
    let third = short_show(&cache);
    assert_eq!((third.blob_bytes, third.cached_bytes), (length, first.blob_bytes - length));
}

/// All files below a folder.
fn walk(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] }).collect()
}

#[test]
fn a_camera_that_gives_no_pose_ends_the_show_with_its_fault() {
    let bad: [fn(&mut Pose); 2] = [|pose| pose.eyes.truncate(1), |pose| pose.eyes[1].y = f64::NAN];
    for (spoil, problem) in bad.into_iter().zip(["eyes: 1; the wall has 2 views", "the eye of view 1 is not finite"]) {
        let wall = wall(2, 1);
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let eyes = wall.default_eyes();
        let is_there = Arc::new(AtomicBool::new(false));
        let joined = Arc::clone(&is_there);
        let show = Show {
            options: ShowOptions {
                barrier_wait: Duration::from_millis(5),
                rate: Rate::Hz(250.0),
                ..ShowOptions::for_wall(&wall)
            },
            wall,
            package: package(3),
            camera: Box::new(move |_| {
                let mut pose = Pose { eyes: eyes.clone(), ..Pose::default() };
                if is_there.load(Ordering::SeqCst) {
                    spoil(&mut pose);
                }
                pose
            }),
            cull: Box::new(|_, _| {}),
            observer: Box::new(|_| {}),
            node_observer: Box::new(move |_| joined.store(true, Ordering::SeqCst)),
            shown_observer: Box::new(|_, _| {}),
            stop: None,
        };
        let service = thread::spawn(move || run_show(listener, show));
        let messages = speak(address, &hello("t1x0", PROTOCOL_VERSION));
        let (code, reason) = goodbye(&messages);
        assert_eq!(code, ByeCode::Failed);
        assert!(reason.ends_with(problem), "{reason}");
        match service.join().unwrap() {
            Err(error @ ServiceError::Pose { .. }) => assert_eq!(error.to_string(), reason),
            other => panic!("{other:?}"),
        }
    }
}

/// Never done with a frame before the next but one has begun, so that the next one is there.
struct Slow {
    begun: Arc<AtomicU64>,
    drawn: Option<u64>,
    shown: u32,
    enough: tokio::sync::watch::Sender<bool>,
}

impl Witness for Slow {
    fn draws(&mut self, frame: &FrameToDraw) -> Result<(), PaintError> {
        let start = Instant::now();
        while self.begun.load(Ordering::SeqCst) <= frame.number + 1 && !*self.enough.borrow() {
            assert!(start.elapsed() < PATIENCE, "frame {} was the last", frame.number);
            thread::yield_now();
        }
        self.drawn = Some(frame.number);
        Ok(())
    }

    fn shows(&mut self, frame: u64) {
        assert_eq!(self.drawn, Some(frame), "only what was drawn last can be shown");
        self.shown += 1;
        self.enough.send_replace(self.shown == 5);
    }
}

#[test]
fn a_node_that_is_always_too_slow_shows_what_it_draws() {
    let wall = wall(1, 1);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let eyes = wall.default_eyes();
    let (enough, stop) = tokio::sync::watch::channel(false);
    let begun = Arc::new(AtomicU64::new(0));
    let begins = Arc::clone(&begun);
    let (given_up, start) = (enough.clone(), Instant::now());
    let show = Show {
        options: ShowOptions { barrier_wait: Duration::from_millis(12), rate: Rate::Hz(100.0), ..ShowOptions::for_wall(&wall) },
        wall,
        package: package(3),
        camera: Box::new(move |frame| {
            begins.store(frame, Ordering::SeqCst);
            given_up.send_if_modified(|is_over| start.elapsed() > PATIENCE && !std::mem::replace(is_over, true));
            Pose { eyes: eyes.clone(), ..Pose::default() }
        }),
        cull: Box::new(|_, _| {}),
        observer: Box::new(|_| {}),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(|_, _| {}),
        stop: Some(stop),
    };
    let service = thread::spawn(move || run_show(listener, show));
    let mut painter = Blank(Slow { begun, drawn: None, shown: 0, enough });
    run(options(address, "t0x0"), &mut painter).unwrap();
    service.join().unwrap().unwrap();
    assert!(painter.0.shown >= 5, "it shows, late as it is");
}

#[test]
fn what_the_master_refuses_for_good_is_an_error_at_once() {
    let (wall, package) = (wall(1, 1), package(3));
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = tokio::sync::watch::channel(false);
    let eyes = wall.default_eyes();
    let show = Show {
        options: ShowOptions::for_wall(&wall),
        wall,
        package: Arc::clone(&package),
        camera: Box::new(move |_| Pose { eyes: eyes.clone(), ..Pose::default() }),
        cull: Box::new(|_, _| {}),
        observer: Box::new(|_| {}),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(|_, _| {}),
        stop: Some(stopped),
    };
    let service = thread::spawn(move || run_show(listener, show));
    let released = Arc::default();
    let (scene, uploaded, shown) = (None, BTreeSet::new(), Vec::new());
    let mut painter = Recorder { package, released, break_off_at: None, sees: sees_some, scene, uploaded, drawn: None, shown };
    match run(options(address, "t9x9"), &mut painter) {
        Err(NodeError::Refused(bye)) => assert!(bye.reason.contains("t9x9") && bye.reason.contains("t0x0"), "{bye}"),
        other => panic!("{other:?}"),
    }
    stop.send_replace(true);
    service.join().unwrap().unwrap();
}

/// Keeps talking until the master closes, and gives its last word.
fn chatter(address: SocketAddr, node: &str) -> ByeCode {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut talker = stream.try_clone().unwrap();
    let greeting = hello(node, PROTOCOL_VERSION);
    let talking = thread::spawn(move || {
        let mut ping = Vec::new();
        ToMaster::Ping(Ping { at_us: 1 }).encode(&mut ping).unwrap();
        talker.write_all(&greeting).unwrap();
        while talker.write_all(&ping).is_ok() {}
    });
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    stream.shutdown(std::net::Shutdown::Both).unwrap_or_default(); // gone already
    talking.join().unwrap();
    goodbye(&messages_of(&answer)).0
}

#[test]
fn who_is_still_talking_hears_that_the_show_is_over() {
    let wall = wall(3, 2);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let names: Vec<String> = wall.nodes().iter().map(|node| node.name.clone()).collect();
    let (stop, stopped) = tokio::sync::watch::channel(false);
    let (eyes, node_count) = (wall.default_eyes(), names.len() as u32);
    let show = Show {
        options: ShowOptions { rate: Rate::Hz(250.0), ..ShowOptions::for_wall(&wall) },
        wall,
        package: package(3),
        camera: Box::new(move |_| Pose { eyes: eyes.clone(), ..Pose::default() }),
        cull: Box::new(|_, _| {}),
        observer: Box::new(move |frame| {
            stop.send_replace(frame.connected == node_count);
        }),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(|_, _| {}),
        stop: Some(stopped),
    };
    let service = thread::spawn(move || run_show(listener, show));
    let talkers: Vec<_> = names.into_iter().map(|name| thread::spawn(move || chatter(address, &name))).collect();
    for talker in talkers {
        assert_eq!(talker.join().unwrap(), ByeCode::EndOfShow);
    }
    service.join().unwrap().unwrap();
}
