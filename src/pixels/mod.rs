//! Compares pictures: tiles drawn from visible sets with tiles drawn from everything, the wall with one picture, and tiles drawn with
//! occlusion culling with the same without.

mod occlusion;

use std::collections::HashSet;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, anyhow};
use glam::{DAffine3, DQuat, DVec3};
use image::{Rgba, RgbaImage};
use mullion_client::frame::Planner;
use mullion_client::gpu::{Attachments, Gpu, Renderer, ViewTarget};
use mullion_client::occlusion::Occlusion;
use mullion_client::output::headless::write_png;
use mullion_common::scene::Package;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{Projection, ViewId, Wall, WallConfig};
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::tree::CullTree;
use serde::Serialize;

use self::occlusion::OcclusionVerdict;
use crate::camera::{Subject, Walk};
use crate::drawn;

/// Size of the wall in all grids: divisible by their columns and rows.
const WALL_PX: [u32; 2] = [480, 288];
const WALL_M: [f64; 2] = [3.2, 1.92];
/// A channel may differ by this much before a pixel counts as different.
const CHANNEL_TOLERANCE: u8 = 2;
/// At most so many of a wall's pixels may differ from one picture of the whole: those at edges of triangles.
const MAX_DIFFERING_PERCENT: f64 = 0.1;

/// Columns and rows of a wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    pub columns: u32,
    pub rows: u32,
}

impl Grid {
    /// Reads `4x4`.
    pub fn parse(text: &str) -> Result<Self, String> {
        let parsed = text.split_once('x').and_then(|(c, r)| Some((c.parse::<u32>().ok()?, r.parse::<u32>().ok()?)));
        match parsed {
            Some((columns @ 1..=16, rows @ 1..=16)) => Ok(Self { columns, rows }),
            _ => Err(format!("{text:?} is no grid: columns x rows, each 1 to 16, as in 4x4")),
        }
    }

    /// The wall of [`WALL_PX`] divided into this grid, which must divide it.
    pub fn wall(self) -> Result<Wall> {
        let (columns, rows) = (self.columns, self.rows);
        let (width, height) = (WALL_PX[0] / columns, WALL_PX[1] / rows);
        if width * columns != WALL_PX[0] || height * rows != WALL_PX[1] {
            return Err(anyhow!("a grid of {columns}x{rows} does not divide {} x {} pixels", WALL_PX[0], WALL_PX[1]));
        }
        let (tile_w, tile_h) = (WALL_M[0] / f64::from(columns), WALL_M[1] / f64::from(rows));
        let text = format!(
            "[grid]\ncolumns = {columns}\nrows = {rows}\ntile_px = [{width}, {height}]\ntile_m = [{tile_w:?}, {tile_h:?}]\n"
        );
        WallConfig::parse(&text).map_err(|e| anyhow!("{e}"))
    }
}

impl fmt::Display for Grid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.columns, self.rows)
    }
}

/// What was found for one scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneVerdict {
    pub scene: String,
    pub leaves: u32,
    pub eyes: u32,
    /// Objects seen in the pictures of the whole wall, summed over the eyes.
    pub objects_seen: u32,
    /// Tiles drawn twice, over all grids and eyes.
    pub tiles_compared: u32,
    /// Mean share of leaves that a tile's set leaves out.
    pub culled_percent: f64,
    /// Tiles whose colours or objects are not the same, bit for bit.
    pub tiles_that_differ: u32,
    /// Over all walls, the greatest share of pixels that differ by more than 2/255 from one picture of the whole.
    pub worst_differing_percent: f64,
    /// Objects of at least 2 × 2 pixels in one picture that the other lacks within one pixel.
    pub objects_missing: u32,
    /// Of each way of occlusion culling.
    pub occlusion: Vec<OcclusionVerdict>,
}

impl SceneVerdict {
    /// Whether no culling changed a picture.
    pub fn holds(&self) -> bool {
        self.frustum_holds() && self.occlusion.iter().all(OcclusionVerdict::holds)
    }

