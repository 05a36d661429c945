//! Goal: two packages joined are one scene: what each view sees of it is what it sees of both, and all that the first had keeps its number.
//! Method: random packages, places and views; the joined scene against the oracle over each package by itself. Nothing else is trusted:
//! the added leaves' boxes are made anew from their vertices.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use mullion_common::geometry::Obb;
use mullion_common::scene::{ChunkHash, ChunkId, ChunkRecord, GeometryChunk, ObjectId, Package};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{ViewId, Wall, WallConfig};
use mullion_server::cull::{Algorithm, Culler, oracle};
use mullion_server::prepare::gltf::{SourceMaterial, SourceMesh, SourceNode, SourcePrimitive, SourceScene};
use mullion_server::prepare::{GraftError, Placement, PrepareOptions, graft, prepare};
use mullion_server::tree::{CullTree, MAX_TRANSFORM};
use proptest::prelude::*;

/// A tent of `cells` stripes, 1 × 2 × 3 parts of `size`.
fn tent(cells: u32, size: f32) -> SourcePrimitive {
    let at = |x: u32, y: u32| {
        let (u, v) = (x as f32 / cells as f32, y as f32);
        Vec3::new(u, v * 2.0, (u - 0.5).abs() * 3.0) * size
    };
    let cell = |x: u32| [2 * x, 2 * x + 2, 2 * x + 3, 2 * x, 2 * x + 3, 2 * x + 1];
    SourcePrimitive {
        gltf_primitive: 0,
        positions: (0..=cells).flat_map(|x| [at(x, 0), at(x, 1)]).collect(),
        normals: None,
        uvs: None,
        colors: None,
        indices: (0..cells).flat_map(cell).collect(),
        material: None,
    }
}

#[derive(Clone, Debug)]
struct Part {
    place: [f64; 3],
    angle: f64,
    scale: f64,
    mesh: u32,
    under_last: bool,
}

fn part() -> impl Strategy<Value = Part> {
    (prop::array::uniform3(-20.0..20.0), 0.0..6.0, 0.2..3.0, 0..3u32, any::<bool>())
        .prop_map(|(place, angle, scale, mesh, under_last)| Part { place, angle, scale, mesh, under_last })
}

fn turned(place: [f64; 3], angle: f64, scale: f64) -> DAffine3 {
    let turn = DQuat::from_scaled_axis(DVec3::new(0.3, 1.0, -0.2) * angle);
    DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, DVec3::from(place))
}

fn packaged(parts: &[Part]) -> Package {
    let mut nodes: Vec<SourceNode> = Vec::new();
    let mut roots = Vec::new();
    for (i, part) in parts.iter().enumerate() {
        let parent = (part.under_last && i > 0).then(|| i as u32 - 1);
        match parent {
            Some(parent) => nodes[parent as usize].children.push(i as u32),
            None => roots.push(i as u32),
        }
        nodes.push(SourceNode {
            name: Some(format!("part {i}")),
            parent,
            children: Vec::new(),
            parent_from_local: turned(part.place, part.angle, part.scale),
            mesh: Some(part.mesh),
            instances: Vec::new(),
        });
    }
    let mesh = |i: u32| SourceMesh { gltf_mesh: i, name: None, primitives: vec![tent(2 + i * 3, 1.0 + i as f32)] };
    let scene = SourceScene {
        nodes,
        roots,
        meshes: (0..3).map(mesh).collect(),
        materials: Vec::<SourceMaterial>::new(),
        images: Vec::new(),
        warnings: Vec::new(),
    };
    let options = PrepareOptions { max_leaf_triangles: 4, ..PrepareOptions::default() };
    prepare(scene, &options, &|_, _, _| {}).expect("prepared").package
}

fn wall() -> Wall {
    let text = "[grid]\ncolumns = 3\nrows = 2\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\nbezel_m = [0.02, 0.03]\n";
    WallConfig::parse(text).expect("a valid wall")
}

/// What a leaf is, wherever it is numbered: its object and its chunk.
fn name(package: &Package, leaf: u32, first_object: u32) -> (u32, ChunkHash) {
    let record = &package.scene.manifest.leaves[leaf as usize];
    (record.object.0 + first_object, package.scene.manifest.chunks[record.chunk.0 as usize].hash)
}

