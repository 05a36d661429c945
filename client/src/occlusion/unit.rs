//! The Occlusion Unit (Bartz, Meißner, Hüttner 1999, section 6.2), without a GPU: how many pixels a box covers and in how many of them
//! nothing is nearer, how near it is there, and where. [`Renderer::count_boxes`](crate::gpu::Renderer::count_boxes) counts the same on the
//! GPU, to the bit.
//!
//! ```text
//! box ─ Footprint::of ─→ a convex polygon and a depth at each pixel ─ count ─→ Counts ─ contribution ─→ a share of the wall
//! ```
//! Counts are conservative: wherever a mesh inside the box is what is seen, the box counts as visible. For this the polygon is up to 1/128
//! of a pixel larger than what the box covers, and its depth a little nearer: by [`DEPTH_SLACK`], and by what its steepest face changes by
//! within as much of a pixel. It holds while products of `clip_from_local` in `f32`, with which meshes are drawn, are right to 1/512 of a pixel,
//! and for pixels on the rim of a mesh's face while that is not much steeper than the box's.

use std::ops::Range;

use glam::{DAffine3, DMat4, DVec2, DVec3, DVec4};
pub use mullion_common::contribution::{ViewPlane, contribution};
use mullion_common::geometry::Aabb;
use mullion_common::wall::Projection;

use super::DEPTH_SLACK;

/// Steps of corners in a pixel: those to which GPUs round, with 8 bits, as all common ones do.
pub const SUBPIXELS: i32 = 256;
/// What a polygon has at most: ten of a box that the near plane cuts, one more for each edge of the tile, and four from growing.
pub const MAX_CORNERS: usize = 18;
/// Pixels around the tile within which polygons are clipped, so that edges of the tile are none of theirs.
pub const GUARD_PX: i32 = 1;

/// Steps by which a polygon grows, to the outside of the step in which a corner lies. GPUs round a mesh's corners by half a step.
const GROWN: f64 = 1.0;
/// Depth is the nearest within so much of a pixel: half a step by which meshes are rounded, and what `f32` loses across a tile.
const DEPTH_GROWN_PX: f64 = 1.0 / 128.0;
/// A GPU may tell the depth of a mesh's face beyond the face's own edge, up to where that is rounded, and there it may be before any face of
/// the box: all fronts are nearer by what the box's steepest face, which may be turned away, changes by, but by no more than so much of the
/// nearest depth.
const MOST_BEYOND: f64 = 1.0 / 64.0;
/// Less than any depth within reach, and no subnormal number: GPUs may take those for 0.
pub const LEAST_DEPTH: f32 = 1e-30;
/// Fronts that rise by more within a pixel are left out: they say nothing.
const STEEPEST: f64 = 128.0;

/// What is known of the surface that a box turns to the eye.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coverage {
    /// Nothing of the box is on the tile, beyond the near plane.
    Nothing,
    /// The box has faces that are turned to the eye.
    Fronts,
    /// It has none: the eye is inside, or the box cannot be placed. Then all that it may cover counts as at the depth of its nearest
    /// point, which is 1 where the near plane cuts it, and on the whole tile where it cannot be placed.
    NoFront,
}

/// Depth over the plane of a face, affine in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Front {
    /// Change from a pixel to the next one to the right.
    pub right: f32,
    /// Change from a pixel to the next one below.
    pub down: f32,
    /// At the centre of the anchor.
    pub at_anchor: f32,
}

impl Front {
    /// One that is nearer than anything, and so never the surface.
    const NONE: Self = Self { right: 0.0, down: 0.0, at_anchor: 2.0 };
}

/// What a box covers of one tile, and how near.
///
/// Outline: a convex polygon in steps of 1/[`SUBPIXELS`] pixel from the tile's top left, x right, y down, clockwise as seen. A pixel is
/// covered when its centre is inside, or on a top or left edge. Depth is reversed: 1 at the near plane, 0 at infinity.
#[derive(Clone, Debug, PartialEq)]
pub struct Footprint {
    size_px: [u32; 2],
    coverage: Coverage,
    corners: [[i32; 2]; MAX_CORNERS],
    corner_count: usize,
    fronts: [Front; 3],
    anchor_px: [i32; 2],
    nearest: f32,
    distance_m: f64,
}

