//! Occlusion culling changes no pixel, whatever is drawn first, and leaves out what is hidden.
//! Method: the same frames with and without, along paths, with objects that move, faces that coincide, and any choice of what is first.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use mullion_client::frame::{FrameInput, FramePlan, PassResult, Planner, ViewInput};
use mullion_client::gpu::{Gpu, GpuError, GpuOptions, Optional, Renderer};
use mullion_client::missing::WhenMissing;
use mullion_client::occlusion::{BoxTest, Occlusion};
use mullion_common::scene::{AlphaMode, Material, ObjectId};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::ViewId;

use crate::fixture::{
    Look, Numbers, Scene, asymmetric_box, clutter, coinciding_sheets, diagonal_band, gpu, plain, rectangle, renderer,
};

const SIZE_PX: [u32; 2] = [143, 91];

/// Clutter in rooms: walls of a lattice, through which some of it sticks, bands that fill little of their boxes, and faces given twice.
fn rooms() -> Scene {
    let mut scene = clutter(400);
    let wall = scene.mesh(&rectangle([-20.0, -20.0], [20.0, 20.0]));
    let paint = scene.material(Material { double_sided: true, ..plain([0.7, 0.6, 0.5, 1.0]) });
    for k in -2..=2 {
        for turn in [DQuat::IDENTITY, DQuat::from_rotation_y(1.57), DQuat::from_rotation_x(1.57)] {
            let place = turn * DVec3::new(0.0, 0.0, f64::from(k) * 7.0);
            let object = scene.object(DAffine3::from_rotation_translation(turn, place));
            scene.leaf(object, wall, paint);
        }
    }
    let (band, mut numbers) = (scene.mesh(&diagonal_band(6.0)), Numbers(11));
    for _ in 0..60 {
        let turn = DQuat::from_scaled_axis(numbers.vector(-3.0, 3.0));
        let object = scene.object(DAffine3::from_rotation_translation(turn, numbers.vector(-15.0, 15.0)));
        scene.leaf(object, band, paint);
    }
    scene.join(&coinciding_sheets(40));
    scene
}

/// A look that turns and walks from frame to frame, and jumps now and then.
fn walk(numbers: &mut Numbers, frame: u32, at: &mut (DVec3, DQuat)) -> Look {
    if frame.is_multiple_of(9) {
        *at = (numbers.vector(-6.0, 6.0), DQuat::from_scaled_axis(numbers.vector(-2.5, 2.5)));
    }
    at.0 += at.1 * DVec3::new(0.02, 0.01, -0.15);
    at.1 *= DQuat::from_rotation_y(0.03);
    let corner = |x: f64, y: f64| at.0 + at.1 * DVec3::new(x, y, -1.0);
    Look { eye: at.0, corners: [corner(-0.9, -0.6), corner(0.8, -0.6), corner(-0.9, 0.5)], size_px: SIZE_PX }
}

fn input<'a>(
    renderer: &'a Renderer,
    scene: &'a Scene,
    look: &Look,
    views: &'a [ViewInput<'a>],
    resident: &'a dyn Fn(mullion_common::scene::ChunkId) -> bool,
) -> FrameInput<'a> {
    let when_missing = WhenMissing::Box;
    FrameInput {
        views,
        shared_eye: look.eye,
        manifest: &scene.manifest,
        transforms: renderer.transforms(),
        resident,
        when_missing,
        has_changed: true,
    }
}

/// Draws one frame of what a planner plans, or of what becomes of its plan.
fn draw_with(
    planner: &mut Planner,
    renderer: &mut Renderer,
    (scene, look, visible, missing): (&Scene, &Look, &VisibleSet, &VisibleSet),
    change: impl FnOnce(&mut FramePlan),
) -> PassResult {
    let views = [ViewInput::new(ViewId(4), look.projection(), visible, missing)];
    let mut plan = planner.begin(input(renderer, scene, look, &views, &|_| true)).clone();
    change(&mut plan);
    let results = renderer.draw(&plan).expect("drawn");
    let mut sum = results.passes[0].clone();
    let mut round = planner.feed(&results).cloned();
    while let Some(plan) = round {
        let results = renderer.draw(&plan).expect("drawn");
        let result = &results.passes[0];
        (sum.leaves, sum.boxes, sum.triangles) =
            (sum.leaves + result.leaves, sum.boxes + result.boxes, sum.triangles + result.triangles);
        round = planner.feed(&results).cloned();
    }
    sum
}

