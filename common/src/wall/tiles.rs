//! A checked wall: screens, tiles, views and the nodes that drive them.

use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

use super::Projection;
use super::config::check_seen_from;
use super::projection::{pixels_per_radian, world_frustum};
use crate::geometry::Frustum;

/// A tile's number in its wall: in the order of screens, row-major from the top left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TileId(pub u16);

/// An observer's number in its wall: one head.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ObserverId(pub u16);

/// A view's number in its wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ViewId(pub u16);

/// Which eye of an observer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs)]
pub enum Eye {
    Mono,
    Left,
    Right,
}

/// A flat physical surface, given by three corners in room space.
#[derive(Clone, Debug, PartialEq)]
pub struct Screen {
    /// Unique in its wall.
    pub name: String,
    /// Bottom left, bottom right, top left as its observer sees them, metres.
    pub corners: [DVec3; 3],
    /// Tiles across and down.
    pub grid: [u32; 2],
    /// Gap between the visible areas of neighbouring tiles, metres.
    pub bezel_m: [f64; 2],
    /// Pixels of each tile.
    pub tile_px: [u32; 2],
}

/// One rendered panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Unique in its wall: `t{column}x{row}` in a grid.
    pub name: String,
    /// Index of its screen.
    pub screen: usize,
    /// Column and row on its screen, from the top left.
    pub place: [u32; 2],
    /// Bottom left, bottom right, top left of its visible area in room space, metres.
    pub corners: [DVec3; 3],
    /// Width and height, pixels.
    pub size_px: [u32; 2],
}

/// What one eye of one observer sees through one tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct View {
    pub tile: TileId,
    pub observer: ObserverId,
    pub eye: Eye,
}

/// A process that drives tiles.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub struct Node {
    pub name: String,
    pub tiles: Vec<TileId>,
}

/// A checked wall. Comes from [`super::WallConfig::check`] only.
#[derive(Clone, Debug, PartialEq)]
pub struct Wall {
    pub(super) name: String,
    pub(super) rate_hz: f64,
    pub(super) near_m: f64,
    pub(super) eyes: Vec<DVec3>,
    pub(super) screens: Vec<Screen>,
    pub(super) tiles: Vec<Tile>,
    pub(super) views: Vec<View>,
    pub(super) nodes: Vec<Node>,
}

impl Wall {
    /// What the room is called.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Frames a second that the wall aims at.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Distance from the eye to the near plane, metres of the room.
    pub fn near_m(&self) -> f64 {
        self.near_m
    }

    /// All screens.
    pub fn screens(&self) -> &[Screen] {
        &self.screens
    }

    /// All tiles, by `TileId`.
    pub fn tiles(&self) -> &[Tile] {
        &self.tiles
    }

    /// The tile with that id.
    pub fn tile(&self, id: TileId) -> &Tile {
        &self.tiles[usize::from(id.0)]
    }

    /// The tile of that name.
    pub fn tile_named(&self, name: &str) -> Option<TileId> {
        self.tiles.iter().position(|t| t.name == name).map(|i| TileId(i as u16))
    }

