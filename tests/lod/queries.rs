//! Goal: what occlusion queries answer of nodes is what their bounds, pixel by pixel, are. Method: a wall before half of the view, an object behind it,
//! before it and beside it; for each node's bounds every pixel's ray, through bounds as they are and a little larger.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec3};
use mullion_client::gpu::{Gpu, GpuOptions, QueryOccluder};
use mullion_client::lod::{BoundsKind, Cut, Hidden, LodObject, Occluder, Solid, StepId, Wait};
use mullion_common::scene::{Hierarchy, NodeBounds, VertexHierarchy, VertexId};
use mullion_common::wall::Projection;

use super::{meshes, seen_from_all_sides, vertices};

const SIZE_PX: [u32; 2] = [80, 60];
const EYE: DVec3 = DVec3::new(0.2, -0.1, 0.4);
/// Through which the eye looks, from its middle, 1 ahead.
const HALF: [f64; 2] = [0.9, 0.7];
/// Where the wall is.
const WALL_Z: f64 = -9.0;
const WALL_HALF: [f64; 2] = [6.0, 9.0];
const WALL_X: f64 = -5.5;

fn gpu() -> Option<Arc<Gpu>> {
    Gpu::open(GpuOptions::default()).inspect_err(|error| println!("skipped: {error}")).ok()
}

fn projection() -> Projection {
    let corner = |x: f64, y: f64| EYE + DVec3::new(x * HALF[0], y * HALF[1], -1.0);
    Projection::through_rectangle(EYE, [corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)], 0.05, &DAffine3::IDENTITY)
}

/// Ways through all pixels' middles, as far along as they are ahead.
fn rays() -> impl Iterator<Item = DVec3> {
    let [width, height] = SIZE_PX;
    let at = |pixel: u32, count: u32| (f64::from(pixel) + 0.5) / f64::from(count) * 2.0 - 1.0;
    let row = move |y: u32| (0..width).map(move |x| DVec3::new(at(x, width) * HALF[0], at(y, height) * HALF[1], -1.0));
    (0..height).flat_map(row)
}

/// How far ahead a ray meets the wall.
fn wall_ahead(ray: DVec3) -> f64 {
    let ahead = EYE.z - WALL_Z;
    let at = EYE + ray * ahead;
    let is_on_it = (at.x - WALL_X).abs() < WALL_HALF[0] && at.y.abs() < WALL_HALF[1];
    if is_on_it { ahead } else { f64::INFINITY }
}

/// Hills, pressed flat.
fn wall(hierarchy: &Hierarchy) -> LodObject<'_> {
    let [x, y] = WALL_HALF;
    let matrix3 = DMat3::from_diagonal(DVec3::new(x / 3.0, y / 2.0, 1e-4));
    let world_from_local = DAffine3 { matrix3, translation: DVec3::new(WALL_X, 0.0, WALL_Z) };
    LodObject { world_from_local, ..seen_from_all_sides(hierarchy) }
}

fn all_steps(hierarchy: &VertexHierarchy) -> Vec<StepId> {
    let splits = (hierarchy.base_count()..hierarchy.vertex_count()).map(StepId);
    splits.filter(|step| !hierarchy.is_follower(step.lead())).collect()
}

fn whole(hierarchy: &Hierarchy) -> Cut {
    let mut cut = Cut::new(hierarchy);
    if let Hierarchy::Vertices(of) = hierarchy {
        cut.follow(hierarchy, &all_steps(of), |_| true);
    }
    cut
}

/// How far ahead a ray enters what is within so much of all of these at once: distances from a middle across an axis, or along it.
fn enters(terms: &[(DVec3, DMat3, f64)], eye: DVec3, ray: DVec3) -> Option<f64> {
    let (mut first, mut last) = (0.0f64, f64::INFINITY);
    for (middle, part, reach) in terms {
        let (from, way) = (*part * (eye - *middle), *part * ray);
        let (a, b, c) = (way.length_squared(), from.dot(way), from.length_squared() - reach * reach);
        if a < 1e-18 {
            if c > 0.0 {
                return None;
            }
            continue;
        }
        let root = (b * b - a * c).sqrt();
        if root.is_nan() {
            return None;
        }
        (first, last) = (first.max((-b - root) / a), last.min((-b + root) / a));
    }
    (first <= last).then_some(first)
}

