//! Goal: the generated garbage has the objects and triangles that the paper counts, and lies in its can. Method: count
//! on the file that a user gets and on what preparation makes of it.
use glam::DVec3;
use mullion_server::generate::{GeneratedScene, glb, write_glb};
use mullion_server::prepare::gltf::{SourceScene, load};
use mullion_server::prepare::{PrepareOptions, prepare, statistics};

const OBJECTS: usize = 2500;
const TRIANGLES: u64 = 5_331_146;

fn loaded(seed: u64) -> SourceScene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("garbage.glb");
    let report = write_glb(GeneratedScene::Garbage, seed, &path).unwrap();
    println!("seed {seed}: {report:?}");
    assert_eq!((report.triangles, report.objects, report.nodes), (TRIANGLES, OBJECTS as u64, OBJECTS as u64 + 1));
    assert!(report.bytes <= 5_000_000, "{report:?}");
    let scene = load(&path, &|_, _, _| {}).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    scene
}

#[test]
fn objects_have_the_papers_triangles() {
    for seed in [0, 20061213] {
        let scene = loaded(seed);
        let root = &scene.nodes[scene.roots[0] as usize];
        assert_eq!((scene.roots.len(), root.children.len(), root.mesh), (1, OBJECTS, None));
        assert!((12..=40).contains(&scene.meshes.len()), "{}", scene.meshes.len());
        let triangles = |child: &u32| {
            let node = &scene.nodes[*child as usize];
            assert!(node.children.is_empty() && node.instances.is_empty());
            let primitives = &scene.meshes[node.mesh.unwrap() as usize].primitives;
            primitives.iter().map(|primitive| primitive.indices.len() / 3).sum::<usize>()
        };
        let counts: Vec<usize> = root.children.iter().map(triangles).collect();
        let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
        assert!(*least > 1700 && *most < 2700, "about 2100: {least} to {most}");
        assert_eq!(counts.iter().sum::<usize>() as u64, TRIANGLES);
    }
}

/// Nothing lies outside the can or hangs over its wall, and the heap rises above its rim.
#[test]
fn things_lie_in_the_can() {
    let scene = loaded(1);
    let children = &scene.nodes[scene.roots[0] as usize].children;
    let places: Vec<DVec3> = children[1..].iter().map(|id| scene.nodes[*id as usize].parent_from_local.translation).collect();
    for at in &places {
        assert!(at.x.hypot(at.z) < 0.52 && (0.0..1.3).contains(&at.y), "{at}");
    }
    let highest = places.iter().map(|at| at.y).fold(0.0, f64::max);
    assert!(highest > 1.1, "{highest}");
    // Things may touch and dent each other, but none is in another's place.
    let least = places
        .iter()
        .enumerate()
        .flat_map(|(k, a)| places[..k].iter().map(move |b| a.distance_squared(*b)))
        .fold(f64::INFINITY, f64::min);
    assert!(least.sqrt() > 0.015, "{}", least.sqrt());
}

#[test]
fn it_prepares_fast_since_meshes_are_shared() {
    let scene = loaded(1);
    let start = std::time::Instant::now();
    let prepared = prepare(scene, &PrepareOptions::default(), &|_, _, _| {}).unwrap();
    println!("prepared in {:?}", start.elapsed());
    assert!(prepared.warnings.is_empty(), "{:?}", prepared.warnings);
    let counts = statistics(&prepared.package);
    assert_eq!((counts.triangles_instanced, counts.leaves), (TRIANGLES, OBJECTS as u64));
    assert!(counts.triangles_unique < 100_000, "{}", counts.triangles_unique);
}

#[test]
fn same_seed_same_bytes() {
    let (first, report) = glb(GeneratedScene::Garbage, 7);
    assert_eq!(first, glb(GeneratedScene::Garbage, 7).0);
    assert_ne!(first, glb(GeneratedScene::Garbage, 8).0);
    assert_eq!(report.bytes, first.len() as u64);
}

#[test]
fn the_gltf_crate_reads_it_too() {
    let (bytes, report) = glb(GeneratedScene::Garbage, 3);
    let (document, _, _) = gltf::import_slice(&bytes).unwrap();
    assert_eq!(document.nodes().len() as u64, report.nodes);
}
