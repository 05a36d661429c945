//! The palace's shared meshes, each about 3300 triangles: runs of colonnade and wall, roofs, paving, stairs, gates,
//! domes. Lengths in metres; a run lies along +X from its origin, its front towards +Z.
use super::Stone;
use super::carving::{Arch, Back, chhatri, column, dome, jali, merlon};
use crate::generate::glb_writer::{GlbWriter, MaterialId, MeshId};
use crate::generate::random::Random;
use crate::generate::solid::{Geometry, ring};
use glam::{Vec3, vec3};

/// Length of a run, side of a square of paving.
pub const RUN_M: f32 = 24.0;
/// Height and depth of a colonnade.
pub const COLONNADE_M: [f32; 2] = [4.6, 5.0];
pub const WALL_HEIGHT_M: f32 = 7.0;
pub const GATE_HEIGHT_M: f32 = 22.0;
pub const STAIR_RISE_M: f32 = 10.0;

pub struct Masonry {
    pub colonnade: MeshId,
    pub arcade: MeshId,
    pub wall: MeshId,
    pub rampart: MeshId,
    pub roof: MeshId,
    pub paving: MeshId,
    pub stair: MeshId,
    pub screen: MeshId,
    pub dome: MeshId,
    pub chhatri: MeshId,
    pub portal: MeshId,
    pub wing: MeshId,
    pub parapet: MeshId,
    pub pillar: MeshId,
    pub pool: MeshId,
    pub tower: MeshId,
    pub house: MeshId,
    pub house_roof: MeshId,
}

impl Masonry {
    pub fn new(glb: &mut GlbWriter, paint: MaterialId, stone: &Stone) -> Masonry {
        let mut add = |name: &str, build: fn(&mut Geometry, &Stone)| {
            let mut geometry = Geometry::default();
            build(&mut geometry, stone);
            glb.mesh(name, &[(&geometry, paint)])
        };
        Masonry {
            colonnade: add("colonnade", colonnade),
            arcade: add("arcade", arcade),
            wall: add("wall", wall),
            rampart: add("rampart", rampart),
            roof: add("roof", roof),
            paving: add("paving", paving),
            stair: add("stair", stair),
            screen: add("pierced screen", screen),
            dome: add("dome", |g, stone| dome(g, Vec3::ZERO, 4.5, [48, 26], stone)),
            chhatri: add("chhatri", |g, stone| chhatri(g, Vec3::ZERO, stone)),
            portal: add("portal", portal),
            wing: add("wing", wing),
            parapet: add("parapet", parapet),
            pillar: add("pillar", pillar),
            pool: add("pool", pool),
            tower: add("tower", tower),
            house: add("house", house),
            house_roof: add("house roof", house_roof),
        }
    }
}

/// Seven columns with their brackets, beam, eaves and roof.
fn colonnade(g: &mut Geometry, stone: &Stone) {
    let [height, depth] = COLONNADE_M;
    for k in 0..7 {
        column(g, vec3(RUN_M * (k as f32 + 0.5) / 7.0, 0.0, -0.5), height - 0.4, stone);
    }
    g.cuboid(vec3(0.0, height - 0.4, -0.75), vec3(RUN_M, height, -0.25), stone.red);
    g.cuboid(vec3(0.0, height, -depth), vec3(RUN_M, height + 0.3, 0.0), stone.dark);
    g.cuboid(vec3(0.0, 0.0, -depth), vec3(RUN_M, height, -depth + 0.4), stone.red);
    eaves(g, height + 0.1, stone);
}

/// Slabs that slope outwards along a run, on corbels: 24 to a run.
fn eaves(g: &mut Geometry, y: f32, stone: &Stone) {
    for k in 0..12 {
        let (x0, x1) = (RUN_M * k as f32 / 12.0, RUN_M * (k + 1) as f32 / 12.0 - 0.04);
        g.bar(vec3((x0 + x1) / 2.0, y, 0.0), vec3((x0 + x1) / 2.0, y - 0.45, 1.3), [x1 - x0, 0.1], stone.dark);
    }
}

