//! The occluder as depths in a small picture (section 3.1), drawn on the CPU: a question is answered at once, and every node of a wall gets
//! the same answer.

use glam::{DAffine3, DMat4, DVec3, Mat4, Vec3, Vec3Swizzles, Vec4, Vec4Swizzles};
use mullion_common::geometry::Aabb;
use mullion_common::scene::{Hierarchy, NodeBounds, VertexHierarchy, VertexId};
use mullion_common::wall::Projection;

use super::cut::Cut;
use super::steps::StepId;
use super::{Hidden, LodObject, Occluder};
use crate::occlusion::unit::Footprint;

/// The tangent of an eighth of a turn halved: where an octagon around a circle has its corners.
pub(super) const OCTAGON: f32 = 0.414_213_57;

/// Which of a node's bounds are asked about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum BoundsKind {
    Sphere,
    Box,
    /// Along the normal: the paper's best.
    Cylinder,
    /// Of a vertex, those around the split and its own: the triangles that it takes and puts are between them. Nothing that the node becomes later: of
    /// that, each split is asked about for itself, unless the node's box is hidden, too. Of a group, its box.
    #[default]
    Link,
}

/// Width and height of a wall's picture, pixels: of the whole wall, whatever its shape.
pub const OCCLUDER_PX: u32 = 288;
/// The picture is so many times as wide and high as the view, for frames that keep it.
const WIDER: f32 = 1.28;
/// Of the angle by which such frames may be turned: about 8 degrees.
const LEAST_COSINE: f64 = 0.99;
/// How far the eye of such frames may be from where it was, as a share of how far away what is drawn is, in the mean of its nearness.
const MOST_PARALLAX: f64 = 0.5;
/// The level of the picture that the mean is taken of: a sixteenth of its pixels.
const MEAN_LEVEL: usize = 2;
/// Of a box's rows of pixels so many are looked at, or fewer than twice as many, and columns as far apart as these.
const SHARE_ROWS: usize = 32;

/// Pixels that are filled at once, by their columns.
const LANE: Vec4 = Vec4::new(0.0, 1.0, 2.0, 3.0);

/// Depths in a picture, and of each 2×2, 4×4, … of its pixels the farthest.
///
/// Only pixels' middles are looked at, so answers are as good as the picture is fine. An error costs triangles or sharpness, no correctness.
#[derive(Debug)]
pub struct DepthOccluder {
    kind: BoundsKind,
    projection: Option<Projection>,
    /// From where it was drawn.
    drawn: Option<Projection>,
    /// One over how far away along the view's axis that is which was drawn, in the mean of its pixels, 1/m.
    mean_near: f64,
    /// Whether it was drawn for the frame that looks: then what is beyond the view is of no use.
    is_of_frame: bool,
    /// By object.
    clip_from_local: Vec<Mat4>,
    levels: Vec<Level>,
    /// Vertices of a cut: columns and rows of pixels, and how near.
    placed: Vec<Vec3>,
}

/// How near what is drawn is at each pixel: one over its distance along the view's axis, 0 where nothing is.
#[derive(Debug)]
struct Level {
    width: usize,
    height: usize,
    near: Vec<f32>,
}

/// A part of a picture in pixels, and how near the nearest there is.
#[derive(Clone, Copy, Debug)]
struct Spread {
    low: Vec3,
    high: Vec3,
}

impl DepthOccluder {
    /// An occluder in a picture of this size, pixels, each at least 1.
    pub fn new([width, height]: [u32; 2], kind: BoundsKind) -> Self {
        let (mut width, mut height) = (width.max(1) as usize, height.max(1) as usize);
        let mut levels = Vec::new();
        loop {
            levels.push(Level { width, height, near: vec![0.0; width * height] });
            if width == 1 && height == 1 {
                break;
            }
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
        }
        Self {
            kind,
            projection: None,
            drawn: None,
            mean_near: 0.0,
            is_of_frame: false,
            clip_from_local: Vec::new(),
            levels,
            placed: Vec::new(),
        }
    }

    /// From where the next frame is seen. Whether what was drawn may be kept for it: it looks about the same way, from about the same place.
    pub fn look(&mut self, projection: &Projection) -> bool {
        let forward = |of: &Projection| of.clip_from_offset.row(3).truncate().normalize_or_zero();
        let holds = self.drawn.is_some_and(|drawn| {
            let parallax = drawn.eye.distance(projection.eye) * self.mean_near;
            forward(&drawn).dot(forward(projection)) > LEAST_COSINE && parallax < MOST_PARALLAX
        });
        self.projection = Some(*projection);
        self.is_of_frame = false;
        holds
    }

