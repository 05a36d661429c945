//! Goal: a wall's tiles show one surface, whoever draws which of them, coarse or fine, and what is hidden or moved changes nothing about that.
//! Method: painters without a network, of one node and of four, of which one comes late, on a planet of a few thousand triangles that lies
//! across all seams.

mod support;

use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use image::RgbaImage;
use mullion_client::gpu::{Gpu, GpuOptions};
use mullion_client::gpu_painter::{GpuPainter, Output};
use mullion_client::missing::WhenMissing;
use mullion_client::node::Painter;
use mullion_client::occlusion::Occlusion;
use mullion_client::tile_session::{FrameToDraw, ViewToDraw};
use mullion_common::scene::{ChunkHash, ChunkId, ChunkKind, ChunkRecord, Filter, LodForm, ObjectId, Package, TextureRef, Wrap};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::ViewId;
use mullion_common::wire::{Budget, Detail, DetailWeight, Moved, Primary, ViewSpec};
use mullion_server::generate::{GeneratedScene, write_glb};
use mullion_server::prepare::lod::{LodOptions, add_hierarchies};
use mullion_server::prepare::plp::{TessellateOptions, tessellate};
use mullion_server::prepare::{Placement, PrepareOptions, graft};
use support::tiled::{TILE_PX, composite, differing, only, specs, wall};

const TRIANGLES: u32 = 6000;

fn package(form: LodForm) -> Package {
    divided(form, PrepareOptions::default().max_leaf_triangles)
}

fn divided(form: LodForm, max_leaf_triangles: u32) -> Package {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("planet.glb");
    write_glb(format!("planet:{}", TRIANGLES / 2).parse::<GeneratedScene>().expect("a scene"), 1, &path).expect("written");
    let mut package = support::package(&path, &PrepareOptions { max_leaf_triangles, ..PrepareOptions::default() });
    add_hierarchies(&mut package, &LodOptions { block_vertices: 500, form, ..LodOptions::default() }, &|_, _, _| {})
        .expect("it has triangles");
    package
}

/// A node: its painter, and what it draws.
struct Node {
    painter: GpuPainter,
    views: Vec<ViewSpec>,
    /// What each view sees.
    leaves: VisibleSet,
    dropped: VisibleSet,
    away: VisibleSet,
}

impl Node {
    /// With the first blobs of each hierarchy, but no geometry; without blobs, all geometry.
    fn new(gpu: &Arc<Gpu>, package: &Package, views: &[ViewSpec], blobs: usize) -> Self {
        Self::culling(gpu, package, (views, blobs), Occlusion::Hiz)
    }

    fn culling(gpu: &Arc<Gpu>, package: &Package, (views, blobs): (&[ViewSpec], usize), occlusion: Occlusion) -> Self {
        let mut painter = GpuPainter::new(Arc::clone(gpu), Output::Keep).culling(occlusion).always();
        painter.open_scene(&Arc::new(package.scene.manifest.clone()), views).expect("opened");
        if let Some(tessellation) = &package.scene.tessellation {
            painter.take_tessellation(tessellation).expect("taken");
        }
        let table = package.scene.hierarchies.preferring(LodForm::Vertices).expect("they are there");
        for (number, entry) in (0..).zip(table.entries()) {
            for blob in table.blobs(number as usize).take(blobs) {
                assert!(painter.take_hierarchy(number, &entry.objects, blob).expect("no failure").is_some_and(|bytes| bytes > 0));
            }
        }
        if blobs == 0 {
            for chunk in (0..package.scene.manifest.chunks.len() as u32).map(ChunkId) {
                painter.upload(chunk, package.chunk(chunk)).expect("taken");
            }
        }
        let leaves = VisibleSet::all(package.scene.manifest.leaves.len() as u32);
        let (dropped, away) = (VisibleSet::default(), VisibleSet::default());
        Self { painter, views: views.to_vec(), leaves, dropped, away }
    }

