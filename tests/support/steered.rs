//! A show on loopback that is steered through the control API and recorded.
#![allow(dead_code)] // each test uses its part

use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use glam::{DQuat, DVec3};
use mullion_common::camera_path::{CameraPath, CameraPose};
use mullion_server::control::http::{self, Reach};
use mullion_server::control::{self, Board, Driver, LiveScene};
use mullion_server::cull::Algorithm;
use mullion_server::library::Library;
use mullion_server::metrics::Metrics;
use mullion_server::record::{Header, Recorder};
use mullion_server::service::{Rate, Show, ShowOptions, ShowReport, run as run_show};

use crate::memory_file::MemoryFile;
use crate::session_support::{package, wall};

/// Longest wait for anything.
pub const PATIENCE: Duration = Duration::from_secs(60);
/// Leaves of the scene.
pub const LEAVES: u32 = 40;

/// Where to steer a show, and where its nodes connect.
#[derive(Clone, Copy)]
pub struct Addresses {
    pub control: SocketAddr,
    pub master: SocketAddr,
}

/// How a show is steered.
pub struct Steered<'a> {
    /// How far the camera stands from the wall's room, metres.
    pub distance_m: f64,
    pub rate_hz: f64,
    /// Longest wait of a frame; the wall's own if left out.
    pub barrier_wait: Option<Duration>,
    /// Where packages are inserted from.
    pub packages: Option<&'a Path>,
}

impl Steered<'_> {
    /// Runs a show of two tiles that `steer` steers, and gives back its record, what it reports, and what `steer` does.
    pub fn run<T>(&self, steer: impl FnOnce(Addresses) -> T) -> (Vec<u8>, ShowReport, T) {
        let (wall, package) = (wall(2, 1), package(LEAVES));
        let stand =
            |x: f64| CameraPose { translation: DVec3::new(x, 1.0, self.distance_m), rotation: DQuat::IDENTITY, scale: 1.0 };
        let path = CameraPath::new((0..500).map(|frame| stand(f64::from(frame) * 0.01)).collect()).unwrap();
        let (mut inlet, batches, questions) = control::channel(&wall, &package);
        if let Some(folder) = self.packages {
            inlet = inlet.inserting_from(Library::open(folder).unwrap()).unwrap();
        }
        let mut driver = Driver::new(Arc::clone(&wall), path, batches);
        let board = Arc::new(Board::new(&wall, driver.clock()));
        let (mut metrics, reader) = Metrics::new(&wall);
        let mut scene = LiveScene::new(Algorithm::Sweep, &wall, &package).answering(questions);
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let control = listener.local_addr().unwrap();
        let server = http::start(listener, inlet, Arc::clone(&board), reader, Reach::Loopback).unwrap();
        let record = MemoryFile::default();
        let header = Header::of(&wall, &package, Algorithm::Sweep.name(), self.rate_hz, "test").unwrap();
        let mut recorder = Recorder::start(record.clone(), &header).unwrap();
        let (stop, stopped) = tokio::sync::watch::channel(false);
        let mut options = ShowOptions { rate: Rate::Hz(self.rate_hz), ..ShowOptions::for_wall(&wall) };
        options.barrier_wait = self.barrier_wait.unwrap_or(options.barrier_wait);
        let show = Show {
            options,
            wall,
            package,
            camera: Box::new(move |frame| driver.pose(frame)),
            cull: Box::new(move |pose, sets| {
                scene.cull(pose, sets);
                recorder.note(pose, sets);
            }),
            observer: Box::new(move |frame| {
                board.note(frame);
                metrics.note_frame(frame);
            }),
            node_observer: Box::new(|_| {}),
            shown_observer: Box::new(|_, _| {}),
            stop: Some(stopped),
        };
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let master = listener.local_addr().unwrap();
        let (ended, end) = mpsc::channel();
        thread::spawn(move || ended.send(run_show(listener, show)));
        let result = steer(Addresses { control, master });
        stop.send_replace(true);
        let report = end.recv_timeout(PATIENCE).expect("the show ends in time").expect("the show goes on to its end");
        drop(server);
        (record.bytes(), report, result)
    }
}
