//! Goal: the generated forest has the triangles that the paper counts. Method: count on the file that a user gets and on
//! what preparation makes of it.
use glam::{DAffine3, DVec3};
use mullion_server::generate::{GeneratedScene, glb, write_glb};
use mullion_server::prepare::gltf::{SourceScene, load};
use mullion_server::prepare::{PrepareOptions, prepare, statistics};

fn loaded(seed: u64) -> SourceScene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("forest.glb");
    let report = write_glb(GeneratedScene::Forest, seed, &path).unwrap();
    println!("seed {seed}: {report:?}");
    assert_eq!(report.triangles, 452_981);
    assert!(report.bytes <= 25_000_000, "{report:?}");
    let scene = load(&path, &|_, _, _| {}).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    scene
}

struct Part {
    triangles: usize,
    low: DVec3,
    high: DVec3,
}

/// What a node amounts to with all below it.
fn part(scene: &SourceScene, top: u32) -> Part {
    let mut part = Part { triangles: 0, low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };
    let mut open = vec![(top, DAffine3::IDENTITY)];
    while let Some((id, parent)) = open.pop() {
        let node = &scene.nodes[id as usize];
        let world = parent * node.parent_from_local;
        assert!(world.matrix3.determinant() > 0.0);
        open.extend(node.children.iter().map(|child| (*child, world)));
        for primitive in node.mesh.iter().flat_map(|mesh| &scene.meshes[*mesh as usize].primitives) {
            part.triangles += primitive.indices.len() / 3;
            for position in &primitive.positions {
                assert!(position.is_finite());
                let at = world.transform_point3(position.as_dvec3());
                (part.low, part.high) = (part.low.min(at), part.high.max(at));
            }
        }
    }
    part
}

#[test]
fn trees_and_castle_have_the_papers_triangles() {
    for seed in [0, 1, 20061213] {
        let scene = loaded(seed);
        let children = &scene.nodes[scene.roots[0] as usize].children;
        assert_eq!((scene.roots.len(), children.len()), (1, 13));
        let parts: Vec<Part> = children.iter().map(|child| part(&scene, *child)).collect();
        for tree in &parts[..12] {
            assert_eq!(tree.triangles, 28_500);
            let size = tree.high - tree.low;
            assert!((9.0..20.0).contains(&size.y) && size.x < 20.0 && size.z < 20.0, "{size}");
            assert!(tree.low.z > 30.0, "it stands before the castle: {}", tree.low);
        }
        let castle = &parts[12];
        assert_eq!(castle.triangles, 110_981);
        assert!((23.0..26.0).contains(&castle.high.y), "{}", castle.high);
    }
}

/// No two trees are alike, and no leaf needs a mask or blending.
#[test]
fn trees_differ_and_leaves_are_opaque() {
    let scene = loaded(1);
    let children = &scene.nodes[scene.roots[0] as usize].children;
    let heights: Vec<u64> = children[..12].iter().map(|child| part(&scene, *child).high.y.to_bits()).collect();
    for (k, height) in heights.iter().enumerate() {
        assert!(!heights[..k].contains(height));
    }
    let opaque = mullion_server::prepare::gltf::SourceAlpha::Opaque;
    assert!(scene.materials.iter().all(|material| material.alpha == opaque));
}

#[test]
fn it_prepares_without_trouble() {
    let prepared = prepare(loaded(1), &PrepareOptions::default(), &|_, _, _| {}).unwrap();
    assert!(prepared.warnings.is_empty(), "{:?}", prepared.warnings);
    assert_eq!(statistics(&prepared.package).triangles_instanced, 452_981);
}

#[test]
fn same_seed_same_bytes() {
    let (first, report) = glb(GeneratedScene::Forest, 7);
    assert_eq!(first, glb(GeneratedScene::Forest, 7).0);
    assert_ne!(first, glb(GeneratedScene::Forest, 8).0);
    assert_eq!(report.bytes, first.len() as u64);
}

#[test]
fn the_gltf_crate_reads_it_too() {
    let (bytes, report) = glb(GeneratedScene::Forest, 3);
    let (document, _, _) = gltf::import_slice(&bytes).unwrap();
    assert_eq!(document.nodes().len() as u64, report.nodes);
}
