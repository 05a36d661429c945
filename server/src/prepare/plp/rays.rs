//! Whether a short ray meets a triangle: a bounding volume hierarchy by the surface-area heuristic over bins (Wald: *On fast Construction of
//! SAH-based Bounding Volume Hierarchies*, 2007).

use glam::Vec3;

/// Triangles in a leaf, at most.
const IN_LEAF: usize = 4;
/// Places where a node may be split.
const BINS: usize = 12;
/// From this depth on nodes are halved by number, so that a walk's memory is bounded.
const SAH_DEPTH: usize = 32;
/// Nodes that wait on a walk: one for each level.
const STACK: usize = SAH_DEPTH + usize::BITS as usize;
/// Smaller nodes are not worth a thread's while.
const WORTH_A_THREAD: usize = 8192;

/// What a ray may meet.
#[derive(Clone, Copy)]
pub(super) struct Obstacle {
    pub corners: [Vec3; 3],
    /// Meets rays that come to its front, too: otherwise only those that leave by it, on whose way an eye would look at it.
    pub double_sided: bool,
    /// Its slot; a ray does not meet the triangle that it starts on.
    pub slot: u32,
}

/// A box, low and high.
#[derive(Clone, Copy)]
struct Bounds {
    low: Vec3,
    high: Vec3,
}

/// A node: inner ones have their first child right behind them.
#[derive(Clone, Copy)]
struct Node {
    bounds: Bounds,
    /// The second child's place; of a leaf, its first triangle's.
    next: u32,
    /// Triangles of a leaf; 0 of inner nodes.
    count: u32,
}

/// A triangle on the way into the tree.
#[derive(Clone, Copy)]
struct Item {
    bounds: Bounds,
    middle: Vec3,
    number: u32,
}

/// Triangles in a binary tree.
pub(super) struct RayTree {
    obstacles: Vec<Obstacle>,
    nodes: Vec<Node>,
}

impl RayTree {
    /// A tree over triangles with finite corners.
    pub fn over(obstacles: &[Obstacle]) -> Self {
        let item = |(number, o): (usize, &Obstacle)| {
            let bounds = Bounds::of(o.corners);
            Item { bounds, middle: (bounds.low + bounds.high) / 2.0, number: number as u32 }
        };
        let mut items: Vec<Item> = obstacles.iter().enumerate().map(item).collect();
        let mut nodes = vec![Node { bounds: Bounds::EMPTY, next: 0, count: 0 }; (2 * items.len()).saturating_sub(1)];
        if !items.is_empty() {
            build(&mut items, &mut nodes, 0, 0, 0);
        }
        Self { obstacles: items.iter().map(|item| obstacles[item.number as usize]).collect(), nodes }
    }

    /// Whether the way from `start` along the unit vector `along` is free for `length_m`.
    pub fn is_free(&self, start: Vec3, along: Vec3, length_m: f32, own_slot: u32) -> bool {
        // A component of 0 gives an infinity, which the comparisons take as it should be.
        let inverse = along.recip();
        let mut open = [0u32; STACK];
        let mut count = usize::from(!self.nodes.is_empty());
        while count > 0 {
            count -= 1;
            let mut at = open[count] as usize;
            loop {
                let node = &self.nodes[at];
                if !node.bounds.is_met(start, inverse, length_m) {
                    break;
                }
                if node.count == 0 {
                    open[count] = node.next;
                    count += 1;
                    at += 1;
                    continue;
                }
                let inside = &self.obstacles[node.next as usize..][..node.count as usize];
                if inside.iter().any(|o| o.slot != own_slot && o.is_met(start, along, length_m)) {
                    return false;
                }
                break;
            }
        }
        true
    }
}

/// Fills `nodes`, which stand at `node_base`, with a tree over `items`, which stand at `item_base`. A subtree of n triangles has room for
/// 2n − 1 nodes, whatever it needs of them: so both halves know where they go.
fn build(items: &mut [Item], nodes: &mut [Node], node_base: u32, item_base: u32, depth: usize) {
    let bounds = items.iter().fold(Bounds::EMPTY, |all, item| all.union(&item.bounds));
    if items.len() <= IN_LEAF {
        nodes[0] = Node { bounds, next: item_base, count: items.len() as u32 };
        return;
    }
    let split = if depth < SAH_DEPTH { split_by_area(items) } else { None };
    let split = split.unwrap_or_else(|| halve(items));
    let second = 2 * split as u32; // behind this node and 2 · split − 1 of the first half
    nodes[0] = Node { bounds, next: node_base + second, count: 0 };
    let large = items.len() > WORTH_A_THREAD;
    let (first_items, second_items) = items.split_at_mut(split);
    let (first_nodes, second_nodes) = nodes[1..].split_at_mut(second as usize - 1);
    let mut first = || build(first_items, first_nodes, node_base + 1, item_base, depth + 1);
    let mut second = || build(second_items, second_nodes, node_base + second, item_base + split as u32, depth + 1);
    if large {
        rayon::join(first, second);
    } else {
        first();
        second();
    }
}

