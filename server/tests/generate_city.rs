//! Goal: the generated city is the city it claims to be. Method: count and compare on the file that a user gets.
use mullion_server::generate::{GeneratedScene, glb, write_glb};
use mullion_server::prepare::gltf::{SourceAlpha, SourceScene, load};

fn subtree_triangles(scene: &SourceScene, top: usize) -> usize {
    let mut open = vec![top as u32];
    let mut triangles = 0;
    while let Some(node) = open.pop() {
        let node = &scene.nodes[node as usize];
        open.extend(&node.children);
        let primitives = node.mesh.iter().flat_map(|mesh| &scene.meshes[*mesh as usize].primitives);
        triangles += primitives.map(|primitive| primitive.indices.len() / 3).sum::<usize>();
    }
    triangles
}

fn name(scene: &SourceScene, node: usize) -> &str {
    scene.nodes[node].name.as_deref().unwrap_or("")
}

#[test]
fn same_seed_same_bytes() {
    let (first, report) = glb(GeneratedScene::City, 7);
    assert_eq!(first, glb(GeneratedScene::City, 7).0);
    assert_ne!(first, glb(GeneratedScene::City, 8).0);
    assert_eq!(report.bytes, first.len() as u64);
}

#[test]
fn city_holds_what_it_promises() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("city.glb");
    for seed in [0, 1, 20240607] {
        let start = std::time::Instant::now();
        let report = write_glb(GeneratedScene::City, seed, &path).unwrap();
        println!("seed {seed}: {report:?}, written in {:?}", start.elapsed());
        let start = std::time::Instant::now();
        let scene = load(&path, &|_, _, _| {}).unwrap();
        println!("loaded in {:?}", start.elapsed());
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        assert_eq!(scene.nodes.len() as u64, report.nodes);
        assert_eq!(subtree_triangles(&scene, scene.roots[0] as usize) as u64, report.triangles);

        let buildings: Vec<usize> = (0..scene.nodes.len()).filter(|k| name(&scene, *k).starts_with("building ")).collect();
        assert_eq!(buildings.len(), 300);
        for building in buildings {
            let triangles = subtree_triangles(&scene, building);
            assert!((3486..=3556).contains(&triangles), "{}: {triangles}", name(&scene, building));
            let block = scene.nodes[building].parent.unwrap() as usize;
            assert!(name(&scene, block).starts_with("block "));
            let floor = scene.nodes[building].children[1] as usize;
            assert_eq!(name(&scene, floor), "floor 1");
            let room = scene.nodes[floor].children[0] as usize;
            assert_eq!(name(&scene, room), "room 1-1");
        }
        check_size_and_materials(&scene);
    }
}

fn check_size_and_materials(scene: &SourceScene) {
    let (mut low, mut high) = (glam::DVec3::INFINITY, glam::DVec3::NEG_INFINITY);
    let mut open: Vec<_> = scene.roots.iter().map(|root| (*root, glam::DAffine3::IDENTITY)).collect();
    while let Some((node, parent)) = open.pop() {
        let node = &scene.nodes[node as usize];
        let world = parent * node.parent_from_local;
        open.extend(node.children.iter().map(|child| (*child, world)));
        for primitive in node.mesh.iter().flat_map(|mesh| &scene.meshes[*mesh as usize].primitives) {
            for position in &primitive.positions {
                assert!(position.is_finite());
                let at = world.transform_point3(position.as_dvec3());
                (low, high) = (low.min(at), high.max(at));
            }
        }
    }
    println!("from {low} to {high}");
    assert!(low.y > -0.01 && high.y > 30.0 && high.y < 70.0);
    assert!(high.x - low.x > 400.0 && high.x - low.x < 760.0 && high.z - low.z > 400.0 && high.z - low.z < 600.0);
    for alpha in [|a| a == SourceAlpha::Opaque, |a| matches!(a, SourceAlpha::Mask { .. }), |a| a == SourceAlpha::Blend] {
        assert!(scene.materials.iter().any(|material| alpha(material.alpha)));
    }
    assert!(scene.images.len() >= 5);
}

#[test]
fn the_gltf_crate_reads_it_too() {
    let (bytes, report) = glb(GeneratedScene::City, 3);
    let (document, _, images) = gltf::import_slice(&bytes).unwrap();
    assert_eq!(document.nodes().len() as u64, report.nodes);
    assert_eq!(images.len(), 7);
}

#[test]
fn names_parse_and_unknown_ones_say_what_there_is() {
    for scene in GeneratedScene::ALL {
        assert_eq!(scene.name().parse::<GeneratedScene>().unwrap(), *scene);
    }
    let error = "vilage".parse::<GeneratedScene>().unwrap_err().to_string();
    assert!(error.contains("vilage") && error.contains("city"), "{error}");
}

#[test]
fn an_unwritable_place_is_named() {
    let error = write_glb(GeneratedScene::City, 0, std::path::Path::new("/nowhere/at/all.glb")).unwrap_err();
    assert!(error.to_string().contains("/nowhere/at/all.glb"), "{error}");
}
