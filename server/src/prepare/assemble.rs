//! Joins divided meshes, objects and the hierarchy into a package.

use std::io::Cursor;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use glam::{DAffine3, Vec3};
use mullion_common::geometry::{Aabb, Obb, axis_lengths};
use mullion_common::scene::{
    AlphaMode, ChunkId, ChunkKind, Filter, GeometryChunk, LeafRecord, LeafSource, LodTables, Material, MaterialId, Object,
    ObjectHierarchy, ObjectId, OhNode, Package, Scene, SceneManifest, Sources, TextureRef, Transform, Wrap,
};
use mullion_common::visible_set::LeafRange;
use rayon::prelude::*;

use super::chunks::ChunkTable;
use super::divide::{Division, Piece, divide};
use super::gltf::{self, SourceAlpha, SourceImage, SourceMesh, SourceScene};
use super::hierarchy::{DraftId, HierarchyBuilder};
use super::refine::{self, TooManyAdded};
use super::{PrepareError, PrepareOptions, Prepared, ProgressFn};
use crate::tree::regroup::Tree;
use crate::tree::{WideTree, hierarchy_over};

/// Most leaves in a scene.
pub(super) const MAX_LEAVES: u64 = 1 << 28;
/// Meshes divided at a time: their chunks are held twice for that long.
const MESHES_AT_A_TIME: usize = 256;

/// Prepares a scene. The same source and options give the same package.
///
/// Each leaf's bound encloses all of its vertices in the world, grown by what the GPU's `f32` may round.
///
/// # Errors
/// When a transform overflows, there are more leaves than ids, or [`PrepareOptions::split_larger_than_m`] is so short
/// that cutting would add more triangles than it may.
pub fn prepare(source: SourceScene, options: &PrepareOptions, progress: ProgressFn<'_>) -> Result<Prepared, PrepareError> {
    let SourceScene { nodes, roots, mut meshes, materials, images, warnings } = source;
    let placed = place_objects(&nodes, &roots)?;
    drop_unplaced(&mut meshes, &placed);
    let mut chunks = ChunkTable::default();
    let materials = convert_materials(&materials, &images, &mut chunks);
    drop(images);

    let longest_edges = options.split_larger_than_m.map(|limit_m| local_limits(limit_m, &placed, meshes.len()));
    let mut table = PieceTable::default();
    let total = meshes.len() as u64;
    let mut divided: Vec<DividedMesh> = Vec::with_capacity(meshes.len());
    let mut limits = longest_edges.unwrap_or_else(|| vec![f32::INFINITY; meshes.len()]).into_iter();
    let cuts_left = AtomicU64::new(refine::MAX_ADDED_TRIANGLES);
    while !meshes.is_empty() {
        let batch: Vec<SourceMesh> = meshes.drain(..meshes.len().min(MESHES_AT_A_TIME)).collect();
        let batch: Vec<(SourceMesh, f32)> = batch.into_iter().zip(limits.by_ref()).collect();
        let divisions: Result<Vec<(SourceMesh, Vec<Division>)>, TooManyAdded> =
            batch.into_par_iter().map(|(mesh, limit)| divide_mesh(mesh, limit, &cuts_left, options)).collect();
        let what = "triangles added by cutting large ones";
        let divisions = divisions.map_err(|TooManyAdded| PrepareError::TooMany { what, cap: refine::MAX_ADDED_TRIANGLES })?;
        for (mesh, divisions) in divisions {
            divided.push(table.take(&mesh, divisions, materials.len() - 1, &mut chunks));
        }
        progress("dividing meshes", divided.len() as u64, total);
    }

    let leaves = draft_leaves(&placed, &divided)?;
    let bounds = leaf_bounds(&leaves, &placed, &table, &chunks, progress);
    progress("building hierarchy", 0, 1);
    let (hierarchy, order) = choose_hierarchy(file_hierarchy(&placed, &divided, &leaves, &bounds)?, &bounds)?;
    let hierarchy = Arc::new(hierarchy);

    let leaf = |&draft: &u32| &leaves[draft as usize];
    let manifest = SceneManifest {
        transforms: placed.iter().map(|o| Transform::from(o.world_from_local)).collect(),
        leaves: order.iter().map(|d| table.record(leaf(d))).collect(),
        materials,
        chunks: chunks.records,
    };
    let sources = Sources {
        leaves: order.iter().map(|d| table.source(leaf(d))).collect(),
        piece_ends: table.piece_ends,
        triangles: table.triangles,
    };
    let objects = name_objects(placed, &nodes, &manifest.leaves);
    let scene = Scene { hierarchy, manifest, objects, sources, tessellation: None, hierarchies: LodTables::default() };
    let package = Package::new(scene, chunks.data).map_err(package_error)?;
    progress("building hierarchy", 1, 1);
    Ok(Prepared { package, warnings })
}

