//! Goal: what objects weigh is what is seen of them, whoever asks and whenever. Method: spheres before spheres, which are alike otherwise.

use std::ops::Range;

use glam::{DAffine3, DVec3};
use mullion_client::lod::{
    BoundsKind, DepthOccluder, KeptOccluder, LodObject, LodOptions, LodSight, Refinement, Tessellated, Weigher,
};
use mullion_common::geometry::Frustum;
use mullion_common::scene::{Hierarchy, LodForm, ObjectId, Package};
use mullion_common::wall::Projection;
use mullion_common::wire::DetailWeight;

use super::{SOON, looking, meshes, seen_from_all_sides, vertices};

const NEAR_M: f64 = 0.05;
/// More than 75 degrees wide and high.
const CORNERS: [DVec3; 3] = [DVec3::new(-1.0, -0.75, -1.0), DVec3::new(1.0, -0.75, -1.0), DVec3::new(-1.0, 0.75, -1.0)];
const BUDGET: u32 = 3000;

/// Shows objects from the origin in some frames: triangles of the first two.
fn show(
    objects: &[LodObject<'_>],
    frames: Range<u64>,
    (weight, tessellated): (DetailWeight, Option<Tessellated<'_>>),
) -> Vec<[u32; 2]> {
    let projection = Projection::through_rectangle(DVec3::ZERO, CORNERS, NEAR_M, &DAffine3::IDENTITY);
    let options = LodOptions { budget: BUDGET, occluders: SOON, ..LodOptions::default() };
    let mut occluder = KeptOccluder::new(DepthOccluder::new([256; 2], BoundsKind::Link));
    let mut refinement = Refinement::new();
    let drawn = |frame: u64| {
        let (sight, mut objects) = (looking(DVec3::ZERO), objects.to_vec());
        let view = (&projection, frame);
        occluder.refine(&mut refinement, &mut objects, (&sight, &options), view, (weight, tessellated));
        [0, 1].map(|at: usize| refinement.cuts()[at].triangle_count())
    };
    frames.map(drawn).collect()
}

fn share([whole, half]: [u32; 2]) -> f64 {
    f64::from(half) / f64::from(whole)
}

/// Objects that stand in a scene of their own, in the order of their places.
struct Scene {
    package: Package,
    hierarchies: Vec<Hierarchy>,
    places: Vec<DVec3>,
}

impl Scene {
    fn new(places: &[(u32, DVec3)]) -> Self {
        let spheres: Vec<_> = places.iter().map(|(side, _)| meshes::sphere(*side)).collect();
        let placed: Vec<_> = spheres.iter().zip(places).map(|(mesh, (_, at))| (mesh, *at)).collect();
        let package = meshes::scene(&placed);
        let table = package.scene.hierarchies.of(LodForm::Vertices).expect("it has some");
        let hierarchies = (0..table.entries().len()).map(|at| table.decode(at, &package.scene.manifest).expect("a hierarchy"));
        Self { hierarchies: hierarchies.collect(), places: places.iter().map(|(_, at)| *at).collect(), package }
    }

    fn tessellated(&self) -> Tessellated<'_> {
        let scene = &self.package.scene;
        Tessellated { tessellation: scene.tessellation.as_ref().expect("it has one"), scene: &scene.manifest }
    }

    fn objects(&self) -> Vec<LodObject<'_>> {
        let table = self.package.scene.hierarchies.of(LodForm::Vertices).expect("it has some");
        let transforms = &self.package.scene.manifest.transforms;
        let object = |at: &DVec3| {
            let number = transforms.iter().position(|transform| transform.affine().translation == *at).expect("it stands there");
            let id = ObjectId(number as u32);
            let of = table.entries().iter().position(|entry| entry.objects.contains(&id)).expect("it has one");
            LodObject {
                id,
                world_from_local: transforms[number].affine(),
                is_double_sided: false,
                ..seen_from_all_sides(&self.hierarchies[of])
            }
        };
        self.places.iter().map(object).collect()
    }

    /// What a weigher finds from an eye that looks along −Z.
    fn shares(&self, weigher: &mut Weigher, eye: DVec3, objects: &[LodObject<'_>]) -> Vec<Option<f32>> {
        let frustum = Frustum::through_rectangle(eye, CORNERS.map(|corner| eye + corner), NEAR_M);
        weigher.weigh(self.tessellated(), &LodSight { planes: &frustum.planes, ..looking(eye) }, objects).collect()
    }
}

/// An object that is seen less gets less of a budget; with triangles enough for all, all are as good as they should be.
#[test]
fn a_budget_goes_where_more_is_seen() {
    let mesh = meshes::torus(60, 40);
    let hierarchy = vertices(&mesh);
    let place = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.0, -12.0));
    let objects = [(-3.0, 1.0), (3.0, 0.25)].map(|(x, weight)| {
        let object = seen_from_all_sides(&hierarchy);
        LodObject { world_from_local: place(x), weight, ..object }
    });
    let sight = looking(DVec3::ZERO);
    let mut refinement = Refinement::new();
    let mut drawn = |options: &LodOptions| {
        refinement.refine(&objects, &sight, options, None);
        [0, 1].map(|at: usize| refinement.cuts()[at].triangle_count())
    };
    let [more, less] = drawn(&LodOptions { budget: 2500, ..LodOptions::default() });
    assert!(less * 2 < more && more + less > 2475, "{more}, {less}");
    let [a, b] = drawn(&LodOptions { budget: u32::MAX, least_pixels: 4.0, ..LodOptions::default() });
    assert!(a < mesh.hierarchy.triangle_count() && a.abs_diff(b) * 20 < a, "{a}, {b}");
}

