//! What stands around the building: ground, chimneys, tanks, conveyors, the pipe bridge, transformers.
use super::stock::{DARK, GALVANISED, MODULE_M, SAFETY_YELLOW, STEEL};
use super::{AREA_M, Builder};
use crate::generate::glb_writer::{MaterialId, MeshId, NodeId, Place};
use crate::generate::solid::{Geometry, ring, srgb};
use glam::{Vec3, vec3};

/// One section of a chimney.
const SECTION_M: f32 = 18.0;

pub fn build(b: &mut Builder, plant: NodeId, paint: MaterialId) {
    let mut add = |name: &str, geometry: Geometry| b.glb.mesh(name, &[(&geometry, paint)]);
    let ground = add("ground", ground());
    let sections = [0, 1, 2, 3].map(|k| add("chimney section", chimney_section(k)));
    let tank = add("tank", tank());
    let bund = add("bund", bund());
    let transformer = add("transformer", transformer());
    let trestle = add("trestle", trestle());
    let bundle = add("pipe bundle", bundle());
    let yard = b.group(plant, "yard", Place::at(Vec3::ZERO));
    b.part(yard, "ground", ground, Place::at(Vec3::ZERO));
    for (k, x) in [-36.0, -12.0].into_iter().enumerate() {
        chimney(b, yard, k, vec3(x, 0.0, -46.0), &sections);
    }
    tank_farm(b, yard, tank, bund);
    conveyors(b, yard);
    pipe_bridge(b, yard, trestle, bundle);
    let transformers = b.group(yard, "transformers", Place::at(vec3(56.0, 0.0, -34.0)));
    for k in 0..4 {
        b.part(transformers, "transformer", transformer, Place::yawed(vec3(0.0, 0.0, -8.0 * k as f32), 0.08 * k as f32));
    }
}

fn chimney(b: &mut Builder, yard: NodeId, k: usize, at: Vec3, sections: &[MeshId; 4]) {
    let chimney = b.group(yard, format!("chimney {}", k + 1), Place::at(at));
    for (k, section) in sections.iter().enumerate() {
        b.part(chimney, "section", *section, Place::at(vec3(0.0, k as f32 * SECTION_M, 0.0)));
    }
    // The flue climbs from the boiler house.
    let flues = b.group(chimney, "flues", Place::at(Vec3::ZERO));
    for (from, to) in
        [([0.0, 14.0, 28.0], [0.0, 16.0, 20.5]), ([0.0, 16.0, 20.5], [0.0, 11.0, 14.0]), ([0.0, 11.0, 14.0], [0.0, 9.0, 6.0])]
    {
        let (from, to) = (Vec3::from(from), Vec3::from(to));
        let length = (to - from).length() / MODULE_M;
        b.part(flues, "flue", b.stock.duct, Place::between(from, to, [2.4, 2.0]).scaled(vec3(length, 2.4, 2.0)));
    }
}

fn tank_farm(b: &mut Builder, yard: NodeId, tank: MeshId, bund: MeshId) {
    let farm = b.group(yard, "tank farm", Place::yawed(vec3(30.0, 0.0, -48.0), 0.1));
    for row in 0..2 {
        let node = b.group(farm, format!("row {}", row + 1), Place::at(vec3(0.0, 0.0, -18.0 * row as f32)));
        b.part(node, "bund", bund, Place::at(Vec3::ZERO));
        for k in 0..3 {
            let at = vec3(15.0 * (k as f32 - 1.0), 0.0, 0.0);
            b.part(node, "tank", tank, Place::yawed(at, 0.3 * k as f32).scaled(vec3(1.0, 1.0 - 0.15 * row as f32, 1.0)));
        }
    }
}

/// Two galleries that climb to the coal bunkers.
fn conveyors(b: &mut Builder, yard: NodeId) {
    let conveyors = b.group(yard, "conveyors", Place::at(vec3(-3.0 * AREA_M, 0.0, 0.0)));
    for (name, from, to) in [
        ("gallery 1", vec3(-66.0, 1.0, -22.0), vec3(2.0, 25.0, -4.0)),
        ("gallery 2", vec3(-60.0, 1.0, 26.0), vec3(2.0, 25.0, 6.0)),
    ] {
        let gallery = b.group(conveyors, name, Place::at(Vec3::ZERO));
        let spans = b.group(gallery, "spans", Place::at(Vec3::ZERO));
        let props = b.group(gallery, "props", Place::at(Vec3::ZERO));
        let count = 9;
        let at = |k: usize| from + (to - from) * (k as f32 / count as f32);
        for k in 0..count {
            let stretch = (at(k + 1) - at(k)).length() / MODULE_M;
            let place = Place::between(at(k), at(k + 1), [1.0, 1.0]).scaled(vec3(stretch, 1.0, 1.0));
            b.part(spans, "span", b.stock.conveyor, place);
            if k % 2 == 1 {
                let foot = at(k) * vec3(1.0, 0.0, 1.0);
                b.part(props, "prop", b.stock.column, Place::between(foot, at(k), [0.7, 1.0]));
            }
        }
    }
}

