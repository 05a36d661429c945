//! Goal: while a scene grows, the wall goes on: no frame waits for it, all nodes begin with one frame, and what a node has it keeps.
//! Method: a master and its nodes in memory on virtual time, from a seed. Messages come at once, blobs take up to a few frames. One node
//! loses its connection and comes back, one joins meanwhile, one never gets the new tables until long after; the scene grows twice.
//!
//! A failing seed is printed. `MULLION_SIM_SEEDS=1000` runs more.

mod session_support;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use glam::{DAffine3, DVec3};
use mullion_client::missing::WhenMissing;
use mullion_client::tile_session::{Action, DrawStats, EndedBy, FrameToDraw, TileSession};
use mullion_common::scene::{
    ChunkHash, ObjectId, Package, SceneManifest, SceneSize, SectionKind, Tessellation, TessellationParts, Transform,
};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::Wall;
use mullion_common::wire::{Insertion, Moved, Opening, SectionRef, Steering, ToTile, body_of};
use mullion_server::master::{EPOCH_WAIT, FrameInput, Master, MasterOptions, Output, Pace, PeerId};
use mullion_server::prepare::{Placement, graft};
use mullion_server::swap_barrier::{BarrierOptions, NodeIndex, Standing};
use session_support::random::Random;
use session_support::{chunks_of, package, transform, visible, wall};

const PERIOD: Duration = Duration::from_millis(10);
const NODES: usize = 4;
/// Loses its connection and comes back.
const RETURNS: usize = 1;
/// Joins while the scene grows.
const LATE: usize = 2;
/// Gets none of the new tables for long.
const STARVED: usize = 3;
/// When the scene grows first, in frames, and when it may again.
const GROWS_AT: [u64; 2] = [40, 1200];
/// When the starved node gets what it lacks: after the first growth was begun without it.
const FED_AT: u64 = 1150;
const FRAMES: u64 = 1300;

struct Node {
    session: TileSession,
    peer: Option<PeerId>,
    /// Blobs on their way, and the frame before which they come.
    blobs: VecDeque<(u64, ChunkHash)>,
    fetched: BTreeMap<ChunkHash, u32>,
    scene: Option<Arc<SceneManifest>>,
    tessellations: u32,
    uploaded: BTreeSet<u32>,
    transforms: Vec<Transform>,
    drawn: Option<u64>,
    shown: Vec<u64>,
}

struct Growing {
    seed: u64,
    rng: Random,
    wall: Arc<Wall>,
    master: Master,
    next_peer: u64,
    frame: u64,
    nodes: Vec<Node>,
    /// The scene with each growth; how many of them frames are of.
    packages: Vec<Arc<Package>>,
    grown: usize,
    began_at: Vec<u64>,
    blobs: BTreeMap<ChunkHash, Vec<u8>>,
    /// What the starved node does not get.
    withheld: BTreeSet<ChunkHash>,
    sets: BTreeMap<u64, Vec<VisibleSet>>,
    places: Vec<Transform>,
    when_missing: WhenMissing,
    passed_over: Vec<(u64, NodeIndex)>,
}

/// The sections of what a package has beyond a size, by the names of their bytes.
fn sections(package: &Package, since: SceneSize, blobs: &mut BTreeMap<ChunkHash, Vec<u8>>) -> [SectionRef; 4] {
    for (chunk, id) in package.scene.manifest.chunks.iter().zip(0..) {
        blobs.insert(chunk.hash, package.chunk(mullion_common::scene::ChunkId(id)).to_vec());
    }
    SectionKind::FOR_TILES.map(|kind| {
        let bytes = package.scene.manifest.section_since(kind, since).unwrap();
        let (hash, length) = (ChunkHash::of(&bytes), bytes.len() as u64);
        blobs.insert(hash, bytes);
        SectionRef { kind, hash, length }
    })
}

