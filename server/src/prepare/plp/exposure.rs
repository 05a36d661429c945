//! How far triangles lie open: short rays from each into the space before it.

use glam::Vec3;
use mullion_common::scene::Exposure;
use rayon::prelude::*;

use super::rays::{Obstacle, RayTree};
use super::world::WorldLeaves;
use crate::generate::Random;

/// How long rays are, in sides below which the octree's nodes are not divided: out of a room or from under a bonnet, but not across the street.
const LENGTH: f32 = 2.5;
/// Rays in all directions, of which a triangle uses those before it.
const DIRECTIONS: usize = 20;
/// A ray that leaves flatter than this sine says little and costs as much.
const LEAST_SINE: f32 = 0.1;
/// The directions come from this seed.
const SEED: u64 = 20;

/// For each slot. `side_m` is the side below which the octree's nodes are not divided.
pub(super) fn exposures(world: &WorldLeaves, side_m: f32) -> Vec<Exposure> {
    let mut first_slots = Vec::with_capacity(world.leaves.len());
    let mut obstacles = Vec::new();
    let mut slots = 0;
    for leaf in &world.leaves {
        first_slots.push(slots);
        if leaf.surface.opaque {
            let double_sided = leaf.surface.double_sided;
            obstacles.extend(leaf.triangles.iter().zip(slots..).map(|(&corners, slot)| Obstacle { corners, double_sided, slot }));
        }
        slots += leaf.triangles.len() as u32;
    }
    let tree = RayTree::over(&obstacles);
    let directions = directions();
    let length_m = LENGTH * side_m;
    world
        .leaves
        .par_iter()
        .zip(first_slots)
        .flat_map_iter(|(leaf, first)| {
            let (tree, directions) = (&tree, &directions);
            leaf.triangles
                .iter()
                .zip(first..)
                .map(move |(triangle, slot)| exposure(tree, directions, *triangle, slot, leaf.surface.double_sided, length_m))
        })
        .collect()
}

fn exposure(tree: &RayTree, directions: &[Vec3], corners: [Vec3; 3], slot: u32, double_sided: bool, length_m: f32) -> Exposure {
    let [a, b, c] = corners;
    let across = (b - a).cross(c - a);
    let Some(normal) = across.try_normalize() else { return Exposure::default() };
    let middle = (a + b + c) / 3.0;
    let mut free = [0.0f32; 6];
    let mut all = [0.0f32; 6];
    for &along in directions {
        let sine = normal.dot(along);
        if sine.abs() < LEAST_SINE || sine < 0.0 && !double_sided {
            continue;
        }
        let share = f32::from(u8::from(tree.is_free(middle, along, length_m, slot)));
        for axis in 0..3 {
            let at = 2 * axis + usize::from(along[axis] < 0.0);
            let weight = along[axis] * along[axis];
            free[at] += share * weight;
            all[at] += weight;
        }
    }
    Exposure::new(std::array::from_fn(|k| if all[k] > 0.0 { free[k] / all[k] } else { 0.0 }), across.length() / 2.0)
}

/// Directions that are spread evenly: the best of many for each one.
fn directions() -> Vec<Vec3> {
    const CANDIDATES: usize = 64;
    let mut random = Random::new(SEED);
    let mut chosen: Vec<Vec3> = Vec::with_capacity(DIRECTIONS);
    while chosen.len() < DIRECTIONS {
        let candidates: Vec<Vec3> = (0..CANDIDATES)
            .map(|_| {
                let [x, y, z, w] = random.rotation();
                glam::Quat::from_xyzw(x, y, z, w) * Vec3::Z
            })
            .collect();
        let nearest = |d: &Vec3| chosen.iter().map(|other| d.dot(*other)).fold(-1.0, f32::max);
        chosen.extend(candidates.into_iter().min_by(|a, b| nearest(a).total_cmp(&nearest(b))));
    }
    chosen
}
