//! Wall files: what a user writes, and the checks that turn it into a [`Wall`].

use std::collections::HashMap;

use glam::DVec3;
use serde::Deserialize;
use thiserror::Error;
use toml::Spanned;

use super::{Eye, Node, ObserverId, Screen, Tile, TileId, View, Wall};

/// Most tiles in a wall.
pub const MAX_TILES: u32 = 256;
const MAX_TILE_PX: u32 = 16_384;
const MAX_LENGTH_M: f64 = 10_000.0;
const MAX_NAME_BYTES: usize = 64;
const DEFAULT_RATE_HZ: f64 = 60.0;
const DEFAULT_NEAR_M: f64 = 0.05;
const DEFAULT_EYE_DISTANCE: f64 = 1.25;
/// Cosine of the greatest deviation from a right angle between a screen's edges, about 0.06°.
const MAX_SKEW: f64 = 1e-3;

/// A wall file (TOML). Lengths in metres, room space right-handed with Y up.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WallConfig {
    /// What the room is called.
    pub name: Option<String>,
    /// Frames a second, 1 to 1000; 60 if left out.
    pub rate_hz: Option<Spanned<f64>>,
    /// Distance of the near plane, 0.0001 to 100 m; 0.05 if left out.
    pub near_m: Option<Spanned<f64>>,
    /// Where the observer's eye is. May be left out beside `grid`: then it is in front of the middle.
    pub eye: Option<Spanned<[f64; 3]>>,
    /// Short form: one flat grid of equal tiles, facing +Z.
    pub grid: Option<Spanned<GridConfig>>,
    /// General form: any flat screens.
    #[serde(default)]
    pub screens: Vec<Spanned<ScreenConfig>>,
    /// Which process drives which tiles; a tile that none names is a node of its own, of the same name.
    #[serde(default)]
    pub nodes: Vec<Spanned<NodeConfig>>,
}

/// A flat grid of equal tiles.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridConfig {
    /// Tiles across.
    pub columns: Spanned<i64>,
    /// Tiles down.
    pub rows: Spanned<i64>,
    /// Pixels of a tile, width and height.
    pub tile_px: Spanned<[i64; 2]>,
    /// Visible size of a tile, width and height.
    pub tile_m: Spanned<[f64; 2]>,
    /// Gap between the visible areas of neighbours, across and down; none if left out.
    pub bezel_m: Option<Spanned<[f64; 2]>>,
    /// Middle of the wall; the room's origin if left out.
    pub center: Option<Spanned<[f64; 3]>>,
}

/// A flat screen by three corners, divided into a grid of tiles.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScreenConfig {
    /// Unique in the wall; the tile's name where the screen is one tile.
    pub name: Spanned<String>,
    /// Corner, as the observer sees it.
    pub bottom_left: Spanned<[f64; 3]>,
    /// Corner, as the observer sees it.
    pub bottom_right: Spanned<[f64; 3]>,
    /// Corner, as the observer sees it.
    pub top_left: Spanned<[f64; 3]>,
    /// Tiles across; 1 if left out.
    pub columns: Option<Spanned<i64>>,
    /// Tiles down; 1 if left out.
    pub rows: Option<Spanned<i64>>,
    /// Pixels of a tile, width and height.
    pub tile_px: Spanned<[i64; 2]>,
    /// Gap between the visible areas of neighbours, across and down; none if left out.
    pub bezel_m: Option<Spanned<[f64; 2]>>,
}

/// A process and the tiles that it drives.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodeConfig {
    /// Unique in the wall.
    pub name: Spanned<String>,
    /// Names of tiles.
    pub tiles: Spanned<Vec<Spanned<String>>>,
}

/// What is wrong with a wall file, and where.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("line {line}: {key}: {problem}")]
pub struct WallError {
    /// Line in the file, from 1.
    pub line: usize,
    /// The key that is wrong, as `screens.left.tile_px`; empty where the file is no TOML.
    pub key: String,
    /// What is wrong and what is allowed.
    pub problem: String,
}

/// A place in the file and the key that stands there.
struct At<'a> {
    text: &'a str,
    prefix: String,
}

