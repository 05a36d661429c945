//! The rendering loop, Fig. 5: min(F) is projected until the budget is reached.

use mullion_common::scene::{CellId, Tessellation};

use super::drawn::Drawn;
use super::front::Front;
use super::leaves::Leaves;
use super::likelihood::Likelihood;
use super::paper::Paper;
use super::sight::CellSight;
use super::{Estimate, Frame, Sight, Solidity};

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
    /// The cell whose triangles did not all fit.
    unfinished: Option<CellId>,
    done: Projected,
}

/// The front, and what is known of each cell in this frame.
#[derive(Debug, Default)]
pub(super) struct Cells {
    pub front: Front,
    pub sight: CellSight,
    known: Vec<Known>,
    frame: u32,
}

/// What is known of a cell.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    /// Three bits of meaning and the frame's number: what is older than the frame means nothing.
    mark: u32,
    /// The root of the share of it that the frustum holds.
    in_sight: f32,
}

const KNOWN_BITS: u32 = 3;

/// Where a cell stands in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CellMark {
    /// Nobody has asked.
    New,
    /// The frustum does not meet it.
    Outside,
    /// The frustum meets it; nobody has come there.
    InSight,
    /// It was reached: what its solidity knows of it is this frame's.
    Reached,
    /// It was projected.
    Projected,
}

impl Cells {
    fn begin(&mut self, tessellation: &Tessellation, sight: &Sight<'_>) {
        let cells = tessellation.cells().len();
        self.front.clear(cells);
        self.frame += 1;
        if self.known.len() != cells || self.frame >> (u32::BITS - KNOWN_BITS) != 0 {
            self.known.clear();
            self.known.resize(cells, Known::default());
            self.frame = 1;
        }
        self.sight.set(sight, tessellation);
    }

    #[inline]
    pub fn mark(&self, cell: CellId) -> CellMark {
        let mark = self.known[cell.index()].mark;
        match (mark >> KNOWN_BITS == self.frame, mark & ((1 << KNOWN_BITS) - 1)) {
            (false, _) => CellMark::New,
            (true, 1) => CellMark::Outside,
            (true, 2) => CellMark::InSight,
            (true, 3) => CellMark::Reached,
            (true, _) => CellMark::Projected,
        }
    }

    #[inline]
    pub fn set(&mut self, cell: CellId, mark: CellMark) {
        self.known[cell.index()].mark = self.frame << KNOWN_BITS | mark as u32;
    }

    /// Whether a cell is in the frustum.
    #[inline]
    pub fn is_in_sight(&mut self, tessellation: &Tessellation, cell: CellId) -> bool {
        self.root_in_sight(tessellation, cell) > 0.0
    }

    /// The root of the share of a cell that the frustum holds, 0 to 1, reckoned once a frame; all of the eye's own cell.
    ///
    /// What comes into the frustum counts for little at first: else all triangles around a corner would come and go at once.
    #[inline]
    pub fn root_in_sight(&mut self, tessellation: &Tessellation, cell: CellId) -> f32 {
        let known = self.known[cell.index()];
        if known.mark >> KNOWN_BITS == self.frame { known.in_sight } else { self.look(tessellation, cell) }
    }

    #[inline(never)] // or what is known already would take a call, too
    fn look(&mut self, tessellation: &Tessellation, cell: CellId) -> f32 {
        let share = self.sight.share_in_sight(tessellation, cell);
        let mark = if share > 0.0 { CellMark::InSight } else { CellMark::Outside };
        let in_sight = share.sqrt();
        self.known[cell.index()] = Known { mark: self.frame << KNOWN_BITS | mark as u32, in_sight };
        in_sight
    }
}

impl Traversal {
    /// A traversal that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// From the next frame on these leaves, by place in [`Tessellation::leaves`], are not drawn: their objects have moved, and whoever draws
    /// draws them apart. A list that is shorter leaves out none beyond.
    pub fn leave_out(&mut self, left_out: &[bool]) {
        self.leaves.leave_out_as(left_out);
    }

    /// Starts a frame: empties the front, and seeds it with the eye's cell or, from outside the hull, with the cells at faces that the eye
    /// is before.
    pub fn begin(&mut self, frame: &Frame<'_>, solidity: Solidity) {
        let tessellation = frame.tessellation;
        self.solidity = solidity;
        self.cells.begin(tessellation, &frame.sight);
        self.drawn.clear(tessellation);
        self.leaves.begin(tessellation);
        self.order.clear();
        self.unfinished = None;
        self.done = Projected::default();
        match solidity {
            Solidity::Paper => self.paper.begin(tessellation, self.cells.sight.eye),
            Solidity::Likelihood => self.likelihood.begin(tessellation),
        }
        if tessellation.cells().is_empty() {
            return;
        }
        match self.cells.sight.eye_cell(tessellation) {
            Some(cell) => {
                self.cells.known[cell.index()].in_sight = 1.0;
                self.seed(tessellation, cell);
            }
            None => self.seed_entries(tessellation),
        }
    }

