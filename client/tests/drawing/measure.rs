//! How long drawing takes. Run with `--release --run-ignored all --no-capture` and the name of the test.

use std::time::Instant;

use glam::{DAffine3, DVec3};
use mullion_client::frame::{FrameInput, Planner, ViewInput};
use mullion_common::scene::GeometryChunk;
use mullion_common::wall::ViewId;

use crate::fixture::{Look, Scene, asymmetric_box, gpu, plain, rectangle, renderer};

const SIZE_PX: [u32; 2] = [480, 270];
const FRAMES: u32 = 20;

/// 30 by 30 by 30 boxes, each an object of its own, of four meshes.
fn boxes() -> Scene {
    let mut scene = Scene::default();
    let meshes: Vec<_> = (1..=4)
        .map(|i| {
            let mut chunk = asymmetric_box();
            chunk.positions.iter_mut().for_each(|p| p[0] *= i as f32 / 4.0);
            scene.mesh(&chunk)
        })
        .collect();
    let materials = [[0.8, 0.3, 0.2, 1.0], [0.2, 0.5, 0.8, 1.0]].map(|color| scene.material(plain(color)));
    for i in 0..27_000u32 {
        let place = DVec3::new(f64::from(i % 30) - 15.0, f64::from(i / 30 % 30) - 15.0, -f64::from(i / 900)) * 4.0;
        let object = scene.object(DAffine3::from_translation(place));
        scene.leaf(object, meshes[i as usize % 4], materials[i as usize / 4 % 2]);
    }
    scene
}

/// A million triangles: 250 sheets of 4000.
fn sheets() -> Scene {
    let mut scene = Scene::default();
    let mut sheet = GeometryChunk::default();
    for i in 0..2000u16 {
        let [x, y] = [f32::from(i % 50) / 25.0 - 1.0, f32::from(i / 50) / 20.0 - 1.0];
        let quad = rectangle([x, y], [x + 0.04, y + 0.05]);
        sheet.positions.extend(quad.positions.iter().map(|p| [p[0], p[1], (p[0] * 9.0).sin() * 0.1]));
        sheet.vertex_ids.extend((0..4).map(|v| u32::from(i) * 4 + v));
        sheet.indices.extend(quad.indices.iter().map(|v| v + i * 4));
    }
    let mesh = scene.mesh(&sheet);
    let gray = scene.material(plain([0.6, 0.6, 0.6, 1.0]));
    for i in 0..250u32 {
        let object = scene.object(DAffine3::from_translation(DVec3::new(0.3, 0.2, -1.5 - 0.1 * f64::from(i))));
        scene.leaf(object, mesh, gray);
    }
    scene
}

#[test]
#[ignore = "a measurement"]
fn time_to_draw() {
    let Some(gpu) = gpu() else { return };
    println!("{}, {} by {} pixels, ms a frame", gpu.describe(), SIZE_PX[0], SIZE_PX[1]);
    for (name, scene) in [("27 000 boxes", boxes()), ("1 M triangles in 250 leaves", sheets())] {
        let started = Instant::now();
        let mut renderer = renderer(&gpu, &scene, SIZE_PX);
        let prepared_ms = started.elapsed().as_secs_f64() * 1e3;
        let (look, visible) = (Look::ahead(DVec3::new(0.4, 0.3, 2.0), SIZE_PX), scene.all());
        let views = [ViewInput { view: ViewId(4), projection: look.projection(), visible: &visible }];
        let mut planner = Planner::new();
        let (mut plan_ms, mut encode_ms, mut total_ms, mut results) = (0.0, 0.0, 0.0, None);
        for _ in 0..FRAMES {
            let started = Instant::now();
            let plan = planner.begin(FrameInput {
                views: &views,
                shared_eye: look.eye,
                manifest: &scene.manifest,
                transforms: renderer.transforms(),
                resident: &|chunk| renderer.is_resident(chunk),
            });
            let planned = started.elapsed();
            results = Some(renderer.draw(plan).expect("drawn"));
            let encoded = started.elapsed();
            renderer.wait().expect("done");
            plan_ms += planned.as_secs_f64() * 1e3 / f64::from(FRAMES);
            encode_ms += (encoded - planned).as_secs_f64() * 1e3 / f64::from(FRAMES);
            total_ms += started.elapsed().as_secs_f64() * 1e3 / f64::from(FRAMES);
        }
        println!(
            "{name}: made ready in {prepared_ms:.1} ms; plan {plan_ms:.2}, encode {encode_ms:.2}, in all {total_ms:.2}; {results:?}"
        );
    }
}
