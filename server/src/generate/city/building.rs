//! One building: storeys with rooms and furniture, a ground floor with shop windows, a roof.
//!
//! The shell is made first; what it leaves of [`TRIANGLES`] is spent on furniture.
use super::{Palette, roof};
use crate::generate::glb_writer::{GlbWriter, MeshId, NodeId, Place};
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, srgb, walls};
use crate::generate::textures::{FACADE_BAYS, Facade};
use glam::{Vec2, Vec3, vec3};

/// Triangles of a building with all that is in it: the papers' city has 300 such.
pub const TRIANGLES: usize = 3521;
/// Height of the ground floor.
const GROUND_M: f32 = 4.0;
/// Width of a window bay.
const BAY_M: f32 = 3.1;
/// From the facade to the inner face of a wall.
const WALL_M: f32 = 0.3;
const DOOR_M: f32 = 1.0;
/// A room's floor is a grid of places for furniture, this far apart.
const SLOT_M: f32 = 2.3;

const TRIM: [Color; 4] = [srgb(236, 228, 212), srgb(214, 200, 178), srgb(168, 158, 146), srgb(120, 84, 66)];
const AWNINGS: [Color; 5] = [srgb(176, 48, 44), srgb(40, 92, 84), srgb(222, 164, 60), srgb(58, 76, 128), srgb(150, 84, 50)];
const INNER: [Color; 4] = [srgb(244, 236, 220), srgb(226, 232, 226), srgb(240, 220, 196), srgb(214, 222, 234)];
const PARQUET: Color = srgb(170, 126, 84);
const CEILING: Color = srgb(244, 244, 240);

/// Size and style of a building, drawn before anything is built.
pub struct Plan {
    pub width_m: f32,
    pub depth_m: f32,
    pub floors: usize,
    pub storey_m: f32,
    pub facade: Facade,
    pub tint: usize,
}

impl Plan {
    /// `height` is 0 at the city's edge and 1 at its centre.
    pub fn draw(random: &mut Random, height: f32) -> Plan {
        let tall = random.unit() * random.unit();
        let floors = 3 + (random.range(0.0, 4.5) + tall * 15.0 * height) as usize;
        let facade = match floors {
            9.. => Facade::Office,
            _ if random.chance(0.4) => Facade::Brick,
            _ => Facade::Plaster,
        };
        Plan {
            width_m: random.range(15.0, 21.5),
            depth_m: random.range(12.0, 17.0),
            floors: floors.min(16),
            storey_m: random.range(3.2, 3.7),
            facade,
            tint: random.below(super::TINTS.len()),
        }
    }

    pub fn half(&self) -> Vec3 {
        vec3(self.width_m / 2.0, 0.0, self.depth_m / 2.0)
    }

    /// Rooms along width and depth: fewer where there are more floors.
    fn rooms(&self) -> (usize, usize) {
        match self.floors {
            ..=3 => (3, 2),
            4..=5 => (2, 2),
            6..=9 => (2, 1),
            _ => (1, 1),
        }
    }
}

/// Adds the building under `building` and returns the number of its triangles.
pub fn build(glb: &mut GlbWriter, palette: &mut Palette, building: NodeId, plan: &Plan, random: &mut Random) -> usize {
    let mut triangles = 0;
    let trim = *random.pick(&TRIM);
    let inner = *random.pick(&INNER);
    let ground = ground_floor(glb, palette, plan, trim, inner, random);
    // Two storeys alternate, so that the windows' lights do not line up.
    let upper = [0, 1].map(|variant| storey(glb, palette, plan, variant, trim, inner));
    let mut rooms = Vec::new();
    for floor in 0..plan.floors {
        let (mesh, y) = match floor {
            0 => (ground, 0.0),
            _ => (upper[floor % 2], GROUND_M + (floor - 1) as f32 * plan.storey_m),
        };
        triangles += glb.triangles_of(mesh);
        let node = glb.node(Some(building), format!("floor {floor}"), Some(mesh), Place::at(vec3(0.0, y, 0.0)));
        rooms.extend(add_rooms(glb, plan, node, floor));
    }
    let roof_y = GROUND_M + (plan.floors - 1) as f32 * plan.storey_m;
    let roof = roof::roof(glb, palette, plan, trim, random);
    triangles += glb.triangles_of(roof);
    glb.node(Some(building), "roof".into(), Some(roof), Place::at(vec3(0.0, roof_y, 0.0)));
    furnish(glb, palette, rooms, triangles, random)
}

struct Room {
    node: NodeId,
    slots: Vec<Vec3>,
}

