//! One screen as one tile or as several, and its pictures.

use std::collections::BTreeMap;

use image::RgbaImage;
use mullion_common::wall::{ViewId, Wall, WallConfig};
use mullion_common::wire::ViewSpec;

/// Width and height of a tile, where the wall has two by two.
pub const TILE_PX: [u32; 2] = [80, 60];

/// The same screen as so many tiles each way, without bezels.
pub fn wall(tiles: u32) -> Wall {
    let [width, height] = TILE_PX.map(|edge| edge * 2 / tiles);
    let (across, up) = (4.0 / f64::from(tiles), 3.0 / f64::from(tiles));
    let text =
        format!("[grid]\ncolumns = {tiles}\nrows = {tiles}\ntile_px = [{width}, {height}]\ntile_m = [{across:?}, {up:?}]\n");
    WallConfig::parse(&text).expect("a valid wall")
}

/// A wall's views, as a node is told of them.
pub fn specs(wall: &Wall) -> Vec<ViewSpec> {
    (0..wall.views().len() as u16).map(|view| ViewSpec::of(wall, ViewId(view))).collect()
}

/// How many pixels differ.
pub fn differing(a: &RgbaImage, b: &RgbaImage) -> usize {
    a.pixels().zip(b.pixels()).filter(|(a, b)| a != b).count()
}

/// The pictures of two by two tiles as one.
pub fn composite(wall: &Wall, pictures: &BTreeMap<String, RgbaImage>) -> RgbaImage {
    let mut all = RgbaImage::new(TILE_PX[0] * 2, TILE_PX[1] * 2);
    for (at, tile) in (0..).zip(wall.tiles()) {
        let (column, row) = (at % 2, at / 2);
        image::imageops::replace(&mut all, &pictures[&tile.name], column * i64::from(TILE_PX[0]), row * i64::from(TILE_PX[1]));
    }
    all
}

/// The picture of a wall that is one tile.
pub fn only(pictures: &BTreeMap<String, RgbaImage>) -> RgbaImage {
    pictures.values().next().cloned().expect("a tile")
}