/// Sorts items to both sides of the cheapest of a few planes and tells how many are on the first; `None` where one plane has all.
fn split_by_area(items: &mut [Item]) -> Option<usize> {
    let middles = items.iter().fold(Bounds::EMPTY, |all, item| all.with(item.middle));
    let size = middles.high - middles.low;
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    if size[axis] <= 0.0 {
        return None;
    }
    let scale = BINS as f32 * 0.9999 / size[axis];
    let bin = |item: &Item| (((item.middle[axis] - middles.low[axis]) * scale) as usize).min(BINS - 1);
    let mut bins = [(Bounds::EMPTY, 0usize); BINS];
    for item in items.iter() {
        let (bounds, count) = &mut bins[bin(item)];
        *bounds = bounds.union(&item.bounds);
        *count += 1;
    }
    let mut costs = [0.0f32; BINS];
    for ways in [false, true] {
        let mut all = (Bounds::EMPTY, 0usize);
        for step in 0..BINS - 1 {
            // The first k + 1 bins are before plane k, the others behind it.
            let at = if ways { BINS - 1 - step } else { step };
            all = (all.0.union(&bins[at].0), all.1 + bins[at].1);
            costs[if ways { at - 1 } else { at }] += if all.1 == 0 { 0.0 } else { all.0.half_area() * all.1 as f32 };
        }
    }
    let plane = (0..BINS - 1).min_by(|a, b| costs[*a].total_cmp(&costs[*b]))?;
    let mut first = 0;
    for k in 0..items.len() {
        if bin(&items[k]) <= plane {
            items.swap(first, k);
            first += 1;
        }
    }
    (first > 0 && first < items.len()).then_some(first)
}

/// Sorts items to both sides of the one in the middle, along the longest side.
fn halve(items: &mut [Item]) -> usize {
    let middles = items.iter().fold(Bounds::EMPTY, |all, item| all.with(item.middle));
    let size = middles.high - middles.low;
    let axis = (0..3).max_by(|a, b| size[*a].total_cmp(&size[*b])).unwrap_or(0);
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |a, b| a.middle[axis].total_cmp(&b.middle[axis]));
    half
}

impl Bounds {
    const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    fn of(corners: [Vec3; 3]) -> Self {
        corners.into_iter().fold(Self::EMPTY, |all, p| all.with(p))
    }

    fn with(&self, p: Vec3) -> Self {
        Self { low: self.low.min(p), high: self.high.max(p) }
    }

    fn union(&self, other: &Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn half_area(&self) -> f32 {
        let s = self.high - self.low;
        s.x * s.y + s.y * s.z + s.z * s.x
    }

    fn is_met(&self, start: Vec3, inverse: Vec3, length_m: f32) -> bool {
        let (a, b) = ((self.low - start) * inverse, (self.high - start) * inverse);
        let enter = a.min(b).max_element().max(0.0);
        let leave = a.max(b).min_element().min(length_m);
        enter <= leave
    }
}

impl Obstacle {
    /// Möller, Trumbore: *Fast, Minimum Storage Ray/Triangle Intersection* (1997).
    fn is_met(&self, start: Vec3, along: Vec3, length_m: f32) -> bool {
        let [a, b, c] = self.corners;
        let (ab, ac) = (b - a, c - a);
        let across = along.cross(ac);
        let determinant = ab.dot(across);
        // Above 0 where the ray comes to the front.
        if determinant == 0.0 || determinant > 0.0 && !self.double_sided {
            return false;
        }
        let inverse = 1.0 / determinant;
        let from = start - a;
        let u = from.dot(across) * inverse;
        let other = from.cross(ab);
        let v = along.dot(other) * inverse;
        let at = ac.dot(other) * inverse;
        u >= 0.0 && v >= 0.0 && u + v <= 1.0 && at > 0.0 && at < length_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::Random;

    #[test]
    fn the_tree_meets_what_one_triangle_after_another_does() {
        let mut random = Random::new(3);
        let mut vector =
            |size: f32| Vec3::new(random.range(-size, size), random.range(-2.0 * size, size), random.range(-size, size));
        let obstacles: Vec<Obstacle> = (0..301)
            .map(|slot| {
                let at = vector(5.0);
                Obstacle { corners: [(); 3].map(|()| at + vector(1.0)), double_sided: slot % 3 == 0, slot }
            })
            .collect();
        let tree = RayTree::over(&obstacles);
        let mut met = 0;
        for k in 0..2000u32 {
            let (start, along, length_m) = (vector(6.0), vector(1.0).normalize(), 0.5 + (k % 7) as f32);
            let free = !obstacles.iter().any(|o| o.slot != k && o.is_met(start, along, length_m));
            assert_eq!(tree.is_free(start, along, length_m, k), free);
            met += usize::from(!free);
        }
        assert!(met > 100 && met < 1800, "{met}");
    }

    #[test]
    fn one_side_lets_rays_in_and_not_out() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y]; // its front is towards +Z
        let tree = |double_sided| RayTree::over(&[Obstacle { corners, double_sided, slot: 0 }]);
        let inside = Vec3::new(0.2, 0.2, 0.0);
        assert!(tree(false).is_free(inside + Vec3::Z, -Vec3::Z, 2.0, 9), "it comes to the front");
        assert!(!tree(true).is_free(inside + Vec3::Z, -Vec3::Z, 2.0, 9));
        assert!(!tree(false).is_free(inside - Vec3::Z, Vec3::Z, 2.0, 9), "an eye up there sees the front");
        assert!(tree(false).is_free(inside - Vec3::Z, Vec3::Z, 0.5, 9), "it ends before");
        assert!(tree(false).is_free(inside - Vec3::Z, Vec3::Z, 2.0, 0), "it is its own");
        assert!(RayTree::over(&[]).is_free(Vec3::ZERO, Vec3::X, 1.0, 0));
    }
}
