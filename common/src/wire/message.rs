//! The messages between a master and its nodes other than greetings and the frame, and their bytes.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::codec::List;
use super::{
    Counted, Frame, MAX_CHUNK_REPLY_BYTES, MAX_CHUNK_REQUEST_BYTES, MAX_NAME_BYTES, MAX_OPENING_BYTES, MAX_PIECE_BYTES,
    MAX_REASON_BYTES, MAX_TILE_SECTION_BYTES, MAX_TO_MASTER_BYTES, MAX_TO_TILE_BYTES, MAX_VIEWS, MAX_WANTED, Manifest, WireError,
    codec, framed, within,
};
use crate::scene::ChunkHash;
use crate::wall::{Eye, ObserverId, TileId, ViewId, Wall};

pub(super) mod tag {
    pub const HELLO: u8 = 1;
    pub const CHUNK_HELLO: u8 = 2;
    pub const READY: u8 = 3;
    pub const STATS: u8 = 4;
    pub const BYE: u8 = 5;
    pub const WELCOME: u8 = 6;
    pub const MANIFEST: u8 = 7;
    pub const FRAME: u8 = 8;
    pub const SWAP: u8 = 9;
    pub const ALIVE: u8 = 10;
    pub const WANT: u8 = 11;
    pub const PIECE: u8 = 12;
    pub const ABSENT: u8 = 13;
    pub const PING: u8 = 14;
    pub const PONG: u8 = 15;
    pub const STANDBY_HELLO: u8 = 16;
    pub const COURSE: u8 = 17;
    pub const RIVAL_HELLO: u8 = 18;
    pub const PREPARED: u8 = 19;
    pub const INSERTIONS: u8 = 20;
    pub const UNPREPARED: u8 = 21;
    pub const COUNTED: u8 = 22;
}

/// What a node did lately. Whether or not anything changed, one comes every second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stats {
    /// Last frame drawn.
    pub frame: u64,
    /// Time it took to draw, microseconds.
    pub draw_us: u32,
    /// Leaves drawn, all views together.
    pub leaves: u32,
    /// Triangles drawn, all views together.
    pub triangles: u64,
    /// Bytes of chunks in memory.
    pub resident_bytes: u64,
}

/// When a node showed a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shown {
    /// Which frame.
    pub frame: u64,
    /// When, on the master's clock as the node estimates it, microseconds.
    pub at_us: u64,
}

/// A node's question what time it is at the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ping {
    /// Node's clock as it asks, microseconds since any fixed start.
    pub at_us: u64,
}

/// The master's answer to a [`Ping`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pong {
    /// What the ping said.
    pub at_us: u64,
    /// Master's clock as it answers, microseconds since any fixed start.
    pub master_us: u64,
}

/// From a node to the master, after the greeting.
#[derive(Clone, Debug, PartialEq)]
pub enum ToMaster {
    /// The frame is drawn and can be shown.
    Ready {
        /// Its number.
        frame: u64,
        /// Time it took to draw, microseconds; 0 where nothing was drawn.
        draw_us: u32,
        /// Whether the wall's budget left something out of the estimate: with more it would have taken longer.
        is_cut: bool,
        /// The last frame shown, where that has not been said and the master's clock is known.
        shown: Option<Shown>,
    },
    /// It holds the tables of a scene that has grown, and the chunks of what it would see of that: the answer to every manifest but the
    /// first. Of a standby: it can take over a show of that epoch.
    Prepared {
        /// Of the manifest, or of the newest scene that a standby holds.
        epoch: u32,
    },
    /// A standby cannot follow a scene that grows.
    Unprepared {
        /// Which it cannot take over.
        epoch: u32,
        /// Why, for people. One line.
        reason: String,
    },
    /// What time is it there?
    Ping(Ping),
    /// What it did lately.
    Stats(Stats),
    /// How much is to be seen of what it drew, or did not.
    Counted(Counted),
    /// It goes.
    Bye(Bye),
}

