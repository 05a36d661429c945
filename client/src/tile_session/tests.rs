//! Goal: a node bears a master that breaks off, and leaves one that lies, with a reason.
//! Method: one session, driven message by message. The whole exchange is simulated in the workspace's tests.

use glam::DVec3;
use mullion_common::scene::{AlphaMode, ChunkKind, ChunkRecord, LeafRecord, Material, MaterialId, Package, Scene, SectionKind};
use mullion_common::visible_set::{LeafRange, VisibleDelta};
use mullion_common::wall::{Eye, ObserverId, TileId};
use mullion_common::wire::{Counted, FrameView, ObjectCount, PROTOCOL_VERSION};

use super::*;

mod detail;
mod tessellation;

fn scene() -> Scene {
    let blob = |i: u8| vec![i; 10];
    let chunks = (0..3).map(|i| ChunkRecord::new(ChunkHash::of(&blob(i)), 0, 10, ChunkKind::Geometry)).collect();
    let leaf = |i: u32| LeafRecord {
        object: ObjectId(0),
        chunk: ChunkId(i),
        material: MaterialId(0),
        triangle_count: 1,
        local_min: [i as f32, 0.0, 0.0],
        local_max: [i as f32 + 1.0, 1.0, 1.0],
    };
    let material = Material { base_color: [1.0; 4], texture: None, alpha: AlphaMode::Opaque, double_sided: false };
    let manifest = SceneManifest {
        transforms: vec![Transform::from(DAffine3::IDENTITY)],
        leaves: (0..3).map(leaf).collect(),
        materials: vec![material],
        chunks,
    };
    Scene { manifest, ..Package::default().scene }
}

fn section(kind: SectionKind) -> Vec<u8> {
    scene().section_bytes(kind).unwrap()
}

fn welcome() -> ToTile {
    let view = ViewSpec {
        view: ViewId(0),
        tile: TileId(0),
        tile_name: "t0x0".into(),
        observer: ObserverId(0),
        eye: Eye::Mono,
        corners: [[0.0; 3]; 3],
        size_px: [64, 48],
        near_m: 0.05,
    };
    let node = "t0x0".into();
    ToTile::Welcome(Welcome {
        version: PROTOCOL_VERSION,
        session: 1,
        node,
        views: vec![view],
        rate_hz: 60.0,
        next_frame: 0,
        count_every: 0,
    })
}

fn manifest() -> ToTile {
    let sections = SectionKind::FOR_TILES.map(|kind| {
        let bytes = section(kind);
        SectionRef { kind, hash: ChunkHash::of(&bytes), length: bytes.len() as u64 }
    });
    ToTile::Manifest(Manifest { epoch: 1, sections: sections.into(), tessellation: None, hierarchies: None })
}

fn frame(number: u64, base: Option<u64>, added: &[(u32, u32)]) -> ToTile {
    let added = VisibleSet::from_ranges(added.iter().map(|&(start, end)| LeafRange::new(start, end)));
    // Frames stand on frame 0 of `drawn`.
    let before = base.filter(|base| *base == 0).map(|_| LeafRange::new(0, 3));
    let digest = VisibleSet::from_ranges(added.ranges().iter().copied().chain(before)).digest();
    let leaves = VisibleDelta { removed: VisibleSet::default(), added };
    let view = FrameView { eye: DVec3::Z, budget: Budget::default(), leaves, digest };
    let shared_eye = DVec3::new(2.5, 0.5, 0.5);
    ToTile::Frame(Frame {
        number,
        epoch: 1,
        base,
        shared_eye,
        views: vec![view],
        dropped_digest: VisibleSet::default().digest(),
        ..Frame::default()
    })
}

fn actions(session: &mut TileSession) -> Vec<Action> {
    std::iter::from_fn(|| session.poll_action()).collect()
}

/// The three chunks, and no room to fetch one ahead.
const MEMORY_BYTES: u64 = 30;

/// A session whose scene is open and which lacks every chunk.
fn open() -> TileSession {
    open_with(WhenMissing::Hold, MEMORY_BYTES)
}

