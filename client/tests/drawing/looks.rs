//! What leaves look like: order, sides, alpha, textures, ids.

use glam::{DAffine3, DVec3};
use mullion_common::scene::{AlphaMode, Filter, GeometryChunk, Material, ObjectId, TextureRef, Wrap};

use crate::fixture::{Look, Picture, Scene, asymmetric_box, draw, draw_all, gpu, plain, png, rectangle, renderer};

const RED: [f32; 4] = [1.0, 0.0, 0.0, 1.0];
const GREEN: [f32; 4] = [0.0, 1.0, 0.0, 1.0];
const BLUE: [f32; 4] = [0.0, 0.0, 1.0, 1.0];

fn ahead() -> Look {
    Look::ahead(DVec3::ZERO, [80, 60])
}

/// A rectangle's leaf, `distance_m` ahead, of the given look.
fn add(scene: &mut Scene, distance_m: f64, geometry: &GeometryChunk, material: Material) -> ObjectId {
    let object = scene.object(DAffine3::from_translation(DVec3::new(0.0, 0.0, -distance_m)));
    let (mesh, material) = (scene.mesh(geometry), scene.material(material));
    scene.leaf(object, mesh, material);
    object
}

/// Which of red, green and blue is strongest.
fn strongest(picture: &Picture, x: u32, y: u32) -> usize {
    let rgb = picture.rgb(x, y);
    (0..3).max_by_key(|&i| rgb[i]).expect("three channels")
}

#[test]
fn of_coplanar_faces_the_first_leaf_is_seen() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let quad = rectangle([-1.0, -0.5], [1.0, 0.7]);
    for color in [GREEN, RED, BLUE] {
        add(&mut scene, 2.0, &quad, plain(color));
    }
    add(&mut scene, 1.5, &rectangle([0.2, -0.5], [1.0, 0.5]), plain(BLUE)); // nearer, last
    let picture = draw_all(&gpu, &scene, &ahead());
    assert_eq!((strongest(&picture, 35, 30), picture.id(35, 30)), (1, 1));
    assert_eq!((strongest(&picture, 55, 30), picture.id(55, 30)), (2, 4));
    assert_eq!(picture.id(0, 0), 0);
    let [r, g, b] = picture.rgb(0, 0);
    assert!(r < g && g < b && r > 100, "the sky: {:?}", [r, g, b]);
}

#[test]
fn blended_leaves_cover_back_to_front_and_have_no_depth_or_id() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let glass =
        |color: [f32; 4], alpha: f32| Material { alpha: AlphaMode::Blend, ..plain([color[0], color[1], color[2], alpha]) };
    add(&mut scene, 1.0, &rectangle([-0.6, -0.3], [0.3, 0.4]), glass(RED, 0.5));
    add(&mut scene, 2.0, &rectangle([-1.2, -0.6], [0.8, 0.8]), glass(BLUE, 0.9));
    add(&mut scene, 3.0, &rectangle([-3.0, -2.0], [3.0, 2.0]), plain(GREEN));
    add(&mut scene, 4.0, &rectangle([-4.0, -3.0], [4.0, 3.0]), glass(RED, 0.9)); // behind the green
    let picture = draw_all(&gpu, &scene, &ahead());
    let [r, g, b] = picture.rgb(38, 28);
    assert!(r > 150 && b > 150 && g < 90, "half red over blue: {:?}", [r, g, b]);
    assert_eq!(strongest(&picture, 52, 20), 2, "blue over green");
    assert_eq!(picture.rgb(5, 55)[0], 0, "nothing of what is behind the green");
    assert_eq!((picture.id(38, 28), picture.id(5, 55)), (3, 3));
}