impl Growing {
    fn new(seed: u64) -> Self {
        let wall = wall(NODES as u32, 1);
        let base = package(60);
        let at = |under, x: f64| Placement {
            name: "added".into(),
            under,
            world_from_root: DAffine3::from_translation(DVec3::new(x, 3.0, -2.0)),
        };
        // Half of the chunks are those of the first scene.
        let once = Arc::new(graft(&base, &package(120), &at(None, 7.0)).unwrap());
        let twice = Arc::new(graft(&once, &package(150), &at(Some(ObjectId(9)), -4.0)).unwrap());
        let mut blobs = BTreeMap::new();
        let bytes = Tessellation::new(TessellationParts::default(), &base.scene.manifest).expect("it names nothing").encode();
        let (kind, hash, length) = (SectionKind::Tessellation, ChunkHash::of(&bytes), bytes.len() as u64);
        let tessellation = SectionRef { kind, hash, length };
        blobs.insert(hash, bytes);
        let options = MasterOptions {
            barrier: BarrierOptions { wait: PERIOD, start_wait: Duration::ZERO, start_nodes: vec![] },
            pace: Pace::Every(PERIOD),
            first_frame: 0,
            frames: None,
            sections: sections(&base, SceneSize::default(), &mut blobs).into(),
            tessellation: Some(tessellation),
            hierarchies: None,
            insertions: vec![],
            adaptive: None,
            estimates: None,
            detail: None,
            session_seed: [7; 32],
        };
        let when_missing = [WhenMissing::Box, WhenMissing::Nothing][(seed % 2) as usize];
        let node = |index: usize| Node {
            session: TileSession::new(&wall.nodes()[index].name, None, 64 << 20, when_missing),
            peer: None,
            blobs: VecDeque::new(),
            fetched: BTreeMap::new(),
            scene: None,
            tessellations: 0,
            uploaded: BTreeSet::new(),
            transforms: Vec::new(),
            drawn: None,
            shown: Vec::new(),
        };
        Self {
            seed,
            rng: Random(seed),
            master: Master::new(Arc::clone(&wall), options, Duration::ZERO),
            next_peer: 0,
            frame: 0,
            nodes: (0..NODES).map(node).collect(),
            wall,
            places: base.scene.manifest.transforms.clone(),
            packages: vec![base, once, twice],
            grown: 0,
            began_at: Vec::new(),
            blobs,
            withheld: BTreeSet::new(),
            sets: BTreeMap::new(),
            when_missing,
            passed_over: Vec::new(),
        }
    }

    fn now(&self) -> Duration {
        PERIOD * self.frame as u32
    }

    fn connect(&mut self, node: usize) {
        let peer = PeerId(self.next_peer);
        self.next_peer += 1;
        let n = &mut self.nodes[node];
        n.peer = Some(peer);
        n.session.connected();
        n.drawn = None;
        let hello = Opening::Control(n.session.hello());
        let now = self.now();
        self.master.handle_connected(peer, now);
        self.master.handle_opening(peer, hello, now);
        self.exchange();
    }

    fn disconnect(&mut self, node: usize) {
        let n = &mut self.nodes[node];
        n.session.disconnected();
        n.blobs.clear();
        n.fetched.clear();
        let peer = n.peer.take().unwrap();
        self.act(node);
        self.master.handle_disconnected(peer, self.now());
        self.exchange();
    }

    /// Lets everybody say and do what there is, until there is nothing; begins a frame where one is wanted.
    fn exchange(&mut self) {
        while let Some(output) = self.master.poll_output() {
            match output {
                Output::Send { peer, message } => {
                    let Some(node) = self.nodes.iter().position(|node| node.peer == Some(peer)) else { continue };
                    let message = ToTile::decode(body_of(&message.bytes)).unwrap();
                    self.nodes[node].session.handle_message(message);
                    self.act(node);
                }
                Output::WantFrame { number } => self.begin(number),
                Output::FrameReleased(released) => {
                    self.passed_over.extend(released.passed_over.iter().map(|node| (released.number, *node)));
                }
                Output::Close { peer, bye } => assert!(self.nodes.iter().all(|node| node.peer != Some(peer)), "{bye}"),
                Output::Shown { .. } => {}
                other => panic!("{other:?}"),
            }
        }
    }

