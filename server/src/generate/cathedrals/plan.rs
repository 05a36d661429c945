//! Where the members stand: nave, crossing, transept, choir, west front, on a grid of seven metres.
use super::bay::{self, BAY_M, RIDGE_M, VAULT_HALF_M};
use super::choir::{self, WEDGES, chord_scale, facing_in, outwards};
use super::fronts::Front;
use super::tower::{self, Fill, HALF_M, STOREY_M};
use super::{Lodge, fittings, fronts};
use crate::generate::glb_writer::{MeshId, NodeId, Place};
use crate::generate::solid::srgb;
use glam::{Vec3, vec3};

const NAVE_BAYS: usize = 7;
const CHOIR_BAYS: usize = 3;
const TRANSEPT_BAYS: usize = 2;
/// Length of the nave.
pub const NAVE_M: f32 = NAVE_BAYS as f32 * BAY_M;
/// Where the crossing begins and ends, and the apse's middle.
const CROSSING_M: [f32; 2] = [NAVE_M, NAVE_M + 2.0 * BAY_M];
const APSE_M: f32 = CROSSING_M[1] + CHOIR_BAYS as f32 * BAY_M;
/// The west front's outer end, and the distance of the towers' axes from the nave's.
const WEST_M: f32 = -9.2;
const TOWERS_M: f32 = 10.2;

/// The meshes.
pub struct Members {
    arcade: MeshId,
    triforium: MeshId,
    clerestory: MeshId,
    pier: MeshId,
    aisle_wall: MeshId,
    aisle_vault: MeshId,
    aisle_roof: MeshId,
    aisle_floor: MeshId,
    nave_vault: MeshId,
    nave_roof: MeshId,
    buttress: MeshId,
    corner: MeshId,
    great_arch: MeshId,
    crossing_floor: MeshId,
    transept_floor: MeshId,
    choir_floor: MeshId,
    ambulatory_vault: MeshId,
    ambulatory_roof: MeshId,
    apse_vault: MeshId,
    apse_roof: MeshId,
    apse_floor: MeshId,
    west_front: MeshId,
    transept_front: MeshId,
    tower_storey: MeshId,
    belfry: MeshId,
    spire: MeshId,
    fleche: MeshId,
    pews: MeshId,
    stalls: MeshId,
    altar: MeshId,
    chandelier: MeshId,
    plinth: MeshId,
}

impl Members {
    pub fn new(lodge: &mut Lodge) -> Members {
        let west = Front { half_m: 6.0, rose_m: 4.4, door_m: 3.4, orders: 5 };
        let transept = Front { half_m: 8.2, rose_m: 5.6, door_m: 3.0, orders: 3 };
        Members {
            arcade: bay::arcade(lodge),
            triforium: bay::triforium(lodge),
            clerestory: bay::clerestory(lodge),
            pier: bay::pier(lodge),
            aisle_wall: bay::aisle_wall(lodge),
            aisle_vault: bay::aisle_vault(lodge),
            aisle_roof: bay::aisle_roof(lodge),
            aisle_floor: bay::aisle_floor(lodge),
            nave_vault: bay::nave_vault(lodge),
            nave_roof: bay::nave_roof(lodge),
            buttress: bay::buttress(lodge),
            corner: bay::corner(lodge),
            great_arch: bay::great_arch(lodge),
            crossing_floor: floor(lodge, "crossing floor", [2.0 * BAY_M, 2.0 * BAY_M], [14, 14]),
            transept_floor: floor(lodge, "transept floor", [2.0 * BAY_M, TRANSEPT_BAYS as f32 * BAY_M], [14, 14]),
            choir_floor: floor(lodge, "choir floor", [BAY_M, 2.0 * BAY_M], [8, 16]),
            ambulatory_vault: choir::ambulatory_vault(lodge),
            ambulatory_roof: choir::ambulatory_roof(lodge),
            apse_vault: choir::apse_vault(lodge),
            apse_roof: choir::apse_roof(lodge),
            apse_floor: choir::floor(lodge),
            west_front: fronts::build(lodge, "west front", &west),
            transept_front: fronts::build(lodge, "transept front", &transept),
            tower_storey: tower::storey(lodge, "tower storey", Fill::Stone),
            belfry: tower::storey(lodge, "belfry", Fill::Louvers),
            spire: tower::spire(lodge),
            fleche: tower::fleche(lodge),
            pews: fittings::pews(lodge),
            stalls: fittings::stalls(lodge),
            altar: fittings::altar(lodge),
            chandelier: fittings::chandelier(lodge),
            plinth: plinth(lodge),
        }
    }
}

