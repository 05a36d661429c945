//! The object hierarchy as the sweep walks it: eight children a node, their boxes side by side in 128 bytes.
//!
//! Boxes are axis-aligned and quantized to 1/255 of their node, rounded outwards. A wide node takes in several levels of
//! the hierarchy, and a hierarchy's node with more than eight children becomes several wide ones; leaf numbers are
//! the same, and so is their order.

use glam::DVec3;
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{NodeId, ObjectHierarchy};
use mullion_common::visible_set::LeafRange;

/// Children of a node.
pub const LANES: usize = 8;

/// Up to eight boxes and what they hold.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct WideNode {
    /// Least x of all lanes, then y, then z, in steps from `origin`; above `max` in an empty lane.
    pub min: [[u8; LANES]; 3],
    /// Greatest coordinates, in the same steps.
    pub max: [[u8; LANES]; 3],
    /// From the tree's origin, metres.
    pub origin: [f32; 3],
    /// A step along each axis is two to this power, metres.
    pub exponent: [i8; 3],
    /// A bit for each lane that is a leaf.
    pub leaf_lanes: u8,
    /// First leaf of each lane, `u32::MAX` in an unused one. A lane ends where the next one starts or the node ends.
    pub first_leaf: [u32; LANES],
    /// Below each lane: a wide node, or with [`WideNode::LEAF`] set the hierarchy's node of a leaf, with
    /// [`WideNode::ORIENTED`] set where its oriented box is much smaller than the lane's.
    pub child: [u32; LANES],
}
const _: () = assert!(size_of::<WideNode>() == 128);

impl WideNode {
    /// Marks a child that is a leaf.
    pub const LEAF: u32 = 1 << 31;
    /// Marks a leaf whose oriented box is worth a test of its own.
    pub const ORIENTED: u32 = 1 << 30;
    /// What remains without the marks.
    pub const NODE: u32 = Self::ORIENTED - 1;
    /// Steps along an axis.
    const STEPS: f64 = 255.0;
    /// Least exponent: a step of a tenth of a nanometre, for nodes without extent.
    const MIN_EXPONENT: i32 = -33;

    /// A node around boxes, relative to the tree's origin.
    fn around(boxes: &[Aabb]) -> Self {
        let all = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(b));
        let mut node = Self {
            min: [[1; LANES]; 3],
            max: [[0; LANES]; 3],
            origin: [0.0; 3],
            exponent: [0; 3],
            leaf_lanes: 0,
            first_leaf: [u32::MAX; LANES],
            child: [0; LANES],
        };
        for axis in 0..3 {
            let origin = floor_f32(all.min[axis]);
            let extent = all.max[axis] - f64::from(origin);
            let exponent = exponent_for(extent / Self::STEPS);
            let step = f64::from(exponent).exp2();
            node.origin[axis] = origin;
            node.exponent[axis] = exponent as i8;
            for (lane, b) in boxes.iter().enumerate() {
                // Exact: a step is a power of two.
                node.min[axis][lane] = ((b.min[axis] - f64::from(origin)) / step).floor() as u8;
                node.max[axis][lane] = ((b.max[axis] - f64::from(origin)) / step).ceil() as u8;
            }
        }
        node
    }

    /// The leaves of a lane; `end` is one past the node's last leaf.
    #[inline(always)]
    pub fn leaves(&self, lane: usize, end: u32) -> LeafRange {
        let next = if lane + 1 < LANES { self.first_leaf[lane + 1].min(end) } else { end };
        LeafRange::new(self.first_leaf[lane], next)
    }

    /// The box of a lane relative to the tree's origin, metres; empty for an unused one.
    pub fn lane_bound(&self, lane: usize) -> Aabb {
        let at = |steps: &[[u8; LANES]; 3]| {
            let axis = |axis: usize| f64::from(self.origin[axis]) + f64::from(steps[axis][lane]) * f64::from(self.step_m()[axis]);
            DVec3::new(axis(0), axis(1), axis(2))
        };
        Aabb { min: at(&self.min), max: at(&self.max) }
    }

    /// The box around all lanes relative to the tree's origin, metres.
    pub fn bound(&self) -> Aabb {
        (0..LANES).map(|lane| self.lane_bound(lane)).filter(|b| !b.is_empty()).fold(Aabb::EMPTY, |all, b| all.union(&b))
    }

    /// Length of a step along each axis, metres.
    pub fn step_m(&self) -> [f32; 3] {
        self.exponent.map(power_of_two)
    }
}

/// Two to the power of `exponent`, in the range of normal numbers.
#[inline(always)]
fn power_of_two(exponent: i8) -> f32 {
    f32::from_bits(((i32::from(exponent) + 127) as u32) << 23)
}

/// The least power of two, as an exponent, that is not below `step_m`.
fn exponent_for(step_m: f64) -> i32 {
    let exponent = (step_m.max(f64::MIN_POSITIVE).log2().ceil() as i32).clamp(WideNode::MIN_EXPONENT, 127);
    // The logarithm rounds.
    if f64::from(exponent).exp2() < step_m { exponent + 1 } else { exponent }
}

/// The greatest `f32` that is not above `value`.
fn floor_f32(value: f64) -> f32 {
    let near = value as f32;
    if f64::from(near) > value { near.next_down() } else { near }
}

