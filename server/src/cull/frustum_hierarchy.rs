//! The frustum hierarchy (FH): the views of a wall, halved by planes again and again (section 3).
//!
//! Any set of views makes one: a grid seen from one eye, the walls of a CAVE, projectors that overlap, several eyes. The
//! bisection planes are sides of the views' own frusta, chosen so that the halves are about equal and few views are on
//! both sides. A view that a plane cuts stands below both halves. Views that no plane parts well share a node.
//!
//! What the tree parts are *cells*: the views themselves or, where overlaps are to have frusta of their own
//! ([`Overlap::OwnFrusta`]), parts of views that do not overlap, each of which may belong to several views.

use glam::{DAffine3, DVec3};
use mullion_common::geometry::{Containment, Frustum, FrustumSide, Plane};

use super::overlap::{Cells, Overlap};

/// A node of the frustum hierarchy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrustumNode {
    /// Cells to be tested one by one: `start..end` in the list of cells.
    #[allow(missing_docs)]
    Cells { start: u32, end: u32 },
    /// A bisection plane: one side of one cell's frustum, and the nodes in its two half-spaces.
    #[allow(missing_docs)]
    Split { cell: u16, side: FrustumSide, negative: u32, positive: u32 },
}

impl FrustumNode {
    /// Whose side its bisection plane is, if it has one.
    fn bisection(&self) -> Option<(u16, FrustumSide)> {
        match *self {
            Self::Cells { .. } => None,
            Self::Split { cell, side, .. } => Some((cell, side)),
        }
    }
}

/// The views of a wall as a tree. Built in room space, where it changes only when an eye moves; placed in the world each
/// frame.
pub struct FrustumHierarchy {
    /// By `ViewId`, room space.
    room: Vec<Frustum>,
    /// By `ViewId`, in the world.
    world: Vec<Frustum>,
    /// The cells, where they are not the views.
    cells: Option<Cells>,
    /// Each view's number: the views of a cell that is a view.
    numbers: Vec<u16>,
    /// Node 0 is the root.
    nodes: Vec<FrustumNode>,
    /// Below each node: range in `members`. Cells of a `Cells` node stand there too.
    below: Vec<(u32, u32)>,
    members: Vec<u16>,
    /// For each entry of `members` that stands below a `Cells` node, what has tested its cell's planes before.
    guards: Vec<Guards>,
    /// The `Split` nodes in order, as a traversal meets them.
    splits: Vec<Split>,
    /// The `Cells` nodes in order: range in `guards`.
    terminals: Vec<(u32, u32)>,
    /// Sides of cells' frusta that have all cells inside.
    primary_sides: Vec<(u16, FrustumSide)>,
    /// The same in the world, with the eye of each.
    primary: Vec<(Plane, DVec3)>,
    /// The eye in the world, where all cells have one.
    one_eye: Option<DVec3>,
    /// Memory of [`FrustumHierarchy::find_guards`].
    above: Vec<Plane>,
    builds: u64,
}

/// Which earlier test tells that a node is inside a view's plane, so that the terminal check can leave it out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guard {
    /// None: the plane is the cell's alone.
    None,
    /// The plane of the primary frustum with this index.
    Primary(u8),
    /// The bisection plane so many steps up, the parent's being 0.
    Split(u8),
}

/// A [`FrustumNode::Split`] as a traversal meets it: in one line of the cache, its plane in the world and where to go on.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Split {
    /// The bisection plane.
    pub plane: Plane,
    /// Of the frustum whose side it is.
    pub eye: DVec3,
    /// The place in the list of splits of the negative half, and of the positive one. Past the list's end stand the
    /// [`FrustumNode::Cells`]: to look a place up tells which it is.
    pub children: [u32; 2],
}

/// What has tested the planes of a cell before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Guards {
    /// All bits of `of_side`.
    all: u64,
    /// By [`FrustumSide`], which bit of [`Guards::settled`] tells that the plane needs no test.
    of_side: [u8; 5],
    cell: u16,
}

