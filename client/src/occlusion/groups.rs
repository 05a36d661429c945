//! Neighbouring leaves that stay hidden, asked for as one: what the multiqueries of CHC++ do (Mattausch, Bittner, Wimmer 2008).
//!
//! A group sleeps once a box wider than its own was hidden. Its leaves are then neither tested nor listed: one box stands for all of them.
//! Where that is seen after all, its leaves are tested in a further pass of the same frame. That is rare: as the eye moves on, the wider
//! box is seen before the own one is, and the group is awake by then.

use glam::DVec3;
use mullion_common::geometry::Aabb;
use mullion_common::scene::{LeafRecord, Transform};
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::tree::leaf_bounds;
use crate::frame::Bound;

/// Leaves of a group: neighbours in the tree.
const GROUP: u32 = 16;
/// Leaves that are not drawn at once below which groups do not pay: to list them all takes less than a further pass now and then.
const FEW: u32 = 2048;
/// Leaves that sleep at most: should they all wake, a pass can take them.
const MOST_ASLEEP: u32 = 1 << 20;
/// By how much of its distance the wider box is wider, on each side: what is behind things comes out as the eye moves past them.
const MARGIN: f64 = 0.01;
/// One in so many groups that are awake is asked for in a frame.
const PERIOD: u32 = 8;
/// A further pass is paid off in so many frames. Where more are owed than these, all are awake for a while.
const PASS_FRAMES: u32 = 16;
const MOST_OWED: u32 = 3 * PASS_FRAMES;
const AWAKE_FRAMES: u32 = 64;

/// The groups of one view.
#[derive(Debug, Default)]
pub struct Groups {
    /// By group.
    sleeps: Vec<bool>,
    frame: u32,
    /// Frames that further passes are not paid off for.
    owed: u32,
    /// Frames for which all are awake.
    awake: u32,
    asked: Vec<Asked>,
    /// What is left of a frame's leaves, and what sleeps of them.
    listed: VisibleSet,
    asleep: VisibleSet,
    /// Leaves of groups, whether they are in the frame or not.
    woken: VisibleSet,
}

/// A group that something is asked of: of its own box, if it sleeps, and then of the wider one.
#[derive(Clone, Copy, Debug)]
struct Asked {
    group: u32,
    sleeps: bool,
}

/// What groups are made of.
#[derive(Clone, Copy)]
#[allow(missing_docs)]
pub struct Standing<'a> {
    pub records: &'a [LeafRecord],
    pub transforms: &'a [Transform],
    pub eye: DVec3,
}

impl Groups {
    /// Wakes all.
    pub fn clear(&mut self) {
        self.sleeps.clear();
    }

    /// Takes leaves that sleep out of those that are to be drawn, none of which is among the first, and asks for boxes.
    pub fn begin(&mut self, standing: Standing<'_>, opaque: &mut VisibleSet, first: &VisibleSet, bounds: &mut Vec<Bound>) {
        self.frame = self.frame.wrapping_add(1);
        (self.owed, self.awake) = (self.owed.saturating_sub(1), self.awake.saturating_sub(1));
        self.asked.clear();
        self.asleep.clear();
        if self.awake > 0 || opaque.len().saturating_sub(first.len()) < FEW {
            return self.sleeps.clear();
        }
        self.sleeps.resize(standing.records.len().div_ceil(GROUP as usize), false);
        self.listed.clear();
        let (mut asleep, mut passed) = (0, 0);
        let mut firsts = first.ranges();
        let mut ranges = opaque.ranges().iter().copied().peekable();
        while let Some(group) = ranges.peek().map(|range| range.start / GROUP) {
            let end = (group + 1) * GROUP;
            firsts = &firsts[firsts.partition_point(|range| range.end <= group * GROUP)..];
            let has_first = firsts.first().is_some_and(|range| range.start < end);
            let sleeps = self.sleeps[group as usize] && !has_first && asleep + GROUP <= MOST_ASLEEP;
            // What comes into view is awake.
            self.sleeps[passed as usize..group as usize].fill(false);
            passed = group + 1;
            let is_asked = sleeps || !has_first && group % PERIOD == self.frame % PERIOD;
            self.sleeps[group as usize] = sleeps;
            let mut own: Option<Aabb> = None;
            while let Some(range) = ranges.peek_mut().filter(|range| range.start < end) {
                let part = LeafRange::new(range.start, range.end.min(end));
                if sleeps {
                    self.asleep.push(part);
                    asleep += part.len();
                } else {
                    self.listed.push(part);
                }
                if is_asked {
                    let of_leaves =
                        (part.start..part.end).map(|leaf| leaf_bounds(&standing.records[leaf as usize], standing.transforms));
                    own = own.into_iter().chain(of_leaves).reduce(|all, bounds| all.union(&bounds));
                }
                range.start = part.end;
                if range.is_empty() {
                    ranges.next();
                }
            }
            if let (true, Some(own)) = (is_asked, own) {
                self.asked.push(Asked { group, sleeps });
                bounds.extend(sleeps.then_some(Bound::World(own)));
                bounds.push(Bound::World(own.grown(MARGIN * standing.eye.distance(own.center()))));
            }
        }
        self.sleeps[passed as usize..].fill(false);
        std::mem::swap(opaque, &mut self.listed);
    }

    /// Triangles of all that sleeps.
    pub fn triangles(&self, records: &[LeafRecord]) -> u64 {
        self.asleep.leaves().map(|leaf| u64::from(records[leaf as usize].triangle_count)).sum()
    }

