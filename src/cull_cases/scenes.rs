//! Random scenes: boxes of every kind in trees of every shape.

use glam::{DAffine3, DMat3, DVec3};
use mullion_common::geometry::{Aabb, Frustum, FrustumSide, Obb};
use mullion_common::scene::{ObjectHierarchy, OhNode};
use mullion_common::visible_set::LeafRange;

use super::random::Random;

/// Deepest chain.
const MAX_CHAIN: u32 = 1000;

/// How a tree groups its leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// By place, so many to a node.
    Compact { branching: u32 },
    /// By place, but every group has members all over the scene.
    Spanning { branching: u32 },
    /// One node with all leaves below it.
    Flat,
    /// Each node holds a leaf and the next node.
    Chain,
}

/// How the groups' boxes are made.
#[derive(Clone, Copy, Debug)]
enum Fit {
    Aligned,
    Oriented,
}

/// Boxes and the tree above them.
pub struct Scene {
    shape: Shape,
    fit: Fit,
    /// Metres to a unit of the scene, in which boxes lie within about [`REACH`] of its middle.
    unit_m: f64,
    middle: DVec3,
    leaves: Vec<Obb>,
    /// Of each node of the tree, depth first, where its subtree ends.
    ends: Vec<u32>,
}

/// A scene's extent in its own units, from its middle.
pub const REACH: f64 = 30.0;

impl Scene {
    /// A scene of at most so many leaves.
    pub fn random(random: &mut Random, max_leaves: u32) -> Self {
        let branching = random.count(2, 40);
        let shape = random.pick(&[Shape::Compact { branching }, Shape::Spanning { branching }, Shape::Flat, Shape::Chain]);
        let (least, most) = match shape {
            Shape::Chain => (1, max_leaves.min(MAX_CHAIN)),
            Shape::Flat => (max_leaves.div_ceil(4), max_leaves),
            _ => (1, max_leaves),
        };
        let count = random.count(least, most);
        Self::of_shape(random, shape, count)
    }

    /// A scene of a shape, with so many leaves.
    pub fn of_shape(random: &mut Random, shape: Shape, count: u32) -> Self {
        let (unit_m, away_m) =
            random.pick(&[(1.0, 0.0), (1.0, 10.0), (1.0, 1e6), (1e-3, 0.0), (1e-3, 1.0), (1e-3, 1e6), (3e4, 0.0)]);
        let clusters: Vec<DVec3> = (0..random.count(1, 12)).map(|_| random.point(REACH)).collect();
        let spread = random.magnitude(0.1, REACH);
        let middle = DVec3::new(1.0, -0.6, 0.3) * away_m;
        let to_world = DAffine3::from_scale_rotation_translation(DVec3::splat(unit_m), random.turn(), middle);
        let mut leaves: Vec<Obb> = (0..count)
            .map(|_| {
                let at = random.pick(&clusters) + random.point(spread);
                random_box(random, at).transformed(&to_world)
            })
            .collect();
        let mut ends = Vec::new();
        match shape {
            Shape::Compact { branching } | Shape::Spanning { branching } => divide(&mut leaves, shape, branching, &mut ends),
            Shape::Flat => {
                ends.push(count + 1);
                ends.extend(2..count + 2);
            }
            // All subtrees end with the last leaf; only leaves end at once.
            Shape::Chain => {
                let all = count * 2 - 1;
                ends.extend((0..all).map(|at| if at % 2 == 0 && at + 1 < all { all } else { at + 1 }));
            }
        }
        let fit = random.pick(&[Fit::Aligned, Fit::Oriented]);
        Self { shape, fit, unit_m, middle, leaves, ends }
    }

    /// What it is, for people.
    pub fn describe(&self) -> String {
        let (count, fit, unit_m) = (self.leaves.len(), self.fit, self.unit_m);
        format!("{count} leaves, {:?}, {fit:?} groups, {unit_m} m to a unit, at {}", self.shape, self.middle)
    }

    /// Metres to a unit.
    pub fn unit_m(&self) -> f64 {
        self.unit_m
    }

    /// The leaves' boxes.
    pub fn leaves(&self) -> &[Obb] {
        &self.leaves
    }

    /// A point in the scene or not far from it.
    pub fn point_near(&self, random: &mut Random) -> DVec3 {
        self.middle + random.point(REACH * 1.5) * self.unit_m
    }

    /// A new box somewhere in the scene.
    pub fn another_box(&self, random: &mut Random) -> Obb {
        let scale = DAffine3::from_scale_rotation_translation(DVec3::splat(self.unit_m), random.turn(), DVec3::ZERO);
        let place = self.point_near(random);
        let mut bound = random_box(random, DVec3::ZERO).transformed(&scale);
        bound.center = place;
        bound
    }

