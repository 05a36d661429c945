//! Every visible set contains the oracle's.
//!
//! The oracle reads the *source file* with another reader than ours, places each triangle in the world in `f64`, and
//! clips it against each tile's frustum, which it makes itself from eye and corners: a triangle of which something
//! remains is visible, and the leaf that claims it must be in the tile's set.

mod support;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DMat4, DQuat, DVec3};
use mullion_common::scene::Package;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{Wall, WallConfig};
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::prepare::{PrepareOptions, scene_bounds};
use mullion_server::tree::CullTree;
use support::random::Random;

/// A triangle of the source file in the world, and the leaf that claims it.
struct SourceTriangle {
    corners: [DVec3; 3],
    leaf: u32,
}

/// All triangles of the file's scene, read with the `gltf` crate.
fn source_triangles(path: &Path, package: &Package) -> Vec<SourceTriangle> {
    let mut claims: HashMap<(u32, u32, u32), u32> = HashMap::new();
    let scene = &package.scene;
    for leaf in 0..scene.leaf_count() {
        let object = scene.manifest.leaves[leaf as usize].object;
        let node = scene.objects[object.0 as usize].source_node;
        for triangle in scene.sources.triangles_of(leaf) {
            let before = claims.insert((node, scene.sources.leaves[leaf as usize].primitive, *triangle), leaf);
            assert_eq!(before, None, "triangle {triangle} of node {node} is in two leaves");
        }
    }
    let (document, buffers, _) = gltf::import(path).expect("another reader reads it too");
    let gltf_scene = document.default_scene().or(document.scenes().next()).expect("a scene");
    let mut open: Vec<(gltf::Node<'_>, DMat4)> = gltf_scene.nodes().map(|n| (n, DMat4::IDENTITY)).collect();
    let mut triangles = Vec::new();
    while let Some((node, world_from_parent)) = open.pop() {
        let local = node.transform().matrix().map(|column| column.map(f64::from));
        let world_from_local = world_from_parent * DMat4::from_cols_array_2d(&local);
        open.extend(node.children().map(|child| (child, world_from_local)));
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
            let positions: Vec<DVec3> = reader
                .read_positions()
                .expect("positions")
                .map(|p| world_from_local.transform_point3(DVec3::from(p.map(f64::from))))
                .collect();
            let indices: Vec<u32> =
                reader.read_indices().map_or_else(|| (0..positions.len() as u32).collect(), |i| i.into_u32().collect());
            assert_eq!(primitive.mode(), gltf::mesh::Mode::Triangles);
            for (t, corners) in indices.chunks_exact(3).enumerate() {
                let leaf = claims.remove(&(node.index() as u32, primitive.index() as u32, t as u32));
                let leaf = leaf.unwrap_or_else(|| panic!("no leaf holds triangle {t} of node {}", node.index()));
                triangles.push(SourceTriangle { corners: [0, 1, 2].map(|k| positions[corners[k] as usize]), leaf });
            }
        }
    }
    assert!(claims.is_empty(), "{} triangles are in leaves and not in the file", claims.len());
    triangles
}

/// Planes (normal, point) of the frustum through a rectangle, made from nothing but eye and corners.
fn planes(eye: DVec3, [bottom_left, bottom_right, top_left]: [DVec3; 3], near_m: f64) -> [(DVec3, DVec3); 5] {
    let top_right = bottom_right + top_left - bottom_left;
    let middle = (bottom_right + top_left) * 0.5;
    let side = |a: DVec3, b: DVec3| {
        let normal = (a - eye).cross(b - eye).normalize();
        (if normal.dot(middle - eye) > 0.0 { normal } else { -normal }, eye)
    };
    let forward = (bottom_right - bottom_left).cross(top_left - bottom_left).normalize();
    let forward = if forward.dot(middle - eye) > 0.0 { forward } else { -forward };
    [
        side(bottom_left, bottom_right),
        side(bottom_right, top_right),
        side(top_right, top_left),
        side(top_left, bottom_left),
        (forward, eye + forward * near_m),
    ]
}

/// Whether something of a triangle remains after clipping (Sutherland and Hodgman 1974).
fn remains(corners: &[DVec3; 3], planes: &[(DVec3, DVec3); 5], polygon: &mut Vec<DVec3>, next: &mut Vec<DVec3>) -> bool {
    let outside = |(normal, point): &(DVec3, DVec3)| corners.iter().all(|c| normal.dot(*c - *point) < 0.0);
    if planes.iter().any(outside) {
        return false;
    }
    polygon.clear();
    polygon.extend_from_slice(corners);
    for (normal, point) in planes {
        next.clear();
        for (i, a) in polygon.iter().enumerate() {
            let b = polygon[(i + 1) % polygon.len()];
            let (da, db) = (normal.dot(*a - *point), normal.dot(b - *point));
            if da >= 0.0 {
                next.push(*a);
            }
            if (da >= 0.0) != (db >= 0.0) {
                next.push(*a + (b - *a) * (da / (da - db)));
            }
        }
        std::mem::swap(polygon, next);
        if polygon.is_empty() {
            return false;
        }
    }
    true
}

struct Counts {
    visible: u64,
    pairs: u64,
}

