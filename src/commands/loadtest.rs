//! `mullion loadtest`: a whole wall on this machine, and whether it keeps its time.

use std::net::TcpListener;
use std::path::PathBuf;
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use mullion_server::cull::Algorithm;
use mullion_server::service::{self, FrameReport, Rate, Show, ShowOptions};
use serde::Serialize;

use super::demo::{GRID_HZ, grid_wall};
use super::load_nodes::Done;
use super::prepare::HowToPrepare;
use crate::camera::PathSource;
use crate::files::{claim, open_named_scene, open_wall, write_json};
use crate::load::clients::{ClientProcesses, Clients};
use crate::load::faults::{self, Faults};
use crate::load::hostile::HostilePeers;
use crate::load::{Bearing, Tally, Verdict, peak_bytes};
use crate::pixels::Grid;
use crate::progress::Progress;
use crate::say::say;
use crate::show;

/// Which wall and scene, and for how long.
#[derive(clap::Args)]
pub struct Options {
    /// A glTF, GLB or package file, or the name of a generated scene: city, plp-city, cars, plant, palace, cathedrals, forest, garbage, boxes or
    /// boxes:LEAVES.
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
    /// The test is passed when so many percent of the frames are shown by every node within a frame's time; 99.5 if left out, 0
    /// with faults.
    #[arg(long, allow_negative_numbers = true, value_name = "PERCENT")]
    on_time: Option<f64>,
    /// Let processes of nodes die and hang: at random from a seed, or as a JSON file lists
    /// ([{"at_s": 2.5, "process": 0, "what": "kill" or "hang", "for_ms": 300}, …]).
    #[arg(long, value_name = "SEED|FILE")]
    faults: Option<String>,
    /// Milliseconds between random faults.
    #[arg(long, value_name = "MS", default_value_t = 500, value_parser = clap::value_parser!(u64).range(50..=3_600_000))]
    fault_every: u64,
    /// Set so many hostile strangers on the master, and let the wall's last node be hostile, too; the others must keep their time.
    #[arg(long, value_name = "STRANGERS", value_parser = clap::value_parser!(u32).range(1..=64))]
    hostile: Option<u32>,
    /// Write every figure (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
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
    /// Where there were faults.
    bearing: Option<Bearing>,
    /// Of all processes of protocol clients, since each was last started.
    done: Done,
    /// Connections that hostile peers made.
    hostile_connections: u64,
    master_peak_bytes: u64,
    /// At the end of each tenth of the test.
    master_bytes: Vec<u64>,
}