/// Why a connection ends. The numbers never change their meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByeCode {
    /// The show is over.
    EndOfShow,
    /// The two sides speak different versions.
    VersionMismatch,
    /// The wall has no node of that name.
    UnknownNode,
    /// A node of that name is there and alive.
    AlreadyConnected,
    /// A message could not be read, or says what cannot be.
    Malformed,
    /// A message is larger than its cap.
    TooLarge,
    /// The other side took too long.
    Timeout,
    /// There are too many connections.
    TooMany,
    /// The session number is of no node that is here.
    UnknownSession,
    /// The credentials do not suffice.
    Refused,
    /// The side that says it stops, and may be back.
    Leaving,
    /// Something failed on the side that says it.
    Failed,
    /// Another master drives the wall.
    OtherMaster,
    /// A code of a later version.
    Other(u32),
}

impl ByeCode {
    const KNOWN: [Self; 13] = [
        Self::EndOfShow,
        Self::VersionMismatch,
        Self::UnknownNode,
        Self::AlreadyConnected,
        Self::Malformed,
        Self::TooLarge,
        Self::Timeout,
        Self::TooMany,
        Self::UnknownSession,
        Self::Refused,
        Self::Leaving,
        Self::Failed,
        Self::OtherMaster,
    ];

    /// Its number on the wire: from 1 in the order above.
    pub fn number(self) -> u32 {
        match self {
            Self::Other(number) => number,
            known => Self::KNOWN.iter().position(|k| *k == known).map_or(0, |i| i as u32 + 1),
        }
    }

    /// The code of that number.
    pub fn from_number(number: u32) -> Self {
        let known = (number as usize).checked_sub(1).and_then(|i| Self::KNOWN.get(i));
        known.copied().unwrap_or(Self::Other(number))
    }

    /// Whether a node that hears it should try again later.
    pub fn is_retryable(self) -> bool {
        use ByeCode as C;
        !matches!(self, C::EndOfShow | C::VersionMismatch | C::UnknownNode | C::Refused)
    }
}

/// The last message on a connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bye {
    /// Why, for programs.
    pub code: ByeCode,
    /// Why, for people. One line.
    pub reason: String,
}

impl Bye {
    /// A reason longer than its cap is cut.
    pub fn new(code: ByeCode, reason: impl Into<String>) -> Self {
        Self { code, reason: cut(reason.into()) }
    }

    /// What answers a message that could not be read.
    pub fn for_error(error: &WireError) -> Self {
        let code = match error {
            WireError::Version { .. } => ByeCode::VersionMismatch,
            WireError::Limit { .. } | WireError::TooLong { .. } | WireError::Codec(codec::CodecError::TooLarge { .. }) => {
                ByeCode::TooLarge
            }
            _ => ByeCode::Malformed,
        };
        Self::new(code, error.to_string())
    }
}

/// A reason that fits its cap.
fn cut(mut reason: String) -> String {
    let mut end = reason.len().min(MAX_REASON_BYTES);
    while !reason.is_char_boundary(end) {
        end -= 1;
    }
    reason.truncate(end);
    reason
}

impl fmt::Display for Bye {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}: {}", self.code, self.reason)
    }
}

/// A view that a node draws: what one eye of one observer sees through one tile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewSpec {
    /// Which view of the wall.
    pub view: ViewId,
    /// Which tile of the wall.
    pub tile: TileId,
    /// What the tile is called.
    pub tile_name: String,
    /// Whose eye.
    pub observer: ObserverId,
    /// Which eye.
    pub eye: Eye,
    /// Bottom left, bottom right, top left of the tile's visible area, room space, metres.
    pub corners: [[f64; 3]; 3],
    /// Width and height of the tile, pixels.
    pub size_px: [u32; 2],
    /// Distance of the near plane, metres of the room.
    pub near_m: f64,
}

impl ViewSpec {
    /// A view of a wall.
    pub fn of(wall: &Wall, id: ViewId) -> Self {
        let view = wall.views()[usize::from(id.0)];
        let tile = wall.tile(view.tile);
        Self {
            view: id,
            tile: view.tile,
            tile_name: tile.name.clone(),
            observer: view.observer,
            eye: view.eye,
            corners: tile.corners.map(|c| c.to_array()),
            size_px: tile.size_px,
            near_m: wall.near_m(),
        }
    }
}

