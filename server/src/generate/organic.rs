//! A creature as large as the scanned Armadillo of Birkholz and Rahn (Table 1), 172 974 vertices and 345 944 triangles, closed, whose limbs
//! reach around and hide it and each other.
//!
//! A sphere of 521 rings of 332 vertices and two poles. Limbs are drawn out of it, all space is turned the more the further out it is, and
//! scales roughen it: none of that folds it.
use super::noise::Noise;
use super::random::Random;
use super::streamed::StreamedMesh;
use glam::{Vec3, vec3};

const RINGS: u32 = 521;
/// Vertices of a ring, a multiple of 4.
const SIDES: u32 = 332;
const QUARTER: u32 = SIDES / 4;

/// What is drawn out of the body.
struct Limb {
    direction: Vec3,
    /// Beyond the body, in its radii.
    length: f32,
    /// Where it begins, as a share of the body's radius.
    width: f32,
}

pub(super) struct Organic {
    limbs: Vec<Limb>,
    muscles: Noise,
    scales: Noise,
}

impl Organic {
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let mut limb = |x: f32, y: f32, z: f32, length: f32, width: f32| {
            let mut sway = || random.range(-0.06, 0.06);
            Limb { direction: vec3(x + sway(), y + sway(), z + sway()).normalize(), length, width }
        };
        let limbs = vec![
            limb(0.9, 0.35, 0.25, 1.9, 0.42),
            limb(-0.9, 0.3, 0.2, 1.9, 0.42),
            limb(0.55, -0.8, 0.1, 1.6, 0.5),
            limb(-0.55, -0.8, 0.1, 1.6, 0.5),
            limb(0.0, 0.85, 0.45, 0.9, 0.5),
            limb(0.3, 0.9, 0.0, 1.0, 0.24),
            limb(-0.3, 0.9, 0.0, 1.0, 0.24),
            limb(0.0, -0.25, -0.95, 2.2, 0.45),
        ];
        let scales = Noise { seed: seed ^ 0x6C07_8965, frequency: 9.0, octaves: 3 };
        Self { limbs, muscles: Noise { seed, frequency: 1.6, octaves: 3 }, scales }
    }

    /// A point of the unit sphere. Neither rings nor their vertices are evenly spaced: without sines, quarters of a circle are parametrised by
    /// the tangent of half the angle.
    fn on_sphere(vertex: u32) -> Vec3 {
        let Some(in_rings) = vertex.checked_sub(1).filter(|v| *v < RINGS * SIDES) else {
            return if vertex == 0 { Vec3::Y } else { Vec3::NEG_Y };
        };
        let (ring, side) = (in_rings / SIDES, in_rings % SIDES);
        let up = 1.0 - 2.0 * (ring + 1) as f32 / (RINGS + 1) as f32;
        // Rings evenly by angle, nearly: closer to the poles than by height.
        let up = up * (1.5 - 0.5 * up * up);
        let across = (1.0 - up * up).max(0.0).sqrt();
        let half_tangent = (side % QUARTER) as f32 / QUARTER as f32;
        let scale = 1.0 / (1.0 + half_tangent * half_tangent);
        let (cos, sin) = ((1.0 - half_tangent * half_tangent) * scale, 2.0 * half_tangent * scale);
        let (x, z) = match side / QUARTER {
            0 => (cos, -sin),
            1 => (-sin, -cos),
            2 => (-cos, sin),
            _ => (sin, cos),
        };
        vec3(x * across, up, z * across)
    }
}

impl StreamedMesh for Organic {
    fn name(&self) -> &'static str {
        "organic"
    }

    fn vertices(&self) -> u32 {
        RINGS * SIDES + 2
    }

    fn triangles(&self) -> u32 {
        2 * RINGS * SIDES
    }

    fn position(&self, vertex: u32) -> Vec3 {
        let direction = Self::on_sphere(vertex);
        let mut radius = 1.0 + 0.12 * self.muscles.at(direction * 2.0);
        for limb in &self.limbs {
            // Twice the sine of half the angle, as a share of the width: a bell around the limb's direction.
            let beside = (direction - limb.direction).length_squared() / (limb.width * limb.width);
            let bell = 1.0 / (1.0 + beside * beside);
            radius += limb.length * bell * bell;
        }
        let drawn = direction * radius;
        let rough = drawn + direction * (0.02 * self.scales.ridges(drawn));
        // The further out, the further around and forwards: arms and tail embrace the body.
        let beyond = (vec3(rough.x, 0.0, rough.z).length() - 1.0).max(0.0);
        let half_tangent = 0.42 * beyond / (1.0 + 0.25 * beyond);
        let scale = 1.0 / (1.0 + half_tangent * half_tangent);
        let (cos, sin) = ((1.0 - half_tangent * half_tangent) * scale, 2.0 * half_tangent * scale);
        let turned = vec3(rough.x * cos + rough.z * sin, rough.y, rough.z * cos - rough.x * sin);
        turned * 0.6
    }

    fn triangle(&self, triangle: u32) -> [u32; 3] {
        let first = |ring: u32| 1 + ring * SIDES;
        let last = RINGS * SIDES + 1;
        let next = |side: u32| (side + 1) % SIDES;
        if triangle < SIDES {
            return [0, first(0) + triangle, first(0) + next(triangle)];
        }
        let below = triangle - SIDES;
        let (band, in_band) = (below / (2 * SIDES), below % (2 * SIDES));
        if band == RINGS - 1 {
            return [last, first(band) + next(in_band), first(band) + in_band];
        }
        let side = in_band / 2;
        let [a, b, c, d] = [first(band) + side, first(band + 1) + side, first(band + 1) + next(side), first(band) + next(side)];
        if in_band.is_multiple_of(2) { [a, b, c] } else { [a, c, d] }
    }

    fn color(&self) -> [f32; 3] {
        [0.55, 0.42, 0.3]
    }
}
