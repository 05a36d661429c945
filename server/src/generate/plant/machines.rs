//! The plant's machines and vessels: shared meshes, most of them rich. Metres; they stand on y = 0 around the origin.
use super::stock::{DARK, GALVANISED, SAFETY_YELLOW, STEEL};
use crate::generate::glb_writer::{GlbWriter, MaterialId, MeshId};
use crate::generate::solid::{Color, Geometry, ring, srgb};
use glam::{Vec3, vec3};

const MACHINE_GREEN: Color = srgb(64, 128, 112);
const MOTOR_BLUE: Color = srgb(58, 98, 150);
const LAGGING: Color = srgb(204, 206, 204);
const CONCRETE: Color = srgb(160, 156, 148);

pub struct Machines {
    pub pump: MeshId,
    pub motor: MeshId,
    pub base: MeshId,
    pub vessel: MeshId,
    pub exchanger: MeshId,
    pub saddle: MeshId,
    pub ladder: MeshId,
    pub casing: MeshId,
    pub header: MeshId,
    pub burner: MeshId,
    pub turbine: MeshId,
    pub generator: MeshId,
    pub fan: MeshId,
}

impl Machines {
    pub fn new(glb: &mut GlbWriter, paint: MaterialId) -> Machines {
        let mut add = |name: &str, geometry: Geometry| glb.mesh(name, &[(&geometry, paint)]);
        Machines {
            pump: add("pump", pump()),
            motor: add("motor", motor()),
            base: add("base", base()),
            vessel: add("vessel", vessel()),
            exchanger: add("heat exchanger", exchanger()),
            saddle: add("saddle", saddle()),
            ladder: add("ladder", ladder()),
            casing: add("boiler casing", casing()),
            header: add("header", header()),
            burner: add("burner", burner()),
            turbine: add("turbine", turbine()),
            generator: add("generator", generator()),
            fan: add("fan", fan()),
        }
    }
}

/// Bolts on a circle about the vertical through `center`.
fn bolts(g: &mut Geometry, center: Vec3, radius: f32, count: usize, size: f32) {
    for corner in ring(count) {
        g.prism(center + vec3(corner.x, 0.0, corner.y) * radius, size, size, size * 1.6, 6, GALVANISED);
    }
}

/// A short pipe with a bolted flange, upright at `base`.
fn nozzle(g: &mut Geometry, base: Vec3, radius: f32, height: f32, color: Color) {
    let wide = radius * 1.7;
    let profile = [
        (radius, 0.0),
        (radius, height - 0.08),
        (wide, height - 0.08),
        (wide, height),
        (radius * 0.8, height),
        (0.0, height - 0.02),
    ];
    g.lathe(base, &profile, 24, color);
    bolts(g, base + vec3(0.0, height, 0.0), radius * 1.4, 8, radius * 0.14);
}

/// A centrifugal pump: volute, suction along +X, discharge upwards.
fn pump() -> Geometry {
    let mut upright = Geometry::default();
    let scroll = [
        (0.0, -0.3),
        (0.25, -0.3),
        (0.3, -0.24),
        (0.45, -0.22),
        (0.55, -0.16),
        (0.6, -0.05),
        (0.6, 0.05),
        (0.55, 0.16),
        (0.45, 0.22),
        (0.3, 0.24),
        (0.25, 0.3),
        (0.0, 0.3),
    ];
    upright.lathe(Vec3::ZERO, &scroll, 48, MACHINE_GREEN);
    bolts(&mut upright, vec3(0.0, 0.22, 0.0), 0.38, 16, 0.035);
    nozzle(&mut upright, vec3(0.0, 0.28, 0.0), 0.2, 0.4, MACHINE_GREEN);
    upright.lathe(
        vec3(0.0, -1.0, 0.0),
        &[(0.0, 0.0), (0.16, 0.0), (0.2, 0.1), (0.2, 0.5), (0.26, 0.6), (0.26, 0.75)],
        32,
        MACHINE_GREEN,
    );
    let mut g = Geometry::default();
    let axis_m = 0.75;
    g.copy(&upright.laid(), |p| p + vec3(0.0, axis_m, 0.0));
    nozzle(&mut g, vec3(0.0, axis_m + 0.4, 0.42), 0.17, 0.6, MACHINE_GREEN);
    for (x, z) in [(-0.8, -0.2), (-0.8, 0.2), (0.05, -0.3), (0.05, 0.3)] {
        g.block(vec3(x, 0.0, z), vec3(0.16, axis_m - 0.1, 0.1), MACHINE_GREEN);
    }
    g
}

