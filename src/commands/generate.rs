//! `mullion generate`.

use std::path::PathBuf;

use anyhow::Result;
use mullion_server::generate::{GeneratedScene, write_glb};

use crate::say::say;

/// What to generate and where to.
#[derive(clap::Args)]
pub struct Options {
    /// Name of the scene: city.
    scene: GeneratedScene,
    /// The GLB file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Another seed gives another scene; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let report = write_glb(options.scene, options.seed, &options.out)?;
    say!("{}: {} triangles, {} nodes, {} bytes", options.out.display(), report.triangles, report.nodes, report.bytes);
    Ok(())
}
