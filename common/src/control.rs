//! What the control API's two ends say to each other: values that serde turns into JSON, and the one message that is bytes.
//!
//! `docs/control.md` tells the whole of it. Nothing here is checked against a wall or a scene: the master does that.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::scene::{ObjectId, Transform};
use crate::wire::Moved;

/// Most bytes of a request.
pub const MAX_REQUEST_BYTES: usize = 4 << 20;
/// Most commands in a request.
pub const MAX_COMMANDS: usize = 65_536;
/// Most moves in a message of [`encode_moves`].
pub const MAX_MOVES: usize = (MAX_REQUEST_BYTES - 4) / MOVE_BYTES;
/// Bytes of a move: an object and its transform.
const MOVE_BYTES: usize = 4 + size_of::<Transform>();

/// Something to do between two frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Command {
    /// Puts the room somewhere in the world, and off its path.
    Camera(CameraAt),
    /// Puts the room back on its path, where the path now is.
    FollowPath,
    /// Where each observer's eye is, room space, metres; none: where the wall has them.
    Eyes(Vec<[f64; 3]>),
    /// Puts objects somewhere. The last word on an object in a frame holds.
    Move(Vec<MoveObject>),
    /// Takes an object and all below it out of what is seen.
    Remove(ObjectNumber),
    /// Brings an object of the scene and all below it back.
    Add(ObjectNumber),
    /// Adds a package of the master's library to the scene. Stands alone in its request.
    Insert(Insert),
    /// Holds the scene's time and the camera's path. Frames go on.
    Pause,
    /// Lets them go on.
    Resume,
    /// Holds them after so many more frames.
    Step(Steps),
    /// What a tile may spend on a frame.
    Budget(TileBudget),
}

/// Where the room is: `world_from_room`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraAt {
    /// The room's origin in the world, metres; each within ±1e15.
    pub translation: [f64; 3],
    /// How the room is turned: x, y, z, w; of length 1 within 0.001.
    #[serde(default = "unturned")]
    pub rotation: [f64; 4],
    /// Metres of the world in a metre of the room, 1e-6 to 1e6.
    #[serde(default = "unscaled")]
    pub scale: f64,
}

fn unturned() -> [f64; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

fn unscaled() -> f64 {
    1.0
}

/// An object and where it goes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoveObject {
    /// Its number in the scene.
    pub object: u32,
    /// `world_from_local`: the three columns of the matrix, then the translation in metres; each within ±1e15.
    pub transform: [f64; 12],
}

/// An object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectNumber {
    /// Its number in the scene.
    pub object: u32,
}

/// A package to be added to the scene, and where.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Insert {
    /// The name of its file in the library.
    pub package: String,
    /// The object that it becomes part of; left out: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub under: Option<u32>,
    /// Where the package's world is in the scene's: three columns, then the translation in metres; each within ±1e15.
    pub transform: [f64; 12],
}

/// An insertion that was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inserted {
    /// The frame from which it is seen.
    pub frame: u64,
    /// The objects that it brought. The first stands above all others.
    pub objects: ObjectRange,
}

/// Objects with numbers that follow on one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct ObjectRange {
    pub first: u32,
    pub count: u32,
}

/// How far a show goes on before it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Steps {
    /// Frames, 1 to 1 000 000.
    pub frames: u32,
}

/// What a tile may spend on a frame. What is left out is not limited.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TileBudget {
    /// The tile's name; left out: each tile of the wall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tile: Option<String>,
    /// Most triangles for each view.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub triangles: Option<u32>,
    /// Most time on the GPU for each view, microseconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gpu_us: Option<u32>,
}

/// A message from a client on its WebSocket.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Comes back with the answer; the client's choice.
    pub id: u64,
    /// What is wanted.
    pub ask: Ask,
}

/// What a client wants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ask {
    /// Do all of these in one frame, or none.
    Commands(Vec<Command>),
    /// Why a tile sees an object, or does not.
    Why(Question),
    /// Which tiles see an object.
    Tiles(ObjectKey),
}

/// Whether a tile sees an object.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Question {
    /// The object.
    pub object: ObjectKey,
    /// The tile's name.
    pub tile: String,
}

/// An object by number, or by the name that the source file gives it, where no other has the same.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
#[allow(missing_docs)]
pub enum ObjectKey {
    Number(u32),
    Name(String),
}

/// A message to a client on its WebSocket.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// The answer to a request.
    #[allow(missing_docs)]
    Answer { id: u64, answer: Answer },
    /// A request or a message of moves was refused; nothing of it was done.
    #[allow(missing_docs)]
    Refused { id: Option<u64>, error: String },
    /// How the show stands. Some frames have none where the client reads slowly.
    Status(Status),
}

/// The answer to an [`Ask`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// The frame from which the commands hold.
    Frame(u64),
    /// To [`Ask::Commands`] with an insertion.
    Inserted(Inserted),
    /// To [`Ask::Why`].
    Why(Why),
    /// To [`Ask::Tiles`].
    Tiles(SeenBy),
}

/// Which tiles see an object.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SeenBy {
    /// In which frame.
    pub frame: u64,
    /// The object's number.
    pub object: u32,
    /// Names of tiles, in the wall's order.
    pub tiles: Vec<String>,
}

