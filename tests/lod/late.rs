//! Goal: answers that come late, in whatever order, change nothing of what refinement promises. Method: an occluder that answers by a seed now, a
//! little later or only when it is waited for, and that keeps a list of what it was asked.

use std::collections::BTreeSet;

use glam::{DAffine3, DVec3};
use mullion_client::lod::{Cut, Hidden, LodObject, LodOptions, Occluder, OccluderFrom, Refinement, StepId, Wait};
use mullion_common::scene::Hierarchy;
use mullion_server::generate::Random;

use super::surface::Surface;
use super::{SOON, looking, meshes, seen_from_all_sides, sorted, vertex_cut, vertices};

/// How it answers.
#[derive(Clone, Copy, PartialEq)]
enum Habit {
    /// At once at times, late at others, in any order.
    Random,
    /// Whatever is waited for.
    Never,
}

struct Late {
    habit: Habit,
    random: Random,
    /// Of the steps such a share is hidden.
    hidden: f32,
    asked: BTreeSet<(usize, StepId)>,
    due: Vec<(usize, StepId)>,
    late_count: usize,
    most_due: usize,
}

impl Late {
    fn new(habit: Habit, seed: u64, hidden: f32) -> Self {
        let random = Random::new(seed);
        Self { habit, random, hidden, asked: BTreeSet::new(), due: Vec::new(), late_count: 0, most_due: 0 }
    }

    fn answer(&mut self) -> Hidden {
        match self.random.chance(self.hidden) {
            true if self.random.chance(0.5) => Hidden::Split,
            true => Hidden::Node,
            false => Hidden::Nothing,
        }
    }
}

impl Occluder for Late {
    fn draw(&mut self, _objects: &[LodObject<'_>], _cuts: &[Cut]) {
        self.asked.clear();
        self.due.clear();
    }

    fn hides(&mut self, object: usize, _hierarchy: &Hierarchy, step: StepId) -> Option<Hidden> {
        assert!(self.asked.insert((object, step)), "{step:?} of {object} was asked about twice");
        if self.habit == Habit::Random && self.random.chance(0.2) {
            return Some(self.answer());
        }
        self.due.push((object, step));
        self.most_due = self.most_due.max(self.due.len());
        None
    }

    fn answer_late(&mut self, wait: Wait, with: &mut dyn FnMut(usize, StepId, Hidden)) {
        let least = usize::from(wait == Wait::ForSome);
        let count = if self.random.chance(0.1) { self.random.below(12) } else { 0 }.max(least);
        for _ in 0..count.min(self.due.len()) {
            let (object, step) = self.due.swap_remove(self.random.below(self.due.len()));
            if self.habit == Habit::Random {
                self.late_count += 1;
                let hidden = self.answer();
                with(object, step, hidden);
            }
        }
    }
}

#[test]
fn late_answers_give_surfaces_within_the_budget() {
    for mesh in [meshes::sphere(16), meshes::hills(30, 25), meshes::seamed_tube(24, 30)] {
        let hierarchy = &vertices(&mesh);
        let whole = Surface::of_mesh(&mesh);
        let mut random = Random::new(3);
        let mut refinement = Refinement::new();
        for frame in 0..60 {
            let what = format!("{}, frame {frame}", mesh.name);
            let eye = DVec3::from([(); 3].map(|()| f64::from(random.range(-8.0, 8.0))));
            let objects = [LodObject { is_double_sided: random.chance(0.3), ..seen_from_all_sides(hierarchy) }];
            let budget = mesh.hierarchy.base().triangles.len() as u32 + random.below(hierarchy.triangle_count() as usize) as u32;
            let options =
                LodOptions { budget, least_pixels: random.range(0.0, 3.0), occluders: SOON, odd_levels: random.chance(0.5) };
            let (seed, hidden) = (u64::from(random.below(1 << 20) as u32), random.unit());
            let find = |refinement: &mut Refinement| {
                let mut occluder = Late::new(Habit::Random, seed, hidden);
                refinement.refine(&objects, &looking(eye), &options, Some((&mut occluder, OccluderFrom::ThisFrame)));
                let (hierarchy, cut) = vertex_cut(&objects[0], &refinement.cuts()[0]);
                whole.assert_is_coarser(hierarchy, cut, &what);
                assert!(refinement.triangle_count() <= budget, "{what}: above the budget");
                assert_eq!(refinement.triangle_count(), cut.triangle_count(), "{what}");
                sorted(cut, hierarchy)
            };
            assert!(find(&mut refinement) == find(&mut Refinement::new()), "{what}: answers come alike, and cuts are others");
        }
    }
}

/// Far from a budget's end it does not matter when answers come. What is never answered is seen.
#[test]
fn whatever_is_seen_is_refined_however_late_that_is_known() {
    let [a, b] = [meshes::torus(40, 24), meshes::hills(30, 25)].map(|mesh| vertices(&mesh));
    let place = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.5, -1.0));
    let objects = [(&a, -3.0), (&b, 4.0)].map(|(of, x)| LodObject { world_from_local: place(x), ..seen_from_all_sides(of) });
    let all: u32 = objects.iter().map(|object| object.hierarchy.triangle_count()).sum();
    let options = LodOptions { budget: u32::MAX, occluders: SOON, ..LodOptions::default() };
    for habit in [Habit::Random, Habit::Never] {
        let mut occluder = Late::new(habit, 9, 0.0);
        let mut refinement = Refinement::new();
        let from = OccluderFrom::ThisFrameAlone;
        refinement.refine(&objects, &looking(DVec3::new(1.0, 2.0, 9.0)), &options, Some((&mut occluder, from)));
        assert_eq!(refinement.triangle_count(), all);
        assert!(refinement.question_count() > 100, "{} questions", refinement.question_count());
        assert!(occluder.most_due > 20, "{} at a time", occluder.most_due);
        assert_eq!(occluder.late_count > 100, habit == Habit::Random);
    }
}

/// An occluder that is kept answers what an earlier frame asked.
#[test]
fn answers_come_in_a_later_frame() {
    let hierarchy = vertices(&meshes::torus(40, 24));
    let objects = [seen_from_all_sides(&hierarchy)];
    let base = Cut::new(&hierarchy).triangle_count();
    let mut occluder = Late::new(Habit::Random, 4, 0.4);
    let mut refinement = Refinement::new();
    for frame in 0..12u32 {
        let options = LodOptions { budget: base + 100 * (frame + 1), occluders: SOON, ..LodOptions::default() };
        let from = if frame == 0 { OccluderFrom::ThisFrame } else { OccluderFrom::EarlierFrame };
        refinement.refine(&objects, &looking(DVec3::new(5.0, 3.0, 9.0)), &options, Some((&mut occluder, from)));
        assert!(refinement.triangle_count() <= options.budget);
    }
    assert!(occluder.late_count > 20, "{}", occluder.late_count);
}
