//! How each leaf is seen in a frame, found out once, when a cell holds the leaf.

use mullion_common::scene::Tessellation;

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

    pub fn leave_out(&mut self, tessellation: &Tessellation, place: u32, left_out: bool) {
        self.left_out.resize(tessellation.leaves().len(), false);
        self.left_out[place as usize] = left_out;
    }

    /// The same leaves as elsewhere are left out.
    pub fn leave_out_as(&mut self, left_out: &[bool]) {
        self.left_out.clear();
        self.left_out.extend_from_slice(left_out);
        self.left_out.resize(self.sights.len(), false);
    }

    /// By place: which leaves are no business of the tessellation's; may be shorter.
    pub fn left_out(&self) -> &[bool] {
        &self.left_out
    }

    #[inline]
    pub fn sight(&mut self, frame: &Frame<'_>, place: u32) -> LeafSight {
        let (number, known) = &mut self.sights[place as usize];
        if *number != self.frame {
            let leaf = frame.tessellation.leaves()[place as usize];
            *known = LeafSight::new(frame.scene, leaf, frame.sight.eye, frame.sight.planes);
            if self.left_out[place as usize] {
                known.shown = Shown::None;
            }
            *number = self.frame;
        }
        *known
    }
}
