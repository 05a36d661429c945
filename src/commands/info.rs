//! `mullion info`.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{ObjectId, Scene};
use mullion_server::prepare::{SceneStatistics, statistics};
use serde::Serialize;

use super::prepare::HowToPrepare;
use crate::files::{is_standard_output, open_scene, write_json};
use crate::say::say;

/// Which scene, and how to tell.
#[derive(clap::Args)]
pub struct Options {
    /// Package, glTF or GLB file.
    file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Also write, for each leaf, where it comes from in the source file and its bounds (JSON; `-` for standard output).
    #[arg(long, value_name = "FILE")]
    leaves: Option<PathBuf>,
    #[command(flatten)]
    how: HowToPrepare,
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let is_piped = options.leaves.as_deref().is_some_and(is_standard_output);
    ensure!(!(options.json && is_piped), "--json and --leaves - both go to standard output: give --leaves a file");
    let package = open_scene(&options.file, &options.how.options()?)?;
    let counts = statistics(&package);
    if is_piped {
        return write_json(&leaf_reports(&package.scene), Path::new("-"));
    }
    if options.json {
        write_json(&counts, Path::new("-"))?;
    } else {
        print_counts(&options.file, &counts);
    }
    options.leaves.as_ref().map_or(Ok(()), |path| write_json(&leaf_reports(&package.scene), path))
}

fn print_counts(file: &Path, s: &SceneStatistics) {
    say!("{}", file.display());
    say!(
        "  file        {} nodes with triangles ({} inner), average branching {:.2}; {} objects with instances",
        s.file_nodes,
        s.file_inner_nodes,
        s.file_branching,
        s.objects
    );
    say!(
        "  cull tree   {} nodes ({} inner, {} leaves), average branching {:.2}, depth {}",
        s.nodes,
        s.inner_nodes,
        s.leaves,
        s.average_branching,
        s.depth
    );
    say!("  triangles   {} unique, {} with instances", s.triangles_unique, s.triangles_instanced);
    say!("  chunks      {} of geometry, {} of textures, {} bytes", s.geometry_chunks, s.texture_chunks, s.chunk_bytes);
    say!("  materials   {}", s.materials);
    match s.bounds_m {
        Some([min, max]) => say!("  bounds      {min:.3?} to {max:.3?} m"),
        None => say!("  bounds      none: the scene has no triangles"),
    }
}

/// A leaf as anyone can check it against the source file.
#[derive(Serialize)]
struct LeafReport {
    leaf: u32,
    /// Index of the glTF node, and the names on the way to it.
    node: u32,
    path: String,
    mesh: u32,
    primitive: u32,
    instance: Option<u32>,
    /// Indices of the primitive's triangles in the source file.
    triangles: Vec<u32>,
    /// World space, metres.
    obb: Obb,
    aabb: Aabb,
}

fn leaf_reports(scene: &Scene) -> Vec<LeafReport> {
    let leaf_nodes = scene.hierarchy.nodes().iter().enumerate().filter(|(i, n)| n.subtree_end as usize == i + 1);
    let report = |(leaf, (_, node)): (usize, (usize, &mullion_common::scene::OhNode))| {
        let record = &scene.manifest.leaves[leaf];
        let source = &scene.sources.leaves[leaf];
        let object = &scene.objects[record.object.0 as usize];
        LeafReport {
            leaf: leaf as u32,
            node: object.source_node,
            path: object_path(scene, record.object),
            mesh: source.mesh,
            primitive: source.primitive,
            instance: object.instance,
            triangles: scene.sources.triangles_of(leaf as u32).to_vec(),
            obb: node.bound,
            aabb: record.local_aabb().transformed(&scene.manifest.transforms[record.object.0 as usize].affine()),
        }
    };
    leaf_nodes.enumerate().map(report).collect()
}

/// The names from the root to an object, joined by `/`; a node without a name is called by its index.
pub fn object_path(scene: &Scene, object: ObjectId) -> String {
    let mut names = Vec::new();
    let mut next = Some(object);
    while let Some(id) = next {
        let object = &scene.objects[id.0 as usize];
        names.push(match (object.instance, object.name.as_str()) {
            (Some(instance), _) => format!("[{instance}]"),
            (None, "") => format!("#{}", object.source_node),
            (None, name) => name.to_owned(),
        });
        next = object.parent;
    }
    names.reverse();
    names.join("/")
}