    fn draw_cut(&mut self, hierarchy: &Hierarchy, cut: &Cut, clip_from_local: &Mat4, facing: Facing) {
        let Level { width, height, near } = &mut self.levels[0];
        let half = Vec3::new(*width as f32, *height as f32, 0.0) * 0.5;
        self.placed.clear();
        let positions = &hierarchy.vertices().positions;
        self.placed.extend(cut.vertices(hierarchy).map(|vertex| {
            let clip = *clip_from_local * Vec3::from(positions[vertex as usize]).extend(1.0);
            let near = if clip.w > 0.0 { clip.w.recip() } else { f32::NAN };
            Vec3::new(half.x + clip.x * near * half.x, half.y - clip.y * near * half.y, near)
        }));
        for corners in cut.placed_triangles(hierarchy) {
            let corners = corners.map(|place| self.placed[place as usize]);
            fill((*width, *height), near, corners, facing);
        }
    }

    /// Each cell of a level is the farthest of up to four of the level before.
    fn build_levels(&mut self) {
        for k in 1..self.levels.len() {
            let (finer, coarser) = self.levels.split_at_mut(k);
            let (finer, coarser) = (&finer[k - 1], &mut coarser[0]);
            for (y, row) in coarser.near.chunks_exact_mut(coarser.width).enumerate() {
                let line = |y: usize| &finer.near[y * finer.width..][..finer.width];
                let (first, second) = (line(2 * y), line((2 * y + 1).min(finer.height - 1)));
                let ((first, first_rest), (second, second_rest)) = (first.as_chunks::<2>(), second.as_chunks::<2>());
                let (cells, last) = row.split_at_mut(first.len());
                for (cell, ([a, b], [c, d])) in cells.iter_mut().zip(first.iter().zip(second)) {
                    *cell = farther(farther(*a, *b), farther(*c, *d));
                }
                // Of an odd width.
                last.iter_mut().zip(first_rest.iter().zip(second_rest)).for_each(|(cell, (a, c))| *cell = farther(*a, *c));
            }
        }
    }
}

