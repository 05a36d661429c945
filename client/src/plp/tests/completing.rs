//! Goal: completion draws all that is seen. Method: the block of cubes, seen by rays.

use glam::Vec3;
use mullion_common::geometry::Aabb;
use proptest::prelude::*;

use super::block::{ORIGIN, TRIANGLES_IN_LEAF, next};
use super::{block, eyes, frustum, solidities};
use crate::plp::{Completion, Traversal};

/// Where a ray from the eye meets a triangle, in lengths of its direction.
fn meets(eye: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<f64> {
    let [eye, direction, a, b, c] = [eye, direction, a, b, c].map(|p| p.as_dvec3());
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let volume = ab.dot(across);
    let from_a = eye - a;
    let u = from_a.dot(across) / volume;
    let v = direction.dot(from_a.cross(ab)) / volume;
    let along = ac.dot(from_a.cross(ab)) / volume;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && along > 1e-4).then_some(along)
}

/// Whether a ray comes into a box before it has gone so far.
fn enters(eye: Vec3, direction: Vec3, bounds: &Aabb, before: f64) -> bool {
    let (eye, direction) = (ORIGIN + eye.as_dvec3(), direction.as_dvec3());
    let (a, b) = ((bounds.min - eye) / direction, (bounds.max - eye) / direction);
    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
    enter.max(0.0) <= leave + 1e-6 && enter <= before + 1e-6
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Pixels are rays: what the nearest triangle of each is must be among what completion draws.
    #[test]
    fn completion_draws_all_that_is_seen(seed in any::<u64>(), eye in eyes(), solidity in solidities(), budget in 0..120u32) {
        let block = block(seed, 9);
        let frustum = frustum(eye);
        let frame = block.frame(eye, &frustum.planes);
        let mut state = seed;
        let [corner, right, _, up] = frustum.rays;
        let towards = |x: f32, y: f32| (corner + (right - corner) * f64::from(x) + (up - corner) * f64::from(y)).as_vec3();
        let rays: Vec<Vec3> = (0..300).map(|_| towards(next(&mut state), next(&mut state))).collect();
        let nearest = |ray: Vec3, is_there: &dyn Fn(u32) -> bool| {
            let hits = (0..).zip(&block.triangles).filter(|(slot, _)| is_there(*slot));
            let hits = hits.filter_map(|(slot, triangle)| meets(eye, ray, *triangle).map(|along| (along, slot)));
            hits.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let mut traversal = Traversal::new();
        traversal.begin(&frame, solidity);
        traversal.project(&frame, budget);
        let mut completion = Completion::default();
        completion.begin(&frame, &traversal);
        let held = |completion: &Completion| block.held(&completion.drawn);
        let mut rounds = 0;
        loop {
            let drawn = held(&completion);
            let so_far: Vec<f64> = rays
                .iter()
                .map(|ray| nearest(*ray, &|slot| drawn.binary_search(&slot).is_ok()).map_or(f64::INFINITY, |(along, _)| along))
                .collect();
            let is_seen = |bounds: Aabb| rays.iter().zip(&so_far).any(|(ray, before)| enters(eye, *ray, &bounds, *before));
            let seen: Vec<bool> = completion.bounds(&block.tessellation).map(is_seen).collect();
            let more = completion.take(&frame, &seen);
            let mut after = drawn.clone();
            for (place, own) in completion.added() {
                prop_assert!(own.iter().all(|(of, slot)| *of == place && block.tessellation.slots(place).contains(slot)));
                after.extend(own.iter().map(|(_, slot)| *slot));
            }
            after.sort_unstable();
            prop_assert_eq!(after, held(&completion), "what was added is what is new");
            rounds += 1;
            if !more {
                break;
            }
        }
        prop_assert!(rounds < 60);
        let drawn = held(&completion);
        let fronts = |slot: u32| {
            let [a, b, c] = block.triangles[slot as usize];
            slot / TRIANGLES_IN_LEAF % 2 == 1 || (b - a).cross(c - a).dot(eye - a) > 0.0
        };
        for ray in &rays {
            if let Some((_, slot)) = nearest(*ray, &fronts).filter(|(_, slot)| block.shows_front(*slot, eye)) {
                prop_assert!(drawn.binary_search(&slot).is_ok(), "triangle {} is seen and not drawn", slot);
            }
        }
    }
}
