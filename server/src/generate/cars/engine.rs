//! The engine with all that is in it, the gearbox, the radiator and the wiring. An engine's origin is the middle of its block; it stands along
//! the car.
use super::Model;
use super::parts::{ALUMINIUM, COPPER, IRON, RUBBER, STEEL, bolts, fine_cuboid, hose, spring};
use super::running_gear::axles;
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, ring, srgb};
use glam::{Vec3, vec3};

const RED: Color = srgb(150, 40, 34);
const BLOCK: Vec3 = vec3(0.5, 0.34, 0.3);
/// Height of a cylinder head above the block's middle.
const HEAD_M: f32 = 0.17;

/// Where the block's middle is in the car.
pub fn middle(model: &Model) -> Vec3 {
    vec3(axles(model)[1] - 0.02, 0.52, 0.0)
}

/// Where the cylinders stand along the block.
fn cylinders(model: &Model) -> impl Iterator<Item = f32> {
    let count = model.cylinders;
    (0..count).map(move |k| BLOCK.x * ((k as f32 + 0.5) / count as f32 - 0.5))
}

/// Block, head, cover, sump and their bolts.
pub fn block(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    let half = BLOCK / 2.0;
    fine_cuboid(&mut g, -half, half, 0.03, IRON);
    fine_cuboid(&mut g, vec3(-half.x, HEAD_M, -0.12), vec3(half.x, HEAD_M + 0.1, 0.12), 0.03, ALUMINIUM);
    fine_cuboid(&mut g, vec3(-half.x + 0.02, HEAD_M + 0.1, -0.09), vec3(half.x - 0.02, HEAD_M + 0.15, 0.09), 0.03, RED);
    fine_cuboid(&mut g, vec3(-half.x + 0.03, -half.y - 0.12, -0.13), vec3(half.x - 0.1, -half.y, 0.13), 0.03, STEEL);
    for z in [-0.13, -0.1, 0.1, 0.13] {
        bolts(&mut g, vec3(-half.x, HEAD_M + 0.1, z), vec3(half.x, HEAD_M + 0.1, z), 16, 0.008);
        bolts(&mut g, vec3(-half.x, -half.y, z), vec3(half.x, -half.y, z), 20, 0.006);
    }
    for x in cylinders(model) {
        // Ribs of the casting, and a plug with its lead.
        for z in [-1.0, 1.0] {
            for rib in 0..4 {
                let at = vec3(x + 0.01 * rib as f32, 0.0, z * (half.z + 0.006));
                fine_cuboid(&mut g, at - vec3(0.002, 0.14, 0.006), at + vec3(0.002, 0.14, 0.006), 0.03, IRON);
            }
        }
        g.lathe(
            vec3(x, HEAD_M + 0.15, 0.0),
            &[(0.014, 0.0), (0.014, 0.02), (0.01, 0.03), (0.01, 0.06), (0.0, 0.065)],
            16,
            RUBBER,
        );
        hose(
            &mut g,
            &[vec3(x, HEAD_M + 0.21, 0.0), vec3(x + 0.02, HEAD_M + 0.25, 0.04), vec3(-0.2, HEAD_M + 0.22, 0.1)],
            0.004,
            [10, 8],
            RUBBER,
        );
    }
    g
}

