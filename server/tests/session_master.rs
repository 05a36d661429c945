//! Goal: what one peer does, or leaves undone, ends that peer's connection and nothing else.
//! Method: the master alone, driven message by message on virtual time.

mod outputs;

use std::sync::Arc;
use std::time::Duration;

use glam::{DAffine3, DVec3};
use mullion_common::identity::{Bearer, NodeIdentity};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{Wall, WallConfig};
use mullion_common::wire::{
    ALIVE_EVERY, ByeCode, ChunkHello, Hello, OPENING_LIMIT, Opening, PROTOCOL_VERSION, Part, SILENCE_LIMIT, Stats, Steering,
    ToMaster, ToTile, body_of,
};
use mullion_server::master::{Admission, FrameInput, MAX_UNNAMED, Master, MasterOptions, Output, Pace, PeerId, TAKEOVER_AFTER};
use mullion_server::swap_barrier::{BarrierOptions, NodeIndex, Standing};
use outputs::{closed, sent};

const A: PeerId = PeerId(1);
const B: PeerId = PeerId(2);
const PERIOD: Duration = Duration::from_millis(10);

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn master() -> Master {
    let text = "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
    let wall: Arc<Wall> = Arc::new(WallConfig::parse(text).unwrap());
    let barrier = BarrierOptions { wait: ms(14), start_wait: Duration::ZERO, start_nodes: vec![] };
    let pace = Pace::Every(PERIOD);
    let options = MasterOptions {
        barrier,
        pace,
        first_frame: 0,
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
    Master::new(wall, options, Duration::ZERO)
}

fn hello(node: &str) -> Opening {
    Opening::Control(Hello { node: node.into(), part: Part::Own, credentials: None, cached: vec![] })
}

fn outputs(master: &mut Master) -> Vec<Output> {
    std::iter::from_fn(|| master.poll_output()).collect()
}

fn begin(master: &mut Master, number: u64, now: Duration) {
    let input = FrameInput {
        number,
        scene_time_s: 0.0,
        world_from_room: DAffine3::IDENTITY,
        eyes: &[DVec3::Z; 2],
        shared_eye: DVec3::Z,
        sets: &[VisibleSet::all(5), VisibleSet::default()],
        moved: &[],
        primary: &[],
        budgets: &[],
        presence: &[],
        steering: Steering::default(),
    };
    master.begin_frame(&input, now, &mut |_| {});
}

fn join(master: &mut Master, peer: PeerId, node: &str, now: Duration) -> Vec<Output> {
    master.handle_connected(peer, now);
    master.handle_opening(peer, hello(node), now);
    outputs(master)
}

#[test]
fn a_node_gets_its_welcome_the_scene_and_the_frame_that_runs() {
    let mut master = master();
    master.handle_timeout(ms(0));
    assert_eq!(outputs(&mut master), [Output::WantFrame { number: 0 }]);
    begin(&mut master, 0, ms(1));
    let out = join(&mut master, A, "t0x0", ms(3));
    let [ToTile::Welcome(welcome), ToTile::Manifest(_), ToTile::Frame(frame)] = &sent(&out, A)[..] else { panic!("{out:?}") };
    assert_eq!((welcome.version, welcome.next_frame, welcome.views.len()), (PROTOCOL_VERSION, 1, 1));
    assert_eq!((frame.number, frame.base), (0, None));
    assert_eq!(frame.views[0].leaves.added, VisibleSet::all(5));

    master.handle_message(A, ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None }, ms(5));
    let out = outputs(&mut master);
    assert_eq!(sent(&out, A), [ToTile::Swap { frame: 0 }]);
    assert!(matches!(&out[..], [.., Output::FrameReleased(r)] if r.number == 0 && r.shown_by == 1));
    assert_eq!(master.next_timeout(), Some(PERIOD), "the beat goes on from when the frame was due");
    master.handle_timeout(PERIOD);
    begin(&mut master, 1, PERIOD + ms(1));
    let out = outputs(&mut master);
    let [ToTile::Frame(frame)] = &sent(&out, A)[..] else { panic!("{out:?}") };
    assert_eq!(frame.base, Some(0));
    assert!(frame.views[0].leaves.added.is_empty() && frame.views[0].leaves.removed.is_empty());
}

#[test]
fn who_says_nothing_is_sent_away() {
    let mut master = master();
    master.handle_connected(A, ms(0));
    join(&mut master, B, "t0x0", ms(0));
    master.handle_timeout(OPENING_LIMIT - ms(1));
    assert_eq!(closed(&outputs(&mut master), A), None);
    master.handle_timeout(OPENING_LIMIT);
    assert_eq!(closed(&outputs(&mut master), A), Some(ByeCode::Timeout));
    master.handle_timeout(SILENCE_LIMIT);
    assert_eq!(closed(&outputs(&mut master), B), Some(ByeCode::Timeout));
    assert_eq!(master.connected(), 0);
}

