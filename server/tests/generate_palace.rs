//! Goal: the generated palace has the node tree and the triangles of the paper's Fatehpur Sikri. Method: count on the
//! file that a user gets, and on the object hierarchy that preparation makes of it.
use mullion_server::generate::{GeneratedScene, glb, write_glb};
use mullion_server::prepare::gltf::{SourceScene, load};
use mullion_server::prepare::{PrepareOptions, prepare, statistics};

fn loaded(seed: u64) -> SourceScene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("palace.glb");
    let report = write_glb(GeneratedScene::Palace, seed, &path).unwrap();
    println!("seed {seed}: {report:?}");
    assert!((1_550_000..=1_650_000).contains(&report.triangles), "{report:?}");
    assert!(report.bytes <= 40_000_000, "{report:?}");
    let scene = load(&path, &|_, _, _| {}).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    scene
}

#[test]
fn the_tree_is_the_papers() {
    for seed in [0, 1, 20061213] {
        let scene = loaded(seed);
        let (leaves, groups): (Vec<_>, Vec<_>) = scene.nodes.iter().partition(|node| node.mesh.is_some());
        assert_eq!((groups.len(), leaves.len()), (288, 482));
        assert!(leaves.iter().all(|node| node.children.is_empty() && node.instances.is_empty()));
        assert!(groups.iter().all(|node| !node.children.is_empty()));
        for mesh in leaves.iter().map(|node| &scene.meshes[node.mesh.unwrap() as usize]) {
            assert_eq!(mesh.primitives.len(), 1);
            let triangles = mesh.primitives[0].indices.len() / 3;
            assert!((2000..=4096).contains(&triangles), "mesh {}: {triangles}", mesh.gltf_mesh);
        }
    }
}

#[test]
fn the_prepared_scene_has_that_tree() {
    let package = prepare(loaded(1), &PrepareOptions::default(), &|_, _, _| {}).unwrap().package;
    let counts = statistics(&package);
    assert_eq!((counts.file_nodes, counts.file_inner_nodes, counts.leaves), (770, 288, 482));
    assert!((counts.file_branching - 769.0 / 288.0).abs() < 1e-6, "{}", counts.file_branching);
}

/// No node mirrors: what faces outwards in a mesh does so in the world.
#[test]
fn nothing_is_mirrored() {
    let scene = loaded(1);
    assert!(scene.nodes.iter().all(|node| node.parent_from_local.matrix3.determinant() > 0.0));
}

#[test]
fn same_seed_same_bytes() {
    let (first, report) = glb(GeneratedScene::Palace, 7);
    assert_eq!(first, glb(GeneratedScene::Palace, 7).0);
    assert_ne!(first, glb(GeneratedScene::Palace, 8).0);
    assert_eq!(report.bytes, first.len() as u64);
}

#[test]
fn the_gltf_crate_reads_it_too() {
    let (bytes, report) = glb(GeneratedScene::Palace, 3);
    let (document, _, _) = gltf::import_slice(&bytes).unwrap();
    assert_eq!(document.nodes().len() as u64, report.nodes);
}
