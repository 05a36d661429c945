//! The castle: eight towers of eight sides around a court of eight sides, two storeys of eight rooms each.
//!
//! Nodes: castle, storey, sector, part. Sectors are turned by eighths of a circle about the court's middle and share their
//! meshes; each is drawn for the one towards +Z.
use crate::generate::glb_writer::{GlbWriter, MaterialId, MeshId, NodeId, Place};
use crate::generate::gothic::{Opening, Pointed, Ribs, Stones, Tracery, Vault, Wall, hoop, roll, tracery};
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, ring, srgb};
use glam::{Vec2, Vec3, vec2, vec3};

const SECTORS: usize = 8;
/// From the court's middle to the faces of the walls: outside, the rooms' two sides, the court.
const OUTER_M: f32 = 21.0;
const ROOM_FAR_M: f32 = 18.8;
const ROOM_NEAR_M: f32 = 10.4;
const COURT_M: f32 = 8.9;
const STOREY_M: f32 = 10.0;
/// Half the thickness of the walls between rooms.
const PARTITION_M: f32 = 0.7;
/// The towers' circumscribed radius and height.
const TOWER_M: [f32; 2] = [4.3, 24.0];

const STONE: [Color; 5] =
    [srgb(222, 206, 172), srgb(214, 196, 160), srgb(228, 214, 184), srgb(206, 188, 154), srgb(218, 198, 158)];
const TRIM: Color = srgb(232, 220, 196);
const BRECCIA: Color = srgb(164, 98, 84);
const FLOOR: [Color; 3] = [srgb(170, 150, 130), srgb(196, 178, 152), srgb(148, 122, 108)];

/// Half of a side of the octagon at distance `apothem`: the tangent of an eighth of π.
fn half_side(apothem: f32) -> f32 {
    apothem * (2f32.sqrt() - 1.0)
}

/// What a sector or a tower is made of.
struct Parts {
    portal: MeshId,
    outer: [MeshId; 2],
    court: [MeshId; 2],
    partition: MeshId,
    vault: MeshId,
    floor: MeshId,
    roof: MeshId,
    tower: MeshId,
    stair: MeshId,
}

pub fn build(glb: &mut GlbWriter, paint: MaterialId, castle: NodeId) {
    let mut random = Random::new(1240);
    let mut add = |glb: &mut GlbWriter, name: &str, build: &dyn Fn(&mut Geometry, &mut Stones)| {
        let mut geometry = Geometry::default();
        build(&mut geometry, &mut Stones::new(&STONE, random.fork()));
        glb.mesh(name, &[(&geometry, paint)])
    };
    let parts = Parts {
        portal: add(glb, "portal", &portal),
        outer: [
            add(glb, "lower outer wall", &|g, s| outer_wall(g, s, 0)),
            add(glb, "upper outer wall", &|g, s| outer_wall(g, s, 1)),
        ],
        court: [
            add(glb, "lower court wall", &|g, s| court_wall(g, s, 0)),
            add(glb, "upper court wall", &|g, s| court_wall(g, s, 1)),
        ],
        partition: add(glb, "partition", &partition),
        vault: add(glb, "room vault", &room_vault),
        floor: add(glb, "room floor", &room_floor),
        roof: add(glb, "roof", &roof),
        tower: add(glb, "tower", &tower),
        stair: add(glb, "stair", &stair),
    };
    let court = add(glb, "court", &court);
    let leaf = |glb: &mut GlbWriter, parent: NodeId, name: &str, mesh: MeshId| {
        glb.node(Some(parent), name.into(), Some(mesh), Place::at(Vec3::ZERO));
    };
    for storey in 0..2 {
        let place = Place::at(vec3(0.0, STOREY_M * storey as f32, 0.0));
        let floor = glb.node(Some(castle), format!("storey {}", storey + 1), None, place);
        for k in 0..SECTORS {
            let sector = glb.node(Some(floor), format!("sector {}", k + 1), None, turned(Vec3::ZERO, 2 * k));
            let outer = if (storey, k) == (0, 0) { parts.portal } else { parts.outer[storey] };
            leaf(glb, sector, "outer wall", outer);
            leaf(glb, sector, "court wall", parts.court[storey]);
            leaf(glb, sector, "partition", parts.partition);
            leaf(glb, sector, "vault", parts.vault);
            leaf(glb, sector, "floor", parts.floor);
            if storey == 1 {
                leaf(glb, sector, "roof", parts.roof);
            }
        }
    }
    let towers = glb.node(Some(castle), "towers".into(), None, Place::at(Vec3::ZERO));
    // The inmost edge of a tower touches the corner between two rooms.
    let corner = vec2(half_side(OUTER_M), OUTER_M).length() + 2.3;
    for k in 0..SECTORS {
        let out = sixteenth(2 * k + 1) * corner;
        let tower = glb.node(Some(towers), format!("tower {}", k + 1), None, turned(out, 2 * k + 1));
        leaf(glb, tower, "shell", parts.tower);
        leaf(glb, tower, "stair", parts.stair);
    }
    leaf(glb, castle, "court", court);
}

