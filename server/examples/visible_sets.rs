//! Per-tile visible sets through the API: `cargo run --release --example visible_sets -- scene.glb wall.toml`.

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DVec3};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::WallConfig;
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::prepare::{self, PrepareOptions, scene_bounds};
use mullion_server::tree::CullTree;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, wall] = arguments.as_slice() else {
        return Err("usage: visible_sets SCENE WALL.toml".into());
    };
    let wall = WallConfig::parse(&std::fs::read_to_string(wall)?)?;
    let start = Instant::now();
    let package = prepare::open(Path::new(scene), &PrepareOptions::default(), &|_, _, _| {})?.package;
    println!("prepared in {:.2} s", start.elapsed().as_secs_f64());

    // The room stands in the middle of the scene, and looks along -Z.
    let middle = scene_bounds(&package).map_or(DVec3::ZERO, |bounds| bounds.center());
    let world_from_room = DAffine3::from_translation(middle);
    let tree = CullTree::new(Arc::clone(&package.scene.hierarchy));
    let mut culler = Culler::new(Algorithm::Sweep, &wall);
    let mut sets = vec![VisibleSet::default(); wall.views().len()];
    culler.cull(&tree, &wall, &wall.default_eyes(), &world_from_room, &mut sets);
    let start = Instant::now();
    let stats = culler.cull(&tree, &wall, &wall.default_eyes(), &world_from_room, &mut sets);
    println!("culled in {:.1} µs, {} nodes visited", start.elapsed().as_secs_f64() * 1e6, stats.nodes_visited);
    for (view, set) in wall.views().iter().zip(&sets) {
        let (leaves, all) = (set.len(), package.scene.leaf_count());
        println!("{:8} {leaves:7} of {all} leaves in {} ranges", wall.tile(view.tile).name, set.ranges().len());
    }
    Ok(())
}
