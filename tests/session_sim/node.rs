//! A node of the simulation: its session, and a painter that draws nothing.

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

use mullion_client::missing::WhenMissing;
use mullion_client::tile_session::TileSession;
use mullion_common::scene::{SceneManifest, Tessellation, Transform};
use mullion_server::master::PeerId;

use super::{Event, detail};

/// A process that may die; its session dies with it.
pub struct Node {
    pub session: TileSession,
    pub name: String,
    pub run: u64,
    pub peer: Option<PeerId>,
    pub inbox: VecDeque<Event>,
    pub is_drawing: bool,
    pub is_hung: bool,
    pub draw_us: u64,
    pub times_hung: u64,
    /// The painter.
    pub scene: Option<Arc<SceneManifest>>,
    pub tessellation: Option<Arc<Tessellation>>,
    pub hierarchies: detail::Taken,
    pub uploaded: BTreeSet<u32>,
    pub evictions: u64,
    pub transforms: Vec<Transform>,
    pub drawn: Option<u64>,
    pub shown: Option<u64>,
}

impl Node {
    pub fn new(name: &str, (when_missing, memory_bytes): (WhenMissing, u64)) -> Self {
        Self {
            session: TileSession::new(name, None, memory_bytes, when_missing),
            name: name.to_owned(),
            run: 0,
            peer: None,
            inbox: VecDeque::new(),
            is_drawing: false,
            is_hung: false,
            draw_us: 3000,
            times_hung: 0,
            scene: None,
            tessellation: None,
            hierarchies: detail::Taken::default(),
            uploaded: BTreeSet::new(),
            evictions: 0,
            transforms: Vec::new(),
            drawn: None,
            shown: None,
        }
    }
}
