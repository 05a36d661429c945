//! Occlusion-controlled refinement (section 3.2): which nodes are split in a frame, most wrong first, within a budget.

use std::collections::BinaryHeap;

use mullion_common::scene::{Hierarchy, Presence, VertexHierarchy};

use super::cut::Cut;
use super::node::Node;
use super::sight::LocalSight;
use super::sparse::Sparse;
use super::steps::{StepId, Steps};
use super::{LodObject, LodSight, NodeSight};

/// How far refinement goes, and when its occluder is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LodOptions {
    /// Most triangles of all objects in sight together. Where their bases alone have more, the smallest objects are left out.
    pub budget: u32,
    /// Nodes that are wrong by fewer pixels are not split. 0: until the budget is used, at last for what is hidden.
    pub least_pixels: f32,
    /// After so many splits what is there becomes the occluder, ascending; the paper's are [`LodOptions::PAPER`].
    pub occluders: [u32; MAX_OCCLUDERS],
    /// Whether an occluder is asked at every other level only: half the questions.
    pub odd_levels: bool,
}

/// Most times that an occluder is drawn in a frame.
const MAX_OCCLUDERS: usize = 4;

impl LodOptions {
    /// The paper's steps, of about 5000 in all (section 4).
    pub const PAPER: [u32; MAX_OCCLUDERS] = [300, 2500, u32::MAX, u32::MAX];
    /// No occluder is drawn.
    pub const NEVER: [u32; MAX_OCCLUDERS] = [u32::MAX; MAX_OCCLUDERS];
}

impl Default for LodOptions {
    fn default() -> Self {
        Self { budget: 10_000, least_pixels: 0.0, occluders: Self::PAPER, odd_levels: false }
    }
}

/// What hides nodes: coarse versions of the objects themselves.
pub trait Occluder {
    /// Takes what the objects look like so far, in place of what it had. What is not answered yet is forgotten, and asked again.
    fn draw(&mut self, objects: &[LodObject<'_>], cuts: &[Cut]);

    /// Whether a node of an object is behind what was drawn; `None`: the answer comes later. The same until that is drawn anew: nobody asks
    /// twice.
    fn hides(&mut self, object: usize, hierarchy: &Hierarchy, step: StepId) -> Option<Hidden>;

    /// Hands over answers that came later: objects, steps and what is hidden, in any order. None only where none is to come, or nobody waits.
    fn answer_late(&mut self, _wait: Wait, _with: &mut dyn FnMut(usize, StepId, Hidden)) {}
}

/// Whether answers are waited for that are not there yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// What is there is enough.
    No,
    /// Until there is one at least.
    ForSome,
}

/// Where a frame's occluder comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OccluderFrom {
    /// It is drawn on the way, at the steps of the options, and at last from what was found: for frames that keep it.
    ThisFrame,
    /// It is drawn on the way, for this frame alone: the paper's way.
    ThisFrameAlone,
    /// It is as an earlier frame drew it, which saw about the same: what is asked costs little, and it is asked from the first.
    EarlierFrame,
    /// The same, and at last it is drawn from what was found.
    EarlierFrameRenewed,
}

impl OccluderFrom {
    fn is_earlier(self) -> bool {
        matches!(self, Self::EarlierFrame | Self::EarlierFrameRenewed)
    }
}

/// What is behind an occluder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Hidden {
    /// Nothing, as far as is known.
    #[default]
    Nothing,
    /// What the node's split changes. What else its vertex splits into may be seen.
    Split,
    /// The node with everything below it.
    Node,
}

/// Nodes in a row that may be too large for what is left of a budget before the rest is not looked at.
const MOST_MISFITS: u32 = 64;
/// A split adds so many triangles at most. With less left the rest is not looked at.
const FEWEST_LEFT: u32 = 2;