/// Of two that are alike a sphere stands before one half of one. By what is seen that gets less of a budget, in the frame that draws the
/// occluder and in those that keep it, whoever comes late.
#[test]
fn less_of_a_budget_goes_where_half_is_hidden() {
    let (torus, sphere) = (vertices(&meshes::torus(60, 40)), vertices(&meshes::sphere(16)));
    let place = |hierarchy, x: f64, z: f64| LodObject {
        world_from_local: DAffine3::from_translation(DVec3::new(x, 0.0, z)),
        ..seen_from_all_sides(hierarchy)
    };
    let objects = [place(&torus, -2.5, -12.0), place(&torus, 2.5, -12.0), place(&sphere, 1.7, -5.0)];
    let show = |frames, weight| show(&objects, frames, (weight, None));
    let (alike, weighed) = (show(0..1, DetailWeight::None), show(0..20, DetailWeight::Nohc));
    assert!(share(weighed[0]) < 0.8 * share(alike[0]), "{:?}, {:?}", weighed[0], alike[0]);
    assert!(weighed.iter().all(|frame| *frame == weighed[0]), "{weighed:?}");
    assert_eq!(show(5..7, DetailWeight::Nohc), weighed[..2]);
    assert_eq!(show(0..20, DetailWeight::Plp), show(0..20, DetailWeight::None), "there is no tessellation");
}

/// The same by an estimate. Whoever comes late agrees from the next turn of the occluder on.
#[test]
fn less_of_a_budget_goes_where_an_estimate_sees_less() {
    const TURN: usize = 64;
    let scene =
        Scene::new(&[(24, DVec3::new(-7.0, 0.2, -14.0)), (24, DVec3::new(7.0, 0.2, -14.0)), (16, DVec3::new(1.5, 0.1, -7.0))]);
    let show = |frames, weight| show(&scene.objects(), frames, (weight, Some(scene.tessellated())));
    let (alike, weighed) = (show(0..1, DetailWeight::None), show(0..TURN as u64 + 3, DetailWeight::Plp));
    assert!(share(weighed[0]) < 0.9 * share(alike[0]), "{:?}, {:?}", weighed[0], alike[0]);
    assert!(share(weighed[1]) < 0.9 * share(alike[0]), "{:?}, {:?}", weighed[1], alike[0]);
    let late = show(9..TURN as u64 + 3, DetailWeight::Plp);
    assert_eq!(late[TURN - 9..], weighed[TURN..]);
}

