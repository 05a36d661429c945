//! The plant's shared meshes of steel, floors, access and electricity. Pipes and machines have files of their own.
use crate::generate::glb_writer::{GlbWriter, MaterialId, MeshId};
use crate::generate::solid::{Color, Geometry, srgb};
use glam::{Vec3, vec3};

pub const STEEL: Color = srgb(116, 134, 150);
pub const PRIMER: Color = srgb(150, 78, 62);
pub const GALVANISED: Color = srgb(176, 180, 182);
pub const SAFETY_YELLOW: Color = srgb(232, 188, 52);
pub const DARK: Color = srgb(58, 62, 68);

/// Sizes of grating panels, metres: length along X, across along Z.
pub const PANEL_M: [f32; 2] = [8.0, 12.0];
/// Length of a module of trays, ducts and conveyors.
pub const MODULE_M: f32 = 8.0;

/// Meshes of which the building is put together.
pub struct Stock {
    /// One metre of I-section along +X, a metre high and half as wide: scaled to length and section.
    pub beam: MeshId,
    pub column: MeshId,
    pub brace: MeshId,
    /// [`PANEL_M`], its top at y = 0, its low corner in x and z at the origin.
    pub grating: MeshId,
    pub handrail: MeshId,
    /// Rises 3 m over 4.2 m of +X.
    pub stair: MeshId,
    pub landing: MeshId,
    pub tray: MeshId,
    pub duct: MeshId,
    pub conveyor: MeshId,
    pub cabinet: MeshId,
    pub lamp: MeshId,
    pub cable_drop: MeshId,
}

impl Stock {
    pub fn new(glb: &mut GlbWriter, paint: MaterialId) -> Stock {
        let mut add = |name: &str, build: &dyn Fn(&mut Geometry)| {
            let mut geometry = Geometry::default();
            build(&mut geometry);
            glb.mesh(name, &[(&geometry, paint)])
        };
        Stock {
            beam: add("beam", &|g| i_section(g, STEEL)),
            column: add("column", &|g| i_section(g, PRIMER)),
            brace: add("brace", &|g| i_section(g, srgb(96, 112, 128))),
            grating: add("grating", &grating),
            handrail: add("handrail", &handrail),
            stair: add("stair", &stair),
            landing: add("landing", &landing),
            tray: add("cable tray", &tray),
            duct: add("duct", &duct),
            conveyor: add("conveyor", &conveyor),
            cabinet: add("cabinet", &cabinet),
            lamp: add("lamp", &lamp),
            cable_drop: add("cable drop", &cable_drop),
        }
    }
}

/// Two flanges and a web: 36 triangles.
fn i_section(g: &mut Geometry, color: Color) {
    g.cuboid(vec3(0.0, -0.5, -0.25), vec3(1.0, -0.42, 0.25), color);
    g.cuboid(vec3(0.0, 0.42, -0.25), vec3(1.0, 0.5, 0.25), color);
    g.cuboid(vec3(0.0, -0.42, -0.03), vec3(1.0, 0.42, 0.03), color);
}

/// Bearing bars along X, cross bars, and a frame.
fn grating(g: &mut Geometry) {
    let [length, across] = PANEL_M;
    let bars = 80;
    for k in 0..bars {
        let z = 0.1 + (across - 0.2) * k as f32 / (bars - 1) as f32;
        g.cuboid(vec3(0.05, -0.04, z - 0.03), vec3(length - 0.05, 0.0, z + 0.03), GALVANISED);
    }
    for k in 0..16 {
        let x = 0.25 + 0.5 * k as f32;
        g.cuboid(vec3(x - 0.03, -0.07, 0.05), vec3(x + 0.03, -0.04, across - 0.05), GALVANISED);
    }
    for z in [0.0, across - 0.05] {
        g.cuboid(vec3(0.0, -0.15, z), vec3(length, 0.0, z + 0.05), STEEL);
    }
}