fn assert_same(a: &Renderer, b: &Renderer, what: &str) {
    let view = ViewId(4);
    let ids = |renderer: &Renderer| renderer.read_ids(view).expect("read");
    let color = |renderer: &Renderer| renderer.read_color(view).expect("read");
    let differing = ids(a).iter().zip(ids(b)).filter(|(a, b)| **a != *b).count();
    assert_eq!(differing, 0, "{what}: so many pixels show another object");
    let (a, b) = (color(a), color(b));
    let differing: Vec<_> = a.enumerate_pixels().zip(b.pixels()).filter(|((.., a), b)| a != b).collect();
    assert!(differing.is_empty(), "{what}: {} pixels differ, as {:?}", differing.len(), &differing[..differing.len().min(4)]);
}

fn both(gpu: &Arc<Gpu>, scene: &Scene) -> (Renderer, Renderer) {
    (renderer(gpu, scene, SIZE_PX), renderer(gpu, scene, SIZE_PX))
}

#[test]
fn no_pixel_changes_along_a_path_while_objects_move() {
    let Some(gpu) = gpu() else { return };
    let scene = rooms();
    let (mut plain, mut culled) = both(&gpu, &scene);
    let (mut all, mut some) = (Planner::new(), Planner::new().culling(Occlusion::Hiz));
    let mut numbers = Numbers(3);
    let mut at = (DVec3::ZERO, DQuat::IDENTITY);
    let (mut leaves, mut hidden, mut late) = (0, 0, 0);
    for frame in 0..45 {
        let look = walk(&mut numbers, frame, &mut at);
        let objects = scene.manifest.transforms.len() as u32;
        for _ in 0..20 {
            let object = ObjectId(numbers.next() % objects);
            let moved = DAffine3::from_translation(numbers.vector(-0.5, 0.5)) * plain.transforms()[object.0 as usize].affine();
            [&mut plain, &mut culled].into_iter().for_each(|renderer| renderer.set_transform(object, moved.into()));
        }
        let visible = scene.all();
        // Some leaves have not come: boxes stand in for them.
        let missing = VisibleSet::from_ranges([LeafRange::new(frame * 5, frame * 5 + 4)]);
        let parts = (&scene, &look, &visible, &missing);
        let of_all = draw_with(&mut all, &mut plain, parts, |_| {});
        let mut first = 0;
        let of_some =
            draw_with(&mut some, &mut culled, parts, |plan| first = plan.passes[0].first.as_ref().expect("culling").len());
        assert_same(&plain, &culled, &format!("frame {frame}"));
        let seen = of_some.seen.expect("culling");
        assert_eq!((of_all.boxes, of_all.seen), (of_some.boxes, None));
        assert!(of_some.leaves >= seen.len() && of_some.leaves <= of_all.leaves);
        leaves += of_all.leaves;
        hidden += of_all.leaves - of_some.leaves;
        late += of_some.leaves.saturating_sub(first);
    }
    println!("{leaves} leaves, {hidden} of them left out, {late} drawn late");
    assert!(hidden * 4 > leaves && late > 1000, "{hidden} of {leaves} were left out, {late} drawn late");
}

