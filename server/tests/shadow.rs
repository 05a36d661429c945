//! Shadows hide what no ray from the eye reaches, and nothing else; walking both hierarchies finds what testing each
//! leaf against each shadow finds.

use glam::{DAffine3, DQuat, DVec3};
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{ObjectHierarchy, OhNode};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_server::cull::shadow::{MAX_OCCLUDERS, Occluder, ShadowError, Shadows};
use proptest::prelude::*;

/// By how much the way from the eye to a point is inside the occluder, and behind it: positive where the occluder blocks it. In
/// shares of the occluder's edges and of the way. Solved as a ray and a parallelogram, without any frustum.
fn depth_of_block(occluder: &Occluder, eye: DVec3, point: DVec3) -> f64 {
    let [corner, a, b] = occluder.corners;
    let (a, b, way) = (a - corner, b - corner, point - eye);
    // corner + u a + v b = eye + t way
    let determinant = a.cross(b).dot(way);
    if determinant.abs() < 1e-12 {
        return -1.0;
    }
    let from_corner = eye - corner;
    let u = from_corner.cross(b).dot(way) / determinant;
    let v = a.cross(from_corner).dot(way) / determinant;
    let t = -a.cross(b).dot(from_corner) / determinant;
    [u, 1.0 - u, v, 1.0 - v, t, 1.0 - t].into_iter().fold(f64::INFINITY, f64::min)
}

/// The least of [`depth_of_block`] over a box's corners, which is the least over the box.
fn depth_in_shadow(occluder: &Occluder, eye: DVec3, bound: &Obb) -> f64 {
    bound.corners().into_iter().map(|corner| depth_of_block(occluder, eye, corner)).fold(f64::INFINITY, f64::min)
}

/// A hierarchy over boxes: halved again and again.
fn hierarchy(boxes: &mut [Obb]) -> ObjectHierarchy {
    fn add(nodes: &mut Vec<OhNode>, leaves: &mut u32, boxes: &mut [Obb]) {
        let at = nodes.len();
        let bound = Obb::around(boxes.iter().flat_map(Obb::corners)).expect("boxes");
        nodes.push(OhNode { bound, subtree_end: 0, leaves: LeafRange::new(*leaves, 0) });
        if let [only] = boxes {
            nodes[at].bound = *only;
            *leaves += 1;
        } else {
            let axis = Aabb::of_points(boxes.iter().map(|b| b.center)).size().max_position();
            boxes.sort_by(|a, b| a.center[axis].total_cmp(&b.center[axis]));
            let (low, high) = boxes.split_at_mut(boxes.len() / 2);
            add(nodes, leaves, low);
            add(nodes, leaves, high);
        }
        nodes[at].subtree_end = nodes.len() as u32;
        nodes[at].leaves.end = *leaves;
    }
    let mut nodes = Vec::new();
    add(&mut nodes, &mut 0, boxes);
    ObjectHierarchy::new(nodes).expect("a tree")
}

fn point(size: f64) -> impl Strategy<Value = DVec3> {
    (-size..size, -size..size, -size..size).prop_map(DVec3::from)
}

/// A 1 × 2 sheet, of any size, turned and sheared.
fn occluder() -> impl Strategy<Value = Occluder> {
    (point(8.0), point(3.0), 0.3..5.0f64, -0.3..0.3f64).prop_map(|(at, turn, size, shear)| {
        let turn = DQuat::from_scaled_axis(turn);
        let edges = [turn * DVec3::new(size, shear * size, 0.0), turn * DVec3::new(0.0, size * 2.0, 0.0)];
        Occluder { corners: [at, at + edges[0], at + edges[1]] }
    })
}