    fn begin(&mut self, number: u64) {
        assert_eq!(number, self.frame);
        let now = self.now();
        if self.master.is_epoch_due(now) {
            self.master.enter_epoch();
            self.grown += 1;
            self.began_at.push(number);
            let all = &self.packages[self.grown].scene.manifest.transforms;
            self.places.extend_from_slice(&all[self.places.len()..]);
        }
        let leaf_count = self.packages[self.grown].scene.leaf_count();
        let sets: Vec<VisibleSet> = (0..NODES).map(|view| visible(self.seed, number, view, leaf_count)).collect();
        let object = self.rng.within(0, self.places.len() as u64) as u32 % self.places.len() as u32;
        let moved = Moved { object: ObjectId(object), transform: transform(object, number) };
        self.places[object as usize] = moved.transform;
        self.sets.insert(number, sets.clone());
        let input = FrameInput {
            number,
            scene_time_s: 0.0,
            world_from_room: DAffine3::IDENTITY,
            eyes: &self.wall.default_eyes(),
            shared_eye: DVec3::new(30.0, 1.0, 20.0),
            sets: &sets,
            moved: &[moved],
            primary: &[],
            budgets: &[],
            presence: &[],
            steering: Steering::default(),
        };
        self.master.begin_frame(&input, now, &mut |_| {});
    }

    fn act(&mut self, node: usize) {
        while let Some(action) = self.nodes[node].session.poll_action() {
            let n = &mut self.nodes[node];
            match action {
                Action::Send(message) => {
                    if let Some(peer) = n.peer {
                        self.master.handle_message(peer, message, self.now());
                    }
                }
                Action::Fetch(blobs) => {
                    for (hash, length) in blobs {
                        assert_eq!(self.blobs[&hash].len() as u64, length);
                        let times = n.fetched.entry(hash).or_default();
                        *times += 1;
                        // A part without materials has the same table as another without.
                        assert!(*times == 1 || length <= 8, "node {node} fetches {hash} twice");
                        n.blobs.push_back((self.frame + self.rng.within(1, 4), hash));
                    }
                }
                Action::OpenScene(manifest, _) => {
                    n.transforms.clone_from(&manifest.transforms);
                    n.uploaded.clear();
                    n.scene = Some(manifest);
                }
                Action::TakeTessellation(tessellation) => {
                    assert!(n.scene.is_some() && tessellation.cells().is_empty(), "node {node}: it comes with the scene");
                    n.tessellations += 1;
                }
                Action::TakeHierarchy { .. } | Action::ForgetHierarchy(_) => panic!("nobody asked for hierarchies"),
                Action::GrowScene(manifest) => {
                    let before = n.scene.replace(Arc::clone(&manifest)).expect("a scene that grows");
                    assert_eq!(manifest.leaves[..before.leaves.len()], before.leaves[..]);
                    n.transforms.extend_from_slice(&manifest.transforms[before.transforms.len()..]);
                    assert!(self.packages.iter().any(|package| package.scene.manifest == *manifest));
                }
                Action::Upload { chunk, bytes } => {
                    assert_eq!(bytes, self.packages[2].chunk(chunk));
                    assert!(n.uploaded.insert(chunk.0), "node {node}: a chunk is uploaded once");
                }
                Action::Evict(_) => panic!("there is room"),
                Action::Count(..) => panic!("nobody asked for counts"),
                Action::SetTransform(moved) => n.transforms[moved.object.0 as usize] = moved.transform,
                Action::Draw(frame) => {
                    self.check(node, &frame);
                    let n = &mut self.nodes[node];
                    n.drawn = Some(frame.number);
                    n.session.drawn(frame.number, DrawStats::default());
                }
                Action::Show { frame } => {
                    assert_eq!(n.drawn, Some(frame));
                    n.shown.push(frame);
                }
                Action::Close { bye, by } => panic!("node {node} and its master part: {bye} ({})", by == EndedBy::Node),
            }
        }
    }

    fn check(&self, node: usize, frame: &FrameToDraw) {
        let n = &self.nodes[node];
        assert_eq!(frame.views[0].leaves, self.sets[&frame.number][node], "node {node}, frame {}", frame.number);
        assert_eq!(frame.epoch as usize, 1 + self.began_at.iter().filter(|began| **began <= frame.number).count());
        let manifest = n.scene.as_ref().expect("a scene is open before anything is drawn");
        assert!(n.transforms.len() >= self.places.len(), "node {node} holds what frame {} speaks of", frame.number);
        if frame.number == self.frame {
            assert_eq!(n.transforms[..self.places.len()], self.places, "node {node}, frame {}", frame.number);
        }
        let one = |leaf| VisibleSet::from_ranges([LeafRange::new(leaf, leaf + 1)]);
        let lacks = |leaf: &u32| chunks_of(manifest, &one(*leaf)).any(|c| !n.uploaded.contains(&c.0));
        let lacking: Vec<u32> = frame.views[0].leaves.leaves().filter(lacks).collect();
        assert_eq!(frame.views[0].missing.leaves().collect::<Vec<_>>(), lacking, "node {node}, frame {}", frame.number);
        assert_eq!(frame.when_missing, self.when_missing);
    }

