//! The rendering loop, Fig. 5: min(F) is projected until the budget is reached.

use mullion_common::scene::{CellId, SceneManifest, Tessellation};

use super::drawn::Drawn;
use super::front::{Entry, Front};
use super::likelihood::Likelihood;
use super::paper::Paper;
use super::sight::{CellSight, LeafSight, Shown, is_before};
use super::{Sight, Solidity};

/// What a traversal has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Projected {
    /// Cells taken from the front.
    pub cells: u32,
    /// Distinct triangles drawn.
    pub triangles: u32,
    /// Whether all that can be reached has been projected.
    pub is_complete: bool,
}

/// A traversal of one tessellation, frame after frame. Takes memory in the first frame only.
///
/// The triangles of a budget are those of any smaller one and more: an estimate grows with its budget.
#[derive(Debug, Default)]
pub struct Traversal {
    cells: Cells,
    solidity: Solidity,
    paper: Paper,
    likelihood: Likelihood,
    leaves: Leaves,
    drawn: Drawn,
    /// Cells in the order in which they were first projected.
    order: Vec<CellId>,
    /// The entry whose triangles did not all fit.
    unfinished: Option<Entry>,
    done: Projected,
    /// The eye's cell in the last frame.
    near: CellId,
}

/// The front, and what is known of each cell in this frame.
#[derive(Debug, Default)]
pub(super) struct Cells {
    pub front: Front,
    pub sight: CellSight,
    /// Two bits of meaning and the frame's number: what is older than the frame means nothing.
    marks: Vec<u32>,
    frame: u32,
}

const KNOWN_BITS: u32 = 2;

/// Where a cell stands in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CellMark {
    /// Nobody has asked.
    New,
    /// The frustum does not meet it.
    Outside,
    /// It was reached.
    Reached,
    /// It was projected.
    Projected,
}

impl Cells {
    fn begin(&mut self, tessellation: &Tessellation, sight: &Sight<'_>, entries: usize) {
        let cells = tessellation.cells().len();
        self.front.clear(entries);
        self.frame += 1;
        if self.marks.len() != cells || self.frame >> (u32::BITS - KNOWN_BITS) != 0 {
            self.marks.clear();
            self.marks.resize(cells, 0);
            self.frame = 1;
        }
        self.sight.set(sight, tessellation);
    }

    #[inline]
    pub fn mark(&self, cell: CellId) -> CellMark {
        let mark = self.marks[cell.index()];
        match (mark >> KNOWN_BITS == self.frame, mark & 3) {
            (false, _) => CellMark::New,
            (true, 1) => CellMark::Outside,
            (true, 2) => CellMark::Reached,
            (true, _) => CellMark::Projected,
        }
    }

    #[inline]
    pub fn set(&mut self, cell: CellId, mark: CellMark) {
        self.marks[cell.index()] = self.frame << KNOWN_BITS | mark as u32;
    }

    /// Whether a cell is in the frustum, asked once a frame.
    #[inline]
    pub fn is_in_sight(&mut self, tessellation: &Tessellation, cell: CellId) -> bool {
        match self.mark(cell) {
            CellMark::New => {
                let in_sight = self.sight.may_see(&self.sight.from_eye(tessellation, cell));
                self.set(cell, if in_sight { CellMark::Reached } else { CellMark::Outside });
                in_sight
            }
            mark => mark != CellMark::Outside,
        }
    }
}

/// How each leaf is seen in this frame.
#[derive(Debug, Default)]
struct Leaves {
    /// By place; with the frame that it is of.
    sights: Vec<(u32, LeafSight)>,
    /// By place: no business of the tessellation's.
    left_out: Vec<bool>,
    frame: u32,
}

impl Traversal {
    /// A traversal that has seen nothing.
    pub fn new() -> Self {
        Self { near: CellId(0), ..Self::default() }
    }

