//! Mullion's tile: receives what it can see, draws it, and shows it when all tiles do.
//!
//! ```text
//! node ──→ tile_session   what the master says, as orders to a painter
//!   └────→ gpu_painter ──→ frame   what to draw, as plain data
//!              └─────────→ gpu     drawn
//! ```

mod connection;
mod detailing;
pub mod disk_cache;
mod estimating;
pub mod frame;
pub mod gpu;
pub mod gpu_painter;
pub mod hierarchies;
pub mod lod;
pub mod master_clock;
pub mod missing;
pub mod motion;
pub mod node;
pub mod occlusion;
pub mod output;
pub mod parts;
pub mod plp;
pub mod prefetch;
pub mod protocol_node;
pub mod residency;
pub mod tile_session;
mod transport;
