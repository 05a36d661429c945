//! The members of a bay, drawn for a bay that begins at x = 0: the wall between nave and aisle lies along +X about z = 0, its
//! front towards the nave at +Z; the aisle lies at −Z.
use super::{Lodge, Work};
use crate::generate::glb_writer::MeshId;
use crate::generate::gothic::{
    Cluster, Opening, Pointed, Ribs, Stones, Tracery, Vault, Wall, glass, hoop, pinnacle, roll, tracery,
};
use crate::generate::random::Random;
use crate::generate::solid::{Geometry, ring};
use glam::{Vec3, vec2, vec3};

/// Length of a bay, width of an aisle, half the width of the nave.
pub const BAY_M: f32 = 7.0;
/// Where the arcade, the triforium and the clerestory end.
pub const ARCADE_M: f32 = 12.0;
const TRIFORIUM_M: f32 = 16.5;
pub const WALL_M: f32 = 28.0;
/// Where the vaults of the aisles and of the nave spring.
pub const AISLE_SPRING_M: f32 = 6.2;
pub const NAVE_SPRING_M: f32 = 17.6;
pub const NAVE_RISE_M: f32 = 9.0;
/// Half the width of the nave's vault: its sides lie in the walls.
pub const VAULT_HALF_M: f32 = BAY_M - 0.4;
/// The eaves' distance from the axis and height, and the ridge's height.
pub const EAVES_M: [f32; 2] = [8.3, 28.2];
pub const RIDGE_M: f32 = 37.0;
/// Half the thickness of the arcade's wall.
const HALF_M: f32 = 0.7;

pub fn arcade(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("arcade", |w| {
        let (trim, reveal) = (w.palette.trim, w.palette.stone[3]);
        let wall = Wall { low: vec2(0.0, 0.0), high: vec2(BAY_M, ARCADE_M), front: HALF_M, back: -HALF_M, stone: vec2(1.2, 0.8) };
        let arch = Pointed { width: 5.0, rise: 4.4 };
        let opening = Opening { middle: BAY_M / 2.0, sill: 0.0, spring: AISLE_SPRING_M, arch, pieces: 8 };
        wall.pierced(&mut w.stone, &opening, &mut w.stones, reveal);
        let head = Opening { sill: AISLE_SPRING_M, ..opening };
        for (grown, z, radius) in [(-0.05, 0.35, 0.16), (0.12, 0.66, 0.13), (0.36, 0.74, 0.1), (0.0, -0.66, 0.2)] {
            roll(&mut w.stone, &head.grown(grown), z, radius, 6, trim);
        }
        for k in 0..7 {
            // A frieze of leaves below the triforium.
            let x = 0.5 + k as f32;
            let at = vec3(x, ARCADE_M - 0.45, HALF_M);
            w.stone.tube(&[at, at + vec3(0.1, 0.12, 0.12), at + vec3(-0.05, 0.25, 0.1)], 0.08, 4, trim);
        }
        ledge(w, ARCADE_M);
    })
}

/// A string course that also closes the joint between the walls below and above.
fn ledge(w: &mut Work, y: f32) {
    w.stone.cuboid(vec3(0.0, y - 0.12, -0.78), vec3(BAY_M, y + 0.12, 0.82), w.palette.trim);
}

/// Four arches before a passage, whose back is closed.
pub fn triforium(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("triforium", |w| {
        let (trim, dark) = (w.palette.trim, w.palette.dark);
        let width = BAY_M / 4.0;
        for k in 0..4 {
            let x = width * k as f32;
            let wall = Wall {
                low: vec2(x, ARCADE_M),
                high: vec2(x + width, TRIFORIUM_M),
                front: 0.7,
                back: 0.25,
                stone: vec2(0.7, 1.0),
            };
            let arch = Pointed::equilateral(1.1);
            let opening = Opening { middle: x + width / 2.0, sill: 12.7, spring: 14.5, arch, pieces: 4 };
            wall.pierced(&mut w.stone, &opening, &mut w.stones, trim);
            roll(&mut w.stone, &opening.grown(0.1), 0.7, 0.08, 4, trim);
            let shaft = [(0.17, 0.0), (0.1, 0.2), (0.09, 1.5), (0.12, 1.55), (0.18, 1.85)];
            w.stone.lathe(vec3(x, 12.7, 0.78), &shaft, 6, trim);
        }
        let back =
            Wall { low: vec2(0.0, ARCADE_M), high: vec2(BAY_M, TRIFORIUM_M), front: -0.3, back: -0.7, stone: vec2(2.3, 1.5) };
        back.closed(&mut w.stone, &mut w.stones);
        w.stone.cuboid(vec3(0.0, 12.4, -0.3), vec3(BAY_M, 12.6, 0.25), dark);
        ledge(w, TRIFORIUM_M);
    })
}

