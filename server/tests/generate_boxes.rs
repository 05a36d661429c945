//! Goal: as many boxes as were asked for, the same ones flat and as a tree, and a tree that is a good one. Method: place
//! every box as our importer reads it, and compare.
use glam::{DAffine3, DVec3};
use mullion_server::generate::{Boxes, BoxesShape, GeneratedScene, MAX_BOXES, glb, write_glb};
use mullion_server::prepare::gltf::{SourceScene, load};
use mullion_server::prepare::{PrepareOptions, prepare, statistics};

fn scene(leaves: u64, shape: BoxesShape) -> GeneratedScene {
    GeneratedScene::Boxes(Boxes::new(leaves, shape).unwrap())
}

fn loaded(leaves: u64, shape: BoxesShape, seed: u64) -> SourceScene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("boxes.glb");
    let report = write_glb(scene(leaves, shape), seed, &path).unwrap();
    assert_eq!((report.objects, report.triangles), (leaves, 12 * leaves));
    assert_eq!(report.bytes, path.metadata().unwrap().len());
    let scene = load(&path, &|_, _, _| {}).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_eq!(scene.nodes.len() as u64, report.nodes);
    scene
}

/// `world_from_box` of every box, in an order of its own.
fn places(scene: &SourceScene) -> Vec<[f64; 12]> {
    let identity = |at: DAffine3| at == DAffine3::IDENTITY;
    assert!(scene.nodes.iter().all(|node| identity(node.parent_from_local)), "groups have no places of their own");
    let mut places: Vec<_> = scene.nodes.iter().flat_map(|n| &n.instances).map(DAffine3::to_cols_array).collect();
    places.sort_by(|a, b| a.partial_cmp(b).unwrap());
    places
}

#[test]
fn flat_and_tree_hold_the_same_boxes() {
    for leaves in [1, 8, 9, 17, 3001] {
        let (flat, tree) = (loaded(leaves, BoxesShape::Flat, 5), loaded(leaves, BoxesShape::Tree, 5));
        assert_eq!(flat.nodes.len(), 1);
        let places_flat = places(&flat);
        assert_eq!(places_flat.len() as u64, leaves);
        assert_eq!(places_flat, places(&tree));
    }
}

#[test]
fn the_tree_is_full_and_its_groups_are_compact() {
    let tree = loaded(40_000, BoxesShape::Tree, 1);
    let nodes_of_instances = tree.nodes.iter().filter(|node| !node.instances.is_empty());
    assert_eq!(nodes_of_instances.clone().count(), 40_000 / 8, "all are full");
    assert!(tree.nodes.iter().all(|node| node.children.len() <= 8 && node.instances.len() <= 8));
    let span = |boxes: &[DAffine3]| {
        let (low, high) = boxes
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), b| (low.min(b.translation), high.max(b.translation)));
        (high - low).length()
    };
    let mut spans: Vec<f64> = nodes_of_instances.map(|node| span(&node.instances)).collect();
    spans.sort_by(f64::total_cmp);
    let median_m = spans[spans.len() / 2];
    assert!(median_m < 16.0, "eight neighbours lie {median_m} m apart, in a world of 630 m");
}

#[test]
fn every_box_is_one_leaf_and_density_stays() {
    let mut areas_km2 = Vec::new();
    for leaves in [4_000, 40_000] {
        let package = prepare(loaded(leaves, BoxesShape::Flat, 2), &PrepareOptions::default(), &|_, _, _| {}).unwrap().package;
        let counts = statistics(&package);
        assert_eq!((counts.leaves as u64, counts.geometry_chunks), (leaves, 1));
        let [min, max] = counts.bounds_m.unwrap().map(DVec3::from);
        assert!(max.y - min.y < 140.0, "{min} to {max}");
        areas_km2.push((max.x - min.x) * (max.z - min.z) / 1e6);
    }
    assert!(areas_km2[1] > 4.0 * areas_km2[0], "{areas_km2:?}");
}

#[test]
fn sizes_span_three_decades_and_no_two_axes_are_alike() {
    let flat = loaded(20_000, BoxesShape::Flat, 3);
    let longest: Vec<f64> = flat.nodes[0].instances.iter().map(|i| i.matrix3.z_axis.length()).collect();
    let (low, high) = longest.iter().fold((f64::INFINITY, 0f64), |(low, high), m| (low.min(*m), high.max(*m)));
    assert!(low < 0.035 && high > 25.0 && high < 31.0, "{low} to {high}");
    for instance in &flat.nodes[0].instances {
        let upright = instance.matrix3.y_axis.normalize().abs().max_element();
        assert!((0.57..=1.0 + 1e-9).contains(&upright));
    }
    let turned = flat.nodes[0].instances.iter().filter(|i| i.matrix3.y_axis.normalize().abs().max_element() < 0.99).count();
    assert!(turned > 19_000, "nearly all are turned: {turned}");
}

#[test]
fn same_seed_same_bytes() {
    for shape in [BoxesShape::Flat, BoxesShape::Tree] {
        let (first, report) = glb(scene(1000, shape), 7);
        assert_eq!(first, glb(scene(1000, shape), 7).0);
        assert_ne!(first, glb(scene(1000, shape), 8).0);
        assert_eq!(report.bytes, first.len() as u64);
    }
}

#[test]
fn the_gltf_crate_reads_it_too() {
    let (bytes, report) = glb(scene(1000, BoxesShape::Tree), 3);
    let document = gltf::Gltf::from_slice(&bytes).unwrap().document;
    assert_eq!(document.nodes().len() as u64, report.nodes);
    assert!(document.extensions_used().eq(["EXT_mesh_gpu_instancing"]));
}

#[test]
fn numbers_and_shapes_that_cannot_be() {
    for leaves in [0, u64::from(MAX_BOXES) + 1, u64::MAX] {
        let error = Boxes::new(leaves, BoxesShape::Flat).unwrap_err().to_string();
        assert_eq!(error, format!("{leaves} leaves, allowed are 1 to 10000000"));
    }
    assert!(Boxes::new(MAX_BOXES.into(), BoxesShape::Flat).is_ok());
    for shape in [BoxesShape::Flat, BoxesShape::Tree] {
        assert_eq!(shape.to_string().parse::<BoxesShape>().unwrap(), shape);
    }
    let error = "grid".parse::<BoxesShape>().unwrap_err().to_string();
    assert!(error.contains("grid") && error.contains("flat, tree"), "{error}");
}