/// The direction of +Z, turned to the right by sixteenths of a circle.
fn sixteenth(k: usize) -> Vec3 {
    let corner = ring(16)[k % 16];
    vec3(corner.y, 0.0, corner.x)
}

fn turned(at: Vec3, sixteenths: usize) -> Place {
    let out = sixteenth(sixteenths);
    Place::facing(at, vec3(out.z, 0.0, -out.x), Vec3::Y)
}

fn wall(half: f32, front: f32, back: f32) -> Wall {
    Wall { low: vec2(-half, 0.0), high: vec2(half, STOREY_M), front, back, stone: vec2(1.3, 0.5) }
}

fn cornice(g: &mut Geometry, half: f32, y: f32, z: f32) {
    g.cuboid(vec3(-half, y - 0.2, z - 0.05), vec3(half, y + 0.12, z + 0.22), TRIM);
}

fn outer_wall(g: &mut Geometry, stones: &mut Stones, storey: usize) {
    let half = half_side(OUTER_M);
    let wall = wall(half, OUTER_M, ROOM_FAR_M);
    let (width, sill, spring) = if storey == 0 { (0.9, 4.6, 6.2) } else { (2.4, 2.4, 5.0) };
    let opening = Opening { middle: 0.0, sill, spring, arch: Pointed::equilateral(width), pieces: 8 };
    wall.pierced(g, &opening, stones, TRIM);
    roll(g, &opening.grown(0.16), OUTER_M, 0.09, 6, TRIM);
    roll(g, &opening.grown(0.16), ROOM_FAR_M, 0.09, 6, BRECCIA);
    if storey == 1 {
        tracery(g, &opening, OUTER_M - 0.5, Tracery::Foiled, TRIM);
    }
    cornice(g, half, if storey == 0 { 0.8 } else { 9.6 }, OUTER_M);
}

/// The gate: a pointed door below a gable, between pilasters, up steps.
fn portal(g: &mut Geometry, stones: &mut Stones) {
    let wall = wall(half_side(OUTER_M), OUTER_M, ROOM_FAR_M);
    let door = Opening { middle: 0.0, sill: 0.0, spring: 3.6, arch: Pointed::equilateral(2.6), pieces: 12 };
    wall.pierced(g, &door, stones, BRECCIA);
    for k in 0..3 {
        let grown = 0.18 + 0.2 * k as f32;
        roll(g, &door.grown(grown), OUTER_M + 0.24 - 0.08 * k as f32, 0.11, 8, if k == 1 { TRIM } else { BRECCIA });
    }
    roll(g, &door.grown(0.2), ROOM_FAR_M, 0.1, 8, BRECCIA);
    for side in [-1.0, 1.0] {
        let x = side * 2.6;
        g.cuboid(vec3(x - 0.35, 0.0, OUTER_M - 0.05), vec3(x + 0.35, 7.2, OUTER_M + 0.45), BRECCIA);
        g.cuboid(vec3(x - 0.45, 7.2, OUTER_M - 0.05), vec3(x + 0.45, 7.7, OUTER_M + 0.55), TRIM);
        g.bar(vec3(side * 3.1, 7.8, OUTER_M + 0.2), vec3(0.0, 9.5, OUTER_M + 0.2), [0.5, 0.3], BRECCIA);
    }
    g.cuboid(vec3(-3.0, 7.3, OUTER_M - 0.04), vec3(3.0, 7.6, OUTER_M + 0.4), TRIM);
    hoop(g, vec3(0.0, 8.5, OUTER_M + 0.06), 0.35, 0.07, [24, 6], TRIM);
    for step in 0..5 {
        let (reach, top) = (0.4 * step as f32, 0.1 - 0.16 * step as f32);
        g.cuboid(vec3(-2.6 - reach, -1.4, OUTER_M + 0.5), vec3(2.6 + reach, top, OUTER_M + 1.6 + reach), FLOOR[step % 2]);
    }
    g.cuboid(vec3(-1.3, -0.4, OUTER_M - 0.1), vec3(1.3, 0.1, OUTER_M + 0.55), FLOOR[1]);
}

