//! What is drawn of leaves that have not come: boxes where their bounds are, or nothing.
//! Method: against rays through the bounds in `f64`, and against scenes without those leaves.

use glam::DVec3;
use mullion_client::missing::WhenMissing;
use mullion_common::scene::{ChunkId, LeafRecord};
use mullion_common::visible_set::{LeafRange, VisibleSet};

use crate::fixture::{Look, Numbers, Scene, clutter, draw, draw_without, gpu, plain, rectangle, renderer};

const SIZE_PX: [u32; 2] = [120, 90];

/// From somewhere among the boxes, off its axis.
fn random_look(numbers: &mut Numbers) -> Look {
    let eye = numbers.vector(-9.0, 9.0);
    let turn = glam::DQuat::from_scaled_axis(numbers.vector(-2.5, 2.5));
    let corner = |x: f64, y: f64| eye + turn * DVec3::new(x, y, -1.0);
    Look { eye, corners: [corner(-0.9, -0.4), corner(0.5, -0.4), corner(-0.9, 0.65)], size_px: SIZE_PX }
}

/// Through the middle of a pixel, from the eye to the screen.
fn ray(look: &Look, x: u32, y: u32) -> DVec3 {
    let [bottom_left, bottom_right, top_left] = look.corners;
    let across = (f64::from(x) + 0.5) / f64::from(look.size_px[0]);
    let up = 1.0 - (f64::from(y) + 0.5) / f64::from(look.size_px[1]);
    bottom_left + (bottom_right - bottom_left) * across + (top_left - bottom_left) * up - look.eye
}

/// Where the ray enters the leaf's bounds, grown by a share of their size, and where it leaves them, in lengths of the ray.
fn crossing(scene: &Scene, leaf: &LeafRecord, look: &Look, ray: DVec3, grown: f64) -> Option<(f64, f64)> {
    let local_from_world = scene.manifest.transforms[leaf.object.0 as usize].affine().inverse();
    let (origin, ray) = (local_from_world.transform_point3(look.eye), local_from_world.transform_vector3(ray));
    let bounds = leaf.local_aabb();
    let margin = bounds.size() * grown;
    let (to_min, to_max) = ((bounds.min - margin - origin) / ray, (bounds.max + margin - origin) / ray);
    let (enters, leaves) = (to_min.min(to_max).max_element(), to_min.max(to_max).min_element());
    (enters < leaves && leaves > 0.0).then_some((enters, leaves))
}

fn some_of(numbers: &mut Numbers, scene: &Scene, one_in: u32) -> VisibleSet {
    let mut picked = scene.all().leaves().collect::<Vec<_>>();
    picked.retain(|_| numbers.next().is_multiple_of(one_in));
    VisibleSet::from_ranges(picked.into_iter().map(|leaf| LeafRange::new(leaf, leaf + 1)))
}

#[test]
fn with_everything_there_all_ways_give_one_picture() {
    let Some(gpu) = gpu() else { return };
    let (scene, mut numbers, nothing) = (clutter(200), Numbers(3), VisibleSet::default());
    let mut renderer = renderer(&gpu, &scene, SIZE_PX);
    for _ in 0..4 {
        let look = random_look(&mut numbers);
        let [boxes, hold, left_out] =
            WhenMissing::ALL.map(|way| draw_without(&mut renderer, &scene, &look, &scene.all(), (way, &nothing)));
        assert!(boxes.color == hold.color && boxes.ids == hold.ids);
        assert!(left_out.color == hold.color && left_out.ids == hold.ids);
        assert!(hold.ids.iter().any(|&id| id != 0));
    }
}

