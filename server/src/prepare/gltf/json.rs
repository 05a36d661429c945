//! The glTF 2.0 JSON as it is written, read with serde.
//!
//! Enumerations stay numbers and strings here, and references stay integers: the modules that use a
//! value check it, so that each fault can name its place. The `gltf` crate's own JSON model was
//! tried first: it refuses integers written as `1.0`, which are valid, and truncates large enum values
//! to 32 bits, which makes some invalid ones pass.
use super::error::{Fault, one_line};
use serde::de::{self, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, de::IgnoredAny};
use std::borrow::Cow;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

/// Most bytes that what the JSON lists may take, whatever its size.
pub const MAX_LISTED_BYTES: u64 = 8 << 30;
/// Bytes granted to what the JSON lists, however short it is.
pub const LISTED_BYTES_FLOOR: u64 = 256 << 20;
/// Bytes granted to what the JSON lists per byte of JSON: `{}` is a node of hundreds of bytes, but honest ones have a
/// mesh, a name, a place.
pub const LISTED_BYTES_PER_JSON_BYTE: u64 = 32;
/// An entry is charged so many times its size: for itself, for what it becomes, and for what is said about it.
const COPIES: u64 = 3;
/// What a map of names takes at least: a tree's leaf has room for eleven.
const MAP_BYTES: u64 = 11 * (size_of::<String>() + size_of::<Int>()) as u64 + 16;
/// What one more name takes: leaves may be half full, and the shortest text takes an allocation.
const MAP_ENTRY_BYTES: u64 = 2 * (size_of::<String>() + size_of::<Int>()) as u64 + 32;

thread_local! {
    /// What the lists of the file that this thread reads may still take. Serde's derived code has no place to hand a
    /// budget down, and it calls back on the thread that called it.
    static LISTED_BYTES_LEFT: Cell<u64> = const { Cell::new(0) };
}

/// Reads a file's JSON. The entries of all its lists and maps together, each charged some times its size, stay below
/// [`LISTED_BYTES_FLOOR`] plus [`LISTED_BYTES_PER_JSON_BYTE`] times its length; strings take no more than a few
/// times their length.
pub(super) fn read(json: &[u8]) -> Result<Root<'_>, Fault> {
    let limit = LISTED_BYTES_FLOOR.saturating_add((json.len() as u64).saturating_mul(LISTED_BYTES_PER_JSON_BYTE));
    LISTED_BYTES_LEFT.set(limit.min(MAX_LISTED_BYTES));
    serde_json::from_slice(json).map_err(|e| Fault::Json(one_line(e)))
}

fn charge<E: de::Error>(bytes: u64) -> Result<(), E> {
    let left = LISTED_BYTES_LEFT.get().checked_sub(bytes);
    let left = left.ok_or_else(|| E::custom("its lists take more memory than its length justifies (LISTED_BYTES)"))?;
    LISTED_BYTES_LEFT.set(left);
    Ok(())
}

/// A non-negative integer; `3`, `3.0` and `30e-1` are the same number in JSON.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(super) struct Int(pub u64);

/// An array, its entries charged.
#[derive(Debug)]
pub(super) struct List<T>(pub Vec<T>);

/// Numbers by name, the entries charged.
#[derive(Debug, Default)]
pub(super) struct Named(BTreeMap<String, Int>);

/// A string that borrows from the file where it has no escapes: data URIs are large.
#[derive(Deserialize, Debug)]
pub(super) struct Text<'a>(#[serde(borrow)] pub Cow<'a, str>);

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Root<'a> {
    pub asset: Option<Asset>,
    #[serde(default)]
    pub extensions_used: List<String>,
    #[serde(default)]
    pub extensions_required: List<String>,
    pub scene: Option<Int>,
    #[serde(default)]
    pub scenes: List<Scene>,
    #[serde(default)]
    pub nodes: List<Node>,
    #[serde(default)]
    pub meshes: List<Mesh>,
    #[serde(default)]
    pub skins: List<Skin>,
    #[serde(default)]
    pub cameras: List<IgnoredAny>,
    #[serde(default)]
    pub accessors: List<Accessor>,
    #[serde(default)]
    pub buffer_views: List<BufferView>,
    #[serde(default, borrow)]
    pub buffers: List<Buffer<'a>>,
    #[serde(default)]
    pub materials: List<Material>,
    #[serde(default)]
    pub textures: List<Texture>,
    #[serde(default)]
    pub samplers: List<Sampler>,
    #[serde(default, borrow)]
    pub images: List<Image<'a>>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Asset {
    pub version: Option<String>,
    pub min_version: Option<String>,
}

#[derive(Deserialize, Debug)]
pub(super) struct Scene {
    #[serde(default)]
    pub nodes: List<Int>,
}

#[derive(Deserialize, Debug)]
pub(super) struct Node {
    pub name: Option<String>,
    #[serde(default)]
    pub children: List<Int>,
    pub matrix: Option<Box<[f64; 16]>>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
    pub mesh: Option<Int>,
    pub skin: Option<Int>,
    pub camera: Option<Int>,
    pub weights: Option<List<f64>>,
    pub extensions: Option<Box<NodeExtensions>>,
}

#[derive(Deserialize, Debug)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Option<Instancing>,
}

#[derive(Deserialize, Debug)]
pub(super) struct Instancing {
    #[serde(default)]
    pub attributes: Named,
}

#[derive(Deserialize, Debug)]
pub(super) struct Mesh {
    pub name: Option<String>,
    #[serde(default)]
    pub primitives: List<Primitive>,
    pub weights: Option<List<f64>>,
}

