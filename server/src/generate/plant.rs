//! A power plant of the size that the paper culls (Nirnimesh, Harish, Narayanan 2006, section 5): the node tree of
//! UNC's plant, 1118 inner nodes over 3919 leaves, in a building 144 m long.
//!
//! Nodes: plant, area, level, system, assembly, part. X runs along the building, the yard lies at −Z, the ground is
//! y = 0. Every part is one mesh of one primitive. Steel, floors and machines come first; the pipework then takes what
//! they leave of both numbers.
mod machines;
mod pipe_parts;
mod pipework;
mod stock;
mod yard;

use super::glb_writer::{Alpha, Glb, GlbWriter, MeshId, NodeId, Place, Sides};
use super::random::Random;
use glam::{Vec3, vec3};
use machines::Machines;
use pipework::Rack;
use stock::{PANEL_M, Stock};

/// Nodes without a mesh, and nodes with one.
const GROUPS: usize = 1118;
const LEAVES: usize = 3919;

/// Extent of an area and a level, metres: x from 0, y from 0, z to both sides.
const AREA_M: f32 = 24.0;
const LEVEL_M: f32 = 6.0;
const HALF_WIDTH_M: f32 = 18.0;
/// Frames stand so far apart.
const BAY_M: f32 = 8.0;
/// Lines of columns.
const COLUMNS_Z_M: [f32; 4] = [-17.0, -6.0, 6.0, 17.0];

/// Name, number of levels and what stands there.
const AREAS: [(&str, usize, Kind); 6] = [
    ("coal handling", 4, Kind::Fans),
    ("boiler house 1", 6, Kind::Boiler),
    ("boiler house 2", 6, Kind::Boiler),
    ("turbine hall", 5, Kind::Turbine),
    ("water treatment", 5, Kind::Vessels),
    ("switchgear", 4, Kind::Cabinets),
];

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Fans,
    Boiler,
    Turbine,
    Vessels,
    Cabinets,
}

/// Adds parts to the tree.
struct Builder {
    glb: GlbWriter,
    stock: Stock,
    machines: Machines,
}

impl Builder {
    fn group(&mut self, parent: NodeId, name: impl Into<String>, place: Place) -> NodeId {
        self.glb.node(Some(parent), name.into(), None, place)
    }

    fn part(&mut self, parent: NodeId, name: &str, mesh: MeshId, place: Place) {
        self.glb.node(Some(parent), name.into(), Some(mesh), place);
    }
}

/// The plant as a file.
pub fn generate(seed: u64) -> Glb {
    let mut random = Random::new(seed);
    let mut glb = GlbWriter::default();
    let paint = glb.material("paint", [1.0; 4], None, Alpha::Opaque, Sides::One);
    let (stock, machines) = (Stock::new(&mut glb, paint), Machines::new(&mut glb, paint));
    let pipes = pipe_parts::PipeParts::all(&mut glb, paint);
    let plant = glb.node(None, "plant".into(), None, Place::at(Vec3::ZERO));
    let mut builder = Builder { glb, stock, machines };
    let mut racks = Vec::new();
    for (k, (name, levels, kind)) in AREAS.into_iter().enumerate() {
        let mut random = random.fork();
        let x = (k as f32 - AREAS.len() as f32 / 2.0) * AREA_M;
        let area = builder.group(plant, name, Place::at(vec3(x, 0.0, 0.0)));
        for storey in 0..levels {
            let level = Level { kind, storey, is_top: storey + 1 == levels };
            racks.extend(level.build(&mut builder, area, &mut random.fork()));
        }
    }
    yard::build(&mut builder, plant, paint);
    let [leaves, groups] = builder.glb.leaves_and_groups();
    pipework::fill(&mut builder.glb, &pipes, &racks, [LEAVES - leaves, GROUPS - groups], &mut random.fork());
    builder.glb.finish("mullion generate plant")
}

struct Level {
    kind: Kind,
    storey: usize,
    is_top: bool,
}

