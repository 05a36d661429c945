//! Trees over boxes: the only user of obvhs.

use std::collections::HashMap;
use std::time::Duration;

use glam::DVec3;
use mullion_common::geometry::Aabb;
use obvhs::BvhBuildParams;
use obvhs::bvh2::builder::build_bvh2;
use rayon::prelude::*;

/// Boxes that obvhs sees at a time. It merges pairs of nearest neighbours, pass by pass: where boxes lie in one another
/// without end it merges one pair a pass, and its time grows with the square of their number.
const RUN: usize = 4096;

/// A node of a [`Tree`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TreeNode {
    /// One past the last node of its subtree.
    pub subtree_end: u32,
    /// Items below it.
    pub item_count: u32,
    /// The item, where it is a leaf.
    pub item: Option<u32>,
}

/// A binary tree over items `0..n`, in depth-first order, one item a leaf.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Tree {
    pub nodes: Vec<TreeNode>,
}

impl Tree {
    /// A tree of nearby boxes by the surface-area heuristic (obvhs: PLOC with reinsertion). Boxes must not be empty.
    ///
    /// Equal boxes are halved, not weighed. Many boxes are cut into runs along a Morton curve, each run gets its tree, and
    /// the runs get one.
    pub fn over(boxes: &[Aabb]) -> Self {
        let mut first: HashMap<[u64; 6], usize> = HashMap::new();
        let mut equal: Vec<Vec<u32>> = Vec::new();
        for (item, b) in boxes.iter().enumerate() {
            let key = [b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z].map(f64::to_bits);
            let at = *first.entry(key).or_insert_with(|| {
                equal.push(Vec::new());
                equal.len() - 1
            });
            equal[at].push(item as u32);
        }
        let distinct: Vec<Aabb> = equal.iter().map(|items| boxes[items[0] as usize]).collect();
        let parts: Vec<Vec<TreeNode>> = equal.iter().map(|items| halved(items)).collect();
        spliced(&over_distinct(&distinct), &parts)
    }

    /// The items below a node, in order.
    pub fn items(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        let end = self.nodes[node as usize].subtree_end;
        self.nodes[node as usize..end as usize].iter().filter_map(|n| n.item)
    }
}

fn over_distinct(boxes: &[Aabb]) -> Tree {
    let all = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(b));
    if boxes.len() <= RUN {
        return ploc(boxes, &all);
    }
    let size = all.size().max_element().max(f64::MIN_POSITIVE);
    let mut order: Vec<(u64, u32)> =
        boxes.iter().zip(0..).map(|(b, item)| (morton((b.center() - all.min) / size), item)).collect();
    order.par_sort_unstable();
    let runs: Vec<(Aabb, Vec<TreeNode>)> = order
        .par_chunks(RUN)
        .map(|run| {
            let boxes: Vec<Aabb> = run.iter().map(|(_, item)| boxes[*item as usize]).collect();
            let around = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(b));
            let mut nodes = ploc(&boxes, &around).nodes;
            nodes.iter_mut().for_each(|node| node.item = node.item.map(|item| run[item as usize].1));
            (around, nodes)
        })
        .collect();
    let (bounds, parts): (Vec<Aabb>, Vec<Vec<TreeNode>>) = runs.into_iter().unzip();
    spliced(&over_distinct(&bounds), &parts)
}

/// 63-bit Morton code of a point in the unit cube.
pub(crate) fn morton(p: DVec3) -> u64 {
    const CELLS: f64 = (1 << 21) as f64;
    let spread = |v: f64| {
        let mut x = (v * CELLS).clamp(0.0, CELLS - 1.0) as u64;
        x = (x | (x << 32)) & 0x001f_0000_0000_ffff;
        x = (x | (x << 16)) & 0x001f_0000_ff00_00ff;
        x = (x | (x << 8)) & 0x100f_00f0_0f00_f00f;
        x = (x | (x << 4)) & 0x10c3_0c30_c30c_30c3;
        (x | (x << 2)) & 0x1249_2492_4924_9249
    };
    spread(p.x) | (spread(p.y) << 1) | (spread(p.z) << 2)
}

/// A balanced tree over some items, one or more.
fn halved(items: &[u32]) -> Vec<TreeNode> {
    let mut nodes = Vec::with_capacity(items.len() * 2 - 1);
    let mut open = vec![items];
    while let Some(items) = open.pop() {
        let count = items.len() as u32;
        let item = if let [only] = items { Some(*only) } else { None };
        nodes.push(TreeNode { subtree_end: nodes.len() as u32 + count * 2 - 1, item_count: count, item });
        if item.is_none() {
            let (left, right) = items.split_at(items.len() / 2);
            open.extend([right, left]);
        }
    }
    nodes
}

/// The tree in which each item stands for the part of that number.
fn spliced(tree: &Tree, parts: &[Vec<TreeNode>]) -> Tree {
    let mut start_of = Vec::with_capacity(tree.nodes.len() + 1);
    let mut total = 0;
    for node in &tree.nodes {
        start_of.push(total);
        total += node.item.map_or(1, |item| parts[item as usize].len() as u32);
    }
    start_of.push(total);
    let mut nodes = Vec::with_capacity(total as usize);
    for node in &tree.nodes {
        let start = nodes.len() as u32;
        match node.item {
            Some(item) => {
                nodes.extend(parts[item as usize].iter().map(|n| TreeNode { subtree_end: n.subtree_end + start, ..*n }))
            }
            None => {
                let subtree_end = start_of[node.subtree_end as usize];
                // A binary tree of n leaves has 2n − 1 nodes.
                nodes.push(TreeNode { subtree_end, item_count: (subtree_end - start).div_ceil(2), item: None });
            }
        }
    }
    Tree { nodes }
}

