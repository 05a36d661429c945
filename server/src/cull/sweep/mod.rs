//! The sweep: one walk of the wide tree finds the tiles of a whole grid.
//!
//! A box meets a contiguous range of a lattice's columns and one of its rows. The walk carries that rectangle of slots, and
//! which of its outer sides may still cut the box, down the tree; of a node's eight children it tests
//! only the planes inside the rectangle and the sides left. What lies in one slot and is cut by nothing goes out whole, as
//! (leaf range × rectangle of tiles), in ascending order. Leaves that are cut are tested again as oriented boxes, in
//! `f64`. Walls of several screens or eyes are swept lattice by lattice.

mod kernel;
mod lanes;
mod lattice;

use glam::DAffine3;
use mullion_common::geometry::Frustum;
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::CullStats;
use crate::tree::CullTree;
use lattice::Lattice;

/// Sweeps frame after frame, reusing its memory.
pub(super) struct Sweeper {
    lattices: Vec<Lattice>,
    memory: kernel::Memory,
}

impl Sweeper {
    /// A sweeper for views given in room space, by `ViewId`.
    pub(super) fn new(room: &[Frustum]) -> Self {
        Self { lattices: Lattice::of_views(room), memory: kernel::Memory::default() }
    }

    /// Takes the views' new frusta in room space, after an eye has moved. Allocates only where views that shared an eye no
    /// longer do.
    pub(super) fn update(&mut self, room: &[Frustum]) {
        if !self.lattices.iter_mut().all(|lattice| lattice.update(room)) {
            self.lattices = Lattice::of_views(room);
        }
    }

    /// Finds what each view may see. `sets` must be empty.
    pub(super) fn cull(&mut self, tree: &CullTree, world_from_room: &DAffine3, sets: &mut [VisibleSet]) -> CullStats {
        let mut stats = CullStats::default();
        let (wide, hierarchy) = (tree.wide(), tree.hierarchy());
        for lattice in &mut self.lattices {
            lattice.place(world_from_room);
            let [across, up] = lattice.slots();
            let leaves = LeafRange::new(0, wide.leaf_count());
            let start = [kernel::Visit { node: 0, leaves, slots: [0, across, 0, up], mask: kernel::ALL }];
            let memory = &mut self.memory;
            stats += lanes::run_on_best(kernel::Sweep { tree: wide, hierarchy, lattice, start: &start, memory, sets });
        }
        stats
    }
}