impl Level {
    /// A level with its systems; gives the racks that wait for pipes.
    fn build(&self, b: &mut Builder, area: NodeId, random: &mut Random) -> Vec<Rack> {
        let at = vec3(0.0, self.storey as f32 * LEVEL_M, 0.0);
        let level = b.group(area, format!("level {}", self.storey), Place::at(at));
        self.steel(b, level, random);
        self.floors(b, level, random);
        self.electrical(b, level, random);
        self.equipment(b, level, random);
        ventilation(b, level, random);
        let pipework = b.group(level, "pipework", Place::at(Vec3::ZERO));
        [-11.5, 11.5]
            .into_iter()
            .enumerate()
            .map(|(k, z)| {
                let at = vec3(0.0, 4.3, z);
                Rack { node: b.group(pipework, format!("rack {}", k + 1), Place::at(at)) }
            })
            .collect()
    }

    /// Frames across, girders along, braces in both.
    fn steel(&self, b: &mut Builder, level: NodeId, random: &mut Random) {
        let steel = b.group(level, "steel", Place::at(Vec3::ZERO));
        let (beam, column, brace) = (b.stock.beam, b.stock.column, b.stock.brace);
        let top = LEVEL_M - 0.3;
        for k in 0..3 {
            let frame = b.group(steel, format!("frame {}", k + 1), Place::at(vec3(k as f32 * BAY_M + 0.5, 0.0, 0.0)));
            for z in COLUMNS_Z_M {
                let place = Place::between(vec3(0.0, 0.0, z), vec3(0.0, LEVEL_M, z), [0.5, 0.8]);
                b.part(frame, "column", column, place);
            }
            for z in COLUMNS_Z_M.windows(2) {
                let place = Place::between(vec3(0.0, top, z[0]), vec3(0.0, top, z[1]), [0.6, 0.6]);
                b.part(frame, "beam", beam, place);
            }
            for _ in 0..1 + random.below(3) {
                let bay = random.below(3);
                let (near, far) = (COLUMNS_Z_M[bay], COLUMNS_Z_M[bay + 1]);
                let (from, to) = if random.chance(0.5) { (near, far) } else { (far, near) };
                let place = Place::between(vec3(0.0, 0.2, from), vec3(0.0, top - 0.2, to), [0.25, 0.4]);
                b.part(frame, "brace", brace, place);
            }
        }
        let girders = b.group(steel, "girders", Place::at(Vec3::ZERO));
        for z in COLUMNS_Z_M {
            let place = Place::between(vec3(0.0, top, z), vec3(AREA_M, top, z), [0.6, 0.6]);
            b.part(girders, "girder", beam, place);
        }
        for z in [COLUMNS_Z_M[0], COLUMNS_Z_M[3]] {
            let bay = random.below(3) as f32 * BAY_M + 0.5;
            let place = Place::between(vec3(bay, 0.2, z), vec3((bay + BAY_M).min(AREA_M), top - 0.2, z), [0.3, 0.4]);
            b.part(girders, "wind brace", brace, place);
        }
    }

    /// Gratings over the level with openings in them, rails around, stairs up.
    fn floors(&self, b: &mut Builder, level: NodeId, random: &mut Random) {
        let floors = b.group(level, "floors", Place::at(Vec3::ZERO));
        let [length, across] = PANEL_M;
        let gratings = b.group(floors, "gratings", Place::at(vec3(0.0, LEVEL_M, -HALF_WIDTH_M)));
        // Boilers and turbines stand in a shaft; elsewhere there is one opening or a few.
        let has_shaft = matches!(self.kind, Kind::Boiler | Kind::Turbine);
        let opening = random.below(9);
        for panel in 0..9 {
            let (x, z) = (panel % 3, panel / 3);
            let in_shaft = has_shaft && z == 1 && x == 1;
            let is_open = panel == opening || in_shaft || self.is_top && z != 0 || random.chance(0.15);
            if !is_open {
                let at = vec3(x as f32 * length, 0.0, z as f32 * across);
                b.part(gratings, "grating", b.stock.grating, Place::at(at));
            }
        }
        let rails = b.group(floors, "handrails", Place::at(vec3(0.0, LEVEL_M, 0.0)));
        for k in 0..3 {
            let z = if random.chance(0.5) { HALF_WIDTH_M } else { -HALF_WIDTH_M };
            b.part(rails, "handrail", b.stock.handrail, Place::at(vec3(k as f32 * 8.0, 0.0, z)));
        }
        let stair = b.group(floors, "stairs", Place::yawed(vec3(20.0, 0.0, -15.0), random.range(-0.06, 0.06)));
        b.part(stair, "flight", b.stock.stair, Place::turned(vec3(0.0, 0.0, 0.6), 2));
        b.part(stair, "landing", b.stock.landing, Place::turned(vec3(-4.2, 3.0, 0.0), 2));
        b.part(stair, "flight", b.stock.stair, Place::at(vec3(-4.2, 3.0, -0.6)));
    }

