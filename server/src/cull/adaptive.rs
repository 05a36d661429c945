//! The paper's adaptive traversal of both hierarchies (section 4.2).

use glam::DVec3;
use mullion_common::geometry::{BoxTerms, Clearance, Frustum, Obb, Plane};
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::CullStats;
use super::frustum_hierarchy::{FrustumHierarchy, Guards, Split};
use super::oh::{self, Open};

/// Culls the object hierarchy to the frustum hierarchy.
///
/// First to the primary frustum: a node that its planes cut is unfolded, one outside is dropped. What is left meets
/// the frustum hierarchy: where a bisection plane misses the node, only that side of the frustum hierarchy goes on
/// with it whole; where the plane cuts it, the object hierarchy unfolds, and each child is classified in turn (the
/// paper's L, C, R). A leaf that is cut goes to both sides. At the frustum hierarchy's leaves the object hierarchy alone goes
/// on, with those of the view's planes that no test on the way has settled: the terminal visibility check that walls
/// with gaps and overlaps need.
///
/// The paper's Algorithm 2 classifies a node's *children*, which loses nodes that have none; its prose, followed
/// here, lets the frustum hierarchy alone descend at the object hierarchy's leaves.
pub(super) fn cull(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    (open, memory): (&mut Vec<Open>, &mut Memory),
    sets: &mut [VisibleSet],
) -> CullStats {
    let mut stats = CullStats::default();
    let mut traversal = Traversal { hierarchy, frusta, memory, sets };
    for_each_in_primary(hierarchy, frusta, open, &mut stats, |node, cut, stats| traversal.walk(node, cut, stats));
    // Where views overlap, a view may have been reached on two ways, and its ranges stand out of order.
    sets.iter_mut().for_each(VisibleSet::normalize);
    stats
}

/// The first level: calls `meet` for the largest nodes that no plane of the primary frustum cuts, and for leaves that one
/// does, each with the planes that cut it; in ascending order.
pub(super) fn for_each_in_primary(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    open: &mut Vec<Open>,
    stats: &mut CullStats,
    mut meet: impl FnMut(u32, u8, &mut CullStats),
) {
    let nodes = hierarchy.nodes();
    let primary = frusta.primary();
    let all_primary = ((1u32 << primary.len()) - 1) as u8;
    let mut at = 0;
    open.clear();
    while at < nodes.len() as u32 {
        while open.last().is_some_and(|(subtree_end, _)| *subtree_end <= at) {
            open.pop();
        }
        let node = &nodes[at as usize];
        stats.nodes_visited += 1;
        let mask = open.last().map_or(all_primary, |(_, mask)| *mask);
        let cut = oh::cut_planes(|k| (&primary[k].0, primary[k].1), mask, &node.bound, stats);
        at = match cut {
            None => node.subtree_end,
            Some(cut) if cut == 0 || node.subtree_end == at + 1 => {
                meet(at, cut, stats);
                node.subtree_end
            }
            Some(cut) => {
                open.push((node.subtree_end, cut));
                at + 1
            }
        };
    }
}

/// Where something has come to in the frustum hierarchy, and what is known of it there. Small, so as to stay in registers.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    /// Place in the frustum hierarchy's list of splits, or past its end. The root is 0.
    fh: u32,
    /// Bit k: wholly on this side of the bisection plane k steps up, the parent's being 0.
    parted: u32,
}

impl Place {
    /// The child `fh`, on whose side of the plane not all of the box is.
    #[inline]
    fn cut(self, fh: u32) -> Self {
        Self { fh, parted: self.parted << 1 }
    }

    /// The child `fh`, on whose side of the plane the box wholly is.
    #[inline]
    fn parted(self, fh: u32) -> Self {
        Self { fh, parted: (self.parted << 1) | 1 }
    }
}

/// Most places that a leaf puts off: one at each depth.
const MAX_HALVES: usize = 32;

/// What a traversal needs, kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Memory {
    /// The ancestors that bisection planes cut, without the last: where each one's subtree ends, and where its children
    /// start.
    unfolded: Vec<(u32, Place)>,
    /// Where a leaf still has to go.
    halves: [Place; MAX_HALVES],
    descent: Vec<Open>,
}

/// A box that goes down the frustum hierarchy, made ready for its planes.
struct Probe {
    terms: BoxTerms,
    /// To the eye, where there is but one.
    reach_m: Option<f64>,
}

impl Probe {
    #[inline]
    fn new(bound: &Obb, one_eye: Option<DVec3>) -> Self {
        let terms = BoxTerms::new(bound);
        Self { terms, reach_m: one_eye.map(|eye| terms.reach_m(eye)) }
    }

    #[inline]
    fn clearance(&self, plane: &Plane, eye: DVec3) -> Clearance {
        plane.clearance(&self.terms, self.reach_m.unwrap_or_else(|| self.terms.reach_m(eye)))
    }

    /// Takes it down the frustum hierarchy from `place` for as long as planes miss it. Returns where it has come to and, where a
    /// plane cuts it there, the two halves.
    #[inline(always)]
    fn part(&self, splits: &[Split], mut place: Place, stats: &mut CullStats) -> (Place, Option<[u32; 2]>) {
        // Counted here first, which stays out of memory.
        let mut tests = 0;
        let mut halves = None;
        while let Some(split) = splits.get(place.fh as usize) {
            tests += 1;
            let [negative, positive] = split.children;
            // Choices that are guessed, not looked up: what comes next does not wait for this test.
            let clearance = self.clearance(&split.plane, split.eye);
            if clearance.is_outside() {
                place = place.parted(negative);
            } else if clearance.is_inside() {
                place = place.parted(positive);
            } else {
                halves = Some([negative, positive]);
                break;
            }
        }
        stats.nodes_visited += tests;
        stats.plane_tests += tests;
        (place, halves)
    }