impl Guards {
    /// Bit of the primary plane 0.
    const PRIMARY: u8 = 32;
    /// A bit that is never set.
    const NEVER: u8 = 63;

    fn of(cell: u16, guards: [Guard; 5]) -> Self {
        let of_side = guards.map(|guard| match guard {
            Guard::None => Self::NEVER,
            Guard::Primary(k) => Self::PRIMARY + k,
            Guard::Split(up) => up,
        });
        Self { all: of_side.iter().fold(0, |all, bit| all | (1 << bit)), of_side, cell }
    }

    /// What tests on the way have settled. `primary_cut`: the primary planes that cut the node; `parted`, bit k: the node is
    /// wholly on this side of the plane k steps up, the parent's being 0.
    #[inline]
    pub fn settled(primary_cut: u8, parted: u32) -> u64 {
        u64::from(parted) | (u64::from(!primary_cut) << Self::PRIMARY)
    }

    /// The planes that no test on the way has settled, a bit each.
    #[inline]
    pub fn untested(&self, settled: u64) -> u8 {
        if self.all & !settled == 0 {
            return 0;
        }
        let bit = |k: usize| (((!settled >> self.of_side[k]) & 1) as u8) << k;
        bit(0) | bit(1) | bit(2) | bit(3) | bit(4)
    }
}

/// How much of a view may lie on the wrong side of a plane and still count as rounding.
const ANGULAR_TOLERANCE: f64 = 1e-9;

/// Deepest node: what a traversal knows of its ancestors fits a `u32`, a bit each. 2048 views, the most that a wall has,
/// are parted by 27 splits.
const MAX_DEPTH: u32 = 31;

const ALL_SIDES: [FrustumSide; 5] =
    [FrustumSide::Left, FrustumSide::Right, FrustumSide::Bottom, FrustumSide::Top, FrustumSide::Near];

impl FrustumHierarchy {
    /// Builds the hierarchy of views given in room space, one or more, by `ViewId`.
    pub fn new(room: Vec<Frustum>, overlap: Overlap) -> Self {
        let mut hierarchy = Self {
            world: room.clone(),
            cells: (overlap == Overlap::OwnFrusta).then(|| Cells::new(&room)),
            numbers: (0..room.len() as u16).collect(),
            room,
            nodes: Vec::new(),
            below: Vec::new(),
            members: Vec::new(),
            guards: Vec::new(),
            splits: Vec::new(),
            terminals: Vec::new(),
            primary_sides: Vec::new(),
            primary: Vec::new(),
            one_eye: None,
            above: Vec::new(),
            builds: 0,
        };
        hierarchy.build();
        hierarchy
    }

    /// Takes the views' new frusta in room space, after an eye has moved. The tree is kept while its planes still part
    /// the views as they did, and built anew when they do not.
    pub fn update(&mut self, room: impl Iterator<Item = Frustum>) {
        self.room.clear();
        self.room.extend(room);
        let has_same_cells = self.cells.as_mut().is_none_or(|cells| cells.update(&self.room));
        if has_same_cells && self.still_parts() {
            self.find_all_guards();
        } else {
            self.build();
        }
    }

    /// Places the views in the world.
    pub fn place(&mut self, world_from_room: &DAffine3) {
        for (world, room) in self.world.iter_mut().zip(&self.room) {
            *world = room.transformed(world_from_room);
        }
        if let Some(cells) = &mut self.cells {
            cells.place(world_from_room);
        }
        let cells = self.cells.as_ref().map_or(&self.world[..], Cells::world);
        let placed = |(cell, side): (u16, FrustumSide)| {
            let frustum = &cells[usize::from(cell)];
            (*frustum.plane(side), frustum.eye)
        };
        self.primary.clear();
        self.primary.extend(self.primary_sides.iter().map(|side| placed(*side)));
        for (split, side) in self.splits.iter_mut().zip(self.nodes.iter().filter_map(FrustumNode::bisection)) {
            (split.plane, split.eye) = placed(side);
        }
        self.one_eye = cells.first().map(|first| first.eye).filter(|eye| cells.iter().all(|cell| cell.eye == *eye));
    }

