//! Goal: what a valid file says is what the scene holds. Method: small files built here, each feature
//! compared with values worked out by hand or by a dull reference, on asymmetric data.
use glam::{DAffine3, DQuat, DVec3, Quat, Vec2, Vec3, vec3};
use mullion_server::prepare::gltf::{Filter, ImageKind, SourceAlpha, SourceImage, SourceScene, Wrap, load};
use proptest::prelude::*;
use serde_json::{Value, json};

/// A file under construction: one buffer, a view and an accessor for each array.
struct Builder {
    json: Value,
    bin: Vec<u8>,
}

impl Builder {
    fn new() -> Builder {
        let json = json!({ "asset": { "version": "2.0" }, "accessors": [], "bufferViews": [] });
        Builder { json, bin: Vec::new() }
    }

    fn push(list: &mut Value, item: Value) -> usize {
        let list = list.as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        let view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        self.bin.extend_from_slice(bytes);
        Self::push(&mut self.json["bufferViews"], view)
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, count: usize, shape: &str) -> usize {
        let view = self.view(bytes);
        let accessor = json!({ "bufferView": view, "componentType": component, "count": count, "type": shape });
        Self::push(&mut self.json["accessors"], accessor)
    }

    fn floats(&mut self, values: &[f32], shape: &str) -> usize {
        let size = match shape {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, 5126, values.len() / size, shape)
    }

    fn try_load(&self) -> Result<SourceScene, String> {
        let folder = tempfile::tempdir().unwrap();
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.bin.len(), "uri": "a%20b.bin" }]);
        std::fs::write(folder.path().join("a b.bin"), &self.bin).unwrap();
        let path = folder.path().join("scene.gltf");
        std::fs::write(&path, json.to_string()).unwrap();
        load(&path, &|_, _, _| {}).map_err(|error| error.to_string())
    }

    fn load(&self) -> SourceScene {
        self.try_load().unwrap()
    }
}

/// Five corners, no two coordinates alike.
const CORNERS: [f32; 15] = [0.0, 0.1, 0.2, 1.0, 0.3, 0.4, 1.1, 2.0, 0.5, 0.6, 2.1, 3.0, -1.0, 2.2, 3.1];

fn topology(mode: u32, indices: Option<&[u8]>) -> SourceScene {
    let mut file = Builder::new();
    let positions = file.floats(&CORNERS, "VEC3");
    let mut primitive = json!({ "attributes": { "POSITION": positions }, "mode": mode });
    if let Some(indices) = indices {
        primitive["indices"] = json!(file.accessor(indices, 5121, indices.len(), "SCALAR"));
    }
    file.json["meshes"] = json!([{ "primitives": [primitive] }]);
    file.load()
}

#[test]
fn every_topology_becomes_a_list() {
    let list = |mode, indices| topology(mode, indices).meshes[0].primitives[0].indices.clone();
    assert_eq!(list(4, None), [0, 1, 2]);
    assert_eq!(list(4, Some(&[4, 2, 0, 1, 2, 3])), [4, 2, 0, 1, 2, 3]);
    assert_eq!(list(5, None), [0, 1, 2, 1, 3, 2, 2, 3, 4]);
    assert_eq!(list(5, Some(&[4, 3, 2, 1])), [4, 3, 2, 3, 1, 2]);
    assert_eq!(list(6, None), [1, 2, 0, 2, 3, 0, 3, 4, 0]);
    assert_eq!(list(6, Some(&[4, 3, 2, 1])), [3, 2, 4, 2, 1, 4]);
    assert_eq!(list(5, Some(&[4, 3])), [0u32; 0]);
    for mode in 0..4 {
        let scene = topology(mode, None);
        assert!(scene.meshes[0].primitives.is_empty());
        assert!(scene.warnings[0].contains("mesh 0 primitive 0"), "{:?}", scene.warnings);
    }
}

/// One way to store positions.
#[derive(Debug, Clone)]
struct Storage {
    component: u32,
    normalized: bool,
    start: usize,
    offset: usize,
    gap: usize,
    count: usize,
    raw: Vec<u8>,
    sparse: Vec<u32>,
    sparse_component: u32,
}

