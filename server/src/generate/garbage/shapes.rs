//! What the kinds of garbage are made of: smooth profiles, fine boxes, dents and creases.
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, ring};
use glam::{IVec3, Vec3, vec3};

/// Sides of everything turned.
pub const SIDES: usize = 32;

/// A curve through `points` (radius, height), `pieces` stretches from each to the next (Catmull, Rom 1974). Points given
/// twice make a corner. No radius gets below 0.
pub fn smooth(points: &[(f32, f32)], pieces: usize) -> Vec<(f32, f32)> {
    let last = points.len() - 1;
    let mut curve = vec![points[0]];
    for k in 0..last {
        let [a, b, c, d] = [points[k.saturating_sub(1)], points[k], points[k + 1], points[(k + 2).min(last)]];
        if b == c {
            continue;
        }
        let at = |t: f32, a: f32, b: f32, c: f32, d: f32| {
            0.5 * (2.0 * b + (c - a) * t + (2.0 * a - 5.0 * b + 4.0 * c - d) * t * t + (3.0 * b - a - 3.0 * c + d) * t * t * t)
        };
        for piece in 1..=pieces {
            let t = piece as f32 / pieces as f32;
            let point = if piece == pieces { c } else { (at(t, a.0, b.0, c.0, d.0).max(0.001), at(t, a.1, b.1, c.1, d.1)) };
            curve.push(point);
        }
    }
    curve
}

/// Half a circle of `radius` about height 0, from the bottom up, `bands` stretches: half of a [`ring`].
pub fn half_circle(radius: f32, bands: usize) -> Vec<(f32, f32)> {
    let ring = ring(2 * bands);
    // The ring starts at +X: turned by a quarter, which half of the bands are.
    let start = 2 * bands - bands / 2;
    (0..=bands)
        .map(|k| match k {
            0 => (0.0, -radius),
            _ if k == bands => (0.0, radius),
            _ => {
                let corner = ring[(start + k) % (2 * bands)];
                (corner.x * radius, corner.y * radius)
            }
        })
        .collect()
}

/// The surface that `profile` sweeps, each band in the colour that `color` gives for its number and side.
pub fn turn(g: &mut Geometry, profile: &[(f32, f32)], color: impl Fn(usize, usize) -> Color) {
    let first = g.colors.len();
    g.lathe(Vec3::ZERO, profile, SIDES, [0; 4]);
    // A band's sides follow each other, three or four corners each.
    let mut at = first;
    for (band, pair) in profile.windows(2).enumerate() {
        let corners = match (pair[0].0 == 0.0, pair[1].0 == 0.0) {
            (true, true) => continue,
            (false, false) => 4,
            _ => 3,
        };
        for side in 0..SIDES {
            g.colors[at..at + corners].fill(color(band, side));
            at += corners;
        }
    }
}

/// A box of `size` about the origin, each face `cells` by `cells` squares: 12 · `cells`² triangles. `color` is asked for
/// each square by its middle, in shares of the size from −0.5 to 0.5.
pub fn fine_box(g: &mut Geometry, size: Vec3, cells: usize, color: impl Fn(Vec3) -> Color) {
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let (out, mut right, mut up) = (axes[axis] * sign * 0.5, axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
            if sign < 0.0 {
                (right, up) = (up, right);
            }
            let at = |x: usize, y: usize| {
                let share = |k: usize| k as f32 / cells as f32 - 0.5;
                out + right * share(x) + up * share(y)
            };
            for k in 0..cells * cells {
                let (x, y) = (k % cells, k / cells);
                let corners = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
                let middle = (corners[0] + corners[2]) / 2.0;
                g.polygon(&corners.map(|corner| corner * size), color(middle));
            }
        }
    }
}

/// Moves every vertex by noise of up to `amount_m`, whose dents are about `dent_m` wide. Vertices at one place stay together.
pub fn crumple(g: &mut Geometry, amount_m: f32, dent_m: f32, random: &mut Random) {
    let seed = random.bits();
    for p in &mut g.positions {
        *p += noise(*p / dent_m, seed) * amount_m;
    }
}

/// Vectors within the unit cube on the whole numbers, and straight between them.
fn noise(p: Vec3, seed: u64) -> Vec3 {
    let low = p.floor();
    let share = p - low;
    let mut sum = Vec3::ZERO;
    for corner in 0..8 {
        let offset = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
        let part = Vec3::select(offset.cmpeq(IVec3::ONE), share, Vec3::ONE - share);
        let at = low.as_ivec3() + offset;
        let key = [at.x, at.y, at.z].iter().fold(seed, |key, c| key.wrapping_mul(0x0100_0000_01B3) ^ u64::from(*c as u32));
        let mut random = Random::new(key);
        let value = vec3(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0));
        sum += value * part.element_product();
    }
    sum
}

/// A flat plate of exactly `triangles`, at least 2: stripes from left to right, two triangles each, and one more where
/// the number is odd.
pub fn plate(g: &mut Geometry, corners: [Vec3; 4], triangles: usize, color: Color) {
    let [a, b, c, d] = corners;
    let stripes = triangles / 2;
    let at = |from: Vec3, to: Vec3, k: usize| from + (to - from) * (k as f32 / stripes as f32);
    for k in 0..stripes {
        let (low, high) = ([at(a, b, k), at(a, b, k + 1)], [at(d, c, k), at(d, c, k + 1)]);
        if k == 0 && triangles % 2 == 1 {
            g.polygon(&[low[0], low[1], high[1], high[0], (low[0] + high[0]) / 2.0], color);
        } else {
            g.polygon(&[low[0], low[1], high[1], high[0]], color);
        }
    }
}