    /// Whether culling to frusta changed none.
    pub fn frustum_holds(&self) -> bool {
        self.tiles_that_differ == 0 && self.worst_differing_percent <= MAX_DIFFERING_PERCENT && self.objects_missing == 0
    }
}

/// How to verify.
pub struct Check<'a> {
    pub grids: &'a [Grid],
    pub algorithm: Algorithm,
    /// Ways to leave out what is hidden, each held against drawing it.
    pub occlusion: &'a [Occlusion],
    /// Where pictures go.
    pub pictures: Option<&'a Path>,
}

/// A picture and the objects in it.
struct Picture {
    color: RgbaImage,
    /// Row-major; 0 for none.
    ids: Vec<u32>,
}

impl Picture {
    /// How many pixels are not the same, in colour or object. Both must be of one size.
    fn differing_from(&self, other: &Self) -> u64 {
        let colors = self.color.pixels().zip(other.color.pixels()).map(|(a, b)| a != b);
        let ids = self.ids.iter().zip(&other.ids).map(|(a, b)| a != b);
        colors.zip(ids).filter(|(color, id)| *color || *id).count() as u64
    }
}

/// An eye and a room.
struct Pose {
    name: &'static str,
    eye: DVec3,
    world_from_room: DAffine3,
}

/// Draws a scene on walls of all grids from several eyes, one of them inside the scene.
pub fn verify(gpu: &Arc<Gpu>, name: &str, package: &Package, check: &Check<'_>) -> Result<SceneVerdict> {
    let Check { grids, algorithm, occlusion: ways, pictures } = *check;
    let leaves = package.scene.leaf_count();
    let whole_wall = Grid { columns: 1, rows: 1 }.wall()?;
    let poses = poses(package, &whole_wall)?;
    let mut verdict = SceneVerdict {
        scene: name.to_owned(),
        leaves,
        eyes: poses.len() as u32,
        objects_seen: 0,
        tiles_compared: 0,
        culled_percent: 0.0,
        tiles_that_differ: 0,
        worst_differing_percent: 0.0,
        objects_missing: 0,
        occlusion: ways.iter().copied().map(OcclusionVerdict::new).collect(),
    };
    let mut painter = Painter::new(gpu, package, grids)?;
    let all = VisibleSet::all(leaves);
    let tree = CullTree::new(Arc::clone(&package.scene.hierarchy));
    let mut visible_pairs = 0u64;
    for pose in &poses {
        let projection = |wall: &Wall, view: u16| wall.projection(ViewId(view), pose.eye, &pose.world_from_room);
        let whole = painter.draw(Painter::WHOLE, projection(&whole_wall, 0), &all)?;
        verdict.objects_seen += whole.ids.iter().filter(|id| **id != 0).collect::<HashSet<_>>().len() as u32;
        if let Some(folder) = pictures {
            write_png(&folder.join(format!("{name}-{}.png", pose.name)), &whole.color)?;
        }
        for (target, grid) in grids.iter().enumerate() {
            let wall = grid.wall()?;
            let mut sets = vec![VisibleSet::default(); wall.views().len()];
            let eyes = vec![pose.eye; wall.views().len()];
            Culler::new(algorithm, &wall).cull(&tree, &wall, &eyes, &pose.world_from_room, &mut sets);
            let mut composite = Composite::new();
            for (view, set) in sets.iter().enumerate() {
                let target = ViewId(target as u16 + 1);
                let culled = painter.draw(target, projection(&wall, view as u16), set)?;
                let uncut = painter.draw(target, projection(&wall, view as u16), &all)?;
                let same = culled.color.as_raw() == uncut.color.as_raw() && culled.ids == uncut.ids;
                verdict.tiles_compared += 1;
                verdict.tiles_that_differ += u32::from(!same);
                visible_pairs += u64::from(set.len());
                composite.place(&culled, wall.tile(wall.views()[view].tile).place);
            }
            let differing = differing_percent(&composite.0.color, &whole.color);
            let missing = missing_objects(&composite.0.ids, &whole.ids) + missing_objects(&whole.ids, &composite.0.ids);
            verdict.worst_differing_percent = verdict.worst_differing_percent.max(differing);
            verdict.objects_missing += missing;
            let stem = format!("{name}-{}-{grid}", pose.name);
            if let (Some(folder), true) = (pictures, missing > 0 || differing > MAX_DIFFERING_PERCENT) {
                write_png(&folder.join(format!("{stem}-composite.png")), &composite.0.color)?;
                write_png(
                    &folder.join(format!("{stem}-difference.png")),
                    &difference(&composite.0.color, &whole.color, CHANNEL_TOLERANCE),
                )?;
            }
            if !ways.is_empty() {
                let subject = occlusion::Subject { wall: &wall, target: ViewId(target as u16 + 1), tree: &tree, algorithm, pose };
                let pictures = pictures.map(|folder| (folder, stem.as_str()));
                occlusion::check(&mut painter, &subject, ways, &mut verdict.occlusion, pictures)?;
            }
        }
    }
    let pairs = u64::from(verdict.tiles_compared) * u64::from(leaves);
    verdict.culled_percent = if pairs == 0 { 0.0 } else { 100.0 - 100.0 * visible_pairs as f64 / pairs as f64 };
    Ok(verdict)
}

