//! A builder of valid GLB 2.0 files: one buffer, one view for each kind of data, accessors into them.
//!
//! What there may be millions of (nodes, accessors, instances) is held as plain structs and written once.
use super::solid::Geometry;
use bytemuck::{NoUninit, bytes_of};
use glam::{Mat3, Quat, Vec2, Vec3};
use serde::Serialize;
use serde_json::{Value, json};
use std::io::{self, Write};

/// What was generated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GenerateReport {
    /// Triangles, every use of a mesh counted.
    pub triangles: u64,
    /// Nodes.
    pub nodes: u64,
    /// Uses of meshes: nodes that have one, and each instance of a node that has instances.
    pub objects: u64,
    /// Length of the file.
    pub bytes: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct TextureId(u32);
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct MaterialId(u32);
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct MeshId(u32);
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct NodeId(u32);

#[derive(Clone, Copy)]
pub enum Alpha {
    Opaque,
    Mask,
    Blend,
}

#[derive(Clone, Copy, PartialEq)]
pub enum Sides {
    One,
    Both,
}

/// Where a node stands in its parent.
#[derive(Clone, Copy)]
pub struct Place {
    pub translation: Vec3,
    pub rotation: Quat,
    pub scale: Vec3,
}

impl Place {
    pub fn at(translation: Vec3) -> Place {
        Place { translation, rotation: Quat::IDENTITY, scale: Vec3::ONE }
    }

    /// Turned about Y by `quarters` times 90 degrees.
    pub fn turned(translation: Vec3, quarters: usize) -> Place {
        let s = 0.5f32.sqrt();
        let (y, w) = [(0.0, 1.0), (s, s), (1.0, 0.0), (-s, s)][quarters % 4];
        Place { rotation: Quat::from_xyzw(0.0, y, 0.0, w), ..Place::at(translation) }
    }

    /// Turned about Y by an angle whose half has the tangent `half_tangent`.
    pub fn yawed(translation: Vec3, half_tangent: f32) -> Place {
        let w = 1.0 / (1.0 + half_tangent * half_tangent).sqrt();
        Place { rotation: Quat::from_xyzw(0.0, half_tangent * w, 0.0, w), ..Place::at(translation) }
    }

    /// +X and +Y of the node lie along `x` and `y`, unit vectors at right angles.
    pub fn facing(translation: Vec3, x: Vec3, y: Vec3) -> Place {
        Place { rotation: Quat::from_mat3(&Mat3::from_cols(x, y, x.cross(y))), ..Place::at(translation) }
    }

    /// From `from` to `to` along +X, +Y upwards as far as that goes; a mesh of one metre gets that length.
    pub fn between(from: Vec3, to: Vec3, [height, width]: [f32; 2]) -> Place {
        let along = (to - from).normalize();
        let side = along.cross(if along.y.abs() > 0.99 { Vec3::X } else { Vec3::Y }).normalize();
        let scale = Vec3::new((to - from).length(), height, width);
        Place { scale, ..Place::facing(from, along, side.cross(along)) }
    }

    pub fn scaled(self, scale: Vec3) -> Place {
        Place { scale, ..self }
    }
}

/// One use of a mesh by `EXT_mesh_gpu_instancing`: its place in its node.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Instance {
    pub translation: [f32; 3],
    /// A quaternion x, y, z, w, normalized 16-bit integers: half the room of floats, and within 0.01° of them.
    pub rotation: [i16; 4],
    pub scale: [f32; 3],
}

/// What an [`Instance`] takes in the file.
pub const INSTANCE_BYTES: usize = size_of::<Instance>();

#[derive(Serialize)]
struct Node {
    #[serde(skip_serializing_if = "String::is_empty")]
    name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh: Option<u32>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    children: Vec<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    translation: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rotation: Option<[f32; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scale: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    extensions: Option<NodeExtensions>,
}

#[derive(Serialize)]
struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    instancing: Instancing,
}

#[derive(Serialize)]
struct Instancing {
    attributes: InstanceAttributes,
}

#[derive(Serialize)]
#[serde(rename_all = "UPPERCASE")]
struct InstanceAttributes {
    translation: u32,
    rotation: u32,
    scale: u32,
}

