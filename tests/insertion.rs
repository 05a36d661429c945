//! Goal: a package is inserted into a running show through the control API: all nodes have it with one frame, none misses a frame for it,
//! and the record culls the same.
//! Method: a service with a library, the client crate, nodes that hold every set against the master's digest, all on loopback. Nothing
//! sleeps to synchronise; every wait ends.

#[path = "support/memory_file.rs"]
mod memory_file;
mod session_support;
#[path = "support/steered.rs"]
mod steered;

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use glam::{DAffine3, DVec3};
use mullion_client::node::{NodeError, NodeOptions, Reconnect};
use mullion_client::protocol_node::{self, ProtocolReport};
use mullion_common::visible_set::VisibleSet;
use mullion_control::{Command, Control, Error, Insert, Inserted, MoveObject, NodeStanding, ObjectNumber, ObjectRange, Reason};
use mullion_server::control::LiveScene;
use mullion_server::library::Library;
use mullion_server::prepare::write_package;
use mullion_server::record::{Ending, Reader};
use mullion_server::service::{Offer, ShowReport};
use session_support::{OBJECTS, package, wall};
use steered::{Addresses, LEAVES, Steered};

const RATE_HZ: f64 = 100.0;

type NodeThread = JoinHandle<Result<ProtocolReport, NodeError>>;

/// Runs a show that `steer` steers, and gives back its record, what it reports, and what `steer` does.
fn steered<T>(packages: Option<&Path>, steer: impl FnOnce(Addresses) -> T) -> (Vec<u8>, ShowReport, T) {
    Steered { distance_m: 60.0, rate_hz: RATE_HZ, barrier_wait: Some(Duration::from_secs(2)), packages }.run(steer)
}

fn node(master: SocketAddr, name: &'static str) -> NodeThread {
    let options = NodeOptions {
        memory_bytes: 0,
        reconnect: Reconnect { give_up_after: Some(Duration::from_secs(5)), ..Reconnect::default() },
        ..NodeOptions::plain(name, master.to_string())
    };
    thread::spawn(move || {
        tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(protocol_node::run(options))
    })
}

fn wait_for(control: &mut Control, is_so: impl Fn(&mullion_control::Status) -> bool) {
    while !is_so(control.next_status().unwrap()) {}
}

/// A library with a package that shares chunks with the scene, and one that is none.
fn library() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_package(&package(60), &folder.path().join("more.mullion")).unwrap();
    std::fs::write(folder.path().join("broken.mullion"), "MULLION").unwrap();
    folder
}

fn insert(package: &str, under: Option<u32>, x: f64) -> Insert {
    Insert { package: package.into(), under, transform: DAffine3::from_translation(DVec3::new(x, 0.0, 0.0)).to_cols_array() }
}

/// Culls a record again, inserting from a library: how many frames.
fn replayed(record: &[u8], library: &Path) -> u64 {
    let (wall, mut scene_package) = (wall(2, 1), package(LEAVES));
    let library = Library::open(library).unwrap();
    let mut reader = Reader::open(record).unwrap();
    let mut scene = LiveScene::new(reader.header().algorithm.parse().unwrap(), &wall, &scene_package);
    let mut sets = vec![VisibleSet::default(); wall.views().len()];
    let mut frames = 0;
    while let Some(mut frame) = reader.next_frame().unwrap() {
        if let Some(insertion) = &frame.insertion {
            let added = library.inserted(insertion).unwrap();
            let place = DAffine3::from_cols_array(&insertion.world_from_root);
            let (offer, _) = Offer::new(&scene_package, &added, &insertion.package, insertion.under, place).unwrap();
            scene_package = Arc::clone(offer.package());
            frame.pose.offer = Some(Arc::new(offer));
        }
        scene.cull(&frame.pose, &mut sets);
        let digests: Vec<u64> = sets.iter().map(VisibleSet::digest).collect();
        assert_eq!(digests, frame.digests, "frame {}", frame.number);
        frames += 1;
    }
    assert_eq!(reader.ending(), Some(&Ending::Complete));
    frames
}

