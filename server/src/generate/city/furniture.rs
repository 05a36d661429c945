//! Furniture: meshes made once and used by many rooms. Colours are in the vertices.
use crate::generate::glb_writer::{GlbWriter, MaterialId, MeshId};
use crate::generate::solid::{Color, Geometry, srgb};
use glam::{Vec3, vec3};

const OAK: Color = srgb(176, 128, 78);
const WALNUT: Color = srgb(104, 70, 46);
const LINEN: Color = srgb(232, 222, 204);
const STEEL: Color = srgb(150, 154, 160);
const DARK: Color = srgb(48, 50, 56);
const CERAMIC: Color = srgb(240, 240, 236);

/// A piece that a room can hold, within 2 m by 2 m around its origin.
pub struct Piece {
    pub name: &'static str,
    pub mesh: MeshId,
    pub triangles: usize,
}

/// The stock that rooms are furnished from.
pub struct Stock {
    /// Sorted by name, all larger than [`Stock::carton`].
    pub pieces: Vec<Piece>,
    /// 12 triangles: fills what furniture leaves of a budget.
    pub carton: Piece,
    /// 2 triangles: fills what cartons leave.
    pub rug: Piece,
}

impl Stock {
    pub fn new(glb: &mut GlbWriter, paint: MaterialId) -> Stock {
        let mut add = |name: &'static str, build: &dyn Fn(&mut Geometry)| {
            let mut geometry = Geometry::default();
            build(&mut geometry);
            Piece { name, mesh: glb.mesh(name, &[(&geometry, paint)]), triangles: geometry.triangles() }
        };
        let teal = srgb(52, 116, 120);
        let rust = srgb(178, 84, 52);
        let pieces = vec![
            add("bed", &|g| bed(g, srgb(92, 118, 158))),
            add("desk", &desk),
            add("dining set", &dining_set),
            add("double bed", &|g| {
                bed(g, srgb(166, 72, 70));
                lamp(g, vec3(-0.98, 0.0, -0.9), 0.9);
            }),
            add("floor lamp", &|g| lamp(g, Vec3::ZERO, 1.7)),
            add("kitchen", &kitchen),
            add("rust sofa", &|g| sofa(g, rust)),
            add("shelf", &shelf),
            add("table", &|g| table(g, Vec3::ZERO, vec3(1.4, 0.74, 0.8))),
            add("teal sofa", &|g| sofa(g, teal)),
            add("wardrobe", &wardrobe),
        ];
        let carton = add("carton", &|g| g.block(Vec3::ZERO, vec3(0.5, 0.4, 0.4), srgb(190, 152, 104)));
        let rug = add("rug", &|g| {
            let (x, z, y) = (0.9, 0.6, 0.01);
            g.polygon(&[vec3(-x, y, z), vec3(x, y, z), vec3(x, y, -z), vec3(-x, y, -z)], rust);
        });
        Stock { pieces, carton, rug }
    }
}

/// 60 triangles.
fn table(g: &mut Geometry, base: Vec3, size: Vec3) {
    g.block(base + vec3(0.0, size.y - 0.05, 0.0), vec3(size.x, 0.05, size.z), OAK);
    legs(g, base, vec3(size.x, size.y - 0.05, size.z), 0.06, OAK);
}

fn legs(g: &mut Geometry, base: Vec3, size: Vec3, thickness: f32, color: Color) {
    let (x, z) = (size.x / 2.0 - thickness, size.z / 2.0 - thickness);
    for (x, z) in [(-x, -z), (x, -z), (x, z), (-x, z)] {
        g.block(base + vec3(x, 0.0, z), vec3(thickness, size.y, thickness), color);
    }
}

/// 72 triangles; `back` is the side of the backrest along z.
fn chair(g: &mut Geometry, base: Vec3, back: f32) {
    g.block(base + vec3(0.0, 0.42, 0.0), vec3(0.42, 0.05, 0.42), WALNUT);
    legs(g, base, vec3(0.42, 0.42, 0.42), 0.04, WALNUT);
    g.block(base + vec3(0.0, 0.47, back * 0.19), vec3(0.42, 0.45, 0.04), WALNUT);
}

/// A table with four chairs: 348 triangles.
fn dining_set(g: &mut Geometry) {
    table(g, Vec3::ZERO, vec3(1.5, 0.74, 0.9));
    for x in [-0.4, 0.4] {
        for side in [-1.0, 1.0] {
            chair(g, vec3(x, 0.0, side * 0.7), side);
        }
    }
}

fn bed(g: &mut Geometry, blanket: Color) {
    g.block(vec3(0.0, 0.15, 0.0), vec3(1.5, 0.15, 2.0), WALNUT);
    g.block(vec3(0.0, 0.3, 0.0), vec3(1.46, 0.2, 1.96), LINEN);
    g.block(vec3(0.0, 0.42, 0.25), vec3(1.54, 0.1, 1.5), blanket);
    g.block(vec3(0.0, 0.15, -1.0), vec3(1.56, 0.85, 0.06), WALNUT);
    for x in [-0.36, 0.36] {
        g.block(vec3(x, 0.5, -0.75), vec3(0.56, 0.12, 0.36), CERAMIC);
    }
    legs(g, Vec3::ZERO, vec3(1.5, 0.15, 2.0), 0.08, WALNUT);
}

