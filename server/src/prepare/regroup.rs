//! Trees over boxes: the only user of obvhs.

use mullion_common::geometry::Aabb;
use obvhs::BvhBuildParams;
use obvhs::bvh2::builder::build_bvh2;
use std::time::Duration;

/// A node of a [`Tree`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TreeNode {
    /// One past the last node of its subtree.
    pub subtree_end: u32,
    /// Items below it.
    pub item_count: u32,
    /// The item, where it is a leaf.
    pub item: Option<u32>,
}

/// A binary tree over items `0..n`, in depth-first order, one item a leaf.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Tree {
    pub nodes: Vec<TreeNode>,
}

impl Tree {
    /// A tree of nearby boxes by the surface-area heuristic (obvhs: PLOC with reinsertion). Boxes must not be empty.
    pub fn over(boxes: &[Aabb]) -> Self {
        match boxes.len() {
            0 => return Self::default(),
            1 => return Self { nodes: vec![TreeNode { subtree_end: 1, item_count: 1, item: Some(0) }] },
            _ => {}
        }
        // Centred, so that f32 keeps what tells neighbours apart.
        let origin = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(b)).center();
        let single: Vec<obvhs::aabb::Aabb> =
            boxes.iter().map(|b| obvhs::aabb::Aabb::new((b.min - origin).as_vec3a(), (b.max - origin).as_vec3a())).collect();
        let params = BvhBuildParams { max_prims_per_leaf: 1, pre_split: false, ..BvhBuildParams::medium_build() };
        let bvh = build_bvh2(&single, params, &mut Duration::default());

        let mut nodes = Vec::with_capacity(boxes.len() * 2 - 1);
        let mut open: Vec<(usize, usize)> = Vec::new(); // (node to visit, tree depth)
        let mut path: Vec<u32> = Vec::new(); // open ancestors, by depth
        let close = |path: &mut Vec<u32>, depth: usize, nodes: &mut Vec<TreeNode>| {
            while path.len() > depth {
                if let Some(id) = path.pop() {
                    let end = nodes.len() as u32;
                    nodes[id as usize].subtree_end = end;
                    // A binary tree of n leaves has 2n − 1 nodes.
                    nodes[id as usize].item_count = (end - id).div_ceil(2);
                }
            }
        };
        open.push((0, 0));
        while let Some((at, depth)) = open.pop() {
            close(&mut path, depth, &mut nodes);
            path.push(nodes.len() as u32);
            let node = &bvh.nodes[at];
            let first = node.first_index as usize;
            let item = (node.prim_count > 0).then(|| bvh.primitive_indices[first]);
            nodes.push(TreeNode { subtree_end: 0, item_count: 0, item });
            if item.is_none() {
                open.push((first + 1, depth + 1));
                open.push((first, depth + 1));
            }
        }
        close(&mut path, 0, &mut nodes);
        Self { nodes }
    }

    /// The items below a node, in order.
    pub fn items(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        let end = self.nodes[node as usize].subtree_end;
        self.nodes[node as usize..end as usize].iter().filter_map(|n| n.item)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
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

    #[test]
    fn coinciding_boxes_make_a_tree_too() {
        let boxes = vec![Aabb { min: DVec3::ZERO, max: DVec3::ZERO }; 100];
        assert_eq!(Tree::over(&boxes).nodes.len(), 199);
    }
}
