//! Goal: a scene grows on all nodes with one frame, as soon as those that are waited for hold what is new, and whoever does not is no
//! burden on the others.
//! Method: the master alone, driven message by message on virtual time.

mod outputs;

use std::sync::Arc;
use std::time::Duration;

use glam::{DAffine3, DVec3};
use mullion_common::scene::{BlobRef, ChunkHash, ObjectId, SectionKind, Transform};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{Wall, WallConfig};
use mullion_common::wire::{
    ByeCode, Frame, Hello, Insertion, Insertions, MAX_PARTS, Manifest, Moved, Opening, Part, SectionRef, StandbyHello, Steering,
    ToMaster, ToStandby, ToTile,
};
use mullion_server::master::{EPOCH_WAIT, EpochError, FrameInput, Hierarchies, Master, MasterOptions, Output, Pace, PeerId};
use mullion_server::swap_barrier::{BarrierOptions, NodeIndex, Standing};
use outputs::{bodies, closed, sent};

const A: PeerId = PeerId(1);
const B: PeerId = PeerId(2);
const LATE: PeerId = PeerId(3);
const STANDBY: PeerId = PeerId(4);
const PERIOD: Duration = Duration::from_millis(10);

fn wall() -> Arc<Wall> {
    let text = "[grid]\ncolumns = 3\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
    Arc::new(WallConfig::parse(text).unwrap())
}

/// Of what the show began with.
fn tessellation() -> SectionRef {
    SectionRef { kind: SectionKind::Tessellation, hash: ChunkHash([9; 32]), length: 56 }
}

/// Of its hierarchies of detail.
fn index() -> BlobRef {
    BlobRef { hash: ChunkHash([8; 32]), length: 44 }
}

fn part(name: u8) -> [SectionRef; 4] {
    SectionKind::FOR_TILES.map(|kind| SectionRef { kind, hash: ChunkHash([name; 32]), length: 40 })
}

fn insertion(number: u8) -> Insertion {
    Insertion { package: format!("{number}.mullion"), hash: ChunkHash([number; 32]), under: None, world_from_root: [0.0; 12] }
}

/// A master on its own clock, which a frame moves on by its period.
struct Show {
    master: Master,
    now: Duration,
    next: u64,
    outputs: Vec<Output>,
}

impl Show {
    fn new() -> Self {
        let barrier = BarrierOptions { wait: Duration::from_millis(8), start_wait: Duration::ZERO, start_nodes: vec![] };
        let options = MasterOptions {
            barrier,
            pace: Pace::Every(PERIOD),
            first_frame: 0,
            frames: None,
            sections: part(0).into(),
            tessellation: Some(tessellation()),
            hierarchies: Some(Hierarchies { index: index(), leaves: Arc::default() }),
            insertions: vec![],
            adaptive: None,
            estimates: None,
            detail: None,
            session_seed: [1; 32],
        };
        let master = Master::new(wall(), options, Duration::ZERO);
        Self { master, now: Duration::ZERO, next: 0, outputs: Vec::new() }
    }

    fn take(&mut self) -> Vec<Output> {
        std::iter::from_fn(|| self.master.poll_output()).collect()
    }

    fn join(&mut self, peer: PeerId, node: &str) -> Vec<ToTile> {
        self.master.handle_connected(peer, self.now);
        let hello = Hello { node: node.into(), part: Part::Own, credentials: None, cached: vec![] };
        self.master.handle_opening(peer, Opening::Control(hello), self.now);
        sent(&self.take(), peer)
    }

    fn say(&mut self, peer: PeerId, message: ToMaster) -> Vec<Output> {
        self.master.handle_message(peer, message, self.now);
        self.take()
    }

    /// Tells nodes that the scene grows, where no standby has a say.
    fn grow(&mut self, number: u8) -> Result<(), EpochError> {
        self.master.propose_epoch(insertion(number), &part(number), self.now)?;
        assert_eq!(self.master.standbys_follow(self.now), Some(Ok(())));
        self.master.begin_epoch(self.now);
        Ok(())
    }

