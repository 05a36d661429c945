//! How each leaf is seen in a frame, found out once, when a cell holds the leaf.

use std::ops::ControlFlow;

use mullion_common::scene::{CellId, Facing, Tessellation};

use super::drawn::Drawn;
use super::sight::LeafSight;
use super::{Frame, Shown};

/// Leaves by their places in the tessellation.
#[derive(Debug, Default)]
pub(super) struct Leaves {
    /// With the frame that it is of.
    sights: Vec<(u32, LeafSight)>,
    /// No business of the tessellation's.
    left_out: Vec<bool>,
    frame: u32,
}

/// A triangle that may be seen and is not drawn.
pub(super) struct OpenTriangle<'a> {
    pub place: u32,
    pub slot: u32,
    pub facing: Facing,
    pub leaf: &'a LeafSight,
}

impl Leaves {
    pub fn begin(&mut self, tessellation: &Tessellation) {
        let leaves = tessellation.leaves().len();
        self.left_out.resize(leaves, false);
        self.frame = self.frame.wrapping_add(1);
        if self.sights.len() != leaves || self.frame == 0 {
            self.sights.clear();
            self.sights.resize(leaves, (0, LeafSight::unseen()));
            self.frame = 1;
        }
    }

    /// From the next frame on: by place, which leaves are left out; may be shorter.
    pub fn leave_out_as(&mut self, left_out: &[bool]) {
        self.left_out.clear();
        self.left_out.extend_from_slice(left_out);
    }

    /// By place: which leaves are no business of the tessellation's; may be shorter.
    pub fn left_out(&self) -> &[bool] {
        &self.left_out
    }

    /// Visits the triangles of a cell that may be seen and are not drawn, until told to stop; whether it came to the end.
    #[inline]
    pub fn visit(
        &mut self,
        frame: &Frame<'_>,
        cell: CellId,
        drawn: &mut Drawn,
        mut visit: impl FnMut(&mut Drawn, OpenTriangle<'_>) -> ControlFlow<()>,
    ) -> bool {
        for (place, rows) in frame.tessellation.runs(cell) {
            let leaf = self.sight(frame, place);
            if leaf.shown == Shown::None {
                continue;
            }
            let first = frame.tessellation.slots(place).start;
            let facings = frame.tessellation.facings(place);
            for number in rows.flatten() {
                let (slot, facing) = (first + u32::from(number), facings[usize::from(number)]);
                if drawn.holds(slot) || leaf.is_away(facing) {
                    continue;
                }
                if visit(drawn, OpenTriangle { place, slot, facing, leaf: &leaf }).is_break() {
                    return false;
                }
            }
        }
        true
    }

    #[inline]
    pub fn sight(&mut self, frame: &Frame<'_>, place: u32) -> LeafSight {
        let (number, known) = &mut self.sights[place as usize];
        if *number != self.frame {
            let leaf = frame.tessellation.leaves()[place as usize];
            *known = LeafSight::new(frame.scene, leaf, frame.sight.eye);
            if self.left_out[place as usize] {
                known.shown = Shown::None;
            }
            *number = self.frame;
        }
        *known
    }
}
