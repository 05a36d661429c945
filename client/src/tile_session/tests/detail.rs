//! Vertex hierarchies come while frames are drawn in detail: bases before all else that their objects need, blocks behind what frames lack,
//! and one that is none costs its own object.

use mullion_common::scene::{Filter, HierarchyIndex, IndexedHierarchy, TextureRef, Wrap};
use mullion_common::wire::{DetailWeight, Primary};

use super::*;

/// Four objects, a leaf each: 0 and 1 have hierarchies of three blobs, 2 has one of a base alone, 3 has none. Leaf 1 has a texture, chunk 4.
fn detailed_scene() -> Scene {
    let chunk = |i: u8, kind| ChunkRecord::new(ChunkHash::of(&[i; 10]), 0, 10, kind);
    let chunks = (0..5).map(|i| chunk(i, if i == 4 { ChunkKind::Texture } else { ChunkKind::Geometry })).collect();
    let leaf = |i: u32| LeafRecord {
        object: ObjectId(i),
        chunk: ChunkId(i),
        material: MaterialId(u32::from(i == 1)),
        triangle_count: 1,
        local_min: [i as f32, 0.0, 0.0],
        local_max: [i as f32 + 1.0, 1.0, 1.0],
    };
    let texture = TextureRef { chunk: ChunkId(4), wrap_u: Wrap::Repeat, wrap_v: Wrap::Clamp, filter: Filter::Linear };
    let material = |texture| Material { base_color: [1.0; 4], texture, alpha: AlphaMode::Opaque, double_sided: false };
    let manifest = SceneManifest {
        transforms: vec![Transform::from(DAffine3::IDENTITY); 4],
        leaves: (0..4).map(leaf).collect(),
        materials: vec![material(None), material(Some(texture))],
        chunks,
    };
    Scene { manifest, ..Package::default().scene }
}

/// A hierarchy's base or block.
fn blob(hierarchy: u8, number: u8) -> Vec<u8> {
    vec![100 + 10 * hierarchy + number; 12]
}

fn name(hierarchy: u8, number: u8) -> (ChunkHash, u64) {
    (ChunkHash::of(&blob(hierarchy, number)), 12)
}

fn index() -> Vec<u8> {
    let hierarchy = |hierarchy: u8, blobs: u8| IndexedHierarchy {
        objects: [ObjectId(hierarchy.into())].into(),
        blobs: (0..blobs).map(|number| BlobRef { hash: name(hierarchy, number).0, length: 12 }).collect(),
    };
    HierarchyIndex { hierarchies: vec![hierarchy(0, 3), hierarchy(1, 3), hierarchy(2, 1)] }.encode()
}

fn detailed_manifest(index: &[u8]) -> ToTile {
    let sections = SectionKind::FOR_TILES.map(|kind| {
        let bytes = detailed_scene().section_bytes(kind).unwrap();
        SectionRef { kind, hash: ChunkHash::of(&bytes), length: bytes.len() as u64 }
    });
    let hierarchies = Some(BlobRef { hash: ChunkHash::of(index), length: index.len() as u32 });
    ToTile::Manifest(Manifest { epoch: 1, sections: sections.into(), tessellation: None, hierarchies })
}

const ENOUGH_BYTES: u64 = 1 << 20;

fn open_detailed(when_missing: WhenMissing, memory_bytes: u64) -> TileSession {
    let mut session = TileSession::new("t0x0", None, memory_bytes, when_missing);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(detailed_manifest(&index()));
    let [Action::Fetch(blobs)] = &actions(&mut session)[..] else { panic!("sections are fetched first") };
    assert_eq!((blobs.len(), blobs[4]), (5, (ChunkHash::of(&index()), index().len() as u64)));
    session.handle_blob(ChunkHash::of(&index()), index());
    for kind in SectionKind::FOR_TILES {
        let bytes = detailed_scene().section_bytes(kind).unwrap();
        session.handle_blob(ChunkHash::of(&bytes), bytes);
    }
    assert!(matches!(&actions(&mut session)[..], [Action::OpenScene(..)]));
    session
}

const DETAIL: Detail = Detail { triangles: None, least_pixels: 1.0, hides: true, weight: DetailWeight::None };

