//! glTF and GLB files in, a checked [`SourceScene`] out.
//!
//! Everything here assumes a hostile file: each count, offset and reference is checked with the JSON
//! value in hand before memory is taken or an index is used, nothing recurses on the file's structure,
//! and every fault is one line that names the file, the object and the reason. What is merely not
//! drawable (points, lines, cameras, missing pictures) is a warning.
mod accessor;
mod container;
mod error;
mod image;
mod instancing;
mod json;
mod material;
mod meshopt;
mod nodes;
mod primitive;
mod skin;
mod uri;
mod validate;

pub use accessor::{MAX_ACCESSOR_ELEMENTS, MAX_ZERO_FILLED_ELEMENTS};
pub use container::{MAX_FILE_BYTES, MAX_JSON_BYTES};
pub use error::{ImportError, ImportErrorKind};
pub use image::{MAX_IMAGE_DECODE_BYTES, MAX_IMAGE_FILE_BYTES, MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE_PX, MAX_IMAGE_TOTAL_BYTES};
pub use instancing::{MAX_INSTANCES, MAX_ZERO_FILLED_INSTANCES};
pub use json::{LISTED_BYTES_FLOOR, LISTED_BYTES_PER_JSON_BYTE, MAX_LISTED_BYTES};
pub use nodes::MAX_NODE_DEPTH;
pub use validate::{DECODED_BYTES_FLOOR, DECODED_BYTES_PER_FILE_BYTE, MAX_DECODED_BYTES};

use self::container::Container;
use self::error::{Fault, one_line, over_cap};
use self::image::ImageTable;
use self::material::UvSource;
use self::validate::Asset;
use super::ProgressFn;
use glam::{DAffine3, Vec2, Vec3};
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Most triangles of a scene, every instance counted: triangle and leaf numbers are 32 bits.
pub const MAX_INSTANCED_TRIANGLES: u64 = u32::MAX as u64;
/// Largest coordinate of a vertex, in its mesh and in the world: products and squares of it stay within `f32`.
pub const MAX_COORDINATE: f64 = 1e12;
/// Most warnings kept; the rest are counted in a last one.
pub const MAX_WARNINGS: usize = 100;

/// A scene as its file has it, checked: every index is in range, every number finite, the nodes a forest.
#[derive(Debug, Default)]
pub struct SourceScene {
    /// Nodes in glTF order.
    pub nodes: Vec<SourceNode>,
    /// The nodes to draw from: of the default scene, else of scene 0, else all without a parent.
    pub roots: Vec<u32>,
    /// Meshes in glTF order; behind them meshes baked for nodes with a skin or morph weights.
    pub meshes: Vec<SourceMesh>,
    /// Materials in glTF order.
    pub materials: Vec<SourceMaterial>,
    /// The pictures that base colour textures use, each once: glTF images of one file, data URI or view are one.
    pub images: Vec<SourceImage>,
    /// What was left out or replaced, one line each.
    pub warnings: Vec<String>,
}

/// A glTF node.
#[derive(Debug, Clone)]
pub struct SourceNode {
    /// The node's name in the file.
    pub name: Option<String>,
    /// Its parent, if it has one.
    pub parent: Option<u32>,
    /// Its children, in the file's order.
    pub children: Vec<u32>,
    /// Its transform; finite, perhaps mirrored or singular.
    pub parent_from_local: DAffine3,
    /// Its mesh, an index into [`SourceScene::meshes`].
    pub mesh: Option<u32>,
    /// `local_from_instance` for each instance of the mesh (`EXT_mesh_gpu_instancing`): an instance lies at
    /// `world_from_node * local_from_instance`. Empty: the mesh once, at the node itself.
    pub instances: Vec<DAffine3>,
}

/// A mesh, in the space of the node that uses it.
#[derive(Debug, Clone)]
pub struct SourceMesh {
    /// The mesh's name in the file.
    pub name: Option<String>,
    /// The glTF mesh it comes from.
    pub gltf_mesh: u32,
    /// Its primitives that consist of triangles; may be empty.
    pub primitives: Vec<SourcePrimitive>,
}

