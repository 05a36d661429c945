//! Goal: a wall draws to one budget, whoever is its master, and whoever comes late; without a tessellation there is none.
//! Method: masters are processes of their own, nodes are threads that note what they were told. The scene is prepared by the binary.

mod support;

use std::net::TcpListener;
use std::sync::Arc;
use std::time::Instant;

use mullion_common::scene::Package;
use mullion_common::wire::{Estimate, Part, Primary};
use mullion_server::service::{ServiceError, Show, ShowBudget, ShowOptions, run as run_show};
use support::masters::{LIMIT, NODES, Node, serve};
use support::mullion;

const BUDGET: [&str; 2] = ["--budget-percent", "10"];

/// A wall of four tiles, and boxes with a tessellation.
fn prepared() -> (tempfile::TempDir, u32) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let done = |args: &[&str]| assert_eq!(mullion(args, LIMIT).code, Some(0), "{args:?}");
    done(&["generate", "boxes", "--leaves", "300", "--out", &path("boxes.glb")]);
    done(&["prepare", &path("boxes.glb"), "--plp", "--plp-leaf", "0.2", "--out", &path("palace.glb")]);
    let wall = "[grid]\ncolumns = 2\nrows = 2\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
    std::fs::write(folder.path().join("wall.toml"), wall).expect("written");
    let package = Package::read(&std::fs::read(path("palace.glb")).expect("it was written")).expect("a package");
    assert!(package.scene.tessellation.is_some());
    let triangles = package.scene.manifest.leaves.iter().map(|leaf| leaf.triangle_count).sum::<u32>();
    (folder, triangles / 10)
}

fn order(node: &Node, since: Instant) -> (Estimate, Primary) {
    node.shows(3, since);
    let frame = node.last();
    frame.estimate.zip(frame.primary).expect("the wall has a budget")
}

#[test]
fn the_budget_outlives_the_master_and_is_for_those_who_come_late_too() {
    let (folder, triangles) = prepared();
    let mut master = serve(folder.path(), "127.0.0.1:0", &BUDGET);
    let address = support::address_of(&mut master);
    let mut standby = serve(folder.path(), "127.0.0.1:0", &[&BUDGET[..], &["--standby-of", &address]].concat());
    let heir = support::address_of(&mut standby);
    master.error_line(&["standby joined"], 0, LIMIT);
    let start = |name: &str| Node::start(name, Part::Own, &[&address, &heir]);
    let started = Instant::now();
    let first = start(NODES[0]);
    let of_first = order(&first, started);
    let late = Instant::now();
    let second = start(NODES[1]);
    let of_second = order(&second, late);
    for (order, primary) in [of_first, of_second] {
        assert_eq!((order.triangles, order.is_complete, primary.planes.len()), (triangles, false, 5), "{order:?}");
        assert!(primary.pixels_per_radian > 48.0, "{primary:?}");
    }
    master.error_line(&[&format!("to {triangles} triangles")], 0, LIMIT);
    master.kill();
    let killed = Instant::now();
    for node in [&first, &second] {
        assert_eq!(order(node, killed).0.triangles, triangles, "the standby was given the same");
    }
    [first, second].into_iter().for_each(Node::end);
}

#[test]
fn a_node_that_hardly_needs_time_gets_all_there_is() {
    let (folder, tenth) = prepared();
    for options in [["--budget-ms", "5"], ["--quality", "budget"]] {
        let mut master = serve(folder.path(), "127.0.0.1:0", &options);
        let address = support::address_of(&mut master);
        let node = Node::start(NODES[0], Part::Own, &[&address]);
        let deadline = Instant::now() + LIMIT;
        // It says that it takes a microsecond.
        while order(&node, Instant::now()).0.triangles < 10 * tenth {
            assert!(Instant::now() < deadline, "{:?}", node.last().estimate);
        }
        node.end();
    }
}

#[test]
fn a_show_whose_budget_cannot_be_does_not_begin() {
    let text = "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
    let wall = Arc::new(mullion_common::wall::WallConfig::parse(text).expect("a wall"));
    let refusal = |budget: ShowBudget| {
        let show = Show {
            options: ShowOptions { budget: Some(budget), frames: Some(1), ..ShowOptions::for_wall(&wall) },
            wall: Arc::clone(&wall),
            package: Arc::default(),
            camera: Box::new(|_| panic!("there is no frame")),
            cull: Box::new(|_, _| ()),
            observer: Box::new(|_| ()),
            node_observer: Box::new(|_| ()),
            shown_observer: Box::new(|_, _| ()),
            stop: None,
        };
        match run_show(TcpListener::bind("127.0.0.1:0").expect("a port"), show) {
            Err(error @ (ServiceError::Budget(_) | ServiceError::NoTessellation)) => error.to_string(),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(refusal(ShowBudget::Triangles(0)), "budget: 0 triangles; there must be more");
    assert_eq!(refusal(ShowBudget::TimeUs(0)), "budget: 0 µs; there must be more");
    for percent in [0.0, -1.0, 100.5, f64::NAN] {
        assert_eq!(
            refusal(ShowBudget::Percent(percent)),
            format!("budget: {percent} %; it must be more than 0, and at most 100")
        );
    }
    let none = "budget: the scene has no tessellation; prepare it with --plp";
    assert_eq!([ShowBudget::Triangles(5), ShowBudget::Percent(100.0), ShowBudget::TimeUs(5)].map(refusal), [none; 3]);
}
