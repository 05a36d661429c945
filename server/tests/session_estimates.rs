//! Goal: all nodes draw in the same detail and to the same budget, which keeps the time that it is to keep, and no node's word or silence takes it from the others.
//! Method: the master alone, driven message by message on virtual time; what drawing takes is made up. A wall of two tiles, one a node.

mod outputs;

use std::sync::Arc;
use std::time::Duration;

use glam::{DAffine3, DVec3};
use mullion_common::geometry::Plane;
use mullion_common::scene::{
    BlobRef, ChunkHash, ChunkId, LeafRecord, MaterialId, Object, ObjectId, Presence, Scene, SceneManifest, SectionKind, Transform,
};
use mullion_common::throughput::{FIRST_TRIANGLES, LEAST_TRIANGLES};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Wall, WallConfig};
use mullion_common::wire::{
    Detail, DetailWeight, Estimate, Hello, Moved, Opening, Part, Primary, SectionRef, Steering, ToMaster, ToTile,
};
use mullion_server::master::{
    EstimateOptions, FrameInput, Hierarchies, HierarchyLeaves, LATE_ANSWERS, Master, MasterOptions, Output, Pace, PeerId,
    REST_FRAMES, Spent, WallBudget,
};
use mullion_server::swap_barrier::BarrierOptions;
use outputs::sent;

const PEERS: [PeerId; 2] = [PeerId(1), PeerId(2)];
const NAMES: [&str; 2] = ["t0x0", "t1x0"];
const WAIT: Duration = Duration::from_millis(20);
const PERIOD: Duration = Duration::from_millis(100);
const TIME_US: u32 = 10_000;
const SCENE: u32 = 10_000_000;
/// Time for a triangle, nanoseconds.
const COST_NS: u32 = 10;

fn wall() -> Arc<Wall> {
    let text = "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
    Arc::new(WallConfig::parse(text).unwrap())
}

fn tessellation() -> SectionRef {
    SectionRef { kind: SectionKind::Tessellation, hash: ChunkHash([5; 32]), length: 99 }
}

const DETAIL: Detail = Detail { triangles: Some(700), least_pixels: 1.5, hides: true, weight: DetailWeight::Nohc };

fn index() -> BlobRef {
    BlobRef { hash: ChunkHash([6; 32]), length: 44 }
}

/// Object 0 with object 1 below it, and object 2, all of two leaves.
fn scene() -> Scene {
    let leaf = |leaf: u32| LeafRecord {
        object: ObjectId(leaf / 2),
        chunk: ChunkId(0),
        material: MaterialId(0),
        triangle_count: 1,
        local_min: [0.0; 3],
        local_max: [1.0, 2.0, 3.0],
    };
    let object = |(start, end)| Object {
        parent: None,
        name: String::new(),
        source_node: 0,
        instance: None,
        parent_from_local: DAffine3::IDENTITY,
        leaves: vec![LeafRange::new(start, end)],
    };
    Scene {
        manifest: SceneManifest { leaves: (0..6).map(leaf).collect(), ..SceneManifest::default() },
        objects: [(0, 4), (2, 4), (4, 6)].map(object).into(),
        ..Scene::default()
    }
}

/// What each node does in a frame: says that drawing took so long, or nothing.
type Answers = [Option<u32>; 2];

struct Show {
    master: Master,
    now: Duration,
    number: u64,
    world_from_room: DAffine3,
    eyes: [DVec3; 2],
    moved: Vec<Moved>,
    presence: Vec<(ObjectId, Presence)>,
    planes: Vec<Plane>,
    /// By the last frame's beginning.
    allocations: u64,
}

impl Show {
    fn new(budget: WallBudget) -> Self {
        Self::with(EstimateOptions { budget, scene_triangles: SCENE, completes: false })
    }

    fn with(estimates: EstimateOptions) -> Self {
        Self::ordering(Some(estimates), None, Some(index()))
    }

