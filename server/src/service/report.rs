//! What whoever runs a show is told of it.

use std::net::SocketAddr;
use std::time::Duration;

use mullion_common::wire::Stats;

use crate::master::Spent;
use crate::swap_barrier::{NodeIndex, Standing};

/// A node comes or goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeEvent {
    /// Its connection was greeted.
    #[allow(missing_docs)]
    Joined { node: String, address: SocketAddr },
    /// Its connection is gone, for a reason of one line. The show goes on.
    #[allow(missing_docs)]
    Left { node: String, reason: String },
    /// A spare took the place of a node that is missing.
    #[allow(missing_docs)]
    StoodIn { node: String, spare: String },
    /// This master stands by for another.
    #[allow(missing_docs)]
    StandingBy { master: String },
    /// The other master is gone: this one goes on from a frame.
    #[allow(missing_docs)]
    TookOver { master: String, frame: u64, reason: String },
    /// Another master drives the wall: this one sends its nodes there, and stands by.
    #[allow(missing_docs)]
    SteppedBack { master: String, reason: String },
}

/// What happened in one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// Its number.
    pub number: u64,
    /// When it was due by the rate of the show, since the show's start: the clock of [`Shown::at_us`].
    pub due: Duration,
    /// Time for the cull.
    pub cull: Duration,
    /// Time to find the deltas.
    pub diff: Duration,
    /// Time to encode and queue them.
    pub encode: Duration,
    /// Time spent writing messages since the frame before was released.
    pub send: Duration,
    /// Time from the frame's beginning to its release.
    pub waited: Duration,
    /// Bytes of each node's frame message, by `NodeIndex`; 0 for nodes that are not connected.
    pub frame_bytes: Vec<u32>,
    /// What each node last said of itself, by `NodeIndex`.
    pub node_stats: Vec<Stats>,
    /// Nodes that held it up and are not waited for any more.
    pub passed_over: Vec<NodeIndex>,
    /// What each node is to the barrier, by `NodeIndex`.
    pub standings: Vec<Standing>,
    /// Objects that no tile draws in it, though some see them: they hardly contribute.
    pub dropped_objects: u32,
    /// What it spent, where the wall draws to a budget.
    pub spent: Option<Spent>,
    /// Nodes connected.
    pub connected: u32,
    /// Nodes that were told to show it.
    pub shown_by: u32,
    /// Bytes of blobs sent since the show began.
    pub chunk_bytes: u64,
    /// Most messages that waited for one peer since the frame before was released; [`MAX_WAITING`](crate::master::MAX_WAITING) at most.
    pub longest_queue: u32,
    /// Connections that are open, whoever is behind them.
    pub open: u32,
}

/// What happened in a show.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShowReport {
    /// Frames released.
    pub frames: u64,
    /// How often each node was passed over, by `NodeIndex`.
    pub passed_over: Vec<u64>,
    /// Connections that were closed for what they said or did not say.
    pub refused: u64,
    /// Bytes of blobs sent.
    pub chunk_bytes: u64,
}

impl ShowReport {
    /// Adds what happened in another turn of the same master.
    pub(super) fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        self.passed_over.resize(self.passed_over.len().max(other.passed_over.len()), 0);
        self.passed_over.iter_mut().zip(&other.passed_over).for_each(|(sum, more)| *sum += more);
        self.refused += other.refused;
        self.chunk_bytes += other.chunk_bytes;
    }
}