fn package_error(error: mullion_common::scene::PackageError) -> PrepareError {
    PrepareError::Package { file: "prepared scene".to_owned(), error }
}

/// An object on the way.
struct Placed {
    parent: Option<u32>,
    source_node: u32,
    instance: Option<u32>,
    parent_from_local: DAffine3,
    world_from_local: DAffine3,
    mesh: Option<u32>,
}

/// All objects, parents before children: nodes in depth-first order, the instances of a node after it.
fn place_objects(nodes: &[gltf::SourceNode], roots: &[u32]) -> Result<Vec<Placed>, PrepareError> {
    let mut placed: Vec<Placed> = Vec::with_capacity(nodes.len());
    let mut open: Vec<(u32, Option<u32>)> = roots.iter().rev().map(|r| (*r, None)).collect();
    while let Some((index, parent)) = open.pop() {
        let node = &nodes[index as usize];
        let world_from_parent = parent.map_or(DAffine3::IDENTITY, |p| placed[p as usize].world_from_local);
        let id = placed.len() as u32;
        let world_from_local = world_from_parent * node.parent_from_local;
        if !world_from_local.is_finite() {
            return Err(PrepareError::Transform { node: index });
        }
        let mesh = node.mesh.filter(|_| node.instances.is_empty());
        let parent_from_local = node.parent_from_local;
        placed.push(Placed { parent, source_node: index, instance: None, parent_from_local, world_from_local, mesh });
        for (i, instance) in node.instances.iter().enumerate() {
            let world_from_local = world_from_local * *instance;
            if !world_from_local.is_finite() {
                return Err(PrepareError::Transform { node: index });
            }
            let instance_index = Some(i as u32);
            placed.push(Placed {
                parent: Some(id),
                source_node: index,
                instance: instance_index,
                parent_from_local: *instance,
                world_from_local,
                mesh: node.mesh,
            });
        }
        open.extend(node.children.iter().rev().map(|c| (*c, Some(id))));
    }
    Ok(placed)
}

/// Empties the meshes that no object shows: dividing them would cost time and put chunks into the package that nobody asks for.
fn drop_unplaced(meshes: &mut [SourceMesh], placed: &[Placed]) {
    let mut is_placed = vec![false; meshes.len()];
    placed.iter().filter_map(|o| o.mesh).for_each(|mesh| is_placed[mesh as usize] = true);
    meshes.iter_mut().zip(is_placed).filter(|(_, placed)| !placed).for_each(|(mesh, _)| mesh.primitives = Vec::new());
}

/// The longest edge that stays whole in each mesh's local space, where its largest instance has `limit_m` metres.
fn local_limits(limit_m: f64, placed: &[Placed], meshes: usize) -> Vec<f32> {
    let mut largest = vec![0.0f64; meshes];
    for object in placed {
        if let Some(mesh) = object.mesh {
            let m = object.world_from_local.matrix3;
            let scale = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
            largest[mesh as usize] = largest[mesh as usize].max(scale);
        }
    }
    largest.iter().map(|scale| (limit_m / scale) as f32).collect()
}

