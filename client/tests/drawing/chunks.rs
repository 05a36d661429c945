//! What becomes of chunks: taken, refused, evicted, missing.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use mullion_client::frame::{FramePlan, PassPlan};
use mullion_client::gpu::{Attachments, GpuError, Renderer, UploadError, ViewTarget};
use mullion_common::scene::{ChunkId, GeometryChunk, Material};
use mullion_common::wall::ViewId;

use crate::fixture::{Look, Scene, asymmetric_box, clutter, draw, gpu, pattern, plain, rectangle, renderer};

#[test]
fn garbage_is_refused_and_nothing_is_drawn_of_it() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let object = scene.object(DAffine3::from_translation(DVec3::new(0.0, 0.0, -2.0)));
    let mesh = scene.mesh(&rectangle([-1.0, -0.5], [1.0, 0.7]));
    let red = scene.material(plain([1.0, 0.0, 0.0, 1.0]));
    scene.leaf(object, mesh, red);
    let good = std::mem::take(&mut scene.chunks[0]);
    let mut renderer = renderer(&gpu, &scene, [40, 30]);

    let mut not_a_number = rectangle([-1.0, -0.5], [1.0, 0.7]);
    not_a_number.positions[2][1] = f32::NAN;
    assert_eq!(renderer.upload(mesh, &not_a_number.encode()), Err(UploadError::NotFinite { vertex: 2 }));
    for bytes in [b"".as_slice(), b"MLC1", &[0xff; 200], &good[..good.len() - 1]] {
        assert!(matches!(renderer.upload(mesh, bytes), Err(UploadError::Geometry(_))));
    }
    assert_eq!(renderer.upload(ChunkId(1), &good), Err(UploadError::Unknown(1)));
    assert!(!renderer.is_resident(mesh) && !renderer.is_resident(ChunkId(9)));
    let look = Look::ahead(DVec3::ZERO, [40, 30]);
    let picture = draw(&mut renderer, &scene, &look, &scene.all());
    assert_eq!((picture.plan.passes[0].missing, picture.ids.iter().max()), (1, Some(&0)));

    assert_eq!(renderer.upload(mesh, &good), Ok(4 * 24 + 6 * 2));
    let picture = draw(&mut renderer, &scene, &look, &scene.all());
    assert_eq!((picture.plan.passes[0].missing, picture.ids.iter().max()), (0, Some(&1)));
}

#[test]
fn evicted_chunks_come_back_as_they_were() {
    let Some(gpu) = gpu() else { return };
    let mut scene = clutter(120);
    let object = scene.object(DAffine3::IDENTITY);
    // Geometry of several sizes, so that what is freed is used again by others.
    let extra = [3usize, 40, 700].map(|triangles| {
        let quad = rectangle([-1.0, -0.5], [1.0, 0.7]);
        scene.mesh(&GeometryChunk { indices: quad.indices.iter().copied().cycle().take(triangles * 3).collect(), ..quad })
    });
    let gray = scene.material(plain([0.5, 0.5, 0.5, 1.0]));
    let textured = scene.texture(pattern(32));
    let other = scene.material(Material { texture: Some(textured), ..plain([1.0; 4]) });
    for (chunk, material) in extra.iter().zip([gray, other, gray]) {
        scene.leaf(object, *chunk, material);
    }
    let look = Look::ahead(DVec3::new(0.5, 0.3, 14.0), [120, 90]);
    let mut renderer = renderer(&gpu, &scene, look.size_px);
    let before = draw(&mut renderer, &scene, &look, &scene.all());
    for order in [[0, 1, 2, 3, 4, 5], [5, 2, 4, 1, 0, 3]] {
        for chunk in order {
            renderer.evict(ChunkId(chunk));
            assert!(!renderer.is_resident(ChunkId(chunk)));
        }
        let empty = draw(&mut renderer, &scene, &look, &scene.all());
        assert_eq!(empty.ids.iter().max(), Some(&0));
        for &chunk in order.iter().rev() {
            renderer.upload(ChunkId(chunk), &scene.chunks[chunk as usize]).expect("taken");
        }
        let after = draw(&mut renderer, &scene, &look, &scene.all());
        assert!(before.color == after.color && before.ids == after.ids);
    }
}

