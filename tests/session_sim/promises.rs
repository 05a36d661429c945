//! What must hold: as a node draws, as a frame is released, and when all faults are over.

use std::collections::BTreeSet;

use mullion_client::missing::WhenMissing;
use mullion_client::tile_session::FrameToDraw;
use mullion_server::master::FrameReleased;
use mullion_server::swap_barrier::{NodeIndex, Standing};

use super::session_support::OBJECTS;
use super::{BACK_IN_PICTURE, END, ENOUGH_MEMORY_BYTES, LEAVES, Sim, WAIT, budget, detail};

impl Sim {
    pub fn check_draw(&mut self, node: usize, frame: &FrameToDraw) {
        let dropped = self.dropped.entry(frame.number).or_insert_with(|| frame.dropped.clone());
        assert_eq!(frame.dropped, *dropped, "node {node}, frame {}", frame.number);
        self.drops += u64::from(!dropped.is_empty());
        let objects: BTreeSet<u32> = dropped.leaves().map(|leaf| leaf % OBJECTS).collect();
        let whole = (0..LEAVES).filter(|leaf| objects.contains(&(leaf % OBJECTS))).count();
        assert_eq!(dropped.len() as usize, whole, "node {node}, frame {}", frame.number);
        assert!(dropped.is_empty() || self.options.adaptive.is_some());
        let n = &self.nodes[node];
        budget::check(&mut self.orders, self.options.estimates.as_ref(), frame, n.tessellation.as_ref());
        let asked = self.detail();
        detail::check(asked, frame, &n.hierarchies);
        let number = frame.number as usize;
        assert_eq!(frame.views[0].leaves, self.sets[number][node], "node {node}, frame {number}");
        assert_eq!(n.transforms, self.places[number], "node {node}, frame {number}");
        let manifest = n.scene.as_ref().expect("a scene is open before anything is drawn");
        let lacks = |leaf: &u32| n.hierarchies.lacks(manifest, &n.uploaded, *leaf, asked.is_some());
        let lacking: Vec<u32> = frame.views[0].leaves.leaves().filter(lacks).collect();
        assert_eq!(frame.views[0].missing.leaves().collect::<Vec<_>>(), lacking, "node {node}, frame {number}");
        assert!(lacking.is_empty() || self.setting.0 != WhenMissing::Hold, "node {node}, frame {number}");
    }

    pub fn check_release(&mut self, released: &FrameReleased) {
        let FrameReleased { number, waited, passed_over, .. } = released;
        self.released = Some(*number);
        self.released_at.push(self.now);
        for node in passed_over {
            self.passed_over[usize::from(node.0)] += 1;
        }
        let still_live: Vec<usize> =
            self.live_at_begin.iter().copied().filter(|n| self.master.standing(NodeIndex(*n as u16)) == Standing::Live).collect();
        for node in &still_live {
            // A node whose connection broke a moment ago may be live for the master still; it had said that it was ready.
            if self.nodes[*node].peer.is_some() {
                assert_eq!(self.nodes[*node].drawn, Some(*number), "node {node} is live and has not drawn frame {number}");
            }
        }
        if *number > 0 {
            assert!(*waited <= WAIT, "frame {number} waited {waited:?}");
            // The last node may be ready in the very microsecond in which the wait is over.
            if *waited == WAIT && self.heard_at < self.now && !self.live_at_begin.is_empty() {
                assert!(!passed_over.is_empty() || still_live.is_empty(), "frame {number} waited for nobody");
            }
        }
    }

    pub fn check_end(&self) {
        for (i, node) in self.nodes.iter().enumerate() {
            // New leaves come into view all the time: a node may be fetching while the last few frames pass.
            let shown_at = node.shown.map(|frame| self.released_at[frame as usize]);
            assert!(shown_at > Some(END - BACK_IN_PICTURE), "node {i} shows frame {:?} of {:?}", node.shown, self.released);
            if self.setting.1 == ENOUGH_MEMORY_BYTES {
                let (manifest, is_detailed) = (&self.package.scene.manifest, self.detail().is_some());
                let chunks = (0..LEAVES).flat_map(|leaf| node.hierarchies.chunks_of(manifest, leaf, is_detailed));
                let chunks: BTreeSet<u32> = chunks.map(|chunk| chunk.0).collect();
                assert_eq!((&node.uploaded, node.evictions), (&chunks, 0), "node {i} did not fetch ahead");
                assert!(!is_detailed || node.hierarchies.is_whole(), "node {i} did not fetch all of its hierarchies");
            }
            // Blobs may make a node late too: it is live from its first frame in time on, and fetches as the view moves.
            let faults = node.times_hung + 1;
            assert!(self.passed_over[i] <= 8 * faults, "node {i} was passed over {} times", self.passed_over[i]);
        }
        let frames = self.released_at.len() as u64;
        assert!(self.options.adaptive.is_some() || self.drops == 0);
        assert!(self.deltas > frames, "{} deltas in {frames} frames", self.deltas);
        assert!(self.shows_told > frames && self.shows_told <= self.shows, "{} of {} told", self.shows_told, self.shows);
    }
}