    /// The pictures by tile, and how many triangles that took.
    fn draw(&mut self, number: u64, world_from_room: DAffine3, detail: Option<Detail>) -> (BTreeMap<String, RgbaImage>, u64) {
        let whole = wall(1);
        let eye = whole.default_eyes()[0];
        let frustum = whole.frustum(ViewId(0), eye, &world_from_room);
        let primary = Primary { pixels_per_radian: 120.0, planes: frustum.planes.to_vec() };
        let view = |_: &ViewSpec| ViewToDraw {
            view: ViewId(0),
            eye,
            budget: Budget::default(),
            leaves: self.leaves.clone(),
            missing: VisibleSet::default(),
        };
        let frame = FrameToDraw {
            number,
            world_from_room,
            shared_eye: world_from_room.transform_point3(eye),
            views: self.views.iter().map(view).collect(),
            dropped: self.dropped.clone(),
            primary: detail.map(|_| primary),
            detail,
            away: self.away.clone(),
            when_missing: WhenMissing::Hold,
            ..FrameToDraw::default()
        };
        let stats = self.painter.draw(&frame).expect("drawn");
        self.painter.show(number).expect("shown");
        (self.painter.pictures().expect("pictures").into_iter().collect(), stats.triangles)
    }
}

/// Before the planet, which fills most of the wall.
fn room(package: &Package, frame: u64) -> DAffine3 {
    let bound = package.scene.hierarchy.nodes()[0].bound;
    let radius_m = bound.half_axes[0].length();
    let turn = DQuat::from_rotation_y(frame as f64 * 0.02);
    DAffine3::from_rotation_translation(turn, bound.center + turn * DVec3::new(0.1, 0.05, 2.6) * radius_m)
}

#[test]
fn all_tiles_show_one_surface() {
    if !support::has_gpu() {
        return;
    }
    let gpu = Gpu::open(GpuOptions::default()).expect("a GPU");
    let mut vertices = package(LodForm::Vertices);
    let fewer = one_surface(&gpu, &vertices, DetailWeight::Nohc);
    assert!(fewer > 100, "what is hidden is not drawn as finely: {fewer} triangles fewer");
    one_surface(&gpu, &package(LodForm::Clusters), DetailWeight::Nohc);
    let tessellation = tessellate(&vertices, &TessellateOptions::default(), &|_, _, _| {}).expect("it has space");
    vertices.scene.tessellation = Some(Arc::new(tessellation));
    one_surface(&gpu, &vertices, DetailWeight::Plp);
}

