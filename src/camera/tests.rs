//! What each walk promises, on a scene of turned boxes that is no cube and lies off the origin.

use std::sync::Arc;

use mullion_common::geometry::Frustum;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::WallConfig;
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::prepare::gltf::{SourceMesh, SourceNode, SourcePrimitive, SourceScene};
use mullion_server::prepare::{PrepareOptions, prepare};
use mullion_server::tree::CullTree;

use super::*;

const CAVE: &str = include_str!("../../configs/cave_4.toml");
const PROJECTORS: &str = include_str!("../../configs/projectors_3x2.toml");
const BEZELS: &str = include_str!("../../configs/wall_4x4.toml");
const SEAMLESS: &str = "eye = [1.0, -0.4, 2.5]\n[grid]\ncolumns = 3\nrows = 2\ntile_px = [64, 48]\ntile_m = [1.0, 0.75]\n";

fn wall(text: &str) -> Wall {
    WallConfig::parse(text).expect("a wall")
}

/// `count` boxes of 1 × 2 × 3 m, `spread_m` apart.
fn boxes(count: u32, spread_m: f64) -> Package {
    let corner = |i: u32| glam::Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32 * 2.0, (i >> 2) as f32 * 3.0);
    let primitive = SourcePrimitive {
        gltf_primitive: 0,
        positions: (0..8).map(corner).collect(),
        normals: None,
        uvs: None,
        colors: None,
        indices: vec![0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6],
        material: None,
    };
    let node = |i: u32| {
        let place = DVec3::new(f64::from(i % 9) * 2.0 + 40.0, (f64::from(i) * 1.7).sin(), f64::from(i / 9)) * spread_m;
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), f64::from(i));
        let parent_from_local = DAffine3::from_rotation_translation(turn, place);
        SourceNode { name: None, parent: None, children: Vec::new(), parent_from_local, mesh: Some(0), instances: Vec::new() }
    };
    let scene = SourceScene {
        nodes: (0..count).map(node).collect(),
        roots: (0..count).collect(),
        meshes: vec![SourceMesh { name: None, gltf_mesh: 0, primitives: vec![primitive] }],
        materials: Vec::new(),
        images: Vec::new(),
        warnings: Vec::new(),
    };
    prepare(scene, &PrepareOptions::default(), &|_, _, _| {}).expect("a scene").package
}

/// Where the eye is at each frame, and which way the room's −Z axis points.
fn eyes(path: &CameraPath, wall: &Wall) -> Vec<(DVec3, DVec3)> {
    let eye = wall.default_eyes()[0];
    let seen = |frame: usize| {
        let room = path.pose(frame as u64);
        (room.transform_point3(eye), room.transform_vector3(DVec3::NEG_Z).normalize())
    };
    (0..path.poses().len()).map(seen).collect()
}

#[test]
fn the_room_faces_what_it_looks_at() {
    let room = place_room(DVec3::new(1.0, 2.0, 3.0), Some(DVec3::new(4.0, 2.0, -1.0)));
    let ahead = room.transform_vector3(DVec3::NEG_Z);
    assert!((ahead - DVec3::new(0.6, 0.0, -0.8)).length() < 1e-12, "{ahead}");
    assert!((room.transform_vector3(DVec3::Y) - DVec3::Y).length() < 1e-12);
    assert!((room.matrix3.determinant() - 1.0).abs() < 1e-12, "not mirrored");
    assert!(parse_point("1,2").is_err() && parse_point("1,2,x").is_err() && parse_point("1, -2, 3e2").is_ok());
}

/// Every corner of every leaf's bound is inside all planes of what the whole wall sees: proof that no leaf lies outside the
/// wall, whatever the algorithm.
fn assert_whole_scene_inside(package: &Package, wall: &Wall, path: &CameraPath) {
    let outer = whole::outer_frustum(wall, wall.default_eyes()[0]);
    let bounds: Vec<_> = package.scene.hierarchy.nodes().iter().filter(|n| n.leaves.len() == 1).map(|n| n.bound).collect();
    for frame in (0..path.poses().len()).step_by(75) {
        let frustum: Frustum = outer.transformed(&path.pose(frame as u64));
        for corner in bounds.iter().flat_map(|bound| bound.corners()) {
            for plane in &frustum.planes {
                let inside_m = plane.distance_m(corner);
                assert!(inside_m > 0.0, "{} frame {frame}: {corner} is {inside_m} m inside", wall.name());
            }
        }
    }
}

#[test]
fn the_whole_scene_is_in_view_at_every_frame() {
    for (package, wall) in
        [BEZELS, PROJECTORS, SEAMLESS, CAVE].into_iter().flat_map(|text| [2.0, 0.004].map(|m| (boxes(60, m), wall(text))))
    {
        let path = Walk::Whole.path(&package, &wall, None).expect("a path");
        assert_eq!(path.poses().len(), 3600);
        assert_whole_scene_inside(&package, &wall, &path);
    }
}

