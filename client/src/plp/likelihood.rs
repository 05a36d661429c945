//! How likely a triangle is seen: what comes through to its cell, how far it lies open towards the eye, how large it appears.
//!
//! Light goes from the eye's cell on through faces, from front to back. A cell gets what its neighbours before it let through, by the solid
//! angles of the faces between; of that, its triangles' fronts keep a share, which was measured along the axes. Then it waits for the turn that
//! its most open triangle may have at best: what lies in the dark and hardly open is never looked at. When that comes, its triangles are sorted
//! by how likely they are seen, and drawn class by class: those that lie open first, those that hardly do after what lies open further back.
//! Of a cell of which the frustum holds a part, they are as likely in sight as that part is large; and the light that came through it counts
//! by the root of that, among what came through others: it may be out of sight with the next frame. (In `mullion bench plp` more triangles come
//! and go by the part itself, and most of all by neither.) The brightest face counts in full, however little of the cell before it is in sight.
//!
//! Only sums, products, quotients and square roots: the same order on every machine.

use std::ops::ControlFlow;

use glam::Vec3;
use mullion_common::scene::{CellId, Exposure, ExposureWeights, Tessellation};

use super::Frame;
use super::drawn::Drawn;
use super::leaves::Leaves;
use super::sight::{CellSight, face};
use super::traversal::{CellMark, Cells};

/// Classes of likelihood, where all light comes through: 1 to a half, a half to a quarter, and so on.
const CLASSES: usize = 12;
/// How likely a triangle is seen that does not lie open at all.
const LEAST_OPEN: f32 = 0.004;
/// What no cover keeps: openings that samples missed.
const LEAST_THROUGH: f32 = 0.02;
/// How much of a cell's light is that of its brightest face; the rest is the mean. A mean alone gets dark along the surface of what is in full
/// view, where a part of each cell is inside; the brightest alone lets light around every corner. `mullion bench plp` tells them apart.
const BRIGHTEST_SHARE: f32 = 0.4;
/// As many pixels that lie open make it as likely as not that one is seen.
const PIXELS_TO_BE_SEEN: f32 = 1.0;

/// What is known of the cells that light has come to, and the triangles of those that are open.
#[derive(Debug, Default)]
pub(super) struct Likelihood {
    cells: Vec<Lit>,
    /// By cell: more than what of any of its triangles lies open in any direction, m².
    open_m2: Vec<f32>,
    /// Triangles of open cells, a cell's in one piece, likely ones first.
    candidates: Vec<Candidate>,
    sorted: Vec<Candidate>,
}

/// Valid once its cell was reached in this frame.
#[derive(Clone, Copy, Debug, Default)]
struct Lit {
    /// Solid angles of its faces: above 0 where light goes out.
    angles: [f32; 4],
    /// Of the faces that light comes in by.
    all: f32,
    /// Light times solid angle, so far.
    came: f32,
    /// Light of the brightest of these faces.
    brightest: f32,
    /// Its triangles that were not drawn yet, among the candidates; [`UNSORTED`]: they are not there yet.
    next: u32,
    end: u32,
}

/// The triangles of a cell that is open are no candidates yet.
const UNSORTED: u32 = u32::MAX;

#[derive(Clone, Copy, Debug, Default)]
struct Candidate {
    slot: u32,
    place: u32,
    class: u8,
}

impl Likelihood {
    pub fn begin(&mut self, tessellation: &Tessellation) {
        self.cells.resize(tessellation.cells().len(), Lit::default());
        self.candidates.clear();
        if self.open_m2.len() != tessellation.cells().len() {
            self.open_m2 = (0..tessellation.cells().len() as u32).map(|cell| most_open_m2(tessellation, CellId(cell))).collect();
        }
    }

    /// All light comes to a cell.
    pub fn seed(&mut self, cells: &mut Cells, tessellation: &Tessellation, cell: CellId) {
        cells.set(cell, CellMark::Reached);
        let angles = cells.sight.solid_angles(tessellation, cell);
        self.cells[cell.index()] = Lit { angles, all: 1.0, came: 1.0, brightest: 1.0, ..Lit::default() };
        cells.front.enqueue(cell, -1.0);
    }

