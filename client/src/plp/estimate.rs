//! What an estimate lets a frame draw of each leaf.

use mullion_common::scene::Tessellation;

use super::drawn::Drawn;

/// The cut of an order: which triangles of a tessellation's leaves are drawn. Leaves that are not its business are drawn whole.
#[derive(Clone, Copy, Debug)]
pub struct Estimate<'a> {
    tessellation: &'a Tessellation,
    drawn: &'a Drawn,
    /// By place in [`Tessellation::leaves`]: no business of the tessellation's; may be shorter.
    left_out: &'a [bool],
}

/// How much of a leaf an estimate draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Share {
    /// Nothing.
    None,
    /// Some triangles of the leaf at this place in [`Tessellation::leaves`].
    Some(u32),
    /// All, or as much as without an estimate.
    All,
}

impl<'a> Estimate<'a> {
    /// What is drawn so far.
    pub(super) fn new(tessellation: &'a Tessellation, drawn: &'a Drawn, left_out: &'a [bool]) -> Self {
        Self { tessellation, drawn, left_out }
    }

    /// How much it draws of leaves that are asked for in ascending order.
    pub fn shares(self) -> Shares<'a> {
        Shares { estimate: self, place: 0 }
    }

    /// The numbers of the triangles that it draws of the leaf at a place, ascending.
    pub fn triangles(self, place: u32) -> impl Iterator<Item = u16> + 'a {
        self.drawn.triangles(self.tessellation, place)
    }
}

/// See [`Estimate::shares`].
#[derive(Clone, Debug)]
pub struct Shares<'a> {
    estimate: Estimate<'a>,
    /// The place of the first covered leaf that is not before the last one asked for.
    place: usize,
}

impl Shares<'_> {
    /// Of a leaf that is not before the last one asked for.
    pub fn of(&mut self, leaf: u32) -> Share {
        let Estimate { tessellation, drawn, left_out } = self.estimate;
        let covered = tessellation.leaves();
        while covered.get(self.place).is_some_and(|covered| *covered < leaf) {
            self.place += 1;
        }
        let is_its_own = covered.get(self.place) == Some(&leaf) && left_out.get(self.place) != Some(&true);
        if !is_its_own {
            return Share::All;
        }
        let place = self.place as u32;
        match drawn.count_of(place) {
            0 => Share::None,
            count if count as usize == tessellation.slots(place).len() => Share::All,
            _ => Share::Some(place),
        }
    }
}
