//! The wall as one picture: its tiles where they stand, bezels between them.

use anyhow::{Result, ensure};
use glam::DVec3;
use image::{Rgba, RgbaImage};
use mullion_common::wall::{Screen, Wall};

/// A tile's place in the picture, pixels from the top left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileRect {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

/// Where each tile stands in a picture of the wall.
pub struct WallLayout {
    /// Width and height of the picture.
    pub size_px: [u32; 2],
    /// By `TileId`.
    pub tiles: Vec<TileRect>,
}

/// Most pixels in a picture of a wall: 256 tiles of 1024 x 1024.
const MAX_PICTURE_PX: u64 = 1 << 28;
const BEZEL: Rgba<u8> = Rgba([12, 12, 14, 255]);
/// Between screens that do not lie in one plane.
const SCREEN_GAP_PX: i64 = 12;

impl WallLayout {
    /// Lays out a wall: screens in one plane as they stand, others side by side, and so those that stand far apart.
    ///
    /// # Errors
    /// When the picture would have more than [`MAX_PICTURE_PX`] pixels.
    pub fn new(wall: &Wall) -> Result<Self> {
        let first = &wall.screens()[0];
        let flat = wall.screens().iter().all(|s| same_plane(first, s)).then(|| Self::placed(wall, &places_in_plane(wall)));
        let layout = match flat {
            Some(flat) if flat.pixels() <= MAX_PICTURE_PX => flat,
            _ => Self::placed(wall, &places_in_a_row(wall)),
        };
        let [width, height] = layout.size_px;
        ensure!(
            layout.pixels() <= MAX_PICTURE_PX,
            "a picture of the wall has {width} x {height} pixels: more than {MAX_PICTURE_PX}"
        );
        Ok(layout)
    }

    fn pixels(&self) -> u64 {
        u64::from(self.size_px[0]) * u64::from(self.size_px[1])
    }

    fn placed(wall: &Wall, places: &[[i64; 2]]) -> Self {
        let least = |axis: usize| places.iter().map(|p| p[axis]).min().unwrap_or(0);
        let corner = [least(0), least(1)];
        let tiles: Vec<TileRect> = places
            .iter()
            .zip(wall.tiles())
            .map(|(place, tile)| TileRect {
                x: u32::try_from(place[0] - corner[0]).unwrap_or(u32::MAX),
                y: u32::try_from(place[1] - corner[1]).unwrap_or(u32::MAX),
                width: tile.size_px[0],
                height: tile.size_px[1],
            })
            .collect();
        let far = |end: fn(&TileRect) -> u32| tiles.iter().map(end).max().unwrap_or(1);
        Self { size_px: [far(|t| t.x.saturating_add(t.width)), far(|t| t.y.saturating_add(t.height))], tiles }
    }

    /// The picture with the tiles' pictures in their places; a tile without one stays dark.
    pub fn compose(&self, pictures: &[Option<RgbaImage>]) -> RgbaImage {
        let mut wall = RgbaImage::from_pixel(self.size_px[0], self.size_px[1], BEZEL);
        for (rect, picture) in self.tiles.iter().zip(pictures) {
            if let Some(picture) = picture {
                image::imageops::replace(&mut wall, picture, i64::from(rect.x), i64::from(rect.y));
            }
        }
        wall
    }
}

/// Top left corners of the tiles of screens that lie in one plane.
fn places_in_plane(wall: &Wall) -> Vec<[i64; 2]> {
    let first = &wall.screens()[0];
    let px_per_m = px_per_m(first);
    let [origin, right_corner, top_corner] = first.corners;
    let (right, up) = ((right_corner - origin).normalize(), (top_corner - origin).normalize());
    let place = |top_left: DVec3| [top_left.dot(right) * px_per_m[0], -top_left.dot(up) * px_per_m[1]];
    wall.tiles().iter().map(|tile| place(tile.corners[2] - origin).map(|v| v.round() as i64)).collect()
}

/// Top left corners of the tiles of screens side by side.
fn places_in_a_row(wall: &Wall) -> Vec<[i64; 2]> {
    let mut places = Vec::with_capacity(wall.tiles().len());
    let mut left = 0;
    for (index, screen) in wall.screens().iter().enumerate() {
        let px_per_m = px_per_m(screen);
        let bezel_px = [0, 1].map(|axis| (screen.bezel_m[axis] * px_per_m[axis]).round() as i64);
        let step = [0, 1].map(|axis| i64::from(screen.tile_px[axis]) + bezel_px[axis]);
        for tile in wall.tiles().iter().filter(|t| t.screen == index) {
            places.push([left + i64::from(tile.place[0]) * step[0], i64::from(tile.place[1]) * step[1]]);
        }
        left += i64::from(screen.grid[0]) * step[0] - bezel_px[0] + SCREEN_GAP_PX;
    }
    places
}

fn px_per_m(screen: &Screen) -> [f64; 2] {
    let [bottom_left, bottom_right, top_left] = screen.tile_corners([0, 0]);
    let lengths_m = [(bottom_right - bottom_left).length(), (top_left - bottom_left).length()];
    [0, 1].map(|axis| f64::from(screen.tile_px[axis]) / lengths_m[axis])
}

fn same_plane(a: &Screen, b: &Screen) -> bool {
    let normal = |s: &Screen| (s.corners[1] - s.corners[0]).cross(s.corners[2] - s.corners[0]).normalize();
    let right = |s: &Screen| (s.corners[1] - s.corners[0]).normalize();
    let offset: DVec3 = b.corners[0] - a.corners[0];
    normal(a).dot(normal(b)) > 1.0 - 1e-9 && right(a).dot(right(b)) > 1.0 - 1e-9 && offset.dot(normal(a)).abs() < 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;
    use mullion_common::wall::WallConfig;

    fn layout(file: &str) -> WallLayout {
        let text = std::fs::read_to_string(format!("{}/configs/{file}", env!("CARGO_MANIFEST_DIR"))).expect("it ships");
        WallLayout::new(&WallConfig::parse(&text).expect("a wall")).expect("it fits a picture")
    }

    #[test]
    fn walls_are_laid_out_as_they_stand() {
        let wall = layout("wall_4x4.toml");
        assert_eq!(wall.size_px, [4 * 480 + 3 * 5, 4 * 270 + 3 * 5]);
        assert_eq!((wall.tiles[5].x, wall.tiles[5].y), (485, 275), "tile t1x1");
        let projectors = layout("projectors_3x2.toml");
        assert_eq!((projectors.tiles[1].x, projectors.tiles[1].y), (576, 0), "overlaps its neighbour by 64 pixels");
        let cave = layout("cave_4.toml");
        assert_eq!(cave.size_px, [4 * 720 + 3 * 12, 720]);
    }
}