#[derive(Serialize, Clone, Copy)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    /// Kind of the data until [`GlbWriter::finish`] numbers the views.
    buffer_view: usize,
    byte_offset: usize,
    component_type: u32,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    normalized: bool,
    count: usize,
    #[serde(rename = "type")]
    shape: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    min: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max: Option<[f32; 3]>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Root {
    asset: Value,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    extensions_used: Vec<&'static str>,
    scene: u32,
    scenes: Value,
    nodes: Vec<Node>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<Value>,
    buffers: Value,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    images: Vec<Value>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    textures: Vec<Value>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    samplers: Vec<Value>,
}

/// The buffer views, in the order in which they lie in the file; all start at multiples of four bytes.
const POSITIONS: usize = 0;
const NORMALS: usize = 1;
const UVS: usize = 2;
const COLORS: usize = 3;
const INDICES_U32: usize = 4;
const INDICES_U16: usize = 5;
const TRANSLATIONS: usize = 6;
const ROTATIONS: usize = 7;
const SCALES: usize = 8;
const KINDS: usize = 9;

/// `byteStride` where the data is vertex attributes.
const STRIDES: [Option<u32>; KINDS] = [Some(12), Some(12), Some(8), Some(4), None, None, None, None, None];

/// Component types of glTF.
const U8: u32 = 5121;
const I16: u32 = 5122;
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;

#[derive(Default)]
pub struct GlbWriter {
    data: [Vec<u8>; KINDS],
    images: Vec<Vec<u8>>,
    accessors: Vec<Accessor>,
    materials: Vec<Value>,
    textures: Vec<Value>,
    meshes: Vec<Value>,
    mesh_triangles: Vec<u64>,
    nodes: Vec<Node>,
    roots: Vec<u32>,
    triangles: u64,
    objects: u64,
}

impl GlbWriter {
    /// A texture that repeats, from PNG bytes.
    pub fn texture(&mut self, png: Vec<u8>) -> TextureId {
        self.textures.push(json!({ "source": self.images.len(), "sampler": 0 }));
        self.images.push(png);
        TextureId(self.textures.len() as u32 - 1)
    }

