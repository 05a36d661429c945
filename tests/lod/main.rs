//! Goal: whatever is asked of a vertex hierarchy and answered, what is drawn is a coarser version of the mesh and nothing else. Method: meshes
//! of several kinds take the path of files into a package; from there thousands of cuts, by random splits and by refinement with random
//! answers, are each held against a dull test of surfaces.

mod meshes;
mod surface;

use glam::{DAffine3, DVec3};
use mullion_client::lod::{Cut, LodObject, LodOptions, LodSight, Occlusion, Progress, Refinement, Start, StepLimit, Visibility};
use mullion_common::geometry::Plane;
use mullion_common::scene::{VertexHierarchy, VertexId};
use mullion_server::generate::Random;

use meshes::Mesh;
use surface::Surface;

/// Splits a lead, and before it all that it needs.
fn split_with_needs(cut: &mut Cut, hierarchy: &VertexHierarchy, lead: VertexId) {
    let mut open = vec![lead];
    while let Some(lead) = open.last().copied() {
        match cut.missing(hierarchy, lead) {
            Some(needed) => open.push(needed),
            None => {
                open.pop();
                if !cut.has(lead) {
                    cut.split(hierarchy, lead);
                }
            }
        }
    }
}

fn random_lead(hierarchy: &VertexHierarchy, random: &mut Random) -> VertexId {
    let count = (hierarchy.vertex_count() - hierarchy.base_count()) as usize;
    hierarchy.lead(VertexId(hierarchy.base_count() + random.below(count) as u32))
}

fn sorted(cut: &Cut, hierarchy: &VertexHierarchy) -> Vec<[u32; 3]> {
    let mut triangles: Vec<[u32; 3]> = cut.triangles(hierarchy).map(|t| t.map(|v| v.0)).collect();
    triangles.sort_unstable();
    triangles
}

/// Splits and collapses at random, now here and now there, from coarse to fine and back.
#[test]
fn any_cut_is_a_surface() {
    const CUTS: usize = 3400;
    for mesh in [meshes::sphere(8), meshes::torus(24, 16), meshes::hills(20, 15), meshes::seamed_tube(14, 16)] {
        let Mesh { name, hierarchy, .. } = &mesh;
        let whole = Surface::of_mesh(&mesh);
        let mut random = Random::new(11);
        let mut cut = Cut::new(hierarchy);
        let (mut fewest, mut most) = (u32::MAX, 0);
        for number in 0..CUTS {
            for _ in 0..1 + random.below(4) {
                let lead = random_lead(hierarchy, &mut random);
                if random.chance(if number / 100 % 2 == 0 { 0.7 } else { 0.1 }) {
                    split_with_needs(&mut cut, hierarchy, lead);
                } else if cut.can_collapse(hierarchy, lead) {
                    cut.collapse(hierarchy, lead);
                }
            }
            whole.assert_is_coarser(hierarchy, &cut, &format!("{name}, cut {number}"));
            (fewest, most) = (fewest.min(cut.triangle_count()), most.max(cut.triangle_count()));
        }
        assert!(fewest * 2 < most, "{name}: {fewest} to {most} triangles");
    }
}

#[test]
fn the_order_of_splits_changes_nothing() {
    for mesh in [meshes::torus(24, 16), meshes::seamed_tube(14, 16)] {
        let hierarchy = &mesh.hierarchy;
        for seed in 0..50 {
            let mut random = Random::new(seed);
            let leads: Vec<VertexId> = (0..20).map(|_| random_lead(hierarchy, &mut random)).collect();
            let mut forwards = Cut::new(hierarchy);
            leads.iter().for_each(|lead| split_with_needs(&mut forwards, hierarchy, *lead));
            // All the way and back to the same set.
            let mut back = Cut::new(hierarchy);
            let all = || (hierarchy.base_count()..hierarchy.vertex_count()).map(VertexId);
            let all_leads = || all().filter(|v| !hierarchy.is_follower(*v));
            all_leads().for_each(|lead| split_with_needs(&mut back, hierarchy, lead));
            assert_eq!(back.triangle_count(), hierarchy.triangle_count());
            for lead in all_leads().collect::<Vec<_>>().into_iter().rev() {
                if !forwards.has(lead) {
                    back.collapse(hierarchy, lead);
                }
            }
            assert_eq!(sorted(&forwards, hierarchy), sorted(&back, hierarchy), "{}, seed {seed}", mesh.name);
        }
    }
}

