//! Occlusion-controlled refinement (section 3.2): the queue, the budget, questions and their answers.

use std::collections::VecDeque;

use mullion_common::scene::{NodeBounds, VertexId};

use super::cut::{Cut, NodeState};
use super::heap::{CollapseHeap, Node, SplitHeap};
use super::sight::LocalSight;
use super::{LodObject, LodSight, NodeSight};

/// How far refinement goes, and what is asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LodOptions {
    /// Most triangles of all objects together. Where the bases alone have more, they are drawn and nothing else.
    pub budget: u32,
    /// Nodes that are wrong by fewer pixels are not split. 0: until the budget is used.
    pub least_pixels: f32,
    /// Most questions without an answer: enough that whoever answers is never idle, few enough that answers still matter. At least 1.
    pub most_asked: u32,
}

impl Default for LodOptions {
    fn default() -> Self {
        Self { budget: 10_000, least_pixels: 0.0, most_asked: 256 }
    }
}

/// From which cut a frame begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The base meshes: the paper's way.
    Base,
    /// That of the last frame, with the answers that were given: a slow camera costs few questions.
    Last,
}

/// Whether nodes are asked about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// Nothing is asked: there is no occluder yet, or none is wanted.
    Off,
    /// Nodes are, but for those whose parent was asked and found visible: every second level.
    On,
}

/// An answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// Some of the bounds may be seen.
    Visible,
    /// All of the bounds is behind what was drawn.
    Occluded,
}

/// How many splits more may be made before refinement rests; those that a split needs are counted, too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepLimit {
    /// As many as there may be.
    None,
    /// Rests once the frame has had so many.
    Total(u32),
}

/// Where refinement rests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// It has made as many splits as it should.
    Rests,
    /// It goes on once the oldest question is answered.
    Waits,
    /// Nothing is left to do.
    Done,
}

/// What is asked: whether anything of these bounds can be seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Question {
    /// Whose.
    pub object: u32,
    /// Bounds in the object's local space.
    pub bounds: NodeBounds,
}

/// While an answer is due nothing is done about nodes that are wrong by less than this share of its node's pixels: what they would take may
/// be wanted there.
const HORIZON: f32 = 0.7;

/// What a question was about.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub object: u32,
    pub lead: VertexId,
    /// How wrong the node is; 0 where nothing waits for the answer.
    pub pixels: f32,
    /// Whether the node has been split already, and it is asked if it should be still.
    pub is_split: bool,
}

/// The refinement of several objects under one budget, frame after frame. Takes memory only while its cuts grow.
#[derive(Debug, Default)]
pub struct Refinement {
    pub(super) cuts: Vec<Cut>,
    pub(super) sights: Vec<LocalSight>,
    pub(super) splits: SplitHeap,
    pub(super) collapses: CollapseHeap,
    pub(super) options: LodOptions,
    pub(super) occlusion: Option<Occlusion>,
    /// Nodes that were found occluded in this frame, and not asked since.
    hidden: Vec<Node>,
    asked: VecDeque<Asked>,
    questions: Vec<Question>,
    /// What a split needs, the coarsest last.
    pub(super) needed: Vec<VertexId>,
    pub(super) triangle_count: u32,
    pub(super) steps: u32,
    question_count: u32,
    pub(super) start: Option<Start>,
    pub(super) frame: u32,
}

