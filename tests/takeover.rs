//! Goal: a wall outlives its master, and a place outlives its node.
//! Method: masters are processes of their own, which are killed; nodes are threads that note which frame they showed when. What is asserted
//! is that the show goes on, and in order; how long that took is printed (`--no-capture`).

mod support;

use std::net::TcpListener;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use mullion_client::missing::WhenMissing;
use mullion_client::node::{
    self, DEFAULT_MEMORY_BYTES, NodeError, NodeOptions, NodeReport, PaintError, Painter, Reconnect, Security,
};
use mullion_client::tile_session::{DrawStats, FrameToDraw};
use mullion_common::scene::{ChunkId, SceneManifest};
use mullion_common::wire::{Moved, Part, ViewSpec};
use mullion_server::generate::{GeneratedScene, write_glb};
use support::Process;
use tokio::sync::watch;

const LIMIT: Duration = Duration::from_secs(60);
const RATE_HZ: &str = "60";
const NODES: [&str; 4] = ["t0x0", "t1x0", "t0x1", "t1x1"];

/// Which tile, which frame, and when.
type Shows = Arc<Mutex<Vec<(String, u64, Instant)>>>;

/// Draws nothing, and notes what it shows.
struct Notes {
    shows: Shows,
    tile: String,
}

impl Painter for Notes {
    fn open_scene(&mut self, _: &Arc<SceneManifest>, views: &[ViewSpec]) -> Result<(), PaintError> {
        self.tile.clone_from(&views[0].tile_name);
        Ok(())
    }

    fn grow_scene(&mut self, _: &Arc<SceneManifest>) -> Result<(), PaintError> {
        panic!("this scene does not grow")
    }

    fn upload(&mut self, _: ChunkId, bytes: &[u8]) -> Result<u64, PaintError> {
        Ok(bytes.len() as u64)
    }

    fn evict(&mut self, _: ChunkId) -> Result<(), PaintError> {
        Ok(())
    }

    fn set_transform(&mut self, _: &Moved) -> Result<(), PaintError> {
        Ok(())
    }

    fn draw(&mut self, frame: &FrameToDraw) -> Result<DrawStats, PaintError> {
        let expected_s = frame.number as f64 / 60.0;
        assert!((frame.scene_time_s - expected_s).abs() < 1e-9, "the scene's time goes on with the frames: {frame:?}");
        Ok(DrawStats::default())
    }

    fn show(&mut self, frame: u64) -> Result<(), PaintError> {
        self.shows.lock().unwrap().push((self.tile.clone(), frame, Instant::now()));
        Ok(())
    }
}

/// A node on a thread; stopped and waited for when it is ended.
struct Node {
    shows: Shows,
    stop: watch::Sender<bool>,
    thread: JoinHandle<Result<NodeReport, NodeError>>,
}

impl Node {
    fn start(name: &str, part: Part, masters: &[&str]) -> Self {
        let shows = Shows::default();
        let (stop, stopped) = watch::channel(false);
        let options = NodeOptions {
            masters: masters.iter().map(|master| (*master).to_owned()).collect(),
            node: name.to_owned(),
            part,
            credentials: None,
            security: Security::Plain,
            memory_bytes: DEFAULT_MEMORY_BYTES,
            when_missing: WhenMissing::Hold,
            cache: None,
            reconnect: Reconnect { give_up_after: Some(LIMIT), ..Reconnect::default() },
            stop: Some(stopped),
        };
        let mut painter = Notes { shows: Arc::clone(&shows), tile: String::new() };
        Self { shows, stop, thread: std::thread::spawn(move || node::run(options, &mut painter)) }
    }

    /// What it showed from `since` on.
    fn shown_since(&self, since: Instant) -> Vec<(String, u64, Instant)> {
        self.shows.lock().unwrap().iter().filter(|(.., at)| *at >= since).cloned().collect()
    }