    /// Begins the next frame, of the next epoch where that is due, and has these nodes draw it. Whom each frame was sent to comes back with it.
    fn frame(&mut self, ready: &[PeerId]) -> Vec<(PeerId, Frame)> {
        self.now = PERIOD * self.next as u32;
        self.master.handle_timeout(self.now);
        if self.master.is_epoch_due(self.now) {
            self.master.enter_epoch();
        }
        let at = |x: f64| Moved { object: ObjectId(0), transform: Transform::from(DAffine3::from_translation(DVec3::X * x)) };
        let input = FrameInput {
            number: self.next,
            scene_time_s: 0.0,
            world_from_room: DAffine3::IDENTITY,
            eyes: &[DVec3::Z; 3],
            shared_eye: DVec3::Z,
            sets: &[VisibleSet::all(5), VisibleSet::all(self.next as u32 % 7), VisibleSet::default()],
            moved: &if self.next == 0 { vec![at(3.0)] } else { vec![] },
            primary: &[],
            budgets: &[],
            presence: &[],
            steering: Steering::default(),
        };
        self.master.begin_frame(&input, self.now, &mut |_| {});
        let frame = self.next;
        self.next += 1;
        let mut outputs = self.take();
        for peer in ready {
            outputs.extend(self.say(*peer, ToMaster::Ready { frame, draw_us: 0, is_cut: false, shown: None }));
        }
        // Over, whoever is ready.
        self.master.handle_timeout(self.now + Duration::from_millis(8));
        outputs.extend(self.take());
        let frames = [A, B, LATE].into_iter().flat_map(|peer| {
            let of_peer = sent(&outputs, peer).into_iter().filter_map(move |message| match message {
                ToTile::Frame(frame) => Some((peer, frame)),
                _ => None,
            });
            of_peer.collect::<Vec<_>>()
        });
        let frames = frames.collect();
        self.outputs = outputs;
        frames
    }

    fn passed_over(&self) -> Vec<NodeIndex> {
        self.outputs
            .iter()
            .find_map(|o| if let Output::FrameReleased(r) = o { Some(r.passed_over.clone()) } else { None })
            .unwrap()
    }

    fn released_at_once(&self) -> bool {
        self.outputs.iter().any(|o| matches!(o, Output::FrameReleased(r) if r.waited == Duration::ZERO))
    }
}

/// Two live nodes that have drawn frame 1, and were told of epoch 2.
fn growing() -> Show {
    let mut show = Show::new();
    show.join(A, "t0x0");
    show.join(B, "t1x0");
    show.frame(&[A, B]);
    show.frame(&[A, B]);
    show.grow(1).unwrap();
    let outputs = show.take();
    let (tessellation, hierarchies) = (Some(tessellation()), Some(index()));
    let whole = Manifest { epoch: 2, sections: [part(0), part(1)].concat(), tessellation, hierarchies };
    for peer in [A, B] {
        assert_eq!(sent(&outputs, peer), [ToTile::Manifest(whole.clone())]);
    }
    show
}

#[test]
fn an_epoch_begins_when_all_live_nodes_are_prepared_and_deltas_go_on() {
    let mut show = growing();
    assert!(show.frame(&[A, B]).iter().all(|(_, frame)| frame.epoch == 1));
    show.say(A, ToMaster::Prepared { epoch: 2 });
    assert!(show.frame(&[A, B]).iter().all(|(_, frame)| frame.epoch == 1), "B is waited for");
    show.say(B, ToMaster::Prepared { epoch: 2 });
    let frames = show.frame(&[A, B]);
    assert_eq!(frames.len(), 2);
    for (_, frame) in &frames {
        assert_eq!((frame.number, frame.epoch, frame.base, frame.moved.len()), (4, 2, Some(3), 0));
    }
    assert!(show.released_at_once() && show.passed_over().is_empty(), "nobody waits for it");
    let messages = show.join(LATE, "t2x0");
    let [ToTile::Welcome(_), ToTile::Manifest(manifest), ToTile::Frame(frame)] = &messages[..] else { panic!("{messages:?}") };
    assert_eq!((manifest.epoch, manifest.sections.len(), frame.epoch, frame.moved.len()), (2, 8, 2, 1));
}

