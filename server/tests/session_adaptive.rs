//! Goal: what hardly contributes to the wall's picture is dropped on all tiles or on none, and nobody's word, or want of one, takes away what
//! is to be seen.
//! Method: the master alone, driven message by message on virtual time; nodes' counts are made up. A wall of two tiles of 64 by 48 pixels, one
//! a node, of which 1 % is 61 pixels.

mod outputs;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use glam::{DAffine3, DVec3};
use mullion_common::scene::{ChunkId, LeafRecord, MaterialId, ObjectId, SceneManifest};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{ViewId, Wall, WallConfig};
use mullion_common::wire::{ByeCode, Counted, Frame, Hello, MAX_COUNTED, ObjectCount, Opening, Part, Steering, ToMaster, ToTile};
use mullion_server::master::{
    Adaptive, COUNT_EVERY, COUNT_HOLDS_FRAMES, DROPS_BELOW, ENTERING_FRAMES, FrameInput, MAX_DROPPED_OBJECTS, Master,
    MasterOptions, ObjectLeaves, Output, Pace, PeerId,
};
use mullion_server::swap_barrier::BarrierOptions;
use outputs::{closed, sent};
use proptest::prelude::*;

const PEERS: [PeerId; 2] = [PeerId(1), PeerId(2)];
const NAMES: [&str; 2] = ["t0x0", "t1x0"];
const THRESHOLD: f64 = 0.01;
/// Of a box in the wall's plane: what reaches the threshold, and what is enough below it to be dropped.
const REACHES_PX: u32 = 62;
const BELOW_PX: u32 = 45;
const EYE_M: f64 = 1.5;

fn wall() -> Arc<Wall> {
    let text = "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
    Arc::new(WallConfig::parse(text).unwrap())
}

/// Object `i` has leaves `2i` and `2i + 1`.
fn objects(count: u32) -> Arc<ObjectLeaves> {
    let leaf = |leaf: u32| LeafRecord {
        object: ObjectId(leaf / 2),
        chunk: ChunkId(0),
        material: MaterialId(0),
        triangle_count: 1,
        local_min: [0.0; 3],
        local_max: [1.0; 3],
    };
    let transforms = vec![DAffine3::IDENTITY.into(); count as usize];
    let scene = SceneManifest { leaves: (0..2 * count).map(leaf).collect(), transforms, ..SceneManifest::default() };
    Arc::new(ObjectLeaves::of(&scene))
}

struct Show {
    master: Master,
    now: Duration,
    number: u64,
    objects: u32,
    sets: Vec<VisibleSet>,
    /// By the last frame's beginning.
    allocations: u64,
    /// What each node has of what is dropped, by frame.
    dropped: [Vec<(u64, VisibleSet)>; 2],
}

impl Show {
    fn new(objects_count: u32) -> Self {
        let adaptive = Adaptive { threshold: THRESHOLD, objects: objects(objects_count) };
        let options = MasterOptions {
            barrier: BarrierOptions { wait: Duration::from_millis(14), start_wait: Duration::ZERO, start_nodes: vec![] },
            pace: Pace::AsFastAsPossible,
            first_frame: 0,
            frames: None,
            sections: vec![],
            tessellation: None,
            hierarchies: None,
            insertions: vec![],
            adaptive: Some(adaptive),
            estimates: None,
            detail: None,
            session_seed: [1; 32],
        };
        let mut show = Self {
            master: Master::new(wall(), options, Duration::ZERO),
            now: Duration::ZERO,
            number: 0,
            objects: objects_count,
            sets: vec![VisibleSet::all(2 * objects_count); 2],
            allocations: 0,
            dropped: [vec![], vec![]],
        };
        show.master.handle_timeout(show.now);
        (0..2).for_each(|node| show.join(node));
        show
    }

    fn join(&mut self, node: usize) {
        self.master.handle_connected(PEERS[node], self.now);
        let hello = Hello { node: NAMES[node].into(), part: Part::Own, credentials: None, cached: vec![] };
        self.master.handle_opening(PEERS[node], Opening::Control(hello), self.now);
        self.dropped[node].clear();
        self.take();
    }

    fn take(&mut self) -> Vec<Output> {
        let outputs: Vec<Output> = std::iter::from_fn(|| self.master.poll_output()).collect();
        for (node, peer) in PEERS.into_iter().enumerate() {
            for message in sent(&outputs, peer) {
                match message {
                    ToTile::Welcome(welcome) => assert_eq!(welcome.count_every, COUNT_EVERY),
                    ToTile::Frame(frame) => self.apply(node, &frame),
                    _ => {}
                }
            }
        }
        outputs
    }

