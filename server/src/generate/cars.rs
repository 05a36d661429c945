//! Five cars with engines, like the model of Klosowski and Silva (*Rendering on a Budget*, 1999): bodies of large panels over engines, gears,
//! running gear and seats that hold nearly all of the triangles. Five different models, parked in two rows.
//!
//! Metres; a car's front is towards +X, its middle is the origin, it stands on y = 0.
mod body;
mod cabin;
mod engine;
mod parts;
mod running_gear;

use super::glb_writer::{Alpha, Glb, GlbWriter, MaterialId, NodeId, Place, Sides};
use super::random::Random;
use super::solid::{Color, Geometry, srgb};
use glam::{Vec3, vec3};

/// What a car is like.
struct Model {
    name: &'static str,
    length_m: f32,
    width_m: f32,
    height_m: f32,
    wheelbase_m: f32,
    /// Where along the length, 0 the tail and 1 the nose, the roof begins and ends at the foot of the rear window, at its head, at the head of
    /// the windscreen and at its foot.
    cabin: [f32; 4],
    /// Height of the boot's lid.
    tail_m: f32,
    cylinders: usize,
    lacquer: Color,
}

const MODELS: [Model; 5] = [
    Model {
        name: "saloon",
        length_m: 4.7,
        width_m: 1.8,
        height_m: 1.43,
        wheelbase_m: 2.8,
        cabin: [0.16, 0.3, 0.56, 0.7],
        tail_m: 1.0,
        cylinders: 6,
        lacquer: srgb(150, 34, 40),
    },
    Model {
        name: "estate",
        length_m: 4.6,
        width_m: 1.78,
        height_m: 1.48,
        wheelbase_m: 2.7,
        cabin: [0.02, 0.08, 0.56, 0.69],
        tail_m: 0.95,
        cylinders: 5,
        lacquer: srgb(40, 74, 116),
    },
    Model {
        name: "coupe",
        length_m: 4.4,
        width_m: 1.84,
        height_m: 1.29,
        wheelbase_m: 2.5,
        cabin: [0.1, 0.36, 0.5, 0.66],
        tail_m: 0.88,
        cylinders: 8,
        lacquer: srgb(214, 168, 44),
    },
    Model {
        name: "hatchback",
        length_m: 3.9,
        width_m: 1.7,
        height_m: 1.46,
        wheelbase_m: 2.45,
        cabin: [0.03, 0.15, 0.56, 0.72],
        tail_m: 0.9,
        cylinders: 4,
        lacquer: srgb(228, 226, 218),
    },
    Model {
        name: "van",
        length_m: 4.5,
        width_m: 1.9,
        height_m: 1.78,
        wheelbase_m: 2.85,
        cabin: [0.01, 0.05, 0.66, 0.82],
        tail_m: 1.0,
        cylinders: 4,
        lacquer: srgb(74, 104, 84),
    },
];

/// Where each car stands, and the half tangent of how it is turned.
const PLACES: [(Vec3, f32); 5] = [
    (vec3(-3.2, 0.0, -4.1), 0.05),
    (vec3(-3.0, 0.0, -0.3), -0.04),
    (vec3(2.9, 0.0, -2.6), 0.9),
    (vec3(-2.6, 0.0, 3.6), 0.02),
    (vec3(3.3, 0.0, 2.3), -1.1),
];

/// The cars as a file.
pub fn generate(seed: u64) -> Glb {
    let mut random = Random::new(seed);
    let mut glb = GlbWriter::default();
    let paint = glb.material("paint", [1.0; 4], None, Alpha::Opaque, Sides::One);
    let all = glb.node(None, "cars".into(), None, Place::at(Vec3::ZERO));
    for (model, (at, turned)) in MODELS.iter().zip(PLACES) {
        let car = glb.node(Some(all), model.name.into(), None, Place::yawed(at, turned));
        car_parts(&mut glb, paint, car, model, &mut random.fork());
    }
    glb.finish("mullion generate cars")
}

fn car_parts(glb: &mut GlbWriter, paint: MaterialId, car: NodeId, model: &Model, random: &mut Random) {
    let mut add = |parent: NodeId, name: &str, geometry: &Geometry, at: Vec3| {
        let mesh = glb.mesh(name, &[(geometry, paint)]);
        glb.node(Some(parent), name.into(), Some(mesh), Place::at(at))
    };
    let shell = add(car, "body", &body::outer(model), Vec3::ZERO);
    add(shell, "inner panels", &body::inner(model), Vec3::ZERO);
    add(shell, "floor", &body::floor(model), Vec3::ZERO);
    add(shell, "bumpers", &body::bumpers(model), Vec3::ZERO);
    let bay = engine::middle(model);
    let block = add(car, "engine", &engine::block(model), bay);
    add(block, "pistons", &engine::pistons(model), Vec3::ZERO);
    add(block, "valves", &engine::valves(model), Vec3::ZERO);
    add(block, "manifolds", &engine::manifolds(model), Vec3::ZERO);
    add(block, "ancillaries", &engine::ancillaries(), Vec3::ZERO);
    add(block, "gearbox", &engine::gearbox(), Vec3::ZERO);
    add(car, "radiator", &engine::radiator(model), Vec3::ZERO);
    add(car, "wiring", &engine::wiring(model, random), Vec3::ZERO);
    add(car, "exhaust", &running_gear::exhaust(model), Vec3::ZERO);
    for (name, at) in running_gear::wheels(model) {
        let wheel = add(car, name, &running_gear::wheel(), at);
        add(wheel, "strut", &running_gear::strut(), vec3(0.0, 0.0, -0.16 * at.z.signum()));
    }
    add(car, "seats", &cabin::seats(model), Vec3::ZERO);
    add(car, "dashboard", &cabin::dashboard(model), Vec3::ZERO);
}