#[test]
fn a_node_that_is_never_prepared_is_passed_by_and_costs_nobody_a_wait() {
    let mut show = growing();
    show.say(A, ToMaster::Prepared { epoch: 2 });
    let began = show.now;
    let first = loop {
        let frames = show.frame(&[A, B]);
        if frames[0].1.epoch == 2 {
            break show.now;
        }
        assert!(show.released_at_once());
    };
    assert!((EPOCH_WAIT..EPOCH_WAIT + PERIOD * 2).contains(&(first - began)), "{first:?}");
    assert_eq!(show.master.standing(NodeIndex(1)), Standing::Trying);
    // It draws none of the new frames, and says something of an old one: nothing waits for it.
    for _ in 0..3 {
        let old = show.next - 3;
        show.frame(&[A]);
        assert!(show.released_at_once() && show.passed_over().is_empty());
        show.say(B, ToMaster::Ready { frame: old, draw_us: 0, is_cut: false, shown: None });
        assert_eq!(show.master.standing(NodeIndex(1)), Standing::Trying);
    }
    show.say(B, ToMaster::Prepared { epoch: 2 });
    show.frame(&[A, B]);
    assert_eq!(show.master.standing(NodeIndex(1)), Standing::Live, "it is back with its first frame");
}

#[test]
fn who_joins_or_comes_back_meanwhile_is_told_of_both_epochs_and_not_waited_for() {
    let mut show = growing();
    let messages = show.join(LATE, "t2x0");
    let [ToTile::Welcome(_), ToTile::Manifest(now), ToTile::Manifest(next), ToTile::Frame(frame)] = &messages[..] else {
        panic!("{messages:?}")
    };
    assert_eq!((now.epoch, now.sections.len(), next.epoch, next.sections.len(), frame.epoch), (1, 4, 2, 8, 1));
    show.master.handle_disconnected(B, show.now);
    let again = PeerId(9);
    assert_eq!(show.join(again, "t1x0").len(), 4);
    show.say(A, ToMaster::Prepared { epoch: 2 });
    let frames = show.frame(&[A]);
    assert_eq!(frames.iter().map(|(peer, frame)| (*peer, frame.epoch)).collect::<Vec<_>>(), [(A, 2), (LATE, 2)]);
    assert!(show.released_at_once());
    // One that is prepared later becomes live like any other.
    show.say(LATE, ToMaster::Prepared { epoch: 2 });
    show.frame(&[A, LATE]);
    assert_eq!([0, 1, 2].map(|node| show.master.standing(NodeIndex(node))), [Standing::Live, Standing::Trying, Standing::Live]);
}

#[test]
fn one_growth_at_a_time_and_no_more_than_there_may_be() {
    let mut show = growing();
    assert_eq!(show.grow(2), Err(EpochError::Busy));
    assert_eq!(closed(&show.say(A, ToMaster::Prepared { epoch: 3 }), A), Some(ByeCode::Malformed), "nobody told it of that");
    show.say(B, ToMaster::Prepared { epoch: 2 });
    show.frame(&[]);
    show.master.handle_disconnected(B, show.now);
    for epoch in 2..MAX_PARTS {
        assert_eq!(show.grow(2), Ok(()), "epoch {epoch}");
        show.frame(&[]);
    }
    assert_eq!(show.grow(2), Err(EpochError::TooMany));
    let messages = show.join(LATE, "t2x0");
    assert!(matches!(&messages[1], ToTile::Manifest(manifest) if manifest.sections.len() == 4 * MAX_PARTS));
}

fn stand_by(show: &mut Show) -> Vec<ToStandby> {
    show.master.handle_connected(STANDBY, show.now);
    let hello = StandbyHello::of(&wall(), &part(0)).unwrap();
    show.master.handle_opening(STANDBY, Opening::Standby(hello), show.now);
    told(&show.take())
}

/// What the standby is told.
fn told(outputs: &[Output]) -> Vec<ToStandby> {
    bodies(outputs, STANDBY).into_iter().map(|body| ToStandby::decode(body).unwrap()).collect()
}

/// The epochs of the courses among that.
fn courses(told: &[ToStandby]) -> Vec<u32> {
    told.iter().filter_map(|message| if let ToStandby::Course(course) = message { Some(course.epoch) } else { None }).collect()
}

fn insertions(entered: u32, numbers: &[u8]) -> ToStandby {
    ToStandby::Insertions(Insertions { entered, list: numbers.iter().map(|number| insertion(*number)).collect() })
}

