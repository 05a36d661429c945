//! Goal: the bytes never change unnoticed, and no bytes from outside make a decoder panic.
//! Method: golden bytes of every message; round trips; random bytes and mutated messages into every decoder.

use glam::{DAffine3, DVec3};
use proptest::prelude::*;

use super::*;
use crate::geometry::Plane;
use crate::scene::{BlobRef, ChunkHash, ObjectId, Presence, SectionKind, Transform};
use crate::visible_set::{LeafRange, VisibleDelta, VisibleSet};
use crate::wall::{Eye, ObserverId, TileId, ViewId};

fn hello() -> Opening {
    Opening::Control(Hello {
        node: "t1x0".into(),
        part: Part::Spare,
        credentials: Some(vec![7, 8]),
        cached: vec![ChunkHash([0xab; 32])],
    })
}

fn standby_hello() -> Opening {
    Opening::Standby(StandbyHello { wall: ChunkHash([0xab; 32]), scene: ChunkHash([0xcd; 32]) })
}

fn rival_hello() -> Opening {
    let show = StandbyHello { wall: ChunkHash([0xab; 32]), scene: ChunkHash([0xcd; 32]) };
    Opening::Rival(RivalHello { show, live_nodes: 3, port: 7467 })
}

fn course() -> ToStandby {
    ToStandby::Course(Box::new(Course {
        number: 9,
        epoch: 2,
        scene_time_s: 0.5,
        world_from_room: DAffine3::from_translation(DVec3::new(1.0, 2.0, 4.0)),
        base: Some(8),
        steering: Steering { path_frame: 7, held_after: Some(2), is_off_path: true },
        eyes: vec![DVec3::new(0.0, 0.0, 2.0)],
        budgets: vec![Budget { triangles: None, gpu_us: Some(500) }],
        presence: vec![(ObjectId(4), Presence::Away), (ObjectId(2), Presence::There)],
        moved: vec![Moved { object: ObjectId(6), transform: Transform::from(DAffine3::IDENTITY) }],
    }))
}

fn insertions() -> ToStandby {
    let insertion = |under| Insertion {
        package: "a".into(),
        hash: ChunkHash([0xab; 32]),
        under,
        world_from_root: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 4.0],
    };
    ToStandby::Insertions(Insertions { entered: 1, list: vec![insertion(None), insertion(Some(ObjectId(6)))] })
}

fn welcome() -> ToTile {
    ToTile::Welcome(Welcome {
        version: PROTOCOL_VERSION,
        session: 0x0102,
        node: "n".into(),
        views: vec![ViewSpec {
            view: ViewId(3),
            tile: TileId(2),
            tile_name: "t".into(),
            observer: ObserverId(1),
            eye: Eye::Left,
            corners: [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.5, 0.0]],
            size_px: [640, 480],
            near_m: 0.25,
        }],
        rate_hz: 60.0,
        next_frame: 5,
        count_every: 4,
    })
}

fn manifest() -> ToTile {
    let section = SectionRef { kind: SectionKind::Leaves, hash: ChunkHash([0xcd; 32]), length: 40 };
    let tessellation = SectionRef { kind: SectionKind::Tessellation, hash: ChunkHash([0xef; 32]), length: 56 };
    let hierarchies = BlobRef { hash: ChunkHash([0x12; 32]), length: 258 };
    let (tessellation, hierarchies) = (Some(tessellation), Some(hierarchies));
    ToTile::Manifest(Manifest { epoch: 1, sections: vec![section], tessellation, hierarchies })
}

fn set(ranges: &[(u32, u32)]) -> VisibleSet {
    VisibleSet::from_ranges(ranges.iter().map(|&(start, end)| LeafRange::new(start, end)))
}

