//! The paper's adaptive traversal with pseudo-groups (section 4.2).

use mullion_common::geometry::{Aabb, Containment, Obb, Plane};
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::VisibleSet;

use glam::DVec3;

use super::CullStats;
use super::adaptive::{emit, for_each_in_primary};
use super::frustum_hierarchy::{FrustumHierarchy, FrustumNode, Guards};
use super::oh::{self, Open};

/// Fewer nodes on one side of a plane go on one by one: a group's box costs about as much as two tests.
const LEAST_GROUP: usize = 3;

/// Culls the object hierarchy to the frustum hierarchy as `adaptive` does, but for what happens to the children of a node
/// that a bisection plane cuts: those that lie on one side of it (the paper's L, and its R) go on as one *pseudo-group*,
/// with a box around theirs. A group is tested as a node is, and comes apart where a plane cuts it; its members are then
/// classified and grouped anew. Saves tests
/// wherever nodes have more than a few children (`server/tests/adaptive_grouped.rs` counts them), and time, since boxes must be
/// made, only where they have hundreds.
///
/// As conservative as `adaptive`: a group's box encloses its members', and is axis-aligned.
pub(super) fn cull(
    hierarchy: &ObjectHierarchy,
    frusta: &FrustumHierarchy,
    open: &mut Vec<Open>,
    memory: &mut Memory,
    sets: &mut [VisibleSet],
) -> CullStats {
    let mut stats = CullStats::default();
    for_each_in_primary(hierarchy, frusta, open, &mut stats, |node, primary_cut, stats| {
        Traversal { hierarchy, frusta, primary_cut, memory, sets, stats }.run(node);
    });
    sets.iter_mut().for_each(VisibleSet::normalize);
    stats
}

/// What a traversal needs, kept from frame to frame.
#[derive(Default)]
pub(super) struct Memory {
    stack: Vec<Meeting>,
    /// The groups on the stack and the one in hand, in the order of the stack.
    groups: Vec<Group>,
    /// Their members, group after group.
    members: Vec<u32>,
    /// Nodes of which one side is known: the negative one, the positive one.
    sides: [Vec<u32>; 2],
    descent: Vec<Open>,
}

/// What meets a node of the frustum hierarchy.
#[derive(Clone, Copy)]
enum Party {
    /// A node of the object hierarchy.
    Node(u32),
    /// One with children that the bisection plane is known to cut.
    CutNode(u32),
    /// A pseudo-group, by its place in the list of them.
    Group(u32),
}

/// Nodes that go on as one.
struct Group {
    /// `start..end` in the list of members.
    start: u32,
    end: u32,
    /// Around the members' boxes.
    bound: Obb,
}

/// A node or a group, a node of the frustum hierarchy that it meets, and what is known of the two.
#[derive(Clone, Copy)]
struct Meeting {
    party: Party,
    fh: u32,
    /// Bit k: the party is wholly on this side of the bisection plane k steps up in the frustum hierarchy, the parent's being 0.
    parted: u32,
    /// How many groups there were when this was put off: those made since are done with when its turn comes.
    groups: u32,
}

struct Traversal<'a> {
    hierarchy: &'a ObjectHierarchy,
    frusta: &'a FrustumHierarchy,
    /// The planes of the primary frustum that cut the node where the traversal starts.
    primary_cut: u8,
    memory: &'a mut Memory,
    sets: &'a mut [VisibleSet],
    stats: &'a mut CullStats,
}

