//! What share of a cell its triangles cover, seen along the axes: the cell looked through at sample points.

use glam::Vec3;
use mullion_common::scene::{Cell, CellId, FACES};
use rayon::prelude::*;

use super::assign::Assigned;
use super::mesh::CellMesh;
use super::world::WorldLeaves;

/// Sample points along each side of a cell's box.
const SAMPLES: usize = 8;
const _: () = assert!(SAMPLES * SAMPLES == u64::BITS as usize);
/// What a cell that no sample point meets covers where it has triangles at all.
const UNKNOWN_COVER: u8 = 128;
/// A triangle's least area, m²: its logarithm is finite.
const LEAST_AREA_M2: f32 = 1e-20;

/// The cells of a tessellation.
pub(super) fn cells(world: &WorldLeaves, mesh: &CellMesh, assigned: &Assigned) -> Vec<Cell> {
    (0..mesh.corners.len() as u32)
        .into_par_iter()
        .map(|cell| {
            let triangles = || touching(world, assigned, cell);
            let corners = mesh.tetrahedron(cell).map(|p| p.as_vec3());
            let mut cover = [0; 6];
            for axis in 0..3 {
                let [ahead, back] = self::cover(&corners, axis, triangles());
                (cover[2 * axis], cover[2 * axis + 1]) = (ahead, back);
            }
            let triangle_count = triangles().count() as u32;
            let area_m2 = |[a, b, c]: [Vec3; 3]| ((b - a).cross(c - a).length() / 2.0).max(LEAST_AREA_M2);
            let log_sum: f32 = triangles().map(|(triangle, _)| area_m2(triangle).log2()).sum();
            let log_area = (4.0 * log_sum / triangle_count.max(1) as f32).round().clamp(-128.0, 127.0) as i8;
            Cell {
                corners: mesh.corners[cell as usize],
                neighbours: mesh.neighbours[cell as usize].map(CellId),
                run_end: assigned.run_ends[cell as usize],
                triangle_count,
                cover,
                log_area,
                reserved: 0,
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

/// The shares of a cell that fronts of triangles cover, 0 to 255, looking along an axis and against it.
fn cover(corners: &[Vec3; 4], axis: usize, triangles: impl Iterator<Item = ([Vec3; 3], Covers)>) -> [u8; 2] {
    let lines = Lines::through(corners, axis);
    // Where each line enters and leaves the cell; none meets it at first.
    let mut spans = [(f32::INFINITY, f32::NEG_INFINITY); SAMPLES * SAMPLES];
    for face in FACES {
        lines.meet(face.map(|k| corners[k]), |line, at, _| spans[line] = (spans[line].0.min(at), spans[line].1.max(at)));
    }
    // A bit for each line, for either way of looking.
    let mut covered = [0u64; 2];
    let mut some = false;
    for (triangle, covers) in triangles.filter(|(_, covers)| *covers != Covers::Nothing) {
        some = true;
        lines.meet(triangle, |line, at, front_is_ahead| {
            if (spans[line].0..=spans[line].1).contains(&at) {
                for (way, covered) in covered.iter_mut().enumerate() {
                    let is_seen = front_is_ahead == (way == 1) || covers == Covers::FromBothSides;
                    *covered |= u64::from(is_seen) << line;
                }
            }
        });
    }
    let all = spans.iter().filter(|(enter, leave)| enter <= leave).count() as u32;
    match (all, some) {
        (0, true) => [UNKNOWN_COVER; 2],
        (0, false) => [0; 2],
        _ => covered.map(|bits| (bits.count_ones() * 255 / all) as u8),
    }
}