    /// Whether it is outside none of the frustum's planes of `mask`.
    #[inline]
    fn meets(&self, frustum: &Frustum, mask: u8, stats: &mut CullStats) -> bool {
        stats.nodes_visited += 1;
        let mut planes = frustum.planes.iter().enumerate().filter(|(k, _)| mask & (1 << k) != 0);
        planes.all(|(_, plane)| {
            stats.plane_tests += 1;
            !self.clearance(plane, frustum.eye).is_outside()
        })
    }
}

/// Both hierarchies, and where what is found goes.
pub(super) struct Traversal<'a> {
    pub hierarchy: &'a ObjectHierarchy,
    pub frusta: &'a FrustumHierarchy,
    pub memory: &'a mut Memory,
    pub sets: &'a mut [VisibleSet],
}

impl Traversal<'_> {
    /// Takes one node of the object hierarchy, of which `primary_cut` has the planes of the primary frustum that cut it, and
    /// all below it through both hierarchies: depth first, as nodes stand in memory.
    fn walk(&mut self, node: u32, primary_cut: u8, stats: &mut CullStats) {
        let hierarchy = self.hierarchy;
        let nodes = hierarchy.nodes();
        let root = (nodes[node as usize].subtree_end, Place::default());
        let (mut subtree_end, mut place) = root;
        let mut at = node;
        self.memory.unfolded.clear();
        while at < root.0 {
            while subtree_end <= at {
                (subtree_end, place) = self.memory.unfolded.pop().unwrap_or(root);
            }
            let end = nodes[at as usize].subtree_end;
            if end == at + 1 {
                self.meet_leaf(at, primary_cut, place, stats);
                at = end;
            } else if let Some(cut_at) = self.meet_node(at, primary_cut, place, stats) {
                self.memory.unfolded.push((subtree_end, place));
                (subtree_end, place) = (end, cut_at);
                at += 1;
            } else {
                at = end;
            }
        }
    }

    /// Takes a node with children down the frustum hierarchy from `place`, for as long as no plane cuts it. Returns where its
    /// children have to go on, if one does.
    #[inline]
    fn meet_node(&mut self, node: u32, primary_cut: u8, place: Place, stats: &mut CullStats) -> Option<Place> {
        let probe = Probe::new(&self.hierarchy.nodes()[node as usize].bound, self.frusta.one_eye());
        let (place, halves) = probe.part(self.frusta.splits(), place, stats);
        if halves.is_some() {
            return Some(place);
        }
        self.check_node(node, primary_cut, place, stats);
        None
    }

    /// Takes a leaf down the frustum hierarchy from `place`: to both sides of planes that cut it.
    #[inline]
    pub(super) fn meet_leaf(&mut self, node: u32, primary_cut: u8, mut place: Place, stats: &mut CullStats) {
        let splits = self.frusta.splits();
        let leaf = &self.hierarchy.nodes()[node as usize];
        let probe = Probe::new(&leaf.bound, self.frusta.one_eye());
        let mut put_off = 0;
        loop {
            let (cut_at, halves) = probe.part(splits, place, stats);
            if let Some([negative, positive]) = halves {
                self.memory.halves[put_off % MAX_HALVES] = cut_at.cut(positive);
                put_off += 1;
                place = cut_at.cut(negative);
                continue;
            }
            self.check_leaf((leaf.leaves, &probe), primary_cut, cut_at, stats);
            if put_off == 0 {
                return;
            }
            put_off -= 1;
            place = self.memory.halves[put_off % MAX_HALVES];
        }
    }

    /// The terminal check of a leaf: emits it to the cells of a place that may see it, tested against the planes that nothing
    /// on the way has settled.
    #[inline]
    fn check_leaf(&mut self, (leaf, probe): (LeafRange, &Probe), primary_cut: u8, place: Place, stats: &mut CullStats) {
        let settled = Guards::settled(primary_cut, place.parted);
        for (cell, guards) in self.frusta.cells_at(place.fh) {
            let mask = guards.untested(settled);
            if mask == 0 || probe.meets(&self.frusta.cells()[usize::from(cell)], mask, stats) {
                emit(self.sets, self.frusta.views_through(cell), leaf);
            }
        }
    }

    /// The terminal check of a node with children: the object hierarchy alone goes on.
    #[inline]
    fn check_node(&mut self, node: u32, primary_cut: u8, place: Place, stats: &mut CullStats) {
        let settled = Guards::settled(primary_cut, place.parted);
        let Self { hierarchy, frusta, memory, sets } = self;
        for (cell, guards) in frusta.cells_at(place.fh) {
            let views = frusta.views_through(cell);
            match guards.untested(settled) {
                0 => emit(sets, views, hierarchy.nodes()[node as usize].leaves),
                mask => {
                    let frustum = &frusta.cells()[usize::from(cell)];
                    let emit = &mut |leaves| emit(sets, views, leaves);
                    oh::descend(hierarchy, node, frustum, mask, &mut memory.descent, stats, emit);
                }
            }
        }
    }
}

/// Adds leaves to the sets of all `views`.
#[inline]
pub(super) fn emit(sets: &mut [VisibleSet], views: &[u16], leaves: LeafRange) {
    for view in views {
        let set = &mut sets[usize::from(*view)];
        // Nearly all come in order, which costs less to add.
        if set.ranges().last().is_none_or(|last| leaves.start >= last.start) {
            set.push(leaves);
        } else {
            set.push_unordered(leaves);
        }
    }
}