/// Why a tile sees an object and all below it, or does not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Why {
    /// In which frame.
    pub frame: u64,
    /// The object's number.
    pub object: u32,
    /// Its name in the source file; may be empty.
    pub name: String,
    /// The tile's name.
    pub tile: String,
    /// Whether any view of the tile sees any leaf of it that is listed.
    pub is_seen: bool,
    /// Leaves of the object and all below it. 0: it has no geometry.
    pub leaf_count: u32,
    /// The first of them; no more than a cap.
    pub leaves: Vec<LeafWhy>,
}

/// Why a leaf is seen, or not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeafWhy {
    /// Its number.
    pub leaf: u32,
    /// The object that it is part of.
    pub object: u32,
    /// For each view of the tile, in the wall's order.
    pub views: Vec<Reason>,
}

/// Why a view sees a leaf, or does not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// It sees it.
    Seen,
    /// The leaf was removed.
    Removed,
    /// The leaf's box lies outside a plane of the view's frustum.
    #[allow(missing_docs)]
    Outside { side: Side, distance_m: f64 },
    /// No plane of the frustum parts the two, but another direction does: the box passes an edge or a corner of the frustum.
    PastAnEdge,
    /// The box and the frustum meet, and still the view does not see it: a fault of the cull.
    Unexplained,
}

/// A side of a frustum, as its view sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Side {
    Left,
    Right,
    Bottom,
    Top,
    Near,
}

/// How a show stands.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// The newest frame that was released; none yet: 0, with `frames` 0.
    pub frame: u64,
    /// Frames released.
    pub frames: u64,
    /// Frames of the camera's path and of the scene's time that have passed: fewer where the show was paused.
    pub path_frame: u64,
    /// Frames a second that the wall aims at.
    pub rate_hz: f64,
    /// Whether the scene's time is held.
    pub is_paused: bool,
    /// Whether another master drives the wall, and this one stands by to take its place: it takes no commands.
    #[serde(default)]
    pub is_standing_by: bool,
    /// Nodes connected.
    pub connected: u32,
    /// By the wall's order.
    pub nodes: Vec<NodeStatus>,
}

/// How a node stands.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeStatus {
    /// Its name.
    pub name: String,
    /// Whether frames wait for it.
    pub standing: NodeStanding,
    /// How often a frame went on without it.
    pub passed_over: u64,
}

/// Whether frames wait for a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NodeStanding {
    /// Not connected.
    #[default]
    Absent,
    /// Connected, not waited for.
    Trying,
    /// Waited for.
    Live,
}

/// Why bytes are no message of moves.
#[derive(Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum MovesError {
    #[error("moves: {length} bytes; a count of 4 bytes comes first")]
    NoCount { length: usize },
    #[error("moves: {count}, at most {MAX_MOVES} are allowed")]
    TooMany { count: u32 },
    #[error("moves: {length} bytes for {count}; each has {MOVE_BYTES}, and the count 4")]
    Length { length: usize, count: u32 },
}

/// Writes moves as a binary message to `out`, which it empties first: their count u32, then for each its object u32 and its
/// `world_from_local` 12 × f64, all little-endian.
pub fn encode_moves(moves: &[Moved], out: &mut Vec<u8>) {
    out.clear();
    out.extend_from_slice(&(moves.len() as u32).to_le_bytes());
    for moved in moves {
        out.extend_from_slice(&moved.object.0.to_le_bytes());
        out.extend_from_slice(bytemuck::bytes_of(&moved.transform));
    }
}

/// Reads what [`encode_moves`] wrote. Numbers are as they come, not finite ones, too.
///
/// # Errors
/// When the length is not that of the count, or they are too many.
pub fn decode_moves(bytes: &[u8]) -> Result<impl Iterator<Item = Moved> + '_, MovesError> {
    let (count, rest) = bytes.split_first_chunk::<4>().ok_or(MovesError::NoCount { length: bytes.len() })?;
    let count = u32::from_le_bytes(*count);
    if count as usize > MAX_MOVES {
        return Err(MovesError::TooMany { count });
    }
    if rest.len() != count as usize * MOVE_BYTES {
        return Err(MovesError::Length { length: bytes.len(), count });
    }
    Ok(rest.chunks_exact(MOVE_BYTES).map(|bytes| {
        let (object, transform) = bytes.split_at(4);
        Moved { object: ObjectId(bytemuck::pod_read_unaligned(object)), transform: bytemuck::pod_read_unaligned(transform) }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DVec3};

    #[test]
    fn moves_come_back_and_other_bytes_do_not() {
        let transform = Transform::from(DAffine3::from_translation(DVec3::new(1.0, -2.0, 3.5)));
        let moves = [Moved { object: ObjectId(7), transform }, Moved { object: ObjectId(2), transform }];
        let mut bytes = Vec::new();
        encode_moves(&moves, &mut bytes);
        assert_eq!(decode_moves(&bytes).map(Iterator::collect::<Vec<_>>), Ok(moves.to_vec()));
        let error = |bytes: &[u8]| decode_moves(bytes).err();
        assert_eq!(error(&bytes[..3]), Some(MovesError::NoCount { length: 3 }));
        assert_eq!(error(&bytes[..bytes.len() - 1]), Some(MovesError::Length { length: 203, count: 2 }));
        assert_eq!(error(&[0xff; 8]), Some(MovesError::TooMany { count: u32::MAX }));
    }
}
