//! The land around the castle: a hill, a path through the alley, tufts of grass.
use crate::generate::glb_writer::{GlbWriter, MaterialId, NodeId, Place};
use crate::generate::random::Random;
use crate::generate::solid::{Geometry, srgb};
use glam::{Vec3, vec3};

/// Half the side of the land, and squares along it.
const HALF_M: f32 = 140.0;
const CELLS: usize = 48;
/// The castle stands on level ground of this radius.
const LEVEL_M: f32 = 34.0;
/// Half the width of the path.
const PATH_M: f32 = 2.2;
/// The land is cut into so many pieces each way, the grass into as many along the alley as those are.
const PIECES: usize = 4;

/// The land's height: level around the castle, then falling gently, with hollows.
fn height(x: f32, z: f32) -> f32 {
    let out = ((x * x + z * z).sqrt() - LEVEL_M).max(0.0);
    // Waves of parabolas: nothing but sums and products.
    let wave = |t: f32| {
        let s = t - t.floor();
        8.0 * s * (1.0 - s) - 1.0
    };
    let rough = wave(x * 0.011 + 0.3) * wave(z * 0.013) * (out * 0.04).min(1.5);
    rough - 0.0006 * out * out - 0.004 * out
}

/// Adds the land in pieces, two triangles to a square.
pub fn ground(glb: &mut GlbWriter, paint: MaterialId, castle: NodeId, random: &mut Random) {
    let land = glb.node(Some(castle), "land".into(), None, Place::at(Vec3::ZERO));
    let (greens, path) = ([srgb(118, 136, 72), srgb(121, 138, 73), srgb(115, 133, 70)], srgb(186, 168, 132));
    let across = CELLS / PIECES;
    let at = |column: usize, row: usize| {
        let meters = |k: usize| (k as f32 / CELLS as f32 * 2.0 - 1.0) * HALF_M;
        vec3(meters(column), height(meters(column), meters(row)), meters(row))
    };
    for piece in 0..PIECES * PIECES {
        let mut g = Geometry::default();
        for k in 0..across * across {
            let (column, row) = (piece % PIECES * across + k % across, piece / PIECES * across + k / across);
            let corners = [at(column, row + 1), at(column + 1, row + 1), at(column + 1, row), at(column, row)];
            let color = *random.pick(&greens);
            g.polygon(&[corners[0], corners[1], corners[2]], color);
            g.polygon(&[corners[0], corners[2], corners[3]], color);
        }
        let mesh = glb.mesh("land", &[(&g, paint)]);
        glb.node(Some(land), format!("land {}", piece + 1), Some(mesh), Place::at(Vec3::ZERO));
    }
    let mut g = Geometry::default();
    let (from, to, steps) = (27.5, HALF_M, 60);
    for k in 0..steps {
        let z = |k: usize| from + (to - from) * k as f32 / steps as f32;
        // Over the squares of the land, which are no finer than this.
        let above = |x: f32, z: f32| vec3(x, surface(x, z) + 0.05, z);
        let (near, far) = (z(k), z(k + 1));
        g.polygon(&[above(-PATH_M, far), above(0.0, far), above(0.0, near), above(-PATH_M, near)], path);
        g.polygon(&[above(0.0, far), above(PATH_M, far), above(PATH_M, near), above(0.0, near)], path);
    }
    let mesh = glb.mesh("path", &[(&g, paint)]);
    glb.node(Some(land), "path".into(), Some(mesh), Place::at(Vec3::ZERO));
}

/// The height of the triangles that [`ground`] makes.
pub fn surface(x: f32, z: f32) -> f32 {
    let cell = 2.0 * HALF_M / CELLS as f32;
    let (u, v) = ((x + HALF_M) / cell, (z + HALF_M) / cell);
    let (column, row) = (u.floor(), v.floor());
    let at = |dx: f32, dz: f32| height((column + dx) * cell - HALF_M, (row + dz) * cell - HALF_M);
    let (u, v) = (u - column, v - row);
    // The diagonal goes from (0, 1) to (1, 0).
    if u + v >= 1.0 {
        at(1.0, 1.0) + (at(0.0, 1.0) - at(1.0, 1.0)) * (1.0 - u) + (at(1.0, 0.0) - at(1.0, 1.0)) * (1.0 - v)
    } else {
        at(0.0, 0.0) + (at(1.0, 0.0) - at(0.0, 0.0)) * u + (at(0.0, 1.0) - at(0.0, 0.0)) * v
    }
}

/// Exactly so many blades of grass, a triangle each, in tufts along the alley and around the trees.
pub fn grass(glb: &mut GlbWriter, leaves: MaterialId, castle: NodeId, trees: &[Vec3], blades: usize, random: &mut Random) {
    let meadow = glb.node(Some(castle), "grass".into(), None, Place::at(Vec3::ZERO));
    let greens = [srgb(96, 124, 54), srgb(112, 140, 60), srgb(132, 150, 72), srgb(150, 156, 84)];
    let mut pieces = vec![Geometry::default(); PIECES * PIECES];
    let mut tuft = (Vec3::ZERO, 0);
    for _ in 0..blades {
        if tuft.1 == 0 {
            tuft = (place_tuft(trees, random), 6 + random.below(9));
        }
        tuft.1 -= 1;
        let (x, z) = (tuft.0.x + random.range(-0.22, 0.22), tuft.0.z + random.range(-0.22, 0.22));
        let foot = vec3(x, surface(x, z) - 0.02, z);
        let (lean, side) = (random.range(-0.12, 0.12), vec3(random.range(-1.0, 1.0), 0.0, random.range(-1.0, 1.0)));
        let side = (side + Vec3::X * 0.01).normalize() * 0.022;
        let tip = foot + vec3(lean, random.range(0.14, 0.4), random.range(-0.12, 0.12));
        let along = ((z - 20.0) / (HALF_M - 20.0) * (PIECES * PIECES) as f32).max(0.0) as usize;
        let piece = &mut pieces[along.min(PIECES * PIECES - 1)];
        piece.polygon(&[foot - side, foot + side, tip], *random.pick(&greens));
    }
    for (k, piece) in pieces.iter().enumerate().filter(|(_, piece)| piece.triangles() > 0) {
        let mesh = glb.mesh("grass", &[(piece, leaves)]);
        glb.node(Some(meadow), format!("grass {}", k + 1), Some(mesh), Place::at(Vec3::ZERO));
    }
}

/// Two fifths of the tufts stand around trees, the others to both sides of the path.
fn place_tuft(trees: &[Vec3], random: &mut Random) -> Vec3 {
    if random.chance(0.4) {
        let tree = *random.pick(trees);
        // Outwards of the path.
        return tree + vec3(tree.x.signum() * random.range(0.0, 2.5), 0.0, random.range(-2.5, 2.5));
    }
    let side = if random.chance(0.5) { 1.0 } else { -1.0 };
    let out = PATH_M + 0.4 + 16.0 * random.unit() * random.unit();
    vec3(side * out, 0.0, random.range(34.0, HALF_M - 6.0))
}
