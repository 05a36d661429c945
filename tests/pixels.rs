//! Culling changes no picture: `mullion verify pixels` on the generated city, and on foreign models where they are.

mod support;

use std::path::{Path, PathBuf};
use std::time::Duration;

use support::mullion;

const LIMIT: Duration = Duration::from_secs(400);

/// Verifies scenes and checks that the verdict is about something.
fn verify(scenes: &[PathBuf], grids: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("verdict.json").display().to_string();
    let mut args: Vec<String> = ["verify", "pixels", "--grids", grids, "--json", &json].map(str::to_owned).into();
    args.extend(scenes.iter().map(|scene| scene.display().to_string()));
    let done = mullion(&args, LIMIT);
    assert_eq!(done.code, Some(0), "{}{}", done.out, done.err);
    let verdicts: serde_json::Value =
        serde_json::from_slice(&std::fs::read(Path::new(&json)).expect("the verdict is there")).expect("it is JSON");
    let verdicts = verdicts.as_array().expect("a list");
    assert_eq!(verdicts.len(), scenes.len());
    for verdict in verdicts {
        let number = |key: &str| verdict[key].as_f64().unwrap_or_else(|| panic!("{key}: {verdict}"));
        assert!(number("tiles_compared") > 0.0, "{verdict}");
        assert!(number("objects_seen") > 0.0, "{verdict}");
        assert!(number("culled_percent") > 20.0, "little was culled, so little is shown: {verdict}");
        for wrong in ["tiles_that_differ", "objects_missing"] {
            assert_eq!(number(wrong), 0.0, "{verdict}");
        }
    }
}

#[test]
fn the_city_looks_the_same_however_much_is_culled() {
    if !support::has_gpu() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    verify(&[support::city(folder.path())], "1x1,3x2");
}

#[test]
fn foreign_scenes_look_the_same_however_much_is_culled() {
    let names = ["CesiumMilkTruck_external/CesiumMilkTruck.gltf", "cad_2cylinder_engine.glb", "scan_armadillo_86k.glb"];
    let scenes = support::models(&names);
    if scenes.is_empty() || !support::has_gpu() {
        return;
    }
    verify(&scenes, "2x2,4x4");
}
