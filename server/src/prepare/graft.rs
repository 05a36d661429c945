//! Joins a package to another one as a subtree. Pure.
//!
//! Everything that the first one has keeps its number: objects, leaves, materials and chunks of the other come behind. What both have in
//! common, chunks and materials, is there once.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{DAffine3, Vec3};
use mullion_common::geometry::Obb;
use mullion_common::scene::{
    ChunkHash, ChunkId, ChunkRecord, GeometryChunk, LeafRecord, LeafSource, MAX_PACKAGE_BYTES, Material, MaterialId, Object,
    ObjectHierarchy, ObjectId, OhNode, Package, PackageError, Scene, SceneManifest, SectionKind, Sources, TextureRef, Transform,
};
use mullion_common::visible_set::LeafRange;
use mullion_common::wire::{Insertion, MAX_TILE_SECTION_BYTES, codec};
use thiserror::Error;

use super::assemble::{MAX_LEAVES, push_range, world_bound};
use crate::tree::{MAX_TRANSFORM, fitted};

/// Where a package is joined to another.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// What the new object above all others of the package is called.
    pub name: String,
    /// The object that it is part of; `None`: it is a root.
    pub under: Option<ObjectId>,
    /// Where the package's world is in the scene's.
    pub world_from_root: DAffine3,
}

impl Placement {
    /// Where an insertion places its package.
    pub fn of(insertion: &Insertion) -> Self {
        let Insertion { package, under, world_from_root, .. } = insertion;
        Self { name: package.clone(), under: *under, world_from_root: DAffine3::from_cols_array(world_from_root) }
    }
}

