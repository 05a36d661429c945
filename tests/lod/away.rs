//! Goal: what is away is as if it had never been there, from the frame in which it goes on. Method: objects before each other, of which some go
//! and come back, held against others that never were.

use glam::{DAffine3, DVec3};
use mullion_client::lod::{BoundsKind, DepthOccluder, KeptOccluder, LodObject, LodOptions, Refinement};
use mullion_common::scene::{Hierarchy, Presence};
use mullion_common::wall::Projection;
use mullion_common::wire::DetailWeight;

use super::{SOON, looking, meshes, seen_from_all_sides, vertices};

const CORNERS: [DVec3; 3] = [DVec3::new(-1.0, -0.75, -1.0), DVec3::new(1.0, -0.75, -1.0), DVec3::new(-1.0, 0.75, -1.0)];
const BUDGET: u32 = 3000;

pub fn place(hierarchy: &Hierarchy, x: f64, z: f64) -> LodObject<'_> {
    LodObject { world_from_local: DAffine3::from_translation(DVec3::new(x, 0.1, z)), ..seen_from_all_sides(hierarchy) }
}

/// One node's refinement.
pub struct Node {
    pub occluder: KeptOccluder,
    refinement: Refinement,
    weight: DetailWeight,
}

impl Node {
    pub fn new(weight: DetailWeight) -> Self {
        let occluder = KeptOccluder::new(DepthOccluder::new([256; 2], BoundsKind::Link));
        Self { occluder, refinement: Refinement::new(), weight }
    }