    fn take_and_recycle(&mut self) {
        for output in self.take() {
            if let Output::Send { message, .. } = output {
                self.master.recycle(message.bytes);
            }
        }
    }

    fn apply(&mut self, node: usize, frame: &Frame) {
        let base = frame.base.map(|base| &self.dropped[node].iter().find(|(number, _)| *number == base).expect("known").1);
        let (mut scratch, mut dropped) = (VisibleSet::default(), VisibleSet::default());
        frame.dropped.apply(base.unwrap_or(&VisibleSet::default()), &mut scratch, &mut dropped);
        assert_eq!(dropped.digest(), frame.dropped_digest);
        self.dropped[node].push((frame.number, dropped));
    }

    /// A frame, which both nodes draw; what is dropped in it, the same on both.
    fn frame(&mut self) -> BTreeSet<u32> {
        let input = FrameInput {
            number: self.number,
            scene_time_s: 0.0,
            world_from_room: DAffine3::IDENTITY,
            eyes: &[DVec3::new(0.0, 0.0, EYE_M); 2],
            shared_eye: DVec3::Z,
            sets: &self.sets,
            moved: &[],
            primary: &[],
            budgets: &[],
            presence: &[],
            steering: Steering::default(),
        };
        let begun = allocation_counter::measure(|| self.master.begin_frame(&input, self.now, &mut |_| {}));
        self.allocations = begun.count_total;
        self.take_and_recycle();
        self.now += Duration::from_millis(1);
        let seen: Vec<&VisibleSet> =
            self.dropped.iter().filter_map(|sets| sets.last()).filter(|(n, _)| *n == self.number).map(|(_, set)| set).collect();
        assert!(!seen.is_empty() && seen.iter().all(|set| *set == seen[0]), "both tiles drop the same");
        let dropped: BTreeSet<u32> = seen[0].leaves().map(|leaf| leaf / 2).collect();
        assert_eq!(seen[0].len(), 2 * dropped.len() as u32, "objects are dropped whole");
        assert_eq!(self.master.dropped_objects(), dropped.len() as u32);
        for peer in PEERS {
            self.master.handle_message(
                peer,
                ToMaster::Ready { frame: self.number, draw_us: 0, is_cut: false, shown: None },
                self.now,
            );
        }
        self.take_and_recycle();
        self.master.handle_timeout(self.now + Duration::from_millis(14));
        self.take_and_recycle();
        self.now += Duration::from_millis(15);
        self.number += 1;
        dropped
    }

    fn frames(&mut self, count: u64) -> BTreeSet<u32> {
        (0..count).map(|_| self.frame()).last().expect("at least one")
    }

    /// A node says how many pixels it counted of some objects' boxes, in the wall's plane.
    fn count(&mut self, node: usize, counts: &[(u32, u32)]) {
        self.count_at(node, counts, EYE_M as f32);
    }

    fn count_at(&mut self, node: usize, counts: &[(u32, u32)], distance_m: f32) {
        let objects = counts.iter().map(|&(object, visible_px)| ObjectCount { object: ObjectId(object), visible_px, distance_m });
        let counted = Counted { frame: self.number - 1, view: ViewId(node as u16), objects: objects.collect() };
        self.master.handle_message(PEERS[node], ToMaster::Counted(counted), self.now);
    }
}

fn set(objects: &[u32]) -> BTreeSet<u32> {
    objects.iter().copied().collect()
}

#[test]
fn what_is_cut_by_a_seam_is_judged_as_one() {
    let mut show = Show::new(4);
    assert_eq!(show.frame(), set(&[]), "nothing has been counted");
    // Object 0 reaches the threshold by both parts together, object 1 does not; object 2 one tile has not counted.
    show.count(0, &[(0, REACHES_PX / 2), (1, 20), (2, 1)]);
    show.count(1, &[(0, REACHES_PX / 2), (1, BELOW_PX - 20)]);
    assert_eq!(show.frame(), set(&[1]));
    assert_eq!(show.frames(5), set(&[1]));
    // It grows on one side, and both draw it.
    let other_px = BELOW_PX - 20;
    show.count(0, &[(1, REACHES_PX - other_px - 2)]);
    assert_eq!(show.frame(), set(&[1]), "a pixel lacks");
    show.count(0, &[(1, REACHES_PX - other_px)]);
    assert_eq!(show.frame(), set(&[]));
}

