//! Views that overlap, as cells that do not (section 3: "treating the overlapping regions as additional independent frustums").

use glam::{DAffine3, DVec3};
use mullion_common::geometry::{Frustum, FrustumSide};

/// How a frustum hierarchy treats views that overlap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overlap {
    /// A view that a bisection plane cuts stands below both halves, and what reaches it is tested against its own planes: "the
    /// terminal frustum will further involve a check for visibility" (section 4.2).
    #[default]
    TerminalCheck,
    /// Views of one eye through one plane that overlap are divided along all their sides: each part is a frustum of its
    /// own, and what it sees is seen by every view that the part belongs to (section 3).
    OwnFrusta,
}

/// Most cells; more views than fit when divided stay whole. What a frustum hierarchy of bounded depth takes.
const MAX_CELLS: usize = 2048;

/// Tangents that differ by less are one edge: rounding, which the slack of the box tests covers.
const SAME_EDGE: f64 = 1e-9;

/// The views of a wall as frusta that do not overlap where the views share an eye and a plane. Keeps its memory.
#[derive(Default)]
pub(super) struct Cells {
    room: Vec<Frustum>,
    world: Vec<Frustum>,
    /// The views that each cell belongs to, cell after cell.
    views: Vec<u16>,
    /// Of each cell, one past its last entry in `views`.
    ends: Vec<u32>,
    /// `views` and `ends` before the last update.
    before: (Vec<u16>, Vec<u32>),
    windows: Vec<Window>,
    /// Views that overlap, directly or by way of others, and which views have been taken.
    patch: Vec<u16>,
    is_taken: Vec<bool>,
    edges: [Vec<f64>; 2],
}

impl Cells {
    /// The cells of views given in room space, by `ViewId`.
    pub(super) fn new(room: &[Frustum]) -> Self {
        let mut cells = Self::default();
        cells.update(room);
        cells
    }

    /// Takes the views' new frusta in room space. Whether there are as many cells as before, of the same views.
    pub(super) fn update(&mut self, room: &[Frustum]) -> bool {
        std::mem::swap(&mut self.views, &mut self.before.0);
        std::mem::swap(&mut self.ends, &mut self.before.1);
        self.views.clear();
        self.ends.clear();
        self.room.clear();
        self.windows.clear();
        self.windows.extend(room.iter().map(Window::of));
        self.is_taken.clear();
        self.is_taken.resize(room.len(), false);
        for view in 0..room.len() {
            if !self.is_taken[view] {
                self.gather_patch(view as u16);
                self.divide_patch(room);
            }
        }
        self.world.clone_from(&self.room);
        (&self.views, &self.ends) == (&self.before.0, &self.before.1)
    }

    /// Finds the views that hang together with `view` by overlaps.
    fn gather_patch(&mut self, view: u16) {
        let Self { patch, is_taken, windows, .. } = self;
        patch.clear();
        patch.push(view);
        is_taken[usize::from(view)] = true;
        let mut at = 0;
        while at < patch.len() {
            let window = &windows[usize::from(patch[at])];
            for (other, is_taken) in is_taken.iter_mut().enumerate() {
                if !*is_taken && window.overlaps(&windows[other]) {
                    *is_taken = true;
                    patch.push(other as u16);
                }
            }
            at += 1;
        }
        patch.sort_unstable();
    }