fn looking(eye: DVec3) -> LodSight<'static> {
    LodSight { eye, planes: &[], pixels_per_radian: 1000.0, near_m: 0.05 }
}

fn seen_from_all_sides(hierarchy: &VertexHierarchy) -> LodObject<'_> {
    LodObject { hierarchy, world_from_local: DAffine3::IDENTITY, is_double_sided: true }
}

/// Answers all questions until refinement rests or is done.
fn refine(
    refinement: &mut Refinement,
    objects: &[LodObject<'_>],
    limit: StepLimit,
    mut visibility: impl FnMut(&mullion_client::lod::Question) -> Visibility,
) -> Progress {
    let mut answers = Vec::new();
    loop {
        let progress = refinement.refine(objects, limit);
        answers.extend(refinement.questions().map(|question| visibility(&question)));
        if progress != Progress::Waits {
            // Nobody waits for these, and they come all the same.
            answers.drain(..).for_each(|answer| refinement.answer(objects, answer));
            return progress;
        }
        assert!(!answers.is_empty(), "it waits for nothing");
        // Answers come late, and not all at once.
        let count = answers.len().div_ceil(2);
        answers.drain(..count).for_each(|answer| refinement.answer(objects, answer));
    }
}

#[test]
fn random_answers_give_surfaces_within_the_budget() {
    for mesh in [meshes::sphere(16), meshes::torus(40, 24), meshes::hills(30, 25), meshes::seamed_tube(24, 30)] {
        let Mesh { name, hierarchy, .. } = &mesh;
        let whole = Surface::of_mesh(&mesh);
        let mut random = Random::new(5);
        let mut refinement = Refinement::new();
        for frame in 0..150 {
            let eye = DVec3::from([(); 3].map(|()| f64::from(random.range(-8.0, 8.0))));
            let normal = DVec3::from([(); 3].map(|()| f64::from(random.range(-1.0, 1.0)))).normalize_or(DVec3::X);
            let planes = [Plane { normal, offset_m: f64::from(random.range(0.0, 2.0)) }];
            let sight = LodSight { planes: &planes, ..looking(eye) };
            let objects = [LodObject { hierarchy, world_from_local: DAffine3::IDENTITY, is_double_sided: random.chance(0.3) }];
            let budget = hierarchy.base().triangles.len() as u32 + random.below(hierarchy.triangle_count() as usize) as u32;
            let options = LodOptions { budget, least_pixels: random.range(0.0, 4.0), most_asked: 1 + random.below(40) as u32 };
            let start = if random.chance(0.5) { Start::Base } else { Start::Last };
            let seen = random.unit();
            refinement.begin(&objects, &sight, &options, start);
            let mut answer = {
                let mut random = random.fork();
                move |_: &_| if random.chance(seen) { Visibility::Visible } else { Visibility::Occluded }
            };
            refine(&mut refinement, &objects, StepLimit::Total(30), &mut answer);
            for steps in [60, u32::MAX] {
                refinement.set_occlusion(&objects, Occlusion::On);
                refine(&mut refinement, &objects, StepLimit::Total(steps), &mut answer);
            }
            assert!(refinement.triangle_count() <= budget, "{name}, frame {frame}: above the budget");
            assert_eq!(refinement.triangle_count(), refinement.cuts()[0].triangle_count());
            whole.assert_is_coarser(hierarchy, &refinement.cuts()[0], &format!("{name}, frame {frame}"));
        }
    }
}

#[test]
fn a_budget_is_used_and_never_exceeded() {
    let [a, b] = [meshes::torus(60, 40), meshes::hills(50, 40)];
    let objects = [seen_from_all_sides(&a.hierarchy), seen_from_all_sides(&b.hierarchy)];
    let base: usize = objects.iter().map(|object| object.hierarchy.base().triangles.len()).sum();
    let all: u32 = objects.iter().map(|object| object.hierarchy.triangle_count()).sum();
    let mut refinement = Refinement::new();
    for start in [Start::Base, Start::Last] {
        for budget in (base as u32..all + 300).step_by(97) {
            let options = LodOptions { budget, ..LodOptions::default() };
            refinement.begin(&objects, &looking(DVec3::new(9.0, 2.0, 5.0)), &options, start);
            assert_eq!(refine(&mut refinement, &objects, StepLimit::None, |_| Visibility::Visible), Progress::Done);
            let drawn: usize =
                objects.iter().zip(refinement.cuts()).map(|(object, cut)| cut.triangles(object.hierarchy).count()).sum();
            assert_eq!(drawn, refinement.triangle_count() as usize);
            assert!(drawn <= budget as usize, "{drawn} of {budget}");
            let least = budget.min(all) as usize;
            assert!(drawn * 100 >= least * 99 || drawn + 1 >= least, "{start:?}: {drawn} of {least}");
        }
    }
    // A smaller one than the last.
    let options = LodOptions { budget: base as u32 + 100, ..LodOptions::default() };
    refinement.begin(&objects, &looking(DVec3::new(9.0, 2.0, 5.0)), &options, Start::Last);
    refine(&mut refinement, &objects, StepLimit::None, |_| Visibility::Visible);
    assert!(refinement.triangle_count() <= base as u32 + 100);
}

/// What lies below the plane y = 0 is hidden: triangles go above it.
#[test]
fn hidden_parts_stay_coarse() {
    let mesh = meshes::sphere(40);
    let objects = [seen_from_all_sides(&mesh.hierarchy)];
    let options = LodOptions { budget: 1200, ..LodOptions::default() };
    let above = |refinement: &Refinement| {
        let hierarchy = objects[0].hierarchy;
        let is_above = |t: &[VertexId; 3]| t.iter().any(|v| hierarchy.position(*v).y > 0.0);
        refinement.cuts()[0].triangles(hierarchy).filter(is_above).count() as f32 / refinement.triangle_count() as f32
    };
    let visibility = |question: &mullion_client::lod::Question| {
        let top = question.bounds.center.y + question.bounds.extent.half_box.y;
        if top > 0.0 { Visibility::Visible } else { Visibility::Occluded }
    };
    let mut refinement = Refinement::new();
    refinement.begin(&objects, &looking(DVec3::new(0.0, 0.0, 50.0)), &options, Start::Base);
    refine(&mut refinement, &objects, StepLimit::None, visibility);
    let without = above(&refinement);
    assert_eq!(refinement.question_count(), 0);
    refinement.begin(&objects, &looking(DVec3::new(0.0, 0.0, 50.0)), &options, Start::Base);
    assert_eq!(refine(&mut refinement, &objects, StepLimit::Total(50), visibility), Progress::Rests);
    refinement.set_occlusion(&objects, Occlusion::On);
    refine(&mut refinement, &objects, StepLimit::None, visibility);
    let (with, questions) = (above(&refinement), refinement.question_count());
    assert!(without < 0.6 && with > 0.68, "{without} of the triangles without questions, {with} with {questions}");
    assert!(questions > 50 && questions < refinement.steps() * 2, "{questions} for {} steps", refinement.steps());

    // The next frames keep what is known: few questions, and nothing worse.
    let mut asked = 0;
    for frame in 0..8 {
        let eye = DVec3::new(f64::from(frame) * 0.01, 0.0, 50.0);
        refinement.begin(&objects, &looking(eye), &options, Start::Last);
        refinement.set_occlusion(&objects, Occlusion::On);
        refine(&mut refinement, &objects, StepLimit::None, visibility);
        asked += refinement.question_count();
    }
    assert!(above(&refinement) > 0.68, "{}", above(&refinement));
    assert!(asked / 8 < questions / 3, "{asked} questions in 8 frames, {questions} in the first");
}

#[test]
fn a_resting_camera_changes_nothing() {
    let mesh = meshes::torus(60, 40);
    let objects = [seen_from_all_sides(&mesh.hierarchy)];
    let options = LodOptions { budget: 1500, ..LodOptions::default() };
    let mut refinement = Refinement::new();
    let mut last = Vec::new();
    for frame in 0..6 {
        refinement.begin(&objects, &looking(DVec3::new(5.0, 3.0, 9.0)), &options, Start::Last);
        refine(&mut refinement, &objects, StepLimit::None, |_| Visibility::Visible);
        let now = sorted(&refinement.cuts()[0], objects[0].hierarchy);
        assert!(frame < 2 || now == last, "frame {frame}");
        last = now;
    }
}

/// Far above, the mesh is what it was; the last block may be missing.
#[test]
fn a_hierarchy_that_has_not_arrived_is_drawn_as_far_as_it_is_there() {
    let mesh = meshes::torus(40, 24);
    let whole = Surface::of_mesh(&mesh);
    let mut growing: Option<VertexHierarchy> = None;
    let mut refinement = Refinement::new();
    let options = LodOptions { budget: u32::MAX, ..LodOptions::default() };
    let mut last = 0;
    for blob in &mesh.blobs {
        match &mut growing {
            None => growing = Some(VertexHierarchy::decode_base(blob, 8).expect("a base")),
            Some(hierarchy) => hierarchy.decode_block(blob).expect("a block"),
        }
        let hierarchy = growing.as_ref().expect("it has begun");
        let objects = [seen_from_all_sides(hierarchy)];
        refinement.begin(&objects, &looking(DVec3::new(5.0, 3.0, 9.0)), &options, Start::Last);
        refine(&mut refinement, &objects, StepLimit::None, |_| Visibility::Visible);
        assert_eq!(refinement.triangle_count(), hierarchy.triangle_count());
        assert!(refinement.triangle_count() > last);
        last = refinement.triangle_count();
        whole.assert_is_coarser(hierarchy, &refinement.cuts()[0], "as far as it is there");
    }
    assert_eq!(last, mesh.hierarchy.triangle_count());
}

/// Frames take no memory once buffers have grown.
#[test]
fn frames_take_no_memory() {
    let [a, b] = [meshes::torus(60, 40), meshes::hills(50, 40)];
    let objects = [seen_from_all_sides(&a.hierarchy), seen_from_all_sides(&b.hierarchy)];
    let options = LodOptions { budget: 1800, most_asked: 32, ..LodOptions::default() };
    let mut refinement = Refinement::new();
    let mut frame = |number: u32, start: Start| {
        let eye = DVec3::new(5.0 + f64::from(number % 4), 3.0, 9.0);
        refinement.begin(&objects, &looking(eye), &options, start);
        refinement.refine(&objects, StepLimit::Total(100));
        for _ in 0..2 {
            refinement.set_occlusion(&objects, Occlusion::On);
            while refinement.refine(&objects, StepLimit::None) == Progress::Waits {
                let count = refinement.questions().len();
                for k in 0..count {
                    refinement.answer(&objects, if k % 3 == 0 { Visibility::Occluded } else { Visibility::Visible });
                }
            }
        }
    };
    for start in [Start::Base, Start::Last] {
        (0..24).for_each(|number| frame(number, start));
        let counted = allocation_counter::measure(|| (0..8).for_each(|number| frame(number, start)));
        assert_eq!(counted.count_total, 0, "{start:?}");
    }
}
