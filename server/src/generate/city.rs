//! The cities of the papers: furnished buildings of about 3521 triangles each, with streets between.
//!
//! Blocks of twelve buildings: five by five of them, or four by three. Nodes: city, block, building, floor, room, furniture.
//! The city's centre is the origin, the street is y = 0, tall buildings stand in the middle.
mod building;
mod furniture;
mod roof;
mod street;

use super::glb_writer::{Alpha, Glb, GlbWriter, MaterialId, NodeId, Place, Sides, TextureId};
use super::random::Random;
use super::solid::{Color, Geometry, srgb};
use super::textures::{self, Facade};
use building::Plan;
use furniture::Stock;
use glam::{Vec2, Vec3, vec3};
use std::collections::BTreeMap;

/// How many blocks along X and Z.
#[derive(Clone, Copy)]
pub struct Blocks {
    x: usize,
    z: usize,
}

impl Blocks {
    /// 300 buildings.
    pub const FIVE_BY_FIVE: Blocks = Blocks { x: 5, z: 5 };
    /// 144 buildings.
    pub const FOUR_BY_THREE: Blocks = Blocks { x: 4, z: 3 };
}

const LOTS_X: usize = 4;
const LOTS_Z: usize = 3;
const LOT_X_M: f32 = 24.0;
const LOT_Z_M: f32 = 21.0;
const SIDEWALK_M: f32 = 4.0;
const CURB_M: f32 = 0.15;
const STREET_M: f32 = 13.0;
const BLOCK_X_M: f32 = LOTS_X as f32 * LOT_X_M + 2.0 * SIDEWALK_M;
const BLOCK_Z_M: f32 = LOTS_Z as f32 * LOT_Z_M + 2.0 * SIDEWALK_M;
const PITCH_X_M: f32 = BLOCK_X_M + STREET_M;
const PITCH_Z_M: f32 = BLOCK_Z_M + STREET_M;
/// Grass around the outermost street.
const MARGIN_M: f32 = 40.0;

/// Tints of facades, as sRGB.
const TINTS: [Color; 8] = [
    srgb(246, 232, 204),
    srgb(226, 170, 128),
    srgb(236, 200, 132),
    srgb(214, 132, 108),
    srgb(240, 214, 186),
    srgb(196, 200, 204),
    srgb(188, 194, 164),
    srgb(250, 244, 232),
];

/// Materials and meshes that the whole city shares.
struct Palette {
    paint: MaterialId,
    stone: MaterialId,
    glass: MaterialId,
    stock: Stock,
    facade_textures: [TextureId; 3],
    facades: BTreeMap<(Facade, usize), MaterialId>,
}

impl Palette {
    fn facade(&mut self, glb: &mut GlbWriter, kind: Facade, tint: usize) -> MaterialId {
        let texture = self.facade_textures[kind as usize];
        *self.facades.entry((kind, tint)).or_insert_with(|| {
            let name = format!("{kind:?} facade {tint}");
            glb.material(&name, factor(TINTS[tint]), Some(texture), Alpha::Opaque, Sides::One)
        })
    }
}

fn factor(color: Color) -> [f32; 4] {
    color.map(|c| f32::from(c) / 255.0)
}

