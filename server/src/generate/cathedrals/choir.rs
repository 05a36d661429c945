//! The choir's round end: six wedges of 30° about the apse's middle. A wedge is drawn outwards to −Z.
use super::bay::{AISLE_SPRING_M, ARCADE_M, BAY_M, EAVES_M, NAVE_RISE_M, NAVE_SPRING_M, RIDGE_M, VAULT_HALF_M, slates, vault};
use super::{Lodge, Work};
use crate::generate::glb_writer::{MeshId, Place};
use crate::generate::gothic::{Stones, Vault};
use crate::generate::random::Random;
use crate::generate::solid::ring;
use glam::{Vec3, vec3};

pub const WEDGES: usize = 6;

/// Outwards from the apse's middle, `k` times 15° from north by east.
pub fn outwards(k: usize) -> Vec3 {
    let corner = ring(24)[k];
    vec3(corner.y, 0.0, -corner.x)
}

/// A frame whose −Z looks outwards.
pub fn facing_in(at: Vec3, k: usize) -> Place {
    let out = outwards(k);
    Place::facing(at, vec3(-out.z, 0.0, out.x), Vec3::Y)
}

/// Half of a wedge's chord at radius 1, and its distance from the middle.
fn chord() -> [f32; 2] {
    let corner = ring(24)[1];
    [corner.y, corner.x]
}

/// A bay is scaled by this along X to fit the chord of a circle of `radius`.
pub fn chord_scale(radius: f32) -> f32 {
    2.0 * chord()[0] * radius / BAY_M
}

/// Points of a wedge: across from −1 to 1, at a radius through the corners.
fn at(across: f32, radius: f32, y: f32) -> Vec3 {
    let [half, away] = chord();
    vec3(across * half * radius, y, -away * radius)
}

pub fn ambulatory_vault(lodge: &mut Lodge) -> MeshId {
    // The ends are those of the aisles' vaults.
    let (near, far, y) = (BAY_M + 0.4, 2.0 * BAY_M - 0.4, AISLE_SPRING_M);
    let corners = [at(-1.0, near, y), at(1.0, near, y), at(1.0, far, y), at(-1.0, far, y)];
    vault(lodge, "ambulatory vault", Vault { corners, rise: 4.7, pieces: 6, courses: 2 }, 0.15)
}

/// The web over a wedge, from an arch on the wall to the key, and the rib on its left.
pub fn apse_vault(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("apse vault", |w| {
        let (pieces, rings) = (8, 10);
        // Heights from the middle of an arch to its springing.
        let height = |share: f32| {
            let (radius, center) = (1.281_25, 0.281_25);
            let out = share + center;
            (radius * radius - out * out).max(0.0).sqrt() / 1.25 * NAVE_RISE_M + NAVE_SPRING_M
        };
        let point = |ring: usize, k: usize| {
            let share = ring as f32 / rings as f32;
            let across = k as f32 / pieces as f32 * 2.0 - 1.0;
            at(across, share * VAULT_HALF_M, height(share * across.abs()))
        };
        let mut web = Stones::new(&w.palette.web, Random::new(6));
        for ring in 0..rings {
            for k in 0..pieces {
                let corners = [point(ring + 1, k), point(ring + 1, k + 1), point(ring, k + 1), point(ring, k)];
                // The innermost end in the key.
                let count = if ring == 0 { 3 } else { 4 };
                w.stone.polygon(&corners[..count], web.next());
            }
        }
        let rib: Vec<Vec3> = (0..=2 * rings)
            .map(|k| {
                let share = k as f32 / (2 * rings) as f32;
                at(-1.0, share * VAULT_HALF_M, height(share) - 0.06)
            })
            .collect();
        w.stone.tube(&rib, 0.2, 6, w.palette.trim);
    })
}

pub fn ambulatory_roof(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("ambulatory roof", |w| {
        let (low, high) = (ARCADE_M + 0.12, 16.3);
        let (far, near) = (2.0 * BAY_M + 0.3, BAY_M + 0.5);
        slates(w, [at(1.0, far, low), at(-1.0, far, low), at(-1.0, near, high), at(1.0, near, high)], [8, 8]);
    })
}

pub fn apse_roof(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("apse roof", |w| {
        let [out, low] = EAVES_M;
        let key = vec3(0.0, RIDGE_M, 0.0);
        slates(w, [at(1.0, out + 0.25, low), at(-1.0, out + 0.25, low), key, key], [6, 12]);
    })
}

/// The floor of a wedge.
pub fn floor(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("apse floor", |w| {
        let rings = 10;
        for ring in 0..rings {
            let (near, far) = (1.4 * ring as f32, 1.4 * (ring + 1) as f32);
            for k in 0..4 {
                let across = |k: usize| k as f32 / 2.0 - 1.0;
                tile(w, [across(k), across(k + 1)], [near, far], (ring + k) % 2);
            }
        }
    })
}

fn tile(w: &mut Work, [left, right]: [f32; 2], [near, far]: [f32; 2], color: usize) {
    let corners = [at(left, near, 0.0), at(right, near, 0.0), at(right, far, 0.0), at(left, far, 0.0)];
    let from = usize::from(near == 0.0);
    w.stone.polygon(&corners[from..], w.palette.floor[color]);
}
