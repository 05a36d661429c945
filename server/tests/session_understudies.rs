//! Goal: a spare fills a place that is empty and gives it back; a standby knows where the show stands, and only of its own show.
//! Method: the master alone, driven message by message on virtual time.

mod outputs;

use std::sync::Arc;
use std::time::Duration;

use glam::{DAffine3, DVec3};
use mullion_common::identity::{Bearer, NodeIdentity};
use mullion_common::scene::{ObjectId, Presence, Transform};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{Wall, WallConfig};
use mullion_common::wire::{
    ALIVE_EVERY, Budget, ByeCode, ChunkHello, Course, Hello, Insertions, Moved, Opening, Part, Ping, RivalHello, SILENCE_LIMIT,
    StandbyHello, Stats, Steering, ToMaster, ToStandby, ToTile,
};
use mullion_server::master::{
    Admission, FrameInput, MAX_STANDBYS, Master, MasterOptions, Output, Pace, PeerId, SPARE_AFTER, TAKEOVER_AFTER,
    TELL_STANDBYS_EVERY,
};
use mullion_server::swap_barrier::{BarrierOptions, NodeIndex, Standing};
use outputs::{bodies, closed, sent};

const NODE: PeerId = PeerId(1);
const OTHER: PeerId = PeerId(2);
const SPARE: PeerId = PeerId(3);
const STANDBY: PeerId = PeerId(4);

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn wall(columns: u32) -> Arc<Wall> {
    let text = format!("[grid]\ncolumns = {columns}\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n");
    Arc::new(WallConfig::parse(&text).unwrap())
}

fn master(first_frame: u64) -> Master {
    let barrier = BarrierOptions { wait: ms(14), start_wait: Duration::ZERO, start_nodes: vec![] };
    let pace = Pace::Every(ms(10));
    let options = MasterOptions {
        barrier,
        pace,
        first_frame,
        frames: None,
        sections: vec![],
        tessellation: None,
        hierarchies: None,
        insertions: vec![],
        adaptive: None,
        estimates: None,
        detail: None,
        session_seed: [1; 32],
    };
    Master::new(wall(2), options, Duration::ZERO)
}

fn outputs(master: &mut Master) -> Vec<Output> {
    std::iter::from_fn(|| master.poll_output()).collect()
}

fn courses(outputs: &[Output]) -> Vec<Course> {
    let courses = bodies(outputs, STANDBY).into_iter().filter_map(|body| match ToStandby::decode(body).unwrap() {
        ToStandby::Course(course) => Some(*course),
        ToStandby::Insertions(none) if none == Insertions::default() => None,
        other => panic!("{other:?}"),
    });
    courses.collect()
}

fn join(master: &mut Master, peer: PeerId, node: &str, part: Part, now: Duration) -> Vec<Output> {
    master.handle_connected(peer, now);
    master.handle_opening(peer, Opening::Control(Hello { node: node.into(), part, credentials: None, cached: vec![] }), now);
    outputs(master)
}

fn moved(object: u32, x: f64) -> Moved {
    Moved { object: ObjectId(object), transform: Transform::from(DAffine3::from_translation(DVec3::new(x, 1.0, 2.0))) }
}

fn begin(master: &mut Master, number: u64, moved: &[Moved], now: Duration) -> Vec<Output> {
    begin_steered(master, number, moved, (&[], Steering::default(), &[]), now)
}

fn begin_steered(
    master: &mut Master,
    number: u64,
    moved: &[Moved],
    (presence, steering, budgets): (&[(ObjectId, Presence)], Steering, &[Budget]),
    now: Duration,
) -> Vec<Output> {
    master.handle_timeout(now);
    let input = FrameInput {
        number,
        scene_time_s: number as f64,
        world_from_room: DAffine3::from_translation(DVec3::new(number as f64, 0.0, 0.0)),
        eyes: &[DVec3::Z, DVec3::new(1.0, 2.0, 3.0)],
        shared_eye: DVec3::Z,
        sets: &[VisibleSet::all(5), VisibleSet::default()],
        moved,
        primary: &[],
        budgets,
        presence,
        steering,
    };
    master.begin_frame(&input, now, &mut |_| {});
    outputs(master)
}