/// The leaves of an added package with boxes around their vertices in the scene.
fn boxes(package: &Package, world_from_root: &DAffine3) -> Vec<(u32, Obb)> {
    let manifest = &package.scene.manifest;
    let bound = |leaf: u32| {
        let record = &manifest.leaves[leaf as usize];
        let world = *world_from_root * manifest.transforms[record.object.0 as usize].affine();
        let positions = GeometryChunk::positions(package.chunk(record.chunk));
        Obb::around(positions.iter().map(|p| world.transform_point3(Vec3::from(*p).as_dvec3()))).expect("vertices")
    };
    (0..manifest.leaves.len() as u32).map(|leaf| (leaf, bound(leaf))).collect()
}

fn assert_grew(base: &Package, added: &Package, joined: &Package, under: Option<ObjectId>) {
    let (old, new) = (&base.scene.manifest, &joined.scene.manifest);
    let (before, after) = (old.size(), new.size());
    assert_eq!(new.transforms[..before.objects as usize], old.transforms[..]);
    assert_eq!(new.leaves[..before.leaves as usize], old.leaves[..]);
    assert_eq!(new.materials[..before.materials as usize], old.materials[..]);
    assert_eq!(new.chunks[..before.chunks as usize], old.chunks[..]);
    assert_eq!(after.objects, before.objects + 1 + added.scene.objects.len() as u32);
    assert_eq!(after.leaves, before.leaves + added.scene.leaf_count());
    let names: BTreeSet<_> = new.chunks.iter().map(|chunk| chunk.hash).collect();
    assert_eq!(names.len(), new.chunks.len(), "a chunk is there once");
    for (id, chunk) in (0..).zip(&new.chunks) {
        assert_eq!(ChunkHash::of(joined.chunk(ChunkId(id))), chunk.hash);
    }
    // What an object names is what stands at or below it.
    for (id, object) in joined.scene.objects.iter().enumerate() {
        let is_below = |mut at: u32| loop {
            match joined.scene.objects[at as usize].parent {
                _ if at as usize == id => break true,
                Some(parent) => at = parent.0,
                None => break false,
            }
        };
        let below =
            (0..).zip(&new.leaves).filter(|(_, leaf)| is_below(leaf.object.0)).map(|(leaf, _)| LeafRange::new(leaf, leaf + 1));
        assert_eq!(VisibleSet::from_ranges(below).ranges(), object.leaves, "object {id}");
    }
    assert_eq!(joined.scene.objects[before.objects as usize].parent, under);
    let mut bytes = Vec::new();
    joined.write_to(&mut bytes).expect("memory takes all");
    assert_eq!(&Package::read(&bytes).expect("what was written"), joined);
    // A tile that had the first package and gets what came since has the joined one.
    let mut of_tile = old.clone();
    let sections = mullion_common::scene::SectionKind::FOR_TILES.map(|kind| new.section_since(kind, before).expect("a section"));
    of_tile.grow(sections.each_ref().map(Vec::as_slice)).expect("it belongs to it");
    assert_eq!(&of_tile, new);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn a_joined_scene_is_seen_as_both_its_parts(
        base in prop::collection::vec(part(), 1..7), added in prop::collection::vec(part(), 0..7),
        (place, angle, scale) in (prop::array::uniform3(-15.0..15.0), 0.0..6.0, 0.3..4.0),
        under in prop::option::of(any::<prop::sample::Index>()),
        views in prop::collection::vec((prop::array::uniform3(-30.0..30.0), 0.0..6.0), 1..4),
    ) {
        let (base, added, wall) = (packaged(&base), packaged(&added), wall());
        let under = under.map(|index| ObjectId(index.index(base.scene.objects.len()) as u32));
        let world_from_root = turned(place, angle, scale);
        let joined = graft(&base, &added, &Placement { name: "it".into(), under, world_from_root }).expect("joined");
        assert_grew(&base, &added, &joined, under);
        let (first_object, first_leaf) = (base.scene.objects.len() as u32 + 1, base.scene.leaf_count());
        let added_boxes = boxes(&added, &world_from_root);
        let tree = CullTree::new(Arc::clone(&joined.scene.hierarchy));
        let eyes = wall.default_eyes();
        for (at, angle) in views {
            let room = turned(at, angle, 10.0);
            let mut culled: Vec<Vec<VisibleSet>> = Vec::new();
            for algorithm in [Algorithm::Sweep, Algorithm::Adaptive, Algorithm::Naive] {
                let mut sets = vec![VisibleSet::default(); wall.views().len()];
                Culler::new(algorithm, &wall).cull(&tree, &wall, &eyes, &room, &mut sets);
                culled.push(sets);
            }
            for view in 0..wall.views().len() {
                let frustum = wall.frustum(ViewId(view as u16), eyes[view], &room);
                let (mut of_joined, mut of_base, mut of_added) = Default::default();
                oracle::visible_leaves(&joined.scene.hierarchy, &frustum, &mut of_joined);
                oracle::visible_leaves(&base.scene.hierarchy, &frustum, &mut of_base);
                oracle::visible_boxes(added_boxes.iter().map(|(leaf, bound)| (*leaf, bound)), &frustum, &mut of_added);
                let both: BTreeSet<_> = of_base.leaves().map(|leaf| name(&base, leaf, 0))
                    .chain(of_added.leaves().map(|leaf| name(&added, leaf, first_object))).collect();
                let one: BTreeSet<_> = of_joined.leaves().map(|leaf| name(&joined, leaf, 0)).collect();
                // The joined scene's new boxes are grown by what a GPU may round: no leaf is missing, and no old one is there for it.
                prop_assert!(one.is_superset(&both), "view {}: {:?} lacks some of {:?}", view, one, both);
                prop_assert_eq!(of_joined.leaves().filter(|leaf| *leaf < first_leaf).collect::<Vec<_>>(), of_base.leaves().collect::<Vec<_>>());
                let grown = |leaf: u32| oracle::intersects(&frustum, &added_boxes[(leaf - first_leaf) as usize].1.grown(1e-3));
                prop_assert!(of_joined.leaves().filter(|leaf| *leaf >= first_leaf).all(grown), "view {}", view);
                for sets in &culled {
                    prop_assert!(sets[view].is_superset_of(&of_joined), "view {}", view);
                }
            }
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let part = Part { place: [1.0, 2.0, 3.0], angle: 1.0, scale: 1.0, mesh: 1, under_last: false };
    let package = packaged(&[part]);
    let at = |under, world_from_root| Placement { name: "it".into(), under, world_from_root };
    let error = |placement: &Placement| graft(&package, &package, placement).expect_err("refused");
    let object = error(&at(Some(ObjectId(1)), DAffine3::IDENTITY));
    assert!(matches!(object, GraftError::NoObject { object: 1, count: 1 }), "{object}");
    for far in [MAX_TRANSFORM * 0.9, f64::NAN, f64::INFINITY] {
        let place = error(&at(None, DAffine3::from_scale_rotation_translation(DVec3::splat(far), DQuat::IDENTITY, DVec3::X)));
        assert!(matches!(place, GraftError::Place { .. }), "{place}");
    }
    let mut damaged = package.clone();
    let chunk = damaged.scene.manifest.chunks[0];
    damaged.scene.manifest.chunks[0] = ChunkRecord::new(ChunkHash([9; 32]), 0, chunk.length, chunk.kind().expect("a kind"));
    let damage = graft(&package, &damaged, &at(None, DAffine3::IDENTITY)).expect_err("refused");
    assert!(matches!(damage, GraftError::Damaged { chunk: 0 }), "{damage}");
    // The same once more costs no chunk and no material.
    let twice = graft(&package, &package, &at(None, DAffine3::from_translation(DVec3::X))).expect("joined");
    let (once, two) = (package.scene.manifest.size(), twice.scene.manifest.size());
    assert_eq!((two.chunks, two.materials, two.leaves), (once.chunks, once.materials, 2 * once.leaves));
    assert_eq!(twice.chunk_bytes(), package.chunk_bytes());
    // An empty package is an object without geometry.
    let nothing = graft(&package, &Package::default(), &at(Some(ObjectId(0)), DAffine3::IDENTITY)).expect("joined");
    assert_eq!((nothing.scene.objects.len(), nothing.scene.leaf_count()), (2, package.scene.leaf_count()));
    let first = graft(&Package::default(), &package, &at(None, DAffine3::IDENTITY)).expect("joined");
    assert_eq!(first.scene.leaf_count(), package.scene.leaf_count());
}