/// Pistons, rods and the crankshaft.
pub fn pistons(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    let stroke = ring(12);
    let crank_y = -0.14;
    let mut shaft = Geometry::default();
    let mut profile = vec![(0.0, -0.3), (0.024, -0.3)];
    profile.extend((0..28).map(|k| (if k % 2 == 0 { 0.03 } else { 0.024 }, -0.29 + 0.02 * k as f32)));
    profile.extend([(0.024, 0.3), (0.0, 0.3)]);
    shaft.lathe(Vec3::ZERO, &profile, 24, STEEL);
    g.copy(&shaft.laid(), |p| p + vec3(0.0, crank_y, 0.0));
    for (k, x) in cylinders(model).enumerate() {
        let pin = stroke[(5 * k) % 12] * 0.04;
        let y = 0.04 + pin.x;
        let crown = [
            (0.0, -0.02),
            (0.03, -0.02),
            (0.034, -0.03),
            (0.034, 0.0),
            (0.031, 0.001),
            (0.031, 0.005),
            (0.034, 0.006),
            (0.034, 0.01),
            (0.031, 0.011),
            (0.031, 0.015),
            (0.034, 0.016),
            (0.034, 0.03),
            (0.0, 0.032),
        ];
        g.lathe(vec3(x, y, 0.0), &crown, 32, ALUMINIUM);
        g.bar(vec3(x, crank_y + 0.04 * pin.x, pin.y), vec3(x, y - 0.02, 0.0), [0.02, 0.016], STEEL);
        for side in [-0.018, 0.018] {
            let mut web = Geometry::default();
            web.lathe(Vec3::ZERO, &[(0.0, -0.006), (0.05, -0.006), (0.055, 0.0), (0.05, 0.006), (0.0, 0.006)], 24, STEEL);
            g.copy(&web.laid(), |p| p + vec3(x + side, crank_y - pin.x * 0.3, pin.y * 0.3));
        }
        g.lathe(vec3(x, -0.08, 0.0), &[(0.036, 0.0), (0.036, 0.2), (0.04, 0.2), (0.04, 0.0), (0.036, 0.0)], 32, IRON);
    }
    g
}

/// Four valves a cylinder with their springs, two camshafts.
pub fn valves(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    let valve = [
        (0.0, 0.0),
        (0.015, 0.0),
        (0.016, 0.003),
        (0.008, 0.01),
        (0.004, 0.018),
        (0.003, 0.03),
        (0.003, 0.09),
        (0.004, 0.092),
        (0.011, 0.094),
        (0.011, 0.098),
        (0.0, 0.1),
    ];
    for x in cylinders(model) {
        for (dx, z) in [(-0.016, -0.04), (0.016, -0.04), (-0.016, 0.04), (0.016, 0.04)] {
            let at = vec3(x + dx, HEAD_M - 0.01, z);
            g.lathe(at, &valve, 16, STEEL);
            spring(&mut g, at + vec3(0.0, 0.04, 0.0), [0.01, 0.0018, 0.05], 4, STEEL);
        }
    }
    for z in [-0.04, 0.04] {
        let mut cam = Geometry::default();
        let count = model.cylinders * 6;
        let mut profile = vec![(0.0, -0.26)];
        profile.extend((0..=count).map(|k| (if k % 3 == 1 { 0.018 } else { 0.011 }, -0.26 + 0.52 * k as f32 / count as f32)));
        profile.push((0.0, 0.26));
        cam.lathe(Vec3::ZERO, &profile, 24, STEEL);
        g.copy(&cam.laid(), |p| p + vec3(0.0, HEAD_M + 0.115, z));
    }
    g
}

/// Pipes to and from each cylinder, with flanges, injectors and heat shields.
pub fn manifolds(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    for x in cylinders(model) {
        let head = vec3(x, HEAD_M + 0.05, 0.12);
        hose(
            &mut g,
            &[head, head + vec3(0.0, 0.02, 0.08), head + vec3(0.02, 0.12, 0.12), vec3(x * 0.9, 0.36, 0.12)],
            0.02,
            [10, 16],
            ALUMINIUM,
        );
        let out = vec3(x, HEAD_M + 0.05, -0.12);
        hose(
            &mut g,
            &[out, out + vec3(0.0, -0.01, -0.07), vec3(x * 0.7, 0.02, -0.22), vec3(-0.12, -0.16, -0.2)],
            0.018,
            [10, 16],
            srgb(128, 96, 70),
        );
        g.lathe(head + vec3(0.0, 0.05, 0.03), &[(0.008, 0.0), (0.01, 0.01), (0.007, 0.02), (0.007, 0.05), (0.0, 0.052)], 16, RED);
        for side in [-0.12, 0.12] {
            fine_cuboid(
                &mut g,
                vec3(x - 0.03, HEAD_M + 0.02, side - 0.004),
                vec3(x + 0.03, HEAD_M + 0.08, side + 0.004),
                0.015,
                IRON,
            );
        }
    }
    let plenum = [(0.0, -0.26), (0.05, -0.25), (0.06, -0.2), (0.06, 0.2), (0.05, 0.25), (0.0, 0.26)];
    let mut along = Geometry::default();
    along.lathe(Vec3::ZERO, &plenum, 32, ALUMINIUM);
    g.copy(&along.laid(), |p| p + vec3(0.0, 0.36, 0.12));
    g
}

