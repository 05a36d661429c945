//! `mullion replay`.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, ensure};
use mullion_common::visible_set::VisibleSet;
use mullion_server::control::LiveScene;
use mullion_server::cull::Algorithm;
use mullion_server::record::{Ending, Header, Reader};

use super::prepare::HowToPrepare;
use crate::files::{open_scene, open_wall};
use crate::say::say;

/// Which record, and of what.
#[derive(clap::Args)]
pub struct Options {
    /// What `serve --record` wrote.
    record: PathBuf,
    /// The wall file that was served.
    #[arg(long)]
    wall: PathBuf,
    /// The scene that was served.
    #[arg(long)]
    scene: PathBuf,
    #[command(flatten)]
    how: HowToPrepare,
}

/// Runs the command: an error where any view's set differs.
pub fn run(options: &Options) -> Result<()> {
    let shown = options.record.display().to_string();
    let file = File::open(&options.record).with_context(|| shown.clone())?;
    let mut reader = Reader::open(BufReader::new(file)).with_context(|| shown.clone())?;
    let algorithm: Algorithm = reader.header().algorithm.parse().map_err(|e: String| anyhow!("{shown}: {e}"))?;
    let wall = Arc::new(open_wall(&options.wall)?);
    let package = Arc::new(open_scene(&options.scene, &options.how.options()?)?);
    let same = Header::of(&wall, &package, algorithm.name(), 0.0, "")?;
    reader.header().check_same(&same).map_err(|e| anyhow!("{shown}: {e}"))?;
    let mut scene = LiveScene::new(algorithm, &wall, &package);
    let (views, objects) = (wall.views().len(), package.scene.objects.len());
    let mut sets = vec![VisibleSet::default(); views];
    let mut frames = 0u64;
    while let Some(frame) = reader.next_frame().with_context(|| shown.clone())? {
        let number = frame.number;
        frame.pose.check(views, objects).map_err(|e| anyhow!("{shown}: frame {number}: {e}"))?;
        ensure!(frame.digests.len() == views, "{shown}: frame {number}: digests of {} views, not {views}", frame.digests.len());
        scene.cull(&frame.pose, &mut sets);
        if let Some(view) = sets.iter().zip(&frame.digests).position(|(set, digest)| set.digest() != *digest) {
            let view = wall.views()[view];
            let tile = &wall.tile(view.tile).name;
            return Err(anyhow!(
                "{shown}: frame {number}: tile {tile} ({:?} eye) sees something else than was recorded",
                view.eye
            ));
        }
        frames += 1;
    }
    let ending = match reader.ending() {
        Some(Ending::Complete) => "to the end of the show",
        Some(Ending::GivenUp) => "until recording was given up, since the disk fell behind",
        None => "until the file was cut off",
    };
    say!("{frames} frames of {views} views: the same sets, bit for bit, {ending}");
    Ok(())
}