    /// Opens a cell: light goes on to the neighbours behind it, and it waits for the turn that its triangles have at best.
    pub fn open(&mut self, cells: &mut Cells, tessellation: &Tessellation, id: CellId) {
        cells.set(id, CellMark::Projected);
        let from_eye = cells.sight.corners_from_eye(tessellation, id);
        let cell = tessellation.cell(id);
        let lit = &self.cells[id.index()];
        let (light, angles, in_sight) = (lit.light(), lit.angles, cells.root_in_sight(tessellation, id));
        let view = from_eye[0] + from_eye[1] + from_eye[2] + from_eye[3];
        for (k, angle) in angles.into_iter().enumerate() {
            let Some(beyond) = cell.neighbours[k].get() else { continue };
            if angle > 0.0 && cells.is_in_sight(tessellation, beyond) && cells.mark(beyond) != CellMark::Projected {
                let out = face(&from_eye, k).0;
                let through = light * (1.0 - cell.cover.of_face(k, out, view)).max(LEAST_THROUGH);
                self.shine(cells, tessellation, beyond, angle * in_sight, through);
            }
        }
        if cell.triangle_count > 0 {
            let lit = &mut self.cells[id.index()];
            (lit.next, lit.end) = (UNSORTED, 0);
            let at_best = class(self.open_m2[id.index()] * pixels_per_m2(&cells.sight, view * 0.25));
            self.wait_for(cells, tessellation, id, at_best);
        }
    }

    /// Whether nothing of an open cell is left.
    pub fn is_whole(&self, cell: CellId) -> bool {
        let Lit { next, end, .. } = self.cells[cell.index()];
        next == end
    }

    /// Draws the class whose turn it is; whether the budget allowed all of it. The cell waits for its next class. One whose triangles were not
    /// sorted yet waits for its first.
    pub fn draw(
        &mut self,
        cells: &mut Cells,
        (leaves, drawn): (&mut Leaves, &mut Drawn),
        frame: &Frame<'_>,
        cell: CellId,
        budget: u32,
    ) -> bool {
        if self.cells[cell.index()].next == UNSORTED {
            self.sort_triangles(cells, leaves, drawn, frame, cell);
            self.wait(cells, frame.tessellation, cell);
            return true;
        }
        let Lit { next, end, .. } = self.cells[cell.index()];
        let class = self.candidates[next as usize].class;
        for at in next..end {
            let candidate = self.candidates[at as usize];
            if candidate.class != class {
                self.cells[cell.index()].next = at;
                self.wait(cells, frame.tessellation, cell);
                return true;
            }
            if !drawn.holds(candidate.slot) {
                if drawn.count() == budget {
                    self.cells[cell.index()].next = at;
                    return false;
                }
                drawn.take(candidate.place, candidate.slot);
            }
        }
        self.cells[cell.index()].next = end;
        true
    }

    /// Enqueues an open cell by its next class, if there is one.
    fn wait(&self, cells: &mut Cells, tessellation: &Tessellation, cell: CellId) {
        let Lit { next, end, .. } = self.cells[cell.index()];
        if next < end {
            self.wait_for(cells, tessellation, cell, self.candidates[next as usize].class);
        }
    }

    fn wait_for(&self, cells: &mut Cells, tessellation: &Tessellation, cell: CellId, class: u8) {
        let in_sight = cells.root_in_sight(tessellation, cell);
        cells.front.enqueue(cell, -(self.cells[cell.index()].weight() * in_sight * in_sight * likely(class)));
    }

    /// Light comes to a cell by a face of this solid angle, as far as that counts.
    fn shine(&mut self, cells: &mut Cells, tessellation: &Tessellation, cell: CellId, angle: f32, light: f32) {
        if cells.mark(cell) != CellMark::Reached {
            cells.set(cell, CellMark::Reached);
            let angles = cells.sight.solid_angles(tessellation, cell);
            let neighbours = tessellation.cell(cell).neighbours;
            let mut all = f32::MIN_POSITIVE;
            for (before, angle) in neighbours.into_iter().zip(angles) {
                if let Some(before) = before.get().filter(|_| angle < 0.0) {
                    all -= angle * cells.root_in_sight(tessellation, before);
                }
            }
            self.cells[cell.index()] = Lit { angles, all, ..Lit::default() };
        }
        let lit = &mut self.cells[cell.index()];
        lit.came = (lit.came + angle * light).min(lit.all);
        lit.brightest = lit.brightest.max(light);
        cells.front.enqueue(cell, -lit.weight());
    }

