//! Goal: a wall outlives its master, and a place outlives its node.
//! Method: masters are processes of their own, which are killed; nodes are threads that note which frame they showed when. What is asserted
//! is that the show goes on, and in order; how long that took is printed (`--no-capture`).

mod support;

use std::time::{Duration, Instant};

use glam::DVec3;
use mullion_client::node::{NodeTls, Security};
use mullion_common::identity::IdentityFile;
use mullion_common::wire::Part;
use mullion_control::{CameraAt, Command, Error, ObjectNumber, Reason, Steps, TileBudget};
use support::masters::{LIMIT, NODES, Node, control_of, free_address, prepared, serve};
use support::mullion;
use support::relay::Relay;

/// Longest that a node of these went without a new frame after `since`.
fn longest_wait(nodes: &[Node], since: Instant) -> Duration {
    nodes.iter().map(|node| node.shows(1, since)[0].2 - since).max().unwrap_or_default()
}

#[test]
fn a_standby_goes_on_where_the_master_died() {
    let folder = prepared();
    let mut master = serve(folder.path(), "127.0.0.1:0", &[]);
    let address = support::address_of(&mut master);
    let mut standby = serve(folder.path(), "127.0.0.1:0", &["--standby-of", &address]);
    let heir = support::address_of(&mut standby);
    standby.error_line(&["standing by for the master"], 0, LIMIT);
    master.error_line(&["standby joined"], 0, LIMIT);
    let started = Instant::now();
    // Two of them know the standby first: it sends them on.
    let nodes = [0, 1, 2, 3].map(|i| {
        let masters = if i < 2 { [address.as_str(), &heir] } else { [heir.as_str(), &address] };
        Node::start(NODES[i], Part::Own, &masters)
    });
    nodes.iter().for_each(|node| drop(node.shows(20, started)));

    master.kill();
    let killed = Instant::now();
    println!("next frame at every node {} ms after the master was killed", longest_wait(&nodes, killed).as_millis());
    for node in &nodes {
        node.shows(20, killed);
        let frames: Vec<u64> = node.shown_since(started).iter().map(|(_, frame, _)| *frame).collect();
        assert!(frames.windows(2).all(|pair| pair[0] < pair[1]), "the heir counts on: {frames:?}");
        let last = node.last();
        assert!(
            (last.scene_time_s - last.number as f64 / 60.0).abs() < 1e-9,
            "the scene's time goes on with the frames: {last:?}"
        );
    }
    standby.error_line(&["is gone", "going on from frame"], 0, LIMIT);
    nodes.into_iter().for_each(Node::end);
}

#[test]
fn a_standby_takes_over_what_was_steered() {
    let folder = prepared();
    let steered = ["--control", "127.0.0.1:0"];
    let mut master = serve(folder.path(), "127.0.0.1:0", &steered);
    let address = support::address_of(&mut master);
    let mut standby = serve(folder.path(), "127.0.0.1:0", &[&steered[..], &["--standby-of", &address]].concat());
    let heir = support::address_of(&mut standby);
    master.error_line(&["standby joined"], 0, LIMIT);
    let started = Instant::now();
    let node = Node::start(NODES[0], Part::Own, &[&address, &heir]);
    node.shows(5, started);
    let (mut control, mut of_heir) = (control_of(&mut master), control_of(&mut standby));

    let camera = Command::Camera(CameraAt { translation: [3.0, 1.0, 60.0], rotation: [0.0, 0.0, 0.0, 1.0], scale: 1.0 });
    let budget = Command::Budget(TileBudget { triangles: Some(1000), ..TileBudget::default() });
    let eye = [0.05, 0.1, 1.7];
    let commands = [camera, budget, Command::Eyes(vec![eye]), Command::Remove(ObjectNumber { object: 0 }), Command::Pause];
    for refused in [of_heir.send(&commands).err(), of_heir.why("0", "t0x0").err(), of_heir.tiles("0").err()] {
        assert!(matches!(&refused, Some(Error::Refused(reason)) if reason.contains("stands by")), "{refused:?}");
    }
    let steered_in = control.send(&commands).expect("taken");
    while control.next_status().expect("it runs").frame < steered_in + 5 {}
    let held = control.status().clone();
    assert!(held.is_paused && !held.is_standing_by);

    master.kill();
    let killed = Instant::now();
    node.shows(20, killed);
    let status = of_heir.next_status().expect("it drives").clone();
    assert!(status.frame > held.frame && status.is_paused && !status.is_standing_by, "{status:?}");
    assert_eq!(status.path_frame, held.path_frame, "the path waits where it was held");
    let last = node.last();
    assert_eq!(last.world_from_room.translation, DVec3::new(3.0, 1.0, 60.0));
    assert_eq!((last.views[0].eye, last.views[0].budget.triangles), (DVec3::from(eye), Some(1000)));
    let why = of_heir.why("0", "t0x0").expect("it answers");
    assert!(why.frame > held.frame, "{} is of the frames that go on after {}", why.frame, held.frame);
    assert!(why.leaf_count > 0 && why.leaves.iter().all(|leaf| leaf.views == [Reason::Removed]), "{why:?}");

    of_heir.send(&[Command::Step(Steps { frames: 4 })]).expect("it takes commands");
    while of_heir.next_status().expect("it runs").path_frame < held.path_frame + 4 {}
    of_heir.send(&[Command::Resume, Command::FollowPath, Command::Add(ObjectNumber { object: 0 })]).expect("it takes commands");
    while of_heir.next_status().expect("it runs").path_frame < held.path_frame + 20 {}
    assert!(!of_heir.status().is_paused);
    let why = of_heir.why("0", "t0x0").expect("it answers");
    assert!(why.leaves.iter().all(|leaf| leaf.views != [Reason::Removed]), "{why:?}");
    node.end();
}