/// The refinement of several objects under one budget.
///
/// What it finds is a function of what it is given, a kept occluder among it, whatever it found before: whoever is given the same finds the same. Only the way there
/// is short where little has changed: the cuts of the last frame are kept, and what differs is split or taken back. Takes memory only while
/// its cuts grow. Where answers come late, what is found is a function of when they come, too.
#[derive(Debug, Default)]
pub struct Refinement {
    cuts: Vec<Cut>,
    /// As each occluder was drawn.
    occluders: [Vec<Cut>; MAX_OCCLUDERS],
    chosen: Vec<Chosen>,
    sights: Vec<LocalSight>,
    /// A surface that is wrong by fewer is good enough. Above 0.
    least_pixels: f32,
    /// Objects in sight by their pixels, where not all of their bases are within the budget.
    by_size: Vec<(f32, u32)>,
    queue: BinaryHeap<Node>,
    /// Nodes that are behind the occluder.
    hidden: Vec<Node>,
    /// So many more were, and got what was left of the budget.
    hidden_before: u32,
    /// Nodes that were asked about and have no answer yet.
    waiting: Vec<Node>,
    /// What a step needs.
    needed: Vec<StepId>,
    /// Which picture the occluder has, counted around.
    picture: u8,
    triangle_count: u32,
    steps: u32,
    question_count: u32,
}

/// How an object is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Standing {
    /// As its base, which counts for nothing: it is out of sight.
    #[default]
    Beyond,
    /// By its cut.
    InSight,
    /// Not at all: there are no triangles left for its base.
    LeftOut,
    /// Not at all: it is away.
    Away,
}

/// The steps of one object that are to be made.
#[derive(Debug, Default)]
struct Chosen {
    standing: Standing,
    /// By step; whether it is chosen, by a follower's number, too.
    known: Sparse<Known>,
    /// Which frame this is, counted around.
    frame: u8,
    steps: Vec<StepId>,
}

/// What is known of a step. Small: most of what is asked about in a frame lies far apart, and every line of cache counts.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    /// In which frame it was chosen last.
    frame: u8,
    /// In which frame it was put into the queue last, where it comes from several.
    offered: u8,
    /// What an occluder answered, and which: 0 is none. No answer: it is to come.
    picture: u8,
    answer: Option<Hidden>,
}
const _: () = assert!(size_of::<Known>() == 4);

impl Chosen {
    fn begin(&mut self, end: u32) {
        self.steps.clear();
        self.frame = self.frame.wrapping_add(1);
        if self.frame == 0 {
            self.known.written().for_each(|known| (known.frame, known.offered) = (0, 0));
            self.frame = 1;
        }
        self.known.grow(end as usize);
    }

    #[inline]
    fn has(&self, step: StepId) -> bool {
        self.known.get(step.index()).frame == self.frame
    }

    /// Chooses a step, or gives it up again. [`Chosen::steps`] does not learn of it.
    fn mark(&mut self, hierarchy: &Hierarchy, step: StepId, is_chosen: bool) {
        let frame = if is_chosen { self.frame } else { 0 };
        hierarchy.numbers(step).for_each(|number| self.known.get_mut(number as usize).frame = frame);
    }

    /// Whether a step was not put into the queue in this frame.
    fn is_first_offered(&mut self, step: StepId) -> bool {
        std::mem::replace(&mut self.known.get_mut(step.index()).offered, self.frame) != self.frame
    }

    /// Notes what an occluder answered of a step that it was asked about in this picture; of any other, nothing.
    fn note_answer(&mut self, step: StepId, picture: u8, hidden: Hidden) {
        if self.known.get(step.index()).picture == picture {
            self.known.get_mut(step.index()).answer = Some(hidden);
        }
    }

    fn follow(&self, hierarchy: &Hierarchy, cut: &mut Cut) {
        match self.standing {
            Standing::LeftOut | Standing::Away => cut.vanish(),
            Standing::Beyond | Standing::InSight => cut.follow(hierarchy, &self.steps, |step| self.has(step)),
        }
    }
}

