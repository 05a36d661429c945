//! Goal: an estimate keeps its budget, grows with it, and with no bound holds whatever may be seen. Method: a block of cubes, six tetrahedra
//! each, with random triangles, seen from within and from outside, against a look at every triangle.

use std::collections::HashMap;

use glam::{DAffine3, DVec3, Vec3};
use mullion_common::geometry::{Aabb, Frustum, Plane};
use mullion_common::scene::{
    AlphaMode, Cell, CellId, ChunkHash, ChunkId, ChunkKind, ChunkRecord, Cover, Exposure, FACES, Facing, LeafRecord, LeafRun,
    Material, MaterialId, ObjectId, SceneManifest, Tessellation, TessellationParts, Transform, push_numbers,
};
use proptest::prelude::*;

use super::*;

const CUBES: [usize; 3] = [3, 4, 2];
const CUBE_M: Vec3 = Vec3::new(1.0, 2.0, 1.5);
const TRIANGLES_IN_LEAF: u32 = 37;
const ORIGIN: DVec3 = DVec3::new(1000.0, -50.0, 3.0);

/// A scene, its tessellation, and its triangles by slot, from the tessellation's origin.
struct Block {
    scene: SceneManifest,
    tessellation: Tessellation,
    triangles: Vec<[Vec3; 3]>,
}

/// SplitMix64, from 0 up to 1.
fn next(state: &mut u64) -> f32 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb) >> 40) as f32 / (1 << 24) as f32
}

fn size_m() -> Vec3 {
    Vec3::from(CUBES.map(|n| n as f32)) * CUBE_M
}

/// Six tetrahedra to a cube, along its diagonal: one for each order of the axes.
fn cells() -> (Vec<Vec3>, Vec<[u32; 4]>) {
    let [nx, ny, nz] = CUBES;
    let index = |p: [usize; 3]| (p[0] + (nx + 1) * (p[1] + (ny + 1) * p[2])) as u32;
    let mut vertices = Vec::new();
    let mut corners = Vec::new();
    for z in 0..=nz {
        for y in 0..=ny {
            for x in 0..=nx {
                vertices.push(Vec3::new(x as f32, y as f32, z as f32) * CUBE_M);
                if x == nx || y == ny || z == nz {
                    continue;
                }
                for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
                    let mut at = [x, y, z];
                    let mut cell = [index(at); 4];
                    for (k, axis) in order.into_iter().enumerate() {
                        at[axis] += 1;
                        cell[k + 1] = index(at);
                    }
                    corners.push(cell);
                }
            }
        }
    }
    for cell in &mut corners {
        let [a, b, c, d] = cell.map(|k| vertices[k as usize]);
        if (b - a).dot((c - a).cross(d - a)) < 0.0 {
            cell.swap(2, 3);
        }
    }
    (vertices, corners)
}

fn neighbours(corners: &[[u32; 4]]) -> Vec<[CellId; 4]> {
    let key = |cell: &[u32; 4], face: usize| {
        let mut key = FACES[face].map(|k| cell[k]);
        key.sort_unstable();
        key
    };
    let mut by_face: HashMap<[u32; 3], Vec<u32>> = HashMap::new();
    for (k, cell) in corners.iter().enumerate() {
        (0..4).for_each(|face| by_face.entry(key(cell, face)).or_default().push(k as u32));
    }
    let beyond = |k: u32, cell: &[u32; 4], face| {
        by_face[&key(cell, face)].iter().find(|other| **other != k).map_or(CellId::NONE, |other| CellId(*other))
    };
    (0..).zip(corners).map(|(k, cell)| [0, 1, 2, 3].map(|face| beyond(k, cell, face))).collect()
}