fn storage() -> impl Strategy<Value = Storage> {
    let component = prop::sample::select(vec![5120u32, 5121, 5122, 5123, 5126]);
    let sparse_component = prop::sample::select(vec![5121u32, 5123, 5125]);
    (component, any::<bool>(), 0..5usize, 0..9usize, 0..8usize, 1..40usize, sparse_component).prop_flat_map(
        |(component, normalized, start, offset, gap, count, sparse_component)| {
            let raw = prop::collection::vec(any::<u8>(), 24 * 12 * 40);
            let sparse = prop::collection::btree_set(0..count as u32, 0..count.min(6));
            (raw, sparse).prop_map(move |(raw, sparse)| Storage {
                component,
                normalized: normalized && component != 5126,
                start,
                offset,
                gap,
                count,
                raw,
                sparse: sparse.into_iter().collect(),
                sparse_component,
            })
        },
    )
}

fn size_of(component: u32) -> usize {
    match component {
        5120 | 5121 => 1,
        5122 | 5123 => 2,
        _ => 4,
    }
}

/// One component, by the formulas of the specification, one at a time.
fn reference(bytes: &[u8], component: u32, normalized: bool) -> f32 {
    let (value, most) = match component {
        5120 => (f64::from(bytes[0] as i8), 127.0),
        5121 => (f64::from(bytes[0]), 255.0),
        5122 => (f64::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
        5123 => (f64::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
        _ => return f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    };
    (if normalized { (value / most).max(-1.0) } else { value }) as f32
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn accessors_decode_as_the_reference_does(mut s in storage()) {
        let size = size_of(s.component);
        if s.component == 5126 {
            // Finite floats only: others are refused.
            s.raw.chunks_exact_mut(4).for_each(|word| word[3] &= 0x1F);
            // Every alignment of a float's bytes must stay finite.
            s.raw.iter_mut().for_each(|byte| *byte &= 0x3F);
        }
        let stride = 3 * size + s.gap;
        let mut file = Builder::new();
        file.bin = vec![0xAA; s.start];
        let body = s.offset + stride * (s.count - 1) + 3 * size;
        let view = file.view(&s.raw[..body]);
        // A stride of 0 means tight in the JSON by its absence.
        if s.gap > 0 {
            file.json["bufferViews"][view]["byteStride"] = json!(stride);
        }
        let mut expected: Vec<[f32; 3]> = (0..s.count)
            .map(|k| std::array::from_fn(|c| {
                reference(&s.raw[s.offset + k * stride + c * size..], s.component, s.normalized)
            }))
            .collect();
        let mut accessor = json!({
            "bufferView": view, "byteOffset": s.offset, "componentType": s.component,
            "normalized": s.normalized, "count": s.count, "type": "VEC3"
        });
        if !s.sparse.is_empty() {
            let values = &s.raw[body..body + s.sparse.len() * 3 * size];
            let width = size_of(s.sparse_component);
            let indices: Vec<u8> = s.sparse.iter().flat_map(|k| k.to_le_bytes()[..width].to_vec()).collect();
            let (indices, values_view) = (file.view(&indices), file.view(values));
            accessor["sparse"] = json!({
                "count": s.sparse.len(),
                "indices": { "bufferView": indices, "componentType": s.sparse_component },
                "values": { "bufferView": values_view }
            });
            for (at, k) in s.sparse.iter().enumerate() {
                let value = |c| reference(&values[(3 * at + c) * size..], s.component, s.normalized);
                expected[*k as usize] = std::array::from_fn(value);
            }
        }
        Builder::push(&mut file.json["accessors"], accessor);
        file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
        file.json["meshes"] = json!([{ "primitives": [{ "attributes": { "POSITION": 0 } }] }]);
        let scene = file.load();
        let found: Vec<[f32; 3]> = scene.meshes[0].primitives[0].positions.iter().map(|p| p.to_array()).collect();
        prop_assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            prop_assert!((found - expected).abs() <= 1e-6 * expected.abs().max(1e-3), "{} {}", found, expected);
        }
    }
}

#[test]
fn colors_become_unorm8() {
    let mut file = Builder::new();
    let positions = file.floats(&CORNERS[..9], "VEC3");
    let floats = file.floats(&[0.0, 0.5, 1.0, 2.0, -1.0, f32::NAN, 0.25, 1.0, 0.0], "VEC3");
    let shorts: Vec<u8> = [0u16, 65535, 32768, 257].iter().cycle().take(12).flat_map(|v| v.to_le_bytes()).collect();
    let shorts = file.accessor(&shorts, 5123, 3, "VEC4");
    file.json["accessors"][shorts]["normalized"] = json!(true);
    let with = |color: usize| json!({ "attributes": { "POSITION": positions, "COLOR_0": color } });
    file.json["meshes"] = json!([{ "primitives": [with(floats), with(shorts)] }]);
    let scene = file.load();
    let colors = |p: usize| scene.meshes[0].primitives[p].colors.clone().unwrap();
    assert_eq!(colors(0), [[0, 128, 255, 255], [255, 0, 0, 255], [64, 255, 0, 255]]);
    assert_eq!(colors(1), [[0, 255, 128, 1]; 3]);
}

#[test]
fn textures_samplers_and_their_transform() {
    let mut file = Builder::new();
    let positions = file.floats(&CORNERS[..9], "VEC3");
    let wrong = file.floats(&[9.0; 6], "VEC2");
    let uvs = file.floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0], "VEC2");
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(3, 2, image::Rgb([1, 2, 3])).write_to(&mut png, image::ImageFormat::Png).unwrap();
    let mut jpeg = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(5, 4, image::Rgb([1, 2, 3])).write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
    let (png_view, jpeg_view) = (file.view(png.get_ref()), file.view(jpeg.get_ref()));
    file.json["images"] = json!([
        { "bufferView": 99, "mimeType": "image/png" },
        { "bufferView": jpeg_view, "mimeType": "image/jpeg" },
        { "bufferView": png_view, "mimeType": "image/png" }
    ]);
    file.json["samplers"] = json!([{ "wrapS": 33071, "wrapT": 33648, "magFilter": 9728 }]);
    file.json["textures"] = json!([{ "source": 2, "sampler": 0 }, { "source": 1 }]);
    let quarter = std::f64::consts::FRAC_PI_2;
    let transform =
        json!({ "KHR_texture_transform": { "offset": [0.5, 0.25], "rotation": quarter, "scale": [2, 3], "texCoord": 1 } });
    file.json["materials"] = json!([
        { "pbrMetallicRoughness": { "baseColorTexture": { "index": 0, "texCoord": 0, "extensions": transform }, "baseColorFactor": [0.1, 0.2, 0.3, 0.4] },
          "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": true },
        { "extensions": { "KHR_materials_pbrSpecularGlossiness": { "diffuseTexture": { "index": 1 } } }, "alphaMode": "BLEND" }
    ]);
    let attributes = json!({ "POSITION": positions, "TEXCOORD_0": wrong, "TEXCOORD_1": uvs });
    file.json["meshes"] = json!([{ "primitives": [
        { "attributes": attributes, "material": 0 }, { "attributes": attributes, "material": 1 }, { "attributes": attributes }
    ] }]);
    let scene = file.load();
    let [first, second] = &scene.materials[..] else { panic!() };
    assert_eq!(first.base_color, [0.1, 0.2, 0.3, 0.4]);
    assert_eq!(first.alpha, SourceAlpha::Mask { cutoff: 0.3 });
    assert!(first.double_sided && !second.double_sided);
    assert_eq!(second.alpha, SourceAlpha::Blend);
    let texture = first.texture.unwrap();
    assert_eq!((texture.image, texture.wrap_u, texture.wrap_v, texture.filter), (0, Wrap::Clamp, Wrap::Mirror, Filter::Nearest));
    assert_eq!(second.texture.unwrap().image, 1);
    assert!(matches!(scene.images[0], SourceImage::Encoded { mime: ImageKind::Png, width: 3, height: 2, .. }));
    assert!(matches!(scene.images[1], SourceImage::Encoded { mime: ImageKind::Jpeg, width: 5, height: 4, .. }));
    // Scaled, then a quarter turn that takes +u to -v, then moved.
    let uvs = scene.meshes[0].primitives[0].uvs.clone().unwrap();
    let expected = [Vec2::new(0.5, 0.25), Vec2::new(0.5, 0.25 - 2.0), Vec2::new(0.5 + 3.0, 0.25)];
    for (found, expected) in uvs.iter().zip(expected) {
        assert!(found.abs_diff_eq(expected, 1e-5), "{found} {expected}");
    }
    assert_eq!(scene.meshes[0].primitives[1].uvs.as_ref().unwrap()[0], Vec2::splat(9.0));
    assert!(scene.meshes[0].primitives[2].uvs.is_none());
}