fn divide_mesh(
    mut mesh: SourceMesh,
    longest_edge: f32,
    cuts_left: &AtomicU64,
    options: &PrepareOptions,
) -> Result<(SourceMesh, Vec<Division>), TooManyAdded> {
    let max_triangles = options.max_leaf_triangles.clamp(1, super::MAX_LEAF_TRIANGLES);
    let divisions = mesh
        .primitives
        .iter_mut()
        .map(|primitive| {
            let from = if longest_edge.is_finite() { refine::refine(primitive, longest_edge, cuts_left)? } else { None };
            let mut division = divide(primitive, max_triangles);
            if let Some(from) = from {
                for piece in &mut division.pieces {
                    for triangle in &mut piece.triangles {
                        *triangle = from[*triangle as usize];
                    }
                    piece.triangles.dedup();
                }
            }
            // Only what names the source stays; the vertices are in the pieces now.
            *primitive = gltf::SourcePrimitive {
                gltf_primitive: primitive.gltf_primitive,
                positions: Vec::new(),
                normals: None,
                uvs: None,
                colors: None,
                indices: Vec::new(),
                material: primitive.material,
            };
            Ok(division)
        })
        .collect::<Result<_, _>>()?;
    Ok((mesh, divisions))
}

/// A mesh as runs of pieces, one for each primitive that has triangles.
struct DividedMesh {
    parts: Vec<DividedPrimitive>,
}

struct DividedPrimitive {
    first_piece: u32,
    tree: Tree,
}

/// What is known of each piece.
#[derive(Default)]
struct PieceTable {
    pieces: Vec<PieceRecord>,
    piece_ends: Vec<u32>,
    triangles: Vec<u32>,
}

struct PieceRecord {
    chunk: ChunkId,
    material: MaterialId,
    triangle_count: u32,
    local: (Vec3, Vec3),
    mesh: u32,
    primitive: u32,
}

impl PieceTable {
    fn take(
        &mut self,
        mesh: &SourceMesh,
        divisions: Vec<Division>,
        default_material: usize,
        chunks: &mut ChunkTable,
    ) -> DividedMesh {
        let mut parts = Vec::new();
        for (primitive, division) in mesh.primitives.iter().zip(divisions) {
            if division.pieces.is_empty() {
                continue;
            }
            parts.push(DividedPrimitive { first_piece: self.pieces.len() as u32, tree: division.tree });
            for Piece { triangles, bytes, local } in division.pieces {
                let triangle_count = GeometryChunk::triangle_count(&bytes);
                let material = MaterialId(primitive.material.map_or(default_material as u32, |m| m));
                let chunk = chunks.add(&bytes, ChunkKind::Geometry);
                let (mesh, primitive) = (mesh.gltf_mesh, primitive.gltf_primitive);
                self.pieces.push(PieceRecord { chunk, material, triangle_count, local, mesh, primitive });
                self.triangles.extend(triangles);
                self.piece_ends.push(self.triangles.len() as u32);
            }
        }
        DividedMesh { parts }
    }

    fn record(&self, leaf: &LeafDraft) -> LeafRecord {
        let piece = &self.pieces[leaf.piece as usize];
        LeafRecord {
            object: ObjectId(leaf.object),
            chunk: piece.chunk,
            material: piece.material,
            triangle_count: piece.triangle_count,
            local_min: piece.local.0.to_array(),
            local_max: piece.local.1.to_array(),
        }
    }

    fn source(&self, leaf: &LeafDraft) -> LeafSource {
        let piece = &self.pieces[leaf.piece as usize];
        LeafSource { mesh: piece.mesh, primitive: piece.primitive, piece: leaf.piece }
    }
}

/// A leaf before it has its number.
struct LeafDraft {
    object: u32,
    piece: u32,
}

/// The leaves of all objects, in the objects' order; within an object by primitive and piece.
fn draft_leaves(placed: &[Placed], divided: &[DividedMesh]) -> Result<Vec<LeafDraft>, PrepareError> {
    let mut leaves = Vec::new();
    for (object, mesh) in placed.iter().enumerate().filter_map(|(i, o)| Some((i as u32, o.mesh?))) {
        for part in &divided[mesh as usize].parts {
            let count = part.tree.nodes[0].item_count;
            leaves.extend((0..count).map(|i| LeafDraft { object, piece: part.first_piece + i }));
        }
        if leaves.len() as u64 > MAX_LEAVES {
            return Err(PrepareError::TooMany { what: "leaves", cap: MAX_LEAVES });
        }
    }
    Ok(leaves)
}