/// Objects move, faces coincide, boxes stand in for leaves, some of it is glass.
fn assert_same_along_a_path(gpu: &Arc<Gpu>, occlusion: Occlusion) {
    let scene = rooms();
    let (mut plain, mut culled) = both(gpu, &scene);
    let (mut all, mut some) = (Planner::new(), Planner::new().culling(occlusion));
    let mut numbers = Numbers(11);
    let mut at = (DVec3::ZERO, DQuat::IDENTITY);
    let (mut leaves, mut drawn) = (0, 0);
    for frame in 0..30 {
        let look = walk(&mut numbers, frame, &mut at);
        for _ in 0..20 {
            let object = ObjectId(numbers.next() % scene.manifest.transforms.len() as u32);
            let moved = DAffine3::from_translation(numbers.vector(-0.5, 0.5)) * plain.transforms()[object.0 as usize].affine();
            [&mut plain, &mut culled].into_iter().for_each(|renderer| renderer.set_transform(object, moved.into()));
        }
        let (visible, missing) = (scene.all(), VisibleSet::from_ranges([LeafRange::new(frame * 5, frame * 5 + 4)]));
        let parts = (&scene, &look, &visible, &missing);
        leaves += draw_with(&mut all, &mut plain, parts, |_| {}).leaves;
        drawn += draw_with(&mut some, &mut culled, parts, |_| {}).leaves;
        assert_same(&plain, &culled, &format!("{occlusion}, frame {frame}"));
    }
    println!("{occlusion}: {drawn} of {leaves} leaves drawn");
    // How much a budget of time allows is the machine's.
    assert!(occlusion == Occlusion::CostAdaptive || drawn * 10 < leaves * 9, "{occlusion}: {drawn} of {leaves} leaves drawn");
}

#[test]
fn no_pixel_changes_front_to_back() {
    let Some(gpu) = gpu() else { return };
    assert_same_along_a_path(&gpu, Occlusion::Paper);
    assert_same_along_a_path(&gpu, Occlusion::CostAdaptive);
}

#[test]
fn no_pixel_changes_with_queries() {
    let Some(gpu) = gpu() else { return };
    assert_same_along_a_path(&gpu, Occlusion::Query);
}

#[test]
fn no_pixel_changes_where_no_depth_test_can_be_forced_to_come_first() {
    let Ok(gpu) = Gpu::open(GpuOptions { without: Some(Optional::EarlyDepth), ..GpuOptions::default() }) else { return };
    assert_same_along_a_path(&gpu, Occlusion::Hiz);
    assert_same_along_a_path(&gpu, Occlusion::Paper);
    assert_same_along_a_path(&gpu, Occlusion::Query);
}

/// Draws a frame in which nothing moves; gives its leaves, and how many bounds were asked for.
fn draw_still(planner: &mut Planner, renderer: &mut Renderer, (scene, look): (&Scene, &Look)) -> (u32, usize) {
    let (visible, missing) = (scene.all(), VisibleSet::default());
    let views = [ViewInput::new(ViewId(4), look.projection(), &visible, &missing)];
    let mut input = input(renderer, scene, look, &views, &|_| true);
    input.has_changed = false;
    let (mut leaves, mut asked) = (0, 0);
    let mut round = Some(planner.begin(input).clone());
    while let Some(plan) = round {
        asked += plan.passes[0].bounds.len();
        let results = renderer.draw(&plan).expect("drawn");
        leaves += results.passes[0].leaves;
        round = planner.feed(&results).cloned();
    }
    (leaves, asked)
}

#[test]
fn at_rest_what_is_seen_is_not_asked_for_again_and_a_sampled_picture_becomes_exact() {
    let Some(gpu) = gpu() else { return };
    let scene = rooms();
    let look = Look::ahead(DVec3::new(0.5, 0.5, 60.0), SIZE_PX);
    let (mut plain, mut culled) = both(&gpu, &scene);
    draw_with(&mut Planner::new(), &mut plain, (&scene, &look, &scene.all(), &VisibleSet::default()), |_| {});
    for occlusion in [Occlusion::Paper, Occlusion::Query, Occlusion::Sampled] {
        let mut planner = Planner::new().culling(occlusion);
        let frames: Vec<(u32, usize)> = (0..11).map(|_| draw_still(&mut planner, &mut culled, (&scene, &look))).collect();
        println!("{occlusion}: leaves drawn, bounds asked for: {frames:?}");
        assert_same(&plain, &culled, &format!("{occlusion} at rest"));
        assert!(frames[10].1 < frames[0].1, "{occlusion}: {frames:?}");
        if occlusion == Occlusion::Sampled {
            assert!(frames.is_sorted_by_key(|(leaves, _)| *leaves) && frames[0].0 < frames[10].0, "{frames:?}");
        }
    }
}