#[test]
fn what_is_inserted_is_there_for_all_with_one_frame() {
    let folder = library();
    let new_objects = OBJECTS + 1;
    let (record, report, nodes) = steered(Some(folder.path()), |at| {
        let nodes = ["t0x0", "t1x0"].map(|name| node(at.master, name));
        let mut control = Control::connect(at.control).unwrap();
        wait_for(&mut control, |status| status.nodes.iter().all(|node| node.standing == NodeStanding::Live));
        // What happened before holds in the new scene, too.
        let away = MoveObject { object: 3, transform: DAffine3::from_translation(DVec3::new(-1e6, 0.0, 0.0)).to_cols_array() };
        control.send(&[Command::Remove(ObjectNumber { object: 1 }), Command::Move(vec![away])]).unwrap();
        let first = control.insert(&insert("more.mullion", Some(2), -5.0)).unwrap();
        assert_eq!(first.objects, ObjectRange { first: OBJECTS, count: new_objects });
        let why = control.why(&OBJECTS.to_string(), "t0x0").unwrap();
        assert!(why.frame >= first.frame && why.is_seen && why.leaf_count == 60, "{why:?}");
        assert_eq!(why.name, "more.mullion");
        let old = control.why("1", "t0x0").unwrap();
        assert!(old.leaves.iter().all(|leaf| leaf.views == [Reason::Removed]), "{old:?}");
        assert!(!control.why("3", "t0x0").unwrap().is_seen);
        // What it is part of takes it along; by itself it comes and goes, and moves.
        control.send(&[Command::Remove(ObjectNumber { object: 2 })]).unwrap();
        assert!(!control.why(&OBJECTS.to_string(), "t0x0").unwrap().is_seen);
        control.send(&[Command::Add(ObjectNumber { object: OBJECTS })]).unwrap();
        assert!(control.why(&OBJECTS.to_string(), "t0x0").unwrap().is_seen);
        assert!(!control.why("2", "t0x0").unwrap().leaves.iter().all(|leaf| leaf.views != [Reason::Removed]));
        let moved = MoveObject { object: OBJECTS + 1, ..away };
        control.send(&[Command::Move(vec![moved])]).unwrap();
        assert!(!control.why(&(OBJECTS + 1).to_string(), "t0x0").unwrap().is_seen);
        // Once more, of what is there already: no chunk is new.
        let second = control.insert(&insert("more.mullion", None, -20.0)).unwrap();
        assert!(second.frame > first.frame);
        assert_eq!(second.objects, ObjectRange { first: OBJECTS + new_objects, count: new_objects });
        let beyond = control.send(&[Command::Remove(ObjectNumber { object: OBJECTS + 2 * new_objects })]);
        assert!(matches!(beyond, Err(Error::Refused(problem)) if problem.contains("the scene has 23")));
        let last = control.status().frame;
        wait_for(&mut control, |status| status.frame > last + 5);
        assert!(control.status().nodes.iter().all(|node| node.standing == NodeStanding::Live && node.passed_over == 0));
        nodes
    });
    assert_eq!((report.refused, report.passed_over.as_slice()), (0, &[0, 0][..]));
    for node in nodes {
        let node = node.join().unwrap().unwrap();
        assert_eq!((node.left, node.connections), (0, 1), "{node:?}");
        assert!(node.shown + 1 >= node.applied, "{node:?}");
    }
    assert_eq!(replayed(&record, folder.path()), report.frames);
}

#[test]
fn what_cannot_be_inserted_is_refused_in_one_line_and_the_show_goes_on() {
    let folder = library();
    steered(Some(folder.path()), |at| {
        let mut control = Control::connect(at.control).unwrap();
        let mut far = insert("more.mullion", None, 0.0);
        far.transform[4] = 1e300;
        let bad = [
            (insert("../more.mullion", None, 0.0), "not a name"),
            (insert("none.mullion", None, 0.0), "none.mullion"),
            (insert("broken.mullion", None, 0.0), "not a Mullion package"),
            (insert("more.mullion", Some(OBJECTS), 0.0), "under: object 7: the scene has 7"),
            (far, "number 4 of the transform"),
        ];
        for (insert, problem) in bad {
            let error = control.insert(&insert).expect_err("refused").to_string();
            assert!(error.contains(problem) && !error.contains('\n'), "{error}");
        }
        let pair = [Command::Pause, Command::Insert(insert("more.mullion", None, 0.0))];
        assert!(matches!(control.send(&pair), Err(Error::Refused(problem)) if problem.contains("stands alone")));
        // Without a node nobody has to prepare.
        let Inserted { objects, .. } = control.insert(&insert("more.mullion", None, 0.0)).unwrap();
        assert_eq!(objects.first, OBJECTS);
    });
    steered(None, |at| {
        let mut control = Control::connect(at.control).unwrap();
        let error = control.insert(&insert("more.mullion", None, 0.0)).expect_err("refused").to_string();
        assert!(error.contains("--library"), "{error}");
        control.send(&[Command::Pause]).unwrap();
    });
}