fn check(package: &Package, triangles: &[SourceTriangle], wall: &Wall, eye: DVec3, world_from_room: &DAffine3) -> Counts {
    let eyes = vec![eye; wall.views().len()];
    let mut sets: Vec<Vec<VisibleSet>> = Vec::new();
    for algorithm in Algorithm::ALL {
        let mut of_views = vec![VisibleSet::default(); eyes.len()];
        Culler::new(algorithm, wall).cull(
            &CullTree::new(Arc::clone(&package.scene.hierarchy)),
            wall,
            &eyes,
            world_from_room,
            &mut of_views,
        );
        sets.push(of_views);
    }
    let mut counts = Counts { visible: 0, pairs: 0 };
    let (mut polygon, mut next) = (Vec::new(), Vec::new());
    for (view, of_view) in wall.views().iter().enumerate() {
        let corners = wall.tile(of_view.tile).corners.map(|c| world_from_room.transform_point3(c));
        let scale = world_from_room.x_axis.length();
        let planes = planes(world_from_room.transform_point3(eye), corners, wall.near_m() * scale);
        let mut visible = vec![false; package.scene.leaf_count() as usize];
        for triangle in triangles {
            let seen = &mut visible[triangle.leaf as usize];
            *seen = *seen || remains(&triangle.corners, &planes, &mut polygon, &mut next);
        }
        for (algorithm, sets) in Algorithm::ALL.iter().zip(&sets) {
            let missing = (0..visible.len() as u32).find(|leaf| visible[*leaf as usize] && !sets[view].contains(*leaf));
            assert_eq!(missing, None, "{algorithm} drops a leaf that view {view} sees from {eye} in {world_from_room:?}");
        }
        counts.visible += visible.iter().filter(|v| **v).count() as u64;
        counts.pairs += sets.last().map_or(0, |of_views| u64::from(of_views[view].len()));
    }
    counts
}

fn walls() -> Vec<Wall> {
    let grid = |columns: u32, rows: u32, bezel_m: f64| {
        format!(
            "near_m = 0.05\n[grid]\ncolumns = {columns}\nrows = {rows}\ntile_px = [64, 36]\ntile_m = [0.8, 0.45]\nbezel_m = [{bezel_m}, {bezel_m}]\n"
        )
    };
    let configs = concat!(env!("CARGO_MANIFEST_DIR"), "/configs");
    let shipped = |file: &str| std::fs::read_to_string(format!("{configs}/{file}")).expect("it ships");
    [grid(1, 1, 0.0), grid(4, 4, 0.0), grid(3, 2, 0.02), shipped("cave_4.toml"), shipped("projectors_3x2.toml")]
        .iter()
        .map(|text| WallConfig::parse(text).expect("a wall"))
        .collect()
}

/// Rooms all over a scene, turned at random; eyes in front of the wall, some of them far to the side, and rooms whose
/// eye is inside a leaf's box.
fn check_scene(path: &Path, rounds: u32, options: &PrepareOptions) {
    let package = support::package(path, options);
    let triangles = source_triangles(path, &package);
    let bounds = scene_bounds(&package).expect("the scene has triangles");
    let leaves: Vec<DVec3> =
        package.scene.hierarchy.nodes().iter().filter(|n| n.leaves.len() == 1).map(|n| n.bound.center).collect();
    let mut random = Random(7);
    let (mut visible, mut pairs) = (0, 0);
    for (round, wall) in (0..rounds).flat_map(|round| walls().into_iter().map(move |wall| (round, wall))) {
        let default_eye = wall.default_eyes()[0];
        let is_flat = wall.screens().iter().all(|s| s.corners.iter().all(|c| c.z == 0.0));
        let eye = match round % 3 {
            0 => default_eye,
            // Far off-axis: ten metres to the side at a hand's breadth from the wall.
            1 if is_flat => DVec3::new(random.between(-10.0, 10.0), random.between(-5.0, 5.0), random.between(0.1, 0.5)),
            _ => default_eye + DVec3::new(random.between(-0.5, 0.5), random.between(-0.5, 0.5), random.between(-0.3, 0.3)),
        };
        wall.check_eye(eye).expect("the eye is in front");
        let turn = DQuat::from_rotation_y(random.between(0.0, 6.3)) * DQuat::from_rotation_x(random.between(-1.2, 1.2));
        let stand = if round % 2 == 0 {
            leaves[random.next() as usize % leaves.len()]
        } else {
            let size = bounds.size() * 1.5;
            bounds.center() + size * DVec3::new(random.between(-0.5, 0.5), random.between(-0.5, 0.5), random.between(-0.5, 0.5))
        };
        let scale = [1.0, 0.1][random.next() as usize % 2] * (bounds.size().length() / 20.0).min(1.0);
        let turned = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, DVec3::ZERO);
        let world_from_room = DAffine3 { translation: stand - turned.transform_point3(eye), ..turned };
        let counts = check(&package, &triangles, &wall, eye, &world_from_room);
        visible += counts.visible;
        pairs += counts.pairs;
    }
    println!("{}: {visible} (leaf, view) pairs visible, {pairs} in the sets", path.display());
    assert!(visible > 0 && pairs < u64::from(package.scene.leaf_count()) * 31 * u64::from(rounds), "the test looked at nothing");
}

#[test]
fn the_city_is_never_dropped() {
    let folder = tempfile::tempdir().expect("a folder");
    check_scene(&support::city(folder.path()), 3, &PrepareOptions::default());
}

#[test]
fn small_leaves_of_foreign_models_are_never_dropped() {
    let names = [
        "cad_2cylinder_engine.glb",
        "city_denhaag.glb",
        "scan_armadillo_86k.glb",
        "CesiumMilkTruck_external/CesiumMilkTruck.gltf",
    ];
    for path in support::models(&names) {
        check_scene(&path, 6, &PrepareOptions { max_leaf_triangles: 500, ..PrepareOptions::default() });
    }
}