/// How many triangles fewer are drawn where what is hidden may be coarse.
fn one_surface(gpu: &Arc<Gpu>, package: &Package, weight: DetailWeight) -> u64 {
    let (tiled, whole) = (wall(2), wall(1));
    let (of_tiled, of_whole) = (specs(&tiled), specs(&whole));
    let mut plain = Node::new(gpu, package, &of_tiled, 0);
    let mut plain_whole = Node::new(gpu, package, &of_whole, 0);
    let mut one = Node::new(gpu, package, &of_whole, usize::MAX);
    let mut together = Node::new(gpu, package, &of_tiled, usize::MAX);
    let mut apart: Vec<Option<Node>> =
        of_tiled.iter().map(|view| Some(Node::new(gpu, package, std::slice::from_ref(view), usize::MAX))).collect();
    apart[3] = None;
    let (mut fewer, mut wrong, mut rounded, mut at_seams) = (0, 0, 0, 0);
    for frame in 0..12 {
        // Nodes skip frames. The last one comes where the others draw their occluders anew, and another misses one frame of them all.
        let number = frame * 3;
        if number == 18 {
            apart[3] = Some(Node::new(gpu, package, &of_tiled[3..], usize::MAX));
        }
        let triangles = [Some(1200), Some(2500), None][frame as usize % 3];
        let detail = Detail { triangles, least_pixels: if triangles.is_some() { 0.0 } else { 1.0 }, hides: true, weight };
        let room = room(package, frame);
        let (tiles, _) = together.draw(number, room, Some(detail));
        let (own, drawn) = one.draw(number, room, Some(detail));
        assert!(drawn <= u64::from(triangles.unwrap_or(TRIANGLES - 1)), "{drawn} of {triangles:?}");
        for (node, view) in apart.iter_mut().zip(&of_tiled).skip(usize::from(frame == 5)) {
            let Some(node) = node else { continue };
            let (own, _) = node.draw(number, room, Some(detail));
            assert!(own[&view.tile_name] == tiles[&view.tile_name], "{} in frame {number}", view.tile_name);
        }
        if triangles.is_none() {
            let mut seen = Node::new(gpu, package, &of_whole, usize::MAX);
            let (_, without) = seen.draw(number, room, Some(Detail { hides: false, ..detail }));
            fewer += without.saturating_sub(drawn);
        }
        // One picture and four of the same surface differ where pixels on edges are rounded otherwise, as they do without.
        let edges =
            differing(&composite(&tiled, &plain.draw(number, room, None).0), &only(&plain_whole.draw(number, room, None).0));
        let (tiles, own) = (composite(&tiled, &tiles), only(&own));
        rounded += edges;
        wrong += differing(&tiles, &own);
        let is_at_seam = |(x, y): (u32, u32)| TILE_PX[0].abs_diff(x) < 2 || TILE_PX[1].abs_diff(y) < 2;
        let differs = |(x, y, pixel): &(u32, u32, &image::Rgba<u8>)| *pixel != own.get_pixel(*x, *y);
        at_seams += tiles.enumerate_pixels().filter(differs).filter(|(x, y, _)| is_at_seam((*x, *y))).count();
    }
    assert!(wrong <= 2 * rounded + 20, "{wrong} pixels differ, {rounded} where all is drawn");
    // A crack or a step is as long as a seam: tens of pixels in each frame.
    assert!(at_seams <= 24, "{at_seams} pixels differ next to seams");
    fewer
}

/// A coarse cut bulges beyond the leaves into tiles of nodes that see none of them: these draw it as one node does that sees all.
#[test]
fn who_sees_no_leaf_draws_the_cut_all_the_same() {
    if !support::has_gpu() {
        return;
    }
    let gpu = Gpu::open(GpuOptions::default()).expect("a GPU");
    let package = package(LodForm::Vertices);
    let of_tiled = specs(&wall(2));
    let detail = Detail { triangles: Some(900), hides: true, ..Detail::default() };
    let mut together = Node::new(&gpu, &package, &of_tiled, usize::MAX);
    let mut apart: Vec<Node> =
        of_tiled.iter().map(|view| Node::new(&gpu, &package, std::slice::from_ref(view), usize::MAX)).collect();
    apart.iter_mut().skip(1).for_each(|node| node.leaves.clear());
    for frame in 0..4 {
        let room = room(&package, frame * 9);
        let (tiles, _) = together.draw(frame, room, Some(detail));
        for (node, view) in apart.iter_mut().zip(&of_tiled) {
            let (own, drawn) = node.draw(frame, room, Some(detail));
            assert!(drawn > 100, "{drawn} triangles of {}", view.tile_name);
            assert!(own[&view.tile_name] == tiles[&view.tile_name], "{} in frame {frame}", view.tile_name);
        }
    }
    // What it does not see it lacks no texture of, and waits for none.
    let mut textured = package.clone();
    let png = {
        let mut bytes = std::io::Cursor::new(Vec::new());
        RgbaImage::from_pixel(2, 2, image::Rgba([200, 90, 40, 255]))
            .write_to(&mut bytes, image::ImageFormat::Png)
            .expect("a PNG");
        bytes.into_inner()
    };
    let manifest = &mut textured.scene.manifest;
    let chunk = ChunkId(manifest.chunks.len() as u32);
    manifest.chunks.push(ChunkRecord::new(ChunkHash::of(&png), 0, png.len() as u32, ChunkKind::Texture));
    let texture = TextureRef { chunk, wrap_u: Wrap::Repeat, wrap_v: Wrap::Repeat, filter: Filter::Linear };
    manifest.materials.iter_mut().for_each(|material| material.texture = Some(texture));
    let mut node = Node::new(&gpu, &textured, &of_tiled, usize::MAX);
    node.leaves.clear();
    assert_eq!(node.draw(0, room(&package, 0), Some(detail)).1, 0);
    node.painter.upload(chunk, &png).expect("taken");
    assert!(node.draw(1, room(&package, 0), Some(detail)).1 > 100);
}