    /// Trays along the building, what hangs from them, lamps, cabinets.
    fn electrical(&self, b: &mut Builder, level: NodeId, random: &mut Random) {
        let electrical = b.group(level, "electrical", Place::at(Vec3::ZERO));
        let z = *random.pick(&[-3.0, 3.0, 4.5, -4.5]);
        let trays = b.group(electrical, "cable trays", Place::at(vec3(0.0, 4.9, z)));
        for k in 0..3 {
            b.part(trays, "cable tray", b.stock.tray, Place::at(vec3(k as f32 * stock::MODULE_M, 0.0, 0.0)));
        }
        for _ in 0..random.below(3) {
            let at = vec3(random.range(1.0, 23.0), -4.8, 0.35);
            b.part(trays, "cable drop", b.stock.cable_drop, Place::yawed(at, random.range(-1.0, 1.0)));
        }
        let lamps = b.group(electrical, "lighting", Place::at(vec3(0.0, LEVEL_M - 0.4, 0.0)));
        for k in 0..4 {
            let at = vec3(6.0 + 12.0 * (k % 2) as f32, 0.0, if k < 2 { -9.0 } else { 9.0 });
            b.part(lamps, "lamp", b.stock.lamp, Place::at(at));
        }
        let place = Place::yawed(vec3(random.range(3.0, 12.0), 0.1, 7.2), random.range(-0.1, 0.1));
        let cabinets = b.group(electrical, "cabinets", place);
        let count = if self.kind == Kind::Cabinets { 9 } else { 2 + random.below(2) };
        for k in 0..count {
            b.part(cabinets, "cabinet", b.stock.cabinet, Place::turned(vec3(k as f32 * 1.02, 0.0, 0.0), 2));
        }
    }

    /// Three machines with what belongs to them; the area decides what stands in the middle.
    fn equipment(&self, b: &mut Builder, level: NodeId, random: &mut Random) {
        let equipment = b.group(level, "equipment", Place::at(vec3(0.0, 0.05, 0.0)));
        let middle = vec3(12.0, 0.0, 0.0);
        match self.kind {
            Kind::Boiler => boiler(b, equipment, middle),
            Kind::Turbine if self.storey == 1 => turbine(b, equipment, middle),
            Kind::Vessels => vessel(b, equipment, middle, random),
            Kind::Fans => fan(b, equipment, middle, random),
            Kind::Turbine | Kind::Cabinets => exchanger(b, equipment, middle, random),
        }
        for (k, z) in [-10.5, 10.5].into_iter().enumerate() {
            let at = vec3(random.range(6.0, 18.0), 0.0, z);
            match (self.storey + k + random.below(2)) % 4 {
                0 | 3 => pump(b, equipment, at, random),
                1 => exchanger(b, equipment, at, random),
                _ => vessel(b, equipment, at, random),
            }
        }
    }
}

/// Sheet metal ducts, straight or climbing at an angle of their own.
fn ventilation(b: &mut Builder, level: NodeId, random: &mut Random) {
    let z = random.range(-3.0, 3.0);
    let duct = b.group(level, "ventilation", Place::yawed(vec3(1.0, 3.4, z), random.range(-0.12, 0.12)));
    let modules = 2 + random.below(2);
    for k in 0..modules {
        let at = vec3(k as f32 * 7.2, 0.0, 0.0);
        let climb = if k == 1 { random.range(-0.1, 0.25) } else { 0.0 };
        let to = at + vec3(1.0, climb, 0.0);
        // The mesh is a module long already.
        let place = Place { scale: Vec3::ONE, ..Place::between(at, to, [1.0, 1.0]) };
        b.part(duct, "duct", b.stock.duct, place);
    }
    b.part(duct, "riser", b.stock.duct, Place::facing(vec3(0.5, -3.0, 0.0), Vec3::Y, -Vec3::X).scaled(vec3(0.4, 0.9, 0.9)));
}

