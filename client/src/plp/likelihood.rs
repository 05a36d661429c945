//! How likely a triangle is seen: what comes through to its cell, how far it lies open towards the eye, how large it appears.
//!
//! Light goes from the eye's cell on through faces, from front to back. A cell gets what its neighbours before it let through, by the solid
//! angles of the faces between; of that, its triangles' fronts keep a share, which was measured along the axes. A cell's triangles are drawn
//! in classes: those that lie open first, those that hardly do after what lies open further back.
//!
//! Only sums, products, quotients and square roots: the same order on every machine.

use glam::Vec3;
use mullion_common::scene::{CellId, ExposureWeights, FACES, Tessellation};

use super::front::Entry;
use super::sight::{CellSight, face};
use super::traversal::{CellMark, Cells};

/// Least exposures of the classes, and how likely triangles of each are seen where all light comes through.
const CLASSES: [(f32, f32); 4] = [(0.6, 0.8), (0.3, 0.45), (0.08, 0.15), (0.0, 0.015)];
/// Entries of a cell: its opening, then its classes.
const ENTRIES: u32 = 1 + CLASSES.len() as u32;
/// What no cover keeps: openings that samples missed.
const LEAST_THROUGH: f32 = 0.02;

/// What light comes to each cell.
#[derive(Debug, Default)]
pub(super) struct Likelihood {
    light: Vec<Light>,
}

/// Valid once its cell was reached in this frame.
#[derive(Clone, Copy, Debug, Default)]
struct Light {
    /// Solid angle of the faces that it comes in by, and that of those by which it has come.
    all: f32,
    /// Light times solid angle.
    came: f32,
    is_known: u32,
}

impl Likelihood {
    /// How many entries a front may hold.
    pub fn entries(tessellation: &Tessellation) -> usize {
        tessellation.cells().len() * ENTRIES as usize
    }

    pub fn cell(entry: Entry) -> CellId {
        CellId(entry.0 / ENTRIES)
    }

    /// The class that an entry stands for; `None` for a cell's opening.
    pub fn class(entry: Entry) -> Option<(CellId, usize)> {
        Some((Self::cell(entry), (entry.0 % ENTRIES).checked_sub(1)? as usize))
    }

    pub fn class_of(exposure: f32) -> usize {
        CLASSES.iter().position(|(least, _)| exposure >= *least).unwrap_or(CLASSES.len() - 1)
    }

    /// How exposures count for the eye, seen from a cell.
    #[inline]
    pub fn weights(&self, sight: &CellSight, tessellation: &Tessellation, cell: CellId) -> ExposureWeights {
        let [a, b, c, d] = sight.from_eye(tessellation, cell);
        ExposureWeights::towards(-(a + b + c + d))
    }

    pub fn begin(&mut self, tessellation: &Tessellation) {
        self.light.clear();
        self.light.resize(tessellation.cells().len(), Light::default());
    }

    /// All light comes to a cell.
    pub fn seed(&mut self, cells: &mut Cells, _tessellation: &Tessellation, cell: CellId) {
        self.light[cell.index()] = Light { all: 1.0, came: 1.0, is_known: 1 };
        cells.front.enqueue(Entry(cell.0 * ENTRIES), -1.0);
    }

    /// Opens a cell: light goes on to the neighbours behind it, and its classes are enqueued. Gives the cell, the first time.
    pub fn open(&mut self, cells: &mut Cells, tessellation: &Tessellation, entry: Entry) -> Option<CellId> {
        let id = Self::cell(entry);
        if entry.0 % ENTRIES != 0 {
            return None;
        }
        cells.set(id, CellMark::Projected);
        let from_eye = cells.sight.from_eye(tessellation, id);
        let cell = tessellation.cell(id);
        let Light { all, came, .. } = self.light[id.index()];
        let light = came / all;
        let towards = from_eye[0] + from_eye[1] + from_eye[2] + from_eye[3];
        let through = light * (1.0 - cover(&cell.cover, towards)).max(LEAST_THROUGH);
        for k in 0..4 {
            let Some(beyond) = cell.neighbours[k].get() else { continue };
            let angle = solid_angle(&from_eye, k);
            if angle <= 0.0 || !cells.is_in_sight(tessellation, beyond) || cells.mark(beyond) == CellMark::Projected {
                continue;
            }
            self.shine(cells, tessellation, beyond, angle, through);
        }
        if cell.triangle_count > 0 {
            let seen = light * size(&cells.sight, cell.log_area, towards * 0.25);
            for (class, (_, likely)) in CLASSES.iter().enumerate() {
                cells.front.enqueue(Entry(id.0 * ENTRIES + 1 + class as u32), -seen * likely);
            }
        }
        Some(id)
    }

    /// Light comes to a cell by a face of this solid angle.
    fn shine(&mut self, cells: &mut Cells, tessellation: &Tessellation, cell: CellId, angle: f32, light: f32) {
        if self.light[cell.index()].is_known == 0 {
            let from_eye = cells.sight.from_eye(tessellation, cell);
            let neighbours = tessellation.cell(cell).neighbours;
            let mut all = 0.0;
            for k in 0..4 {
                let angle = -solid_angle(&from_eye, k);
                if angle > 0.0 && neighbours[k].get().is_some_and(|before| cells.is_in_sight(tessellation, before)) {
                    all += angle;
                }
            }
            self.light[cell.index()] = Light { all: all.max(f32::MIN_POSITIVE), came: 0.0, is_known: 1 };
        }
        let known = &mut self.light[cell.index()];
        known.came = (known.came + angle * light).min(known.all);
        cells.front.enqueue(Entry(cell.0 * ENTRIES), -(known.came / known.all));
    }
}

/// The share that the fronts in a cell cover, looking along `view`, of any length.
fn cover(cover: &[u8; 6], view: Vec3) -> f32 {
    let square = view * view;
    let along = |axis: usize| f32::from(cover[2 * axis + usize::from(view[axis] < 0.0)]) * square[axis];
    (along(0) + along(1) + along(2)) / (255.0 * square.element_sum().max(f32::MIN_POSITIVE))
}

/// About the solid angle of a face for the eye, at the origin: above 0 where the way out of the cell leads away from the eye.
fn solid_angle(from_eye: &[Vec3; 4], k: usize) -> f32 {
    let (normal, [a, b, c]) = face(from_eye, k);
    let _ = FACES;
    let middle = (a + b + c) / 3.0;
    let square = middle.length_squared().max(f32::MIN_POSITIVE);
    normal.dot(middle) / (square * square.sqrt())
}

/// How likely a triangle of this size at this place has a pixel: its area in pixels, at most 1.
fn size(sight: &CellSight, log_area: i8, middle: Vec3) -> f32 {
    let pixels = exp2_quarters(log_area) * sight.pixels_per_radian * sight.pixels_per_radian / middle.length_squared().max(f32::MIN_POSITIVE);
    pixels / (pixels + 1.0)
}

/// 2 to the power of a number of quarters.
fn exp2_quarters(quarters: i8) -> f32 {
    const PARTS: [f32; 4] = [1.0, 1.189_207_1, 1.414_213_5, 1.681_792_8];
    let whole = i32::from(quarters).div_euclid(4);
    PARTS[i32::from(quarters).rem_euclid(4) as usize] * f32::from_bits(((whole + 127) as u32) << 23)
}
