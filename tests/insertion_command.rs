//! Goal: `serve --library` inserts, tells at its end of the whole scene, and its record replays with the library, and only with it.
//! Method: the binary alone, steered with the client crate.

mod support;

use std::path::Path;
use std::time::Duration;

use glam::{DAffine3, DVec3};
use mullion_control::Insert;
use mullion_server::generate::write_glb;
use mullion_server::prepare::{PrepareOptions, write_package};
use support::masters::control_of;
use support::{Process, mullion};

const LIMIT: Duration = Duration::from_secs(120);

fn write_boxes(leaves: u32, folder: &Path, name: &str) {
    let source = folder.join("boxes.glb");
    write_glb(format!("boxes:{leaves}").parse().expect("a scene"), 1, &source).expect("written");
    write_package(&support::package(&source, &PrepareOptions::default()), &folder.join(name)).expect("written");
}

#[test]
fn the_command_line_inserts_tells_of_the_whole_scene_and_replays() {
    let folder = tempfile::tempdir().expect("a folder");
    write_boxes(40, folder.path(), "scene.mullion");
    write_boxes(60, folder.path(), "more.mullion");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (wall, scene, record, report) = (path("wall.toml"), path("scene.mullion"), path("show.rec"), path("report.json"));
    std::fs::write(&wall, "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n").expect("written");
    let (any, library) = ("127.0.0.1:0", folder.path().display().to_string());
    let how = ["--library", &library, "--record", &record, "--report", &report, "--frames", "400", "--path", "whole"];
    let mut serve = Process::start(&[&["serve", &wall, &scene, "--listen", any, "--control", any][..], &how].concat());
    let transform = DAffine3::from_translation(DVec3::X).to_cols_array();
    let insert = Insert { package: "more.mullion".to_owned(), under: None, transform };
    assert!(control_of(&mut serve).insert(&insert).expect("inserted").objects.count > 60);
    assert_eq!(serve.wait(LIMIT), Some(0), "{}", serve.err.text());
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(report).expect("written")).expect("JSON");
    assert_eq!(report["leaves"], 100, "{report}");
    let replay = ["replay", &record, "--wall", &wall, "--scene", &scene];
    let done = mullion(&[&replay[..], &["--library", &library]].concat(), LIMIT);
    assert!(done.code == Some(0) && done.out.contains("400 frames"), "{}{}", done.out, done.err);
    let done = mullion(&replay, LIMIT);
    assert!(done.code != Some(0) && done.err.contains("--library"), "{}{}", done.out, done.err);
}