impl Refinement {
    /// A refinement that has found nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Finds the cuts of a frame. Without an occluder nothing is taken to be hidden.
    ///
    /// Objects are the same ones in the same order from frame to frame, or [`Refinement::forget`] comes between.
    pub fn refine(
        &mut self,
        objects: &[LodObject<'_>],
        sight: &LodSight<'_>,
        options: &LodOptions,
        mut occluder: Option<(&mut (dyn Occluder + '_), OccluderFrom)>,
    ) {
        self.begin(objects, sight, options);
        let keeps = occluder.as_ref().is_some_and(|(_, from)| from.is_earlier());
        let mut drawn = if keeps { MAX_OCCLUDERS } else { 0 };
        let mut misfits = 0;
        let mut is_left_over = false;
        loop {
            if !is_left_over
                && let Some((occluder, _)) = &mut occluder
                && options.occluders.get(drawn).is_some_and(|steps| self.steps >= *steps)
            {
                self.draw_occluder(objects, drawn, *occluder);
                drawn += 1;
            }
            let Some(mut node) = self.queue.pop() else {
                if let Some((occluder, _)) = occluder.as_mut().filter(|_| !self.waiting.is_empty()) {
                    self.take_late(*occluder, Wait::ForSome);
                    continue;
                }
                // Nothing else wants what is left of the budget.
                if options.least_pixels > 0.0 || self.hidden.is_empty() {
                    break;
                }
                is_left_over = true;
                misfits = 0;
                self.hidden_before = self.hidden.len() as u32;
                self.queue.extend(self.hidden.drain(..));
                continue;
            };
            let object = node.object as usize;
            let hierarchy = objects[object].hierarchy;
            if !self.chosen[object].has(node.step) {
                if let Some((occluder, _)) = occluder.as_mut().filter(|_| drawn > 0 && !is_left_over) {
                    // Questions may be asked at every other level: what is below a node that is seen is likely seen.
                    if !node.is_seen {
                        let Some(hidden) = self.ask(*occluder, hierarchy, &node) else {
                            self.waiting.push(node);
                            self.take_late(*occluder, Wait::No);
                            continue;
                        };
                        if hidden == Hidden::Split
                            && !node.is_followed
                            && let Hierarchy::Vertices(hierarchy) = hierarchy
                        {
                            self.offer_next(hierarchy, &node);
                            node.is_followed = true;
                        }
                        if hidden != Hidden::Nothing {
                            self.hidden.push(node);
                            continue;
                        }
                    }
                    node.is_seen = options.odd_levels && !node.is_seen;
                }
                let added = self.find_needed(hierarchy, object, node.step, options.budget);
                if self.triangle_count.saturating_add(added) > options.budget {
                    let chosen = &mut self.chosen[object];
                    self.needed.drain(..).for_each(|step| chosen.mark(hierarchy, step, false));
                    misfits += 1;
                    if self.triangle_count.saturating_add(FEWEST_LEFT) > options.budget {
                        break;
                    }
                    if misfits > MOST_MISFITS {
                        // What waits came before these.
                        let Some((occluder, _)) = occluder.as_mut().filter(|_| !self.waiting.is_empty()) else { break };
                        self.take_late(*occluder, Wait::ForSome);
                    }
                    continue;
                }
                misfits = 0;
                self.triangle_count += added;
                self.steps += match hierarchy {
                    Hierarchy::Vertices(_) => self.needed.len() as u32,
                    Hierarchy::Clusters(_) => added / 2,
                };
                self.chosen[object].steps.append(&mut self.needed);
            }
            self.offer_below(hierarchy, &node);
        }
        let cuts = self.cuts.iter_mut().zip(&self.chosen).zip(objects);
        cuts.for_each(|((cut, chosen), object)| chosen.follow(object.hierarchy, cut));
        if let Some((occluder, OccluderFrom::ThisFrame | OccluderFrom::EarlierFrameRenewed)) = occluder {
            occluder.draw(objects, &self.cuts);
            self.next_picture();
        }
    }

    fn begin(&mut self, objects: &[LodObject<'_>], sight: &LodSight<'_>, options: &LodOptions) {
        self.queue.clear();
        self.hidden.clear();
        self.waiting.clear();
        (self.triangle_count, self.steps, self.question_count, self.hidden_before) = (0, 0, 0, 0);
        if self.picture == 0 {
            self.next_picture(); // nobody was asked about that one
        }
        self.least_pixels = options.least_pixels.max(f32::MIN_POSITIVE);
        self.sights.clear();
        self.sights.extend(objects.iter().map(|object| LocalSight::new(sight, object)));
        self.chosen.resize_with(objects.len(), Chosen::default);
        // Those of occluders only once there are some.
        let occluders = self.occluders.iter_mut().filter(|cuts| !cuts.is_empty());
        for cuts in std::iter::once(&mut self.cuts).chain(occluders) {
            cuts.resize_with(objects.len(), Cut::default);
        }
        self.choose_bases(objects, options.budget);
        for (number, object) in objects.iter().enumerate() {
            let hierarchy = object.hierarchy;
            self.chosen[number].begin(hierarchy.end());
            if self.chosen[number].standing != Standing::InSight {
                continue;
            }
            let object = number as u32;
            hierarchy.for_first(|parent, step| {
                self.offer(hierarchy, Node { pixels: f32::INFINITY, object, step, parent, is_seen: false, is_followed: false });
            });
        }
    }

    /// How each object stands. Where the bases in sight are more than the budget, the largest objects are drawn.
    fn choose_bases(&mut self, objects: &[LodObject<'_>], budget: u32) {
        let base = |object: usize| objects[object].hierarchy.base_triangles();
        self.by_size.clear();
        for (number, (object, chosen)) in objects.iter().zip(&mut self.chosen).enumerate() {
            if object.presence == Presence::Away {
                chosen.standing = Standing::Away;
                continue;
            }
            let pixels = self.sights[number].of_box(&object.hierarchy.local_aabb());
            chosen.standing = if pixels.is_some() { Standing::InSight } else { Standing::Beyond };
            if let Some(pixels) = pixels {
                self.triangle_count = self.triangle_count.saturating_add(base(number));
                self.by_size.push((pixels, number as u32));
            }
        }
        if self.triangle_count <= budget {
            return;
        }
        self.triangle_count = 0;
        self.by_size.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (_, number) in &self.by_size {
            let (number, added) = (*number as usize, base(*number as usize));
            if added <= budget - self.triangle_count {
                self.triangle_count += added;
            } else {
                self.chosen[number].standing = Standing::LeftOut;
            }
        }
    }

    /// Puts a node into the queue, if it is in sight and wrong by pixels enough. It is as wrong as its bounds say, and no more than what it comes
    /// from.
    #[inline]
    fn offer(&mut self, hierarchy: &impl Steps, node: Node) {
        let sight = &self.sights[node.object as usize];
        if let NodeSight::Pixels(pixels) = sight.of(hierarchy.packed_bounds(node.parent, node.step))
            && pixels >= self.least_pixels
        {
            self.queue.push(Node { pixels: (pixels * sight.weight).min(node.pixels), ..node });
        }
    }

    /// What the occluder says of a node. Asks it, if nobody has.
    #[inline]
    fn ask(&mut self, occluder: &mut dyn Occluder, hierarchy: &Hierarchy, node: &Node) -> Option<Hidden> {
        let object = node.object as usize;
        let known = self.chosen[object].known.get_mut(node.step.index());
        if known.picture != self.picture {
            self.question_count += 1;
            (known.picture, known.answer) = (self.picture, occluder.hides(object, hierarchy, node.step));
        }
        known.answer
    }

    /// Takes answers that came late, and puts what waited for them into the queue. If there are none although they are waited for, nothing is
    /// taken to be hidden.
    fn take_late(&mut self, occluder: &mut dyn Occluder, wait: Wait) {
        let (chosen, picture) = (&mut self.chosen, self.picture);
        let mut are_any = false;
        occluder.answer_late(wait, &mut |object, step, hidden| {
            if let Some(chosen) = chosen.get_mut(object) {
                chosen.note_answer(step, picture, hidden);
            }
            are_any = true;
        });
        match (are_any, wait) {
            (true, _) => {}
            (false, Wait::No) => return,
            (false, Wait::ForSome) => {
                self.waiting
                    .iter()
                    .for_each(|node| chosen[node.object as usize].note_answer(node.step, picture, Hidden::Nothing));
            }
        }
        let has_answer = |node: &mut Node| chosen[node.object as usize].known.get(node.step.index()).answer.is_some();
        self.queue.extend(self.waiting.extract_if(.., has_answer));
    }

    /// Offers the nodes that a node becomes by its step.
    fn offer_below(&mut self, hierarchy: &Hierarchy, node: &Node) {
        match hierarchy {
            Hierarchy::Vertices(hierarchy) => {
                if !node.is_followed {
                    self.offer_next(hierarchy, node);
                }
                for vertex in hierarchy.together(node.step.lead()) {
                    if let Some(lead) = hierarchy.first_child(vertex) {
                        self.offer(hierarchy, Node { step: StepId(lead.0), parent: vertex, is_followed: false, ..*node });
                    }
                }
            }
            // A group comes from all that it needs, and is asked about once.
            Hierarchy::Clusters(hierarchy) => {
                for group in hierarchy.below(node.step.group()) {
                    if self.chosen[node.object as usize].is_first_offered(StepId(group.0)) {
                        self.offer(hierarchy, Node { step: StepId(group.0), ..*node });
                    }
                }
            }
        }
    }

    /// Offers what a node's vertex splits into after it.
    fn offer_next(&mut self, hierarchy: &VertexHierarchy, node: &Node) {
        if let Some(lead) = hierarchy.next_sibling(node.step.lead()) {
            self.offer(hierarchy, Node { step: StepId(lead.0), is_followed: false, ..*node });
        }
    }

    /// Chooses a step and all that it needs, as far as that is not chosen, and notes them as needed, itself first. How many triangles they add; if
    /// they do not fit, as many as were found until then: all of them are to be given up.
    fn find_needed(&mut self, hierarchy: &Hierarchy, object: usize, step: StepId, budget: u32) -> u32 {
        let (chosen, found) = (&mut self.chosen[object], &mut self.needed);
        chosen.mark(hierarchy, step, true);
        found.clear();
        found.push(step);
        let (mut at, mut added) = (0, 0u32);
        while let Some(step) = found.get(at).copied() {
            at += 1;
            added += hierarchy.added_triangles(step);
            if self.triangle_count.saturating_add(added) > budget {
                break;
            }
            hierarchy.for_needs(step, |needed| {
                if !chosen.has(needed) {
                    let needed = hierarchy.named(needed);
                    chosen.mark(hierarchy, needed, true);
                    found.push(needed);
                }
            });
        }
        added
    }

    /// Makes what is chosen so far the occluder. What was behind the last one may be seen beyond this.
    fn draw_occluder(&mut self, objects: &[LodObject<'_>], number: usize, occluder: &mut dyn Occluder) {
        let cuts = &mut self.occluders[number];
        if cuts.is_empty() {
            cuts.extend(objects.iter().map(|object| Cut::new(object.hierarchy)));
        }
        for ((cut, chosen), object) in cuts.iter_mut().zip(&self.chosen).zip(objects) {
            chosen.follow(object.hierarchy, cut);
        }
        occluder.draw(objects, cuts);
        self.next_picture();
        self.queue.extend(self.hidden.drain(..).chain(self.waiting.drain(..)));
    }

    fn next_picture(&mut self) {
        self.picture = self.picture.wrapping_add(1).max(1);
        if self.picture == 1 {
            // Once around: nothing of what was answered then is taken for an answer now.
            self.chosen.iter_mut().flat_map(|chosen| chosen.known.written()).for_each(|known| known.picture = 0);
        }
    }

    /// Forgets all cuts: objects are others, or in another order.
    pub fn forget(&mut self) {
        self.cuts.clear();
        self.occluders.iter_mut().for_each(Vec::clear);
        self.chosen.clear();
    }

    /// Triangles of all objects in sight.
    pub fn triangle_count(&self) -> u32 {
        self.triangle_count
    }

    /// Whether anything of an object may be in sight: it is there, and its box is.
    pub fn is_in_sight(&self, object: usize) -> bool {
        self.chosen.get(object).is_some_and(|chosen| matches!(chosen.standing, Standing::InSight | Standing::LeftOut))
    }

    /// Splits beyond the bases. A group of clusters counts as many as add its triangles.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// How often an occluder was asked.
    pub fn question_count(&self) -> u32 {
        self.question_count
    }

    /// Of the questions, how many told at last that something was hidden. Of a frame that drew its occluder: others ask little anew.
    pub fn hidden_share(&self) -> f32 {
        (self.hidden.len() as u32 + self.hidden_before) as f32 / self.question_count.max(1) as f32
    }

    /// The cut of each object. That of one that is out of sight is its base, that of one that is away has no triangles.
    pub fn cuts(&self) -> &[Cut] {
        &self.cuts
    }
}
