//! `mullion bench`: the papers' tables and figures, measured on this machine.

mod cull;
mod figures;
mod machine;
mod measure;
mod moving;
mod occlusion;
mod plp;
mod table;

use anyhow::Result;

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
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    match &options.what {
        What::Cull(options) => cull::run(options),
        What::Occlusion(options) => occlusion::run(options),
        What::Plp(options) => plp::run(options),
    }
}