/// Why packages were not joined.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum GraftError {
    #[error("object {object}: the scene has {count}, from 0 on")]
    NoObject { object: u32, count: usize },
    #[error("object {object} of the package would stand outside ±{MAX_TRANSFORM:e}")]
    Place { object: usize },
    #[error("{found} {what}, both together; at most {cap} are allowed")]
    TooMany { what: &'static str, found: u64, cap: u64 },
    #[error("chunk {chunk} of the package is damaged: its bytes are not those of its name")]
    Damaged { chunk: u32 },
    #[error(transparent)]
    Package(#[from] PackageError),
}

/// The scene of `base` with that of `added` in it. The first new object stands above the others; all new ones are numbered behind those of
/// `base`, in the order that they have in `added`.
///
/// Boxes of new leaves are fitted around their vertices where they now stand, as by preparation.
///
/// # Errors
/// When there is no such object, the place is out of range, or together they pass a cap of packages.
pub fn graft(base: &Package, added: &Package, at: &Placement) -> Result<Package, GraftError> {
    check_size(base, added)?;
    let (old, new) = (&base.scene, &added.scene);
    let size = old.manifest.size();
    if let Some(under) = at.under.filter(|under| under.0 >= size.objects) {
        return Err(GraftError::NoObject { object: under.0, count: old.objects.len() });
    }
    let first_object = size.objects + 1;
    let mut transforms = old.manifest.transforms.clone();
    transforms.push(placed(&at.world_from_root, 0)?);
    for (object, transform) in new.manifest.transforms.iter().enumerate() {
        transforms.push(placed(&(at.world_from_root * transform.affine()), object)?);
    }
    let (chunks, chunk_of, added_bytes) = join_chunks(base, added)?;
    let (materials, material_of) = join_materials(&old.manifest.materials, &new.manifest.materials, &chunk_of)?;
    let mut leaves = old.manifest.leaves.clone();
    leaves.extend(new.manifest.leaves.iter().map(|leaf| LeafRecord {
        object: ObjectId(leaf.object.0 + first_object),
        chunk: chunk_of[leaf.chunk.0 as usize],
        material: material_of[leaf.material.0 as usize],
        ..*leaf
    }));
    let scene = Scene {
        hierarchy: Arc::new(join_hierarchies(base, added, &transforms[first_object as usize..])?),
        manifest: SceneManifest { transforms, leaves, materials, chunks },
        objects: join_objects(old, new, at),
        sources: join_sources(&old.sources, &new.sources),
        tessellation: old.tessellation.clone(),
        hierarchies: old.hierarchies.clone(),
    };
    Ok(base.grown(scene, added_bytes)?)
}

/// What is larger could be neither written as one package nor sent.
fn check_size(base: &Package, added: &Package) -> Result<(), GraftError> {
    let (a, b) = (base.scene.manifest.size(), added.scene.manifest.size());
    let check = |what, found: u64, cap: u64| if found <= cap { Ok(()) } else { Err(GraftError::TooMany { what, found, cap }) };
    let sum = |a: u32, b: u32| u64::from(a) + u64::from(b);
    let in_section = |bytes: usize| MAX_TILE_SECTION_BYTES / bytes as u64;
    check("leaves", sum(a.leaves, b.leaves), MAX_LEAVES.min(in_section(size_of::<LeafRecord>())))?;
    check("objects", sum(a.objects, b.objects) + 1, in_section(size_of::<Transform>()))?;
    check("chunks", sum(a.chunks, b.chunks), in_section(size_of::<ChunkRecord>()))?;
    check("materials", sum(a.materials, b.materials), in_section(size_of::<Material>()))?;
    check("triangles", (base.scene.sources.triangles.len() + added.scene.sources.triangles.len()) as u64, u64::from(u32::MAX))?;
    check("bytes of chunks", base.chunk_bytes() + added.chunk_bytes(), MAX_PACKAGE_BYTES)
}

fn placed(world_from_local: &DAffine3, object: usize) -> Result<Transform, GraftError> {
    // A number that is not finite is not within the range, either.
    let is_in_range = world_from_local.to_cols_array().iter().all(|number| number.abs() <= MAX_TRANSFORM);
    if is_in_range { Ok((*world_from_local).into()) } else { Err(GraftError::Place { object }) }
}

/// All chunks, what each of the added package's is called among them, and the bytes of those that are new.
type JoinedChunks = (Vec<ChunkRecord>, Vec<ChunkId>, Vec<u8>);

/// Joins chunks. Every added chunk's name is held
/// against its bytes: nodes would refuse a wrong one, again and again.
fn join_chunks(base: &Package, added: &Package) -> Result<JoinedChunks, GraftError> {
    let mut chunks = base.scene.manifest.chunks.clone();
    let mut known: HashMap<_, ChunkId> = (0..).zip(&chunks).map(|(id, c)| ((c.hash, c.kind()), ChunkId(id))).collect();
    let (mut chunk_of, mut bytes) = (Vec::with_capacity(added.scene.manifest.chunks.len()), Vec::new());
    for (id, chunk) in (0..).map(ChunkId).zip(&added.scene.manifest.chunks) {
        if ChunkHash::of(added.chunk(id)) != chunk.hash {
            return Err(GraftError::Damaged { chunk: id.0 });
        }
        chunk_of.push(*known.entry((chunk.hash, chunk.kind())).or_insert_with(|| {
            let offset = base.chunk_bytes() + bytes.len() as u64;
            bytes.extend_from_slice(added.chunk(id));
            chunks.push(chunk.moved_to(offset));
            ChunkId(chunks.len() as u32 - 1)
        }));
    }
    Ok((chunks, chunk_of, bytes))
}

fn join_materials(
    base: &[Material],
    added: &[Material],
    chunk_of: &[ChunkId],
) -> Result<(Vec<Material>, Vec<MaterialId>), GraftError> {
    let key = |material: &Material| codec::encode(material).map_err(|e| PackageError::Section(SectionKind::Materials, e));
    let mut materials = base.to_vec();
    let mut known: HashMap<Vec<u8>, MaterialId> = HashMap::with_capacity(base.len());
    for (id, material) in (0..).map(MaterialId).zip(base) {
        known.entry(key(material)?).or_insert(id);
    }
    let mut material_of = Vec::with_capacity(added.len());
    for material in added {
        let texture = material.texture.map(|texture| TextureRef { chunk: chunk_of[texture.chunk.0 as usize], ..texture });
        let material = Material { texture, ..material.clone() };
        material_of.push(*known.entry(key(&material)?).or_insert_with(|| {
            materials.push(material);
            MaterialId(materials.len() as u32 - 1)
        }));
    }
    Ok((materials, material_of))
}

/// The added tree as it is, below the root of the other. `transforms`: where its objects stand now.
fn join_hierarchies(base: &Package, added: &Package, transforms: &[Transform]) -> Result<ObjectHierarchy, GraftError> {
    let mut hierarchy = ObjectHierarchy::clone(&base.scene.hierarchy);
    if added.scene.leaf_count() == 0 {
        return Ok(hierarchy);
    }
    let mut nodes: Vec<OhNode> = added.scene.hierarchy.nodes().to_vec();
    // Backwards, children come before their parents.
    for id in (0..nodes.len()).rev() {
        nodes[id].bound = if nodes[id].subtree_end as usize == id + 1 {
            let leaf = &added.scene.manifest.leaves[nodes[id].leaves.start as usize];
            leaf_bound(added, leaf, &transforms[leaf.object.0 as usize].affine())
        } else {
            fitted(&nodes, id)
        };
    }
    hierarchy.append(&ObjectHierarchy::new(nodes).map_err(PackageError::from)?);
    if let Some(root) = hierarchy.root() {
        let bound = fitted(hierarchy.nodes(), 0);
        hierarchy.set_bound(root, bound);
    }
    Ok(hierarchy)
}

fn leaf_bound(package: &Package, leaf: &LeafRecord, world_from_local: &DAffine3) -> Obb {
    let positions = GeometryChunk::positions(package.chunk(leaf.chunk));
    world_bound(&positions, (Vec3::from(leaf.local_min), Vec3::from(leaf.local_max)), world_from_local)
}

fn join_objects(old: &Scene, new: &Scene, at: &Placement) -> Vec<Object> {
    let (first_object, first_leaf) = (old.objects.len() as u32 + 1, old.leaf_count());
    let whole = LeafRange::new(first_leaf, first_leaf + new.leaf_count());
    let world_from_parent = at.under.map_or(DAffine3::IDENTITY, |under| old.manifest.transforms[under.0 as usize].affine());
    let parent_from_local = Some(world_from_parent.inverse() * at.world_from_root).filter(DAffine3::is_finite);
    let next_node =
        |objects: &[Object]| objects.iter().map(|object| object.source_node).max().map_or(0, |last| last.saturating_add(1));
    let first_node = next_node(&old.objects);
    let mut objects = old.objects.clone();
    let mut above = at.under.filter(|_| !whole.is_empty());
    while let Some(object) = above {
        // The last numbers of all: behind what is there.
        push_range(&mut objects[object.0 as usize].leaves, whole);
        above = objects[object.0 as usize].parent;
    }
    objects.push(Object {
        parent: at.under,
        name: at.name.clone(),
        source_node: first_node,
        instance: None,
        parent_from_local: parent_from_local.unwrap_or(at.world_from_root),
        leaves: Some(whole).into_iter().filter(|whole| !whole.is_empty()).collect(),
    });
    objects.extend(new.objects.iter().map(|object| Object {
        parent: Some(object.parent.map_or(ObjectId(first_object - 1), |parent| ObjectId(parent.0 + first_object))),
        source_node: object.source_node.saturating_add(first_node).saturating_add(1),
        leaves: object.leaves.iter().map(|range| LeafRange::new(range.start + first_leaf, range.end + first_leaf)).collect(),
        ..object.clone()
    }));
    objects
}

/// Meshes of the added package's file are numbered behind those of the other.
fn join_sources(old: &Sources, new: &Sources) -> Sources {
    let (pieces, triangles) = (old.piece_ends.len() as u32, old.triangles.len() as u32);
    let meshes = old.leaves.iter().map(|leaf| leaf.mesh).max().map_or(0, |last| last.saturating_add(1));
    let mut sources = old.clone();
    sources.leaves.extend(new.leaves.iter().map(|leaf| LeafSource {
        mesh: leaf.mesh.saturating_add(meshes),
        primitive: leaf.primitive,
        piece: leaf.piece + pieces,
    }));
    sources.piece_ends.extend(new.piece_ends.iter().map(|end| end + triangles));
    sources.triangles.extend_from_slice(&new.triangles);
    sources
}
