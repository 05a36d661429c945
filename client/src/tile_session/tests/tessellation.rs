//! The tessellation comes with the scene, is checked like all else of it, and stays as long as it is the same; a frame's order comes as it is.

use mullion_common::geometry::Plane;
use mullion_common::scene::TessellationParts;
use mullion_common::wire::{Estimate, Primary};

use super::*;

/// One that covers nothing, so many metres from the origin.
fn bytes(x: f64) -> Vec<u8> {
    let parts = TessellationParts { origin: DVec3::X * x, ..TessellationParts::default() };
    Tessellation::new(parts, &scene().manifest).expect("it names nothing").encode()
}

fn section_of(bytes: &[u8]) -> SectionRef {
    SectionRef { kind: SectionKind::Tessellation, hash: ChunkHash::of(bytes), length: bytes.len() as u64 }
}

fn naming(bytes: &[u8], manifest: ToTile) -> ToTile {
    let ToTile::Manifest(manifest) = manifest else { unreachable!("a manifest") };
    ToTile::Manifest(Manifest { tessellation: Some(section_of(bytes)), ..manifest })
}

/// A session that has all of its scene but the tessellation, which it was the last to ask for.
fn lacking(bytes: &[u8]) -> TileSession {
    let mut session = TileSession::new("t0x0", None, MEMORY_BYTES, WhenMissing::Hold);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(naming(bytes, manifest()));
    let [Action::Fetch(blobs)] = &actions(&mut session)[..] else { panic!("all is fetched at once") };
    assert_eq!((blobs.len(), blobs[4]), (5, (ChunkHash::of(bytes), bytes.len() as u64)));
    for kind in SectionKind::FOR_TILES {
        let bytes = section(kind);
        session.handle_blob(ChunkHash::of(&bytes), bytes);
    }
    session.handle_message(frame(0, None, &[(0, 3)]));
    assert_eq!(actions(&mut session), [], "nothing is opened by halves");
    session
}

fn origin(action: &Action) -> DVec3 {
    let Action::TakeTessellation(tessellation) = action else { panic!("{action:?}") };
    tessellation.origin()
}

fn with_tessellation() -> TileSession {
    let bytes = bytes(1.0);
    let mut session = lacking(&bytes);
    session.handle_blob(ChunkHash::of(&bytes), bytes);
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::OpenScene(..), _, Action::Fetch(chunks)] if chunks.len() == 3), "{got:?}");
    assert_eq!(origin(&got[1]), DVec3::X);
    (0..3).for_each(|chunk| give(&mut session, chunk));
    actions(&mut session);
    session.drawn(0, DrawStats { draw_us: 77, ..DrawStats::default() });
    assert_eq!(actions(&mut session), [Action::Send(ToMaster::Ready { frame: 0, draw_us: 77, is_cut: false, shown: None })]);
    session
}

fn reconnected(session: &mut TileSession, manifest: ToTile) -> Vec<Action> {
    session.disconnected();
    session.connected();
    session.handle_message(welcome());
    session.handle_message(manifest);
    actions(session)
}

#[test]
fn it_outlives_a_connection_and_is_fetched_again_where_it_is_another() {
    let mut session = with_tessellation();
    assert_eq!(reconnected(&mut session, naming(&bytes(1.0), manifest())), []);
    let got = reconnected(&mut session, naming(&bytes(2.0), manifest()));
    assert!(matches!(&got[..], [Action::Fetch(blobs)] if blobs.len() == 5), "{got:?}");
    for blob in SectionKind::FOR_TILES.map(section).into_iter().chain([bytes(2.0)]) {
        session.handle_blob(ChunkHash::of(&blob), blob);
    }
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::OpenScene(..), _]) && origin(&got[1]) == DVec3::X * 2.0, "{got:?}");
    let got = reconnected(&mut session, manifest());
    assert!(matches!(&got[..], [Action::Fetch(blobs)] if blobs.len() == 4), "a scene without one is another scene: {got:?}");
}