/// What the belt drives, the belt itself, starter and filter.
pub fn ancillaries() -> Geometry {
    let mut g = Geometry::default();
    let front = BLOCK.x / 2.0;
    let grooves = |radius: f32| {
        let mut profile = vec![(0.0, 0.0), (radius, 0.0)];
        profile.extend((0..12).map(|k| (radius - if k % 2 == 0 { 0.0 } else { 0.004 }, 0.002 * (k + 1) as f32)));
        profile.extend([(radius, 0.026), (0.0, 0.026)]);
        profile
    };
    let pulleys = [(0.07, -0.14, 0.0), (0.03, 0.05, 0.18), (0.05, -0.02, -0.16), (0.045, 0.14, 0.0), (0.025, -0.03, 0.09)];
    for (radius, y, z) in pulleys {
        let mut pulley = Geometry::default();
        pulley.lathe(Vec3::ZERO, &grooves(radius), 32, STEEL);
        g.copy(&pulley.laid(), |p| p + vec3(front + 0.02, y, z));
    }
    let path: Vec<Vec3> = pulleys.iter().map(|(radius, y, z)| vec3(front + 0.033, y + radius * 0.7, z + radius * 0.7)).collect();
    hose(&mut g, &[path[0], path[2], path[3], path[1], path[4], path[0]], 0.006, [16, 8], RUBBER);
    for (at, radius, length) in
        [(vec3(0.14, 0.05, 0.2), 0.07, 0.14), (vec3(0.12, -0.02, -0.2), 0.065, 0.16), (vec3(-0.2, -0.08, 0.18), 0.04, 0.18)]
    {
        let mut machine = Geometry::default();
        let half = length / 2.0;
        let mut profile = vec![(0.0, -half), (radius * 0.6, -half)];
        profile.extend((0..24).map(|k| (radius - if k % 2 == 0 { 0.0 } else { 0.006 }, -half + length * (k + 1) as f32 / 26.0)));
        profile.extend([(radius * 0.6, half), (0.0, half)]);
        machine.lathe(Vec3::ZERO, &profile, 32, ALUMINIUM);
        for corner in ring(12) {
            machine.prism(vec3(corner.x * radius * 0.8, half, corner.y * radius * 0.8), 0.005, 0.005, 0.008, 6, STEEL);
        }
        g.copy(&machine.laid(), |p| p + at);
    }
    g.lathe(vec3(0.0, -0.2, 0.2), &[(0.0, 0.0), (0.04, 0.0), (0.045, 0.01), (0.045, 0.09), (0.035, 0.1), (0.0, 0.1)], 48, RED);
    g
}