/// A city as a file.
pub fn generate(seed: u64, blocks: Blocks) -> Glb {
    let mut random = Random::new(seed);
    let mut glb = GlbWriter::default();
    let mut art = random.fork();
    let facade_textures =
        [Facade::Plaster, Facade::Brick, Facade::Office].map(|kind| glb.texture(textures::facade(kind, &mut art)));
    let [asphalt, paving, grass, leaves] =
        [textures::asphalt, textures::paving, textures::grass, textures::leaves].map(|draw| glb.texture(draw(&mut art)));
    let white = [1.0; 4];
    let paint = glb.material("paint", white, None, Alpha::Opaque, Sides::One);
    let stone = glb.material("stone", factor(srgb(214, 202, 184)), Some(paving), Alpha::Opaque, Sides::One);
    let glass = glb.material("glass", [0.25, 0.35, 0.4, 0.35], None, Alpha::Blend, Sides::One);
    let asphalt = glb.material("asphalt", white, Some(asphalt), Alpha::Opaque, Sides::One);
    let pavement = glb.material("pavement", white, Some(paving), Alpha::Opaque, Sides::One);
    let grass = glb.material("grass", white, Some(grass), Alpha::Opaque, Sides::One);
    let leaves = glb.material("leaves", white, Some(leaves), Alpha::Mask, Sides::Both);
    let stock = Stock::new(&mut glb, paint);
    let mut palette = Palette { paint, stone, glass, stock, facade_textures, facades: BTreeMap::new() };
    let street = street::Furniture::new(&mut glb, paint, leaves, glass, &mut art);

    let city = glb.node(None, "city".into(), None, Place::at(Vec3::ZERO));
    ground(&mut glb, city, blocks, [asphalt, grass, paint]);
    let sidewalk = sidewalk(&mut glb, pavement);
    for b in 0..blocks.x * blocks.z {
        let mut random = random.fork();
        let middle = |count: usize| (count - 1) as f32 / 2.0;
        let cell = Vec2::new((b % blocks.x) as f32 - middle(blocks.x), (b / blocks.x) as f32 - middle(blocks.z));
        let center = vec3(cell.x * PITCH_X_M, 0.0, cell.y * PITCH_Z_M);
        let block = glb.node(Some(city), format!("block {}", b + 1), None, Place::at(center));
        glb.node(Some(block), "sidewalk".into(), Some(sidewalk), Place::at(Vec3::ZERO));
        for lot in 0..LOTS_X * LOTS_Z {
            let mut random = random.fork();
            let plan = Plan::draw(&mut random, 1.0 / (1.0 + 0.4 * cell.length_squared()));
            let place = lot_place(lot, &plan);
            let node = glb.node(Some(block), format!("building {}-{}", b + 1, lot + 1), None, place);
            building::build(&mut glb, &mut palette, node, &plan, &mut random);
        }
        line_streets(&mut glb, block, &street, &mut random);
    }
    glb.finish("mullion generate city")
}

/// Fronts face the street; the middle row's face the row behind it.
fn lot_place(lot: usize, plan: &Plan) -> Place {
    let (column, row) = (lot % LOTS_X, lot / LOTS_X);
    let x = (column as f32 - (LOTS_X - 1) as f32 / 2.0) * LOT_X_M;
    let z = (row as f32 - (LOTS_Z - 1) as f32 / 2.0) * LOT_Z_M;
    // Flush with the sidewalk, whatever the depth.
    let set_back = (LOT_Z_M - plan.depth_m) / 2.0 - 0.6;
    match row {
        0 => Place::turned(vec3(x, CURB_M, z - set_back), 2),
        2 => Place::turned(vec3(x, CURB_M, z + set_back), 0),
        _ => Place::turned(vec3(x, CURB_M, z), 2 * (column % 2)),
    }
}

/// Grass below, asphalt up to the outer edge of the outermost street, markings on it.
fn ground(glb: &mut GlbWriter, city: NodeId, blocks: Blocks, [asphalt, grass, paint]: [MaterialId; 3]) {
    let half = Vec2::new(PITCH_X_M * blocks.x as f32, PITCH_Z_M * blocks.z as f32) / 2.0 + STREET_M / 2.0;
    let mut field = Geometry::default();
    // Four strips around the asphalt: nothing lies in the same plane as something else.
    let (x, z, far_x, far_z) = (half.x, half.y, half.x + MARGIN_M, half.y + MARGIN_M);
    for [x0, z0, x1, z1] in [[-far_x, z, far_x, far_z], [-far_x, -far_z, far_x, -z], [x, -z, far_x, z], [-far_x, -z, -x, z]] {
        flat(&mut field, x0, z0, x1, z1, 6.0);
    }
    let mesh = glb.mesh("grass", &[(&field, grass)]);
    glb.node(Some(city), "grass".into(), Some(mesh), Place::at(Vec3::ZERO));

    let lane = srgb(228, 224, 210);
    let along = |k: usize, count: usize, pitch: f32| (k as f32 - count as f32 / 2.0) * pitch;
    for k in 0..=blocks.x.max(blocks.z) {
        if k <= blocks.z {
            avenue(glb, city, k, along(k, blocks.z, PITCH_Z_M), half.x, [asphalt, paint], lane);
        }
        if k <= blocks.x {
            street(glb, city, k, along(k, blocks.x, PITCH_X_M), blocks.z, [asphalt, paint], lane);
        }
    }
}

/// The road along X at `z`.
fn avenue(glb: &mut GlbWriter, city: NodeId, k: usize, z: f32, half_x: f32, [asphalt, paint]: [MaterialId; 2], lane: Color) {
    let mut avenue = Geometry::default();
    flat(&mut avenue, -half_x, z - STREET_M / 2.0, half_x, z + STREET_M / 2.0, 8.0);
    let mut marks = Geometry::default();
    dashes(&mut marks, half_x, |from, to| [from, z - 0.08, to, z + 0.08], lane);
    let mesh = glb.mesh("avenue", &[(&avenue, asphalt), (&marks, paint)]);
    glb.node(Some(city), format!("avenue {}", k + 1), Some(mesh), Place::at(Vec3::ZERO));
}