#[test]
fn morph_targets_rest_at_their_weights() {
    let mut file = Builder::new();
    let positions = file.floats(&CORNERS[..9], "VEC3");
    let first = file.floats(&[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0], "VEC3");
    // The second target is sparse on top of nothing: it moves vertex 2 alone.
    let (indices, values) = (file.view(&[2]), file.view(&[7f32, 8.0, 9.0].map(f32::to_le_bytes).concat()));
    let sparse =
        json!({ "count": 1, "indices": { "bufferView": indices, "componentType": 5121 }, "values": { "bufferView": values } });
    let second = Builder::push(
        &mut file.json["accessors"],
        json!({ "componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse }),
    );
    file.json["meshes"] = json!([{
        "primitives": [{ "attributes": { "POSITION": positions }, "targets": [{ "POSITION": first }, { "POSITION": second }] }],
        "weights": [0.5, 0.0]
    }]);
    file.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0, "weights": [0.0, 2.0] }]);
    let scene = file.load();
    assert_eq!((scene.nodes[0].mesh, scene.nodes[1].mesh), (Some(0), Some(1)));
    assert_eq!(scene.meshes[1].gltf_mesh, 0);
    let base = |k: usize| Vec3::from_slice(&CORNERS[3 * k..]);
    let at = |mesh: usize| scene.meshes[mesh].primitives[0].positions.clone();
    assert_eq!(at(0), [base(0) + vec3(0.5, 0.0, 0.0), base(1) + vec3(0.0, 1.0, 0.0), base(2) + vec3(0.0, 0.0, 1.5)]);
    assert_eq!(at(1), [base(0), base(1), base(2) + vec3(14.0, 16.0, 18.0)]);
    assert!(scene.warnings.iter().any(|warning| warning.contains("morph")));
}