fn add_rooms(glb: &mut GlbWriter, plan: &Plan, floor_node: NodeId, floor: usize) -> Vec<Room> {
    let (nx, nz) = plan.rooms();
    let half = plan.half() - vec3(WALL_M, 0.0, WALL_M);
    let size = vec3(2.0 * half.x / nx as f32, 0.0, 2.0 * half.z / nz as f32);
    let mut rooms = Vec::new();
    for k in 0..nx * nz {
        let corner = vec3((k % nx) as f32 * size.x, 0.05, (k / nx) as f32 * size.z) - half;
        let center = corner + size / 2.0;
        let node = glb.node(Some(floor_node), format!("room {floor}-{}", k + 1), None, Place::at(center));
        let (across, along) = (((size.x - 0.3) / SLOT_M) as usize, ((size.z - 0.3) / SLOT_M) as usize);
        let middle = |count: usize| (count as f32 - 1.0) / 2.0;
        let slots = (0..across * along).map(|s| {
            let (x, z) = ((s % across) as f32 - middle(across), (s / across) as f32 - middle(along));
            vec3(x * SLOT_M, 0.0, z * SLOT_M)
        });
        rooms.push(Room { node, slots: slots.collect() });
    }
    rooms
}

/// Spends what `used` leaves of the budget; returns the building's triangles.
fn furnish(glb: &mut GlbWriter, palette: &Palette, mut rooms: Vec<Room>, mut used: usize, random: &mut Random) -> usize {
    let stock = &palette.stock;
    let mut next = 0;
    loop {
        let left = TRIANGLES.saturating_sub(used);
        let fitting: Vec<_> = stock.pieces.iter().filter(|piece| piece.triangles <= left).collect();
        let piece = match (fitting.is_empty(), left) {
            (false, _) => *random.pick(&fitting),
            (true, l) if l >= stock.carton.triangles => &stock.carton,
            (true, l) if l >= stock.rug.triangles => &stock.rug,
            _ => return used,
        };
        // Round the building room by room, so that furniture spreads evenly; crowded rooms are passed over.
        let Some(at) = (0..rooms.len()).map(|k| (next + k) % rooms.len()).find(|k| !rooms[*k].slots.is_empty()) else {
            return used;
        };
        next = at + 1;
        let room = &mut rooms[at];
        let slot = room.slots.swap_remove(random.below(room.slots.len()));
        let place = Place::turned(slot, random.below(4));
        glb.node(Some(room.node), piece.name.into(), Some(piece.mesh), place);
        used += piece.triangles;
    }
}

/// An upper storey: facade, ledge, balconies on low houses, inner walls.
fn storey(glb: &mut GlbWriter, palette: &mut Palette, plan: &Plan, variant: usize, trim: Color, inner: Color) -> MeshId {
    let half = plan.half();
    let (low, high) = (-half, half + vec3(0.0, plan.storey_m, 0.0));
    let mut facade = Geometry::default();
    for (side, corners) in walls(low, high).into_iter().enumerate() {
        let bays = ((corners[1] - corners[0]).length() / BAY_M).round();
        let (u, v) = (side as f32 / FACADE_BAYS, (variant * 2 + 1) as f32 / FACADE_BAYS);
        facade.textured(corners, Vec2::new(u, v), Vec2::new(u + bays / FACADE_BAYS, v - 1.0 / FACADE_BAYS));
    }
    let mut paint = Geometry::default();
    ledge(&mut paint, half, plan.storey_m - 0.25, 0.18, 0.25, trim);
    if plan.facade != Facade::Office && plan.floors <= 7 {
        for x in [-0.27, 0.27] {
            balcony(&mut paint, vec3(x * plan.width_m, 0.0, half.z), trim);
        }
    }
    interior(&mut paint, plan, plan.storey_m - 0.3, inner, WallsInside::All);
    let facade_material = palette.facade(glb, plan.facade, plan.tint);
    glb.mesh("storey", &[(&facade, facade_material), (&paint, palette.paint)])
}

/// A band around the building at height `y`.
pub fn ledge(g: &mut Geometry, half: Vec3, y: f32, out: f32, height: f32, color: Color) {
    let (x, z) = (half.x + out, half.z + out);
    g.cuboid(vec3(-x, y, half.z), vec3(x, y + height, z), color);
    g.cuboid(vec3(-x, y, -z), vec3(x, y + height, -half.z), color);
    g.cuboid(vec3(half.x, y, -half.z), vec3(x, y + height, half.z), color);
    g.cuboid(vec3(-x, y, -half.z), vec3(-half.x, y + height, half.z), color);
}

fn balcony(g: &mut Geometry, wall: Vec3, trim: Color) {
    let iron = srgb(58, 58, 62);
    g.cuboid(wall + vec3(-1.5, 0.0, 0.0), wall + vec3(1.5, 0.15, 1.3), trim);
    g.cuboid(wall + vec3(-1.5, 0.15, 1.22), wall + vec3(1.5, 1.1, 1.3), iron);
    g.cuboid(wall + vec3(-1.5, 0.15, 0.0), wall + vec3(-1.42, 1.1, 1.22), iron);
    g.cuboid(wall + vec3(1.42, 0.15, 0.0), wall + vec3(1.5, 1.1, 1.22), iron);
}

#[derive(PartialEq)]
enum WallsInside {
    All,
    /// The front (+Z) is glass.
    NotFront,
}

