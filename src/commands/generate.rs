//! `mullion generate`.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use mullion_server::generate::{Boxes, BoxesShape, GeneratedScene, Planet, write_glb};

use crate::say::say;

/// What to generate and where to.
#[derive(clap::Args)]
pub struct Options {
    /// Name of the scene: city, plp-city, cars, plant, palace, cathedrals, forest, garbage, boxes,
    /// planet, hills or organic.
    scene: GeneratedScene,
    /// The GLB file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Another seed gives another scene; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// As large as the city that is drawn to a budget: the same as plp-city (with city only).
    #[arg(long)]
    plp: bool,
    /// How many boxes, 1 to 10000000 (with boxes only) [default: 100000].
    #[arg(long, value_name = "N")]
    leaves: Option<u64>,
    /// How the file holds them: flat (instances of one node) or tree (with boxes only) [default: flat].
    #[arg(long)]
    shape: Option<BoxesShape>,
    /// How many vertices, 6 to 67108864, as nearly as it goes (with planet only) [default: 16777218].
    #[arg(long, value_name = "N")]
    vertices: Option<u64>,
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let report = write_glb(scene(options)?, options.seed, &options.out)?;
    say!(
        "{}: {} triangles, {} objects, {} nodes, {} bytes",
        options.out.display(),
        report.triangles,
        report.objects,
        report.nodes,
        report.bytes
    );
    Ok(())
}

/// The named scene, with what only boxes take.
fn scene(options: &Options) -> Result<GeneratedScene> {
    if options.plp {
        return match options.scene {
            GeneratedScene::City | GeneratedScene::PlpCity => Ok(GeneratedScene::PlpCity),
            other => bail!("--plp: only the city takes it, {other} does not"),
        };
    }
    if let Some(vertices) = options.vertices {
        return match options.scene {
            GeneratedScene::Planet(_) => Ok(GeneratedScene::Planet(Planet::new(vertices).context("--vertices")?)),
            other => bail!("--vertices: only the planet takes it, {other} does not"),
        };
    }
    let given = [("--leaves", options.leaves.is_some()), ("--shape", options.shape.is_some())];
    match (options.scene, given.iter().find(|(_, is_given)| *is_given)) {
        (GeneratedScene::Boxes(default), _) => {
            let leaves = options.leaves.unwrap_or(default.leaves().into());
            let boxes = Boxes::new(leaves, options.shape.unwrap_or(default.shape())).context("--leaves")?;
            Ok(GeneratedScene::Boxes(boxes))
        }
        (other, Some((flag, _))) => bail!("{flag}: only boxes take it, {other} does not"),
        (other, None) => Ok(other),
    }
}