#[test]
fn a_sign_of_life_keeps_a_node_and_one_is_given() {
    let mut master = master();
    join(&mut master, A, "t0x0", ms(0));
    let mut alive = 0;
    for second in 1..30 {
        let now = ALIVE_EVERY * second;
        master.handle_message(A, ToMaster::Stats(Stats { frame: 7, ..Stats::default() }), now);
        master.handle_timeout(now);
        alive += sent(&outputs(&mut master), A).iter().filter(|m| **m == ToTile::Alive).count();
    }
    assert_eq!((master.connected(), alive), (1, 29));
    assert_eq!(master.stats().next().unwrap().frame, 7);
}

#[test]
fn a_name_is_taken_while_its_node_lives() {
    let mut master = master();
    join(&mut master, A, "t0x0", ms(0));
    let out = join(&mut master, B, "t0x0", TAKEOVER_AFTER - ms(1));
    assert_eq!(closed(&out, B), Some(ByeCode::AlreadyConnected));
    let heir = PeerId(3);
    let out = join(&mut master, heir, "t0x0", TAKEOVER_AFTER);
    assert_eq!((closed(&out, A), closed(&out, heir)), (Some(ByeCode::Timeout), None));
    assert_eq!(master.standing(NodeIndex(0)), Standing::Trying);

    master.handle_disconnected(heir, ms(4000));
    let out = join(&mut master, PeerId(4), "t0x0", ms(4001));
    assert_eq!(closed(&out, PeerId(4)), None, "a connection that ended frees its name at once");
}

#[test]
fn unnamed_connections_are_bounded() {
    let mut master = master();
    let most = MAX_UNNAMED as u64 + 2; // and one for each node
    for i in 0..most {
        master.handle_connected(PeerId(100 + i), ms(0));
    }
    assert!(outputs(&mut master).iter().all(|o| !matches!(o, Output::Close { .. })));
    master.handle_connected(A, ms(0));
    assert_eq!(closed(&outputs(&mut master), A), Some(ByeCode::TooMany));
    master.handle_timeout(OPENING_LIMIT);
    outputs(&mut master);
    assert_eq!(closed(&join(&mut master, B, "t0x0", OPENING_LIMIT), B), None);
}

#[test]
fn a_chunk_connection_belongs_to_a_session_and_ends_with_it() {
    let mut master = master();
    let out = join(&mut master, A, "t0x0", ms(0));
    let Some(ToTile::Welcome(welcome)) = sent(&out, A).into_iter().next() else { panic!("{out:?}") };
    let open = |master: &mut Master, peer, session| {
        master.handle_connected(peer, ms(1));
        master.handle_opening(peer, Opening::Chunks(ChunkHello { session }), ms(1));
        outputs(master)
    };
    assert_eq!(closed(&open(&mut master, B, welcome.session ^ 1), B), Some(ByeCode::UnknownSession));
    let chunks = PeerId(3);
    assert!(open(&mut master, chunks, welcome.session).contains(&Output::ServeChunks { peer: chunks }));
    let newer = PeerId(4);
    let out = open(&mut master, newer, welcome.session);
    assert_eq!((closed(&out, chunks), closed(&out, newer)), (Some(ByeCode::AlreadyConnected), None));
    master.handle_disconnected(A, ms(2));
    assert_eq!(closed(&outputs(&mut master), newer), Some(ByeCode::Leaving));
    assert_eq!(closed(&open(&mut master, PeerId(5), welcome.session), PeerId(5)), Some(ByeCode::UnknownSession));
}

#[test]
fn a_liar_and_a_stranger_are_told_why() {
    let mut master = master();
    join(&mut master, A, "t0x0", ms(0));
    master.handle_message(A, ToMaster::Ready { frame: 3, draw_us: 0, is_cut: false, shown: None }, ms(1));
    assert_eq!(closed(&outputs(&mut master), A), Some(ByeCode::Malformed));

    let mut bytes = Vec::new();
    hello("t0x0").encode_as_version(PROTOCOL_VERSION + 1, &mut bytes).unwrap();
    master.handle_connected(B, ms(2));
    master.handle_body(B, body_of(&bytes), ms(2));
    let [ToTile::Bye(bye)] = &sent(&outputs(&mut master), B)[..] else { panic!("no goodbye") };
    assert_eq!(bye.code, ByeCode::VersionMismatch);
    assert!(
        bye.reason.contains(&format!("version {}", PROTOCOL_VERSION + 1))
            && bye.reason.contains(&format!("version {PROTOCOL_VERSION}")),
        "{bye}"
    );
}

