//! Leaves of which some triangles are drawn. Method: the picture is held against that of a scene whose chunks have those triangles alone.

use mullion_client::frame::{FramePlan, PassPlan};
use mullion_client::occlusion::BoxTest;
use mullion_client::parts::Parts;
use mullion_common::scene::{ChunkId, GeometryChunk};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::ViewId;
use std::sync::Arc;

use crate::fixture::{Look, Numbers, Scene, clutter, gpu, renderer};
use mullion_client::gpu::{Attachments, Gpu, Renderer, ViewTarget};

const SIZE_PX: [u32; 2] = [97, 75];
const LEAVES: u32 = 150;

/// Some triangles of most leaves that are not blended; every fifth leaf stays whole, and of some nothing is drawn.
fn parts(scene: &Scene) -> (VisibleSet, Parts) {
    let mut numbers = Numbers(11);
    let (mut opaque, mut parts) = (VisibleSet::default(), Parts::default());
    for leaf in (0..LEAVES).filter(|leaf| leaf % 5 != 3) {
        opaque.push(LeafRange::new(leaf, leaf + 1));
        if !numbers.next().is_multiple_of(5) {
            let keep = numbers.next() % 4;
            let count = scene.manifest.leaves[leaf as usize].triangle_count as u16;
            parts.push(leaf, (0..count).filter(|_| numbers.next() % 3 < keep));
        }
    }
    (opaque, parts)
}

/// The same scene, with a chunk for each leaf that has the triangles that are drawn.
fn thinned(scene: &Scene, parts: &Parts) -> Scene {
    let mut thin = Scene::default();
    thin.join(scene);
    for leaf in 0..LEAVES {
        let mut chunk =
            GeometryChunk::decode(&scene.chunks[scene.manifest.leaves[leaf as usize].chunk.0 as usize]).expect("a chunk");
        if let Some(numbers) = parts.of(leaf) {
            let triangles = numbers.iter().flat_map(|number| chunk.indices[usize::from(*number) * 3..][..3].to_vec());
            chunk.indices = triangles.collect();
        }
        let own = thin.mesh(&chunk);
        let record = &mut thin.manifest.leaves[leaf as usize];
        (record.chunk, record.triangle_count) = (own, chunk.indices.len() as u32 / 3);
    }
    thin
}

fn keeping_indices(gpu: &Arc<Gpu>, scene: &Scene) -> Renderer {
    let views = [ViewTarget { view: ViewId(4), size_px: SIZE_PX }];
    let manifest = Arc::new(scene.manifest.clone());
    let mut renderer = Renderer::new(Arc::clone(gpu), manifest, &views, Attachments::ColorAndIds).expect("a renderer");
    renderer.keep_indices();
    for (chunk, bytes) in (0..).map(ChunkId).zip(&scene.chunks) {
        renderer.upload(chunk, bytes).expect("taken");
    }
    renderer
}

#[test]
fn a_part_is_drawn_as_if_the_leaf_had_no_more() {
    let Some(gpu) = gpu() else { return };
    let scene = clutter(LEAVES);
    let (opaque, parts) = parts(&scene);
    let thin = thinned(&scene, &parts);
    let look = Look::ahead(glam::DVec3::new(0.5, 0.2, 3.0), SIZE_PX);
    let blended: Vec<u32> = (0..LEAVES).filter(|leaf| leaf % 5 == 3).collect();
    let whole = PassPlan { opaque: opaque.clone(), blended, ..PassPlan::new(ViewId(4), look.projection()) };
    let first = VisibleSet::from_ranges(opaque.leaves().filter(|leaf| leaf % 3 == 0).map(|leaf| LeafRange::new(leaf, leaf + 1)));
    let mut of_thin = renderer(&gpu, &thin, SIZE_PX);
    let mut of_parts = keeping_indices(&gpu, &scene);
    for first in [None, Some(first)] {
        let (in_turns, test) = (first.is_some(), BoxTest::Sifted);
        if in_turns && !of_thin.can_cull() {
            println!("skipped: the GPU cannot cull");
            continue;
        }
        let plain = PassPlan { first, test, ..whole.clone() };
        let expected = of_thin.draw(&FramePlan { passes: vec![plain.clone()] }).expect("drawn");
        let part = PassPlan { parts: parts.clone(), ..plain };
        let found = of_parts.draw(&FramePlan { passes: vec![part] }).expect("drawn");
        let read =
            |renderer: &Renderer| (renderer.read_color(ViewId(4)).expect("read"), renderer.read_ids(ViewId(4)).expect("read"));
        assert!(read(&of_thin) == read(&of_parts), "in turns: {in_turns}");
        assert!(read(&of_parts).1.iter().filter(|id| **id != 0).count() > 1000, "there is something to see");
        if !in_turns {
            assert_eq!(found.passes[0].triangles, expected.passes[0].triangles);
        }
    }
}
