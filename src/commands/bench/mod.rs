//! `mullion bench`: the papers' tables and figures, measured on this machine.

mod cull;
mod figures;
mod lod;
mod machine;
mod measure;
mod moving;
mod occlusion;
mod plp;
mod table;

use std::fs;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use mullion_client::gpu::{Gpu, GpuOptions};

use crate::files::claim;
use crate::say::say;

/// What to measure.
#[derive(clap::Args)]
pub struct Options {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Cull times of all algorithms on the same frames, beside each other.
    Cull(cull::Options),
    /// Occlusion culling beside frustum culling alone, on the same frames.
    Occlusion(occlusion::Options),
    /// What estimates within a budget of triangles find of the visible set, without a GPU.
    Plp(plp::Options),
    /// What occlusion does for level of detail: triangles that are seen, and what it costs.
    Lod(lod::Options),
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    match &options.what {
        What::Cull(options) => cull::run(options),
        What::Occlusion(options) => occlusion::run(options),
        What::Plp(options) => plp::run(options),
        What::Lod(options) => lod::run(options),
    }
}

/// A GPU, if there is one; says where there is none.
fn open_gpu(is_piped: bool) -> Option<Arc<Gpu>> {
    match Gpu::open(GpuOptions::default()) {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            if !is_piped {
                say!("nothing is drawn: {error}");
            }
            None
        }
    }
}

/// Creates the file and the folder that results go to, so that long work does not end with nowhere to write them.
fn claim_outputs(json: Option<&Path>, plots: Option<&Path>) -> Result<()> {
    json.map_or(Ok(()), claim)?;
    plots.map_or(Ok(()), |folder| {
        fs::create_dir_all(folder).with_context(|| format!("--plots: cannot make the folder {}", folder.display()))
    })
}