/// A frame of such leaves, drawn in detail.
fn in_detail(number: u64, leaves: &[(u32, u32)]) -> ToTile {
    let ToTile::Frame(plain) = frame(number, None, leaves) else { unreachable!("it is a frame") };
    let primary = Primary { pixels_per_radian: 800.0, planes: vec![] };
    ToTile::Frame(Frame { detail: Some(DETAIL), primary: Some(Box::new(primary)), ..plain })
}

/// What the session does, where the painter takes all blobs of hierarchies but those that start with such a byte.
fn paint(session: &mut TileSession, refused: Option<u8>) -> Vec<Action> {
    let mut done = Vec::new();
    while let Some(action) = session.poll_action() {
        if let Action::TakeHierarchy { number, blob, .. } = &action {
            session.hierarchy_taken(*number, (Some(blob[0]) != refused).then_some(20));
        }
        done.push(action);
    }
    done
}

fn give_blob(session: &mut TileSession, hierarchy: u8, number: u8) {
    session.handle_blob(name(hierarchy, number).0, blob(hierarchy, number));
}

fn taken(hierarchy: u8, number: u8) -> Action {
    let objects = [ObjectId(hierarchy.into())].into();
    Action::TakeHierarchy { number: hierarchy.into(), objects, blob: blob(hierarchy, number) }
}

fn fetched(actions: &[Action]) -> Vec<(ChunkHash, u64)> {
    let blobs = actions.iter().filter_map(|action| if let Action::Fetch(blobs) = action { Some(blobs.clone()) } else { None });
    blobs.flatten().collect()
}

fn drawn_frame(actions: &[Action]) -> &FrameToDraw {
    let Some(Action::Draw(frame)) = actions.last() else { panic!("{actions:?}") };
    frame
}

#[test]
fn bases_come_before_all_else_and_blocks_behind_what_the_frame_lacks() {
    let mut session = open_detailed(WhenMissing::Hold, ENOUGH_BYTES);
    session.handle_message(in_detail(0, &[(0, 2), (3, 4)]));
    // The eye is nearest to leaf 2, which is not seen. No geometry of what has a hierarchy.
    let got = paint(&mut session, None);
    assert_eq!(got, [Action::Fetch(vec![name(1, 0), name(0, 0), hash(4), hash(3)])]);
    give_blob(&mut session, 1, 0);
    give(&mut session, 3);
    assert_eq!(fetched(&paint(&mut session, None)), [], "something lacks still");
    give(&mut session, 4);
    give_blob(&mut session, 0, 0);
    let got = paint(&mut session, None);
    // The other base, then blocks by turns; four are on their way at once.
    assert_eq!(fetched(&got), [name(2, 0), name(0, 1), name(1, 1), name(0, 2)]);
    let frame = drawn_frame(&got);
    assert_eq!((frame.detail, frame.views[0].missing.is_empty()), (Some(DETAIL), true), "its leaves are not missing");
    assert_eq!(got[..3], [Action::Upload { chunk: ChunkId(4), bytes: vec![4; 10] }, taken(0, 0), got[2].clone()]);
    session.drawn(0, DrawStats::default());
    // One that comes before its turn waits for those before it.
    give_blob(&mut session, 0, 2);
    assert_eq!(fetched(&paint(&mut session, None)), [name(1, 2)]);
    give_blob(&mut session, 0, 1);
    assert_eq!(paint(&mut session, None), [taken(0, 1), taken(0, 2)]);
    give_blob(&mut session, 1, 1);
    give_blob(&mut session, 2, 0);
    give_blob(&mut session, 1, 2);
    assert_eq!(paint(&mut session, None), [taken(1, 1), taken(2, 0), taken(1, 2)]);
    assert_eq!(session.stats().resident_bytes, 60 + 20, "three hierarchies as the painter says, and two chunks");
}

#[test]
fn without_an_order_all_is_as_if_there_were_no_hierarchies() {
    let mut session = open_detailed(WhenMissing::Hold, ENOUGH_BYTES);
    session.handle_message(frame(0, None, &[(0, 4)]));
    assert_eq!(paint(&mut session, None), [Action::Fetch(vec![hash(2), hash(1), hash(4), hash(3), hash(0)])]);
    (0..5).for_each(|chunk| give(&mut session, chunk));
    let got = paint(&mut session, None);
    assert_eq!((fetched(&got), drawn_frame(&got).detail), (vec![], None));
    session.drawn(0, DrawStats::default());
    session.handle_message(frame(1, None, &[(0, 4)]));
    assert_eq!(fetched(&paint(&mut session, None)), []);
}