    /// Takes what is seen of what was asked for; if it was not told, all is. Gives the leaves that sleep no longer, and might be seen.
    pub fn note(&mut self, bounds_seen: &[bool], woken: &mut VisibleSet) {
        self.woken.clear();
        let mut answers = bounds_seen.iter().copied();
        let mut is_seen = || answers.next().unwrap_or(true);
        for Asked { group, sleeps } in self.asked.drain(..) {
            if sleeps && is_seen() {
                self.woken.push(LeafRange::new(group * GROUP, (group + 1) * GROUP));
            }
            self.sleeps[group as usize] = !is_seen();
        }
        self.asleep.intersection_into(&self.woken, woken);
        if !woken.is_empty() {
            self.owed += PASS_FRAMES;
            if self.owed > MOST_OWED {
                (self.owed, self.awake) = (0, AWAKE_FRAMES);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DAffine3;
    use mullion_common::scene::{ChunkId, MaterialId, ObjectId};

    const LEAVES: u32 = 3200;

    /// A row of unit cubes, two metres apart.
    struct Row {
        records: Vec<LeafRecord>,
        transforms: Vec<Transform>,
    }

    impl Row {
        fn new() -> Self {
            let record = |leaf| LeafRecord {
                object: ObjectId(leaf),
                chunk: ChunkId(0),
                material: MaterialId(0),
                triangle_count: 12,
                local_min: [0.0; 3],
                local_max: [1.0; 3],
            };
            let place = |leaf| DAffine3::from_translation(DVec3::new(2.0 * f64::from(leaf), 0.0, -100.0)).into();
            Self { records: (0..LEAVES).map(record).collect(), transforms: (0..LEAVES).map(place).collect() }
        }

        /// A frame in which a box is seen if it reaches beyond so many metres along the row. Which leaves were listed, and which woke.
        fn frame(&self, groups: &mut Groups, first: u32, hidden_m: f64) -> (VisibleSet, VisibleSet) {
            let standing = Standing { records: &self.records, transforms: &self.transforms, eye: DVec3::ZERO };
            let first = VisibleSet::from_ranges([LeafRange::new(LEAVES - first, LEAVES)]);
            let (mut listed, mut bounds, mut woken) = (VisibleSet::all(LEAVES), Vec::new(), VisibleSet::default());
            groups.begin(standing, &mut listed, &first, &mut bounds);
            let slept = LEAVES - listed.len();
            assert_eq!(groups.triangles(&self.records), 12 * u64::from(slept));
            let seen: Vec<bool> = bounds.iter().map(|bound| bound.in_world().expect("of the world").max.x > hidden_m).collect();
            groups.note(&seen, &mut woken);
            (listed, woken)
        }
    }

    #[test]
    fn what_stays_hidden_sleeps_and_wakes_before_it_is_seen() {
        let (row, mut groups) = (Row::new(), Groups::default());
        (0..PERIOD).for_each(|_| _ = row.frame(&mut groups, 160, 2000.0));
        let (listed, woken) = row.frame(&mut groups, 160, 2000.0);
        // Hidden are 1000 leaves. Of the group at the edge, and of the one whose wider box is beyond it, all are listed.
        assert_eq!((listed.ranges()[0], woken.len()), (LeafRange::new(976, LEAVES), 0));
        // More and more is seen: nothing of it sleeps by then.
        for step in 0..80 {
            let (_, woken) = row.frame(&mut groups, 160, 2000.0 - 4.0 * f64::from(step));
            assert!(woken.is_empty(), "step {step}");
        }
    }

    #[test]
    fn what_is_seen_all_at_once_wakes() {
        let (row, mut groups) = (Row::new(), Groups::default());
        (0..=PERIOD).for_each(|_| _ = row.frame(&mut groups, 160, 2000.0));
        let (listed, woken) = row.frame(&mut groups, 160, 1000.0);
        let seen = VisibleSet::from_ranges([LeafRange::new(496, 976)]);
        assert_eq!((listed.ranges()[0].start, woken), (976, seen));
        assert_eq!(row.frame(&mut groups, 160, 1000.0).0.ranges()[0].start, 480, "the wider box of the last one was seen, too");
    }

    #[test]
    fn nothing_sleeps_that_is_drawn_at_once_or_where_too_much_woke() {
        let (row, mut groups) = (Row::new(), Groups::default());
        (0..=PERIOD).for_each(|_| _ = row.frame(&mut groups, 160, 1e9));
        assert_eq!(row.frame(&mut groups, 160, 1e9).0.len(), 160);
        assert_eq!(row.frame(&mut groups, 320, 1e9).0.len(), 320);
        assert_eq!(row.frame(&mut groups, LEAVES - FEW + 1, 1e9).0.len(), LEAVES, "there are few");

        (0..=PERIOD).for_each(|_| _ = row.frame(&mut groups, 160, 6400.0));
        for step in 1..=MOST_OWED / PASS_FRAMES + 1 {
            assert!(!row.frame(&mut groups, 160, 6000.0 - 100.0 * f64::from(step)).1.is_empty());
        }
        let awake = (0..100).take_while(|_| row.frame(&mut groups, 160, 1e9).0.len() == LEAVES).count();
        assert!(awake >= AWAKE_FRAMES as usize - 1, "{awake}");
    }
}