impl At<'_> {
    fn error<T>(&self, spanned: &Spanned<T>, key: &str, problem: impl Into<String>) -> WallError {
        let key = [self.prefix.as_str(), key].into_iter().filter(|s| !s.is_empty()).collect::<Vec<_>>().join(".");
        WallError { line: line_of(self.text, spanned.span().start), key, problem: problem.into() }
    }

    fn under<'b>(&'b self, prefix: impl Into<String>) -> At<'b> {
        At { text: self.text, prefix: prefix.into() }
    }

    fn number(&self, key: &str, value: &Spanned<f64>, low: f64, high: f64) -> Result<f64, WallError> {
        let v = *value.get_ref();
        if (low..=high).contains(&v) { Ok(v) } else { Err(self.error(value, key, format!("{v} is outside {low} to {high}"))) }
    }

    fn count(&self, key: &str, value: &Spanned<i64>, high: u32) -> Result<u32, WallError> {
        let v = *value.get_ref();
        let in_range = u32::try_from(v).ok().filter(|n| (1..=high).contains(n));
        in_range.ok_or_else(|| self.error(value, key, format!("{v} is outside 1 to {high}")))
    }

    fn pixels(&self, value: &Spanned<[i64; 2]>) -> Result<[u32; 2], WallError> {
        let v = *value.get_ref();
        let fit = |n: i64| u32::try_from(n).ok().filter(|n| (1..=MAX_TILE_PX).contains(n));
        match (fit(v[0]), fit(v[1])) {
            (Some(width), Some(height)) => Ok([width, height]),
            _ => Err(self.error(value, "tile_px", format!("{v:?}: width and height must be 1 to {MAX_TILE_PX} pixels"))),
        }
    }

    fn point(&self, key: &str, value: &Spanned<[f64; 3]>) -> Result<DVec3, WallError> {
        let v = *value.get_ref();
        if v.iter().all(|c| c.abs() <= MAX_LENGTH_M) {
            Ok(DVec3::from(v))
        } else {
            Err(self.error(value, key, format!("{v:?}: coordinates must be -{MAX_LENGTH_M} to {MAX_LENGTH_M} m")))
        }
    }

    fn lengths(&self, key: &str, value: &Spanned<[f64; 2]>, low: f64) -> Result<[f64; 2], WallError> {
        let v = *value.get_ref();
        if v.iter().all(|c| (low..=MAX_LENGTH_M).contains(c)) {
            Ok(v)
        } else {
            Err(self.error(value, key, format!("{v:?}: lengths must be {low} to {MAX_LENGTH_M} m")))
        }
    }

    fn name(&self, value: &Spanned<String>) -> Result<String, WallError> {
        let name = value.get_ref();
        let allowed = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if name.is_empty() || name.len() > MAX_NAME_BYTES || !name.chars().all(allowed) || name.starts_with('.') {
            let rule = format!("1 to {MAX_NAME_BYTES} letters, digits, '-', '_' or '.', not starting with '.'");
            return Err(self.error(value, "name", format!("{name:?} is no name: {rule}")));
        }
        Ok(name.clone())
    }
}

fn line_of(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|&&b| b == b'\n').count()
}

impl WallConfig {
    /// Reads and checks a wall file.
    ///
    /// # Errors
    /// For text that is no TOML, unknown or missing keys, values out of range, screens that are mirrored, skewed or
    /// seen from behind, and names that stand twice or name nothing; with the line, the key and what is allowed.
    pub fn parse(text: &str) -> Result<Wall, WallError> {
        let config: Self = toml::from_str(text).map_err(|e| toml_error(text, &e))?;
        config.check(text)
    }