impl Footprint {
    /// What a box covers of a tile of `size_px` pixels, each edge 1 to 16384. Conservative; see [`crate::occlusion::unit`].
    ///
    /// `bounds` in the object's space, in metres there; flat ones and points are taken, and cover what lies within the growth.
    /// `world_from_local` may mirror and shear. Boxes are clipped at the near plane in `f64`, so that one that is partly behind the eye
    /// covers what is in front of it. One that is not finite covers the tile.
    pub fn of(projection: &Projection, size_px: [u32; 2], bounds: &Aabb, world_from_local: &DAffine3) -> Self {
        if bounds.is_empty() {
            return Self::nothing(size_px);
        }
        let clip_from_local = projection.clip_from_offset * DMat4::from(projection.offset_from_local(world_from_local));
        let corners = bounds.corners().map(|corner| clip_from_local * corner.extend(1.0));
        let Some(solid) = Solid::beyond_near(&corners, size_px) else { return Self::whole_tile(size_px) };
        let Solid { points, depth, distance_m } = solid;
        let guard = f64::from(GUARD_PX);
        let mut outline = points.hull().clipped(DVec2::splat(-guard), size_px_f64(size_px) + guard);
        if outline.len() == 0 {
            return Self::nothing(size_px);
        }
        outline = outline.grown().hull();
        if outline.is_overfull || outline.len() > MAX_CORNERS {
            return Self::whole_tile(size_px);
        }
        let nearest = ((depth * DEPTH_SLACK) as f32).clamp(LEAST_DEPTH, 1.0);
        let mut footprint = Self { nearest, distance_m, ..Self::nothing(size_px) };
        footprint.corner_count = outline.len();
        for (corner, point) in footprint.corners.iter_mut().zip(outline.as_slice()) {
            *corner = [point.x as i32, point.y as i32];
        }
        footprint.anchor_px = footprint.middle_px();
        footprint.find_fronts(&clip_from_local, [corners[0], corners[7]]);
        footprint
    }

    fn nothing(size_px: [u32; 2]) -> Self {
        Self {
            size_px,
            coverage: Coverage::Nothing,
            corners: [[0; 2]; MAX_CORNERS],
            corner_count: 0,
            fronts: [Front::NONE; 3],
            anchor_px: [0; 2],
            nearest: LEAST_DEPTH,
            distance_m: f64::INFINITY,
        }
    }

    fn whole_tile(size_px: [u32; 2]) -> Self {
        let [width, height] = size_px.map(|edge| edge as i32 * SUBPIXELS);
        let mut whole = Self { coverage: Coverage::NoFront, nearest: 1.0, distance_m: 0.0, ..Self::nothing(size_px) };
        whole.corners[..4].copy_from_slice(&[[0, 0], [width, 0], [width, height], [0, height]]);
        whole.corner_count = 4;
        whole
    }

    /// The size of the tile that it was made for, in pixels.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// What is known of its surface.
    pub fn coverage(&self) -> Coverage {
        self.coverage
    }

    /// The polygon: none, or three to [`MAX_CORNERS`], each within [`GUARD_PX`] of the tile but for the growth.
    pub fn corners(&self) -> &[[i32; 2]] {
        &self.corners[..self.corner_count]
    }

    /// The box's faces towards the eye, of which the farthest at a pixel is its surface there; fewer than there are where some say nothing.
    pub fn fronts(&self) -> &[Front; 3] {
        &self.fronts
    }

    /// The pixel from which fronts are told.
    pub fn anchor_px(&self) -> [i32; 2] {
        self.anchor_px
    }

    /// The depth of the box's nearest point beyond the near plane, more than 0, at most 1. No pixel's is nearer.
    pub fn nearest(&self) -> f32 {
        self.nearest
    }

