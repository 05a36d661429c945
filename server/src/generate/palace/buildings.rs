//! The monuments: each a group of the shared meshes.
use super::Builder;
use super::masonry::{COLONNADE_M, GATE_HEIGHT_M, RUN_M, WALL_HEIGHT_M, terrace};
use crate::generate::glb_writer::{NodeId, Place};
use glam::{Vec3, vec3};

/// The mosque's west side: a portal towards the court, three domes, halls to both sides.
pub fn prayer_hall(b: &mut Builder, quarter: NodeId, at: Vec3) {
    let hall = b.group(quarter, "prayer hall", Place::turned(at, 1));
    b.leaf(hall, "portal", b.masonry.portal, Place::at(Vec3::ZERO).scaled(vec3(1.0, 0.75, 0.8)));
    let domes = b.group(hall, "domes", Place::at(vec3(0.0, 6.5, -10.0)));
    for (x, size) in [(-26.0, 1.1), (0.0, 1.9), (26.0, 1.1)] {
        b.leaf(domes, "dome", b.masonry.dome, Place::at(vec3(x, 0.0, 0.0)).scaled(Vec3::splat(size)));
    }
    let halls = b.group(hall, "halls", Place::at(vec3(0.0, 0.0, -5.0)));
    for (name, x) in [("south hall", -10.0 - RUN_M), ("north hall", 10.0)] {
        let node = b.group(halls, name, Place::at(vec3(x, 0.0, 0.0)));
        for row in 0..2 {
            b.leaf(node, "aisle", b.masonry.arcade, Place::at(vec3(0.0, 0.0, -5.0 * row as f32)));
        }
    }
}

/// The victory gate: portal between wings, pavilions on top, the great stair before it.
pub fn great_gate(b: &mut Builder, quarter: NodeId, at: Vec3) {
    let gate = b.group(quarter, "great gate", Place::at(at));
    b.own_leaf(gate, "terrace", Place::at(vec3(0.0, 0.0, -4.0)), |g, stone| terrace(g, vec3(46.0, 10.0, 12.0), stone));
    b.leaf(gate, "portal", b.masonry.portal, Place::at(Vec3::ZERO).scaled(vec3(1.0, 1.3, 1.0)));
    let wings = b.group(gate, "wings", Place::at(Vec3::ZERO));
    b.leaf(wings, "east wing", b.masonry.wing, Place::at(vec3(10.0, 0.0, 0.0)).scaled(vec3(1.0, 1.3, 1.0)));
    b.leaf(wings, "west wing", b.masonry.wing, Place::at(vec3(-19.0, 0.0, 0.0)).scaled(vec3(1.0, 1.3, 1.0)));
    let top = b.group(gate, "top", Place::at(vec3(0.0, GATE_HEIGHT_M * 1.3, -1.0)));
    b.leaf(top, "pavilions", b.masonry.parapet, Place::at(vec3(0.0, 0.0, -1.0)));
    for x in [-7.0, 0.0, 7.0] {
        b.leaf(top, "chhatri", b.masonry.chhatri, Place::at(vec3(x, 0.0, -5.0)));
    }
    let stairs = b.group(gate, "stairs", Place::at(vec3(0.0, 0.0, 2.0)));
    b.leaf(stairs, "stair", b.masonry.stair, Place::at(vec3(-12.0, 0.0, 0.0)));
    b.leaf(stairs, "stair", b.masonry.stair, Place::at(vec3(12.8, 0.0, 0.0)));
}

/// Pierced screens on all sides of a dome.
pub fn tomb(b: &mut Builder, quarter: NodeId, name: &str, at: Vec3) {
    let tomb = b.group(quarter, name, Place::at(at));
    let screens = b.group(tomb, "screens", Place::at(vec3(0.0, 0.9, 0.0)));
    for k in 0..4 {
        let out = [Vec3::Z, Vec3::X, -Vec3::Z, -Vec3::X][k];
        b.leaf(screens, "pierced screen", b.masonry.screen, Place::turned(out * 6.0, k));
    }
    b.leaf(tomb, "dome", b.masonry.dome, Place::at(vec3(0.0, 5.5, 0.0)));
    b.leaf(tomb, "floor", b.masonry.paving, Place::at(vec3(0.0, 0.9, 0.0)).scaled(vec3(0.7, 4.0, 0.7)));
}

/// The palace of five storeys, each smaller than the one below, the top a chhatri.
pub fn five_storeys(b: &mut Builder, court: NodeId, at: Vec3) {
    let palace = b.group(court, "palace of five storeys", Place::at(at));
    for storey in 0..4 {
        let y = (COLONNADE_M[0] + 0.3) * storey as f32;
        let size = 1.0 - 0.2 * storey as f32;
        let node = b.group(palace, format!("storey {}", storey + 1), Place::at(vec3(0.0, y, 0.0)));
        for side in 0..4 {
            b.leaf(node, "colonnade", b.masonry.colonnade, facing_out(side, size).scaled(vec3(size, 1.0, size)));
        }
    }
    let y = (COLONNADE_M[0] + 0.3) * 4.0;
    b.leaf(palace, "chhatri", b.masonry.chhatri, Place::at(vec3(0.0, y, 0.0)).scaled(Vec3::splat(1.3)));
}

/// One of the four sides of a square whose fronts look outwards; `size` is its side in runs.
fn facing_out(side: usize, size: f32) -> Place {
    let half = size * RUN_M / 2.0;
    // The corner from which +X runs along the side, on whole quarter turns: exact.
    let corner = [vec3(-half, 0.0, half), vec3(half, 0.0, half), vec3(half, 0.0, -half), vec3(-half, 0.0, -half)];
    Place::turned(corner[side % 4], side)
}