/// An electric motor along X with cooling fins.
fn motor() -> Geometry {
    let mut upright = Geometry::default();
    upright.lathe(
        Vec3::ZERO,
        &[
            (0.0, -0.8),
            (0.06, -0.8),
            (0.06, -0.6),
            (0.36, -0.6),
            (0.4, -0.55),
            (0.4, 0.5),
            (0.36, 0.6),
            (0.42, 0.62),
            (0.42, 0.85),
            (0.0, 0.9),
        ],
        32,
        MOTOR_BLUE,
    );
    for fin in ring(48) {
        let (from, to) = (vec3(fin.x, 0.0, fin.y) * 0.39, vec3(fin.x, 0.0, fin.y) * 0.47);
        upright.bar(from, to, [0.02, 1.0], MOTOR_BLUE);
    }
    let mut g = Geometry::default();
    g.copy(&upright.laid(), |p| p + vec3(0.0, 0.75, 0.0));
    g.block(vec3(0.0, 0.0, 0.0), vec3(1.0, 0.36, 0.6), MOTOR_BLUE);
    g.cuboid(vec3(-0.25, 0.6, 0.4), vec3(0.25, 1.0, 0.65), MOTOR_BLUE);
    g
}

fn base() -> Geometry {
    let mut g = Geometry::default();
    g.block(Vec3::ZERO, vec3(3.4, 0.25, 1.4), CONCRETE);
    for z in [-0.5, 0.5] {
        g.cuboid(vec3(-1.5, 0.25, z - 0.08), vec3(1.5, 0.4, z + 0.08), STEEL);
        for k in 0..8 {
            g.prism(vec3(-1.4 + 0.4 * k as f32, 0.4, z), 0.03, 0.03, 0.08, 6, GALVANISED);
        }
    }
    g
}

/// A lagged pressure vessel, 2.4 m wide and 5.4 m high.
fn vessel() -> Geometry {
    let mut g = Geometry::default();
    let mut profile = vec![(0.0, 0.8), (0.5, 0.82), (0.9, 0.95), (1.12, 1.15), (1.2, 1.4)];
    for k in 0..6 {
        let y = 1.45 + 0.55 * k as f32;
        profile.extend([(1.2, y), (1.23, y + 0.02), (1.23, y + 0.08), (1.2, y + 0.1)]);
    }
    profile.extend([(1.2, 4.7), (1.12, 4.95), (0.9, 5.15), (0.5, 5.28), (0.0, 5.3)]);
    g.lathe(Vec3::ZERO, &profile, 32, LAGGING);
    for leg in ring(4) {
        let foot = vec3(leg.x, 0.0, leg.y);
        g.bar(foot, foot + vec3(0.0, 1.5, 0.0), [0.16, 0.16], STEEL);
        g.block(foot, vec3(0.35, 0.04, 0.35), STEEL);
    }
    for x in [-0.4, 0.4] {
        nozzle(&mut g, vec3(x, 5.1, 0.0), 0.13, 0.5, GALVANISED);
    }
    g.lathe(vec3(0.0, 5.2, -0.6), &[(0.28, 0.0), (0.28, 0.2), (0.36, 0.2), (0.36, 0.3), (0.0, 0.34)], 24, STEEL);
    bolts(&mut g, vec3(0.0, 5.5, -0.6), 0.32, 12, 0.025);
    g
}

/// A shell-and-tube heat exchanger along X, 6 m long, on the height of its saddles.
fn exchanger() -> Geometry {
    let mut upright = Geometry::default();
    let profile = [
        (0.0, -3.1),
        (0.3, -3.08),
        (0.5, -3.0),
        (0.6, -2.85),
        (0.6, -2.5),
        (0.75, -2.5),
        (0.75, -2.38),
        (0.6, -2.38),
        (0.6, -1.0),
        (0.63, -0.98),
        (0.63, -0.9),
        (0.6, -0.88),
        (0.6, 0.88),
        (0.63, 0.9),
        (0.63, 0.98),
        (0.6, 1.0),
        (0.6, 2.38),
        (0.75, 2.38),
        (0.75, 2.5),
        (0.6, 2.5),
        (0.6, 2.85),
        (0.5, 3.0),
        (0.3, 3.08),
        (0.0, 3.1),
    ];
    upright.lathe(Vec3::ZERO, &profile, 32, srgb(176, 120, 84));
    for y in [-2.55, 2.3] {
        bolts(&mut upright, vec3(0.0, y, 0.0), 0.68, 24, 0.04);
    }
    let mut g = Geometry::default();
    g.copy(&upright.laid(), |p| p + vec3(0.0, 1.4, 0.0));
    for x in [-2.0, -2.7, 2.0] {
        nozzle(&mut g, vec3(x, 1.9, 0.0), 0.15, 0.5, GALVANISED);
    }
    g
}

