//! How things come to lie in the can: balls sink, push each other apart and stay within its wall.
//!
//! Position based, as in Müller, Heidelberger, Hennix, Ratcliff: "Position based dynamics" (2007), without velocities:
//! what matters is where the balls end.
use super::{RADIUS_M, RIM_M};
use crate::generate::random::Random;
use glam::{Vec3, vec3};

/// Steps in which balls sink, and steps after those in which they only make room for each other.
const SINKING: usize = 90;
const RESTING: usize = 60;
/// How far a ball sinks in a step.
const SINK_M: f32 = 0.006;
/// Above the rim the heap narrows by so much a metre.
const SLOPE: f32 = 1.1;
/// The cone's top is so wide, or balls would stand on each other in a line.
const PEAK_M: f32 = 0.12;
/// Edge of a cell: no ball is larger.
const CELL_M: f32 = 0.2;
const CELLS: usize = 10;
const LAYERS: usize = 24;

/// Where balls of these radii, at most half a cell, come to rest.
pub fn settle(radii_m: impl Iterator<Item = f32>, random: &mut Random) -> Vec<Vec3> {
    let radii: Vec<f32> = radii_m.collect();
    assert!(radii.iter().all(|radius| 2.0 * radius <= CELL_M));
    let mut places: Vec<Vec3> = (0..radii.len()).map(|k| drop_from(k as f32 / radii.len() as f32, random)).collect();
    let mut cells: Vec<Vec<usize>> = vec![Vec::new(); CELLS * CELLS * LAYERS];
    for step in 0..SINKING + RESTING {
        if step < SINKING {
            places.iter_mut().for_each(|place| place.y -= SINK_M);
        }
        cells.iter_mut().for_each(Vec::clear);
        for (k, place) in places.iter().enumerate() {
            let [x, y, z] = cell(*place);
            cells[(y * CELLS + z) * CELLS + x].push(k);
        }
        push_apart(&mut places, &radii, &cells);
        for (place, radius) in places.iter_mut().zip(&radii) {
            *place = within(*place, *radius);
        }
    }
    places
}

/// Those of low `share` lie deep: 0 to 1 from the floor upwards.
fn drop_from(share: f32, random: &mut Random) -> Vec3 {
    loop {
        let (x, z) = (random.range(-1.0, 1.0), random.range(-1.0, 1.0));
        if x * x + z * z <= 1.0 {
            return vec3(x * RADIUS_M * 0.9, 0.05 + share * 1.25 * RIM_M, z * RADIUS_M * 0.9);
        }
    }
}

fn cell(place: Vec3) -> [usize; 3] {
    let across = |value: f32| ((value / CELL_M + CELLS as f32 / 2.0).max(0.0) as usize).min(CELLS - 1);
    [across(place.x), ((place.y / CELL_M).max(0.0) as usize).min(LAYERS - 1), across(place.z)]
}

fn push_apart(places: &mut [Vec3], radii: &[f32], cells: &[Vec<usize>]) {
    for k in 0..places.len() {
        let [x, y, z] = cell(places[k]);
        let near = |middle: usize, count: usize| middle.saturating_sub(1)..(middle + 2).min(count);
        for row in near(y, LAYERS).flat_map(|y| near(z, CELLS).map(move |z| (y * CELLS + z) * CELLS)) {
            for other in near(x, CELLS).flat_map(|x| &cells[row + x]).copied().filter(|other| *other > k) {
                let apart = places[other] - places[k];
                let (least, distance_squared) = (radii[k] + radii[other], apart.length_squared());
                if distance_squared < least * least && distance_squared > 0.0 {
                    let distance = distance_squared.sqrt();
                    let push = apart * (0.5 * (least - distance) / distance);
                    places[k] -= push;
                    places[other] += push;
                }
            }
        }
    }
}

/// On the floor, within the wall, and above the rim within a cone.
fn within(place: Vec3, radius: f32) -> Vec3 {
    let y = place.y.max(radius);
    let widest = (RADIUS_M - radius - SLOPE * (y - RIM_M).max(0.0)).max(PEAK_M);
    let out = (place.x * place.x + place.z * place.z).sqrt();
    let share = if out > widest { widest / out } else { 1.0 };
    vec3(place.x * share, y, place.z * share)
}
