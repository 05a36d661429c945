//! Cans, bottles, cups and jars. Each stands on y = 0 and has about 2100 triangles.
use super::shapes::{crumple, smooth, turn};
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, ring, srgb};
use glam::{Vec3, vec3};

const SILVER: Color = srgb(196, 200, 204);
const WHITE: Color = srgb(238, 236, 228);

pub fn all(random: &mut Random) -> Vec<(&'static str, Geometry)> {
    vec![
        ("red can", drink_can(srgb(192, 36, 40))),
        ("blue can", drink_can(srgb(40, 84, 168))),
        ("green can", drink_can(srgb(48, 138, 72))),
        ("crushed can", crushed_can(random)),
        ("green bottle", bottle(srgb(46, 104, 64), WHITE)),
        ("brown bottle", bottle(srgb(112, 66, 34), srgb(214, 176, 84))),
        ("water bottle", water_bottle(random)),
        ("tin", tin()),
        ("jar", jar()),
        ("paper cup", paper_cup()),
        ("mug", mug()),
        ("spray can", spray_can()),
        ("light bulb", light_bulb()),
    ]
}

/// Stripes of two colours that wind around.
fn label(color: Color) -> impl Fn(usize, usize) -> Color {
    move |band, side| if (side + band) % 16 < 5 { WHITE } else { color }
}

fn drink_can(color: Color) -> Geometry {
    let mut g = Geometry::default();
    turn(&mut g, &smooth(&[(0.0, 0.008), (0.022, 0.006), (0.026, 0.0), (0.032, 0.008)], 2), |_, _| SILVER);
    turn(&mut g, &smooth(&[(0.032, 0.008), (0.033, 0.014), (0.033, 0.1), (0.027, 0.112)], 6), label(color));
    turn(&mut g, &smooth(&[(0.027, 0.112), (0.028, 0.115), (0.026, 0.113), (0.0, 0.111)], 2), |_, _| SILVER);
    g.torus(vec3(0.004, 0.114, 0.0), 0.007, 0.0015, [16, 6], SILVER);
    g.torus(vec3(-0.006, 0.113, 0.0), 0.004, 0.0012, [8, 4], SILVER);
    g
}

fn crushed_can(random: &mut Random) -> Geometry {
    let mut g = drink_can(srgb(226, 168, 40));
    for p in &mut g.positions {
        // Folded sideways in the middle and trodden flat.
        let bend = 1.0 - (p.y / 0.057 - 1.0).abs();
        *p = vec3(p.x * (1.0 + 0.25 * bend) + 0.02 * bend, p.y * 0.6, p.z * 0.7);
    }
    crumple(&mut g, 0.007, 0.018, random);
    g
}

fn bottle(glass: Color, paper: Color) -> Geometry {
    let mut g = Geometry::default();
    turn(&mut g, &smooth(&[(0.0, 0.006), (0.02, 0.004), (0.027, 0.0), (0.03, 0.008)], 2), |_, _| glass);
    turn(&mut g, &smooth(&[(0.03, 0.008), (0.03, 0.02)], 2), |_, _| glass);
    turn(&mut g, &[(0.0304, 0.02), (0.0304, 0.04), (0.0304, 0.06), (0.0304, 0.08)], |_, side| match side % 16 {
        0..4 => srgb(60, 70, 60),
        _ => paper,
    });
    let neck = [(0.03, 0.08), (0.03, 0.09), (0.022, 0.11), (0.013, 0.128), (0.012, 0.15), (0.0135, 0.155), (0.0135, 0.16)];
    turn(&mut g, &smooth(&neck, 3), |_, _| glass);
    turn(&mut g, &smooth(&[(0.0135, 0.16), (0.01, 0.161), (0.009, 0.15), (0.0, 0.12)], 2), |_, _| glass);
    g
}

fn water_bottle(random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    let (water, cap) = (srgb(150, 190, 210), srgb(30, 80, 160));
    let mut profile = vec![(0.0, 0.006), (0.026, 0.0), (0.031, 0.01)];
    for k in 0..6 {
        let y = 0.02 + 0.015 * k as f32;
        profile.extend([(0.0315, y), (0.029, y + 0.007)]);
    }
    profile.extend([(0.031, 0.112), (0.024, 0.135), (0.011, 0.148), (0.011, 0.153)]);
    turn(&mut g, &smooth(&profile, 2)[..30], |_, _| water);
    let rest = smooth(&profile, 2)[29..].to_vec();
    turn(&mut g, &rest, |_, _| water);
    crumple(&mut g, 0.004, 0.03, random);
    g.lathe(vec3(0.0, 0.15, 0.0), &[(0.0, 0.0), (0.014, 0.0), (0.014, 0.014), (0.0, 0.015)], 32, cap);
    g
}