    fn deliver(&mut self, node: usize) {
        let is_starved = node == STARVED && self.frame < FED_AT;
        let (due, rest): (VecDeque<_>, VecDeque<_>) = self.nodes[node]
            .blobs
            .drain(..)
            .partition(|(at, hash)| *at <= self.frame && !(is_starved && self.withheld.contains(hash)));
        self.nodes[node].blobs = rest;
        for (_, hash) in due {
            self.nodes[node].session.handle_blob(hash, self.blobs[&hash].clone());
            self.act(node);
        }
    }

    fn run(mut self) {
        let (leaves_at, joins_at) = (GROWS_AT[0] + self.rng.within(0, 4), GROWS_AT[0] + self.rng.within(0, 4));
        for node in [0, RETURNS, STARVED] {
            self.connect(node);
        }
        for frame in 0..FRAMES {
            self.frame = frame;
            if let Some(growth) = GROWS_AT.iter().position(|at| *at == frame) {
                let (from, to) = (Arc::clone(&self.packages[growth]), Arc::clone(&self.packages[growth + 1]));
                let part = sections(&to, from.scene.manifest.size(), &mut self.blobs);
                if growth == 0 {
                    self.withheld = part.iter().map(|section| section.hash).collect();
                }
                let insertion = Insertion {
                    package: "added".into(),
                    hash: ChunkHash([0; 32]),
                    under: None,
                    world_from_root: DAffine3::IDENTITY.to_cols_array(),
                };
                self.master.propose_epoch(insertion, &part, self.now()).unwrap();
                assert_eq!(self.master.standbys_follow(self.now()), Some(Ok(())));
                self.master.begin_epoch(self.now());
                self.exchange();
            }
            if frame == leaves_at {
                self.disconnect(RETURNS);
            }
            if frame == leaves_at + 2 {
                self.connect(RETURNS);
            }
            if frame == joins_at {
                self.connect(LATE);
            }
            (0..NODES).for_each(|node| self.deliver(node));
            self.exchange();
            self.master.handle_timeout(self.now());
            self.exchange();
        }
        self.check_end();
    }

    fn check_end(&self) {
        let [first, second] = self.began_at[..] else { panic!("the scene grew {} times", self.began_at.len()) };
        let wait = EPOCH_WAIT.as_millis() as u64 / PERIOD.as_millis() as u64;
        assert!(
            (GROWS_AT[0] + wait..=GROWS_AT[0] + wait + 1).contains(&first),
            "one node never said that it is prepared: {first}"
        );
        assert!(second > GROWS_AT[1] && second < GROWS_AT[1] + 60, "{second}");
        for (node, n) in self.nodes.iter().enumerate() {
            let shows = |frame: u64| n.shown.contains(&frame);
            if node != STARVED {
                assert!((first - 5..first + 5).all(shows), "node {node} shows every frame around the first growth");
            } else {
                assert!(shows(first - 1), "the starved one shows every frame of the old epoch");
                // Fed, it still draws the frame that runs.
                assert_eq!((first..FED_AT - 1).find(|frame| shows(*frame)), None, "the starved one holds its picture");
            }
            assert!((second - 5..FRAMES - 1).all(shows), "node {node} shows every frame from the second growth on");
            assert_eq!(self.master.standing(NodeIndex(node as u16)), Standing::Live);
            assert_eq!(n.scene.as_deref(), Some(&self.packages[2].scene.manifest));
            assert_eq!(n.tessellations, 1, "node {node}: it stays what it was");
        }
        let late = self.passed_over.iter().filter(|(frame, _)| *frame > 5);
        assert_eq!(late.collect::<Vec<_>>(), [] as [&(u64, NodeIndex); 0], "nobody was waited for in vain");
    }
}

#[test]
fn a_wall_goes_on_while_its_scene_grows() {
    let seeds = std::env::var("MULLION_SIM_SEEDS").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(24);
    for seed in 0..seeds {
        println!("seed {seed}");
        Growing::new(seed).run();
    }
}
