//! The oracle against another way to the same answer: clipping.
//!
//! A view's space has no end and a box has, so that where they meet the box's surface is met: a box meets the view when
//! something of a face is left after clipping with the frustum's planes (Sutherland and Hodgman 1974).

use glam::{DAffine3, DMat3, DQuat, DVec3};
use mullion_common::geometry::{Aabb, Containment, Frustum, Obb};
use mullion_common::scene::{ObjectHierarchy, OhNode};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_server::cull::oracle;
use proptest::prelude::*;

/// Whether something of the box is left inside planes that stand `out_m` further out.
fn remains(frustum: &Frustum, obb: &Obb, out_m: f64) -> bool {
    let center = obb.center - frustum.eye;
    let face = |axis: usize, side: f64| {
        let [n, a, b] = [0, 1, 2].map(|k| obb.half_axes[(axis + k) % 3]);
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| center + n * side + a * x + b * y)
    };
    (0..3).flat_map(|axis| [face(axis, -1.0), face(axis, 1.0)]).any(|face| {
        let mut polygon = face.to_vec();
        for plane in &frustum.planes {
            let distance_m = |p: DVec3| plane.normal.dot(p) + plane.distance_m(frustum.eye) + out_m;
            let mut next = Vec::new();
            for (i, a) in polygon.iter().enumerate() {
                let b = polygon[(i + 1) % polygon.len()];
                let (da, db) = (distance_m(*a), distance_m(b));
                if da >= 0.0 {
                    next.push(*a);
                }
                if (da >= 0.0) != (db >= 0.0) {
                    next.push(*a + (b - *a) * (da / (da - db)));
                }
            }
            polygon = next;
        }
        !polygon.is_empty()
    })
}

/// Clipping and the oracle agree, or both say so only by rounding.
fn agree(frustum: &Frustum, obb: &Obb) -> Result<(), String> {
    let found = oracle::intersects(frustum, obb);
    let reach_m = (obb.center - frustum.eye).length() + obb.half_axes.iter().map(|h| h.length()).sum::<f64>();
    let rounding_m = 1e-12 * reach_m + 1e-15 * frustum.eye.length();
    let is_doubtful = remains(frustum, obb, rounding_m) && !remains(frustum, obb, -rounding_m);
    if is_doubtful || found == remains(frustum, obb, 0.0) {
        Ok(())
    } else {
        Err(format!("the oracle says {found} of {obb:?} in {frustum:?}"))
    }
}

/// An off-axis view through a 1 × 2 tile, wherever the room stands.
fn view(eye: DVec3, near_m: f64, world_from_room: &DAffine3) -> Frustum {
    let corners = [DVec3::new(-0.3, -1.5, -2.0), DVec3::new(0.7, -1.5, -2.0), DVec3::new(-0.3, 0.5, -2.0)];
    Frustum::through_rectangle(eye, corners, near_m).transformed(world_from_room)
}

fn point(size: f64) -> impl Strategy<Value = DVec3> {
    (-size..size, -size..size, -size..size).prop_map(DVec3::from)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, ..ProptestConfig::default() })]
    #[test]
    fn the_oracle_agrees_with_clipping(
        eye in (-6.0..6.0f64, -6.0..6.0f64, -1.5..4.0f64),
        near_m in prop_oneof![Just(0.05), 0.1..0.4f64],
        turn in point(3.0),
        // The room's size and where it stands.
        (size, away) in prop_oneof![Just((1.0, 0.0)), Just((1e-3, 0.0)), Just((1e3, 1e6)), Just((1.0, 1e6)), Just((1e6, 0.0))],
        // A box in the room: 1 × 2 × 3 sheared, flat or a stick, anywhere or close to an edge of the view.
        center in prop_oneof![point(8.0), point(3.0)],
        is_at_edge in any::<bool>(),
        along in -0.2..4.0f64,
        lengths in prop_oneof![Just(DVec3::ZERO), (0.01..0.9f64).prop_map(|s| DVec3::new(1.0, 2.0, 3.0) * s)],
        flat in 0..8u8,
        shear in (point(0.6), point(0.6), point(0.6)),
        box_turn in point(3.0),
    ) {
        let turned = DAffine3::from_scale_rotation_translation(DVec3::splat(size), DQuat::from_scaled_axis(turn), DVec3::new(1.0, -0.7, 0.4) * away);
        let in_room = view(DVec3::from(eye), near_m, &DAffine3::IDENTITY);
        let center = if is_at_edge { in_room.eye + in_room.rays[2] * along + center * 0.3 } else { center };
        let keep = |bit: u8, length: f64| if flat & bit == 0 { length } else { 0.0 };
        let half = DVec3::new(keep(1, lengths.x), keep(2, lengths.y), keep(4, lengths.z)) * 0.5;
        let sheared = DMat3::from_quat(DQuat::from_scaled_axis(box_turn))
            * (DMat3::IDENTITY + DMat3::from_cols(shear.0, shear.1, shear.2));
        let local = Obb::from(Aabb { min: -half, max: half });
        let in_room_box = local.transformed(&DAffine3 { matrix3: sheared, translation: center });
        prop_assert_eq!(agree(&in_room.transformed(&turned), &in_room_box.transformed(&turned)), Ok(()));
    }
}

