//! Views that one eye sees through one plane, as a lattice.
//!
//! The edges of a grid's tiles lie in a few planes through the eye: one a column's edge, one a row's, however many
//! tiles there are. Between them are *slots*. A slot belongs to one column; to two where tiles overlap, which
//! is the overlap as a frustum of its own (section 3); or to none, in the gap behind a bezel.

use glam::{DAffine3, DVec3};
use mullion_common::geometry::{Frustum, FrustumSide};

/// Views of one eye as columns and rows. `clone_from` reuses memory.
#[derive(Debug, Default)]
pub(super) struct Lattice {
    frame: Frame,
    columns: Axis,
    rows: Axis,
    /// Views, row by row from the bottom.
    views: Vec<u16>,
    placed: Placed,
}

/// The planes of a lattice in the world, relative to its eye.
#[derive(Debug, Default)]
struct Placed {
    eye: DVec3,
    near: RelativePlane,
    planes: [Vec<RelativePlane>; 2],
}

/// The half-space `normal · (p − eye) + offset_m > 0`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RelativePlane {
    /// Unit normal.
    pub normal: DVec3,
    /// Metres; zero for planes through the eye.
    pub offset_m: f64,
}

/// How an eye looks at a plane.
#[derive(Clone, Copy, Debug, Default)]
struct Frame {
    eye: DVec3,
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    /// Signed distance of the eye from the near plane.
    near_m: f64,
}

/// Edges along one axis, as tangents from the axis of view, and the slots between them.
#[derive(Debug, Default)]
struct Axis {
    /// Ascending.
    tangents: Vec<f64>,
    /// Of each column, its first and last edge; ascending.
    spans: Vec<[u16; 2]>,
    slots: u16,
    /// Whether each slot is a column.
    is_plain: bool,
    /// Of each slot, the first column that covers it or lies after it.
    first: SlotTable,
    /// Of each slot, one past the last column that covers it or lies before it.
    end: SlotTable,
}

/// A column for each slot. As long as indices can be, so that no look-up is checked: several are made for each range found.
#[derive(Clone, Debug)]
struct SlotTable([u16; Self::SLOTS]);

impl SlotTable {
    /// More than a wall of 256 tiles in a row has with bezels: 511.
    const SLOTS: usize = 512;

    fn of(columns: impl Iterator<Item = u16>) -> Self {
        let mut table = Self::default();
        table.0.iter_mut().zip(columns).for_each(|(place, column)| *place = column);
        table
    }

    #[inline(always)]
    fn at(&self, slot: u16) -> u16 {
        self.0[usize::from(slot) % Self::SLOTS]
    }
}

impl Default for SlotTable {
    fn default() -> Self {
        Self([0; Self::SLOTS])
    }
}

/// Clones field by field, which a derived `clone_from` does not.
macro_rules! clone_by_field {
    ($type:ident { $($field:ident),* }) => {
        impl Clone for $type {
            fn clone(&self) -> Self {
                Self { $($field: self.$field.clone()),* }
            }

            fn clone_from(&mut self, other: &Self) {
                $(self.$field.clone_from(&other.$field);)*
            }
        }
    };
}

clone_by_field!(Lattice { frame, columns, rows, views, placed });
clone_by_field!(Placed { eye, near, planes });
clone_by_field!(Axis { tangents, spans, slots, is_plain, first, end });

/// Tangents that differ by less are one edge: rounding, which the slack of the box tests covers.
const SAME_EDGE: f64 = 1e-9;

impl Lattice {
    /// The lattices that views given in room space form, by `ViewId`: views of one eye through one plane, where they are
    /// columns by rows; any other view alone.
    pub(super) fn of_views(room: &[Frustum]) -> Vec<Self> {
        let mut groups: Vec<(Frame, Vec<u16>)> = Vec::new();
        for (frustum, view) in room.iter().zip(0..) {
            match groups.iter_mut().find(|(frame, _)| frame.sees(frustum)) {
                Some((_, views)) => views.push(view),
                None => groups.push((Frame::of(frustum), vec![view])),
            }
        }
        let mut lattices = Vec::new();
        for (frame, mut views) in groups {
            // Views that show the same, as those of several eyes do where the eyes are in one place, are a lattice each time: eyes
            // part later, and lattices are not joined again.
            while !views.is_empty() {
                let (mut layer, mut rest): (Vec<u16>, Vec<u16>) = (Vec::new(), Vec::new());
                for view in views {
                    let edges = |view: &u16| frame.edges(&room[usize::from(*view)]);
                    let is_taken = layer.iter().any(|other| same_cell(&edges(other), &edges(&view)));
                    if is_taken { &mut rest } else { &mut layer }.push(view);
                }
                match Self::of_group(frame, &layer, room) {
                    Some(lattice) => lattices.push(lattice),
                    None => lattices.extend(layer.iter().filter_map(|view| Self::of_group(frame, &[*view], room))),
                }
                views = rest;
            }
        }
        lattices
    }