fn court_wall(g: &mut Geometry, stones: &mut Stones, storey: usize) {
    // Its front looks into the court: drawn towards +Z, then turned about.
    let half = half_side(ROOM_NEAR_M);
    let mut inner = Geometry::default();
    let wall =
        Wall { low: vec2(-half, 0.0), high: vec2(half, STOREY_M), front: -COURT_M, back: -ROOM_NEAR_M, stone: vec2(1.1, 0.5) };
    let (width, sill, spring) = if storey == 0 { (1.9, 0.0, 2.9) } else { (1.7, 0.6, 3.6) };
    let door = Opening { middle: 0.0, sill, spring, arch: Pointed::equilateral(width), pieces: 8 };
    wall.pierced(&mut inner, &door, stones, BRECCIA);
    for k in 0..2 {
        roll(&mut inner, &door.grown(0.14 + 0.2 * k as f32), -COURT_M + 0.08, 0.1, 6, if k == 0 { BRECCIA } else { TRIM });
    }
    roll(&mut inner, &door.grown(0.14), -ROOM_NEAR_M, 0.08, 6, TRIM);
    inner.cuboid(vec3(-half, 8.6, -COURT_M - 0.05), vec3(half, 8.9, -COURT_M + 0.16), TRIM);
    g.copy(&inner, |p| vec3(-p.x, p.y, -p.z));
}

/// The wall to the next room along the bisector, with a door of breccia, half-columns where vaults spring.
fn partition(g: &mut Geometry, stones: &mut Stones) {
    let scale = vec2(half_side(1.0), 1.0).length();
    let (near, far) = (ROOM_NEAR_M * scale - 0.3, ROOM_FAR_M * scale + 0.3);
    let mut flat = Geometry::default();
    let wall =
        Wall { low: vec2(near, 0.0), high: vec2(far, STOREY_M), front: PARTITION_M, back: -PARTITION_M, stone: vec2(1.3, 0.6) };
    let door = Opening { middle: (near + far) / 2.0, sill: 0.0, spring: 2.6, arch: Pointed::equilateral(1.7), pieces: 6 };
    wall.pierced(&mut flat, &door, stones, BRECCIA);
    for z in [-PARTITION_M, PARTITION_M] {
        roll(&mut flat, &door.grown(0.14), z, 0.1, 4, BRECCIA);
    }
    let out = sixteenth(1);
    // The wall's +X runs outwards, its front looks back to this sector.
    let across = vec3(-out.z, 0.0, out.x);
    g.copy(&flat, |p| out * p.x + Vec3::Y * p.y + across * p.z);
}

/// The room's corners at the feet of its vault.
fn room_corners(y: f32) -> [Vec3; 4] {
    let side = |z: f32| half_side(z) - PARTITION_M * 1.08;
    let (near, far) = (ROOM_NEAR_M, ROOM_FAR_M);
    [vec3(-side(far), y, far), vec3(side(far), y, far), vec3(side(near), y, near), vec3(-side(near), y, near)]
}

fn room_vault(g: &mut Geometry, stones: &mut Stones) {
    let vault = Vault { corners: room_corners(4.6), rise: 4.2, pieces: 6, courses: 2 };
    vault.webs(g, stones);
    vault.ribs(g, Ribs::Diagonal, 0.16, TRIM);
    for corner in room_corners(0.1) {
        let inwards = (vec3(0.0, 0.1, 14.6) - corner).normalize() * 0.25;
        let foot = [(0.42, 0.0), (0.42, 0.3), (0.28, 0.5)];
        g.lathe(corner + inwards, &foot, 12, TRIM);
        g.lathe(corner + inwards, &[(0.28, 0.5), (0.26, 3.9)], 12, BRECCIA);
        g.lathe(corner + inwards, &[(0.26, 3.9), (0.45, 4.5), (0.45, 4.7), (0.0, 4.7)], 12, TRIM);
    }
}