/// A stick along a ray, one along a side of the near rectangle, a sheet in a plane of the frustum: axes that are parallel, or
/// almost.
#[test]
fn parallel_edges_part_nothing_wrongly() {
    let frustum = view(DVec3::new(2.0, 0.4, 0.3), 0.05, &DAffine3::IDENTITY);
    let [ray, next] = [frustum.rays[1], frustum.rays[2]];
    let out = -frustum.planes[1].normal;
    for (tilt, distance) in [0.0, 1e-15, 1e-12, 1e-8].into_iter().flat_map(|tilt| [0.1, 1.0, 1e6].map(|d| (tilt, d))) {
        for (gap, is_seen) in [(1e-3, false), (-1e-3, true)] {
            let center = frustum.eye + (ray + next) * 0.5 * distance + out * gap * distance;
            let along = (ray + DVec3::new(0.3, -0.7, 0.2) * tilt) * distance * 0.2;
            let stick = Obb { center, half_axes: [along, DVec3::ZERO, DVec3::ZERO] };
            let sheet = Obb { center, half_axes: [along, DVec3::ZERO, (next - ray) * distance * 0.1] };
            for obb in [stick, sheet] {
                assert_eq!(oracle::intersects(&frustum, &obb), is_seen, "{tilt} {distance} {gap}");
                assert_eq!(agree(&frustum, &obb), Ok(()));
            }
        }
    }
}

/// What the plane tests cannot tell: a box beyond an edge of the frustum, outside no single plane.
#[test]
fn a_box_beyond_an_edge_is_not_seen() {
    let frustum = view(DVec3::new(0.2, -0.5, 0.0), 0.05, &DAffine3::IDENTITY);
    let beyond = frustum.rays[2] * 3.0 + DVec3::new(0.35, 0.35, 0.0);
    let diagonal = DVec3::new(1.0, -1.0, 0.0);
    let obb = Obb { center: frustum.eye + beyond, half_axes: [diagonal, DVec3::new(0.1, 0.1, 0.0), DVec3::Z * 0.2] };
    assert_eq!(frustum.classify(&obb), Containment::Cut);
    assert!(!oracle::intersects(&frustum, &obb));
    let around_eye = Obb { center: frustum.eye, half_axes: [DVec3::X, DVec3::Y * 2.0, DVec3::Z * 3.0] };
    assert!(oracle::intersects(&frustum, &around_eye));
    let behind = Obb { center: frustum.eye + DVec3::Z * 3.1, ..around_eye };
    assert!(!oracle::intersects(&frustum, &behind));
}

#[test]
fn leaves_are_found_whatever_encloses_them() {
    let frustum = view(DVec3::ZERO, 0.05, &DAffine3::IDENTITY);
    let at = |z: f64, subtree_end, start, end| {
        let bound = Obb::of_point(DVec3::new(0.0, 0.0, z));
        OhNode { bound, subtree_end, leaves: LeafRange::new(start, end) }
    };
    // The root's bound is wrong: it lies behind the eye.
    let nodes = vec![at(5.0, 4, 0, 3), at(-3.0, 2, 0, 1), at(4.0, 3, 1, 2), at(-9.0, 4, 2, 3)];
    let mut set = VisibleSet::default();
    oracle::visible_leaves(&ObjectHierarchy::new(nodes).expect("a tree"), &frustum, &mut set);
    assert_eq!(set.leaves().collect::<Vec<_>>(), [0, 2]);
}

/// A doll's house a thousand kilometres from the origin: what touches a side of a view close to the eye, by less than what
/// coordinates round there, is not outside any plane.
#[test]
fn planes_far_from_the_origin_part_nothing_wrongly() {
    let far = DVec3::new(1.0, -0.6, 0.3) * 1e6;
    let mut seen = 0;
    for i in 0..2000 {
        let turn = DQuat::from_scaled_axis(DVec3::new(f64::from(i) * 0.01, 1.3, -0.4));
        let room = DAffine3::from_scale_rotation_translation(DVec3::splat(2e-5), turn, far);
        let frustum = view(DVec3::new(0.3, 0.2, 0.5), 0.05, &room);
        let share = f64::from(i % 7) / 6.0;
        for side in 0..4 {
            let along = frustum.rays[side] * share + frustum.rays[(side + 1) % 4] * (1.0 - share);
            let point = Obb::of_point(frustum.eye + along);
            if oracle::intersects(&frustum, &point) {
                seen += 1;
                assert_ne!(frustum.classify(&point), Containment::Outside, "{i} {side}");
            }
        }
    }
    assert!(seen > 1000, "{seen}");
}