#[test]
fn no_pixel_changes_whatever_is_drawn_first() {
    let Some(gpu) = gpu() else { return };
    let scene = rooms();
    let (mut plain, mut culled) = both(&gpu, &scene);
    let mut numbers = Numbers(4);
    let mut at = (DVec3::ZERO, DQuat::IDENTITY);
    for frame in 0..24 {
        let look = walk(&mut numbers, frame * 9, &mut at);
        let (visible, missing) = (scene.all(), VisibleSet::default());
        let parts = (&scene, &look, &visible, &missing);
        draw_with(&mut Planner::new(), &mut plain, parts, |_| {});
        let of = 1 + numbers.next() % 5;
        draw_with(&mut Planner::new().culling(Occlusion::Hiz), &mut culled, parts, |plan| {
            let pass = &mut plan.passes[0];
            let chosen = pass.opaque.leaves().filter(|_| numbers.next().is_multiple_of(of));
            pass.first = Some(VisibleSet::from_ranges(chosen.map(|leaf| LeafRange::new(leaf, leaf + 1))));
        });
        assert_same(&plain, &culled, &format!("look {frame}"));
    }
}

#[test]
fn the_pyramid_drops_nothing_of_which_a_pixel_is_seen() {
    let Some(gpu) = gpu() else { return };
    let scene = rooms();
    let visible = scene.all();
    let mut numbers = Numbers(29);
    let (mut seen, mut hidden) = (0, 0);
    // Odd edges at every level, one pixel, a row, a power of two.
    for size_px in [[143, 91], [1, 1], [517, 3], [2, 255], [64, 128]] {
        let mut renderer = renderer(&gpu, &scene, size_px);
        for look in 0..12 {
            let mut at = (DVec3::ZERO, DQuat::IDENTITY);
            let look = Look { size_px, ..walk(&mut numbers, look * 9, &mut at) };
            let first = visible.leaves().filter(|_| numbers.next().is_multiple_of(3));
            let first = VisibleSet::from_ranges(first.map(|leaf| LeafRange::new(leaf, leaf + 1)));
            let parts = (&scene, &look, &visible, &VisibleSet::default());
            let [(drawn, ids), (sifted, _)] = [BoxTest::Drawn, BoxTest::Sifted].map(|test| {
                let mut planner = Planner::new().culling(Occlusion::Hiz);
                let result = draw_with(&mut planner, &mut renderer, parts, |plan| {
                    (plan.passes[0].first, plan.passes[0].test) = (Some(first.clone()), test);
                });
                (result, renderer.read_leaves(ViewId(4)).expect("read"))
            });
            let (has_pixel, none) = (|leaf: &u32| ids.contains(&(leaf + 1)), VisibleSet::default());
            let mut dropped = VisibleSet::default();
            drawn.late.difference_into(&sifted.late, &mut dropped);
            // Drawn boxes are taken to be nearer where they are steep: a few more are seen, of which there is no pixel.
            assert!(dropped.len() * 10 <= drawn.late.len(), "{size_px:?}: {dropped:?} of {drawn:?}");
            assert!(drawn.late.is_superset_of(&sifted.late) && !dropped.leaves().any(|leaf| has_pixel(&leaf)), "{size_px:?}");
            // What has a pixel is known to the leaf, of glass and what reaches the near plane at least what is seen.
            let seen_next = sifted.seen.unwrap_or(none);
            assert!(visible.leaves().filter(has_pixel).all(|leaf| seen_next.contains(leaf)), "{size_px:?}: {seen_next:?}");
            assert!(drawn.seen.as_ref().is_some_and(|drawn| drawn.is_superset_of(&seen_next)), "{size_px:?}: {seen_next:?}");
            let drawn = drawn.late;
            (seen, hidden) = (seen + drawn.len(), hidden + visible.len() - drawn.len());
        }
    }
    assert!(seen > 1000 && hidden > 1000, "{seen} seen, {hidden} hidden");
}