/// The roads along Z at `x`, between the avenues.
fn street(glb: &mut GlbWriter, city: NodeId, k: usize, x: f32, rows: usize, [asphalt, paint]: [MaterialId; 2], lane: Color) {
    let mut road = Geometry::default();
    let mut marks = Geometry::default();
    for row in 0..rows {
        let z = (row as f32 - (rows - 1) as f32 / 2.0) * PITCH_Z_M;
        let (z0, z1) = (z - BLOCK_Z_M / 2.0, z + BLOCK_Z_M / 2.0);
        flat(&mut road, x - STREET_M / 2.0, z0, x + STREET_M / 2.0, z1, 8.0);
        for end in [z0 + 0.8, z1 - 2.8] {
            zebra(&mut marks, x, end, lane);
        }
    }
    let mesh = glb.mesh("street", &[(&road, asphalt), (&marks, paint)]);
    glb.node(Some(city), format!("street {}", k + 1), Some(mesh), Place::at(Vec3::ZERO));
}

fn flat(g: &mut Geometry, x0: f32, z0: f32, x1: f32, z1: f32, repeat_m: f32) {
    let corners = [vec3(x0, 0.0, z1), vec3(x1, 0.0, z1), vec3(x1, 0.0, z0), vec3(x0, 0.0, z0)];
    g.textured(corners, Vec2::new(x0, z1) / repeat_m, Vec2::new(x1, z0) / repeat_m);
}

/// Height of road markings above the road.
const MARK_M: f32 = 0.02;

fn mark(g: &mut Geometry, [x0, z0, x1, z1]: [f32; 4], color: Color) {
    let y = MARK_M;
    g.polygon(&[vec3(x0, y, z1), vec3(x1, y, z1), vec3(x1, y, z0), vec3(x0, y, z0)], color);
}

fn dashes(g: &mut Geometry, half: f32, rectangle: impl Fn(f32, f32) -> [f32; 4], color: Color) {
    let count = (2.0 * half / 8.0) as usize;
    for k in 0..count {
        let from = -half + 8.0 * k as f32 + 2.0;
        mark(g, rectangle(from, from + 4.0), color);
    }
}

fn zebra(g: &mut Geometry, x: f32, z: f32, color: Color) {
    for k in 0..8 {
        let left = x - STREET_M / 2.0 + 0.8 + k as f32 * 1.5;
        mark(g, [left, z, left + 0.7, z + 2.0], color);
    }
}

fn sidewalk(glb: &mut GlbWriter, pavement: MaterialId) -> super::glb_writer::MeshId {
    let half = vec3(BLOCK_X_M / 2.0, 0.0, BLOCK_Z_M / 2.0);
    let mut slab = Geometry::default();
    slab.paving(-half, half + vec3(0.0, CURB_M, 0.0), 4.0);
    glb.mesh("sidewalk", &[(&slab, pavement)])
}

/// Trees, lamp posts and parked cars along the four edges of a block.
fn line_streets(glb: &mut GlbWriter, block: NodeId, street: &street::Furniture, random: &mut Random) {
    let parent = glb.node(Some(block), "street furniture".into(), None, Place::at(Vec3::ZERO));
    // Outwards from each edge: +Z, +X, -Z, -X, as quarter turns about Y.
    for side in 0..4 {
        let (length, out) = if side % 2 == 0 { (BLOCK_X_M, BLOCK_Z_M / 2.0) } else { (BLOCK_Z_M, BLOCK_X_M / 2.0) };
        let edge = glb.node(Some(parent), format!("edge {}", side + 1), None, Place::turned(Vec3::ZERO, side));
        let stops = (length / 9.0) as usize;
        for k in 0..stops {
            let x = (k as f32 + 0.5 - stops as f32 / 2.0) * 9.0;
            let verge = vec3(x, CURB_M, out - 1.0);
            if k % 3 == 1 {
                let place = Place::turned(verge, 3);
                glb.node(Some(edge), "lamp post".into(), Some(street.lamp_post), place);
            } else if random.chance(0.85) {
                let scale = random.range(0.85, 1.2);
                let place = Place { scale: Vec3::splat(scale), ..Place::turned(verge, random.below(4)) };
                glb.node(Some(edge), "tree".into(), Some(*random.pick(&street.trees)), place);
            }
            if random.chance(0.3) {
                let place = Place::turned(vec3(x + 4.5, 0.0, out + 1.4), 1 + 2 * random.below(2));
                glb.node(Some(edge), "car".into(), Some(*random.pick(&street.cars)), place);
            }
        }
    }
}
