//! A hierarchy over leaves whose grouping nobody gave, or gave badly.

use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{ObjectHierarchy, OhNode};
use mullion_common::visible_set::LeafRange;

use super::LANES;
use super::regroup::Tree;

/// A hierarchy of nearby leaves, up to [`LANES`] children a node, for leaves with these bounds: its nodes, depth first, and the
/// leaves in the order of their new numbers.
///
/// An inner node's box is fitted around its children's boxes (Nirnimesh, Harish, Narayanan 2006, Algorithm 1).
pub fn hierarchy_over(bounds: &[Obb]) -> (Vec<OhNode>, Vec<u32>) {
    let boxes: Vec<Aabb> = bounds.iter().map(Obb::aabb).collect();
    let tree = Tree::over(&boxes);
    let collapse = Collapse::of(&tree, &boxes);
    drop(boxes);
    let (mut nodes, mut order): (Vec<OhNode>, Vec<u32>) = (Vec::new(), Vec::new());
    let mut open: Vec<Step> = if bounds.is_empty() { Vec::new() } else { vec![Step::Enter(0)] };
    let mut children: Vec<u32> = Vec::new();
    while let Some(step) = open.pop() {
        match step {
            Step::Enter(at) => {
                let id = nodes.len();
                let leaves = LeafRange::new(order.len() as u32, order.len() as u32 + tree.nodes[at as usize].item_count);
                let item = tree.nodes[at as usize].item;
                let bound = item.map_or(Obb::of_point(glam::DVec3::ZERO), |item| bounds[item as usize]);
                nodes.push(OhNode { bound, subtree_end: id as u32 + 1, leaves });
                match item {
                    Some(item) => order.push(item),
                    None => {
                        collapse.gather(at, &mut children);
                        open.push(Step::Leave(id));
                        open.extend(children.iter().rev().map(|child| Step::Enter(*child)));
                    }
                }
            }
            Step::Leave(id) => {
                nodes[id].subtree_end = nodes.len() as u32;
                nodes[id].bound = fitted(&nodes, id);
            }
        }
    }
    (nodes, order)
}

/// A hierarchy over leaves that keep their order, one or more: neighbours in it are grouped.
pub(super) fn in_order(bounds: &[Obb]) -> ObjectHierarchy {
    let mut nodes: Vec<OhNode> = Vec::new();
    let whole = LeafRange::new(0, bounds.len() as u32);
    let mut open: Vec<Result<LeafRange, usize>> = if bounds.is_empty() { Vec::new() } else { vec![Ok(whole)] };
    while let Some(step) = open.pop() {
        match step {
            Ok(leaves) => {
                let id = nodes.len();
                let bound = bounds[leaves.start as usize];
                nodes.push(OhNode { bound, subtree_end: id as u32 + 1, leaves });
                if leaves.len() > 1 {
                    open.push(Err(id));
                    let each = leaves.len().div_ceil(LANES as u32);
                    let starts = (leaves.start..leaves.end).step_by(each as usize);
                    open.extend(starts.rev().map(|start| Ok(LeafRange::new(start, (start + each).min(leaves.end)))));
                }
            }
            Err(id) => {
                nodes[id].subtree_end = nodes.len() as u32;
                nodes[id].bound = fitted(&nodes, id);
            }
        }
    }
    // Depth first, nested and numbered in order, as the steps have it.
    ObjectHierarchy::new(nodes).expect("a tree")
}

enum Step {
    Enter(u32),
    Leave(usize),
}

/// The box fitted around the boxes of a node's children, which stand after it; it must have some.
pub(crate) fn fitted(nodes: &[OhNode], id: usize) -> Obb {
    let end = nodes[id].subtree_end as usize;
    let first = Some(id + 1).filter(|first| *first < end);
    let children = || {
        std::iter::successors(first, |at| Some(nodes[*at].subtree_end as usize).filter(|next| *next < end))
            .map(|at| &nodes[at].bound)
    };
    Obb::around(children().flat_map(Obb::corners)).unwrap_or(nodes[id].bound)
}

/// How a binary tree becomes one of up to [`LANES`] children a node, so that the nodes that remain are visited least
/// (dynamic programming as Ylitie, Karras and Laine 2017, section 3.1, with another measure).
///
/// A node is visited where an edge of a tile cuts the one above it, and a plane meets boxes in proportion to their
/// mean width, not to their surface.
struct Collapse<'a> {
    tree: &'a Tree,
    /// Of each node, the least cost of what is below it, when at most 1, 2 … 7 nodes stand for it.
    costs: Vec<[f32; LANES - 1]>,
}

impl<'a> Collapse<'a> {
    fn of(tree: &'a Tree, boxes: &[Aabb]) -> Self {
        let mut collapse = Self { tree, costs: vec![[0.0; LANES - 1]; tree.nodes.len()] };
        // Backwards, children come before parents; the last two done are the ones next in order.
        let mut done: Vec<Aabb> = Vec::new();
        for at in (0..tree.nodes.len()).rev() {
            let around = match tree.nodes[at].item {
                Some(item) => boxes[item as usize],
                None => {
                    let (first, second) = (done.pop().unwrap_or(Aabb::EMPTY), done.pop().unwrap_or(Aabb::EMPTY));
                    let around = first.union(&second);
                    let width = around.size().element_sum() as f32;
                    let [left, right] = collapse.children(at as u32);
                    let mut costs = [width + collapse.best_split(left, right, LANES).1; LANES - 1];
                    for count in 2..LANES {
                        costs[count - 1] = costs[count - 2].min(collapse.best_split(left, right, count).1);
                    }
                    collapse.costs[at] = costs;
                    around
                }
            };
            done.push(around);
        }
        collapse
    }

    fn children(&self, at: u32) -> [u32; 2] {
        [at + 1, self.tree.nodes[at as usize + 1].subtree_end]
    }

    /// The least cost of two siblings that at most `count` nodes stand for, two or more, and how many of them stand for the
    /// first.
    fn best_split(&self, left: u32, right: u32, count: usize) -> (usize, f32) {
        let cost = |node: u32, count: usize| self.costs[node as usize][count - 1];
        let splits = (1..count).map(|first| (first, cost(left, first) + cost(right, count - first)));
        splits.fold((1, f32::INFINITY), |best, split| if split.1 < best.1 { split } else { best })
    }

    /// The nodes that stand below `at`, leaves first.
    fn gather(&self, at: u32, children: &mut Vec<u32>) {
        children.clear();
        let mut open = vec![(at, LANES)];
        while let Some((node, count)) = open.pop() {
            let is_one = node != at && {
                let costs = &self.costs[node as usize];
                self.tree.nodes[node as usize].item.is_some() || costs[count - 1] >= costs[0]
            };
            if is_one {
                children.push(node);
                continue;
            }
            let [left, right] = self.children(node);
            let (first, _) = self.best_split(left, right, count);
            open.extend([(right, count - first), (left, first)]);
        }
        // Leaves first: what a walk finds of them goes out before it opens the others.
        children.sort_by_key(|child| self.tree.nodes[*child as usize].item.is_none());
    }
}
