//! Groups of leaves that stay hidden are asked for as one, and no pixel changes: not where they come out, nor before things that are blended.

use glam::{DAffine3, DQuat, DVec3};
use mullion_client::frame::{FrameInput, Planner, ViewInput};
use mullion_client::gpu::Renderer;
use mullion_client::missing::WhenMissing;
use mullion_client::occlusion::Occlusion;
use mullion_common::scene::Material;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::ViewId;

use crate::fixture::{Look, Numbers, Scene, asymmetric_box, clutter, gpu, plain, rectangle, renderer};

const SIZE_PX: [u32; 2] = [143, 91];

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
            for _ in 0..16 {
                let place = DAffine3::from_scale_rotation_translation(
                    numbers.vector(0.02, 0.2),
                    DQuat::from_scaled_axis(numbers.vector(-2.0, 2.0)),
                    around + numbers.vector(-0.4, 0.4),
                );
                let shade = [0.2 + 0.04 * room as f32, 0.1 * corner as f32, 0.5, 1.0];
                let (object, material) = (scene.object(place), scene.material(plain(shade)));
                scene.leaf(object, mesh, material);
            }
        }
    }
    scene
}

/// Draws a frame. How many rounds that took, and how many leaves were listed in the first.
fn draw(planner: &mut Planner, renderer: &mut Renderer, scene: &Scene, look: &Look) -> (u32, u32) {
    let (all, none) = (scene.all(), VisibleSet::default());
    let views = [ViewInput::new(ViewId(4), look.projection(), &all, &none)];
    let mut plan = Some(planner.begin(FrameInput {
        views: &views,
        shared_eye: look.eye,
        manifest: &scene.manifest,
        transforms: renderer.transforms(),
        resident: &|_| true,
        when_missing: WhenMissing::Hold,
        has_changed: false,
    }));
    let (mut rounds, mut listed) = (0, 0);
    while let Some(round) = plan {
        let pass = &round.passes[0];
        if rounds == 0 {
            listed = pass.opaque.len() + pass.blended.len() as u32;
        }
        rounds += 1;
        let results = renderer.draw(round).expect("drawn");
        plan = planner.feed(&results);
    }
    (rounds, listed)
}

/// Walks past the rooms and jumps now and then. How many frames took more than one round, and how many leaves slept.
fn assert_same_past_rooms(scene: &Scene) -> (u32, u32) {
    let Some(gpu) = gpu() else { return (1, 1) };
    let [mut plain, mut culled] = [(); 2].map(|()| renderer(&gpu, scene, SIZE_PX));
    let (mut all, mut some) = (Planner::new(), Planner::new().culling(Occlusion::Hiz));
    let (mut again, mut slept) = (0, 0);
    for frame in 0..120_u32 {
        let eye = DVec3::new(f64::from(frame % 40) * 0.15 + f64::from(frame / 40) * 17.0, 0.3, 9.0);
        let turn = DQuat::from_rotation_y(-0.8);
        let corner = |x: f64, y: f64| eye + turn * DVec3::new(x, y, -1.0);
        let look = Look { eye, corners: [corner(-0.9, -0.6), corner(0.8, -0.6), corner(-0.9, 0.5)], size_px: SIZE_PX };
        draw(&mut all, &mut plain, scene, &look);
        let (rounds, listed) = draw(&mut some, &mut culled, scene, &look);
        again += u32::from(rounds > 1);
        slept += scene.all().len() - listed;
        let view = ViewId(4);
        assert!(plain.read_leaves(view).expect("read") == culled.read_leaves(view).expect("read"), "frame {frame}: leaves");
        assert!(plain.read_color(view).expect("read") == culled.read_color(view).expect("read"), "frame {frame}: colours");
    }
    println!("{again} frames with a further round, {} leaves asleep", slept / 120);
    (again, slept / 120)
}

#[test]
fn no_pixel_changes_as_groups_fall_asleep_and_wake() {
    let scene = rooms();
    let (again, slept) = assert_same_past_rooms(&scene);
    assert!(again > 0 && slept > 0, "{again} frames with a further round, {slept} leaves asleep");
}

#[test]
fn what_wakes_comes_before_what_is_blended() {
    let mut scene = clutter(40);
    scene.join(&rooms());
    let (again, slept) = assert_same_past_rooms(&scene);
    assert!(again > 0 && slept > 0, "{again} frames with a further round, {slept} leaves asleep");
}
