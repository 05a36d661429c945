//! Goal: what is fetched ahead comes in the right order, within its share, and once.
//! Method: small scenes whose chunks arrive at once or in random order, against a list sorted by the rule.

use glam::{DMat3, DQuat};
use mullion_common::scene::{
    AlphaMode, ChunkHash, Filter, LeafRecord, Material, MaterialId, ObjectId, SceneManifest, TextureRef, Transform, Wrap,
};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Eye, ObserverId, TileId, ViewId};
use proptest::prelude::*;

use super::*;
use crate::motion::Motion;

/// A leaf of 1 × 2 × 3 m at each place, each with a chunk of `length` bytes; chunk 0 is a texture that every third leaf has.
fn scene(places: &[DVec3], length: u32) -> SceneManifest {
    let record = |kind, i: usize, length| ChunkRecord::new(ChunkHash([i as u8; 32]), 0, length, kind);
    let texture = TextureRef { chunk: ChunkId(0), wrap_u: Wrap::Repeat, wrap_v: Wrap::Clamp, filter: Filter::Linear };
    let material = |texture| Material { base_color: [1.0; 4], texture, alpha: AlphaMode::Opaque, double_sided: false };
    let leaf = |i: usize| LeafRecord {
        object: ObjectId(i as u32),
        chunk: ChunkId(i as u32 + 1),
        material: MaterialId((i % 3 / 2) as u32),
        triangle_count: 1,
        local_min: [-0.5, -1.0, -1.5],
        local_max: [0.5, 1.0, 1.5],
    };
    let geometry = (1..=places.len()).map(|i| record(ChunkKind::Geometry, i, length));
    SceneManifest {
        transforms: places.iter().map(|place| Transform::from(DAffine3::from_translation(*place))).collect(),
        leaves: (0..places.len()).map(leaf).collect(),
        materials: vec![material(None), material(Some(texture))],
        chunks: std::iter::once(record(ChunkKind::Texture, 0, length)).chain(geometry).collect(),
    }
}

/// A node whose blobs arrive when it is told so.
struct Node<'a> {
    manifest: &'a SceneManifest,
    residency: Residency,
    prefetch: Prefetch,
    on_the_way: Vec<(ChunkId, u64)>,
}

impl<'a> Node<'a> {
    fn new(manifest: &'a SceneManifest, cap_bytes: u64) -> Self {
        let count = manifest.chunks.len();
        let mut node = Self {
            manifest,
            residency: Residency::new(count, cap_bytes),
            prefetch: Prefetch::new(count),
            on_the_way: Vec::new(),
        };
        node.see(&VisibleSet::default());
        node
    }

    fn known(&self) -> Known<'_> {
        Known { manifest: self.manifest, transforms: &self.manifest.transforms, hierarchies: None, residency: &self.residency }
    }

    /// A frame that needs these leaves, all of whose chunks come at once.
    fn see(&mut self, set: &VisibleSet) {
        let (mut missing, mut gone) = (Vec::new(), Vec::new());
        let transforms = &self.manifest.transforms;
        self.residency.begin_frame(self.manifest, transforms, None, std::iter::once(set), DVec3::ZERO, &mut missing);
        for chunk in missing {
            self.residency.loaded(chunk, self.length(chunk));
        }
        self.residency.evict(&mut gone);
        if !gone.is_empty() {
            self.prefetch.look_again();
        }
    }

    fn length(&self, chunk: ChunkId) -> u64 {
        u64::from(self.manifest.chunks[chunk.0 as usize].length)
    }

    fn load(&self) -> Load {
        let bytes = self.on_the_way.iter().map(|(chunk, _)| self.length(*chunk)).sum();
        Load { count: self.on_the_way.len(), bytes, room: self.on_the_way.iter().map(|(_, room)| room).sum() }
    }

    fn look(&mut self, aim: &Aim) {
        let known = Known {
            manifest: self.manifest,
            transforms: &self.manifest.transforms,
            hierarchies: None,
            residency: &self.residency,
        };
        self.prefetch.look(aim, known);
    }

    /// Asks for as much as it may; gives what it asked for.
    fn ask(&mut self) -> Vec<ChunkId> {
        let mut asked = Vec::new();
        loop {
            let load = self.load();
            let held: Vec<ChunkHash> = self.on_the_way.iter().map(|(c, _)| self.manifest.chunks[c.0 as usize].hash).collect();
            let known = Known {
                manifest: self.manifest,
                transforms: &self.manifest.transforms,
                hierarchies: None,
                residency: &self.residency,
            };
            let Some((chunk, room)) = self.prefetch.next(known, &load, |record| held.contains(&record.hash)) else { break };
            self.on_the_way.push((chunk, room));
            asked.push(chunk);
        }
        asked
    }

    fn arrive(&mut self, at: usize) {
        let (chunk, _) = self.on_the_way.swap_remove(at);
        self.residency.loaded(chunk, self.length(chunk));
    }

    /// Frames in which all that was asked for comes at once, until nothing more is asked for; gives the order.
    fn run(&mut self, aim: &Aim) -> Vec<ChunkId> {
        let mut order = Vec::new();
        loop {
            let before = order.len();
            for _ in 0..4 {
                self.look(aim);
                order.extend(self.ask());
                while !self.on_the_way.is_empty() {
                    self.arrive(0);
                }
            }
            if order.len() == before {
                return order;
            }
        }
    }
}

