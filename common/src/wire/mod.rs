//! What master and tiles say to each other. No sockets here: bytes in, messages out.
//!
//! # Connections
//! A node opens two TCP connections to the master's port: the *control* connection, and, once it is welcome, the *chunk*
//! connection, so that nothing large ever stands before a frame. The first message says which of the two it is.
//!
//! # Framing
//! Every message is a little-endian `u32` length and that many bytes of body. The length never passes the cap of the
//! connection's state: [`MAX_OPENING_BYTES`] until the first message is accepted, then [`MAX_TO_MASTER_BYTES`],
//! [`MAX_TO_TILE_BYTES`], [`MAX_CHUNK_REQUEST_BYTES`] or [`MAX_CHUNK_REPLY_BYTES`]. A body takes no memory before its
//! length has been compared with the cap. What follows a whole message in its body is an error.
//!
//! # Bodies
//! A body is a `u8` tag, a header, and for some messages bulk data. Headers are plain little-endian structs in the order
//! of their fields: fixed-width integers and floats, `Option` as a byte 0 or 1 and then the value, a list or string as a
//! `u64` count and its items, an enum as a `u32`, counted from 0 in the
//! order of its declaration (a [`ByeCode`] from 1). `uvarint` is LEB128, low group first, at most 5 bytes.
//!
//! | tag | message | from, to | header, bulk |
//! |---|---|---|---|
//! | 1 | [`Hello`] | node, control | magic `MULL`, version u32, node string, part u32 ([`Part`]), credentials `Option<bytes>`, cached list of hashes |
//! | 2 | [`ChunkHello`] | node, chunks | magic `MULL`, version u32, session u64 |
//! | 3 | Ready | node, control | frame u64, draw_us u32, [`Shown`] as an `Option` |
//! | 4 | [`Stats`] | node, control | the fields of [`Stats`] |
//! | 5 | [`Bye`] | either, both | code u32, reason string; the same in every version |
//! | 6 | [`Welcome`] | master, control | the fields of [`Welcome`] |
//! | 7 | [`Manifest`] | master, control | epoch u32, list of (section kind u32, hash 32 bytes, length u64), the tessellation as an `Option` of the same, the index of hierarchies of detail as an `Option` of (hash 32 bytes, length u32) |
//! | 8 | [`Frame`] | master, control | see [`Frame`] |
//! | 9 | Swap | master, control | frame u64 |
//! | 10 | Alive | master, control | nothing; sent where nothing else was for a second |
//! | 11 | [`Want`] | node, chunks | list of hashes, appended to those wanted before, at most [`MAX_WANTED`] open at once |
//! | 12 | [`Piece`] | master, chunks | hash, offset u64, total u64, then the bytes to the end of the body |
//! | 13 | Absent | master, chunks | hash |
//! | 14 | [`Ping`] | node, control | at_us u64 |
//! | 15 | [`Pong`] | master, control | at_us u64, master_us u64 |
//! | 16 | [`StandbyHello`] | standby | magic `MULL`, version u32, hash of the wall, hash of the scene |
//! | 17 | [`Course`] | master, standby | see [`Course`]; answered by Ready |
//! | 18 | [`RivalHello`] | master, master | as StandbyHello, then live_nodes u32, port u16; answered by Bye |
//! | 19 | Prepared | node, control; standby | epoch u32 |
//! | 20 | [`Insertions`] | master, standby | entered u32, list of [`Insertion`]; answered by Prepared or Unprepared |
//! | 21 | Unprepared | standby | epoch u32, reason string |
//! | 22 | [`Counted`] | node, control | frame u64, view u16, then for each object: id u32, visible_px u32, distance_m f32, to the end of the body |
//!
//! # A session
//! `Hello` → `Welcome`, `Manifest`; then the node opens its chunk connection with the session number that `Welcome`
//! gave, and wants the manifest's sections by hash. For each `Frame` the node applies the deltas, wants what it lacks,
//! draws, and says `Ready`. `Swap` tells it to show that frame. A node works on the newest frame: older ones that it has
//! not drawn are dropped. A node that says nothing for [`SILENCE_LIMIT`] is gone; `Stats` once a second is enough.
//! A node asks for the time when it greets, and about twice a second; half of the shortest way there and back is how far its estimate of the
//! master's clock may be off. With each Ready it says when, on that clock, it showed the frame before.
//! The magic and the version come first in both greetings, so that any version can refuse any other by name.
//!
//! # A scene that grows
//! Another `Manifest` may come while frames of the old epoch go on: it names the sections of the one before, and more. The node fetches
//! what is new, and the chunks of what it would see of that, and says `Prepared`. Some frame after that is the first of the new epoch, on
//! all nodes at once. Objects, leaves, materials and chunks keep their numbers, so that deltas go on across epochs.
//!
//! # Deltas
//! A frame's `base` is a frame that this node said `Ready` for on this connection, at most [`BASE_WINDOW`] frames back;
//! without a base the delta is against empty sets. A view's digest tells whether the set that came of it is the master's. Transforms are absolute, of every object that moved since the base
//! (or since the first manifest). A node keeps the sets of the last [`BASE_WINDOW`] frames that it acknowledged.
//!
//! # What hardly contributes
//! Where [`Welcome::count_every`] is not 0, a node counts, every so many frames, how much of the boxes of some objects that it sees is visible,
//! and says `Counted`. The master sums that up over the wall and names with each frame what is not to be drawn though tiles see it, the
//! same for all nodes. Visible sets stay what they are.
//!
//! # To a budget
//! A frame may say how many triangles the wall spends on an estimate of what is visible ([`Estimate`]). All nodes get the same order: each
//! finds the same estimate from the tessellation that the manifest names, and draws what its views see of it. `Ready` says how long drawing
//! took, from which the master learns how many triangles a wall has time for.
//!
//! # In detail
//! A frame may say how finely objects with hierarchies of detail are drawn ([`Detail`]). The manifest names an index, and that the blobs of each: a base
//! and blocks, coarse first. A node fetches them only then, and draws what has come of them in the place of these objects' leaves: wherever they are in
//! sight, but for what the frame drops or says to be away.

