//! Goal: every cap of the protocol has its number, holds on both sides of it, and what breaks one is answered with the right goodbye.
//! Method: the numbers of `docs/protocol.md` beside the constants; messages that just fit, and those that just do not.

use glam::{DAffine3, DVec3};
use mullion_common::scene::{BlobRef, ChunkHash, ObjectId, SectionKind, Transform};
use mullion_common::visible_set::{LeafRange, VisibleDelta, VisibleSet};
use mullion_common::wall::{Eye, ObserverId, TileId, ViewId};
use mullion_common::wire::codec::{self, CodecError};
use mullion_common::wire::*;
use serde::{Deserialize, Serialize};

const HASH: ChunkHash = ChunkHash([7; 32]);

fn bytes(encode: impl FnOnce(&mut Vec<u8>) -> Result<(), WireError>) -> Vec<u8> {
    let mut out = Vec::new();
    encode(&mut out).unwrap();
    out.split_off(LENGTH_BYTES)
}

fn tile(message: &ToTile) -> Result<ToTile, WireError> {
    ToTile::decode(&bytes(|out| message.encode(out)))
}

/// What becomes of a message that its own `encode` refuses, and one of the same kind that it writes.
fn unchecked(like: &ToTile, value: &impl Serialize) -> Result<ToTile, WireError> {
    let tag = bytes(|out| like.encode(out))[0];
    ToTile::decode(&[&[tag][..], &codec::encode(value).unwrap()].concat())
}

fn standby(message: &ToStandby) -> Result<ToStandby, WireError> {
    ToStandby::decode(&bytes(|out| message.encode(out)))
}

#[test]
fn caps_are_those_that_are_written_down() {
    assert_eq!((MAX_OPENING_BYTES, MAX_TO_MASTER_BYTES, MAX_TO_TILE_BYTES), (1024, 4096, 67_108_864));
    assert_eq!((MAX_CHUNK_REQUEST_BYTES, MAX_PIECE_BYTES, MAX_CHUNK_REPLY_BYTES), (16_384, 262_144, 262_208));
    assert_eq!((MAX_NAME_BYTES, MAX_CREDENTIALS_BYTES, MAX_CACHED, MAX_REASON_BYTES), (64, 512, 8, 512));
    assert_eq!((MAX_VIEWS, MAX_WALL_VIEWS, MAX_PARTS, MAX_SECTIONS, MAX_WANTED), (2048, 65_536, 1024, 4096, 256));
    assert_eq!((MAX_TILE_SECTION_BYTES, MAX_PRIMARY_PLANES, BASE_WINDOW), (1_073_741_824, 8, 8));
    assert_eq!((OPENING_LIMIT.as_secs(), SILENCE_LIMIT.as_secs(), ALIVE_EVERY.as_secs()), (5, 10, 1));
}

#[test]
fn a_value_takes_no_more_than_its_cap_and_all_of_its_bytes() {
    let value = (1u32, vec![2u8; 10]); // 4 + 8 + 10 bytes
    let written = codec::encode(&value).unwrap();
    let mut appended = vec![9];
    codec::encode_into(&value, &mut appended).unwrap();
    assert_eq!((written.len(), &appended[1..]), (22, &written[..]));
    assert_eq!(codec::decode::<(u32, Vec<u8>), 22>(&written), Ok(value.clone()));
    assert_eq!(codec::decode::<(u32, Vec<u8>), 21>(&written), Err(CodecError::TooLarge { len: 22, cap: 21 }));
    let longer = [&written[..], &[0]].concat();
    assert_eq!(codec::decode::<(u32, Vec<u8>), 23>(&longer), Err(CodecError::Trailing { left: 1 }));
    assert_eq!(codec::decode_prefix::<(u32, Vec<u8>), 22>(&longer), Ok((value, 22)));
    // Too short for its cap is malformed, not too large: also where it has exactly as many bytes as its cap.
    let cut = &written[..21];
    assert!(matches!(codec::decode::<(u32, Vec<u8>), 21>(cut), Err(CodecError::Malformed(_))));
    assert!(matches!(codec::decode::<(u32, Vec<u8>), 64>(cut), Err(CodecError::Malformed(_))));
    assert!(matches!(codec::decode::<(u32, Vec<u8>), 20>(cut), Err(CodecError::TooLarge { len: 21, cap: 20 })));
}

