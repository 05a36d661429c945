//! A small scene and a small wall for tests of master and nodes.
#![allow(dead_code, reason = "each test file uses its part")]

#[path = "../support/random.rs"]
pub mod random;
pub mod seeds;

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{
    AlphaMode, ChunkHash, ChunkId, ChunkKind, ChunkRecord, Filter, LeafRecord, LeafSource, Material, MaterialId, Object,
    ObjectHierarchy, ObjectId, OhNode, Package, Scene, SceneManifest, Sources, TextureRef, Transform, Wrap,
};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Wall, WallConfig};
use random::Random;

/// A wall of `columns × rows` tiles, each driven by a node of its name.
pub fn wall(columns: u32, rows: u32) -> Arc<Wall> {
    let text = format!("[grid]\ncolumns = {columns}\nrows = {rows}\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n");
    Arc::new(WallConfig::parse(&text).expect("a valid wall"))
}

pub const OBJECTS: u32 = 7;

/// A scene of so many leaves along a line. Every third leaf's chunk is shared with the one before; some materials have
/// textures. One chunk in 16 is larger than a piece.
pub fn package(leaf_count: u32) -> Arc<Package> {
    let (mut chunks, mut data) = (Vec::new(), Vec::new());
    let mut add = |kind: ChunkKind, bytes: &[u8]| {
        let id = ChunkId(chunks.len() as u32);
        chunks.push(ChunkRecord::new(ChunkHash::of(bytes), data.len() as u64, bytes.len() as u32, kind));
        data.extend_from_slice(bytes);
        id
    };
    let textures = [0u8, 1].map(|i| add(ChunkKind::Texture, &vec![i; 90_000]));
    let mut leaves: Vec<LeafRecord> = Vec::new();
    for i in 0..leaf_count {
        let chunk = match leaves.last() {
            Some(before) if i % 3 == 2 => before.chunk,
            _ => add(ChunkKind::Geometry, &i.to_le_bytes().repeat(if i % 16 == 0 { 40_000 } else { 50 })),
        };
        let x = i as f32;
        let (local_min, local_max) = ([x, 0.0, 0.0], [x + 1.0, 2.0, 3.0]);
        let (object, material) = (ObjectId(i % OBJECTS), MaterialId(i % 4));
        leaves.push(LeafRecord { object, chunk, material, triangle_count: 2, local_min, local_max });
    }
    let texture = |i: usize| TextureRef { chunk: textures[i], wrap_u: Wrap::Repeat, wrap_v: Wrap::Clamp, filter: Filter::Linear };
    let material = |texture| Material { base_color: [1.0; 4], texture, alpha: AlphaMode::Opaque, double_sided: false };
    let materials = vec![material(None), material(Some(texture(0))), material(None), material(Some(texture(1)))];
    let bound = |from: u32, to: u32| {
        let (min, max) = (DVec3::new(f64::from(from), 0.0, 0.0), DVec3::new(f64::from(to), 2.0, 3.0));
        Obb::from(Aabb { min, max })
    };
    let node = |subtree_end, from, to| {
        let leaves = LeafRange::new(from, to);
        OhNode { bound: bound(from, to), subtree_end, leaves }
    };
    let mut nodes = vec![node(leaf_count + 1, 0, leaf_count)];
    nodes.extend((0..leaf_count).map(|i| node(i + 2, i, i + 1)));
    let object = |i: u32| Object {
        parent: None,
        name: format!("object {i}"),
        source_node: i,
        instance: None,
        parent_from_local: DAffine3::IDENTITY,
        leaves: (0..leaf_count).filter(|l| l % OBJECTS == i).map(|l| LeafRange::new(l, l + 1)).collect(),
    };
    let scene = Scene {
        hierarchy: Arc::new(ObjectHierarchy::new(nodes).expect("a tree")),
        manifest: SceneManifest {
            transforms: vec![Transform::from(DAffine3::IDENTITY); OBJECTS as usize],
            leaves,
            materials,
            chunks,
        },
        objects: (0..OBJECTS).map(object).collect(),
        sources: Sources {
            leaves: (0..leaf_count).map(|piece| LeafSource { mesh: 0, primitive: 0, piece }).collect(),
            piece_ends: (1..=leaf_count).collect(),
            triangles: vec![0; leaf_count as usize],
        },
        tessellation: None,
        hierarchies: Default::default(),
    };
    Arc::new(Package::new(scene, data).expect("a valid package"))
}

/// What a view sees in a frame: a window that wanders over the leaves, with holes.
pub fn visible(seed: u64, frame: u64, view: usize, leaf_count: u32) -> VisibleSet {
    let mut rng = Random(seed ^ (frame / 3) << 20 ^ (view as u64) << 50);
    let start = ((frame / 2 + 13 * view as u64) % u64::from(leaf_count)) as u32;
    let mut set = VisibleSet::default();
    for _ in 0..rng.within(0, 6) {
        let from = (start + rng.within(0, 40) as u32).min(leaf_count - 1);
        set.push_unordered(LeafRange::new(from, (from + rng.within(1, 12) as u32).min(leaf_count)));
    }
    set.normalize();
    set
}

/// The chunks that a set of leaves needs.
pub fn chunks_of<'a>(manifest: &'a SceneManifest, set: &'a VisibleSet) -> impl Iterator<Item = ChunkId> + 'a {
    set.leaves().flat_map(|leaf| {
        let leaf = &manifest.leaves[leaf as usize];
        let texture = manifest.materials[leaf.material.0 as usize].texture.map(|t| t.chunk);
        [Some(leaf.chunk), texture].into_iter().flatten()
    })
}

/// Where an object stands in a frame.
pub fn transform(object: u32, frame: u64) -> Transform {
    Transform::from(DAffine3::from_translation(DVec3::new(f64::from(object), frame as f64, 0.5)))
}
