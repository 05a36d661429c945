//! Fruit and balls. Each has about 2100 triangles.
use super::shapes::{SIDES, crumple, half_circle, smooth, turn};
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, ring, srgb};
use glam::{Vec3, vec3};

const STALK: Color = srgb(96, 70, 44);

pub fn all(random: &mut Random) -> Vec<(&'static str, Geometry)> {
    vec![
        ("red apple", apple(srgb(190, 44, 38), srgb(214, 150, 64))),
        ("green apple", apple(srgb(132, 172, 62), srgb(170, 190, 90))),
        ("apple core", core()),
        ("orange", orange(random)),
        ("lemon", lemon(random)),
        ("banana", banana()),
        ("beach ball", beach_ball()),
        ("tennis ball", tennis_ball(random)),
    ]
}

fn stalk(g: &mut Geometry, from: Vec3) {
    let path = [0.0, 0.4, 0.7, 1.0].map(|t: f32| from + vec3(0.008 * t * t, 0.022 * t, 0.0));
    g.tube(&path, 0.0018, 8, STALK);
}

fn apple(skin: Color, cheek: Color) -> Geometry {
    let mut g = Geometry::default();
    let profile = [
        (0.0, 0.009),
        (0.006, 0.006),
        (0.016, 0.0),
        (0.03, 0.014),
        (0.038, 0.038),
        (0.034, 0.06),
        (0.02, 0.07),
        (0.008, 0.064),
        (0.0, 0.055),
    ];
    turn(&mut g, &smooth(&profile, 4), |_, side| if side < SIDES / 4 { cheek } else { skin });
    stalk(&mut g, vec3(0.0, 0.054, 0.0));
    let leaf = [vec3(0.004, 0.07, 0.0), vec3(0.016, 0.076, 0.008), vec3(0.03, 0.074, 0.0), vec3(0.016, 0.076, -0.008)];
    // Seen from above and from below.
    g.polygon(&leaf, srgb(70, 120, 50));
    g.polygon(&[leaf[3], leaf[2], leaf[1], leaf[0]], srgb(92, 138, 66));
    g
}

fn core() -> Geometry {
    let mut g = Geometry::default();
    let profile = [
        (0.0, 0.0),
        (0.018, 0.004),
        (0.022, 0.012),
        (0.011, 0.022),
        (0.009, 0.034),
        (0.012, 0.048),
        (0.023, 0.058),
        (0.018, 0.067),
        (0.0, 0.06),
    ];
    let (skin, flesh) = (srgb(186, 60, 48), srgb(226, 206, 158));
    turn(&mut g, &smooth(&profile, 4), |band, _| if (9..23).contains(&band) { flesh } else { skin });
    stalk(&mut g, vec3(0.0, 0.06, 0.0));
    g
}

fn orange(random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    turn(&mut g, &half_circle(0.038, SIDES), |_, _| srgb(232, 140, 40));
    crumple(&mut g, 0.0012, 0.006, random);
    g.lathe(vec3(0.0, 0.036, 0.0), &[(0.006, 0.0), (0.004, 0.004), (0.0, 0.003)], 12, srgb(90, 110, 50));
    g
}

fn lemon(random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    let profile = [
        (0.0, 0.0),
        (0.006, 0.003),
        (0.01, 0.01),
        (0.022, 0.022),
        (0.028, 0.042),
        (0.022, 0.062),
        (0.01, 0.073),
        (0.006, 0.08),
        (0.0, 0.083),
    ];
    turn(&mut g, &smooth(&profile, 4), |_, _| srgb(234, 208, 66));
    crumple(&mut g, 0.001, 0.006, random);
    g.lathe(Vec3::ZERO, &[(0.0, -0.003), (0.004, -0.002), (0.005, 0.002)], 12, STALK);
    g
}

/// A quarter of a ring, thick in the middle, drawn as a turned solid that is bent.
fn banana() -> Geometry {
    let mut g = Geometry::default();
    let profile = [
        (0.0, -0.08),
        (0.003, -0.079),
        (0.005, -0.068),
        (0.014, -0.05),
        (0.018, -0.02),
        (0.018, 0.02),
        (0.014, 0.05),
        (0.006, 0.066),
        (0.0, 0.068),
    ];
    let (peel, tip) = (srgb(226, 190, 66), srgb(96, 78, 44));
    turn(&mut g, &smooth(&profile, 4), |band, side| match band {
        0..6 | 30.. => tip,
        _ if side % 7 == 0 => srgb(196, 158, 54),
        _ => peel,
    });
    for p in &mut g.positions {
        // A parabola, close enough to a circle.
        *p = vec3(p.x + 5.5 * p.y * p.y, p.y, p.z);
    }
    g
}

fn beach_ball() -> Geometry {
    let mut g = Geometry::default();
    let colors = [srgb(208, 50, 46), srgb(240, 236, 226), srgb(48, 96, 180), srgb(240, 236, 226)];
    turn(&mut g, &half_circle(0.055, SIDES), |band, side| match band {
        0..2 | 30.. => colors[1],
        _ => colors[side / 4 % 4],
    });
    g.lathe(vec3(0.0, 0.054, 0.0), &[(0.004, 0.0), (0.004, 0.004), (0.0, 0.004)], 24, colors[1]);
    g
}

fn tennis_ball(random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    turn(&mut g, &half_circle(0.033, 24), |_, _| srgb(206, 220, 74));
    crumple(&mut g, 0.0008, 0.003, random);
    // The seam is a curve on the ball: x = a cos t + b cos 3t and so on, from the corners of a ring.
    let ring = ring(48);
    let seam: Vec<Vec3> = (0..=48)
        .map(|k| {
            let (once, thrice, twice) = (ring[k % 48], ring[3 * k % 48], ring[2 * k % 48]);
            let at = vec3(3.0 * once.x + thrice.x, 3.0 * once.y - thrice.y, 3.4 * twice.y);
            at.normalize() * 0.0335
        })
        .collect();
    g.tube(&seam, 0.0008, 6, srgb(238, 238, 226));
    g
}
