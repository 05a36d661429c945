//! What preparation promises: bounds that enclose, leaves of bounded size in depth-first order, shared chunks, one
//! package for one source, and a container that notices damage.

use std::collections::HashSet;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use mullion_common::scene::{GeometryChunk, NodeId, Package, PackageError};
use mullion_common::visible_set::VisibleSet;
use mullion_server::generate::{GeneratedScene, write_glb};
use mullion_server::prepare::gltf::{SourceMesh, SourceNode, SourcePrimitive, SourceScene};
use mullion_server::prepare::{self, PrepareOptions, prepare, statistics};

fn city(options: &PrepareOptions) -> Package {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("city.glb");
    write_glb(GeneratedScene::City, 1, &path).expect("written");
    prepare::open(&path, options, &|_, _, _| {}).expect("prepared").package
}

fn bytes_of(package: &Package) -> Vec<u8> {
    let mut bytes = Vec::new();
    package.write_to(&mut bytes).expect("memory takes all");
    bytes
}

/// A bent sheet of `2 · cells²` triangles, 1 × 2 m.
fn sheet(cells: u32) -> SourcePrimitive {
    let steps = || 0..=cells;
    let at = |x: u32, y: u32| {
        let (u, v) = (x as f32 / cells as f32, y as f32 / cells as f32);
        Vec3::new(u, v * 2.0, (u * 7.0).sin() * 0.2)
    };
    let corner = |x: u32, y: u32| y * (cells + 1) + x;
    let cell = |x: u32, y: u32| {
        let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
        [a, b, c, a, c, d]
    };
    SourcePrimitive {
        gltf_primitive: 0,
        positions: steps().flat_map(|y| steps().map(move |x| at(x, y))).collect(),
        normals: None,
        uvs: None,
        colors: None,
        indices: (0..cells).flat_map(|y| (0..cells).flat_map(move |x| cell(x, y))).collect(),
        material: None,
    }
}

/// A parent with `count` children that show one mesh, every third mirrored, and an empty node.
fn flat_scene(count: u32, cells: u32) -> SourceScene {
    let child = |i: u32| {
        let angle = f64::from(i);
        let scale = DVec3::new(if i.is_multiple_of(3) { -1.0 } else { 1.0 }, 1.5, 0.5);
        let place = DVec3::new(angle.sin() * 30.0, f64::from(i % 7), 1000.0 + angle.cos() * 30.0);
        DAffine3::from_scale_rotation_translation(scale, DQuat::from_rotation_y(angle), place)
    };
    let node = |parent, children, parent_from_local, mesh| SourceNode {
        name: None,
        parent,
        children,
        parent_from_local,
        mesh,
        instances: Vec::new(),
    };
    let mut nodes = vec![node(None, (1..count + 2).collect(), DAffine3::from_translation(DVec3::X * 1e5), None)];
    nodes.extend((0..count).map(|i| node(Some(0), Vec::new(), child(i), Some(0))));
    nodes.push(node(Some(0), Vec::new(), DAffine3::IDENTITY, None));
    let meshes = vec![SourceMesh { name: None, gltf_mesh: 0, primitives: vec![sheet(cells)] }];
    SourceScene { nodes, roots: vec![0], meshes, materials: Vec::new(), images: Vec::new(), warnings: Vec::new() }
}

/// Every parent's box holds its children's boxes, and every leaf's box its vertices, to within rounding.
fn assert_encloses(package: &Package) {
    let (hierarchy, manifest) = (&package.scene.hierarchy, &package.scene.manifest);
    for id in (0..hierarchy.nodes().len() as u32).map(NodeId) {
        let bound = &hierarchy.node(id).bound;
        let tolerance_m = 1e-12 * (bound.center.length() + bound.radius_along(DVec3::ONE.normalize()));
        for child in hierarchy.children(id) {
            for corner in hierarchy.node(child).bound.corners() {
                assert!(bound.contains(corner, tolerance_m), "node {child:?} sticks out of {id:?}");
            }
        }
        if hierarchy.is_leaf(id) {
            let leaf = &manifest.leaves[hierarchy.node(id).leaves.start as usize];
            let chunk = GeometryChunk::decode(package.chunk(leaf.chunk)).expect("a chunk");
            let world_from_local = manifest.transforms[leaf.object.0 as usize].affine();
            for position in &chunk.positions {
                let world = world_from_local.transform_point3(Vec3::from(*position).as_dvec3());
                assert!(bound.contains(world, 0.0), "a vertex sticks out of leaf node {id:?}");
            }
        }
    }
}