/// One that was taken away, and one that hardly contributes. Back again, it is drawn as before.
#[test]
fn what_is_away_or_dropped_is_drawn_by_nobody() {
    if !support::has_gpu() {
        return;
    }
    let gpu = Gpu::open(GpuOptions::default()).expect("a GPU");
    let package = package(LodForm::Vertices);
    let detail = Detail { triangles: Some(900), ..Detail::default() };
    let mut node = Node::new(&gpu, &package, &specs(&wall(2)), usize::MAX);
    let room = room(&package, 2);
    let before = node.draw(0, room, Some(detail));
    let all = node.leaves.clone();
    let nothing = VisibleSet::default;
    for (frame, (away, dropped)) in (0..).zip([(all.clone(), nothing()), (nothing(), all.clone()), (all.clone(), all)]) {
        (node.away, node.dropped) = (away, dropped);
        let (tiles, drawn) = node.draw(2 * frame + 1, room, Some(detail));
        assert_eq!(drawn, 0, "in frame {frame}");
        assert!(tiles.iter().any(|(tile, picture)| differing(picture, &before.0[tile]) > 50));
        (node.away, node.dropped) = (nothing(), nothing());
        assert!(node.draw(2 * frame + 2, room, Some(detail)) == before);
    }
}

/// As fine as it goes, a hierarchy is its mesh; and an object that moved is drawn where it is.
#[test]
fn the_finest_cut_is_the_mesh() {
    if !support::has_gpu() {
        return;
    }
    let gpu = Gpu::open(GpuOptions::default()).expect("a GPU");
    [LodForm::Vertices, LodForm::Clusters].map(package).iter().for_each(|package| finest_is_mesh(&gpu, package));
}

fn finest_is_mesh(gpu: &Arc<Gpu>, package: &Package) {
    let of_tiled = specs(&wall(2));
    let mut plain = Node::new(gpu, package, &of_tiled, 0);
    for occlusion in [Occlusion::Off, Occlusion::Paper, Occlusion::Query, Occlusion::Hiz] {
        let mut fine = Node::culling(gpu, package, (&of_tiled, usize::MAX), occlusion);
        let mut base = Node::culling(gpu, package, (&of_tiled, 1), occlusion);
        let detail = Detail { triangles: Some(u32::MAX), ..Detail::default() };
        let home = package.scene.manifest.transforms[0];
        let aside = DAffine3::from_scale_rotation_translation(DVec3::splat(0.5), DQuat::from_rotation_y(0.3), DVec3::X * 2.0);
        for (frame, transform) in (0..).zip([home, (home.affine() * aside).into(), home]) {
            for node in [&mut plain, &mut fine, &mut base] {
                node.painter.set_transform(&Moved { object: ObjectId(0), transform }).expect("moved");
            }
            let room = room(package, 3);
            let (exact, _) = plain.draw(frame, room, None);
            let (found, _) = fine.draw(frame, room, Some(detail));
            for (tile, picture) in &exact {
                // Ties go by the order of triangles, which is another: some pixels on edges.
                let wrong = differing(picture, &found[tile]);
                assert!(
                    wrong * 200 <= (TILE_PX[0] * TILE_PX[1]) as usize,
                    "{wrong} pixels of {tile} differ in frame {frame}, {occlusion:?}"
                );
            }
            let (coarse, drawn) = base.draw(frame, room, Some(detail));
            assert!(drawn > 0 && drawn < 400, "{drawn} triangles of the base");
            assert!(coarse.iter().any(|(tile, picture)| differing(picture, &exact[tile]) > 50), "a base is coarse");
        }
        // Given up, its leaves are drawn: here there are none.
        fine.painter.forget_hierarchy(0).expect("forgotten");
        assert_eq!(fine.draw(9, room(package, 3), Some(detail)).1, 0);
        // And without an order, whatever has come.
        assert_eq!(base.draw(9, room(package, 3), None).1, 0);
    }
}