    fn check(&self, text: &str) -> Result<Wall, WallError> {
        let top = At { text, prefix: String::new() };
        let here = Spanned::new(0..0, ());
        let rate_hz = self.rate_hz.as_ref().map_or(Ok(DEFAULT_RATE_HZ), |v| top.number("rate_hz", v, 1.0, 1000.0))?;
        let near_m = self.near_m.as_ref().map_or(Ok(DEFAULT_NEAR_M), |v| top.number("near_m", v, 1e-4, 100.0))?;
        let given_eye = self.eye.as_ref().map(|v| top.point("eye", v)).transpose()?;
        let (screens, eye) = match (&self.grid, self.screens.as_slice()) {
            (Some(grid), []) => {
                let screen = grid_screen(&top.under("grid"), grid)?;
                let [bottom_left, bottom_right, top_left] = screen.corners;
                let in_front = DVec3::Z * (bottom_right - bottom_left).length() * DEFAULT_EYE_DISTANCE;
                let eye = given_eye.unwrap_or((bottom_right + top_left) * 0.5 + in_front);
                (vec![screen], eye)
            }
            (None, screens) if !screens.is_empty() => {
                let eye =
                    given_eye.ok_or_else(|| top.error(&here, "eye", "is missing: [x, y, z] in metres, where the observer is"))?;
                (checked_screens(&top, screens)?, eye)
            }
            (None, _) => return Err(top.error(&here, "grid", "is missing: a wall has a [grid] or one or more [[screens]]")),
            (Some(grid), _) => return Err(top.error(grid, "grid", "stands beside [[screens]]: a wall has one or the other")),
        };
        for (i, screen) in screens.iter().enumerate() {
            let (key, place) = match self.screens.get(i) {
                Some(config) => (format!("screens.{}.bottom_right", screen.name), config.get_ref().bottom_right.span()),
                None => ("eye".to_owned(), self.eye.as_ref().map_or(0..0, Spanned::span)),
            };
            check_seen_from(&screen.corners, eye, near_m)
                .map_err(|problem| top.error(&Spanned::new(place, ()), &key, problem))?;
        }
        let count: u32 = screens.iter().map(|s| s.grid[0] * s.grid[1]).sum();
        if count > MAX_TILES {
            let (key, place) = match (&self.grid, self.screens.last()) {
                (Some(grid), _) => ("grid", grid.span()),
                (None, last) => ("screens", last.map_or(0..0, Spanned::span)),
            };
            let problem = format!("{count} tiles in all, at most {MAX_TILES} are allowed");
            return Err(top.error(&Spanned::new(place, ()), key, problem));
        }
        let tiles = tiles_of(&screens);
        let mut names = HashMap::new();
        for (i, tile) in tiles.iter().enumerate() {
            if names.insert(tile.name.as_str(), i).is_some() {
                let place = self.screens.get(tile.screen).map_or(0..0, Spanned::span);
                return Err(top.error(&Spanned::new(place, ()), "screens", format!("two tiles are called {:?}", tile.name)));
            }
        }
        let nodes = self.nodes_of(&top, &tiles)?;
        let views = (0..tiles.len() as u16).map(|t| View { tile: TileId(t), observer: ObserverId(0), eye: Eye::Mono }).collect();
        let name = self.name.clone().unwrap_or_else(|| "wall".to_owned());
        Ok(Wall { name, rate_hz, near_m, eyes: vec![eye], screens, tiles, views, nodes })
    }

    fn nodes_of(&self, top: &At<'_>, tiles: &[Tile]) -> Result<Vec<Node>, WallError> {
        let mut driver: Vec<Option<usize>> = vec![None; tiles.len()];
        let mut nodes: Vec<Node> = Vec::new();
        for (i, spanned) in self.nodes.iter().enumerate() {
            let config = spanned.get_ref();
            let at = top.under("nodes");
            let name = at.name(&config.name)?;
            let at = top.under(format!("nodes.{name}"));
            if nodes.iter().any(|n| n.name == name) {
                return Err(at.error(&config.name, "name", format!("two nodes are called {name:?}")));
            }
            let mut driven = Vec::new();
            for tile_name in config.tiles.get_ref() {
                let Some(tile) = tiles.iter().position(|t| t.name == *tile_name.get_ref()) else {
                    let known = tiles.iter().take(4).map(|t| t.name.as_str()).collect::<Vec<_>>().join(", ");
                    return Err(at.error(
                        tile_name,
                        "tiles",
                        format!("{:?} is no tile; there are {known} …", tile_name.get_ref()),
                    ));
                };
                if driver[tile].replace(i).is_some() {
                    return Err(at.error(tile_name, "tiles", format!("{:?} is driven twice", tile_name.get_ref())));
                }
                driven.push(TileId(tile as u16));
            }
            if driven.is_empty() {
                return Err(at.error(&config.tiles, "tiles", "is empty: a node drives one tile or more"));
            }
            nodes.push(Node { name, tiles: driven });
        }
        for (i, tile) in tiles.iter().enumerate().filter(|(i, _)| driver[*i].is_none()) {
            if let Some(at) = nodes.iter().position(|n| n.name == tile.name) {
                let problem = format!("{:?} is also a tile that no node drives", tile.name);
                return Err(top.error(&self.nodes[at], "nodes", problem));
            }
            nodes.push(Node { name: tile.name.clone(), tiles: vec![TileId(i as u16)] });
        }
        Ok(nodes)
    }
}

fn toml_error(text: &str, error: &toml::de::Error) -> WallError {
    let message = error.message().lines().collect::<Vec<_>>().join(" ");
    let line = line_of(text, error.span().map_or(0, |s| s.start));
    let line_text = text.lines().nth(line - 1).unwrap_or("").trim();
    WallError { line, key: line_text.chars().take(60).collect(), problem: message }
}