    /// How far the box's nearest point beyond the near plane is from the eye along the view, in metres of the room: `Dist(Eye) + Dist(Obj)`
    /// of equation 1. Infinite where nothing is, 0 where the box cannot be placed.
    pub fn distance_m(&self) -> f64 {
        self.distance_m
    }

    /// Depth of the box's surface at a pixel's centre, more than 0, at most 1. Meaningful where the pixel is covered. The order of
    /// operations is the shader's.
    pub fn depth_at(&self, [x, y]: [u32; 2]) -> f32 {
        let [right, down] = [x as i32 - self.anchor_px[0], y as i32 - self.anchor_px[1]].map(|steps| steps as f32);
        let surface = |nearest: f32, front: &Front| nearest.min(front.right * right + front.down * down + front.at_anchor);
        self.fronts.iter().fold(self.nearest, surface).max(LEAST_DEPTH)
    }

    /// Rows of the tile with pixels that may be covered.
    pub fn rows(&self) -> Range<u32> {
        let ys = self.corners().iter().map(|corner| i64::from(corner[1]));
        let (Some(top), Some(bottom)) = (ys.clone().min(), ys.max()) else { return 0..0 };
        within_tile(first_center(top)..last_center(bottom) + 1, self.size_px[1])
    }

    /// Pixels of a row that are covered. Exact, by the top-left rule in integers.
    pub fn span(&self, y: u32) -> Range<u32> {
        let y = i64::from(y) * i64::from(SUBPIXELS) + CENTER;
        let mut span = 0..if self.corner_count > 0 { i64::from(self.size_px[0]) } else { 0 };
        for (from, to) in self.edges() {
            let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
            // Inside is where dx·(y − from.y) − dy·(x − from.x) is positive, and 0 on top and left edges.
            let at_zero = dx * (y - from[1]) + dy * from[0];
            match dy {
                ..0 => span.start = span.start.max(first_center((-at_zero - dy - 1).div_euclid(-dy))),
                1.. => span.end = span.end.min(last_center((at_zero - 1).div_euclid(dy)) + 1),
                0 if at_zero < i64::from(dx <= 0) => return 0..0,
                0 => {}
            }
        }
        within_tile(span, self.size_px[0])
    }

    /// From each corner to the next.
    fn edges(&self) -> impl Iterator<Item = ([i64; 2], [i64; 2])> {
        let corners = self.corners();
        let following = corners.iter().cycle().skip(1);
        corners.iter().zip(following).map(|(from, to)| (from.map(i64::from), to.map(i64::from)))
    }

    /// The Occlusion Unit's registers after the box, against a tile's depth. What [`crate::gpu::Renderer::count_boxes`] counts, to the bit.
    ///
    /// `depth` of the size that the footprint was made for. A pixel as near as what is there counts as visible.
    pub fn count(&self, depth: &DepthImage<'_>) -> Counts {
        let mut counts = Counts::default();
        let [width, height] = depth.size_px;
        for y in self.rows().start..self.rows().end.min(height) {
            let span = self.span(y);
            for x in span.start..span.end.min(width) {
                let (there, here) = (depth.at([x, y]), self.depth_at([x, y]));
                counts.projected += 1;
                if here >= there {
                    counts.see([x, y], here);
                }
            }
        }
        counts
    }

    /// The middle of what it covers, within the tile.
    fn middle_px(&self) -> [i32; 2] {
        [0, 1].map(|axis| {
            let along = self.corners().iter().map(|corner| corner[axis]);
            let (least, most) = (along.clone().min().unwrap_or(0), along.max().unwrap_or(0));
            ((least + most) / (2 * SUBPIXELS)).clamp(0, self.size_px[axis] as i32 - 1)
        })
    }

