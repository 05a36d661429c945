//! Goal: bad input gets one clear line, never a panic, a hang or a huge allocation. Method: take a good
//! triangle, spoil one thing, and look for the words that name what and where.
use mullion_server::prepare::gltf::{SourceImage, SourceScene, load};
use mullion_server::prepare::{PrepareOptions, prepare};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;
use tempfile::TempDir;

/// Positions of one triangle as f32, then its indices as u16.
fn triangle_bytes() -> Vec<u8> {
    let mut bytes: Vec<u8> = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2].iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

fn triangle() -> Value {
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 6 }
        ],
        "buffers": [{ "byteLength": 42, "uri": "scene.bin" }]
    })
}

struct Folder(TempDir);

impl Folder {
    fn new() -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        folder.write("scene.bin", &triangle_bytes());
        folder
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        let path = self.path().join(name);
        // A new file each time: ext4 flushes one that is truncated and rewritten, at a millisecond each.
        let _ = std::fs::remove_file(&path);
        std::fs::write(path, bytes).unwrap();
    }

    fn load(&self, json: &Value) -> Result<SourceScene, String> {
        self.load_bytes("scene.gltf", json.to_string().as_bytes())
    }

    fn load_bytes(&self, name: &str, bytes: &[u8]) -> Result<SourceScene, String> {
        self.write(name, bytes);
        load(&self.path().join(name), &|_, _, _| {}).map_err(|error| error.to_string())
    }
}

#[track_caller]
fn refused(outcome: Result<SourceScene, String>, words: &[&str]) {
    let line = outcome.expect_err("the file should be refused");
    println!("{line}");
    assert!(!line.contains('\n') && line.len() < 1000, "{line}");
    assert!(line.contains("scene."), "no file name: {line}");
    for word in words {
        assert!(line.contains(word), "no {word:?} in: {line}");
    }
}

#[track_caller]
fn spoiled(spoil: impl Fn(&mut Value), words: &[&str]) {
    let mut json = triangle();
    spoil(&mut json);
    refused(Folder::new().load(&json), words);
}

fn glb(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let mut json = json.to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    for word in [2, 28 + json.len() + bin.len(), json.len()] {
        out.extend((word as u32).to_le_bytes());
    }
    out.extend(b"JSON");
    out.extend(&json);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(&bin);
    out
}

#[test]
fn the_unspoiled_triangle_loads() {
    let scene = Folder::new().load(&triangle()).unwrap();
    assert_eq!(scene.roots, [0]);
    let primitive = &scene.meshes[0].primitives[0];
    assert_eq!(primitive.positions[2].to_array(), [0.0, 2.0, 3.0]);
    assert_eq!(primitive.indices, [0, 1, 2]);
    let mut json = triangle();
    json["buffers"][0].as_object_mut().unwrap().remove("uri");
    let bytes = glb(json.to_string().as_bytes(), &triangle_bytes());
    assert_eq!(Folder::new().load_bytes("scene.glb", &bytes).unwrap().meshes[0].primitives[0].indices, [0, 1, 2]);
}

#[test]
fn missing_empty_and_foreign_files() {
    let folder = Folder::new();
    let missing = load(&folder.path().join("scene.none"), &|_, _, _| {}).map_err(|e| e.to_string());
    refused(missing, &["No such file"]);
    let is_folder = load(folder.path(), &|_, _, _| {}).unwrap_err().to_string();
    assert!(is_folder.contains("is a directory"), "{is_folder}");
    refused(folder.load_bytes("scene.gltf", b""), &["empty"]);
    refused(folder.load_bytes("scene.gltf", b"solid stl"), &["neither GLB"]);
    refused(folder.load_bytes("scene.gltf", b"{\"asset\":"), &["JSON", "line 1"]);
}

#[test]
fn a_glb_cut_anywhere_is_refused() {
    let mut json = triangle();
    json["buffers"][0].as_object_mut().unwrap().remove("uri");
    let whole = glb(json.to_string().as_bytes(), &triangle_bytes());
    let folder = Folder::new();
    for length in 0..whole.len() {
        assert!(folder.load_bytes("scene.glb", &whole[..length]).is_err(), "cut to {length}");
    }
    refused(folder.load_bytes("scene.glb", &whole[..whole.len() - 1]), &["truncated", "bytes"]);
}