    /// How often the tree was built: once, and again when an eye's movement invalidated it.
    pub fn builds(&self) -> u64 {
        self.builds
    }

    /// The views' frusta in room space, by `ViewId`.
    pub fn room(&self) -> &[Frustum] {
        &self.room
    }

    /// The views' frusta in the world, by `ViewId`.
    pub fn views(&self) -> &[Frustum] {
        &self.world
    }

    /// The cells' frusta in the world.
    pub fn cells(&self) -> &[Frustum] {
        self.cells.as_ref().map_or(&self.world, Cells::world)
    }

    /// The views that see all that a cell sees.
    #[inline]
    pub fn views_through(&self, cell: u16) -> &[u16] {
        match &self.cells {
            Some(cells) => cells.views_through(cell),
            None => std::slice::from_ref(&self.numbers[usize::from(cell)]),
        }
    }

    /// The planes of the primary frustum in the world, with the eye of each: they have all views inside. Few or none
    /// where the views look all around.
    pub fn primary(&self) -> &[(Plane, DVec3)] {
        &self.primary
    }

    /// A node; 0 is the root.
    pub fn node(&self, id: u32) -> &FrustumNode {
        &self.nodes[id as usize]
    }

    /// The splits, the root's first, placed in the world.
    #[inline]
    pub fn splits(&self) -> &[Split] {
        &self.splits
    }

    /// The eye in the world, where all cells have one.
    #[inline]
    pub fn one_eye(&self) -> Option<DVec3> {
        self.one_eye
    }

    /// The cells of a [`FrustumNode::Cells`], and for each of its planes (by [`FrustumSide`]) what tested it before.
    pub fn cells_of(&self, start: u32, end: u32) -> impl Iterator<Item = (u16, &Guards)> {
        self.guards[start as usize..end as usize].iter().map(|guards| (guards.cell, guards))
    }

    /// The same at a place past the end of the list of splits.
    #[inline]
    pub fn cells_at(&self, place: u32) -> impl Iterator<Item = (u16, &Guards)> {
        let (start, end) = self.terminals[place as usize - self.splits.len()];
        self.cells_of(start, end)
    }

    fn build(&mut self) {
        self.builds += 1;
        self.nodes.clear();
        self.below.clear();
        self.members.clear();
        let all: Vec<u16> = (0..self.room_cells().len() as u16).collect();
        self.primary_sides = primary_sides(self.room_cells());
        self.build_node(&all, 0);
        self.guards = self.members.iter().map(|cell| Guards::of(*cell, [Guard::None; 5])).collect();
        self.find_all_guards();
        self.list_places();
    }

    /// Makes the lists of splits and of terminals. Planes come with [`FrustumHierarchy::place`].
    fn list_places(&mut self) {
        let split_count = self.nodes.iter().filter_map(FrustumNode::bisection).count() as u32;
        let (mut splits, mut terminals) = (0..split_count, split_count..);
        let is_split = |node: &FrustumNode| node.bisection().is_some();
        let next = |node: &FrustumNode| if is_split(node) { splits.next() } else { terminals.next() };
        let places: Vec<u32> = self.nodes.iter().filter_map(next).collect();
        self.splits.clear();
        self.terminals.clear();
        for node in &self.nodes {
            match *node {
                FrustumNode::Cells { start, end } => self.terminals.push((start, end)),
                FrustumNode::Split { negative, positive, .. } => self.splits.push(Split {
                    plane: Plane { normal: DVec3::ZERO, offset_m: 0.0 },
                    eye: DVec3::ZERO,
                    children: [negative, positive].map(|child| places[child as usize]),
                }),
            }
        }
    }

    /// The cells' frusta in room space.
    fn room_cells(&self) -> &[Frustum] {
        self.cells.as_ref().map_or(&self.room, Cells::room)
    }