/// A list of triangles with one material.
#[derive(Debug, Clone)]
pub struct SourcePrimitive {
    /// Its index within the glTF mesh.
    pub gltf_primitive: u32,
    /// Positions, finite, morph targets and skin applied.
    pub positions: Vec<Vec3>,
    /// Normals, one a position; not necessarily of unit length.
    pub normals: Option<Vec<Vec3>>,
    /// Coordinates of the base colour texture, `KHR_texture_transform` applied; `None` without such a texture.
    pub uvs: Option<Vec<Vec2>>,
    /// `COLOR_0`, linear.
    pub colors: Option<Vec<[u8; 4]>>,
    /// Three a triangle, counterclockwise; triangle `k` of the list is source triangle `k`.
    pub indices: Vec<u32>,
    /// Its material, an index into [`SourceScene::materials`]; `None` is glTF's default, opaque white.
    pub material: Option<u32>,
}

/// What the tiles draw of a glTF material.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceMaterial {
    /// The material's name in the file.
    pub name: Option<String>,
    /// Base colour factor, linear, 0 to 1.
    pub base_color: [f32; 4],
    /// Base colour texture.
    pub texture: Option<SourceTexture>,
    /// How alpha is used.
    pub alpha: SourceAlpha,
    /// Whether back faces are drawn.
    pub double_sided: bool,
}

/// An image and how it is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SourceTexture {
    /// An index into [`SourceScene::images`].
    pub image: u32,
    /// Outside 0 to 1 along u.
    pub wrap_u: Wrap,
    /// Outside 0 to 1 along v.
    pub wrap_v: Wrap,
    /// Magnification filter.
    pub filter: Filter,
}

/// glTF's alpha modes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SourceAlpha {
    /// Alpha is ignored.
    Opaque,
    /// Drawn where alpha is at least the cutoff.
    Mask {
        /// Smallest alpha that is drawn.
        cutoff: f32,
    },
    /// Blended over what lies behind.
    Blend,
}

/// What a texture shows outside 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// Itself again.
    Repeat,
    /// Itself again, every second time mirrored.
    Mirror,
    /// The pixels at its edge.
    Clamp,
}

/// How a texture is magnified.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// The nearest pixel.
    Nearest,
    /// Between the four nearest.
    Linear,
}

/// The picture formats that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageKind {
    /// PNG.
    Png,
    /// JPEG.
    Jpeg,
}

/// A picture, or the reason why there is none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SourceImage {
    /// A picture as the file has it; it has been decoded once, and will decode again.
    Encoded {
        /// The encoded bytes.
        bytes: Vec<u8>,
        /// Their format, by their first bytes.
        mime: ImageKind,
        /// Width in pixels, at most [`MAX_IMAGE_SIDE_PX`].
        width: u32,
        /// Height in pixels, at most [`MAX_IMAGE_SIDE_PX`].
        height: u32,
    },
    /// Missing, damaged, of another format or too large: draw a stand-in.
    Missing {
        /// One line; also among the warnings.
        why: String,
    },
}

/// Reads and checks the glTF or GLB file at `path`.
///
/// External buffers and images are read from `path`'s folder only. Each is read once, however often
/// it is named. Memory stays below [`MAX_LISTED_BYTES`] plus [`MAX_DECODED_BYTES`] plus the files' own size; for
/// small files below the two floors plus [`LISTED_BYTES_PER_JSON_BYTE`] times the JSON and
/// [`DECODED_BYTES_PER_FILE_BYTE`] times all files.
///
/// # Errors
/// Any breach of glTF 2.0 that would make the scene wrong or its reading unsafe, any required extension
/// that is not read, any cap exceeded: one line in the error's `Display`.
pub fn load(path: &Path, progress: ProgressFn<'_>) -> Result<SourceScene, ImportError> {
    load_scene(path, progress).map_err(|kind| ImportError { file: one_line(path.display()), kind })
}

fn load_scene(path: &Path, progress: ProgressFn<'_>) -> Result<SourceScene, Fault> {
    progress("reading", 0, 1);
    let mut container = Container::read(path)?;
    let mut warnings = std::mem::take(&mut container.warnings);
    let json = json::read(container.json())?;
    validate::asset_header(&json, &mut warnings)?;
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let buffers = validate::load_buffers(&json, &container, folder)?;
    let asset = Asset::new(&json, &buffers)?;
    progress("reading", 1, 1);

    let mut forest = nodes::build(&asset, &mut warnings)?;
    let worlds = nodes::worlds(&forest)?;
    let mut table = ImageTable::new(&json, folder);
    let (materials, uvs) = material::read_all(&json, &mut table, &mut warnings)?;
    let mut image_warnings = Vec::new();
    let (meshes, images) = rayon::join(
        || decode_meshes(&asset, &uvs, progress, &mut warnings),
        || {
            image::load_all(&asset, &table, &mut image_warnings, |done, total| {
                progress("checking textures", done as u64, total as u64);
            })
        },
    );
    let (mut meshes, images) = (meshes?, images?);
    warnings.append(&mut image_warnings);
    skin::bake_all(&asset, &mut forest, &worlds, &uvs, &mut meshes, &mut warnings)?;

    let mut scene = SourceScene { nodes: forest.nodes, roots: forest.roots, meshes, materials, images, warnings };
    check_instanced_triangles(&scene)?;
    check_extent(&scene, &worlds)?;
    bound_warnings(&mut scene.warnings);
    Ok(scene)
}