/// The great window below the vault, with a parapet over it.
pub fn clerestory(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("clerestory", |w| {
        let trim = w.palette.trim;
        let wall = Wall { low: vec2(0.0, TRIFORIUM_M), high: vec2(BAY_M, WALL_M), front: 0.5, back: -0.5, stone: vec2(1.4, 1.0) };
        let arch = Pointed::equilateral(4.8);
        let opening = Opening { middle: BAY_M / 2.0, sill: 17.6, spring: 22.2, arch, pieces: 8 };
        wall.pierced(&mut w.stone, &opening, &mut w.stones, trim);
        tracery(&mut w.stone, &opening, 0.0, Tracery::Double, trim);
        glass(&mut w.glass, &opening, 0.0, 1.0, &mut w.panes);
        roll(&mut w.stone, &opening.grown(0.12), 0.5, 0.1, 4, trim);
        roll(&mut w.stone, &opening.grown(0.14), -0.5, 0.12, 4, trim);
        w.stone.cuboid(vec3(0.0, WALL_M - 0.3, -1.3), vec3(BAY_M, WALL_M + 0.05, 0.6), trim);
        for k in 0..5 {
            hoop(&mut w.stone, vec3(0.7 + 1.4 * k as f32, WALL_M + 0.55, -1.15), 0.36, 0.1, [6, 4], trim);
        }
        for y in [WALL_M + 0.1, WALL_M + 1.0] {
            w.stone.bar(vec3(0.0, y, -1.15), vec3(BAY_M, y, -1.15), [0.22, 0.14], trim);
        }
    })
}

/// A clustered column with the shafts that carry the nave's vault.
pub fn pier(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("pier", |w| {
        let (stone, trim) = (w.palette.stone[0], w.palette.trim);
        Cluster { height: AISLE_SPRING_M, radius: 0.98, shafts: 8 }.build(&mut w.stone, Vec3::ZERO, stone, trim);
        for (x, z, radius) in [(-0.34, 0.78, 0.13), (0.0, 0.9, 0.17), (0.34, 0.78, 0.13)] {
            let top = NAVE_SPRING_M - AISLE_SPRING_M;
            let shaft = [(1.6, 0.0), (1.0, 0.3), (1.0, 5.7), (1.4, 5.8), (1.0, 5.9), (1.0, top - 0.7), (2.0, top)];
            let profile = shaft.map(|(r, y)| (r * radius, y));
            w.stone.lathe(vec3(x, AISLE_SPRING_M, z), &profile, 6, stone);
            w.stone.block(vec3(x, NAVE_SPRING_M, z), vec3(0.5, 0.16, 0.5), trim);
        }
    })
}

/// What fills a corner where walls meet at a right angle, up to their top.
pub fn corner(lodge: &mut Lodge) -> MeshId {
    let half = HALF_M + 0.05;
    lodge.mesh("corner", |w| {
        w.stone.cuboid(vec3(-half, 0.0, -half), vec3(half, WALL_M + 0.02, half), w.palette.stone[0]);
    })
}

/// An arch across the nave below its vaults, about x = 0, with the wall over it.
pub fn great_arch(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("great arch", |w| {
        let half = BAY_M + HALF_M;
        let (low, high) = (vec2(-half, NAVE_SPRING_M), vec2(half, WALL_M - 0.1));
        let wall = Wall { low, high, front: HALF_M, back: -HALF_M, stone: vec2(2.0, 1.4) };
        // A little narrower and lower than the vaults.
        let arch = Pointed { width: 12.4, rise: 8.3 };
        let opening = Opening { middle: 0.0, sill: NAVE_SPRING_M, spring: NAVE_SPRING_M, arch, pieces: 8 };
        wall.pierced(&mut w.stone, &opening, &mut w.stones, w.palette.stone[3]);
        for z in [-0.55, 0.55] {
            roll(&mut w.stone, &opening.grown(0.05), z, 0.18, 4, w.palette.trim);
        }
    })
}