#[test]
fn boxes_change_only_pixels_of_their_bounds_and_nothing_is_a_scene_without_the_leaves() {
    let Some(gpu) = gpu() else { return };
    let (scene, mut numbers) = (clutter(200), Numbers(8));
    let mut renderer = renderer(&gpu, &scene, SIZE_PX);
    let (mut changed, mut unchanged) = (0, 0);
    for _ in 0..6 {
        let (look, missing) = (random_look(&mut numbers), some_of(&mut numbers, &scene, 5));
        let mut others = VisibleSet::default();
        scene.all().difference_into(&missing, &mut others);
        let without = draw(&mut renderer, &scene, &look, &others);
        let nothing = draw_without(&mut renderer, &scene, &look, &scene.all(), (WhenMissing::Nothing, &missing));
        assert!(nothing.color == without.color && nothing.ids == without.ids, "eye {}", look.eye);
        assert_eq!(nothing.plan.passes[0].missing, missing.len());

        let boxes = draw_without(&mut renderer, &scene, &look, &scene.all(), (WhenMissing::Box, &missing));
        assert_eq!(boxes.plan.passes[0].boxes, missing.leaves().collect::<Vec<_>>());
        for (x, y, pixel) in boxes.color.enumerate_pixels() {
            if pixel == without.color.get_pixel(x, y) && boxes.id(x, y) == without.id(x, y) {
                unchanged += 1;
                continue;
            }
            let ray = ray(&look, x, y);
            let crosses = |leaf: u32| crossing(&scene, &scene.manifest.leaves[leaf as usize], &look, ray, 1e-3).is_some();
            assert!(missing.leaves().any(crosses), "eye {}: {x}, {y} is no box's", look.eye);
            changed += 1;
        }
    }
    assert!(changed > 3000 && unchanged > 10_000, "{changed} changed, {unchanged} not");
}

#[test]
fn boxes_are_the_leaves_bounds_and_open_to_an_eye_inside() {
    let Some(gpu) = gpu() else { return };
    let (scene, mut numbers) = (clutter(60), Numbers(21));
    let mut renderer = renderer(&gpu, &scene, SIZE_PX);
    let (mut differing, mut pixels, mut seen) = (0, 0, 0);
    for round in 0..8 {
        let mut look = random_look(&mut numbers);
        if round % 2 == 0 {
            // Into the middle of a leaf's bounds: that one must not be seen.
            let leaf = &scene.manifest.leaves[round * 5];
            let middle = scene.manifest.transforms[leaf.object.0 as usize].affine().transform_point3(leaf.local_aabb().center());
            look.corners = look.corners.map(|corner| corner - look.eye + middle);
            look.eye = middle;
        }
        let picture = draw_without(&mut renderer, &scene, &look, &scene.all(), (WhenMissing::Box, &scene.all()));
        for (x, y, _) in picture.color.enumerate_pixels() {
            let ray = ray(&look, x, y);
            let enters = scene.manifest.leaves.iter().filter_map(|leaf| {
                let (enters, _) = crossing(&scene, leaf, &look, ray, 0.0)?;
                (enters > 0.0).then_some((enters, leaf.object.0 + 1))
            });
            let wanted = enters.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, id)| id);
            differing += u32::from(picture.id(x, y) != wanted);
            seen += u32::from(wanted != 0);
            pixels += 1;
        }
    }
    println!("{differing} of {pixels} pixels show another box than the rays, {seen} show one");
    assert!(differing * 2000 < pixels && seen * 10 > pixels, "{differing} of {pixels} differ, {seen} show a box");
}

#[test]
fn a_box_has_its_materials_colour_and_no_holes_and_flat_ones_are_seen() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let object = scene.object(glam::DAffine3::from_translation(DVec3::new(0.0, 0.0, -2.0)));
    let mesh = scene.mesh(&rectangle([-1.0, -0.5], [1.0, 0.7]));
    let glass = scene.material(mullion_common::scene::Material {
        alpha: mullion_common::scene::AlphaMode::Blend,
        ..plain([1.0, 0.0, 0.0, 0.1])
    });
    scene.leaf(object, mesh, glass);
    let look = Look::ahead(DVec3::ZERO, [80, 60]);
    let mut renderer = renderer(&gpu, &scene, look.size_px);
    renderer.evict(ChunkId(0));
    let picture = draw_without(&mut renderer, &scene, &look, &scene.all(), (WhenMissing::Box, &scene.all()));
    let [r, g, b] = picture.rgb(40, 30);
    assert!(r > 120 && g == 0 && b == 0, "solid red: {:?}", [r, g, b]);
    assert_eq!((picture.id(40, 30), picture.id(2, 30)), (1, 0));
    let behind = Look {
        eye: DVec3::new(0.0, 0.0, -4.0),
        corners: [DVec3::new(1.0, -0.75, -3.0), DVec3::new(-1.0, -0.75, -3.0), DVec3::new(1.0, 0.75, -3.0)],
        ..look
    };
    let picture = draw_without(&mut renderer, &scene, &behind, &scene.all(), (WhenMissing::Box, &scene.all()));
    assert_eq!(picture.id(40, 30), 1, "a flat box has two outer sides");
}