#[test]
fn leaves_are_missing_until_their_base_and_texture_have_come() {
    let mut session = open_detailed(WhenMissing::Box, ENOUGH_BYTES);
    let mut missing = |give_next: &dyn Fn(&mut TileSession), number| {
        give_next(&mut session);
        session.handle_message(in_detail(number, &[(0, 4)]));
        let got = paint(&mut session, None);
        let missing: Vec<u32> = drawn_frame(&got).views[0].missing.leaves().collect();
        session.drawn(number, DrawStats::default());
        missing
    };
    assert_eq!(missing(&|_| {}, 0), [0, 1, 2, 3]);
    assert_eq!(missing(&|session| give_blob(session, 0, 0), 1), [1, 2, 3]);
    assert_eq!(missing(&|session| give_blob(session, 1, 0), 2), [1, 2, 3], "its texture lacks");
    assert_eq!(missing(&|session| give(session, 4), 3), [2, 3]);
    assert_eq!(missing(&|session| give(session, 3), 4), [2]);
    assert_eq!(missing(&|session| give_blob(session, 2, 0), 5), []);
}

#[test]
fn a_hierarchy_that_is_none_costs_its_own_object() {
    let mut session = open_detailed(WhenMissing::Hold, ENOUGH_BYTES);
    session.handle_message(in_detail(0, &[(0, 3)]));
    assert_eq!(fetched(&paint(&mut session, None)), [name(2, 0), name(1, 0), name(0, 0), hash(4)]);
    give_blob(&mut session, 2, 0);
    give_blob(&mut session, 1, 0);
    give(&mut session, 4);
    // What the painter refuses is drawn from its leaves, which lack. Its blocks were asked for before that, and nobody takes them.
    give_blob(&mut session, 0, 0);
    let got = paint(&mut session, Some(100));
    assert_eq!(fetched(&got), [name(0, 1), name(1, 1), name(0, 2), name(1, 2), hash(0)]);
    give_blob(&mut session, 0, 1);
    give_blob(&mut session, 0, 2);
    assert_eq!(paint(&mut session, None), []);
    give(&mut session, 0);
    assert!(drawn_frame(&paint(&mut session, None)).views[0].missing.is_empty());
    session.drawn(0, DrawStats::default());
    // A block that is none costs the object, too, and the next frame lacks its geometry.
    give_blob(&mut session, 1, 1);
    assert_eq!(paint(&mut session, Some(111)).len(), 2);
    session.handle_message(in_detail(1, &[(0, 3)]));
    assert_eq!(fetched(&paint(&mut session, None)), [hash(1)]);
    give(&mut session, 1);
    assert!(drawn_frame(&paint(&mut session, None)).views[0].missing.is_empty());
}

#[test]
fn one_that_always_comes_damaged_costs_its_own_object() {
    let mut session = open_detailed(WhenMissing::Hold, ENOUGH_BYTES);
    session.handle_message(in_detail(0, &[(0, 1)]));
    paint(&mut session, None);
    for _ in 0..MAX_REFETCHES {
        session.handle_blob(name(0, 0).0, vec![7; 12]);
        assert_eq!(paint(&mut session, None), [Action::Fetch(vec![name(0, 0)])]);
    }
    session.handle_blob(name(0, 0).0, vec![7; 12]);
    assert_eq!(paint(&mut session, None), [Action::ForgetHierarchy(0), Action::Fetch(vec![hash(0)])]);
    give(&mut session, 0);
    assert!(drawn_frame(&paint(&mut session, None)).views[0].missing.is_empty());
}

#[test]
fn nothing_comes_of_one_that_was_refused_though_it_was_to_be_handed_on() {
    let mut session = open_detailed(WhenMissing::Hold, ENOUGH_BYTES);
    session.handle_message(in_detail(0, &[(0, 1)]));
    paint(&mut session, None);
    give_blob(&mut session, 0, 0);
    paint(&mut session, None);
    give_blob(&mut session, 0, 1);
    give_blob(&mut session, 0, 2);
    assert_eq!(session.poll_action(), Some(taken(0, 1)));
    session.hierarchy_taken(0, None);
    assert!(!actions(&mut session).contains(&taken(0, 2)));
}