/// obvhs' tree over boxes within `all`.
fn ploc(boxes: &[Aabb], all: &Aabb) -> Tree {
    match boxes.len() {
        0 => return Tree::default(),
        1 => return Tree { nodes: halved(&[0]) },
        _ => {}
    }
    // Centred, so that f32 keeps what tells neighbours apart.
    let origin = all.center();
    let single: Vec<obvhs::aabb::Aabb> =
        boxes.iter().map(|b| obvhs::aabb::Aabb::new((b.min - origin).as_vec3a(), (b.max - origin).as_vec3a())).collect();
    let params = BvhBuildParams { max_prims_per_leaf: 1, pre_split: false, ..BvhBuildParams::very_slow_build() };
    let bvh = build_bvh2(&single, params, &mut Duration::default());

    let mut nodes: Vec<TreeNode> = Vec::with_capacity(boxes.len() * 2 - 1);
    let mut path: Vec<u32> = Vec::new(); // open ancestors, by depth
    let mut open: Vec<(usize, usize)> = vec![(0, 0)]; // (node to visit, tree depth)
    let close = |path: &mut Vec<u32>, depth: usize, nodes: &mut Vec<TreeNode>| {
        for id in path.drain(depth..) {
            let end = nodes.len() as u32;
            nodes[id as usize].subtree_end = end;
            nodes[id as usize].item_count = (end - id).div_ceil(2);
        }
    };
    while let Some((at, depth)) = open.pop() {
        close(&mut path, depth, &mut nodes);
        path.push(nodes.len() as u32);
        let node = &bvh.nodes[at];
        let first = node.first_index as usize;
        let item = (node.prim_count > 0).then(|| bvh.primitive_indices[first]);
        nodes.push(TreeNode { subtree_end: 0, item_count: 0, item });
        if item.is_none() {
            open.extend([(first + 1, depth + 1), (first, depth + 1)]);
        }
    }
    close(&mut path, 0, &mut nodes);
    Tree { nodes }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_item_stands_once(points in proptest::collection::vec((-50.0..50.0f64, 0.0..1.0f64, -9e5..9e5f64), 0..60)) {
            let boxes: Vec<_> = points.iter().map(|p| {
                let min = DVec3::from(*p);
                Aabb { min, max: min + DVec3::new(1.0, 2.0, 3.0) }
            }).collect();
            let tree = Tree::over(&boxes);
            prop_assert_eq!(tree.nodes.len(), (boxes.len() * 2).saturating_sub(1));
            if !boxes.is_empty() {
                let mut items: Vec<_> = tree.items(0).collect();
                items.sort_unstable();
                prop_assert_eq!(items, (0..boxes.len() as u32).collect::<Vec<_>>());
            }
            for (i, node) in tree.nodes.iter().enumerate() {
                prop_assert_eq!(node.item_count as usize, tree.items(i as u32).count());
                prop_assert!(node.item.is_none() == (node.subtree_end as usize > i + 1));
            }
        }
    }

    fn depth(tree: &Tree) -> usize {
        let mut ends: Vec<u32> = Vec::new();
        let mut deepest = 0;
        for (i, node) in tree.nodes.iter().enumerate() {
            ends.retain(|end| *end > i as u32);
            ends.push(node.subtree_end);
            deepest = deepest.max(ends.len());
        }
        deepest
    }

    fn assert_whole(tree: &Tree, count: usize) {
        let mut items: Vec<_> = tree.items(0).collect();
        items.sort_unstable();
        assert!(items.into_iter().eq(0..count as u32), "every item stands once");
        assert_eq!((tree.nodes.len(), tree.nodes[0].item_count as usize), (count * 2 - 1, count));
    }

    #[test]
    fn coinciding_boxes_make_a_balanced_tree() {
        let boxes = vec![Aabb { min: DVec3::ZERO, max: DVec3::ZERO }; 100_000];
        let tree = Tree::over(&boxes);
        assert_whole(&tree, boxes.len());
        assert!(depth(&tree) <= 18, "{}", depth(&tree));
    }

    /// Each box in the next: the worst that a builder by nearest neighbours can meet.
    #[test]
    fn nested_boxes_cost_no_more_than_their_runs() {
        let nested = |i: i32| Aabb { min: DVec3::splat(-1.0 - f64::from(i)), max: DVec3::splat(1.0 + f64::from(i)) };
        let boxes: Vec<Aabb> = (0..20_000).map(nested).collect();
        let tree = Tree::over(&boxes);
        assert_whole(&tree, boxes.len());
        assert!(depth(&tree) <= 2 * RUN, "{}", depth(&tree));
    }

    #[test]
    fn runs_are_joined() {
        let at = |i: u32| DVec3::new(f64::from(i % 50), f64::from(i / 50 % 50), f64::from(i / 2500)) * 3.0;
        let boxes: Vec<Aabb> = (0..5000).map(|i| Aabb { min: at(i), max: at(i) + DVec3::new(1.0, 2.0, 3.0) }).collect();
        let tree = Tree::over(&boxes);
        assert_whole(&tree, boxes.len());
        assert!(depth(&tree) < 40, "{}", depth(&tree));
    }
}
