//! How a show is steered: the control API.

use std::fs::File;
use std::io::BufWriter;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use mullion_common::camera_path::CameraPath;
use mullion_common::scene::Package;
use mullion_common::wall::Wall;
use mullion_server::control::http::{self, Reach, Server};
use mullion_server::control::{self, Board, Driver, LiveScene};
use mullion_server::cull::Algorithm;
use mullion_server::library::Library;
use mullion_server::metrics::MetricsReader;
use mullion_server::record::{Header, Recorder};
use mullion_server::service::{Camera, Cull, Succession};

use crate::files::set_aside;
use crate::say::say;

/// Who steers.
#[derive(clap::Args)]
pub struct Steering {
    /// Let programs steer the show: an address for the control API (docs/control.md). Off if left out.
    #[arg(long, value_name = "ADDRESS")]
    control: Option<SocketAddr>,
    /// Let --control be an address that other machines reach. Whoever reaches it steers the wall: keep it on a network of its own.
    #[arg(long, requires = "control")]
    control_from_network: bool,
    /// Let packages of this folder, as `mullion prepare` writes them, be inserted into the running show: through --control, or, of a
    /// standby, by its master.
    #[arg(long = "library", value_name = "DIR")]
    insert_from: Option<PathBuf>,
    /// Write down all that comes in, for `mullion replay`.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
}

/// The parts of a show that is steered.
pub struct Steered {
    pub camera: Camera,
    pub cull: Cull,
    pub board: Arc<Board>,
    pub succession: Succession,
    /// Listens until it is dropped.
    pub server: Option<Server>,
}

impl Steering {
    /// Whether the options fit together; before anything takes long.
    pub fn check(&self, standby_of: Option<&str>) -> Result<()> {
        if let Some(address) = self.control {
            ensure!(
                address.ip().is_loopback() || self.control_from_network,
                "--control: other machines reach {address}, and whoever reaches it steers the wall; add --control-from-network to allow that"
            );
        }
        let is_of_use = self.insert_from.is_none() || self.control.is_some() || standby_of.is_some();
        ensure!(is_of_use, "--library: nobody could insert anything; add --control, or --standby-of");
        self.packages().map(|_| ())
    }

    /// What may be inserted.
    pub fn packages(&self) -> Result<Option<Library>> {
        let open = |folder: &PathBuf| Library::open(folder).with_context(|| format!("--library: {}", folder.display()));
        self.insert_from.as_ref().map(open).transpose()
    }

    /// Starts what listens.
    pub fn start(
        &self,
        path: CameraPath,
        (path_name, rate_hz): (&str, f64),
        algorithm: Algorithm,
        wall: &Arc<Wall>,
        package: &Arc<Package>,
        metrics: MetricsReader,
    ) -> Result<Steered> {
        let (mut inlet, batches, questions) = control::channel(wall, package);
        if let Some(library) = self.packages()? {
            inlet = inlet.inserting_from(library).context("--library")?;
        }
        let mut driver = Driver::new(Arc::clone(wall), path, batches);
        let board = Arc::new(Board::new(wall, driver.clock()));
        let mut scene = LiveScene::new(algorithm, wall, package).answering(questions);
        let server = self.control.map(|address| {
            let listener = TcpListener::bind(address).with_context(|| format!("--control: cannot listen on {address}"))?;
            let reach = if self.control_from_network { Reach::Network } else { Reach::Loopback };
            say!("steer it at:        http://{}/status", listener.local_addr()?);
            http::start(listener, inlet, Arc::clone(&board), metrics, reach).context("--control")
        });
        let mut recorder = match &self.record {
            Some(file) => {
                let header = Header::of(wall, package, algorithm.name(), rate_hz, path_name)?;
                if let Some(older) = set_aside(file).context("--record")? {
                    say!("an older record:    {}", older.display());
                }
                let out = File::create(file).with_context(|| format!("--record: {}", file.display()))?;
                Some(Recorder::start(BufWriter::new(out), &header).with_context(|| format!("--record: {}", file.display()))?)
            }
            None => None,
        };
        let succession = driver.succession();
        Ok(Steered {
            succession,
            camera: Box::new(move |frame| driver.pose(frame)),
            cull: Box::new(move |pose, sets| {
                scene.cull(pose, sets);
                recorder.iter_mut().for_each(|recorder| recorder.note(pose, sets));
            }),
            board,
            server: server.transpose()?,
        })
    }
}