    /// `corners` least and greatest, in clip space.
    fn find_fronts(&mut self, clip_from_local: &DMat4, corners: [DVec4; 2]) {
        let axes = [clip_from_local.x_axis, clip_from_local.y_axis, clip_from_local.z_axis];
        let (mut slopes, mut found, mut steepest) = ([None; 3], 0, 0.0f64);
        for axis in 0..3 {
            for (corner, outward) in corners.into_iter().zip([-axes[axis], axes[axis]]) {
                let plane = ClipPlane { corner, across: axes[(axis + 1) % 3], up: axes[(axis + 2) % 3] };
                let slope = plane.slope(self.size_px, self.anchor_px);
                steepest = steepest.max(slope.map_or(0.0, |slope| slope.change()));
                if found < 3 && plane.faces_eye(outward) {
                    slopes[found] = slope;
                    found += 1; // of opposite faces one at most
                }
            }
        }
        self.coverage = if found > 0 { Coverage::Fronts } else { Coverage::NoFront };
        let beyond = (steepest * DEPTH_GROWN_PX).min(f64::from(self.nearest) * MOST_BEYOND);
        self.fronts = slopes.map(|slope| slope.and_then(|slope| slope.front(beyond)).unwrap_or(Front::NONE));
        self.nearest = (self.nearest + beyond as f32).min(1.0);
    }
}

/// Steps from a pixel's edge to its centre.
const CENTER: i64 = SUBPIXELS as i64 / 2;

/// The first pixel whose centre is not before `at`.
fn first_center(at: i64) -> i64 {
    (at - CENTER + i64::from(SUBPIXELS) - 1).div_euclid(i64::from(SUBPIXELS))
}

/// The last pixel whose centre is not after `at`.
fn last_center(at: i64) -> i64 {
    (at - CENTER).div_euclid(i64::from(SUBPIXELS))
}

fn within_tile(range: Range<i64>, edge_px: u32) -> Range<u32> {
    let start = range.start.clamp(0, i64::from(edge_px));
    start as u32..range.end.clamp(start, i64::from(edge_px)) as u32
}

fn size_px_f64(size_px: [u32; 2]) -> DVec2 {
    DVec2::from_array(size_px.map(f64::from))
}

/// A box beyond the near plane, on the screen.
struct Solid {
    /// Its corners, pixels.
    points: Points,
    /// Depth of the nearest of them.
    depth: f64,
    distance_m: f64,
}

impl Solid {
    /// None where it cannot be placed.
    fn beyond_near(corners: &[DVec4; 8], size_px: [u32; 2]) -> Option<Self> {
        let mut solid = Self { points: Points::default(), depth: 0.0, distance_m: f64::INFINITY };
        let beyond = corners.map(|clip| clip.w - clip.z);
        for at in 0..8 {
            if !corners[at].is_finite() {
                return None;
            }
            if beyond[at] >= 0.0 {
                solid.take(corners[at], size_px)?;
            }
            for bit in [1, 2, 4].into_iter().filter(|bit| at & bit == 0) {
                let (from, to) = (beyond[at], beyond[at | bit]);
                if (from < 0.0) != (to < 0.0) {
                    solid.take(corners[at].lerp(corners[at | bit], from / (from - to)), size_px)?;
                }
            }
        }
        Some(solid)
    }

    fn take(&mut self, clip: DVec4, size_px: [u32; 2]) -> Option<()> {
        let ndc = clip.truncate() / clip.w;
        let point = DVec2::new(0.5 + ndc.x * 0.5, 0.5 - ndc.y * 0.5) * size_px_f64(size_px);
        self.points.push(point);
        self.depth = self.depth.max(ndc.z);
        self.distance_m = self.distance_m.min(clip.w);
        (clip.w > 0.0 && point.is_finite() && ndc.z.is_finite()).then_some(())
    }
}

/// The plane of a face in clip space, through a corner along two axes.
struct ClipPlane {
    corner: DVec4,
    across: DVec4,
    up: DVec4,
}

/// The eye is the origin of these three: x, y, w.
fn xyw(clip: DVec4) -> DVec3 {
    DVec3::new(clip.x, clip.y, clip.w)
}