impl Refinement {
    /// A refinement that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Begins a frame. Questions that are open are forgotten: no answer to them may come any more.
    pub fn begin(&mut self, objects: &[LodObject<'_>], sight: &LodSight<'_>, options: &LodOptions, start: Start) {
        self.options = *options;
        self.occlusion = Some(Occlusion::Off);
        self.frame = self.frame.wrapping_add(1);
        self.splits.clear();
        self.collapses.clear();
        self.hidden.clear();
        self.asked.clear();
        self.questions.clear();
        (self.steps, self.question_count) = (0, 0);
        self.start = Some(start);
        self.sights.clear();
        self.sights.extend(objects.iter().map(|object| LocalSight::new(sight, object)));
        let known = self.cuts.len().min(objects.len());
        self.cuts.resize_with(objects.len(), Cut::default);
        for (number, object) in objects.iter().enumerate() {
            if start == Start::Base || number >= known {
                self.cuts[number].reset(object.hierarchy);
            } else {
                self.cuts[number].grow(object.hierarchy);
            }
        }
        self.triangle_count = self.cuts.iter().map(Cut::triangle_count).sum();
        for number in 0..objects.len() {
            match start {
                Start::Base => (0..objects[number].hierarchy.base_count()).for_each(|v| self.offer(objects, number, VertexId(v))),
                Start::Last => self.offer_all(objects, number),
            }
        }
    }

    /// From now on nodes are asked about, or not. Those that were found occluded are asked again: the occluder has been drawn anew.
    pub fn set_occlusion(&mut self, objects: &[LodObject<'_>], occlusion: Occlusion) {
        self.occlusion = Some(occlusion);
        let mut hidden = std::mem::take(&mut self.hidden);
        for node in hidden.drain(..) {
            let hierarchy = objects[node.object as usize].hierarchy;
            if let Some(slot) = self.cuts[node.object as usize].slot_mut(hierarchy.parent(node.lead))
                && slot.next == Some(node.lead)
                && slot.node == NodeState::Occluded
            {
                slot.node = NodeState::Unknown;
                self.splits.push(node);
            }
        }
        self.hidden = hidden;
        if self.start == Some(Start::Last) && occlusion == Occlusion::On {
            self.ask_again(objects);
        }
    }

    /// Splits until the budget is used, nothing is left, so many splits have been made, or an answer is needed to go on.
    ///
    /// `objects` are those of [`Refinement::begin`].
    pub fn refine(&mut self, objects: &[LodObject<'_>], limit: StepLimit) -> Progress {
        self.coarsen_to_fit(objects);
        loop {
            if matches!(limit, StepLimit::Total(steps) if self.steps >= steps) {
                return Progress::Rests;
            }
            let Some(node) = self.splits.peek().copied() else {
                return if self.asked.is_empty() { Progress::Done } else { Progress::Waits };
            };
            let is_far_behind = self.asked.front().is_some_and(|asked| node.pixels < asked.pixels * HORIZON);
            if is_far_behind {
                return Progress::Waits;
            }
            if !self.is_worth(objects, &node) {
                return if self.asked.is_empty() { Progress::Done } else { Progress::Waits };
            }
            let hierarchy = objects[node.object as usize].hierarchy;
            let parent = hierarchy.parent(node.lead);
            let cut = &mut self.cuts[node.object as usize];
            let Some(slot) = cut.slot_mut(parent).filter(|slot| slot.next == Some(node.lead)) else {
                self.splits.pop();
                continue;
            };
            let needs_answer = self.occlusion == Some(Occlusion::On) && !slot.is_seen;
            match slot.node {
                NodeState::Asked | NodeState::Occluded => {
                    self.splits.pop();
                    continue;
                }
                NodeState::Unknown if needs_answer => {
                    if self.asked.len() as u32 >= self.options.most_asked.max(1) {
                        return Progress::Waits;
                    }
                    slot.node = NodeState::Asked;
                    self.splits.pop();
                    self.ask(objects, &node, false);
                    continue;
                }
                NodeState::Unknown | NodeState::Visible => {}
            }
            self.splits.pop();
            self.split(objects, &node);
        }
    }

    /// Whether the first node of the queue is worth its triangles.
    fn is_worth(&mut self, objects: &[LodObject<'_>], node: &Node) -> bool {
        const FEWEST: u32 = 2;
        let fits = self.triangle_count.saturating_add(FEWEST) <= self.options.budget;
        node.pixels >= self.options.least_pixels && node.pixels > 0.0 && (fits || self.has_less_worth(objects, node))
    }

    pub(super) fn ask(&mut self, objects: &[LodObject<'_>], node: &Node, is_split: bool) {
        let Node { object, lead, pixels } = *node;
        self.asked.push_back(Asked { object, lead, pixels, is_split });
        self.questions.push(Question { object, bounds: objects[object as usize].hierarchy.bounds(lead) });
        self.question_count += 1;
    }

    pub(super) fn may_ask(&self) -> bool {
        (self.asked.len() as u32) < self.options.most_asked.max(1)
    }

    /// The questions that have not been given out yet, oldest first. Their answers are due in this order.
    pub fn questions(&mut self) -> impl ExactSizeIterator<Item = Question> {
        self.questions.drain(..)
    }

    /// The answer to the oldest open question; one for no question means nothing.
    pub fn answer(&mut self, objects: &[LodObject<'_>], visibility: Visibility) {
        let Some(Asked { object, lead, is_split, .. }) = self.asked.pop_front() else { return };
        let hierarchy = objects[object as usize].hierarchy;
        let cut = &mut self.cuts[object as usize];
        if is_split {
            self.answer_split(objects, object, lead, visibility);
            return;
        }
        // The node may have been split meanwhile, because another one needed that.
        let Some(slot) = cut.slot_mut(hierarchy.parent(lead)).filter(|slot| slot.next == Some(lead)) else { return };
        let NodeSight::Pixels(pixels) = self.sights[object as usize].of(&hierarchy.bounds(lead)) else { return };
        let node = Node { pixels, object, lead };
        match visibility {
            Visibility::Visible => {
                slot.node = NodeState::Visible;
                self.splits.push(node);
            }
            Visibility::Occluded => {
                slot.node = NodeState::Occluded;
                self.hidden.push(node);
            }
        }
    }

    /// Puts what a vertex would split into next into the queue, if it is in sight.
    pub(super) fn offer(&mut self, objects: &[LodObject<'_>], object: usize, vertex: VertexId) {
        let Some(lead) = self.cuts[object].slot(vertex).and_then(|slot| slot.next) else { return };
        if let NodeSight::Pixels(pixels) = self.sights[object].of(&objects[object].hierarchy.bounds(lead)) {
            self.splits.push(Node { pixels, object: object as u32, lead });
        }
    }

    /// Makes a split, and before it those that it needs, if all of them fit.
    fn split(&mut self, objects: &[LodObject<'_>], node: &Node) {
        let object = node.object as usize;
        let hierarchy = objects[object].hierarchy;
        self.find_needed(objects, node);
        let added: u32 = self.needed.iter().map(|lead| hierarchy.added_triangles(*lead)).sum();
        // Nothing that these need may go while room is made.
        self.needed.iter().for_each(|lead| self.cuts[object].pin(hierarchy, *lead));
        if !self.make_room(objects, node, added) {
            self.needed.iter().for_each(|lead| self.cuts[object].unpin(hierarchy, *lead));
            return;
        }
        self.needed.iter().for_each(|lead| self.cuts[object].unpin(hierarchy, *lead));
        while let Some(lead) = self.needed.pop() {
            self.triangle_count += self.cuts[object].split(hierarchy, lead);
            self.steps += 1;
            self.offer(objects, object, hierarchy.parent(lead));
            for vertex in hierarchy.together(lead) {
                self.offer(objects, object, vertex);
            }
            self.note_collapse(objects, object, lead);
        }
    }

    /// All splits that a node's needs and that are not made, itself first: each comes before those that it needs.
    fn find_needed(&mut self, objects: &[LodObject<'_>], node: &Node) {
        let hierarchy = objects[node.object as usize].hierarchy;
        let cut = &self.cuts[node.object as usize];
        self.needed.clear();
        self.needed.push(node.lead);
        let mut at = 0;
        while let Some(lead) = self.needed.get(at).copied() {
            at += 1;
            for vertex in hierarchy.together(lead) {
                for needed in hierarchy.link(vertex).path() {
                    let needed = hierarchy.lead(VertexId(*needed));
                    if !cut.has(needed) && !self.needed.contains(&needed) {
                        self.needed.push(needed);
                    }
                }
            }
        }
        // What a split needs has lower numbers.
        self.needed.sort_unstable_by(|a, b| b.cmp(a));
    }

    /// Triangles of all objects.
    pub fn triangle_count(&self) -> u32 {
        self.triangle_count
    }

    /// Splits made in this frame.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Questions asked in this frame.
    pub fn question_count(&self) -> u32 {
        self.question_count
    }

    /// The cut of each object.
    pub fn cuts(&self) -> &[Cut] {
        &self.cuts
    }
}
