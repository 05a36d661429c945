//! Goal: whatever is asked of a vertex hierarchy and answered, what is drawn is a coarser version of the mesh and nothing else. Method: meshes
//! of several kinds take the path of files into a package; from there thousands of cuts, by random splits and by refinement with random
//! answers, are each held against a dull test of surfaces.

mod away;
mod clusters;
mod late;
mod looks;
mod meshes;
mod moved;
mod queries;
mod surface;
mod weights;

use glam::{DAffine3, DVec3, Vec3};
use mullion_client::lod::{
    BoundsKind, Cut, DepthOccluder, Hidden, LodObject, LodOptions, LodSight, Occluder, OccluderFrom, Refinement, StepId,
    VertexCut,
};
use mullion_common::geometry::Plane;
use mullion_common::scene::{Hierarchy, ObjectId, Presence, VertexHierarchy, VertexId};
use mullion_common::wall::Projection;
use mullion_server::generate::Random;

use meshes::Mesh;
use surface::Surface;

/// A lead that must be split before this one and is not: of any, the first in its link.
fn missing(cut: &VertexCut, hierarchy: &VertexHierarchy, lead: VertexId) -> Option<VertexId> {
    let links = hierarchy.together(lead).flat_map(|vertex| hierarchy.link(vertex).path());
    links.map(|v| VertexId(*v)).find(|v| !cut.has(*v)).map(|v| hierarchy.lead(v))
}