/// What one sees from inside: floor, ceiling, the inner faces of the walls, partitions with doorways.
fn interior(g: &mut Geometry, plan: &Plan, height: f32, color: Color, inside: WallsInside) {
    let half = plan.half() - vec3(WALL_M, 0.0, WALL_M);
    for (k, [a, b, c, d]) in walls(-half, half + vec3(0.0, height, 0.0)).into_iter().enumerate() {
        if !(k == 2 && inside == WallsInside::NotFront) {
            g.polygon(&[b, a, d, c], color);
        }
    }
    let z = if inside == WallsInside::NotFront { half.z + WALL_M } else { half.z };
    let sheet = |y: f32| [vec3(-half.x, y, z), vec3(half.x, y, z), vec3(half.x, y, -half.z), vec3(-half.x, y, -half.z)];
    g.polygon(&sheet(0.05), PARQUET);
    let [a, b, c, d] = sheet(height);
    g.polygon(&[d, c, b, a], CEILING);

    let (nx, nz) = plan.rooms();
    let size = vec3(2.0 * half.x / nx as f32, 0.0, 2.0 * half.z / nz as f32);
    for x in 1..nx {
        for z in 0..nz {
            let from = vec3(x as f32 * size.x, 0.0, z as f32 * size.z) - half;
            partition(g, from, vec3(0.0, 0.0, size.z), height, color);
        }
    }
    for z in 1..nz {
        for x in 0..nx {
            let from = vec3(x as f32 * size.x, 0.0, z as f32 * size.z) - half;
            partition(g, from, vec3(size.x, 0.0, 0.0), height, color);
        }
    }
}

/// A wall along `run` with a doorway in its middle: 36 triangles.
fn partition(g: &mut Geometry, from: Vec3, run: Vec3, height: f32, color: Color) {
    let along = run.normalize();
    let thick = vec3(along.z, 0.0, along.x) * 0.06;
    let door = (run.length() - DOOR_M) / 2.0;
    let mut part = |start: f32, end: f32, low: f32, high: f32| {
        let (a, b) = (from + along * start, from + along * end);
        g.cuboid(a - thick + vec3(0.0, low, 0.0), b + thick + vec3(0.0, high, 0.0), color);
    };
    part(0.0, door, 0.05, height);
    part(door + DOOR_M, run.length(), 0.05, height);
    part(door, door + DOOR_M, 2.1, height);
}

/// Stone on three sides, shop windows in front.
fn ground_floor(glb: &mut GlbWriter, palette: &Palette, plan: &Plan, trim: Color, inner: Color, random: &mut Random) -> MeshId {
    let half = plan.half();
    let mut stone = Geometry::default();
    for (side, corners) in walls(-half, half + vec3(0.0, GROUND_M, 0.0)).into_iter().enumerate() {
        if side != 2 {
            let length = (corners[1] - corners[0]).length();
            stone.textured(corners, Vec2::new(0.0, GROUND_M / 2.0), Vec2::new(length / 2.0, 0.0));
        }
    }
    let mut paint = Geometry::default();
    let mut glass = Geometry::default();
    let bays = (plan.width_m / 4.0).round().max(2.0) as usize;
    let bay = plan.width_m / bays as f32;
    let awning = *random.pick(&AWNINGS);
    let door = random.below(bays);
    let front = half.z;
    // Just inside the stone walls at both ends, so that no two faces share a plane.
    let inset = half.x - 0.02;
    for k in 0..=bays {
        let x = -half.x + k as f32 * bay;
        let (left, right) = ((x - 0.3).max(-inset), (x + 0.3).min(inset));
        paint.cuboid(vec3(left, 0.0, front - WALL_M), vec3(right, GROUND_M - 0.7, front), trim);
    }
    for k in 0..bays {
        let (left, right) = (-half.x + k as f32 * bay + 0.3, -half.x + (k + 1) as f32 * bay - 0.3);
        let (y, z) = (GROUND_M - 0.7, front - 0.12);
        if k == door {
            paint.cuboid(vec3(left, 0.0, z - 0.08), vec3(right, y, z), srgb(84, 58, 44));
        } else {
            paint.cuboid(vec3(left, 0.0, z - 0.1), vec3(right, 0.5, front), trim);
            let pane = [vec3(left, 0.5, z), vec3(right, 0.5, z), vec3(right, y, z), vec3(left, y, z)];
            glass.polygon(&pane, [255; 4]);
        }
        // Awnings slope outwards and are seen from both sides.
        let (top, low, out) = (GROUND_M - 0.75, GROUND_M - 1.25, front + 1.2);
        let edge = [vec3(left, low, out), vec3(right, low, out), vec3(right, top, front), vec3(left, top, front)];
        paint.polygon(&edge, awning);
        let [a, b, c, d] = edge;
        paint.polygon(&[d, c, b, a], awning);
    }
    glass.colors.clear();
    paint.cuboid(vec3(-inset, GROUND_M - 0.7, front - WALL_M), vec3(inset, GROUND_M, front), trim);
    ledge(&mut paint, half, GROUND_M - 0.2, 0.3, 0.2, trim);
    interior(&mut paint, plan, GROUND_M - 0.3, inner, WallsInside::NotFront);
    glb.mesh("ground floor", &[(&stone, palette.stone), (&paint, palette.paint), (&glass, palette.glass)])
}