fn open_with(when_missing: WhenMissing, memory_bytes: u64) -> TileSession {
    let mut session = TileSession::new("t0x0", None, memory_bytes, when_missing);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(manifest());
    let [Action::Fetch(blobs)] = &actions(&mut session)[..] else { panic!("sections are fetched first") };
    assert_eq!(blobs.len(), 4);
    for kind in SectionKind::FOR_TILES {
        let bytes = section(kind);
        session.handle_blob(ChunkHash::of(&bytes), bytes);
    }
    assert!(matches!(&actions(&mut session)[..], [Action::OpenScene(manifest, _)] if **manifest == scene().manifest));
    session
}

fn give(session: &mut TileSession, chunk: u8) {
    session.handle_blob(ChunkHash::of(&[chunk; 10]), vec![chunk; 10]);
}

/// A session that has drawn frame 0, all three leaves.
fn drawn() -> TileSession {
    let mut session = open();
    session.handle_message(frame(0, None, &[(0, 3)]));
    (0..3).for_each(|i| give(&mut session, i));
    assert!(matches!(actions(&mut session).last(), Some(Action::Draw(frame)) if frame.number == 0));
    session.drawn(0, DrawStats::default());
    assert_eq!(actions(&mut session), [Action::Send(ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None })]);
    session
}

fn left(session: &mut TileSession) -> String {
    match actions(session).pop() {
        Some(Action::Close { bye, by: EndedBy::Node }) => bye.reason,
        other => panic!("not left but {other:?}"),
    }
}

#[test]
fn nearest_chunks_come_first_and_nothing_is_drawn_before_all_are_there() {
    let mut session = open();
    session.handle_message(frame(0, None, &[(0, 1), (2, 3)]));
    assert_eq!(actions(&mut session), [Action::Fetch(vec![hash(2), hash(0)])]);
    give(&mut session, 2);
    assert!(matches!(&actions(&mut session)[..], [Action::Upload { chunk: ChunkId(2), .. }]));
    give(&mut session, 0);
    assert!(matches!(&actions(&mut session)[..], [Action::Upload { .. }, Action::Draw(_)]));
}

#[test]
fn the_newest_frame_wins_and_only_what_was_drawn_is_shown() {
    let mut session = drawn();
    session.handle_message(ToTile::Swap { frame: 0 });
    session.handle_message(ToTile::Swap { frame: 0 });
    session.handle_message(frame(1, Some(0), &[]));
    session.handle_message(frame(2, Some(0), &[]));
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::Show { frame: 0 }, Action::Draw(frame)] if frame.number == 2), "{got:?}");
    session.handle_message(ToTile::Swap { frame: 1 });
    assert_eq!(actions(&mut session), []);
}

#[test]
fn a_node_that_is_late_shows_what_it_drew_before_it_draws_on() {
    let mut session = drawn();
    session.handle_message(frame(1, Some(0), &[]));
    assert!(matches!(&actions(&mut session)[..], [Action::Draw(_)]));
    session.handle_message(frame(2, Some(0), &[]));
    session.drawn(1, DrawStats::default());
    assert_eq!(
        actions(&mut session),
        [Action::Send(ToMaster::Ready { frame: 1, draw_us: 0, is_cut: false, shown: None })],
        "frame 2 waits for the answer"
    );
    session.handle_message(ToTile::Swap { frame: 1 });
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::Show { frame: 1 }, Action::Draw(frame)] if frame.number == 2), "{got:?}");

    session.handle_message(frame(3, Some(0), &[]));
    session.drawn(2, DrawStats::default());
    assert_eq!(actions(&mut session), [Action::Send(ToMaster::Ready { frame: 2, draw_us: 0, is_cut: false, shown: None })]);
    session.handle_message(frame(4, Some(0), &[]));
    assert!(matches!(&actions(&mut session)[..], [Action::Draw(frame)] if frame.number == 4), "no answer came: it goes on");
}

