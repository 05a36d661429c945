//! Roofs: gables with dormers on low houses, flat ones with huts, tanks and masts on the others.
use super::Palette;
use super::building::{Plan, ledge};
use crate::generate::glb_writer::{GlbWriter, MeshId};
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, srgb};
use crate::generate::textures::Facade;
use glam::vec3;

const TILES: [Color; 3] = [srgb(172, 82, 56), srgb(146, 66, 48), srgb(116, 72, 60)];
const GRAVEL: [Color; 3] = [srgb(150, 144, 134), srgb(122, 118, 114), srgb(170, 160, 144)];

pub fn roof(glb: &mut GlbWriter, palette: &Palette, plan: &Plan, trim: Color, random: &mut Random) -> MeshId {
    let mut paint = Geometry::default();
    if plan.floors <= 5 && plan.facade != Facade::Office && random.chance(0.6) {
        gable(&mut paint, plan, trim, random);
    } else {
        flat(&mut paint, plan, trim, random);
    }
    glb.mesh("roof", &[(&paint, palette.paint)])
}

fn gable(g: &mut Geometry, plan: &Plan, trim: Color, random: &mut Random) {
    let tiles = *random.pick(&TILES);
    let (x, z) = (plan.width_m / 2.0 + 0.4, plan.depth_m / 2.0 + 0.6);
    let rise = plan.depth_m * random.range(0.22, 0.34);
    let (ridge_left, ridge_right) = (vec3(-x, rise, 0.0), vec3(x, rise, 0.0));
    let corner = |sx: f32, sz: f32| vec3(sx * x, 0.0, sz * z);
    g.polygon(&[corner(-1.0, 1.0), corner(1.0, 1.0), ridge_right, ridge_left], tiles);
    g.polygon(&[corner(1.0, -1.0), corner(-1.0, -1.0), ridge_left, ridge_right], tiles);
    g.polygon(&[corner(1.0, 1.0), corner(1.0, -1.0), ridge_right], trim);
    g.polygon(&[corner(-1.0, -1.0), corner(-1.0, 1.0), ridge_left], trim);
    g.polygon(&[corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)], trim);
    for k in 0..2 {
        let at = vec3(random.range(-0.35, 0.35) * plan.width_m, 0.3, (k as f32 - 0.5) * plan.depth_m * 0.4);
        g.block(at, vec3(0.9, rise + 0.9, 0.7), srgb(142, 80, 62));
        g.block(at + vec3(0.0, rise + 0.9, 0.0), vec3(1.1, 0.15, 0.9), trim);
    }
    for k in 0..3 {
        // Dormers, their backs inside the roof.
        let at = vec3((k as f32 - 1.0) * plan.width_m * 0.28, 0.2, z * 0.55);
        g.block(at, vec3(1.5, rise * 0.5 + 0.6, z * 0.5), trim);
        g.block(at + vec3(0.0, rise * 0.5 + 0.6, 0.0), vec3(1.8, 0.12, z * 0.56), tiles);
        g.block(at + vec3(0.0, rise * 0.2, z * 0.25), vec3(0.9, rise * 0.25 + 0.4, 0.06), srgb(62, 84, 104));
    }
}

fn flat(g: &mut Geometry, plan: &Plan, trim: Color, random: &mut Random) {
    let half = plan.half();
    let gravel = *random.pick(&GRAVEL);
    g.polygon(
        &[vec3(-half.x, 0.02, half.z), vec3(half.x, 0.02, half.z), vec3(half.x, 0.02, -half.z), vec3(-half.x, 0.02, -half.z)],
        gravel,
    );
    // A parapet that leans over the edge on both sides.
    let inner = half - vec3(0.4, 0.0, 0.4);
    ledge(g, inner, 0.0, 0.65, 0.9, trim);
    let hut = vec3(random.range(-0.2, 0.2) * plan.width_m, 0.0, random.range(-0.2, 0.2) * plan.depth_m);
    g.block(hut, vec3(4.2, 2.6, 3.4), trim);
    g.block(hut + vec3(0.0, 2.6, 0.0), vec3(4.6, 0.18, 3.8), gravel);
    g.block(hut + vec3(0.0, 0.0, 1.71), vec3(1.0, 2.1, 0.06), srgb(92, 96, 100));
    for k in 0..3 {
        let at = vec3((k as f32 - 1.0) * 2.4 + 0.6, 0.0, -half.z * 0.66);
        g.block(at, vec3(1.6, 1.0, 1.2), srgb(186, 188, 188));
        g.prism(at + vec3(0.0, 1.0, 0.0), 0.45, 0.45, 0.14, 8, srgb(70, 72, 74));
    }
    if random.chance(0.45) {
        let at = vec3(half.x * 0.62, 0.0, half.z * 0.5);
        g.prism(at + vec3(0.0, 1.4, 0.0), 1.3, 1.3, 2.3, 12, srgb(134, 92, 62));
        g.prism(at + vec3(0.0, 3.7, 0.0), 1.5, 0.0, 0.9, 12, srgb(96, 74, 60));
        for (x, z) in [(-0.8, -0.8), (0.8, -0.8), (0.8, 0.8), (-0.8, 0.8)] {
            g.block(at + vec3(x, 0.0, z), vec3(0.14, 1.4, 0.14), srgb(66, 64, 62));
        }
    }
    if plan.floors >= 9 {
        g.prism(hut + vec3(0.0, 2.7, 0.0), 0.12, 0.03, 2.8, 6, srgb(196, 60, 48));
    }
}