fn frame() -> Frame {
    Frame {
        number: 9,
        epoch: 1,
        scene_time_s: 0.5,
        world_from_room: DAffine3::from_translation(DVec3::new(1.0, 2.0, 4.0)),
        shared_eye: DVec3::new(0.0, 1.0, 0.0),
        base: Some(8),
        views: vec![FrameView {
            eye: DVec3::new(0.0, 0.0, 2.0),
            budget: Budget { triangles: Some(1000), gpu_us: None },
            leaves: VisibleDelta { removed: set(&[(0, 1)]), added: set(&[(5, 8), (300, 500)]) },
            digest: 0x0102,
        }],
        dropped: VisibleDelta { removed: set(&[(2, 4)]), added: set(&[(6, 7)]) },
        dropped_digest: 0x0304,
        primary: Some(Box::new(Primary {
            pixels_per_radian: 2.5,
            planes: vec![Plane { normal: DVec3::new(0.0, 1.0, 0.0), offset_m: 4.0 }],
        })),
        estimate: Some(Estimate { triangles: 258, is_complete: true }),
        detail: Some(Detail { triangles: Some(5), least_pixels: 1.5, hides: true, weight: DetailWeight::Nohc }),
        away: set(&[(3, 5), (200, 201)]),
        moved: vec![Moved { object: ObjectId(6), transform: Transform::from(DAffine3::IDENTITY) }],
    }
}

fn ready() -> ToMaster {
    ToMaster::Ready { frame: 258, draw_us: 3, is_cut: true, shown: Some(Shown { frame: 257, at_us: 7 }) }
}

fn counted() -> ToMaster {
    let count = |object, visible_px| ObjectCount { object: ObjectId(object), visible_px, distance_m: 2.5 };
    ToMaster::Counted(Counted { frame: 258, view: ViewId(3), objects: vec![count(6, 500), count(9, 0)] })
}

fn bytes(encode: impl FnOnce(&mut Vec<u8>) -> Result<(), WireError>) -> Vec<u8> {
    let mut out = Vec::new();
    encode(&mut out).expect("a sample within its caps");
    assert_eq!(out.len() - LENGTH_BYTES, u32::from_le_bytes(out[..4].try_into().unwrap()) as usize);
    out
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn f64s(values: &[f64]) -> String {
    values.iter().map(|v| hex(&v.to_le_bytes())).collect()
}

/// All messages, by name, whole.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let hash = ChunkHash([0xab; 32]);
    let bye = Bye::new(ByeCode::UnknownNode, "no");
    let stats = Stats { frame: 1, draw_us: 2, leaves: 3, triangles: 4, resident_bytes: 5 };
    vec![
        ("hello", bytes(|out| hello().encode(out))),
        ("chunk hello", bytes(|out| Opening::Chunks(ChunkHello { session: 0x0102 }).encode(out))),
        ("ready", bytes(|out| ready().encode(out))),
        ("stats", bytes(|out| ToMaster::Stats(stats).encode(out))),
        ("bye to master", bytes(|out| ToMaster::Bye(bye.clone()).encode(out))),
        ("welcome", bytes(|out| welcome().encode(out))),
        ("manifest", bytes(|out| manifest().encode(out))),
        ("frame", bytes(|out| frame().encode(out))),
        ("swap", bytes(|out| ToTile::Swap { frame: 258 }.encode(out))),
        ("alive", bytes(|out| ToTile::Alive.encode(out))),
        ("bye to tile", bytes(|out| ToTile::Bye(bye.clone()).encode(out))),
        ("want", bytes(|out| Want { hashes: vec![hash] }.encode(out))),
        ("piece", bytes(|out| ChunkReply::Piece(Piece { hash, offset: 2, total: 5, bytes: b"cde" }).encode(out))),
        ("absent", bytes(|out| ChunkReply::Absent { hash }.encode(out))),
        ("bye on chunks", bytes(|out| ChunkReply::Bye(bye.clone()).encode(out))),
        ("ping", bytes(|out| ToMaster::Ping(Ping { at_us: 258 }).encode(out))),
        ("pong", bytes(|out| ToTile::Pong(Pong { at_us: 258, master_us: 3 }).encode(out))),
        ("standby hello", bytes(|out| standby_hello().encode(out))),
        ("course", bytes(|out| course().encode(out))),
        ("rival hello", bytes(|out| rival_hello().encode(out))),
        ("prepared", bytes(|out| ToMaster::Prepared { epoch: 258 }.encode(out))),
        ("insertions", bytes(|out| insertions().encode(out))),
        ("unprepared", bytes(|out| ToMaster::unprepared(258, "no".into()).encode(out))),
        ("counted", bytes(|out| counted().encode(out))),
    ]
}