fn leaf_bounds(
    leaves: &[LeafDraft],
    placed: &[Placed],
    table: &PieceTable,
    chunks: &ChunkTable,
    progress: ProgressFn<'_>,
) -> Vec<Obb> {
    const LEAVES_AT_A_TIME: usize = 1 << 14;
    let mut bounds = Vec::with_capacity(leaves.len());
    for batch in leaves.chunks(LEAVES_AT_A_TIME) {
        bounds.par_extend(batch.par_iter().map(|leaf| {
            let piece = &table.pieces[leaf.piece as usize];
            let positions = GeometryChunk::positions(chunks.bytes(piece.chunk));
            world_bound(&positions, piece.local, &placed[leaf.object as usize].world_from_local)
        }));
        progress("fitting boxes", bounds.len() as u64, leaves.len() as u64);
    }
    bounds
}

/// The oriented box of a leaf in the world, grown by the rounding of `clip_from_local` on the GPU.
pub(super) fn world_bound(positions: &[[f32; 3]], local: (Vec3, Vec3), world_from_local: &DAffine3) -> Obb {
    let world = positions.iter().map(|p| world_from_local.transform_point3(Vec3::from(*p).as_dvec3()));
    let bound = Obb::around(world).unwrap_or(Obb::of_point(world_from_local.translation));
    let local = Aabb { min: local.0.as_dvec3(), max: local.1.as_dvec3() };
    bound.grown(local.rounding_m(axis_lengths(&world_from_local.matrix3)))
}

/// A hierarchy, and the drafts of its leaves in order.
type Numbered = (ObjectHierarchy, Vec<u32>);

/// The tree that the cull will walk: as the file groups its objects, or built anew where that grouping would be visited more: by
/// floor, by material, in chains.
fn choose_hierarchy(of_file: Numbered, bounds: &[Obb]) -> Result<Numbered, PrepareError> {
    let regrouped = numbered(hierarchy_over(bounds))?;
    let cost_m2 = |(hierarchy, _): &Numbered| WideTree::new(hierarchy).cost_m2();
    Ok(if cost_m2(&of_file) <= cost_m2(&regrouped) { of_file } else { regrouped })
}

fn numbered((nodes, order): (Vec<OhNode>, Vec<u32>)) -> Result<Numbered, PrepareError> {
    Ok((ObjectHierarchy::new(nodes).map_err(|e| package_error(e.into()))?, order))
}

/// The hierarchy as the file groups its objects.
fn file_hierarchy(
    placed: &[Placed],
    divided: &[DividedMesh],
    leaves: &[LeafDraft],
    bounds: &[Obb],
) -> Result<Numbered, PrepareError> {
    let mut builder = HierarchyBuilder::default();
    let mut below: Vec<Vec<DraftId>> = (0..placed.len()).map(|_| Vec::new()).collect();
    let mut roots = Vec::new();
    let mut leaf_end = leaves.len();
    for (id, object) in placed.iter().enumerate().rev() {
        let leaf_start = leaves[..leaf_end].partition_point(|leaf| leaf.object < id as u32);
        let mut own = Vec::new();
        let mut next = leaf_start;
        for part in object.mesh.iter().flat_map(|mesh| &divided[*mesh as usize].parts) {
            let count = part.tree.nodes[0].item_count as usize;
            let items: Vec<DraftId> = (next..next + count).map(|i| builder.leaf(i as u32, bounds[i])).collect();
            own.push(builder.tree(&part.tree.nodes, &items));
            next += count;
        }
        debug_assert_eq!(next, leaf_end);
        leaf_end = leaf_start;
        let mut children = std::mem::take(&mut below[id]);
        children.reverse(); // they came last to first
        if let Some(node) = builder.object(own, children) {
            object.parent.map_or(&mut roots, |p| &mut below[p as usize]).push(node);
        }
    }
    roots.reverse();
    let root = builder.root(roots);
    numbered(builder.finish(root))
}

