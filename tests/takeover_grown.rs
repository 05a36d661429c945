//! Goal: what was inserted into a show outlives its master, too, and of two masters that grew apart one follows the other.
//! Method: masters are processes of their own, each with a library of its own; nodes are threads.

mod support;

use std::path::Path;
use std::time::Instant;

use glam::{DAffine3, DVec3};
use mullion_common::wire::Part;
use mullion_control::{Command, Control, Insert, Inserted, MoveObject, ObjectNumber, Reason};
use mullion_server::prepare::{PrepareOptions, write_package};
use mullion_server::record::Reader;
use support::masters::{LIMIT, NODES, Node, control_of, free_address, prepared, serve};
use support::relay::Relay;
use support::{Process, address_of, mullion};

const ANY: &str = "127.0.0.1:0";

/// A folder with the show's files, and packages in libraries: `first` has both, `second` none yet.
fn with_libraries() -> tempfile::TempDir {
    let folder = prepared();
    for library in ["first", "second"] {
        std::fs::create_dir(folder.path().join(library)).expect("made");
    }
    let palace = support::package(&folder.path().join("palace.glb"), &PrepareOptions::default());
    for name in ["wing.mullion", "tower.mullion"] {
        write_package(&palace, &folder.path().join("first").join(name)).expect("written");
    }
    folder
}

fn give(folder: &Path, package: &str) {
    std::fs::copy(folder.join("first").join(package), folder.join("second").join(package)).expect("copied");
}

/// Starts a master that can be steered.
fn start(folder: &Path, listen: &str, library: &str, more: &[&str]) -> (Process, String) {
    let library = folder.join(library).display().to_string();
    let mut master = serve(folder, listen, &[&["--control", ANY, "--library", &library, "--path", "whole"], more].concat());
    let address = address_of(&mut master);
    (master, address)
}

fn insert(control: &mut Control, package: &str) -> Result<Inserted, mullion_control::Error> {
    insert_under(control, package, None)
}

fn insert_under(control: &mut Control, package: &str, under: Option<u32>) -> Result<Inserted, mullion_control::Error> {
    control.insert(&Insert { package: package.to_owned(), under, transform: DAffine3::IDENTITY.to_cols_array() })
}

fn is_seen(control: &mut Control, object: u32) -> bool {
    NODES.iter().any(|tile| control.why(&object.to_string(), tile).expect("it answers").is_seen)
}

/// Waits for a frame: what was answered reaches a standby with a frame that comes after the answer.
fn shows(control: &mut Control, frame: u64) {
    while control.next_status().expect("it runs").frame < frame {}
}

/// A transform out of everybody's sight.
fn far_off(object: u32) -> MoveObject {
    MoveObject { object, transform: DAffine3::from_translation(DVec3::new(0.0, 0.0, 1e6)).to_cols_array() }
}

#[cfg(unix)]
#[test]
fn a_standby_takes_over_a_scene_that_has_grown() {
    let folder = with_libraries();
    let address = free_address();
    let (mut master, _) = start(folder.path(), &address, "first", &[]);
    let record = folder.path().join("heir.rec").display().to_string();
    let (mut standby, heir) = start(folder.path(), ANY, "second", &["--standby-of", &address, "--record", &record]);
    master.error_line(&["standby joined"], 0, LIMIT);
    let started = Instant::now();
    let nodes = NODES.map(|name| Node::start(name, Part::Own, &[&address, &heir]));
    nodes.iter().for_each(|node| drop(node.shows(5, started)));

    let mut control = control_of(&mut master);
    let refused = insert(&mut control, "wing.mullion").expect_err("the standby has no such file").to_string();
    assert!(refused.contains("the master that stands by cannot follow: package \"wing.mullion\""), "{refused}");
    give(folder.path(), "wing.mullion");
    let wing = insert(&mut control, "wing.mullion").expect("now it has").objects;
    // Something of what is new goes, something else moves.
    let (gone, moved) = (wing.first, wing.first + wing.count - 1);
    let moves = Command::Move(vec![far_off(moved)]);
    let taken = control.send(&[Command::Remove(ObjectNumber { object: gone }), moves]).expect("taken");
    shows(&mut control, taken + 5);

    master.kill();
    let killed = Instant::now();
    nodes.iter().for_each(|node| drop(node.shows(20, killed)));
    standby.error_line(&["is gone", "going on from frame"], 0, LIMIT);
    let mut of_heir = control_of(&mut standby);
    let why = of_heir.why(&gone.to_string(), NODES[0]).expect("it answers");
    assert!(why.leaf_count > 0 && why.leaves.iter().all(|leaf| leaf.views == [Reason::Removed]), "{why:?}");
    of_heir.send(&[Command::Add(ObjectNumber { object: gone })]).expect("taken");
    assert!(is_seen(&mut of_heir, gone) && !is_seen(&mut of_heir, moved));
    give(folder.path(), "tower.mullion");
    // What is inserted under something that was removed is seen.
    of_heir.send(&[Command::Remove(ObjectNumber { object: gone })]).expect("taken");
    let tower = insert_under(&mut of_heir, "tower.mullion", Some(gone)).expect("inserted").objects;
    assert!(tower.first == wing.first + wing.count && is_seen(&mut of_heir, tower.first));

    // The first master is back, catches up with both insertions, and goes on where the second one dies.
    let report = folder.path().join("report.json").display().to_string();
    let (mut master, _) = start(folder.path(), &address, "first", &["--standby-of", &heir, "--report", &report]);
    standby.error_line(&["standby joined"], 0, LIMIT);
    let Inserted { frame, objects: third } =
        insert(&mut of_heir, "wing.mullion").expect("inserted, once the standby has caught up");
    shows(&mut of_heir, frame + 5);
    standby.kill();
    let killed = Instant::now();
    nodes.iter().for_each(|node| drop(node.shows(20, killed)));
    let mut control = control_of(&mut master);
    assert!(is_seen(&mut control, third.first) && is_seen(&mut control, tower.first) && !is_seen(&mut control, moved));
    assert!(nodes.iter().all(|node| node.last().epoch == 4), "three insertions");
    nodes.into_iter().for_each(Node::end);
    master.signal(rustix::process::Signal::INT);
    assert_eq!(master.wait(LIMIT), Some(0), "{}", master.err.text());
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(report).expect("written")).expect("JSON");
    assert_eq!(report["objects"], third.first + third.count, "{report}");

    // What the heir recorded begins with the scene that it inherited.
    let recorded = std::fs::read(&record).expect("a record");
    let first = Reader::open(&recorded[..]).expect("a record").next_frame().expect("whole").expect("a frame");
    let inherited = first.begins_with.expect("another master's scene");
    assert_eq!(inherited.iter().map(|insertion| insertion.package.as_str()).collect::<Vec<_>>(), ["wing.mullion"]);
    let path = |name: &str| folder.path().join(name).display().to_string();
    let of = ["--wall", &path("wall.toml"), "--scene", &path("palace.glb"), "--library", &path("second")];
    let done = mullion(&[&["replay", &record][..], &of].concat(), LIMIT);
    assert!(done.code == Some(0) && done.out.contains("the same sets, bit for bit"), "{}{}", done.out, done.err);
}