/// The mosque's arcade: eight pointed arches on piers.
fn arcade(g: &mut Geometry, stone: &Stone) {
    let bay = RUN_M / 8.0;
    for k in 0..8 {
        let corner = vec3(k as f32 * bay, 0.0, 0.0);
        let arch = Arch { corner, size: [bay, 6.0], opening: [2.2, 2.8, 4.6], depth: 0.7, segments: 24 };
        arch.build(g, stone, Back::Open);
    }
    g.cuboid(vec3(0.0, 6.0, -COLONNADE_M[1]), vec3(RUN_M, 6.3, 0.0), stone.dark);
    g.cuboid(vec3(0.0, 0.0, -COLONNADE_M[1]), vec3(RUN_M, 6.0, -COLONNADE_M[1] + 0.4), stone.red);
    eaves(g, 6.0, stone);
    crest(g, 6.3, 16, stone);
}

fn crest(g: &mut Geometry, y: f32, count: usize, stone: &Stone) {
    for k in 0..count {
        merlon(g, vec3(RUN_M * (k as f32 + 0.5) / count as f32, y, -0.2), stone);
    }
}

/// A hall's wall: eight niches, merlons on top.
fn wall(g: &mut Geometry, stone: &Stone) {
    let bay = RUN_M / 8.0;
    for k in 0..8 {
        let corner = vec3(k as f32 * bay, 0.0, 0.0);
        let arch = Arch { corner, size: [bay, WALL_HEIGHT_M], opening: [1.8, 2.6, 4.2], depth: 0.5, segments: 22 };
        arch.build(g, stone, Back::Closed);
    }
    g.cuboid(vec3(0.0, 0.0, -1.2), vec3(RUN_M, WALL_HEIGHT_M, -0.52), stone.red);
    g.cuboid(vec3(0.0, 5.4, 0.0), vec3(RUN_M, 5.7, 0.25), stone.pale);
    crest(g, WALL_HEIGHT_M, 30, stone);
    eaves(g, 5.4, stone);
}

/// The town wall: rubble courses, loopholes, merlons.
fn rampart(g: &mut Geometry, stone: &Stone) {
    g.cuboid(vec3(0.0, -2.0, -2.4), vec3(RUN_M, 8.0, -0.2), stone.dark);
    let (columns, rows) = (20, 11);
    let mut random = Random::new(20);
    for k in 0..columns * rows {
        let (column, row) = (k % columns, k / columns);
        let shift = if row % 2 == 0 { 0.0 } else { 0.5 };
        let (dx, dy) = (RUN_M / (columns as f32 + 0.5), 10.0 / rows as f32);
        let low = vec3((column as f32 + shift) * dx + 0.03, -2.0 + row as f32 * dy + 0.03, -0.2);
        let proud = 0.12 + 0.05 * ((k * 7) % 5) as f32;
        let color = *random.pick(&[stone.dark, stone.red, stone.worn]);
        g.cuboid(low, low + vec3(dx - 0.06, dy - 0.06, proud), color);
    }
    crest(g, 8.0, 28, stone);
}

/// A flat roof of slabs behind a parapet, [`RUN_M`] by the depth of a colonnade.
fn roof(g: &mut Geometry, stone: &Stone) {
    let depth = COLONNADE_M[1];
    let (columns, rows) = (40, 4);
    let mut random = Random::new(40);
    for k in 0..columns * rows {
        let (dx, dz) = (RUN_M / columns as f32, depth / rows as f32);
        let low = vec3((k % columns) as f32 * dx, 0.0, -((k / columns + 1) as f32) * dz);
        let tone = *random.pick(&[stone.dark, stone.red, stone.red]);
        g.cuboid(low + vec3(0.02, 0.0, 0.02), low + vec3(dx - 0.02, 0.12, dz - 0.02), tone);
    }
    for k in 0..30 {
        let x = RUN_M * (k as f32 + 0.5) / 30.0;
        for z in [-0.2, -depth + 0.2] {
            merlon(g, vec3(x, 0.12, z), stone);
        }
    }
    for k in 0..24 {
        let x = RUN_M * (k as f32 + 0.5) / 24.0;
        g.bar(vec3(x, -0.1, 0.0), vec3(x, -0.1, 0.9), [0.25, 0.25], stone.dark);
    }
}

