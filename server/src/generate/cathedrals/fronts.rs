//! The fronts of the west and of the transept: portal, gallery, rose, gable. Drawn about x = 0, outwards to +Z.
use super::bay::{RIDGE_M, WALL_M};
use super::{Lodge, Work};
use crate::generate::glb_writer::MeshId;
use crate::generate::gothic::{Opening, Pointed, Stones, Wall, hoop, pinnacle, roll};
use crate::generate::solid::{Color, Geometry, ring};
use glam::{Vec2, Vec3, vec2, vec3};

/// Where the portal's storey and the gallery end.
const PORTAL_M: f32 = 11.0;
const GALLERY_M: f32 = 14.6;
/// The wall's faces.
const FRONT_M: f32 = 0.8;

/// How large a front is.
pub struct Front {
    pub half_m: f32,
    pub rose_m: f32,
    /// Width of the door, and arches around it.
    pub door_m: f32,
    pub orders: usize,
}

pub fn build(lodge: &mut Lodge, name: &str, front: &Front) -> MeshId {
    lodge.mesh(name, |w| {
        portal(w, front);
        gallery(w, front);
        rose(w, front);
        gable(w, front);
    })
}

fn storey(front: &Front, low: f32, high: f32) -> Wall {
    Wall { low: vec2(-front.half_m, low), high: vec2(front.half_m, high), front: FRONT_M, back: -FRONT_M, stone: vec2(1.8, 1.1) }
}

fn portal(w: &mut Work, front: &Front) {
    let (trim, dark) = (w.palette.trim, w.palette.dark);
    let arch = Pointed::equilateral(front.door_m);
    let door = Opening { middle: 0.0, sill: 0.0, spring: 4.0, arch, pieces: 10 };
    storey(front, 0.0, PORTAL_M).pierced(&mut w.stone, &door, &mut w.stones, dark);
    // Both leaves are shut, a tympanum over them.
    let half = front.door_m / 2.0 + 0.05;
    w.stone.cuboid(vec3(-half, 0.0, -0.25), vec3(-0.02, 4.1, -0.1), w.palette.wood[0]);
    w.stone.cuboid(vec3(0.02, 0.0, -0.25), vec3(half, 4.1, -0.1), w.palette.wood[1]);
    w.stone.cuboid(vec3(-0.15, 0.0, -0.35), vec3(0.15, 4.3, 0.05), trim);
    w.stone.cuboid(vec3(-half, 4.0, -0.3), vec3(half, 4.4, 0.1), trim);
    let outline = arch.grown(0.05).outline(10);
    for (z, is_front) in [(-0.05, true), (-0.2, false)] {
        for pair in outline.windows(2) {
            let at = |p: Vec2| vec3(p.x, 4.0 + p.y, z);
            let foot = |p: Vec2| vec3(p.x, 4.0, z);
            let corners = [foot(pair[0]), foot(pair[1]), at(pair[1]), at(pair[0])];
            match is_front {
                true => w.stone.polygon(&corners, w.stones.next()),
                false => w.stone.polygon(&[corners[1], corners[0], corners[3], corners[2]], w.stones.next()),
            }
        }
    }
    for x in [-0.7, 0.0, 0.7] {
        figure(&mut w.stone, vec3(x * front.door_m * 0.35, 4.45, 0.05), if x == 0.0 { 1.7 } else { 1.1 }, trim);
    }
    for order in 0..front.orders {
        let (grown, z) = (0.2 + 0.34 * order as f32, FRONT_M + 0.1 + 0.12 * order as f32);
        let arch = door.grown(grown);
        roll(&mut w.stone, &Opening { sill: 4.0, ..arch }, z, 0.17, 4, if order % 2 == 0 { trim } else { dark });
        for side in [-1.0, 1.0] {
            let x = side * arch.arch.width / 2.0;
            let column = [(0.24, 0.0), (0.15, 0.3), (0.15, 3.3), (0.24, 3.7), (0.24, 4.05), (0.0, 4.05)];
            w.stone.lathe(vec3(x, 0.0, z), &column, 8, trim);
            figure(&mut w.stone, vec3(x, 1.0, z + 0.2), 2.0, trim);
        }
        // Small figures sit along the arch.
        let head = arch.arch.outline(8);
        for p in head.iter().skip(1).step_by(2) {
            figure(&mut w.stone, vec3(p.x, 4.0 + p.y - 0.15, z + 0.12), 0.5, trim);
        }
    }
    for k in 0..4 {
        let (reach, top) = (0.4 * k as f32, -0.12 * k as f32);
        let half = front.half_m - 0.2;
        w.stone.cuboid(vec3(-half, -2.0, FRONT_M - 0.1), vec3(half, top - 0.02, FRONT_M + 1.2 + reach), w.stones.next());
    }
}

/// A saint: a robe, shoulders, a head and a halo.
fn figure(g: &mut Geometry, foot: Vec3, height: f32, color: Color) {
    let robe = [(0.16, 0.0), (0.11, 0.45), (0.14, 0.77), (0.05, 0.84), (0.07, 0.92), (0.0, 1.0)];
    g.lathe(foot, &robe.map(|(r, y)| (r * height * 0.8, y * height)), 6, color);
}