#[test]
fn an_object_does_not_flicker_about_the_threshold() {
    let mut show = Show::new(1);
    let between_px = (f64::from(2 * 64 * 48) * THRESHOLD * (DROPS_BELOW + 1.0) / 2.0) as u32;
    let mut seen = Vec::new();
    show.frame();
    for pixels in [between_px, BELOW_PX, between_px, REACHES_PX, between_px, BELOW_PX] {
        show.count(0, &[(0, pixels)]);
        show.count(1, &[(0, 0)]);
        seen.push(!show.frame().is_empty());
    }
    assert_eq!(seen, [false, true, true, false, false, true]);
}

#[test]
fn what_is_far_away_counts_for_more() {
    let mut show = Show::new(2);
    show.frame();
    // As far behind the wall as the eye is before it, an object counts twice.
    show.count_at(0, &[(0, BELOW_PX / 2), (1, REACHES_PX / 2 + 1)], 2.0 * EYE_M as f32);
    show.count(1, &[(0, 0), (1, 0)]);
    assert_eq!(show.frame(), set(&[0]));
}

#[test]
fn nothing_is_dropped_for_want_of_a_count() {
    let mut show = Show::new(3);
    show.frame();
    for node in 0..2 {
        show.count(node, &[(0, 1), (1, 1), (2, 1)]);
    }
    assert_eq!(show.frame(), set(&[0, 1, 2]));
    // Counts hold for a while.
    assert_eq!(show.frames(COUNT_HOLDS_FRAMES - 2), set(&[0, 1, 2]));
    show.count(0, &[(0, 1), (1, 1)]);
    show.count(1, &[(0, 1)]);
    assert_eq!(show.frames(3), set(&[0]), "no tile vouches for 2, one for 1");
    // A node that is gone vouches for nothing, from the next frame on, nor does the one that comes in its place.
    show.master.handle_disconnected(PEERS[1], show.now);
    assert_eq!(show.frame(), set(&[]));
    show.count(0, &[(0, 1), (1, 1)]);
    assert_eq!(show.frames(2), set(&[]));
    show.join(1);
    assert_eq!(show.frames(2), set(&[]));
    show.count(0, &[(0, 1), (1, 1)]);
    show.count(1, &[(1, 1)]);
    assert_eq!(show.frame(), set(&[1]));
    // One that comes back between two frames has not counted either.
    show.master.handle_disconnected(PEERS[1], show.now);
    show.join(1);
    assert_eq!(show.frame(), set(&[]));
}

#[test]
fn what_comes_into_view_of_a_further_tile_stays_dropped_until_that_has_counted() {
    let mut show = Show::new(2);
    let left = VisibleSet::all(4);
    show.sets = vec![left.clone(), VisibleSet::from_ranges([LeafRange::new(2, 4)])];
    show.frame();
    show.count(0, &[(0, BELOW_PX), (1, REACHES_PX)]);
    assert_eq!(show.frame(), set(&[0]), "only one tile sees it");
    show.sets[1] = left.clone();
    assert_eq!(show.frame(), set(&[0]));
    show.count(1, &[(0, 1)]);
    assert_eq!(show.frames(ENTERING_FRAMES + 10), set(&[0]), "it has been counted in time");
    // Out of all views it is dropped no more: it may come back anywhere.
    show.sets = vec![VisibleSet::from_ranges([LeafRange::new(2, 4)]); 2];
    assert_eq!(show.frame(), set(&[]));
    show.sets = vec![left.clone(), left];
    assert_eq!(show.frames(3), set(&[]));
    show.count(0, &[(0, 1)]);
    show.count(1, &[(0, 1)]);
    assert_eq!(show.frame(), set(&[0]));
    show.sets[1] = VisibleSet::from_ranges([LeafRange::new(2, 4)]);
    assert_eq!(show.frame(), set(&[0]));
    show.sets[1] = VisibleSet::all(4);
    assert_eq!(show.frames(ENTERING_FRAMES), set(&[0]));
    assert_eq!(show.frames(2), set(&[]), "a tile into which it came has had its time");
}

#[test]
fn who_lies_takes_nothing_from_the_others() {
    let mut show = Show::new(3);
    show.frame();
    show.count(0, &[(0, BELOW_PX), (1, REACHES_PX), (2, 1)]);
    // Too much keeps an object, too little does not hide what others see, and what is not there is no matter.
    show.count(1, &[(0, u32::MAX), (1, 0), (2, 1), (3, 0), (u32::MAX, 7)]);
    assert_eq!(show.frame(), set(&[2]));
    // Its word counts for a tile at most: the whole of its own is half of the wall.
    show.count_at(1, &[(0, 0), (2, u32::MAX)], -1e30);
    assert_eq!(show.frame(), set(&[0]));
    // Of many messages one a frame is heard.
    for flood in 0..1000 {
        show.count(1, &[(0, if flood == 0 { 0 } else { u32::MAX })]);
    }
    assert_eq!(show.frame(), set(&[0]));
    // Of another's tile, or of frames to come, it has nothing to say.
    for counted in [
        Counted { frame: 0, view: ViewId(0), objects: vec![] },
        Counted { frame: 0, view: ViewId(9), objects: vec![] },
        Counted { frame: show.number, view: ViewId(1), objects: vec![] },
    ] {
        show.master.handle_message(PEERS[1], ToMaster::Counted(counted), show.now);
        let outputs = show.take();
        assert_eq!((closed(&outputs, PEERS[1]), closed(&outputs, PEERS[0])), (Some(ByeCode::Malformed), None));
        show.join(1);
    }
}