    /// `None` when the views are not all cells of columns by rows, each once.
    fn of_group(frame: Frame, views: &[u16], room: &[Frustum]) -> Option<Self> {
        let edges = |axis: usize| views.iter().map(move |v| frame.edges(&room[usize::from(*v)])[axis]);
        let (columns, rows) = (Axis::of(edges(0)), Axis::of(edges(1)));
        let mut cells = vec![None; columns.spans.len() * rows.spans.len()];
        for view in views {
            let [x, y] = frame.edges(&room[usize::from(*view)]);
            let cell = &mut cells[rows.span_of(y)? * columns.spans.len() + columns.span_of(x)?];
            if cell.replace(*view).is_some() {
                return None;
            }
        }
        let views: Vec<u16> = cells.into_iter().collect::<Option<_>>()?;
        let planes = |axis: &Axis| vec![RelativePlane::default(); axis.tangents.len()];
        let planes = [planes(&columns), planes(&rows)];
        let placed = Placed { eye: frame.eye, near: RelativePlane::default(), planes };
        Some(Self { frame, columns, rows, views, placed })
    }

    /// Takes the views' new frusta in room space, after an eye has moved. Whether they still form this lattice.
    pub(super) fn update(&mut self, room: &[Frustum]) -> bool {
        let frustum_of = |column: usize, row: usize, views: &[u16], columns: &Axis| {
            &room[usize::from(views[row * columns.spans.len() + column])]
        };
        let frame = Frame::of(frustum_of(0, 0, &self.views, &self.columns));
        self.frame = frame;
        for column in 0..self.columns.spans.len() {
            let [x, _] = frame.edges(frustum_of(column, 0, &self.views, &self.columns));
            self.columns.set(column, x);
        }
        for row in 0..self.rows.spans.len() {
            let [_, y] = frame.edges(frustum_of(0, row, &self.views, &self.columns));
            self.rows.set(row, y);
        }
        let holds = |(cell, view): (usize, &u16)| {
            let frustum = &room[usize::from(*view)];
            let [x, y] = frame.edges(frustum);
            let (column, row) = (cell % self.columns.spans.len(), cell / self.columns.spans.len());
            frame.sees(frustum) && self.columns.is_at(column, x) && self.rows.is_at(row, y)
        };
        self.columns.is_ascending() && self.rows.is_ascending() && self.views.iter().enumerate().all(holds)
    }

    /// Places the planes in the world.
    pub(super) fn place(&mut self, world_from_room: &DAffine3) {
        let Frame { eye, forward, right, up, near_m } = self.frame;
        let [forward, right, up] = [forward, right, up].map(|v| world_from_room.transform_vector3(v));
        let scale = forward.length();
        self.placed.eye = world_from_room.transform_point3(eye);
        self.placed.near = RelativePlane { normal: forward / scale, offset_m: near_m * scale };
        for ((axis, across), planes) in [(&self.columns, right), (&self.rows, up)].into_iter().zip(&mut self.placed.planes) {
            for (plane, tangent) in planes.iter_mut().zip(&axis.tangents) {
                *plane = RelativePlane { normal: (across - forward * *tangent).normalize(), offset_m: 0.0 };
            }
        }
    }

    /// By how much, since it was placed as `before`, planes have moved at most where the eye is, metres, and turned,
    /// radians; `None` where they are not the same planes.
    pub(super) fn movement_since(&self, before: &Self) -> Option<(f64, f64)> {
        let (now, before_at) = (&self.placed, &before.placed);
        let is_same = self.views == before.views && (0..2).all(|axis| now.planes[axis].len() == before_at.planes[axis].len());
        if !is_same {
            return None;
        }
        let pairs = (0..2).flat_map(|axis| now.planes[axis].iter().zip(&before_at.planes[axis]));
        let turned = pairs
            .chain([(&now.near, &before_at.near)])
            .map(|(now, before)| (now.normal - before.normal).length())
            .fold(0.0, f64::max);
        let moved_m = (now.eye - before_at.eye).length() + (now.near.offset_m - before_at.near.offset_m).abs();
        Some((moved_m, turned))
    }

    /// The views, row by row from the bottom.
    pub(super) fn views(&self) -> &[u16] {
        &self.views
    }

    /// The eye in the world.
    pub(super) fn eye(&self) -> DVec3 {
        self.placed.eye
    }

    /// The near plane, positive towards the scene.
    pub(super) fn near(&self) -> &RelativePlane {
        &self.placed.near
    }

    /// The columns' planes from left to right, and the rows' from bottom to top; each positive towards the next one.
    pub(super) fn planes(&self) -> [&[RelativePlane]; 2] {
        [&self.placed.planes[0], &self.placed.planes[1]]
    }

    /// Whether columns and rows are the slots: nothing overlaps, and there are no gaps.
    #[inline(always)]
    pub(super) fn is_plain(&self) -> bool {
        self.columns.is_plain && self.rows.is_plain
    }