/// A row of blind arches with a king in each.
fn gallery(w: &mut Work, front: &Front) {
    let trim = w.palette.trim;
    storey(front, PORTAL_M, GALLERY_M).closed(&mut w.stone, &mut w.stones);
    let count = front.half_m as usize;
    let width = 2.0 * front.half_m / count as f32;
    for k in 0..count {
        let middle = -front.half_m + width * (k as f32 + 0.5);
        let arch = Pointed::equilateral(width * 0.75);
        let blind = Opening { middle, sill: PORTAL_M + 0.3, spring: PORTAL_M + 1.9, arch, pieces: 4 };
        for z in [FRONT_M + 0.12, -FRONT_M - 0.05] {
            roll(&mut w.stone, &blind, z, 0.1, 4, trim);
        }
        figure(&mut w.stone, vec3(middle, PORTAL_M + 0.3, FRONT_M + 0.2), 2.2, trim);
    }
    for y in [PORTAL_M, GALLERY_M] {
        w.stone.cuboid(vec3(-front.half_m, y - 0.15, -FRONT_M - 0.15), vec3(front.half_m, y + 0.15, FRONT_M + 0.35), trim);
    }
}

/// Twelve petals about a hub, twenty-four small rings at the rim, glass in rings of panes.
fn rose(w: &mut Work, front: &Front) {
    let trim = w.palette.trim;
    let (middle, radius) = (vec2(0.0, (GALLERY_M + WALL_M) / 2.0 - 0.2), front.rose_m);
    storey(front, GALLERY_M, WALL_M).holed(&mut w.stone, middle, radius, 48, &mut w.stones, w.palette.dark);
    let center = middle.extend(0.0);
    let bar = 0.028 * radius;
    for (share, thickness) in [(1.0, 2.5), (0.8, 1.2), (0.22, 1.6)] {
        hoop(&mut w.stone, center, radius * share, bar * thickness, [48, 4], trim);
    }
    for z in [FRONT_M, -FRONT_M] {
        hoop(&mut w.stone, middle.extend(z), radius + 0.2, 0.16, [48, 4], trim);
    }
    for (k, spoke) in ring(24).into_iter().enumerate() {
        let out = spoke.extend(0.0) * radius;
        if k % 2 == 0 {
            w.stone.tube(&[center + out * 0.22, center + out * 0.6], bar, 6, trim);
            hoop(&mut w.stone, center + out * 0.665, 0.11 * radius, bar * 0.9, [8, 4], trim);
        } else {
            w.stone.tube(&[center + out * 0.55, center + out * 0.8], bar, 6, trim);
        }
        hoop(&mut w.stone, center + out * 0.9, 0.085 * radius, bar * 0.8, [8, 4], trim);
    }
    disc(&mut w.glass, middle.extend(0.0), radius + 0.06, &mut w.panes);
}

/// Rings of panes; the sheet is seen from both sides.
fn disc(g: &mut Geometry, middle: Vec3, radius: f32, panes: &mut Stones) {
    let ring = ring(48);
    let shares = [0.0, 0.1, 0.22, 0.34, 0.46, 0.58, 0.69, 0.8, 0.9, 1.0];
    for band in shares.windows(2) {
        for k in 0..48 {
            let at = |share: f32, k: usize| middle + (ring[k % 48] * radius * share).extend(0.0);
            let color = panes.next();
            match band[0] == 0.0 {
                true => g.polygon(&[middle, at(band[1], k), at(band[1], k + 1)], color),
                false => g.polygon(&[at(band[0], k), at(band[1], k), at(band[1], k + 1), at(band[0], k + 1)], color),
            }
        }
    }
}

/// The gable before the roof, with crockets and a small rose, turrets at both corners.
fn gable(w: &mut Work, front: &Front) {
    let (trim, stone) = (w.palette.trim, w.palette.stone[0]);
    let (half, peak) = (front.half_m + 0.6, RIDGE_M + 2.2);
    let rows = 12;
    let at = |row: usize, side: f32, z: f32| {
        let share = row as f32 / rows as f32;
        vec3(side * half * (1.0 - share), WALL_M + (peak - WALL_M) * share, z)
    };
    for row in 0..rows {
        for (z, side) in [(FRONT_M - 0.1, 1.0), (-FRONT_M, -1.0)] {
            let corners = [at(row, -side, z), at(row, side, z), at(row + 1, side, z), at(row + 1, -side, z)];
            let count = if row + 1 == rows { 3 } else { 4 };
            w.stone.polygon(&corners[..count], w.stones.next());
        }
    }
    for side in [-1.0, 1.0] {
        let (low, high) = (at(0, side, 0.0), at(rows, side, 0.0));
        w.stone.bar(low, high + Vec3::Y * 0.3, [2.0 * FRONT_M + 0.4, 0.4], trim);
        for k in 1..12 {
            let foot = low.lerp(high, k as f32 / 12.0) + vec3(side * 0.2, 0.25, 0.0);
            w.stone.tube(&[foot, foot + vec3(side * 0.15, 0.35, 0.0), foot + vec3(side * 0.4, 0.5, 0.0)], 0.16, 6, trim);
        }
        pinnacle(&mut w.stone, vec3(side * (front.half_m + 0.4), WALL_M - 6.0, 0.0), 1.3, 15.0, 5, [stone, trim]);
        w.stone.lathe(
            vec3(side * (front.half_m + 0.4), -0.3, 0.0),
            &[(1.5, 0.0), (1.5, 1.4), (1.3, 1.8), (1.3, WALL_M - 5.7)],
            8,
            stone,
        );
    }
    let middle = vec3(0.0, WALL_M + 3.2, FRONT_M);
    hoop(&mut w.stone, middle, 1.5, 0.16, [32, 6], trim);
    for foil in ring(6) {
        hoop(&mut w.stone, middle + foil.extend(0.0) * 0.85, 0.42, 0.1, [12, 4], trim);
    }
    w.stone.cuboid(vec3(-half, WALL_M - 0.2, -FRONT_M - 0.1), vec3(half, WALL_M + 0.2, FRONT_M + 0.3), trim);
}