fn saddle() -> Geometry {
    let mut g = Geometry::default();
    g.block(Vec3::ZERO, vec3(0.4, 0.6, 1.3), CONCRETE);
    g.cuboid(vec3(-0.12, 0.6, -0.55), vec3(0.12, 1.1, 0.55), STEEL);
    for z in [-0.5, 0.5] {
        g.prism(vec3(0.0, 1.1, z), 0.03, 0.03, 0.1, 6, GALVANISED);
    }
    g
}

/// 5 m, caged.
fn ladder() -> Geometry {
    let mut g = Geometry::default();
    for x in [-0.25, 0.25] {
        g.tube(&[vec3(x, 0.0, 0.0), vec3(x, 6.0, 0.0)], 0.03, 8, SAFETY_YELLOW);
    }
    for k in 0..20 {
        let y = 0.25 + 0.28 * k as f32;
        g.tube(&[vec3(-0.25, y, 0.0), vec3(0.25, y, 0.0)], 0.015, 6, SAFETY_YELLOW);
    }
    let hoop: Vec<Vec3> = ring(16)[..9].iter().map(|c| vec3(c.x * 0.38, 0.0, c.y * 0.75)).collect();
    for k in 0..5 {
        let path: Vec<Vec3> = hoop.iter().map(|p| *p + vec3(0.0, 2.2 + 0.9 * k as f32, 0.0)).collect();
        g.tube(&path, 0.02, 6, SAFETY_YELLOW);
    }
    for k in [2, 4, 6] {
        g.tube(&[hoop[k] + vec3(0.0, 2.2, 0.0), hoop[k] + vec3(0.0, 5.8, 0.0)], 0.015, 6, SAFETY_YELLOW);
    }
    g
}

/// One storey of a boiler's wall of tubes, 7 m wide, 5.7 m high, with buckstays.
fn casing() -> Geometry {
    let mut g = Geometry::default();
    let rust = srgb(152, 104, 84);
    g.block(Vec3::ZERO, vec3(7.0, 5.7, 3.2), srgb(136, 92, 74));
    for k in 0..56 {
        let x = -3.44 + 0.125 * k as f32;
        for z in [-1.62, 1.62] {
            g.tube(&[vec3(x, 0.0, z), vec3(x, 5.7, z)], 0.055, 6, rust);
        }
    }
    for k in 0..4 {
        let y = 0.7 + 1.45 * k as f32;
        for z in [-1.8, 1.8] {
            g.bar(vec3(-3.7, y, z), vec3(3.7, y, z), [0.25, 0.3], STEEL);
        }
    }
    for (k, x) in [-2.0, 0.0, 2.0].into_iter().enumerate() {
        let y = 2.0 + 0.7 * (k % 2) as f32;
        g.cuboid(vec3(x - 0.3, y, 1.7), vec3(x + 0.3, y + 0.6, 1.85), DARK);
        g.tube(&[vec3(x, y + 0.3, 1.85), vec3(x, y + 0.3, 2.05)], 0.14, 16, GALVANISED);
    }
    g
}

/// A steam drum along X, 7 m long, with its risers.
fn header() -> Geometry {
    let mut upright = Geometry::default();
    upright.lathe(Vec3::ZERO, &[(0.0, -3.6), (0.3, -3.5), (0.42, -3.3), (0.42, 3.3), (0.3, 3.5), (0.0, 3.6)], 32, LAGGING);
    let mut g = upright.laid();
    for k in 0..24 {
        let x = -3.1 + 0.27 * k as f32;
        let side = if k % 2 == 0 { 1.0 } else { -1.0 };
        let path = [vec3(x, 0.2, 0.3 * side), vec3(x, 0.25, 0.7 * side), vec3(x, 0.05, 0.95 * side), vec3(x, -0.8, 1.05 * side)];
        g.tube(&path, 0.06, 8, LAGGING);
    }
    g
}

/// A burner's wind box and its gun, along +Z.
fn burner() -> Geometry {
    let mut upright = Geometry::default();
    upright.lathe(Vec3::ZERO, &[(0.75, 0.0), (0.75, 0.5), (0.6, 0.6), (0.6, 0.9), (0.3, 1.0), (0.3, 1.3), (0.0, 1.3)], 32, STEEL);
    bolts(&mut upright, vec3(0.0, 0.5, 0.0), 0.68, 16, 0.04);
    upright.tube(&[vec3(0.0, 1.2, 0.0), vec3(0.0, 2.2, 0.0)], 0.07, 12, GALVANISED);
    upright.tube(&[vec3(0.0, 2.0, 0.0), vec3(0.5, 2.1, 0.0), vec3(0.9, 2.6, 0.2)], 0.04, 8, DARK);
    let mut g = Geometry::default();
    g.copy(&upright, |p| vec3(p.x, -p.z, p.y));
    g
}