fn lamp(g: &mut Geometry, base: Vec3, height: f32) {
    g.prism(base, 0.15, 0.15, 0.03, 8, DARK);
    g.prism(base + vec3(0.0, 0.03, 0.0), 0.015, 0.015, height - 0.3, 6, STEEL);
    g.prism(base + vec3(0.0, height - 0.3, 0.0), 0.22, 0.14, 0.28, 12, srgb(250, 226, 170));
}

fn sofa(g: &mut Geometry, cloth: Color) {
    g.block(vec3(0.0, 0.12, 0.0), vec3(1.9, 0.2, 0.85), cloth);
    g.block(vec3(0.0, 0.12, -0.36), vec3(1.9, 0.72, 0.18), cloth);
    for x in [-0.88, 0.88] {
        g.block(vec3(x, 0.12, 0.0), vec3(0.18, 0.5, 0.85), cloth);
    }
    for x in [-0.52, 0.0, 0.52] {
        g.block(vec3(x, 0.32, 0.08), vec3(0.5, 0.14, 0.66), LINEN);
    }
    legs(g, Vec3::ZERO, vec3(1.9, 0.12, 0.85), 0.06, WALNUT);
}

fn shelf(g: &mut Geometry) {
    let books = [srgb(150, 44, 40), srgb(38, 78, 120), srgb(214, 170, 62), srgb(60, 104, 70), srgb(120, 80, 130)];
    for x in [-0.6, 0.6] {
        g.block(vec3(x, 0.0, 0.0), vec3(0.04, 2.0, 0.32), OAK);
    }
    g.block(vec3(0.0, 0.0, -0.15), vec3(1.2, 2.0, 0.02), OAK);
    for level in 0..5 {
        let y = 0.06 + 0.46 * level as f32;
        g.block(vec3(0.0, y, 0.0), vec3(1.16, 0.03, 0.3), OAK);
        if level < 4 {
            let x = -0.3 + 0.17 * level as f32;
            g.block(vec3(x, y + 0.03, 0.02), vec3(0.4, 0.28, 0.2), books[level]);
            g.block(vec3(x + 0.32, y + 0.03, 0.02), vec3(0.22, 0.24, 0.18), books[level + 1]);
        }
    }
}

fn wardrobe(g: &mut Geometry) {
    g.block(Vec3::ZERO, vec3(1.4, 2.1, 0.6), OAK);
    for side in [-1.0, 1.0] {
        g.block(vec3(side * 0.35, 0.06, 0.31), vec3(0.66, 1.98, 0.02), LINEN);
        g.block(vec3(side * 0.06, 1.0, 0.34), vec3(0.02, 0.2, 0.03), STEEL);
    }
}

fn desk(g: &mut Geometry) {
    table(g, Vec3::ZERO, vec3(1.5, 0.72, 0.75));
    g.block(vec3(0.5, 0.1, 0.0), vec3(0.4, 0.56, 0.6), WALNUT);
    g.block(vec3(0.0, 0.72, -0.2), vec3(0.24, 0.02, 0.18), DARK);
    g.block(vec3(0.0, 0.74, -0.2), vec3(0.05, 0.14, 0.04), DARK);
    g.block(vec3(0.0, 0.86, -0.18), vec3(0.6, 0.36, 0.03), DARK);
    g.block(vec3(0.0, 0.72, 0.12), vec3(0.44, 0.02, 0.14), STEEL);
    chair(g, vec3(0.0, 0.0, 0.6), 1.0);
}

fn kitchen(g: &mut Geometry) {
    g.block(vec3(0.0, 0.1, -0.6), vec3(1.9, 0.76, 0.6), CERAMIC);
    g.block(vec3(0.0, 0.86, -0.59), vec3(1.96, 0.04, 0.64), WALNUT);
    g.block(vec3(0.0, 1.5, -0.72), vec3(1.9, 0.6, 0.35), CERAMIC);
    for x in [-0.7, -0.23, 0.23, 0.7] {
        g.block(vec3(x, 0.14, -0.29), vec3(0.43, 0.68, 0.02), LINEN);
    }
    g.block(vec3(0.45, 0.9, -0.6), vec3(0.5, 0.01, 0.4), DARK);
    g.prism(vec3(-0.5, 0.9, -0.6), 0.16, 0.18, 0.06, 12, STEEL);
    g.prism(vec3(0.4, 0.91, -0.55), 0.11, 0.11, 0.16, 8, rust_pot());
}

const fn rust_pot() -> Color {
    srgb(188, 78, 48)
}
