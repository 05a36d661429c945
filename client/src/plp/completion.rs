//! Conservative completion: from an estimate on, cells that the picture so far does not hide are projected, until none is left. What is drawn
//! then holds all that is seen.
//!
//! Whatever an eye sees lies in a cell, and the way to it leads through cells, from the eye's own or one at the hull. The first of them that is not wholly drawn is nearer than what
//! is seen, so nothing hides it from the eye there: while something is missing, some cell that waits is found to be seen.

use std::ops::ControlFlow;

use mullion_common::geometry::Aabb;
use mullion_common::scene::{CellId, Tessellation};

use super::drawn::Drawn;
use super::leaves::Leaves;
use super::sight::CellSight;
use super::{Estimate, Frame, Traversal};

/// A view's completion. Takes memory in its first frames only.
#[derive(Debug, Default)]
pub struct Completion {
    sight: CellSight,
    leaves: Leaves,
    pub(super) drawn: Drawn,
    marks: Vec<Mark>,
    /// Cells with triangles that are asked for.
    waiting: Vec<CellId>,
    asked: Vec<CellId>,
    /// What is to be looked at, while it is reached.
    open: Vec<CellId>,
    /// Triangles that were drawn since the last question: place, slot.
    added: Vec<(u32, u32)>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mark {
    /// Nobody has come to it.
    #[default]
    New,
    /// Reached, or not to be asked for any more.
    Known,
    /// All its triangles are drawn that may be seen.
    Whole,
}

impl Completion {
    /// Starts where an estimate stopped. `frame` is as the view sees it: with its own eye and planes.
    pub fn begin(&mut self, frame: &Frame<'_>, traversal: &Traversal) {
        let tessellation = frame.tessellation;
        self.sight.set(&frame.sight, tessellation);
        self.leaves.leave_out_as(traversal.left_out());
        self.leaves.begin(tessellation);
        self.drawn.copy(traversal.drawn());
        self.marks.clear();
        self.marks.resize(tessellation.cells().len(), Mark::New);
        self.waiting.clear();
        for cell in traversal.cells().iter().copied().filter(|cell| traversal.is_whole(*cell)) {
            self.marks[cell.index()] = Mark::Whole;
        }
        for cell in traversal.cells().iter().copied() {
            if traversal.is_whole(cell) {
                // For the view's own eye, which may see fronts that the shared one does not.
                self.project(frame, cell);
                self.open.extend(tessellation.cell(cell).neighbours.into_iter().filter_map(CellId::get));
            } else {
                self.open.push(cell);
            }
        }
        self.open.extend(traversal.front());
        // Where the view's own eye is: the shared one need not have come there.
        match self.sight.eye_cell(tessellation) {
            _ if tessellation.cells().is_empty() => {}
            Some(cell) => self.open.push(cell),
            None => {
                let all = (0..tessellation.cells().len() as u32).map(CellId);
                self.open.extend(all.filter(|cell| self.sight.is_entry(tessellation, *cell)));
            }
        }
        self.reach(tessellation);
        self.added.clear();
    }

    /// The boxes of the cells that wait, in the world, metres: each is to be held against the picture so far.
    pub fn bounds<'a>(&'a self, tessellation: &'a Tessellation) -> impl Iterator<Item = Aabb> + 'a {
        let of_cell = |cell: &CellId| Aabb::of_points(tessellation.corners(*cell).into_iter().map(|corner| corner.as_dvec3()));
        self.waiting.iter().map(move |cell| of_cell(cell).moved(tessellation.origin()))
    }

    /// Projects those that are seen, by whether each of the bounds is; none is said of those beyond, which count as seen. Whether any is left
    /// to ask for.
    pub fn take(&mut self, frame: &Frame<'_>, seen: &[bool]) -> bool {
        self.added.clear();
        std::mem::swap(&mut self.asked, &mut self.waiting);
        self.waiting.clear();
        for at in 0..self.asked.len() {
            let cell = self.asked[at];
            if seen.get(at) == Some(&false) {
                continue;
            }
            self.marks[cell.index()] = Mark::Whole;
            self.project(frame, cell);
            self.open.extend(frame.tessellation.cell(cell).neighbours.into_iter().filter_map(CellId::get));
        }
        self.reach(frame.tessellation);
        !self.waiting.is_empty()
    }

    /// What the last answers added, leaf by leaf: place in [`Tessellation::leaves`], and its triangles' slots, both ascending.
    pub fn added(&mut self) -> impl Iterator<Item = (u32, &[(u32, u32)])> {
        self.added.sort_unstable();
        self.added.chunk_by(|a, b| a.0 == b.0).map(|own| (own[0].0, own))
    }

    /// All that is drawn.
    pub fn estimate<'a>(&'a self, tessellation: &'a Tessellation) -> Estimate<'a> {
        Estimate::new(tessellation, &self.drawn, self.leaves.left_out())
    }

    /// Marks all cells that are open: those with triangles wait, and the view looks through those without.
    fn reach(&mut self, tessellation: &Tessellation) {
        while let Some(id) = self.open.pop() {
            if self.marks[id.index()] != Mark::New {
                continue;
            }
            self.marks[id.index()] = Mark::Known;
            if self.sight.share_in_sight(tessellation, id) == 0.0 {
                continue;
            }
            let cell = tessellation.cell(id);
            if cell.triangle_count == 0 {
                self.open.extend(cell.neighbours.into_iter().filter_map(CellId::get));
            } else {
                self.waiting.push(id);
            }
        }
    }

    /// Draws all triangles of a cell that may be seen.
    fn project(&mut self, frame: &Frame<'_>, cell: CellId) {
        self.leaves.visit(frame, cell, &mut self.drawn, |drawn, open| {
            drawn.take(open.place, open.slot);
            self.added.push((open.place, open.slot));
            ControlFlow::Continue(())
        });
    }
}
