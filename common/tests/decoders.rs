//! Goal: no bytes from outside make a decoder panic, or take more memory than its caps allow.
//! Method: the messages in `tests/seeds`, bent and cut at random, and plain random bytes, into every decoder, with allocations counted. For
//! longer: `BOLERO_RANDOM_ITERATIONS=10000000 BOLERO_RANDOM_SEED=2 cargo test --release -p mullion-common --test decoders`; a fuzzer goes on
//! from there: `cargo bolero test -p mullion-common --test decoders messages`.

mod spoiled;

use std::fs;
use std::hint::black_box;
use std::path::Path;

use bolero::check;
use mullion_common::camera_path::CameraPath;
use mullion_common::scene::{GeometryChunk, HierarchyIndex, Package, SceneManifest};
use mullion_common::wall::WallConfig;
use mullion_common::wire::{
    ChunkReply, MAX_CHUNK_REPLY_BYTES, MAX_CHUNK_REQUEST_BYTES, MAX_OPENING_BYTES, MAX_TO_MASTER_BYTES, MAX_TO_TILE_BYTES,
    Opening, ToMaster, ToStandby, ToTile, Want,
};
use spoiled::Spoiled;

/// The bodies of all messages, each in a file.
fn seeds() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/seeds");
    let mut files: Vec<_> = fs::read_dir(folder).expect("seeds").map(|entry| entry.expect("a file").path()).collect();
    files.sort();
    let seeds: Vec<Vec<u8>> = files.iter().map(|file| fs::read(file).expect("a seed")).collect();
    assert!(seeds.len() >= 20, "a seed for every message");
    seeds
}

/// Whether a decoder keeps to twice its cap, and to what goes with the body's length.
fn assert_modest(decoder: &str, cap: usize, body: &[u8], decode: impl FnOnce()) {
    // What texts of the master's claim is taken on trust as far as a mebibyte, the cap of all its messages but frames.
    const CLAIMED: u64 = 2 << 20;
    let taken = allocation_counter::measure(decode).bytes_max;
    let most = (2 * cap as u64).min(64 * body.len() as u64 + CLAIMED);
    assert!(taken <= most, "{decoder} took {taken} bytes for {} of body", body.len());
}

fn decode_all(body: &[u8]) {
    assert_modest("opening", MAX_OPENING_BYTES, body, || drop(black_box(Opening::decode(body))));
    assert_modest("to master", MAX_TO_MASTER_BYTES, body, || drop(black_box(ToMaster::decode(body))));
    assert_modest("to tile", MAX_TO_TILE_BYTES, body, || drop(black_box(ToTile::decode(body))));
    assert_modest("to standby", MAX_TO_TILE_BYTES, body, || drop(black_box(ToStandby::decode(body))));
    assert_modest("want", MAX_CHUNK_REQUEST_BYTES, body, || drop(black_box(Want::decode(body))));
    assert_modest("chunk reply", MAX_CHUNK_REPLY_BYTES, body, || drop(black_box(ChunkReply::decode(body))));
}

#[test]
fn messages() {
    let seeds = seeds();
    seeds.iter().for_each(|seed| decode_all(seed));
    check!().with_generator(Spoiled::any()).for_each(|spoiled: &Spoiled| decode_all(&spoiled.of(&seeds)));
}

#[test]
fn any_bytes() {
    check!().for_each(|bytes: &[u8]| {
        decode_all(bytes);
        let _ = black_box(Package::read(bytes));
        let quarter = bytes.len() / 4;
        let sections = [0, 1, 2, 3].map(|k| &bytes[k * quarter..(k + 1) * quarter]);
        let _ = black_box(SceneManifest::from_sections(sections));
        let _ = black_box(GeometryChunk::decode(bytes));
        assert_modest("hierarchy index", usize::MAX / 2, bytes, || drop(black_box(HierarchyIndex::decode(bytes, 1000))));
        if let Ok(text) = str::from_utf8(bytes) {
            let _ = black_box(WallConfig::parse(text));
            let _ = black_box(CameraPath::parse(text));
        }
    });
}
