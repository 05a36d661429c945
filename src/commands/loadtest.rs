//! `mullion loadtest`: a whole wall on this machine, and whether it keeps its time.

use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use mullion_common::wall::Wall;
use mullion_server::cull::Algorithm;
use mullion_server::service::{self, FrameReport, Rate, Show, ShowOptions};
use serde::Serialize;

use super::demo::{GRID_HZ, grid_wall};
use super::load_nodes::Done;
use super::prepare::HowToPrepare;
use crate::camera::PathSource;
use crate::files::{claim, open_named_scene, open_wall, write_json};
use crate::load::{Tally, Verdict, peak_bytes};
use crate::pixels::Grid;
use crate::progress::Progress;
use crate::say::say;
use crate::show;

/// Which wall and scene, and for how long.
#[derive(clap::Args)]
pub struct Options {
    /// A glTF, GLB or package file, or the name of a generated scene: city, plant, palace, boxes or boxes:LEAVES.
    #[arg(long, value_name = "FILE|NAME", default_value = "city")]
    scene: String,
    /// Columns and rows of the wall.
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "8x8", value_parser = Grid::parse, conflicts_with = "wall")]
    grid: Grid,
    /// A wall file instead of a grid.
    #[arg(long, value_name = "FILE")]
    wall: Option<PathBuf>,
    /// What the nodes do.
    #[arg(long, value_enum, default_value_t = Clients::Protocol)]
    clients: Clients,
    /// Processes that share the nodes; with other clients than `protocol` every node is one.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=256))]
    processes: u32,
    /// Frames a second; a wall file's own if left out, else 60.
    #[arg(long, allow_negative_numbers = true)]
    hz: Option<f64>,
    /// Length of the test, after a first second that does not count.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    seconds: u32,
    /// Camera path: a file, or a walk made for the scene: orbit, whole, interior, flythrough, pan.
    #[arg(long, value_name = "FILE|NAME", default_value = "interior")]
    path: String,
    /// The test is passed when so many percent of the frames are shown by every node within a frame's time.
    #[arg(long, allow_negative_numbers = true, value_name = "PERCENT", default_value_t = 99.5)]
    on_time: f64,
    /// Write every figure (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

/// What nodes do in a load test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Clients {
    /// Take every frame, check every set, keep in step; draw nothing.
    Protocol,
    /// Draw without a window.
    Headless,
    /// Draw in windows.
    Real,
}

/// All that a load test has found.
#[derive(Serialize)]
struct Report {
    scene: String,
    wall: String,
    nodes: usize,
    processes: usize,
    clients: Clients,
    hz: f64,
    #[serde(flatten)]
    verdict: Verdict,
    /// Of all processes of protocol clients.
    done: Done,
    master_peak_bytes: u64,
}