    /// Adds the node over `cells`. Never deeper than [`MAX_DEPTH`]: each split leaves at most three quarters.
    fn build_node(&mut self, cells: &[u16], depth: u32) -> u32 {
        let id = self.nodes.len() as u32;
        let start = self.members.len() as u32;
        self.members.extend_from_slice(cells);
        let end = self.members.len() as u32;
        self.below.push((start, end));
        self.nodes.push(FrustumNode::Cells { start, end });
        let split = if depth < MAX_DEPTH { best_split(self.room_cells(), cells) } else { None };
        if let Some((cell, side)) = split {
            let room = self.room_cells();
            let plane = *room[usize::from(cell)].plane(side);
            let on = |wrong: Containment| {
                cells.iter().copied().filter(|c| side_of(&room[usize::from(*c)], &plane) != wrong).collect::<Vec<_>>()
            };
            let (below, beyond) = (on(Containment::Inside), on(Containment::Outside));
            let negative = self.build_node(&below, depth + 1);
            let positive = self.build_node(&beyond, depth + 1);
            self.nodes[id as usize] = FrustumNode::Split { cell, side, negative, positive };
        }
        id
    }

    fn find_all_guards(&mut self) {
        let mut above = std::mem::take(&mut self.above);
        above.clear();
        self.find_guards(0, &mut above);
        self.above = above;
    }

    /// Finds the guards of all cells below `node`, whose ancestors' planes are `above`, positive on its side.
    fn find_guards(&mut self, node: u32, above: &mut Vec<Plane>) {
        match self.nodes[node as usize] {
            FrustumNode::Cells { start, end } => {
                for at in start as usize..end as usize {
                    self.guards[at] = self.guards_of(self.members[at], above);
                }
            }
            FrustumNode::Split { cell, side, negative, positive } => {
                let plane = *self.room_cells()[usize::from(cell)].plane(side);
                for (child, plane) in [(negative, plane.flipped()), (positive, plane)] {
                    above.push(plane);
                    self.find_guards(child, above);
                    above.pop();
                }
            }
        }
    }

    fn guards_of(&self, cell: u16, above: &[Plane]) -> Guards {
        let room = self.room_cells();
        let frustum = &room[usize::from(cell)];
        Guards::of(
            cell,
            ALL_SIDES.map(|side| {
                let plane = frustum.plane(side);
                let primary = |(c, s): &(u16, FrustumSide)| same_plane(room[usize::from(*c)].plane(*s), plane);
                if let Some(k) = self.primary_sides.iter().position(primary) {
                    return Guard::Primary(k as u8);
                }
                let split = above.iter().position(|p| same_plane(p, plane));
                split.map_or(Guard::None, |depth| Guard::Split((above.len() - 1 - depth) as u8))
            }),
        )
    }

    /// Whether every cell still lies where the tree has it, and the primary planes still hold all cells.
    fn still_parts(&self) -> bool {
        let room = self.room_cells();
        let stray = |child: u32, plane: &Plane, right: Containment, sibling: u32| {
            let list = |node: u32| {
                let (start, end) = self.below[node as usize];
                &self.members[start as usize..end as usize]
            };
            list(child).iter().any(|cell| {
                // Below both children it may lie anywhere.
                side_of(&room[usize::from(*cell)], plane) != right && !list(sibling).contains(cell)
            })
        };
        let splits_hold = self.nodes.iter().all(|node| match *node {
            FrustumNode::Cells { .. } => true,
            FrustumNode::Split { cell, side, negative, positive } => {
                let plane = room[usize::from(cell)].plane(side);
                !stray(negative, plane, Containment::Outside, positive) && !stray(positive, plane, Containment::Inside, negative)
            }
        });
        splits_hold && self.primary_sides.iter().all(|(cell, side)| holds_all(room, *cell, *side))
    }
}