fn tin() -> Geometry {
    let mut g = Geometry::default();
    let mut profile = vec![(0.0, 0.002), (0.036, 0.002), (0.038, 0.0), (0.038, 0.01)];
    for k in 0..10 {
        let y = 0.014 + 0.006 * k as f32;
        profile.extend([(0.0365, y), (0.038, y + 0.003)]);
    }
    profile.extend([(0.038, 0.085), (0.0355, 0.084), (0.0355, 0.02), (0.0, 0.018)]);
    turn(&mut g, &profile, |band, _| if (6..24).contains(&band) { srgb(208, 86, 48) } else { SILVER });
    // The lid stands open.
    let mut lid = Geometry::default();
    lid.lathe(Vec3::ZERO, &[(0.0, 0.0), (0.034, 0.0), (0.034, 0.0015), (0.0, 0.0015)], 32, SILVER);
    for k in 1..5 {
        lid.torus(Vec3::ZERO, 0.007 * k as f32, 0.001, [24, 4], SILVER);
    }
    g.copy(&lid, |p| vec3(0.038 + p.y, 0.115 + p.x * 0.9, p.z));
    g
}

fn jar() -> Geometry {
    let mut g = Geometry::default();
    let (glass, jam) = (srgb(176, 196, 186), srgb(140, 30, 48));
    let body = [(0.0, 0.0), (0.03, 0.0), (0.036, 0.008), (0.036, 0.06), (0.03, 0.072), (0.028, 0.078)];
    turn(&mut g, &smooth(&body, 4), |band, _| if band < 12 { jam } else { glass });
    let lid = [(0.0, 0.076), (0.032, 0.076), (0.033, 0.078), (0.033, 0.09), (0.031, 0.092), (0.0, 0.093)];
    turn(&mut g, &smooth(&lid, 2), |band, side| if band > 2 && side % 2 == 0 { srgb(210, 178, 90) } else { srgb(190, 156, 70) });
    g.torus(vec3(0.0, 0.0345, 0.0), 0.0365, 0.001, [32, 4], srgb(236, 226, 200));
    g
}

fn paper_cup() -> Geometry {
    let mut g = Geometry::default();
    let (brown, lid) = (srgb(132, 92, 60), srgb(236, 236, 232));
    turn(&mut g, &smooth(&[(0.0, 0.004), (0.026, 0.004), (0.027, 0.0), (0.037, 0.1)], 7), |band, side| {
        if band > 15 && (side + band) % 4 < 2 { WHITE } else { brown }
    });
    let top = [(0.037, 0.1), (0.04, 0.101), (0.04, 0.106), (0.036, 0.108), (0.035, 0.116), (0.0, 0.114)];
    turn(&mut g, &smooth(&top, 2), |_, _| lid);
    let straw = [vec3(0.012, 0.1, 0.0), vec3(0.014, 0.14, 0.0), vec3(0.018, 0.15, 0.001), vec3(0.032, 0.158, 0.005)];
    g.tube(&straw, 0.003, 12, srgb(206, 52, 48));
    g
}

fn mug() -> Geometry {
    let mut g = Geometry::default();
    let (glaze, inside) = (srgb(66, 120, 150), srgb(232, 224, 206));
    let outer = [(0.0, 0.004), (0.03, 0.002), (0.033, 0.0), (0.036, 0.02), (0.036, 0.075), (0.037, 0.085)];
    turn(&mut g, &smooth(&outer, 3), |band, _| if (7..9).contains(&band) { inside } else { glaze });
    let inner = [(0.037, 0.085), (0.034, 0.083), (0.032, 0.02), (0.0, 0.01)];
    turn(&mut g, &smooth(&inner, 3), |_, _| inside);
    let handle: Vec<Vec3> =
        ring(24)[..13].iter().map(|corner| vec3(0.034 + 0.026 * corner.y, 0.045 + 0.024 * corner.x, 0.0)).collect();
    g.tube(&handle, 0.005, 24, glaze);
    g
}

fn spray_can() -> Geometry {
    let mut g = Geometry::default();
    let body = [(0.0, 0.004), (0.024, 0.0), (0.026, 0.006), (0.026, 0.11), (0.02, 0.122), (0.012, 0.126)];
    turn(&mut g, &smooth(&body, 5), |band, side| match band {
        0..5 | 18.. => SILVER,
        _ if (side / 4 + band / 3) % 2 == 0 => srgb(150, 60, 140),
        _ => srgb(226, 190, 60),
    });
    turn(&mut g, &smooth(&[(0.018, 0.122), (0.018, 0.142), (0.016, 0.146), (0.0, 0.147)], 2), |_, _| WHITE);
    g.torus(vec3(0.0, 0.116, 0.0), 0.024, 0.002, [32, 4], SILVER);
    g
}

fn light_bulb() -> Geometry {
    let mut g = Geometry::default();
    let mut screw = vec![(0.0, 0.0), (0.006, 0.001), (0.012, 0.006)];
    for k in 0..5 {
        let y = 0.008 + 0.0045 * k as f32;
        screw.extend([(0.0135, y + 0.001), (0.012, y + 0.0035)]);
    }
    turn(&mut g, &screw, |_, _| SILVER);
    let glass = [(0.012, 0.03), (0.016, 0.042), (0.028, 0.065), (0.031, 0.082), (0.022, 0.102), (0.0, 0.111)];
    turn(&mut g, &smooth(&glass, 4), |_, _| srgb(246, 240, 214));
    g
}