/// A floor from the origin along +X, about z = 0.
fn floor(lodge: &mut Lodge, name: &str, [length, width]: [f32; 2], tiles: [usize; 2]) -> MeshId {
    lodge.mesh(name, |w| fittings::tiles(w, [0.0, -width / 2.0], [length, width / 2.0], tiles))
}

/// Three steps around all of it, and the ground it stands on.
fn plinth(lodge: &mut Lodge) -> MeshId {
    lodge.mesh("plinth", |w| {
        let stone = srgb(170, 164, 152);
        for step in 0..3 {
            let (reach, low, high) = (1.2 * (3 - step) as f32, -3.0 + 0.3 * step as f32, -1.0 + 0.3 * step as f32);
            // The arms' tops lie a little lower than the body's: no two faces share a plane.
            let mut slab = |from: [f32; 2], to: [f32; 2], drop: f32| {
                let low = vec3(from[0] - reach, low - drop, from[1] - reach);
                w.stone.cuboid(low, vec3(to[0] + reach, high - drop, to[1] + reach), stone);
            };
            slab([-12.0, -18.5], [APSE_M + 18.0, 18.5], 0.0);
            slab([CROSSING_M[0] - 3.0, -25.0], [CROSSING_M[1] + 3.0, 25.0], 0.03);
        }
        // What carries the floors, just below them.
        w.stone.cuboid(vec3(-11.0, -2.0, -15.0), vec3(APSE_M + 15.0, -0.04, 15.0), stone);
        w.stone.cuboid(vec3(CROSSING_M[0] - 1.0, -2.1, -22.0), vec3(CROSSING_M[1] + 1.0, -0.06, 22.0), stone);
    })
}

/// Adds all that stands in a cathedral but the nave's pavement.
pub fn build(l: &mut Lodge, cathedral: NodeId, m: &Members) {
    l.leaf(cathedral, "plinth", m.plinth, Place::at(Vec3::ZERO));
    nave(l, cathedral, m);
    crossing(l, cathedral, m);
    transept(l, cathedral, m);
    straight_choir(l, cathedral, m);
    apse(l, cathedral, m);
    west(l, cathedral, m);
}

/// Nothing but the wall towards the nave, whose front looks to +Z.
fn elevation(l: &mut Lodge, side: NodeId, m: &Members, place: Place) {
    l.leaf(side, "arcade", m.arcade, place);
    l.leaf(side, "triforium", m.triforium, place);
    l.leaf(side, "clerestory", m.clerestory, place);
}

/// One side of a bay with its aisle: `place` is where the wall's left end stands as seen from the nave.
fn side(l: &mut Lodge, bay: NodeId, name: &str, m: &Members, place: Place) -> NodeId {
    let node = l.group(bay, name, place);
    let here = Place::at(Vec3::ZERO);
    elevation(l, node, m, here);
    let aisle = l.group(node, "aisle", here);
    l.leaf(aisle, "wall", m.aisle_wall, here);
    l.leaf(aisle, "vault", m.aisle_vault, here);
    l.leaf(aisle, "floor", m.aisle_floor, here);
    l.leaf(aisle, "roof", m.aisle_roof, here);
    node
}

/// What stands where a bay begins.
#[derive(Clone, Copy, PartialEq)]
enum Joint {
    /// Piers and buttresses.
    Open,
    /// A tower or the transept.
    Adjoined,
}

impl Joint {
    fn of(bay: usize) -> Joint {
        if bay == 0 { Joint::Adjoined } else { Joint::Open }
    }
}

/// A bay with both sides and what stands at its first joint.
fn both_sides(l: &mut Lodge, bay: NodeId, m: &Members, joint: Joint) {
    let north = side(l, bay, "north side", m, Place::at(vec3(0.0, 0.0, -BAY_M)));
    let south = side(l, bay, "south side", m, Place::turned(vec3(BAY_M, 0.0, BAY_M), 2));
    for (side, x) in [(north, 0.0), (south, BAY_M)] {
        if joint == Joint::Open {
            let place = Place::at(vec3(x, 0.0, 0.0));
            l.leaf(side, "pier", m.pier, place);
            l.leaf(side, "buttress", m.buttress, place);
        }
    }
}

