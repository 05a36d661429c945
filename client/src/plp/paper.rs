//! The paper's solidity, as its text has it: that of the cells on the way from the eye to a cell.
//!
//! ```text
//! Fig. 6, as printed                          here
//! ρ_B = |A| / ρ_max + (v · n_B) ρ_A           ρ_B = |A| + ρ_A
//! not star-shaped: apply_penalty_factor(ρ_B)  not star-shaped: ρ_B + the mean of |c|
//! enqueue(B, ρ_B), whatever it had            enqueue(B, ρ_B + |B| / 2), where that is less than it had; ties: the nearest first
//! project(A): its triangles are drawn         of A a share s is in sight: they are drawn in the turn of ρ_A + 0.05 · the mean of |c| (1/s − 1)
//! ```
//! Where it leaves the figure's letter, `mullion bench plp` has the reason; what is found at 1, 2, 5 and 10 % of the budget stands in
//! `benches/record/plp.md`.
//!
//! - v · n_B is left out. A product of many numbers below 1 forgets all but the last few cells, though solidity "is defined in terms of the
//!   solidity of the cells that intersect the closure of a segment from the cell B to the eye point": what is behind a wall, reached by a face
//!   seen from its edge, would be as good as new.
//! - The penalty is a summand: no factor penalises a cell of solidity 0, and such are all that the eye sees through empty space. It is one cell
//!   more on the way, of the mean size of those that hold triangles.
//! - Of all ways to a cell the least solid counts, so that it matters not which neighbour was projected last: Dijkstra's order.
//! - The way ends in the middle of B, with half of its own triangles. Otherwise all cells behind empty ones were equal, and they alone may be
//!   more than a budget.
//! - A cell of which the frustum holds a part is projected in its turn, and its triangles are drawn later, the smaller the part: cells have
//!   corners in common, and many come into the frustum at once.
//! - ρ_max would divide all alike, and no order hangs on it.
//!
//! Counts, the geometry of cells and the frustum are all that it uses.

use std::ops::ControlFlow;

use glam::Vec3;
use mullion_common::scene::{CellId, FACES, Tessellation};

use super::Frame;
use super::drawn::Drawn;
use super::leaves::Leaves;
use super::traversal::{CellMark, Cells};

/// How long a cell's triangles wait that is in sight by a half, as a share of the penalty.
const WAITS_AT_EDGE: f32 = 0.05;

/// How solid the way to the middle of each cell is that was reached, in halves of a triangle: whole numbers, so that ways that are
/// alike are equal.
#[derive(Debug, Default)]
pub(super) struct Paper {
    ways: Vec<f32>,
    /// What is added where a cell is not star-shaped.
    penalty: f32,
    /// How far from the eye cells are, metres, in the large.
    reach_m: f32,
}

impl Paper {
    pub fn begin(&mut self, tessellation: &Tessellation, eye: Vec3) {
        self.ways.resize(tessellation.cells().len(), 0.0);
        self.penalty = 2.0 * tessellation.rho_mean() as f32;
        self.reach_m = eye.length();
    }

    pub fn seed(&mut self, cells: &mut Cells, tessellation: &Tessellation, cell: CellId) {
        let from_eye = cells.sight.corners_from_eye(tessellation, cell);
        self.come(cells, tessellation, cell, &from_eye, 0.0);
    }

    /// Projects a cell: its neighbours that were not projected are enqueued, or moved to their new solidity. Whether its triangles are to be
    /// drawn at once; else they wait in the front.
    pub fn open(&mut self, cells: &mut Cells, tessellation: &Tessellation, a: CellId) -> bool {
        cells.set(a, CellMark::Projected);
        let from_eye = cells.sight.corners_from_eye(tessellation, a);
        let cell = tessellation.cell(a);
        let through = self.ways[a.index()] + cell.triangle_count as f32;
        for k in 0..4 {
            let Some(b) = cell.neighbours[k].get() else { continue };
            if !cells.is_in_sight(tessellation, b) || cells.mark(b) == CellMark::Projected {
                continue;
            }
            let beyond = cells.sight.corners_from_eye(tessellation, b);
            let penalty = if is_star_shaped(&from_eye, k, &beyond) { 0.0 } else { self.penalty };
            self.come(cells, tessellation, b, &beyond, through + penalty);
        }
        let root = cells.root_in_sight(tessellation, a);
        let is_at_edge = root < 1.0 && cell.triangle_count > 0;
        if is_at_edge {
            cells.front.enqueue(a, self.ways[a.index()] + WAITS_AT_EDGE * self.penalty * (1.0 / (root * root) - 1.0));
        }
        !is_at_edge
    }

    /// update_solidity: there is a way to a cell that is as solid as that up to the cell.
    fn come(&mut self, cells: &mut Cells, tessellation: &Tessellation, b: CellId, from_eye: &[Vec3; 4], way: f32) {
        let way = way + tessellation.cell(b).triangle_count as f32;
        if cells.mark(b) == CellMark::Reached && way >= self.ways[b.index()] {
            return;
        }
        cells.set(b, CellMark::Reached);
        self.ways[b.index()] = way;
        let distance_m = (from_eye[0] + from_eye[1] + from_eye[2] + from_eye[3]).length() * 0.25;
        // Below a half, which no two solidities are closer than.
        let tie = 0.5 * distance_m / (distance_m + self.reach_m).max(f32::MIN_POSITIVE);
        cells.front.enqueue(b, way + tie);
    }

    /// Draws a cell's triangles; whether the budget allowed all of them.
    pub fn draw(leaves: &mut Leaves, drawn: &mut Drawn, frame: &Frame<'_>, cell: CellId, budget: u32) -> bool {
        leaves.visit(frame, cell, drawn, |drawn, candidate| {
            if drawn.count() == budget {
                return ControlFlow::Break(());
            }
            drawn.take(candidate.place, candidate.slot);
            ControlFlow::Continue(())
        })
    }
}

/// Whether the middle of the neighbour beyond a face is seen from the eye, at the origin, through that face.
fn is_star_shaped(from_eye: &[Vec3; 4], k: usize, beyond: &[Vec3; 4]) -> bool {
    let middle = beyond[0] + beyond[1] + beyond[2] + beyond[3];
    let [a, b, c] = FACES[k].map(|k| from_eye[k]);
    // A face that is left forwards is clockwise for the eye.
    let sides = [a.cross(b).dot(middle), b.cross(c).dot(middle), c.cross(a).dot(middle)];
    sides.iter().all(|side| *side >= 0.0)
}