/// Splits a lead, and before it all that it needs.
fn split_with_needs(cut: &mut VertexCut, hierarchy: &VertexHierarchy, lead: VertexId) {
    let mut open = vec![lead];
    while let Some(lead) = open.last().copied() {
        match missing(cut, hierarchy, lead) {
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

fn sorted(cut: &VertexCut, hierarchy: &VertexHierarchy) -> Vec<[u32; 3]> {
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
        let mut cut = VertexCut::new(hierarchy);
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
            let mut forwards = VertexCut::new(hierarchy);
            leads.iter().for_each(|lead| split_with_needs(&mut forwards, hierarchy, *lead));
            // All the way and back to the same set.
            let mut back = VertexCut::new(hierarchy);
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

/// What refinement takes of a mesh.
fn vertices(mesh: &Mesh) -> Hierarchy {
    Hierarchy::Vertices(mesh.hierarchy.clone())
}

fn clusters(mesh: &Mesh) -> Hierarchy {
    Hierarchy::Clusters(mesh.clusters.clone())
}

/// The cut of one object, and its hierarchy: of vertices.
fn vertex_cut<'a>(object: &LodObject<'a>, cut: &'a Cut) -> (&'a VertexHierarchy, &'a VertexCut) {
    match (object.hierarchy, cut) {
        (Hierarchy::Vertices(hierarchy), Cut::Vertices(cut)) => (hierarchy, cut),
        _ => panic!("they are of clusters"),
    }
}

fn looking(eye: DVec3) -> LodSight<'static> {
    LodSight { eye, planes: &[], pixels_per_radian: 1000.0, near_m: 0.05 }
}

fn seen_from_all_sides(hierarchy: &Hierarchy) -> LodObject<'_> {
    LodObject {
        id: ObjectId(0),
        hierarchy,
        world_from_local: DAffine3::IDENTITY,
        is_double_sided: true,
        is_solid: true,
        presence: Presence::There,
        weight: 1.0,
    }
}

/// Answers by a rule, and counts how often it was drawn.
struct Told<F> {
    rule: F,
    drawn: usize,
}

impl<F: FnMut(&Hierarchy, StepId) -> Hidden> Occluder for Told<F> {
    fn draw(&mut self, objects: &[LodObject<'_>], cuts: &[Cut]) {
        assert_eq!(objects.len(), cuts.len());
        self.drawn += 1;
    }

    fn hides(&mut self, _object: usize, hierarchy: &Hierarchy, step: StepId) -> Option<Hidden> {
        Some((self.rule)(hierarchy, step))
    }
}

fn told<F: FnMut(&Hierarchy, StepId) -> Hidden>(rule: F) -> Told<F> {
    Told { rule, drawn: 0 }
}

const SOON: [u32; 4] = [30, 60, u32::MAX, u32::MAX];

#[test]
fn random_answers_give_surfaces_within_the_budget() {
    for mesh in [meshes::sphere(16), meshes::torus(40, 24), meshes::hills(30, 25), meshes::seamed_tube(24, 30)] {
        let name = mesh.name;
        let hierarchy = &vertices(&mesh);
        let whole = Surface::of_mesh(&mesh);
        let mut random = Random::new(5);
        let mut refinement = Refinement::new();
        for frame in 0..150 {
            let eye = DVec3::from([(); 3].map(|()| f64::from(random.range(-8.0, 8.0))));
            let normal = DVec3::from([(); 3].map(|()| f64::from(random.range(-1.0, 1.0)))).normalize_or(DVec3::X);
            let planes = [Plane { normal, offset_m: f64::from(random.range(0.0, 2.0)) }];
            let sight = LodSight { planes: &planes, ..looking(eye) };
            let objects = [LodObject {
                id: ObjectId(0),
                hierarchy,
                world_from_local: DAffine3::IDENTITY,
                is_double_sided: random.chance(0.3),
                is_solid: true,
                presence: Presence::There,
                weight: 1.0,
            }];
            let budget = mesh.hierarchy.base().triangles.len() as u32 + random.below(hierarchy.triangle_count() as usize) as u32;
            let least_pixels = random.range(0.0, 4.0);
            let options = LodOptions { budget, least_pixels, occluders: SOON, odd_levels: random.chance(0.5) };
            let seen = random.unit();
            let mut random = random.fork();
            let mut occluder = told(|_, _| match random.unit() {
                unit if unit < seen => Hidden::Nothing,
                _ if random.chance(0.5) => Hidden::Split,
                _ => Hidden::Node,
            });
            refinement.refine(&objects, &sight, &options, Some((&mut occluder, OccluderFrom::ThisFrame)));
            assert!(refinement.triangle_count() <= budget, "{name}, frame {frame}: above the budget");
            let in_sight = if refinement.is_in_sight(0) { refinement.cuts()[0].triangle_count() } else { 0 };
            assert_eq!(refinement.triangle_count(), in_sight);
            let (hierarchy, cut) = vertex_cut(&objects[0], &refinement.cuts()[0]);
            whole.assert_is_coarser(hierarchy, cut, &format!("{name}, frame {frame}"));
        }
    }
}

/// The same of clusters, whose groups come from several: no crack, no triangle above the budget, and the same whatever was found before.
#[test]
fn random_answers_give_clusters_without_cracks() {
    for mesh in [meshes::sphere(22), meshes::torus(90, 60), meshes::painted_torus(80, 60), meshes::hills(90, 60)] {
        let hierarchy = clusters(&mesh);
        let whole = Surface::of_mesh(&mesh);
        let objects = [seen_from_all_sides(&hierarchy)];
        let mut random = Random::new(7);
        let mut refinement = Refinement::new();
        let mut most = 0;
        for frame in 0..60 {
            let what = format!("{}, frame {frame}", mesh.name);
            let eye = DVec3::from([(); 3].map(|()| f64::from(random.range(-8.0, 8.0))));
            let budget = mesh.clusters.root_triangles() + random.below(mesh.clusters.triangle_count() as usize) as u32;
            let options = LodOptions { budget, least_pixels: random.range(0.0, 3.0), occluders: SOON, odd_levels: false };
            let (salt, share) = (random.below(1000) as u32, random.below(6) as u32);
            let mut occluder = told(|_, step| if (step.0 * 7 + salt) % 6 < share { Hidden::Node } else { Hidden::Nothing });
            let mut found = |refinement: &mut Refinement| {
                refinement.refine(&objects, &looking(eye), &options, Some((&mut occluder, OccluderFrom::ThisFrame)));
                let positions = &mesh.clusters.vertices().positions;
                let cut = &refinement.cuts()[0];
                let at: Vec<Vec3> = cut.vertices(&hierarchy).map(|v| Vec3::from(positions[v as usize])).collect();
                let mut triangles: Vec<[Vec3; 3]> =
                    cut.placed_triangles(&hierarchy).map(|t| t.map(|place| at[place as usize])).collect();
                triangles.sort_unstable_by_key(|t| t.map(|p| p.to_array().map(f32::to_bits)));
                triangles
            };
            let triangles = found(&mut refinement);
            assert_eq!(triangles.len(), refinement.triangle_count() as usize, "{what}");
            assert!(refinement.triangle_count() <= budget, "{what}");
            whole.assert_is_whole(&triangles, &what);
            assert!(triangles == found(&mut Refinement::new()), "{what}: it remembers");
            most = most.max(triangles.len());
        }
        assert!(most * 4 > mesh.triangles.len(), "{}: {most} triangles at most", mesh.name);
    }
}

/// Nodes of a wall that joined at different times draw the same.
#[test]
fn what_was_found_before_changes_nothing() {
    let [a, b] = [meshes::torus(60, 40), meshes::hills(50, 40)].map(|mesh| vertices(&mesh));
    let objects = [seen_from_all_sides(&a), seen_from_all_sides(&b)];
    let mut since_long = Refinement::new();
    let mut occluder = told(|_, step| if step.0 % 5 == 0 { Hidden::Split } else { Hidden::Nothing });
    for frame in 0..20 {
        let sight = looking(DVec3::new(5.0 - f64::from(frame) * 0.3, 3.0, 9.0 - f64::from(frame % 7)));
        let options = LodOptions { budget: 1500 + 100 * (frame % 4), occluders: SOON, ..LodOptions::default() };
        since_long.refine(&objects, &sight, &options, Some((&mut occluder, OccluderFrom::ThisFrame)));
        let mut fresh = Refinement::new();
        fresh.refine(&objects, &sight, &options, Some((&mut occluder, OccluderFrom::ThisFrame)));
        for ((object, old), new) in objects.iter().zip(since_long.cuts()).zip(fresh.cuts()) {
            // In the same order, too: the first one wins where triangles coincide.
            let [old, new] = [old, new].map(|cut| vertex_cut(object, cut));
            assert!(old.1.triangles(old.0).eq(new.1.triangles(new.0)), "frame {frame}");
        }
        assert_eq!(since_long.steps(), fresh.steps());
    }
    assert_eq!(occluder.drawn, 120, "two occluders in each of forty refinements, and what was found");
}

/// A frame that renews its occluder finds what it would find if it kept it; and what comes after asks the new one.
#[test]
fn an_occluder_is_renewed_from_what_was_found_with_it() {
    let hierarchy = vertices(&meshes::torus(60, 40));
    let objects = [seen_from_all_sides(&hierarchy)];
    let options = LodOptions { budget: 1500, occluders: SOON, ..LodOptions::default() };
    let [kept, renewed] = [OccluderFrom::EarlierFrame, OccluderFrom::EarlierFrameRenewed].map(|second| {
        let mut occluder = told(|_, step| if step.0 % 5 == 0 { Hidden::Split } else { Hidden::Nothing });
        let mut refinement = Refinement::new();
        let mut frame = |distance_m, from| {
            let sight = looking(DVec3::new(5.0, 3.0, distance_m));
            refinement.refine(&objects, &sight, &options, Some((&mut occluder, from)));
            let (hierarchy, cut) = vertex_cut(&objects[0], &refinement.cuts()[0]);
            (sorted(cut, hierarchy), refinement.question_count())
        };
        frame(9.0, OccluderFrom::ThisFrame);
        let found = frame(8.9, second);
        let (after, questions) = frame(8.9, OccluderFrom::EarlierFrame);
        assert_eq!(after, found.0, "the answers are the same ones");
        (found, questions, occluder.drawn)
    });
    assert_eq!(kept.0, renewed.0);
    assert_eq!((kept.1, kept.2), (0, 3));
    assert!(renewed.1 > 0 && renewed.2 == 4, "{} questions, drawn {} times", renewed.1, renewed.2);
}

#[test]
fn a_budget_is_used_and_never_exceeded() {
    let [a, b] = [meshes::torus(60, 40), meshes::hills(50, 40)].map(|mesh| vertices(&mesh));
    let objects = [seen_from_all_sides(&a), seen_from_all_sides(&b)];
    let base: usize = objects.iter().map(|object| Cut::new(object.hierarchy).placed_triangles(object.hierarchy).count()).sum();
    let all: u32 = objects.iter().map(|object| object.hierarchy.triangle_count()).sum();
    let mut refinement = Refinement::new();
    // Two thirds are hidden; and all.
    let mut occluders = [Hidden::Nothing, Hidden::Node].map(|first| {
        told(move |_, step: StepId| match step.0 % 3 {
            0 => first,
            1 => Hidden::Node,
            _ => Hidden::Split,
        })
    });
    let mut check = |budget: u32| {
        let options = LodOptions { budget, occluders: SOON, ..LodOptions::default() };
        let way = (budget / 97) as usize % 3;
        let occluder = occluders.get_mut(way).map(|occluder| (occluder as &mut dyn Occluder, OccluderFrom::ThisFrame));
        let is_asked = occluder.is_some();
        refinement.refine(&objects, &looking(DVec3::new(9.0, 2.0, 5.0)), &options, occluder);
        assert_eq!(refinement.question_count() > 0 && refinement.hidden_share() > 0.0, is_asked && refinement.steps() >= SOON[0]);
        let drawn: usize =
            objects.iter().zip(refinement.cuts()).map(|(object, cut)| cut.placed_triangles(object.hierarchy).count()).sum();
        assert_eq!(drawn, refinement.triangle_count() as usize);
        assert!(drawn <= budget as usize, "{drawn} of {budget}");
        let least = budget.min(all) as usize;
        assert!(drawn * 100 >= least * 99 || drawn + 1 >= least, "{drawn} of {least}");
    };
    (base as u32..all + 300).step_by(97).for_each(&mut check);
    // A smaller one than the last.
    check(base as u32 + 100);
}

/// With more bases than a budget has triangles for, what is small is left out, and nothing is counted for what is out of sight.
#[test]
fn where_bases_are_too_many_the_smallest_are_left_out() {
    const NEAR: usize = 5;
    let mesh = meshes::torus(40, 24);
    let base = mesh.hierarchy.base().triangles.len() as u32;
    let hierarchy = vertices(&mesh);
    // Each farther away than the one before, and the last behind the eye.
    let place = |z: f64| DAffine3::from_translation(DVec3::new(0.0, 0.0, z));
    let objects: Vec<LodObject<'_>> = [-10.0, -20.0, -30.0, -40.0, -50.0, 20.0]
        .map(|z| LodObject { world_from_local: place(z), ..seen_from_all_sides(&hierarchy) })
        .to_vec();
    let planes = [Plane { normal: DVec3::NEG_Z, offset_m: 0.0 }];
    let sight = LodSight { planes: &planes, ..looking(DVec3::ZERO) };
    let mut refinement = Refinement::new();
    for budget in (0..base * 8).step_by(base as usize / 3) {
        refinement.refine(&objects, &sight, &LodOptions { budget, ..LodOptions::default() }, None);
        let drawn: Vec<u32> = refinement.cuts().iter().map(|cut| cut.triangle_count()).collect();
        let there = NEAR.min((budget / base) as usize);
        assert!(drawn[..there].iter().all(|triangles| *triangles >= base), "{drawn:?} of {budget}");
        assert!(drawn[there..NEAR].iter().all(|triangles| *triangles == 0), "{drawn:?} of {budget}");
        assert_eq!(drawn[NEAR], base, "it is as coarse as it may be");
        assert_eq!(refinement.triangle_count(), drawn[..NEAR].iter().sum::<u32>());
        assert!(refinement.triangle_count() <= budget);
        for ((object, cut), count) in objects.iter().zip(refinement.cuts()).zip(&drawn) {
            assert_eq!(cut.placed_triangles(object.hierarchy).count(), *count as usize);
        }
    }
}

/// What lies below the plane y = 0 is hidden: triangles go above it.
#[test]
fn hidden_parts_stay_coarse() {
    let mesh = meshes::sphere(40);
    let hierarchy = vertices(&mesh);
    let objects = [seen_from_all_sides(&hierarchy)];
    let options = LodOptions { budget: 1200, occluders: [50, 300, u32::MAX, u32::MAX], ..LodOptions::default() };
    let above = |refinement: &Refinement| {
        let (hierarchy, cut) = vertex_cut(&objects[0], &refinement.cuts()[0]);
        let is_above = |t: &[VertexId; 3]| t.iter().any(|v| hierarchy.position(*v).y > 0.0);
        cut.triangles(hierarchy).filter(is_above).count() as f32 / refinement.triangle_count() as f32
    };
    let sight = looking(DVec3::new(0.0, 0.0, 50.0));
    let mut refinement = Refinement::new();
    refinement.refine(&objects, &sight, &options, None);
    let without = above(&refinement);
    assert_eq!(refinement.question_count(), 0);
    let mut occluder = told(|_, step| {
        let bounds = mesh.hierarchy.bounds(step.lead());
        if bounds.center.y + bounds.extent.half_box.y > 0.0 { Hidden::Nothing } else { Hidden::Node }
    });
    let mut asked = Vec::new();
    for odd_levels in [false, true] {
        refinement.refine(
            &objects,
            &sight,
            &LodOptions { odd_levels, ..options },
            Some((&mut occluder, OccluderFrom::ThisFrame)),
        );
        let (with, questions) = (above(&refinement), refinement.question_count());
        assert!(without < 0.6 && with > 0.68, "{without} of the triangles without questions, {with} with {questions}");
        assert!(questions > 50 && questions < refinement.steps() * 2, "{questions} for {} steps", refinement.steps());
        asked.push(questions);
    }
    assert!(asked[1] * 10 < asked[0] * 8, "at odd levels alone it asks less: {asked:?}");
}

/// Hides every other step from its first picture, and nothing from later ones.
#[derive(Default)]
struct Clearing {
    drawn: u32,
}

impl Occluder for Clearing {
    fn draw(&mut self, _objects: &[LodObject<'_>], _cuts: &[Cut]) {
        self.drawn += 1;
    }

    fn hides(&mut self, _object: usize, _hierarchy: &Hierarchy, step: StepId) -> Option<Hidden> {
        Some(if self.drawn == 1 && step.0.is_multiple_of(2) { Hidden::Node } else { Hidden::Nothing })
    }
}

#[test]
fn what_an_occluder_hid_is_asked_about_again_after_its_update() {
    let hierarchy = vertices(&meshes::torus(60, 40));
    let objects = [seen_from_all_sides(&hierarchy)];
    // As good as can be, however many triangles that takes: nothing gets what is left of a budget.
    let found = |occluders: [u32; 4]| {
        let options = LodOptions { budget: u32::MAX, least_pixels: f32::MIN_POSITIVE, occluders, ..LodOptions::default() };
        let mut refinement = Refinement::new();
        let occluder = (&mut Clearing::default() as &mut dyn Occluder, OccluderFrom::ThisFrameAlone);
        refinement.refine(&objects, &looking(DVec3::new(9.0, 2.0, 5.0)), &options, Some(occluder));
        refinement.triangle_count()
    };
    let all = hierarchy.triangle_count();
    let once = found([100, u32::MAX, u32::MAX, u32::MAX]);
    assert!(once < all * 9 / 10, "{once} of {all}: much stays hidden");
    assert_eq!(found([100, 200, u32::MAX, u32::MAX]), all);
}

/// Far above, the mesh is what it was; the last block may be missing.
#[test]
fn a_hierarchy_that_has_not_arrived_is_drawn_as_far_as_it_is_there() {
    let mesh = meshes::torus(40, 24);
    let whole = Surface::of_mesh(&mesh);
    let mut growing: Option<Hierarchy> = None;
    let mut refinement = Refinement::new();
    let options = LodOptions { budget: u32::MAX, ..LodOptions::default() };
    let mut last = 0;
    for blob in &mesh.blobs {
        match &mut growing {
            None => growing = Some(Hierarchy::decode_base(blob, 8).expect("a base")),
            Some(hierarchy) => hierarchy.decode_block(blob).expect("a block"),
        }
        let hierarchy = growing.as_ref().expect("it has begun");
        let objects = [seen_from_all_sides(hierarchy)];
        refinement.refine(&objects, &looking(DVec3::new(5.0, 3.0, 9.0)), &options, None);
        assert_eq!(refinement.triangle_count(), hierarchy.triangle_count());
        assert!(refinement.triangle_count() > last);
        last = refinement.triangle_count();
        let (hierarchy, cut) = vertex_cut(&objects[0], &refinement.cuts()[0]);
        whole.assert_is_coarser(hierarchy, cut, "as far as it is there");
    }
    assert_eq!(last, mesh.hierarchy.triangle_count());
}

/// Frames take no memory once buffers have grown.
#[test]
fn frames_take_no_memory() {
    let [a, b] = [meshes::torus(60, 40), meshes::hills(50, 40)].map(|mesh| vertices(&mesh));
    let objects = [seen_from_all_sides(&a), seen_from_all_sides(&b)];
    let options = LodOptions { budget: 1800, occluders: SOON, ..LodOptions::default() };
    let corners = [DVec3::new(-1.0, -1.0, -1.0), DVec3::new(1.0, -1.0, -1.0), DVec3::new(-1.0, 1.0, -1.0)];
    let mut occluder = DepthOccluder::new([64, 64], BoundsKind::Link);
    let mut refinement = Refinement::new();
    let mut frame = |number: u32| {
        let eye = DVec3::new(5.0 + f64::from(number % 4), 3.0, 9.0);
        let world_from_room = DAffine3::from_translation(eye);
        occluder.look(&Projection::through_rectangle(DVec3::ZERO, corners, 0.1, &world_from_room));
        refinement.refine(&objects, &looking(eye), &options, Some((&mut occluder, OccluderFrom::ThisFrame)));
    };
    (0..24).for_each(&mut frame);
    let counted = allocation_counter::measure(|| (0..8).for_each(&mut frame));
    assert_eq!(counted.count_total, 0);
}