/// A floor of checkered stone, its underside a ceiling over the storey below.
fn room_floor(g: &mut Geometry, _: &mut Stones) {
    let (half_near, half_far) = (half_side(ROOM_NEAR_M), half_side(ROOM_FAR_M));
    let (columns, rows) = (10, 8);
    let at = |column: usize, row: usize| {
        let share = row as f32 / rows as f32;
        let half = half_near + (half_far - half_near) * share;
        let z = ROOM_NEAR_M + (ROOM_FAR_M - ROOM_NEAR_M) * share;
        vec3((column as f32 / columns as f32 * 2.0 - 1.0) * half, 0.1, z)
    };
    for k in 0..columns * rows {
        let (x, z) = (k % columns, k / columns);
        g.polygon(&[at(x, z + 1), at(x + 1, z + 1), at(x + 1, z), at(x, z)], FLOOR[(x + z) % 2]);
    }
}

fn roof(g: &mut Geometry, _: &mut Stones) {
    let (near, far, low, high) = (COURT_M, OUTER_M, STOREY_M + 0.1, STOREY_M + 0.9);
    let (half_near, half_far) = (half_side(near), half_side(far));
    let slab = [vec3(-half_far, low, far), vec3(half_far, low, far), vec3(half_near, low, near), vec3(-half_near, low, near)];
    g.polygon(&slab, FLOOR[1]);
    for (half, z) in [(half_far, far - 0.35), (half_near, near + 0.35)] {
        g.cuboid(vec3(-half, low - 0.1, z - 0.35), vec3(half, high, z + 0.3), STONE[0]);
    }
}

/// The ring's corners lie on the axes: the tower is turned so that one looks outwards.
fn tower(g: &mut Geometry, stones: &mut Stones) {
    let [radius, height] = TOWER_M;
    let corners = ring(8);
    let rows = 24;
    let apothem = radius * (0.5 + 0.5 * 0.5f32.sqrt()).sqrt();
    for k in 0..8 {
        let (a, b) = (corners[k], corners[(k + 1) % 8]);
        let at = |share: f32, y: f32| {
            let p: Vec2 = a.lerp(b, share) * radius;
            vec3(p.x, y, -p.y)
        };
        for stone in 0..rows * 4 {
            let (row, column) = (stone / 4, stone % 4);
            let (low, high) = (height * row as f32 / rows as f32, height * (row + 1) as f32 / rows as f32);
            let (left, right) = (column as f32 / 4.0, (column + 1) as f32 / 4.0);
            g.polygon(&[at(left, low), at(right, low), at(right, high), at(left, high)], stones.next());
        }
        let out = vec3((a + b).x, 0.0, -(a + b).y).normalize();
        for y in [4.0, 13.0] {
            let slit = out * (apothem + 0.02) + Vec3::Y * y;
            g.bar(slit, slit + Vec3::Y * 1.5, [0.22, 0.08], srgb(70, 62, 54));
        }
    }
    for (y, reach) in [(0.0, 0.5), (9.6, 0.25), (height - 0.4, 0.35)] {
        let high = if y == 0.0 { 0.9 } else { 0.35 };
        g.lathe(
            vec3(0.0, y, 0.0),
            &[(radius - 0.1, 0.0), (radius + reach, 0.0), (radius + reach, high), (radius - 0.1, high + 0.2)],
            8,
            TRIM,
        );
    }
    g.lathe(vec3(0.0, height, 0.0), &[(radius, 0.0), (radius - 0.5, 0.0), (radius - 0.5, -0.6), (0.0, -0.6)], 8, FLOOR[1]);
}

/// Steps that wind up inside a tower around a newel.
fn stair(g: &mut Geometry, _: &mut Stones) {
    let ring = ring(16);
    g.lathe(Vec3::ZERO, &[(0.35, 0.0), (0.35, 21.0), (0.0, 21.0)], 12, TRIM);
    for step in 0..60 {
        let out = ring[step % 16];
        let y = 0.35 * step as f32;
        let (from, to) = (vec3(out.x, 0.0, out.y) * 0.3, vec3(out.x, 0.0, out.y) * 3.2);
        g.bar(from + Vec3::Y * y, to + Vec3::Y * y, [0.9, 0.2], FLOOR[1]);
    }
}

/// Paving and a basin of eight sides.
fn court(g: &mut Geometry, _: &mut Stones) {
    let paving: Vec<(f32, f32)> = (0..=8).map(|k| (11.3 * (8 - k) as f32 / 8.0, 0.05 + 0.01 * k as f32)).collect();
    for (k, band) in paving.windows(2).enumerate() {
        g.lathe(Vec3::ZERO, band, 32, FLOOR[k % 2]);
    }
    g.lathe(vec3(0.0, 0.1, 0.0), &[(2.0, 0.0), (2.0, 0.7), (1.7, 0.7), (1.7, 0.4), (0.0, 0.4)], 8, TRIM);
}