/// A square of slabs, [`RUN_M`] wide, centred, no two quite alike.
fn paving(g: &mut Geometry, stone: &Stone) {
    let mut random = Random::new(17);
    let count = 17;
    let slab = RUN_M / count as f32;
    for k in 0..count * count {
        let corner = vec3((k % count) as f32 * slab, 0.0, (k / count) as f32 * slab) - vec3(RUN_M, 0.0, RUN_M) / 2.0;
        let color = *random.pick(&[stone.red, stone.red, stone.dark, stone.worn]);
        let height = 0.02 + 0.004 * ((k * 17) % 5) as f32;
        g.cuboid(corner + vec3(0.02, -0.2, 0.02), corner + vec3(slab - 0.02, height, slab - 0.02), color);
    }
}

/// 40 steps down from the origin towards +Z, 24 m wide, with cheeks.
fn stair(g: &mut Geometry, stone: &Stone) {
    let steps = 40;
    let (rise, going) = (STAIR_RISE_M / steps as f32, 0.45);
    for k in 0..steps {
        let (y, z) = (-rise * (k + 1) as f32, going * k as f32);
        for part in 0..6 {
            let x = -RUN_M / 2.0 + RUN_M * part as f32 / 6.0;
            let color = if (part + k) % 3 == 0 { stone.dark } else { stone.red };
            g.cuboid(vec3(x, -STAIR_RISE_M, z), vec3(x + RUN_M / 6.0 - 0.03, y, z + going), color);
        }
    }
    for x in [-RUN_M / 2.0 - 0.4, RUN_M / 2.0 + 0.4] {
        let foot = going * steps as f32;
        g.bar(vec3(x, 0.3, 0.0), vec3(x, 0.3 - STAIR_RISE_M, foot), [0.8, 0.9], stone.pale);
    }
}

/// A tomb's side: pierced screens between posts, 12 m wide, centred, its front towards +Z.
fn screen(g: &mut Geometry, stone: &Stone) {
    for k in 0..3 {
        let x = -6.0 + 4.0 * k as f32;
        jali(g, vec3(x + 0.3, 0.9, 0.0), [3.4, 2.8], [6, 3], stone);
        g.cuboid(vec3(x + 0.2, 0.0, -0.15), vec3(x + 3.8, 0.8, 0.15), stone.pale);
    }
    for k in 0..4 {
        let x = -6.0 + 4.0 * k as f32;
        g.block(vec3(x, 0.0, 0.0), vec3(0.4, 4.2, 0.4), stone.pale);
        // Brackets like serpents carry the eaves.
        let path: Vec<Vec3> = (0..9)
            .map(|s| {
                let t = s as f32 / 8.0;
                vec3(x, 2.6 + 1.5 * t, 0.2 + 1.6 * t * t + 0.25 * (t * (1.0 - t)) * if s % 2 == 0 { 1.0 } else { -1.0 })
            })
            .collect();
        g.tube(&path, 0.09, 8, stone.pale);
    }
    g.cuboid(vec3(-6.2, 4.2, -0.3), vec3(6.2, 4.6, 0.3), stone.pale);
    g.bar(vec3(0.0, 4.5, 0.0), vec3(0.0, 4.1, 2.0), [12.6, 0.12], stone.pale);
}

/// The great arch of a gate, 20 m wide, centred, with the recess behind it and bands around.
fn portal(g: &mut Geometry, stone: &Stone) {
    let height = GATE_HEIGHT_M;
    for (depth, inset, z) in [(3.0, 0.0, 0.0), (2.0, 1.6, -3.0), (1.5, 3.0, -5.0)] {
        let opening = [13.0 - 2.0 * inset, 9.0 - inset * 0.5, 17.5 - inset * 1.4];
        let (back, segments) = if z == -5.0 { (Back::Closed, 52) } else { (Back::Open, 56) };
        let corner = vec3(-10.0, 0.0, z);
        Arch { corner, size: [20.0, height], opening, depth, segments }.build(g, stone, back);
    }
    let door = Arch { corner: vec3(-3.0, 0.0, -6.4), size: [6.0, 9.0], opening: [3.4, 4.5, 7.0], depth: 0.08, segments: 24 };
    door.build(g, stone, Back::Closed);
    for k in 0..3 {
        let (x, top) = (7.4 + 0.9 * k as f32, 18.6 + 0.9 * k as f32);
        let band = if k % 2 == 0 { stone.pale } else { stone.dark };
        for side in [-1.0, 1.0] {
            g.bar(vec3(side * x, 0.0, 0.05), vec3(side * x, top, 0.05), [0.25, 0.2], band);
        }
        g.bar(vec3(-x, top, 0.05), vec3(x, top, 0.05), [0.2, 0.25], band);
    }
    for k in 0..30 {
        merlon(g, vec3(-9.7 + 19.4 * k as f32 / 29.0, height, -0.4), stone);
    }
    g.cuboid(vec3(-10.0, 0.0, -9.0), vec3(10.0, height, -6.5), stone.red);
}