/// Both nodes live and heard of; the spare waits.
fn with_a_spare() -> Master {
    let mut master = master(0);
    join(&mut master, NODE, "t0x0", Part::Own, ms(0));
    join(&mut master, OTHER, "t1x0", Part::Own, ms(0));
    assert_eq!(join(&mut master, SPARE, "attic", Part::Spare, ms(0)), [], "a spare without a place is told nothing");
    assert_eq!(master.name_of(SPARE), Some("attic"));
    master
}

fn say(master: &mut Master, peer: PeerId, now: Duration) {
    master.handle_message(peer, ToMaster::Stats(Stats::default()), now);
}

#[test]
fn a_spare_takes_an_empty_place_and_its_owner_takes_it_back() {
    let mut master = with_a_spare();
    begin(&mut master, 0, &[], ms(0));
    master.handle_disconnected(NODE, ms(100));
    for peer in [OTHER, SPARE] {
        say(&mut master, peer, ms(900));
    }
    master.handle_timeout(SPARE_AFTER - ms(1));
    assert!(sent(&outputs(&mut master), SPARE).is_empty(), "the node may be back at once");
    assert_eq!(master.next_timeout(), Some(SPARE_AFTER), "the place has been empty since the node's last word");
    master.handle_timeout(SPARE_AFTER);
    let out = outputs(&mut master);
    assert!(out.contains(&Output::StoodIn { node: NodeIndex(0), spare: "attic".into() }), "{out:?}");
    let [ToTile::Welcome(welcome), ToTile::Manifest(_), ToTile::Frame(frame)] = &sent(&out, SPARE)[..] else { panic!("{out:?}") };
    assert_eq!((welcome.node.as_str(), welcome.views[0].tile_name.as_str(), frame.number), ("t0x0", "t0x0", 0));
    master.handle_message(SPARE, ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None }, SPARE_AFTER + ms(1));
    assert_ne!(master.standing(NodeIndex(0)), Standing::Absent);

    let out = join(&mut master, PeerId(9), "t0x0", Part::Own, SPARE_AFTER + ms(50));
    assert_eq!((closed(&out, SPARE), closed(&out, PeerId(9))), (Some(ByeCode::Leaving), None));
    assert!(ByeCode::Leaving.is_retryable(), "it comes back as a spare");
    assert!(matches!(&sent(&out, PeerId(9))[..], [ToTile::Welcome(_), ToTile::Manifest(_), ToTile::Frame(_)]));
}

#[test]
fn a_node_that_hangs_loses_its_place_where_there_is_a_spare() {
    let mut master = with_a_spare();
    for second in 1..=3 {
        let now = ALIVE_EVERY * second;
        say(&mut master, OTHER, now);
        say(&mut master, SPARE, now);
        assert_eq!(TAKEOVER_AFTER, ms(3000));
        master.handle_timeout(now);
        let out = outputs(&mut master);
        assert_eq!(closed(&out, NODE), (second == 3).then_some(ByeCode::Timeout), "{second} s");
    }
    assert_eq!(master.name_of(SPARE), Some("t0x0"));
}