/// From outside with all in view, from close with the eye far off the wall's axis, from inside the scene, and from the
/// middle of a leaf.
fn poses(package: &Package, wall: &Wall) -> Result<Vec<Pose>> {
    let front = wall.default_eyes()[0];
    let aside = front + DVec3::new(2.9, -1.3, -3.0);
    let subject = Subject::of(package);
    let orbit = Walk::Orbit.path(package, wall, Some(10))?;
    // The room turned and placed so that `eye` is at `stand` and sees `target` through the middle of the wall.
    let pose = |name, eye: DVec3, stand: DVec3, target: DVec3| {
        let ahead = (target - stand).try_normalize().unwrap_or(DVec3::X);
        let turn = DQuat::from_rotation_arc((-eye).normalize(), ahead);
        let turned = DAffine3::from_scale_rotation_translation(DVec3::splat(subject.scale()), turn, DVec3::ZERO);
        Pose { name, eye, world_from_room: DAffine3 { translation: stand - turned.transform_point3(eye), ..turned } }
    };
    let start = orbit.pose(0);
    let near = orbit.pose(9).transform_point3(front);
    // Not the very middle, where symmetric models have planes that pass through the eye.
    let inside = subject.center() + subject.size() * DVec3::new(0.07, 0.11, -0.05);
    let nodes = package.scene.hierarchy.nodes();
    let leaf = nodes.iter().filter(|n| n.leaves.len() == 1).nth(package.scene.leaf_count() as usize / 5);
    let leaf = leaf.map_or(subject.center(), |n| n.bound.center);
    Ok(vec![
        Pose { name: "outside", eye: front, world_from_room: start },
        pose("aside", aside, near, subject.center()),
        pose("inside", front, inside, leaf),
        pose("leaf", aside, leaf, subject.center()),
    ])
}

/// One scene on the GPU, all of it, with a target for the whole wall and one for a tile of each grid.
struct Painter<'a> {
    package: &'a Package,
    renderer: Renderer,
}

impl<'a> Painter<'a> {
    const WHOLE: ViewId = ViewId(0);

    fn new(gpu: &Arc<Gpu>, package: &'a Package, grids: &[Grid]) -> Result<Self> {
        let mut targets = vec![ViewTarget { view: Self::WHOLE, size_px: WALL_PX }];
        for (i, grid) in grids.iter().enumerate() {
            targets.push(ViewTarget { view: ViewId(i as u16 + 1), size_px: grid.wall()?.tiles()[0].size_px });
        }
        let renderer = drawn::upload(gpu, package, &targets, Attachments::ColorAndIds)?;
        Ok(Self { package, renderer })
    }

    /// Draws all of a set.
    fn draw(&mut self, target: ViewId, projection: Projection, visible: &VisibleSet) -> Result<Picture> {
        Ok(self.draw_with(&mut Planner::new(), target, projection, visible)?.0)
    }

