//! Wheels, brakes, struts and the exhaust.
use super::Model;
use super::parts::{ALUMINIUM, IRON, RUBBER, STEEL, across, hose, spring};
use crate::generate::solid::{Geometry, ring, srgb};
use glam::{Vec3, vec3};

/// Radius of a wheel with its tyre.
pub const WHEEL_M: f32 = 0.31;

/// Where the axles are along the car: rear, front.
pub fn axles(model: &Model) -> [f32; 2] {
    let front = model.length_m / 2.0 - 0.82;
    [front - model.wheelbase_m, front]
}

/// The four wheels by name and middle.
pub fn wheels(model: &Model) -> [(&'static str, Vec3); 4] {
    let [rear, front] = axles(model);
    let z = model.width_m / 2.0 - 0.12;
    [
        ("wheel rear left", vec3(rear, WHEEL_M, -z)),
        ("wheel rear right", vec3(rear, WHEEL_M, z)),
        ("wheel front left", vec3(front, WHEEL_M, -z)),
        ("wheel front right", vec3(front, WHEEL_M, z)),
    ]
}

/// Tyre with tread, rim with spokes, ventilated disc, caliper. About Z.
pub fn wheel() -> Geometry {
    let mut g = Geometry::default();
    let tyre = [
        (0.2, -0.09),
        (0.23, -0.1),
        (0.28, -0.1),
        (0.3, -0.085),
        (0.305, -0.05),
        (0.305, 0.05),
        (0.3, 0.085),
        (0.28, 0.1),
        (0.23, 0.1),
        (0.2, 0.09),
        (0.2, -0.09),
    ];
    g.lathe(Vec3::ZERO, &tyre, 48, RUBBER);
    for (k, corner) in ring(48).into_iter().enumerate() {
        let out = vec3(corner.x, 0.0, -corner.y);
        for row in [-0.06, -0.02, 0.02, 0.06] {
            let shift = if k % 2 == 0 { 0.008 } else { -0.008 };
            let at = out * 0.304 + vec3(0.0, row + shift, 0.0);
            g.bar(at, at + out * 0.006, [0.03, 0.03], RUBBER);
        }
    }
    let rim = [(0.199, -0.08), (0.18, -0.07), (0.17, 0.0), (0.18, 0.07), (0.199, 0.08)];
    g.lathe(Vec3::ZERO, &rim, 48, ALUMINIUM);
    let inside: Vec<(f32, f32)> = rim.iter().rev().map(|(r, y)| (r - 0.004, *y)).collect();
    g.lathe(Vec3::ZERO, &inside, 48, ALUMINIUM);
    for side in [-0.05, 0.05] {
        for corner in ring(6) {
            let out = vec3(corner.x, 0.0, corner.y);
            g.bar(out * 0.03 + vec3(0.0, side, 0.0), out * 0.175 + vec3(0.0, side, 0.0), [0.03, 0.02], ALUMINIUM);
        }
        g.lathe(vec3(0.0, side, 0.0), &[(0.0, -0.02), (0.05, -0.02), (0.055, 0.0), (0.05, 0.02), (0.0, 0.02)], 32, STEEL);
    }
    for face in [-0.014, 0.008] {
        g.lathe(vec3(0.0, face, 0.0), &[(0.06, 0.0), (0.14, 0.0), (0.14, 0.006), (0.06, 0.006), (0.06, 0.0)], 48, IRON);
    }
    for corner in ring(48) {
        let out = vec3(corner.x, 0.0, corner.y);
        g.bar(out * 0.07, out * 0.138, [0.004, 0.016], IRON);
    }
    g.cuboid(vec3(0.1, -0.04, -0.05), vec3(0.16, 0.04, 0.05), srgb(170, 40, 36));
    across(g)
}

/// A spring and a damper over a wheel, and the arm below.
pub fn strut() -> Geometry {
    let mut g = Geometry::default();
    let damper = [(0.0, 0.0), (0.025, 0.0), (0.025, 0.2), (0.012, 0.21), (0.012, 0.4), (0.05, 0.41), (0.05, 0.42), (0.0, 0.43)];
    g.lathe(Vec3::ZERO, &damper, 24, IRON);
    spring(&mut g, vec3(0.0, 0.18, 0.0), [0.05, 0.006, 0.22], 8, srgb(60, 90, 160));
    for x in [-0.2, 0.2] {
        g.tube(&[vec3(0.0, -0.1, 0.0), vec3(x * 0.5, -0.1, 0.0), vec3(x, -0.09, 0.0)], 0.014, 16, IRON);
    }
    g
}

/// Pipe, silencers and a perforated core in each.
pub fn exhaust(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    let [rear, front] = axles(model);
    let y = 0.2;
    let path = [
        vec3(front - 0.15, 0.34, -0.2),
        vec3(front - 0.5, y, -0.1),
        vec3(0.0, y, 0.0),
        vec3(rear + 0.3, y + 0.04, 0.2),
        vec3(rear - 0.5, y + 0.06, 0.35),
    ];
    hose(&mut g, &path, 0.025, [16, 24], STEEL);
    for (x, z, length, radius) in [(0.1, 0.0, 0.5, 0.07), (rear - 0.35, 0.33, 0.35, 0.1)] {
        let mut can = Geometry::default();
        let half = length / 2.0;
        can.lathe(Vec3::ZERO, &[(0.0, -half), (radius, -half + 0.02), (radius, half - 0.02), (0.0, half)], 32, STEEL);
        for ring_of_holes in 0..6 {
            let at = vec3(0.0, -half + length * (ring_of_holes as f32 + 0.5) / 6.0, 0.0);
            can.torus(at, radius * 0.5, 0.006, [24, 8], IRON);
        }
        g.copy(&can.laid(), |p| p + vec3(x, y, z));
    }
    g
}