#[test]
fn of_coplanar_faces_the_first_leaf_is_seen_in_whichever_turn() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let mesh = scene.mesh(&rectangle([-1.0, -1.0], [1.0, 1.0]));
    for shade in [0.2, 0.5, 0.9] {
        let material = scene.material(plain([shade, shade, shade, 1.0]));
        let object = scene.object(DAffine3::from_translation(DVec3::new(0.0, 0.0, -3.0)));
        scene.leaf(object, mesh, material);
    }
    let look = Look::ahead(DVec3::ZERO, SIZE_PX);
    let mut culled = renderer(&gpu, &scene, SIZE_PX);
    for first in [vec![], vec![0], vec![1], vec![2], vec![0, 2], vec![1, 2], vec![0, 1, 2]] {
        let parts = (&scene, &look, &scene.all(), &VisibleSet::default());
        let result = draw_with(&mut Planner::new().culling(Occlusion::Hiz), &mut culled, parts, |plan| {
            plan.passes[0].first = Some(VisibleSet::from_ranges(first.iter().map(|leaf| LeafRange::new(*leaf, leaf + 1))));
        });
        let ids = culled.read_ids(ViewId(4)).expect("read");
        assert!(ids.contains(&1) && !ids.contains(&2) && !ids.contains(&3), "{first:?}");
        assert_eq!(result.seen, Some(VisibleSet::all(1)), "one has all pixels: {first:?}");
        let waited = (0..3).filter(|leaf| !first.contains(leaf));
        assert!(waited.clone().all(|leaf| result.late.contains(leaf)), "as near as what hides it: {first:?}");
        assert_eq!(result.late.len(), waited.count() as u32, "{first:?}");
    }
}

/// Draws a frame of all without and with culling, and holds them against each other. How many leaves the latter drew.
fn drawn_alike((scene, look): (&Scene, &Look), planner: &mut Planner, plain: &mut Renderer, culled: &mut Renderer) -> u32 {
    let parts = (scene, look, &scene.all(), &VisibleSet::default());
    draw_with(&mut Planner::new(), plain, parts, |_| {});
    let result = draw_with(planner, culled, parts, |_| {});
    assert_same(plain, culled, "all, and what is not hidden");
    result.leaves
}

#[test]
fn what_a_wall_hides_is_left_out_from_the_second_frame_on_and_is_back_at_once() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let (wall, mesh) = (scene.mesh(&rectangle([-30.0, -30.0], [30.0, 30.0])), scene.mesh(&asymmetric_box()));
    let [solid, glass] = [AlphaMode::Opaque, AlphaMode::Blend].map(|alpha| Material { alpha, ..plain([0.5; 4]) });
    let (solid, glass) = (scene.material(solid), scene.material(glass));
    let in_front = scene.object(DAffine3::from_translation(DVec3::new(0.0, 0.0, -5.0)));
    scene.leaf(in_front, wall, solid);
    for k in 0..40 {
        let place = DVec3::new(f64::from(k % 8) - 4.0, f64::from(k / 8) - 2.5, -20.0);
        let object = scene.object(DAffine3::from_translation(place));
        scene.leaf(object, mesh, if k % 4 == 0 { glass } else { solid });
    }
    let around_the_eye = scene.object(DAffine3::from_translation(DVec3::splat(-0.5)));
    scene.leaf(around_the_eye, mesh, solid);
    let look = Look::ahead(DVec3::ZERO, SIZE_PX);
    let (mut plain, mut culled) = both(&gpu, &scene);
    let mut planner = Planner::new().culling(Occlusion::Hiz);
    let mut frame = |plain: &mut Renderer, culled: &mut Renderer| drawn_alike((&scene, &look), &mut planner, plain, culled);
    // The glass waits even in the first frame.
    let drawn: Vec<u32> = (0..3).map(|_| frame(&mut plain, &mut culled)).collect();
    assert_eq!(drawn, [32, 2, 2], "the wall, and what is around the eye");
    let aside = DAffine3::from_translation(DVec3::new(0.0, 500.0, -5.0));
    [&mut plain, &mut culled].into_iter().for_each(|renderer| renderer.set_transform(in_front, aside.into()));
    assert_eq!(frame(&mut plain, &mut culled), 42, "nothing is hidden, also in the first frame");
    let back = scene.manifest.transforms[in_front.0 as usize];
    [&mut plain, &mut culled].into_iter().for_each(|renderer| renderer.set_transform(in_front, back));
    let drawn: Vec<u32> = (0..3).map(|_| frame(&mut plain, &mut culled)).collect();
    assert_eq!(drawn, [42, 2, 2], "what is hidden goes with the next frame");
}