#[test]
fn a_master_that_was_only_cut_off_goes_on_and_its_standby_stands_by_again() {
    let folder = prepared();
    let mut master = serve(folder.path(), "127.0.0.1:0", &[]);
    let address = support::address_of(&mut master);
    let way = Relay::to(address.clone());
    let mut standby = serve(folder.path(), "127.0.0.1:0", &["--standby-of", &way.address]);
    let heir = support::address_of(&mut standby);
    let (joined, _) = master.error_line(&["standby joined"], 0, LIMIT);
    let started = Instant::now();
    let nodes = NODES.map(|name| Node::start(name, Part::Own, &[&address, &heir]));
    nodes.iter().for_each(|node| drop(node.shows(10, started)));

    way.cut();
    let (took_over, _) = standby.error_line(&["is gone", "going on from frame"], 0, LIMIT);
    way.mend();
    let words = ["drives the wall", "it has 4 live nodes, to 0", "stepping back"];
    let (stepped_back, _) = standby.error_line(&words, took_over, LIMIT);
    standby.error_line(&["standing by for the master"], stepped_back, LIMIT);
    master.error_line(&["standby joined"], joined + 1, LIMIT);
    let back = Instant::now();
    nodes.iter().for_each(|node| drop(node.shows(10, back)));

    // Then it is really gone.
    master.kill();
    let killed = Instant::now();
    nodes.iter().for_each(|node| drop(node.shows(20, killed)));
    standby.error_line(&["is gone", "going on from frame"], stepped_back, LIMIT);
    let said = master.err.text();
    assert!(NODES.iter().all(|name| !said.contains(&format!("node {name} left"))), "none left while it was there:\n{said}");
    nodes.into_iter().for_each(Node::end);
}

#[cfg(unix)]
#[test]
fn a_master_that_hung_steps_back_for_the_one_that_has_its_nodes() {
    use rustix::process::Signal;

    let folder = prepared();
    let mut master = serve(folder.path(), "127.0.0.1:0", &[]);
    let address = support::address_of(&mut master);
    let mut standby = serve(folder.path(), "127.0.0.1:0", &["--standby-of", &address]);
    let heir = support::address_of(&mut standby);
    master.error_line(&["standby joined"], 0, LIMIT);
    let started = Instant::now();
    let nodes = NODES.map(|name| Node::start(name, Part::Own, &[&address, &heir]));
    nodes.iter().for_each(|node| drop(node.shows(10, started)));

    master.signal(Signal::STOP);
    standby.error_line(&["is gone", "going on from frame"], 0, LIMIT);
    standby.error_line(&["4 of 4 nodes show it"], 0, LIMIT);
    master.signal(Signal::CONT);
    let (stepped_back, _) = master.error_line(&["drives the wall", "more live nodes", "stepping back"], 0, LIMIT);
    master.error_line(&["standing by for the master"], stepped_back, LIMIT);
    standby.error_line(&["standby joined"], 0, LIMIT);

    standby.kill();
    let killed = Instant::now();
    nodes.iter().for_each(|node| drop(node.shows(20, killed)));
    master.error_line(&["is gone", "going on from frame"], stepped_back, LIMIT);
    nodes.into_iter().for_each(Node::end);
}

