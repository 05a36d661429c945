//! Masters that are processes of their own, and nodes that are threads and note which frame they showed when.
#![allow(dead_code)] // each test uses its part

use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use mullion_client::missing::WhenMissing;
use mullion_client::node::{
    self, Connector, DEFAULT_MEMORY_BYTES, NodeError, NodeOptions, NodeReport, PaintError, Reconnect, Security,
};
use mullion_client::tile_session::FrameToDraw;
use mullion_common::wire::{Part, ViewSpec};
use mullion_control::Control;
use mullion_server::generate::{GeneratedScene, write_glb};
use tokio::sync::watch;

use super::Process;
use super::painter::{Blank, Witness};

pub const LIMIT: Duration = Duration::from_secs(60);
pub const RATE_HZ: &str = "60";
pub const NODES: [&str; 4] = ["t0x0", "t1x0", "t0x1", "t1x1"];

/// Which tile, which frame, and when.
pub type Shows = Arc<Mutex<Vec<(String, u64, Instant)>>>;

/// Notes what a node shows.
struct Notes {
    shows: Shows,
    last: Arc<Mutex<Option<FrameToDraw>>>,
    tile: String,
}

impl Witness for Notes {
    fn opens(&mut self, views: &[ViewSpec]) {
        self.tile.clone_from(&views[0].tile_name);
    }

    fn draws(&mut self, frame: &FrameToDraw) -> Result<(), PaintError> {
        *self.last.lock().unwrap() = Some(frame.clone());
        Ok(())
    }

    fn shows(&mut self, frame: u64) {
        self.shows.lock().unwrap().push((self.tile.clone(), frame, Instant::now()));
    }
}

/// A node on a thread; stopped and waited for when it is ended.
pub struct Node {
    shows: Shows,
    last: Arc<Mutex<Option<FrameToDraw>>>,
    stop: watch::Sender<bool>,
    thread: JoinHandle<Result<NodeReport, NodeError>>,
}

impl Node {
    pub fn start(name: &str, part: Part, masters: &[&str]) -> Self {
        Self::secured(name, part, masters, Security::Plain)
    }

    pub fn secured(name: &str, part: Part, masters: &[&str], security: Security) -> Self {
        let shows = Shows::default();
        let (stop, stopped) = watch::channel(false);
        let options = NodeOptions {
            masters: masters.iter().map(|master| (*master).to_owned()).collect(),
            connector: Connector::default(),
            node: name.to_owned(),
            part,
            credentials: None,
            security,
            memory_bytes: DEFAULT_MEMORY_BYTES,
            when_missing: WhenMissing::Hold,
            cache: None,
            reconnect: Reconnect { give_up_after: Some(LIMIT), ..Reconnect::default() },
            stop: Some(stopped),
        };
        let last = Arc::default();
        let mut painter = Blank(Notes { shows: Arc::clone(&shows), last: Arc::clone(&last), tile: String::new() });
        Self { shows, last, stop, thread: std::thread::spawn(move || node::run(options, &mut painter)) }
    }

    /// What it showed from `since` on.
    pub fn shown_since(&self, since: Instant) -> Vec<(String, u64, Instant)> {
        self.shows.lock().unwrap().iter().filter(|(.., at)| *at >= since).cloned().collect()
    }

    /// Waits until it has shown so many frames since `since`, and gives them.
    pub fn shows(&self, frames: usize, since: Instant) -> Vec<(String, u64, Instant)> {
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

    /// The last frame that it drew.
    pub fn last(&self) -> FrameToDraw {
        self.last.lock().unwrap().clone().expect("it has drawn")
    }

    pub fn end(self) {
        self.stop.send_replace(true);
        self.thread.join().expect("no panic").expect("it was stopped");
    }
}

pub fn serve(folder: &Path, listen: &str, more: &[&str]) -> Process {
    let (wall, scene) = (folder.join("wall.toml"), folder.join("palace.glb"));
    let files = [wall, scene].map(|path| path.display().to_string());
    let first = ["serve", &files[0], &files[1], "--listen", listen, "--rate", RATE_HZ];
    Process::start(&[&first, more].concat())
}

pub fn prepared() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    write_glb(GeneratedScene::Palace, 1, &folder.path().join("palace.glb")).expect("written");
    let wall = "[grid]\ncolumns = 2\nrows = 2\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
    std::fs::write(folder.path().join("wall.toml"), wall).expect("written");
    folder
}

/// An address that is free now, for a master that is started twice.
pub fn free_address() -> String {
    TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a port").to_string()
}

/// Where a `serve --control` is steered.
pub fn control_of(serve: &mut Process) -> Control {
    let line = serve.out_line("steer it at:", LIMIT);
    let address = line
        .trim_start_matches("steer it at:")
        .trim()
        .trim_start_matches("http://")
        .trim_end_matches("/status")
        .parse::<SocketAddr>();
    Control::connect(address.expect("an address")).expect("it listens")
}