fn sheared_box() -> impl Strategy<Value = Obb> {
    let lengths = prop_oneof![Just(0.0), 0.01..0.4f64];
    (point(25.0), point(3.0), lengths, point(0.2)).prop_map(|(at, turn, length, shear)| {
        let half = DVec3::new(1.0, 2.0, 3.0) * length * 0.5;
        let turned = Obb::from(Aabb { min: -half, max: half })
            .transformed(&DAffine3::from_rotation_translation(DQuat::from_scaled_axis(turn), at));
        Obb { half_axes: turned.half_axes.map(|h| h + shear * length), ..turned }
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]
    #[test]
    fn what_is_hidden_is_blocked_and_what_is_blocked_is_hidden(
        occluders in proptest::collection::vec(occluder(), 1..40),
        mut boxes in proptest::collection::vec(sheared_box(), 1..200),
        eye in point(3.0),
        at in point(1.0),
        far in prop_oneof![Just(0.0), Just(1e5)],
    ) {
        let far = DVec3::new(1.0, 2.0, -3.0) * far;
        let eye = eye + far;
        let moved = |c: DVec3| c + far;
        let occluders: Vec<_> = occluders.iter().map(|o| Occluder { corners: o.corners.map(moved) }).collect();
        boxes.iter_mut().for_each(|b| b.center += far);
        let scene = hierarchy(&mut boxes);
        let mut hidden = VisibleSet::default();
        Shadows::new(eye, &occluders).expect("occluders").hide(&scene, &mut hidden);
        for (leaf, bound) in (0..).zip(&boxes) {
            let deepest = occluders.iter().map(|o| depth_in_shadow(o, eye, bound)).fold(f64::NEG_INFINITY, f64::max);
            if hidden.contains(leaf) {
                prop_assert!(deepest > 0.0, "leaf {leaf} is hidden {deepest} deep: {bound:?}");
                let [x, y, z] = bound.half_axes;
                let inside = bound.center + x * at.x + y * at.y + z * at.z;
                prop_assert!(occluders.iter().any(|o| depth_of_block(o, eye, inside) > 0.0));
            } else {
                // Nothing but rounding keeps a leaf in the light.
                prop_assert!(deepest < 1e-3, "leaf {leaf} is not hidden, {deepest} deep: {bound:?}");
            }
        }
    }
}

/// 64 occluders side by side before 4096 boxes: a node meets few of them.
#[test]
fn many_shadows_cost_little_more_than_a_few() {
    let sheet = |column: u32, row: u32| {
        let corner = DVec3::new(f64::from(column) - 4.0, f64::from(row) * 0.6 - 2.4, -3.0);
        Occluder { corners: [corner, corner + DVec3::X * 0.9, corner + DVec3::Y * 0.5] }
    };
    let mut boxes: Vec<Obb> = (0..4096)
        .map(|i| {
            let [x, y, z] = [i % 16, i / 16 % 16, i / 256].map(f64::from);
            let center = DVec3::new(x * 2.0 - 15.0, y * 1.2 - 9.0, -4.0 - z);
            Obb::from(Aabb { min: center - 0.1, max: center + DVec3::new(0.1, 0.2, 0.3) })
        })
        .collect();
    let scene = hierarchy(&mut boxes);
    let cost = |occluders: &[Occluder]| {
        let mut hidden = VisibleSet::default();
        let stats = Shadows::new(DVec3::new(0.3, 0.1, 0.0), occluders).expect("occluders").hide(&scene, &mut hidden);
        (stats, hidden.len())
    };
    let all: Vec<Occluder> = (0..8).flat_map(|row| (0..8).map(move |column| sheet(column, row))).collect();
    let ((few, _), (many, hidden)) = (cost(&all[..4]), cost(&all));
    assert!(hidden > 500, "{hidden}");
    let per_node = many.plane_tests as f64 / many.nodes_visited as f64;
    assert!(per_node < 16.0, "{per_node} tests a node for 64 shadows; {few:?}, {many:?}");
}

#[test]
fn an_occluder_hides_from_both_sides_and_nothing_before_it() {
    let corners = [DVec3::new(-2.0, -1.0, -3.0), DVec3::new(2.0, -1.0, -3.0), DVec3::new(-2.0, 1.0, -3.0)];
    let mut boxes = [-9.0, -2.0, -3.0, 5.0].map(|z| Obb::of_point(DVec3::new(0.1, 0.2, z)));
    let scene = hierarchy(&mut boxes);
    let from = |eye: DVec3, corners| {
        let mut hidden = VisibleSet::default();
        Shadows::new(eye, &[Occluder { corners }]).expect("an occluder").hide(&scene, &mut hidden);
        hidden.leaves().map(|leaf| boxes[leaf as usize].center.z).collect::<Vec<_>>()
    };
    assert_eq!(from(DVec3::ZERO, corners), [-9.0]);
    assert_eq!(from(DVec3::ZERO, [corners[0], corners[2], corners[1]]), [-9.0]);
    assert_eq!(from(DVec3::new(0.0, 0.0, -20.0), corners), [-2.0, 5.0]);
    assert_eq!(from(DVec3::new(9.0, 0.0, -3.0), corners), [0.0; 0], "seen edge on");
    assert_eq!(from(DVec3::ZERO, [corners[0]; 3]), [0.0; 0], "without area");
}

#[test]
fn wrong_occluders_are_told() {
    let occluder = Occluder { corners: [DVec3::ZERO, DVec3::X, DVec3::Y] };
    let too_many = vec![occluder; MAX_OCCLUDERS + 1];
    assert_eq!(Shadows::new(DVec3::Z, &too_many).err(), Some(ShadowError::TooMany { count: MAX_OCCLUDERS + 1 }));
    let broken = Occluder { corners: [DVec3::ZERO, DVec3::INFINITY, DVec3::Y] };
    let error = Shadows::new(DVec3::Z, &[occluder, broken]).err().expect("an error").to_string();
    assert_eq!(error, "occluder 1: corner [inf, inf, inf]: coordinates must be finite");
    let mut hidden = VisibleSet::all(3);
    let mut none = Shadows::new(DVec3::Z, &[]).expect("no occluders");
    none.hide(&hierarchy(&mut [Obb::of_point(DVec3::ZERO)]), &mut hidden);
    assert!(hidden.is_empty());
}