/// 8 m along +X: posts, two rails and a toe board.
fn handrail(g: &mut Geometry) {
    for k in 0..9 {
        let x = k as f32;
        g.tube(&[vec3(x, 0.0, 0.0), vec3(x, 1.1, 0.0)], 0.025, 8, SAFETY_YELLOW);
        g.cuboid(vec3(x - 0.06, 0.0, -0.06), vec3(x + 0.06, 0.02, 0.06), STEEL);
    }
    for y in [0.55, 1.1] {
        g.tube(&[vec3(0.0, y, 0.0), vec3(8.0, y, 0.0)], 0.03, 8, SAFETY_YELLOW);
    }
    g.cuboid(vec3(0.0, 0.02, -0.01), vec3(8.0, 0.17, 0.01), SAFETY_YELLOW);
}

fn stair(g: &mut Geometry) {
    let treads = 16;
    for k in 0..treads {
        let (x, y) = (4.2 * (k as f32 + 0.5) / treads as f32, 3.0 * (k + 1) as f32 / treads as f32);
        for slat in 0..5 {
            let x = x + 0.05 * slat as f32 - 0.1;
            g.cuboid(vec3(x, y - 0.03, -0.45), vec3(x + 0.03, y, 0.45), GALVANISED);
        }
    }
    for z in [-0.5, 0.5] {
        g.bar(vec3(0.0, 0.0, z), vec3(4.2, 3.0, z), [0.04, 0.25], STEEL);
        for y in [0.55, 1.05] {
            g.tube(&[vec3(0.0, y, z), vec3(4.2, 3.0 + y, z)], 0.025, 8, SAFETY_YELLOW);
        }
        for k in 0..5 {
            let (x, y) = (4.2 * k as f32 / 4.0, 3.0 * k as f32 / 4.0);
            g.tube(&[vec3(x, y, z), vec3(x, y + 1.05, z)], 0.025, 8, SAFETY_YELLOW);
        }
    }
}

/// Between two flights.
fn landing(g: &mut Geometry) {
    for k in 0..20 {
        let z = -1.1 + 0.11 * k as f32;
        g.cuboid(vec3(0.0, -0.04, z), vec3(1.3, 0.0, z + 0.06), GALVANISED);
    }
    g.bar(vec3(1.3, -0.1, -1.2), vec3(1.3, -0.1, 1.2), [0.05, 0.2], STEEL);
    for z in [-1.2, 0.0, 1.2] {
        g.tube(&[vec3(1.3, 0.0, z), vec3(1.3, 1.1, z)], 0.025, 8, SAFETY_YELLOW);
    }
    g.tube(&[vec3(1.3, 1.1, -1.2), vec3(1.3, 1.1, 1.2)], 0.03, 8, SAFETY_YELLOW);
}

/// A ladder tray along +X with its cables.
fn tray(g: &mut Geometry) {
    for z in [-0.3, 0.3] {
        g.cuboid(vec3(0.0, 0.0, z - 0.015), vec3(MODULE_M, 0.1, z + 0.015), GALVANISED);
    }
    for k in 0..32 {
        let x = 0.125 + 0.25 * k as f32;
        g.cuboid(vec3(x - 0.02, 0.0, -0.3), vec3(x + 0.02, 0.02, 0.3), GALVANISED);
    }
    let jackets = [DARK, srgb(196, 84, 40), DARK, srgb(48, 84, 140), DARK, DARK, srgb(70, 120, 74)];
    for (k, jacket) in jackets.into_iter().enumerate() {
        let z = -0.24 + 0.08 * k as f32;
        // Cables sag and wander.
        let path: Vec<Vec3> =
            (0..=8).map(|s| vec3(s as f32, 0.05 + 0.008 * ((s + k) % 2) as f32, z + 0.012 * ((s * 3 + k) % 5) as f32)).collect();
        g.tube(&path, 0.022 + 0.004 * (k % 3) as f32, 6, jacket);
    }
}

/// Sheet metal along +X, stiffened.
fn duct(g: &mut Geometry) {
    g.cuboid(vec3(0.0, -0.5, -0.7), vec3(MODULE_M, 0.5, 0.7), srgb(190, 194, 190));
    for k in 0..9 {
        let x = (MODULE_M - 0.08) * k as f32 / 8.0;
        g.cuboid(vec3(x, -0.56, -0.76), vec3(x + 0.08, 0.56, 0.76), GALVANISED);
    }
    for k in 0..16 {
        let x = 0.35 + 0.48 * k as f32;
        g.bar(vec3(x, 0.5, -0.66), vec3(x, 0.5, 0.66), [0.03, 0.05], GALVANISED);
    }
}