    /// From the next frame on the leaf at a place in [`Tessellation::leaves`] is not drawn: its object has moved, and whoever draws draws it
    /// apart; or is drawn again.
    pub fn leave_out(&mut self, tessellation: &Tessellation, place: u32, left_out: bool) {
        self.leaves.left_out.resize(tessellation.leaves().len(), false);
        self.leaves.left_out[place as usize] = left_out;
    }

    /// Starts a frame: empties the front, and seeds it with the eye's cell or, from outside the hull, with the cells at faces that the eye
    /// is before.
    pub fn begin(&mut self, tessellation: &Tessellation, sight: &Sight<'_>, solidity: Solidity) {
        self.solidity = solidity;
        let entries = match solidity {
            Solidity::Paper => tessellation.cells().len(),
            Solidity::Likelihood => Likelihood::entries(tessellation),
        };
        self.cells.begin(tessellation, sight, entries);
        self.drawn.clear(tessellation);
        self.leaves.begin(tessellation);
        self.order.clear();
        self.unfinished = None;
        self.done = Projected::default();
        match solidity {
            Solidity::Paper => self.paper.begin(tessellation),
            Solidity::Likelihood => self.likelihood.begin(tessellation),
        }
        if tessellation.cells().is_empty() {
            return;
        }
        match self.eye_cell(tessellation) {
            Some(cell) => {
                self.near = cell;
                self.cells.set(cell, CellMark::Reached);
                self.seed(tessellation, cell);
            }
            None => self.seed_entries(tessellation),
        }
    }

    fn seed(&mut self, tessellation: &Tessellation, cell: CellId) {
        match self.solidity {
            Solidity::Paper => self.paper.seed(&mut self.cells, cell),
            Solidity::Likelihood => self.likelihood.seed(&mut self.cells, tessellation, cell),
        }
    }

    /// Seeds every cell with a face on the hull that the eye is before: light comes in there.
    fn seed_entries(&mut self, tessellation: &Tessellation) {
        for index in 0..tessellation.cells().len() as u32 {
            let cell = CellId(index);
            let neighbours = tessellation.cell(cell).neighbours;
            if !neighbours.contains(&CellId::NONE) {
                continue;
            }
            let from_eye = self.cells.sight.from_eye(tessellation, cell);
            let is_entry = (0..4).any(|k| neighbours[k] == CellId::NONE && is_before(&from_eye, k));
            if is_entry && self.cells.is_in_sight(tessellation, cell) {
                self.seed(tessellation, cell);
            }
        }
    }

    /// The cell that the eye is in, by a walk from where it was: `None` outside the hull.
    fn eye_cell(&self, tessellation: &Tessellation) -> Option<CellId> {
        let mut cell = if self.near.index() < tessellation.cells().len() { self.near } else { CellId(0) };
        // A walk in a Delaunay mesh ends; where rounding leads it around, any cell on the way is as good.
        for _ in 0..tessellation.cells().len() {
            let from_eye = self.cells.sight.from_eye(tessellation, cell);
            let Some(beyond) = (0..4).find(|k| is_before(&from_eye, *k)) else { return Some(cell) };
            cell = tessellation.cell(cell).neighbours[beyond].get()?;
        }
        Some(cell)
    }

    /// Projects cells until `budget` triangles are drawn, never more, or nothing is left. With a larger budget it goes on from there.
    ///
    /// `scene` is that of the tessellation, and `sight` that of [`Traversal::begin`].
    pub fn project(
        &mut self,
        tessellation: &Tessellation,
        scene: &SceneManifest,
        sight: &Sight<'_>,
        budget: u32,
    ) -> Projected {
        while self.drawn.count() < budget {
            let entry = match self.unfinished.take() {
                Some(entry) => entry,
                None => match self.cells.front.pop() {
                    Some((key, entry)) => {
                        self.open(tessellation, entry, key);
                        entry
                    }
                    None => {
                        self.done.is_complete = true;
                        break;
                    }
                },
            };
            if !self.draw(tessellation, scene, sight, entry, budget) {
                self.unfinished = Some(entry);
            }
        }
        self.done.triangles = self.drawn.count();
        self.done
    }