#[test]
fn skins_rest_where_their_joints_are() {
    let mut file = Builder::new();
    let positions = file.floats(&CORNERS[..9], "VEC3");
    let joints = file.accessor(&[0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], 5121, 3, "VEC4");
    let weights = file.floats(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.25, 0.75, 0.0, 0.0], "VEC4");
    let inverse_binds = [DAffine3::from_translation(DVec3::new(0.0, -1.0, 0.0)), DAffine3::from_scale(DVec3::new(2.0, 1.0, 0.5))];
    let matrices: Vec<f32> = inverse_binds.iter().flat_map(|m| glam::DMat4::from(*m).as_mat4().to_cols_array()).collect();
    let binds = file.floats(&matrices, "MAT4");
    file.json["meshes"] =
        json!([{ "primitives": [{ "attributes": { "POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights } }] }]);
    file.json["skins"] = json!([{ "joints": [2, 3], "inverseBindMatrices": binds }]);
    let turn = DQuat::from_rotation_z(0.7);
    file.json["nodes"] = json!([
        { "children": [1], "translation": [5, 6, 7] },
        { "mesh": 0, "skin": 0, "scale": [2, -1, 1] },
        { "children": [3], "translation": [0, 1, 0] },
        { "translation": [3, 0, 0], "rotation": turn.to_array() }
    ]);
    let scene = file.load();
    assert_eq!(scene.nodes[1].mesh, Some(1));
    let node = DAffine3::from_translation(DVec3::new(5.0, 6.0, 7.0)) * DAffine3::from_scale(DVec3::new(2.0, -1.0, 1.0));
    let root = DAffine3::from_translation(DVec3::Y);
    let tip = root * DAffine3::from_rotation_translation(turn, DVec3::new(3.0, 0.0, 0.0));
    let joints = [root * inverse_binds[0], tip * inverse_binds[1]];
    let base = |k: usize| Vec3::from_slice(&CORNERS[3 * k..]).as_dvec3();
    let world = [
        joints[0].transform_point3(base(0)),
        joints[1].transform_point3(base(1)),
        0.25 * joints[0].transform_point3(base(2)) + 0.75 * joints[1].transform_point3(base(2)),
    ];
    for (found, expected) in scene.meshes[1].primitives[0].positions.iter().zip(world) {
        let found = node.transform_point3(found.as_dvec3());
        assert!(found.abs_diff_eq(expected, 1e-5), "{found} {expected}");
    }
    assert!(scene.warnings.iter().any(|warning| warning.contains("skin")));
}

#[test]
fn instances_from_floats_and_normalized_integers() {
    let mut file = Builder::new();
    let positions = file.floats(&CORNERS[..9], "VEC3");
    let translation = file.floats(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "VEC3");
    let rotation: Vec<u8> = [0i16, 0, 0, 32767, 0, 23170, 0, 23170].iter().flat_map(|v| v.to_le_bytes()).collect();
    let rotation = file.accessor(&rotation, 5122, 2, "VEC4");
    file.json["accessors"][rotation]["normalized"] = json!(true);
    let scale = file.floats(&[1.0, 1.0, 1.0, 2.0, 3.0, -4.0], "VEC3");
    file.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    file.json["meshes"] = json!([{ "primitives": [{ "attributes": { "POSITION": positions } }] }]);
    let attributes = json!({ "TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale, "_ID": 77 });
    file.json["nodes"] = json!([{ "mesh": 0, "extensions": { "EXT_mesh_gpu_instancing": { "attributes": attributes } } }]);
    let scene = file.load();
    let [first, second] = &scene.nodes[0].instances[..] else { panic!() };
    assert!(first.abs_diff_eq(DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0)), 1e-12));
    let turn = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2).as_dquat();
    let expected = DAffine3::from_scale_rotation_translation(DVec3::new(2.0, 3.0, -4.0), turn, DVec3::new(4.0, 5.0, 6.0));
    assert!(second.abs_diff_eq(expected, 1e-5), "{second} {expected}");
}

/// Adds a view that exists compressed only; the fallback buffer 1 has no data.
fn compressed(file: &mut Builder, bytes: &[u8], count: usize, stride: usize, mode: &str, filter: &str) -> usize {
    let offset = file.bin.len();
    file.bin.extend_from_slice(bytes);
    let ext = json!({
        "buffer": 0, "byteOffset": offset, "byteLength": bytes.len(),
        "byteStride": stride, "count": count, "mode": mode, "filter": filter
    });
    let mut view = json!({ "buffer": 1, "byteLength": count * stride, "extensions": { "EXT_meshopt_compression": ext } });
    if mode == "ATTRIBUTES" {
        view["byteStride"] = json!(stride);
    }
    Builder::push(&mut file.json["bufferViews"], view)
}

#[test]
fn meshopt_views_decode() {
    let mut file = Builder::new();
    let corners: Vec<[f32; 3]> = CORNERS.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    let positions = meshopt::encode_vertex_buffer(&corners).unwrap();
    let positions = compressed(&mut file, &positions, 5, 12, "ATTRIBUTES", "NONE");
    let exponents = meshopt::encode_filter_exp(&corners, 24, meshopt::EncodeExpMode::Separate);
    let exponents = meshopt::encode_vertex_buffer(&exponents).unwrap();
    let exponents = compressed(&mut file, &exponents, 5, 12, "ATTRIBUTES", "EXPONENTIAL");
    let normals: Vec<[f32; 4]> = corners.iter().map(|c| Vec3::from_array(*c).normalize().extend(0.0).to_array()).collect();
    let octahedral = meshopt::encode_vertex_buffer(&meshopt::encode_filter_oct::<i16>(&normals, 16)).unwrap();
    let octahedral = compressed(&mut file, &octahedral, 5, 8, "ATTRIBUTES", "OCTAHEDRAL");
    let list = [0u32, 1, 2, 2, 1, 3, 4, 0, 3];
    let triangles = compressed(&mut file, &meshopt::encode_index_buffer(&list, 5).unwrap(), 9, 2, "TRIANGLES", "NONE");
    let sequence = compressed(&mut file, &meshopt::encode_index_sequence(&list, 5).unwrap(), 9, 4, "INDICES", "NONE");
    file.json["accessors"] = json!([
        { "bufferView": positions, "componentType": 5126, "count": 5, "type": "VEC3" },
        { "bufferView": exponents, "componentType": 5126, "count": 5, "type": "VEC3" },
        { "bufferView": octahedral, "componentType": 5122, "normalized": true, "count": 5, "type": "VEC3" },
        { "bufferView": triangles, "componentType": 5123, "count": 9, "type": "SCALAR" },
        { "bufferView": sequence, "componentType": 5125, "count": 9, "type": "SCALAR" }
    ]);
    file.json["extensionsRequired"] = json!(["EXT_meshopt_compression", "KHR_mesh_quantization"]);
    file.json["meshes"] = json!([{ "primitives": [
        { "attributes": { "POSITION": 0, "NORMAL": 2 }, "indices": 3 },
        { "attributes": { "POSITION": 1 }, "indices": 4 }
    ] }]);
    let folder = tempfile::tempdir().unwrap();
    let mut json = file.json.clone();
    json["buffers"] = json!([
        { "byteLength": file.bin.len(), "uri": "scene.bin" },
        { "byteLength": 1000, "extensions": { "EXT_meshopt_compression": { "fallback": true } } }
    ]);
    std::fs::write(folder.path().join("scene.bin"), &file.bin).unwrap();
    std::fs::write(folder.path().join("scene.gltf"), json.to_string()).unwrap();
    let scene = load(&folder.path().join("scene.gltf"), &|_, _, _| {}).unwrap();
    let [first, second] = &scene.meshes[0].primitives[..] else { panic!() };
    assert_eq!(first.positions, corners.iter().map(|c| Vec3::from_array(*c)).collect::<Vec<_>>());
    for (found, exact) in second.positions.iter().zip(&corners) {
        assert!(found.abs_diff_eq(Vec3::from_array(*exact), 1e-5));
    }
    for (found, exact) in first.normals.as_ref().unwrap().iter().zip(&normals) {
        assert!(found.abs_diff_eq(Vec3::from_slice(exact), 1e-3), "{found} {exact:?}");
    }
    // The triangle codec may rotate a triangle, never turn it over.
    for (found, exact) in first.indices.chunks_exact(3).zip(list.chunks_exact(3)) {
        let rotations = [[exact[0], exact[1], exact[2]], [exact[1], exact[2], exact[0]], [exact[2], exact[0], exact[1]]];
        assert!(rotations.iter().any(|r| r == found), "{found:?} {exact:?}");
    }
    assert_eq!(second.indices, list);
}

#[test]
fn the_default_scene_decides_the_roots() {
    let mut file = Builder::new();
    file.json["nodes"] = json!([{ "name": "a" }, { "name": "b", "children": [2] }, {}]);
    assert_eq!(file.load().roots, [0, 1]);
    file.json["scenes"] = json!([{ "nodes": [1] }, { "nodes": [0] }]);
    assert_eq!(file.load().roots, [1]);
    file.json["scene"] = json!(1.0);
    let scene = file.load();
    assert_eq!(scene.roots, [0]);
    assert_eq!((scene.nodes[2].parent, scene.nodes[1].name.as_deref()), (Some(1), Some("b")));
}
