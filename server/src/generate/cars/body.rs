//! The body: a shell lofted over cross-sections, with openings for windows and wheels, an inner shell, a floor and bumpers.
use super::Model;
use super::parts::{IRON, RUBBER};
use super::running_gear::{WHEEL_M, axles};
use crate::generate::solid::{Color, Geometry, srgb};
use glam::{Vec3, vec3};

/// Cells of the outer shell: along the car, and from sill to sill.
const OUTER: [usize; 2] = [60, 44];
const INNER: [usize; 2] = [40, 30];
/// Between the shells.
const GAP_M: f32 = 0.04;
const SILL_M: f32 = 0.24;
const BELT_M: f32 = 0.9;
/// Shares of a half section, from the sill to the middle of the roof: flank, side windows, roof.
const FLANK: f32 = 0.45;
const ROOF: f32 = 0.72;

/// 0 to 1 while `x` goes from `low` to `high`, smooth at both ends.
fn smooth(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Height of the shell's middle line at `u` along the car, 0 the tail.
fn top_m(model: &Model, u: f32) -> f32 {
    let [tail, rear, front, bonnet] = model.cabin;
    let nose = 0.72 + 0.26 * smooth(1.0, bonnet, u);
    let boot = model.tail_m - 0.12 * smooth(tail, 0.0, u);
    let low = if u > 0.5 { nose } else { boot };
    low + (model.height_m - low) * smooth(tail, rear, u) * smooth(bonnet, front, u)
}

/// A point of the shell: `u` along the car, `v` from the left sill over the roof to the right one, both 0 to 1.
fn shell(model: &Model, u: f32, v: f32) -> Vec3 {
    let side = 2.0 * v - 1.0;
    let k = 1.0 - side.abs();
    let ends = (2.0 * u - 1.0) * (2.0 * u - 1.0);
    let half = model.width_m / 2.0 * (1.0 - 0.16 * ends * ends);
    let top = top_m(model, u);
    let belt = BELT_M.min(top - 0.05);
    let shoulder = half - 0.22 * (top - belt);
    let (y, z) = if k < FLANK {
        let t = k / FLANK;
        (SILL_M + (belt - SILL_M) * t, half * (1.0 - 0.09 * (t - 0.6) * (t - 0.6) * 4.0))
    } else if k < ROOF {
        let t = (k - FLANK) / (ROOF - FLANK);
        (belt + (top - 0.05 - belt) * t, half * 0.942 + (shoulder - 0.04 - half * 0.942) * t)
    } else {
        let t = (k - ROOF) / (1.0 - ROOF);
        (top - 0.05 * (1.0 - t) * (1.0 - t), (shoulder - 0.04) * (1.0 - t))
    };
    vec3((u - 0.5) * model.length_m, y, z * side.signum())
}

/// Whether a place of the shell is an opening.
fn is_open(model: &Model, u: f32, v: f32) -> bool {
    let k = 1.0 - (2.0 * v - 1.0).abs();
    let [tail, rear, front, bonnet] = model.cabin;
    let side_window = k > FLANK + 0.02 && k < ROOF - 0.03 && u > rear + 0.02 && u < front - 0.01;
    let pillar = (u - (rear + front) / 2.0).abs() < 0.012;
    let screen = k > ROOF + 0.03 && (u > front + 0.02 && u < bonnet - 0.03 || u > tail + 0.02 && u < rear - 0.02);
    let p = shell(model, u, v);
    let wheel = k < FLANK
        && axles(model).into_iter().any(|x| {
            let (dx, dy) = (p.x - x, p.y - WHEEL_M);
            dx * dx + dy * dy < (WHEEL_M + 0.06) * (WHEEL_M + 0.06)
        });
    side_window && !pillar || screen || wheel
}

/// The part of the shell that is no opening, `inwards_m` in from it, seen from outside or from within.
fn skin(model: &Model, cells: [usize; 2], inwards_m: f32, from_within: bool, color: Color) -> Geometry {
    let mut g = Geometry::default();
    let share = |k: usize, count: usize| k as f32 / count as f32;
    let normal = |u: f32, v: f32| {
        let d = 0.004;
        let along = shell(model, (u + d).min(1.0), v) - shell(model, (u - d).max(0.0), v);
        let over = shell(model, u, (v + d).min(1.0)) - shell(model, u, (v - d).max(0.0));
        over.cross(along).normalize_or(Vec3::Y)
    };
    for x in 0..=cells[0] {
        for y in 0..=cells[1] {
            let (u, v) = (share(x, cells[0]), share(y, cells[1]));
            let out = normal(u, v);
            g.positions.push(shell(model, u, v) - out * inwards_m);
            g.normals.push(if from_within { -out } else { out });
            g.colors.push(color);
        }
    }
    let index = |x: usize, y: usize| (x * (cells[1] + 1) + y) as u32;
    for x in 0..cells[0] {
        for y in 0..cells[1] {
            if is_open(model, (x as f32 + 0.5) / cells[0] as f32, (y as f32 + 0.5) / cells[1] as f32) {
                continue;
            }
            let mut corners = [index(x, y), index(x + 1, y), index(x + 1, y + 1), index(x, y + 1)];
            if !from_within {
                corners.reverse();
            }
            let [a, b, c, d] = corners;
            g.indices.extend([a, b, c, a, c, d]);
        }
    }
    g
}

/// Wings, doors, bonnet, roof and lid.
pub fn outer(model: &Model) -> Geometry {
    skin(model, OUTER, 0.0, false, model.lacquer)
}

/// What is behind them.
pub fn inner(model: &Model) -> Geometry {
    skin(model, INNER, GAP_M, true, srgb(70, 70, 74))
}

/// A ribbed floor with a tunnel, both sides of it.
pub fn floor(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    let half = vec3(model.length_m * 0.49, 0.0, model.width_m * 0.44);
    let [nx, nz] = [24, 12];
    let height = |x: usize, z: usize| {
        let tunnel = if z == nz / 2 && x < 2 * nx / 3 { 0.16 } else { 0.0 };
        SILL_M + 0.02 + tunnel + if x.is_multiple_of(2) { 0.02 } else { 0.0 }
    };
    let at = |x: usize, z: usize| {
        let share = vec3(2.0 * x as f32 / nx as f32 - 1.0, 0.0, 2.0 * z as f32 / nz as f32 - 1.0);
        half * share + vec3(0.0, height(x, z), 0.0)
    };
    let is_arch = |p: Vec3| axles(model).into_iter().any(|x| (p.x - x).abs() < WHEEL_M + 0.05 && p.z.abs() > half.z - 0.25);
    for x in 0..nx {
        for z in 0..nz {
            let corners = [at(x, z), at(x, z + 1), at(x + 1, z + 1), at(x + 1, z)];
            if is_arch((corners[0] + corners[2]) / 2.0) {
                continue;
            }
            g.polygon(&corners, IRON);
            let below = corners.map(|p| p - vec3(0.0, 0.015, 0.0));
            g.polygon(&[below[3], below[2], below[1], below[0]], IRON);
        }
    }
    g
}

/// Bumpers, sills, a grille of slats and lamps; they close the shell's ends.
pub fn bumpers(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    let half = vec3(model.length_m / 2.0, 0.0, model.width_m / 2.0 * 0.84);
    for (end, top) in [(half.x, top_m(model, 1.0)), (-half.x, top_m(model, 0.0))] {
        let out = end.signum();
        let block = |g: &mut Geometry, [x0, x1]: [f32; 2], [y0, y1]: [f32; 2], [z0, z1]: [f32; 2], color: Color| {
            let (a, b) = (end + out * x0, end + out * x1);
            super::parts::fine_cuboid(g, vec3(a.min(b), y0, z0), vec3(a.max(b), y1, z1), 0.08, color);
        };
        block(&mut g, [-0.06, 0.1], [0.26, 0.5], [-half.z, half.z], RUBBER);
        block(&mut g, [-0.03, 0.0], [top - 0.08, top - 0.05], [-half.z, half.z], model.lacquer);
        for side in [-1.0f32, 1.0] {
            let z = [side * half.z, side * (half.z - 0.3)];
            let z = [z[0].min(z[1]), z[0].max(z[1])];
            let glow = if out > 0.0 { srgb(248, 244, 226) } else { srgb(186, 30, 26) };
            block(&mut g, [-0.05, 0.03], [0.52, top - 0.08], z, glow);
        }
        for slat in 0..8 {
            let y = 0.51 + (top - 0.61) * slat as f32 / 8.0;
            let color = if out > 0.0 { RUBBER } else { model.lacquer };
            let depth = if out > 0.0 { 0.012 } else { (top - 0.61) / 8.0 };
            block(&mut g, [-0.03, 0.0], [y, y + depth], [-half.z + 0.3, half.z - 0.3], color);
        }
    }
    for side in [-1.0, 1.0] {
        let z = side * model.width_m * 0.44;
        let [rear, front] = axles(model);
        let from = vec3(rear + WHEEL_M + 0.1, SILL_M, z);
        g.bar(from, vec3(front - WHEEL_M - 0.1, SILL_M, z), [0.12, 0.1], model.lacquer);
    }
    g
}