/// The master's answer to a greeting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Welcome {
    /// The master's version.
    pub version: u32,
    /// Opens the chunk connection; unguessable.
    pub session: u64,
    /// The node as the master knows it.
    pub node: String,
    /// What it draws.
    #[serde(deserialize_with = "codec::list")]
    pub views: Vec<ViewSpec>,
    /// Frames a second that the wall aims at.
    pub rate_hz: f64,
    /// Number of the next frame.
    pub next_frame: u64,
    /// In each view, some objects are counted every so many frames; 0: none ever.
    pub count_every: u32,
}

/// From the master to a node, on the control connection.
#[derive(Clone, Debug, PartialEq)]
pub enum ToTile {
    /// The node is part of the wall.
    Welcome(Welcome),
    /// The scene.
    Manifest(Manifest),
    /// What to draw.
    Frame(Frame),
    /// What to show.
    Swap {
        /// Number of the frame.
        frame: u64,
    },
    /// The master is there and has nothing to say.
    Alive,
    /// What time it is at the master.
    Pong(Pong),
    /// The master ends the connection.
    Bye(Bye),
}

/// Blobs that a node wants, in order of need.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Want {
    /// Names, in order of need.
    pub hashes: Vec<ChunkHash>,
}

/// Part of a blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece<'a> {
    /// Name of the blob.
    pub hash: ChunkHash,
    /// Where the piece starts; pieces of a blob come in order.
    pub offset: u64,
    /// Bytes of the whole blob.
    pub total: u64,
    /// The bytes.
    pub bytes: &'a [u8],
}

/// From the master to a node, on the chunk connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ChunkReply<'a> {
    /// Part of a blob.
    Piece(Piece<'a>),
    /// The master has no such blob.
    Absent {
        /// Its name.
        hash: ChunkHash,
    },
    /// The master ends the connection.
    Bye(Bye),
}

#[derive(Serialize, Deserialize)]
struct ReasonHead {
    number: u32,
    reason: String,
}

#[derive(Serialize, Deserialize)]
struct PieceHead {
    hash: ChunkHash,
    offset: u64,
    total: u64,
}

pub(super) fn put_bye(out: &mut Vec<u8>, bye: &Bye) -> Result<(), WireError> {
    put_reason(out, bye.code.number(), &bye.reason)
}

fn put_reason(out: &mut Vec<u8>, number: u32, reason: &str) -> Result<(), WireError> {
    within("bytes of a reason", reason.len(), MAX_REASON_BYTES)?;
    Ok(codec::encode_into(&ReasonHead { number, reason: reason.to_owned() }, out)?)
}

pub(super) fn take_bye(rest: &[u8]) -> Result<Bye, WireError> {
    let (number, reason) = take_reason(rest)?;
    Ok(Bye { code: ByeCode::from_number(number), reason })
}

/// A number, and why, in one line.
fn take_reason(rest: &[u8]) -> Result<(u32, String), WireError> {
    let ReasonHead { number, reason } = codec::decode::<_, MAX_OPENING_BYTES>(rest)?;
    within("bytes of a reason", reason.len(), MAX_REASON_BYTES)?;
    Ok((number, reason.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()))
}

pub(super) fn split_tag(body: &[u8], cap: usize) -> Result<(u8, &[u8]), WireError> {
    within("bytes of a message", body.len(), cap)?;
    body.split_first().map(|(tag, rest)| (*tag, rest)).ok_or(WireError::Empty)
}

impl ToMaster {
    /// What says why a scene is not followed. A reason longer than its cap is cut.
    pub fn unprepared(epoch: u32, reason: String) -> Self {
        Self::Unprepared { epoch, reason: cut(reason) }
    }

