//! Goal: an estimate keeps its budget, grows with it, and with no bound holds whatever may be seen. Method: a block of cubes, six tetrahedra
//! each, with random triangles, seen from within and from outside, against a look at every triangle.

mod block;
mod completing;

use glam::{DQuat, DVec3, Vec3};
use mullion_common::geometry::{Frustum, Plane};
use mullion_common::scene::{CellId, FACES, SceneManifest, Tessellation, TessellationParts};
use proptest::prelude::*;

use super::*;
use block::{Block, ORIGIN, TRIANGLES_IN_LEAF};

const CUBES: [usize; 3] = [3, 4, 2];

fn size_m() -> Vec3 {
    block::size_m(CUBES)
}

fn block(seed: u64, leaves: u32) -> Block {
    block::block(seed, CUBES, leaves)
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

/// Goal: little comes and goes at once with a small turn, though cells do. Method: 300 turns by 0.1° in a block where up to 24 cells have a
/// corner in common; where each counts as soon as it is in sight, one of the turns changes 13 % of what is drawn.
#[test]
fn small_turns_change_little() {
    const CUBES: [usize; 3] = [10, 6, 10];
    let block = block::block(3, CUBES, 600);
    let eye = ORIGIN + (block::size_m(CUBES) * Vec3::new(0.43, 0.52, 0.47)).as_dvec3();
    let budget = block.tessellation.slot_count() / 20;
    let ahead = DVec3::new(0.0, 0.1, 1.0).normalize();
    let (right, up) = (DVec3::X * 0.5, ahead.cross(DVec3::X) * 0.4);
    let corners = [ahead - right - up, ahead + right - up, ahead - right + up];
    for solidity in Solidity::ALL {
        let mut traversal = Traversal::new();
        let mut before: Option<Vec<u32>> = None;
        for turn in 0..=300 {
            let rotation = DQuat::from_rotation_y(f64::from(turn) * 0.1f64.to_radians());
            let planes = Frustum::through_rectangle(eye, corners.map(|corner| eye + rotation * corner), 0.01).planes;
            let sight = Sight { eye, planes: &planes, pixels_per_radian: 800.0 };
            let frame = Frame { tessellation: &block.tessellation, scene: &block.scene, sight };
            traversal.begin(&frame, solidity);
            assert_eq!(traversal.project(&frame, budget).triangles, budget);
            let held = block.held(traversal.drawn());
            let gone = before.iter().flatten().filter(|slot| held.binary_search(slot).is_err()).count();
            assert!(gone as f64 <= 0.06 * f64::from(budget), "{solidity:?}, turn {turn}: {gone} of {budget} are gone");
            before = Some(held);
        }
    }
}

/// What is likely comes first: the less likely it may be, the more is drawn, up to all.
#[test]
fn likely_triangles_are_the_first_of_the_order() {
    let block = block(7, 9);
    let frame = block.frame(size_m() * 0.3, &[]);
    let (mut likely, mut first) = (Traversal::new(), Traversal::new());
    likely.begin(&frame, Solidity::Likelihood);
    let mut before = 0;
    for least in [1.1, 0.5, 0.25, 0.06, 0.0] {
        let done = likely.project_likely(&frame, u32::MAX, least);
        assert!(done.triangles > before || least > 0.5, "{done:?} as likely as {least}");
        first.begin(&frame, Solidity::Likelihood);
        first.project(&frame, done.triangles);
        assert_eq!(block.held(likely.drawn()), block.held(first.drawn()));
        assert_eq!(done.is_complete, least == 0.0);
        before = done.triangles;
    }
    likely.begin(&frame, Solidity::Likelihood);
    assert_eq!(likely.project_likely(&frame, 5, 0.0).triangles, 5);
}

/// How solid the least solid way from a cell to the middle of each one is, in halves of a triangle: every way tried until none is better.
fn least_ways(block: &Block, eye: Vec3, from: CellId) -> Vec<u64> {
    let tessellation = &block.tessellation;
    let count = |cell: usize| u64::from(tessellation.cells()[cell].triangle_count);
    let mut ways = vec![u64::MAX; tessellation.cells().len()];
    ways[from.index()] = count(from.index());
    loop {
        let before = ways.clone();
        for (a, cell) in tessellation.cells().iter().enumerate().filter(|(a, _)| before[*a] < u64::MAX) {
            for (k, b) in cell.neighbours.into_iter().enumerate().filter_map(|(k, b)| Some((k, b.get()?))) {
                let own = tessellation.corners(CellId(a as u32));
                let [p, q, r] = FACES[k].map(|k| own[k]);
                let middle = tessellation.corners(b).into_iter().sum::<Vec3>() / 4.0;
                let normal = (q - p).cross(r - p);
                let along = normal.dot(p - eye) / normal.dot(middle - eye);
                let met = eye + (middle - eye) * along;
                let is_inside = [(p, q), (q, r), (r, p)].iter().all(|(u, v)| (*v - *u).cross(met - *u).dot(normal) >= 0.0);
                let is_star = normal.dot(middle - eye) > 0.0 && (0.0..=1.0).contains(&along) && is_inside;
                let penalty = if is_star { 0 } else { 2 * u64::from(tessellation.rho_mean()) };
                ways[b.index()] = ways[b.index()].min(ways[a] + count(a) + count(b.index()) + penalty);
            }
        }
        if ways == before {
            return ways;
        }
    }
}

#[test]
fn the_papers_order_is_that_of_the_least_solid_ways() {
    for (seed, share) in [(1, [0.31, 0.42, 0.57]), (2, [0.83, 0.11, 0.22]), (3, [0.07, 0.93, 0.71])] {
        let block = block(seed, 9);
        let eye = size_m() * Vec3::from(share);
        let mut traversal = Traversal::new();
        let frame = block.frame(eye, &[]);
        traversal.begin(&frame, Solidity::Paper);
        traversal.project(&frame, u32::MAX);
        let ways = least_ways(&block, eye, traversal.cells()[0]);
        let order: Vec<u64> = traversal.cells().iter().map(|cell| ways[cell.index()]).collect();
        assert_eq!(order.len(), block.tessellation.cells().len());
        assert!(order.is_sorted(), "{order:?}");
    }
}

#[test]
fn what_has_moved_is_left_out_until_it_is_back() {
    let block = block(5, 9);
    let frame = block.frame(size_m() * 0.4, &[]);
    let mut traversal = Traversal::new();
    for (left_out, expected) in [(false, true), (true, false), (false, true)] {
        traversal.leave_out(&[false, false, false, left_out]);
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
