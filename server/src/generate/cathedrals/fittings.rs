//! What stands on the floor, and the floor.
use super::bay::BAY_M;
use super::plan::NAVE_M;
use super::{Lodge, Work};
use crate::generate::glb_writer::MeshId;
use crate::generate::solid::ring;
use glam::{Vec3, vec2, vec3};

/// Squares of two triangles from `low` to `high` (x and z), by turns in two colours.
pub fn tiles(w: &mut Work, low: [f32; 2], high: [f32; 2], [columns, rows]: [usize; 2]) {
    let at = |x: usize, z: usize| {
        let share = |k: usize, count: usize, axis: usize| low[axis] + (high[axis] - low[axis]) * k as f32 / count as f32;
        vec3(share(x, columns, 0), 0.0, share(z, rows, 1))
    };
    for k in 0..columns * rows {
        let (x, z) = (k % columns, k / columns);
        w.stone.polygon(&[at(x, z + 1), at(x + 1, z + 1), at(x + 1, z), at(x, z)], w.palette.floor[(x + z) % 2]);
    }
}

/// The nave's pavement from the west door to the crossing, of exactly `triangles`: squares of two triangles, and stars
/// of four as far as the number wants them. One square at the wall has a corner more where it is odd.
pub fn pavement(lodge: &mut Lodge, triangles: usize) -> MeshId {
    let (low, high) = (vec2(-9.2, -BAY_M), vec2(NAVE_M, BAY_M));
    // Squares of about three triangles, four to one along the axis.
    let mut rows = 1;
    while 3 * (rows + 1) * (rows + 1) * 9 / 2 <= triangles {
        rows += 1;
    }
    let columns = rows * 9 / 2;
    let stars = (triangles - 2 * columns * rows) / 2;
    assert!(stars <= columns * rows, "{triangles} triangles are no pavement of {columns} by {rows}");
    lodge.mesh("nave pavement", |w| {
        let at = |x: usize, z: usize| {
            let share = vec2(x as f32 / columns as f32, z as f32 / rows as f32);
            let p = low + (high - low) * share;
            vec3(p.x, 0.0, p.y)
        };
        let floor = w.palette.floor;
        let squares = columns * rows;
        for k in 0..squares {
            let (x, z) = (k % columns, k / columns);
            let corners = [at(x, z + 1), at(x + 1, z + 1), at(x + 1, z), at(x, z)];
            let is_star = (k + 1) * stars / squares > k * stars / squares;
            if is_star {
                let middle = (corners[0] + corners[2]) / 2.0;
                for side in 0..4 {
                    let color = floor[if side % 2 == 0 { 1 } else { 2 }];
                    w.stone.polygon(&[corners[side], corners[(side + 1) % 4], middle], color);
                }
            } else {
                w.stone.polygon(&corners, floor[0]);
            }
        }
        if triangles % 2 == 1 {
            // The door's threshold.
            w.stone.polygon(&[vec3(-9.25, 0.0, 1.8), vec3(-9.2, 0.0, 0.0), vec3(-9.25, 0.0, -1.8)], floor[0]);
        }
    })
}

/// Five rows of pews on either side of the nave's middle.
pub fn pews(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("pews", |w| {
        let [wood, dark] = w.palette.wood;
        for row in 0..5 {
            let x = 0.5 + 1.35 * row as f32;
            for side in [-1.0, 1.0] {
                let (near, far): (f32, f32) = (1.2 * side, 5.4 * side);
                let (low, high) = (near.min(far), near.max(far));
                let mut slab = |from: Vec3, to: Vec3| w.stone.cuboid(from, to, wood);
                slab(vec3(x - 0.25, 0.42, low), vec3(x + 0.22, 0.47, high));
                slab(vec3(x - 0.3, 0.35, low), vec3(x - 0.25, 1.0, high));
                slab(vec3(x - 0.36, 0.98, low), vec3(x - 0.2, 1.02, high));
                slab(vec3(x - 0.5, 0.1, low), vec3(x - 0.38, 0.14, high));
                for z in [near, far] {
                    w.stone.cuboid(vec3(x - 0.55, 0.0, z - 0.04), vec3(x + 0.28, 0.95, z + 0.04), dark);
                    let finial = [(0.03, 0.0), (0.05, 0.06), (0.03, 0.1), (0.07, 0.2), (0.0, 0.32)];
                    w.stone.lathe(vec3(x - 0.3, 0.95, z), &finial, 6, dark);
                }
            }
        }
    })
}