#[derive(Deserialize, Debug)]
pub(super) struct Primitive {
    #[serde(default)]
    pub attributes: Named,
    pub indices: Option<Int>,
    pub material: Option<Int>,
    pub mode: Option<Int>,
    #[serde(default)]
    pub targets: List<Named>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Skin {
    pub inverse_bind_matrices: Option<Int>,
    #[serde(default)]
    pub joints: List<Int>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<Int>,
    #[serde(default)]
    pub byte_offset: Int,
    pub component_type: Option<Int>,
    #[serde(default)]
    pub normalized: bool,
    pub count: Option<Int>,
    #[serde(rename = "type")]
    pub shape: Option<String>,
    pub sparse: Option<Box<Sparse>>,
}

#[derive(Deserialize, Debug)]
pub(super) struct Sparse {
    pub count: Int,
    pub indices: SparseIndices,
    pub values: SparseValues,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub buffer_view: Int,
    #[serde(default)]
    pub byte_offset: Int,
    pub component_type: Int,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub buffer_view: Int,
    #[serde(default)]
    pub byte_offset: Int,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub buffer: Option<Int>,
    #[serde(default)]
    pub byte_offset: Int,
    pub byte_length: Option<Int>,
    pub byte_stride: Option<Int>,
    pub extensions: Option<Box<ViewExtensions>>,
}

#[derive(Deserialize, Debug)]
pub(super) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression", alias = "KHR_meshopt_compression")]
    pub meshopt: Option<Meshopt>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Meshopt {
    pub buffer: Int,
    #[serde(default)]
    pub byte_offset: Int,
    pub byte_length: Int,
    pub byte_stride: Int,
    pub count: Int,
    pub mode: String,
    pub filter: Option<String>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer<'a> {
    pub byte_length: Option<Int>,
    #[serde(borrow)]
    pub uri: Option<Text<'a>>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Image<'a> {
    #[serde(borrow)]
    pub uri: Option<Text<'a>>,
    pub mime_type: Option<String>,
    pub buffer_view: Option<Int>,
}

#[derive(Deserialize, Debug)]
pub(super) struct Texture {
    pub source: Option<Int>,
    pub sampler: Option<Int>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Sampler {
    pub mag_filter: Option<Int>,
    pub wrap_s: Option<Int>,
    pub wrap_t: Option<Int>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    pub name: Option<String>,
    pub pbr_metallic_roughness: Option<Pbr>,
    pub alpha_mode: Option<String>,
    pub alpha_cutoff: Option<f64>,
    #[serde(default)]
    pub double_sided: bool,
    pub extensions: Option<MaterialExtensions>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct Pbr {
    pub base_color_factor: Option<[f64; 4]>,
    pub base_color_texture: Option<TextureInfo>,
}

#[derive(Deserialize, Debug)]
pub(super) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    pub specular_glossiness: Option<SpecularGlossiness>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct SpecularGlossiness {
    pub diffuse_factor: Option<[f64; 4]>,
    pub diffuse_texture: Option<TextureInfo>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureInfo {
    pub index: Int,
    #[serde(default)]
    pub tex_coord: Int,
    pub extensions: Option<TextureInfoExtensions>,
}

#[derive(Deserialize, Debug)]
pub(super) struct TextureInfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub transform: Option<TextureTransform>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureTransform {
    pub offset: Option<[f64; 2]>,
    pub rotation: Option<f64>,
    pub scale: Option<[f64; 2]>,
    pub tex_coord: Option<Int>,
}

impl<'de> Deserialize<'de> for Int {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct IntVisitor;
        impl Visitor<'_> for IntVisitor {
            type Value = Int;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a non-negative integer")
            }
            fn visit_u64<E: de::Error>(self, value: u64) -> Result<Int, E> {
                Ok(Int(value))
            }
            fn visit_f64<E: de::Error>(self, value: f64) -> Result<Int, E> {
                const EXACT: f64 = (1u64 << 53) as f64;
                if (0.0..=EXACT).contains(&value) && value.fract() == 0.0 {
                    Ok(Int(value as u64))
                } else {
                    Err(E::invalid_value(de::Unexpected::Float(value), &self))
                }
            }
        }
        deserializer.deserialize_u64(IntVisitor)
    }
}

impl<T> Default for List<T> {
    fn default() -> Self {
        List(Vec::new())
    }
}

impl<T> std::ops::Deref for List<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        &self.0
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for List<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ListVisitor<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for ListVisitor<T> {
            type Value = List<T>;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("an array")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> Result<List<T>, A::Error> {
                let mut items = Vec::new();
                while let Some(item) = sequence.next_element()? {
                    charge(size_of::<T>() as u64 * COPIES)?;
                    items.push(item);
                }
                // A vector of one has room for four, and most lists are short.
                items.shrink_to_fit();
                Ok(List(items))
            }
        }
        deserializer.deserialize_seq(ListVisitor(PhantomData))
    }
}

impl std::ops::Deref for Named {
    type Target = BTreeMap<String, Int>;
    fn deref(&self) -> &BTreeMap<String, Int> {
        &self.0
    }
}

impl<'de> Deserialize<'de> for Named {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NamedVisitor;
        impl<'de> Visitor<'de> for NamedVisitor {
            type Value = Named;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("an object of integers")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Named, A::Error> {
                let mut entries = BTreeMap::new();
                while let Some((name, value)) = map.next_entry()? {
                    charge(if entries.is_empty() { MAP_BYTES } else { MAP_ENTRY_BYTES })?;
                    entries.insert(name, value);
                }
                Ok(Named(entries))
            }
        }
        deserializer.deserialize_map(NamedVisitor)
    }
}