fn block(seed: u64, leaves: u32) -> Block {
    let mut state = seed;
    let (vertices, corners) = cells();
    let mut vector = |low: Vec3, size: Vec3| low + Vec3::new(next(&mut state), next(&mut state), next(&mut state)) * size;
    let mut triangles: Vec<[Vec3; 3]> = Vec::new();
    let mut scene = SceneManifest {
        transforms: vec![Transform::from(DAffine3::from_translation(ORIGIN))],
        materials: [false, true]
            .map(|double_sided| Material { base_color: [1.0; 4], texture: None, alpha: AlphaMode::Opaque, double_sided })
            .to_vec(),
        chunks: vec![ChunkRecord::new(ChunkHash([0; 32]), 0, 0, ChunkKind::Geometry); leaves as usize],
        leaves: Vec::new(),
    };
    let mut facings = Vec::new();
    for leaf in 0..leaves {
        let at = vector(Vec3::ZERO, size_m());
        let own: Vec<[Vec3; 3]> = (0..TRIANGLES_IN_LEAF)
            .map(|_| [(); 3].map(|()| vector(at - 0.4, Vec3::splat(0.8)).clamp(Vec3::splat(0.001), size_m() - 0.001)))
            .collect();
        let (low, high) =
            own.as_flattened().iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let record = LeafRecord {
            object: ObjectId(0),
            chunk: ChunkId(leaf),
            material: MaterialId(leaf % 2),
            triangle_count: TRIANGLES_IN_LEAF,
            local_min: low.to_array(),
            local_max: high.to_array(),
        };
        let (middle, radius) = record.middle_and_radius();
        facings.extend(own.iter().map(|t| Facing::new(*t, middle, radius)));
        scene.leaves.push(record);
        triangles.extend(own);
    }
    let exposures = triangles
        .iter()
        .map(|_| Exposure::new(vector(Vec3::ZERO, Vec3::ONE).to_array().repeat(2).try_into().unwrap_or_default(), 0.01));
    let mut parts = TessellationParts {
        origin: ORIGIN,
        leaves: (0..leaves).collect(),
        exposures: exposures.collect(),
        facings,
        ..TessellationParts::default()
    };
    for (cell, neighbours) in corners.iter().zip(neighbours(&corners)) {
        let ends = cell.map(|k| vertices[k as usize]);
        let (low, high) = ends.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let mut triangle_count = 0;
        for (place, own) in triangles.chunks(TRIANGLES_IN_LEAF as usize).enumerate() {
            // As by their boxes: more than touch it.
            let meets = |t: &[Vec3; 3]| (0..3).all(|k| t.iter().any(|p| p[k] >= low[k]) && t.iter().any(|p| p[k] <= high[k]));
            let numbers: Vec<u16> = (0..).zip(own).filter(|(_, t)| meets(t)).map(|(number, _)| number).collect();
            if !numbers.is_empty() {
                push_numbers(&mut parts.words, &numbers);
                parts.runs.push(LeafRun { place: place as u32, end: parts.words.len() as u32 });
                triangle_count += numbers.len() as u32;
            }
        }
        let cover = Cover([(37 * parts.cells.len()) as u8; 12]);
        parts.cells.push(Cell { corners: *cell, neighbours, run_end: parts.runs.len() as u32, triangle_count, cover });
    }
    parts.vertices = vertices;
    Block { tessellation: Tessellation::new(parts, &scene).expect("it is one"), scene, triangles }
}

impl Block {
    fn frame<'a>(&'a self, eye: Vec3, planes: &'a [Plane]) -> Frame<'a> {
        let sight = Sight { eye: ORIGIN + eye.as_dvec3(), planes, pixels_per_radian: 800.0 };
        Frame { tessellation: &self.tessellation, scene: &self.scene, sight }
    }

    fn held(&self, drawn: &Drawn) -> Vec<u32> {
        (0..self.tessellation.slot_count()).filter(|slot| drawn.holds(*slot)).collect()
    }

    /// Whether a triangle has its front towards an eye, by more than rounding, or two of them.
    fn shows_front(&self, slot: u32, eye: Vec3) -> bool {
        let [a, b, c] = self.triangles[slot as usize];
        let double_sided = slot / TRIANGLES_IN_LEAF % 2 == 1;
        double_sided || (b - a).cross(c - a).normalize_or_zero().dot(eye - a) > 1e-3
    }
}

/// A frustum from an eye towards the block's middle, off its axis.
fn frustum(eye: Vec3) -> Frustum {
    let eye = ORIGIN + eye.as_dvec3();
    let ahead = (ORIGIN + size_m().as_dvec3() * 0.45 - eye).normalize_or(DVec3::Z);
    let right = ahead.cross(DVec3::Y).normalize_or(DVec3::X) * 0.5;
    let up = right.cross(ahead).normalize() * 0.3;
    let middle = eye + ahead + right * 0.2;
    Frustum::through_rectangle(eye, [middle - right - up, middle + right - up, middle - right + up], 0.01)
}

fn eyes() -> impl Strategy<Value = Vec3> {
    let inside = [0.02..0.98f32, 0.02..0.98, 0.02..0.98].prop_map(|p| Vec3::from(p) * size_m());
    let around = [-3.0..3.0f32, -3.0..3.0, -3.0..3.0].prop_map(|p| Vec3::from(p) * 4.0);
    prop_oneof![inside, around]
}