#[test]
fn deltas_stand_on_what_is_remembered_only() {
    let mut master = master();
    join(&mut master, A, "t0x0", ms(0));
    for number in 0..12u64 {
        let now = ms(20 * number);
        master.handle_timeout(now);
        begin(&mut master, number, now);
        let frames = sent(&outputs(&mut master), A);
        let Some(ToTile::Frame(frame)) = frames.iter().find(|m| matches!(m, ToTile::Frame(_))) else { panic!("{frames:?}") };
        // Frame 1 is acknowledged and nothing after it: it is a base for eight frames.
        assert_eq!(frame.base, (2..=9).contains(&number).then_some(1), "frame {number}");
        if number == 1 {
            master.handle_message(A, ToMaster::Ready { frame: 1, draw_us: 0, is_cut: false, shown: None }, now);
        }
        master.handle_timeout(now + ms(14));
        outputs(&mut master);
    }
}

fn identity(name: &str, tiles: &[&str]) -> Bearer {
    Bearer::Node(NodeIdentity { name: name.into(), tiles: tiles.iter().map(|tile| (*tile).into()).collect() })
}

/// The reason of a goodbye with code Refused.
fn refusal(outputs: &[Output], which: PeerId) -> String {
    let bye = outputs.iter().find_map(|o| match o {
        Output::Close { peer, bye } if *peer == which => Some(bye),
        _ => None,
    });
    let bye = bye.unwrap_or_else(|| panic!("it is not refused: {outputs:?}"));
    assert_eq!(bye.code, ByeCode::Refused, "{bye}");
    bye.reason.clone()
}

#[test]
fn a_choosy_master_takes_a_node_with_its_own_certificate_only() {
    let mut master = master().admitting(Admission::ByCertificate);
    let mut peers = (1..).map(PeerId);
    let mut greet = |master: &mut Master, shown: Option<Bearer>, node: &str| {
        let peer = peers.next().unwrap();
        master.handle_connected(peer, ms(0));
        shown.into_iter().for_each(|shown| master.handle_identity(peer, shown));
        master.handle_opening(peer, hello(node), ms(0));
        (peer, outputs(master))
    };
    let (peer, out) = greet(&mut master, None, "t0x0");
    assert!(refusal(&out, peer).contains("certificates only"));
    let (peer, out) = greet(&mut master, None, "t9x9");
    assert!(!refusal(&out, peer).contains("t0x0"), "strangers do not learn names");
    let (peer, out) = greet(&mut master, Some(identity("t1x0", &["t1x0"])), "t0x0");
    let reason = refusal(&out, peer);
    assert!(reason.contains("\"t1x0\"") && reason.contains("\"t0x0\""), "{reason}");
    let (peer, out) = greet(&mut master, Some(identity("t0x0", &["t0x0", "t1x0"])), "t0x0");
    let reason = refusal(&out, peer);
    assert!(reason.contains("for tiles t0x0, t1x0, but") && reason.contains("mullion enroll"), "{reason}");
    let (peer, out) = greet(&mut master, Some(identity("t9x9", &["t9x9"])), "t9x9");
    assert_eq!(closed(&out, peer), Some(ByeCode::UnknownNode));
    let (peer, out) = greet(&mut master, Some(identity("t0x0", &["t0x0"])), "t0x0");
    assert_eq!((closed(&out, peer), master.name_of(peer)), (None, Some("t0x0")));
    // Too late to become somebody else.
    master.handle_identity(peer, identity("t1x0", &["t1x0"]));
    assert_eq!(master.name_of(peer), Some("t0x0"));
}

#[test]
fn a_chunk_connection_must_be_of_the_node_whose_session_it_names() {
    let mut master = master().admitting(Admission::ByCertificate);
    let [own, others, none] = [PeerId(3), PeerId(4), PeerId(5)];
    master.handle_connected(A, ms(0));
    master.handle_identity(A, identity("t0x0", &["t0x0"]));
    master.handle_opening(A, hello("t0x0"), ms(0));
    let out = outputs(&mut master);
    let [ToTile::Welcome(welcome), ..] = &sent(&out, A)[..] else { panic!("{out:?}") };
    let session = welcome.session;
    let mut open = |peer, shown: Option<Bearer>| {
        master.handle_connected(peer, ms(1));
        shown.into_iter().for_each(|shown| master.handle_identity(peer, shown));
        master.handle_opening(peer, Opening::Chunks(ChunkHello { session }), ms(1));
        outputs(&mut master)
    };
    assert_eq!(open(own, Some(identity("t0x0", &["t0x0"]))), [Output::ServeChunks { peer: own }]);
    for (peer, shown) in [(others, Some(identity("t1x0", &["t1x0"]))), (none, None)] {
        let out = open(peer, shown);
        refusal(&out, peer);
        assert_eq!(closed(&out, own), None, "the node keeps its own");
        assert_eq!(closed(&out, A), None);
    }
}
