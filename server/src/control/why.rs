//! Which views see an object, and why others do not.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use mullion_common::control::{LeafWhy, Reason, SeenBy, Side, Why};
use mullion_common::geometry::{FrustumSide, Obb};
use mullion_common::scene::{Object, ObjectId, Package};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{TileId, ViewId, Wall};

use super::queue::Subject;
use crate::cull::oracle;
use crate::tree::DynamicScene;

/// Most leaves that an answer tells of.
pub const MAX_LEAVES_TOLD: usize = 256;

/// What an answer needs of a frame: taken between two frames, looked at elsewhere.
#[derive(Clone, Debug)]
pub struct Snapshot {
    frame: u64,
    subject: Subject,
    package: Arc<Package>,
    world_from_room: DAffine3,
    eyes: Vec<DVec3>,
    /// What each view of interest sees.
    sets: Vec<(ViewId, VisibleSet)>,
    leaves: Vec<LeafAt>,
}

#[derive(Clone, Copy, Debug)]
struct LeafAt {
    leaf: u32,
    bound: Obb,
    is_removed: bool,
}

impl Snapshot {
    /// Of a frame whose sets are these.
    pub(super) fn take(
        subject: Subject,
        frame: u64,
        wall: &Wall,
        scene: &DynamicScene,
        (eyes, world_from_room): (&[DVec3], &DAffine3),
        sets: &[VisibleSet],
    ) -> Self {
        let set = |view: ViewId| (view, sets[usize::from(view.0)].clone());
        let all_views = (0..sets.len() as u16).map(ViewId);
        let (sets, leaves) = match subject {
            Subject::Tile(object, tile) => {
                let removed = scene.tree().removed();
                let at = |leaf| LeafAt {
                    leaf,
                    bound: *scene.tree().leaf_bound(leaf),
                    is_removed: removed.is_some_and(|removed| removed.contains(leaf)),
                };
                let leaves = leaves_of(scene.package(), object).take(MAX_LEAVES_TOLD).map(at).collect();
                (wall.views_of(tile).map(set).collect(), leaves)
            }
            Subject::Wall(_) => (all_views.map(set).collect(), Vec::new()),
        };
        let package = Arc::clone(scene.package());
        Self { frame, subject, package, world_from_room: *world_from_room, eyes: eyes.to_vec(), sets, leaves }
    }

    fn object(&self) -> Option<(ObjectId, &Object)> {
        let (Subject::Tile(object, _) | Subject::Wall(object)) = self.subject;
        Some((object, self.package.scene.objects.get(object.0 as usize)?))
    }

    /// Which tiles see the object or anything below it. None where the frame was of a scene without it.
    pub fn seen_by(&self, wall: &Wall) -> Option<SeenBy> {
        let (object, Object { leaves: ranges, .. }) = self.object()?;
        let mut tiles: Vec<TileId> = Vec::new();
        for (view, set) in &self.sets {
            let tile = wall.views()[usize::from(view.0)].tile;
            if !tiles.contains(&tile) && ranges.iter().any(|range| meets(set, range)) {
                tiles.push(tile);
            }
        }
        let tiles = tiles.into_iter().map(|tile| wall.tile(tile).name.clone()).collect();
        Some(SeenBy { frame: self.frame, object: object.0, tiles })
    }

    /// For each leaf and view, whether the view sees it, and if not, why. None where the question was about no tile, or
    /// the frame was of a scene without the object.
    pub fn why(&self, wall: &Wall) -> Option<Why> {
        let Subject::Tile(_, tile) = self.subject else {
            return None;
        };
        let (object, object_of) = self.object()?;
        let frusta: Vec<_> = self
            .sets
            .iter()
            .map(|(view, _)| wall.frustum(*view, self.eyes[usize::from(view.0)], &self.world_from_room))
            .collect();
        let reason = |at: &LeafAt, view: usize| {
            if self.sets[view].1.contains(at.leaf) {
                return Reason::Seen;
            }
            if at.is_removed {
                return Reason::Removed;
            }
            match oracle::parting_side(&frusta[view], &at.bound) {
                Some((side, distance_m)) => Reason::Outside { side: side_of(side), distance_m },
                None if oracle::intersects(&frusta[view], &at.bound) => Reason::Unexplained,
                None => Reason::PastAnEdge,
            }
        };
        let leaves: Vec<LeafWhy> = self
            .leaves
            .iter()
            .map(|at| LeafWhy {
                leaf: at.leaf,
                object: self.package.scene.manifest.leaves[at.leaf as usize].object.0,
                views: (0..frusta.len()).map(|view| reason(at, view)).collect(),
            })
            .collect();
        Some(Why {
            frame: self.frame,
            object: object.0,
            name: object_of.name.clone(),
            tile: wall.tile(tile).name.clone(),
            is_seen: self.sets.iter().any(|(_, set)| object_of.leaves.iter().any(|range| meets(set, range))),
            leaf_count: object_of.leaves.iter().map(LeafRange::len).sum(),
            leaves,
        })
    }
}

fn leaves_of(package: &Package, object: ObjectId) -> impl Iterator<Item = u32> + '_ {
    let object = package.scene.objects.get(object.0 as usize);
    object.into_iter().flat_map(|object| &object.leaves).flat_map(|range| range.start..range.end)
}

/// Whether a set holds any leaf of a range.
fn meets(set: &VisibleSet, range: &LeafRange) -> bool {
    let ranges = set.ranges();
    let next = ranges.partition_point(|seen| seen.end <= range.start);
    ranges.get(next).is_some_and(|seen| seen.start < range.end)
}

fn side_of(side: FrustumSide) -> Side {
    match side {
        FrustumSide::Left => Side::Left,
        FrustumSide::Right => Side::Right,
        FrustumSide::Bottom => Side::Bottom,
        FrustumSide::Top => Side::Top,
        FrustumSide::Near => Side::Near,
    }
}