#[test]
fn spares_are_bounded_kept_informed_and_let_go_when_silent() {
    let mut master = with_a_spare();
    master.handle_message(SPARE, ToMaster::Ping(Ping { at_us: 5 }), ms(1));
    assert!(matches!(&sent(&outputs(&mut master), SPARE)[..], [ToTile::Pong(pong)] if pong.at_us == 5));
    join(&mut master, PeerId(10), "shed", Part::Spare, ms(1));
    let out = join(&mut master, PeerId(11), "cellar", Part::Spare, ms(1));
    assert_eq!(closed(&out, PeerId(11)), Some(ByeCode::TooMany), "as many as there are nodes");
    master.handle_message(PeerId(10), ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None }, ms(2));
    assert_eq!(closed(&outputs(&mut master), PeerId(10)), Some(ByeCode::Malformed), "ready with nothing");
    let mut alive = 0;
    for second in 1..=10 {
        let now = ALIVE_EVERY * second;
        say(&mut master, NODE, now);
        say(&mut master, OTHER, now);
        master.handle_timeout(now);
        alive += sent(&outputs(&mut master), SPARE).iter().filter(|m| **m == ToTile::Alive).count();
    }
    assert_eq!(alive, 9, "once a second, but for the second in which it was answered");
    master.handle_timeout(SILENCE_LIMIT + ms(1));
    let out = outputs(&mut master);
    assert_eq!(closed(&out, SPARE), Some(ByeCode::Timeout));
    assert_eq!((closed(&out, NODE), master.connected()), (None, 2), "nobody else is touched");
    master.handle_disconnected(SPARE, SILENCE_LIMIT + ms(2));
}

fn stand_by(master: &mut Master, peer: PeerId, hello: StandbyHello, now: Duration) -> Vec<Output> {
    master.handle_connected(peer, now);
    master.handle_opening(peer, Opening::Standby(hello), now);
    master.handle_message(peer, ToMaster::Prepared { epoch: 1 }, now);
    outputs(master)
}

#[test]
fn a_standby_hears_of_every_frame_and_of_all_that_moved() {
    let mut first = master(0);
    begin(&mut first, 0, &[moved(7, 1.0)], ms(0));
    let hello = StandbyHello::of(&wall(2), &[]).unwrap();
    let out = stand_by(&mut first, STANDBY, hello, ms(1));
    let [course] = &courses(&out)[..] else { panic!("{out:?}") };
    assert_eq!((course.number, course.base, course.scene_time_s), (0, None, 0.0));
    assert_eq!(
        (course.eyes.as_slice(), course.moved.as_slice()),
        (&[DVec3::Z, DVec3::new(1.0, 2.0, 3.0)][..], &[moved(7, 1.0)][..])
    );
    first.handle_message(STANDBY, ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None }, ms(2));
    first.handle_timeout(ms(14));
    // What it has not acknowledged comes again.
    for (number, expected) in [(1, vec![moved(3, 1.0)]), (2, vec![moved(3, 1.0), moved(8, 2.0)])] {
        let now = ms(20 * number);
        let out = begin(&mut first, number, &expected[expected.len() - 1..], now);
        let [course] = &courses(&out)[..] else { panic!("{out:?}") };
        assert_eq!((course.number, course.base, &course.moved), (number, Some(0), &expected));
        first.handle_timeout(now + ms(14));
        outputs(&mut first);
    }
    assert_eq!(first.connected(), 0, "a standby is no node: no frame waits for it");
    first.handle_timeout(ms(40) + TELL_STANDBYS_EVERY);
    let out = outputs(&mut first);
    assert!(bodies(&out, STANDBY).iter().any(|body| ToStandby::decode(body) == Ok(ToStandby::Alive)), "{out:?}");

    let mut second = master(3);
    second.handle_timeout(ms(0));
    assert_eq!(outputs(&mut second), [Output::WantFrame { number: 3 }], "the heir counts on");
}