impl Traversal<'_> {
    fn run(&mut self, node: u32) {
        self.memory.stack.clear();
        self.memory.stack.push(Meeting { party: Party::Node(node), fh: 0, parted: 0, groups: 0 });
        while let Some(meeting) = self.memory.stack.pop() {
            self.memory.groups.truncate(meeting.groups as usize);
            self.memory.members.truncate(self.memory.groups.last().map_or(0, |group| group.end as usize));
            match *self.frusta.node(meeting.fh) {
                FrustumNode::Cells { start, end } => self.check(&meeting, start, end),
                FrustumNode::Split { cell, side, negative, positive } => {
                    let frustum = &self.frusta.cells()[usize::from(cell)];
                    self.part(meeting, frustum.plane(side), frustum.eye, [negative, positive]);
                }
            }
        }
    }

    /// The terminal check: emits what the cells may see, tested against the planes that nothing on the way has settled.
    fn check(&mut self, meeting: &Meeting, start: u32, end: u32) {
        let Self { hierarchy, frusta, primary_cut, memory, sets, stats } = self;
        let Memory { groups, members, descent, .. } = memory;
        for (cell, guards) in frusta.cells_of(start, end) {
            let mask = guards.untested(Guards::settled(*primary_cut, meeting.parted));
            let frustum = &frusta.cells()[usize::from(cell)];
            let views = frusta.views_through(cell);
            let mut descend = |node, mask, stats: &mut CullStats| {
                oh::descend(hierarchy, node, frustum, mask, descent, stats, &mut |leaves| emit(sets, views, leaves));
            };
            match meeting.party {
                Party::Node(node) | Party::CutNode(node) => descend(node, mask, stats),
                Party::Group(group) => {
                    let Group { start, end, bound } = &groups[group as usize];
                    stats.nodes_visited += 1;
                    let cut = oh::cut_planes(|k| (&frustum.planes[k], frustum.eye), mask, bound, stats);
                    // A member that no plane cuts any more is emitted without a test.
                    for member in cut.iter().flat_map(|_| &members[*start as usize..*end as usize]) {
                        descend(*member, cut.unwrap_or_default(), stats);
                    }
                }
            }
        }
    }

    /// Sends a party on to one side of a bisection plane, or takes it apart.
    fn part(&mut self, meeting: Meeting, plane: &Plane, eye: DVec3, halves: [u32; 2]) {
        let nodes = self.hierarchy.nodes();
        let containment = match meeting.party {
            Party::CutNode(_) => Containment::Cut,
            Party::Node(node) => classify(&nodes[node as usize].bound, plane, eye, self.stats),
            Party::Group(group) => classify(&self.memory.groups[group as usize].bound, plane, eye, self.stats),
        };
        match (containment, meeting.party) {
            (Containment::Outside, party) => self.meet(party, &meeting, halves[0], true),
            (Containment::Inside, party) => self.meet(party, &meeting, halves[1], true),
            (Containment::Cut, Party::Group(group)) => {
                let Group { start, end, .. } = self.memory.groups[group as usize];
                for member in start..end {
                    let node = self.memory.members[member as usize];
                    self.sort(node, &meeting, plane, eye, halves);
                }
                self.regroup(&meeting, halves);
            }
            (Containment::Cut, Party::Node(node) | Party::CutNode(node)) => {
                let end = nodes[node as usize].subtree_end;
                if end == node + 1 {
                    halves.into_iter().for_each(|half| self.meet(meeting.party, &meeting, half, false));
                    return;
                }
                let mut child = node + 1;
                while child < end {
                    self.sort(child, &meeting, plane, eye, halves);
                    child = nodes[child as usize].subtree_end;
                }
                self.regroup(&meeting, halves);
            }
        }
    }

    /// Classifies a node as the paper's L, C or R. L and R are kept for [`Traversal::regroup`]; a leaf of C goes to both
    /// halves, another node comes apart by the same plane.
    fn sort(&mut self, node: u32, meeting: &Meeting, plane: &Plane, eye: DVec3, halves: [u32; 2]) {
        let current = &self.hierarchy.nodes()[node as usize];
        match classify(&current.bound, plane, eye, self.stats) {
            Containment::Outside => self.memory.sides[0].push(node),
            Containment::Inside => self.memory.sides[1].push(node),
            Containment::Cut if current.subtree_end == node + 1 => {
                halves.into_iter().for_each(|half| self.meet(Party::Node(node), meeting, half, false));
            }
            Containment::Cut => {
                let groups = self.memory.groups.len() as u32;
                self.memory.stack.push(Meeting { party: Party::CutNode(node), groups, ..*meeting });
            }
        }
    }

    /// Sends L and R on, each as a group where it is worth one.
    fn regroup(&mut self, meeting: &Meeting, halves: [u32; 2]) {
        let nodes = self.hierarchy.nodes();
        for (side, half) in halves.into_iter().enumerate() {
            let list = std::mem::take(&mut self.memory.sides[side]);
            if list.len() < LEAST_GROUP {
                list.iter().for_each(|node| self.meet(Party::Node(*node), meeting, half, true));
            } else {
                let around = list.iter().fold(Aabb::EMPTY, |all, node| all.union(&nodes[*node as usize].bound.aabb()));
                let start = self.memory.members.len() as u32;
                self.memory.members.extend_from_slice(&list);
                let end = self.memory.members.len() as u32;
                let group = self.memory.groups.len() as u32;
                self.memory.groups.push(Group { start, end, bound: around.into() });
                self.meet(Party::Group(group), meeting, half, true);
            }
            self.memory.sides[side] = list;
            self.memory.sides[side].clear();
        }
    }

    /// Puts a party off until it meets a half of the frustum hierarchy, on one side of whose plane it `is_parted`.
    fn meet(&mut self, party: Party, above: &Meeting, fh: u32, is_parted: bool) {
        let parted = (above.parted << 1) | u32::from(is_parted);
        let groups = self.memory.groups.len() as u32;
        self.memory.stack.push(Meeting { party, fh, parted, groups });
    }
}

fn classify(bound: &Obb, plane: &Plane, eye: DVec3, stats: &mut CullStats) -> Containment {
    stats.nodes_visited += 1;
    stats.plane_tests += 1;
    plane.classify(bound, eye)
}
