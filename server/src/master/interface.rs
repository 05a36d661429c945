//! What a shell gives a master, and what the master has it do.

use std::sync::Arc;
use std::time::Duration;

use glam::{DAffine3, DVec3};
use mullion_common::geometry::Plane;
use mullion_common::scene::{BlobRef, ObjectId, Presence};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wire::{Budget, Bye, Detail, Insertion, Moved, SectionRef, Shown, Steering};

use super::{Adaptive, EstimateOptions, HierarchyLeaves, Message, PeerId, Spent};
use crate::swap_barrier::{BarrierOptions, NodeIndex};

/// When frames are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// As soon as the one before was released.
    AsFastAsPossible,
    /// One so long after the other. A frame that is released later than that begins the next at once, and the beat goes on
    /// from there: nothing is made up for.
    Every(Duration),
}

/// Vertex hierarchies, as a master knows them.
#[derive(Clone, Debug)]
pub struct Hierarchies {
    /// Their index.
    pub index: BlobRef,
    /// What they stand for.
    pub leaves: Arc<HierarchyLeaves>,
}

/// What a master needs to know beside the wall.
#[derive(Clone, Debug)]
pub struct MasterOptions {
    /// How long frames wait.
    pub barrier: BarrierOptions,
    /// When frames are wanted.
    pub pace: Pace,
    /// Number of the first frame: 0, but for a master that takes another's place.
    pub first_frame: u64,
    /// How many frames the show has, from frame 0 on; `None`: until it is stopped.
    pub frames: Option<u64>,
    /// What tiles fetch before they draw: of what the show began with, and of each insertion.
    pub sections: Vec<SectionRef>,
    /// The tessellation of what the show began with, where that has one.
    pub tessellation: Option<SectionRef>,
    /// The hierarchies of detail of what the show began with, where that has some.
    pub hierarchies: Option<Hierarchies>,
    /// What the scene has grown by under masters before.
    pub insertions: Vec<Insertion>,
    /// What hardly contributes is drawn on no tile; `None`: all that is seen is drawn.
    pub adaptive: Option<Adaptive>,
    /// Estimates of what is visible are drawn, within a budget; `None`: all that is seen is drawn. For scenes with a tessellation.
    pub estimates: Option<EstimateOptions>,
    /// How finely hierarchies of detail are drawn, in every frame; `None`: leaves are drawn. Nobody is told where there are no hierarchies.
    pub detail: Option<Detail>,
    /// Makes session numbers unguessable: random bytes, fresh for each run.
    pub session_seed: [u8; 32],
}

/// A frame that begins. Slices are by `ViewId`, all but `moved`.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// The number that was wanted.
    pub number: u64,
    /// Time in the scene, seconds.
    pub scene_time_s: f64,
    /// Where the room is in the world.
    pub world_from_room: DAffine3,
    /// Where each view's eye is, room space, metres.
    pub eyes: &'a [DVec3],
    /// The eye that all views share for what must agree across seams, world space.
    pub shared_eye: DVec3,
    /// What each view sees.
    pub sets: &'a [VisibleSet],
    /// Objects that have another transform than in the frame before.
    pub moved: &'a [Moved],
    /// Planes of the primary frustum in the world, with all that any view sees on their positive side; at most
    /// [`MAX_PRIMARY_PLANES`](mullion_common::wire::MAX_PRIMARY_PLANES). Only estimates and details are for them.
    pub primary: &'a [Plane],
    /// What each view may spend; empty: nothing is limited.
    pub budgets: &'a [Budget],
    /// Objects that come or go with all below them, in this order: for standbys. Nodes are told by what views see, and of objects with vertex
    /// hierarchies where they are drawn in detail.
    pub presence: &'a [(ObjectId, Presence)],
    /// How the show is steered: for standbys.
    pub steering: Steering,
}

/// What the shell is to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Put a message into the peer's [`Outbox`](super::Outbox).
    Send {
        /// To whom.
        peer: PeerId,
        /// What.
        message: Message,
    },
    /// The connection is a chunk connection: serve what it wants.
    ServeChunks {
        /// Which connection.
        peer: PeerId,
    },
    /// Write what waits, then close. The peer's number is forgotten.
    Close {
        /// Which connection.
        peer: PeerId,
        /// Why.
        bye: Bye,
    },
    /// The frame was released.
    FrameReleased(FrameReleased),
    /// A node says when it showed a frame.
    Shown {
        /// Which node.
        node: NodeIndex,
        /// Which frame and when, by the node's estimate of the time that `now` tells.
        shown: Shown,
    },
    /// A spare took the place of a node that is missing.
    StoodIn {
        /// The place.
        node: NodeIndex,
        /// What the spare calls itself.
        spare: String,
    },
    /// Another master says that it drives the wall with more live nodes. If that is so, this one is to stand by for it.
    Outnumbered {
        /// Its connection, which is closed next.
        peer: PeerId,
        /// Where it listens, at the address that the connection comes from.
        port: u16,
    },
    /// Call [`Master::begin_frame`](super::Master::begin_frame) with that number.
    WantFrame {
        /// The number.
        number: u64,
    },
    /// The show is over; all connections are closing.
    Finished,
}

/// Parts of the work on a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// What each view gains and loses.
    Diff,
    /// The bytes of messages.
    Encode,
}

/// A frame that was released.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameReleased {
    /// Its number.
    pub number: u64,
    /// When it was due, by the pace of the show.
    pub due: Duration,
    /// Time since it began.
    pub waited: Duration,
    /// Nodes that held it up and are not waited for any more.
    pub passed_over: Vec<NodeIndex>,
    /// Nodes that show it.
    pub shown_by: u32,
    /// What it spent, where the wall draws to a budget.
    pub spent: Option<Spent>,
}