#[test]
fn back_faces_are_dropped_unless_double_sided_and_mirrors_keep_their_front() {
    let Some(gpu) = gpu() else { return };
    let quad = rectangle([-1.0, -0.5], [0.5, 0.7]);
    let seen = |scale: DVec3, double_sided: bool| {
        let mut scene = Scene::default();
        let object = scene.object(DAffine3::from_scale(scale) * DAffine3::from_translation(DVec3::new(0.0, 0.0, -2.0)));
        let (mesh, material) = (scene.mesh(&quad), scene.material(Material { double_sided, ..plain(RED) }));
        scene.leaf(object, mesh, material);
        let look = ahead();
        let behind = Look {
            eye: DVec3::new(0.0, 0.0, -4.0),
            corners: [DVec3::new(1.0, -0.75, -3.0), DVec3::new(-1.0, -0.75, -3.0), DVec3::new(1.0, 0.75, -3.0)],
            ..look
        };
        [look, behind].map(|look| draw_all(&gpu, &scene, &look).ids.contains(&1))
    };
    assert_eq!(seen(DVec3::ONE, false), [true, false]);
    assert_eq!(seen(DVec3::ONE, true), [true, true]);
    assert_eq!(seen(DVec3::new(-1.0, 1.0, 1.0), false), [true, false], "a mirror image faces where it faced");
    assert_eq!(seen(DVec3::new(-1.0, -1.5, 1.0), false), [true, false], "turned half around");
    assert_eq!(seen(DVec3::new(-1.0, 1.0, 1.0), true), [true, true]);
}

#[test]
fn a_moved_object_is_drawn_where_it_stands() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let object = add(&mut scene, 2.0, &rectangle([-1.0, -0.5], [-0.2, 0.7]), plain(RED));
    let (look, mut renderer) = (ahead(), renderer(&gpu, &scene, [80, 60]));
    let before = draw(&mut renderer, &scene, &look, &scene.all());
    assert_eq!((before.id(30, 30), before.id(50, 30)), (1, 0));
    let mirrored =
        DAffine3::from_scale_rotation_translation(DVec3::new(-1.0, 1.0, 1.0), glam::DQuat::IDENTITY, DVec3::new(0.0, 0.0, -2.0));
    renderer.set_transform(object, mirrored.into());
    renderer.set_transform(ObjectId(99), mirrored.into());
    renderer.set_transform(object, DAffine3::from_scale(DVec3::NAN).into());
    let after = draw(&mut renderer, &scene, &look, &scene.all());
    assert_eq!((after.id(30, 30), after.id(50, 30)), (0, 1));
}

#[test]
fn masked_fragments_below_the_cutoff_are_not_there() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let holes = png(&image::RgbaImage::from_fn(2, 1, |x, _| image::Rgba([255, 255, 255, if x == 0 { 80 } else { 200 }])));
    let texture = TextureRef { filter: Filter::Nearest, wrap_u: Wrap::Clamp, ..scene.texture(holes) };
    let mask = Material { texture: Some(texture), alpha: AlphaMode::Mask { cutoff: 0.5 }, ..plain(RED) };
    add(&mut scene, 2.0, &rectangle([-1.0, -0.6], [1.0, 0.7]), mask.clone());
    add(&mut scene, 3.0, &rectangle([-1.5, -0.8], [1.5, 0.9]), plain(GREEN));
    let picture = draw_all(&gpu, &scene, &ahead());
    assert_eq!((picture.id(30, 30), picture.id(50, 30)), (2, 1));
    assert_eq!((strongest(&picture, 30, 30), strongest(&picture, 50, 30)), (1, 0));
}

#[test]
fn textures_lie_as_gltf_says_and_bad_ones_are_checkers() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    // Top row red and green, bottom row blue and white: glTF's (0, 0) is the image's top left.
    let rgbw = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 255u8]];
    let good = png(&image::RgbaImage::from_fn(2, 2, |x, y| image::Rgba(rgbw[(2 * y + x) as usize])));
    let good = TextureRef { filter: Filter::Nearest, ..scene.texture(good) };
    let bad = TextureRef { filter: Filter::Nearest, ..scene.texture(b"\x89PNG\r\n\x1a\nno image".to_vec()) };
    let textured = |texture| Material { texture: Some(texture), ..plain([1.0; 4]) };
    add(&mut scene, 2.0, &rectangle([-1.8, -1.0], [-0.1, 1.0]), textured(good));
    add(&mut scene, 2.0, &rectangle([0.1, -1.0], [1.8, 1.0]), textured(bad));
    let look = ahead();
    let picture = draw_all(&gpu, &scene, &look);
    assert_eq!([(12, 20), (30, 20), (12, 40)].map(|(x, y)| strongest(&picture, x, y)), [0, 1, 2]);
    let white = picture.rgb(30, 40);
    assert!(white.iter().all(|&c| c > 100), "{white:?}");
    let magenta = (42..78).filter(|&x| picture.rgb(x, 30)[0] > 100 && picture.rgb(x, 30)[1] == 0).count();
    let black = (42..78).filter(|&x| picture.rgb(x, 30) == [0, 0, 0]).count();
    assert!(magenta > 8 && black > 8, "a checker: {magenta} magenta, {black} black of 36");
    let counts_as_resident = renderer(&gpu, &scene, look.size_px).is_resident(bad.chunk);
    assert!(counts_as_resident, "what cannot be read is not asked for again");
}

