//! Culling: which leaves of the object hierarchy each view may see.
//!
//! All algorithms are conservative and give leaf ranges, one visible set a view. `adaptive` is the paper's
//! (Nirnimesh, Harish, Narayanan 2006, section 4.2); the others are what it is held against.

mod adaptive;
mod adaptive_grouped;
mod fh;
mod frustum_hierarchy;
mod naive;
mod oh;
mod oh_plain;
pub mod oracle;
mod overlap;
mod primary;
pub mod shadow;
mod sweep;

use std::fmt;
use std::str::FromStr;

use glam::{DAffine3, DVec3};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{ViewId, Wall};

use crate::tree::{CullTree, TreeForm};

pub use frustum_hierarchy::{FrustumHierarchy, FrustumNode, Guards, Split};
pub use overlap::Overlap;
pub use primary::PrimaryFrustum;

/// How to cull.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Algorithm {
    /// Every leaf against every view: O(m n). `oh` makes the same tests and finds the same sets; `adaptive` also tests
    /// against planes of neighbouring views, and may leave out more of what cannot be seen.
    Naive,
    /// The object hierarchy, view by view, with plane masks and the fully-inside shortcut: "OH without FH".
    Oh,
    /// The object hierarchy, view by view, without masks and shortcut: the paper's traditional way.
    OhPlain,
    /// Every leaf down the frustum hierarchy: "FH without OH".
    Fh,
    /// Both hierarchies together, each unfolded where it pays: "adaptive OH and FH".
    Adaptive,
    /// The same with pseudo-groups: what lies on one side of a bisection plane goes on as one. For nodes of very many
    /// children.
    AdaptiveGrouped,
    /// One walk of the wide tree for a whole grid of tiles: ours, and the fastest.
    Sweep,
}

impl Algorithm {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Naive, Self::OhPlain, Self::Fh, Self::Oh, Self::Adaptive, Self::AdaptiveGrouped, Self::Sweep];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Naive => "naive",
            Self::OhPlain => "oh-plain",
            Self::Fh => "fh",
            Self::Oh => "oh",
            Self::Adaptive => "adaptive",
            Self::AdaptiveGrouped => "adaptive-grouped",
            Self::Sweep => "sweep",
        }
    }
}

impl Algorithm {
    /// The form of the tree that it walks, which must be refitted before.
    pub fn tree_form(self) -> TreeForm {
        if self == Self::Sweep { TreeForm::Wide } else { TreeForm::Hierarchy }
    }
}

impl fmt::Display for Algorithm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Algorithm {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::name).join(", ");
        Self::ALL.into_iter().find(|a| a.name() == name).ok_or_else(|| format!("{name:?} is no algorithm; there are {}", known()))
    }
}

impl std::ops::AddAssign for CullStats {
    fn add_assign(&mut self, other: Self) {
        self.nodes_visited += other.nodes_visited;
        self.plane_tests += other.plane_tests;
    }
}

/// What one cull cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CullStats {
    /// Nodes of the object hierarchy tested, counted each time.
    pub nodes_visited: u64,
    /// Boxes tested against a plane.
    pub plane_tests: u64,
}

/// Culls frame after frame, reusing its memory: a frame allocates nothing once sets have reached their size.
pub struct Culler {
    algorithm: Algorithm,
    frusta: FrustumHierarchy,
    sweeper: sweep::Sweeper,
    room_eyes: Vec<DVec3>,
    traversal: adaptive::Memory,
    descent: Vec<oh::Open>,
    open: Vec<oh::Open>,
    /// A set with leaves that are gone, on its way to one without.
    with_removed: VisibleSet,
    groups: adaptive_grouped::Memory,
}

impl Culler {
    /// A culler for a wall.
    pub fn new(algorithm: Algorithm, wall: &Wall) -> Self {
        let room_eyes = wall.default_eyes();
        let frusta = FrustumHierarchy::new(room_frusta(wall, &room_eyes), Overlap::default());
        let sweeper = sweep::Sweeper::new(frusta.views());
        Self {
            algorithm,
            frusta,
            sweeper,
            room_eyes,
            traversal: adaptive::Memory::default(),
            descent: Vec::new(),
            open: Vec::new(),
            with_removed: VisibleSet::default(),
            groups: adaptive_grouped::Memory::default(),
        }
    }