#[test]
fn boxes_enclose_and_leaves_are_bounded() {
    for (package, most) in [
        (city(&PrepareOptions { max_leaf_triangles: 300, split_larger_than_m: None }), 300),
        (
            prepare(flat_scene(50, 20), &PrepareOptions { max_leaf_triangles: 100, split_larger_than_m: None }, &|_, _, _| {})
                .expect("prepared")
                .package,
            100,
        ),
    ] {
        assert_encloses(&package);
        assert!(package.scene.manifest.leaves.iter().all(|leaf| (1..=most).contains(&leaf.triangle_count)));
        // An object's ranges name the leaves that it or an object below it draws, whatever tree numbers them.
        let objects = &package.scene.objects;
        let mut below: Vec<HashSet<u32>> = vec![HashSet::new(); objects.len()];
        for (leaf, record) in (0..).zip(&package.scene.manifest.leaves) {
            let mut above = Some(record.object);
            while let Some(object) = above {
                below[object.0 as usize].insert(leaf);
                above = objects[object.0 as usize].parent;
            }
        }
        for (object, leaves) in objects.iter().zip(below) {
            assert_eq!(VisibleSet::from_ranges(object.leaves.clone()).ranges(), object.leaves, "sorted and merged");
            assert_eq!(object.leaves.iter().flat_map(|r| r.start..r.end).collect::<HashSet<u32>>(), leaves);
        }
    }
}

#[test]
fn a_flat_file_gets_groups_and_instances_share_chunks() {
    let package = prepare(flat_scene(1000, 1), &PrepareOptions::default(), &|_, _, _| {}).expect("prepared").package;
    let s = statistics(&package);
    assert_eq!((s.leaves, s.geometry_chunks, s.triangles_unique, s.triangles_instanced), (1000, 1, 2, 2000));
    assert!(s.average_branching <= 16.0 && s.depth > 3 && s.depth < 40, "{s:?}");
    assert_eq!((s.file_nodes, s.file_inner_nodes), (1001, 1), "the empty node is an object without leaves");
    assert_eq!(s.file_branching, 1000.0);
    assert_eq!(s.objects, 1002);
    assert_eq!(package.scene.objects[1001].leaves, []);
}

#[test]
fn floors_are_cut_on_request_only() {
    let whole = prepare(flat_scene(1, 1), &PrepareOptions::default(), &|_, _, _| {}).expect("prepared").package;
    assert_eq!(statistics(&whole).triangles_unique, 2);
    let options = PrepareOptions { split_larger_than_m: Some(0.25), ..PrepareOptions::default() };
    let cut = prepare(flat_scene(1, 1), &options, &|_, _, _| {}).expect("prepared").package;
    assert!(statistics(&cut).triangles_unique > 50, "{:?}", statistics(&cut));
    let sources: HashSet<u32> = cut.scene.sources.triangles_of(0).iter().copied().collect();
    assert_eq!(sources, HashSet::from([0, 1]), "parts of a cut triangle still name it");
}

#[test]
fn one_source_gives_one_package_and_it_reads_back() {
    let (a, b) = (city(&PrepareOptions::default()), city(&PrepareOptions::default()));
    let bytes = bytes_of(&a);
    assert!(bytes == bytes_of(&b), "the same source gave different bytes");
    assert!(Package::read(&bytes).expect("it reads") == a, "what was written is not what is read");
}

#[test]
fn damage_to_a_package_is_noticed() {
    let package = prepare(flat_scene(3, 2), &PrepareOptions::default(), &|_, _, _| {}).expect("prepared").package;
    let bytes = bytes_of(&package);
    for cut in (0..bytes.len()).step_by(7) {
        assert!(Package::read(&bytes[..cut]).is_err(), "cut at {cut}");
    }
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        match Package::read(&damaged) {
            Ok(read) => assert!(read == package, "byte {at} changed the scene unnoticed"),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    let mut later = bytes.clone();
    later[8] = 99;
    assert!(matches!(Package::read(&later), Err(PackageError::Version { found: 99 })));
    // A section of a kind that this reader does not know is skipped: here, in place of none that it needs.
    let mut with_unknown = bytes.clone();
    let count = u32::from_le_bytes(with_unknown[12..16].try_into().expect("four bytes"));
    with_unknown[12..16].copy_from_slice(&(count + 1).to_le_bytes());
    let table_end = 16 + count as usize * 56;
    let mut entry = [0u8; 56];
    entry[..4].copy_from_slice(&1000u32.to_le_bytes());
    with_unknown.splice(table_end..table_end, entry);
    for i in 0..count as usize {
        let at = 16 + i * 56 + 8;
        let offset = u64::from_le_bytes(with_unknown[at..at + 8].try_into().expect("eight bytes")) + 56;
        with_unknown[at..at + 8].copy_from_slice(&offset.to_le_bytes());
    }
    assert!(Package::read(&with_unknown).expect("unknown sections are skipped") == package);
}