fn solidities() -> impl Strategy<Value = Solidity> {
    prop_oneof![Just(Solidity::Paper), Just(Solidity::Likelihood)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn budgets_are_kept_and_estimates_grow(seed in any::<u64>(), eye in eyes(), solidity in solidities(), step in 1..90u32) {
        let block = block(seed, 9);
        let planes = frustum(eye).planes;
        let frame = block.frame(eye, &planes);
        let (mut going_on, mut anew) = (Traversal::new(), Traversal::new());
        going_on.begin(&frame, solidity);
        let mut before: Vec<u32> = Vec::new();
        for budget in (0..400).step_by(step as usize) {
            let done = going_on.project(&frame, budget);
            let held = block.held(going_on.drawn());
            prop_assert_eq!((done.triangles, going_on.drawn().count()), (held.len() as u32, held.len() as u32));
            prop_assert!(done.triangles == budget || done.triangles < budget && done.is_complete);
            prop_assert!(before.iter().all(|slot| held.contains(slot)), "what was there stays");
            anew.begin(&frame, solidity);
            prop_assert_eq!(anew.project(&frame, budget).triangles, done.triangles);
            prop_assert_eq!(&block.held(anew.drawn()), &held, "it is the same at once or step by step");
            let mut listed = Vec::new();
            for (place, count) in anew.drawn().leaves() {
                let numbers: Vec<u16> = anew.drawn().triangles(&block.tessellation, place).collect();
                prop_assert_eq!(numbers.len() as u32, count);
                listed.extend(numbers.iter().map(|number| block.tessellation.slots(place).start + u32::from(*number)));
            }
            prop_assert_eq!(&listed, &held, "leaf by leaf, ascending");
            before = held;
        }
    }

    #[test]
    fn without_a_bound_all_is_drawn_that_may_be_seen(seed in any::<u64>(), eye in eyes(), solidity in solidities()) {
        let block = block(seed, 9);
        let frustum = frustum(eye);
        for planes in [&[][..], &frustum.planes[..]] {
            let frame = block.frame(eye, planes);
            let mut traversal = Traversal::new();
            traversal.begin(&frame, solidity);
            let done = traversal.project(&frame, u32::MAX);
            prop_assert!(done.is_complete && traversal.front().next().is_none());
            let mut cells = traversal.cells().to_vec();
            cells.sort_unstable();
            prop_assert!(cells.is_sorted_by(|a, b| a < b), "each cell once");
            let seen = |p: &Vec3| planes.iter().all(|plane| plane.distance_m(ORIGIN + p.as_dvec3()) > 1e-3);
            for slot in 0..block.tessellation.slot_count() {
                let may_be_seen = block.shows_front(slot, eye) && block.triangles[slot as usize].iter().any(seen);
                prop_assert!(!may_be_seen || traversal.drawn().holds(slot), "triangle {} is missing", slot);
            }
            let backs = (0..block.tessellation.slot_count()).filter(|slot| !block.shows_front(*slot, eye));
            let drawn = backs.clone().filter(|slot| traversal.drawn().holds(*slot)).count();
            prop_assert!(drawn * 5 <= backs.count().max(10), "hardly any back is drawn");
        }
    }
}

/// Where a ray from the eye meets a triangle, in lengths of its direction.
fn meets(eye: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<f64> {
    let [eye, direction, a, b, c] = [eye, direction, a, b, c].map(|p| p.as_dvec3());
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let volume = ab.dot(across);
    let from_a = eye - a;
    let u = from_a.dot(across) / volume;
    let v = direction.dot(from_a.cross(ab)) / volume;
    let along = ac.dot(from_a.cross(ab)) / volume;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && along > 1e-4).then_some(along)
}

/// Whether a ray comes into a box before it has gone so far.
fn enters(eye: Vec3, direction: Vec3, bounds: &Aabb, before: f64) -> bool {
    let (eye, direction) = (ORIGIN + eye.as_dvec3(), direction.as_dvec3());
    let (a, b) = ((bounds.min - eye) / direction, (bounds.max - eye) / direction);
    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
    enter.max(0.0) <= leave + 1e-6 && enter <= before + 1e-6
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Pixels are rays: what the nearest triangle of each is must be among what completion draws.
    #[test]
    fn completion_draws_all_that_is_seen(seed in any::<u64>(), eye in eyes(), solidity in solidities(), budget in 0..120u32) {
        let block = block(seed, 9);
        let frustum = frustum(eye);
        let frame = block.frame(eye, &frustum.planes);
        let mut state = seed;
        let [corner, right, _, up] = frustum.rays;
        let towards = |x: f32, y: f32| (corner + (right - corner) * f64::from(x) + (up - corner) * f64::from(y)).as_vec3();
        let rays: Vec<Vec3> = (0..300).map(|_| towards(next(&mut state), next(&mut state))).collect();
        let nearest = |ray: Vec3, is_there: &dyn Fn(u32) -> bool| {
            let hits = (0..).zip(&block.triangles).filter(|(slot, _)| is_there(*slot));
            let hits = hits.filter_map(|(slot, triangle)| meets(eye, ray, *triangle).map(|along| (along, slot)));
            hits.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let mut traversal = Traversal::new();
        traversal.begin(&frame, solidity);
        traversal.project(&frame, budget);
        let mut completion = Completion::default();
        completion.begin(&frame, &traversal);
        let held = |completion: &Completion| block.held(&completion.drawn);
        let mut rounds = 0;
        loop {
            let drawn = held(&completion);
            let so_far: Vec<f64> = rays
                .iter()
                .map(|ray| nearest(*ray, &|slot| drawn.binary_search(&slot).is_ok()).map_or(f64::INFINITY, |(along, _)| along))
                .collect();
            let is_seen = |bounds: Aabb| rays.iter().zip(&so_far).any(|(ray, before)| enters(eye, *ray, &bounds, *before));
            let seen: Vec<bool> = completion.bounds(&block.tessellation).map(is_seen).collect();
            let more = completion.take(&frame, &seen);
            let mut after = drawn.clone();
            for (place, own) in completion.added() {
                prop_assert!(own.iter().all(|(of, slot)| *of == place && block.tessellation.slots(place).contains(slot)));
                after.extend(own.iter().map(|(_, slot)| *slot));
            }
            after.sort_unstable();
            prop_assert_eq!(after, held(&completion), "what was added is what is new");
            rounds += 1;
            if !more {
                break;
            }
        }
        prop_assert!(rounds < 60);
        let drawn = held(&completion);
        let fronts = |slot: u32| {
            let [a, b, c] = block.triangles[slot as usize];
            slot / TRIANGLES_IN_LEAF % 2 == 1 || (b - a).cross(c - a).dot(eye - a) > 0.0
        };
        for ray in &rays {
            if let Some((_, slot)) = nearest(*ray, &fronts).filter(|(_, slot)| block.shows_front(*slot, eye)) {
                prop_assert!(drawn.binary_search(&slot).is_ok(), "triangle {} is seen and not drawn", slot);
            }
        }
    }
}

#[test]
fn what_has_moved_is_left_out_until_it_is_back() {
    let block = block(5, 9);
    let frame = block.frame(size_m() * 0.4, &[]);
    let mut traversal = Traversal::new();
    for (left_out, expected) in [(false, true), (true, false), (false, true)] {
        traversal.leave_out(&block.tessellation, 3, left_out);
        traversal.begin(&frame, Solidity::Likelihood);
        traversal.project(&frame, u32::MAX);
        assert_eq!(traversal.drawn().leaves().any(|(place, _)| place == 3), expected);
    }
}

#[test]
fn a_tessellation_without_cells_draws_nothing() {
    let scene = SceneManifest::default();
    let tessellation = Tessellation::new(TessellationParts::default(), &scene).expect("it names nothing");
    let sight = Sight { eye: DVec3::ONE, planes: &[], pixels_per_radian: 1.0 };
    let frame = Frame { tessellation: &tessellation, scene: &scene, sight };
    for solidity in Solidity::ALL {
        let mut traversal = Traversal::new();
        traversal.begin(&frame, solidity);
        assert_eq!(traversal.project(&frame, 9), Projected { cells: 0, triangles: 0, is_complete: true });
    }
}

#[test]
fn after_the_first_frame_no_memory_is_taken() {
    let block = block(11, 12);
    let eyes: Vec<Vec3> = (0..8).map(|k| size_m() * (0.1 + 0.1 * k as f32)).collect();
    for solidity in Solidity::ALL {
        let mut traversal = Traversal::new();
        let run = |traversal: &mut Traversal| {
            for eye in &eyes {
                let frame = block.frame(*eye, &[]);
                traversal.begin(&frame, solidity);
                traversal.project(&frame, 100);
                traversal.project(&frame, u32::MAX);
            }
        };
        run(&mut traversal);
        let counted = allocation_counter::measure(|| run(&mut traversal));
        assert_eq!(counted.count_total, 0, "{solidity:?}");
    }
}