/// Two ranks of stalls on either side of a choir bay, under canopies.
pub fn stalls(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("choir stalls", |w| {
        let [wood, dark] = w.palette.wood;
        for side in [-1.0, 1.0] {
            for rank in 0..2 {
                let (z, floor) = (side * (4.0 + 1.1 * rank as f32), 0.35 * rank as f32);
                w.stone.cuboid(vec3(0.3, 0.0, z - 0.55), vec3(BAY_M - 0.3, floor + 0.1, z + 0.55), dark);
                for seat in 0..8 {
                    let x = 0.8 + 0.77 * seat as f32;
                    w.stone.cuboid(vec3(x - 0.3, floor + 0.5, z - 0.25), vec3(x + 0.3, floor + 0.56, z + 0.3), wood);
                    w.stone.cuboid(vec3(x - 0.36, floor + 0.1, z - 0.3), vec3(x - 0.3, floor + 1.0, z + 0.3), dark);
                    w.stone.lathe(vec3(x - 0.33, floor + 1.0, z), &[(0.05, 0.0), (0.08, 0.1), (0.0, 0.25)], 8, wood);
                }
            }
            let back = side * 5.8;
            w.stone.cuboid(vec3(0.3, 0.0, back - 0.06), vec3(BAY_M - 0.3, 3.0, back + 0.06), wood);
            for canopy in 0..8 {
                let at = vec3(0.8 + 0.77 * canopy as f32, 3.0, back - side * 0.2);
                w.stone.prism(at, 0.3, 0.0, 1.2, 8, dark);
                w.stone.bar(at - vec3(0.38, 3.0, 0.0), at - vec3(0.38, 0.0, 0.0), [0.08, 0.08], dark);
            }
        }
    })
}

/// The high altar on its steps, with a retable and candles.
pub fn altar(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("altar", |w| {
        let (trim, gilt) = (w.palette.trim, w.palette.gilt);
        for step in 0..3 {
            let reach = 2.4 - 0.5 * step as f32;
            let top = 0.16 * (step + 1) as f32;
            w.stone.cuboid(vec3(-reach, 0.0, -reach - 1.0), vec3(reach, top, reach + 1.0), w.palette.floor[step % 3]);
        }
        w.stone.cuboid(vec3(-0.6, 0.48, -1.6), vec3(0.6, 1.45, 1.6), trim);
        w.stone.cuboid(vec3(-0.7, 1.45, -1.75), vec3(0.7, 1.55, 1.75), w.palette.dark);
        w.stone.cuboid(vec3(0.55, 1.55, -1.7), vec3(0.75, 3.2, 1.7), gilt);
        for k in 0..7 {
            let at = vec3(0.62, 3.2, -1.5 + 0.5 * k as f32);
            w.stone.prism(at, 0.2, 0.0, 1.0 - 0.2 * (k as f32 - 3.0).abs(), 8, gilt);
        }
        for k in 0..6 {
            let at = vec3(0.0, 1.55, -1.5 + 0.6 * k as f32);
            let stick =
                [(0.12, 0.0), (0.03, 0.1), (0.05, 0.25), (0.03, 0.45), (0.1, 0.5), (0.03, 0.52), (0.03, 0.9), (0.0, 0.95)];
            w.stone.lathe(at, &stick, 12, gilt);
        }
    })
}

/// A ring of lamps that hangs from the vault.
pub fn chandelier(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("chandelier", |w| {
        let gilt = w.palette.gilt;
        w.stone.torus(vec3(0.0, 8.0, 0.0), 1.6, 0.08, [24, 4], gilt);
        w.stone.torus(vec3(0.0, 9.0, 0.0), 0.8, 0.06, [16, 4], gilt);
        for out in ring(12) {
            let foot = vec3(out.x * 1.6, 8.05, out.y * 1.6);
            w.stone.lathe(foot, &[(0.1, 0.0), (0.05, 0.1), (0.05, 0.35), (0.0, 0.45)], 8, gilt);
        }
        for out in ring(4) {
            let (low, high) = (vec3(out.x * 1.6, 8.0, out.y * 1.6), vec3(0.0, 11.0, 0.0));
            w.stone.tube(&[low, high], 0.03, 4, w.palette.dark);
        }
        w.stone.tube(&[vec3(0.0, 11.0, 0.0), vec3(0.0, 26.2, 0.0)], 0.03, 4, w.palette.dark);
    })
}
