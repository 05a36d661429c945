//! `mullion serve`.

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail, ensure};
use mullion_server::cull::Algorithm;
use mullion_server::metrics::Metrics;
use mullion_server::service::{self, FrameReport, MasterTls, NodeEvent, Rate, Security, Show, ShowOptions};

use super::prepare::HowToPrepare;
use super::quality::QualityOptions;
use super::steering::Steering;
use crate::address::{DEFAULT_PORT, with_port};
use crate::camera::PathSource;
use crate::files::{claim, open_identity, open_scene, open_wall, write_json};
use crate::progress::Progress;
use crate::say::say;
use crate::show::{self, Record};

/// Which wall shows which scene, and how.
#[derive(clap::Args)]
pub struct Options {
    /// Wall file.
    wall: PathBuf,
    /// Package, glTF or GLB file.
    scene: PathBuf,
    /// Address to listen on. One that other machines reach needs --identity or --insecure.
    #[arg(long, value_name = "ADDRESS", default_value_t = SocketAddr::from(([127, 0, 0, 1], DEFAULT_PORT)))]
    listen: SocketAddr,
    /// The master.pem that `mullion enroll` wrote, or a standbys/NAME.pem: take only peers with certificates of the same authority, over TLS.
    #[arg(long, value_name = "FILE", conflicts_with = "insecure")]
    identity: Option<PathBuf>,
    /// Without certificates, take any node that knows a name of the wall, from other machines, too. Whoever reaches the address can then
    /// fetch the scene: keep the wall on a network of its own.
    #[arg(long)]
    insecure: bool,
    /// End after so many frames; go on until stopped if left out.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// Frames a second; the wall file's if left out, 0 for as many as the tiles can show.
    #[arg(long, allow_negative_numbers = true, value_name = "HZ")]
    rate: Option<f64>,
    /// Hold the first frame until every node is there, but no longer than so many seconds.
    #[arg(long, allow_negative_numbers = true, value_name = "SECONDS", default_value_t = 0.0)]
    wait: f64,
    /// How long a frame waits for a tile that was ready for the last one, milliseconds; a frame's time and 4 ms if left out.
    #[arg(long, allow_negative_numbers = true, value_name = "MS")]
    barrier: Option<f64>,
    /// Stand by for the master at this address, and go on with its show when it is gone. Wall and scene must be the same, and --library
    /// must hold what is inserted there.
    #[arg(long, value_name = "HOST[:PORT]")]
    standby_of: Option<String>,
    /// Leave out, on all tiles alike, objects that hardly contribute: whose boxes' visible pixels, on all tiles together and weighted by
    /// distance, are less than this share of the wall's (0.0001: a pixel in ten thousand). Pictures change a little.
    #[arg(long, allow_negative_numbers = true, value_name = "THRESHOLD", value_parser = show::share_of_wall)]
    adaptive: Option<f64>,
    #[command(flatten)]
    quality: QualityOptions,
    /// sweep, adaptive, adaptive-grouped, oh, fh, oh-plain or naive.
    #[arg(long, default_value = "sweep")]
    algorithm: Algorithm,
    /// Camera path: a file, or a walk made for the scene: orbit, whole, interior, flythrough, pan.
    #[arg(long, value_name = "FILE|NAME", default_value = "orbit")]
    path: String,
    /// Write what happened when the show has ended (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    #[command(flatten)]
    steering: Steering,
    #[command(flatten)]
    how: HowToPrepare,
}

/// How often the log says how far the show is, where there is no bar.
const TELL_EVERY: Duration = Duration::from_secs(1);

impl Options {
    /// How connections are secured; refuses an open door that nobody asked for.
    fn security(&self) -> Result<Security> {
        match &self.identity {
            Some(path) => {
                let identity = open_identity(path).context("--identity")?;
                Ok(Security::Tls(MasterTls::new(identity).map_err(|e| anyhow!("--identity: {}: {e}", path.display()))?))
            }
            None if self.insecure || self.listen.ip().is_loopback() => Ok(Security::Plain),
            None => bail!(
                "--listen: other machines reach {}: make certificates with `mullion enroll {} --out DIR` and name --identity \
                 DIR/master.pem, or let in anyone with --insecure",
                self.listen,
                self.wall.display()
            ),
        }
    }
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let wall = Arc::new(open_wall(&options.wall)?);
    let path = PathSource::open(&options.path).context("--path")?;
    let rate_hz = options.rate.unwrap_or(wall.rate_hz());
    ensure!((0.0..=1000.0).contains(&rate_hz), "--rate: {rate_hz} is outside 0 to 1000 frames a second");
    ensure!((0.0..=86_400.0).contains(&options.wait), "--wait: {} is outside 0 to 86400 s", options.wait);
    let barrier_ms = options.barrier.unwrap_or(1000.0 / rate_hz.clamp(1.0, 1000.0) + 4.0);
    ensure!((0.1..=60_000.0).contains(&barrier_ms), "--barrier: {barrier_ms} is outside 0.1 to 60000 ms");
    let security = options.security()?;
    options.report.as_deref().map_or(Ok(()), claim)?;
    options.steering.check(options.standby_of.as_deref())?;
    let quality = options.quality.chosen(rate_hz)?;
    let package = Arc::new(open_scene(&options.scene, &options.how.options()?)?);
    quality.check_tessellation(&package, options.scene.display())?;
    quality.check_hierarchies(&package, options.scene.display())?;
    let listener = TcpListener::bind(options.listen).with_context(|| format!("cannot listen on {}", options.listen))?;
    let address = listener.local_addr()?;
    if options.insecure && !address.ip().is_loopback() {
        eprintln!("warning: {address} takes any node that knows a name of the wall: keep it on a network of its own");
    }
    say!("serving {} to wall {} on {address}", options.scene.display(), wall.name());
    let first = &wall.nodes()[0].name;
    match security {
        Security::Plain => say!("start a tile with:  mullion tile {first} --master {address}"),
        Security::Tls(_) => say!("start a tile with:  mullion tile {first} --master {address} --identity {first}.pem"),
    }

