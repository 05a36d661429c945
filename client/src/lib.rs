//! Mullion's tile.
pub mod frame;
pub mod gpu;
pub mod node;
pub mod output;
pub mod residency;
pub mod tile_session;
