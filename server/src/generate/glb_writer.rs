//! A builder of valid GLB 2.0 files: one buffer, one view for each kind of data, accessors into them.
use super::solid::Geometry;
use bytemuck::cast_slice;
use glam::{Quat, Vec3};
use serde::Serialize;
use serde_json::{Value, json};

/// What was generated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GenerateReport {
    /// Triangles, every use of a mesh counted.
    pub triangles: u64,
    /// Nodes.
    pub nodes: u64,
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
}

#[derive(Serialize)]
struct Node {
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
}

/// The buffer views, in the order in which they lie in the file; wide elements first keeps all aligned.
const POSITIONS: usize = 0;
const NORMALS: usize = 1;
const UVS: usize = 2;
const COLORS: usize = 3;
const INDICES_U32: usize = 4;
const INDICES_U16: usize = 5;
const IMAGES: usize = 6;

#[derive(Default)]
pub struct GlbWriter {
    data: [Vec<u8>; IMAGES],
    images: Vec<Vec<u8>>,
    accessors: Vec<Value>,
    materials: Vec<Value>,
    textures: Vec<Value>,
    meshes: Vec<Value>,
    mesh_triangles: Vec<u64>,
    nodes: Vec<Node>,
    roots: Vec<u32>,
    triangles: u64,
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

    pub fn node(&mut self, parent: Option<NodeId>, name: String, mesh: Option<MeshId>, place: Place) -> NodeId {
        let id = self.nodes.len() as u32;
        self.triangles += mesh.map_or(0, |mesh| self.mesh_triangles[mesh.0 as usize]);
        let unless = |default: bool| !default;
        self.nodes.push(Node {
            name,
            mesh: mesh.map(|mesh| mesh.0),
            children: Vec::new(),
            translation: unless(place.translation == Vec3::ZERO).then_some(place.translation.to_array()),
            rotation: unless(place.rotation == Quat::IDENTITY).then_some(place.rotation.to_array()),
            scale: unless(place.scale == Vec3::ONE).then_some(place.scale.to_array()),
        });
        match parent {
            Some(NodeId(parent)) => self.nodes[parent as usize].children.push(id),
            None => self.roots.push(id),
        }
        NodeId(id)
    }

    fn primitive(&mut self, geometry: &Geometry, material: u32) -> Value {
        let vertices = geometry.positions.len();
        let low = geometry.positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = geometry.positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        let bounds = json!({ "min": low.to_array(), "max": high.to_array() });
        let position = self.accessor(POSITIONS, cast_slice(&geometry.positions), vertices, 5126, "VEC3", bounds);
        let mut attributes = json!({ "POSITION": position });
        if geometry.normals.len() == vertices {
            attributes["NORMAL"] =
                json!(self.accessor(NORMALS, cast_slice(&geometry.normals), vertices, 5126, "VEC3", json!({})));
        }
        if geometry.uvs.len() == vertices {
            attributes["TEXCOORD_0"] = json!(self.accessor(UVS, cast_slice(&geometry.uvs), vertices, 5126, "VEC2", json!({})));
        }
        if geometry.colors.len() == vertices {
            let normalized = json!({ "normalized": true });
            attributes["COLOR_0"] =
                json!(self.accessor(COLORS, cast_slice(&geometry.colors), vertices, 5121, "VEC4", normalized));
        }
        let corners = geometry.indices.len();
        // 65535 is the restart value of 16 bit indices.
        let indices = if vertices < 65535 {
            let narrow: Vec<u16> = geometry.indices.iter().map(|k| *k as u16).collect();
            self.accessor(INDICES_U16, cast_slice(&narrow), corners, 5123, "SCALAR", json!({}))
        } else {
            self.accessor(INDICES_U32, cast_slice(&geometry.indices), corners, 5125, "SCALAR", json!({}))
        };
        json!({ "attributes": attributes, "indices": indices, "material": material })
    }

    fn accessor(&mut self, view: usize, bytes: &[u8], count: usize, component: u32, shape: &str, mut accessor: Value) -> usize {
        accessor["bufferView"] = json!(view);
        accessor["byteOffset"] = json!(self.data[view].len());
        accessor["componentType"] = json!(component);
        accessor["count"] = json!(count);
        accessor["type"] = json!(shape);
        self.data[view].extend_from_slice(bytes);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// The finished file.
    pub fn finish(mut self, generator: &str) -> (Vec<u8>, GenerateReport) {
        let mut bin = Vec::new();
        let mut views = Vec::new();
        let mut view_numbers = [0; IMAGES];
        const STRIDES: [Option<u32>; IMAGES] = [Some(12), Some(12), Some(8), Some(4), None, None];
        for (kind, data) in self.data.iter().enumerate().filter(|(_, data)| !data.is_empty()) {
            view_numbers[kind] = views.len();
            let mut view = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": data.len() });
            match STRIDES[kind] {
                Some(stride) => {
                    view["byteStride"] = json!(stride);
                    view["target"] = json!(34962);
                }
                None => view["target"] = json!(34963),
            }
            views.push(view);
            bin.extend_from_slice(data);
            bin.resize(bin.len().next_multiple_of(4), 0);
        }
        for accessor in &mut self.accessors {
            let kind = accessor["bufferView"].as_u64().map_or(0, |kind| kind as usize);
            accessor["bufferView"] = json!(view_numbers[kind]);
        }
        let mut images = Vec::new();
        for png in &self.images {
            images.push(json!({ "bufferView": views.len(), "mimeType": "image/png" }));
            views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": png.len() }));
            bin.extend_from_slice(png);
            bin.resize(bin.len().next_multiple_of(4), 0);
        }
        let nodes = self.nodes.len() as u64;
        let mut root = json!({
            "asset": { "version": "2.0", "generator": generator },
            "scene": 0,
            "scenes": [{ "nodes": self.roots }],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": views,
            "buffers": [{ "byteLength": bin.len() }],
        });
        if !images.is_empty() {
            root["images"] = json!(images);
            root["textures"] = json!(self.textures);
            root["samplers"] = json!([{ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 }]);
        }
        let bytes = container(root.to_string().into_bytes(), bin);
        let report = GenerateReport { triangles: self.triangles, nodes, bytes: bytes.len() as u64 };
        (bytes, report)
    }
}

fn container(mut json: Vec<u8>, bin: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + bin.len();
    let mut out = Vec::with_capacity(total);
    let word = |out: &mut Vec<u8>, value: usize| out.extend_from_slice(&(value as u32).to_le_bytes());
    out.extend_from_slice(b"glTF");
    word(&mut out, 2);
    word(&mut out, total);
    word(&mut out, json.len());
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(&json);
    word(&mut out, bin.len());
    out.extend_from_slice(b"BIN\0");
    out.extend_from_slice(&bin);
    out
}