#[test]
fn golden_bytes() {
    let ab = "ab".repeat(32);
    let golden = [
        (
            "hello",
            format!("01 4d554c4c0a000000 0400000000000000 74317830 01000000 01 0200000000000000 0708 0100000000000000 {ab}"),
        ),
        ("chunk hello", "02 4d554c4c0a000000 0201000000000000".into()),
        ("ready", "03 0201000000000000 03000000 01 01 0101000000000000 0700000000000000".into()),
        ("stats", "04 0100000000000000 02000000 03000000 0400000000000000 0500000000000000".into()),
        ("bye to master", "05 03000000 0200000000000000 6e6f".into()),
        (
            "welcome",
            format!(
                "06 0a000000 0201000000000000 01000000000000006e 0100000000000000 0300 0200 010000000000000074 0100 \
                 01000000 {} 80020000 e0010000 {} {} 0500000000000000 04000000",
                f64s(&[1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.5, 0.0]),
                f64s(&[0.25]),
                f64s(&[60.0]),
            ),
        ),
        (
            "manifest",
            format!(
                "07 01000000 0100000000000000 03000000 {} 2800000000000000 01 08000000 {} 3800000000000000 01 {} 02010000",
                "cd".repeat(32),
                "ef".repeat(32),
                "12".repeat(32)
            ),
        ),
        (
            "frame",
            format!(
                "08 0900000000000000 01000000 {} {} {} 010800000000000000 0403000000000000 01 00002040 01000000 01 02010000 01 \
                 01 01 05000000 0000c03f 01 01 01000000 01000000 {} {} 01e8030000 00 \
                 0201000000000000 01 00 00  02 05 02 a302 c701  01 02 01  01 06 00  02 03 01 c201 00  06000000 {}",
                f64s(&[0.5]),
                f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 4.0]),
                f64s(&[0.0, 1.0, 0.0]),
                f64s(&[0.0, 1.0, 0.0, 4.0]),
                f64s(&[0.0, 0.0, 2.0]),
                f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
            ),
        ),
        ("swap", "09 0201000000000000".into()),
        ("alive", "0a".into()),
        ("bye to tile", "05 03000000 0200000000000000 6e6f".into()),
        ("want", format!("0b 0100000000000000 {ab}")),
        ("piece", format!("0c {ab} 0200000000000000 0500000000000000 636465")),
        ("absent", format!("0d {ab}")),
        ("bye on chunks", "05 03000000 0200000000000000 6e6f".into()),
        ("ping", "0e 0201000000000000".into()),
        ("pong", "0f 0201000000000000 0300000000000000".into()),
        ("standby hello", format!("10 4d554c4c0a000000 {ab} {}", "cd".repeat(32))),
        (
            "course",
            format!(
                "11 0900000000000000 02000000 {} {} 010800000000000000 0700000000000000 0102000000 01 01000000 01000000 02000000 01000000 \
                 {} 00 01f4010000 0400000001 0200000000 06000000 {}",
                f64s(&[0.5]),
                f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 4.0]),
                f64s(&[0.0, 0.0, 2.0]),
                f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
            ),
        ),
        ("rival hello", format!("12 4d554c4c0a000000 {ab} {} 03000000 2b1d", "cd".repeat(32))),
        ("prepared", "13 02010000".into()),
        (
            "insertions",
            format!(
                "14 01000000 0200000000000000 010000000000000061 {ab} 00 {place} 010000000000000061 {ab} 01 06000000 {place}",
                place = f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 4.0]),
            ),
        ),
        ("unprepared", "15 02010000 0200000000000000 6e6f".into()),
        ("counted", "16 0201000000000000 0300 06000000 f4010000 00002040 09000000 00000000 00002040".into()),
    ];
    for ((name, bytes), (golden_name, golden)) in samples().iter().zip(golden) {
        assert_eq!(*name, golden_name);
        assert_eq!(hex(body_of(bytes)), golden.replace(char::is_whitespace, ""), "{name}");
    }
}