#[test]
fn every_face_of_a_box_is_lit_and_none_like_its_neighbours() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let chunk = GeometryChunk { colors: Vec::new(), ..asymmetric_box() };
    let object = scene.object(DAffine3::from_rotation_translation(
        glam::DQuat::from_rotation_y(0.6) * glam::DQuat::from_rotation_x(0.5),
        DVec3::new(-1.2, -1.4, -5.0),
    ));
    let mesh = scene.mesh(&chunk);
    let gray = scene.material(plain([0.5, 0.5, 0.5, 1.0]));
    scene.leaf(object, mesh, gray);
    let picture = draw_all(&gpu, &scene, &Look::ahead(DVec3::ZERO, [160, 120]));
    let mut shades: Vec<u8> = Vec::new();
    for (x, y, pixel) in picture.color.enumerate_pixels().filter(|(x, y, _)| picture.id(*x, *y) == 1) {
        assert!(pixel.0[0] > 60, "black at {x}, {y}");
        shades.push(pixel.0[0]);
    }
    shades.sort_unstable();
    shades.dedup_by(|a, b| a.abs_diff(*b) <= 4); // the head light varies a little over a face
    assert!((3..=12).contains(&shades.len()), "three faces, each with its own light: {shades:?}");
}

/// The shader's light, in `f64` from the plane itself.
fn light(normal: DVec3, towards_eye: DVec3) -> f64 {
    let towards_sun = DVec3::new(0.3521, 0.8049, 0.4778);
    0.25 + 0.45 * normal.dot(towards_sun).max(0.0) + 0.30 * normal.dot(towards_eye).max(0.0)
}

fn encode_srgb(linear: f64) -> f64 {
    255.0 * if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[test]
fn light_is_that_of_the_plane_from_both_sides_and_far_off_axis() {
    let Some(gpu) = gpu() else { return };
    let eye = DVec3::new(500.3, -20.2, 7_000.7);
    let corner = |x: f64, y: f64| eye + DVec3::new(x, y, -1.0);
    let size_px = [101, 67];
    let look = Look { eye, corners: [corner(0.4, -1.3), corner(2.1, -1.3), corner(0.4, -0.2)], size_px };
    for (tilt, turn) in [(0.0, 0.0), (0.7, 0.3), (-1.2, 0.4), (0.5, 2.6), (-2.9, -0.3)] {
        let rotation = glam::DQuat::from_rotation_y(turn) * glam::DQuat::from_rotation_x(tilt);
        let mut scene = Scene::default();
        let object = scene.object(DAffine3::from_rotation_translation(rotation, eye + DVec3::new(5.0, -3.0, -4.0)));
        let mesh = scene.mesh(&rectangle([-9.0, -7.0], [8.0, 9.0]));
        let gray = scene.material(Material { double_sided: true, ..plain([0.5, 0.5, 0.5, 1.0]) });
        scene.leaf(object, mesh, gray);
        let picture = draw_all(&gpu, &scene, &look);
        let front = rotation * DVec3::Z;
        let normal = if front.dot(DVec3::new(-5.0, 3.0, 4.0)) > 0.0 { front } else { -front };
        let mut seen = 0;
        for (x, y, pixel) in picture.color.enumerate_pixels().filter(|(x, y, _)| picture.id(*x, *y) == 1) {
            let across = 0.4 + 1.7 * (f64::from(x) + 0.5) / f64::from(size_px[0]);
            let up = -0.2 - 1.1 * (f64::from(y) + 0.5) / f64::from(size_px[1]);
            let towards_eye = -DVec3::new(across, up, -1.0).normalize();
            let wanted = encode_srgb(0.5 * light(normal, towards_eye));
            let found = f64::from(pixel.0[1]);
            assert!((found - wanted).abs() < 0.8, "tilt {tilt}, turn {turn}, at {x}, {y}: {found}, wanted {wanted:.2}");
            seen += 1;
        }
        assert!(seen > 500, "tilt {tilt}, turn {turn}: {seen} pixels");
    }
}