/// Of a vector the part along an axis.
fn along(axis: DVec3) -> DMat3 {
    DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z)
}

/// A node's bounds of a kind, for [`enters`], stretched and grown.
fn terms(
    kind: BoundsKind,
    NodeBounds { center, extent, .. }: &NodeBounds,
    stretched: f64,
    grown: f64,
) -> Vec<(DVec3, DMat3, f64)> {
    let center = center.as_dvec3();
    let reach = |length: f32| f64::from(length) * stretched + grown;
    match kind {
        BoundsKind::Sphere => vec![(center, DMat3::IDENTITY, reach(extent.radius))],
        BoundsKind::Box => {
            DVec3::AXES.iter().zip(extent.half_box.to_array()).map(|(axis, half)| (center, along(*axis), reach(half))).collect()
        }
        _ => {
            let axis = extent.axis.direction().as_dvec3();
            let (below, above) = (f64::from(extent.cylinder_below), f64::from(extent.cylinder_above));
            let middle = center + axis * ((above - below) / 2.0);
            let height = (below + above) / 2.0 * stretched + grown;
            vec![(center, DMat3::IDENTITY - along(axis), reach(extent.cylinder_radius)), (middle, along(axis), height)]
        }
    }
}

/// Asks about steps, and waits for all answers.
fn answers(occluder: &mut QueryOccluder, object: usize, hierarchy: &Hierarchy, steps: &[StepId]) -> Vec<Hidden> {
    let mut answers: Vec<Option<Hidden>> = steps.iter().map(|step| occluder.hides(object, hierarchy, *step)).collect();
    let mut open = answers.iter().filter(|answer| answer.is_none()).count();
    while open > 0 {
        let before = open;
        occluder.answer_late(Wait::ForSome, &mut |of, step, hidden| {
            assert_eq!(of, object);
            let at = steps.binary_search(&step).expect("it was asked");
            assert_eq!(answers[at].replace(hidden), None, "{step:?} is answered twice");
            open -= 1;
        });
        assert!(open < before, "it waits and gets none");
    }
    occluder.check().expect("a GPU that works");
    answers.into_iter().flatten().collect()
}

#[test]
fn queries_answer_as_every_pixel_does() {
    let Some(gpu) = gpu() else { return };
    let (object, wall_mesh) = (vertices(&meshes::torus(24, 16)), vertices(&meshes::hills(10, 8)));
    let Hierarchy::Vertices(hierarchy) = &object else { panic!("they are vertices") };
    let steps = all_steps(hierarchy);
    let turned = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(0.4);
    let mirrored = DMat3::from_diagonal(DVec3::new(-0.4, 0.6, 0.5));
    let places = [
        ("behind", turned * 0.5, DVec3::new(-5.0, 0.4, -14.0)),
        ("before", turned * 0.3, DVec3::new(-1.6, 0.3, -5.0)),
        ("beside", turned * 0.5, DVec3::new(4.0, 0.4, -14.0)),
        ("across its edge", turned, DVec3::new(0.7, -0.2, -15.0)),
        ("through it", mirrored * 2.0, DVec3::new(-3.0, 0.2, WALL_Z - 1.0)),
        ("mirrored, across its edge", turned * mirrored, DVec3::new(0.8, 0.2, -13.0)),
    ];
    let rays: Vec<DVec3> = rays().collect();
    let walls: Vec<f64> = rays.iter().map(|ray| wall_ahead(*ray)).collect();
    for kind in [BoundsKind::Sphere, BoundsKind::Box, BoundsKind::Cylinder] {
        let mut occluder = QueryOccluder::new(&gpu, SIZE_PX, kind).expect("an occluder");
        occluder.look(&projection());
        for (place, matrix3, translation) in places {
            let world_from_local = DAffine3 { matrix3, translation };
            // Seen through: it hides nothing of itself.
            let asked = LodObject { world_from_local, is_solid: false, ..seen_from_all_sides(&object) };
            let objects = [wall(&wall_mesh), asked];
            occluder.draw(&objects, &objects.map(|object| whole(object.hierarchy)));
            let found = answers(&mut occluder, 1, &object, &steps);
            let local_from_world = world_from_local.inverse();
            let eye = local_from_world.transform_point3(EYE);
            // More than the corners of a mesh around a sphere reach, and half a pixel, of an axis that is shortened most.
            let (stretched, grown) = (if kind == BoundsKind::Box { 1.0 } else { 1.13 }, 0.5 * 16.0 * 2.0 * HALF[0] / 80.0 / 0.3);
            let (mut hidden, mut seen) = (0, 0);
            for (step, found) in steps.iter().zip(&found) {
                let what = format!("{kind:?}, {place}, {step:?}");
                let bounds = hierarchy.bounds(step.lead());
                let shows = |terms: &[(DVec3, DMat3, f64)], nearer: f64| {
                    let mut pixels = rays.iter().zip(&walls);
                    pixels.any(|(ray, wall)| {
                        enters(terms, eye, local_from_world.transform_vector3(*ray)).is_some_and(|ahead| ahead * nearer < *wall)
                    })
                };
                match found {
                    Hidden::Nothing => {
                        assert!(shows(&terms(kind, &bounds, stretched, grown), 0.999), "{what}: no pixel shows it");
                        seen += 1;
                    }
                    Hidden::Node => {
                        assert!(!shows(&terms(kind, &bounds, 1.0, 0.0), 1.001), "{what}: a pixel shows it");
                        hidden += 1;
                    }
                    Hidden::Split => panic!("{what}: more than a split is asked about"),
                }
            }
            let all = (hidden == 0, seen == 0);
            let expected = match place {
                "behind" => (false, true),
                "before" | "beside" => (true, false),
                _ => (false, false),
            };
            assert_eq!(all, expected, "{kind:?}, {place}: {hidden} hidden, {seen} seen");
        }
    }
}