fn pipe_bridge(b: &mut Builder, yard: NodeId, trestle: MeshId, bundle: MeshId) {
    let bridge = b.group(yard, "pipe bridge", Place::yawed(vec3(0.0, 0.0, -30.0), 0.02));
    for (name, mesh, offset) in [("trestles", trestle, 0.0), ("bundles", bundle, 7.1)] {
        let node = b.group(bridge, name, Place::at(Vec3::ZERO));
        for k in 0..12 {
            b.part(node, name.trim_end_matches('s'), mesh, Place::at(vec3(12.0 * k as f32 - 72.0, offset, 0.0)));
        }
    }
}

/// Slabs of concrete: one leaf, as a site plan gives it.
fn ground() -> Geometry {
    let mut g = Geometry::default();
    let (columns, rows, slab) = (30, 16, vec3(9.0, 0.0, 9.0));
    for k in 0..columns * rows {
        let corner = vec3((k % columns) as f32 - 17.0, 0.0, (k / columns) as f32 - 11.0) * slab;
        let tone = 150 + ((k * 37 + k / columns * 11) % 5) as u8 * 6;
        let (from, to) = (corner + vec3(0.03, -0.4, 0.03), corner + slab - vec3(0.03, 0.0, 0.03));
        let corners =
            [vec3(from.x, -0.02, to.z), vec3(to.x, -0.02, to.z), vec3(to.x, -0.02, from.z), vec3(from.x, -0.02, from.z)];
        g.polygon(&corners, srgb(tone, tone, tone - 8));
    }
    g
}

/// Concrete below, bands of red and white on top.
fn chimney_section(k: usize) -> Geometry {
    let mut g = Geometry::default();
    let radius = |y: f32| 4.2 - 0.025 * (k as f32 * SECTION_M + y);
    for band in 0..6 {
        let (low, high) = (band as f32 * 3.0, (band + 1) as f32 * 3.0);
        let color = match (k, band % 2) {
            (0 | 1, _) => srgb(178, 172, 162),
            (_, 0) => srgb(186, 56, 46),
            _ => srgb(228, 226, 220),
        };
        let (l, h) = (radius(low), radius(high));
        g.lathe(Vec3::ZERO, &[(l, low), (l - 0.02, low + 1.4), (h + 0.03, high - 0.1), (h, high)], 48, color);
    }
    let top = radius(SECTION_M);
    g.lathe(
        vec3(0.0, SECTION_M - 0.6, 0.0),
        &[(top, 0.0), (top + 0.9, 0.1), (top + 0.9, 0.25), (top - 0.4, 0.25), (top - 0.4, -0.5)],
        48,
        STEEL,
    );
    for post in ring(24) {
        let at = vec3(post.x, 0.0, post.y) * (top + 0.85) + vec3(0.0, SECTION_M - 0.4, 0.0);
        g.tube(&[at, at + vec3(0.0, 1.1, 0.0)], 0.03, 6, SAFETY_YELLOW);
    }
    g.torus(vec3(0.0, SECTION_M + 0.7, 0.0), top + 0.85, 0.03, [48, 6], SAFETY_YELLOW);
    g
}

/// 12 m wide, 10 m high, with a stair that winds up its shell.
fn tank() -> Geometry {
    let mut g = Geometry::default();
    let (radius, white) = (6.0, srgb(220, 222, 216));
    let mut profile = Vec::new();
    for k in 0..5 {
        let y = 2.0 * k as f32;
        profile.extend([(radius, y), (radius, y + 1.9), (radius + 0.05, y + 1.95)]);
    }
    profile.extend([(radius, 10.0), (radius + 0.2, 10.0), (radius + 0.2, 10.1), (3.0, 10.9), (0.0, 11.3)]);
    g.lathe(Vec3::ZERO, &profile, 48, white);
    for (k, corner) in ring(96)[..48].iter().enumerate() {
        let out = vec3(corner.x, 0.0, corner.y);
        let y = 10.0 * (k + 1) as f32 / 48.0;
        g.bar(out * 6.02 + Vec3::Y * y, out * 6.9 + Vec3::Y * y, [0.3, 0.05], GALVANISED);
        if k % 3 == 0 {
            g.tube(&[out * 6.85 + Vec3::Y * y, out * 6.85 + Vec3::Y * (y + 1.1)], 0.025, 6, SAFETY_YELLOW);
        }
    }
    let rail: Vec<Vec3> =
        ring(48)[..25].iter().enumerate().map(|(k, c)| vec3(c.x * 6.85, 1.2 + 10.0 * k as f32 / 24.0, c.y * 6.85)).collect();
    g.tube(&rail, 0.03, 6, SAFETY_YELLOW);
    for corner in ring(24) {
        let at = vec3(corner.x, 0.0, corner.y) * 6.1 + vec3(0.0, 10.1, 0.0);
        g.tube(&[at, at + vec3(0.0, 1.1, 0.0)], 0.025, 6, SAFETY_YELLOW);
    }
    g.torus(vec3(0.0, 11.2, 0.0), 6.1, 0.03, [48, 4], SAFETY_YELLOW);
    g
}

