//! A hierarchy over leaves whose grouping nobody gave, or gave badly.

use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::OhNode;
use mullion_common::visible_set::LeafRange;

use super::LANES;
use super::regroup::Tree;

/// A hierarchy of nearby leaves, up to [`LANES`] children a node, for leaves with these bounds: its nodes, depth first, and the
/// leaves in the order of their new numbers.
///
/// An inner node's box is fitted around its children's boxes (Nirnimesh, Harish, Narayanan 2006, Algorithm 1).
pub(crate) fn hierarchy_over(bounds: &[Obb]) -> (Vec<OhNode>, Vec<u32>) {
    let boxes: Vec<Aabb> = bounds.iter().map(Obb::aabb).collect();
    let tree = Tree::over(&boxes);
    let areas = areas(&tree, &boxes);
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
                        gather(&tree, &areas, at, &mut children);
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

enum Step {
    Enter(u32),
    Leave(usize),
}

/// The box fitted around the boxes of a node's children, which stand after it; it must have some.
pub(super) fn fitted(nodes: &[OhNode], id: usize) -> Obb {
    let end = nodes[id].subtree_end as usize;
    let first = Some(id + 1).filter(|first| *first < end);
    let children = || {
        std::iter::successors(first, |at| Some(nodes[*at].subtree_end as usize).filter(|next| *next < end))
            .map(|at| &nodes[at].bound)
    };
    Obb::around(children().flat_map(Obb::corners)).unwrap_or(nodes[id].bound)
}

/// Half the surface of each node's axis-aligned box.
fn areas(tree: &Tree, boxes: &[Aabb]) -> Vec<f32> {
    let mut areas = vec![0.0; tree.nodes.len()];
    // Backwards, children come before parents; the last two done are the ones next in order.
    let mut done: Vec<Aabb> = Vec::new();
    for (node, area) in tree.nodes.iter().zip(&mut areas).rev() {
        let around = match node.item {
            Some(item) => boxes[item as usize],
            None => {
                let (first, second) = (done.pop().unwrap_or(Aabb::EMPTY), done.pop().unwrap_or(Aabb::EMPTY));
                first.union(&second)
            }
        };
        *area = around.half_area() as f32;
        done.push(around);
    }
    areas
}

/// The nodes that become the children of `at`: those below it, the largest opened first, in order.
fn gather(tree: &Tree, areas: &[f32], at: u32, children: &mut Vec<u32>) {
    children.clear();
    children.push(at);
    while children.len() < LANES {
        let is_inner = |at: &u32| tree.nodes[*at as usize].item.is_none();
        let largest = (0..children.len())
            .filter(|i| is_inner(&children[*i]))
            .max_by(|a, b| areas[children[*a] as usize].total_cmp(&areas[children[*b] as usize]));
        let Some(largest) = largest else {
            return;
        };
        let left = children[largest] + 1;
        let right = tree.nodes[left as usize].subtree_end;
        children.splice(largest..=largest, [left, right]);
    }
}