    /// All views, by `ViewId`, in the order of their tiles.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// The views of a tile.
    pub fn views_of(&self, tile: TileId) -> impl Iterator<Item = ViewId> + '_ {
        let of_tile = move |(i, v): (usize, &View)| (v.tile == tile).then_some(ViewId(i as u16));
        self.views.iter().enumerate().filter_map(of_tile)
    }

    /// All nodes.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Where each view's eye is while no head is tracked: room space, metres, by `ViewId`.
    pub fn default_eyes(&self) -> Vec<DVec3> {
        self.views.iter().map(|v| self.eyes[usize::from(v.observer.0)]).collect()
    }

    /// Whether an observer may stand at `eye` (room space): in front of every screen, further away than the near plane.
    ///
    /// # Errors
    /// Names the screen that the eye is behind or too near.
    pub fn check_eye(&self, eye: DVec3) -> Result<(), String> {
        let check = |screen: &Screen| {
            check_seen_from(&screen.corners, eye, self.near_m).map_err(|problem| match screen.name.as_str() {
                "" => format!("the wall {problem}"),
                name => format!("screen {name} {problem}"),
            })
        };
        self.screens.iter().try_for_each(check)
    }

    /// Of how many pixels a length is, on the wall's finest tile, that is as far from an eye (room space, before the wall) as it is long: above 0.
    pub fn pixels_per_radian(&self, eye: DVec3) -> f64 {
        self.tiles.iter().map(|tile| pixels_per_radian(eye, tile.corners, tile.size_px)).fold(f64::MIN_POSITIVE, f64::max)
    }

    /// What a view sees, in the world. `eye` in room space.
    pub fn frustum(&self, view: ViewId, eye: DVec3, world_from_room: &DAffine3) -> Frustum {
        let tile = self.tile(self.views[usize::from(view.0)].tile);
        world_frustum(eye, tile.corners, self.near_m, world_from_room)
    }

    /// How a view projects. `eye` in room space.
    pub fn projection(&self, view: ViewId, eye: DVec3, world_from_room: &DAffine3) -> Projection {
        let tile = self.tile(self.views[usize::from(view.0)].tile);
        Projection::through_rectangle(eye, tile.corners, self.near_m, world_from_room)
    }
}

impl Screen {
    /// Bottom left, bottom right, top left of the tile at `[column, row]`, from the top left.
    pub fn tile_corners(&self, [column, row]: [u32; 2]) -> [DVec3; 3] {
        let [bottom_left, bottom_right, top_left] = self.corners;
        let (across, up) = (bottom_right - bottom_left, top_left - bottom_left);
        let share = |axis: usize, length_m: f64, index: u32| {
            let count = f64::from(self.grid[axis]);
            let tile_m = (length_m - (count - 1.0) * self.bezel_m[axis]) / count;
            let start_m = f64::from(index) * (tile_m + self.bezel_m[axis]);
            // Without bezels a tile ends exactly where the next one starts.
            let end_m = if self.bezel_m[axis] == 0.0 { f64::from(index + 1) * tile_m } else { start_m + tile_m };
            (start_m / length_m, end_m / length_m)
        };
        let (left, right) = share(0, across.length(), column);
        let (bottom, top) = share(1, up.length(), self.grid[1] - 1 - row);
        [
            bottom_left + across * left + up * bottom,
            bottom_left + across * right + up * bottom,
            bottom_left + across * left + up * top,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::super::WallConfig;
    use super::*;

    #[test]
    fn the_finest_tile_is_the_one_whose_pixels_are_smallest_from_where_the_eye_is() {
        let text = "eye = [0.0, 1.0, 0.0]\n\n[[screens]]\nname = \"coarse\"\nbottom_left = [-1.0, 0.0, -1.0]\nbottom_right = [1.0, 0.0, -1.0]\n\
                    top_left = [-1.0, 2.0, -1.0]\ntile_px = [100, 50]\n\n[[screens]]\nname = \"fine\"\nbottom_left = [3.0, 0.0, -1.0]\n\
                    bottom_right = [3.0, 0.0, 1.0]\ntop_left = [3.0, 2.0, -1.0]\ntile_px = [40, 60]\n";
        let wall = WallConfig::parse(text).expect("a wall");
        let from = |x: f64, z: f64| wall.pixels_per_radian(DVec3::new(x, 1.0, z));
        assert!((from(0.0, 0.0) - 3.0 * 60.0 / 2.0).abs() < 1e-9, "it is three metres away, with 30 rows a metre");
        assert!((from(2.9, 0.0) - 1.0 * 100.0 / 2.0).abs() < 1e-9, "now the other is finer");
        assert!(from(3.0, -1.0) > 0.0, "in both planes");
    }
}