#[test]
fn a_standby_hears_how_the_show_is_steered_and_what_came_and_went_in_order() {
    let (there, away) = (Presence::There, Presence::Away);
    let object = |number| ObjectId(number);
    let mut first = master(0);
    // The last word on each counts, and the order of these.
    let said = [(object(1), away), (object(2), there), (object(1), there), (object(3), away)];
    begin_steered(&mut first, 0, &[], (&said, Steering::default(), &[]), ms(0));
    let out = stand_by(&mut first, STANDBY, StandbyHello::of(&wall(2), &[]).unwrap(), ms(1));
    assert_eq!(courses(&out)[0].presence, [(object(2), there), (object(1), there), (object(3), away)]);
    first.handle_message(STANDBY, ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None }, ms(2));
    first.handle_timeout(ms(14));
    let steering = Steering { path_frame: 0, held_after: Some(3), is_off_path: true };
    let budgets = [Budget { triangles: Some(9), gpu_us: None }, Budget::default()];
    let out = begin_steered(&mut first, 1, &[], (&[(object(2), away)], steering, &budgets), ms(20));
    let [course] = &courses(&out)[..] else { panic!("{out:?}") };
    assert_eq!(
        (course.base, &course.presence[..]),
        (Some(0), &[(object(2), away)][..]),
        "what was acknowledged does not come again"
    );
    assert_eq!((course.steering, &course.budgets[..]), (steering, &budgets[..]));
    // One that comes new hears all of it.
    first.handle_disconnected(STANDBY, ms(21));
    let out = stand_by(&mut first, STANDBY, StandbyHello::of(&wall(2), &[]).unwrap(), ms(22));
    assert_eq!(courses(&out)[0].presence, [(object(1), there), (object(3), away), (object(2), away)]);
}

#[test]
fn a_standby_of_another_show_or_one_too_many_is_told_so() {
    let mut master = master(0);
    let hello = StandbyHello::of(&wall(2), &[]).unwrap();
    let other = StandbyHello::of(&wall(3), &[]).unwrap();
    assert_eq!(closed(&stand_by(&mut master, PeerId(20), other, ms(0)), PeerId(20)), Some(ByeCode::Refused));
    for i in 0..=MAX_STANDBYS as u64 {
        let peer = PeerId(30 + i);
        let out = stand_by(&mut master, peer, hello, ms(0));
        assert_eq!(closed(&out, peer), (i == MAX_STANDBYS as u64).then_some(ByeCode::TooMany));
    }
    master.handle_timeout(SILENCE_LIMIT);
    assert_eq!(closed(&outputs(&mut master), PeerId(30)), Some(ByeCode::Timeout));
}

fn rival(live_nodes: u32) -> Opening {
    Opening::Rival(RivalHello { show: StandbyHello::of(&wall(2), &[]).unwrap(), live_nodes, port: 7467 })
}

#[test]
fn of_two_masters_the_one_that_is_greeted_decides_and_the_one_with_fewer_nodes_steps_back() {
    let mut first = master(0);
    join(&mut first, NODE, "t0x0", Part::Own, ms(0));
    join(&mut first, OTHER, "t1x0", Part::Own, ms(0));
    begin(&mut first, 0, &[], ms(0));
    first.handle_message(NODE, ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None }, ms(1));
    first.handle_timeout(ms(14));
    outputs(&mut first);
    assert_eq!((first.live_nodes(), first.connected()), (1, 2), "one that is not waited for does not count");
    let mut greet = |peer: u64, opening: Opening| {
        let peer = PeerId(peer);
        first.handle_connected(peer, ms(15));
        first.handle_opening(peer, opening, ms(15));
        let out = outputs(&mut first);
        (closed(&out, peer), out.contains(&Output::Outnumbered { peer, port: 7467 }))
    };
    assert_eq!(greet(20, rival(0)), (Some(ByeCode::OtherMaster), false));
    assert_eq!(greet(21, rival(1)), (Some(ByeCode::OtherMaster), false), "who drove the wall before goes on");
    assert_eq!(greet(22, rival(2)), (Some(ByeCode::Leaving), true));
    assert_eq!(greet(23, rival(3)), (Some(ByeCode::OtherMaster), false), "more than there are");
    let other = RivalHello { show: StandbyHello::of(&wall(3), &[]).unwrap(), live_nodes: 2, port: 7467 };
    assert_eq!(greet(24, Opening::Rival(other)), (Some(ByeCode::Refused), false), "of another wall");
    assert!(ByeCode::OtherMaster.is_retryable(), "nodes go on to the other");
    // One that hung knows nothing of its nodes: who asks is to ask again.
    first.handle_connected(PeerId(25), ms(4000));
    first.handle_opening(PeerId(25), rival(1), ms(4000));
    assert_eq!(closed(&outputs(&mut first), PeerId(25)), Some(ByeCode::Timeout));
    first.handle_connected(PeerId(26), ms(5000));
    first.handle_opening(PeerId(26), rival(1), ms(5000));
    assert_eq!(closed(&outputs(&mut first), PeerId(26)), Some(ByeCode::OtherMaster));
    assert_eq!(first.connected(), 2, "nobody else is touched");
}