#[test]
fn frames_that_came_while_one_was_drawn_are_no_answer() {
    let mut session = drawn();
    session.handle_message(frame(1, Some(0), &[]));
    assert!(matches!(&actions(&mut session)[..], [Action::Draw(_)]));
    session.drawn_behind(1, DrawStats::default(), 2);
    session.handle_message(frame(2, Some(0), &[]));
    session.handle_message(frame(3, Some(0), &[]));
    assert_eq!(
        actions(&mut session),
        [Action::Send(ToMaster::Ready { frame: 1, draw_us: 0, is_cut: false, shown: None })],
        "they wait for the answer"
    );
    session.handle_message(ToTile::Swap { frame: 1 });
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::Show { frame: 1 }, Action::Draw(frame)] if frame.number == 3), "{got:?}");
    session.drawn_behind(3, DrawStats::default(), 1);
    session.handle_message(frame(4, Some(0), &[]));
    assert_eq!(actions(&mut session), [Action::Send(ToMaster::Ready { frame: 3, draw_us: 0, is_cut: false, shown: None })]);
    session.handle_message(frame(5, Some(0), &[]));
    assert!(matches!(&actions(&mut session)[..], [Action::Draw(frame)] if frame.number == 5), "no answer came: it goes on");
}

#[test]
fn chunks_and_picture_outlive_a_connection() {
    let mut session = drawn();
    session.handle_message(ToTile::Swap { frame: 0 });
    actions(&mut session);
    session.disconnected();
    session.connected();
    session.handle_message(welcome());
    session.handle_message(manifest());
    session.handle_message(frame(7, None, &[(1, 3)]));
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::Draw(frame)] if frame.number == 7), "nothing is fetched again: {got:?}");
}

#[test]
fn a_frame_is_shown_though_the_connection_before_had_one_of_its_number() {
    let mut session = drawn();
    session.handle_message(ToTile::Swap { frame: 0 });
    assert_eq!(actions(&mut session), [Action::Show { frame: 0 }]);
    session.disconnected();
    session.connected();
    session.handle_message(welcome());
    session.handle_message(manifest());
    session.handle_message(frame(0, None, &[(0, 2)]));
    assert!(matches!(&actions(&mut session)[..], [Action::Draw(frame)] if frame.number == 0));
    session.drawn(0, DrawStats::default());
    session.handle_message(ToTile::Swap { frame: 0 });
    assert_eq!(
        actions(&mut session),
        [Action::Send(ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None }), Action::Show { frame: 0 }]
    );
}

#[test]
fn a_damaged_blob_is_fetched_again_a_few_times() {
    let mut session = open();
    session.handle_message(frame(0, None, &[(0, 1)]));
    let wanted = [Action::Fetch(vec![(ChunkHash::of(&[0; 10]), 10)])];
    assert_eq!(actions(&mut session), wanted);
    for _ in 0..MAX_REFETCHES {
        session.handle_blob(ChunkHash::of(&[0; 10]), vec![1; 10]);
        assert_eq!(actions(&mut session), wanted);
    }
    session.handle_blob(ChunkHash::of(&[0; 10]), vec![1; 10]);
    assert!(left(&mut session).contains("damaged"));
}

#[test]
fn a_master_that_lies_is_left_with_a_reason() {
    let mut session = drawn();
    session.handle_message(frame(4, Some(3), &[]));
    assert!(left(&mut session).contains("frame 3, which is not here"));
    let mut session = drawn();
    session.handle_message(frame(1, Some(0), &[(3, 5)]));
    assert!(left(&mut session).contains("leaf 4 of 3"));
    let mut session = open();
    session.handle_absent(ChunkHash([0; 32]));
    assert!(left(&mut session).contains("no blob"));
    let mut session = TileSession::new("t0x0", None, u64::MAX, WhenMissing::Hold);
    session.connected();
    session.handle_message(frame(0, None, &[]));
    assert!(left(&mut session).contains("before the manifest"));
}

#[test]
fn what_came_in_just_before_the_end_is_still_uploaded() {
    let mut session = open();
    session.handle_message(frame(0, None, &[(0, 1)]));
    actions(&mut session);
    give(&mut session, 0);
    session.disconnected();
    assert!(matches!(&actions(&mut session)[..], [Action::Upload { chunk: ChunkId(0), .. }]));
}