fn straight(eye: DVec3, axis: DVec3) -> Aim {
    Aim { eye, axis, cos_half_angle: 0.5 }
}

fn view(corners: [[f64; 3]; 3]) -> ViewSpec {
    let (view, tile, observer) = (ViewId(0), TileId(0), ObserverId(0));
    ViewSpec { view, tile, tile_name: "t".into(), observer, eye: Eye::Mono, corners, size_px: [64, 48], near_m: 0.05 }
}

#[test]
fn what_the_motion_will_show_comes_first_and_then_what_is_near() {
    // Leaves along the x axis, at x = 2, −2, 4, −4, …; the camera looks along +x and walks there at 5 m/s.
    let places: Vec<DVec3> = (0..40).map(|i| DVec3::X * f64::from((i / 2 + 1) * 2 * (1 - i % 2 * 2))).collect();
    let manifest = scene(&places, 10);
    let mut motion = Motion::default();
    for frame in 0..30 {
        motion.note(frame, 60.0, DVec3::X * (frame as f64 / 60.0 * 5.0), &DAffine3::IDENTITY);
    }
    let pose = motion.ahead(AHEAD_S, 60.0).unwrap();
    let aim = Aim::through(&[view([[1.0, -0.4, 0.5], [1.0, -0.4, -0.5], [1.0, 0.4, 0.5]])], [DVec3::ZERO].into_iter(), &pose);
    let order = Node::new(&manifest, u64::MAX).run(&aim);
    let at =
        |order: &[ChunkId]| -> Vec<i32> { order.iter().filter(|c| c.0 > 0).map(|c| places[c.0 as usize - 1].x as i32).collect() };
    let order = at(&order);
    assert_eq!(order.len(), 40, "everything comes in the end");
    // At 29/60 s the eye is at 2.4; in a second it will be at 7.4, inside the sphere around the leaf at 6.
    assert_eq!(order[..4], [8, 6, 10, 12]);
    assert!(order[..18].iter().all(|x| *x >= 6), "{order:?}");
    assert_eq!(order[18..21], [4, 2, -2], "what is behind, by distance");
    let still = Node::new(&manifest, u64::MAX).run(&Aim { eye: DVec3::X * 0.1, axis: DVec3::ZERO, cos_half_angle: -1.0 });
    assert_eq!(at(&still)[..5], [2, -2, 4, -4, 6], "without motion, all around, by distance alone");
}

#[test]
fn a_node_at_rest_looks_at_nothing_until_a_chunk_goes() {
    let places: Vec<DVec3> = (0..9).map(|i| DVec3::X * f64::from(i)).collect();
    let mut manifest = scene(&places, 10);
    let aim = straight(DVec3::ZERO, DVec3::X);
    let mut node = Node::new(&manifest, u64::MAX);
    assert_eq!(node.run(&aim).len(), 10);
    assert!(!node.prefetch.is_looking(&node.residency), "all is there");
    manifest.materials[1].texture = None;
    // 100 bytes, of which 75 may be taken, and geometry counts twice until it is there: 6 blobs of 10.
    let mut node = Node::new(&manifest, 100);
    let got = node.run(&aim);
    assert_eq!(got.len(), 6, "{got:?}");
    assert!(!node.prefetch.is_looking(&node.residency), "there is no room");
    assert_eq!(node.ask(), []);
}

