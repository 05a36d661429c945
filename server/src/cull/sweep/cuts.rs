//! Visits that at most one plane cuts each way, be it between two slots or on the outside of one: almost all.

use super::classify::{BOTTOM, LEFT, LanePlane, LanePlanes, NEAR, RIGHT, TOP};
use super::kernel::Visit;
use super::lattice::Lattice;

/// The views that see what lies on the negative side of the one plane and of the other, on the positive side of the
/// one, of the other, and of both. [`NO_VIEW`] outside and in gaps.
pub(super) type Views = [u16; 4];

/// In place of a view.
pub(super) const NO_VIEW: u16 = u16::MAX;

/// What may cut a visit.
pub(super) enum Cuts<'a> {
    /// One plane; of the views, the first two count.
    One(&'a LanePlane, Views),
    /// A plane between columns and one between rows.
    Two([&'a LanePlane; 2], Views),
}

/// In place of a slot, outside.
const NO_SLOT: u16 = u16::MAX;

/// The plane of an axis and the slots on either side: one slot, twice, where none cuts.
struct Axis<'a> {
    plane: Option<&'a LanePlane>,
    slots: [u16; 2],
}

impl<'a> Axis<'a> {
    /// `None` where there may be two planes. Of `mask`, `LEFT` and `RIGHT` count.
    #[inline(always)]
    fn of([low, high]: [u16; 2], mask: u8, planes: &'a [LanePlane]) -> Option<Self> {
        let is_two = high - low == 2;
        let sides = mask & (LEFT | RIGHT);
        if high - low > 2 || sides == LEFT | RIGHT || (is_two && sides != 0) {
            return None;
        }
        let first = if sides == LEFT { NO_SLOT } else { low };
        let last = if sides == RIGHT { NO_SLOT } else { high - 1 };
        let plane = usize::from(low) + usize::from(is_two || sides == RIGHT);
        Some(Self { plane: (is_two || sides != 0).then(|| &planes[plane]), slots: [first, last] })
    }
}

impl<'a> Cuts<'a> {
    /// What may cut a visit; `None` where that may be more, nothing, or where several views see one side.
    #[inline(always)]
    pub(super) fn of(visit: &Visit, lattice: &Lattice, planes: &'a LanePlanes) -> Option<Self> {
        const _: () = assert!(BOTTOM == LEFT << 2 && TOP == RIGHT << 2);
        let [left, right, bottom, top] = visit.slots;
        let x = Axis::of([left, right], visit.mask, planes.of_axis(0))?;
        let y = Axis::of([bottom, top], visit.mask >> 2, planes.of_axis(1))?;
        let is_near = visit.mask & NEAR != 0;
        if is_near == (x.plane.is_some() || y.plane.is_some()) {
            return None;
        }
        // Some of them alike where an axis has no plane.
        let mut views = [NO_VIEW; 4];
        let is_plain = lattice.is_plain();
        for (side, view) in views.iter_mut().enumerate() {
            let [column, row] = [x.slots[side % 2], y.slots[side / 2]];
            if column != NO_SLOT && row != NO_SLOT {
                *view = if is_plain { lattice.view(column, row) } else { view_of(lattice, column, row)? };
            }
        }
        let [first, across, up, _] = views;
        Some(match (x.plane, y.plane) {
            (Some(columns), Some(rows)) => Self::Two([columns, rows], views),
            (Some(plane), None) => Self::One(plane, [first, across, NO_VIEW, NO_VIEW]),
            (None, Some(plane)) => Self::One(plane, [first, up, NO_VIEW, NO_VIEW]),
            (None, None) => Self::One(planes.near(), [NO_VIEW, first, NO_VIEW, NO_VIEW]),
        })
    }
}

/// The view that sees a slot of any lattice, or [`NO_VIEW`]; `None` where several do.
#[inline(always)]
fn view_of(lattice: &Lattice, column: u16, row: u16) -> Option<u16> {
    let [first, end, low, high] = lattice.cells([column, column + 1, row, row + 1]);
    match end.saturating_sub(first) * high.saturating_sub(low) {
        0 => Some(NO_VIEW),
        1 => Some(lattice.view(first, low)),
        _ => None,
    }
}