#[test]
fn without_a_scene_every_frame_is_ready_at_once_and_told_when_it_was_shown() {
    let mut session = TileSession::without_scene("n", None);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(manifest());
    session.handle_message(frame(0, None, &[(0, 3)]));
    assert!(
        matches!(&actions(&mut session)[..], [Action::Draw(frame)] if frame.views[0].leaves.len() == 3),
        "nothing is fetched"
    );
    session.drawn(0, DrawStats::default());
    session.handle_message(ToTile::Swap { frame: 0 });
    session.note_shown(7, 1); // never shown
    assert_eq!(
        actions(&mut session),
        [Action::Send(ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None }), Action::Show { frame: 0 }]
    );
    session.note_shown(0, 1234);
    session.handle_message(frame(1, Some(0), &[(3, 5)]));
    assert_eq!(actions(&mut session).len(), 1);
    session.drawn(1, DrawStats::default());
    let shown = Some(Shown { frame: 0, at_us: 1234 });
    assert_eq!(actions(&mut session), [Action::Send(ToMaster::Ready { frame: 1, draw_us: 0, is_cut: false, shown })]);
}

#[test]
fn a_set_that_is_not_the_masters_ends_the_connection() {
    let mut session = drawn();
    let ToTile::Frame(mut frame) = frame(1, Some(0), &[(3, 5)]) else { unreachable!("a frame") };
    frame.views[0].digest ^= 1;
    session.handle_message(ToTile::Frame(frame));
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::Close { bye, by: EndedBy::Node }] if bye.reason.contains("view 0")), "{got:?}");
}

/// A session of that setting whose scene is open and which was told of frame 0, leaves 0 and 2; leaf 2 is nearest.
fn told_of_frame_0(when_missing: WhenMissing) -> TileSession {
    let mut session = open_with(when_missing, MEMORY_BYTES);
    session.handle_message(frame(0, None, &[(0, 1), (2, 3)]));
    session
}

fn missing_in(action: Option<&Action>) -> Vec<u32> {
    match action {
        Some(Action::Draw(frame)) => frame.views[0].missing.leaves().collect(),
        other => panic!("not drawn but {other:?}"),
    }
}

#[test]
fn a_frame_that_need_not_wait_is_drawn_at_once_and_names_what_is_missing() {
    for when_missing in [WhenMissing::Box, WhenMissing::Nothing] {
        let mut session = told_of_frame_0(when_missing);
        let got = actions(&mut session);
        assert!(matches!(&got[..], [Action::Fetch(blobs), Action::Draw(frame)]
            if blobs.len() == 2 && frame.when_missing == when_missing && frame.views[0].leaves.len() == 2));
        assert_eq!(missing_in(got.last()), [0, 2]);
        session.drawn(0, DrawStats::default());
        assert_eq!(actions(&mut session), [Action::Send(ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None })]);
        // The next frame shows what has come; it stands on the whole set of the one before.
        give(&mut session, 2);
        assert!(matches!(&actions(&mut session)[..], [Action::Upload { chunk: ChunkId(2), .. }]), "nothing is drawn twice");
        let ToTile::Frame(mut next) = frame(1, None, &[(0, 1), (2, 3)]) else { unreachable!("a frame") };
        next.base = Some(0);
        next.views[0].leaves.added.clear();
        session.handle_message(ToTile::Frame(next));
        let got = actions(&mut session);
        assert_eq!(missing_in(got.last()), [0]);
        assert_eq!(got.len(), 1, "what is on its way is not fetched again");
        session.drawn(1, DrawStats::default());
        give(&mut session, 0);
        session.handle_message(frame(2, None, &[(0, 1), (2, 3)]));
        assert_eq!(missing_in(actions(&mut session).last()), []);
    }
}