/// A casing with ribs, two shafts and their toothed wheels.
pub fn gearbox() -> Geometry {
    let mut g = Geometry::default();
    let start = -BLOCK.x / 2.0;
    let mut case = Geometry::default();
    let mut profile = vec![(0.19, 0.0), (0.19, -0.02)];
    profile.extend((0..40).map(|k| (0.17 - 0.0028 * k as f32 + if k % 4 == 0 { 0.01 } else { 0.0 }, -0.03 - 0.012 * k as f32)));
    profile.push((0.0, -0.53));
    profile.reverse();
    case.lathe(Vec3::ZERO, &profile, 32, ALUMINIUM);
    g.copy(&case.laid(), |p| p + vec3(start, -0.06, 0.0));
    for (shaft, z) in [-0.035f32, 0.035].into_iter().enumerate() {
        for wheel in 0..6 {
            let radius = if shaft == 0 { 0.03 + 0.006 * wheel as f32 } else { 0.066 - 0.006 * wheel as f32 };
            let at = vec3(start - 0.08 - 0.05 * wheel as f32, -0.06, z * 1.3);
            let mut gear = Geometry::default();
            gear.lathe(Vec3::ZERO, &[(0.012, -0.012), (radius, -0.012), (radius, 0.012), (0.012, 0.012)], 32, STEEL);
            for corner in ring(32) {
                let out = vec3(corner.x, 0.0, corner.y);
                gear.bar(out * radius, out * (radius + 0.006), [0.004, 0.024], STEEL);
            }
            g.copy(&gear.laid(), |p| p + at);
        }
    }
    g
}

/// Tubes and folded fins between two tanks, behind a fan.
pub fn radiator(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    let x = model.length_m / 2.0 - 0.22;
    let (low, high, half_z) = (0.34, 0.68, 0.3);
    for y in [low - 0.05, high] {
        fine_cuboid(&mut g, vec3(x - 0.03, y, -half_z), vec3(x + 0.03, y + 0.05, half_z), 0.03, ALUMINIUM);
    }
    const TUBES: usize = 36;
    const FINS: usize = 26;
    for tube in 0..=TUBES {
        let z = half_z * (2.0 * tube as f32 / TUBES as f32 - 1.0);
        g.tube(&[vec3(x, low, z), vec3(x, high, z)], 0.004, 8, ALUMINIUM);
        for fin in 0..FINS {
            let y = low + (high - low) * (fin as f32 + 0.5) / FINS as f32;
            if tube < TUBES {
                fine_cuboid(&mut g, vec3(x - 0.02, y, z + 0.004), vec3(x + 0.02, y + 0.0008, z + 0.013), 0.1, COPPER);
            }
        }
    }
    let hub = vec3(x - 0.1, (low + high) / 2.0, 0.0);
    for corner in ring(8) {
        let out = vec3(0.0, corner.x, corner.y);
        g.bar(hub + out * 0.02, hub + out * 0.16 + vec3(0.02, 0.0, 0.0), [0.05, 0.006], RUBBER);
    }
    let bay = middle(model);
    for (y, z) in [(high - 0.02, 0.2), (low + 0.02, -0.2)] {
        let start = vec3(x - 0.03, y, z);
        let end = bay + vec3(0.25, y - 0.5, z * 0.4);
        hose(
            &mut g,
            &[start, start - vec3(0.08, 0.02, 0.0), (start + end) / 2.0 - vec3(0.0, 0.04, 0.0), end],
            0.022,
            [14, 16],
            RUBBER,
        );
    }
    g
}

/// The loom: bundles of cable through the engine bay and along the sills, no two cars alike.
pub fn wiring(model: &Model, random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    let bay = middle(model);
    let colors = [srgb(170, 40, 36), srgb(40, 40, 44), srgb(60, 90, 160), srgb(200, 170, 60), srgb(70, 130, 80)];
    for cable in 0..16 {
        let color = colors[cable % colors.len()];
        let mut jitter = |by: f32| vec3(random.range(-by, by), random.range(-by, by), random.range(-by, by));
        let path: Vec<Vec3> = if cable < 10 {
            let side = if cable % 2 == 0 { 0.24 } else { -0.24 };
            (0..6).map(|k| bay + vec3(-0.4 + 0.16 * k as f32, 0.1, side) + jitter(0.05)).collect()
        } else {
            let side = model.width_m * if cable % 2 == 0 { 0.4 } else { -0.4 };
            (0..8).map(|k| vec3(bay.x - 0.4 - 0.3 * k as f32, 0.32, side) + jitter(0.02)).collect()
        };
        hose(&mut g, &path, 0.005, [8, 8], color);
    }
    g
}