/// Two walls leave a quarter of the view open. A band runs behind them, all of it hidden, but the box around it is not.
#[test]
fn a_leaf_of_which_only_the_box_is_seen_is_left_out_piece_by_piece() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let paint = scene.material(Material { double_sided: true, ..plain([0.5; 4]) });
    let walls = [rectangle([-30.0, -30.0], [0.0, 30.0]), rectangle([-30.0, -30.0], [30.0, 0.0])];
    for (wall, away) in walls.iter().zip([5.0, 5.5]) {
        let (mesh, object) = (scene.mesh(wall), scene.object(DAffine3::from_translation(DVec3::new(0.0, 0.0, -away))));
        scene.leaf(object, mesh, paint);
    }
    let band = scene.mesh(&diagonal_band(6.0));
    let object = scene.object(DAffine3::from_translation(DVec3::new(-4.0, -4.0, -20.0)));
    scene.leaf(object, band, paint);
    let look = Look::ahead(DVec3::ZERO, SIZE_PX);
    let (mut plain, mut culled) = both(&gpu, &scene);
    let mut planner = Planner::new().culling(Occlusion::Hiz);
    let mut frame = |plain: &mut Renderer, culled: &mut Renderer| drawn_alike((&scene, &look), &mut planner, plain, culled);
    let drawn: Vec<u32> = (0..64).map(|_| frame(&mut plain, &mut culled)).collect();
    // In the first frame, and whenever its box is tested again.
    assert_eq!(drawn.iter().filter(|leaves| **leaves == 3).count(), 3, "{drawn:?}");
    let place = DAffine3::from_translation(DVec3::new(0.0, 0.0, -20.0));
    [&mut plain, &mut culled].into_iter().for_each(|renderer| renderer.set_transform(object, place.into()));
    let drawn: Vec<u32> = (0..40).map(|_| frame(&mut plain, &mut culled)).collect();
    assert_eq!(drawn, [3; 40], "it is seen, also in the first frame");
}

#[test]
fn a_gpu_that_cannot_test_boxes_draws_all() {
    let options = GpuOptions { without: Some(Optional::IndirectDraws), ..GpuOptions::default() };
    let Ok(gpu) = Gpu::open(options) else { return };
    let scene = rooms();
    let (mut plain, mut culled) = both(&gpu, &scene);
    assert!(!culled.can_cull());
    let look = Look::ahead(DVec3::new(0.5, 0.5, 6.0), SIZE_PX);
    let (all, missing) = (scene.all(), VisibleSet::default());
    let parts = (&scene, &look, &all, &missing);
    let of_all = draw_with(&mut Planner::new(), &mut plain, parts, |_| {});
    let mut planner = Planner::new().culling(Occlusion::Hiz);
    for _ in 0..3 {
        let of_some = draw_with(&mut planner, &mut culled, parts, |_| {});
        assert_eq!((of_some.leaves, of_some.seen), (of_all.leaves, None));
        assert_same(&plain, &culled, "without tests");
    }
    let views = [ViewInput::new(ViewId(4), look.projection(), &all, &missing)];
    let plan = Planner::new().culling(Occlusion::Paper).begin(input(&culled, &scene, &look, &views, &|_| true)).clone();
    assert_eq!(culled.draw(&plan), Err(GpuError::NoCulling));
}