#[derive(Debug, PartialEq, Deserialize)]
struct Text(#[serde(deserialize_with = "codec::text")] String);

#[test]
fn a_text_takes_no_memory_for_what_it_claims() {
    let read = |bytes: &[u8]| codec::decode::<Text, { 64 << 20 }>(bytes);
    let claims = |length: u64, bytes: &[u8]| [&length.to_le_bytes()[..], bytes].concat();
    assert_eq!(read(&codec::encode(&"chair").unwrap()), Ok(Text("chair".into())));
    assert_eq!(read(&claims(2, b"ab")), Ok(Text("ab".into())));
    assert!(read(&claims(2, b"\xff\xfe")).is_err(), "no UTF-8");
    let long = claims(32 << 20, b"ab");
    let taken = allocation_counter::measure(|| assert!(read(&long).is_err())).bytes_max;
    assert!(taken < 4096, "{taken} bytes");
}

#[test]
fn a_reason_is_cut_at_its_cap() {
    let ToMaster::Unprepared { epoch: 2, reason } = ToMaster::unprepared(2, "é".repeat(MAX_REASON_BYTES)) else { panic!() };
    assert_eq!(reason, "é".repeat(MAX_REASON_BYTES / 2));
    let message = ToMaster::unprepared(2, "no\nsuch file".into());
    let answer = ToMaster::decode(&bytes(|out| message.encode(out)));
    assert_eq!(answer, Ok(ToMaster::unprepared(2, "no such file".into())), "in one line");
    let long = ToMaster::Unprepared { epoch: 2, reason: "e".repeat(MAX_REASON_BYTES + 1) }.encode(&mut Vec::new());
    assert_eq!(long, Err(WireError::Limit { what: "bytes of a reason", value: 513, cap: 512 }));
}

#[test]
fn a_goodbye_says_whether_to_come_back_and_what_was_wrong() {
    use ByeCode as C;
    let final_ones = [C::EndOfShow, C::VersionMismatch, C::UnknownNode, C::Refused];
    for code in (1..14).map(C::from_number) {
        assert_eq!(code.is_retryable(), !final_ones.contains(&code), "{code:?}");
    }
    let answer = |error: WireError| Bye::for_error(&error).code;
    assert_eq!(answer(WireError::Version { theirs: 9 }), C::VersionMismatch);
    assert_eq!(answer(WireError::Limit { what: "views", value: 2, cap: 1 }), C::TooLarge);
    assert_eq!(answer(WireError::TooLong { cap: 1 }), C::TooLarge);
    assert_eq!(answer(CodecError::TooLarge { len: 2, cap: 1 }.into()), C::TooLarge);
    assert_eq!(answer(CodecError::Trailing { left: 1 }.into()), C::Malformed);
    assert_eq!(answer(WireError::Empty), C::Malformed);
    let bye = Bye::for_error(&WireError::TooLong { cap: 8 });
    assert_eq!(bye.to_string(), "TooLarge: the message is longer than the 8 bytes allowed");
}

#[test]
fn each_greeting_is_read_as_what_it_is() {
    let chunks = Opening::Chunks(ChunkHello { session: 0x0102_0304_0506_0708 });
    assert_eq!(Opening::decode(&bytes(|out| chunks.encode(out))), Ok(chunks));
}

#[test]
fn signs_of_life_carry_nothing() {
    let mut alive = bytes(|out| ToTile::Alive.encode(out));
    assert_eq!(ToStandby::decode(&alive), Ok(ToStandby::Alive));
    alive.push(0);
    assert_eq!(ToTile::decode(&alive), Err(WireError::Tag { tag: alive[0] }));
    assert_eq!(ToStandby::decode(&alive), Err(WireError::Tag { tag: alive[0] }));
}

#[test]
fn a_welcome_keeps_to_its_caps() {
    let view = ViewSpec {
        view: ViewId(0),
        tile: TileId(0),
        tile_name: "t".repeat(2 * MAX_NAME_BYTES),
        observer: ObserverId(0),
        eye: Eye::Left,
        corners: [[0.0; 3]; 3],
        size_px: [1, 1],
        near_m: 0.1,
    };
    let node = "n".repeat(MAX_NAME_BYTES);
    let fits =
        Welcome { version: PROTOCOL_VERSION, session: 1, node, views: vec![view], rate_hz: 60.0, next_frame: 0, count_every: 0 };
    assert_eq!(tile(&ToTile::Welcome(fits.clone())), Ok(ToTile::Welcome(fits.clone())));
    let answer = |change: fn(&mut Welcome)| {
        let mut bad = fits.clone();
        change(&mut bad);
        let answer = unchecked(&ToTile::Welcome(fits.clone()), &bad);
        assert_eq!(ToTile::Welcome(bad).encode(&mut Vec::new()).err().as_ref(), answer.as_ref().err(), "both sides agree");
        answer
    };
    assert_eq!(answer(|w| w.node.push('n')), Err(WireError::Limit { what: "bytes of a node's name", value: 65, cap: 64 }));
    let long_name = answer(|w| w.views[0].tile_name.push('t'));
    assert_eq!(long_name, Err(WireError::Limit { what: "bytes of a tile's name", value: 129, cap: 128 }));
    let views = answer(|w| {
        w.views[0].tile_name.clear();
        w.views = vec![w.views[0].clone(); MAX_VIEWS + 1];
    });
    assert_eq!(views, Err(WireError::Limit { what: "views", value: 2049, cap: 2048 }));
    let not_finite = Err(WireError::NotFinite { what: "a number of the welcome" });
    assert_eq!(answer(|w| w.rate_hz = f64::NAN), not_finite);
    assert_eq!(answer(|w| w.views[0].near_m = f64::INFINITY), not_finite);
    assert_eq!(answer(|w| w.views[0].corners[2][1] = f64::NAN), not_finite);
}

#[test]
fn a_manifest_keeps_to_its_caps() {
    let section = |length| SectionRef { kind: SectionKind::Leaves, hash: HASH, length };
    let tessellation = SectionRef { kind: SectionKind::Tessellation, ..section(MAX_TILE_SECTION_BYTES) };
    let sections = vec![section(MAX_TILE_SECTION_BYTES); MAX_SECTIONS];
    let index = BlobRef { hash: HASH, length: MAX_TILE_SECTION_BYTES as u32 };
    let fits = ToTile::Manifest(Manifest { epoch: 1, sections, tessellation: Some(tessellation), hierarchies: Some(index) });
    assert_eq!(tile(&fits), Ok(fits.clone()));
    let answer_to = |sections, tessellation, hierarchies| {
        let bad = Manifest { epoch: 1, sections, tessellation, hierarchies };
        let answer = unchecked(&fits, &bad);
        assert_eq!(ToTile::Manifest(bad).encode(&mut Vec::new()).err().as_ref(), answer.as_ref().err(), "both sides agree");
        answer
    };
    let answer = |sections| answer_to(sections, None, None);
    let many = answer(vec![section(1); MAX_SECTIONS + 1]);
    assert_eq!(many, Err(WireError::Limit { what: "sections", value: 4097, cap: 4096 }));
    let large = answer(vec![section(1), section(MAX_TILE_SECTION_BYTES + 1)]);
    let too_large = Err(WireError::Limit { what: "bytes of a section", value: 1_073_741_825, cap: 1_073_741_824 });
    assert_eq!(large, too_large);
    let longer = SectionRef { length: MAX_TILE_SECTION_BYTES + 1, ..tessellation };
    assert_eq!(answer_to(vec![], Some(longer), None), too_large);
    assert_eq!(answer_to(vec![], None, Some(BlobRef { length: index.length + 1, ..index })), too_large);
    assert_eq!(answer_to(vec![], Some(section(1)), None), Err(WireError::Bulk { what: "tessellation" }), "it is leaves");
}

#[test]
fn chunks_are_asked_for_and_come_within_their_caps() {
    let want = Want { hashes: vec![HASH; MAX_WANTED] };
    let mut body = bytes(|out| want.encode(out));
    assert_eq!(Want::decode(&body), Ok(want));
    body[0] += 1;
    assert_eq!(Want::decode(&body), Err(WireError::Tag { tag: body[0] }));

    let data = vec![1; MAX_PIECE_BYTES];
    let piece = |offset, total, bytes| ChunkReply::Piece(Piece { hash: HASH, offset, total, bytes });
    let reply = |piece: ChunkReply<'_>| {
        let body = bytes(|out| piece.encode(out));
        ChunkReply::decode(&body).map(|reply| format!("{reply:?}"))
    };
    // A full piece at the end of the largest blob.
    let cap = MAX_TILE_SECTION_BYTES;
    let fits = piece(cap - MAX_PIECE_BYTES as u64, cap, &data);
    assert_eq!(reply(fits.clone()), Ok(format!("{fits:?}")));
    let past_its_end = reply(piece(cap - MAX_PIECE_BYTES as u64 + 1, cap, &data));
    assert_eq!(past_its_end, Err(WireError::Bulk { what: "piece" }));
    assert_eq!(reply(piece(u64::MAX, 4, b"abcd")), Err(WireError::Bulk { what: "piece" }));
    let too_large = reply(piece(0, cap + 1, b"abcd"));
    assert_eq!(too_large, Err(WireError::Limit { what: "bytes of a blob", value: cap + 1, cap }));
    let too_long = piece(0, cap, &[&data[..], &[1]].concat()).encode(&mut Vec::new());
    assert_eq!(too_long, Err(WireError::Limit { what: "bytes of a piece", value: 262_145, cap: 262_144 }));
}