    /// Draws what a planner leaves of a set. Gives that, too.
    fn draw_with(
        &mut self,
        planner: &mut Planner,
        target: ViewId,
        projection: Projection,
        visible: &VisibleSet,
    ) -> Result<(Picture, VisibleSet)> {
        let drawn = drawn::draw(&mut self.renderer, planner, self.package, (target, projection, visible))?.leaves;
        let picture = Picture { color: self.renderer.read_color(target)?, ids: self.renderer.read_ids(target)? };
        Ok((picture, drawn))
    }
}

/// The wall's picture, tile by tile.
struct Composite(Picture);

impl Composite {
    fn new() -> Self {
        let [width, height] = WALL_PX;
        Self(Picture { color: RgbaImage::new(width, height), ids: vec![0; (width * height) as usize] })
    }

    fn place(&mut self, tile: &Picture, [column, row]: [u32; 2]) {
        let (width, height) = tile.color.dimensions();
        let (left, top) = (column * width, row * height);
        image::imageops::replace(&mut self.0.color, &tile.color, i64::from(left), i64::from(top));
        for y in 0..height {
            let from = &tile.ids[(y * width) as usize..][..width as usize];
            let at = ((top + y) * WALL_PX[0] + left) as usize;
            self.0.ids[at..at + width as usize].copy_from_slice(from);
        }
    }
}

fn differs(a: &Rgba<u8>, b: &Rgba<u8>, tolerance: u8) -> bool {
    a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > tolerance)
}

fn differing_percent(a: &RgbaImage, b: &RgbaImage) -> f64 {
    let differing = a.pixels().zip(b.pixels()).filter(|(a, b)| differs(a, b, CHANNEL_TOLERANCE)).count();
    100.0 * differing as f64 / (a.width() * a.height()) as f64
}

/// Red where a channel differs by more than so much.
fn difference(a: &RgbaImage, b: &RgbaImage, tolerance: u8) -> RgbaImage {
    let mut out = a.clone();
    for ((out, a), b) in out.pixels_mut().zip(a.pixels()).zip(b.pixels()) {
        *out = if differs(a, b, tolerance) { Rgba([255, 0, 0, 255]) } else { Rgba([a[0] / 3, a[1] / 3, a[2] / 3, 255]) };
    }
    out
}

/// How many objects fill a block of 2 × 2 pixels somewhere in `a`, without a pixel in `b` there or within one pixel.
fn missing_objects(a: &[u32], b: &[u32]) -> u32 {
    let [width, height] = WALL_PX.map(|v| v as usize);
    let mut missing: Vec<u32> = Vec::new();
    for (y, x) in (0..height - 1).flat_map(|y| (0..width - 1).map(move |x| (y, x))) {
        let id = a[y * width + x];
        let block = [a[y * width + x + 1], a[(y + 1) * width + x], a[(y + 1) * width + x + 1]];
        if id == 0 || block != [id; 3] {
            continue;
        }
        let rows = y.saturating_sub(1)..(y + 3).min(height);
        let columns = x.saturating_sub(1)..(x + 3).min(width);
        let found = rows.into_iter().any(|y| b[y * width..][columns.clone()].contains(&id));
        if !found {
            missing.push(id);
        }
    }
    missing.sort_unstable();
    missing.dedup();
    missing.len() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_object_is_found_and_a_shifted_one_is_not() {
        let [width, height] = WALL_PX.map(|v| v as usize);
        let mut with = vec![0; width * height];
        let mut shifted = with.clone();
        for (y, x) in [(5, 7), (5, 8), (6, 7), (6, 8)] {
            with[y * width + x] = 9;
            shifted[(y + 1) * width + x + 1] = 9;
        }
        let without = vec![0; width * height];
        assert_eq!(missing_objects(&with, &without), 1);
        assert_eq!(missing_objects(&with, &shifted), 0);
        assert_eq!(missing_objects(&without, &with), 0);
        let mut thin = without.clone();
        thin[..width].fill(3); // one pixel high
        assert_eq!(missing_objects(&thin, &without), 0);
    }
}
