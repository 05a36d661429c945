//! The west towers: storeys of ten by ten metres, drawn about the tower's axis with their floor at y = 0, and spires.
use super::Lodge;
use crate::generate::glb_writer::MeshId;
use crate::generate::gothic::{Face, Opening, Pointed, Tracery, Wall, pinnacle, roll, tracery};
use crate::generate::solid::{Geometry, ring};
use glam::{vec2, vec3};

/// Half of a tower's side, and the height of a storey.
pub const HALF_M: f32 = 5.0;
pub const STOREY_M: f32 = 17.0;

/// What fills the openings of a storey.
#[derive(Clone, Copy, PartialEq)]
pub enum Fill {
    /// Stone: they are blind.
    Stone,
    /// Slanting boards, as before bells.
    Louvers,
}

pub fn storey(lodge: &mut Lodge, name: &str, fill: Fill) -> MeshId {
    lodge.mesh(name, |w| {
        let (trim, dark) = (w.palette.trim, w.palette.dark);
        let mut face = Geometry::default();
        let (sill, spring, width) = if fill == Fill::Louvers { (1.6, 11.4, 2.9) } else { (3.5, 9.5, 2.4) };
        for side in [-1.0, 1.0] {
            let (low, high): (f32, f32) = if side < 0.0 { (-HALF_M, 0.0) } else { (0.0, HALF_M) };
            let wall = Wall {
                low: vec2(low, 0.0),
                high: vec2(high, STOREY_M),
                front: HALF_M,
                back: HALF_M - 0.8,
                stone: vec2(1.8, 1.3),
            };
            let opening = Opening { middle: side * 2.1, sill, spring, arch: Pointed::equilateral(width), pieces: 6 };
            wall.pierced(&mut face, &opening, &mut w.stones, dark);
            tracery(&mut face, &opening, HALF_M - 0.3, Tracery::Plain, trim);
            roll(&mut face, &opening.grown(0.14), HALF_M + 0.04, 0.14, 4, trim);
            if fill == Fill::Louvers {
                for board in 0..12 {
                    let y = sill + 0.2 + 0.95 * board as f32;
                    face.bar(
                        vec3(side * 2.1, y, HALF_M - 0.5),
                        vec3(side * 2.1, y + 0.45, HALF_M - 0.78),
                        [width, 0.06],
                        w.palette.wood[0],
                    );
                }
            }
        }
        let back = Wall {
            low: vec2(-HALF_M + 0.8, 0.0),
            high: vec2(HALF_M - 0.8, STOREY_M),
            front: HALF_M - 0.85,
            back: 0.0,
            stone: vec2(2.1, 1.7),
        };
        back.stones(&mut face, Face::Front, [back.low, back.high], &mut w.stones);
        for (y, reach) in [(0.15, 0.35), (STOREY_M - 0.2, 0.45)] {
            face.cuboid(vec3(-HALF_M - 0.4, y - 0.2, HALF_M - 0.1), vec3(HALF_M - 0.15, y + 0.2, HALF_M + reach), trim);
        }
        for turn in ring(4) {
            w.stone.copy(&face, |p| vec3(p.x * turn.x + p.z * turn.y, p.y, p.z * turn.x - p.x * turn.y));
        }
        for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            // Buttresses clasp the corners.
            let at = vec3(x * (HALF_M - 0.2), 0.0, z * (HALF_M - 0.2));
            w.stone.block(at, vec3(1.9, STOREY_M * 0.62, 1.9), w.palette.stone[1]);
            w.stone.block(at + vec3(0.0, STOREY_M * 0.62, 0.0), vec3(1.6, STOREY_M * 0.38, 1.6), w.palette.stone[2]);
            w.stone.prism(at + vec3(x * 0.9, STOREY_M * 0.6, z * 0.9), 0.5, 0.0, 3.2, 8, trim);
        }
    })
}

/// A spire of eight sides, between four pinnacles.
pub fn spire(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("spire", |w| {
        let (stone, trim) = (w.palette.stone[0], w.palette.trim);
        w.stone.cuboid(vec3(-HALF_M, 0.0, -HALF_M), vec3(HALF_M, 0.5, HALF_M), stone);
        pinnacle(&mut w.stone, vec3(0.0, 0.5, 0.0), 4.3, 34.0, 12, [stone, trim]);
        for (x, z) in [(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)] {
            pinnacle(&mut w.stone, vec3(x, 0.5, z), 1.0, 9.0, 5, [stone, trim]);
        }
        for k in 0..10 {
            let x = -4.5 + k as f32;
            for z in [-4.85, 4.85] {
                w.stone.block(vec3(x, 0.5, z), vec3(0.3, 1.0, 0.3), trim);
                w.stone.block(vec3(z, 0.5, x), vec3(0.3, 1.0, 0.3), trim);
            }
        }
    })
}

/// The flèche over the crossing, of wood and lead.
pub fn fleche(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("fleche", |w| {
        let (slate, dark) = (w.palette.slate[0], w.palette.dark);
        pinnacle(&mut w.stone, vec3(0.0, 0.0, 0.0), 1.5, 26.0, 12, [slate, dark]);
    })
}
