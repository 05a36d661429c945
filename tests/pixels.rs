//! Culling changes no picture: `mullion verify pixels` on the generated city, and on foreign models where they are.

mod support;

use std::path::{Path, PathBuf};
use std::time::Duration;

use mullion_server::generate::{GeneratedScene, write_glb};
use serde_json::Value;
use support::mullion;

const LIMIT: Duration = Duration::from_secs(400);

/// Every way of occlusion culling that promises to change nothing.
const EXACT: [&str; 4] = ["paper", "cost-adaptive", "query", "hiz"];

/// Verifies scenes and checks that the verdict is about something.
fn verify(scenes: &[PathBuf], grids: &str, more: &[&str]) -> Vec<Value> {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("verdict.json").display().to_string();
    let mut args: Vec<String> = ["verify", "pixels", "--grids", grids, "--json", &json].map(str::to_owned).into();
    args.extend(more.iter().copied().map(str::to_owned));
    args.extend(scenes.iter().map(|scene| scene.display().to_string()));
    let done = mullion(&args, LIMIT);
    assert_eq!(done.code, Some(0), "{}{}", done.out, done.err);
    let verdicts: Vec<Value> =
        serde_json::from_slice(&std::fs::read(Path::new(&json)).expect("the verdict is there")).expect("it is a list in JSON");
    assert_eq!(verdicts.len(), scenes.len());
    for verdict in &verdicts {
        let number = |key: &str| verdict[key].as_f64().unwrap_or_else(|| panic!("{key}: {verdict}"));
        assert!(number("tiles_compared") > 0.0, "{verdict}");
        assert!(number("objects_seen") > 0.0, "{verdict}");
        assert!(number("culled_percent") > 20.0, "little was culled, so little is shown: {verdict}");
        for wrong in ["tiles_that_differ", "objects_missing"] {
            assert_eq!(number(wrong), 0.0, "{verdict}");
        }
    }
    verdicts
}

/// The same with occlusion culling: no pixel differs, and something was left out.
fn verify_occlusion(scenes: &[PathBuf]) {
    for verdict in verify(scenes, "4x4", &["--occlusion", &EXACT.join(",")]) {
        let ways = verdict["occlusion"].as_array().expect("a list");
        assert_eq!(ways.iter().map(|way| way["occlusion"].as_str().expect("a name")).collect::<Vec<_>>(), EXACT);
        for way in ways {
            let number = |key: &str| way[key].as_u64().unwrap_or_else(|| panic!("{key}: {verdict}"));
            assert!(number("tiles_compared") > 4 * 16, "several frames of each tile: {verdict}");
            assert!(number("leaves_left_out") > 0, "nothing was hidden: {verdict}");
            assert_eq!([number("pixels_that_differ"), number("tiles_that_differ")], [0, 0], "{verdict}");
        }
    }
}

#[test]
fn the_city_looks_the_same_however_much_is_culled() {
    if !support::has_gpu() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    verify(&[support::city(folder.path())], "1x1,3x2", &[]);
}

#[test]
fn foreign_scenes_look_the_same_however_much_is_culled() {
    let names = ["CesiumMilkTruck_external/CesiumMilkTruck.gltf", "cad_2cylinder_engine.glb", "scan_armadillo_86k.glb"];
    let scenes = support::models(&names);
    if scenes.is_empty() || !support::has_gpu() {
        return;
    }
    verify(&scenes, "2x2,4x4", &[]);
}

#[test]
fn a_wall_looks_the_same_whatever_is_hidden() {
    if !support::has_gpu() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("boxes.glb");
    let boxes: GeneratedScene = "boxes:500".parse().expect("a scene");
    write_glb(boxes, 1, &scene).expect("written");
    verify_occlusion(&[scene]);
}

#[test]
fn foreign_scenes_look_the_same_whatever_is_hidden() {
    let scenes = support::models(&["CesiumMilkTruck_external/CesiumMilkTruck.gltf", "cad_2cylinder_engine.glb"]);
    if scenes.is_empty() || !support::has_gpu() {
        return;
    }
    verify_occlusion(&scenes);
}

#[test]
fn only_what_promises_the_same_picture_is_verified() {
    for (way, why) in [("sampled", "an estimate"), ("none", "nothing to verify"), ("some", "no way to cull")] {
        let outcome = mullion(&["verify", "pixels", "scene.glb", "--occlusion", way], LIMIT);
        assert!(outcome.code != Some(0) && outcome.err.contains(why), "{}", outcome.err);
    }
}