fn nave(l: &mut Lodge, cathedral: NodeId, m: &Members) {
    let nave = l.group(cathedral, "nave", Place::at(Vec3::ZERO));
    let here = Place::at(Vec3::ZERO);
    for k in 0..NAVE_BAYS {
        let bay = l.group(nave, format!("bay {}", k + 1), Place::at(vec3(k as f32 * BAY_M, 0.0, 0.0)));
        both_sides(l, bay, m, Joint::of(k));
        l.leaf(bay, "vault", m.nave_vault, here);
        l.leaf(bay, "roof", m.nave_roof, here);
        if (1..NAVE_BAYS - 1).contains(&k) {
            l.leaf(bay, "pews", m.pews, here);
        }
        if k % 2 == 1 {
            l.leaf(bay, "chandelier", m.chandelier, Place::at(vec3(BAY_M / 2.0, 0.0, 0.0)));
        }
    }
}

fn crossing(l: &mut Lodge, cathedral: NodeId, m: &Members) {
    let crossing = l.group(cathedral, "crossing", Place::at(vec3(CROSSING_M[0], 0.0, 0.0)));
    let here = Place::at(Vec3::ZERO);
    l.leaf(crossing, "floor", m.crossing_floor, here);
    // As wide as the vaults on all four sides, which arches part from it.
    let vault = vec3(2.0 * VAULT_HALF_M / BAY_M, 1.0, 1.0);
    l.leaf(crossing, "vault", m.nave_vault, Place::at(vec3(BAY_M - VAULT_HALF_M, 0.0, 0.0)).scaled(vault));
    for side in 0..4 {
        let out = [Vec3::Z, Vec3::X, -Vec3::Z, -Vec3::X][side] * BAY_M;
        l.leaf(crossing, "arch", m.great_arch, Place::turned(vec3(BAY_M, 0.0, 0.0) + out, side));
    }
    l.leaf(crossing, "roof", m.nave_roof, here.scaled(vec3(2.0, 1.0, 1.0)));
    l.leaf(crossing, "fleche", m.fleche, Place::at(vec3(BAY_M, RIDGE_M - 3.0, 0.0)));
    l.leaf(crossing, "altar", m.altar, Place::at(vec3(BAY_M + 3.0, 0.0, 0.0)));
    for (k, (x, z)) in [(0.0, -BAY_M), (0.0, BAY_M), (2.0 * BAY_M, BAY_M), (2.0 * BAY_M, -BAY_M)].into_iter().enumerate() {
        // Thick, and with the shafts towards the crossing.
        let place = Place::facing(vec3(x, 0.0, z), diagonal(k), Vec3::Y).scaled(vec3(1.35, 1.0, 1.35));
        l.leaf(crossing, "great pier", m.pier, place);
        // Four walls end in this corner.
        l.leaf(crossing, "corner", m.corner, Place::at(vec3(x, 0.0, z)));
    }
}

/// +X of a frame whose +Z looks from corner `k` into the crossing.
fn diagonal(k: usize) -> Vec3 {
    let (x, z) = [(1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)][k];
    vec3(x, 0.0, z) * 0.5f32.sqrt()
}

fn transept(l: &mut Lodge, cathedral: NodeId, m: &Members) {
    let transept = l.group(cathedral, "transept", Place::at(vec3(CROSSING_M[0] + BAY_M, 0.0, 0.0)));
    for (name, quarters) in [("north arm", 1), ("south arm", 3)] {
        // The arm runs along its own +X from the crossing's middle.
        let arm = l.group(transept, name, Place::turned(Vec3::ZERO, quarters));
        let here = Place::at(Vec3::ZERO);
        l.leaf(arm, "crossing roof", m.nave_roof, here);
        l.leaf(arm, "floor", m.transept_floor, Place::at(vec3(BAY_M, 0.0, 0.0)));
        for k in 0..TRANSEPT_BAYS {
            let bay = l.group(arm, format!("bay {}", k + 1), Place::at(vec3(BAY_M * (k + 1) as f32, 0.0, 0.0)));
            l.leaf(bay, "vault", m.nave_vault, here);
            l.leaf(bay, "roof", m.nave_roof, here);
            for (name, place) in
                [("left side", Place::at(vec3(0.0, 0.0, -BAY_M))), ("right side", Place::turned(vec3(BAY_M, 0.0, BAY_M), 2))]
            {
                let side = l.group(bay, name, place);
                elevation(l, side, m, here);
                if k > 0 {
                    // The wall of an aisle without an aisle.
                    l.leaf(side, "wall", m.aisle_wall, Place::at(vec3(0.0, 0.0, BAY_M - 1.3)));
                    let joint = if name == "left side" { 0.0 } else { BAY_M };
                    l.leaf(side, "pier", m.pier, Place::at(vec3(joint, 0.0, 0.0)));
                }
            }
        }
        let end = BAY_M * (TRANSEPT_BAYS + 1) as f32;
        l.leaf(arm, "front", m.transept_front, Place::turned(vec3(end, 0.0, 0.0), 1));
    }
}

