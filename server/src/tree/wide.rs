//! The object hierarchy as the sweep walks it: eight children a node, their boxes side by side in 128 bytes.
//!
//! Boxes are axis-aligned and quantized to steps of their node, 128 to 255 of them across, rounded outwards. A wide node takes in several levels of
//! the hierarchy, and a hierarchy's node with more than eight children becomes several wide ones; leaf numbers are
//! the same, and so is their order. Nodes stand depth first: siblings side by side cost a sweep of a million leaves a fifth more.

use glam::DVec3;
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{NodeId, ObjectHierarchy};

use super::paths::ALL_LANES;
use super::wide_node::{LANES, LeafAxes, Room, WideNode};

/// A hierarchy as wide nodes.
#[derive(Clone, Debug, Default)]
pub struct WideTree {
    nodes: Vec<WideNode>,
    /// Of each node, its leaves' oriented boxes.
    axes: Vec<LeafAxes>,
    /// A bit for each leaf whose oriented box is worth a test of its own.
    oriented: Vec<u64>,
    /// Node 0, and the nodes that came above it when trees were appended, each the first child of the next. All other
    /// nodes come after their parents.
    roots: Vec<u32>,
    origin: DVec3,
    leaf_count: u32,
    /// Half the surfaces of all nodes' boxes, m².
    cost_m2: f64,
}

/// Siblings of the hierarchy that stand side by side: `first..end` in its list of nodes, with all below them.
#[derive(Clone, Copy)]
struct Run {
    first: u32,
    end: u32,
}

impl WideTree {
    /// The wide form of a hierarchy.
    pub fn new(hierarchy: &ObjectHierarchy) -> Self {
        let Some(root) = hierarchy.root() else {
            return Self::default();
        };
        let origin = hierarchy.node(root).bound.center;
        let mut tree = Self {
            nodes: Vec::new(),
            axes: Vec::new(),
            oriented: Vec::new(),
            roots: vec![0],
            origin,
            leaf_count: hierarchy.leaf_count(),
            cost_m2: 0.0,
        };
        tree.build(hierarchy, Run { first: root.0, end: hierarchy.nodes().len() as u32 });
        tree
    }

    /// Adds the nodes over a run of the hierarchy, whose boxes are up to date.
    fn build(&mut self, hierarchy: &ObjectHierarchy, run: Run) {
        let first = self.nodes.len();
        let areas = areas_of(hierarchy, run);
        // What is to become a node, and where its number goes: parent and lane.
        let mut open: Vec<(Run, Option<(u32, usize)>)> = vec![(run, None)];
        let mut members: Vec<(Run, f64)> = Vec::new();
        while let Some((run, place)) = open.pop() {
            let id = self.nodes.len() as u32;
            if let Some((parent, lane)) = place {
                self.nodes[parent as usize].child[lane] = id;
            }
            gather(hierarchy, &areas, run, &mut members);
            let mut node = WideNode::default();
            let first_open = open.len();
            for (lane, (member, _)) in members.iter().enumerate() {
                node.first_leaf[lane] = hierarchy.node(NodeId(member.first)).leaves.start;
                if member.end == member.first + 1 {
                    node.leaf_lanes |= 1 << lane;
                    node.child[lane] = WideNode::LEAF | member.first;
                } else {
                    open.push((*member, Some((id, lane))));
                }
            }
            open[first_open..].reverse();
            self.nodes.push(node);
        }
        self.axes.resize(self.nodes.len(), LeafAxes::default());
        let run = run.first..run.end;
        for id in run.filter(|id| hierarchy.is_leaf(NodeId(*id))) {
            let node = hierarchy.node(NodeId(id));
            self.mark_oriented(node.leaves.start, &node.bound);
        }
        for id in (first..self.nodes.len()).rev() {
            self.refit_all(id as u32, Room::None, hierarchy);
            self.cost_m2 += half_area(&self.nodes[id].bound());
        }
    }

    /// Takes a tree that was appended below the hierarchy's root, its root being `added`. Returns how many nodes there were
    /// before; the boxes at the root have to be refitted.
    pub(super) fn append(&mut self, hierarchy: &ObjectHierarchy, added: NodeId) -> u32 {
        let first = self.nodes.len() as u32;
        let end = hierarchy.node(added).subtree_end;
        self.build(hierarchy, Run { first: added.0, end });
        let first_leaf = hierarchy.node(added).leaves.start;
        self.leaf_count = hierarchy.leaf_count();
        let root = self.root();
        let lane = self.nodes[root as usize].lane_count();
        if lane < LANES {
            let node = &mut self.nodes[root as usize];
            (node.first_leaf[lane], node.child[lane]) = (first_leaf, first);
            return first;
        }
        let mut above = WideNode::default();
        (above.first_leaf[0], above.child[0]) = (0, root);
        (above.first_leaf[1], above.child[1]) = (first_leaf, first);
        self.roots.push(self.nodes.len() as u32);
        self.nodes.push(above);
        self.axes.push(LeafAxes::default());
        first
    }

