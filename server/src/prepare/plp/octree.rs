//! The octree over the scene's vertices, of which only the middles of its leaves are kept.

use glam::Vec3;
use rayon::prelude::*;

use super::TessellateError;
use super::world::WorldLeaves;
use crate::generate::Random;
use crate::tree::regroup::morton;

/// Most points of a tessellation: about seven cells each.
const MAX_POINTS: usize = 2_000_000;
/// Bits of a Morton code.
const CODE_BITS: u32 = 63;
/// A node with no more vertices is not divided.
const VERTICES_IN_LEAF: u64 = 1;
/// How far a middle is moved, as a share of its node's side: octrees are full of points on one sphere.
const MOVED_SHARE: f32 = 0.1;
/// How much larger than the scene's box the box of all points is, as a share of the longest side, on each side.
const MARGIN_SHARE: f32 = 0.02;
/// How far its corners are moved, likewise: less than the margin, so that the hull still holds the scene.
const CORNER_MOVED_SHARE: f32 = 0.002;

/// A leaf of the octree.
#[derive(Clone, Copy)]
pub(super) struct OctreeLeaf {
    middle: Vec3,
    side_m: f32,
}

/// The leaves of the octree over all vertices, empty ones included where they meet the scene's box.
///
/// The root is a cube of the least size, from the longest side up, that halving divides into nodes of just `leaf_share` of that side. Those
/// are not below it and are divided once more: the finest leaves are half the share in every scene, not anything between half and all of it.
pub(super) fn leaf_middles(world: &WorldLeaves, leaf_share: f64) -> Result<Vec<OctreeLeaf>, TessellateError> {
    let mut depth = 1u32;
    let mut root_share = leaf_share;
    while root_share < 1.0 {
        root_share *= 2.0;
        depth += 1;
    }
    let root_m = world.longest_m * root_share as f32;
    let low = Vec3::splat(-root_m / 2.0);
    let code = |p: &Vec3| morton((*p - low).as_dvec3() / f64::from(root_m)) >> (CODE_BITS - 3 * depth);
    let mut counted: Vec<(u64, u64)> = world
        .leaves
        .par_iter()
        .flat_map_iter(|leaf| {
            let mut codes: Vec<u64> = leaf.triangles.as_flattened().iter().map(code).collect();
            codes.sort_unstable();
            codes.chunk_by(|a, b| a == b).map(|run| (run[0], run.len() as u64)).collect::<Vec<_>>()
        })
        .collect();
    counted.par_sort_unstable();
    let mut leaves = Vec::new();
    let mut open = vec![(&counted[..], low, root_m, depth)];
    while let Some((inside, corner, side_m, levels)) = open.pop() {
        let vertices: u64 = inside.iter().map(|(_, count)| count).sum();
        if levels == 0 || vertices <= VERTICES_IN_LEAF {
            let middle = corner + side_m / 2.0;
            if (middle.abs() - side_m / 2.0).cmple(world.half_m).all() {
                leaves.push(OctreeLeaf { middle, side_m });
            }
            if leaves.len() > MAX_POINTS {
                let found = leaves.len() as u64;
                return Err(TessellateError::TooMany { what: "leaves of the octree", found, cap: MAX_POINTS as u64 });
            }
            continue;
        }
        let shift = 3 * (levels - 1);
        let mut rest = inside;
        for octant in 0..8u64 {
            let (own, others) = rest.split_at(rest.partition_point(|(code, _)| code >> shift & 7 <= octant));
            rest = others;
            let step = Vec3::new((octant & 1) as f32, (octant >> 1 & 1) as f32, (octant >> 2) as f32) * (side_m / 2.0);
            open.push((own, corner + step, side_m / 2.0, levels - 1));
        }
    }
    Ok(leaves)
}

/// The points of the tessellation: the middles, each moved a little, and the corners of the box around all, in `f32` and all distinct.
pub(super) fn moved(leaves: &[OctreeLeaf], world: &WorldLeaves, random: &mut Random) -> Vec<Vec3> {
    let mut jitter = |by: f32| Vec3::new(random.range(-by, by), random.range(-by, by), random.range(-by, by));
    let half_m = world.half_m + world.longest_m * MARGIN_SHARE;
    let sign = |k: u8| Vec3::new((k & 1).into(), (k >> 1 & 1).into(), (k >> 2).into()) * 2.0 - 1.0;
    let mut points: Vec<Vec3> = (0..8).map(|k| half_m * sign(k) + jitter(world.longest_m * CORNER_MOVED_SHARE)).collect();
    let inside = world.half_m + world.longest_m * (MARGIN_SHARE / 2.0);
    points.extend(leaves.iter().map(|leaf| (leaf.middle + jitter(leaf.side_m * MOVED_SHARE)).clamp(-inside, inside)));
    points.sort_unstable_by_key(|p| p.to_array().map(f32::to_bits));
    points.dedup();
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::plp::world::{Surface, WorldLeaf};
    use glam::DVec3;

    fn world(triangles: Vec<[Vec3; 3]>, half_m: Vec3) -> WorldLeaves {
        let surface = Surface { double_sided: false, opaque: true };
        let leaves = vec![WorldLeaf { leaf: 0, triangles, surface }];
        WorldLeaves { origin: DVec3::ZERO, half_m, longest_m: half_m.max_element() * 2.0, leaves }
    }

    #[test]
    fn nodes_are_divided_where_vertices_are() {
        let half_m = Vec3::new(8.0, 4.0, 1.0); // an eighth of 16 m is 2 m: divided into nodes of 1 m
        let crowd = [Vec3::new(-7.9, -3.9, -0.9), Vec3::new(-7.8, -3.9, -0.9), Vec3::new(-7.9, -3.8, -0.9)];
        let leaves = leaf_middles(&world(vec![crowd, [half_m; 3]], half_m), 0.125).expect("few");
        let sides: Vec<f32> = leaves.iter().map(|leaf| leaf.side_m).collect();
        assert!(sides.contains(&1.0) && sides.contains(&8.0) && !sides.contains(&0.5), "{sides:?}");
        for leaf in &leaves {
            assert!((leaf.middle.abs() - leaf.side_m / 2.0).cmple(half_m).all(), "they meet the box");
        }
        let near = leaves.iter().filter(|leaf| (leaf.middle - crowd[0]).length() < 2.0);
        assert!(near.clone().count() > 3 && near.clone().all(|leaf| leaf.side_m == 1.0));
    }

    #[test]
    fn points_are_distinct_and_the_hull_holds_the_scene() {
        let half_m = Vec3::new(8.0, 4.0, 0.0);
        let world = world(vec![[-half_m, half_m, Vec3::ZERO]], half_m);
        let leaves = leaf_middles(&world, 0.05).expect("few");
        let points = moved(&leaves, &world, &mut Random::new(1));
        assert_eq!(points.len(), leaves.len() + 8);
        for k in 0..8 {
            let sign = Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32) * 2.0 - 1.0;
            assert!(points.iter().any(|p| (*p * sign).cmpgt(half_m).all()), "a corner of the hull beyond each corner");
        }
    }
}