/// A gate's side, 9 m wide from the origin, three storeys of niches.
fn wing(g: &mut Geometry, stone: &Stone) {
    for k in 0..6 {
        let corner = vec3(4.5 * (k % 2) as f32, 6.0 * (k / 2) as f32, 0.0);
        let arch = Arch { corner, size: [4.5, 6.0], opening: [2.8, 2.6, 4.8], depth: 1.2, segments: 30 };
        arch.build(g, stone, Back::Closed);
        g.bar(corner + vec3(0.0, 5.9, 0.05), corner + vec3(4.5, 5.9, 0.05), [0.3, 0.25], stone.pale);
    }
    g.cuboid(vec3(0.0, 0.0, -9.0), vec3(9.0, 18.0, -1.25), stone.red);
    for k in 0..14 {
        merlon(g, vec3(0.3 + 8.4 * k as f32 / 13.0, 18.0, -0.4), stone);
    }
}

/// Little pavilions in a row on top of a gate, 20 m, centred.
fn parapet(g: &mut Geometry, stone: &Stone) {
    g.cuboid(vec3(-10.0, 0.0, -1.2), vec3(10.0, 0.4, 1.2), stone.dark);
    for k in 0..7 {
        let at = vec3(-9.0 + 3.0 * k as f32, 0.4, 0.0);
        for (x, z) in [(-0.7, -0.7), (0.7, -0.7), (0.7, 0.7), (-0.7, 0.7)] {
            g.lathe(at + vec3(x, 0.0, z), &[(0.14, 0.0), (0.1, 0.2), (0.08, 1.5), (0.16, 1.7)], 8, stone.red);
        }
        g.block(at + vec3(0.0, 1.7, 0.0), vec3(2.2, 0.15, 2.2), stone.dark);
        g.lathe(
            at + vec3(0.0, 1.8, 0.0),
            &[(0.95, 0.0), (1.0, 0.25), (0.9, 0.55), (0.65, 0.85), (0.3, 1.05), (0.08, 1.15), (0.1, 1.3), (0.0, 1.6)],
            16,
            stone.pale,
        );
    }
    for k in 0..18 {
        merlon(g, vec3(-9.6 + 19.2 * k as f32 / 17.0, 0.4, 1.1), stone);
    }
}

/// The column in the hall of private audience: a bundle of brackets carries the throne.
fn pillar(g: &mut Geometry, stone: &Stone) {
    let shaft = [
        (0.9, 0.0),
        (0.9, 0.3),
        (0.7, 0.4),
        (0.75, 0.6),
        (0.6, 0.8),
        (0.6, 1.8),
        (0.68, 1.9),
        (0.6, 2.0),
        (0.55, 2.9),
        (0.65, 3.0),
    ];
    g.lathe(Vec3::ZERO, &shaft, 16, stone.red);
    for (tier, count) in [24, 24, 24].into_iter().enumerate() {
        for out in ring(count) {
            let out = vec3(out.x, 0.0, out.y);
            let y = 3.0 + 0.55 * tier as f32;
            let reach = 1.0 + 0.5 * tier as f32;
            let path = [0.0, 0.35, 0.7, 1.0].map(|t: f32| out * (0.5 + (reach - 0.5) * t) + Vec3::Y * (y + 0.55 * t * t));
            g.tube(&path, 0.1, 6, stone.red);
        }
    }
    g.lathe(Vec3::ZERO, &[(0.0, 4.6), (2.2, 4.6), (2.3, 4.7), (2.3, 4.9), (0.0, 4.9)], 24, stone.dark);
    for post in ring(16) {
        let at = vec3(post.x, 0.0, post.y) * 2.15 + vec3(0.0, 4.9, 0.0);
        g.tube(&[at, at + vec3(0.0, 0.8, 0.0)], 0.05, 6, stone.pale);
    }
}

