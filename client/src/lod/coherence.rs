//! Frame coherence, the paper's future work: the cut of the last frame is kept. What is less worth than what waits is taken back, and questions
//! are asked again in turns: about what was hidden every few frames, about what was seen more rarely.

use std::cmp::Reverse;

use mullion_common::scene::VertexId;

use super::cut::NodeState;
use super::heap::Node;
use super::refinement::{Refinement, Start, Visibility};
use super::{LodObject, NodeSight};

/// Nodes that were hidden are asked again every so many frames.
const HIDDEN_PERIOD: u32 = 4;
/// Splits that were seen are asked again every so many frames.
const SPLIT_PERIOD: u32 = 16;
/// A split is made in place of another only if it is so many times as wrong: nothing goes back and forth.
const WORTH_A_CHANGE: f32 = 1.1;
/// A split is taken back once its node is wrong by less than this share of the least pixels.
const FAR_BELOW: f32 = 0.7;

impl Refinement {
    /// Puts all that a kept cut could split or take back into the queues.
    pub(super) fn offer_all(&mut self, objects: &[LodObject<'_>], object: usize) {
        let hierarchy = objects[object].hierarchy;
        for place in 0..self.cuts[object].slots().len() {
            let (vertex, state, next) = {
                let slot = &self.cuts[object].slots()[place];
                (slot.vertex, slot.node, slot.next)
            };
            match (state, next) {
                // Hidden as far as is known: whether it still is, is asked in turns.
                (NodeState::Occluded, Some(lead)) => {
                    if let NodeSight::Pixels(pixels) = self.sights[object].of(&hierarchy.bounds(lead)) {
                        if lead.0 % HIDDEN_PERIOD == self.frame % HIDDEN_PERIOD {
                            self.set_state(object, vertex, NodeState::Unknown);
                            self.splits.push(Node { pixels, object: object as u32, lead });
                        }
                    } else {
                        self.set_state(object, vertex, NodeState::Unknown);
                    }
                }
                _ => {
                    // No answer to an open question will come, and none holds for ever.
                    let is_due = vertex.0 % SPLIT_PERIOD == self.frame % SPLIT_PERIOD;
                    if state != NodeState::Visible || is_due {
                        self.set_state(object, vertex, NodeState::Unknown);
                    }
                    self.offer(objects, object, vertex);
                }
            }
            if !hierarchy.is_base(vertex) && !hierarchy.is_follower(vertex) {
                self.note_collapse(objects, object, vertex);
            }
        }
    }

    fn set_state(&mut self, object: usize, vertex: VertexId, state: NodeState) {
        if let Some(slot) = self.cuts[object].slot_mut(vertex) {
            slot.node = state;
        }
    }

    /// Asks again about splits that were seen, in turns.
    pub(super) fn ask_again(&mut self, objects: &[LodObject<'_>]) {
        for object in 0..objects.len() {
            let hierarchy = objects[object].hierarchy;
            for place in 0..self.cuts[object].slots().len() {
                let vertex = self.cuts[object].slots()[place].vertex;
                let is_due = vertex.0 % SPLIT_PERIOD == self.frame % SPLIT_PERIOD;
                if is_due && self.may_ask() && !hierarchy.is_follower(vertex) && self.cuts[object].can_collapse(hierarchy, vertex)
                {
                    self.ask(objects, &Node { pixels: 0.0, object: object as u32, lead: vertex }, true);
                }
            }
        }
    }

    /// What was found out about a split that is made.
    pub(super) fn answer_split(&mut self, objects: &[LodObject<'_>], object: u32, lead: VertexId, visibility: Visibility) {
        if let Some(slot) = self.cuts[object as usize].slot_mut(lead) {
            slot.is_hidden = visibility == Visibility::Occluded;
            self.note_collapse(objects, object as usize, lead);
        }
    }

    /// Puts a split into the queue of those that can be taken back, if it can.
    pub(super) fn note_collapse(&mut self, objects: &[LodObject<'_>], object: usize, lead: VertexId) {
        let hierarchy = objects[object].hierarchy;
        if self.start == Some(Start::Last) && self.cuts[object].can_collapse(hierarchy, lead) {
            let pixels = self.pixels_of_split(objects, object, lead);
            self.collapses.push(Reverse(Node { pixels, object: object as u32, lead }));
        }
    }

    /// How wrong the surface would be without a split that is made; 0 where nobody would see that.
    fn pixels_of_split(&self, objects: &[LodObject<'_>], object: usize, lead: VertexId) -> f32 {
        let is_hidden = self.cuts[object].slot(lead).is_some_and(|slot| slot.is_hidden);
        match self.sights[object].of(&objects[object].hierarchy.bounds(lead)) {
            NodeSight::Pixels(pixels) if !is_hidden => pixels,
            _ => 0.0,
        }
    }

    /// The split that would be missed least.
    fn least_worth(&mut self, objects: &[LodObject<'_>]) -> Option<Node> {
        loop {
            let Reverse(node) = *self.collapses.peek()?;
            let hierarchy = objects[node.object as usize].hierarchy;
            let can_go = self.cuts[node.object as usize].can_collapse(hierarchy, node.lead);
            if can_go && node.pixels == self.pixels_of_split(objects, node.object as usize, node.lead) {
                return Some(node);
            }
            self.collapses.pop();
        }
    }

    /// Whether some split is so much less worth than a node that the node should be split in its place.
    pub(super) fn has_less_worth(&mut self, objects: &[LodObject<'_>], node: &Node) -> bool {
        self.least_worth(objects).is_some_and(|least| least.pixels * WORTH_A_CHANGE < node.pixels)
    }

    /// Takes splits back until so many triangles fit; whether they do. Only what is less worth than the node goes.
    pub(super) fn make_room(&mut self, objects: &[LodObject<'_>], node: &Node, added: u32) -> bool {
        while self.triangle_count.saturating_add(added) > self.options.budget {
            match self.least_worth(objects) {
                Some(least) if least.pixels * WORTH_A_CHANGE < node.pixels => self.take_back(objects, &least),
                _ => return false,
            }
        }
        true
    }

    /// Takes back what is above the budget, and what is hardly wrong without.
    pub(super) fn coarsen_to_fit(&mut self, objects: &[LodObject<'_>]) {
        while let Some(least) = self.least_worth(objects) {
            if self.triangle_count <= self.options.budget && least.pixels >= self.options.least_pixels * FAR_BELOW {
                break;
            }
            self.take_back(objects, &least);
        }
    }

    fn take_back(&mut self, objects: &[LodObject<'_>], node: &Node) {
        let object = node.object as usize;
        let hierarchy = objects[object].hierarchy;
        let is_hidden = self.cuts[object].slot(node.lead).is_some_and(|slot| slot.is_hidden);
        self.triangle_count -= self.cuts[object].collapse(hierarchy, node.lead);
        // What it needed may be free now, and what it split from may split again.
        for vertex in hierarchy.together(node.lead) {
            for needed in hierarchy.link(vertex).path() {
                self.note_collapse(objects, object, hierarchy.lead(VertexId(*needed)));
            }
        }
        let parent = hierarchy.parent(node.lead);
        if is_hidden {
            self.set_state(object, parent, NodeState::Occluded);
        } else {
            self.offer(objects, object, parent);
        }
    }
}