/// How long the first frame waits for all nodes.
const START_WAIT: Duration = Duration::from_secs(30);

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let wall = match &options.wall {
        Some(file) => open_wall(file)?,
        None => grid_wall(options.grid, 0, options.hz.unwrap_or(GRID_HZ))?,
    };
    let wall = Arc::new(wall);
    let hz = options.hz.unwrap_or(wall.rate_hz());
    ensure!((1.0..=1000.0).contains(&hz), "--hz: {hz} is outside 1 to 1000 frames a second");
    let least_on_time = options.on_time.unwrap_or(if options.faults.is_some() { 0.0 } else { 99.5 });
    ensure!((0.0..=100.0).contains(&least_on_time), "--on-time: {least_on_time} is outside 0 to 100 percent");
    let faults = options.faults.as_deref().map(Faults::open).transpose().context("--faults")?;
    let path = PathSource::open(&options.path).context("--path")?;
    options.json.as_deref().map_or(Ok(()), claim)?;
    let package = Arc::new(open_named_scene(&options.scene, &options.how.options()?)?);
    let warm_up = hz.ceil() as u64;
    let frames = warm_up + (hz * f64::from(options.seconds)).ceil() as u64 + 1;
    let path = path.path(&package, &wall, Some(frames))?;

    let listener = TcpListener::bind("127.0.0.1:0").context("cannot listen")?;
    let address = listener.local_addr()?.to_string();
    let good = wall.nodes().len() - usize::from(options.hostile.is_some());
    ensure!(good > 0, "--hostile: the wall needs a second node");
    let tally = Tally::new(wall.nodes().len() as u32, good as u32, frames);
    let mut show_options = ShowOptions::for_wall(&wall).starting_together(&wall, START_WAIT);
    show_options.start_nodes.truncate(good);
    show_options.frames = Some(frames);
    show_options.rate = Rate::Hz(hz);
    show_options.barrier_wait = Duration::from_secs_f64(1.0 / hz) + service::BARRIER_GRACE;

    let clients = ClientProcesses::start(options.clients, &wall.nodes()[..good], &address, options.processes as usize)?;
    let processes = clients.len();
    let every = Duration::from_millis(options.fault_every);
    let plan = faults.map_or(Ok(Vec::new()), |faults| faults.plan(processes, f64::from(options.seconds), every))?;
    let (first_frame, first_frame_seen) = mpsc::sync_channel(1);
    let (over, is_over) = mpsc::channel();
    let trouble = thread::spawn(move || {
        // Without a first frame there is nothing to disturb.
        let start = first_frame_seen.recv().unwrap_or_else(|_| Instant::now());
        faults::happen(&plan, clients, start + Duration::from_secs(1), &is_over)
    });
    let hostile = options.hostile.map(|strangers| HostilePeers::start(&address, strangers, &wall.nodes()[good..][0].name));
    let progress = Progress::new();
    let (of_frames, of_shows, of_leaves) = (tally.clone(), tally.clone(), tally.clone());
    let tenth = (frames / 10).max(1);
    let mut cull = show::culler(Algorithm::Sweep, &wall, &package);
    let show = Show {
        camera: show::camera(path, &wall),
        cull: Box::new(move |pose, sets| {
            cull(pose, sets);
            of_leaves.note_leaves(sets.iter().map(|set| u64::from(set.len())).sum());
        }),
        observer: Box::new(move |frame: &FrameReport| {
            of_frames.note_frame(frame);
            if (frame.number + 1).is_multiple_of(tenth) {
                of_frames.note_memory();
            }
            let _ = first_frame.try_send(Instant::now()); // it was told of the first one
            progress.show("showing", frame.number + 1, frames);
        }),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(move |node, shown| of_shows.note_shown(node, shown)),
        stop: Some(show::stop_on_interrupt()?.subscribe()),
        options: show_options,
        wall: Arc::clone(&wall),
        package: Arc::clone(&package),
    };
    service::run(listener, show)?;
    drop(over);
    let hostile_connections = hostile.as_ref().map_or(0, HostilePeers::attempts);
    drop(hostile);
    let (clients, happened) = trouble.join().map_err(|_| anyhow!("the thread that makes trouble ended unexpectedly"))??;
    let report = Report {
        scene: options.scene.clone(),
        wall: wall.name().to_owned(),
        nodes: wall.nodes().len(),
        processes,
        clients: options.clients,
        hz,
        verdict: tally.verdict(hz, warm_up as usize),
        bearing: options.faults.as_ref().map(|_| tally.bearing(&happened)),
        done: clients.finish()?,
        hostile_connections,
        master_peak_bytes: peak_bytes(),
        master_bytes: tally.memory(),
    };
    report.print();
    options.json.as_ref().map_or(Ok(()), |path| write_json(&report, path))?;
    let on_time = report.verdict.on_time_percent;
    ensure!(report.done.left == 0, "{} times a node was sent what is not the master's set", report.done.left);
    ensure!(on_time >= least_on_time, "{on_time:.2} % of the frames were on time; {least_on_time} % were asked for");
    let (next, back) = (Bearing::NEXT_FRAME_MS, Bearing::BACK_MS);
    let is_borne = report.bearing.as_ref().is_none_or(Bearing::is_good);
    ensure!(is_borne, "a fault held up the wall for more than {next} ms, or a node was not back after {back} ms");
    Ok(())
}

impl Report {
    fn print(&self) {
        let Self { scene, wall, nodes, processes, hz, verdict, bearing, done, .. } = self;
        say!("{scene} on {wall}: {nodes} nodes in {processes} processes at {hz} Hz");
        verdict.print();
        bearing.iter().for_each(Bearing::print);
        if self.hostile_connections > 0 {
            say!("hostile connections          {:10}", self.hostile_connections);
        }
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        say!(
            "memory at most               {:10.0} MiB, and {:.0} MiB of clients",
            mib(self.master_peak_bytes),
            mib(done.peak_bytes)
        );
        if let [first, .., last] = self.master_bytes[..] {
            say!(
                "memory of the master         {:10.1} MiB after a tenth of the test, {:.1} MiB at its end",
                mib(first),
                mib(last)
            );
        }
        if done.connections > 0 {
            say!("sets checked                 {:10} frames of nodes, {} not the master's", done.applied, done.left);
            say!("clocks known to              {:10} µs", done.uncertainty_us);
        }
    }
}
