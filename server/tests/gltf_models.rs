//! Goal: foreign files come out right. Method: every model in `MULLION_MODELS` is compared with the `gltf`
//! crate's own importer, and the edge cases there with the Khronos validator's verdicts.
use mullion_server::prepare::gltf::{ImportError, ImportErrorKind, SourceScene, load};
use std::path::{Path, PathBuf};

fn models() -> Option<PathBuf> {
    let folder = std::env::var_os("MULLION_MODELS").map(PathBuf::from);
    if folder.is_none() {
        println!("skipped: MULLION_MODELS is not set");
    }
    folder
}

fn read(path: &Path) -> Result<SourceScene, ImportError> {
    load(path, &|_, _, _| {})
}

fn triangles(scene: &SourceScene) -> usize {
    let of_mesh = |mesh: u32| {
        let primitives = &scene.meshes[mesh as usize].primitives;
        primitives.iter().map(|p| p.indices.len() / 3).sum::<usize>()
    };
    let nodes = scene.nodes.iter();
    nodes.map(|n| n.mesh.map_or(0, of_mesh) * n.instances.len().max(1)).sum()
}

#[test]
fn models_agree_with_the_gltf_crate() {
    let Some(folder) = models() else { return };
    let manifest = std::fs::read(folder.join("manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_slice(&manifest).unwrap();
    for entry in manifest["models"].as_array().unwrap() {
        let name = entry["path"].as_str().unwrap();
        if entry["set"] != "models" {
            continue;
        }
        let path = folder.join(name);
        let start = std::time::Instant::now();
        let scene = read(&path).unwrap();
        let took = start.elapsed();
        println!(
            "{name}: {} nodes, {} triangles, {} images, {} warnings, {took:?}",
            scene.nodes.len(),
            triangles(&scene),
            scene.images.len(),
            scene.warnings.len()
        );
        for warning in scene.warnings.iter().take(3) {
            println!("    {warning}");
        }
        assert_eq!(scene.nodes.len() as u64, entry["nodes"].as_u64().unwrap(), "{name}");
        let expected = entry["triangles_instanced"].as_u64().unwrap();
        assert_eq!(triangles(&scene) as u64, expected, "{name}");
        compare(&path, &scene);
    }
}

/// Positions, normals and indices, bit for bit, against `gltf::import`.
fn compare(path: &Path, scene: &SourceScene) {
    let (document, buffers, _) = gltf::import(path).unwrap();
    assert_eq!(document.meshes().len(), scene.meshes.len());
    for (theirs, ours) in document.meshes().zip(&scene.meshes) {
        let mut ours = ours.primitives.iter();
        for theirs in theirs.primitives() {
            if theirs.mode() != gltf::mesh::Mode::Triangles {
                continue;
            }
            let ours = ours.next().unwrap();
            assert_eq!(ours.gltf_primitive as usize, theirs.index());
            let reader = theirs.reader(|buffer| buffers.get(buffer.index()).map(|data| &data.0[..]));
            let positions = reader.read_positions().unwrap();
            assert!(positions.eq(ours.positions.iter().map(|p| p.to_array())));
            match reader.read_normals() {
                Some(normals) => {
                    assert!(normals.eq(ours.normals.iter().flatten().map(|n| n.to_array())))
                }
                None => assert!(ours.normals.is_none()),
            }
            match reader.read_indices() {
                Some(indices) => assert!(indices.into_u32().eq(ours.indices.iter().copied())),
                None => assert_eq!(ours.indices.len(), ours.positions.len()),
            }
            assert_eq!(ours.material.map(|m| m as usize), theirs.material().index());
        }
        assert!(ours.next().is_none());
    }
    for (theirs, ours) in document.nodes().zip(&scene.nodes) {
        let matrix = glam::Mat4::from_cols_array_2d(&theirs.transform().matrix());
        let own = glam::DMat4::from(ours.parent_from_local).as_mat4();
        assert!(matrix.abs_diff_eq(own, 1e-3 * own.abs_max()), "{matrix} {own}");
        assert_eq!(theirs.mesh().map(|m| m.index() as u32), ours.mesh);
        assert!(theirs.children().map(|c| c.index() as u32).eq(ours.children.iter().copied()));
    }
}

trait AbsMax {
    fn abs_max(&self) -> f32;
}

impl AbsMax for glam::Mat4 {
    fn abs_max(&self) -> f32 {
        self.to_cols_array().into_iter().fold(1.0, |most, value| most.max(value.abs()))
    }
}

#[test]
fn edge_cases_load_or_say_why() {
    let Some(folder) = models() else { return };
    let folder = folder.join("edge");
    let index = std::fs::read(folder.join("edge_index.json")).unwrap();
    let index: serde_json::Value = serde_json::from_slice(&index).unwrap();
    for (name, entry) in index["files"].as_object().unwrap() {
        let outcome = read(&folder.join(name));
        let valid = entry["verdict"] == "valid";
        match &outcome {
            Ok(scene) if valid => println!("ok       {name}: {} triangles", triangles(scene)),
            Ok(_) => println!("lenient  {name}: {}", entry["codes"]),
            Err(error) => println!("refused  {error}"),
        }
        if let Err(error) = &outcome {
            let line = error.to_string();
            assert!(!line.contains('\n') && line.contains(name.rsplit('/').next().unwrap()), "{line}");
        }
        // A valid file loads, or the error names what it needs: an extension, or a later glTF.
        let needs_more = match &outcome {
            Err(ImportError { kind: ImportErrorKind::Extension(_), .. }) => true,
            Err(ImportError { kind: ImportErrorKind::Version(why), .. }) => why.starts_with("minVersion 2.1,"),
            _ => false,
        };
        assert!(!valid || outcome.is_ok() || needs_more, "{name} is valid: {outcome:?}");
    }
}
