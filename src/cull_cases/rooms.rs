//! Random rooms: walls of every kind, and heads before them.

use std::fmt::Write;

use glam::DVec3;
use mullion_common::wall::{MAX_TILES, View, Wall, WallConfig};

use super::random::Random;

/// Half the distance between a head's two eyes, metres.
const HALF_EYES_M: f64 = 0.032;
const NEAR_M: f64 = 0.05;

/// A screen as a wall file has it.
#[derive(Clone)]
struct Screen {
    /// Bottom left, bottom right, top left, metres.
    corners: [DVec3; 3],
    grid: [u32; 2],
    bezel_m: f64,
}

/// What stands around the heads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Grid,
    Cave,
    Projectors,
}

/// Whose eyes look at it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Audience {
    Mono,
    Stereo,
    /// So many heads of one eye each.
    Heads(u32),
}

/// A wall and who looks at it. Each screen stands in the wall once for each eye.
pub struct Room {
    kind: Kind,
    audience: Audience,
    wall: Wall,
    /// Screens that each eye has.
    screens: usize,
    size_m: f64,
}

impl Room {
    /// A room with at most so many views.
    pub fn random(random: &mut Random, max_views: u32) -> Self {
        let heads = random.count(2, 4);
        let audience = random.pick(&[Audience::Mono, Audience::Mono, Audience::Stereo, Audience::Heads(heads)]);
        let eyes = match audience {
            Audience::Mono => 1,
            Audience::Stereo => 2,
            Audience::Heads(heads) => heads,
        };
        let max_tiles = (max_views.min(MAX_TILES) / eyes).max(1);
        let kind = if max_tiles < 4 { Kind::Grid } else { random.pick(&[Kind::Grid, Kind::Grid, Kind::Cave, Kind::Projectors]) };
        let screens = match kind {
            Kind::Grid => vec![grid(random, max_tiles)],
            Kind::Cave => cave(random, max_tiles),
            Kind::Projectors => projectors(random, max_tiles),
        };
        let corners = || screens.iter().flat_map(|s| s.corners);
        let size_m = corners().map(|c| c.abs().max_element()).fold(0.0, f64::max) * 2.0;
        let eye = if kind == Kind::Cave { DVec3::new(0.05, 0.02, 0.04) } else { DVec3::new(0.1, -0.2, 1.2) } * size_m;
        let mut text = format!("near_m = {NEAR_M}\neye = {}\n", array(eye));
        for (of_eye, (at, screen)) in (0..eyes).flat_map(|of_eye| screens.iter().enumerate().map(move |s| (of_eye, s))) {
            let [bottom_left, bottom_right, top_left] = screen.corners.map(array);
            let ([columns, rows], bezel_m) = (screen.grid, screen.bezel_m);
            let _ = write!(
                text,
                "[[screens]]\nname = \"e{of_eye}s{at}\"\nbottom_left = {bottom_left}\nbottom_right = {bottom_right}\n\
                 top_left = {top_left}\ncolumns = {columns}\nrows = {rows}\ntile_px = [64, 36]\nbezel_m = [{bezel_m}, {bezel_m}]\n"
            ); // a string takes all
        }
        let wall = WallConfig::parse(&text).expect("what is written here is a wall");
        Self { kind, audience, wall, screens: screens.len(), size_m }
    }

    /// What it is, for people.
    pub fn describe(&self) -> String {
        format!("{:?} of {} views, {:?}", self.kind, self.wall.views().len(), self.audience)
    }

    pub fn wall(&self) -> &Wall {
        &self.wall
    }

    /// Where the audience's eyes are, room space, by head or eye: anywhere before the wall, at times far to the side or close
    /// to it.
    pub fn heads(&self, random: &mut Random) -> Vec<DVec3> {
        match self.audience {
            Audience::Mono => vec![self.head(random)],
            Audience::Stereo => {
                let (head, across) = (self.head(random), random.turn() * DVec3::X * HALF_EYES_M);
                vec![head - across, head + across]
            }
            Audience::Heads(heads) => (0..heads).map(|_| self.head(random)).collect(),
        }
    }