/// The wall around a row of tanks.
fn bund() -> Geometry {
    let mut g = Geometry::default();
    let concrete = srgb(168, 164, 156);
    for z in [-8.0, 8.0] {
        g.cuboid(vec3(-23.0, 0.0, z - 0.15), vec3(23.0, 1.2, z + 0.15), concrete);
    }
    for x in [-23.0, 22.7] {
        g.cuboid(vec3(x, 0.0, -7.85), vec3(x + 0.3, 1.2, 7.85), concrete);
    }
    for k in 0..24 {
        let x = -22.0 + 1.9 * k as f32;
        for z in [-8.3, 8.15] {
            g.cuboid(vec3(x, 0.0, z), vec3(x + 0.25, 1.1, z + 0.15), concrete);
        }
    }
    g
}

fn transformer() -> Geometry {
    let mut g = Geometry::default();
    let grey = srgb(150, 160, 156);
    g.block(Vec3::ZERO, vec3(6.5, 0.4, 4.5), srgb(168, 164, 156));
    g.block(vec3(0.0, 0.4, 0.0), vec3(4.4, 3.0, 2.2), grey);
    for k in 0..20 {
        let x = -2.0 + 0.2 * k as f32;
        for z in [-1.9, 1.12] {
            g.cuboid(vec3(x, 0.8, z), vec3(x + 0.08, 3.0, z + 0.8), grey);
        }
    }
    for x in [-1.4, 0.0, 1.4] {
        let sheds: Vec<(f32, f32)> = (0..12)
            .flat_map(|k| {
                let y = 0.12 * k as f32;
                [(0.1, y), (0.24, y + 0.03), (0.1, y + 0.08)]
            })
            .collect();
        g.lathe(vec3(x, 3.4, 0.0), &sheds, 16, srgb(124, 66, 48));
        g.tube(&[vec3(x, 4.7, 0.0), vec3(x, 5.2, 0.0)], 0.05, 8, GALVANISED);
    }
    g.tube(&[vec3(-2.0, 3.9, -0.8), vec3(2.0, 3.9, -0.8)], 0.4, 24, grey);
    g
}

/// A frame of the pipe bridge and the truss to the next, 12 m along +X.
fn trestle() -> Geometry {
    let mut g = Geometry::default();
    for z in [-2.0, 2.0] {
        g.bar(vec3(0.0, 0.0, z * 1.25), vec3(0.0, 7.6, z), [0.3, 0.3], STEEL);
        for y in [7.0, 8.6] {
            g.bar(vec3(0.0, y, z), vec3(12.0, y, z), [0.2, 0.25], STEEL);
        }
        for k in 0..6 {
            let x = 2.0 * k as f32;
            let (low, high) = if k % 2 == 0 { (7.0, 8.6) } else { (8.6, 7.0) };
            g.bar(vec3(x, low, z), vec3(x + 2.0, high, z), [0.1, 0.12], STEEL);
        }
    }
    g.bar(vec3(0.0, 0.4, -2.5), vec3(0.0, 6.8, 2.0), [0.12, 0.15], STEEL);
    g.bar(vec3(0.0, 0.4, 2.5), vec3(0.0, 6.8, -2.0), [0.12, 0.15], STEEL);
    for k in 0..4 {
        g.bar(vec3(3.0 * k as f32, 6.9, -2.2), vec3(3.0 * k as f32, 6.9, 2.2), [0.25, 0.3], STEEL);
    }
    g
}

/// The pipes of one span of the bridge.
fn bundle() -> Geometry {
    let mut g = Geometry::default();
    let colors = [
        srgb(206, 208, 210),
        srgb(70, 146, 96),
        srgb(206, 208, 210),
        srgb(222, 180, 60),
        srgb(112, 168, 206),
        srgb(186, 52, 42),
        srgb(140, 96, 62),
    ];
    for (k, color) in colors.into_iter().enumerate() {
        let (radius, z) = (0.12 + 0.05 * (k % 4) as f32, -1.5 + 0.5 * k as f32);
        g.tube(&[vec3(0.0, radius, z), vec3(12.0, radius, z)], radius, 16, color);
        for x in [0.0, 3.0, 6.0, 9.0] {
            g.tube(&[vec3(x + 0.1, radius, z), vec3(x + 0.2, radius, z)], radius + 0.03, 16, DARK);
        }
    }
    g
}
