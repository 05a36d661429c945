//! Whether a short ray meets a triangle: a binary tree over triangles along a Morton curve, quick to build and good enough for rays that end
//! soon.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::tree::regroup::morton;

/// Triangles in a leaf of the tree.
const IN_LEAF: usize = 4;

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

/// Triangles in a complete binary tree: node k has children 2k + 1 and 2k + 2, and the last level's nodes hold [`IN_LEAF`] triangles each.
pub(super) struct RayTree {
    obstacles: Vec<Obstacle>,
    nodes: Vec<Bounds>,
    first_leaf: usize,
}

impl RayTree {
    /// A tree over triangles in a cube of this size around the origin.
    pub fn over(obstacles: Vec<Obstacle>, size_m: f32) -> Self {
        let place = |o: &Obstacle| {
            let [a, b, c] = o.corners;
            morton(DVec3::splat(0.5) + ((a + b + c) / 3.0).as_dvec3() / f64::from(size_m))
        };
        let mut keyed: Vec<(u64, u32)> = obstacles.par_iter().map(place).zip(0..obstacles.len() as u32).collect();
        keyed.par_sort_unstable();
        let obstacles: Vec<Obstacle> = keyed.into_par_iter().map(|(_, k)| obstacles[k as usize]).collect();
        let leaves = obstacles.len().div_ceil(IN_LEAF).next_power_of_two();
        let first_leaf = leaves - 1;
        let empty = Bounds { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };
        let mut nodes = vec![empty; 2 * leaves - 1];
        for (leaf, inside) in obstacles.chunks(IN_LEAF).enumerate() {
            nodes[first_leaf + leaf] = inside.iter().flat_map(|o| o.corners).fold(empty, |all, p| Bounds {
                low: all.low.min(p),
                high: all.high.max(p),
            });
        }
        for k in (0..first_leaf).rev() {
            let (a, b) = (nodes[2 * k + 1], nodes[2 * k + 2]);
            nodes[k] = Bounds { low: a.low.min(b.low), high: a.high.max(b.high) };
        }
        Self { obstacles, nodes, first_leaf }
    }

    /// Whether the way from `start` along the unit vector `along` is free for `length_m`.
    pub fn is_free(&self, start: Vec3, along: Vec3, length_m: f32, own_slot: u32) -> bool {
        // A component of 0 gives an infinity, which the comparisons take as it should be.
        let inverse = along.recip();
        let mut open = [0u32; 64];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let node = open[count] as usize;
            if !self.nodes[node].is_met(start, inverse, length_m) {
                continue;
            }
            if node < self.first_leaf {
                // One deeper than the tree at most.
                open[count] = 2 * node as u32 + 1;
                open[count + 1] = 2 * node as u32 + 2;
                count += 2;
                continue;
            }
            let first = ((node - self.first_leaf) * IN_LEAF).min(self.obstacles.len());
            let inside = &self.obstacles[first..(first + IN_LEAF).min(self.obstacles.len())];
            if inside.iter().any(|o| o.slot != own_slot && o.is_met(start, along, length_m)) {
                return false;
            }
        }
        true
    }
}

impl Bounds {
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
        let mut vector = |size: f32| Vec3::new(random.range(-size, size), random.range(-2.0 * size, size), random.range(-size, size));
        let obstacles: Vec<Obstacle> = (0..301)
            .map(|slot| {
                let at = vector(5.0);
                Obstacle { corners: [(); 3].map(|()| at + vector(1.0)), double_sided: slot % 3 == 0, slot }
            })
            .collect();
        let tree = RayTree::over(obstacles.clone(), 30.0);
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
        let tree = |double_sided| RayTree::over(vec![Obstacle { corners, double_sided, slot: 0 }], 2.0);
        let inside = Vec3::new(0.2, 0.2, 0.0);
        assert!(tree(false).is_free(inside + Vec3::Z, -Vec3::Z, 2.0, 9), "it comes to the front");
        assert!(!tree(true).is_free(inside + Vec3::Z, -Vec3::Z, 2.0, 9));
        assert!(!tree(false).is_free(inside - Vec3::Z, Vec3::Z, 2.0, 9), "an eye up there sees the front");
        assert!(tree(false).is_free(inside - Vec3::Z, Vec3::Z, 0.5, 9), "it ends before");
        assert!(tree(false).is_free(inside - Vec3::Z, Vec3::Z, 2.0, 0), "it is its own");
        assert!(RayTree::over(Vec::new(), 2.0).is_free(Vec3::ZERO, Vec3::X, 1.0, 0));
    }
}