/// A square pool, 24 m wide, centred, with a platform that four bridges lead to.
fn pool(g: &mut Geometry, stone: &Stone) {
    for step in 0..4 {
        let (outer, inner, y) = (12.0 - 0.6 * step as f32, 11.4 - 0.6 * step as f32, -0.25 * step as f32);
        for side in ring(4) {
            let (out, along) = (vec3(side.x, 0.0, side.y), vec3(-side.y, 0.0, side.x));
            let middle = out * (outer + inner) / 2.0 + Vec3::Y * (y - 0.1);
            g.bar(middle - along * outer, middle + along * outer, [outer - inner, 0.24], stone.red);
        }
    }
    let water = [vec3(-10.0, -0.9, 10.0), vec3(10.0, -0.9, 10.0), vec3(10.0, -0.9, -10.0), vec3(-10.0, -0.9, -10.0)];
    g.polygon(&water, stone.water);
    g.block(vec3(0.0, -0.9, 0.0), vec3(6.0, 0.9, 6.0), stone.dark);
    for side in ring(4) {
        let (out, along) = (vec3(side.x, 0.0, side.y), vec3(-side.y, 0.0, side.x));
        g.bar(out * 3.0, out * 11.5, [1.2, 0.2], stone.pale);
        for k in 0..6 {
            for edge in [-0.5, 0.5] {
                let at = out * (3.5 + 1.4 * k as f32) + along * edge + Vec3::Y * 0.1;
                g.lathe(at, &[(0.09, 0.0), (0.12, 0.15), (0.05, 0.3), (0.1, 0.5), (0.0, 0.6)], 8, stone.pale);
            }
        }
    }
}

/// A tower of eight sides set with stone tusks, 20 m high.
fn tower(g: &mut Geometry, stone: &Stone) {
    g.lathe(
        Vec3::ZERO,
        &[
            (4.4, 0.0),
            (4.4, 3.0),
            (3.6, 3.2),
            (3.2, 4.0),
            (2.9, 11.0),
            (2.4, 17.0),
            (3.2, 17.6),
            (3.2, 18.2),
            (2.3, 18.2),
            (2.2, 18.6),
        ],
        16,
        stone.red,
    );
    for row in 0..8 {
        for tusk in ring(16) {
            let out = vec3(tusk.x, 0.0, tusk.y);
            let y = 4.6 + 1.5 * row as f32;
            let radius = 3.15 - 0.045 * (row as f32 * 1.5);
            g.tube(&[out * (radius - 0.3) + Vec3::Y * y, out * (radius + 0.9) + Vec3::Y * (y + 0.25)], 0.09, 4, stone.pale);
        }
    }
    for post in ring(16) {
        let at = vec3(post.x, 0.0, post.y) * 3.0 + vec3(0.0, 18.2, 0.0);
        g.tube(&[at, at + vec3(0.0, 1.0, 0.0)], 0.08, 6, stone.red);
    }
    dome(g, vec3(0.0, 18.6, 0.0), 2.2, [16, 12], stone);
}

/// Side and height of a house.
pub const HOUSE_M: [f32; 2] = [12.0, 6.0];

/// Four walls with two niches each, centred.
fn house(g: &mut Geometry, stone: &Stone) {
    let [side, height] = HOUSE_M;
    let half = side / 2.0;
    let mut front = Geometry::default();
    for k in 0..2 {
        let corner = vec3(half * k as f32 - half, 0.0, half);
        let arch = Arch { corner, size: [half, height], opening: [2.6, 2.4, 4.4], depth: 0.6, segments: 26 };
        arch.build(&mut front, stone, Back::Closed);
    }
    for k in 0..8 {
        let x = -half + side * (k as f32 + 0.5) / 8.0;
        front.bar(vec3(x, height - 0.3, half), vec3(x, height - 0.6, half + 1.1), [side / 8.0 - 0.05, 0.1], stone.dark);
    }
    for quarter in ring(4) {
        g.copy(&front, |p| vec3(p.x * quarter.x + p.z * quarter.y, p.y, p.z * quarter.x - p.x * quarter.y));
    }
}