#[test]
fn a_master_that_died_stands_by_for_its_heir_when_it_is_started_again() {
    let folder = prepared();
    let address = free_address();
    let mut master = serve(folder.path(), &address, &[]);
    support::address_of(&mut master);
    let mut standby = serve(folder.path(), "127.0.0.1:0", &["--standby-of", &address]);
    let heir = support::address_of(&mut standby);
    master.error_line(&["standby joined"], 0, LIMIT);
    let started = Instant::now();
    let nodes = NODES.map(|name| Node::start(name, Part::Own, &[&address, &heir]));
    nodes.iter().for_each(|node| drop(node.shows(10, started)));
    master.kill();
    standby.error_line(&["4 of 4 nodes show it"], 0, LIMIT);

    let mut master = serve(folder.path(), &address, &["--standby-of", &heir]);
    support::address_of(&mut master);
    standby.error_line(&["standby joined"], 0, LIMIT);
    // By then it has heard where the show stands: one that never did waits for a first word.
    let joined = Instant::now();
    nodes.iter().for_each(|node| drop(node.shows(20, joined)));
    standby.kill();
    let killed = Instant::now();
    nodes.iter().for_each(|node| drop(node.shows(20, killed)));
    master.error_line(&["is gone", "going on from frame"], 0, LIMIT);
    nodes.into_iter().for_each(Node::end);
}

#[test]
fn nodes_resume_when_a_master_without_a_standby_is_started_again() {
    let folder = prepared();
    let address = free_address();
    let mut master = serve(folder.path(), &address, &[]);
    support::address_of(&mut master);
    let started = Instant::now();
    let nodes = NODES.map(|name| Node::start(name, Part::Own, &[&address]));
    nodes.iter().for_each(|node| drop(node.shows(10, started)));
    master.kill();
    let mut master = serve(folder.path(), &address, &[]);
    support::address_of(&mut master);
    let back = Instant::now();
    println!("next frame at every node {} ms after the master was back", longest_wait(&nodes, back).as_millis());
    nodes.iter().for_each(|node| drop(node.shows(10, back)));
    nodes.into_iter().for_each(Node::end);
}

#[test]
fn a_spare_shows_what_a_missing_tile_would_until_that_one_is_back() {
    let folder = prepared();
    let mut master = serve(folder.path(), "127.0.0.1:0", &[]);
    let address = support::address_of(&mut master);
    let started = Instant::now();
    let mut nodes: Vec<Node> = NODES.iter().map(|name| Node::start(name, Part::Own, &[&address])).collect();
    nodes.iter().for_each(|node| drop(node.shows(5, started)));
    let spare = Node::start("attic", Part::Spare, &[&address]);
    master.error_line(&["node attic joined"], 0, LIMIT);
    assert_eq!(spare.shown_since(started), [], "it has no place yet");

    let gone = Instant::now();
    nodes.remove(1).end();
    let shown = spare.shows(10, gone);
    println!("the spare showed a frame {} ms after the node was stopped", (shown[0].2 - gone).as_millis());
    assert!(shown.iter().all(|(tile, ..)| tile == NODES[1]), "{shown:?}");
    master.error_line(&["spare attic takes the place of node t1x0"], 0, LIMIT);

    let owner = Node::start(NODES[1], Part::Own, &[&address]);
    owner.shows(10, gone);
    let (left, _) = master.error_line(&["node attic left", "is back"], 0, LIMIT);
    // Its place is taken: it waits again.
    master.error_line(&["node attic joined"], left, LIMIT);
    owner.end();
    nodes.into_iter().for_each(Node::end);
    spare.end();
}

#[test]
fn with_certificates_a_standby_takes_over_and_a_spare_stands_in() {
    let folder = prepared();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let done = mullion(&["enroll", &path("wall.toml"), "--out", &path("ids"), "--spares", "1", "--standbys", "1"], LIMIT);
    assert_eq!(done.code, Some(0), "{}", done.err);
    let shown = |file: &str| {
        let text = std::fs::read(folder.path().join("ids").join(file)).expect("enrolled");
        Security::Tls(NodeTls::new(IdentityFile::parse(&text).expect("an identity")).expect("of a node or a spare"))
    };
    let mut master = serve(folder.path(), "127.0.0.1:0", &["--identity", &path("ids/master.pem")]);
    let address = support::address_of(&mut master);
    let of_standby = ["--standby-of", &address, "--identity", &path("ids/standbys/standby-1.pem")];
    let mut standby = serve(folder.path(), "127.0.0.1:0", &of_standby);
    let heir = support::address_of(&mut standby);
    master.error_line(&["standby joined"], 0, LIMIT);
    let started = Instant::now();
    let masters = [address.as_str(), &heir];
    let start = |name: &&str| Node::secured(name, Part::Own, &masters, shown(&format!("nodes/{name}.pem")));
    let nodes: Vec<Node> = NODES[1..].iter().map(start).collect();
    nodes.iter().for_each(|node| drop(node.shows(20, started)));

    master.kill();
    let killed = Instant::now();
    let spare = Node::secured("spare-1", Part::Spare, &masters, shown("spares/spare-1.pem"));
    nodes.iter().for_each(|node| drop(node.shows(20, killed)));
    assert!(spare.shows(10, killed).iter().all(|(tile, ..)| tile == NODES[0]), "the place that is empty");
    standby.error_line(&["spare spare-1 takes the place of node t0x0"], 0, LIMIT);
    nodes.into_iter().for_each(Node::end);
    spare.end();
}