#[test]
fn messages_go_round() {
    for opening in [hello(), standby_hello(), rival_hello()] {
        assert_eq!(Opening::decode(body_of(&bytes(|out| opening.encode(out)))), Ok(opening));
    }
    for message in [course(), insertions(), ToStandby::Alive] {
        assert_eq!(ToStandby::decode(body_of(&bytes(|out| message.encode(out)))), Ok(message));
    }
    for message in [welcome(), manifest(), ToTile::Frame(frame()), ToTile::Swap { frame: 3 }, ToTile::Alive] {
        assert_eq!(ToTile::decode(body_of(&bytes(|out| message.encode(out)))), Ok(message));
    }
    for message in [counted(), ready()] {
        assert_eq!(ToMaster::decode(body_of(&bytes(|out| message.encode(out)))), Ok(message));
    }
    let piece = ChunkReply::Piece(Piece { hash: ChunkHash([1; 32]), offset: 0, total: 3, bytes: b"abc" });
    assert_eq!(ChunkReply::decode(body_of(&bytes(|out| piece.encode(out)))), Ok(piece));
}

#[test]
fn weights_go_round_by_byte_and_by_name() {
    for (byte, weight) in (0..).zip(DetailWeight::ALL) {
        assert_eq!((u8::from(weight), DetailWeight::try_from(byte)), (byte, Ok(weight)));
        assert_eq!(weight.to_string().parse(), Ok(weight));
        let mut frame = frame();
        frame.detail.as_mut().expect("it has one").weight = weight;
        assert_eq!(ToTile::decode(body_of(&bytes(|out| frame.encode(out)))), Ok(ToTile::Frame(frame)));
    }
    assert!(DetailWeight::try_from(3).is_err());
    let error = "plenty".parse::<DetailWeight>().unwrap_err().to_string();
    assert!(DetailWeight::ALL.iter().all(|weight| error.contains(weight.name())), "{error}");
}

#[test]
fn a_manifest_has_whole_parts() {
    let of = |kinds: &[SectionKind]| {
        let section = |(i, kind): (usize, &SectionKind)| SectionRef { kind: *kind, hash: ChunkHash([i as u8; 32]), length: 1 };
        let sections = kinds.iter().enumerate().map(section).collect();
        Manifest { epoch: 1, sections, tessellation: None, hierarchies: None }.parts()
    };
    let [a, b, c, d] = SectionKind::FOR_TILES;
    let parts = of(&[a, b, c, d, d, c, b, a]).unwrap();
    assert_eq!(parts.iter().map(|part| part.map(|s| s.hash.0[0])).collect::<Vec<_>>(), [[0, 1, 2, 3], [7, 6, 5, 4]]);
    assert_eq!(of(&[]), Err("the manifest lacks section Transforms".to_owned()));
    assert_eq!(of(&[a, b, c, d, a, b, d]), Err("the manifest lacks section Materials".to_owned()));
}

#[test]
fn goodbye_codes_keep_their_numbers() {
    for number in 1..40 {
        assert_eq!(ByeCode::from_number(number).number(), number);
    }
    assert_eq!(ByeCode::EndOfShow.number(), 1);
    assert_eq!(ByeCode::VersionMismatch.number(), 2);
    assert_eq!(ByeCode::Failed.number(), 12);
    assert_eq!(ByeCode::OtherMaster.number(), 13);
}