    /// Writes the whole message to `out`, which it empties first.
    ///
    /// # Errors
    /// When a part passes its cap.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        let cap = MAX_TO_MASTER_BYTES;
        match self {
            Self::Ready { frame, draw_us, is_cut, shown } => {
                framed(out, tag::READY, cap, |out| Ok(codec::encode_into(&(frame, draw_us, is_cut, shown), out)?))
            }
            Self::Prepared { epoch } => framed(out, tag::PREPARED, cap, |out| Ok(codec::encode_into(epoch, out)?)),
            Self::Unprepared { epoch, reason } => framed(out, tag::UNPREPARED, cap, |out| put_reason(out, *epoch, reason)),
            Self::Ping(ping) => framed(out, tag::PING, cap, |out| Ok(codec::encode_into(ping, out)?)),
            Self::Stats(stats) => framed(out, tag::STATS, cap, |out| Ok(codec::encode_into(stats, out)?)),
            Self::Counted(counted) => counted.encode(out),
            Self::Bye(bye) => framed(out, tag::BYE, cap, |out| put_bye(out, bye)),
        }
    }

    /// Reads a body.
    ///
    /// # Errors
    /// When it is no such message, a part passes its cap, or a distance is not finite.
    pub fn decode(body: &[u8]) -> Result<Self, WireError> {
        let (tag, rest) = split_tag(body, MAX_TO_MASTER_BYTES)?;
        match tag {
            tag::READY => {
                let (frame, draw_us, is_cut, shown) = codec::decode::<_, MAX_TO_MASTER_BYTES>(rest)?;
                Ok(Self::Ready { frame, draw_us, is_cut, shown })
            }
            tag::PREPARED => Ok(Self::Prepared { epoch: codec::decode::<_, MAX_TO_MASTER_BYTES>(rest)? }),
            tag::UNPREPARED => {
                let (epoch, reason) = take_reason(rest)?;
                Ok(Self::Unprepared { epoch, reason })
            }
            tag::PING => Ok(Self::Ping(codec::decode::<_, MAX_TO_MASTER_BYTES>(rest)?)),
            tag::STATS => Ok(Self::Stats(codec::decode::<_, MAX_TO_MASTER_BYTES>(rest)?)),
            tag::COUNTED => Ok(Self::Counted(Counted::decode(rest)?)),
            tag::BYE => Ok(Self::Bye(take_bye(rest)?)),
            tag => Err(WireError::Tag { tag }),
        }
    }
}

impl ToTile {
    /// Writes the whole message to `out`, which it empties first.
    ///
    /// # Errors
    /// When a part passes its cap.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        let cap = MAX_TO_TILE_BYTES;
        match self {
            Self::Welcome(welcome) => {
                welcome.check()?;
                framed(out, tag::WELCOME, cap, |out| Ok(codec::encode_into(welcome, out)?))
            }
            Self::Manifest(manifest) => {
                manifest.check()?;
                framed(out, tag::MANIFEST, cap, |out| Ok(codec::encode_into(manifest, out)?))
            }
            Self::Frame(frame) => frame.encode(out),
            Self::Swap { frame } => framed(out, tag::SWAP, cap, |out| Ok(codec::encode_into(frame, out)?)),
            Self::Alive => framed(out, tag::ALIVE, cap, |_| Ok(())),
            Self::Pong(pong) => framed(out, tag::PONG, cap, |out| Ok(codec::encode_into(pong, out)?)),
            Self::Bye(bye) => framed(out, tag::BYE, cap, |out| put_bye(out, bye)),
        }
    }

    /// Reads a body.
    ///
    /// # Errors
    /// When it is no such message, a part passes its cap, or a number that places something is not finite.
    pub fn decode(body: &[u8]) -> Result<Self, WireError> {
        const SMALL: usize = 1 << 20;
        let (tag, rest) = split_tag(body, MAX_TO_TILE_BYTES)?;
        match tag {
            tag::WELCOME => {
                let welcome: Welcome = codec::decode::<_, SMALL>(rest)?;
                welcome.check().map(|()| Self::Welcome(welcome))
            }
            tag::MANIFEST => {
                let manifest: Manifest = codec::decode::<_, SMALL>(rest)?;
                manifest.check().map(|()| Self::Manifest(manifest))
            }
            tag::FRAME => Ok(Self::Frame(Frame::decode(rest)?)),
            tag::SWAP => Ok(Self::Swap { frame: codec::decode::<_, SMALL>(rest)? }),
            tag::ALIVE if rest.is_empty() => Ok(Self::Alive),
            tag::PONG => Ok(Self::Pong(codec::decode::<_, SMALL>(rest)?)),
            tag::BYE => Ok(Self::Bye(take_bye(rest)?)),
            tag => Err(WireError::Tag { tag }),
        }
    }
}

