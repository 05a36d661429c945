//! Groups of leaves that stay hidden are asked for as one, and no pixel changes: not where they come out, nor before things that are blended.

use glam::{DAffine3, DQuat, DVec3};
use mullion_client::frame::{FrameInput, Planner, ViewInput};
use mullion_client::gpu::{Renderer, ViewTarget};
use mullion_client::missing::WhenMissing;
use mullion_client::occlusion::Occlusion;
use mullion_common::scene::{Material, ObjectId};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::ViewId;

use crate::fixture::{Look, Numbers, Scene, asymmetric_box, clutter, gpu, plain, rectangle, renderer_of};

const SIZE_PX: [u32; 2] = [143, 91];
const VIEWS: [ViewId; 2] = [ViewId(4), ViewId(7)];

/// Rooms side by side along +X, full of boxes and open towards +Z. Neighbours of a room are numbered one after the other.
fn rooms() -> Scene {
    let mut scene = Scene::default();
    let wall = scene.mesh(&rectangle([-5.0, -6.0], [5.0, 6.0]));
    let paint = scene.material(Material { double_sided: true, ..plain([0.7, 0.6, 0.5, 1.0]) });
    let (mesh, mut numbers) = (scene.mesh(&asymmetric_box()), Numbers(17));
    for room in 0..20 {
        let at = DVec3::new(f64::from(room) * 4.0, 0.0, 0.0);
        let beside = scene.object(DAffine3::from_rotation_translation(DQuat::from_rotation_y(1.57), at - DVec3::X * 2.0));
        scene.leaf(beside, wall, paint);
        for corner in 0..10 {
            let around = at + DVec3::new(f64::from(corner % 2) - 0.5, f64::from(corner / 2) - 2.0, -3.0);
            for _ in 0..8 {
                let place = DAffine3::from_scale_rotation_translation(
                    numbers.vector(0.02, 0.2),
                    DQuat::from_scaled_axis(numbers.vector(-2.0, 2.0)),
                    around + numbers.vector(-0.4, 0.4),
                );
                // Everything there is twice, in two colours.
                for twin in [0.3, 0.9] {
                    let shade = [0.2 + 0.04 * room as f32, 0.1 * corner as f32, twin, 1.0];
                    let (object, material) = (scene.object(place), scene.material(plain(shade)));
                    scene.leaf(object, mesh, material);
                }
            }
        }
    }
    scene
}

/// Draws a frame of both views. How many rounds that took, and how many leaves were listed in the first.
fn draw(planner: &mut Planner, renderer: &mut Renderer, scene: &Scene, looks: &[Look; 2], missing: &VisibleSet) -> (u32, u32) {
    let all = scene.all();
    let views = [0, 1].map(|at| ViewInput::new(VIEWS[at], looks[at].projection(), &all, missing));
    let mut plan = Some(planner.begin(FrameInput {
        views: &views,
        shared_eye: looks[0].eye,
        manifest: &scene.manifest,
        transforms: renderer.transforms(),
        resident: &|_| true,
        when_missing: WhenMissing::Box,
        has_changed: false,
    }));
    let (mut rounds, mut listed) = (0, 0);
    while let Some(round) = plan {
        if rounds == 0 {
            listed = round.passes.iter().map(|pass| pass.opaque.len() + (pass.blended.len() + pass.boxes.len()) as u32).sum();
        }
        rounds += 1;
        let results = renderer.draw(round).expect("drawn");
        plan = planner.feed(&results);
    }
    (rounds, listed)
}

/// Walks past the rooms and jumps now and then, while boxes move. Asserts that some frames took more than one round, and that leaves slept.
fn assert_same_past_rooms(scene: &Scene, missing: &VisibleSet) {
    let Some(gpu) = gpu() else { return };
    let targets = VIEWS.map(|view| ViewTarget { view, size_px: SIZE_PX });
    let [mut plain, mut culled] = [(); 2].map(|()| renderer_of(&gpu, scene, &targets));
    let (mut all, mut some) = (Planner::new(), Planner::new().culling(Occlusion::Hiz));
    let (mut again, mut slept, mut numbers) = (0, 0, Numbers(23));
    for frame in 0..120_u32 {
        for _ in 0..20 {
            let object = ObjectId(numbers.next() % scene.manifest.transforms.len() as u32);
            let moved = DAffine3::from_translation(numbers.vector(-0.2, 0.2)) * plain.transforms()[object.0 as usize].affine();
            [&mut plain, &mut culled].into_iter().for_each(|renderer| renderer.set_transform(object, moved.into()));
        }
        let eye = DVec3::new(f64::from(frame % 40) * 0.15 + f64::from(frame / 40) * 17.0, 0.3, 9.0);
        let looks = [-0.8, -1.1].map(|angle| {
            let turn = DQuat::from_rotation_y(angle);
            let corner = |x: f64, y: f64| eye + turn * DVec3::new(x, y, -1.0);
            Look { eye, corners: [corner(-0.9, -0.6), corner(0.8, -0.6), corner(-0.9, 0.5)], size_px: SIZE_PX }
        });
        draw(&mut all, &mut plain, scene, &looks, missing);
        let (rounds, listed) = draw(&mut some, &mut culled, scene, &looks, missing);
        again += u32::from(rounds > 1);
        slept += 2 * scene.all().len() - listed;
        for view in VIEWS {
            assert!(plain.read_leaves(view).expect("read") == culled.read_leaves(view).expect("read"), "frame {frame}: leaves");
            assert!(plain.read_color(view).expect("read") == culled.read_color(view).expect("read"), "frame {frame}: colours");
        }
    }
    println!("{again} frames with a further round, {} leaves asleep", slept / 240);
    assert!(again > 0 && slept > 0, "{again} frames with a further round, {slept} leaves asleep");
}

#[test]
fn no_pixel_changes_as_groups_fall_asleep_and_wake() {
    assert_same_past_rooms(&rooms(), &VisibleSet::default());
}

#[test]
fn what_wakes_comes_before_what_is_blended() {
    let mut scene = clutter(40);
    scene.join(&rooms());
    assert_same_past_rooms(&scene, &VisibleSet::default());
}

#[test]
fn what_wakes_comes_before_boxes_of_what_is_missing() {
    // A box of each corner of a room is missing: its own box stands for it, and coincides with it.
    let scene = rooms();
    let missing = VisibleSet::from_ranges((0..3000).step_by(16).map(|leaf| LeafRange::new(leaf, leaf + 1)));
    assert_same_past_rooms(&scene, &missing);
}