#[test]
fn greetings_of_strangers_are_told_apart() {
    let mut other = Vec::new();
    hello().encode_as_version(PROTOCOL_VERSION + 1, &mut other).unwrap();
    assert_eq!(Opening::decode(body_of(&other)), Err(WireError::Version { theirs: PROTOCOL_VERSION + 1 }));
    // Another version may have another layout behind the version.
    assert_eq!(Opening::decode(b"\x01MULL\xff\0\0\0!"), Err(WireError::Version { theirs: 255 }));
    assert_eq!(Opening::decode(b"\x01GET / HTTP/1.1"), Err(WireError::Magic));
    assert_eq!(Opening::decode(b"GET / HTTP/1.1"), Err(WireError::Tag { tag: b'G' }));
    assert_eq!(Opening::decode(b""), Err(WireError::Empty));
}

#[test]
fn caps_hold_both_ways() {
    let mut out = Vec::new();
    let too_long =
        Opening::Control(Hello { node: "x".repeat(MAX_NAME_BYTES + 1), part: Part::Own, credentials: None, cached: vec![] });
    assert!(matches!(too_long.encode(&mut out), Err(WireError::Limit { .. })));
    let full = Opening::Control(Hello {
        node: "x".repeat(MAX_NAME_BYTES),
        part: Part::Spare,
        credentials: Some(vec![0; MAX_CREDENTIALS_BYTES]),
        cached: vec![ChunkHash([0; 32]); MAX_CACHED],
    });
    assert_eq!(Opening::decode(body_of(&bytes(|out| full.encode(out)))), Ok(full));
    let wanted = Want { hashes: vec![ChunkHash([0; 32]); MAX_WANTED + 1] };
    assert!(matches!(wanted.encode(&mut out), Err(WireError::Limit { .. })));
    assert!(matches!(ToMaster::decode(&[tag(4); MAX_TO_MASTER_BYTES + 1]), Err(WireError::Limit { .. })));
    assert_eq!(Bye::new(ByeCode::Failed, "é".repeat(MAX_REASON_BYTES)).reason.len(), MAX_REASON_BYTES);
    let across_the_cap = format!("a{}", "é".repeat(MAX_REASON_BYTES));
    assert_eq!(Bye::new(ByeCode::Failed, across_the_cap).reason.len(), MAX_REASON_BYTES - 1, "no character is cut in two");

    let counted = |objects: Vec<ObjectCount>| ToMaster::Counted(Counted { frame: 1, view: ViewId(0), objects });
    let count = |object| ObjectCount { object: ObjectId(object), visible_px: 1, distance_m: 1.0 };
    let full = counted((0..MAX_COUNTED as u32).map(count).collect());
    assert_eq!(ToMaster::decode(body_of(&bytes(|out| full.encode(out)))), Ok(full));
    assert!(matches!(counted(vec![count(0); MAX_COUNTED + 1]).encode(&mut out), Err(WireError::Limit { .. })));
    let ranges = |count: usize| (0..count as u32).map(|i| LeafRange::new(2 * i, 2 * i + 1));
    let dropped = |count| VisibleDelta { removed: VisibleSet::default(), added: VisibleSet::from_ranges(ranges(count)) };
    assert!(Frame { dropped: dropped(MAX_DROPPED_RANGES), ..frame() }.encode(&mut out).is_ok());
    let too_many = Frame { dropped: dropped(MAX_DROPPED_RANGES + 1), ..frame() }.encode(&mut out);
    assert!(matches!(too_many, Err(WireError::Limit { .. })));
    let away = |count| Frame { away: VisibleSet::from_ranges(ranges(count)), ..frame() };
    let full = ToTile::Frame(away(MAX_AWAY_RANGES));
    assert_eq!(ToTile::decode(body_of(&bytes(|out| full.encode(out)))), Ok(full));
    assert!(matches!(away(MAX_AWAY_RANGES + 1).encode(&mut out), Err(WireError::Limit { .. })));
    assert!(matches!(ToTile::decode(&with_one_more_away()), Err(WireError::Limit { .. })));

    let planes = |count| {
        let planes = vec![Plane { normal: DVec3::X, offset_m: 1.0 }; count];
        Frame { primary: Some(Box::new(Primary { pixels_per_radian: 1.0, planes })), ..frame() }
    };
    let full = ToTile::Frame(planes(MAX_PRIMARY_PLANES));
    assert_eq!(ToTile::decode(body_of(&bytes(|out| full.encode(out)))), Ok(full));
    assert!(matches!(planes(MAX_PRIMARY_PLANES + 1).encode(&mut out), Err(WireError::Limit { .. })));

    let claims = |list: u64| [&[tag(11)][..], &list.to_le_bytes()].concat();
    assert!(Want::decode(&claims(u64::MAX)).is_err());
    assert!(Want::decode(&claims(MAX_WANTED as u64)).is_err());
}