/// A steam turbine along X, 7 m long, split at its axis.
fn turbine() -> Geometry {
    let mut upright = Geometry::default();
    let profile = [
        (0.0, -3.5),
        (0.2, -3.5),
        (0.2, -3.1),
        (0.7, -3.1),
        (0.75, -2.9),
        (0.8, -2.2),
        (0.95, -2.1),
        (1.0, -1.6),
        (1.0, -1.2),
        (0.7, -1.1),
        (0.7, -0.8),
        (1.1, -0.6),
        (1.35, 0.0),
        (1.6, 0.7),
        (1.7, 1.2),
        (1.7, 1.8),
        (1.6, 2.1),
        (1.2, 2.5),
        (0.6, 2.8),
        (0.6, 3.2),
        (0.2, 3.2),
        (0.2, 3.5),
        (0.0, 3.5),
    ];
    upright.lathe(Vec3::ZERO, &profile, 48, srgb(96, 132, 120));
    let mut g = Geometry::default();
    g.copy(&upright.laid(), |p| p + vec3(0.0, 1.5, 0.0));
    for z in [-1.85, 1.85] {
        g.cuboid(vec3(-3.0, 1.35, z - 0.15), vec3(2.6, 1.6, z + 0.15), srgb(84, 118, 106));
        for k in 0..24 {
            g.prism(vec3(-2.9 + 0.23 * k as f32, 1.6, z), 0.06, 0.06, 0.16, 6, GALVANISED);
        }
    }
    for x in [-2.6, -1.0, 1.5] {
        g.block(vec3(x, 0.0, 0.0), vec3(0.7, 1.2, 3.2), CONCRETE);
    }
    g.tube(
        &[
            vec3(-2.2, 2.2, 0.0),
            vec3(-2.2, 3.0, 0.0),
            vec3(-1.9, 3.5, 0.0),
            vec3(-1.2, 3.7, 0.0),
            vec3(1.0, 3.7, 0.0),
            vec3(1.4, 3.5, 0.0),
            vec3(1.5, 3.0, 0.0),
        ],
        0.3,
        16,
        LAGGING,
    );
    g
}

fn generator() -> Geometry {
    let mut upright = Geometry::default();
    upright.lathe(
        Vec3::ZERO,
        &[
            (0.0, -3.0),
            (0.25, -3.0),
            (0.25, -2.4),
            (1.2, -2.4),
            (1.35, -2.2),
            (1.35, 2.2),
            (1.2, 2.4),
            (0.5, 2.4),
            (0.5, 3.0),
            (0.0, 3.1),
        ],
        48,
        MOTOR_BLUE,
    );
    let mut g = Geometry::default();
    g.copy(&upright.laid(), |p| p + vec3(0.0, 1.5, 0.0));
    for k in 0..12 {
        let x = -2.0 + 0.36 * k as f32;
        g.cuboid(vec3(x, 1.0, -1.45), vec3(x + 0.12, 2.1, 1.45), srgb(50, 86, 132));
    }
    g.block(Vec3::ZERO, vec3(5.0, 0.8, 2.6), CONCRETE);
    g.block(vec3(2.6, 0.8, 0.0), vec3(0.9, 1.4, 1.4), STEEL);
    g
}

/// A radial fan: scroll about X, outlet upwards.
fn fan() -> Geometry {
    let mut upright = Geometry::default();
    let profile =
        [(0.5, -0.75), (0.5, -0.5), (1.35, -0.5), (1.4, -0.45), (1.4, 0.45), (1.35, 0.5), (0.3, 0.5), (0.3, 0.8), (0.0, 0.8)];
    upright.lathe(Vec3::ZERO, &profile, 48, srgb(150, 160, 150));
    for spoke in ring(16) {
        let out = vec3(spoke.x, -0.55, spoke.y);
        upright.bar(vec3(0.0, -0.55, 0.0) + out * vec3(0.1, 0.0, 0.1), out * vec3(1.35, 1.0, 1.35), [0.06, 0.1], STEEL);
    }
    let mut g = Geometry::default();
    g.copy(&upright.laid(), |p| p + vec3(0.0, 1.6, 0.0));
    g.cuboid(vec3(-0.45, 1.8, 0.5), vec3(0.45, 3.6, 1.4), srgb(150, 160, 150));
    g.cuboid(vec3(-0.55, 3.4, 0.4), vec3(0.55, 3.5, 1.5), STEEL);
    g.block(vec3(0.0, 0.0, 0.0), vec3(1.4, 0.5, 2.2), CONCRETE);
    g
}