/// All meshes, in parallel; warnings and the fault that is reported follow the file's order.
fn decode_meshes(
    asset: &Asset,
    uvs: &[Option<UvSource>],
    progress: ProgressFn<'_>,
    warnings: &mut Vec<String>,
) -> Result<Vec<SourceMesh>, Fault> {
    let total = asset.json.meshes.len() as u64;
    let done = AtomicU64::new(0);
    let decoded: Vec<_> = (0..asset.json.meshes.len())
        .into_par_iter()
        .map(|m| {
            let mut warnings = Vec::new();
            let mesh = primitive::decode_mesh(asset, uvs, m, None, &mut warnings);
            progress("decoding meshes", done.fetch_add(1, Ordering::Relaxed) + 1, total);
            mesh.map(|mesh| (mesh, warnings))
        })
        .collect();
    let mut meshes = Vec::with_capacity(decoded.len());
    for result in decoded {
        let (mesh, mut own) = result?;
        warnings.append(&mut own);
        meshes.push(mesh);
    }
    Ok(meshes)
}

fn check_instanced_triangles(scene: &SourceScene) -> Result<(), Fault> {
    let triangles: Vec<u64> = scene
        .meshes
        .iter()
        .map(|mesh| mesh.primitives.iter().map(|primitive| primitive.indices.len() as u64 / 3).sum())
        .collect();
    let mut total = 0u64;
    for (k, node) in scene.nodes.iter().enumerate() {
        let Some(mesh) = node.mesh else { continue };
        // No overflow: at most 2^24 instances, and meshes that are in memory.
        total = total.saturating_add(triangles[mesh as usize].saturating_mul(node.instances.len().max(1) as u64));
        if total > MAX_INSTANCED_TRIANGLES {
            let reason = "the triangles of all instances are too many";
            return Err(over_cap(format_args!("node {k}"), reason, "MAX_INSTANCED_TRIANGLES", MAX_INSTANCED_TRIANGLES));
        }
    }
    Ok(())
}

/// Finite is not enough: a scale of 1e308 would overflow in whatever multiplies it next.
fn check_extent(scene: &SourceScene, worlds: &[DAffine3]) -> Result<(), Fault> {
    let cap = |place: String, extent: f64| {
        let reason = format!("has vertices {extent:e} from the origin");
        over_cap(place, reason, "MAX_COORDINATE", MAX_COORDINATE as u64)
    };
    let mut reaches = Vec::with_capacity(scene.meshes.len());
    for mesh in &scene.meshes {
        let positions = mesh.primitives.iter().flat_map(|primitive| &primitive.positions);
        let reach = positions.fold(Vec3::ZERO, |most, position| most.max(position.abs())).as_dvec3();
        if reach.max_element() > MAX_COORDINATE {
            return Err(cap(format!("mesh {}", mesh.gltf_mesh), reach.max_element()));
        }
        reaches.push(reach);
    }
    for (k, (node, world)) in scene.nodes.iter().zip(worlds).enumerate() {
        let Some(mesh) = node.mesh else { continue };
        let once = [DAffine3::IDENTITY];
        let instances = if node.instances.is_empty() { &once[..] } else { &node.instances };
        for instance in instances {
            let world = *world * *instance;
            let extent = world.matrix3.abs() * reaches[mesh as usize] + world.translation.abs();
            // Written so that NaN fails.
            let inside = extent.max_element() <= MAX_COORDINATE && extent.is_finite();
            if !inside {
                return Err(cap(format!("node {k}"), extent.max_element()));
            }
        }
    }
    Ok(())
}

fn bound_warnings(warnings: &mut Vec<String>) {
    for warning in warnings.iter_mut() {
        *warning = one_line(&*warning);
    }
    if warnings.len() > MAX_WARNINGS {
        let more = warnings.len() - MAX_WARNINGS;
        warnings.truncate(MAX_WARNINGS);
        warnings.push(format!("and {more} more warnings"));
    }
}
