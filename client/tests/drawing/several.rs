//! Several views of one renderer, with occlusion culling, while chunks come and go, objects move, and the scene grows.
//! Method: each view is held against the same frame of a renderer that is made anew and draws all that is there.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use mullion_client::frame::{FrameInput, Planner, ViewInput};
use mullion_client::gpu::{Attachments, Gpu, Renderer, ViewTarget};
use mullion_client::missing::WhenMissing;
use mullion_client::occlusion::Occlusion;
use mullion_common::scene::{ChunkId, ObjectId};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::ViewId;

use crate::fixture::{Look, Numbers, Scene, clutter, coinciding_sheets, gpu, plain, rectangle};

/// Not as large as each other, and none is even.
const VIEWS: [(ViewId, [u32; 2]); 3] = [(ViewId(2), [61, 43]), (ViewId(3), [97, 31]), (ViewId(7), [33, 75])];

fn renderer(gpu: &Arc<Gpu>, scene: &Scene) -> Renderer {
    let views = VIEWS.map(|(view, size_px)| ViewTarget { view, size_px });
    let manifest = Arc::new(scene.manifest.clone());
    Renderer::new(Arc::clone(gpu), manifest, &views, Attachments::ColorAndIds).expect("a renderer")
}

/// Draws a frame of all views, to its end. Gives how many leaves that took.
fn draw(renderer: &mut Renderer, planner: &mut Planner, scene: &Scene, looks: &[Look; 3], sets: &[VisibleSet; 3]) -> u32 {
    let none = VisibleSet::default();
    let views: Vec<ViewInput<'_>> = (VIEWS.iter().zip(looks).zip(sets))
        .map(|(((view, _), look), visible)| ViewInput::new(*view, look.projection(), visible, &none))
        .collect();
    let mut plan = planner
        .begin(FrameInput {
            views: &views,
            shared_eye: looks[0].eye,
            manifest: &scene.manifest,
            transforms: renderer.transforms(),
            resident: &|chunk| renderer.is_resident(chunk),
            when_missing: WhenMissing::Nothing,
            has_changed: true,
        })
        .clone();
    let mut leaves = 0;
    loop {
        let results = renderer.draw(&plan).expect("drawn");
        leaves += results.passes.iter().map(|pass| pass.leaves).sum::<u32>();
        match planner.feed(&results) {
            Some(next) => plan = next.clone(),
            None => return leaves,
        }
    }
}

/// A lattice of walls with clutter between them.
fn rooms(seed: f64) -> Scene {
    let mut scene = clutter(150);
    let wall = scene.mesh(&rectangle([-20.0, -20.0], [20.0, 20.0]));
    let paint = scene.material(plain([0.7, 0.6, seed as f32, 1.0]));
    for k in -2..=2 {
        for turn in [DQuat::IDENTITY, DQuat::from_rotation_y(1.57), DQuat::from_rotation_x(1.57)] {
            let place = turn * DVec3::new(0.0, 0.0, f64::from(k) * 7.0 + seed);
            let object = scene.object(DAffine3::from_rotation_translation(turn, place));
            scene.leaf(object, wall, paint);
        }
    }
    scene.join(&coinciding_sheets(10));
    scene
}

/// Thirty frames in one way.
fn assert_same_through_all(gpu: &Arc<Gpu>, mut planner: Planner, name: &str) {
    let mut scene = rooms(0.1);
    let mut culled = renderer(gpu, &scene);
    let mut numbers = Numbers(41);
    let (mut all, mut some) = (0, 0);
    for frame in 0..30_u32 {
        // Chunks come, a third of them goes again, and in the middle there is more of everything.
        if frame == 15 {
            scene.join(&rooms(0.4));
            culled.grow(Arc::new(scene.manifest.clone())).expect("grown");
        }
        for (number, bytes) in scene.chunks.iter().enumerate() {
            let chunk = ChunkId(number as u32);
            match numbers.next() % 6 {
                0 => culled.evict(chunk),
                _ => _ = culled.upload(chunk, bytes).expect("taken"),
            }
        }
        for _ in 0..10 {
            let object = ObjectId(numbers.next() % scene.manifest.transforms.len() as u32);
            let moved = DAffine3::from_translation(numbers.vector(-0.5, 0.5));
            let there = moved * culled.transforms()[object.0 as usize].affine();
            culled.set_transform(object, there.into());
        }
        let mut turn = DQuat::from_rotation_y(f64::from(frame) * 0.05);
        let looks = VIEWS.map(|(_, size_px)| {
            turn *= DQuat::from_rotation_y(0.9);
            let eye = DVec3::new(0.5, 0.7, 1.0 + 0.1 * f64::from(frame));
            let corner = |x: f64, y: f64| eye + turn * DVec3::new(x, y, -1.0);
            Look { eye, corners: [corner(-0.9, -0.6), corner(0.8, -0.6), corner(-0.9, 0.5)], size_px }
        });
        let sets = looks.each_ref().map(|look| if frame % 4 == 3 { scene.all() } else { scene.visible(&look.frustum()) });
        some += draw(&mut culled, &mut planner, &scene, &looks, &sets);

        let mut anew = renderer(gpu, &scene);
        for (number, bytes) in scene.chunks.iter().enumerate().filter(|(at, _)| culled.is_resident(ChunkId(*at as u32))) {
            anew.upload(ChunkId(number as u32), bytes).expect("taken");
        }
        for (number, transform) in culled.transforms().iter().enumerate() {
            anew.set_transform(ObjectId(number as u32), *transform);
        }
        all += draw(&mut anew, &mut Planner::new(), &scene, &looks, &sets);
        for (view, _) in VIEWS {
            let [a, b] = [&culled, &anew].map(|r| (r.read_color(view).expect("read"), r.read_leaves(view).expect("read")));
            assert!(a == b, "{name}, frame {frame}, view {}", view.0);
        }
    }
    assert!(some < all, "{name}: {some} of {all} leaves drawn");
}

#[test]
fn no_pixel_changes_while_everything_does() {
    let Some(gpu) = gpu() else { return };
    let ways = [Occlusion::Hiz, Occlusion::Query, Occlusion::Paper];
    ways.into_iter().for_each(|way| assert_same_through_all(&gpu, Planner::new().culling(way), way.name()));
}

#[test]
fn no_pixel_changes_while_culling_comes_and_goes() {
    let Some(gpu) = gpu() else { return };
    assert_same_through_all(&gpu, Planner::new().culling(Occlusion::Hiz).while_worth(), "while it is worth it");
}