#[test]
fn a_standby_that_comes_back_takes_the_place_of_its_lost_connection() {
    let mut master = master(0);
    let hello = StandbyHello::of(&wall(2), &[]).unwrap();
    stand_by(&mut master, STANDBY, hello, ms(0));
    let out = stand_by(&mut master, PeerId(5), hello, TAKEOVER_AFTER - ms(1));
    assert_eq!((closed(&out, PeerId(5)), closed(&out, STANDBY)), (Some(ByeCode::TooMany), None), "it may be alive");
    let out = stand_by(&mut master, PeerId(6), hello, TAKEOVER_AFTER);
    assert_eq!((closed(&out, PeerId(6)), closed(&out, STANDBY)), (None, Some(ByeCode::Timeout)));
}

#[test]
fn with_certificates_everyone_takes_the_part_that_is_theirs_and_no_other() {
    let node = Bearer::Node(NodeIdentity { name: "t0x0".into(), tiles: vec!["t0x0".into()] });
    let (attic, shed) = (Bearer::Spare("attic".into()), Bearer::Spare("shed".into()));
    let namesake = Bearer::Spare("t0x0".into());
    let hello = |node: &str, part| Opening::Control(Hello { node: node.into(), part, credentials: None, cached: vec![] });
    let openings = [
        hello("t0x0", Part::Own),
        hello("attic", Part::Spare),
        hello("t0x0", Part::Spare),
        Opening::Standby(StandbyHello::of(&wall(2), &[]).unwrap()),
        rival(0),
    ];
    let shown = [None, Some(node.clone()), Some(attic.clone()), Some(shed.clone()), Some(namesake), Some(Bearer::Master)];
    let allowed = [(1, 0), (2, 1), (4, 2), (5, 3), (5, 4)];
    for (who, shown) in shown.iter().enumerate() {
        for (what, opening) in openings.iter().enumerate() {
            let mut master = master(0).admitting(Admission::ByCertificate);
            master.handle_connected(NODE, ms(0));
            shown.iter().for_each(|shown| master.handle_identity(NODE, shown.clone()));
            master.handle_opening(NODE, opening.clone(), ms(0));
            let expected = match allowed.contains(&(who, what)) {
                true if what == 4 => Some(ByeCode::OtherMaster), // it is told who is to drive
                true => None,
                false => Some(ByeCode::Refused),
            };
            assert_eq!(closed(&outputs(&mut master), NODE), expected, "{shown:?} greets with {opening:?}");
        }
    }

    // A spare that has a place fetches chunks for it, and nobody else does, not even whose place it is.
    let mut master = master(0).admitting(Admission::ByCertificate);
    let open = |master: &mut Master, peer, shown: &Bearer, opening| {
        master.handle_connected(peer, ms(0));
        master.handle_identity(peer, shown.clone());
        master.handle_opening(peer, opening, ms(0));
        outputs(master)
    };
    open(&mut master, SPARE, &attic, hello("attic", Part::Spare));
    master.handle_timeout(SPARE_AFTER);
    let out = outputs(&mut master);
    let [ToTile::Welcome(welcome), ..] = &sent(&out, SPARE)[..] else { panic!("{out:?}") };
    let chunks = Opening::Chunks(ChunkHello { session: welcome.session });
    for (peer, shown) in [(40, &node), (41, &shed), (42, &Bearer::Master)] {
        let out = open(&mut master, PeerId(peer), shown, chunks.clone());
        assert_eq!((closed(&out, PeerId(peer)), closed(&out, SPARE)), (Some(ByeCode::Refused), None), "{shown:?}");
    }
    assert_eq!(open(&mut master, PeerId(43), &attic, chunks), [Output::ServeChunks { peer: PeerId(43) }]);
}