impl ClipPlane {
    /// Whether the eye is on the side to which `outward` points, and not in the plane.
    fn faces_eye(&self, outward: DVec4) -> bool {
        let normal = xyw(self.across).cross(xyw(self.up));
        -normal.dot(xyw(self.corner)) * normal.dot(xyw(outward)) > 0.0
    }

    /// Depth over it. None where it is seen so steeply that it says nothing.
    ///
    /// z is linear in (x, y, w) over the plane, so that z/w is affine in x/w and y/w: its three numbers are what the corner and both axes ask
    /// for.
    fn slope(&self, size_px: [u32; 2], anchor_px: [i32; 2]) -> Option<Slope> {
        let [corner, across, up] = [self.corner, self.across, self.up].map(xyw);
        let turned = across.cross(up) * self.corner.z + up.cross(corner) * self.across.z + corner.cross(across) * self.up.z;
        let by_ndc = turned / corner.dot(across.cross(up));
        let [width, height] = size_px.map(f64::from);
        let (right, down) = (by_ndc.x * 2.0 / width, by_ndc.y * -2.0 / height);
        let [x, y] = anchor_px.map(|at| f64::from(at) + 0.5);
        let slope = Slope { right, down, at_anchor: by_ndc.z - by_ndc.x + by_ndc.y + right * x + down * y };
        (slope.change() < STEEPEST).then_some(slope)
    }
}

/// A front before it is made nearer and rounded.
#[derive(Clone, Copy, Debug)]
struct Slope {
    right: f64,
    down: f64,
    at_anchor: f64,
}

impl Slope {
    /// The most by which depth changes along any way of one pixel right or left and one up or down.
    fn change(&self) -> f64 {
        self.right.abs() + self.down.abs()
    }

    /// `beyond`: by how much depth is nearer at least.
    fn front(&self, beyond: f64) -> Option<Front> {
        let at_anchor = self.at_anchor + beyond.max(self.change() * DEPTH_GROWN_PX);
        let lasting = |number: f64| if number.abs() < f64::from(LEAST_DEPTH) { 0.0 } else { (number * DEPTH_SLACK) as f32 };
        let front = Front { right: lasting(self.right), down: lasting(self.down), at_anchor: lasting(at_anchor) };
        front.at_anchor.is_finite().then_some(front)
    }
}

/// Some points, without a heap.
#[derive(Clone, Debug)]
struct Points {
    at: [DVec2; Self::MOST],
    count: usize,
    /// There were more.
    is_overfull: bool,
}

impl Default for Points {
    fn default() -> Self {
        Self { at: [DVec2::ZERO; Self::MOST], count: 0, is_overfull: false }
    }
}

impl Points {
    /// Four for each corner of a clipped polygon, and some to spare.
    const MOST: usize = 64;

    fn push(&mut self, point: DVec2) {
        match self.at.get_mut(self.count) {
            Some(place) => (*place, self.count) = (point, self.count + 1),
            None => self.is_overfull = true,
        }
    }

    fn len(&self) -> usize {
        self.count
    }

    fn as_slice(&self) -> &[DVec2] {
        &self.at[..self.count]
    }

    fn empty(&self) -> Self {
        Self { count: 0, ..*self }
    }

    /// The corners of the least convex polygon around them, clockwise as seen with y down (Andrew's monotone chain). Exact for whole
    /// numbers up to 2²⁵.
    fn hull(mut self) -> Self {
        self.at[..self.count].sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        let mut hull = self.empty();
        let points = self.as_slice();
        let half = |hull: &mut Self, points: &mut dyn Iterator<Item = &DVec2>| {
            let begin = hull.count;
            for &point in points {
                while hull.count >= begin + 2 {
                    let (a, b) = (hull.at[hull.count - 2], hull.at[hull.count - 1]);
                    if (b - a).perp_dot(point - b) > 0.0 {
                        break;
                    }
                    hull.count -= 1;
                }
                hull.push(point);
            }
            hull.count -= usize::from(hull.count > begin + 1); // the other half begins with it
        };
        half(&mut hull, &mut points.iter());
        half(&mut hull, &mut points.iter().rev());
        hull
    }