#[test]
fn empty_and_degenerate_geometry_is_harmless() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let object = scene.object(DAffine3::from_translation(DVec3::new(0.0, 0.0, -3.0)));
    let flat = scene.object(DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)));
    let red = scene.material(plain([1.0, 0.0, 0.0, 1.0]));
    let line = GeometryChunk { positions: vec![[0.0; 3], [1.0; 3], [2.0; 3]], vertex_ids: vec![0, 1, 2], ..Default::default() };
    let meshes = [
        scene.mesh(&GeometryChunk { indices: vec![0, 1, 2, 1, 1, 1], ..line.clone() }),
        scene.mesh(&line), // vertices without triangles
        scene.mesh(&asymmetric_box()),
    ];
    for mesh in meshes {
        scene.leaf(object, mesh, red);
    }
    scene.leaf(flat, meshes[2], red);
    let nothing = scene.mesh(&GeometryChunk::default());
    let mut renderer = renderer(&gpu, &scene, [40, 30]);
    assert_eq!(renderer.upload(nothing, &scene.chunks[nothing.0 as usize]), Ok(0));
    assert!(renderer.is_resident(nothing));
    let picture = draw(&mut renderer, &scene, &Look::ahead(DVec3::new(0.2, 0.7, 1.0), [40, 30]), &scene.all());
    assert!(picture.ids.contains(&1) && picture.ids.contains(&2), "the box, and the box pressed flat");

    let empty = Scene::default();
    let mut renderer = super::fixture::renderer(&gpu, &empty, [1, 1]);
    let picture = draw(&mut renderer, &empty, &Look::ahead(DVec3::ZERO, [1, 1]), &empty.all());
    assert_eq!(picture.ids, [0]);
}

#[test]
fn faults_are_errors() {
    let Some(gpu) = gpu() else { return };
    let scene = clutter(5);
    let open = |size_px| {
        let views = [ViewTarget { view: ViewId(4), size_px }];
        Renderer::new(Arc::clone(&gpu), Arc::new(scene.manifest.clone()), &views, Attachments::Color)
    };
    for size_px in [[0, 10], [10, u32::MAX]] {
        assert!(matches!(open(size_px), Err(GpuError::Limit { .. })));
    }
    let mut renderer = open([10, 8]).expect("a renderer");
    let projection = Look::ahead(DVec3::ZERO, [10, 8]).projection();
    let pass = PassPlan { opaque: scene.all(), ..PassPlan::new(ViewId(5), projection) };
    let plan = FramePlan { passes: vec![pass.clone()] };
    assert_eq!(renderer.draw(&plan), Err(GpuError::UnknownView(5)));
    // Leaves past the table, or not resident, are skipped.
    let pass = PassPlan { view: ViewId(4), blended: vec![3, 4000], ..pass };
    let results = renderer.draw(&FramePlan { passes: vec![pass] }).expect("drawn");
    assert_eq!(results.passes[0].leaves, 0);
    assert_eq!(renderer.read_ids(ViewId(4)), Err(GpuError::NoIds));
    assert!(renderer.read_color(ViewId(5)).is_err());

    assert!(renderer.read_shown(ViewId(4)).expect("read").is_none());
    let shown = renderer.show().expect("shown");
    assert_eq!((shown.len(), shown[0].view, shown[0].size_px), (1, ViewId(4), [10, 8]));
    renderer.wait().expect("done");
    assert_eq!(renderer.read_shown(ViewId(4)).expect("read"), Some(renderer.read_color(ViewId(4)).expect("read")));
}
