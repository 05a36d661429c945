//! The frames that deltas may stand on, and where every moved object is.

use std::collections::{HashMap, VecDeque};

use glam::{DAffine3, DVec3};
use mullion_common::scene::ObjectId;
use mullion_common::visible_set::{VisibleDelta, VisibleSet};
use mullion_common::wire::{BASE_WINDOW, Budget, Course, Frame, FrameView, Moved, Steering};

use super::FrameInput;
use super::last_words::LastWords;
use mullion_common::wall::ViewId;

#[derive(Debug, Default)]
struct Past {
    number: u64,
    /// By `ViewId`.
    sets: Vec<VisibleSet>,
    dropped: VisibleSet,
}

#[derive(Debug)]
struct MovedAt {
    moved: Moved,
    frame: u64,
}

/// The newest frame and the sets of the [`BASE_WINDOW`] before it.
#[derive(Debug, Default)]
pub(super) struct History {
    past: VecDeque<Past>,
    scene_time_s: f64,
    world_from_room: DAffine3,
    eyes: Vec<DVec3>,
    budgets: Vec<Budget>,
    shared_eye: DVec3,
    steering: Steering,
    presence: LastWords,
    /// Digest of what is dropped in the newest frame.
    dropped_digest: u64,
    /// What changed in that since each base that a node has: most have the same.
    dropped_since: Vec<(Option<u64>, VisibleDelta)>,
    /// How many of these are of the newest frame.
    dropped_known: usize,
    moved: Vec<MovedAt>,
    place_of: HashMap<ObjectId, usize>,
}

impl History {
    /// Takes a frame, and what no view draws in it. Allocates only while sets grow, or where an object moves for the first time.
    pub fn push(&mut self, input: &FrameInput<'_>, dropped: &VisibleSet) {
        let mut newest = if self.past.len() > BASE_WINDOW { self.past.pop_front() } else { None }.unwrap_or_default();
        newest.number = input.number;
        newest.sets.resize_with(input.sets.len(), VisibleSet::default);
        for (kept, set) in newest.sets.iter_mut().zip(input.sets) {
            kept.clear();
            set.ranges().iter().for_each(|range| kept.push(*range));
        }
        newest.dropped.clone_from(dropped);
        (self.dropped_digest, self.dropped_known) = (dropped.digest(), 0);
        self.past.push_back(newest);
        self.scene_time_s = input.scene_time_s;
        self.world_from_room = input.world_from_room;
        self.shared_eye = input.shared_eye;
        self.eyes.clear();
        self.eyes.extend_from_slice(input.eyes);
        self.budgets.clear();
        self.budgets.extend_from_slice(input.budgets);
        self.steering = input.steering;
        input.presence.iter().for_each(|(object, presence)| self.presence.say(*object, *presence, input.number));
        for moved in input.moved {
            let entry = MovedAt { moved: *moved, frame: input.number };
            let place = *self.place_of.entry(moved.object).or_insert(self.moved.len());
            match self.moved.get_mut(place) {
                Some(known) => *known = entry,
                None => self.moved.push(entry),
            }
        }
    }

    /// Number of the newest frame.
    pub fn newest(&self) -> Option<u64> {
        self.past.back().map(|past| past.number)
    }

    /// Whether nothing has moved, come or gone since the newest frame: not the room, no eye, no object.
    pub fn is_as_before(&self, input: &FrameInput<'_>) -> bool {
        let stays = |moved: &Moved| self.place_of.get(&moved.object).is_some_and(|place| self.moved[*place].moved == *moved);
        self.newest().is_some()
            && self.world_from_room == input.world_from_room
            && self.eyes == input.eyes
            && input.presence.is_empty()
            && input.moved.iter().all(stays)
    }

    /// Makes `course` that of the newest frame, for a standby that has acknowledged `acked`; false before the first.
    pub fn course(&self, acked: Option<u64>, epoch: u32, course: &mut Course) -> bool {
        let Some(newest) = self.newest() else { return false };
        course.number = newest;
        course.epoch = epoch;
        course.scene_time_s = self.scene_time_s;
        course.world_from_room = self.world_from_room;
        course.base = acked.filter(|acked| *acked < newest);
        course.steering = self.steering;
        course.eyes.clone_from(&self.eyes);
        course.budgets.clone_from(&self.budgets);
        self.presence.since(course.base, &mut course.presence);
        course.moved.clear();
        let is_news = |at: &&MovedAt| course.base.is_none_or(|base| at.frame > base);
        course.moved.extend(self.moved.iter().filter(is_news).map(|at| at.moved));
        true
    }

    /// Makes `frame` the newest one for a node with these views that has acknowledged `acked`. Reuses its memory.
    pub fn write(&mut self, views: &[ViewId], acked: Option<u64>, epoch: u32, frame: &mut Frame) {
        let Some(newest) = self.past.back() else { return };
        let is_base = |past: &&Past| Some(past.number) == acked && past.number < newest.number;
        let base = self.past.iter().find(is_base);
        frame.number = newest.number;
        frame.epoch = epoch;
        frame.scene_time_s = self.scene_time_s;
        frame.world_from_room = self.world_from_room;
        frame.shared_eye = self.shared_eye;
        frame.base = base.map(|base| base.number);
        frame.views.resize_with(views.len(), FrameView::default);
        let nothing = VisibleSet::default();
        for (view, out) in views.iter().map(|v| usize::from(v.0)).zip(&mut frame.views) {
            out.eye = self.eyes[view];
            out.budget = self.budgets.get(view).copied().unwrap_or_default();
            out.leaves.between(base.map_or(&nothing, |base| &base.sets[view]), &newest.sets[view]);
            out.digest = newest.sets[view].digest();
        }
        frame.dropped_digest = self.dropped_digest;
        let known = self.dropped_since[..self.dropped_known].iter().position(|(since, _)| *since == frame.base);
        let known = known.unwrap_or_else(|| {
            if self.dropped_known == self.dropped_since.len() {
                self.dropped_since.push(Default::default());
            }
            let (since, delta) = &mut self.dropped_since[self.dropped_known];
            *since = frame.base;
            delta.between(base.map_or(&nothing, |base| &base.dropped), &newest.dropped);
            self.dropped_known += 1;
            self.dropped_known - 1
        });
        let VisibleDelta { removed, added } = &self.dropped_since[known].1;
        frame.dropped.removed.clone_from(removed);
        frame.dropped.added.clone_from(added);
        frame.moved.clear();
        let is_news = |at: &&MovedAt| base.is_none_or(|base| at.frame > base.number);
        frame.moved.extend(self.moved.iter().filter(is_news).map(|at| at.moved));
    }
}