/// A gallery along +X: trusses on both sides, belt and rollers.
fn conveyor(g: &mut Geometry) {
    for z in [-1.0, 1.0] {
        for y in [0.0, 2.2] {
            g.bar(vec3(0.0, y, z), vec3(MODULE_M, y, z), [0.12, 0.16], PRIMER);
        }
        for k in 0..4 {
            let x = 2.0 * k as f32;
            let (low, high) = if k % 2 == 0 { (0.0, 2.2) } else { (2.2, 0.0) };
            g.bar(vec3(x, low, z), vec3(x + 2.0, high, z), [0.08, 0.1], PRIMER);
            g.bar(vec3(x, 0.0, z), vec3(x, 2.2, z), [0.08, 0.1], PRIMER);
        }
    }
    g.cuboid(vec3(0.0, 0.95, -0.5), vec3(MODULE_M, 0.98, 0.5), DARK);
    g.cuboid(vec3(0.0, 0.55, -0.5), vec3(MODULE_M, 0.58, 0.5), DARK);
    for k in 0..10 {
        let x = 0.4 + 0.8 * k as f32;
        g.tube(&[vec3(x, 0.85, -0.55), vec3(x, 0.85, 0.55)], 0.08, 12, GALVANISED);
        g.cuboid(vec3(x - 0.04, 0.0, -0.6), vec3(x + 0.04, 0.9, -0.55), STEEL);
        g.cuboid(vec3(x - 0.04, 0.0, 0.55), vec3(x + 0.04, 0.9, 0.6), STEEL);
    }
    // A roof of corrugated sheet.
    for k in 0..16 {
        let x = 0.5 * k as f32;
        g.bar(vec3(x + 0.25, 2.35, -1.2), vec3(x + 0.25, 2.35, 1.2), [0.42, 0.06], srgb(120, 140, 150));
    }
}

fn cabinet(g: &mut Geometry) {
    let (enamel, frame) = (srgb(206, 210, 206), srgb(84, 92, 98));
    g.block(Vec3::ZERO, vec3(1.0, 0.1, 0.8), DARK);
    g.block(vec3(0.0, 0.1, 0.0), vec3(1.0, 2.1, 0.8), frame);
    g.cuboid(vec3(-0.47, 0.15, 0.4), vec3(0.47, 2.15, 0.43), enamel);
    for k in 0..14 {
        let y = 0.3 + 0.04 * k as f32;
        g.cuboid(vec3(-0.3, y, 0.43), vec3(0.3, y + 0.02, 0.445), frame);
    }
    for (k, color) in [srgb(190, 40, 36), srgb(60, 150, 70), SAFETY_YELLOW].into_iter().enumerate() {
        let x = -0.2 + 0.2 * k as f32;
        g.tube(&[vec3(x, 1.9, 0.43), vec3(x, 1.9, 0.47)], 0.04, 12, color);
    }
    g.cuboid(vec3(0.36, 1.0, 0.43), vec3(0.4, 1.25, 0.48), DARK);
}

fn lamp(g: &mut Geometry) {
    g.tube(&[vec3(0.0, 0.0, 0.0), vec3(0.0, -0.8, 0.0)], 0.02, 6, STEEL);
    g.lathe(vec3(0.0, -1.1, 0.0), &[(0.0, 0.0), (0.26, 0.04), (0.3, 0.1), (0.1, 0.28), (0.0, 0.3)], 24, srgb(250, 240, 206));
}

/// A conduit that comes down from a tray.
fn cable_drop(g: &mut Geometry) {
    for k in 0..4 {
        let z = 0.09 * k as f32;
        let path = [vec3(0.0, 5.0, z), vec3(0.02, 3.0, z), vec3(0.0, 1.6, z), vec3(0.2, 1.3, z), vec3(0.4, 1.25, z)];
        g.tube(&path, 0.03, 8, DARK);
    }
    for k in 0..4 {
        let y = 1.8 + 0.9 * k as f32;
        g.cuboid(vec3(-0.06, y, -0.08), vec3(0.06, y + 0.04, 0.35), GALVANISED);
    }
}