    /// Notes the triangles of a cell that may be seen and are not drawn, by class.
    fn sort_triangles(&mut self, cells: &Cells, leaves: &mut Leaves, drawn: &mut Drawn, frame: &Frame<'_>, cell: CellId) {
        let tessellation = frame.tessellation;
        let [a, b, c, d] = cells.sight.corners_from_eye(tessellation, cell);
        let middle = (a + b + c + d) * 0.25;
        let weights = ExposureWeights::towards(-middle);
        let pixels_per_m2 = pixels_per_m2(&cells.sight, middle);
        let start = self.candidates.len();
        let mut counts = [0usize; CLASSES + 1];
        leaves.visit(frame, cell, drawn, |_, open| {
            let pixels_per_m2 = pixels_per_m2 * open.leaf.slope(open.facing);
            let exposure = tessellation.exposures()[open.slot as usize];
            let class = class(open_m2(exposure, weights.of(exposure)) * pixels_per_m2);
            counts[usize::from(class) + 1] += 1;
            self.candidates.push(Candidate { slot: open.slot, place: open.place, class });
            ControlFlow::Continue(())
        });
        let lit = &mut self.cells[cell.index()];
        (lit.next, lit.end) = (start as u32, self.candidates.len() as u32);
        if lit.next == lit.end {
            return;
        }
        for class in 0..CLASSES {
            counts[class + 1] += counts[class];
        }
        self.sorted.clear();
        self.sorted.resize(self.candidates.len() - start, Candidate::default());
        for candidate in &self.candidates[start..] {
            let at = &mut counts[usize::from(candidate.class)];
            self.sorted[*at] = *candidate;
            *at += 1;
        }
        self.candidates[start..].copy_from_slice(&self.sorted);
    }
}

impl Lit {
    /// What comes through to the cell, 0 to 1.
    fn light(&self) -> f32 {
        BRIGHTEST_SHARE * self.brightest + (1.0 - BRIGHTEST_SHARE) * self.came / self.all
    }

    /// How much that counts, as its square: what is in the dark counts less than its light says, as hidden triangles of a cell are hidden
    /// together.
    fn weight(&self) -> f32 {
        let light = self.light();
        light * light
    }
}

/// How much of a triangle lies open, m², where that is a share of it towards an eye.
#[inline]
fn open_m2(exposure: Exposure, share: f32) -> f32 {
    exposure.area_m2() * (LEAST_OPEN + (1.0 - LEAST_OPEN) * share * share)
}

/// More than what of any triangle of a cell lies open in any direction, m².
fn most_open_m2(tessellation: &Tessellation, cell: CellId) -> f32 {
    /// For products that are rounded otherwise.
    const SLACK: f32 = 1.0 + 1e-5;
    let mut most = 0f32;
    for (place, rows) in tessellation.runs(cell) {
        let first = tessellation.slots(place).start;
        for number in rows.flatten() {
            let exposure = tessellation.exposures()[(first + u32::from(number)) as usize];
            most = most.max(open_m2(exposure, exposure.most()));
        }
    }
    most * SLACK
}

/// The class of a triangle: by how many of its pixels lie open towards the eye.
#[inline]
fn class(open_px: f32) -> u8 {
    let likely = open_px / (open_px + PIXELS_TO_BE_SEEN);
    // The exponent counts halvings from 1 on.
    (126 - (likely.to_bits() >> 23).min(126)).min(CLASSES as u32 - 1) as u8
}

/// How likely a triangle of a class is seen where all light comes through: its upper end.
fn likely(class: u8) -> f32 {
    f32::from_bits((127 - u32::from(class)) << 23)
}

/// Pixels that a square metre covers there at most.
fn pixels_per_m2(sight: &CellSight, from_eye: Vec3) -> f32 {
    sight.pixels_per_radian * sight.pixels_per_radian / from_eye.length_squared().max(f32::MIN_POSITIVE)
}