    fn ordering(estimates: Option<EstimateOptions>, detail: Option<Detail>, index: Option<BlobRef>) -> Self {
        let leaves = Arc::new(HierarchyLeaves::of(&scene(), [0, 1].map(ObjectId)));
        let options = MasterOptions {
            barrier: BarrierOptions { wait: WAIT, start_wait: Duration::ZERO, start_nodes: vec![] },
            pace: Pace::Every(PERIOD),
            first_frame: 0,
            frames: None,
            sections: vec![],
            tessellation: Some(tessellation()),
            hierarchies: index.map(|index| Hierarchies { index, leaves }),
            insertions: vec![],
            adaptive: None,
            estimates,
            detail,
            session_seed: [1; 32],
        };
        let mut show = Self {
            master: Master::new(wall(), options, Duration::ZERO),
            now: Duration::ZERO,
            number: 0,
            world_from_room: DAffine3::IDENTITY,
            eyes: [DVec3::new(0.1, 0.2, 1.5); 2],
            moved: vec![],
            presence: vec![],
            planes: vec![Plane { normal: DVec3::Y, offset_m: 2.0 }],
            allocations: 0,
        };
        show.master.handle_timeout(show.now);
        (0..2).for_each(|node| drop(show.join(node)));
        show
    }

    fn outputs(&mut self) -> Vec<Output> {
        std::iter::from_fn(|| self.master.poll_output()).collect()
    }

    fn join(&mut self, node: usize) -> Vec<ToTile> {
        self.master.handle_connected(PEERS[node], self.now);
        let hello = Hello { node: NAMES[node].into(), part: Part::Own, credentials: None, cached: vec![] };
        self.master.handle_opening(PEERS[node], Opening::Control(hello), self.now);
        sent(&self.outputs(), PEERS[node])
    }

    fn begin(&mut self) -> Vec<Output> {
        let input = FrameInput {
            number: self.number,
            scene_time_s: self.number as f64,
            world_from_room: self.world_from_room,
            eyes: &self.eyes,
            shared_eye: DVec3::Z,
            sets: &[VisibleSet::all(5), VisibleSet::default()],
            moved: &self.moved,
            primary: &self.planes,
            budgets: &[],
            presence: &self.presence,
            steering: Steering::default(),
        };
        let begun = allocation_counter::measure(|| self.master.begin_frame(&input, self.now, &mut |_| {}));
        self.allocations = begun.count_total;
        self.outputs()
    }

    fn ready(&mut self, node: usize, frame: u64, draw_us: u32) {
        self.master.handle_message(PEERS[node], ToMaster::Ready { frame, draw_us, is_cut: true, shown: None }, self.now);
    }

    /// A frame that nobody answers: what both nodes are told to do.
    fn orders(&mut self) -> (Option<Primary>, Option<Estimate>, Option<Detail>) {
        let outputs = self.begin();
        let [first, second] = PEERS.map(|peer| match sent(&outputs, peer).pop() {
            Some(ToTile::Frame(frame)) => (frame.primary.map(|primary| *primary), frame.estimate, frame.detail),
            other => panic!("{other:?}"),
        });
        assert_eq!(first, second, "all get the same");
        self.number += 1;
        self.now += PERIOD;
        self.master.handle_timeout(self.now);
        for output in outputs.into_iter().chain(self.outputs()) {
            if let Output::Send { message, .. } = output {
                self.master.recycle(message.bytes);
            }
        }
        first
    }