/// Flips every byte of a small GLB: any outcome is fine but a panic, a hang or a huge allocation.
#[test]
fn a_glb_with_any_byte_changed_does_not_panic() {
    let mut json = triangle();
    json["buffers"][0].as_object_mut().unwrap().remove("uri");
    json["nodes"][0]["translation"] = json!([1, 2, 3]);
    let mut bytes = glb(json.to_string().as_bytes(), &triangle_bytes());
    let folder = Folder::new();
    for at in 0..bytes.len() {
        let kept = bytes[at];
        for value in [b'0', b'9', b'-', b'e', b'"', kept ^ 0x80, 0xFF] {
            bytes[at] = value;
            if let Err(line) = folder.load_bytes("scene.glb", &bytes) {
                assert!(!line.contains('\n'), "{line}");
            }
        }
        bytes[at] = kept;
    }
}

#[test]
fn versions_and_extensions() {
    spoiled(|j| j["asset"]["version"] = json!("1.0"), &["version 1.0"]);
    spoiled(|j| j["asset"]["minVersion"] = json!("2.1"), &["minVersion 2.1"]);
    spoiled(|j| j["asset"] = json!({}), &["version"]);
    let draco = json!(["KHR_draco_mesh_compression"]);
    spoiled(|j| j["extensionsRequired"] = draco.clone(), &["KHR_draco_mesh_compression"]);
    let mut json = triangle();
    json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let scene = Folder::new().load(&json).unwrap();
    assert!(scene.warnings[0].contains("KHR_lights_punctual"));
}

#[test]
fn hostile_counts_take_no_memory() {
    let huge = 1u64 << 62;
    spoiled(|j| j["accessors"][0]["count"] = json!(huge), &["accessor 0", "4611686018427387904", "bufferView 0 has 36 bytes"]);
    spoiled(|j| j["accessors"][0]["count"] = json!(u64::MAX), &["accessor 0", "2^64"]);
    spoiled(
        |j| j["accessors"][0] = json!({ "componentType": 5126, "count": huge, "type": "VEC3" }),
        &["accessor 0", "MAX_ZERO_FILLED"],
    );
    spoiled(|j| j["accessors"][0]["count"] = json!(0), &["accessor 0", "count is 0"]);
    spoiled(|j| j["accessors"][0]["count"] = json!(-1), &["JSON", "integer"]);
    spoiled(|j| j["accessors"][0]["count"] = json!(2.5), &["JSON", "integer"]);
    spoiled(|j| j["accessors"][0]["byteOffset"] = json!(u64::MAX), &["accessor 0"]);
    spoiled(|j| j["bufferViews"][0]["byteOffset"] = json!(u64::MAX), &["bufferView 0", "buffer 0"]);
    spoiled(|j| j["buffers"][0]["byteLength"] = json!(huge), &["buffer 0", "42 bytes"]);
    // Many cheap accessors are one expensive file.
    let mut json = triangle();
    json["accessors"][0] = json!({ "componentType": 5126, "count": 1 << 22, "type": "VEC3" });
    let primitive = json!({ "attributes": { "POSITION": 0 } });
    json["meshes"][0]["primitives"] = json!(vec![primitive; 1000]);
    refused(Folder::new().load(&json), &["accessor 0", "memory"]);
}

