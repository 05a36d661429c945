//! The garbage can of Bartz, Meißner and Hüttner 1999 (section 5.1.4, Table 1): 2500 objects of about 2100 triangles
//! each, 5 331 146 in all, none of them fixed to another.
//!
//! The first object is the can, of sheet metal; the others lie in it at random, as [`heap`] lets them settle. All are
//! nodes of one root. Objects of one kind share their mesh. The can gets the triangles that the others leave.
//! Metres, true to life; the floor is y = 0.
mod fruit;
mod heap;
mod packs;
mod shapes;
mod vessels;

use super::glb_writer::{Alpha, Glb, GlbWriter, MaterialId, MeshId, Place, Sides};
use super::random::Random;
use super::solid::{Geometry, ring, srgb};
use glam::{Quat, Vec3, vec3};

/// Objects, the can among them.
const OBJECTS: usize = 2500;
/// Triangles of all objects together.
const TRIANGLES: usize = 5_331_146;
/// How far from the can's middle things lie, the radius of its wall, and the height of its rim.
const RADIUS_M: f32 = 0.52;
const WALL_M: f32 = 0.59;
const RIM_M: f32 = 1.1;

/// What lies in the can many times.
struct Kind {
    name: &'static str,
    mesh: MeshId,
    triangles: usize,
    /// Of the ball that stands for it while the heap settles.
    radius_m: f32,
}

/// The heap as a file.
pub fn generate(seed: u64) -> Glb {
    let mut random = Random::new(seed);
    let mut glb = GlbWriter::default();
    let paint = glb.material("paint", [1.0; 4], None, Alpha::Opaque, Sides::One);
    let sheet = glb.material("sheet", [1.0; 4], None, Alpha::Opaque, Sides::Both);
    let kinds = kinds(&mut glb, paint, &mut random.fork());
    // As many of each kind, or one more: what is left for the can is the same whatever the seed.
    let mut things: Vec<&Kind> = (1..OBJECTS).map(|k| &kinds[k % kinds.len()]).collect();
    shuffle(&mut things, &mut random.fork());
    let places = heap::settle(things.iter().map(|kind| kind.radius_m), &mut random.fork());
    let left = TRIANGLES - things.iter().map(|kind| kind.triangles).sum::<usize>();
    let can = glb.mesh("can", &[(&can(left), sheet)]);

    let root = glb.node(None, "garbage".into(), None, Place::at(Vec3::ZERO));
    glb.node(Some(root), "can".into(), Some(can), Place::at(Vec3::ZERO));
    let mut random = random.fork();
    for (k, (kind, at)) in things.iter().zip(places).enumerate() {
        let place = Place { rotation: Quat::from_array(random.rotation()), ..Place::at(at) };
        glb.node(Some(root), format!("{} {}", kind.name, k + 1), Some(kind.mesh), place);
    }
    glb.finish("mullion generate garbage")
}

fn shuffle<T>(list: &mut [T], random: &mut Random) {
    for k in (1..list.len()).rev() {
        list.swap(k, random.below(k + 1));
    }
}

fn kinds(glb: &mut GlbWriter, paint: MaterialId, random: &mut Random) -> Vec<Kind> {
    let mut shapes = vessels::all(random);
    shapes.extend(fruit::all(random));
    shapes.extend(packs::all(random));
    let kind = |(name, geometry): (&'static str, Geometry)| {
        let (low, high) = bounds(&geometry);
        let middle = (low + high) / 2.0;
        // Its node turns it about its middle.
        let mut centred = geometry;
        centred.positions.iter_mut().for_each(|p| *p -= middle);
        let radius_m = 0.88 * (high - low).element_sum() / 6.0;
        Kind { name, mesh: glb.mesh(name, &[(&centred, paint)]), triangles: centred.triangles(), radius_m }
    };
    shapes.into_iter().map(kind).collect()
}

fn bounds(geometry: &Geometry) -> (Vec3, Vec3) {
    geometry.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
}

/// Sides of an upright rib, and triangles of one of a single stretch.
const RIB_SIDES: usize = 4;
const RIB_TRIANGLES: usize = 2 * RIB_SIDES + 2 * (RIB_SIDES - 2);

/// A wall with hoops and ribs, a floor, with a plate that has exactly what is left of `triangles`.
fn can(triangles: usize) -> Geometry {
    let mut g = Geometry::default();
    let (zinc, dark, enamel) = (srgb(150, 158, 162), srgb(120, 128, 134), srgb(36, 96, 84));
    g.lathe(Vec3::ZERO, &[(0.0, 0.0), (WALL_M, 0.0), (WALL_M, RIM_M)], 48, zinc);
    for (y, thickness) in [(0.012, 0.012), (0.36, 0.008), (0.72, 0.008), (RIM_M, 0.016)] {
        g.torus(vec3(0.0, y, 0.0), WALL_M, thickness, [48, 4], dark);
    }
    let least_plate = 40;
    let ribs = ((triangles - g.triangles() - least_plate) / RIB_TRIANGLES).min(48);
    // As evenly as the places of a fine ring allow.
    let places = ring(192);
    for k in 0..ribs {
        let out = places[k * places.len() / ribs];
        let foot = vec3(out.x, 0.0, out.y) * WALL_M;
        g.tube(&[foot, foot + vec3(0.0, RIM_M, 0.0)], 0.008, RIB_SIDES, zinc);
    }
    let left = triangles - g.triangles();
    let (half, low, high, z) = (0.1, 0.79, 0.91, WALL_M + 0.02);
    let corners = [vec3(-half, low, z), vec3(half, low, z), vec3(half, high, z), vec3(-half, high, z)];
    shapes::plate(&mut g, corners, left, enamel);
    g
}