    /// Takes down whether a leaf's oriented box has so much less surface than the axis-aligned box around it that another test
    /// pays. Takes effect when the leaf's node is refitted.
    pub(super) fn mark_oriented(&mut self, leaf: u32, bound: &Obb) {
        const WORTH: f64 = 0.9;
        // Edges at right angles are taken for granted: it is a guess, and made for every leaf that moves.
        let [x, y, z] = bound.half_axes.map(DVec3::length);
        let is_worth_it = (x * y + y * z + z * x) * 4.0 < WORTH * bound.aabb().half_area();
        let (word, bit) = (leaf as usize / 64, leaf % 64);
        if word >= self.oriented.len() {
            self.oriented.resize(word + 1, 0);
        }
        self.oriented[word] = (self.oriented[word] & !(1 << bit)) | (u64::from(is_worth_it) << bit);
    }

    /// Gives these lanes of a node the boxes of their leaves as they are now and of their children as they were last refitted. Whether
    /// the box around all lanes is another one than before.
    pub(super) fn refit(&mut self, id: u32, lanes: u8, hierarchy: &ObjectHierarchy) -> bool {
        let before = self.nodes[id as usize].bound();
        // Other lanes stay as they are while the node's steps still measure all of them well.
        if !self.refit_in_steps(id, lanes, hierarchy) {
            self.refit_all(id, Room::Around, hierarchy);
        }
        let after = self.nodes[id as usize].bound();
        self.cost_m2 += half_area(&after) - half_area(&before);
        after != before
    }

    /// Whether the lanes could be given their boxes in the steps that the node has.
    fn refit_in_steps(&mut self, id: u32, lanes: u8, hierarchy: &ObjectHierarchy) -> bool {
        let mut left = lanes & self.nodes[id as usize].used_lanes();
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let b = self.lane_box(id, lane, hierarchy);
            if !self.nodes[id as usize].set_box(lane, &b) {
                return false;
            }
            self.refit_axes(id, lane, hierarchy);
        }
        self.nodes[id as usize].is_measured_well()
    }

    /// Gives a node new steps and the boxes of all lanes.
    fn refit_all(&mut self, id: u32, room: Room, hierarchy: &ObjectHierarchy) {
        let mut boxes = [Aabb::EMPTY; LANES];
        let count = self.nodes[id as usize].lane_count();
        for (lane, b) in boxes.iter_mut().enumerate().take(count) {
            *b = self.lane_box(id, lane, hierarchy);
        }
        self.nodes[id as usize].set_boxes(&boxes, room);
        for lane in 0..count {
            self.refit_axes(id, lane, hierarchy);
        }
    }

    /// The box of a lane, relative to the tree's origin.
    fn lane_box(&self, id: u32, lane: usize, hierarchy: &ObjectHierarchy) -> Aabb {
        let node = &self.nodes[id as usize];
        if node.leaf_lanes & (1 << lane) == 0 {
            return self.nodes[node.child[lane] as usize].bound();
        }
        let around = hierarchy.node(NodeId(node.child[lane] & WideNode::NODE)).bound.aabb();
        Aabb { min: around.min - self.origin, max: around.max - self.origin }
    }

    /// Takes a leaf's oriented box, if that is worth a test; the lane has its box.
    fn refit_axes(&mut self, id: u32, lane: usize, hierarchy: &ObjectHierarchy) {
        let node = &mut self.nodes[id as usize];
        if node.leaf_lanes & (1 << lane) == 0 {
            return;
        }
        let (leaf, at) = (node.first_leaf[lane] as usize, node.child[lane] & WideNode::NODE);
        let is_oriented = (self.oriented[leaf / 64] >> (leaf % 64)) & 1 != 0;
        node.child[lane] = WideNode::LEAF | at | if is_oriented { WideNode::ORIENTED } else { 0 };
        if is_oriented {
            self.axes[id as usize].set(lane, &hierarchy.node(NodeId(at)).bound.half_axes, node);
        }
    }

    /// Refits the nodes that do not come after their parents, when all others are up to date.
    pub(super) fn refit_roots(&mut self, hierarchy: &ObjectHierarchy) {
        for at in 1..self.roots.len() {
            self.refit(self.roots[at], ALL_LANES, hierarchy);
        }
    }

    /// All nodes.
    pub fn nodes(&self) -> &[WideNode] {
        &self.nodes
    }

    /// Of each node, the oriented boxes of the lanes that are marked with [`WideNode::ORIENTED`].
    pub fn axes(&self) -> &[LeafAxes] {
        &self.axes
    }

    /// Where a walk starts.
    pub fn root(&self) -> u32 {
        self.roots.last().copied().unwrap_or(0)
    }

    /// What a walk costs, for comparing trees over the same leaves: how often nodes are visited, as the sum of half their
    /// boxes' surfaces, m².
    pub fn cost_m2(&self) -> f64 {
        self.cost_m2
    }

    /// The same as a share of the root's.
    pub(super) fn visits(&self) -> f64 {
        let root_m2 = self.nodes.get(self.root() as usize).map_or(0.0, |root| half_area(&root.bound()));
        if root_m2 > 0.0 { self.cost_m2 / root_m2 } else { 1.0 }
    }

    /// What the nodes' origins are relative to, metres.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Memory taken, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.axes[..]) + size_of_val(&self.oriented[..])
    }

    /// Number of leaves.
    pub fn leaf_count(&self) -> u32 {
        self.leaf_count
    }
}