#[test]
fn a_frame_that_holds_is_drawn_when_all_is_there() {
    let mut session = told_of_frame_0(WhenMissing::Hold);
    assert_eq!(actions(&mut session).len(), 1, "fetched, not drawn");
    give(&mut session, 2);
    give(&mut session, 0);
    let got = actions(&mut session);
    assert_eq!(got.len(), 3);
    assert_eq!(missing_in(got.last()), []);
}

#[test]
fn chunks_of_a_frame_that_is_drawn_already_are_fetched_on() {
    let mut session = told_of_frame_0(WhenMissing::Box);
    assert_eq!(missing_in(actions(&mut session).last()), [0, 2]);
    // While it is drawn, a blob comes damaged.
    session.handle_blob(ChunkHash::of(&[2; 10]), vec![7; 10]);
    assert_eq!(actions(&mut session), [Action::Fetch(vec![(ChunkHash::of(&[2; 10]), 10)])]);
    give(&mut session, 0);
    give(&mut session, 2);
    assert!(matches!(&actions(&mut session)[..], [Action::Upload { .. }, Action::Upload { .. }]));
}

fn hash(chunk: u8) -> (ChunkHash, u64) {
    (ChunkHash::of(&[chunk; 10]), 10)
}

#[test]
fn what_no_frame_needs_is_fetched_when_the_newest_lacks_nothing() {
    let mut session = open_with(WhenMissing::Box, u64::MAX);
    session.handle_message(frame(0, None, &[(2, 3)]));
    assert!(matches!(&actions(&mut session)[..], [Action::Fetch(blobs), Action::Draw(_)] if *blobs == [hash(2)]));
    session.drawn(0, DrawStats::default());
    give(&mut session, 2);
    actions(&mut session);
    // The eye is at 2.5, leaf 1 from 1 to 2.
    session.handle_message(frame(1, None, &[(2, 3)]));
    assert!(matches!(&actions(&mut session)[..], [Action::Fetch(blobs), Action::Draw(_)] if *blobs == [hash(1), hash(0)]));
    // What is on its way is not asked for again, now that it is needed, and is missing till it is there.
    session.drawn(1, DrawStats::default());
    session.handle_message(frame(2, None, &[(0, 3)]));
    let got = actions(&mut session);
    assert_eq!(missing_in(got.last()), [0, 1]);
    assert_eq!(got.len(), 2, "ready and drawn: {got:?}");
    give(&mut session, 1);
    give(&mut session, 0);
    assert!(matches!(&actions(&mut session)[..], [Action::Upload { .. }, Action::Upload { .. }]));
    session.drawn(2, DrawStats::default());
    session.handle_message(frame(3, None, &[]));
    assert!(matches!(&actions(&mut session)[..], [Action::Send(_), Action::Draw(_)]), "all is there");
}

#[test]
fn a_blob_fetched_ahead_may_come_damaged_or_never() {
    let mut session = open_with(WhenMissing::Box, u64::MAX);
    session.handle_message(frame(0, None, &[]));
    let Some(Action::Fetch(blobs)) = session.poll_action() else { panic!("all is fetched ahead") };
    assert_eq!(blobs, [hash(2), hash(1), hash(0)]);
    actions(&mut session);
    session.drawn(0, DrawStats::default());
    session.handle_blob(hash(1).0, vec![7; 10]);
    assert!(actions(&mut session).contains(&Action::Fetch(vec![hash(1)])));
    give(&mut session, 2);
    session.disconnected();
    actions(&mut session);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(manifest());
    session.handle_message(frame(0, None, &[]));
    assert!(matches!(&actions(&mut session)[..], [Action::Fetch(blobs), Action::Draw(_)] if *blobs == [hash(1), hash(0)]));
}

/// The scene with an object, two leaves and their chunks behind what it had.
fn grown() -> SceneManifest {
    let mut manifest = scene().manifest;
    manifest.transforms.push(Transform::from(DAffine3::from_translation(DVec3::new(2.0, 0.0, -6.0)))); // ahead
    for i in 3..5u8 {
        manifest.chunks.push(ChunkRecord::new(ChunkHash::of(&[i; 10]), 0, 10, ChunkKind::Geometry));
        let (object, chunk) = (ObjectId(1), ChunkId(u32::from(i)));
        manifest.leaves.push(LeafRecord { object, chunk, ..manifest.leaves[0] });
    }
    manifest
}

