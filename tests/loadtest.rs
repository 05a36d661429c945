//! `mullion loadtest` as users run it: every node in step, every set the master's. Times are never looked at.

mod support;

use std::fs;
use std::time::Duration;

use serde_json::Value;
use support::mullion;
use tempfile::TempDir;

/// Generous for a debug build on a busy machine; a hang is longer.
const LIMIT: Duration = Duration::from_secs(60);

#[test]
fn a_wall_of_processes_takes_every_set_as_the_master_has_it() {
    let folder = TempDir::new().expect("a folder");
    let json = folder.path().join("load.json").display().to_string();
    let arguments = ["loadtest", "--scene", "palace", "--grid", "3x2", "--processes", "2", "--seconds", "1", "--hz", "20"];
    let outcome = mullion(&[&arguments[..], &["--on-time", "0", "--json", &json]].concat(), LIMIT);
    assert_eq!((outcome.code, outcome.err.as_str()), (Some(0), ""), "{}", outcome.out);
    assert!(outcome.out.contains("6 nodes in 2 processes"), "{}", outcome.out);
    let report: Value = serde_json::from_slice(&fs::read(&json).expect("a report")).expect("JSON");
    assert_eq!((report["nodes"].as_u64(), report["processes"].as_u64(), report["frames"].as_u64()), (Some(6), Some(2), Some(20)));
    let done = &report["done"];
    assert_eq!((done["connections"].as_u64(), done["left"].as_u64()), (Some(6), Some(0)));
    // A node that is passed over may leave out frames, not more than there are.
    let (applied, frames) = (done["applied"].as_u64().expect("a count"), 20 + 20 + 1);
    assert!((6..=6 * frames).contains(&applied), "{applied}");
    assert!(report["bytes_per_node_and_frame"]["median"].as_f64().expect("bytes") > 100.0);
}

#[test]
fn a_process_dies_and_another_hangs_and_no_set_is_wrong() {
    let folder = TempDir::new().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (json, faults) = (at("load.json"), at("faults.json"));
    let what = r#"[{"at_s": 0.1, "process": 1, "what": "kill", "for_ms": 100},
                   {"at_s": 0.4, "process": 0, "what": "hang", "for_ms": 100}]"#;
    fs::write(&faults, what).expect("written");
    let arguments = ["loadtest", "--scene", "palace", "--grid", "2x2", "--processes", "2", "--seconds", "2", "--hz", "20"];
    let outcome = mullion(&[&arguments[..], &["--faults", &faults, "--json", &json]].concat(), LIMIT);
    // Whether all came back in time is the machine's matter.
    let report: Value = serde_json::from_slice(&fs::read(&json).expect("a report")).expect("JSON");
    let (bearing, done) = (&report["bearing"], &report["done"]);
    assert_eq!((bearing["kills"].as_u64(), bearing["hangs"].as_u64()), (Some(1), Some(1)), "{}", outcome.err);
    assert_eq!((done["left"].as_u64(), report["frames"].as_u64()), (Some(0), Some(40)));
    let missing = mullion(&[&arguments[..], &["--faults", &at("nowhere.json")]].concat(), LIMIT);
    assert_eq!(missing.code, Some(2));
    assert!(missing.err.contains("nowhere.json"), "{}", missing.err);
}

#[test]
fn hostile_peers_change_nothing_for_the_others() {
    let folder = TempDir::new().expect("a folder");
    let json = folder.path().join("load.json").display().to_string();
    let arguments = ["loadtest", "--scene", "palace", "--grid", "2x2", "--processes", "1", "--seconds", "2", "--hz", "20"];
    let outcome = mullion(&[&arguments[..], &["--on-time", "0", "--hostile", "3", "--json", &json]].concat(), LIMIT);
    assert_eq!(outcome.code, Some(0), "{}", outcome.err);
    let report: Value = serde_json::from_slice(&fs::read(&json).expect("a report")).expect("JSON");
    let done = &report["done"];
    assert_eq!((done["connections"].as_u64(), done["left"].as_u64()), (Some(3), Some(0)), "nobody else lost its connection");
    assert!(report["hostile_connections"].as_u64().is_some_and(|count| count > 3), "{report}");
    let warnings = outcome.err.lines().count() as u64;
    assert!(warnings <= 4 * outcome.took.as_secs() + 8, "the log stays readable: {warnings} lines");
}

#[test]
fn what_was_asked_for_and_not_reached_is_an_error() {
    let outcome = mullion(&["loadtest", "--scene", "palace", "--grid", "1x1", "--seconds", "1", "--hz", "nonsense"], LIMIT);
    assert_eq!(outcome.code, Some(2));
    let outcome = mullion(&["loadtest", "--scene", "nowhere.glb", "--grid", "1x1"], LIMIT);
    assert_eq!(outcome.code, Some(2));
    assert!(outcome.err.contains("nowhere.glb"), "{}", outcome.err);
}