#[test]
fn what_a_scene_grows_by_is_dropped_once_it_is_known() {
    let mut show = Show::new(2);
    show.sets = vec![VisibleSet::all(8); 2];
    show.frame();
    let counts = [(1, 0), (2, 0), (3, REACHES_PX)];
    (0..2).for_each(|node| show.count(node, &counts));
    assert_eq!(show.frame(), set(&[1]), "there are two objects");
    show.master.know_objects(objects(4));
    assert_eq!(show.frame(), set(&[1]));
    (0..2).for_each(|node| show.count(node, &counts));
    assert_eq!(show.frame(), set(&[1, 2]));
}

#[test]
fn a_frame_allocates_nothing_for_it() {
    let mut show = Show::new(40);
    show.frame();
    let bytes = |show: &Show, node: usize| {
        let count = |object| ObjectCount { object: ObjectId(object), visible_px: object % 3 * 30, distance_m: EYE_M as f32 };
        let (view, objects) = (ViewId(node as u16), (0..40).map(count).collect());
        ToMaster::Counted(Counted { frame: show.number - 1, view, objects })
    };
    for frame in 0..40 {
        let counts = [0, 1].map(|node| bytes(&show, node));
        // Some come into sight and go out of it, so that objects are dropped and drawn again.
        show.sets[1] = VisibleSet::from_ranges([LeafRange::new(frame % 4 * 8, 80)]);
        let taken = allocation_counter::measure(|| {
            for (peer, counted) in PEERS.into_iter().zip(counts) {
                show.master.handle_message(peer, counted, show.now);
            }
        });
        show.frame();
        assert!(frame < 20 || taken.count_total + show.allocations == 0, "frame {frame}: {taken:?}, {}", show.allocations);
    }
    assert!(show.master.dropped_objects() > 5);
}

#[test]
fn what_is_dropped_is_bounded() {
    let count = MAX_DROPPED_OBJECTS as u32 + 1000;
    let mut show = Show::new(count);
    show.frame();
    let mut most = 0;
    for round in 0..3 * count / MAX_COUNTED as u32 {
        let first = round * MAX_COUNTED as u32 % count;
        let counts: Vec<(u32, u32)> = (first..(first + MAX_COUNTED as u32).min(count)).map(|object| (object, 0)).collect();
        (0..2).for_each(|node| show.count(node, &counts));
        most = most.max(show.frame().len());
    }
    assert_eq!(most, MAX_DROPPED_OBJECTS);
}

/// The dull oracle: all that is known, looked through anew for each frame.
#[derive(Default)]
struct Oracle {
    /// By node and object: pixels.
    counts: [BTreeMap<u32, u32>; 2],
    dropped: BTreeSet<u32>,
}

impl Oracle {
    fn frame(&mut self, objects: u32) -> BTreeSet<u32> {
        let pixels = f64::from(2 * 64 * 48);
        self.dropped = (0..objects)
            .filter(|object| {
                let [left, right] = [0, 1].map(|node| self.counts[node].get(object));
                let (Some(left), Some(right)) = (left, right) else { return false };
                let factor = if self.dropped.contains(object) { 1.0 } else { DROPS_BELOW };
                f64::from(left + right) / pixels < THRESHOLD * factor
            })
            .collect();
        self.dropped.clone()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn it_decides_as_the_equation_says(
        rounds in proptest::collection::vec((0..2usize, proptest::collection::btree_map(0..12u32, 0..70u32, 0..8)), 1..60)
    ) {
        let mut show = Show::new(12);
        let mut oracle = Oracle::default();
        show.frame();
        oracle.frame(show.objects);
        for (node, counts) in rounds {
            let counts: Vec<(u32, u32)> = counts.into_iter().collect();
            show.count(node, &counts);
            oracle.counts[node].extend(counts);
            prop_assert_eq!(show.frame(), oracle.frame(12));
        }
    }
}