/// A ball with all that files bring: faces that are there twice, also turned around, fins on edges that two others share, triangles without area, and
/// vertices that nothing uses.
fn bad_ball(folder: &Path) -> PathBuf {
    const ROUND: u32 = 64;
    const HIGH: u32 = 40;
    let mut positions: Vec<[f32; 3]> = Vec::new();
    for row in 0..=HIGH {
        for column in 0..ROUND {
            let (up, around) = (row as f32 / HIGH as f32 * PI, column as f32 / ROUND as f32 * 2.0 * PI);
            let radius = 1.0 + 0.1 * (around * 5.0).sin() * up.sin();
            positions.push([radius * up.sin() * around.cos(), radius * up.cos(), -radius * up.sin() * around.sin()]);
        }
    }
    let vertex = |row: u32, column: u32| row * ROUND + column % ROUND;
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for (row, column) in (0..HIGH).flat_map(|row| (0..ROUND).map(move |column| (row, column))) {
        let [a, b] = [vertex(row, column), vertex(row, column + 1)];
        let [c, d] = [vertex(row + 1, column + 1), vertex(row + 1, column)];
        triangles.extend([[a, d, c], [a, c, b]]); // those at the poles have no area
    }
    let of_ball = triangles.clone();
    for (number, [a, b, c]) in of_ball.into_iter().enumerate() {
        if number % 7 == 0 {
            triangles.push([b, c, a]);
        }
        if number % 11 == 0 {
            triangles.push([a, c, b]);
        }
        if number % 13 == 0 {
            let tip = positions.len() as u32;
            positions.push(positions[a as usize].map(|x| x * 1.15));
            triangles.push([a, b, tip]);
        }
        if number % 17 == 0 {
            triangles.extend([[a, a, b], [c, c, c]]);
        }
    }
    positions.extend((0..100).map(|k| [k as f32 * 0.01, 0.0, 0.0]));
    let places = positions.iter().flatten().flat_map(|x| x.to_le_bytes());
    let bytes: Vec<u8> = places.chain(triangles.iter().flatten().flat_map(|corner| corner.to_le_bytes())).collect();
    std::fs::write(folder.join("ball.bin"), &bytes).expect("written");
    let json = serde_json::json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": positions.len(), "type": "VEC3", "min": [-2, -2, -2], "max": [2, 2, 2] },
            { "bufferView": 1, "componentType": 5125, "count": triangles.len() * 3, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": positions.len() * 12 },
            { "buffer": 0, "byteOffset": positions.len() * 12, "byteLength": triangles.len() * 12 },
        ],
        "buffers": [{ "uri": "ball.bin", "byteLength": bytes.len() }],
    });
    let path = folder.join("ball.gltf");
    std::fs::write(&path, json.to_string()).expect("written");
    path
}

