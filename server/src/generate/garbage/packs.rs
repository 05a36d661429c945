//! Boxes, cartons, paper and small things. Each has about 2100 triangles.
use super::shapes::{SIDES, crumple, fine_box, half_circle, turn};
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, ring, srgb};
use glam::{Vec3, vec3};

/// Squares along each edge of a box: 12 · 14² triangles are 2352.
const CELLS: usize = 14;

pub fn all(random: &mut Random) -> Vec<(&'static str, Geometry)> {
    vec![
        ("cardboard box", cardboard_box(random)),
        ("crushed box", crushed_box(random)),
        ("milk carton", milk_carton(random)),
        ("cigarette box", cigarette_box(random)),
        ("crumpled newspaper", paper(srgb(206, 202, 190), srgb(120, 120, 118), random)),
        ("crumpled note", paper(srgb(240, 222, 120), srgb(228, 206, 96), random)),
        ("crumpled foil", paper(srgb(186, 192, 198), srgb(150, 158, 166), random)),
        ("book", book(random)),
        ("toy brick", toy_brick()),
        ("spool", spool()),
    ]
}

fn cardboard_box(random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    let (card, tape) = (srgb(176, 134, 88), srgb(206, 178, 130));
    fine_box(&mut g, vec3(0.11, 0.08, 0.09), CELLS, |p| if p.z.abs() < 0.07 && p.x.abs() < 0.49 { tape } else { card });
    crumple(&mut g, 0.004, 0.04, random);
    g
}

fn crushed_box(random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    let (orange, white) = (srgb(222, 116, 44), srgb(240, 230, 204));
    fine_box(&mut g, vec3(0.12, 0.1, 0.05), CELLS, |p| if p.x * p.x + p.y * p.y < 0.08 { white } else { orange });
    for p in &mut g.positions {
        // One edge is pushed in.
        let push = (p.x / 0.12 + 0.5) * (p.y / 0.1 + 0.5);
        p.y -= 0.035 * push;
    }
    crumple(&mut g, 0.012, 0.03, random);
    g
}

fn milk_carton(random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    let (white, blue) = (srgb(240, 240, 236), srgb(56, 110, 180));
    fine_box(&mut g, vec3(0.06, 0.12, 0.06), CELLS, |p| if p.y + 0.3 * p.x < -0.05 { blue } else { white });
    for p in &mut g.positions {
        // The top is folded to a gable.
        let above = ((p.y - 0.035) / 0.025).clamp(0.0, 1.0);
        p.z *= 1.0 - 0.92 * above;
    }
    crumple(&mut g, 0.002, 0.03, random);
    g.lathe(vec3(0.0, 0.02, 0.03), &[(0.0, 0.0), (0.008, 0.0), (0.008, 0.012), (0.0, 0.012)], 16, srgb(200, 50, 50));
    g
}

fn cigarette_box(random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    let (red, white) = (srgb(190, 40, 44), srgb(242, 240, 234));
    fine_box(&mut g, vec3(0.055, 0.088, 0.024), CELLS, |p| if p.y > 0.12 - p.x.abs() * 0.6 { red } else { white });
    crumple(&mut g, 0.003, 0.025, random);
    for k in 0..3 {
        let from = vec3(-0.015 + 0.012 * k as f32, 0.035, 0.0);
        g.tube(&[from, from + vec3(0.002, 0.02 + 0.004 * k as f32, 0.0)], 0.004, 8, white);
    }
    g
}

fn paper(front: Color, back: Color, random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    turn(&mut g, &half_circle(0.044, SIDES), |band, side| if band * 7 % 5 == 0 && side % 8 < 6 { back } else { front });
    crumple(&mut g, 0.022, 0.022, random);
    crumple(&mut g, 0.008, 0.009, random);
    g
}

fn book(random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    let (cover, pages) = (srgb(122, 36, 44), srgb(236, 228, 206));
    fine_box(&mut g, vec3(0.105, 0.15, 0.022), CELLS, |p| if p.z.abs() > 0.499 || p.x < -0.499 { cover } else { pages });
    crumple(&mut g, 0.002, 0.05, random);
    for z in [-0.0125, 0.0125] {
        g.cuboid(vec3(-0.056, -0.079, z - 0.0012), vec3(0.056, 0.079, z + 0.0012), cover);
    }
    g.cuboid(vec3(-0.058, -0.079, -0.0113), vec3(-0.0545, 0.079, 0.0113), cover);
    for k in 0..3 {
        let y = -0.05 + 0.05 * k as f32;
        g.cuboid(vec3(-0.0595, y, -0.012), vec3(-0.0585, y + 0.012, 0.012), srgb(206, 170, 80));
    }
    g
}

fn toy_brick() -> Geometry {
    let mut g = Geometry::default();
    let green = srgb(60, 150, 90);
    fine_box(&mut g, vec3(0.096, 0.036, 0.064), 9, |_| green);
    for k in 0..8 {
        let at = vec3(-0.036 + 0.024 * (k % 4) as f32, 0.018, if k < 4 { -0.016 } else { 0.016 });
        let stud = [(0.0075, 0.0), (0.0075, 0.006), (0.0068, 0.0068), (0.0, 0.0068)];
        g.lathe(at, &stud, 24, green);
    }
    g
}

/// Thread on a reel.
fn spool() -> Geometry {
    let mut g = Geometry::default();
    let (wood, thread) = (srgb(190, 146, 96), srgb(150, 50, 110));
    for y in [-0.035, 0.027] {
        let rim = [(0.0, 0.0), (0.026, 0.0), (0.028, 0.002), (0.028, 0.006), (0.024, 0.008), (0.0, 0.008)];
        g.lathe(vec3(0.0, y, 0.0), &rim, SIDES, wood);
    }
    // The thread winds up in one piece.
    let ring = ring(16);
    let turns = 10;
    let path: Vec<Vec3> = (0..=16 * turns)
        .map(|k| {
            let corner = ring[k % 16];
            vec3(corner.x * 0.02, -0.025 + 0.05 * k as f32 / (16 * turns) as f32, corner.y * 0.02)
        })
        .collect();
    g.tube(&path, 0.003, 4, thread);
    g.lathe(vec3(0.0, -0.027, 0.0), &[(0.0195, 0.0), (0.0195, 0.054)], SIDES, thread);
    g
}