#[test]
fn a_scene_grows_once_its_standby_is_prepared() {
    let mut show = Show::new();
    show.join(A, "t0x0");
    show.frame(&[A]);
    let greeting = stand_by(&mut show);
    assert_eq!((&greeting[0], courses(&greeting)), (&insertions(0, &[]), vec![1]));
    show.say(STANDBY, ToMaster::Prepared { epoch: 1 });
    show.master.propose_epoch(insertion(1), &part(1), show.now).unwrap();
    let outputs = show.take();
    assert_eq!(told(&outputs), [insertions(0, &[1])]);
    assert!(sent(&outputs, A).is_empty(), "no node is told before");
    show.frame(&[A]);
    assert_eq!((show.master.standbys_follow(show.now), courses(&told(&show.outputs))), (None, vec![1]));
    show.say(STANDBY, ToMaster::Prepared { epoch: 2 });
    assert_eq!(show.master.standbys_follow(show.now), Some(Ok(())));
    show.master.begin_epoch(show.now);
    assert!(matches!(&sent(&show.take(), A)[..], [ToTile::Manifest(manifest)] if manifest.epoch == 2));
    show.say(A, ToMaster::Prepared { epoch: 2 });
    show.frame(&[A]);
    assert_eq!(courses(&told(&show.outputs)), [2]);
    // One that comes now is told of it first.
    show.master.handle_disconnected(STANDBY, show.now);
    let greeting = stand_by(&mut show);
    assert_eq!((&greeting[0], courses(&greeting)), (&insertions(1, &[1]), vec![2]));
    show.master.propose_epoch(insertion(2), &part(2), show.now).unwrap();
    assert_eq!(told(&show.take()), [insertions(1, &[1, 2])]);
    show.say(STANDBY, ToMaster::Prepared { epoch: 2 });
    assert_eq!(show.master.standbys_follow(show.now), None);
    assert_eq!(closed(&show.say(STANDBY, ToMaster::Prepared { epoch: 4 }), STANDBY), Some(ByeCode::Malformed));
    assert_eq!(show.master.standbys_follow(show.now), Some(Ok(())), "it is gone");
}

#[test]
fn what_a_standby_cannot_follow_is_refused_and_may_be_proposed_again() {
    let mut show = Show::new();
    show.join(A, "t0x0");
    stand_by(&mut show);
    show.say(STANDBY, ToMaster::Prepared { epoch: 1 });
    for _ in 0..2 {
        show.master.propose_epoch(insertion(1), &part(1), show.now).unwrap();
        assert_eq!(told(&show.take()), [insertions(0, &[1])]);
        assert_eq!(show.say(STANDBY, ToMaster::unprepared(2, "no such file".into())), []);
        let reason = "the master that stands by cannot follow: no such file".to_owned();
        assert_eq!(show.master.standbys_follow(show.now), Some(Err(reason)));
        assert_eq!(show.master.standbys_follow(show.now), None, "nothing is proposed");
    }
    // What it was prepared for in vain counts for nothing.
    show.master.propose_epoch(insertion(1), &part(1), show.now).unwrap();
    show.say(STANDBY, ToMaster::Prepared { epoch: 2 });
    show.say(STANDBY, ToMaster::unprepared(2, "lost".into()));
    assert!(matches!(show.master.standbys_follow(show.now), Some(Err(_))));
    show.master.propose_epoch(insertion(2), &part(2), show.now).unwrap();
    assert_eq!(show.master.standbys_follow(show.now), None);
    // One that takes too long is no longer waited for, and goes on hearing of what is shown.
    show.take();
    show.now += EPOCH_WAIT;
    assert_eq!(show.master.standbys_follow(show.now), Some(Ok(())));
    show.master.begin_epoch(show.now);
    show.next = (show.now.as_millis() / PERIOD.as_millis()) as u64;
    show.say(A, ToMaster::Prepared { epoch: 2 });
}

#[test]
fn a_standby_that_cannot_follow_what_is_shown_goes() {
    let mut show = Show::new();
    show.grow(1).unwrap();
    stand_by(&mut show);
    let out = show.say(STANDBY, ToMaster::unprepared(2, "no such file".into()));
    assert_eq!(closed(&out, STANDBY), Some(ByeCode::Refused), "nodes know of it already");
    show.frame(&[]);
    assert_eq!(stand_by(&mut show)[0], insertions(1, &[1]));
    let out = show.say(STANDBY, ToMaster::unprepared(2, "no such file".into()));
    assert_eq!(closed(&out, STANDBY), Some(ByeCode::Refused));
    for (peer, node) in [(A, "t0x0"), (B, "t1x0")] {
        show.join(peer, node);
    }
    let out = show.say(A, ToMaster::unprepared(2, "what?".into()));
    assert_eq!((closed(&out, A), closed(&out, B)), (Some(ByeCode::Malformed), None), "a node is none");
}