/// Slabs and merlons on a house.
fn house_roof(g: &mut Geometry, stone: &Stone) {
    let (half, count) = (HOUSE_M[0] / 2.0, 14);
    let slab = HOUSE_M[0] / count as f32;
    let mut random = Random::new(14);
    for k in 0..count * count {
        let corner = vec3((k % count) as f32 * slab - half, 0.0, (k / count) as f32 * slab - half);
        let color = *random.pick(&[stone.dark, stone.red]);
        g.cuboid(corner + vec3(0.02, 0.0, 0.02), corner + vec3(slab - 0.02, 0.12, slab - 0.02), color);
    }
    let mut front = Geometry::default();
    for k in 0..13 {
        merlon(&mut front, vec3(-half + 0.5 + 11.0 * k as f32 / 12.0, 0.12, half - 0.2), stone);
    }
    for quarter in ring(4) {
        g.copy(&front, |p| vec3(p.x * quarter.x + p.z * quarter.y, p.y, p.z * quarter.x - p.x * quarter.y));
    }
}

/// What a court stands on: retaining walls with niches around `size` (width, height, depth), its top at y = 0, centred.
pub fn terrace(g: &mut Geometry, size: Vec3, stone: &Stone) {
    let half = size / 2.0;
    let niches = |length: f32| (length / 10.0).round().max(1.0);
    let total = 2.0 * (niches(size.x) + niches(size.z));
    // A niche takes 28 triangles and 14 a stretch; all together about 3300.
    let segments = (((3300.0 / total - 28.0) / 14.0) as usize / 2 * 2).clamp(4, 60);
    for (k, quarter) in ring(4).into_iter().enumerate() {
        let (length, out) = if k % 2 == 0 { (size.x, half.z) } else { (size.z, half.x) };
        let width = length / niches(length);
        let mut wall = Geometry::default();
        for niche in 0..niches(length) as usize {
            let corner = vec3(width * niche as f32 - length / 2.0, -size.y, out);
            let opening = [width * 0.6, size.y * 0.45, size.y * 0.8];
            Arch { corner, size: [width, size.y], opening, depth: 0.5, segments }.build(&mut wall, stone, Back::Closed);
        }
        wall.bar(vec3(-length / 2.0, -0.2, out + 0.1), vec3(length / 2.0, -0.2, out + 0.1), [0.5, 0.4], stone.pale);
        g.copy(&wall, |p| vec3(p.x * quarter.x + p.z * quarter.y, p.y, p.z * quarter.x - p.x * quarter.y));
    }
    let y = -0.1;
    g.polygon(
        &[vec3(-half.x, y, half.z), vec3(half.x, y, half.z), vec3(half.x, y, -half.z), vec3(-half.x, y, -half.z)],
        stone.dark,
    );
}

/// The ridge and the land around it, one square of earth beside the other, 640 m by 520 m.
pub fn land(g: &mut Geometry, stone: &Stone) {
    let mut random = Random::new(44);
    let [columns, rows] = [44, 36];
    let at = |x: usize, z: usize| {
        let (fx, fz) = (x as f32 / columns as f32 - 0.5, z as f32 / rows as f32 - 0.5);
        let edge = (fx * fx + fz * fz - 0.16).max(0.0);
        let rough = ((x * 13 + z * 29 + x * z * 7) % 11) as f32 * 0.25;
        vec3(fx * 640.0, -0.6 - edge * (90.0 + 12.0 * rough), fz * 520.0)
    };
    for k in 0..columns * rows {
        let (x, z) = (k % columns, k / columns);
        let color = *random.pick(&[stone.earth, stone.earth, stone.dust, stone.scrub]);
        let corners = [at(x, z + 1), at(x + 1, z + 1), at(x + 1, z), at(x, z)];
        g.polygon(&[corners[0], corners[1], corners[2]], color);
        g.polygon(&[corners[0], corners[2], corners[3]], color);
    }
}