/// The body of a frame in which one range more is away than may be.
fn with_one_more_away() -> Vec<u8> {
    let ranges = |count: u32| VisibleSet::from_ranges((0..count).map(|i| LeafRange::new(2 * i, 2 * i + 1)));
    let body = |away: VisibleSet| body_of(&bytes(|out| Frame { away, moved: vec![], ..frame() }.encode(out))).to_vec();
    let most = MAX_AWAY_RANGES as u32;
    // A count of three bytes, and two for each range: the last bytes of a frame in which nothing moved.
    let mut more = body(ranges(most));
    let count = more.len() - 2 * MAX_AWAY_RANGES - 3;
    assert_eq!(more[count..count + 3], [0x80, 0x80, 0x04]);
    more[count] |= 1;
    more.extend([0, 0]);
    more
}

fn tag(tag: u8) -> u8 {
    tag
}

#[test]
fn what_is_not_finite_or_backwards_is_refused() {
    let refused = |change: fn(&mut Frame)| {
        let mut bad = frame();
        change(&mut bad);
        ToTile::decode(body_of(&bytes(|out| bad.encode(out)))).is_err()
    };
    assert!(!refused(|_| {}));
    assert!(refused(|f| f.scene_time_s = f64::NAN));
    assert!(refused(|f| f.world_from_room.translation.x = f64::INFINITY));
    assert!(refused(|f| f.views[0].eye.y = f64::NAN));
    assert!(refused(|f| f.shared_eye.y = f64::NAN));
    assert!(refused(|f| f.base = Some(9)));
    fn primary(frame: &mut Frame, change: fn(&mut Primary)) {
        frame.primary.as_deref_mut().into_iter().for_each(change);
    }
    assert!(!refused(|f| (f.estimate, f.detail) = (None, None)));
    assert!(!refused(|f| (f.primary, f.estimate, f.detail) = (None, None, None)));
    assert!(!refused(|f| primary(f, |p| p.planes.clear())));
    assert!(refused(|f| primary(f, |p| p.planes[0].normal.z = f64::NAN)));
    assert!(refused(|f| primary(f, |p| p.planes[0].offset_m = f64::INFINITY)));
    assert!(refused(|f| primary(f, |p| p.pixels_per_radian = 0.0)));
    assert!(refused(|f| primary(f, |p| p.pixels_per_radian = -1.0)));
    assert!(refused(|f| primary(f, |p| p.pixels_per_radian = f32::INFINITY)));
    let refused = |change: fn(&mut Vec<ObjectCount>)| {
        let ToMaster::Counted(mut bad) = counted() else { unreachable!("it is counts") };
        change(&mut bad.objects);
        ToMaster::decode(body_of(&bytes(|out| bad.encode(out)))).is_err()
    };
    assert!(!refused(|_| {}));
    assert!(refused(|counts| counts.swap(0, 1)));
    assert!(refused(|counts| counts[1].object = ObjectId(6)));
    assert!(refused(|counts| counts[1].distance_m = f32::NAN));
}

