//! Steering a show from outside: commands are checked where they come in, wait in a bounded queue, and are done between frames.
//!
//! ```text
//! http ──→ Inlet ── batches ──→ Driver (poses) ──→ LiveScene (sets) ──→ recorder
//!            └───── questions ────────────────────────↗
//! ```
//! No sockets but in [`http`]. A frame waits for none of it: it takes what is there, and what it gives out goes into memory that a
//! reader may miss.

mod board;
mod check;
mod driver;
mod grafter;
pub mod http;
mod live_scene;
mod queue;
mod why;

pub use board::Board;
pub use check::{Change, Checker, ControlError};
pub use driver::{Clock, Driver};
pub use grafter::{MAX_INSERTIONS, OnInserted};
pub use live_scene::LiveScene;
pub use queue::{Batches, Inlet, MAX_QUEUED, Questions, Subject, channel};
pub use why::{MAX_LEAVES_TOLD, Snapshot};