fn boiler(b: &mut Builder, parent: NodeId, at: Vec3) {
    let boiler = b.group(parent, "boiler", Place::at(at));
    b.part(boiler, "casing", b.machines.casing, Place::at(vec3(0.0, 0.0, -1.9)));
    b.part(boiler, "casing", b.machines.casing, Place::turned(vec3(0.0, 0.0, 1.9), 2));
    b.part(boiler, "header", b.machines.header, Place::at(vec3(0.0, 4.6, 4.6)));
    b.part(boiler, "burner", b.machines.burner, Place::at(vec3(-1.6, 2.0, 3.6)));
    b.part(boiler, "burner", b.machines.burner, Place::at(vec3(1.6, 2.0, 3.6)));
}

fn turbine(b: &mut Builder, parent: NodeId, at: Vec3) {
    let set = b.group(parent, "turbine set", Place::at(at));
    b.part(set, "turbine", b.machines.turbine, Place::at(vec3(-4.0, 0.0, 0.0)));
    b.part(set, "generator", b.machines.generator, Place::at(vec3(3.4, 0.0, 0.0)));
    b.part(set, "exciter", b.machines.motor, Place::at(vec3(7.6, 0.6, 0.0)));
}

/// Machines stand at angles of their own, as retrofits do.
fn odd(at: Vec3, random: &mut Random) -> Place {
    let half_tangent = if random.chance(0.5) { random.range(-0.8, 0.8) } else { 0.0 };
    Place::yawed(at, half_tangent)
}

fn pump(b: &mut Builder, parent: NodeId, at: Vec3, random: &mut Random) {
    let skid = b.group(parent, "pump skid", odd(at, random));
    for k in 0..1 + random.below(2) {
        let z = k as f32 * 1.8;
        b.part(skid, "base", b.machines.base, Place::at(vec3(0.0, 0.0, z)));
        b.part(skid, "pump", b.machines.pump, Place::at(vec3(1.0, 0.3, z)));
        b.part(skid, "motor", b.machines.motor, Place::at(vec3(-0.7, 0.3, z)));
    }
}

fn vessel(b: &mut Builder, parent: NodeId, at: Vec3, random: &mut Random) {
    let vessel = b.group(parent, "vessel", odd(at, random));
    b.part(vessel, "shell", b.machines.vessel, Place::at(Vec3::ZERO).scaled(Vec3::splat(random.range(0.75, 1.0))));
    b.part(vessel, "ladder", b.machines.ladder, Place::at(vec3(0.0, 0.0, 1.35)).scaled(Vec3::splat(0.85)));
    b.part(vessel, "dosing pump", b.machines.pump, Place::at(vec3(2.2, 0.0, 0.4)).scaled(Vec3::splat(0.6)));
}

fn exchanger(b: &mut Builder, parent: NodeId, at: Vec3, random: &mut Random) {
    let exchanger = b.group(parent, "heat exchanger", odd(at, random));
    b.part(exchanger, "shell", b.machines.exchanger, Place::at(Vec3::ZERO));
    for x in [-1.5, 1.5] {
        b.part(exchanger, "saddle", b.machines.saddle, Place::at(vec3(x, 0.0, 0.0)));
    }
}

fn fan(b: &mut Builder, parent: NodeId, at: Vec3, random: &mut Random) {
    let set = b.group(parent, "fan set", odd(at, random));
    b.part(set, "fan", b.machines.fan, Place::at(Vec3::ZERO));
    b.part(set, "motor", b.machines.motor, Place::at(vec3(2.0, 0.8, 0.0)));
    b.part(set, "base", b.machines.base, Place::at(vec3(1.0, 0.0, 0.0)));
}