    /// Adds the cells of a patch.
    fn divide_patch(&mut self, room: &[Frustum]) {
        let Self { patch, windows, edges, .. } = self;
        for (axis, edges) in edges.iter_mut().enumerate() {
            edges.clear();
            edges.extend(patch.iter().flat_map(|view| windows[usize::from(*view)].spans[axis]));
            edges.sort_unstable_by(f64::total_cmp);
            edges.dedup_by(|b, a| is_same_edge(*a, *b));
        }
        let parts = (edges[0].len() - 1) * (edges[1].len() - 1);
        if patch.len() == 1 || self.room.len() + parts + room.len() > MAX_CELLS {
            for view in &self.patch {
                self.room.push(room[usize::from(*view)]);
                self.views.push(*view);
                self.ends.push(self.views.len() as u32);
            }
            return;
        }
        let window = windows[usize::from(patch[0])];
        for y in edges[1].windows(2) {
            for x in edges[0].windows(2) {
                let middle = [(x[0] + x[1]) * 0.5, (y[0] + y[1]) * 0.5];
                let first = self.views.len();
                self.views.extend(patch.iter().filter(|view| windows[usize::from(**view)].shows(middle)));
                if self.views.len() > first {
                    self.room.push(window.frustum([[x[0], x[1]], [y[0], y[1]]]));
                    self.ends.push(self.views.len() as u32);
                }
            }
        }
    }

    /// Places the cells in the world.
    pub(super) fn place(&mut self, world_from_room: &DAffine3) {
        for (world, room) in self.world.iter_mut().zip(&self.room) {
            *world = room.transformed(world_from_room);
        }
    }

    pub(super) fn room(&self) -> &[Frustum] {
        &self.room
    }

    pub(super) fn world(&self) -> &[Frustum] {
        &self.world
    }

    /// The views that a cell belongs to, ascending.
    pub(super) fn views_through(&self, cell: u16) -> &[u16] {
        let cell = usize::from(cell);
        let start = if cell == 0 { 0 } else { self.ends[cell - 1] };
        &self.views[start as usize..self.ends[cell] as usize]
    }
}

/// A view as a rectangle in the plane at distance one before its eye.
#[derive(Clone, Copy)]
struct Window {
    eye: DVec3,
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    near_m: f64,
    /// Tangents: left and right, bottom and top.
    spans: [[f64; 2]; 2],
}

impl Window {
    fn of(frustum: &Frustum) -> Self {
        let near = frustum.plane(FrustumSide::Near);
        let forward = near.normal;
        let [bottom_left, bottom_right, _, top_left] = frustum.rays;
        let right = (bottom_right - bottom_left).normalize();
        let up = (top_left - bottom_left).normalize();
        let tangent = |ray: DVec3, across: DVec3| ray.dot(across) / ray.dot(forward);
        let spans =
            [[tangent(bottom_left, right), tangent(bottom_right, right)], [tangent(bottom_left, up), tangent(top_left, up)]];
        Self { eye: frustum.eye, forward, right, up, near_m: -near.distance_m(frustum.eye), spans }
    }

    /// Whether the two share eye, directions and near plane, and a part of the picture.
    fn overlaps(&self, other: &Self) -> bool {
        let same = |a: DVec3, b: DVec3| (a - b).length() < SAME_EDGE;
        self.eye == other.eye
            && same(self.forward, other.forward)
            && same(self.right, other.right)
            && same(self.up, other.up)
            && (self.near_m - other.near_m).abs() < SAME_EDGE * self.near_m
            && self.spans.iter().zip(&other.spans).all(|([low, high], [other_low, other_high])| {
                let (low, high) = (low.max(*other_low), high.min(*other_high));
                low < high && !is_same_edge(low, high)
            })
    }

    fn shows(&self, point: [f64; 2]) -> bool {
        self.spans.iter().zip(point).all(|([low, high], at)| *low < at && at < *high)
    }

    /// What is seen through another rectangle of this window's plane. Built before an eye at the origin: its place would cost
    /// the rays digits.
    fn frustum(&self, [[left, right], [bottom, top]]: [[f64; 2]; 2]) -> Frustum {
        let at = |x: f64, y: f64| self.forward + self.right * x + self.up * y;
        let corners = [at(left, bottom), at(right, bottom), at(left, top)];
        Frustum::through_rectangle(DVec3::ZERO, corners, self.near_m).transformed(&DAffine3::from_translation(self.eye))
    }
}

fn is_same_edge(a: f64, b: f64) -> bool {
    (a - b).abs() <= SAME_EDGE * (1.0 + a.abs())
}