/// The aisle's outer wall at z = −7, a traceried window over blind arches.
pub fn aisle_wall(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("aisle wall", |w| {
        let trim = w.palette.trim;
        let (front, back) = (0.5 - BAY_M, -0.5 - BAY_M);
        let wall = Wall { low: vec2(0.0, 0.0), high: vec2(BAY_M, ARCADE_M), front, back, stone: vec2(1.7, 1.0) };
        let arch = Pointed::equilateral(3.6);
        let opening = Opening { middle: BAY_M / 2.0, sill: 3.6, spring: 6.8, arch, pieces: 7 };
        wall.pierced(&mut w.stone, &opening, &mut w.stones, trim);
        tracery(&mut w.stone, &opening, -BAY_M, Tracery::Foiled, trim);
        glass(&mut w.glass, &opening, -BAY_M - 0.12, 0.7, &mut w.panes);
        roll(&mut w.stone, &opening.grown(0.12), front, 0.09, 4, trim);
        roll(&mut w.stone, &opening.grown(0.14), back, 0.11, 4, trim);
        for k in 0..3 {
            let arch = Pointed::equilateral(1.6);
            let blind = Opening { middle: 1.3 + 2.2 * k as f32, sill: 0.5, spring: 1.6, arch, pieces: 3 };
            roll(&mut w.stone, &blind, front, 0.08, 4, trim);
        }
        w.stone.cuboid(vec3(0.0, 0.0, front - 0.1), vec3(BAY_M, 0.5, front + 0.4), trim);
        w.stone.cuboid(vec3(0.0, 3.2, front - 0.1), vec3(BAY_M, 3.4, front + 0.2), trim);
        w.stone.cuboid(vec3(0.0, -0.3, back - 0.4), vec3(BAY_M, 1.0, back + 0.1), trim);
        w.stone.cuboid(vec3(0.0, ARCADE_M - 0.2, back - 0.3), vec3(BAY_M, ARCADE_M + 0.1, front + 0.1), trim);
        for k in 0..5 {
            hoop(&mut w.stone, vec3(0.7 + 1.4 * k as f32, ARCADE_M + 0.5, back), 0.33, 0.09, [6, 4], trim);
        }
        w.stone.bar(vec3(0.0, ARCADE_M + 0.92, back), vec3(BAY_M, ARCADE_M + 0.92, back), [0.22, 0.14], trim);
    })
}

pub fn aisle_vault(lodge: &mut Lodge) -> MeshId {
    let y = AISLE_SPRING_M;
    let (near, far) = (-0.4, 0.4 - BAY_M);
    let corners = [vec3(0.0, y, near), vec3(BAY_M, y, near), vec3(BAY_M, y, far), vec3(0.0, y, far)];
    vault(lodge, "aisle vault", Vault { corners, rise: 4.7, pieces: 6, courses: 2 }, 0.15)
}

/// The vault over a bay of the nave, about z = 0.
pub fn nave_vault(lodge: &mut Lodge) -> MeshId {
    let (y, half) = (NAVE_SPRING_M, VAULT_HALF_M);
    let corners = [vec3(0.0, y, half), vec3(BAY_M, y, half), vec3(BAY_M, y, -half), vec3(0.0, y, -half)];
    vault(lodge, "nave vault", Vault { corners, rise: NAVE_RISE_M, pieces: 8, courses: 3 }, 0.2)
}

pub fn vault(lodge: &mut Lodge, name: &str, vault: Vault, rib_m: f32) -> MeshId {
    lodge.mesh(name, |w| {
        let mut web = Stones::new(&w.palette.web, Random::new(5));
        vault.webs(&mut w.stone, &mut web);
        vault.ribs(&mut w.stone, Ribs::Transverse, rib_m, w.palette.trim);
    })
}

/// Slates from the aisle's parapet up to the clerestory.
pub fn aisle_roof(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("aisle roof", |w| {
        let (foot, top) = (vec3(0.0, ARCADE_M + 0.12, -BAY_M - 0.2), vec3(0.0, TRIFORIUM_M - 0.2, -0.6));
        slates(w, [foot + Vec3::X * BAY_M, foot, top, top + Vec3::X * BAY_M], [10, 8]);
    })
}

/// Slates on a face: low left, low right, high right, high left as seen from outside.
pub fn slates(w: &mut Work, corners: [Vec3; 4], [columns, rows]: [usize; 2]) {
    let [a, b, c, d] = corners;
    let at = |column: usize, row: usize| {
        let share = column as f32 / columns as f32;
        a.lerp(b, share).lerp(d.lerp(c, share), row as f32 / rows as f32)
    };
    for k in 0..columns * rows {
        let (x, y) = (k % columns, k / columns);
        let color = w.palette.slate[(x * 7 + y * 5 + x * y) % 3];
        let face = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
        // The upper row of a gable that ends in a point has no upper edge.
        match face[2] == face[3] {
            true => w.stone.polygon(&face[..3], color),
            false => w.stone.polygon(&face, color),
        }
    }
}