/// A hierarchy as wide nodes, a parent before its children, node 0 the root.
#[derive(Clone, Debug, Default)]
pub struct WideTree {
    nodes: Vec<WideNode>,
    origin: DVec3,
    leaf_count: u32,
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
        let boxes = boxes_of(hierarchy);
        let origin = boxes[root.0 as usize].center();
        let mut tree = Self { nodes: Vec::new(), origin, leaf_count: hierarchy.leaf_count() };
        let whole = Run { first: root.0, end: hierarchy.nodes().len() as u32 };
        // What is to become a node, and where its number goes: parent and lane.
        let mut open: Vec<(Run, Option<(u32, usize)>)> = vec![(whole, None)];
        let mut members: Vec<Run> = Vec::new();
        while let Some((run, place)) = open.pop() {
            let id = tree.nodes.len() as u32;
            if let Some((parent, lane)) = place {
                tree.nodes[parent as usize].child[lane] = id;
            }
            gather(hierarchy, &boxes, run, &mut members);
            let around: Vec<Aabb> = members
                .iter()
                .map(|m| {
                    let b = bound_of(hierarchy, &boxes, *m);
                    Aabb { min: b.min - origin, max: b.max - origin }
                })
                .collect();
            let mut node = WideNode::around(&around);
            let first_open = open.len();
            for (lane, member) in members.iter().enumerate() {
                node.first_leaf[lane] = hierarchy.node(NodeId(member.first)).leaves.start;
                if member.end == member.first + 1 {
                    let is_oriented = is_worth_its_own_test(&hierarchy.node(NodeId(member.first)).bound);
                    node.leaf_lanes |= 1 << lane;
                    node.child[lane] = WideNode::LEAF | member.first | if is_oriented { WideNode::ORIENTED } else { 0 };
                } else {
                    open.push((*member, Some((id, lane))));
                }
            }
            open[first_open..].reverse();
            tree.nodes.push(node);
        }
        tree
    }

    /// All nodes; a parent comes before its children.
    pub fn nodes(&self) -> &[WideNode] {
        &self.nodes
    }

    /// What a walk costs, for comparing trees over the same leaves: how often nodes are visited, as the sum of half their
    /// boxes' surfaces, m².
    pub fn cost_m2(&self) -> f64 {
        self.nodes.iter().map(|node| node.bound().half_area()).sum()
    }

    /// What the nodes' origins are relative to, metres.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Number of leaves.
    pub fn leaf_count(&self) -> u32 {
        self.leaf_count
    }
}

/// Whether an oriented box has so much less surface than the axis-aligned box around it that another test pays.
fn is_worth_its_own_test(bound: &Obb) -> bool {
    const WORTH: f64 = 0.9;
    bound.size_measure() < WORTH * bound.aabb().half_area() / 4.0
}

/// The axis-aligned box of every node of the hierarchy, from its leaves' boxes up.
fn boxes_of(hierarchy: &ObjectHierarchy) -> Vec<Aabb> {
    let nodes = hierarchy.nodes();
    let mut boxes = vec![Aabb::EMPTY; nodes.len()];
    for at in (0..nodes.len() as u32).rev() {
        let id = NodeId(at);
        boxes[at as usize] = if hierarchy.is_leaf(id) {
            nodes[at as usize].bound.aabb()
        } else {
            hierarchy.children(id).fold(Aabb::EMPTY, |all, child| all.union(&boxes[child.0 as usize]))
        };
    }
    boxes
}

/// The runs that become the children of `run`'s node: up to eight, in order.
fn gather(hierarchy: &ObjectHierarchy, boxes: &[Aabb], run: Run, members: &mut Vec<Run>) {
    members.clear();
    members.push(run);
    loop {
        // Opens the largest member that has room: near the root, where every visit ends, levels are worth most.
        let fits = |run: &Run| {
            let is_leaf = run.end == run.first + 1;
            !is_leaf && members.len() - 1 + parts_of(hierarchy, *run, LANES) <= LANES
        };
        let area = |run: &Run| bound_of(hierarchy, boxes, *run).half_area();
        let largest =
            (0..members.len()).filter(|i| fits(&members[*i])).max_by(|a, b| area(&members[*a]).total_cmp(&area(&members[*b])));
        let Some(at) = largest else {
            return;
        };
        let opened = parts(hierarchy, members[at]);
        members.splice(at..=at, opened);
    }
}

/// Into how many parts a run opens, counted up to `limit`.
fn parts_of(hierarchy: &ObjectHierarchy, run: Run, limit: usize) -> usize {
    let single = hierarchy.node(NodeId(run.first)).subtree_end == run.end;
    let mut at = if single { run.first + 1 } else { run.first };
    let mut count = 0;
    while at < run.end && count < limit {
        at = hierarchy.node(NodeId(at)).subtree_end;
        count += 1;
    }
    count
}

/// The parts of a run: the node's children, or the siblings; in runs of equal length where they are more than eight.
fn parts(hierarchy: &ObjectHierarchy, run: Run) -> Vec<Run> {
    let single = hierarchy.node(NodeId(run.first)).subtree_end == run.end;
    let mut at = if single { run.first + 1 } else { run.first };
    let mut siblings: Vec<Run> = Vec::new();
    while at < run.end {
        let end = hierarchy.node(NodeId(at)).subtree_end;
        siblings.push(Run { first: at, end });
        at = end;
    }
    let each = siblings.len().div_ceil(LANES);
    siblings.chunks(each).map(|run| Run { first: run[0].first, end: run[run.len() - 1].end }).collect()
}

fn bound_of(hierarchy: &ObjectHierarchy, boxes: &[Aabb], run: Run) -> Aabb {
    let mut at = run.first;
    let mut all = Aabb::EMPTY;
    while at < run.end {
        all = all.union(&boxes[at as usize]);
        at = hierarchy.node(NodeId(at)).subtree_end;
    }
    all
}
