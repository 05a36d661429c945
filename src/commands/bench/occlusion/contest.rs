//! A scene drawn in several ways, frame by frame, in turns.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use image::RgbaImage;
use mullion_client::frame::{Bound, FramePlan, PassPlan, Planner};
use mullion_client::gpu::{Attachments, Gpu, Renderer, ViewTarget};
use mullion_client::occlusion::Occlusion;
use mullion_common::camera_path::CameraPath;
use mullion_common::scene::{AlphaMode, LeafRecord, Package};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Projection, ViewId, Wall};
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::tree::CullTree;

use super::table::{Row, Table};
use super::{Mode, Way};
use crate::drawn::{self, Drawn};
use crate::show::Spread;

const VIEW: ViewId = ViewId(0);
/// Frames before one counts: buffers grow, and what is seen becomes known.
const WARM_UP: usize = 2;

/// A scene on the GPU twice: as it is drawn fastest without occlusion culling, and with leaf ids.
pub struct Contest<'a> {
    package: &'a Package,
    wall: &'a Wall,
    plain: Renderer,
    culled: Renderer,
    /// Frustum culling alone is the first.
    contestants: Vec<Contestant>,
}

struct Contestant {
    way: Way,
    planner: Planner,
    sums: Sums,
}

/// What is summed over the frames.
#[derive(Default)]
struct Sums {
    frame_ms: Vec<f64>,
    timed: Timed,
    drawn: Vec<u64>,
    tests: u64,
    hidden_culled: u64,
    drawn_leaves: u64,
    false_visible: u64,
    wrong_pixels: u64,
}

/// Sums over the frames in which the GPU's clock was read, milliseconds.
#[derive(Default)]
struct Timed {
    frames: u64,
    all_ms: f64,
    draw_ms: f64,
    test_ms: f64,
}

impl Timed {
    fn add(&mut self, frame_ms: f64, draw_ms: f64, test_ms: f64) {
        self.frames += 1;
        self.all_ms += frame_ms;
        self.draw_ms += draw_ms;
        self.test_ms += test_ms;
    }

    /// Of culling to the frustum, of planning and waiting, of testing and of drawing. `cull_ms`: of a frame.
    fn shares_percent(&self, cull_ms: f64) -> Option<[f64; 4]> {
        let Self { frames, all_ms, draw_ms, test_ms } = *self;
        let cull_ms = cull_ms * frames as f64;
        let share = |ms: f64| 100.0 * ms / (all_ms + cull_ms);
        (frames > 0).then(|| [share(cull_ms), share(all_ms - draw_ms - test_ms), share(test_ms), share(draw_ms)])
    }
}

/// What is true of a frame, however it is drawn.
struct Truth {
    /// Leaves of which a pixel is seen.
    with_pixel: VisibleSet,
    /// Leaves in the frustum whose boxes are hidden.
    box_hidden: VisibleSet,
    /// Of all that is in the frustum.
    picture: RgbaImage,
}

impl<'a> Contest<'a> {
    /// Uploads the scene.
    pub fn new(gpu: &Arc<Gpu>, package: &'a Package, wall: &'a Wall, ways: &[Way]) -> Result<Self> {
        let targets = [ViewTarget { view: VIEW, size_px: wall.tiles()[0].size_px }];
        let contestant = |way: Way| Contestant { way, planner: way.planner(), sums: Sums::default() };
        let frustum = Way { mode: Mode::Frustum, adaptive: None };
        let contestants = std::iter::once(frustum).chain(ways.iter().copied()).map(contestant).collect();
        let plain = drawn::upload(gpu, package, &targets, Attachments::Color)?;
        let culled = drawn::upload(gpu, package, &targets, Attachments::Color)?;
        Ok(Self { package, wall, plain, culled, contestants })
    }