    /// A frame: the order that both nodes get, and what was spent. Who answers does so as soon as it can have drawn.
    fn frame(&mut self, answers: impl FnOnce(u32) -> Answers) -> (Estimate, Spent) {
        let outputs = self.begin();
        let orders = PEERS.map(|peer| match sent(&outputs, peer).pop() {
            Some(ToTile::Frame(frame)) => frame.estimate,
            other => panic!("{other:?}"),
        });
        assert_eq!(orders[0], orders[1], "all get the same");
        for output in outputs {
            if let Output::Send { message, .. } = output {
                self.master.recycle(message.bytes);
            }
        }
        let order = orders[0].expect("a budget");
        let (began, mut spent) = (self.now, None);
        let mut answers: Vec<(usize, u32)> =
            (0..).zip(answers(order.triangles)).filter_map(|(node, us)| Some((node, us?))).collect();
        answers.sort_by_key(|(_, draw_us)| *draw_us);
        let next = self.number + 1;
        let mut is_over = false;
        let mut turn = |show: &mut Self, at: Duration| {
            if at >= began + WAIT && !is_over {
                (show.now, is_over) = (began + WAIT, true);
                show.master.handle_timeout(show.now);
            }
            show.now = at;
        };
        for (node, draw_us) in answers {
            let at = began + Duration::from_micros(u64::from(draw_us));
            turn(self, at.min(began + PERIOD - Duration::from_millis(1)));
            self.ready(node, self.number, draw_us);
        }
        turn(self, began + WAIT);
        self.now = began + PERIOD;
        self.master.handle_timeout(self.now);
        for output in self.outputs() {
            match output {
                Output::FrameReleased(released) => spent = released.spent,
                Output::WantFrame { number } => assert_eq!(number, next),
                Output::Send { message, .. } => self.master.recycle(message.bytes),
                _ => {}
            }
        }
        self.number = next;
        (order, spent.expect("it was released"))
    }

    /// Frames in which both draw, the second at twice the cost of the first; the last one's triangles.
    fn frames(&mut self, count: usize, cost_ns: u32) -> u32 {
        (0..count).map(|_| self.frame(|triangles| both(triangles, cost_ns)).0.triangles).last().expect("one at least")
    }
}

fn both(triangles: u32, cost_ns: u32) -> Answers {
    let of = |cost_ns: u32| Some((u64::from(triangles) * u64::from(cost_ns) / 1000) as u32 + 1);
    [of(cost_ns / 2), of(cost_ns)]
}

#[test]
fn a_budget_of_triangles_is_given_to_all_with_each_frame() {
    let mut show = Show::new(WallBudget::Triangles(5000));
    show.world_from_room = DAffine3::from_translation(DVec3::X);
    show.frame(|_| [Some(100), Some(70)]); // which waits for nobody
    for _ in 0..3 {
        let (order, spent) = show.frame(|_| [Some(100), Some(70)]);
        assert_eq!(order, Estimate { triangles: 5000, is_complete: false });
        assert_eq!(spent, Spent { triangles: 5000, is_complete: false, slowest_us: 100, is_over: false });
    }
    let mut show = Show::new(WallBudget::Triangles(2 * SCENE));
    assert_eq!(show.frame(|_| [None, None]).0.triangles, SCENE, "there are no more");
}

#[test]
fn who_joins_late_is_told_of_the_tessellation_and_gets_the_frame_that_runs_with_its_order() {
    let mut show = Show::new(WallBudget::Triangles(5000));
    show.master.handle_disconnected(PEERS[1], show.now);
    show.begin();
    let told = show.join(1);
    let [ToTile::Welcome(_), ToTile::Manifest(manifest), ToTile::Frame(frame)] = &told[..] else { panic!("{told:?}") };
    assert_eq!(manifest.tessellation, Some(tessellation()));
    assert_eq!((frame.estimate.map(|order| order.triangles), frame.detail), (Some(5000), None));
    assert_eq!(frame.primary.as_ref().map(|primary| &primary.planes), Some(&show.planes));
}

#[test]
fn where_the_wall_looks_is_said_once_with_whatever_is_ordered() {
    let of_triangles = EstimateOptions { budget: WallBudget::Triangles(5000), scene_triangles: SCENE, completes: false };
    let estimate = Some(Estimate { triangles: 5000, is_complete: false });
    for (options, detail) in [(Some(of_triangles.clone()), Some(DETAIL)), (None, Some(DETAIL)), (Some(of_triangles), None)] {
        let estimate = estimate.filter(|_| options.is_some());
        let mut show = Show::ordering(options, detail, Some(index()));
        for _ in 0..3 {
            let primary = Primary { pixels_per_radian: (1.5 * 64.0 / 0.4) as f32, planes: show.planes.clone() };
            assert_eq!(show.orders(), (Some(primary), estimate, detail));
            show.planes.push(Plane { normal: DVec3::Z, offset_m: 3.0 });
            show.world_from_room.translation.x += 1.0;
        }
        show.planes = vec![Plane { normal: DVec3::Z, offset_m: 3.0 }; 20];
        assert_eq!(show.orders().0.map(|primary| primary.planes.len()), Some(8), "no more than nodes take");
    }
}