/// How long the first frame waits for all nodes.
const START_WAIT: Duration = Duration::from_secs(30);
/// How long client processes may take to end after the show.
const END_WAIT: Duration = Duration::from_secs(10);

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let wall = match &options.wall {
        Some(file) => open_wall(file)?,
        None => grid_wall(options.grid, 0, options.hz.unwrap_or(GRID_HZ))?,
    };
    let wall = Arc::new(wall);
    let hz = options.hz.unwrap_or(wall.rate_hz());
    ensure!((1.0..=1000.0).contains(&hz), "--hz: {hz} is outside 1 to 1000 frames a second");
    ensure!((0.0..=100.0).contains(&options.on_time), "--on-time: {} is outside 0 to 100 percent", options.on_time);
    let path = PathSource::open(&options.path).context("--path")?;
    options.json.as_deref().map_or(Ok(()), claim)?;
    let package = Arc::new(open_named_scene(&options.scene, &options.how.options()?)?);
    let warm_up = hz.ceil() as u64;
    let frames = warm_up + (hz * f64::from(options.seconds)).ceil() as u64 + 1;
    let path = path.path(&package, &wall, Some(frames))?;

    let listener = TcpListener::bind("127.0.0.1:0").context("cannot listen")?;
    let address = listener.local_addr()?.to_string();
    let tally = Tally::new(wall.nodes().len() as u32);
    let mut show_options = ShowOptions::for_wall(&wall).starting_together(&wall, START_WAIT);
    show_options.frames = Some(frames);
    show_options.rate = Rate::Hz(hz);
    show_options.barrier_wait = Duration::from_secs_f64(1.0 / hz) + service::BARRIER_GRACE;

    let mut clients = start_clients(options, &wall, &address)?;
    let processes = clients.0.len();
    let progress = Progress::new();
    let (of_frames, of_shows, of_leaves) = (tally.clone(), tally.clone(), tally.clone());
    let mut cull = show::culler(Algorithm::Sweep, &wall, &package);
    let show = Show {
        camera: show::camera(path, &wall),
        cull: Box::new(move |pose, sets| {
            cull(pose, sets);
            of_leaves.note_leaves(sets.iter().map(|set| u64::from(set.len())).sum());
        }),
        observer: Box::new(move |frame: &FrameReport| {
            of_frames.note_frame(frame);
            progress.show("showing", frame.number + 1, frames);
        }),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(move |_, shown| of_shows.note_shown(shown)),
        stop: Some(show::stop_on_interrupt()?.subscribe()),
        options: show_options,
        wall: Arc::clone(&wall),
        package: Arc::clone(&package),
    };
    service::run(listener, show)?;
    let report = Report {
        scene: options.scene.clone(),
        wall: wall.name().to_owned(),
        nodes: wall.nodes().len(),
        processes,
        clients: options.clients,
        hz,
        verdict: tally.verdict(hz, warm_up as usize),
        done: clients.finish(options.clients)?,
        master_peak_bytes: peak_bytes(),
    };
    report.print();
    options.json.as_ref().map_or(Ok(()), |path| write_json(&report, path))?;
    let on_time = report.verdict.on_time_percent;
    if report.done.left > 0 {
        bail!("{} times a node was sent what is not the master's set", report.done.left);
    }
    ensure!(on_time >= options.on_time, "{on_time:.2} % of the frames were on time; {} % were asked for", options.on_time);
    Ok(())
}

/// Client processes; what of them still runs when this is dropped is ended.
struct ClientProcesses(Vec<Child>);

fn start_clients(options: &Options, wall: &Wall, address: &str) -> Result<ClientProcesses> {
    let program = std::env::current_exe().context("cannot find this program to start nodes")?;
    let names: Vec<&str> = wall.nodes().iter().map(|node| node.name.as_str()).collect();
    let each = match options.clients {
        Clients::Protocol => names.len().div_ceil(options.processes as usize),
        Clients::Headless | Clients::Real => 1,
    };
    let mut processes = ClientProcesses(Vec::new());
    for names in names.chunks(each) {
        let mut command = Command::new(&program);
        match options.clients {
            Clients::Protocol => command.arg("load-nodes"),
            Clients::Headless | Clients::Real => command.args(["tile", "--give-up-after", "5"]),
        };
        command.args(["--master", address]).args(names).stdin(Stdio::null());
        if options.clients == Clients::Headless {
            command.args(["--headless", "loadtest"]);
        }
        let child = command.stdout(Stdio::piped()).spawn().context("cannot start a node")?;
        processes.0.push(child);
    }
    Ok(processes)
}

impl ClientProcesses {
    /// Waits for all to end and adds up what they did.
    fn finish(&mut self, clients: Clients) -> Result<Done> {
        let end = Instant::now() + END_WAIT;
        let mut sum = Done::default();
        for child in &mut self.0 {
            while child.try_wait()?.is_none() {
                ensure!(Instant::now() < end, "a node has not ended {} s after the show", END_WAIT.as_secs());
                std::thread::sleep(Duration::from_millis(5));
            }
            let text = child.stdout.take().map(std::io::read_to_string).transpose()?.unwrap_or_default();
            if clients == Clients::Protocol {
                let done: Done = serde_json::from_str(&text).context("a process of nodes failed")?;
                sum.add(&done);
            }
        }
        Ok(sum)
    }
}

impl Drop for ClientProcesses {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill(); // ended already
            let _ = child.wait(); // nothing is left of it then
        }
    }
}

impl Report {
    fn print(&self) {
        let Self { scene, wall, nodes, processes, hz, verdict, done, .. } = self;
        say!("{scene} on {wall}: {nodes} nodes in {processes} processes at {hz} Hz");
        verdict.print();
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        say!(
            "memory at most               {:10.0} MiB, and {:.0} MiB of clients",
            mib(self.master_peak_bytes),
            mib(done.peak_bytes)
        );
        if done.connections > 0 {
            say!("sets checked                 {:10} frames of nodes, {} not the master's", done.applied, done.left);
            say!("clocks known to              {:10} µs", done.uncertainty_us);
        }
    }
}