    /// Draws all frames in all ways.
    pub fn measure(mut self, (scene, path_name): (String, String), path: &CameraPath, frames: u64) -> Result<Table> {
        let mut culler = Culler::new(Algorithm::Sweep, self.wall);
        let tree = CullTree::new(Arc::clone(&self.package.scene.hierarchy));
        let (eyes, mut sets) = (self.wall.default_eyes(), vec![VisibleSet::default(); 1]);
        let leaves = &self.package.scene.manifest.leaves;
        let all = VisibleSet::all(leaves.len() as u32);
        let (mut in_frustum, mut with_pixel, mut seen_triangles, mut box_hidden, mut cull_ms) = (0, 0, 0, 0, 0.0);
        let warm_up = std::iter::repeat_n((0, false), WARM_UP);
        for (frame, counts) in warm_up.chain((0..frames).map(|frame| (frame, true))) {
            let world_from_room = path.pose(frame);
            sets[0].clear();
            let started = Instant::now();
            culler.cull(&tree, self.wall, &eyes, &world_from_room, &mut sets);
            let culled_ms = started.elapsed().as_secs_f64() * 1e3;
            let projection = self.wall.projection(VIEW, eyes[0], &world_from_room);
            let truth = self.truth(&projection, &sets[0])?;
            // Each is first in turn: nobody always comes after the same other.
            let count = self.contestants.len();
            for at in 0..count {
                let at = (at + frame as usize) % count;
                let visible = match self.contestants[at].way.mode {
                    Mode::None => &all,
                    Mode::Perfect => &truth.with_pixel,
                    _ => &sets[0],
                };
                let drawn = self.draw(at, &projection, visible)?;
                if counts {
                    self.add(at, drawn, &truth)?;
                }
            }
            if counts {
                cull_ms += culled_ms;
                in_frustum += u64::from(sets[0].len());
                with_pixel += u64::from(truth.with_pixel.len());
                box_hidden += u64::from(truth.box_hidden.len());
                seen_triangles += triangles(&truth.with_pixel, leaves);
            }
        }
        let triangles = triangles(&all, leaves);
        let pixels = self.wall.tiles()[0].size_px.iter().map(|edge| u64::from(*edge)).product();
        let frustum_triangles: u64 = self.contestants[0].sums.drawn.iter().sum();
        let frustum_ms: f64 = self.contestants[0].sums.frame_ms.iter().sum();
        let rows = self.contestants.iter().map(|c| c.row((triangles, pixels), frustum_ms, cull_ms, box_hidden)).collect();
        Ok(Table {
            scene,
            path: path_name,
            frames,
            triangles,
            leaves: leaves.len() as u32,
            bound: frustum_triangles as f64 / seen_triangles.max(1) as f64,
            without_pixel_percent: 100.0 - percent(with_pixel, in_frustum),
            box_hidden_percent: percent(box_hidden, in_frustum),
            rows,
        })
    }

    /// Draws a frame in one way. Gives how long it took, milliseconds, too.
    fn draw(&mut self, at: usize, projection: &Projection, visible: &VisibleSet) -> Result<(f64, Drawn)> {
        let Contestant { way, planner, .. } = &mut self.contestants[at];
        let renderer = if way.mode.occlusion() == Occlusion::Off { &mut self.plain } else { &mut self.culled };
        let started = Instant::now();
        let drawn = drawn::draw(renderer, planner, self.package, (VIEW, *projection, visible))?;
        renderer.wait()?;
        Ok((started.elapsed().as_secs_f64() * 1e3, drawn))
    }

    /// Looks at what was drawn.
    fn add(&mut self, at: usize, (frame_ms, drawn): (f64, Drawn), truth: &Truth) -> Result<()> {
        let mode = self.contestants[at].way.mode;
        let renderer = if mode.occlusion() == Occlusion::Off { &self.plain } else { &self.culled };
        let picture = renderer.read_color(VIEW)?;
        let wrong = truth.picture.pixels().zip(picture.pixels()).filter(|(true_one, drawn)| true_one != drawn).count();
        let (mut kept, mut without_pixel) = (VisibleSet::default(), VisibleSet::default());
        truth.box_hidden.difference_into(&drawn.leaves, &mut kept);
        drawn.leaves.difference_into(&truth.with_pixel, &mut without_pixel);
        let sums = &mut self.contestants[at].sums;
        sums.frame_ms.push(frame_ms);
        if let Some(draw_us) = drawn.draw_us {
            sums.timed.add(frame_ms, draw_us / 1e3, drawn.test_us / 1e3);
        }
        sums.drawn.push(drawn.triangles);
        sums.tests += u64::from(drawn.tests);
        sums.hidden_culled += u64::from(kept.len());
        sums.drawn_leaves += u64::from(drawn.leaves.len());
        sums.false_visible += u64::from(without_pixel.len());
        sums.wrong_pixels += wrong as u64;
        Ok(())
    }

