//! The steady-state frame allocates nothing: memory grows while a walk is new, and is reused when it comes round again.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::{VisibleDelta, VisibleSet};
use mullion_common::wall::{Wall, WallConfig};
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::tree::{Bounds, CullTree, hierarchy_over};

const FRAMES: u32 = 40;

fn walls() -> Vec<Wall> {
    ["wall_4x4.toml", "cave_4.toml", "projectors_3x2.toml"]
        .iter()
        .map(|file| {
            let path = format!("{}/../configs/{file}", env!("CARGO_MANIFEST_DIR"));
            WallConfig::parse(&std::fs::read_to_string(path).expect("it ships")).expect("a wall")
        })
        .collect()
}

/// Turned boxes of 1 × 2 × 3 parts on a bent grid.
fn leaf(at: u32) -> Obb {
    let [x, y, z] = [at % 40, at / 40 % 10, at / 400].map(f64::from);
    let half = DVec3::new(0.1, 0.2, 0.3) * (1.0 + (x * 0.7).sin().abs());
    let place = DAffine3::from_rotation_translation(
        DQuat::from_scaled_axis(DVec3::new(x, y, z) * 0.1),
        DVec3::new(x * 1.5 - 30.0, y * 1.2 + (x * 0.4).sin(), z * 2.0 - 50.0),
    );
    Obb::from(Aabb { min: -half, max: half }).transformed(&place)
}

fn tree() -> CullTree {
    let leaves: Vec<Obb> = (0..20_000).map(leaf).collect();
    let (nodes, _) = hierarchy_over(&leaves);
    let mut tree = CullTree::editable(Arc::new(ObjectHierarchy::new(nodes).expect("a tree")), Bounds::Obb);
    (0..20_000).step_by(1000).for_each(|leaf| tree.remove_leaf(leaf));
    tree
}

/// What a show does in a frame: leaves sway, the tree follows, every view is culled, and sets become deltas.
struct Show {
    tree: CullTree,
    bounds: Vec<Obb>,
    culler: Culler,
    algorithm: Algorithm,
    sets: Vec<VisibleSet>,
    before: Vec<VisibleSet>,
    delta: VisibleDelta,
}

impl Show {
    fn new(algorithm: Algorithm, wall: &Wall) -> Self {
        let tree = tree();
        let bounds = (0..tree.hierarchy().leaf_count()).map(|leaf| *tree.leaf_bound(leaf)).collect();
        let sets = || vec![VisibleSet::default(); wall.views().len()];
        let (culler, delta) = (Culler::new(algorithm, wall), VisibleDelta::default());
        Self { tree, bounds, culler, algorithm, sets: sets(), before: sets(), delta }
    }

    fn frame(&mut self, wall: &Wall, eyes: &[DVec3], frame: u32, moving: u32) -> u32 {
        let turn = f64::from(frame) / f64::from(FRAMES) * std::f64::consts::TAU;
        for leaf in (0..moving).map(|k| k * 97 % self.bounds.len() as u32) {
            let mut bound = self.bounds[leaf as usize];
            bound.center.y += (turn + f64::from(leaf)).sin();
            self.tree.move_leaf(leaf, &bound);
        }
        self.tree.refit(self.algorithm.tree_form());
        let room = DAffine3::from_rotation_translation(DQuat::from_rotation_y(turn), DVec3::new(turn.sin() * 20.0, 2.0, 0.0));
        self.culler.cull(&self.tree, wall, eyes, &room, &mut self.sets);
        let mut seen = 0;
        for (set, before) in self.sets.iter().zip(&mut self.before) {
            self.delta.between(before, set);
            before.clone_from(set);
            seen += set.len();
        }
        seen
    }
}

fn assert_allocates_nothing(mut show: Show, wall: &Wall, moving: u32, name: &str) {
    let eyes = wall.default_eyes();
    let mut seen = 0;
    let mut round = |show: &mut Show| (0..FRAMES).for_each(|frame| seen += show.frame(wall, &eyes, frame, moving));
    // The second round begins where the first one ended: a delta that the first one has not met.
    round(&mut show);
    round(&mut show);
    let counted = allocation_counter::measure(|| round(&mut show));
    assert_eq!(counted.count_total, 0, "{name} on {}: {counted:?}", wall.name());
    assert!(seen > 10_000, "{name} on {}: something is in view", wall.name());
}

#[test]
fn culls_and_deltas_allocate_nothing() {
    for wall in walls() {
        for algorithm in Algorithm::ALL {
            assert_allocates_nothing(Show::new(algorithm, &wall), &wall, 0, algorithm.name());
        }
        let mut slack = Show::new(Algorithm::Sweep, &wall);
        slack.culler = Culler::new(Algorithm::Sweep, &wall).with_slack(true);
        assert_allocates_nothing(slack, &wall, 0, "sweep with slack");
        let mut threads = Show::new(Algorithm::Sweep, &wall);
        threads.culler = Culler::new(Algorithm::Sweep, &wall).with_threads(2).expect("a thread");
        assert_allocates_nothing(threads, &wall, 0, "sweep on two threads");
    }
}

#[test]
fn moving_and_refitting_allocate_nothing() {
    for wall in walls() {
        for algorithm in [Algorithm::Adaptive, Algorithm::Sweep] {
            assert_allocates_nothing(Show::new(algorithm, &wall), &wall, 500, algorithm.name());
        }
    }
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocation_counter::measure(|| drop(std::hint::black_box(vec![1u8; 100]))).count_total, 1);
}