    /// Slots across and up.
    pub(super) fn slots(&self) -> [u16; 2] {
        [self.columns.slots, self.rows.slots]
    }

    /// First column, one past the last, first row and one past the last that cover a rectangle of slots; none where the
    /// first is not below the end.
    #[inline(always)]
    pub(super) fn cells(&self, [left, right, bottom, top]: [u16; 4]) -> [u16; 4] {
        [self.columns.first.at(left), self.columns.end.at(right - 1), self.rows.first.at(bottom), self.rows.end.at(top - 1)]
    }

    /// The view of a cell.
    #[inline(always)]
    pub(super) fn view(&self, column: u16, row: u16) -> u16 {
        self.views[usize::from(row) * self.columns.spans.len() + usize::from(column)]
    }

    /// The views of a row, by column.
    #[inline(always)]
    pub(super) fn row(&self, row: u16, columns: std::ops::Range<u16>) -> &[u16] {
        let start = usize::from(row) * self.columns.spans.len();
        &self.views[start + usize::from(columns.start)..start + usize::from(columns.end)]
    }
}

impl Frame {
    fn of(frustum: &Frustum) -> Self {
        let near = frustum.plane(FrustumSide::Near);
        let [bottom_left, bottom_right, _, top_left] = frustum.rays;
        Self {
            eye: frustum.eye,
            forward: near.normal,
            right: (bottom_right - bottom_left).normalize(),
            up: (top_left - bottom_left).normalize(),
            near_m: near.distance_m(frustum.eye),
        }
    }

    /// Whether a view has this frame.
    fn sees(&self, frustum: &Frustum) -> bool {
        let other = Self::of(frustum);
        let same = |a: DVec3, b: DVec3| (a - b).length() < SAME_EDGE;
        self.eye == other.eye
            && same(self.forward, other.forward)
            && same(self.right, other.right)
            && same(self.up, other.up)
            && (self.near_m - other.near_m).abs() < SAME_EDGE * self.near_m.abs()
    }

    /// A view's edges as tangents: left and right, bottom and top.
    fn edges(&self, frustum: &Frustum) -> [[f64; 2]; 2] {
        let [bottom_left, bottom_right, _, top_left] = frustum.rays;
        let tangent = |ray: DVec3, across: DVec3| ray.dot(across) / ray.dot(self.forward);
        [
            [tangent(bottom_left, self.right), tangent(bottom_right, self.right)],
            [tangent(bottom_left, self.up), tangent(top_left, self.up)],
        ]
    }
}

fn same_edge(a: f64, b: f64) -> bool {
    (a - b).abs() <= SAME_EDGE * (1.0 + a.abs())
}

fn same_cell(a: &[[f64; 2]; 2], b: &[[f64; 2]; 2]) -> bool {
    a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| same_edge(*a, *b))
}

impl Axis {
    fn of(edges: impl Iterator<Item = [f64; 2]> + Clone) -> Self {
        let mut tangents: Vec<f64> = edges.clone().flatten().collect();
        tangents.sort_by(f64::total_cmp);
        tangents.dedup_by(|b, a| same_edge(*a, *b));
        let index = |t: f64| tangents.iter().position(|known| same_edge(*known, t)).unwrap_or(0) as u16;
        let mut spans: Vec<[u16; 2]> = edges.map(|[low, high]| [index(low), index(high)]).collect();
        spans.sort_unstable();
        spans.dedup();
        let slots = 0..tangents.len().saturating_sub(1) as u16;
        // Where one column lies within another, columns between the first and the last are taken along: conservative.
        let first = |slot: u16| spans.iter().take_while(|span| span[1] <= slot).count() as u16;
        let end = |slot: u16| spans.iter().take_while(|span| span[0] <= slot).count() as u16;
        let (first, end) = (SlotTable::of(slots.clone().map(first)), SlotTable::of(slots.clone().map(end)));
        let is_plain = spans.iter().zip(0..).all(|(span, slot)| *span == [slot, slot + 1]);
        Self { spans, slots: slots.end, is_plain, first, end, tangents }
    }

    fn span_of(&self, edges: [f64; 2]) -> Option<usize> {
        (0..self.spans.len()).find(|column| self.is_at(*column, edges))
    }

    fn is_at(&self, column: usize, edges: [f64; 2]) -> bool {
        let span = self.spans[column].map(|edge| self.tangents[usize::from(edge)]);
        same_edge(span[0], edges[0]) && same_edge(span[1], edges[1])
    }

    fn set(&mut self, column: usize, edges: [f64; 2]) {
        for (edge, tangent) in self.spans[column].into_iter().zip(edges) {
            self.tangents[usize::from(edge)] = tangent;
        }
    }

    fn is_ascending(&self) -> bool {
        self.tangents.windows(2).all(|pair| pair[0] < pair[1])
    }
}