fn added_sections() -> [Vec<u8>; 4] {
    SectionKind::FOR_TILES.map(|kind| grown().section_since(kind, scene().manifest.size()).unwrap())
}

fn grown_manifest(epoch: u32) -> ToTile {
    let ToTile::Manifest(Manifest { mut sections, .. }) = manifest() else { unreachable!("a manifest") };
    sections.extend(SectionKind::FOR_TILES.into_iter().zip(added_sections()).map(|(kind, bytes)| SectionRef {
        kind,
        hash: ChunkHash::of(&bytes),
        length: bytes.len() as u64,
    }));
    ToTile::Manifest(Manifest { epoch, sections, tessellation: None, hierarchies: None })
}

#[test]
fn a_scene_of_many_parts_is_asked_for_in_portions() {
    const PARTS: usize = 300;
    let mut blobs: HashMap<ChunkHash, Vec<u8>> = HashMap::new();
    let mut sections = Vec::new();
    for part in 0..PARTS {
        let mut scene = Package::default().scene;
        scene.manifest.transforms = vec![Transform::from(DAffine3::from_translation(DVec3::X * part as f64))];
        for kind in SectionKind::FOR_TILES {
            let bytes = scene.section_bytes(kind).unwrap();
            let hash = ChunkHash::of(&bytes);
            sections.push(SectionRef { kind, hash, length: bytes.len() as u64 });
            blobs.insert(hash, bytes);
        }
    }
    assert!(blobs.len() > MAX_WANTED);
    let mut session = TileSession::new("t0x0", None, 1 << 20, WhenMissing::Hold);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(ToTile::Manifest(Manifest { epoch: 1, sections, tessellation: None, hierarchies: None }));
    let (mut wanted, mut opened) = (VecDeque::new(), None);
    loop {
        for action in actions(&mut session) {
            match action {
                Action::Fetch(more) => wanted.extend(more.into_iter().map(|(hash, _)| hash)),
                Action::OpenScene(manifest, _) => opened = Some(manifest),
                other => panic!("{other:?}"),
            }
        }
        assert!(wanted.len() < MAX_WANTED, "{} at once", wanted.len());
        let Some(hash) = wanted.pop_front() else { break };
        session.handle_blob(hash, blobs[&hash].clone());
    }
    let opened = opened.expect("it has all its parts");
    assert!(opened.transforms.iter().enumerate().all(|(i, t)| t.affine().translation.x == i as f64));
    assert_eq!(opened.transforms.len(), PARTS);
}

fn give_sections(session: &mut TileSession) {
    added_sections().into_iter().for_each(|bytes| session.handle_blob(ChunkHash::of(&bytes), bytes));
}

fn frame_of(epoch: u32, number: u64, base: Option<u64>, added: &[(u32, u32)]) -> ToTile {
    let ToTile::Frame(mut frame) = frame(number, base, added) else { unreachable!("a frame") };
    frame.epoch = epoch;
    ToTile::Frame(frame)
}

/// A session that has drawn frame 0, all three leaves, with room to fetch ahead.
fn drawn_with_room() -> TileSession {
    let mut session = open_with(WhenMissing::Hold, u64::MAX);
    session.handle_message(frame(0, None, &[(0, 3)]));
    (0..3).for_each(|i| give(&mut session, i));
    actions(&mut session);
    session.drawn(0, DrawStats::default());
    actions(&mut session);
    session
}

