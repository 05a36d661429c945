//! Walls: as written ([`WallConfig`]), checked ([`Wall`]), and seen from an eye ([`Projection`]).
//!
//! Room space is fixed: metres, right-handed, Y up. The camera moves the room (`world_from_room`), the head moves
//! the eye in the room.

mod config;
mod projection;
mod tiles;

pub use config::{GridConfig, MAX_TILES, NodeConfig, ScreenConfig, WallConfig, WallError};
pub use projection::{Projection, pixels_per_radian};
pub use tiles::{Eye, Node, ObserverId, Screen, Tile, TileId, View, ViewId, Wall};