/// What is no surface is drawn as the file has it once all splits are made, and hardly otherwise where it is good to a pixel.
#[test]
fn bad_meshes_are_drawn_as_they_are() {
    if !support::has_gpu() {
        return;
    }
    let gpu = Gpu::open(GpuOptions::default()).expect("a GPU");
    let folder = tempfile::tempdir().expect("a folder");
    let path = bad_ball(folder.path());
    for form in LodForm::ALL {
        let mut package = support::package(&path, &PrepareOptions::default());
        add_hierarchies(&mut package, &LodOptions { form, ..LodOptions::default() }, &|_, _, _| {}).expect("it has triangles");
        let views = specs(&wall(2));
        let mut plain = Node::new(&gpu, &package, &views, 0);
        let mut cut = Node::new(&gpu, &package, &views, usize::MAX);
        let room = room(&package, 3);
        let (exact, all) = plain.draw(0, room, None);
        let shown: usize = exact
            .values()
            .map(|picture| differing(picture, &RgbaImage::from_pixel(TILE_PX[0], TILE_PX[1], *picture.get_pixel(0, 0))))
            .sum();
        assert!(shown > 2000, "{shown} pixels of the ball");
        for (least_pixels, most_wrong) in [(0.0, 200), (1.0, 20)] {
            let detail = Detail { triangles: None, least_pixels, hides: false, ..Detail::default() };
            let (found, drawn) = cut.draw(1, room, Some(detail));
            assert!(if least_pixels > 0.0 { drawn < all } else { drawn > all / 2 }, "{form}: {drawn} of {all} triangles");
            let wrong: usize = exact.iter().map(|(tile, picture)| differing(picture, &found[tile])).sum();
            assert!(wrong * most_wrong <= shown, "{form}, {least_pixels} pixels: {wrong} of {shown} pixels differ");
        }
    }
}

/// Two planets in one place, of which one is drawn from its leaves and the other by its finest cut: every pixel is the same with
/// occlusion culling, though leaves come late beyond the cut.
#[test]
fn where_cuts_and_leaves_coincide_culling_changes_nothing() {
    if !support::has_gpu() {
        return;
    }
    let gpu = Gpu::open(GpuOptions::default()).expect("a GPU");
    let red = divided(LodForm::Vertices, 60);
    let mut blue = red.clone();
    blue.scene.manifest.materials.iter_mut().for_each(|material| material.base_color = [0.1, 0.2, 0.9, 1.0]);
    let place = Placement { name: "other".to_owned(), under: None, world_from_root: DAffine3::IDENTITY };
    let mut both = graft(&red, &blue, &place).expect("joined");
    add_hierarchies(&mut both, &LodOptions::default(), &|_, _, _| {}).expect("it has triangles");
    let manifest = &both.scene.manifest;
    let of_meshes: Vec<ObjectId> = manifest.leaves.iter().map(|leaf| leaf.object).collect();
    let views = specs(&wall(2));
    let detail = Detail { triangles: Some(u32::MAX), ..Detail::default() };
    for object in [of_meshes[0], of_meshes[of_meshes.len() - 1]] {
        let mut nodes = [Occlusion::Off, Occlusion::Hiz, Occlusion::Query, Occlusion::Paper].map(|occlusion| {
            let mut node = Node::culling(&gpu, &both, (&views, 0), occlusion);
            let table = both.scene.hierarchies.preferring(LodForm::Vertices).expect("they are there");
            let (number, _) = (0..).zip(table.entries()).find(|(_, entry)| entry.objects.contains(&object)).expect("it has one");
            for blob in table.blobs(number as usize) {
                assert!(node.painter.take_hierarchy(number, &[object], blob).expect("no failure").is_some());
            }
            node
        });
        let (mut late, mut of_cuts) = (0, 0);
        for frame in 0..24 {
            let room = room(&both, frame * 7);
            let (plain, all) = nodes[0].draw(frame, room, Some(detail));
            for node in &mut nodes[1..] {
                let (culled, drawn) = node.draw(frame, room, Some(detail));
                for (tile, picture) in &plain {
                    let wrong = differing(picture, &culled[tile]);
                    assert_eq!(wrong, 0, "{tile} in frame {frame}, {:?} by its cut", object);
                }
                late += u64::from(drawn < all);
            }
            let is_blue = |pixel: &&image::Rgba<u8>| pixel[2] > pixel[0];
            of_cuts += plain.values().flat_map(|picture| picture.pixels()).filter(is_blue).count();
        }
        assert!(late > 48 && of_cuts > 0, "{late} {of_cuts} {}", manifest.leaves.len());
    }
}