#[test]
fn a_scene_that_grows_is_taken_in_while_frames_go_on() {
    let mut session = drawn_with_room();
    session.handle_message(grown_manifest(2));
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::Fetch(blobs)] if blobs.len() == 4), "what is here is not fetched again: {got:?}");
    // A frame of the old epoch, with the tables half there.
    let [first, ..] = added_sections();
    session.handle_blob(ChunkHash::of(&first), first);
    session.handle_message(frame(1, Some(0), &[]));
    assert!(matches!(&actions(&mut session)[..], [Action::Draw(frame)] if frame.number == 1));
    session.drawn(1, DrawStats::default());
    actions(&mut session);
    give_sections(&mut session);
    session.handle_message(frame(2, Some(0), &[]));
    let got = actions(&mut session);
    let [Action::GrowScene(manifest), Action::Fetch(blobs), Action::Draw(_)] = &got[..] else { panic!("{got:?}") };
    assert_eq!((**manifest == grown(), blobs.as_slice()), (true, &[hash(3), hash(4)][..]));
    session.drawn(2, DrawStats::default());
    give(&mut session, 3);
    let prepared = Action::Send(ToMaster::Prepared { epoch: 2 });
    assert!(!actions(&mut session).contains(&prepared), "it would see the other chunk, too");
    give(&mut session, 4);
    assert!(actions(&mut session).contains(&prepared));
    // The new epoch's first frame stands on one of the old epoch, and lacks nothing.
    session.handle_message(frame_of(2, 3, Some(0), &[(3, 5)]));
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::Draw(frame)] if frame.epoch == 2 && frame.views[0].leaves.len() == 5), "{got:?}");
    session.handle_message(frame(4, Some(0), &[]));
    assert!(left(&mut session).contains("frame 4 is of epoch 1, the manifest of 2"));
}

#[test]
fn a_frame_of_a_scene_that_is_not_there_yet_waits_for_it() {
    let mut session = drawn_with_room();
    session.handle_message(grown_manifest(2));
    session.handle_message(frame_of(2, 1, Some(0), &[(3, 5)]));
    let mut moved = frame_of(2, 2, Some(0), &[(3, 5)]);
    if let ToTile::Frame(frame) = &mut moved {
        frame.moved = vec![Moved { object: ObjectId(1), transform: Transform::from(DAffine3::from_translation(DVec3::X)) }];
    }
    session.handle_message(moved);
    assert!(matches!(&actions(&mut session)[..], [Action::Fetch(_)]));
    give_sections(&mut session);
    let got = actions(&mut session);
    let is_moved = |action: &Action| matches!(action, Action::SetTransform(moved) if moved.object == ObjectId(1));
    assert!(matches!(&got[0], Action::GrowScene(_)) && got.iter().any(is_moved), "{got:?}");
    give(&mut session, 3);
    give(&mut session, 4);
    let got = actions(&mut session);
    assert!(matches!(got.last(), Some(Action::Draw(frame)) if frame.number == 2), "{got:?}");
    assert!(got.contains(&Action::Send(ToMaster::Prepared { epoch: 2 })));
}

#[test]
fn what_was_fetched_of_a_growing_scene_outlives_a_connection() {
    let mut session = drawn_with_room();
    session.handle_message(grown_manifest(2));
    give_sections(&mut session);
    actions(&mut session);
    session.disconnected();
    session.connected();
    session.handle_message(welcome());
    // The master went on, or has not begun yet, or is another one that never grew.
    session.handle_message(grown_manifest(7));
    assert_eq!(actions(&mut session), [], "all of it is here, and nothing was asked");
    session.disconnected();
    session.connected();
    session.handle_message(welcome());
    session.handle_message(manifest());
    assert!(matches!(&actions(&mut session)[..], [Action::Fetch(blobs)] if blobs.len() == 4), "its scene is a smaller one");
}

#[test]
fn a_scene_that_does_not_begin_with_the_one_before_ends_the_connection() {
    for bad in [grown_manifest(3), manifest(), {
        let ToTile::Manifest(Manifest { mut sections, .. }) = grown_manifest(2) else { unreachable!("a manifest") };
        sections.rotate_left(4);
        ToTile::Manifest(Manifest { epoch: 2, sections, tessellation: None, hierarchies: None })
    }] {
        let mut session = drawn_with_room();
        session.handle_message(bad);
        assert!(left(&mut session).contains("is not that of epoch 1 and more"));
    }
    let mut session = drawn_with_room();
    session.handle_message(frame_of(2, 1, None, &[]));
    assert!(left(&mut session).contains("frame 1 is of epoch 2, the manifest of 1"));
    let mut session = TileSession::without_scene("n", None);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(manifest());
    session.handle_message(grown_manifest(2));
    assert_eq!(actions(&mut session), [Action::Send(ToMaster::Prepared { epoch: 2 })], "who draws nothing is always prepared");
}