#[test]
fn what_was_fetched_ahead_and_evicted_is_not_fetched_ahead_again() {
    let places: Vec<DVec3> = (0..6).map(|i| DVec3::X * f64::from(i * 4 + 2)).collect();
    let manifest = scene(&places, 10);
    let aim = straight(DVec3::ZERO, DVec3::X);
    let mut node = Node::new(&manifest, 60);
    // Leaf 4 is in view and then is not, over and over; whatever goes, nothing comes back ahead of its need.
    let (one, other) = ([LeafRange::new(4, 6)], [LeafRange::new(2, 4)]);
    let sets = [VisibleSet::from_ranges(one), VisibleSet::from_ranges(other)];
    let mut asked = Vec::new();
    for round in 0..40 {
        node.see(&sets[round % 2]);
        asked.extend(node.run(&aim));
        assert!(node.residency.resident_bytes() <= 60);
    }
    let never_seen = |chunk: &&ChunkId| (1..=2).contains(&chunk.0);
    let mut unseen: Vec<&ChunkId> = asked.iter().filter(never_seen).collect();
    unseen.sort_unstable();
    unseen.dedup();
    assert_eq!(asked.iter().filter(never_seen).count(), unseen.len(), "{asked:?}");
    // A connection that is gone takes with it what was asked for.
    node.prefetch.forget_asked();
    node.look(&aim);
    assert!(node.prefetch.queue.iter().any(|candidate| candidate.leaf < 2) || node.residency.is_resident(ChunkId(1)));
}

#[test]
fn large_scenes_are_looked_through_over_frames_and_large_blobs_left_alone() {
    let count = 3 * LEAVES_PER_FRAME + 5;
    let places: Vec<DVec3> = (0..count).map(|i| DVec3::X * f64::from(count - i)).collect();
    let mut manifest = scene(&places, 10);
    manifest.chunks[count as usize].length = PREFETCH_LARGEST_BYTES as u32 + 1; // the nearest leaf's
    let mut node = Node::new(&manifest, u64::MAX);
    let aim = straight(DVec3::ZERO, DVec3::X);
    for _ in 0..3 {
        node.look(&aim);
        assert_eq!(node.ask(), [], "not before all leaves were seen");
    }
    node.look(&aim);
    let nearest: Vec<ChunkId> = (0..4).map(|i| ChunkId(count - 1 - i)).collect();
    assert_eq!(node.ask().len(), PREFETCH_WINDOW);
    // Leaf `count` − 1 has a chunk that is too large; its texture may still come.
    let got: Vec<ChunkId> = node.on_the_way.iter().map(|(chunk, _)| *chunk).filter(|chunk| chunk.0 > 0).collect();
    assert_eq!(got, nearest[..got.len()]);
    assert!(node.prefetch.found.capacity() <= 4 * QUEUE_LEAVES && node.prefetch.queue.capacity() <= 4 * QUEUE_LEAVES);
}

#[test]
fn blobs_on_their_way_are_few_and_small_but_for_one() {
    let places: Vec<DVec3> = (0..9).map(|i| DVec3::X * f64::from(i)).collect();
    let aim = straight(DVec3::ZERO, DVec3::X);
    for (length, most) in [(10, PREFETCH_WINDOW), (900 << 10, 2), (3 << 20, 1)] {
        let manifest = scene(&places, length);
        let mut node = Node::new(&manifest, u64::MAX);
        node.look(&aim);
        assert_eq!(node.ask().len(), most, "of {length} bytes");
        assert_eq!(node.ask(), []);
    }
}

fn place() -> impl Strategy<Value = DVec3> {
    [-30.0..30.0, -20.0..20.0, -10.0..10.0f64].prop_map(DVec3::from)
}

fn aim() -> impl Strategy<Value = Aim> {
    (place(), place(), -1.0..1.0f64).prop_map(|(eye, axis, cos_half_angle)| Aim {
        eye,
        axis: axis.try_normalize().unwrap_or(DVec3::X),
        cos_half_angle,
    })
}

