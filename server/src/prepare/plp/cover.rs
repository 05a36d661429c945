//! What share of a cell its triangles cover, seen along the axes: the cell looked through at sample points.

use glam::Vec3;
use mullion_common::scene::{Cell, CellId, Cover, FACES};
use rayon::prelude::*;

use super::assign::Assigned;
use super::mesh::CellMesh;
use super::world::WorldLeaves;

/// Sample points along each side of a cell's box.
const SAMPLES: usize = 16;
/// What a cell that no sample point meets covers where it has triangles at all.
const UNKNOWN_SHARE: f32 = 0.5;

/// The cells of a tessellation.
pub(super) fn cells(world: &WorldLeaves, mesh: &CellMesh, assigned: &Assigned) -> Vec<Cell> {
    (0..mesh.corners.len() as u32)
        .into_par_iter()
        .map(|cell| {
            let triangles = || touching(world, assigned, cell);
            let corners = mesh.tetrahedron(cell).map(|p| p.as_vec3());
            let mut shares = [[0.0; 4]; 6];
            for axis in 0..3 {
                [shares[2 * axis], shares[2 * axis + 1]] = shares_along(&corners, axis, triangles());
            }
            let triangle_count = triangles().count() as u32;
            Cell {
                corners: mesh.corners[cell as usize],
                neighbours: mesh.neighbours[cell as usize].map(CellId),
                run_end: assigned.run_ends[cell as usize],
                triangle_count,
                cover: Cover::new(shares),
            }
        })
        .collect()
}

/// How a triangle covers what is behind it.
#[derive(Clone, Copy, PartialEq)]
enum Covers {
    Nothing,
    FromItsFront,
    FromBothSides,
}

/// The triangles that touch a cell.
fn touching<'a>(world: &'a WorldLeaves, assigned: &'a Assigned, cell: u32) -> impl Iterator<Item = ([Vec3; 3], Covers)> + 'a {
    let end_before = |ends: &[u32]| (cell as usize).checked_sub(1).map_or(0, |before| ends[before]) as usize;
    let runs = end_before(&assigned.run_ends)..assigned.run_ends[cell as usize] as usize;
    let mut start = runs.start.checked_sub(1).map_or(0, |before| assigned.ends[before] as usize);
    assigned.runs[runs.clone()].iter().zip(&assigned.ends[runs]).flat_map(move |(run, end)| {
        let numbers = &assigned.triangles[start..*end as usize];
        start = *end as usize;
        let leaf = &world.leaves[run.place as usize];
        let covers = match (leaf.surface.opaque, leaf.surface.double_sided) {
            (false, _) => Covers::Nothing,
            (true, false) => Covers::FromItsFront,
            (true, true) => Covers::FromBothSides,
        };
        numbers.iter().map(move |number| (leaf.triangles[*number as usize], covers))
    })
}

/// Sample lines along an axis through a cell's box.
struct Lines {
    axis: usize,
    low: [f32; 2],
    step: [f32; 2],
}

impl Lines {
    fn through(corners: &[Vec3; 4], axis: usize) -> Self {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let (low, high) = corners.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let step = [(high[u] - low[u]) / SAMPLES as f32, (high[v] - low[v]) / SAMPLES as f32];
        Self { axis, low: [low[u], low[v]], step }
    }

    /// Calls `meet` for each line that meets a triangle: with its number, where they meet, and whether the triangle's front is towards the
    /// greater coordinates.
    fn meet(&self, triangle: [Vec3; 3], mut meet: impl FnMut(usize, f32, bool)) {
        let [u, v] = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        let [a, b, c] = triangle.map(|p| [p[u] - self.low[0], p[v] - self.low[1]]);
        let doubled = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if doubled == 0.0 {
            return; // seen from its edge
        }
        let range = |k: usize| {
            let (least, most) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
            let first = (least / self.step[k] - 0.5).ceil().clamp(0.0, SAMPLES as f32);
            let end = ((most / self.step[k] - 0.5).floor() + 1.0).clamp(0.0, SAMPLES as f32);
            first as usize..end as usize
        };
        for y in range(1) {
            for x in range(0) {
                let p = [(x as f32 + 0.5) * self.step[0], (y as f32 + 0.5) * self.step[1]];
                let side = |p0: [f32; 2], p1: [f32; 2]| (p1[0] - p0[0]) * (p[1] - p0[1]) - (p1[1] - p0[1]) * (p[0] - p0[0]);
                let weights = [side(b, c) / doubled, side(c, a) / doubled, side(a, b) / doubled];
                if weights.iter().all(|weight| *weight >= 0.0) {
                    let at = triangle.iter().zip(weights).map(|(p, weight)| p[self.axis] * weight).sum();
                    meet(y * SAMPLES + x, at, doubled > 0.0);
                }
            }
        }
    }
}

/// A sample line in a cell: where it enters and leaves, and by which faces.
#[derive(Clone, Copy)]
struct Span {
    enter: (f32, usize),
    leave: (f32, usize),
    /// Whether a front is met, looking along the axis and against it.
    covered: [bool; 2],
}

/// The shares that fronts cover of the lines that leave by each face, looking along an axis and against it.
fn shares_along(corners: &[Vec3; 4], axis: usize, triangles: impl Iterator<Item = ([Vec3; 3], Covers)>) -> [[f32; 4]; 2] {
    let lines = Lines::through(corners, axis);
    let nowhere = Span { enter: (f32::INFINITY, 0), leave: (f32::NEG_INFINITY, 0), covered: [false; 2] };
    let mut spans = [nowhere; SAMPLES * SAMPLES];
    for (k, face) in FACES.into_iter().enumerate() {
        lines.meet(face.map(|k| corners[k]), |line, at, _| {
            let span = &mut spans[line];
            span.enter = if at < span.enter.0 { (at, k) } else { span.enter };
            span.leave = if at > span.leave.0 { (at, k) } else { span.leave };
        });
    }
    let mut some = false;
    for (triangle, covers) in triangles.filter(|(_, covers)| *covers != Covers::Nothing) {
        some = true;
        lines.meet(triangle, |line, at, front_is_ahead| {
            let span = &mut spans[line];
            if (span.enter.0..=span.leave.0).contains(&at) {
                // Looking along the axis, fronts are those that face against it.
                span.covered[usize::from(front_is_ahead)] = true;
                span.covered[usize::from(!front_is_ahead)] |= covers == Covers::FromBothSides;
            }
        });
    }
    let met = || spans.iter().filter(|span| span.enter.0 <= span.leave.0);
    std::array::from_fn(|way| {
        let share = |of: &dyn Fn(&Span) -> bool| {
            let all = met().filter(|span| of(span)).count();
            let covered = met().filter(|span| of(span) && span.covered[way]).count();
            (all > 0).then(|| covered as f32 / all as f32)
        };
        // A face that no line leaves by has what the whole cell has.
        let whole = share(&|_| true).unwrap_or(if some { UNKNOWN_SHARE } else { 0.0 });
        std::array::from_fn(|face| {
            share(&|span| if way == 0 { span.leave.1 == face } else { span.enter.1 == face }).unwrap_or(whole)
        })
    })
}
