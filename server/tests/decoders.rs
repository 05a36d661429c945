//! Goal: no file that claims to be a record, and no list of moves from outside, makes the master's decoders panic or take more memory than
//! what is there calls for. Method and longer runs as in the common crate's `tests/decoders.rs`.

#[path = "../../tests/support/memory_file.rs"]
mod memory_file;
#[path = "../../common/tests/spoiled/mod.rs"]
mod spoiled;

use std::hint::black_box;

use bolero::check;
use glam::{DAffine3, DVec3};
use memory_file::MemoryFile;
use mullion_common::control::{decode_moves, encode_moves};
use mullion_common::scene::ObjectId;
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wire::{Budget, Moved};
use mullion_server::record::{Header, Reader, Recorder};
use mullion_server::service::Pose;
use mullion_server::tree::Presence;
use spoiled::Spoiled;

fn moved(object: u32) -> Moved {
    Moved { object: ObjectId(object), transform: DAffine3::from_translation(DVec3::splat(f64::from(object))).into() }
}

/// A whole record of three frames, with something in every list.
fn record() -> Vec<u8> {
    let header = Header { scene: [1; 32], wall: [2; 32], algorithm: "sweep".into(), rate_hz: 60.0, path: "orbit".into() };
    let file = MemoryFile::default();
    let mut recorder = Recorder::start(file.clone(), &header).unwrap();
    let pose = Pose {
        eyes: vec![DVec3::Z, DVec3::X],
        moved: vec![moved(1), moved(2)],
        presence: vec![(ObjectId(3), Presence::Away)],
        budgets: vec![Budget::default()],
        ..Pose::default()
    };
    (0..3).for_each(|_| recorder.note(&pose, &[VisibleSet::from_ranges([LeafRange::new(1, 4)])]));
    drop(recorder);
    file.bytes()
}

/// Reads all of it; gives how many frames it had.
fn read(bytes: &[u8]) -> usize {
    let Ok(mut reader) = Reader::open(bytes) else { return 0 };
    std::iter::from_fn(|| reader.next_frame().ok().flatten()).map(black_box).count()
}

/// Whether decoding takes memory only for what is there.
fn assert_modest(bytes: &[u8], decode: impl FnOnce()) {
    const STILL_SMALL: u64 = 64 << 10;
    let taken = allocation_counter::measure(decode).bytes_max;
    assert!(taken <= 64 * bytes.len() as u64 + STILL_SMALL, "{taken} bytes for {}", bytes.len());
}

#[test]
fn records() {
    let seeds = [record()];
    assert_eq!(read(&seeds[0]), 3, "the seed is a record");
    check!().with_generator(Spoiled::any()).for_each(|spoiled: &Spoiled| {
        let bytes = spoiled.of(&seeds);
        assert_modest(&bytes, || _ = black_box(read(&bytes)));
    });
}

#[test]
fn moves() {
    let mut good = Vec::new();
    encode_moves(&[moved(1), moved(2), moved(3)], &mut good);
    let seeds = [good];
    assert_eq!(decode_moves(&seeds[0]).unwrap().count(), 3);
    check!().with_generator(Spoiled::any()).for_each(|spoiled: &Spoiled| {
        let bytes = spoiled.of(&seeds);
        assert_modest(&bytes, || drop(black_box(decode_moves(&bytes).map(Iterator::count))));
    });
}

#[test]
fn any_bytes() {
    check!().for_each(|bytes: &[u8]| {
        black_box(read(bytes));
        let _ = black_box(decode_moves(bytes).map(Iterator::count));
    });
}
