//! Which objects with hierarchies of detail are out of the scene. Nodes refine all that they have hierarchies of, whether their views see it or not,
//! and so are told: by leaves, which go and come whole objects at a time.

use std::sync::Arc;

use mullion_common::scene::{Object, ObjectId, Presence, Scene};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wire::MAX_AWAY_RANGES;

/// The leaves that hierarchies stand for, by the objects that take them along when they go.
#[derive(Debug, Default)]
pub struct HierarchyLeaves {
    /// By object: of its own leaves and those of all below it.
    of_objects: Vec<VisibleSet>,
}

impl HierarchyLeaves {
    /// Of a scene with hierarchies for the own leaves of these objects, in any order. Takes as long as there are leaves, and objects above each.
    pub fn of(scene: &Scene, objects: impl IntoIterator<Item = ObjectId>) -> Self {
        let mut has_hierarchy = vec![false; scene.objects.len()];
        objects.into_iter().for_each(|object| has_hierarchy[object.0 as usize] = true);
        let mut standing_for = VisibleSet::default();
        for (leaf, record) in (0..).zip(&scene.manifest.leaves) {
            if has_hierarchy[record.object.0 as usize] {
                standing_for.push(LeafRange::new(leaf, leaf + 1));
            }
        }
        let of_object = |object: &Object| {
            let (own, mut both) = (VisibleSet::from_ranges(object.leaves.iter().copied()), VisibleSet::default());
            own.intersection_into(&standing_for, &mut both);
            both
        };
        Self { of_objects: scene.objects.iter().map(of_object).collect() }
    }
}

/// What is out of the scene.
#[derive(Debug)]
pub(super) struct Away {
    leaves: Arc<HierarchyLeaves>,
    set: VisibleSet,
    scratch: VisibleSet,
}

impl Away {
    /// All is there.
    pub fn new(leaves: Arc<HierarchyLeaves>) -> Self {
        Self { leaves, set: VisibleSet::default(), scratch: VisibleSet::default() }
    }

    /// Objects come or go with all below them, in this order. What has no hierarchy, or came later, is left aside.
    pub fn note(&mut self, presence: &[(ObjectId, Presence)]) {
        for (object, presence) in presence {
            let Some(leaves) = self.leaves.of_objects.get(object.0 as usize).filter(|leaves| !leaves.is_empty()) else {
                continue;
            };
            match presence {
                Presence::Away => self.set.union_into(leaves, &mut self.scratch),
                Presence::There => self.set.difference_into(leaves, &mut self.scratch),
            }
            std::mem::swap(&mut self.set, &mut self.scratch);
        }
    }

    /// The leaves; `None` where they are more ranges than a frame names.
    pub fn set(&self) -> Option<&VisibleSet> {
        Some(&self.set).filter(|set| set.ranges().len() <= MAX_AWAY_RANGES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DAffine3;
    use mullion_common::scene::{ChunkId, LeafRecord, MaterialId, SceneManifest};

    /// A scene of these leaves' owners and objects' leaves.
    fn scene(owners: &[u32], subtrees: &[&[(u32, u32)]]) -> Scene {
        let leaf = |object: &u32| LeafRecord {
            object: ObjectId(*object),
            chunk: ChunkId(0),
            material: MaterialId(0),
            triangle_count: 1,
            local_min: [0.0; 3],
            local_max: [1.0; 3],
        };
        let object = |leaves: &&[(u32, u32)]| Object {
            parent: None,
            name: String::new(),
            source_node: 0,
            instance: None,
            parent_from_local: DAffine3::IDENTITY,
            leaves: leaves.iter().map(|(start, end)| LeafRange::new(*start, *end)).collect(),
        };
        let leaves = owners.iter().map(leaf).collect();
        Scene {
            manifest: SceneManifest { leaves, ..SceneManifest::default() },
            objects: subtrees.iter().map(object).collect(),
            ..Scene::default()
        }
    }

    #[test]
    fn objects_take_along_what_hierarchies_stand_for_below_them() {
        // Object 0 is above 1 and 2; 3 stands alone; 2 has no hierarchy.
        let scene = scene(&[1, 2, 2, 0, 1, 3], &[&[(0, 5)], &[(0, 1), (4, 5)], &[(1, 3)], &[(5, 6)]]);
        let mut away = Away::new(Arc::new(HierarchyLeaves::of(&scene, [1, 3, 0].map(ObjectId))));
        use Presence::{Away as Gone, There};
        type Words = &'static [(u32, Presence)];
        let turns: [(Words, &[u32]); 7] = [
            (&[], &[]),
            (&[(2, Gone), (9, Gone)], &[]), // neither has a hierarchy
            (&[(3, Gone), (1, Gone)], &[0, 4, 5]),
            (&[(1, Gone), (0, Gone)], &[0, 3, 4, 5]),
            (&[(1, There)], &[3, 5]), // whatever took it away
            (&[(0, There), (1, Gone)], &[0, 4, 5]),
            (&[(1, There), (3, There)], &[]),
        ];
        for (words, expected) in turns {
            let words: Vec<_> = words.iter().map(|(object, presence)| (ObjectId(*object), *presence)).collect();
            away.note(&words);
            assert_eq!(away.set().expect("few").leaves().collect::<Vec<_>>(), expected, "{words:?}");
        }
    }

    #[test]
    fn no_more_is_named_than_a_frame_may_name() {
        let count = 2 * MAX_AWAY_RANGES as u32 + 1;
        let owners: Vec<u32> = (0..count).map(|leaf| leaf % 2).collect();
        let every_other: Vec<(u32, u32)> = (0..count).step_by(2).map(|leaf| (leaf, leaf + 1)).collect();
        let scene = scene(&owners, &[&every_other, &[(1, 2)]]);
        let mut away = Away::new(Arc::new(HierarchyLeaves::of(&scene, [0, 1].map(ObjectId))));
        away.note(&[(ObjectId(0), Presence::Away)]);
        assert!(away.set().is_none());
        away.note(&[(ObjectId(1), Presence::Away)]);
        assert!(away.set().is_some_and(|set| set.ranges().len() == MAX_AWAY_RANGES), "two of them are one range now");
    }
}
