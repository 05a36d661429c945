//! Which triangles touch which cells.

use std::iter;

use glam::DVec3;
use mullion_common::scene::{LeafRun, push_numbers};
use rayon::prelude::*;

use super::TessellateError;
use super::mesh::{CellMesh, NO_CELL};
use super::world::{WorldLeaf, WorldLeaves};

/// Leaves are shared out in about so many parts, each with marks of its own for all cells.
const PARTS: usize = 16;
/// What coordinates in `f32` may be off, as a share of the longest side: a triangle that comes so close to a cell touches it.
const SLACK_SHARE: f64 = 1e-6;

/// Runs of all cells.
pub(super) struct Assigned {
    pub runs: Vec<LeafRun>,
    pub words: Vec<u16>,
    /// The numbers that the words stand for, for each run one past its last.
    pub triangles: Vec<u16>,
    pub ends: Vec<u32>,
    /// For each cell, one past its last run.
    pub run_ends: Vec<u32>,
}

/// Lists every triangle in every cell that it touches. Conservative within [`SLACK_SHARE`].
pub(super) fn assign(world: &WorldLeaves, mesh: &CellMesh) -> Result<Assigned, TessellateError> {
    let slack_m = f64::from(world.longest_m) * SLACK_SHARE;
    let part = world.leaves.len().div_ceil(PARTS).max(1);
    let of_parts: Vec<Vec<Vec<(u32, u16)>>> = world
        .leaves
        .par_chunks(part)
        .map(|leaves| {
            let mut search = Search { mesh, slack_m, stamps: vec![0; mesh.corners.len()], stamp: 0, near: 0, open: Vec::new() };
            leaves.iter().map(|leaf| search.touched(leaf)).collect()
        })
        .collect();
    let of_leaves: Vec<Vec<(u32, u16)>> = of_parts.into_iter().flatten().collect();
    let references: u64 = of_leaves.iter().map(|pairs| pairs.len() as u64).sum();
    if references > u64::from(u32::MAX) {
        return Err(TessellateError::TooMany { what: "references to triangles", found: references, cap: u32::MAX.into() });
    }
    Ok(by_cell(&of_leaves, mesh.corners.len(), references as usize))
}

/// Sorts pairs of cell and triangle, which come leaf by leaf and triangle by triangle, by cell.
fn by_cell(of_leaves: &[Vec<(u32, u16)>], cells: usize, references: usize) -> Assigned {
    let mut starts = vec![0u32; cells + 1];
    of_leaves.iter().flatten().for_each(|(cell, _)| starts[*cell as usize + 1] += 1);
    for cell in 0..cells {
        starts[cell + 1] += starts[cell];
    }
    let mut next = starts.clone();
    let mut sorted = vec![(0u32, 0u16); references];
    for (place, pairs) in of_leaves.iter().enumerate() {
        for (cell, number) in pairs {
            let at = &mut next[*cell as usize];
            sorted[*at as usize] = (place as u32, *number);
            *at += 1;
        }
    }
    let (mut runs, mut words, mut ends) = (Vec::new(), Vec::new(), Vec::new());
    let mut numbers: Vec<u16> = Vec::new();
    let mut run_ends = Vec::with_capacity(cells);
    for cell in 0..cells {
        let (start, end) = (starts[cell], starts[cell + 1]);
        let mut at = start;
        for run in sorted[start as usize..end as usize].chunk_by(|a, b| a.0 == b.0) {
            at += run.len() as u32;
            numbers.clear();
            numbers.extend(run.iter().map(|(_, number)| number));
            push_numbers(&mut words, &numbers);
            runs.push(LeafRun { place: run[0].0, end: words.len() as u32 });
            ends.push(at);
        }
        run_ends.push(runs.len() as u32);
    }
    Assigned { runs, words, triangles: sorted.into_iter().map(|(_, number)| number).collect(), ends, run_ends }
}

struct Search<'a> {
    mesh: &'a CellMesh,
    slack_m: f64,
    /// The last triangle that asked each cell.
    stamps: Vec<u32>,
    stamp: u32,
    /// Where the last triangle was.
    near: u32,
    open: Vec<u32>,
}

impl Search<'_> {
    /// The cells that a leaf's triangles touch.
    fn touched(&mut self, leaf: &WorldLeaf) -> Vec<(u32, u16)> {
        let mut pairs = Vec::with_capacity(leaf.triangles.len() * 2);
        for (number, triangle) in leaf.triangles.iter().enumerate() {
            // No leaf that is covered has more triangles than 16 bits number.
            self.spread(&triangle.map(|p| p.as_dvec3()), |cell| pairs.push((cell, number as u16)));
        }
        pairs
    }

    /// From the cell of a corner to neighbours beyond faces that the triangle reaches. The cells that a triangle touches hang together by
    /// faces that it touches, as it is connected and cells are closed.
    fn spread(&mut self, triangle: &[DVec3; 3], mut touch: impl FnMut(u32)) {
        self.near = self.mesh.locate(triangle[0], self.near);
        self.stamp += 1;
        self.stamps[self.near as usize] = self.stamp;
        self.open.push(self.near);
        while let Some(cell) = self.open.pop() {
            touch(cell);
            for (plane, &beyond) in self.mesh.planes(cell).iter().zip(&self.mesh.neighbours[cell as usize]) {
                if beyond == NO_CELL || self.stamps[beyond as usize] == self.stamp {
                    continue;
                }
                // All of the neighbour is beyond the face's plane.
                let reaches = triangle.iter().any(|p| plane.height_m(*p) >= -self.slack_m);
                if reaches {
                    self.stamps[beyond as usize] = self.stamp;
                    if touches(triangle, &self.mesh.tetrahedron(beyond), self.slack_m) {
                        self.open.push(beyond);
                    }
                }
            }
        }
    }
}

/// Whether a triangle comes within `slack_m` of a tetrahedron, by the separating axes of both: five normals and eighteen products of edges.
/// Conservative: where the products vanish, the axis says nothing.
pub(super) fn touches(triangle: &[DVec3; 3], cell: &[DVec3; 4], slack_m: f64) -> bool {
    let separates = |axis: DVec3| {
        let length = axis.length();
        let span = |points: &[DVec3]| {
            points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
                let at = axis.dot(*p - cell[0]);
                (low.min(at), high.max(at))
            })
        };
        let ((a, b), (c, d)) = (span(triangle), span(cell));
        let slack = slack_m * length;
        length > 0.0 && (a > d + slack || c > b + slack)
    };
    let edges = [triangle[1] - triangle[0], triangle[2] - triangle[1], triangle[0] - triangle[2]];
    let sides =
        [cell[1] - cell[0], cell[2] - cell[0], cell[3] - cell[0], cell[2] - cell[1], cell[3] - cell[1], cell[3] - cell[2]];
    let faces = [sides[0].cross(sides[1]), sides[1].cross(sides[2]), sides[2].cross(sides[0]), sides[3].cross(sides[4])];
    let normals = iter::once(edges[0].cross(edges[1])).chain(faces);
    let products = edges.into_iter().flat_map(|edge| sides.into_iter().map(move |side| edge.cross(side)));
    !normals.chain(products).any(separates)
}

#[cfg(test)]
mod tests;