/// In the open, behind another, and beside the view; and who stands elsewhere than the tessellation knows.
#[test]
fn an_estimate_sees_what_stands_in_front() {
    let places = [
        (24, DVec3::new(-4.0, 0.2, -14.0)),
        (24, DVec3::new(4.0, 0.2, -14.0)),
        (16, DVec3::new(2.0, 0.1, -7.0)),
        (16, DVec3::new(60.0, 0.1, -9.0)),
    ];
    let scene = Scene::new(&places);
    let mut objects = scene.objects();
    let mut weigher = Weigher::default();
    let shares = scene.shares(&mut weigher, DVec3::ZERO, &objects);
    let [Some(open), Some(behind), Some(front), None] = shares[..] else { panic!("{shares:?}") };
    assert!(open > 0.5 && front > 0.5 && behind < 0.5 * open, "{shares:?}");
    assert!([open, behind, front].iter().all(|share| (0.0..=1.0).contains(share)), "{shares:?}");
    // From the other side, and back: the same, whatever was asked before, and of whom.
    let turned = scene.shares(&mut weigher, DVec3::new(0.0, 0.0, -22.0), &objects);
    assert_ne!(turned, shares);
    assert_eq!(scene.shares(&mut weigher, DVec3::ZERO, &objects), shares);
    assert_eq!(scene.shares(&mut Weigher::default(), DVec3::ZERO, &objects[1..]), shares[1..]);
    objects[1].world_from_local.translation.y += 0.5;
    objects[2].id = ObjectId(99);
    assert_eq!(scene.shares(&mut weigher, DVec3::ZERO, &objects), [shares[0], None, None, None]);
}

/// What hides nothing is drawn as an occluder once in a long time. Weights do not wait for that: another view has its own at once, and so does
/// another way to weigh.
#[test]
fn weights_are_those_of_the_view() {
    let places = [(24, DVec3::new(1.0, 0.2, -14.0)), (24, DVec3::new(-1.0, 0.1, -7.0)), (24, DVec3::new(0.0, 0.1, -20.0))];
    let scene = Scene::new(&places);
    let ahead = (DVec3::ZERO, DAffine3::IDENTITY);
    let back = (DVec3::new(0.0, 0.0, -27.0), DAffine3::from_rotation_y(std::f64::consts::PI));
    let options = LodOptions { budget: BUDGET, occluders: SOON, ..LodOptions::default() };
    let show = |frames: &[((DVec3, DAffine3), DetailWeight)]| {
        let mut occluder = KeptOccluder::new(DepthOccluder::new([256; 2], BoundsKind::Link));
        let mut refinement = Refinement::new();
        for (frame, ((eye, turned), weight)) in (3..).zip(frames) {
            let mut objects = scene.objects();
            objects.iter_mut().for_each(|object| object.is_solid = false);
            let room = DAffine3::from_translation(*eye) * *turned;
            let projection = Projection::through_rectangle(DVec3::ZERO, CORNERS, NEAR_M, &room);
            let tessellated = Some(scene.tessellated());
            occluder.refine(
                &mut refinement,
                &mut objects,
                (&looking(*eye), &options),
                (&projection, frame),
                (*weight, tessellated),
            );
        }
        [0, 1, 2].map(|at: usize| refinement.cuts()[at].triangle_count())
    };
    let (plp, none) = (DetailWeight::Plp, DetailWeight::None);
    let [from_ahead, from_back] = [show(&[(ahead, plp)]), show(&[(back, plp)])];
    assert!(from_ahead[1] > from_ahead[2] && from_back[1] < from_back[2], "{from_ahead:?}, {from_back:?}");
    assert_eq!(show(&[(ahead, plp), (ahead, plp), (back, plp)]), from_back);
    assert_eq!(show(&[(back, none), (back, none), (back, plp)]), from_back);
}

/// Turns take no memory once buffers have grown.
#[test]
fn weighing_takes_no_memory() {
    let scene = Scene::new(&[(16, DVec3::new(-4.0, 0.2, -14.0)), (16, DVec3::new(2.0, 0.1, -7.0))]);
    let (objects, mut weigher) = (scene.objects(), Weigher::default());
    let mut weigh = |number: u32| {
        let sight = looking(DVec3::X * f64::from(number % 4));
        weigher.weigh(scene.tessellated(), &sight, &objects).flatten().sum::<f32>()
    };
    assert!((0..8).map(&mut weigh).sum::<f32>() > 0.0);
    let counted = allocation_counter::measure(|| assert!((0..8).map(&mut weigh).sum::<f32>() > 0.0));
    assert_eq!(counted.count_total, 0);
}
