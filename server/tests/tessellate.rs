//! Goal: whatever a scene holds, it is tessellated without a panic, and every triangle is in a cell; and that survives the way through a
//! package. Method: degenerate scenes, a generated one, and its bytes.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use mullion_common::scene::{CellId, Package, SectionKind, Tessellation};
use mullion_server::generate::{GeneratedScene, Random, write_glb};
use mullion_server::prepare::gltf::{SourceMesh, SourceNode, SourcePrimitive, SourceScene};
use mullion_server::prepare::plp::{TessellateError, TessellateOptions, TessellationStatistics, tessellate};
use mullion_server::prepare::{PrepareOptions, open, prepare};

/// A scene of one mesh of these triangles, moved far out or not.
fn package(triangles: &[[Vec3; 3]], at: DVec3) -> Package {
    let positions: Vec<Vec3> = triangles.as_flattened().to_vec();
    let indices = (0..positions.len() as u32).collect();
    let primitive =
        SourcePrimitive { gltf_primitive: 0, positions, normals: None, uvs: None, colors: None, indices, material: None };
    let meshes = if triangles.is_empty() {
        Vec::new()
    } else {
        vec![SourceMesh { name: None, gltf_mesh: 0, primitives: vec![primitive] }]
    };
    let node = SourceNode {
        name: None,
        parent: None,
        children: Vec::new(),
        parent_from_local: DAffine3::from_translation(at),
        mesh: (!triangles.is_empty()).then_some(0),
        instances: Vec::new(),
    };
    let scene = SourceScene {
        nodes: vec![node],
        roots: vec![0],
        meshes,
        materials: Vec::new(),
        images: Vec::new(),
        warnings: Vec::new(),
    };
    let options = PrepareOptions { max_leaf_triangles: 50, ..PrepareOptions::default() };
    prepare(scene, &options, &|_, _, _| {}).expect("it is a scene").package
}

fn tessellated(package: &Package) -> Tessellation {
    tessellate(package, &TessellateOptions::default(), &|_, _, _| {}).expect("it can be tessellated")
}

/// Every slot is named by a cell.
fn assert_complete(tessellation: &Tessellation) {
    let mut named = vec![false; tessellation.slot_count() as usize];
    for cell in 0..tessellation.cells().len() as u32 {
        for (place, rows) in tessellation.runs(CellId(cell)) {
            let first = tessellation.slots(place).start;
            rows.flatten().for_each(|number| named[(first + u32::from(number)) as usize] = true);
        }
    }
    assert!(named.iter().all(|named| *named));
}

#[test]
fn degenerate_scenes_are_tessellated() {
    let mut random = Random::new(4);
    let mut vector = |size: Vec3| Vec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0)) * size;
    let mut scattered = |count: usize, size: Vec3| (0..count).map(|_| [(); 3].map(|()| vector(size))).collect::<Vec<_>>();
    let scenes: [(&str, Vec<[Vec3; 3]>); 9] = [
        ("nothing", Vec::new()),
        ("one triangle", vec![[Vec3::ZERO, Vec3::X, Vec3::Y]]),
        ("a point", vec![[Vec3::ONE; 3]; 3]),
        ("duplicates", vec![[Vec3::ZERO, Vec3::X, Vec3::new(1.0, 2.0, 3.0)]; 200]),
        ("a plane", scattered(300, Vec3::new(5.0, 0.0, 2.0))),
        ("a line", scattered(300, Vec3::new(5.0, 0.0, 0.0))),
        (
            "a grid",
            (0..512)
                .map(|k| {
                    [Vec3::ZERO, Vec3::X, Vec3::Z].map(|p| p + Vec3::new((k % 8) as f32, (k / 64) as f32, (k / 8 % 8) as f32))
                })
                .collect(),
        ),
        ("tiny", scattered(100, Vec3::splat(1e-9))),
        ("large", scattered(100, Vec3::new(1e8, 2e8, 3e7))),
    ];
    for (name, triangles) in scenes {
        for at in [DVec3::ZERO, DVec3::new(4e6, -3.0, 2e5)] {
            let package = package(&triangles, at);
            let tessellation = tessellated(&package);
            assert_eq!(tessellation.slot_count() as usize, triangles.len(), "{name}");
            assert_complete(&tessellation);
            assert_eq!(tessellation.cells().is_empty(), triangles.is_empty(), "{name}");
            let decoded = Tessellation::decode(&tessellation.encode(), &package.scene.manifest);
            assert_eq!(decoded, Ok(tessellation), "{name}");
        }
    }
}

#[test]
fn shares_out_of_range_are_refused() {
    let package = package(&[[Vec3::ZERO, Vec3::X, Vec3::Y]], DVec3::ZERO);
    for leaf_share in [0.0, -1.0, 0.6, f64::NAN, f64::INFINITY] {
        let refused = tessellate(&package, &TessellateOptions { leaf_share }, &|_, _, _| {});
        assert!(matches!(refused, Err(TessellateError::Share { .. })), "{leaf_share}");
    }
}

#[test]
fn the_city_is_tessellated_within_its_bounds_and_goes_through_a_package() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("city.glb");
    let report = write_glb(GeneratedScene::PlpCity, 1, &path).expect("it is written");
    assert!(report.triangles > 500_000, "{report:?}");
    let mut package = open(&path, &PrepareOptions::default(), &|_, _, _| {}).expect("it is prepared").package;
    let tessellation = tessellated(&package);
    assert_eq!(tessellated(&package), tessellation, "the same again");
    assert_complete(&tessellation);
    package.scene.tessellation = Some(Arc::new(tessellation));
    let statistics = TessellationStatistics::of(&package).expect("it has one");
    println!("{statistics:?}");
    assert!(statistics.references_per_triangle() <= 2.2);
    assert!(statistics.share_of_instances() <= 0.25);
    let mut bytes = Vec::new();
    package.write_to(&mut bytes).expect("memory takes all");
    assert_eq!(Package::read(&bytes).expect("it is a package"), package);
    // Who does not know the section skips it.
    let kind = (SectionKind::Tessellation as u32).to_le_bytes();
    let at = (0..9).map(|k| 16 + 56 * k).find(|at| bytes[*at..][..4] == kind).expect("its section");
    bytes[at..][..4].copy_from_slice(&999u32.to_le_bytes());
    assert_eq!(Package::read(&bytes).expect("it is a package").scene.tessellation, None);
}

#[test]
fn cars_are_what_they_promise() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cars.glb");
    let report = write_glb(GeneratedScene::Cars, 1, &path).expect("it is written");
    assert!((810_000..950_000).contains(&report.triangles), "{report:?}");
    let package = open(&path, &PrepareOptions::default(), &|_, _, _| {}).expect("it is prepared").package;
    let cars: Vec<_> = package.scene.objects.iter().filter(|object| object.parent.is_some_and(|parent| parent.0 == 0)).collect();
    assert_eq!(cars.len(), 5);
    for car in cars {
        let leaves = car.leaves.iter().flat_map(|range| range.start..range.end);
        let triangles: u32 = leaves.map(|leaf| package.scene.manifest.leaves[leaf as usize].triangle_count).sum();
        assert!(triangles > 150_000, "{}: {triangles}", car.name);
    }
}