pub mod codec;
mod counted;
mod frame;
mod manifest;
mod message;
mod opening;
mod primary;
mod ranges;
mod standby;

use std::time::Duration;

use thiserror::Error;

pub use codec::CodecError;
pub use counted::{Counted, ObjectCount};
pub use frame::{Budget, Frame, FrameView, Moved};
pub use manifest::{Manifest, SectionRef};
pub use message::{Bye, ByeCode, ChunkReply, Piece, Ping, Pong, Shown, Stats, ToMaster, ToTile, ViewSpec, Want, Welcome};
pub use opening::{ChunkHello, Hello, Opening, Part};
pub use primary::{Detail, DetailWeight, Estimate, Primary, UnknownWeight};
pub use standby::{Course, Insertion, Insertions, RivalHello, StandbyHello, Steering, ToStandby};

use crate::scene::{MAX_CHUNK_BYTES, MAX_HIERARCHY_BLOB_BYTES, SectionKind};

/// Version of the protocol. Master and nodes speak only their own.
pub const PROTOCOL_VERSION: u32 = 10;
/// First bytes of a greeting, after its tag.
pub const MAGIC: [u8; 4] = *b"MULL";

/// Longest body before the greeting is accepted.
pub const MAX_OPENING_BYTES: usize = 1 << 10;
/// How long a connection may take for its greeting.
pub const OPENING_LIMIT: Duration = Duration::from_secs(5);
/// Longest body from a node on the control connection, after its greeting.
pub const MAX_TO_MASTER_BYTES: usize = 4 << 10;
/// Longest body from the master on the control connection: frames.
pub const MAX_TO_TILE_BYTES: usize = 64 << 20;
/// Longest body from a node on the chunk connection.
pub const MAX_CHUNK_REQUEST_BYTES: usize = 16 << 10;
/// Most bytes of a blob in one piece.
pub const MAX_PIECE_BYTES: usize = 256 << 10;
/// Longest body from the master on the chunk connection.
pub const MAX_CHUNK_REPLY_BYTES: usize = MAX_PIECE_BYTES + 64;