fn frame(added: &[(u32, u32)]) -> Frame {
    let added = VisibleSet::from_ranges(added.iter().map(|&(start, end)| LeafRange::new(start, end)));
    let leaves = VisibleDelta { removed: VisibleSet::default(), added };
    let view = FrameView { eye: DVec3::ZERO, budget: Budget::default(), leaves, digest: 0 };
    Frame { number: 1, views: vec![view], ..Frame::default() }
}

#[test]
fn sets_reach_the_last_leaf_number() {
    let last = frame(&[(0, 1), (5, 6), (u32::MAX - 1, u32::MAX)]);
    assert_eq!(tile(&ToTile::Frame(last.clone())), Ok(ToTile::Frame(last)));
}

#[test]
fn insertions_keep_to_their_caps() {
    let insertion = |name: usize| Insertion {
        package: "p".repeat(name),
        hash: HASH,
        under: Some(ObjectId(1)),
        world_from_root: DAffine3::IDENTITY.to_cols_array(),
    };
    let full = Insertions { entered: MAX_PARTS as u32 - 1, list: vec![insertion(MAX_PACKAGE_NAME_BYTES); MAX_PARTS - 1] };
    assert_eq!(standby(&ToStandby::Insertions(full.clone())), Ok(ToStandby::Insertions(full.clone())));
    let tag = bytes(|out| ToStandby::Insertions(Insertions::default()).encode(out))[0];
    let answer = |change: &dyn Fn(&mut Insertions)| {
        let mut bad = full.clone();
        change(&mut bad);
        let answer = ToStandby::decode(&[&[tag][..], &codec::encode(&bad).unwrap()].concat());
        assert_eq!(ToStandby::Insertions(bad).encode(&mut Vec::new()).err().as_ref(), answer.as_ref().err(), "both sides agree");
        answer
    };
    let many = answer(&|i| i.list = vec![insertion(1); MAX_PARTS]);
    assert_eq!(many, Err(WireError::Limit { what: "insertions", value: 1024, cap: 1023 }));
    let more_than_there_are = answer(&|i| i.list.truncate(5));
    assert_eq!(more_than_there_are, Err(WireError::Limit { what: "insertions that are shown", value: 1023, cap: 5 }));
    let long = answer(&|i| {
        i.list.truncate(900); // so that the list as a whole is not too long
        i.list[7] = insertion(MAX_PACKAGE_NAME_BYTES + 1);
        i.entered = 8;
    });
    assert_eq!(long, Err(WireError::Limit { what: "bytes of a package's name", value: 256, cap: 255 }));
    let nowhere = answer(&|i| i.list[1022].world_from_root[11] = f64::NAN);
    assert_eq!(nowhere, Err(WireError::NotFinite { what: "where a package is inserted" }));
}