/// Objects with their names and the leaves of their subtrees.
fn name_objects(placed: Vec<Placed>, nodes: &[gltf::SourceNode], leaves: &[LeafRecord]) -> Vec<Object> {
    let mut own: Vec<Vec<LeafRange>> = (0..placed.len()).map(|_| Vec::new()).collect();
    for (leaf, record) in leaves.iter().enumerate() {
        push_range(&mut own[record.object.0 as usize], LeafRange::new(leaf as u32, leaf as u32 + 1));
    }
    for id in (0..placed.len()).rev() {
        own[id].sort_unstable();
        let mut merged: Vec<LeafRange> = Vec::new();
        std::mem::take(&mut own[id]).into_iter().for_each(|range| push_range(&mut merged, range));
        if let Some(parent) = placed[id].parent {
            own[parent as usize].extend(&merged);
        }
        own[id] = merged;
    }
    placed
        .into_iter()
        .zip(own)
        .map(|(object, leaves)| Object {
            parent: object.parent.map(ObjectId),
            name: nodes[object.source_node as usize].name.clone().unwrap_or_default(),
            source_node: object.source_node,
            instance: object.instance,
            parent_from_local: object.parent_from_local,
            leaves,
        })
        .collect()
}

/// Appends a range that starts at or after the end of the last one.
pub(super) fn push_range(ranges: &mut Vec<LeafRange>, range: LeafRange) {
    match ranges.last_mut() {
        Some(last) if last.end == range.start => last.end = range.end,
        _ => ranges.push(range),
    }
}

/// The file's materials, and the default one last.
fn convert_materials(materials: &[gltf::SourceMaterial], images: &[SourceImage], chunks: &mut ChunkTable) -> Vec<Material> {
    let mut textures: Vec<Option<ChunkId>> = vec![None; images.len()];
    let mut texture = |image: u32, chunks: &mut ChunkTable| {
        *textures[image as usize].get_or_insert_with(|| match &images[image as usize] {
            SourceImage::Encoded { bytes, .. } => chunks.add(bytes, ChunkKind::Texture),
            SourceImage::Missing { .. } => chunks.add(&stand_in_png(), ChunkKind::Texture),
        })
    };
    let wrap = |w: gltf::Wrap| match w {
        gltf::Wrap::Repeat => Wrap::Repeat,
        gltf::Wrap::Mirror => Wrap::Mirror,
        gltf::Wrap::Clamp => Wrap::Clamp,
    };
    let filter = |f: gltf::Filter| match f {
        gltf::Filter::Nearest => Filter::Nearest,
        gltf::Filter::Linear => Filter::Linear,
    };
    let mut converted: Vec<Material> = materials
        .iter()
        .map(|m| Material {
            base_color: m.base_color,
            texture: m.texture.as_ref().map(|t| TextureRef {
                chunk: texture(t.image, chunks),
                wrap_u: wrap(t.wrap_u),
                wrap_v: wrap(t.wrap_v),
                filter: filter(t.filter),
            }),
            alpha: match m.alpha {
                SourceAlpha::Opaque => AlphaMode::Opaque,
                SourceAlpha::Mask { cutoff } => AlphaMode::Mask { cutoff },
                SourceAlpha::Blend => AlphaMode::Blend,
            },
            double_sided: m.double_sided,
        })
        .collect();
    converted.push(Material { base_color: [1.0; 4], texture: None, alpha: AlphaMode::Opaque, double_sided: false });
    converted
}

/// What is drawn where a texture is missing: a magenta and grey checker, hard to overlook.
fn stand_in_png() -> Vec<u8> {
    const SIZE_PX: u32 = 64;
    const SQUARE_PX: u32 = 8;
    let checker = image::RgbImage::from_fn(SIZE_PX, SIZE_PX, |x, y| {
        if (x / SQUARE_PX + y / SQUARE_PX).is_multiple_of(2) { image::Rgb([255, 0, 255]) } else { image::Rgb([96, 96, 96]) }
    });
    let mut png = Vec::new();
    // Encoding a small picture into memory does not fail; an empty chunk would be drawn as untextured.
    let _ = checker.write_to(&mut Cursor::new(&mut png), image::ImageFormat::Png);
    png
}