    fn head(&self, random: &mut Random) -> DVec3 {
        match self.kind {
            Kind::Cave => random.point(0.4 * self.size_m),
            _ if random.chance(3) => {
                let near = random.magnitude(NEAR_M * 1.1, NEAR_M * 10.0);
                DVec3::new(random.between(-10.0, 10.0), random.between(-5.0, 5.0), near)
            }
            _ => random.point(0.5 * self.size_m) + DVec3::Z * self.size_m,
        }
    }

    /// The eye of each view, by `ViewId`. Where a head stands where the wall cannot be seen from, the wall file's eye.
    pub fn eyes(&self, heads: &[DVec3]) -> Vec<DVec3> {
        let defaults = self.wall.default_eyes();
        let eye = |(view, default): (&View, &DVec3)| {
            let head = heads[self.wall.tile(view.tile).screen / self.screens];
            if self.wall.check_eye(head).is_ok() { head } else { *default }
        };
        self.wall.views().iter().zip(&defaults).map(eye).collect()
    }
}

fn array(point: DVec3) -> String {
    format!("[{:?}, {:?}, {:?}]", point.x, point.y, point.z)
}

/// A flat grid in the plane z = 0, with bezels or without.
fn grid(random: &mut Random, max_tiles: u32) -> Screen {
    let columns = random.count(1, max_tiles.min(16));
    let rows = random.count(1, (max_tiles / columns).min(16));
    let tile_m = random.magnitude(0.1, 2.0);
    let bezel_m = if random.chance(2) { 0.0 } else { tile_m * random.between(0.0, 0.2) };
    let side = |count: u32, tile_m: f64| f64::from(count) * tile_m + f64::from(count - 1) * bezel_m;
    let (across, up) = (DVec3::X * side(columns, tile_m), DVec3::Y * side(rows, tile_m * 0.5625));
    let bottom_left = (across + up) * -0.5;
    Screen { corners: [bottom_left, bottom_left + across, bottom_left + up], grid: [columns, rows], bezel_m }
}

/// Three to six walls of a cube about the origin.
fn cave(random: &mut Random, max_tiles: u32) -> Vec<Screen> {
    // Inwards and up, of left, front, right, floor, back, ceiling.
    let walls = [
        (DVec3::X, DVec3::Y),
        (DVec3::Z, DVec3::Y),
        (-DVec3::X, DVec3::Y),
        (DVec3::Y, -DVec3::Z),
        (-DVec3::Z, DVec3::Y),
        (-DVec3::Y, DVec3::Z),
    ];
    let count = random.count(3, max_tiles.min(6));
    let parts = f64::from(max_tiles / count).sqrt() as u32;
    let grid = [random.count(1, parts.min(4)), random.count(1, parts.min(4))];
    let half_m = random.magnitude(0.8, 3.0);
    let screen = |(inwards, up): &(DVec3, DVec3)| {
        let right = up.cross(*inwards);
        let at = |x: f64, y: f64| (right * x + *up * y - *inwards) * half_m;
        Screen { corners: [at(-1.0, -1.0), at(1.0, -1.0), at(-1.0, 1.0)], grid, bezel_m: 0.0 }
    };
    walls[..count as usize].iter().map(screen).collect()
}

/// Projectors on one plane that overlap their neighbours.
fn projectors(random: &mut Random, max_tiles: u32) -> Vec<Screen> {
    let columns = random.count(1, max_tiles.min(6));
    let rows = random.count(1, (max_tiles / columns).min(4));
    let (width_m, height_m) = (random.magnitude(0.5, 3.0), random.magnitude(0.5, 2.0));
    let step = |random: &mut Random, size_m: f64| size_m * random.between(0.45, 0.95);
    let (step_x, step_y) = (step(random, width_m), step(random, height_m));
    let screen = |column: u32, row: u32| {
        let at = |x: f64, y: f64| {
            DVec3::new(
                (f64::from(column) - f64::from(columns) * 0.5) * step_x + x * width_m,
                (f64::from(row) - f64::from(rows) * 0.5) * step_y + y * height_m,
                0.0,
            )
        };
        Screen { corners: [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)], grid: [1, 1], bezel_m: 0.0 }
    };
    (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))).map(|(c, r)| screen(c, r)).collect()
}