#[test]
fn the_course_refuses_each_number_that_is_not_finite() {
    let good = Course {
        number: 2,
        base: Some(1),
        eyes: vec![DVec3::ZERO],
        moved: vec![Moved { object: ObjectId(1), transform: Transform::from(DAffine3::IDENTITY) }],
        ..Course::default()
    };
    let answer = |change: fn(&mut Course)| {
        let mut bad = good.clone();
        change(&mut bad);
        standby(&ToStandby::Course(Box::new(bad)))
    };
    assert_eq!(answer(|_| {}), Ok(ToStandby::Course(Box::new(good.clone()))));
    let not_finite = Err(WireError::NotFinite { what: "a number of the course" });
    assert_eq!(answer(|c| c.scene_time_s = f64::NAN), not_finite);
    assert_eq!(answer(|c| c.world_from_room.translation.y = f64::NAN), not_finite);
    assert_eq!(answer(|c| c.eyes[0].z = f64::INFINITY), not_finite);
    let too_late = |value| Err(WireError::Limit { what: "a frame's number", value, cap: 1 << 48 });
    assert!(answer(|c| c.number = 1 << 48).is_ok());
    assert_eq!(answer(|c| c.number = (1 << 48) + 1), too_late((1 << 48) + 1));
    assert_eq!(answer(|c| c.steering.path_frame = u64::MAX), too_late(u64::MAX));
    assert_eq!(answer(|c| c.base = Some(2)), Err(WireError::Bulk { what: "base" }));
    assert_eq!(answer(|c| c.base = Some(3)), Err(WireError::Bulk { what: "base" }));
}