#[test]
fn wrong_types_and_enums() {
    spoiled(|j| j["accessors"][0]["type"] = json!("VEC2"), &["accessor 0", "POSITION", "Vec2"]);
    spoiled(|j| j["accessors"][0]["type"] = json!("VEC7"), &["accessor 0", "VEC7"]);
    spoiled(|j| j["accessors"][0]["componentType"] = json!(5123), &["accessor 0", "U16", "KHR_mesh_quantization"]);
    spoiled(|j| j["accessors"][0]["componentType"] = json!(5130), &["accessor 0", "5130"]);
    spoiled(|j| j["accessors"][0]["componentType"] = json!(5126u64 + (1 << 32)), &["accessor 0"]);
    spoiled(|j| j["accessors"][0]["normalized"] = json!(true), &["accessor 0", "normalized"]);
    spoiled(|j| j["accessors"][1]["componentType"] = json!(5122), &["accessor 1", "indices"]);
    spoiled(|j| j["meshes"][0]["primitives"][0]["mode"] = json!(7), &["mesh 0 primitive 0", "mode 7"]);
    spoiled(|j| j["meshes"][0]["primitives"][0]["mode"] = json!(4u64 + (1 << 32)), &["mesh 0 primitive 0"]);
    spoiled(|j| j["meshes"][0]["primitives"][0]["material"] = json!(0), &["mesh 0 primitive 0", "material 0"]);
    spoiled(|j| j["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(1), &["accessor 1", "NORMAL"]);
    spoiled(|j| j["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(9), &["accessor 9"]);
    spoiled(|j| j["bufferViews"][0]["byteStride"] = json!(8), &["accessor 0", "byteStride 8"]);
    spoiled(|j| j["bufferViews"][0]["byteStride"] = json!(0), &["bufferView 0", "byteStride 0"]);
    spoiled(|j| j["materials"] = json!([{ "alphaMode": "GLOW" }]), &["material 0", "GLOW"]);
}

#[test]
fn ranges_past_their_end() {
    spoiled(|j| j["bufferViews"][1]["byteLength"] = json!(7), &["bufferView 1", "buffer 0"]);
    spoiled(|j| j["bufferViews"][1]["buffer"] = json!(1), &["bufferView 1", "buffer 1"]);
    spoiled(|j| j["accessors"][1]["count"] = json!(6), &["accessor 1", "bufferView 1 has 6 bytes"]);
    let folder = Folder::new();
    let mut bytes = triangle_bytes();
    bytes[40] = 3;
    folder.write("scene.bin", &bytes);
    refused(folder.load(&triangle()), &["accessor 1", "3 vertices"]);
    folder.write("scene.bin", &bytes[..20]);
    refused(folder.load(&triangle()), &["buffer 0", "20 bytes"]);
    std::fs::remove_file(folder.path().join("scene.bin")).unwrap();
    refused(folder.load(&triangle()), &["scene.bin", "No such file"]);
}

#[test]
fn numbers_that_are_not_finite() {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let folder = Folder::new();
        let mut bytes = triangle_bytes();
        bytes[12..16].copy_from_slice(&value.to_le_bytes());
        folder.write("scene.bin", &bytes);
        refused(folder.load(&triangle()), &["mesh 0 primitive 0", "POSITION 1", "finite"]);
    }
    spoiled(|j| j["nodes"][0]["scale"] = json!([1e308, 1e308, 0]), &["node 0", "MAX_COORDINATE"]);
    spoiled(|j| j["nodes"][0]["translation"] = json!([0, 1e13, 0]), &["node 0", "MAX_COORDINATE"]);
    let folder = Folder::new();
    let mut bytes = triangle_bytes();
    bytes[12..16].copy_from_slice(&f32::MAX.to_le_bytes());
    folder.write("scene.bin", &bytes);
    refused(folder.load(&triangle()), &["mesh 0", "MAX_COORDINATE"]);
    spoiled(
        |j| {
            j["nodes"] = json!([{ "children": [1], "scale": [1e200, 1, 1] }, { "mesh": 0, "scale": [1e200, 1, 1] }]);
        },
        &["node 1", "not finite"],
    );
}

#[test]
fn transforms() {
    let mut matrix = vec![0.0; 16];
    (0..4).for_each(|k| matrix[5 * k] = 1.0);
    matrix[3] = 0.5;
    spoiled(|j| j["nodes"][0]["matrix"] = json!(matrix), &["node 0", "affine"]);
    spoiled(|j| j["nodes"][0]["rotation"] = json!([0, 0, 0, 0]), &["node 0", "rotation"]);
    let mut json = triangle();
    json["nodes"][0]["scale"] = json!([-1, 2, 0]);
    let scene = Folder::new().load(&json).unwrap();
    assert_eq!(scene.nodes[0].parent_from_local.matrix3.x_axis.x, -1.0);
}

#[test]
fn node_graphs_that_are_no_forest() {
    spoiled(|j| j["nodes"] = json!([{ "name": "a", "children": [1] }, { "name": "b", "children": [0] }]), &["node", "cycle"]);
    spoiled(|j| j["nodes"] = json!([{ "children": [0] }]), &["node 0", "cycle"]);
    spoiled(
        |j| j["nodes"] = json!([{ "children": [2] }, { "children": [2] }, { "name": "shared\nchild" }]),
        &["node 2", "shared child", "node 0", "node 1"],
    );
    spoiled(|j| j["nodes"] = json!([{ "children": [1, 1] }, {}]), &["node 1", "two parents"]);
    spoiled(|j| j["nodes"] = json!([{ "children": [1] }]), &["node 0", "node 1"]);
    spoiled(|j| j["scenes"][0]["nodes"] = json!([0, 0]), &["scene 0", "twice"]);
    spoiled(|j| j["scene"] = json!(4), &["scene 4"]);
    let chain = |length: usize| -> Vec<Value> {
        (1..=length).map(|k| if k < length { json!({ "children": [k] }) } else { json!({}) }).collect()
    };
    spoiled(|j| j["nodes"] = json!(chain(100_000)), &["MAX_NODE_DEPTH", "4096"]);
    spoiled(|j| j["nodes"] = json!(chain(4097)), &["node 4096", "MAX_NODE_DEPTH"]);
    let mut json = triangle();
    json["nodes"] = json!(chain(4096));
    assert_eq!(Folder::new().load(&json).unwrap().nodes.len(), 4096);
    let deep = "[".repeat(200_000);
    refused(Folder::new().load_bytes("scene.gltf", format!("{{\"extras\":{deep}").as_bytes()), &["JSON"]);
}

#[test]
fn uris_that_leave_the_folder() {
    let outer = tempfile::tempdir().unwrap();
    std::fs::write(outer.path().join("secret.bin"), triangle_bytes()).unwrap();
    let inner = outer.path().join("asset");
    std::fs::create_dir(&inner).unwrap();
    std::os::unix::fs::symlink(outer.path().join("secret.bin"), inner.join("link.bin")).unwrap();
    let secret = outer.path().join("secret.bin").display().to_string();
    let uris = ["../secret.bin", "%2e%2e/secret.bin", "a/../../secret.bin", "..%2Fsecret.bin", "link.bin", &secret];
    for uri in uris {
        let mut json = triangle();
        json["buffers"][0]["uri"] = json!(uri);
        std::fs::write(inner.join("scene.gltf"), json.to_string()).unwrap();
        let outcome = load(&inner.join("scene.gltf"), &|_, _, _| {}).map_err(|e| e.to_string());
        refused(outcome, &["buffer 0", "leaves the asset's folder"]);
    }
    spoiled(|j| j["buffers"][0]["uri"] = json!("http://localhost/scene.bin"), &["buffer 0", "http:"]);
    spoiled(|j| j["buffers"][0]["uri"] = json!("file:///etc/passwd"), &["buffer 0", "file:"]);
    spoiled(|j| j["images"] = json!([{ "uri": "../picture.png" }]), &["image 0", "leaves"]);
    spoiled(|j| j["buffers"][0]["uri"] = json!("data:;base64,@@@"), &["buffer 0", "base64"]);
    spoiled(|j| j["buffers"][0]["uri"] = json!("/dev/zero"), &["buffer 0", "leaves"]);
    let mut json = triangle();
    json["buffers"][0]["uri"] = json!("device.bin");
    std::fs::remove_file(inner.join("link.bin")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", inner.join("device.bin")).unwrap();
    std::fs::write(inner.join("scene.gltf"), json.to_string()).unwrap();
    assert!(load(&inner.join("scene.gltf"), &|_, _, _| {}).is_err());
}

#[test]
fn sparse_accessors_are_checked() {
    let sparse = |count: u64, view: u64| json!({ "count": count, "indices": { "bufferView": 1, "componentType": 5123 }, "values": { "bufferView": view } });
    spoiled(|j| j["accessors"][0]["sparse"] = sparse(4, 0), &["accessor 0 sparse", "count 4"]);
    spoiled(|j| j["accessors"][0]["sparse"] = sparse(1 << 62, 0), &["accessor 0 sparse"]);
    spoiled(|j| j["accessors"][0]["sparse"] = sparse(3, 1), &["accessor 0 sparse", "bufferView 1 has 6 bytes"]);
    let folder = Folder::new();
    let mut bytes = triangle_bytes();
    bytes[40] = 9;
    folder.write("scene.bin", &bytes);
    let mut json = triangle();
    json["accessors"][0]["sparse"] = sparse(3, 0);
    refused(folder.load(&json), &["accessor 0 sparse", "index 9", "count 3"]);
    bytes[40] = 1;
    folder.write("scene.bin", &bytes);
    refused(folder.load(&json), &["accessor 0 sparse", "increase"]);
}

#[test]
fn instances_are_capped_and_checked() {
    let instanced = |count: u64| {
        let mut json = triangle();
        json["accessors"].as_array_mut().unwrap().push(json!({ "componentType": 5126, "count": count, "type": "VEC3" }));
        json["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
        json["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 2 } } });
        json
    };
    assert_eq!(Folder::new().load(&instanced(1000)).unwrap().nodes[0].instances.len(), 1000);
    refused(Folder::new().load(&instanced(1 << 22)), &["node 0", "MAX_ZERO_FILLED_INSTANCES", "65536"]);
    assert_eq!(Folder::new().load(&instanced(1 << 16)).unwrap().nodes[0].instances.len(), 1 << 16);
    // What preparation makes of them counts: some for each of many nodes, and of many primitives.
    let mut json = instanced(1 << 16);
    json["nodes"] = json!(vec![json["nodes"][0].clone(); 7]);
    refused(Folder::new().load(&json), &["node", "memory"]);
    let mut json = instanced(1 << 16);
    json["meshes"][0]["primitives"] = json!(vec![json["meshes"][0]["primitives"][0].clone(); 10]);
    refused(Folder::new().load(&json), &["node 0", "memory"]);
    let mut json = triangle();
    json["meshes"][0]["primitives"] = json!(vec![json["meshes"][0]["primitives"][0].clone(); 5000]);
    json["nodes"] = json!(vec![json["nodes"][0].clone(); 5000]);
    refused(Folder::new().load(&json), &["node", "memory"]);
    let mut json = instanced(5);
    json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = json!(0);
    refused(Folder::new().load(&json), &["node 0", "differ in count"]);
    let mut json = instanced(3);
    json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["ROTATION"] = json!(0);
    refused(Folder::new().load(&json), &["accessor 0", "ROTATION"]);
}

#[test]
fn compressed_views_are_checked_before_they_are_decoded() {
    let compressed = |fields: Value| {
        let mut json = triangle();
        json["extensionsUsed"] = json!(["EXT_meshopt_compression"]);
        let mut ext = json!({ "buffer": 0, "byteLength": 36, "byteStride": 12, "count": 3, "mode": "ATTRIBUTES" });
        fields.as_object().unwrap().iter().for_each(|(key, value)| ext[key] = value.clone());
        json["bufferViews"][0]["extensions"] = json!({ "EXT_meshopt_compression": ext });
        json
    };
    let folder = Folder::new();
    refused(folder.load(&compressed(json!({}))), &["bufferView 0 (meshopt)", "damaged"]);
    refused(folder.load(&compressed(json!({ "count": 1u64 << 62 }))), &["bufferView 0 (meshopt)", "count"]);
    refused(folder.load(&compressed(json!({ "mode": "ZIP" }))), &["bufferView 0 (meshopt)", "ZIP"]);
    refused(folder.load(&compressed(json!({ "filter": "BLUR" }))), &["bufferView 0 (meshopt)", "BLUR"]);
    refused(folder.load(&compressed(json!({ "filter": "QUATERNION" }))), &["bufferView 0 (meshopt)", "byteStride 12"]);
    refused(folder.load(&compressed(json!({ "byteStride": 3, "count": 12 }))), &["bufferView 0 (meshopt)", "byteStride 3"]);
    refused(folder.load(&compressed(json!({ "buffer": 7 }))), &["bufferView 0 (meshopt)", "buffer 7"]);
    refused(folder.load(&compressed(json!({ "byteLength": 43 }))), &["bufferView 0 (meshopt)", "buffer 0"]);
    refused(folder.load(&compressed(json!({ "mode": "TRIANGLES", "byteStride": 4, "count": 9 }))), &["damaged"]);
    let mut bomb = compressed(json!({ "count": 1u64 << 28, "byteStride": 4 }));
    bomb["buffers"][0] = json!({ "byteLength": 1u64 << 30 });
    bomb["bufferViews"][0]["byteLength"] = json!(1u64 << 30);
    refused(folder.load(&bomb), &["bufferView 0 (meshopt)"]);
}

#[test]
fn pictures_that_are_missing_or_damaged_are_warnings() {
    let picture = |image: Value| {
        let mut json = triangle();
        json["images"] = json!([image]);
        json["textures"] = json!([{ "source": 0 }]);
        json["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
        json
    };
    let folder = Folder::new();
    folder.write("bad.png", b"\x89PNG\r\n\x1a\nnothing");
    // A PNG header that claims 60000 by 60000 pixels.
    let mut bomb = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\xea\x60\0\0\xea\x60\x08\x06\0\0\0".to_vec();
    bomb.extend([0x8a, 0xd5, 0x9e, 0x32]);
    folder.write("bomb.png", &bomb);
    let uris = ["none.png", "bad.png", "bomb.png", "data:image/png;base64,AAAA", "data:image/png;base64,*"];
    for uri in uris {
        let scene = folder.load(&picture(json!({ "uri": uri }))).unwrap();
        println!("{:?}", scene.warnings);
        assert!(matches!(scene.images[..], [SourceImage::Missing { .. }]));
        assert!(scene.warnings.iter().any(|warning| warning.contains("image 0")));
    }
    refused(folder.load(&picture(json!({}))), &["image 0", "neither uri nor bufferView"]);
    refused(folder.load(&picture(json!({ "bufferView": 5 }))), &["image 0", "bufferView 5"]);
}

#[test]
fn a_length_too_short_to_cut_to_is_refused() {
    let scene = Folder::new().load(&triangle()).unwrap();
    let options = PrepareOptions { split_larger_than_m: Some(1e-4), ..PrepareOptions::default() };
    let line = prepare(scene, &options, &|_, _, _| {}).err().expect("too short").to_string();
    assert!(line.contains("triangles added by cutting") && line.contains("16777216"), "{line}");
}

/// `accessors` that share `sparse_entries`, the first of them drawn `primitives` times.
fn drawn_often(sparse_entries: u32, accessors: usize, mode: u32, primitives: usize) -> (Folder, Value) {
    let folder = Folder::new();
    let mut bytes: Vec<u8> = (0..sparse_entries).flat_map(u32::to_le_bytes).collect();
    let values = bytes.len();
    bytes.resize(values + 12 * sparse_entries as usize, 0);
    folder.write("scene.bin", &bytes);
    let mut json = triangle();
    json["buffers"][0]["byteLength"] = json!(bytes.len());
    json["bufferViews"] = json!([
        { "buffer": 0, "byteLength": values },
        { "buffer": 0, "byteOffset": values, "byteLength": bytes.len() - values }
    ]);
    let sparse =
        json!({ "count": sparse_entries, "indices": { "bufferView": 0, "componentType": 5125 }, "values": { "bufferView": 1 } });
    let accessor = json!({ "componentType": 5126, "count": sparse_entries, "type": "VEC3", "sparse": sparse });
    json["accessors"] = json!(vec![accessor; accessors]);
    let primitive = json!({ "attributes": { "POSITION": 0 }, "mode": mode });
    json["meshes"][0]["primitives"] = json!(vec![primitive; primitives]);
    (folder, json)
}

#[test]
fn long_sparse_accessors_that_many_share_take_no_time() {
    const ENTRIES: u32 = 1 << 18;
    // Each would take long if every use read the indices again.
    let begun = Instant::now();
    let (folder, json) = drawn_often(ENTRIES, 1, 0, 60_000);
    let scene = folder.load(&json).unwrap();
    assert!(scene.meshes[0].primitives.is_empty() && scene.warnings[0].contains("points"));
    let (folder, json) = drawn_often(ENTRIES, 1, 4, 60_000);
    refused(folder.load(&json), &["accessor 0", "memory"]);
    let (folder, json) = drawn_often(ENTRIES, 60_000, 0, 1);
    refused(folder.load(&json), &["accessor", "sparse", "memory"]);
    assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
}

#[test]
fn meshes_and_skins_that_many_nodes_share_take_no_time() {
    let begun = Instant::now();
    let mut json = triangle();
    let point = json!({ "attributes": { "POSITION": 0, "JOINTS_0": 0 }, "mode": 0 });
    json["meshes"][0]["primitives"] = json!(vec![point; 30_000]);
    json["skins"] = json!([{ "joints": vec![0; 100_000] }]);
    json["nodes"] = json!(vec![json!({ "mesh": 0, "skin": 0 }); 30_000]);
    refused(Folder::new().load(&json), &["memory"]);
    json["meshes"][0]["primitives"][0]["mode"] = json!(4);
    json["meshes"][0]["primitives"].as_array_mut().unwrap().truncate(1);
    refused(Folder::new().load(&json), &["skin 0", "memory"]);
    assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
}

#[test]
fn a_file_that_is_named_often_is_read_once() {
    const TIMES: usize = 3000;
    let folder = Folder::new();
    // A megabyte that is a picture of one pixel: the decoder stops at its end.
    let mut picture = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(1, 1).write_to(&mut picture, image::ImageFormat::Png).unwrap();
    let mut picture = picture.into_inner();
    picture.resize(1 << 20, 0);
    folder.write("picture.png", &picture);
    let spellings = ["picture.png", "./picture.png", "%70icture.png", "data:image/png;base64,AAAA"];
    let mut json = triangle();
    json["images"] = (0..TIMES).map(|k| json!({ "uri": spellings[k % 4] })).collect();
    json["textures"] = (0..TIMES).map(|k| json!({ "source": k })).collect();
    let material = |k: usize| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": k } } });
    json["materials"] = (0..TIMES).map(material).collect();
    let scene = folder.load(&json).unwrap();
    assert!(matches!(&scene.images[..], [SourceImage::Encoded { bytes, .. }, SourceImage::Missing { .. }] if *bytes == picture));
    assert!(scene.materials.iter().enumerate().all(|(k, m)| m.texture.unwrap().image == u32::from(k % 4 == 3)));

    // Buffers likewise: 4097 of a megabyte would not fit into the limit on files.
    let mut bytes = triangle_bytes();
    bytes.resize(1 << 20, 0);
    folder.write("scene.bin", &bytes);
    let mut json = triangle();
    let buffer = json["buffers"][0].clone();
    json["buffers"] = json!(vec![buffer; 4097]);
    json["bufferViews"][1]["buffer"] = json!(4096);
    assert_eq!(folder.load(&json).unwrap().meshes[0].primitives[0].indices, [0, 1, 2]);
    // Nor does naming a file again earn the right to decode more.
    json["accessors"][0] = json!({ "componentType": 5126, "count": 1 << 22, "type": "VEC3" });
    let primitive = json!({ "attributes": { "POSITION": 0 } });
    json["meshes"][0]["primitives"] = json!(vec![primitive; 20]);
    refused(folder.load(&json), &["memory"]);
}

#[test]
fn short_entries_do_not_add_up_to_much_memory() {
    let folder = Folder::new();
    let file = |lists: &str| format!("{{\"asset\":{{\"version\":\"2.0\"}},{lists}}}");
    let many = |item: &str, count: usize| vec![item; count].join(",");
    // Four million in each file: hundreds of bytes for three or four.
    const COUNT: usize = 4 << 20;
    let top = format!("\"nodes\":[{}]", many("{}", COUNT));
    let half = format!("\"materials\":[{}],\"nodes\":[{}]", many("{}", COUNT / 2), many("{}", COUNT / 2));
    let nested = format!("\"meshes\":[{}]", many("{\"primitives\":[{},{},{},{}]}", COUNT / 4));
    let maps = format!("\"meshes\":[{{\"primitives\":[{{\"targets\":[{}]}}]}}]", many("{\"a\":1}", COUNT / 2));
    for lists in [top, half, nested, maps] {
        refused(folder.load_bytes("scene.gltf", file(&lists).as_bytes()), &["JSON", "LISTED_BYTES", "line 1"]);
    }
    // Honest ones pass in any number; the budget is the file's, not the process's.
    let node = "{\"mesh\":0,\"name\":\"leaf\",\"translation\":[1.5,0,-2.25]}";
    let mesh = "\"meshes\":[{\"primitives\":[]}]";
    for _ in 0..2 {
        let scene = folder.load_bytes("scene.gltf", file(&format!("{mesh},\"nodes\":[{}]", many(node, 400_000))).as_bytes());
        assert_eq!(scene.unwrap().nodes.len(), 400_000);
    }
}