#[test]
fn detail_is_ordered_where_it_was_chosen_and_there_are_hierarchies() {
    assert_eq!(Show::ordering(None, Some(DETAIL), None).orders(), (None, None, None), "there are none");
    assert_eq!(Show::ordering(None, None, Some(index())).orders(), (None, None, None), "nobody wants it");
    let mut show = Show::ordering(None, Some(DETAIL), Some(index()));
    show.master.handle_disconnected(PEERS[1], show.now);
    show.begin();
    let told = show.join(1);
    let [ToTile::Welcome(_), ToTile::Manifest(manifest), ToTile::Frame(frame)] = &told[..] else { panic!("{told:?}") };
    assert_eq!((manifest.hierarchies, frame.detail), (Some(index()), Some(DETAIL)), "who comes late is told, too");
    let mut show = Show::ordering(None, Some(DETAIL), Some(index()));
    for frame in 0..40 {
        show.world_from_room = DAffine3::from_translation(DVec3::X * f64::from(frame));
        show.orders();
        assert!(frame < 20 || show.allocations == 0, "frame {frame}: {} allocations", show.allocations);
    }
}

/// All of it in every frame, whatever base a node has; and nothing where nothing is drawn in detail.
#[test]
fn what_is_away_of_hierarchies_is_said_with_each_detail() {
    use Presence::{Away, There};
    let mut show = Show::ordering(None, Some(DETAIL), Some(index()));
    type Words = &'static [(u32, Presence)];
    let frames: [(Words, &[u32]); 5] =
        [(&[], &[]), (&[(1, Away), (2, Away)], &[2, 3]), (&[], &[2, 3]), (&[(0, Away)], &[0, 1, 2, 3]), (&[(1, There)], &[0, 1])];
    for (presence, away) in frames {
        show.presence = presence.iter().map(|(object, presence)| (ObjectId(*object), *presence)).collect();
        let outputs = show.begin();
        for (node, peer) in PEERS.into_iter().enumerate() {
            let Some(ToTile::Frame(frame)) = sent(&outputs, peer).pop() else { panic!("no frame") };
            assert_eq!(frame.away.leaves().collect::<Vec<_>>(), away, "frame {}", show.number);
            show.ready(node, show.number, 1);
        }
        show.number += 1;
        show.now += PERIOD;
        show.master.handle_timeout(show.now);
    }
    show.master.handle_disconnected(PEERS[1], show.now);
    show.presence.clear();
    show.begin();
    let told = show.join(1);
    let Some(ToTile::Frame(frame)) = told.last() else { panic!("{told:?}") };
    assert_eq!(frame.away.leaves().collect::<Vec<_>>(), [0, 1], "who comes late is told, too");
    // A master that takes its place has heard the last words.
    let words = show.master.course().expect("it runs").presence;
    for (detail, away) in [(Some(DETAIL), &[0, 1][..]), (None, &[])] {
        let mut heir = Show::ordering(None, detail, Some(index()));
        heir.presence.clone_from(&words);
        let Some(ToTile::Frame(frame)) = sent(&heir.begin(), PEERS[0]).pop() else { panic!("no frame") };
        assert_eq!((frame.detail, &frame.away.leaves().collect::<Vec<_>>()[..]), (detail, away));
    }
}

#[test]
fn what_comes_and_goes_takes_no_memory() {
    let mut show = Show::ordering(None, Some(DETAIL), Some(index()));
    for frame in 0..40 {
        let presence = if frame % 2 == 0 { Presence::Away } else { Presence::There };
        show.presence = if frame < 20 { vec![(ObjectId(1), presence)] } else { vec![] };
        show.orders();
        assert!(frame < 30 || show.allocations == 0, "frame {frame}: {} allocations", show.allocations);
    }
}