/// Both slopes over a bay of the nave, with a crest of iron.
pub fn nave_roof(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("nave roof", |w| {
        let [out, low] = EAVES_M;
        for side in [-1.0, 1.0] {
            let (left, right) = if side > 0.0 { (0.0, BAY_M) } else { (BAY_M, 0.0) };
            let at = |x: f32, y: f32, z: f32| vec3(x, y, z * side);
            let corners = [at(left, low, out), at(right, low, out), at(right, RIDGE_M, 0.0), at(left, RIDGE_M, 0.0)];
            slates(w, corners, [8, 8]);
        }
        for k in 0..7 {
            let at = vec3(0.5 + k as f32, RIDGE_M - 0.05, 0.0);
            w.stone.prism(at, 0.14, 0.0, 0.9, 4, w.palette.dark);
        }
        w.stone.bar(vec3(0.0, RIDGE_M, 0.0), vec3(BAY_M, RIDGE_M, 0.0), [0.3, 0.2], w.palette.dark);
    })
}

/// A buttress outside the aisle's wall, its pinnacle, and the arches that fly to the clerestory.
pub fn buttress(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("buttress", |w| {
        let (stone, trim, dark) = (w.palette.stone[1], w.palette.trim, w.palette.dark);
        for (half, low, high, out) in [(0.95, -0.3, 5.0, 11.2), (0.85, 5.0, 10.0, 10.8), (0.75, 10.0, 19.5, 10.3)] {
            w.stone.cuboid(vec3(-half, low, -out), vec3(half, high, -7.45), if low < 0.0 { dark } else { stone });
            // The offset sheds water.
            w.stone.bar(vec3(0.0, high, -out + 0.1), vec3(0.0, high + 0.5, -out + 0.7), [2.0 * half, 0.16], trim);
        }
        for x in [-0.76, 0.76] {
            // Blind tracery on the flanks.
            let mut flank = Geometry::default();
            let arch = Pointed::equilateral(1.6);
            let blind = Opening { middle: -8.9, sill: 11.0, spring: 16.5, arch, pieces: 4 };
            roll(&mut flank, &blind, 0.0, 0.09, 4, trim);
            w.stone.copy(&flank, |p| vec3(x - p.z, p.y, p.x));
        }
        pinnacle(&mut w.stone, vec3(0.0, 19.5, -9.0), 0.85, 8.0, 5, [stone, trim]);
        flyer(w, [15.2, 19.6]);
        flyer(w, [19.2, 24.6]);
    })
}

/// An arch that rises from the buttress to the wall, `low` to `high`.
fn flyer(w: &mut Work, [low, high]: [f32; 2]) {
    let (from, to, half, pieces) = (-7.6, -0.45, 0.38, 8);
    let quarter: Vec<(f32, f32)> = ring(4 * 16)[..17].iter().map(|corner| (1.0 - corner.x, corner.y)).collect();
    let curve: Vec<(f32, f32)> = (0..=pieces)
        .map(|k| {
            let (along, up) = quarter[k * 16 / pieces];
            (from + (to - from) * along, low - 1.2 + (high - low + 0.2) * up)
        })
        .collect();
    let top = |z: f32| low + 0.9 + (high - low) * (z - from) / (to - from);
    for pair in curve.windows(2) {
        let ([z0, y0], [z1, y1]) = ([pair[0].0, pair[0].1], [pair[1].0, pair[1].1]);
        let at = |x: f32, y: f32, z: f32| vec3(x * half, y, z);
        let (t0, t1) = (top(z0), top(z1));
        w.stone.polygon(&[at(1.0, y1, z1), at(1.0, y0, z0), at(1.0, t0, z0), at(1.0, t1, z1)], w.stones.next());
        w.stone.polygon(&[at(-1.0, y0, z0), at(-1.0, y1, z1), at(-1.0, t1, z1), at(-1.0, t0, z0)], w.stones.next());
        w.stone.polygon(&[at(-1.0, y0, z0), at(1.0, y0, z0), at(1.0, y1, z1), at(-1.0, y1, z1)], w.palette.dark);
        w.stone.polygon(&[at(1.0, t0, z0), at(-1.0, t0, z0), at(-1.0, t1, z1), at(1.0, t1, z1)], w.palette.trim);
    }
    for k in 1..8 {
        let z = from + (to - from) * k as f32 / 8.0;
        let at = vec3(0.0, top(z), z);
        w.stone.tube(&[at, at + vec3(0.0, 0.3, -0.06), at + vec3(0.0, 0.38, -0.25)], 0.1, 4, w.palette.trim);
    }
}

/// The floor of a bay's aisle.
pub fn aisle_floor(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("aisle floor", |w| super::fittings::tiles(w, [0.0, -BAY_M], [BAY_M, 0.0], [7, 7]))
}