/// Half the surface of a box, m²; zero for an empty one.
fn half_area(b: &Aabb) -> f64 {
    if b.is_empty() { 0.0 } else { b.half_area() }
}

/// Half the surface of the axis-aligned box of every node of a run, from its leaves' boxes up.
fn areas_of(hierarchy: &ObjectHierarchy, run: Run) -> Areas {
    let mut areas = vec![0.0; (run.end - run.first) as usize];
    let mut done: Vec<(u32, Aabb)> = Vec::new(); // a node's children, the next one in order on top
    for at in (run.first..run.end).rev() {
        let node = hierarchy.node(NodeId(at));
        let mut around = if node.subtree_end == at + 1 { node.bound.aabb() } else { Aabb::EMPTY };
        while let Some((child, b)) = done.last()
            && *child < node.subtree_end
        {
            around = around.union(b);
            done.pop();
        }
        areas[(at - run.first) as usize] = around.half_area() as f32;
        done.push((at, around));
    }
    Areas { first: run.first, areas }
}

struct Areas {
    first: u32,
    areas: Vec<f32>,
}

impl Areas {
    /// Half the surface of a run's boxes, those of its nodes added up.
    fn of(&self, hierarchy: &ObjectHierarchy, run: Run) -> f64 {
        siblings(hierarchy, run).map(|node| f64::from(self.areas[(node.first - self.first) as usize])).sum()
    }
}

/// The runs that become the children of `run`'s node: up to eight, in order.
fn gather(hierarchy: &ObjectHierarchy, areas: &Areas, run: Run, members: &mut Vec<(Run, f64)>) {
    members.clear();
    members.push((run, areas.of(hierarchy, run)));
    loop {
        // Opens the largest member that has room: near the root, where every visit ends, levels are worth most.
        let room = LANES + 1 - members.len();
        let fits = |(run, _): &(Run, f64)| run.end > run.first + 1 && parts_of(hierarchy, *run, room + 1) <= room;
        let largest = (0..members.len()).filter(|i| fits(&members[*i])).max_by(|a, b| members[*a].1.total_cmp(&members[*b].1));
        let Some(at) = largest else {
            return;
        };
        let opened = parts(hierarchy, members[at].0);
        members.splice(at..=at, opened.into_iter().map(|run| (run, areas.of(hierarchy, run))));
    }
}

/// The nodes of a run, each with all below it.
fn siblings(hierarchy: &ObjectHierarchy, run: Run) -> impl Iterator<Item = Run> {
    let mut at = run.first;
    std::iter::from_fn(move || {
        (at < run.end).then(|| {
            let end = hierarchy.node(NodeId(at)).subtree_end;
            Run { first: std::mem::replace(&mut at, end), end }
        })
    })
}

/// What a run opens to: its nodes, or where it is one node, that node's children.
fn opened(hierarchy: &ObjectHierarchy, run: Run) -> impl Iterator<Item = Run> {
    let is_one = hierarchy.node(NodeId(run.first)).subtree_end == run.end;
    siblings(hierarchy, Run { first: run.first + u32::from(is_one), end: run.end })
}

/// Into how many parts a run opens, counted up to `limit` and no further than [`LANES`].
fn parts_of(hierarchy: &ObjectHierarchy, run: Run, limit: usize) -> usize {
    opened(hierarchy, run).take(limit.min(LANES)).count()
}

/// The parts of a run; joined to runs of equal length where they are more than eight.
fn parts(hierarchy: &ObjectHierarchy, run: Run) -> Vec<Run> {
    let siblings: Vec<Run> = opened(hierarchy, run).collect();
    let each = siblings.len().div_ceil(LANES);
    siblings.chunks(each).map(|run| Run { first: run[0].first, end: run[run.len() - 1].end }).collect()
}
