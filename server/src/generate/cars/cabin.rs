//! Seats and the dashboard.
use super::Model;
use super::parts::{IRON, RUBBER, STEEL, across, fine_cuboid, spring};
use crate::generate::solid::{Color, Geometry, srgb};
use glam::{Vec3, vec3};

const CLOTH: Color = srgb(96, 92, 88);

/// Two seats in front and a bench, quilted, on frames with springs.
pub fn seats(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    let [_, rear, front, _] = model.cabin;
    let along = |share: f32| (rear + (front - rear) * share - 0.5) * model.length_m;
    let wide = model.width_m * 0.24;
    for (x, z) in [(along(0.75), wide), (along(0.75), -wide), (along(0.2), wide), (along(0.2), -wide)] {
        let at = vec3(x, 0.32, z);
        for row in 0..5 {
            let y = at + vec3(-0.22 + 0.09 * row as f32, 0.0, 0.0);
            fine_cuboid(&mut g, y + vec3(0.0, 0.08, -0.24), y + vec3(0.08, 0.2, 0.24), 0.08, CLOTH);
            let back = at + vec3(-0.3 - 0.03 * row as f32, 0.2 + 0.11 * row as f32, 0.0);
            fine_cuboid(&mut g, back - vec3(0.05, 0.0, 0.23), back + vec3(0.06, 0.1, 0.23), 0.08, CLOTH);
        }
        fine_cuboid(&mut g, at + vec3(-0.5, 0.74, -0.12), at + vec3(-0.42, 0.9, 0.12), 0.04, CLOTH);
        for k in 0..6 {
            spring(
                &mut g,
                at + vec3(-0.2 + 0.2 * (k % 3) as f32, 0.0, 0.2 * (k / 3) as f32 - 0.1),
                [0.02, 0.002, 0.08],
                3,
                STEEL,
            );
        }
        for rail in [-0.2, 0.2] {
            g.bar(at + vec3(-0.25, -0.02, rail), at + vec3(0.25, -0.02, rail), [0.03, 0.03], IRON);
        }
    }
    g
}

/// A padded board with dials and vents, and the steering wheel on its column.
pub fn dashboard(model: &Model) -> Geometry {
    let mut g = Geometry::default();
    let x = (model.cabin[2] - 0.5) * model.length_m + 0.34;
    let half_z = model.width_m * 0.4;
    fine_cuboid(&mut g, vec3(x, 0.62, -half_z), vec3(x + 0.25, 0.82, half_z), 0.05, RUBBER);
    for vent in 0..4 {
        let z = half_z * (0.5 * vent as f32 - 0.75);
        for slat in 0..8 {
            let y = 0.7 + 0.01 * slat as f32;
            fine_cuboid(&mut g, vec3(x - 0.01, y, z - 0.07), vec3(x, y + 0.003, z + 0.07), 0.05, IRON);
        }
    }
    let driver_z = -model.width_m * 0.24;
    for dial in [-0.09, 0.09] {
        let mut face = Geometry::default();
        face.lathe(Vec3::ZERO, &[(0.0, 0.0), (0.06, 0.0), (0.065, 0.01), (0.07, 0.0)], 32, srgb(220, 220, 210));
        let face = face.laid();
        g.copy(&face, |p| vec3(-p.x, p.y, -p.z) + vec3(x - 0.005, 0.75, driver_z + dial));
    }
    let mut wheel = Geometry::default();
    wheel.torus(Vec3::ZERO, 0.18, 0.014, [48, 16], RUBBER);
    for end in [vec3(0.17, 0.0, 0.0), vec3(-0.08, 0.0, 0.15), vec3(-0.08, 0.0, -0.15)] {
        wheel.bar(Vec3::ZERO, end, [0.03, 0.012], IRON);
    }
    let wheel = wheel.laid();
    g.copy(&wheel, |p| p + vec3(x - 0.2, 0.78, driver_z));
    g.tube(&[vec3(x - 0.2, 0.78, driver_z), vec3(x + 0.1, 0.72, driver_z)], 0.025, 16, IRON);
    let mut lever = Geometry::default();
    lever.lathe(Vec3::ZERO, &[(0.0, -0.14), (0.008, -0.14), (0.008, 0.0), (0.024, 0.02), (0.026, 0.05), (0.0, 0.07)], 24, RUBBER);
    g.copy(&across(lever), |p| vec3(p.x, p.z, -p.y) + vec3(x - 0.25, 0.6, 0.0));
    g
}