#[test]
fn what_the_painter_has_not_taken_yet_outlives_a_connection_too() {
    let bytes = bytes(1.0);
    let mut session = lacking(&bytes);
    session.handle_blob(ChunkHash::of(&bytes), bytes.clone());
    let got = reconnected(&mut session, naming(&bytes, manifest()));
    assert!(matches!(&got[..], [Action::OpenScene(..), Action::TakeTessellation(_)]), "{got:?}");
}

#[test]
fn it_stays_when_the_scene_grows() {
    let mut session = with_tessellation();
    session.handle_message(naming(&bytes(1.0), grown_manifest(2)));
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::Fetch(blobs)] if blobs.len() == 4), "{got:?}");
    give_sections(&mut session);
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::GrowScene(_), ..]), "{got:?}");
    for other in [naming(&bytes(2.0), grown_manifest(2)), grown_manifest(2)] {
        let mut session = with_tessellation();
        session.handle_message(other);
        assert_eq!(left(&mut session), "epoch 2 has another tessellation than epoch 1");
    }
}

#[test]
fn who_comes_when_the_scene_has_grown_takes_it_all_at_once() {
    let mut session = TileSession::new("t0x0", None, MEMORY_BYTES, WhenMissing::Hold);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(naming(&bytes(1.0), grown_manifest(2)));
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::Fetch(blobs)] if blobs.len() == 9), "{got:?}");
    session.handle_blob(ChunkHash::of(&bytes(1.0)), bytes(1.0));
    give_sections(&mut session);
    for kind in SectionKind::FOR_TILES {
        session.handle_blob(ChunkHash::of(&section(kind)), section(kind));
    }
    let got = actions(&mut session);
    assert!(matches!(&got[..], [Action::OpenScene(..), Action::TakeTessellation(_)]), "{got:?}");
}

#[test]
fn one_that_comes_damaged_is_fetched_again_and_given_up_in_the_end() {
    let bytes = bytes(1.0);
    let mut session = lacking(&bytes);
    for _ in 0..MAX_REFETCHES {
        session.handle_blob(ChunkHash::of(&bytes), vec![7; bytes.len()]);
        assert_eq!(actions(&mut session), [Action::Fetch(vec![(ChunkHash::of(&bytes), bytes.len() as u64)])]);
    }
    session.handle_blob(ChunkHash::of(&bytes), vec![7; bytes.len()]);
    assert_eq!(left(&mut session), format!("blob {} came damaged {} times", ChunkHash::of(&bytes), MAX_REFETCHES + 1));
}

#[test]
fn what_is_no_tessellation_of_the_scene_ends_the_connection() {
    let bytes = vec![7; 100];
    let mut session = lacking(&bytes);
    session.handle_blob(ChunkHash::of(&bytes), bytes);
    let reason = left(&mut session);
    assert!(reason.starts_with("the scene: ") && reason.contains("header"), "{reason}");
}

#[test]
fn who_draws_nothing_fetches_none() {
    let mut session = TileSession::without_scene("n", None);
    session.connected();
    session.handle_message(welcome());
    session.handle_message(naming(&bytes(1.0), manifest()));
    session.handle_message(naming(&bytes(1.0), grown_manifest(2)));
    assert_eq!(actions(&mut session), [Action::Send(ToMaster::Prepared { epoch: 2 })]);
}

#[test]
fn a_frames_order_comes_to_the_painter_as_it_is() {
    let mut session = with_tessellation();
    let planes = vec![Plane { normal: DVec3::Y, offset_m: 2.0 }];
    let (order, primary) = (Estimate { triangles: 500, is_complete: false }, Primary { pixels_per_radian: 800.0, planes });
    for (number, orders) in [(1, Some((order, primary))), (2, None)] {
        let (estimate, primary) = orders.unzip();
        let ToTile::Frame(plain) = frame(number, None, &[(0, 3)]) else { unreachable!("it is a frame") };
        session.handle_message(ToTile::Frame(Frame { estimate, primary: primary.clone().map(Box::new), ..plain }));
        let got = actions(&mut session);
        let Some(Action::Draw(drawn)) = got.last() else { panic!("{got:?}") };
        assert_eq!((&drawn.estimate, &drawn.primary), (&estimate, &primary));
        session.drawn(number, DrawStats::default());
    }
}