    fn seed(&mut self, tessellation: &Tessellation, cell: CellId) {
        match self.solidity {
            Solidity::Paper => self.paper.seed(&mut self.cells, tessellation, cell),
            Solidity::Likelihood => self.likelihood.seed(&mut self.cells, tessellation, cell),
        }
    }

    /// Seeds every cell with a face on the hull that the eye is before: light comes in there.
    fn seed_entries(&mut self, tessellation: &Tessellation) {
        for cell in (0..tessellation.cells().len() as u32).map(CellId) {
            if self.cells.sight.is_entry(tessellation, cell) && self.cells.is_in_sight(tessellation, cell) {
                self.seed(tessellation, cell);
            }
        }
    }

    /// Projects cells until `budget` triangles are drawn, never more, or nothing is left. With a larger budget it goes on from there.
    ///
    /// `frame` is that of [`Traversal::begin`].
    pub fn project(&mut self, frame: &Frame<'_>, budget: u32) -> Projected {
        self.project_below(frame, budget, f32::INFINITY)
    }

    /// The same by [`Solidity::Likelihood`], as long as what comes next is as likely seen as this at least, 0 to 1. What is in a cell of which a
    /// part is in sight is as likely seen as that part is large, at most.
    pub fn project_likely(&mut self, frame: &Frame<'_>, budget: u32, least: f32) -> Projected {
        self.project_below(frame, budget, -least)
    }

    fn project_below(&mut self, frame: &Frame<'_>, budget: u32, most: f32) -> Projected {
        while self.drawn.count() < budget {
            if self.unfinished.is_none() && self.cells.front.least().is_some_and(|key| key > most) {
                break;
            }
            let cell = match self.unfinished.take() {
                Some(cell) => cell,
                None => match self.cells.front.pop() {
                    Some((_, cell)) if self.open(frame, cell) => cell,
                    Some(_) => continue,
                    None => {
                        self.done.is_complete = true;
                        break;
                    }
                },
            };
            let (leaves, drawn) = (&mut self.leaves, &mut self.drawn);
            let all = match self.solidity {
                Solidity::Paper => Paper::draw(leaves, drawn, frame, cell, budget),
                Solidity::Likelihood => self.likelihood.draw(&mut self.cells, (leaves, drawn), frame, cell, budget),
            };
            self.unfinished = (!all).then_some(cell);
        }
        self.done.triangles = self.drawn.count();
        self.done
    }

    /// What follows from a cell's leaving the front: its neighbours are enqueued. Whether its triangles are to be drawn at once.
    fn open(&mut self, frame: &Frame<'_>, cell: CellId) -> bool {
        let is_first = self.cells.mark(cell) != CellMark::Projected;
        if is_first {
            self.order.push(cell);
            self.done.cells += 1;
        }
        match self.solidity {
            _ if !is_first => true,
            Solidity::Paper => self.paper.open(&mut self.cells, frame.tessellation, cell),
            Solidity::Likelihood => {
                self.likelihood.open(&mut self.cells, frame.tessellation, cell);
                false
            }
        }
    }

    /// How many triangles of the leaf at a place have their fronts to the eye, as far as is known, wherever they are. `frame` is that of
    /// [`Traversal::begin`].
    pub fn front_count(&mut self, frame: &Frame<'_>, place: u32) -> u32 {
        let leaf = self.leaves.sight(frame, place);
        frame.tessellation.facings(place).iter().filter(|facing| !leaf.is_away(**facing)).count() as u32
    }

    /// What is drawn so far.
    pub fn drawn(&self) -> &Drawn {
        &self.drawn
    }

    /// Whether all triangles of a cell that was projected are drawn.
    pub(super) fn is_whole(&self, cell: CellId) -> bool {
        let is_whole = match self.solidity {
            Solidity::Paper => !self.cells.front.holds(cell),
            Solidity::Likelihood => self.likelihood.is_whole(cell),
        };
        is_whole && self.unfinished != Some(cell)
    }

    pub(super) fn left_out(&self) -> &[bool] {
        self.leaves.left_out()
    }

    /// The cut: what a frame draws of each leaf. `tessellation` is that of the frame.
    pub fn estimate<'a>(&'a self, tessellation: &'a Tessellation) -> Estimate<'a> {
        Estimate::new(tessellation, &self.drawn, self.left_out())
    }

    /// The cells that were projected, first to last.
    pub fn cells(&self) -> &[CellId] {
        &self.order
    }

    /// plp_front: the cells that would be next, in no order; also those that were projected and of whose triangles some are left.
    pub fn front(&self) -> impl Iterator<Item = CellId> + '_ {
        self.cells.front.cells()
    }
}
