//! The paper's solidity: Fig. 6.

use glam::Vec3;
use mullion_common::scene::{CellId, FACES, Tessellation};

use super::drawn::Drawn;
use super::leaves::Leaves;
use super::sight::face;
use super::traversal::{CellMark, Cells};
use super::{Frame, Shown};

/// What is not star-shaped is that many times as solid. The paper names no factor.
const PENALTY: f32 = 4.0;

/// How solid the way to each cell is that waits.
#[derive(Debug, Default)]
pub(super) struct Paper {
    /// 1 / ρ_max.
    scale: f32,
}

impl Paper {
    pub fn begin(&mut self, tessellation: &Tessellation) {
        self.scale = 1.0 / tessellation.rho_max() as f32;
    }

    pub fn seed(&mut self, cells: &mut Cells, cell: CellId) {
        cells.front.enqueue(cell, 0.0);
    }

    /// Projects a cell: its neighbours that were not projected are enqueued, or moved to their new solidity.
    pub fn open(&mut self, cells: &mut Cells, tessellation: &Tessellation, a: CellId, solidity: f32) {
        cells.set(a, CellMark::Projected);
        let from_eye = cells.sight.corners_from_eye(tessellation, a);
        let cell = tessellation.cell(a);
        let own = cell.triangle_count as f32 * self.scale;
        for k in 0..4 {
            let Some(b) = cell.neighbours[k].get() else { continue };
            if !cells.is_in_sight(tessellation, b) || cells.mark(b) == CellMark::Projected {
                continue;
            }
            let solidity = own + alignment(&from_eye, k) * solidity;
            let star = is_star_shaped(&from_eye, k, &cells.sight.corners_from_eye(tessellation, b));
            cells.front.enqueue(b, if star { solidity } else { solidity * PENALTY });
        }
    }

    /// Draws a cell's triangles; whether the budget allowed all of them.
    pub fn draw(leaves: &mut Leaves, drawn: &mut Drawn, frame: &Frame<'_>, cell: CellId, budget: u32) -> bool {
        for (place, rows) in frame.tessellation.runs(cell) {
            let leaf = leaves.sight(frame, place);
            if leaf.shown == Shown::None {
                continue;
            }
            let first = frame.tessellation.slots(place).start;
            let facings = frame.tessellation.facings(place);
            for number in rows.flatten() {
                let slot = first + u32::from(number);
                if drawn.holds(slot) || leaf.is_away(facings[usize::from(number)]) {
                    continue;
                }
                if drawn.count() == budget {
                    return false;
                }
                drawn.take(place, slot);
            }
        }
        true
    }
}

/// v · n_B: how well a face, out of the cell, is aligned with the view towards it. Not below 0: on the way back to the eye nothing is taken off.
fn alignment(from_eye: &[Vec3; 4], k: usize) -> f32 {
    let (normal, [a, b, c]) = face(from_eye, k);
    let view = a + b + c;
    let lengths = normal.length_squared() * view.length_squared();
    if lengths > 0.0 { (normal.dot(view) / lengths.sqrt()).max(0.0) } else { 0.0 }
}

/// Whether the middle of the neighbour beyond a face is seen from the eye, at the origin, through that face.
fn is_star_shaped(from_eye: &[Vec3; 4], k: usize, beyond: &[Vec3; 4]) -> bool {
    let middle = beyond[0] + beyond[1] + beyond[2] + beyond[3];
    let [a, b, c] = FACES[k].map(|k| from_eye[k]);
    // A face that is left forwards is clockwise for the eye.
    let sides = [a.cross(b).dot(middle), b.cross(c).dot(middle), c.cross(a).dot(middle)];
    sides.iter().all(|side| *side >= 0.0)
}
