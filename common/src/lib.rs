//! Mullion's shared core. Pure: no sockets, no clock, no GPU.
pub mod camera_path;
pub mod contribution;
pub mod control;
pub mod geometry;
pub mod identity;
pub mod scene;
pub mod throughput;
#[cfg(feature = "tls")]
pub mod tls;
pub mod visible_set;
pub mod wall;
pub mod wire;