#[test]
fn a_budget_of_time_follows_the_slowest() {
    let mut show = Show::new(WallBudget::TimeUs(TIME_US));
    assert_eq!(show.frame(|triangles| both(triangles, COST_NS)).0.triangles.abs_diff(FIRST_TRIANGLES) * 20 / FIRST_TRIANGLES, 0);
    let settled = show.frames(40, COST_NS);
    let expected = TIME_US / COST_NS * 900;
    assert!(settled.abs_diff(expected) < expected / 20, "{settled}, {expected} by what it costs");
    let (_, spent) = show.frame(|triangles| both(triangles, COST_NS));
    assert_eq!((spent.triangles, spent.is_over), (settled, false));
    // It becomes dearer by half: over for a frame or two.
    let (_, spent) = show.frame(|triangles| both(triangles, COST_NS * 3 / 2));
    assert!(spent.is_over && spent.slowest_us > TIME_US, "{spent:?}");
    assert!(show.frames(10, COST_NS * 3 / 2) < expected * 3 / 4);
    assert!(!show.frame(|triangles| both(triangles, COST_NS * 3 / 2)).1.is_over);
}

#[test]
fn who_draws_nothing_or_says_nothing_changes_nothing() {
    let mut show = Show::new(WallBudget::TimeUs(TIME_US));
    let settled = show.frames(40, COST_NS);
    for _ in 0..20 {
        assert_eq!(show.frame(|_| [None, None]).0.triangles, settled);
    }
    for _ in 0..20 {
        assert_eq!(show.frame(|_| [Some(0), Some(0)]).0.triangles, settled);
    }
}

#[test]
fn a_node_that_was_passed_over_counts_for_a_few_answers() {
    let mut show = Show::new(WallBudget::TimeUs(TIME_US));
    let settled = show.frames(40, COST_NS);
    // One tile's costs are five times as high of a sudden: it is passed over, and comes back in time because the budget shrinks.
    for _ in 0..20 {
        show.frame(|triangles| [both(triangles, COST_NS)[0], both(triangles, 5 * COST_NS)[1]]);
    }
    let (order, spent) = show.frame(|triangles| [both(triangles, COST_NS)[0], both(triangles, 5 * COST_NS)[1]]);
    assert!(order.triangles.abs_diff(settled / 5) < settled / 40, "{order:?}");
    assert!(!spent.is_over && spent.slowest_us > TIME_US * 4 / 5, "{spent:?}");
}

#[test]
fn one_that_stays_late_takes_nothing_from_the_others() {
    let mut show = Show::new(WallBudget::TimeUs(TIME_US));
    let settled = show.frames(40, COST_NS);
    let late_us = PERIOD.as_micros() as u32 - 2000;
    let mut least = settled;
    for _ in 0..usize::from(LATE_ANSWERS) + 60 {
        least = least.min(show.frame(|triangles| [both(triangles, 2 * COST_NS)[0], Some(late_us)]).0.triangles);
    }
    assert!(least < settled / 10, "it may have been for the triangles' sake: {least}");
    let (order, _) = show.frame(|triangles| [both(triangles, 2 * COST_NS)[0], Some(late_us)]);
    assert!(order.triangles.abs_diff(settled) < settled / 20, "{order:?}");
}

#[test]
fn nobody_drew_for_longer_than_the_frame_has_been_there() {
    let mut show = Show::new(WallBudget::TimeUs(TIME_US));
    let settled = show.frames(40, COST_NS);
    for _ in 0..20 {
        show.begin();
        show.now += Duration::from_millis(1);
        let number = show.number;
        show.ready(0, number, u32::MAX);
        show.ready(1, number, 900);
        show.now += PERIOD;
        show.master.handle_timeout(show.now);
        show.outputs();
        show.number += 1;
    }
    let after = show.frame(|_| [None, None]).0.triangles;
    assert!(after > settled, "1 ms is less than there is: {after}");
}

