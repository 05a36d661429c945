//! Greetings: the first message on a connection, and its bytes.

use serde::{Deserialize, Serialize};

use super::codec::List;
use super::message::{split_tag, tag};
use super::{
    MAGIC, MAX_CACHED, MAX_CREDENTIALS_BYTES, MAX_NAME_BYTES, MAX_OPENING_BYTES, PROTOCOL_VERSION, RivalHello, StandbyHello,
    WireError, codec, framed, within,
};
use crate::scene::ChunkHash;

/// A node's greeting on its control connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hello {
    /// Which node of the wall it is; of a spare, its own name, for people.
    pub node: String,
    /// Whether it is that node, or would stand in for any.
    pub part: Part,
    /// What proves it, where the master asks for proof.
    pub credentials: Option<Vec<u8>>,
    /// What it has cached. Reserved: the master reads and ignores it.
    pub cached: Vec<ChunkHash>,
}

/// What a node takes part as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Part {
    /// The node of the wall that it names.
    #[default]
    Own,
    /// It waits until a node is missing and takes its place, until that one is back.
    Spare,
}

/// A node's greeting on its chunk connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChunkHello {
    /// The number that the welcome gave.
    pub session: u64,
}

/// The first message on a connection: says which one it is.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Opening {
    Control(Hello),
    Chunks(ChunkHello),
    Standby(StandbyHello),
    Rival(RivalHello),
}

#[derive(Serialize, Deserialize)]
struct HelloHead {
    magic: [u8; 4],
    version: u32,
    node: String,
    part: Part,
    credentials: Option<List<u8>>,
    cached: List<ChunkHash>,
}

#[derive(Serialize, Deserialize)]
struct ChunkHelloHead {
    magic: [u8; 4],
    version: u32,
    session: u64,
}

#[derive(Serialize, Deserialize)]
struct StandbyHelloHead {
    magic: [u8; 4],
    version: u32,
    wall: ChunkHash,
    scene: ChunkHash,
}

#[derive(Serialize, Deserialize)]
struct RivalHelloHead {
    magic: [u8; 4],
    version: u32,
    wall: ChunkHash,
    scene: ChunkHash,
    live_nodes: u32,
    port: u16,
}

impl Opening {
    /// Writes the whole message to `out`, which it empties first.
    ///
    /// # Errors
    /// When a part passes its cap.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        self.encode_as_version(PROTOCOL_VERSION, out)
    }

    /// As [`Opening::encode`], of a program of another version.
    ///
    /// # Errors
    /// When a part passes its cap.
    pub fn encode_as_version(&self, version: u32, out: &mut Vec<u8>) -> Result<(), WireError> {
        match self {
            Self::Control(hello) => {
                hello.check()?;
                let Hello { node, part, credentials, cached } = hello.clone();
                let (credentials, cached) = (credentials.map(List), List(cached));
                let head = HelloHead { magic: MAGIC, version, node, part, credentials, cached };
                framed(out, tag::HELLO, MAX_OPENING_BYTES, |out| Ok(codec::encode_into(&head, out)?))
            }
            Self::Chunks(hello) => {
                let head = ChunkHelloHead { magic: MAGIC, version, session: hello.session };
                framed(out, tag::CHUNK_HELLO, MAX_OPENING_BYTES, |out| Ok(codec::encode_into(&head, out)?))
            }
            Self::Standby(StandbyHello { wall, scene }) => {
                let head = StandbyHelloHead { magic: MAGIC, version, wall: *wall, scene: *scene };
                framed(out, tag::STANDBY_HELLO, MAX_OPENING_BYTES, |out| Ok(codec::encode_into(&head, out)?))
            }
            Self::Rival(RivalHello { show: StandbyHello { wall, scene }, live_nodes, port }) => {
                let (live_nodes, port) = (*live_nodes, *port);
                let head = RivalHelloHead { magic: MAGIC, version, wall: *wall, scene: *scene, live_nodes, port };
                framed(out, tag::RIVAL_HELLO, MAX_OPENING_BYTES, |out| Ok(codec::encode_into(&head, out)?))
            }
        }
    }

    /// Reads a body.
    ///
    /// # Errors
    /// When it is no greeting of this version, or a part passes its cap.
    pub fn decode(body: &[u8]) -> Result<Self, WireError> {
        let (tag, rest) = split_tag(body, MAX_OPENING_BYTES)?;
        if !matches!(tag, tag::HELLO | tag::CHUNK_HELLO | tag::STANDBY_HELLO | tag::RIVAL_HELLO) {
            return Err(WireError::Tag { tag });
        }
        if !rest.starts_with(&MAGIC) {
            return Err(WireError::Magic);
        }
        let version = rest.get(4..8).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes).ok_or(WireError::Empty)?;
        if version != PROTOCOL_VERSION {
            return Err(WireError::Version { theirs: version });
        }
        match tag {
            tag::HELLO => {
                let HelloHead { node, part, credentials, cached, .. } = codec::decode::<_, MAX_OPENING_BYTES>(rest)?;
                let hello = Hello { node, part, credentials: credentials.map(|list| list.0), cached: cached.0 };
                hello.check()?;
                Ok(Self::Control(hello))
            }
            tag::CHUNK_HELLO => {
                let head: ChunkHelloHead = codec::decode::<_, MAX_OPENING_BYTES>(rest)?;
                Ok(Self::Chunks(ChunkHello { session: head.session }))
            }
            tag::RIVAL_HELLO => {
                let RivalHelloHead { wall, scene, live_nodes, port, .. } = codec::decode::<_, MAX_OPENING_BYTES>(rest)?;
                Ok(Self::Rival(RivalHello { show: StandbyHello { wall, scene }, live_nodes, port }))
            }
            _ => {
                let StandbyHelloHead { wall, scene, .. } = codec::decode::<_, MAX_OPENING_BYTES>(rest)?;
                Ok(Self::Standby(StandbyHello { wall, scene }))
            }
        }
    }
}

impl Hello {
    fn check(&self) -> Result<(), WireError> {
        within("bytes of a node's name", self.node.len(), MAX_NAME_BYTES)?;
        within("bytes of credentials", self.credentials.as_ref().map_or(0, Vec::len), MAX_CREDENTIALS_BYTES)?;
        within("cached hashes", self.cached.len(), MAX_CACHED)
    }
}