#[test]
fn without_bezels_the_tiles_together_see_every_leaf() {
    let (package, wall) = (boxes(60, 2.0), wall(SEAMLESS));
    let path = Walk::Whole.path(&package, &wall, None).expect("a path");
    let tree = CullTree::new(Arc::clone(&package.scene.hierarchy));
    let eyes = wall.default_eyes();
    for algorithm in Algorithm::ALL {
        let mut culler = Culler::new(algorithm, &wall);
        let mut sets = vec![VisibleSet::default(); wall.views().len()];
        for frame in (0..3600).step_by(150) {
            culler.cull(&tree, &wall, &eyes, &path.pose(frame), &mut sets);
            let seen = VisibleSet::from_ranges(sets.iter().flat_map(|set| set.ranges().iter().copied()));
            assert_eq!(seen, VisibleSet::all(package.scene.leaf_count()), "{algorithm} frame {frame}");
        }
    }
    // As near as that: a step closer and something is cut.
    let room = path.pose(0);
    let closer = DAffine3 { translation: room.translation.lerp(Subject::of(&package).all().center(), 0.1), ..room };
    let outer = whole::outer_frustum(&wall, eyes[0]).transformed(&closer);
    let corners = Subject::of(&package).all().corners();
    assert!(corners.iter().any(|c| outer.planes.iter().any(|p| p.distance_m(*c) < 0.0)), "the walk keeps too far away");
}

#[test]
fn someone_walks_through_the_scene_at_walking_pace() {
    let (package, wall) = (boxes(200, 3.0), wall(CAVE));
    let subject = Subject::of(&package);
    let path = Walk::Interior.path(&package, &wall, Some(20_000)).expect("a path");
    let eyes = eyes(&path, &wall);
    for (before, now) in eyes.iter().zip(&eyes[1..]) {
        let step_m = before.0.distance(now.0);
        assert!((step_m * 60.0 / 1.4 - 1.0).abs() < 0.01, "{step_m} m a frame");
        assert!(before.1.angle_between(now.1).to_degrees() < 3.0, "turns are smooth");
    }
    for (eye, ahead) in &eyes {
        assert!((eye.y - subject.eye_height_y()).abs() < 1e-9 && ahead.y.abs() < 1e-9, "level, at eye height");
        let inside = eye.cmpge(subject.all().min) & eye.cmple(subject.all().max);
        assert!(inside.x && inside.z, "{eye} is beside the scene");
    }
    let within = |eye: DVec3| subject.at_eye_height().any(|leaf| (eye.cmpge(leaf.min) & eye.cmple(leaf.max)).all());
    assert!(eyes.iter().any(|(eye, _)| within(*eye)), "the round goes through things");
    assert!(!eyes[..600].iter().any(|(eye, _)| within(*eye)), "but starts in the open");
    let floor = path.pose(77).transform_point3(DVec3::ZERO);
    assert!((floor.y - (subject.eye_height_y() - 1.65)).abs() < 1e-9, "the floor of the CAVE is on the scene's: {floor}");
}

#[test]
fn a_flight_comes_from_outside_goes_through_the_middle_and_out() {
    let wall = wall(BEZELS);
    for (package, least, most) in [(boxes(200, 3.0), 20.0, 50.0), (boxes(200, 100.0), 20.0, 50.0)] {
        let subject = Subject::of(&package);
        for frames in [None, Some(301)] {
            let path = Walk::Flythrough.path(&package, &wall, frames).expect("a path");
            let eyes = eyes(&path, &wall);
            let (first, middle, last) = (eyes[0].0, eyes[eyes.len() / 2].0, eyes[eyes.len() - 1].0);
            for outside in [first, last] {
                assert!(outside.distance(subject.center()) > 1.4 * subject.radius_m(), "{outside}");
            }
            assert!(middle.distance(subject.center()) < 0.05 * subject.radius_m(), "{middle}");
            for (before, now) in eyes.iter().zip(&eyes[1..]) {
                let speed_m_per_s = before.0.distance(now.0) * wall.rate_hz();
                let is_sensible = frames.is_some() || (least * 0.9..most * 1.5).contains(&speed_m_per_s);
                assert!(is_sensible, "{speed_m_per_s} m/s");
                assert!(before.1.dot((now.0 - before.0).normalize()) > 0.99, "it looks ahead");
            }
        }
    }
}

#[test]
fn a_pan_turns_one_degree_a_frame_and_stays() {
    let (package, wall) = (boxes(60, 2.0), wall(PROJECTORS));
    let path = Walk::Pan.path(&package, &wall, None).expect("a path");
    let eyes = eyes(&path, &wall);
    assert_eq!(eyes.len(), 360);
    for (k, (before, now)) in eyes.iter().zip(eyes.iter().cycle().skip(1)).enumerate() {
        assert!(before.0.distance(now.0) < 1e-9, "frame {k}");
        assert!((before.1.angle_between(now.1).to_degrees() - 1.0).abs() < 1e-6, "frame {k}, and from the last to the first");
    }
}

#[test]
fn walks_are_the_same_each_time_and_survive_their_file() {
    let wall = wall(CAVE);
    for package in [boxes(60, 2.0), boxes(60, 0.004), boxes(0, 1.0)] {
        for walk in Walk::value_variants() {
            let path = walk.path(&package, &wall, Some(7)).expect("a path");
            assert_eq!(path.poses().len(), 7);
            assert_eq!(walk.path(&package, &wall, Some(7)).expect("a path"), path, "{walk}");
            assert_eq!(CameraPath::parse(&path.to_string()), Ok(path), "{walk}");
            assert_eq!(walk.path(&package, &wall, Some(1)).expect("a path").poses().len(), 1, "{walk}");
        }
    }
}

#[test]
fn names_are_those_that_users_type() {
    for walk in Walk::value_variants() {
        let typed = walk.to_possible_value().expect("none is hidden");
        assert_eq!(typed.get_name(), walk.name());
        assert!(matches!(PathSource::open(walk.name()), Ok(PathSource::Walk(found)) if found == *walk));
    }
    let refused = PathSource::open("stroll").expect_err("there is none");
    let message = format!("{refused:#}");
    assert!(["stroll", "orbit", "interior", "pan"].iter().all(|word| message.contains(word)), "{message}");
}