    /// Culls large scenes on so many threads, the caller's among them; only [`Algorithm::Sweep`] takes more than one.
    ///
    /// # Errors
    /// When the system gives no more.
    pub fn with_threads(mut self, threads: usize) -> std::io::Result<Self> {
        self.sweeper.set_threads(threads)?;
        Ok(self)
    }

    /// Whether [`Algorithm::Sweep`] uses temporal slack: a frame costs what has changed since the last one, in memory that
    /// is kept of each node. Sets are the same.
    #[must_use]
    pub fn with_slack(mut self, is_used: bool) -> Self {
        self.sweeper.set_slack(is_used);
        self
    }

    /// How [`Algorithm::Fh`], [`Algorithm::Adaptive`] and [`Algorithm::AdaptiveGrouped`] treat views that overlap; the other
    /// algorithms have no frustum hierarchy.
    #[must_use]
    pub fn with_overlap(mut self, overlap: Overlap) -> Self {
        self.frusta = FrustumHierarchy::new(self.frusta.room().to_vec(), overlap);
        self
    }

    /// Finds what each view may see.
    ///
    /// `eyes` in room space (each in front of its screen, see `Wall::check_eye`) and `sets` are indexed by `ViewId`, one for each view of the wall; `world_from_room` is a
    /// similarity without mirroring. The sets are conservative: they hold every leaf of which a pixel may be drawn.
    ///
    /// # Panics
    /// When `eyes` or `sets` are not as many as the wall's views.
    pub fn cull(
        &mut self,
        tree: &CullTree,
        wall: &Wall,
        eyes: &[DVec3],
        world_from_room: &DAffine3,
        sets: &mut [VisibleSet],
    ) -> CullStats {
        assert_eq!(eyes.len(), wall.views().len(), "an eye for each view");
        assert_eq!(sets.len(), wall.views().len(), "a set for each view");
        if eyes != self.room_eyes {
            self.room_eyes.clear();
            self.room_eyes.extend_from_slice(eyes);
            self.frusta.update(room_frusta_iter(wall, &self.room_eyes));
            self.sweeper.update(self.frusta.room());
        }
        debug_assert!(tree.is_refitted(self.algorithm.tree_form()), "refit before culling");
        sets.iter_mut().for_each(VisibleSet::clear);
        let hierarchy = tree.hierarchy();
        if hierarchy.root().is_none() {
            return CullStats::default();
        }
        let stats = self.cull_all(tree, world_from_room, sets);
        if let Some(removed) = tree.removed() {
            for set in sets {
                self.with_removed.clone_from(set);
                self.with_removed.difference_into(removed, set);
            }
        }
        stats
    }

    fn cull_all(&mut self, tree: &CullTree, world_from_room: &DAffine3, sets: &mut [VisibleSet]) -> CullStats {
        if self.algorithm == Algorithm::Sweep {
            return self.sweeper.cull(tree, world_from_room, sets);
        }
        let hierarchy = tree.hierarchy();
        self.frusta.place(world_from_room);
        match self.algorithm {
            Algorithm::Sweep => unreachable!("above"),
            Algorithm::Naive => naive::cull(hierarchy, self.frusta.views(), sets),
            Algorithm::OhPlain => oh_plain::cull(hierarchy, self.frusta.views(), sets),
            Algorithm::Fh => {
                let memory = (&mut self.open, &mut self.traversal);
                fh::cull(hierarchy, &self.frusta, memory, sets)
            }
            Algorithm::Oh => oh::cull(hierarchy, self.frusta.views(), &mut self.descent, sets),
            Algorithm::Adaptive => {
                let memory = (&mut self.open, &mut self.traversal);
                adaptive::cull(hierarchy, &self.frusta, memory, sets)
            }
            Algorithm::AdaptiveGrouped => adaptive_grouped::cull(hierarchy, &self.frusta, &mut self.open, &mut self.groups, sets),
        }
    }
}

fn room_frusta(wall: &Wall, eyes: &[DVec3]) -> Vec<mullion_common::geometry::Frustum> {
    room_frusta_iter(wall, eyes).collect()
}

fn room_frusta_iter<'a>(wall: &'a Wall, eyes: &'a [DVec3]) -> impl Iterator<Item = mullion_common::geometry::Frustum> + 'a {
    eyes.iter().enumerate().map(|(view, eye)| wall.frustum(ViewId(view as u16), *eye, &DAffine3::IDENTITY))
}