proptest! {
    #[test]
    fn the_order_is_that_of_the_rule(places in proptest::collection::vec(place(), 1..60), aim in aim()) {
        let manifest = scene(&places, 10);
        let mut node = Node::new(&manifest, u64::MAX);
        let order: Vec<u32> = node.run(&aim).iter().filter(|c| c.0 > 0).map(|c| c.0 - 1).collect();
        let radius = DVec3::new(0.5, 1.0, 1.5).length();
        let mut wanted: Vec<u32> = (0..places.len() as u32).collect();
        wanted.sort_by(|a, b| {
            let key = |leaf: &u32| {
                let offset = places[*leaf as usize] - aim.eye;
                (!aim.meets(places[*leaf as usize], radius), offset.length_squared())
            };
            let (a, b) = (key(a), key(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        prop_assert_eq!(order, wanted);
    }

    #[test]
    fn nothing_is_asked_for_twice_or_beyond_its_share(
        places in proptest::collection::vec(place(), 1..40),
        aims in proptest::collection::vec(aim(), 3),
        cap in 0..900u64,
        steps in proptest::collection::vec((0..8u8, 0..40u32, 0..12u32), 1..120),
    ) {
        let manifest = scene(&places, 10);
        let mut node = Node::new(&manifest, cap);
        let mut last_needed = vec![0; manifest.chunks.len()];
        let mut asked_at = vec![0u64; manifest.chunks.len()];
        for (what, a, b) in steps {
            match what {
                0 => {
                    let start = a.min(places.len() as u32 - 1);
                    let set = VisibleSet::from_ranges([LeafRange::new(start, (start + b).min(places.len() as u32))]);
                    node.see(&set);
                    for chunk in set.leaves().flat_map(|leaf| chunks_of(&manifest, None, leaf)).flatten() {
                        last_needed[chunk.0 as usize] = node.residency.frame();
                    }
                }
                1..=3 => node.look(&aims[a as usize % aims.len()]),
                4..=5 if !node.on_the_way.is_empty() => node.arrive(a as usize % node.on_the_way.len()),
                _ => {
                    let before = node.residency.resident_bytes();
                    for (i, chunk) in node.ask().into_iter().enumerate() {
                        let at = chunk.0 as usize;
                        prop_assert!(!node.residency.is_resident(chunk));
                        let times = node.on_the_way.iter().filter(|(other, _)| *other == chunk).count();
                        prop_assert_eq!(times, 1, "{:?}, the {}th, is on its way already", chunk, i);
                        prop_assert!(asked_at[at] == 0 || last_needed[at] > asked_at[at], "{:?} was asked for in vain before", chunk);
                        asked_at[at] = node.residency.frame();
                        prop_assert!(before + node.load().room <= share_of(cap), "within its share");
                    }
                }
            }
            prop_assert!(node.load().count <= PREFETCH_WINDOW);
            prop_assert!(node.known().residency.frame() > 0);
        }
    }

    #[test]
    fn a_cone_meets_every_sphere_of_which_it_holds_a_point(aim in aim(), point in place(), radius in 0.0..5.0f64, from in place()) {
        let along = (point - aim.eye).normalize_or_zero().dot(aim.axis);
        let aim = Aim { cos_half_angle: aim.cos_half_angle.min(along), ..aim };
        prop_assert!(aim.meets(point + from.normalize_or_zero() * radius, radius * 1.001 + 1e-9));
    }

    #[test]
    fn an_aim_holds_all_that_its_views_see(
        eye in [-0.5..0.5, 1.0..2.0, 0.5..2.0f64],
        turn in [-1.5..1.5, -1.0..1.0, -0.5..0.5f64],
        at in [0.0..1.0, 0.0..1.0f64],
        beyond in 1.0..50.0f64,
    ) {
        let eye = DVec3::from(eye);
        let views = [view([[-2.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-2.0, 1.5, 0.0]]), view([[0.0, 0.0, 0.0], [2.0, 0.0, 1.0], [0.0, 2.0, 0.0]])];
        let pose = Pose { eye: DVec3::new(100.0, -3.0, 7.0), world_from_room: DQuat::from_scaled_axis(DVec3::from(turn)) };
        let aim = Aim::through(&views, [eye, eye].into_iter(), &pose);
        prop_assert!((aim.axis.length() - 1.0).abs() < 1e-9);
        for view in &views {
            let [bottom_left, bottom_right, top_left] = view.corners.map(DVec3::from);
            let ray = bottom_left + (bottom_right - bottom_left) * at[0] + (top_left - bottom_left) * at[1] - eye;
            let world = pose.eye + DMat3::from_quat(pose.world_from_room) * ray * beyond;
            prop_assert!(aim.meets(world, 0.0));
        }
    }
}