    /// Triangles of each object, seen from the origin, and whether the occluder was drawn.
    pub fn frame(&mut self, number: u64, objects: &[LodObject<'_>]) -> (Vec<u32>, bool) {
        self.frame_from(number, DVec3::ZERO, objects)
    }

    /// The same, seen from elsewhere.
    pub fn frame_from(&mut self, number: u64, eye: DVec3, objects: &[LodObject<'_>]) -> (Vec<u32>, bool) {
        let projection = Projection::through_rectangle(DVec3::ZERO, CORNERS, 0.05, &DAffine3::from_translation(eye));
        let options = LodOptions { budget: BUDGET, occluders: SOON, ..LodOptions::default() };
        let (sight, mut objects) = (looking(eye), objects.to_vec());
        let view = (&projection, number);
        let is_drawn = self.occluder.refine(&mut self.refinement, &mut objects, (&sight, &options), view, (self.weight, None));
        (self.refinement.cuts().iter().map(|cut| cut.triangle_count()).collect(), is_drawn)
    }
}

#[test]
fn what_is_away_spends_no_budget() {
    let mesh = meshes::torus(60, 40);
    for hierarchy in [vertices(&mesh), Hierarchy::Clusters(meshes::torus(60, 40).clusters)] {
        let mut objects = [place(&hierarchy, -2.5, -12.0), place(&hierarchy, 2.5, -9.0)];
        let options = LodOptions { budget: BUDGET, ..LodOptions::default() };
        let (mut alone, mut refinement) = (Refinement::new(), Refinement::new());
        alone.refine(&objects[..1], &looking(DVec3::ZERO), &options, None);
        let mut counts = |objects: &[LodObject<'_>]| {
            refinement.refine(objects, &looking(DVec3::ZERO), &options, None);
            let counts = [0, 1].map(|at: usize| refinement.cuts()[at].triangle_count());
            (counts, refinement.triangle_count(), refinement.is_in_sight(1))
        };
        let both = counts(&objects);
        objects[1].presence = Presence::Away;
        let of_one = alone.triangle_count();
        assert!(both.0[0] * 2 < of_one, "{both:?} of {of_one}");
        assert_eq!(counts(&objects), ([of_one, 0], of_one, false));
        objects[1].presence = Presence::There;
        assert_eq!(counts(&objects), both);
    }
}

/// A torus behind a sphere that goes between two turns of the occluder, and comes back.
#[test]
fn what_goes_away_hides_nothing_from_that_frame_on() {
    let (torus, sphere) = (vertices(&meshes::torus(60, 40)), vertices(&meshes::sphere(16)));
    let there = [place(&torus, 1.0, -12.0), place(&torus, -5.0, -12.0), place(&sphere, 0.4, -5.0)];
    let mut gone = there;
    gone[2].presence = Presence::Away;
    for weight in [DetailWeight::None, DetailWeight::Nohc] {
        let (mut node, mut late, mut never) = (Node::new(weight), Node::new(weight), Node::new(weight));
        let [first, kept] = [0, 1].map(|number| node.frame(number, &there));
        assert!(first.1 && !kept.1, "{weight}");
        let without = [2, 3].map(|number| node.frame(number, &gone));
        assert_eq!(without, [2, 3].map(|number| late.frame(number, &gone)), "{weight}: whoever comes late");
        assert!(without[0].1 && !without[1].1, "{weight}: once");
        for ((drawn, _), number) in without.iter().zip(2..) {
            assert!(drawn[0] > kept.0[0] && drawn[2] == 0, "{weight}: {drawn:?}, {kept:?} before");
            assert_eq!(never.frame(number, &there[..2]).0, drawn[..2], "{weight}: as if it had never been there");
        }
        // Back again it has its triangles at once, and hides once the occluder is drawn anew or renewed.
        let (back, is_drawn) = node.frame(4, &there);
        assert!(back[2] > 0 && !is_drawn, "{weight}: {back:?}");
        let turn = (5..=64).find(|number| node.frame(*number, &there).1).expect("it has a turn");
        assert_eq!(node.frame(turn + 1, &there), kept, "{weight}");
    }
}

/// A renewed occluder has what has come since it was drawn: that hides from there on, and is outdated when it goes.
#[test]
fn what_has_come_hides_once_the_occluder_is_renewed() {
    let (torus, sphere) = (vertices(&meshes::torus(60, 40)), vertices(&meshes::sphere(16)));
    let there = [place(&torus, 1.0, -12.0), place(&torus, -5.0, -12.0), place(&sphere, 0.4, -5.0)];
    let mut gone = there;
    gone[2].presence = Presence::Away;
    let mut node = Node::new(DetailWeight::None);
    assert!(node.frame(0, &gone).1);
    let before = node.frame(15, &there);
    let renewed = node.frame(16, &there);
    assert_eq!(renewed, before, "it asks what it has");
    let (after, is_drawn) = node.frame(17, &there);
    assert!(after[0] < before.0[0] && !is_drawn, "{after:?}, {before:?} before");
    assert!(node.frame(20, &gone).1, "it is in the picture");
    node.occluder.draw_anew();
    assert!(node.frame(21, &gone).1, "whatever the frame");
}

/// One with holes was never in the picture: that stays when it goes.
#[test]
fn what_hid_nothing_goes_without_a_turn() {
    let sphere = vertices(&meshes::sphere(16));
    let mut objects = [place(&sphere, -2.0, -6.0), place(&sphere, 2.0, -6.0)];
    objects[1].is_solid = false;
    let mut node = Node::new(DetailWeight::Nohc);
    node.frame(0, &objects);
    objects[1].presence = Presence::Away;
    assert!(!node.frame(1, &objects).1, "it was not in the picture");
}

/// Objects come, go and move, and the eye jumps, without memory once buffers have grown; with a budget that has something left for what is hidden, too.
#[test]
fn coming_and_going_takes_no_memory() {
    let (torus, sphere) = (vertices(&meshes::torus(60, 40)), vertices(&meshes::sphere(16)));
    for (weight, away_every) in [(DetailWeight::Nohc, 2), (DetailWeight::None, 2), (DetailWeight::None, 40)] {
        let mut objects = [place(&torus, 1.0, -12.0), place(&sphere, 0.4, -5.0)];
        let mut node = Node::new(weight);
        let mut frame = |number: u64| {
            let eye = DVec3::X * if number % 35 < 3 { 9.0 } else { 0.0 };
            let projection = Projection::through_rectangle(DVec3::ZERO, CORNERS, 0.05, &DAffine3::from_translation(eye));
            let budget = if number % 14 < 2 { 40_000 } else { BUDGET };
            let options = LodOptions { budget, occluders: SOON, ..LodOptions::default() };
            objects[0].world_from_local.translation.y = (number % 7) as f64;
            objects[1].presence = if number % away_every != 1 { Presence::There } else { Presence::Away };
            let view = (&projection, number);
            let sight = looking(eye);
            node.occluder.refine(&mut node.refinement, &mut objects, (&sight, &options), view, (weight, None));
        };
        (0..140).for_each(&mut frame);
        let counted = allocation_counter::measure(|| (140..280).for_each(&mut frame));
        assert_eq!(counted.count_total, 0, "{weight}, away every {away_every} frames");
    }
}
