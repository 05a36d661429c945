//! Goal: to a wall's budget all nodes draw the same cut, whoever draws which tiles; without a bound, or where it is completed, every tile has
//! the picture that it has without an estimate, moved objects among them. Method: painters without a network, of one node and of four, on
//! clustered boxes seen from their midst.

mod support;

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use image::RgbaImage;
use mullion_client::gpu::{Gpu, GpuOptions};
use mullion_client::gpu_painter::{GpuPainter, Output};
use mullion_client::missing::WhenMissing;
use mullion_client::node::Painter;
use mullion_client::occlusion::Occlusion;
use mullion_client::tile_session::{FrameToDraw, ViewToDraw};
use mullion_common::scene::{ChunkId, ObjectId, Package, Transform};
use mullion_common::throughput::LEAST_TRIANGLES;
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::ViewId;
use mullion_common::wire::{Budget, Estimate, Moved, Primary, ViewSpec};
use mullion_server::generate::{GeneratedScene, write_glb};
use mullion_server::prepare::PrepareOptions;
use mullion_server::prepare::plp::{TessellateOptions, tessellate};
use support::tiled::{composite, differing, only, specs, wall};

const BOXES: &str = "boxes:1500";

fn package() -> Package {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("boxes.glb");
    write_glb(BOXES.parse::<GeneratedScene>().expect("a scene"), 1, &path).expect("written");
    let mut package = support::package(&path, &PrepareOptions::default());
    let tessellation = tessellate(&package, &TessellateOptions::default(), &|_, _, _| {}).expect("it has triangles");
    package.scene.tessellation = Some(Arc::new(tessellation));
    package
}

/// The room in the midst of the boxes.
fn world_from_room(package: &Package) -> DAffine3 {
    let bound = package.scene.hierarchy.nodes()[0].bound;
    DAffine3::from_translation(bound.center + DVec3::new(0.31, 0.07, 0.17) * bound.half_axes[0].length())
}

/// A node's painter with all chunks, of some views of a wall.
fn painter(gpu: &Arc<Gpu>, package: &Package, views: &[ViewSpec], occlusion: Occlusion) -> GpuPainter {
    let mut painter = GpuPainter::new(Arc::clone(gpu), Output::Keep).culling(occlusion).always();
    painter.open_scene(&Arc::new(package.scene.manifest.clone()), views).expect("opened");
    painter.take_tessellation(package.scene.tessellation.as_ref().expect("it is there")).expect("taken");
    for chunk in (0..package.scene.manifest.chunks.len() as u32).map(ChunkId) {
        painter.upload(chunk, package.chunk(chunk)).expect("taken");
    }
    painter
}

/// What is to be drawn.
struct Order {
    estimate: Option<Estimate>,
    primary: Option<Primary>,
    of_tile: Budget,
    /// Which is removed.
    without: Option<ObjectId>,
}

const ALL: Order = Order { estimate: None, primary: None, of_tile: Budget { triangles: None, gpu_us: None }, without: None };

fn to_budget(package: &Package, triangles: u32, is_complete: bool) -> Order {
    let whole = wall(1);
    let eye = whole.default_eyes()[0];
    let frustum = whole.frustum(ViewId(0), eye, &world_from_room(package));
    let primary = Primary { pixels_per_radian: 100.0, planes: frustum.planes.to_vec() };
    Order { estimate: Some(Estimate { triangles, is_complete }), primary: Some(primary), ..ALL }
}

/// The objects next before the eye.
fn nearest(package: &Package) -> Vec<ObjectId> {
    let manifest = &package.scene.manifest;
    let eye = world_from_room(package).transform_point3(wall(1).default_eyes()[0]);
    let place = |object: &ObjectId| manifest.transforms[object.0 as usize].affine().translation - eye;
    let mut ahead: Vec<ObjectId> = (0..manifest.transforms.len() as u32).map(ObjectId).filter(|o| place(o).z < -1.0).collect();
    ahead.sort_by(|a, b| place(a).length().total_cmp(&place(b).length()));
    ahead.truncate(12);
    ahead
}

/// The pictures of some views, by tile.
fn draw(painter: &mut GpuPainter, package: &Package, views: &[ViewSpec], order: &Order) -> (BTreeMap<String, RgbaImage>, u64) {
    let (world_from_room, eye) = (world_from_room(package), wall(1).default_eyes()[0]);
    let records = (0..).zip(&package.scene.manifest.leaves).filter(|(_, record)| Some(record.object) != order.without);
    let seen = VisibleSet::from_ranges(records.map(|(leaf, _)| LeafRange::new(leaf, leaf + 1)));
    let view = |_: &ViewSpec| ViewToDraw {
        view: ViewId(0),
        eye,
        budget: order.of_tile,
        leaves: seen.clone(),
        missing: VisibleSet::default(),
    };
    let frame = FrameToDraw {
        world_from_room,
        shared_eye: world_from_room.transform_point3(eye),
        views: views.iter().map(view).collect(),
        estimate: order.estimate,
        primary: order.primary.clone(),
        when_missing: WhenMissing::Hold,
        ..FrameToDraw::default()
    };
    let stats = painter.draw(&frame).expect("drawn");
    painter.show(0).expect("shown");
    (painter.pictures().expect("pictures").into_iter().collect(), stats.triangles)
}