    /// A material; `color` is linear.
    pub fn material(
        &mut self,
        name: &str,
        color: [f32; 4],
        texture: Option<TextureId>,
        alpha: Alpha,
        sides: Sides,
    ) -> MaterialId {
        let mut pbr = json!({ "baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 0.9 });
        if let Some(TextureId(texture)) = texture {
            pbr["baseColorTexture"] = json!({ "index": texture });
        }
        let mut material = json!({ "name": name, "pbrMetallicRoughness": pbr });
        match alpha {
            Alpha::Opaque => {}
            Alpha::Mask => material["alphaMode"] = json!("MASK"),
            Alpha::Blend => material["alphaMode"] = json!("BLEND"),
        }
        if sides == Sides::Both {
            material["doubleSided"] = json!(true);
        }
        self.materials.push(material);
        MaterialId(self.materials.len() as u32 - 1)
    }

    /// A mesh of the given parts; parts without triangles are left out.
    pub fn mesh(&mut self, name: &str, parts: &[(&Geometry, MaterialId)]) -> MeshId {
        let mut primitives = Vec::new();
        let mut triangles = 0;
        for (geometry, MaterialId(material)) in parts.iter().filter(|(geometry, _)| geometry.triangles() > 0) {
            triangles += geometry.triangles() as u64;
            primitives.push(self.primitive(geometry, *material));
        }
        assert!(!primitives.is_empty(), "mesh {name} has no triangles: glTF allows no such mesh");
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        self.mesh_triangles.push(triangles);
        MeshId(self.meshes.len() as u32 - 1)
    }

    pub fn triangles_of(&self, mesh: MeshId) -> usize {
        self.mesh_triangles[mesh.0 as usize] as usize
    }

    /// Triangles so far, every use of a mesh counted.
    pub fn triangles(&self) -> u64 {
        self.triangles
    }

    /// Nodes so far that have a mesh, and nodes that have none.
    pub fn leaves_and_groups(&self) -> [usize; 2] {
        let leaves = self.nodes.iter().filter(|node| node.mesh.is_some()).count();
        [leaves, self.nodes.len() - leaves]
    }

    pub fn node(&mut self, parent: Option<NodeId>, name: String, mesh: Option<MeshId>, place: Place) -> NodeId {
        let id = self.nodes.len() as u32;
        self.triangles += mesh.map_or(0, |mesh| self.mesh_triangles[mesh.0 as usize]);
        self.objects += u64::from(mesh.is_some());
        let unless = |default: bool| !default;
        self.nodes.push(Node {
            name,
            mesh: mesh.map(|mesh| mesh.0),
            children: Vec::new(),
            translation: unless(place.translation == Vec3::ZERO).then_some(place.translation.to_array()),
            rotation: unless(place.rotation == Quat::IDENTITY).then_some(place.rotation.to_array()),
            scale: unless(place.scale == Vec3::ONE).then_some(place.scale.to_array()),
            extensions: None,
        });
        match parent {
            Some(NodeId(parent)) => self.nodes[parent as usize].children.push(id),
            None => self.roots.push(id),
        }
        NodeId(id)
    }

    /// A node at its parent's place that shows `mesh` once for each of `instances`, of which there must be some.
    pub fn instances(&mut self, parent: Option<NodeId>, name: String, mesh: MeshId, instances: &[Instance]) -> NodeId {
        assert!(!instances.is_empty(), "node {name} has no instances: glTF allows no empty accessor");
        let count = instances.len();
        let translation = self.accessor(TRANSLATIONS, F32, "VEC3", count, instances.iter().map(|i| i.translation));
        let rotation = self.accessor(ROTATIONS, I16, "VEC4", count, instances.iter().map(|i| i.rotation));
        self.accessors[rotation].normalized = true;
        let scale = self.accessor(SCALES, F32, "VEC3", count, instances.iter().map(|i| i.scale));
        let [translation, rotation, scale] = [translation, rotation, scale].map(|accessor| accessor as u32);
        let attributes = InstanceAttributes { translation, rotation, scale };
        let id = self.node(parent, name, Some(mesh), Place::at(Vec3::ZERO));
        self.nodes[id.0 as usize].extensions = Some(NodeExtensions { instancing: Instancing { attributes } });
        let more = count as u64 - 1;
        self.triangles += more * self.mesh_triangles[mesh.0 as usize];
        self.objects += more;
        id
    }

    fn primitive(&mut self, geometry: &Geometry, material: u32) -> Value {
        let vertices = geometry.positions.len();
        let position = self.accessor(POSITIONS, F32, "VEC3", vertices, geometry.positions.iter().map(Vec3::to_array));
        let accessor = &mut self.accessors[position];
        accessor.min = Some(geometry.positions.iter().copied().fold(Vec3::INFINITY, Vec3::min).to_array());
        accessor.max = Some(geometry.positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max).to_array());
        let mut attributes = json!({ "POSITION": position });
        if geometry.normals.len() == vertices {
            let normals = geometry.normals.iter().map(Vec3::to_array);
            attributes["NORMAL"] = json!(self.accessor(NORMALS, F32, "VEC3", vertices, normals));
        }
        if geometry.uvs.len() == vertices {
            let uvs = geometry.uvs.iter().map(Vec2::to_array);
            attributes["TEXCOORD_0"] = json!(self.accessor(UVS, F32, "VEC2", vertices, uvs));
        }
        if geometry.colors.len() == vertices {
            let colors = self.accessor(COLORS, U8, "VEC4", vertices, geometry.colors.iter().copied());
            self.accessors[colors].normalized = true;
            attributes["COLOR_0"] = json!(colors);
        }
        let corners = geometry.indices.len();
        // 65535 is the restart value of 16 bit indices.
        let indices = if vertices < 65535 {
            self.accessor(INDICES_U16, U16, "SCALAR", corners, geometry.indices.iter().map(|k| *k as u16))
        } else {
            self.accessor(INDICES_U32, U32, "SCALAR", corners, geometry.indices.iter().copied())
        };
        json!({ "attributes": attributes, "indices": indices, "material": material })
    }

    fn accessor<E: NoUninit>(
        &mut self,
        kind: usize,
        component_type: u32,
        shape: &'static str,
        count: usize,
        elements: impl Iterator<Item = E>,
    ) -> usize {
        let data = &mut self.data[kind];
        let byte_offset = data.len();
        data.reserve(count * size_of::<E>());
        elements.for_each(|element| data.extend_from_slice(bytes_of(&element)));
        let (normalized, min, max) = (false, None, None);
        self.accessors.push(Accessor { buffer_view: kind, byte_offset, component_type, normalized, count, shape, min, max });
        self.accessors.len() - 1
    }

    /// The finished file, its parts still apart.
    pub fn finish(mut self, generator: &str) -> Glb {
        let mut views = Vec::new();
        let mut view_numbers = [0; KINDS];
        let mut parts = Vec::new();
        let mut length = 0;
        let place = |view: &mut Value, mut bytes: Vec<u8>, length: &mut usize, parts: &mut Vec<Vec<u8>>| {
            view["buffer"] = json!(0);
            view["byteOffset"] = json!(*length);
            view["byteLength"] = json!(bytes.len());
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            *length += bytes.len();
            parts.push(bytes);
        };
        for (kind, data) in self.data.into_iter().enumerate().filter(|(_, data)| !data.is_empty()) {
            view_numbers[kind] = views.len();
            let mut view = match (STRIDES[kind], kind) {
                (Some(stride), _) => json!({ "byteStride": stride, "target": 34962 }),
                (None, INDICES_U32 | INDICES_U16) => json!({ "target": 34963 }),
                _ => json!({}),
            };
            place(&mut view, data, &mut length, &mut parts);
            views.push(view);
        }
        for accessor in &mut self.accessors {
            accessor.buffer_view = view_numbers[accessor.buffer_view];
        }
        let mut images = Vec::new();
        for png in self.images {
            images.push(json!({ "bufferView": views.len(), "mimeType": "image/png" }));
            let mut view = json!({});
            place(&mut view, png, &mut length, &mut parts);
            views.push(view);
        }
        let sampler = json!({ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 });
        let is_instanced = self.nodes.iter().any(|node| node.extensions.is_some());
        let nodes = self.nodes.len() as u64;
        let root = Root {
            asset: json!({ "version": "2.0", "generator": generator }),
            extensions_used: if is_instanced { vec!["EXT_mesh_gpu_instancing"] } else { Vec::new() },
            scene: 0,
            scenes: json!([{ "nodes": self.roots }]),
            nodes: self.nodes,
            meshes: self.meshes,
            materials: self.materials,
            accessors: self.accessors,
            buffer_views: views,
            buffers: json!([{ "byteLength": length }]),
            samplers: if images.is_empty() { Vec::new() } else { vec![sampler] },
            images,
            textures: self.textures,
        };
        // Text of numbers, strings and lists: there is nothing in it that JSON cannot hold.
        let mut json = serde_json::to_vec(&root).expect("plain data is written as JSON");
        json.resize(json.len().next_multiple_of(4), b' ');
        let bytes = (HEADERS_BYTES + json.len() + length) as u64;
        let report = GenerateReport { triangles: self.triangles, nodes, objects: self.objects, bytes };
        Glb { json, parts, report }
    }
}

/// The header of the file and of its two chunks.
const HEADERS_BYTES: usize = 12 + 8 + 8;

/// A finished file.
pub struct Glb {
    json: Vec<u8>,
    /// The binary chunk in pieces, each padded to four bytes.
    parts: Vec<Vec<u8>>,
    pub report: GenerateReport,
}

impl Glb {
    /// Writes the file without holding it a second time.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let word = |value: usize| (value as u32).to_le_bytes();
        let bin_bytes = self.parts.iter().map(Vec::len).sum::<usize>();
        out.write_all(b"glTF")?;
        out.write_all(&word(2))?;
        out.write_all(&word(HEADERS_BYTES + self.json.len() + bin_bytes))?;
        out.write_all(&word(self.json.len()))?;
        out.write_all(b"JSON")?;
        out.write_all(&self.json)?;
        out.write_all(&word(bin_bytes))?;
        out.write_all(b"BIN\0")?;
        self.parts.iter().try_for_each(|part| out.write_all(part))
    }
}