/// Meshes far from their objects' origins, which `f32` rounds by centimetres.
#[test]
fn no_pixel_changes_far_from_the_origins_of_objects() {
    let Some(gpu) = gpu() else { return };
    let mut scene = clutter(300);
    scene.push_meshes_away(DVec3::new(190_000.0, -70_000.0, 130_000.0));
    let (mut plain, mut culled) = both(&gpu, &scene);
    let mut numbers = Numbers(17);
    let mut at = (DVec3::ZERO, DQuat::IDENTITY);
    let (mut all, mut hiz, mut query) =
        (Planner::new(), Planner::new().culling(Occlusion::Hiz), Planner::new().culling(Occlusion::Query));
    let (mut leaves, mut drawn) = (0, 0);
    for frame in 0..30 {
        let look = walk(&mut numbers, frame, &mut at);
        let (visible, missing) = (scene.all(), VisibleSet::default());
        let parts = (&scene, &look, &visible, &missing);
        leaves += draw_with(&mut all, &mut plain, parts, |_| {}).leaves;
        for planner in [&mut hiz, &mut query] {
            drawn += draw_with(planner, &mut culled, parts, |_| {}).leaves;
            assert_same(&plain, &culled, &format!("far away, frame {frame}"));
        }
    }
    assert!(drawn < leaves * 2, "{drawn} of {leaves} twice");
}

#[test]
fn a_frame_that_was_not_complete_leaves_no_trace() {
    let Some(gpu) = gpu() else { return };
    let scene = rooms();
    let (mut plain, mut culled) = both(&gpu, &scene);
    let mut numbers = Numbers(23);
    let mut at = (DVec3::ZERO, DQuat::IDENTITY);
    let (visible, missing) = (scene.all(), VisibleSet::default());
    for occlusion in [Occlusion::Paper, Occlusion::Query] {
        let mut planner = Planner::new().culling(occlusion);
        for frame in 0..8 {
            // Its first round is planned, with much asked for, and never drawn.
            let look = walk(&mut numbers, frame, &mut at);
            let views = [ViewInput::new(ViewId(4), look.projection(), &visible, &missing)];
            let asked = planner.begin(input(&culled, &scene, &look, &views, &|_| true)).passes[0].bounds.len();
            assert!(asked > 0, "{occlusion}, frame {frame}");
            let look = walk(&mut numbers, frame, &mut at);
            let parts = (&scene, &look, &visible, &missing);
            draw_with(&mut Planner::new(), &mut plain, parts, |_| {});
            let drawn = draw_with(&mut planner, &mut culled, parts, |_| {}).leaves;
            assert_same(&plain, &culled, &format!("{occlusion}, frame {frame}"));
            if occlusion == Occlusion::Paper {
                // It knows nothing of frames before while something moves.
                let anew = draw_with(&mut Planner::new().culling(occlusion), &mut culled, parts, |_| {}).leaves;
                assert_eq!(drawn, anew, "{occlusion}, frame {frame}");
            }
        }
    }
}

#[test]
fn a_pass_that_is_timed_tells_what_it_took() {
    let Some(gpu) = gpu() else { return };
    let scene = clutter(50);
    let (mut plain, mut culled) = both(&gpu, &scene);
    let look = Look::ahead(DVec3::ZERO, SIZE_PX);
    let (all, none) = (scene.all(), VisibleSet::default());
    let times = |renderer: &mut Renderer, mut planner: Planner, is_timed: bool| {
        draw_with(&mut planner, renderer, (&scene, &look, &all, &none), |plan| plan.passes[0].is_timed = is_timed).times
    };
    assert_eq!(times(&mut plain, Planner::new(), false), None);
    let timed = times(&mut plain, Planner::new(), true);
    let tested = times(&mut culled, Planner::new().culling(Occlusion::Hiz), false);
    assert_eq!(timed.is_some(), tested.is_some(), "a GPU has a clock or not");
    for times in timed.into_iter().chain(tested) {
        assert!(times.plan_us > 0.0 && times.draw_us > 0.0, "{times:?}");
    }
    assert!(timed.is_none_or(|times| times.test_us == 0.0), "{timed:?}");
}
