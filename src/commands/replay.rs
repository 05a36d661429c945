//! `mullion replay`.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, ensure};
use mullion_common::scene::Package;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wire::Insertion;
use mullion_server::control::LiveScene;
use mullion_server::cull::Algorithm;
use mullion_server::library::Library;
use mullion_server::prepare::{Placement, graft};
use mullion_server::record::{Ending, Header, Reader};
use mullion_server::service::{FreshScene, Offer};

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
    /// The folder of packages that were inserted.
    #[arg(long = "library", value_name = "DIR")]
    insert_from: Option<PathBuf>,
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
    let library = options
        .insert_from
        .as_deref()
        .map(|folder| Library::open(folder).with_context(|| format!("--library: {}", folder.display())));
    let library = library.transpose()?;
    let first = Arc::new(open_scene(&options.scene, &options.how.options()?)?);
    let mut package = Arc::clone(&first);
    let same = Header::of(&wall, &package, algorithm.name(), 0.0, "")?;
    reader.header().check_same(&same).map_err(|e| anyhow!("{shown}: {e}"))?;
    let mut scene = LiveScene::new(algorithm, &wall, &package);
    let views = wall.views().len();
    let mut sets = vec![VisibleSet::default(); views];
    let mut frames = 0u64;
    let mut objects = package.scene.objects.len();
    let mut is_offered = false;
    while let Some(mut frame) = reader.next_frame().with_context(|| shown.clone())? {
        let number = frame.number;
        if let Some(insertions) = &frame.begins_with {
            let fresh = grown(&first, insertions, library.as_ref()).with_context(|| format!("{shown}: frame {number}"))?;
            package = Arc::clone(fresh.package());
            (objects, is_offered) = (package.scene.objects.len(), false);
            frame.pose.begins_with = Some(Arc::new(fresh));
        }
        let grown = package.scene.objects.len();
        if let Some(insertion) = &frame.insertion {
            let offer = offer(&package, insertion, library.as_ref()).with_context(|| format!("{shown}: frame {number}"))?;
            package = Arc::clone(offer.package());
            frame.pose.offer = Some(Arc::new(offer));
        }
        let may_grow = is_offered;
        is_offered = may_grow && !frame.pose.grows || frame.insertion.is_some();
        ensure!(may_grow || !frame.pose.grows, "{shown}: frame {number}: the scene grows, though nothing was inserted");
        let is_second = may_grow && !frame.pose.grows && frame.insertion.is_some();
        ensure!(!is_second, "{shown}: frame {number}: a second insertion before the first was seen");
        if frame.pose.grows {
            objects = grown;
        }
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

/// The package of an insertion.
fn inserted(insertion: &Insertion, library: Option<&Library>) -> Result<Package> {
    let name = &insertion.package;
    let library = library.ok_or_else(|| anyhow!("package {name:?} was inserted: name its folder with --library"))?;
    Ok(library.inserted(insertion)?)
}

/// The scene that an insertion made.
fn offer(base: &Arc<Package>, insertion: &Insertion, library: Option<&Library>) -> Result<Offer> {
    let added = inserted(insertion, library)?;
    let Placement { name, under, world_from_root } = Placement::of(insertion);
    Ok(Offer::new(base, &added, &name, under, world_from_root)?.0)
}

/// The scene that insertions under another master made.
fn grown(first: &Arc<Package>, insertions: &[Insertion], library: Option<&Library>) -> Result<FreshScene> {
    let mut package = Arc::clone(first);
    for insertion in insertions {
        package = Arc::new(graft(&package, &inserted(insertion, library)?, &Placement::of(insertion))?);
    }
    Ok(FreshScene::new(package, insertions.to_vec()))
}