    /// A leaf's box after a step, at most so far.
    pub fn moved(random: &mut Random, leaf: &Obb, step_m: f64) -> Obb {
        let mut moved = if random.chance(2) {
            *leaf
        } else {
            let turn = DAffine3::from_quat(random.turn());
            Obb { half_axes: leaf.half_axes.map(|half| turn.transform_vector3(half)), ..*leaf }
        };
        moved.center += random.point(step_m);
        moved
    }

    /// A leaf's box where it touches a side of a view from outside, so that a hair of it is seen: what rounding drops first.
    pub fn touching(random: &mut Random, leaf: &Obb, frusta: &[Frustum]) -> Obb {
        const HAIR: [f64; 3] = [1e-14, 1e-9, 1e-7];
        let frustum = random.pick(frusta);
        let [bottom_left, bottom_right, top_right, top_left] = frustum.rays;
        let (side, along) = random.pick(&[
            (FrustumSide::Left, [bottom_left, top_left]),
            (FrustumSide::Right, [bottom_right, top_right]),
            (FrustumSide::Bottom, [bottom_left, bottom_right]),
            (FrustumSide::Top, [top_left, top_right]),
        ]);
        let share = random.pick(&[0.0, 0.5, 1.0]);
        let way = (along[0] * share + along[1] * (1.0 - share)) * random.magnitude(1.0, 1e3);
        let normal = frustum.plane(side).normal;
        let to_corner: DVec3 = leaf.half_axes.iter().map(|half| *half * half.dot(normal).signum()).sum();
        let center = frustum.eye + way - to_corner + normal * way.length() * random.pick(&HAIR);
        Obb { center, ..*leaf }
    }

    /// The tree, with each group's box around its children's.
    pub fn hierarchy(&self) -> ObjectHierarchy {
        let is_leaf = |at: u32| self.ends[at as usize] == at + 1;
        let mut nodes: Vec<OhNode> = Vec::with_capacity(self.ends.len());
        let mut next_leaf = 0;
        for (at, end) in (0..).zip(&self.ends) {
            let bound = self.leaves[(next_leaf as usize).min(self.leaves.len() - 1)];
            nodes.push(OhNode { bound, subtree_end: *end, leaves: LeafRange::new(next_leaf, next_leaf + 1) });
            next_leaf += u32::from(is_leaf(at));
        }
        let mut corners = Vec::new();
        for at in (0..nodes.len() as u32).rev().filter(|at| !is_leaf(*at)) {
            corners.clear();
            let mut child = at + 1;
            let mut end = child;
            while child < self.ends[at as usize] {
                let child_node = &nodes[child as usize];
                corners.extend(child_node.bound.corners());
                end = child_node.leaves.end;
                child = child_node.subtree_end;
            }
            let node = &mut nodes[at as usize];
            node.leaves.end = end;
            node.bound = match self.fit {
                Fit::Aligned => Aabb::of_points(corners.iter().copied()).into(),
                Fit::Oriented => Obb::around(corners.iter().copied()).unwrap_or(node.bound),
            };
        }
        ObjectHierarchy::new(nodes).expect("depth first, and leaves numbered as they come")
    }
}

/// A box of any size and kind: upright, turned or sheared, and now and then flat, a stick or a point.
fn random_box(random: &mut Random, center: DVec3) -> Obb {
    let length = |random: &mut Random| if random.chance(8) { 0.0 } else { random.magnitude(0.01, 1.0) };
    let size = random.magnitude(0.05, 5.0);
    let half = DVec3::new(length(random), length(random), length(random)) * size;
    let matrix3 = match random.next() % 3 {
        0 => DMat3::IDENTITY,
        1 => DMat3::from_quat(random.turn()),
        _ => DMat3::from_cols(random.point(1.0), random.point(1.0), random.point(1.0)),
    };
    let half = if random.chance(20) { DVec3::ZERO } else { half };
    Obb::from(Aabb { min: -half, max: half }).transformed(&DAffine3 { matrix3, translation: center })
}

/// Adds the nodes of a tree over boxes: parts of equal length, so many to a node. Sorted along the longest axis first, where
/// the tree is to be compact.
fn divide(boxes: &mut [Obb], shape: Shape, branching: u32, ends: &mut Vec<u32>) {
    let at = ends.len();
    ends.push(0);
    if boxes.len() > 1 {
        if matches!(shape, Shape::Compact { .. }) {
            let size = Aabb::of_points(boxes.iter().map(|b| b.center)).size();
            boxes.sort_by(|a, b| a.center[size.max_position()].total_cmp(&b.center[size.max_position()]));
        }
        let each = boxes.len().div_ceil(branching as usize);
        boxes.chunks_mut(each).for_each(|part| divide(part, shape, branching, ends));
    }
    ends[at] = ends.len() as u32;
}