/// As what would be sent is refused before that, by its bytes.
#[test]
fn orders_out_of_their_range_are_refused_on_both_sides() {
    let good = bytes(|out| frame().encode(out));
    // The pixels of the detail, and whether there is a primary frustum.
    let (pixels, has_primary) = (1.5f32.to_le_bytes(), [&[1], &2.5f32.to_le_bytes()[..]].concat());
    let find = |part: &[u8]| good.windows(part.len()).position(|window| window == part).expect("it is there");
    let spoiled = |at: usize, with: &[u8]| {
        let mut body = body_of(&good).to_vec();
        body[at - LENGTH_BYTES..][..with.len()].copy_from_slice(with);
        ToTile::decode(&body).err()
    };
    for bad in [f32::NAN, f32::INFINITY, -0.5] {
        let not_finite = Some(WireError::NotFinite { what: "pixels of the detail" });
        assert_eq!(spoiled(find(&pixels), &bad.to_le_bytes()), not_finite);
        let detail = Detail { least_pixels: bad, ..Detail::default() };
        assert_eq!(Frame { detail: Some(detail), ..frame() }.encode(&mut Vec::new()).err(), not_finite);
    }
    assert!(matches!(spoiled(find(&pixels) + 5, &[3]), Some(WireError::Codec(_))), "no weight");
    assert_eq!(spoiled(find(&pixels), &0f32.to_le_bytes()), None, "all that can be seen of it");
    let nowhere = Some(WireError::Bulk { what: "primary frustum" });
    for orders in [Frame { estimate: None, ..frame() }, Frame { detail: None, ..frame() }] {
        assert_eq!(Frame { primary: None, ..orders }.encode(&mut Vec::new()).err(), nowhere);
    }
    let at = find(&has_primary) - LENGTH_BYTES;
    let without = [&body_of(&good)[..at], &[0], &body_of(&good)[at + 1 + 4 + 4..]].concat();
    assert_eq!(ToTile::decode(&without).err(), nowhere);
}

fn decode_all(body: &[u8]) {
    let _ = Opening::decode(body);
    let _ = ToMaster::decode(body);
    let _ = Want::decode(body);
    let _ = ChunkReply::decode(body);
    let _ = ToStandby::decode(body);
    if let Ok(ToTile::Frame(frame)) = ToTile::decode(body) {
        let beside = [&frame.dropped.removed, &frame.dropped.added, &frame.away];
        for set in frame.views.iter().flat_map(|v| [&v.leaves.removed, &v.leaves.added]).chain(beside) {
            assert!(set.ranges().iter().all(|r| r.start < r.end) && set.ranges().windows(2).all(|w| w[0].end < w[1].start));
        }
    }
}

fn any_set() -> impl Strategy<Value = VisibleSet> {
    let edge = prop_oneof![0..200u32, any::<u32>()];
    proptest::collection::vec((edge, 1..300u32), 0..20)
        .prop_map(|v| VisibleSet::from_ranges(v.into_iter().map(|(s, len)| LeafRange::new(s, s.saturating_add(len)))))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn no_bytes_make_a_decoder_panic(tag in 0..23u8, rest in proptest::collection::vec(any::<u8>(), 0..300)) {
        decode_all(&[&[tag][..], &rest].concat());
        decode_all(&[&[tag][..], &MAGIC, &PROTOCOL_VERSION.to_le_bytes(), &rest].concat());
    }

    #[test]
    fn mutated_messages_do_not_panic(
        which in 0..samples().len(), edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        keep in any::<prop::sample::Index>(), cut in any::<bool>(),
    ) {
        let mut body = body_of(&samples()[which].1).to_vec();
        for (at, value) in edits {
            let at = at.index(body.len());
            body[at] = value;
        }
        if cut {
            body.truncate(keep.index(body.len() + 1));
        }
        decode_all(&body);
    }

    #[test]
    fn sets_go_round(removed in any_set(), added in any_set(), dropped in any_set(), away in any_set()) {
        let mut frame = frame();
        frame.views[0].leaves = VisibleDelta { removed, added };
        (frame.dropped.added, frame.away) = (dropped, away);
        let decoded = ToTile::decode(body_of(&bytes(|out| frame.encode(out))));
        prop_assert_eq!(decoded, Ok(ToTile::Frame(frame)));
    }
}