    /// What follows from an entry's leaving the front: its neighbours are enqueued.
    fn open(&mut self, tessellation: &Tessellation, entry: Entry, key: f32) {
        let first = match self.solidity {
            Solidity::Paper => Some(self.paper.open(&mut self.cells, tessellation, entry, key)),
            Solidity::Likelihood => self.likelihood.open(&mut self.cells, tessellation, entry),
        };
        if let Some(cell) = first {
            self.order.push(cell);
            self.done.cells += 1;
        }
    }

    /// Draws an entry's triangles; whether all fitted.
    fn draw(
        &mut self,
        tessellation: &Tessellation,
        scene: &SceneManifest,
        sight: &Sight<'_>,
        entry: Entry,
        budget: u32,
    ) -> bool {
        let (cell, class) = match self.solidity {
            Solidity::Paper => (CellId(entry.0), None),
            Solidity::Likelihood => match Likelihood::class(entry) {
                Some((cell, class)) => (cell, Some(class)),
                None => return true,
            },
        };
        for (place, rows) in tessellation.runs(cell) {
            let leaf = self.leaves.sight(tessellation, scene, sight, place);
            if leaf.shown == Shown::None {
                continue;
            }
            let first = tessellation.slots(place).start;
            let facings = tessellation.facings(place);
            let weights = class.map(|_| self.likelihood.weights(&self.cells.sight, tessellation, cell));
            for number in rows.flatten() {
                let slot = first + u32::from(number);
                let is_away = || leaf.shown == Shown::Fronts && facings[usize::from(number)].is_away_from(leaf.eye, leaf.middle, leaf.radius);
                let is_of_class = || match (class, weights) {
                    (Some(class), Some(weights)) => Likelihood::class_of(weights.of(tessellation.exposures()[slot as usize])) == class,
                    _ => true,
                };
                if self.drawn.holds(slot) || !is_of_class() || is_away() {
                    continue;
                }
                if self.drawn.count() == budget {
                    return false;
                }
                self.drawn.take(place, slot);
            }
        }
        true
    }

    /// What is drawn so far.
    pub fn drawn(&self) -> &Drawn {
        &self.drawn
    }

    /// The cells that were projected, first to last.
    pub fn cells(&self) -> &[CellId] {
        &self.order
    }

    /// plp_front: the cells that would be next, in no order. A cell that holds more classes of triangles than were projected is among them.
    pub fn front(&self) -> impl Iterator<Item = CellId> + '_ {
        self.cells.front.entries().map(|entry| match self.solidity {
            Solidity::Paper => CellId(entry.0),
            Solidity::Likelihood => Likelihood::cell(entry),
        })
    }
}

impl Leaves {
    fn begin(&mut self, tessellation: &Tessellation) {
        const UNSEEN: LeafSight = LeafSight { eye: glam::Vec3::ZERO, middle: glam::Vec3::ZERO, radius: 0.0, shown: Shown::None };
        let leaves = tessellation.leaves().len();
        self.left_out.resize(leaves, false);
        self.frame = self.frame.wrapping_add(1);
        if self.sights.len() != leaves || self.frame == 0 {
            self.sights.clear();
            self.sights.resize(leaves, (0, UNSEEN));
            self.frame = 1;
        }
    }

    #[inline]
    fn sight(&mut self, tessellation: &Tessellation, scene: &SceneManifest, sight: &Sight<'_>, place: u32) -> LeafSight {
        let (frame, known) = &mut self.sights[place as usize];
        if *frame != self.frame {
            let leaf = tessellation.leaves()[place as usize];
            *known = LeafSight::new(scene, leaf, sight.eye, sight.planes);
            if self.left_out[place as usize] {
                known.shown = Shown::None;
            }
            *frame = self.frame;
        }
        *known
    }
}