#[test]
fn where_memory_is_short_frames_have_what_they_need_and_nothing_is_fetched_ahead() {
    let mut session = open_detailed(WhenMissing::Hold, 60);
    session.handle_message(in_detail(0, &[(0, 2)]));
    assert_eq!(fetched(&paint(&mut session, None)).len(), 3);
    give_blob(&mut session, 1, 0);
    give_blob(&mut session, 0, 0);
    give(&mut session, 4);
    let got = paint(&mut session, None);
    // Of 60 bytes 45 may be taken; 20 of each base, and the texture, are more.
    assert!(drawn_frame(&got).views[0].missing.is_empty() && fetched(&got).is_empty(), "{got:?}");
}

#[test]
fn what_has_come_outlives_a_connection_and_an_order_that_is_taken_back() {
    let mut session = open_detailed(WhenMissing::Hold, ENOUGH_BYTES);
    session.handle_message(in_detail(0, &[(0, 1)]));
    paint(&mut session, None);
    give_blob(&mut session, 0, 0);
    // Its order to the painter, too, though nobody has asked for it yet.
    session.disconnected();
    session.connected();
    session.handle_message(welcome());
    session.handle_message(detailed_manifest(&index()));
    session.handle_message(in_detail(7, &[(0, 1)]));
    let got = paint(&mut session, None);
    assert_eq!((&got[0], drawn_frame(&got).number), (&taken(0, 0), 7));
    assert_eq!(fetched(&got), [name(1, 0), name(2, 0), name(0, 1), name(1, 1)]);
    session.drawn(7, DrawStats::default());
    session.handle_message(frame(8, None, &[(0, 1)]));
    assert_eq!(fetched(&paint(&mut session, None)), [hash(0)], "leaves are drawn from geometry again");
    give(&mut session, 0);
    assert_eq!(drawn_frame(&paint(&mut session, None)).detail, None);
    session.drawn(8, DrawStats::default());
    session.handle_message(in_detail(9, &[(0, 1)]));
    assert!(drawn_frame(&paint(&mut session, None)).views[0].missing.is_empty(), "the base is here");
}

#[test]
fn other_hierarchies_are_another_scene_and_no_later_epoch() {
    let other = HierarchyIndex::default().encode();
    let mut session = open_detailed(WhenMissing::Hold, ENOUGH_BYTES);
    session.handle_message(in_detail(0, &[(0, 1)]));
    paint(&mut session, None);
    give_blob(&mut session, 0, 0);
    session.disconnected();
    session.connected();
    session.handle_message(welcome());
    session.handle_message(detailed_manifest(&other));
    let got = paint(&mut session, None);
    assert!(matches!(&got[..], [Action::Fetch(blobs)] if blobs.len() == 5), "nothing of the one before is taken: {got:?}");
    let mut session = open_detailed(WhenMissing::Hold, ENOUGH_BYTES);
    let ToTile::Manifest(Manifest { sections, hierarchies, .. }) = detailed_manifest(&other) else { unreachable!("a manifest") };
    let sections = [&sections[..], &sections[..]].concat();
    session.handle_message(ToTile::Manifest(Manifest { epoch: 2, sections, tessellation: None, hierarchies }));
    assert_eq!(left(&mut session), "epoch 2 has other hierarchies of detail than epoch 1");
}

#[test]
fn what_is_no_index_of_the_scene_ends_the_connection() {
    let bad = [&index()[..], &[0; 4]].concat();
    let mut session = TileSession::new("t0x0", None, ENOUGH_BYTES, WhenMissing::Hold);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(detailed_manifest(&bad));
    for kind in SectionKind::FOR_TILES {
        let bytes = detailed_scene().section_bytes(kind).unwrap();
        session.handle_blob(ChunkHash::of(&bytes), bytes);
    }
    session.handle_blob(ChunkHash::of(&bad), bad);
    let reason = left(&mut session);
    assert!(reason.starts_with("the scene: hierarchies of detail: "), "{reason}");
    let mut session = TileSession::without_scene("n", None);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(detailed_manifest(&index()));
    session.handle_message(in_detail(0, &[(0, 3)]));
    assert!(
        matches!(&actions(&mut session)[..], [Action::Draw(frame)] if frame.detail == Some(DETAIL)),
        "who draws nothing fetches none"
    );
}