fn straight_choir(l: &mut Lodge, cathedral: NodeId, m: &Members) {
    let choir = l.group(cathedral, "choir", Place::at(vec3(CROSSING_M[1], 0.0, 0.0)));
    let here = Place::at(Vec3::ZERO);
    for k in 0..CHOIR_BAYS {
        let bay = l.group(choir, format!("bay {}", k + 1), Place::at(vec3(k as f32 * BAY_M, 0.0, 0.0)));
        both_sides(l, bay, m, Joint::of(k));
        l.leaf(bay, "vault", m.nave_vault, here);
        l.leaf(bay, "roof", m.nave_roof, here);
        l.leaf(bay, "floor", m.choir_floor, here);
        if k + 1 < CHOIR_BAYS {
            l.leaf(bay, "stalls", m.stalls, here);
        }
    }
}

fn apse(l: &mut Lodge, cathedral: NodeId, m: &Members) {
    let apse = l.group(cathedral, "apse", Place::at(vec3(APSE_M, 0.0, 0.0)));
    l.leaf(apse, "high altar", m.altar, Place::at(vec3(-1.0, 0.0, 0.0)));
    for k in 0..WEDGES {
        let wedge = l.group(apse, format!("wedge {}", k + 1), Place::at(Vec3::ZERO));
        let corner = outwards(2 * k);
        let middle = 2 * k + 1;
        let inner = facing_in(corner * BAY_M, middle).scaled(vec3(chord_scale(BAY_M), 1.0, 1.0));
        elevation(l, wedge, m, inner);
        l.leaf(wedge, "pier", m.pier, facing_in(corner * BAY_M, 2 * k));
        let ambulatory = l.group(wedge, "ambulatory", Place::at(Vec3::ZERO));
        // The mesh of the wall lies seven metres behind its origin.
        let outer = corner * (2.0 * BAY_M) - outwards(middle) * BAY_M;
        let place = facing_in(outer, middle).scaled(vec3(chord_scale(2.0 * BAY_M), 1.0, 1.0));
        l.leaf(ambulatory, "wall", m.aisle_wall, place);
        let here = facing_in(Vec3::ZERO, middle);
        l.leaf(ambulatory, "vault", m.ambulatory_vault, here);
        l.leaf(ambulatory, "roof", m.ambulatory_roof, here);
        l.leaf(wedge, "vault", m.apse_vault, here);
        l.leaf(wedge, "roof", m.apse_roof, here);
        l.leaf(wedge, "floor", m.apse_floor, here);
    }
    for k in 0..=WEDGES {
        let place = facing_in(outwards(2 * k) * BAY_M, 2 * k);
        l.leaf(apse, "buttress", m.buttress, place);
        // Within the walls, which part at the back where they turn.
        l.leaf(apse, "corner", m.corner, place.scaled(vec3(0.6, 0.99, 0.6)));
    }
    l.leaf(apse, "arch", m.great_arch, Place::turned(Vec3::ZERO, 1));
    l.leaf(apse, "pier", m.pier, facing_in(outwards(2 * WEDGES) * BAY_M, 2 * WEDGES));
}

fn west(l: &mut Lodge, cathedral: NodeId, m: &Members) {
    let west = l.group(cathedral, "west front", Place::at(Vec3::ZERO));
    l.leaf(west, "front", m.west_front, Place::turned(vec3(WEST_M, 0.0, 0.0), 3));
    let narthex = Place::at(vec3(WEST_M, 0.0, 0.0));
    l.leaf(west, "vault", m.nave_vault, narthex.scaled(vec3(-WEST_M / BAY_M, 1.0, 1.0)));
    l.leaf(west, "roof", m.nave_roof, narthex.scaled(vec3(-WEST_M / BAY_M, 1.0, 1.0)));
    for (name, side) in [("north tower", -1.0), ("south tower", 1.0)] {
        let place = Place::at(vec3(-HALF_M, 0.0, side * TOWERS_M));
        let tower = l.group(west, name, place);
        for storey in 0..3 {
            let mesh = if storey == 2 { m.belfry } else { m.tower_storey };
            let name = if storey == 2 { "belfry".into() } else { format!("storey {}", storey + 1) };
            l.leaf(tower, &name, mesh, Place::at(vec3(0.0, STOREY_M * storey as f32, 0.0)));
        }
        l.leaf(tower, "spire", m.spire, Place::at(vec3(0.0, 3.0 * STOREY_M, 0.0)));
    }
}