fn grid_screen(at: &At<'_>, spanned: &Spanned<GridConfig>) -> Result<Screen, WallError> {
    let grid = spanned.get_ref();
    let columns = at.count("columns", &grid.columns, MAX_TILES)?;
    let rows = at.count("rows", &grid.rows, MAX_TILES)?;
    let tile_px = at.pixels(&grid.tile_px)?;
    let tile_m = at.lengths("tile_m", &grid.tile_m, 1e-4)?;
    let bezel_m = grid.bezel_m.as_ref().map_or(Ok([0.0; 2]), |v| at.lengths("bezel_m", v, 0.0))?;
    let center = grid.center.as_ref().map_or(Ok(DVec3::ZERO), |v| at.point("center", v))?;
    let side = |count: u32, axis: usize| f64::from(count) * tile_m[axis] + f64::from(count - 1) * bezel_m[axis];
    let (across, up) = (DVec3::X * side(columns, 0), DVec3::Y * side(rows, 1));
    let bottom_left = center - (across + up) * 0.5;
    let corners = [bottom_left, bottom_left + across, bottom_left + up];
    Ok(Screen { name: String::new(), corners, grid: [columns, rows], bezel_m, tile_px })
}

fn checked_screens(top: &At<'_>, configs: &[Spanned<ScreenConfig>]) -> Result<Vec<Screen>, WallError> {
    let mut screens: Vec<Screen> = Vec::new();
    for spanned in configs {
        let config = spanned.get_ref();
        let name = top.under("screens").name(&config.name)?;
        let at = top.under(format!("screens.{name}"));
        if screens.iter().any(|s| s.name == name) {
            return Err(at.error(&config.name, "name", format!("two screens are called {name:?}")));
        }
        let columns = config.columns.as_ref().map_or(Ok(1), |v| at.count("columns", v, MAX_TILES))?;
        let rows = config.rows.as_ref().map_or(Ok(1), |v| at.count("rows", v, MAX_TILES))?;
        let tile_px = at.pixels(&config.tile_px)?;
        let bezel_m = config.bezel_m.as_ref().map_or(Ok([0.0; 2]), |v| at.lengths("bezel_m", v, 0.0))?;
        let corners = [
            at.point("bottom_left", &config.bottom_left)?,
            at.point("bottom_right", &config.bottom_right)?,
            at.point("top_left", &config.top_left)?,
        ];
        let (across, up) = (corners[1] - corners[0], corners[2] - corners[0]);
        if across.length() < 1e-4 || up.length() < 1e-4 {
            return Err(at.error(
                &config.bottom_right,
                "bottom_right",
                "the corners coincide: a screen has a width and a height",
            ));
        }
        if across.normalize().dot(up.normalize()).abs() > MAX_SKEW {
            return Err(at.error(
                &config.top_left,
                "top_left",
                "the screen is no rectangle: its edges must meet at right angles",
            ));
        }
        let corners = squared(corners);
        let room_m = [across.length() - f64::from(columns - 1) * bezel_m[0], up.length() - f64::from(rows - 1) * bezel_m[1]];
        if let (Some(bezel), true) = (&config.bezel_m, room_m.iter().any(|m| *m <= 0.0)) {
            return Err(at.error(bezel, "bezel_m", "the bezels leave no room for tiles"));
        }
        screens.push(Screen { name, corners, grid: [columns, rows], bezel_m, tile_px });
    }
    Ok(screens)
}

/// Measured corners are never exactly square: the top left one moves so that they are, by less than [`MAX_SKEW`] of the
/// height. What is culled and what is drawn then have one shape.
fn squared([bottom_left, bottom_right, top_left]: [DVec3; 3]) -> [DVec3; 3] {
    let up = (top_left - bottom_left).reject_from(bottom_right - bottom_left);
    [bottom_left, bottom_right, bottom_left + up]
}

/// A screen must show its front to the eye, further away than the near plane.
pub(super) fn check_seen_from(corners: &[DVec3; 3], eye: DVec3, near_m: f64) -> Result<(), String> {
    let [bottom_left, bottom_right, top_left] = *corners;
    let towards_eye = (bottom_right - bottom_left).cross(top_left - bottom_left).normalize();
    let distance_m = (eye - bottom_left).dot(towards_eye);
    if distance_m < 0.0 {
        Err("is mirrored: seen from the eye, bottom_right is left of bottom_left. Swap the corners, or move the eye in front"
            .into())
    } else if distance_m <= near_m {
        Err(format!("is {distance_m:.4} m in front of the eye; it must be further away than near_m, {near_m} m"))
    } else {
        Ok(())
    }
}

fn tiles_of(screens: &[Screen]) -> Vec<Tile> {
    let mut tiles = Vec::new();
    for (index, screen) in screens.iter().enumerate() {
        let [columns, rows] = screen.grid;
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let grid_name = format!("t{column}x{row}");
            let name = match (screens.len(), columns * rows) {
                (1, 2..) => grid_name,
                (_, 1) if !screen.name.is_empty() => screen.name.clone(),
                (1, _) => grid_name,
                _ => format!("{}-{grid_name}", screen.name),
            };
            let corners = screen.tile_corners([column, row]);
            tiles.push(Tile { name, screen: index, place: [column, row], corners, size_px: screen.tile_px });
        }
    }
    tiles
}
