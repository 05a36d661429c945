//! `mullion tile`.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, ensure};
use mullion_client::disk_cache::DiskCache;
use mullion_client::gpu::{Gpu, GpuOptions};
use mullion_client::gpu_painter::{GpuPainter, Output};
use mullion_client::missing::WhenMissing;
use mullion_client::node::{self, Connector, DEFAULT_MEMORY_BYTES, NodeOptions, NodeReport, NodeTls, Reconnect, Security};
use mullion_client::occlusion::Occlusion;
use mullion_client::output::window::{Cover, Display, WindowOptions};
use mullion_common::wire::Part;
use tokio::sync::watch;

use crate::address::with_port;
use crate::files::open_identity;
use crate::say::say;
use crate::show::stop_on_interrupt;

/// Which node to be, of which master, and where pictures go.
#[derive(clap::Args)]
pub struct Options {
    /// The node's name in the wall file; a tile that no node drives is a node of its own name. With --spare, any name.
    name: String,
    /// Host and port of the master; the port may be left out. Further ones, after commas, are masters that stand by for it.
    #[arg(long, value_name = "HOST[:PORT]", default_value = "127.0.0.1", value_delimiter = ',')]
    master: Vec<String>,
    /// Wait until a node of the wall is missing, and stand in for it until it is back.
    #[arg(long)]
    spare: bool,
    /// The nodes/NAME.pem that `mullion enroll` wrote for this node, or a spares/NAME.pem with --spare and the name in it: speak TLS, and only
    /// with masters of that wall.
    #[arg(long, value_name = "FILE")]
    identity: Option<PathBuf>,
    /// Show no window; write each tile's picture into this folder when the show ends.
    #[arg(long, value_name = "DIR", conflicts_with = "fullscreen")]
    headless: Option<PathBuf>,
    /// Write the pictures every so many frames as well.
    #[arg(long, value_name = "FRAMES", default_value_t = 0, requires = "headless")]
    every: u64,
    /// Cover the whole screen.
    #[arg(long)]
    fullscreen: bool,
    /// What geometry and textures may take on the GPU, MiB; what was not in view for longest goes first.
    #[arg(long, value_name = "MIB", default_value_t = DEFAULT_MEMORY_BYTES >> 20,
          value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    memory_mib: u64,
    /// What to show of what has not come yet: box, hold (the last picture, until everything is there) or nothing.
    #[arg(long, value_name = "box|hold|nothing", default_value_t = WhenMissing::Box)]
    missing: WhenMissing,
    /// How to leave out what others hide: none, paper, sampled, cost-adaptive, query or hiz. The pictures are the same, but of sampled while
    /// something moves. hiz is left off by itself where it does not pay.
    #[arg(long, value_name = "MODE", default_value_t = Occlusion::Hiz)]
    occlusion: Occlusion,
    /// Folder for geometry and textures, so that a restart fetches only what is new; nodes of one machine may share it. The user's cache
    /// folder if left out.
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// What the cache may take on disk, MiB; what was not used for longest goes first. 0: no cache.
    #[arg(long, value_name = "MIB", default_value_t = DEFAULT_CACHE_MIB, value_parser = clap::value_parser!(u64).range(0..=1 << 30))]
    cache_mib: u64,
    /// End when the master has been out of reach for so many seconds; try for ever if left out.
    #[arg(long, allow_negative_numbers = true, value_name = "SECONDS")]
    give_up_after: Option<f64>,
}

const DEFAULT_CACHE_MIB: u64 = 8 << 10;

impl Options {
    /// How connections are secured.
    fn security(&self) -> Result<Security> {
        let Some(path) = &self.identity else { return Ok(Security::Plain) };
        let identity = open_identity(path).context("--identity")?;
        Ok(Security::Tls(NodeTls::new(identity).map_err(|e| anyhow!("--identity: {}: {e}", path.display()))?))
    }

    /// The cache that was asked for. That of the user is used where it can be; a folder that was named must be usable.
    fn open_cache(&self) -> Result<Option<Arc<DiskCache>>> {
        if self.cache_mib == 0 {
            return Ok(None);
        }
        let open = |folder: PathBuf| DiskCache::open(folder, self.cache_mib << 20).map(Arc::new);
        match (&self.cache, dirs::cache_dir()) {
            (Some(folder), _) => {
                open(folder.clone()).map(Some).with_context(|| format!("--cache: cannot use {}", folder.display()))
            }
            (None, Some(users)) => Ok(open(users.join("mullion")).inspect_err(|e| tracing::warn!("no cache: {e}")).ok()),
            (None, None) => Ok(None),
        }
    }
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let seconds = options.give_up_after;
    ensure!(seconds.is_none_or(|s| (0.0..=1e9).contains(&s)), "--give-up-after: not a number of seconds");
    let reconnect = Reconnect { give_up_after: seconds.map(Duration::from_secs_f64), ..Reconnect::default() };
    let stop = stop_on_interrupt()?;
    let node_options = NodeOptions {
        masters: options.master.iter().map(|master| with_port(master)).collect(),
        connector: Connector::default(),
        part: if options.spare { Part::Spare } else { Part::Own },
        node: options.name.clone(),
        credentials: None,
        security: options.security()?,
        memory_bytes: options.memory_mib << 20,
        when_missing: options.missing,
        cache: options.open_cache()?,
        reconnect,
        stop: Some(stop.subscribe()),
    };
    let report = match &options.headless {
        Some(folder) => {
            let gpu = Gpu::open(GpuOptions::default())?;
            let mut painter =
                GpuPainter::new(gpu, Output::Folder { folder: folder.clone(), every: options.every }).culling(options.occlusion);
            let report = node::run(node_options, &mut painter)?;
            painter.write_pictures().map_err(|e| anyhow!("{e}"))?;
            report
        }
        None => run_in_window(options, node_options, &stop)?,
    };
    let NodeReport { drawn, shown, blob_bytes, cached_bytes, .. } = report;
    say!("{}: {drawn} frames drawn, {shown} shown, {blob_bytes} bytes of scene, and {cached_bytes} from the cache", options.name);
    Ok(())
}

/// The window has the main thread; the node runs beside it.
fn run_in_window(options: &Options, node_options: NodeOptions, stop: &watch::Sender<bool>) -> Result<NodeReport> {
    let display = Display::open()?;
    let gpu = Gpu::open(GpuOptions { display: Some(display.handle()), ..GpuOptions::default() })?;
    let feed = display.feed();
    let mut painter = GpuPainter::new(Arc::clone(&gpu), Output::OwnWindow(feed.clone())).culling(options.occlusion);
    let cover = if options.fullscreen { Cover::Screen } else { Cover::Window };
    let title = format!("Mullion {}", options.name);
    let node_thread = std::thread::spawn(move || {
        let result = node::run(node_options, &mut painter);
        feed.close();
        result
    });
    const START_PX: [u32; 2] = [960, 540];
    // The node learns its views from the master; the window lays them out as they come.
    let window = display.run(gpu, WindowOptions { title, size_px: START_PX, cover, tiles: Vec::new() });
    // Without a master there are no frames by which the node would notice.
    stop.send_replace(true);
    window?;
    node_thread.join().map_err(|_| anyhow!("the node's thread ended unexpectedly"))?.map_err(Into::into)
}