/// The plane that halves `cells` best, if one does: neither side keeps more than three quarters, and both sides
/// together hold at most half as many again.
fn best_split(room: &[Frustum], cells: &[u16]) -> Option<(u16, FrustumSide)> {
    if cells.len() < 2 {
        return None;
    }
    let mut best: Option<(usize, (u16, FrustumSide))> = None;
    for (cell, side) in cells.iter().flat_map(|c| FrustumSide::AROUND_EYE.map(|side| (*c, side))) {
        let plane = room[usize::from(cell)].plane(side);
        let (mut negative, mut positive) = (0, 0);
        for c in cells {
            match side_of(&room[usize::from(*c)], plane) {
                Containment::Outside => negative += 1,
                Containment::Inside => positive += 1,
                Containment::Cut => {
                    negative += 1;
                    positive += 1;
                }
            }
        }
        let larger = usize::max(negative, positive);
        let halves = larger * 4 <= cells.len() * 3 || (cells.len() <= 3 && larger < cells.len());
        let cost = larger * 2 + negative + positive;
        if halves && (negative + positive) * 2 <= cells.len() * 3 && best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, (cell, side)));
        }
    }
    best.map(|(_, split)| split)
}

/// Where a view's cone lies: `Inside` the positive half-space, `Outside` it, or `Cut`. Touching counts as being on the
/// side where the rest is.
fn side_of(view: &Frustum, plane: &Plane) -> Containment {
    let scale = view.rays[0].length();
    let apex = plane.distance_m(view.eye) / scale;
    let rays = view.rays.map(|r| plane.normal.dot(r) / r.length());
    let least = rays.into_iter().fold(apex, f64::min);
    let greatest = rays.into_iter().fold(apex, f64::max);
    if least >= -ANGULAR_TOLERANCE {
        Containment::Inside
    } else if greatest <= ANGULAR_TOLERANCE {
        Containment::Outside
    } else {
        Containment::Cut
    }
}

/// Whether a side of one view's frustum has all views inside.
pub(super) fn holds_all(room: &[Frustum], view: u16, side: FrustumSide) -> bool {
    let plane = room[usize::from(view)].plane(side);
    room.iter().all(|f| match side {
        FrustumSide::Near => near_holds(f, plane),
        _ => side_of(f, plane) == Containment::Inside,
    })
}

/// The sides of the views' frusta that have every view inside, each plane once.
pub(super) fn primary_sides(room: &[Frustum]) -> Vec<(u16, FrustumSide)> {
    const MAX_PLANES: usize = mullion_common::wire::MAX_PRIMARY_PLANES;
    let mut sides: Vec<(u16, FrustumSide)> = Vec::new();
    for (view, side) in (0..room.len() as u16).flat_map(|v| ALL_SIDES.map(|side| (v, side))) {
        let plane = room[usize::from(view)].plane(side);
        let same = |(v, s): &(u16, FrustumSide)| same_plane(room[usize::from(*v)].plane(*s), plane);
        if sides.len() < MAX_PLANES && !sides.iter().any(same) && holds_all(room, view, side) {
            sides.push((view, side));
        }
    }
    sides
}

/// Whether two planes are one up to rounding, which the slack of the box tests covers.
fn same_plane(a: &Plane, b: &Plane) -> bool {
    (a.normal - b.normal).length() < ANGULAR_TOLERANCE && (a.offset_m - b.offset_m).abs() < ANGULAR_TOLERANCE
}

/// Whether what a view sees past its own near plane is past this one: it starts further away and opens forward.
fn near_holds(view: &Frustum, plane: &Plane) -> bool {
    let near = view.plane(FrustumSide::Near);
    view.rays.iter().all(|ray| {
        // Where the ray meets the view's own near plane.
        let forward = near.normal.dot(*ray);
        let start = view.eye + *ray * (-near.distance_m(view.eye) / forward);
        forward > 0.0 && plane.distance_m(start) >= -ANGULAR_TOLERANCE && plane.normal.dot(*ray) >= 0.0
    })
}