#[test]
fn all_nodes_cut_at_the_same_place() {
    if !support::has_gpu() {
        return;
    }
    let gpu = Gpu::open(GpuOptions::default()).expect("a GPU");
    let package = package();
    let (tiled, whole) = (wall(2), wall(1));
    let (of_tiled, of_whole) = (specs(&tiled), specs(&whole));
    let mut one = painter(&gpu, &package, &of_whole, Occlusion::Off);
    let mut together = painter(&gpu, &package, &of_tiled, Occlusion::Off);
    let mut apart: Vec<GpuPainter> =
        of_tiled.iter().map(|view| painter(&gpu, &package, std::slice::from_ref(view), Occlusion::Hiz)).collect();
    let (exact, _) = draw(&mut one, &package, &of_whole, &ALL);
    let exact_tiles = composite(&tiled, &draw(&mut together, &package, &of_tiled, &ALL).0);
    // What a picture in one piece and one of tiles may differ by: pixels on edges, whose places are rounded otherwise.
    let edges = differing(&exact_tiles, &only(&exact));
    let mut seams = 0;
    for triangles in [40, 150, 600] {
        let order = to_budget(&package, triangles, false);
        let (pictures, drawn) = draw(&mut one, &package, &of_whole, &order);
        assert!(drawn <= u64::from(triangles), "{drawn} of {triangles}");
        let (tiles, _) = draw(&mut together, &package, &of_tiled, &order);
        for (node, view) in apart.iter_mut().zip(&of_tiled) {
            let (own, _) = draw(node, &package, std::slice::from_ref(view), &order);
            assert!(own[&view.tile_name] == tiles[&view.tile_name], "{} to {triangles}", view.tile_name);
        }
        let composite_of = composite(&tiled, &tiles);
        let wrong = differing(&composite_of, &only(&pictures));
        assert!(wrong <= edges + edges / 2 + 4, "{wrong} pixels differ to {triangles}, {edges} where all is drawn");
        assert!(differing(&composite_of, &exact_tiles) > 20, "to {triangles} something is missing");
        let of_tile = Order { of_tile: Budget { triangles: Some(triangles / 4), gpu_us: None }, ..ALL };
        let (own, _) = draw(&mut together, &package, &of_tiled, &of_tile);
        seams = seams.max(differing(&composite(&tiled, &own), &only(&pictures)));
    }
    assert!(seams > 2 * edges + 50, "tiles with budgets of their own find something else: {seams}");
}

#[test]
fn a_completed_estimate_is_the_exact_picture() {
    if !support::has_gpu() {
        return;
    }
    let gpu = Gpu::open(GpuOptions::default()).expect("a GPU");
    let package = package();
    let specs = specs(&wall(2));
    for occlusion in [Occlusion::Off, Occlusion::Hiz] {
        let mut plain = painter(&gpu, &package, &specs, Occlusion::Off);
        let mut estimating = painter(&gpu, &package, &specs, occlusion);
        // Large, and close before the eye; then back.
        let home = package.scene.manifest.transforms[7];
        let close = DAffine3::from_scale_rotation_translation(
            DVec3::splat(0.4),
            glam::DQuat::from_rotation_y(0.3),
            world_from_room(&package).translation - DVec3::Z * 3.0,
        );
        for transform in [home, Transform::from(close), home] {
            let moved = Moved { object: ObjectId(7), transform };
            for painter in [&mut plain, &mut estimating] {
                painter.set_transform(&moved).expect("moved");
            }
            let (exact, of_all) = draw(&mut plain, &package, &specs, &ALL);
            for (triangles, is_complete) in [(u32::MAX, false), (300, true), (0, true), (0, true)] {
                let (found, drawn) = draw(&mut estimating, &package, &specs, &to_budget(&package, triangles, is_complete));
                assert!(found == exact, "to {triangles}, {occlusion}");
                assert!(!is_complete || drawn * 2 < of_all, "{drawn} of {of_all} triangles are drawn");
            }
            let (found, _) = draw(&mut estimating, &package, &specs, &to_budget(&package, 300, false));
            assert!(found != exact, "300 triangles are not all");
            // What is removed hides nothing, though its chunks are there and the cells know it.
            for object in nearest(&package) {
                let (exact, _) = draw(&mut plain, &package, &specs, &Order { without: Some(object), ..ALL });
                let order = Order { without: Some(object), ..to_budget(&package, 0, true) };
                let (found, _) = draw(&mut estimating, &package, &specs, &order);
                assert!(found == exact, "without {object:?}, {occlusion}");
            }
        }
    }
}

#[test]
fn a_tile_with_little_time_draws_little() {
    if !support::has_gpu() {
        return;
    }
    let gpu = Gpu::open(GpuOptions::default()).expect("a GPU");
    let package = package();
    let specs = specs(&wall(1));
    let mut painter = painter(&gpu, &package, &specs, Occlusion::Off);
    let in_time = |gpu_us| Order { of_tile: Budget { triangles: None, gpu_us: Some(gpu_us) }, ..ALL };
    // No picture takes a microsecond, nor an hour.
    let drawn: Vec<u64> = (0..12).map(|_| draw(&mut painter, &package, &specs, &in_time(1)).1).collect();
    assert!(drawn.last() <= Some(&u64::from(LEAST_TRIANGLES)) && drawn.last() < drawn.first(), "{drawn:?}");
    let drawn: Vec<u64> = (0..12).map(|_| draw(&mut painter, &package, &specs, &in_time(u32::MAX)).1).collect();
    assert!(drawn.last() >= drawn.first() && drawn.last() > Some(&u64::from(LEAST_TRIANGLES)), "{drawn:?}");
    let both = Order { of_tile: Budget { triangles: Some(50), gpu_us: Some(u32::MAX) }, ..ALL };
    assert!((1..=50).contains(&draw(&mut painter, &package, &specs, &both).1));
}