#[test]
fn what_was_asked_before_a_new_picture_has_no_answer() {
    let Some(gpu) = gpu() else { return };
    let (object, wall_mesh) = (vertices(&meshes::torus(24, 16)), vertices(&meshes::hills(10, 8)));
    let Hierarchy::Vertices(hierarchy) = &object else { panic!("they are vertices") };
    let steps = all_steps(hierarchy);
    let place = DAffine3::from_translation(DVec3::new(-6.0, 0.4, -16.0));
    let objects = [wall(&wall_mesh), LodObject { world_from_local: place, ..seen_from_all_sides(&object) }];
    let mut occluder = QueryOccluder::new(&gpu, SIZE_PX, BoundsKind::Link).expect("an occluder");
    occluder.look(&projection());
    assert_eq!(occluder.hides(1, &object, steps[0]), Some(Hidden::Nothing), "nothing is drawn");
    let cuts = objects.map(|object| whole(object.hierarchy));
    occluder.draw(&objects, &cuts);
    // More than a batch, and a part of one.
    assert!(steps[..100].iter().all(|step| occluder.hides(1, &object, *step).is_none()));
    occluder.draw(&objects, &cuts);
    occluder.answer_late(Wait::ForSome, &mut |_, step, _| panic!("{step:?} is of the last picture"));
    assert!(answers(&mut occluder, 1, &object, &steps).iter().all(|hidden| *hidden == Hidden::Split), "all of it is behind");
    // Without the wall its front is seen.
    let open = [LodObject { is_solid: false, ..objects[0] }, objects[1]];
    occluder.draw(&open, &cuts);
    let seen = answers(&mut occluder, 1, &object, &steps).iter().filter(|hidden| **hidden == Hidden::Nothing).count();
    assert!(seen * 4 > steps.len() && seen < steps.len(), "{seen} of {}", steps.len());
}

/// The box around a link holds all vertices of it.
#[test]
fn links_are_within_their_boxes() {
    for mesh in [meshes::torus(24, 16), meshes::seamed_tube(14, 16)] {
        let of = vertices(&mesh);
        for step in all_steps(&mesh.hierarchy) {
            let (Solid { middle, axes, half }, hidden) = Solid::of(BoundsKind::Link, &of, step);
            assert_eq!(hidden, Hidden::Split);
            let own = || mesh.hierarchy.together(step.lead());
            let around = own().flat_map(|vertex| mesh.hierarchy.link(vertex).path()).map(|v| VertexId(*v));
            for vertex in own().chain(around) {
                let way = mesh.hierarchy.position(vertex) - middle;
                let at = Vec3::from(axes.map(|axis| axis.dot(way))).abs();
                assert!(at.cmple(half + 1e-5).all(), "{}, {step:?}: {at} of {half}", mesh.name);
            }
        }
    }
}