/// The hall with the pillar: four walls, a chhatri at each corner of the roof.
pub fn private_audience(b: &mut Builder, court: NodeId, at: Vec3) {
    let hall = b.group(court, "hall of private audience", Place::at(at));
    let size = 0.55;
    let half = size * RUN_M / 2.0;
    b.leaf(hall, "pillar", b.masonry.pillar, Place::at(Vec3::ZERO));
    let walls = b.group(hall, "walls", Place::at(Vec3::ZERO));
    for side in 0..4 {
        b.leaf(walls, "wall", b.masonry.wall, facing_out(side, size).scaled(vec3(size, 1.2, size)));
    }
    let roof = b.group(hall, "roof", Place::at(vec3(0.0, WALL_HEIGHT_M * 1.2, 0.0)));
    b.leaf(roof, "slabs", b.masonry.paving, Place::at(Vec3::ZERO).scaled(vec3(size, 1.0, size)));
    for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        let at = vec3(x, 0.0, z) * (half - 2.2);
        b.leaf(roof, "chhatri", b.masonry.chhatri, Place::at(at).scaled(Vec3::splat(0.9)));
    }
}

/// A raised tank of water with pavilions on two sides.
pub fn pool(b: &mut Builder, court: NodeId, at: Vec3) {
    let pool = b.group(court, "pool", Place::at(at));
    b.leaf(pool, "basin", b.masonry.pool, Place::at(vec3(0.0, 1.3, 0.0)));
    let pavilions = b.group(pool, "pavilions", Place::at(Vec3::ZERO));
    for x in [-15.0, 15.0] {
        b.leaf(pavilions, "chhatri", b.masonry.chhatri, Place::at(vec3(x, 0.0, 0.0)));
    }
}

/// An open hall: colonnades back to back under a roof with chhatris.
pub fn pavilion(b: &mut Builder, court: NodeId, name: &str, at: Vec3) {
    let pavilion = b.group(court, name, Place::at(at));
    let hall = b.group(pavilion, "hall", Place::at(Vec3::ZERO));
    b.leaf(hall, "front", b.masonry.colonnade, Place::at(vec3(-RUN_M / 2.0, 0.0, COLONNADE_M[1])));
    b.leaf(hall, "rear", b.masonry.colonnade, Place::turned(vec3(RUN_M / 2.0, 0.0, -COLONNADE_M[1]), 2));
    let roof = b.group(pavilion, "roof", Place::at(vec3(0.0, COLONNADE_M[0] + 0.3, 0.0)));
    for x in [-9.0, 9.0] {
        b.leaf(roof, "chhatri", b.masonry.chhatri, Place::at(vec3(x, 0.0, 0.0)));
    }
}

/// A domed tower at each corner of a court.
pub fn corner_domes(b: &mut Builder, court: NodeId, half: Vec3) {
    let towers = b.group(court, "corner towers", Place::at(Vec3::ZERO));
    for (k, (x, z)) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].into_iter().enumerate() {
        let tower = b.group(towers, format!("tower {}", k + 1), Place::at(vec3(x, 0.0, z) * half));
        b.leaf(tower, "walls", b.masonry.house, Place::at(Vec3::ZERO).scaled(vec3(0.9, 1.3, 0.9)));
        b.leaf(tower, "dome", b.masonry.dome, Place::at(vec3(0.0, 7.8, 0.0)).scaled(Vec3::splat(1.05)));
    }
}

/// The town wall in the south and the east with a gate, and the tower by the lake.
pub fn walls(b: &mut Builder, palace: NodeId) {
    let walls = b.group(palace, "town wall", Place::at(Vec3::ZERO));
    // Each stretch ends in a bastion.
    let south = b.group(walls, "south wall", Place::at(vec3(-216.0, 0.0, 200.0)));
    stretches(b, south, 4, 4);
    let east = b.group(walls, "east wall", Place::turned(vec3(215.0, 0.0, 200.0), 1));
    stretches(b, east, 4, 4);
    let gate = b.group(walls, "town gate", Place::at(vec3(190.0, 0.0, 201.0)));
    b.leaf(gate, "portal", b.masonry.portal, Place::at(Vec3::ZERO).scaled(Vec3::splat(0.7)));
    b.leaf(gate, "pavilions", b.masonry.parapet, Place::at(vec3(0.0, GATE_HEIGHT_M * 0.7, -1.0)).scaled(Vec3::splat(0.7)));
    let lake = b.group(palace, "lake shore", Place::at(vec3(-150.0, 0.0, -160.0)));
    b.leaf(lake, "tower", b.masonry.tower, Place::at(Vec3::ZERO));
    b.leaf(lake, "paving", b.masonry.paving, Place::at(Vec3::ZERO));
}

fn stretches(b: &mut Builder, wall: NodeId, stretches: usize, runs: usize) {
    for stretch in 0..stretches {
        let x = (stretch * runs) as f32 * RUN_M;
        let node = b.group(wall, format!("stretch {}", stretch + 1), Place::at(vec3(x, 0.0, 0.0)));
        for run in 0..runs {
            b.leaf(node, "rampart", b.masonry.rampart, Place::at(vec3(run as f32 * RUN_M, 0.0, 0.0)));
        }
        b.leaf(node, "bastion", b.masonry.tower, Place::at(vec3(0.0, -1.0, -1.0)).scaled(vec3(1.1, 0.6, 1.1)));
    }
}