    /// Waits until it has shown so many frames since `since`, and gives them.
    fn shows(&self, frames: usize, since: Instant) -> Vec<(String, u64, Instant)> {
        let deadline = Instant::now() + LIMIT;
        loop {
            let shown = self.shown_since(since);
            if shown.len() >= frames {
                return shown;
            }
            assert!(Instant::now() < deadline, "{} frames shown within {LIMIT:?}, not {frames}", shown.len());
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn end(self) {
        self.stop.send_replace(true);
        self.thread.join().expect("no panic").expect("it was stopped");
    }
}

fn serve(folder: &Path, listen: &str, more: &[&str]) -> Process {
    let (wall, scene) = (folder.join("wall.toml"), folder.join("palace.glb"));
    let files = [wall, scene].map(|path| path.display().to_string());
    let first = ["serve", &files[0], &files[1], "--listen", listen, "--rate", RATE_HZ];
    Process::start(&[&first, more].concat())
}

fn prepared() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    write_glb(GeneratedScene::Palace, 1, &folder.path().join("palace.glb")).expect("written");
    let wall = "[grid]\ncolumns = 2\nrows = 2\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
    std::fs::write(folder.path().join("wall.toml"), wall).expect("written");
    folder
}

/// An address that is free now, for a master that is started twice.
fn free_address() -> String {
    TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a port").to_string()
}

/// Longest that a node of these went without a new frame after `since`.
fn longest_wait(nodes: &[Node], since: Instant) -> Duration {
    nodes.iter().map(|node| node.shows(1, since)[0].2 - since).max().unwrap_or_default()
}

#[test]
fn a_standby_goes_on_where_the_master_died() {
    let folder = prepared();
    let mut master = serve(folder.path(), "127.0.0.1:0", &[]);
    let address = support::address_of(&mut master);
    let mut standby = serve(folder.path(), "127.0.0.1:0", &["--standby-of", &address]);
    let heir = support::address_of(&mut standby);
    standby.error_line(&["standing by for the master"], 0, LIMIT);
    master.error_line(&["standby joined"], 0, LIMIT);
    let started = Instant::now();
    // Two of them know the standby first: it sends them on.
    let nodes = [0, 1, 2, 3].map(|i| {
        let masters = if i < 2 { [address.as_str(), &heir] } else { [heir.as_str(), &address] };
        Node::start(NODES[i], Part::Own, &masters)
    });
    nodes.iter().for_each(|node| drop(node.shows(20, started)));

    master.kill();
    let killed = Instant::now();
    println!("next frame at every node {} ms after the master was killed", longest_wait(&nodes, killed).as_millis());
    for node in &nodes {
        node.shows(20, killed);
        let frames: Vec<u64> = node.shown_since(started).iter().map(|(_, frame, _)| *frame).collect();
        assert!(frames.windows(2).all(|pair| pair[0] < pair[1]), "the heir counts on: {frames:?}");
    }
    standby.error_line(&["is gone", "going on from frame"], 0, LIMIT);
    nodes.into_iter().for_each(Node::end);
}

#[test]
fn nodes_resume_when_a_master_without_a_standby_is_started_again() {
    let folder = prepared();
    let address = free_address();
    let mut master = serve(folder.path(), &address, &[]);
    support::address_of(&mut master);
    let started = Instant::now();
    let nodes = NODES.map(|name| Node::start(name, Part::Own, &[&address]));
    nodes.iter().for_each(|node| drop(node.shows(10, started)));
    master.kill();
    let mut master = serve(folder.path(), &address, &[]);
    support::address_of(&mut master);
    let back = Instant::now();
    println!("next frame at every node {} ms after the master was back", longest_wait(&nodes, back).as_millis());
    nodes.iter().for_each(|node| drop(node.shows(10, back)));
    nodes.into_iter().for_each(Node::end);
}

#[test]
fn a_spare_shows_what_a_missing_tile_would_until_that_one_is_back() {
    let folder = prepared();
    let mut master = serve(folder.path(), "127.0.0.1:0", &[]);
    let address = support::address_of(&mut master);
    let started = Instant::now();
    let mut nodes: Vec<Node> = NODES.iter().map(|name| Node::start(name, Part::Own, &[&address])).collect();
    nodes.iter().for_each(|node| drop(node.shows(5, started)));
    let spare = Node::start("attic", Part::Spare, &[&address]);
    master.error_line(&["node attic joined"], 0, LIMIT);
    assert_eq!(spare.shown_since(started), [], "it has no place yet");

    let gone = Instant::now();
    nodes.remove(1).end();
    let shown = spare.shows(10, gone);
    println!("the spare showed a frame {} ms after the node was stopped", (shown[0].2 - gone).as_millis());
    assert!(shown.iter().all(|(tile, ..)| tile == NODES[1]), "{shown:?}");
    master.error_line(&["spare attic takes the place of node t1x0"], 0, LIMIT);

    let owner = Node::start(NODES[1], Part::Own, &[&address]);
    owner.shows(10, gone);
    master.error_line(&["node attic left", "is back"], 0, LIMIT);
    // Its place is taken: it waits again.
    master.error_line(&["node attic joined"], master.err.lines().len().saturating_sub(3), LIMIT);
    owner.end();
    nodes.into_iter().for_each(Node::end);
    spare.end();
}