#[test]
fn of_two_masters_that_grew_apart_the_one_that_steps_back_follows_the_other() {
    let folder = with_libraries();
    ["wing.mullion", "tower.mullion"].iter().for_each(|package| give(folder.path(), package));
    let (mut master, address) = start(folder.path(), ANY, "first", &[]);
    let way = Relay::to(address.clone());
    let (mut standby, heir) = start(folder.path(), ANY, "second", &["--standby-of", &way.address]);
    let (joined, _) = master.error_line(&["standby joined"], 0, LIMIT);
    let started = Instant::now();
    let nodes = NODES.map(|name| Node::start(name, Part::Own, &[&address, &heir]));
    nodes.iter().for_each(|node| drop(node.shows(10, started)));

    way.cut();
    let (took_over, _) = standby.error_line(&["is gone", "going on from frame"], 0, LIMIT);
    let (mut control, mut of_heir) = (control_of(&mut master), control_of(&mut standby));
    while of_heir.next_status().expect("it drives").is_standing_by {}
    let apart = insert(&mut of_heir, "tower.mullion").expect("nobody has to prepare").objects;
    of_heir.send(&[Command::Move(vec![far_off(apart.first), far_off(1)])]).expect("taken");
    let wing = insert(&mut control, "wing.mullion").expect("inserted").objects;
    assert_eq!(wing.first, apart.first);
    way.mend();
    let (stepped_back, _) = standby.error_line(&["drives the wall", "stepping back"], took_over, LIMIT);
    master.error_line(&["standby joined"], joined + 1, LIMIT);
    let Inserted { frame, objects: tower } =
        insert(&mut control, "tower.mullion").expect("inserted, once the standby has followed");
    shows(&mut control, frame + 5);
    assert_eq!(tower.first, wing.first + wing.count);

    master.kill();
    let killed = Instant::now();
    nodes.iter().for_each(|node| drop(node.shows(20, killed)));
    standby.error_line(&["is gone", "going on from frame"], stepped_back, LIMIT);
    let status = of_heir.next_status().expect("it drives").clone();
    assert!(!status.is_standing_by);
    for object in [1, wing.first, tower.first] {
        let why = of_heir.why(&object.to_string(), NODES[0]).expect("it answers");
        assert!(why.leaf_count > 0, "{why:?}");
        assert!(is_seen(&mut of_heir, object), "what it moved itself is forgotten: {object}");
    }
    assert!(nodes.iter().all(|node| node.last().epoch == 3));
    nodes.into_iter().for_each(Node::end);
}

#[test]
fn a_standby_that_lacks_what_is_shown_already_says_so_and_ends() {
    let folder = with_libraries();
    let (mut master, address) = start(folder.path(), ANY, "first", &[]);
    insert(&mut control_of(&mut master), "wing.mullion").expect("inserted");
    let without = serve(folder.path(), ANY, &["--standby-of", &address]);
    let (with_another, _) = start(folder.path(), ANY, "second", &["--standby-of", &address]);
    for (mut standby, problem) in
        [(without, "has no library; start it with --library"), (with_another, "package \"wing.mullion\"")]
    {
        let code = standby.wait(LIMIT);
        let said = standby.err.text();
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains("the master to stand by for refused") && said.contains(problem), "{said}");
    }
    assert!(master.is_running());
}