/// Longest name of a node or tile.
pub const MAX_NAME_BYTES: usize = 64;
/// Longest name of a package.
pub const MAX_PACKAGE_NAME_BYTES: usize = 255;
/// Longest credentials.
pub const MAX_CREDENTIALS_BYTES: usize = 512;
/// Most hashes in a greeting's list of what is cached.
pub const MAX_CACHED: usize = 8;
/// Longest reason in a [`Bye`].
pub const MAX_REASON_BYTES: usize = 512;
/// Most views of a node.
pub const MAX_VIEWS: usize = 2048;
/// Most views of a wall.
pub const MAX_WALL_VIEWS: usize = 1 << 16;
/// Most parts of a scene: one, and one for each time that it grew.
pub const MAX_PARTS: usize = 1024;
/// Most sections in a manifest.
pub const MAX_SECTIONS: usize = MAX_PARTS * SectionKind::FOR_TILES.len();
/// Largest section that travels as a blob.
pub const MAX_TILE_SECTION_BYTES: u64 = 1 << 30;
/// Most blobs that a node may have asked for and not got.
pub const MAX_WANTED: usize = 256;
/// Most objects whose boxes are counted in one message.
pub const MAX_COUNTED: usize = 256;
/// Most ranges of leaves that are dropped.
pub const MAX_DROPPED_RANGES: usize = 1 << 16;
/// Most ranges of leaves whose objects are drawn by hierarchies and are away.
pub const MAX_AWAY_RANGES: usize = 1 << 16;
/// Most planes of the primary frustum that a frame names.
pub const MAX_PRIMARY_PLANES: usize = 8;
/// How many frames back a base may lie.
pub const BASE_WINDOW: usize = 8;
/// How long the other side may say nothing before it counts as gone.
pub const SILENCE_LIMIT: Duration = Duration::from_secs(10);
/// How often each side says something at least.
pub const ALIVE_EVERY: Duration = Duration::from_secs(1);

const _: () = assert!(1 + 8 + MAX_WANTED * 32 <= MAX_CHUNK_REQUEST_BYTES, "a full list fits its cap");
const _: () = assert!(1 + 8 + 2 + MAX_COUNTED * size_of::<ObjectCount>() <= MAX_TO_MASTER_BYTES, "a full count fits its cap");
const _: () = assert!(1 + 4 + 8 + MAX_REASON_BYTES <= MAX_OPENING_BYTES, "a refusal fits every cap");
const _: () = assert!(1 + 32 + 8 + 8 + MAX_PIECE_BYTES <= MAX_CHUNK_REPLY_BYTES, "a full piece fits its cap");
const _: () = assert!(MAX_CHUNK_BYTES as u64 <= MAX_TILE_SECTION_BYTES, "one cap holds for chunks and sections");
const _: () = assert!(MAX_HIERARCHY_BLOB_BYTES as u64 <= MAX_TILE_SECTION_BYTES, "and for what hierarchies consist of");
const _: () = assert!(ALIVE_EVERY.as_secs() * 4 <= SILENCE_LIMIT.as_secs(), "a few lost signs of life are no death");

/// Bytes of the length before every body.
pub const LENGTH_BYTES: usize = 4;

/// Why bytes are no message, or a message cannot be sent.
#[derive(Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum WireError {
    #[error(transparent)]
    Codec(#[from] CodecError),
    #[error("the message is empty")]
    Empty,
    #[error("no message has tag {tag} here")]
    Tag { tag: u8 },
    #[error("not a Mullion greeting: it does not start with MULL")]
    Magic,
    #[error("protocol version {theirs}; this program speaks version {PROTOCOL_VERSION}")]
    Version { theirs: u32 },
    #[error("{what}: {value}, at most {cap} are allowed")]
    Limit { what: &'static str, value: u64, cap: u64 },
    #[error("the message is longer than the {cap} bytes allowed")]
    TooLong { cap: usize },
    #[error("{what} is not finite")]
    NotFinite { what: &'static str },
    #[error("{what}: cut off or out of order")]
    Bulk { what: &'static str },
}

fn within(what: &'static str, value: usize, cap: usize) -> Result<(), WireError> {
    if value <= cap { Ok(()) } else { Err(WireError::Limit { what, value: value as u64, cap: cap as u64 }) }
}

/// Writes a whole message to `out`, which it empties first: the length, the tag, and what `body` appends.
fn framed(
    out: &mut Vec<u8>,
    tag: u8,
    cap: usize,
    body: impl FnOnce(&mut Vec<u8>) -> Result<(), WireError>,
) -> Result<(), WireError> {
    out.clear();
    out.extend_from_slice(&[0; LENGTH_BYTES]);
    out.push(tag);
    body(out)?;
    let length = out.len() - LENGTH_BYTES;
    within("bytes of a message", length, cap)?;
    out[..LENGTH_BYTES].copy_from_slice(&(length as u32).to_le_bytes());
    Ok(())
}

/// The body of a message that an `encode` of this module wrote.
pub fn body_of(message: &[u8]) -> &[u8] {
    message.get(LENGTH_BYTES..).unwrap_or(&[])
}

#[cfg(test)]
mod tests;