    /// The part of a convex polygon within a rectangle (Sutherland and Hodgman 1974).
    fn clipped(self, least: DVec2, most: DVec2) -> Self {
        let sides: [&dyn Fn(DVec2) -> f64; 4] = [&|p| p.x - least.x, &|p| most.x - p.x, &|p| p.y - least.y, &|p| most.y - p.y];
        sides.into_iter().fold(self, |polygon, inside_by| {
            let mut part = polygon.empty();
            for (at, &from) in polygon.as_slice().iter().enumerate() {
                let to = polygon.at[(at + 1) % polygon.count];
                let (a, b) = (inside_by(from), inside_by(to));
                if a >= 0.0 {
                    part.push(from);
                }
                if (a < 0.0) != (b < 0.0) {
                    part.push(from.lerp(to, a / (a - b)));
                }
            }
            part
        })
    }

    /// In steps of a pixel, each point as the square around it that all are grown by: 1 to 2 steps to each side.
    fn grown(self) -> Self {
        let mut squares = self.empty();
        for point in self.as_slice() {
            let step = (*point * f64::from(SUBPIXELS)).floor();
            let (least, most) = (step - GROWN, step + 1.0 + GROWN);
            for corner in [least, DVec2::new(most.x, least.y), most, DVec2::new(least.x, most.y)] {
                squares.push(corner);
            }
        }
        squares
    }
}

/// A tile's depth, reversed, in memory.
#[derive(Clone, Copy, Debug)]
pub struct DepthImage<'a> {
    size_px: [u32; 2],
    depths: &'a [f32],
}

impl<'a> DepthImage<'a> {
    /// `depths` row by row from the top left, 0 where nothing is. None where they are not as many as pixels.
    pub fn new(size_px: [u32; 2], depths: &'a [f32]) -> Option<Self> {
        let pixels = size_px.map(u64::from).iter().product::<u64>();
        (depths.len() as u64 == pixels).then_some(Self { size_px, depths })
    }

    fn at(&self, [x, y]: [u32; 2]) -> f32 {
        self.depths[y as usize * self.size_px[0] as usize + x as usize]
    }
}

/// Pixels of a tile, from the top left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelRect {
    /// The first column and row.
    pub first: [u32; 2],
    /// The last ones, which belong to it.
    pub last: [u32; 2],
}

/// What the Occlusion Unit's registers hold after a box.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Pixels of the tile that the box covers: the projection hit counter, PHC.
    pub projected: u32,
    /// Those where the box is at least as near as what is there: the non-occlusion hit counter, NOHC.
    pub visible: u32,
    /// The nearest depth of the box in visible pixels, reversed; 0 where there are none.
    pub closest: f32,
    /// The least rectangle around visible pixels.
    pub rect: Option<PixelRect>,
}

impl Counts {
    fn see(&mut self, pixel: [u32; 2], depth: f32) {
        self.visible += 1;
        self.closest = self.closest.max(depth);
        let rect = self.rect.get_or_insert(PixelRect { first: pixel, last: pixel });
        rect.first = [0, 1].map(|axis| rect.first[axis].min(pixel[axis]));
        rect.last = [0, 1].map(|axis| rect.last[axis].max(pixel[axis]));
    }
}

/// Equation 1 of section 4.3 as it is printed: [`contribution`] of the pixels of the box's screen projection (PHC), whether hidden or not.
///
/// The paper's example (footnote 6) has a threshold of 100, called 0.02 % of a view plane of 650 by 650 pixels: 100 of its pixels are 0.024 %.
/// Its average object, 423 pixels at 10 from a plane before which the eye is 0.002, comes to 5.007; one pixel to 0.0118.
pub fn contribution_as_printed(counts: &Counts, plane: &ViewPlane, object_m: f64) -> f64 {
    contribution(counts.projected, plane, object_m)
}

#[cfg(test)]
mod tests;