    let mut show_options = ShowOptions::for_wall(&wall);
    if options.wait > 0.0 {
        show_options = show_options.starting_together(&wall, Duration::from_secs_f64(options.wait));
    }
    show_options.security = security;
    show_options.frames = options.frames;
    show_options.standby_of = options.standby_of.as_deref().map(with_port);
    show_options.adaptive = options.adaptive;
    quality.apply_to(&mut show_options);
    show_options.insert_from = options.steering.packages()?;
    show_options.rate = if rate_hz == 0.0 { Rate::AsFastAsPossible } else { Rate::Hz(rate_hz) };
    show_options.barrier_wait = Duration::from_secs_f64(barrier_ms / 1000.0);

    let path = path.path(&package, &wall, options.frames)?;
    let (metrics, reader) = Metrics::new(&wall);
    let steered = options.steering.start(path, (&options.path, rate_hz), options.algorithm, &wall, &package, reader)?;
    show_options.succession = steered.succession;
    let metrics = Arc::new(Mutex::new(metrics));
    let progress = Arc::new(Progress::new());
    let lines = Arc::clone(&progress);
    let of_nodes = Arc::clone(&metrics);
    let tell_of_node = move |event: &NodeEvent| match event {
        NodeEvent::Joined { node, address } => lines.line(&format!("node {node} joined from {address}")),
        NodeEvent::Left { node, reason } => lines.line(&format!("node {node} left: {reason}")),
        NodeEvent::StoodIn { node, spare } => lines.line(&format!("spare {spare} takes the place of node {node}")),
        NodeEvent::StandingBy { master } => lines.line(&format!("standing by for the master at {master}")),
        NodeEvent::SteppedBack { master, reason } => {
            lines.line(&format!("the master at {master} drives the wall ({reason}): stepping back"));
        }
        NodeEvent::TookOver { master, frame, reason } => {
            lines.line(&format!("the master at {master} is gone ({reason}): going on from frame {frame}"));
        }
    };
    let node_observer = move |event: &NodeEvent| {
        tell_of_node(event);
        locked(&of_nodes).note_node(event);
    };
    let node_names: Vec<String> = wall.nodes().iter().map(|n| n.name.clone()).collect();
    let record = Record::new(&wall, &package);
    let noted = record.clone();
    let total = options.frames;
    let of_total = total.map_or_else(String::new, |total| format!(" of {total}"));
    let mut told: Option<Instant> = None;
    let board = Arc::clone(&steered.board);
    let of_frames = Arc::clone(&metrics);
    let observer = move |frame: &FrameReport| {
        for node in &frame.passed_over {
            progress.line(&format!(
                "frame {}: {} was not ready, its picture stays",
                frame.number,
                node_names[usize::from(node.0)]
            ));
        }
        let shown = frame.number + 1;
        progress.show("showing", shown, total.unwrap_or(shown));
        if !progress.is_visible() && told.is_none_or(|at| at.elapsed() >= TELL_EVERY) {
            told = Some(Instant::now());
            let spent = match frame.spent {
                Some(spent) if spent.is_complete => ", with all that they see".to_owned(),
                Some(spent) => format!(", to {} triangles", spent.triangles),
                None => String::new(),
            };
            progress.line(&format!("frame {shown}{of_total}: {} of {} nodes show it{spent}", frame.shown_by, node_names.len()));
        }
        noted.note(frame);
        board.note(frame);
        locked(&of_frames).note_frame(frame);
    };
    let stop = show::stop_on_interrupt()?;
    let report = service::run(
        listener,
        Show {
            camera: steered.camera,
            cull: record.culler(steered.cull),
            observer: Box::new(observer),
            node_observer: Box::new(node_observer),
            shown_observer: Box::new(move |node, shown| locked(&metrics).note_shown(node, shown)),
            stop: Some(stop.subscribe()),
            options: show_options,
            wall: Arc::clone(&wall),
            package: Arc::clone(&package),
        },
    )?;
    drop(steered.server);
    let summary = record.summary(&options.scene.display().to_string(), &wall, &report);
    summary.print();
    options.report.as_ref().map_or(Ok(()), |path| write_json(&summary, path))
}

/// All who note something are called from the master's loop: nobody ever waits.
fn locked(metrics: &Mutex<Metrics>) -> MutexGuard<'_, Metrics> {
    metrics.lock().unwrap_or_else(PoisonError::into_inner)
}