/// As [`frame`], with leaves that are dropped, none before.
fn frame_dropping(number: u64, base: Option<u64>, added: &[(u32, u32)], dropped: &VisibleSet) -> ToTile {
    let ToTile::Frame(frame) = frame(number, base, added) else { unreachable!("it is a frame") };
    let delta = VisibleDelta { removed: VisibleSet::default(), added: dropped.clone() };
    ToTile::Frame(Frame { dropped: delta, dropped_digest: dropped.digest(), ..frame })
}

#[test]
fn what_is_dropped_comes_apart_from_what_is_seen_and_must_be_the_masters() {
    let mut session = drawn();
    let dropped = VisibleSet::from_ranges([LeafRange::new(1, 2), LeafRange::new(70, 90)]);
    session.handle_message(frame_dropping(1, Some(0), &[], &dropped));
    let [Action::Draw(drawn)] = &actions(&mut session)[..] else { panic!("all is there") };
    assert_eq!((&drawn.views[0].leaves, &drawn.dropped), (&VisibleSet::all(3), &dropped));
    session.drawn(1, DrawStats::default());
    // Nothing is dropped since frame 0; since frame 1, the master speaks of another set than there is.
    let ToTile::Frame(mut frame) = frame_dropping(2, Some(0), &[], &VisibleSet::default()) else { unreachable!("it is a frame") };
    session.handle_message(ToTile::Frame(frame.clone()));
    assert!(matches!(actions(&mut session).last(), Some(Action::Draw(frame)) if frame.dropped.is_empty()));
    session.drawn(2, DrawStats::default());
    (frame.number, frame.dropped_digest) = (3, dropped.digest());
    session.handle_message(ToTile::Frame(frame));
    assert_eq!(left(&mut session), "frame 3: what is dropped is not what the master says");
}

#[test]
fn what_is_drawn_is_counted_where_the_master_asks_for_it() {
    let mut session = drawn();
    session.disconnected();
    session.connected();
    let ToTile::Welcome(welcome) = welcome() else { unreachable!("it is a welcome") };
    session.handle_message(ToTile::Welcome(Welcome { count_every: 2, ..welcome }));
    session.handle_message(manifest());
    let mut told = Vec::new();
    for number in 0..4 {
        session.handle_message(frame(number, None, &[(0, 3)]));
        assert!(matches!(actions(&mut session).last(), Some(Action::Draw(_))));
        session.drawn(number, DrawStats::default());
        // Neither the master nor the picture waits for a count.
        assert!(matches!(&actions(&mut session)[..], [Action::Send(ToMaster::Ready { .. })]));
        session.handle_message(ToTile::Swap { frame: number });
        assert_eq!(session.poll_action(), Some(Action::Show { frame: number }));
        if let Some(Action::Count(frame, order)) = session.poll_action() {
            assert_eq!((frame.number, &order), (number, &CountOrder { place: 0, objects: vec![ObjectId(0)] }));
            let count = |object: &ObjectId| ObjectCount { object: *object, visible_px: 7, distance_m: 1.0 };
            session.counted(number, ViewId(0), order.objects.iter().map(count).collect());
            told.extend(actions(&mut session));
        }
    }
    let counted = |frame| {
        let objects = vec![ObjectCount { object: ObjectId(0), visible_px: 7, distance_m: 1.0 }];
        Action::Send(ToMaster::Counted(Counted { frame, view: ViewId(0), objects }))
    };
    assert_eq!(told, [counted(0), counted(2)]);
    session.counted(3, ViewId(0), Vec::new());
    assert_eq!(actions(&mut session), [], "who cannot count says nothing");
}