#[test]
fn all_is_drawn_when_the_camera_rests_and_only_then() {
    let rests = EstimateOptions { budget: WallBudget::TimeUs(TIME_US), scene_triangles: SCENE, completes: true };
    let mut show = Show::with(rests.clone());
    let settled = |show: &mut Show| {
        for frame in 0..60 {
            show.world_from_room = DAffine3::from_translation(DVec3::X * f64::from(frame));
            assert!(!show.frame(|triangles| both(triangles, COST_NS)).0.is_complete);
        }
        let (order, spent) = show.frame(|triangles| both(triangles, COST_NS));
        (order.triangles, spent.triangles)
    };
    let (triangles, _) = settled(&mut show);
    let complete = |show: &mut Show| show.frame(|_| [Some(19_000), Some(18_000)]);
    // One frame rests already.
    for _ in 1..REST_FRAMES - 1 {
        let (order, _) = show.frame(|triangles| both(triangles, COST_NS));
        assert!(!order.is_complete);
    }
    // The first complete picture is waited for, however short the wait is else.
    let late = |show: &mut Show| show.frame(|_| [Some(PERIOD.as_micros() as u32), Some(18_000)]);
    let (order, spent) = late(&mut show);
    assert!(order.is_complete && Duration::from_micros(spent.slowest_us.into()) > WAIT, "{spent:?}");
    assert_eq!(late(&mut show).1.slowest_us, 18_000, "the next one is not");
    for _ in 0..10 {
        let (order, spent) = complete(&mut show);
        assert!(order.is_complete && spent.is_complete && !spent.is_over, "{order:?}, {spent:?}");
    }
    let order = complete(&mut show).0;
    assert!(order.triangles.abs_diff(triangles) < triangles / 20, "how long all takes is another matter: {order:?}");

    let moved = |x| Moved { object: ObjectId(3), transform: Transform::from(DAffine3::from_translation(DVec3::X * x)) };
    let changes: [fn(&mut Show); 4] = [
        |show| show.world_from_room.translation.y += 1e-9,
        |show| show.eyes[1].z += 1e-9,
        |show| show.presence = vec![(ObjectId(1), Presence::Away)],
        |show| show.moved = vec![Moved { object: ObjectId(3), transform: Transform::from(DAffine3::IDENTITY) }],
    ];
    for change in changes {
        change(&mut show);
        assert!(!complete(&mut show).0.is_complete, "something has changed");
        show.presence.clear();
        for _ in 1..REST_FRAMES {
            assert!(!complete(&mut show).0.is_complete);
        }
        assert!(complete(&mut show).0.is_complete);
    }
    // An object that is put where it is does not move, one that goes does.
    assert!(complete(&mut show).0.is_complete);
    show.moved = vec![moved(1.0)];
    assert!(!complete(&mut show).0.is_complete);

    let mut show = Show::with(EstimateOptions { completes: false, ..rests });
    assert!((0..3 * REST_FRAMES).all(|_| !complete(&mut show).0.is_complete), "nobody wants it");
}

#[test]
fn a_budget_grows_with_the_scene() {
    let mut show = Show::new(WallBudget::Triangles(5000));
    show.frame(|_| [None, None]);
    show.master.know_triangles(WallBudget::Triangles(7000), 2 * SCENE);
    assert_eq!(show.frame(|_| [None, None]).0.triangles, 7000);

    let options = EstimateOptions { budget: WallBudget::TimeUs(TIME_US), scene_triangles: 3000, completes: false };
    let mut show = Show::with(options);
    assert_eq!(show.frames(20, COST_NS), 3000, "there are no more");
    show.master.know_triangles(WallBudget::TimeUs(TIME_US), SCENE);
    let grown = show.frames(40, COST_NS);
    assert!(grown > TIME_US / COST_NS * 850, "{grown}");
    assert!((0..40).map(|_| show.frame(|_| [Some(15_000), None]).0.triangles).last() == Some(LEAST_TRIANGLES));
}

#[test]
fn a_frame_takes_no_memory() {
    let mut show = Show::new(WallBudget::TimeUs(TIME_US));
    for frame in 0..40 {
        show.world_from_room = DAffine3::from_translation(DVec3::X * f64::from(frame));
        show.frame(|triangles| both(triangles, COST_NS));
        assert!(frame < 20 || show.allocations == 0, "frame {frame}: {} allocations", show.allocations);
    }
}
