//! What several parts of a car are made of.
use crate::generate::solid::{Color, Geometry, ring, srgb};
use glam::{Vec3, vec3};

pub const STEEL: Color = srgb(150, 154, 158);
pub const IRON: Color = srgb(92, 94, 98);
pub const ALUMINIUM: Color = srgb(190, 192, 194);
pub const RUBBER: Color = srgb(34, 34, 36);
pub const COPPER: Color = srgb(186, 112, 66);

/// A box whose faces are divided into squares of about `step` metres, `low` to `high`.
pub fn fine_cuboid(g: &mut Geometry, low: Vec3, high: Vec3, step: f32, color: Color) {
    let size = high - low;
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    for axis in 0..3 {
        for ahead in [false, true] {
            let (mut right, mut up) = (axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
            if !ahead {
                (right, up) = (up, right);
            }
            let corner = if ahead { low + axes[axis] * size } else { low };
            let count = |along: Vec3| ((size * along).length() / step).round().max(1.0) as usize;
            let (nx, ny) = (count(right), count(up));
            let at = |x: usize, y: usize| corner + size * (right * (x as f32 / nx as f32) + up * (y as f32 / ny as f32));
            for k in 0..nx * ny {
                let (x, y) = (k % nx, k / nx);
                g.polygon(&[at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)], color);
            }
        }
    }
}

/// A spring about the vertical through `base`: `turns` of wire.
pub fn spring(g: &mut Geometry, base: Vec3, [radius, wire, height]: [f32; 3], turns: usize, color: Color) {
    const A_TURN: usize = 12;
    let ring = ring(A_TURN);
    let path: Vec<Vec3> = (0..=turns * A_TURN)
        .map(|k| {
            let corner = ring[k % A_TURN] * radius;
            base + vec3(corner.x, height * k as f32 / (turns * A_TURN) as f32, -corner.y)
        })
        .collect();
    g.tube(&path, wire, 8, color);
}

/// A pipe through points, rounded at each by points between.
pub fn hose(g: &mut Geometry, points: &[Vec3], radius: f32, [pieces, sides]: [usize; 2], color: Color) {
    let last = points.len() - 1;
    let mut path = vec![points[0]];
    for k in 0..last {
        let [a, b, c, d] = [points[k.saturating_sub(1)], points[k], points[k + 1], points[(k + 2).min(last)]];
        for piece in 1..=pieces {
            let t = piece as f32 / pieces as f32;
            let (t2, t3) = (t * t, t * t * t);
            path.push((b * 2.0 + (c - a) * t + (a * 2.0 - b * 5.0 + c * 4.0 - d) * t2 + (b * 3.0 - a - c * 3.0 + d) * t3) * 0.5);
        }
    }
    g.tube(&path, radius, sides, color);
}

/// Hexagonal heads along a line, upright.
pub fn bolts(g: &mut Geometry, from: Vec3, to: Vec3, count: usize, size: f32) {
    for k in 0..count {
        let at = from + (to - from) * ((k as f32 + 0.5) / count as f32);
        g.prism(at, size, size, size * 1.2, 6, STEEL);
    }
}

/// What stood along +Y lies along Z.
pub fn across(g: Geometry) -> Geometry {
    let mut g = g;
    g.positions.iter_mut().for_each(|p| *p = vec3(p.x, -p.z, p.y));
    g
}