    /// Draws all that is in the frustum, in both ways, and tests all boxes against it.
    fn truth(&mut self, projection: &Projection, visible: &VisibleSet) -> Result<Truth> {
        let manifest = &self.package.scene.manifest;
        let is_blended = |leaf: &u32| {
            let material = manifest.leaves[*leaf as usize].material;
            manifest.materials[material.0 as usize].alpha == AlphaMode::Blend
        };
        let mut pass = PassPlan::new(VIEW, *projection);
        visible.leaves().filter(|leaf| !is_blended(leaf)).for_each(|leaf| pass.opaque.push(LeafRange::new(leaf, leaf + 1)));
        pass.bounds.extend(visible.leaves().map(Bound::Leaf));
        let results = self.culled.draw(&FramePlan { passes: vec![pass] })?;
        let (mut seen, mut box_hidden) = (VisibleSet::default(), VisibleSet::default());
        for (leaf, is_seen) in visible.leaves().zip(&results.passes[0].bounds_seen) {
            let of = if *is_seen { &mut seen } else { &mut box_hidden };
            of.push(LeafRange::new(leaf, leaf + 1));
        }
        // Of nothing there is no round, and no picture of ids.
        let mut ids = if visible.is_empty() { Vec::new() } else { self.culled.read_leaves(VIEW)? };
        ids.sort_unstable();
        ids.dedup();
        let opaque = ids.into_iter().filter_map(|id| id.checked_sub(1));
        // Blended leaves leave no ids: those count whose boxes are seen.
        let leaves = opaque.chain(seen.leaves().filter(is_blended));
        let mut with_pixel = VisibleSet::default();
        leaves.for_each(|leaf| with_pixel.push_unordered(LeafRange::new(leaf, leaf + 1)));
        with_pixel.normalize();
        drawn::draw(&mut self.plain, &mut Planner::new(), self.package, (VIEW, *projection, visible))?;
        Ok(Truth { with_pixel, box_hidden, picture: self.plain.read_color(VIEW)? })
    }
}

fn triangles(of: &VisibleSet, leaves: &[LeafRecord]) -> u64 {
    of.leaves().map(|leaf| u64::from(leaves[leaf as usize].triangle_count)).sum()
}

fn percent(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { 100.0 * part as f64 / whole as f64 }
}

impl Contestant {
    fn row(&self, (triangles, pixels): (u64, u64), frustum_ms: f64, cull_ms: f64, box_hidden: u64) -> Row {
        let Self { way, sums, .. } = self;
        let all_ms: f64 = sums.frame_ms.iter().sum();
        let frames = sums.frame_ms.len() as u64;
        let culled_percent = |drawn: u64| 100.0 - percent(drawn, triangles);
        Row {
            mode: way.name(),
            culled_percent: 100.0 - percent(sums.drawn.iter().sum(), triangles * frames),
            frame_ms: Spread::of(sums.frame_ms.iter().copied()),
            speed_up: frustum_ms / all_ms,
            shares_percent: sums.timed.shares_percent(cull_ms / frames.max(1) as f64),
            tests: sums.tests as f64 / frames.max(1) as f64,
            hidden_culled_percent: percent(sums.hidden_culled, box_hidden),
            false_visible_percent: percent(sums.false_visible, sums.drawn_leaves),
            wrong_pixels: sums.wrong_pixels,
            wrong_percent: percent(sums.wrong_pixels, pixels * frames),
            threshold: way.adaptive.map(|adaptive| adaptive.threshold),
            by_frame: sums.frame_ms.iter().zip(&sums.drawn).map(|(ms, drawn)| [1e3 / ms, culled_percent(*drawn)]).collect(),
        }
    }
}