impl Welcome {
    fn check(&self) -> Result<(), WireError> {
        within("bytes of a node's name", self.node.len(), MAX_NAME_BYTES)?;
        within("views", self.views.len(), MAX_VIEWS)?;
        let finite = |v: &ViewSpec| v.near_m.is_finite() && v.corners.iter().flatten().all(|c| c.is_finite());
        for view in &self.views {
            // A tile of a grid on a named screen is called after both.
            within("bytes of a tile's name", view.tile_name.len(), 2 * MAX_NAME_BYTES)?;
        }
        if self.rate_hz.is_finite() && self.views.iter().all(finite) {
            Ok(())
        } else {
            Err(WireError::NotFinite { what: "a number of the welcome" })
        }
    }
}

impl Want {
    /// Writes the whole message to `out`, which it empties first.
    ///
    /// # Errors
    /// When there are more than [`MAX_WANTED`] hashes.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        within("wanted blobs", self.hashes.len(), MAX_WANTED)?;
        framed(out, tag::WANT, MAX_CHUNK_REQUEST_BYTES, |out| Ok(codec::encode_into(&self.hashes, out)?))
    }

    /// Reads a body.
    ///
    /// # Errors
    /// When it is no such message or passes its cap.
    pub fn decode(body: &[u8]) -> Result<Self, WireError> {
        let (tag, rest) = split_tag(body, MAX_CHUNK_REQUEST_BYTES)?;
        if tag != tag::WANT {
            return Err(WireError::Tag { tag });
        }
        let List(hashes) = codec::decode::<List<ChunkHash>, MAX_CHUNK_REQUEST_BYTES>(rest)?;
        within("wanted blobs", hashes.len(), MAX_WANTED)?;
        Ok(Self { hashes })
    }
}

impl<'a> ChunkReply<'a> {
    /// Writes the whole message to `out`, which it empties first.
    ///
    /// # Errors
    /// When a part passes its cap.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        let cap = MAX_CHUNK_REPLY_BYTES;
        match self {
            Self::Piece(Piece { hash, offset, total, bytes }) => {
                within("bytes of a piece", bytes.len(), MAX_PIECE_BYTES)?;
                framed(out, tag::PIECE, cap, |out| {
                    codec::encode_into(&PieceHead { hash: *hash, offset: *offset, total: *total }, out)?;
                    out.extend_from_slice(bytes);
                    Ok(())
                })
            }
            Self::Absent { hash } => framed(out, tag::ABSENT, cap, |out| Ok(codec::encode_into(hash, out)?)),
            Self::Bye(bye) => framed(out, tag::BYE, cap, |out| put_bye(out, bye)),
        }
    }

    /// Reads a body.
    ///
    /// # Errors
    /// When it is no such message, a part passes its cap, or a piece ends past the end of its blob.
    pub fn decode(body: &'a [u8]) -> Result<Self, WireError> {
        const HEAD: usize = 64;
        let (tag, rest) = split_tag(body, MAX_CHUNK_REPLY_BYTES)?;
        match tag {
            tag::PIECE => {
                let (PieceHead { hash, offset, total }, used) = codec::decode_prefix::<_, HEAD>(rest)?;
                let bytes = &rest[used..];
                within("bytes of a piece", bytes.len(), MAX_PIECE_BYTES)?;
                if total > MAX_TILE_SECTION_BYTES {
                    return Err(WireError::Limit { what: "bytes of a blob", value: total, cap: MAX_TILE_SECTION_BYTES });
                }
                match offset.checked_add(bytes.len() as u64) {
                    Some(end) if end <= total => Ok(Self::Piece(Piece { hash, offset, total, bytes })),
                    _ => Err(WireError::Bulk { what: "piece" }),
                }
            }
            tag::ABSENT => Ok(Self::Absent { hash: codec::decode::<_, HEAD>(rest)? }),
            tag::BYE => Ok(Self::Bye(take_bye(rest)?)),
            tag => Err(WireError::Tag { tag }),
        }
    }
}