/// Of what is above 0, if anything is.
fn mean_above_zero(values: &[f32]) -> Option<f64> {
    let (sum, count) = values.iter().filter(|v| **v > 0.0).fold((0.0, 0u32), |(sum, count), v| (sum + f64::from(*v), count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// The less near of two. Both are numbers, and so it takes no branch, and several go at once.
#[inline]
fn farther(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Where all that a split changes lies in the picture: between the vertices around it and its own.
fn link_spread(clip_from_local: &Mat4, hierarchy: &VertexHierarchy, lead: VertexId) -> Option<Spread> {
    let corner = |vertex: VertexId| *clip_from_local * hierarchy.position(vertex).extend(1.0);
    Spread::of(link_vertices(hierarchy, lead).map(corner))
}

/// A split's own vertices, and those around it.
#[inline]
pub(super) fn link_vertices(hierarchy: &VertexHierarchy, lead: VertexId) -> impl Iterator<Item = VertexId> {
    let around = hierarchy.together(lead).flat_map(|vertex| hierarchy.link(vertex).path()).map(|v| VertexId(*v));
    hierarchy.together(lead).chain(around)
}

/// Where a node's bounds lie in the picture; `None` if they reach behind the eye.
fn bounds_spread(kind: BoundsKind, clip_from_local: &Mat4, bounds: &NodeBounds) -> Option<Spread> {
    let middle = *clip_from_local * bounds.center.extend(1.0);
    let way = |direction: Vec3| *clip_from_local * direction.extend(0.0);
    let extent = &bounds.extent;
    match kind {
        BoundsKind::Sphere => {
            let rows = [0, 1, 3].map(|row| clip_from_local.row(row).xyz().length() * extent.radius);
            let nearest = middle.w - rows[2];
            // The furthest way from the middle is at the nearest distance or the furthest.
            let side = |at: f32, reach: f32| {
                let (low, high) = (at - reach, at + reach);
                let over = |x: f32, is_low: bool| x / if (x < 0.0) == is_low { nearest } else { middle.w + rows[2] };
                (over(low, true), over(high, false))
            };
            let (x, y) = (side(middle.x, rows[0]), side(middle.y, rows[1]));
            (nearest > 0.0).then(|| Spread { low: Vec3::new(x.0, y.0, 0.0), high: Vec3::new(x.1, y.1, nearest.recip()) })
        }
        BoundsKind::Box => {
            let half = extent.half_box;
            let [x, y, z] = [way(Vec3::X * half.x), way(Vec3::Y * half.y), way(Vec3::Z * half.z)];
            let ends = [middle - z, middle + z].into_iter();
            Spread::of(ends.flat_map(|end| [end - x - y, end - x + y, end + x - y, end + x + y]))
        }
        _ => {
            let axis = extent.axis.direction();
            let (side, other) = axis.any_orthonormal_pair();
            let radius = extent.cylinder_radius;
            let [u, v] = [way(side * radius), way(other * radius)];
            let axis = way(axis);
            let ends = [middle - axis * extent.cylinder_below, middle + axis * extent.cylinder_above].into_iter();
            // An octagon around the circle.
            let [a, b, c, d] = [u + v * OCTAGON, u - v * OCTAGON, u * OCTAGON + v, u * OCTAGON - v];
            Spread::of(ends.flat_map(|end| [end + a, end - a, end + b, end - b, end + c, end - c, end + d, end - d]))
        }
    }
}

impl Spread {
    fn of(points: impl Iterator<Item = Vec4>) -> Option<Self> {
        let mut spread = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };
        let mut least_w = f32::INFINITY;
        for clip in points {
            least_w = least_w.min(clip.w);
            let near = clip.w.recip();
            let at = (clip.xy() * near).extend(near);
            spread.low = spread.low.min(at);
            spread.high = spread.high.max(at);
        }
        (least_w > 0.0).then_some(spread)
    }
}

impl Occluder for DepthOccluder {
    fn draw(&mut self, objects: &[LodObject<'_>], cuts: &[Cut]) {
        let Some(projection) = self.projection else { return };
        let wider = Mat4::from_scale(Vec3::new(WIDER.recip(), WIDER.recip(), 1.0));
        self.drawn = Some(projection);
        self.is_of_frame = true;
        self.levels[0].near.fill(0.0);
        self.clip_from_local.clear();
        for (object, cut) in objects.iter().zip(cuts) {
            let clip_from_local = wider * projection.clip_from_local(&object.world_from_local);
            let facing = match (object.is_double_sided, object.world_from_local.matrix3.determinant() < 0.0) {
                (true, _) => Facing::Either,
                (false, false) => Facing::Counterclockwise,
                (false, true) => Facing::Clockwise,
            };
            if object.is_solid {
                self.draw_cut(object.hierarchy, cut, &clip_from_local, facing);
            }
            self.clip_from_local.push(clip_from_local);
        }
        self.build_levels();
        // Where nothing covers as much as a cell of that, of all pixels.
        let mean = |level: usize| mean_above_zero(&self.levels[level].near);
        self.mean_near = mean(MEAN_LEVEL.min(self.levels.len() - 1)).or_else(|| mean(0)).unwrap_or(0.0);
    }

    fn hides(&mut self, object: usize, hierarchy: &Hierarchy, step: StepId) -> Option<Hidden> {
        let Some(clip_from_local) = self.clip_from_local.get(object) else { return Some(Hidden::Nothing) };
        let (spread, hidden) = match (hierarchy, self.kind) {
            // Bounds enclose the vertex: what shows that shows something of them.
            (Hierarchy::Vertices(hierarchy), _) if self.shows(*clip_from_local * hierarchy.position(step.lead()).extend(1.0)) => {
                return Some(Hidden::Nothing);
            }
            (Hierarchy::Vertices(hierarchy), BoundsKind::Link) => {
                let lead = step.lead();
                let is_hidden = link_spread(clip_from_local, hierarchy, lead).is_some_and(|spread| self.is_behind(&spread));
                // Where all that its vertex becomes is behind, too, nobody need ask about its later splits.
                let is_followed = || hierarchy.next_sibling(lead).is_some();
                let whole = || bounds_spread(BoundsKind::Box, clip_from_local, &hierarchy.bounds(lead));
                return Some(match is_hidden {
                    false => Hidden::Nothing,
                    true if is_followed() && whole().is_some_and(|spread| self.is_behind(&spread)) => Hidden::Node,
                    true => Hidden::Split,
                });
            }
            (Hierarchy::Vertices(hierarchy), kind) => {
                (bounds_spread(kind, clip_from_local, &hierarchy.bounds(step.lead())), Hidden::Node)
            }
            (Hierarchy::Clusters(hierarchy), kind) => {
                let kind = if kind == BoundsKind::Link { BoundsKind::Box } else { kind };
                (bounds_spread(kind, clip_from_local, &hierarchy.bounds(step.group())), Hidden::Node)
            }
        };
        Some(if spread.is_some_and(|spread| self.is_behind(&spread)) { hidden } else { Hidden::Nothing })
    }
}

impl DepthOccluder {
    /// Of a box's pixels in the picture the share in which nothing was drawn before the box: of the Occlusion Unit's registers NOHC / PHC
    /// (Bartz, Meißner, Hüttner 1999, section 6.2). 0 to 1; `None` where nothing was drawn yet, or the box has no pixels.
    ///
    /// What is inside the box hides nothing of it. Of a box of many rows not all pixels are looked at, but one of each square of them.
    pub fn visible_share(&self, world_from_local: &DAffine3, local: &Aabb) -> Option<f32> {
        let drawn = self.drawn?;
        let wider = DMat4::from_scale(DVec3::new(1.0, 1.0, f64::from(WIDER)) / f64::from(WIDER));
        let projection = Projection { clip_from_offset: wider * drawn.clip_from_offset, ..drawn };
        let Level { width, height, near } = &self.levels[0];
        let footprint = Footprint::of(&projection, [*width as u32, *height as u32], local, world_from_local);
        // Depths are the near plane's distance over that of what is there.
        let near_m = projection.clip_from_offset.w_axis.z as f32;
        let step = (footprint.rows().len() / SHARE_ROWS).max(1);
        let (mut visible, mut all) = (0u32, 0u32);
        for y in footprint.rows().step_by(step) {
            let row = &near[y as usize * width..][..*width];
            for x in footprint.span(y).step_by(step) {
                all += 1;
                visible += u32::from(footprint.depth_at([x, y]) >= row[x as usize] * near_m);
            }
        }
        (all > 0).then(|| visible as f32 / all as f32)
    }

    /// Whether a point is before all that was drawn at its pixel.
    fn shows(&self, clip: Vec4) -> bool {
        let Level { width, height, near } = &self.levels[0];
        let nearness = clip.w.recip();
        let [x, y] = [clip.x * nearness * 0.5 + 0.5, 0.5 - clip.y * nearness * 0.5];
        let is_inside = clip.w > 0.0 && (0.0..1.0).contains(&x) && (0.0..1.0).contains(&y);
        is_inside && near[(y * *height as f32) as usize * width + (x * *width as f32) as usize] <= nearness
    }

    /// Whether everything there is behind what was drawn.
    fn is_behind(&self, Spread { low, high }: &Spread) -> bool {
        let (width, height) = (self.levels[0].width as f32, self.levels[0].height as f32);
        // A pixel more than is covered: only middles were looked at.
        const MARGIN: f32 = 0.5;
        let column = |x: f32| (x * 0.5 + 0.5) * width;
        let row = |y: f32| (0.5 - y * 0.5) * height;
        let (left, right) = (column(low.x) - MARGIN, column(high.x) + MARGIN);
        let (top, bottom) = (row(high.y) - MARGIN, row(low.y) + MARGIN);
        // Beyond the view in the frame that drew it, and beyond the picture in those that keep it.
        let margin = if self.is_of_frame { 0.5 - 0.5 / WIDER } else { 0.0 };
        let (x_margin, y_margin) = (margin * width, margin * height);
        if right < x_margin || left >= width - x_margin || bottom < y_margin || top >= height - y_margin {
            return true;
        }
        // As integers below 0 are 0, and what is beyond the picture is cut off.
        let [x, y] =
            [(left, right, width), (top, bottom, height)].map(|(low, high, size)| (low as usize, high.min(size - 1.0) as usize));
        const CELLS: usize = 4;
        let longest = (x.1 - x.0).max(y.1 - y.0);
        let level = (longest / CELLS).checked_ilog2().map_or(0, |log| log as usize + 1);
        let Level { width, near, .. } = &self.levels[level];
        let rows = (y.0 >> level)..=(y.1 >> level);
        rows.into_iter().all(|y| near[y * width..][x.0 >> level..=x.1 >> level].iter().all(|near| *near > high.z))
    }
}

/// Which triangles are drawn, as the eye sees them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Facing {
    Counterclockwise,
    Clockwise,
    Either,
}

/// Draws a triangle: the nearest stays. One that reaches behind the eye is left out.
#[inline]
fn fill((width, height): (usize, usize), near: &mut [f32], [a, b, c]: [Vec3; 3], facing: Facing) {
    let (ab, ac) = (b.xy() - a.xy(), c.xy() - a.xy());
    let doubled = ab.perp_dot(ac);
    // Rows count downwards: counterclockwise is below 0. What is behind the eye is no number.
    let is_drawn = match facing {
        Facing::Counterclockwise => doubled < 0.0,
        Facing::Clockwise => doubled > 0.0,
        Facing::Either => doubled.abs() > 0.0,
    };
    if !is_drawn {
        return;
    }
    let (low, high) = (a.min(b).min(c) + 0.5, a.max(b).max(c) + 0.5);
    // From the first to the last pixel whose middle is between; as integers numbers below 0 are 0.
    let (left, right) = (low.x as usize, (high.x as usize).min(width));
    let (top, bottom) = (low.y as usize, (high.y as usize).min(height));
    if left >= right || top >= bottom {
        return;
    }
    // Weights of b and c, and nearness, are linear in the picture.
    let inverse = doubled.recip();
    let (b_x, b_y) = (ac.y * inverse, -ac.x * inverse);
    let (c_x, c_y) = (-ab.y * inverse, ab.x * inverse);
    let (near_b, near_c) = (b.z - a.z, c.z - a.z);
    // Whole lanes, as far as the picture goes: what is beyond the triangle is outside in any case.
    let right = width.min(left + (right - left).next_multiple_of(4));
    for y in top..bottom {
        let (dx, dy) = (left as f32 + 0.5 - a.x, y as f32 + 0.5 - a.y);
        let (from_b, from_c) = (b_x * dx + b_y * dy, c_x * dx + c_y * dy);
        let put = |x: usize, pixels: Vec4| {
            let x = x as f32 + LANE;
            let (weight_b, weight_c) = (from_b + b_x * x, from_c + c_x * x);
            let is_inside = weight_b.min(weight_c).cmpge(Vec4::ZERO) & (weight_b + weight_c).cmple(Vec4::ONE);
            Vec4::select(is_inside, pixels.max(a.z + weight_b * near_b + weight_c * near_c), pixels)
        };
        let (lanes, rest) = near[y * width..][left..right].as_chunks_mut::<4>();
        for (number, lanes) in lanes.iter_mut().enumerate() {
            *lanes = put(number * 4, Vec4::from(*lanes)).to_array();
        }
        // At the picture's right edge.
        let at = lanes.len() * 4;
        for (number, pixel) in rest.iter_mut().enumerate() {
            *pixel = put(at + number, Vec4::splat(*pixel)).x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mullion_common::scene::{
        BaseMesh, BlockParts, LinkShape, MaterialId, NodeAxis, NodeExtent, PackedBounds, Split, VertexData,
    };
    use proptest::prelude::*;

    const SIZE: [u32; 2] = [64, 48];

    fn looking_ahead(kind: BoundsKind) -> DepthOccluder {
        let corners = [DVec3::new(-1.0, -0.75, -1.0), DVec3::new(1.0, -0.75, -1.0), DVec3::new(-1.0, 0.75, -1.0)];
        let projection = Projection::through_rectangle(DVec3::ZERO, corners, 0.1, &DAffine3::IDENTITY);
        let mut occluder = DepthOccluder::new(SIZE, kind);
        occluder.look(&projection);
        occluder.clip_from_local.push(projection.clip_from_local(&DAffine3::IDENTITY));
        occluder
    }

    /// Draws a square across the view, this far away, from one column to another of the picture from −1 to 1.
    fn draw_square(occluder: &mut DepthOccluder, away: f32, [left, right]: [f32; 2]) {
        let corner = |x: f32, y: f32| {
            let clip = occluder.clip_from_local[0] * Vec3::new(x * away, y * away, -away).extend(1.0);
            Vec3::new((clip.x / clip.w + 1.0) * 32.0, (1.0 - clip.y / clip.w) * 24.0, clip.w.recip())
        };
        let [a, b, c, d] = [corner(left, -1.0), corner(right, -1.0), corner(right, 1.0), corner(left, 1.0)];
        let near = &mut occluder.levels[0].near;
        fill((64, 48), near, [a, b, c], Facing::Counterclockwise);
        fill((64, 48), near, [a, c, d], Facing::Counterclockwise);
        occluder.build_levels();
    }

    fn bounds(center: Vec3, extent: NodeExtent) -> NodeBounds {
        NodeBounds { center, extent, cone_sine: None }
    }

    fn ball(center: Vec3, radius: f32) -> NodeBounds {
        let extent = NodeExtent {
            radius,
            axis: NodeAxis::along(Vec3::new(0.3, 0.5, 0.8)),
            cylinder_radius: radius,
            cylinder_above: radius,
            cylinder_below: radius,
            half_box: Vec3::splat(radius),
            ..NodeExtent::default()
        };
        bounds(center, extent)
    }

    fn hides(occluder: &DepthOccluder, bounds: &NodeBounds) -> bool {
        bounds_spread(occluder.kind, &occluder.clip_from_local[0], bounds).is_some_and(|spread| occluder.is_behind(&spread))
    }

    #[test]
    fn what_is_behind_is_hidden() {
        for kind in [BoundsKind::Sphere, BoundsKind::Box, BoundsKind::Cylinder] {
            let mut occluder = looking_ahead(kind);
            assert!(!hides(&occluder, &ball(Vec3::new(0.0, 0.0, -9.0), 0.5)), "{kind:?}: nothing is drawn");
            draw_square(&mut occluder, 5.0, [-1.0, 0.0]);
            assert!(hides(&occluder, &ball(Vec3::new(-3.0, 0.0, -9.0), 0.5)), "{kind:?}: behind it");
            assert!(!hides(&occluder, &ball(Vec3::new(-1.0, 0.0, -4.0), 0.5)), "{kind:?}: before it");
            assert!(!hides(&occluder, &ball(Vec3::new(-1.0, 0.0, -5.2), 0.5)), "{kind:?}: through it");
            assert!(!hides(&occluder, &ball(Vec3::new(0.0, 0.0, -9.0), 0.5)), "{kind:?}: half beside it");
            assert!(!hides(&occluder, &ball(Vec3::new(3.0, 0.0, -9.0), 0.5)), "{kind:?}: beside it");
            assert!(!hides(&occluder, &ball(Vec3::new(0.0, 0.0, 0.0), 0.5)), "{kind:?}: around the eye");
            assert!(hides(&occluder, &ball(Vec3::new(-900.0, 0.0, -9.0), 0.5)), "{kind:?}: outside");
        }
    }

    /// Before and behind a wall: a small sphere, asked about link by link. Of its first split all that comes of it is looked at, too, as another
    /// comes after it.
    #[test]
    fn splits_behind_are_hidden() {
        let hierarchy = small_sphere();
        let [first, last] = [0, 1].map(|number| StepId(hierarchy.base_count() + number));
        let hierarchy = Hierarchy::Vertices(hierarchy);
        let cases = [
            (first, -9.0, Hidden::Node),
            (first, -5.4, Hidden::Split), // its box is not behind
            (first, -5.0, Hidden::Nothing),
            (first, -3.0, Hidden::Nothing),
            (last, -9.0, Hidden::Split),
            (last, -3.0, Hidden::Nothing),
        ];
        for (step, z, hidden) in cases {
            let mut occluder = looking_ahead(BoundsKind::Link);
            let projection = occluder.projection.expect("it looks");
            draw_square(&mut occluder, 5.0, [-1.0, 1.0]);
            occluder.clip_from_local[0] = projection.clip_from_local(&DAffine3::from_translation(DVec3::new(0.3, 0.1, z)));
            assert_eq!(occluder.hides(0, &hierarchy, step), Some(hidden), "{step:?} at {z}");
        }
    }

    /// A tetrahedron, and two splits of one vertex: the first puts one outside its first face, the second one over a face of that.
    fn small_sphere() -> VertexHierarchy {
        let corners =
            [[0.0, 0.3, 0.0], [0.3, -0.2, 0.0], [-0.3, -0.2, 0.0], [0.0, 0.0, -0.4], [0.0, 0.0, 0.3], [-0.15, 0.1, 0.2]];
        let triangles = [[2, 1, 0], [3, 0, 1], [3, 1, 2], [3, 2, 0]];
        let vertices = |positions: &[[f32; 3]]| VertexData { positions: positions.to_vec(), ..VertexData::default() };
        let mut hierarchy = VertexHierarchy::new(BaseMesh {
            vertices: vertices(&corners[..4]),
            triangles: triangles.to_vec(),
            materials: vec![MaterialId(0)],
            vertex_total: 6,
            triangle_total: 8,
            block_count: 1,
            local_min: [-0.3, -0.2, -0.4],
            local_max: [0.3, 0.3, 0.3],
            ..BaseMesh::default()
        })
        .expect("a base");
        let extent = NodeExtent { error: 0.3, radius: 0.6, half_box: Vec3::splat(0.6), ..NodeExtent::default() };
        hierarchy
            .append(BlockParts {
                first: 4,
                vertices: vertices(&corners[4..]),
                splits: vec![Split::new(PackedBounds::new(&extent), 3, LinkShape::Ring, false); 2],
                links: vec![0, 2, 1, 0, 2, 4],
            })
            .expect("a block");
        hierarchy
    }

    proptest! {
        /// Against every pixel asked for itself.
        #[test]
        fn triangles_are_filled(
            corners in [[-20.0..90.0f32, -20.0..70.0f32, 0.1..1.0f32], [-20.0..90.0f32, -20.0..70.0f32, 0.1..1.0f32], [-20.0..90.0f32, -20.0..70.0f32, 0.1..1.0f32]],
            facing in prop_oneof![Just(Facing::Counterclockwise), Just(Facing::Clockwise), Just(Facing::Either)],
        ) {
            let [a, b, c] = corners.map(Vec3::from);
            let area = |a: Vec3, b: Vec3, x: f32, y: f32| (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
            let all = area(a, b, c.x, c.y);
            prop_assume!(all.abs() > 1.0);
            let is_drawn = facing == Facing::Either || (all < 0.0) == (facing == Facing::Counterclockwise);
            let mut near = vec![0.0; 64 * 48];
            fill((64, 48), &mut near, [a, b, c], facing);
            for (at, found) in near.iter().enumerate() {
                let (x, y) = ((at % 64) as f32 + 0.5, (at / 64) as f32 + 0.5);
                let weights = [area(b, c, x, y) / all, area(c, a, x, y) / all, area(a, b, x, y) / all];
                let least = weights.iter().copied().fold(f32::INFINITY, f32::min);
                if least.abs() < 1e-3 {
                    continue; // on an edge
                }
                let expected = weights[0] * a.z + weights[1] * b.z + weights[2] * c.z;
                prop_assert!(if is_drawn && least > 0.0 { (found - expected).abs() < 1e-3 } else { *found == 0.0 }, "{found} at {x}, {y}");
            }
        }
    }

    #[test]
    fn a_picture_is_kept_while_the_view_is_about_the_same() {
        let mut occluder = DepthOccluder::new(SIZE, BoundsKind::Link);
        let turned = |degrees: f64| {
            let corners = [DVec3::new(-1.0, -0.75, -1.0), DVec3::new(1.0, -0.75, -1.0), DVec3::new(-1.0, 0.75, -1.0)];
            Projection::through_rectangle(DVec3::ZERO, corners, 0.1, &DAffine3::from_rotation_y(degrees.to_radians()))
        };
        assert!(!occluder.look(&turned(0.0)), "nothing is drawn");
        occluder.draw(&[], &[]);
        assert_eq!(
            [0.0, 7.0, -7.0, 9.0, 90.0, 180.0].map(|by| occluder.look(&turned(by))),
            [true, true, true, false, false, false]
        );
    }

    /// Beside the view and within the picture: of no use to the frame that draws, and to be seen by those that keep it.
    #[test]
    fn what_is_beside_the_view_is_left_out_by_the_frame_that_draws() {
        let mut occluder = looking_ahead(BoundsKind::Box);
        occluder.draw(&[], &[]);
        let projection = occluder.projection.expect("it looks");
        let wider = Mat4::from_scale(Vec3::new(WIDER.recip(), WIDER.recip(), 1.0));
        occluder.clip_from_local.push(wider * projection.clip_from_local(&DAffine3::IDENTITY));
        let [within, beside, beyond] = [9.0, 10.5, 13.0].map(|x| ball(Vec3::new(x, 0.0, -9.0), 0.5));
        assert_eq!([within, beside, beyond].map(|ball| hides(&occluder, &ball)), [false, true, true]);
        occluder.look(&projection);
        assert_eq!([within, beside, beyond].map(|ball| hides(&occluder, &ball)), [false, false, true]);
    }

    /// Boxes that are not cubes, to the side of the middle, around the left edge of a square.
    #[test]
    fn a_box_is_seen_as_far_as_it_is_not_behind() {
        let mut occluder = looking_ahead(BoundsKind::Box);
        let share = |occluder: &DepthOccluder, x: f64, z: f64| {
            let half = DVec3::new(0.6, 0.9, 0.3);
            let middle = DVec3::new(x, -0.4, z);
            occluder.visible_share(&DAffine3::from_translation(middle), &Aabb::of_points([-half, half]))
        };
        assert_eq!(share(&occluder, 0.0, -9.0), None, "nothing was drawn");
        occluder.draw(&[], &[]);
        assert_eq!(share(&occluder, 0.0, -9.0), Some(1.0), "before nothing");
        let projection = occluder.projection.expect("it looks");
        let wider = Mat4::from_scale(Vec3::new(WIDER.recip(), WIDER.recip(), 1.0));
        occluder.clip_from_local.push(wider * projection.clip_from_local(&DAffine3::IDENTITY));
        draw_square(&mut occluder, 5.0, [0.0, 1.0]);
        let half = share(&occluder, 0.0, -9.0).expect("it has pixels");
        assert!((half - 0.5).abs() < 0.15, "{half}");
        assert_eq!(share(&occluder, 2.0, -9.0), Some(0.0), "behind it");
        assert_eq!(share(&occluder, 2.0, -4.0), Some(1.0), "before it");
        let through = share(&occluder, 2.0, -5.2).expect("it has pixels");
        assert!((0.8..1.0).contains(&through), "its front is before it, one side goes on behind it: {through}");
        assert_eq!(share(&occluder, -2.0, -9.0), Some(1.0), "beside it");
        assert_eq!(share(&occluder, 0.2, -0.1), Some(1.0), "around the eye");
        assert_eq!(share(&occluder, 0.2, 9.0), None, "behind the eye");
    }

    #[test]
    fn what_faces_away_is_not_drawn() {
        let mut occluder = looking_ahead(BoundsKind::Box);
        draw_square(&mut occluder, 5.0, [1.0, -1.0]);
        assert!(occluder.levels[0].near.iter().all(|near| *near == 0.0));
    }

    proptest! {
        /// Where points of a cylinder lie, its spread reaches: and so with boxes and spheres.
        #[test]
        fn spreads_enclose(
            center in [-2.0..2.0f32, -2.0..2.0f32, -9.0..-3.0f32],
            direction in [-1.0..1.0f32, -1.0..1.0f32, -1.0..1.0f32],
            [radius, below, above] in [0.0..1.0f32, 0.0..1.0f32, 0.0..1.0f32],
            [turn, height, across] in [0.0..6.3f32, 0.0..1.0f32, 0.0..1.0f32],
        ) {
            let axis = NodeAxis::along(Vec3::from(direction));
            let (u, v) = axis.direction().any_orthonormal_pair();
            let point = |turn: f32, height: f32| {
                axis.direction() * (height * (below + above) - below) + (u * turn.cos() + v * turn.sin()) * radius * across
            };
            let inner = point(turn, height);
            let half = below.max(above).max(radius) * 2.0;
            let extent = NodeExtent {
                radius: half,
                axis,
                cylinder_radius: radius,
                cylinder_below: below,
                cylinder_above: above,
                half_box: Vec3::splat(half),
                ..NodeExtent::default()
            };
            let bounds = bounds(Vec3::from(center), extent);
            for kind in [BoundsKind::Sphere, BoundsKind::Box, BoundsKind::Cylinder] {
                let occluder = looking_ahead(kind);
                let clip = occluder.clip_from_local[0] * (bounds.center + inner).extend(1.0);
                let at = Vec3::new(clip.x / clip.w, clip.y / clip.w, clip.w.recip());
                if let Some(Spread { low, high }) = bounds_spread(occluder.kind, &occluder.clip_from_local[0], &bounds) {
                    prop_assert!((at + 1e-4).cmpge(low).all() && at.cmple(high + 1e-4).all(), "{kind:?}: {at} in {low} to {high}");
                }
            }
        }
    }
}
