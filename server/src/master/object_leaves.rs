//! Which leaves an object has of its own.

use mullion_common::scene::{ObjectId, SceneManifest};
use mullion_common::visible_set::LeafRange;

/// The leaves of each object, those of objects below it aside.
#[derive(Debug, Default)]
pub struct ObjectLeaves {
    /// By object: where its ranges end.
    ends: Vec<u32>,
    ranges: Vec<LeafRange>,
}

impl ObjectLeaves {
    /// Of a scene. Takes as long as there are leaves.
    pub fn of(scene: &SceneManifest) -> Self {
        let (leaves, objects) = (&scene.leaves, scene.transforms.len());
        let runs = || {
            let runs = leaves.chunk_by(|a, b| a.object == b.object);
            runs.scan(0, |start, run| {
                let range = LeafRange::new(*start, *start + run.len() as u32);
                *start = range.end;
                Some((run[0].object.0 as usize, range))
            })
        };
        let mut next = vec![0u32; objects];
        runs().for_each(|(object, _)| next[object] += 1);
        let mut sum = 0;
        for next in &mut next {
            (*next, sum) = (sum, sum + *next);
        }
        let mut ranges = vec![LeafRange::new(0, 0); sum as usize];
        for (object, range) in runs() {
            ranges[next[object] as usize] = range;
            next[object] += 1;
        }
        Self { ends: next, ranges }
    }

    /// How many objects there are.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// An object's leaves, ascending; none of an object that is not there.
    pub fn ranges(&self, object: ObjectId) -> &[LeafRange] {
        let at = object.0 as usize;
        let Some(end) = self.ends.get(at) else { return &[] };
        let start = at.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.ranges[start as usize..*end as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DAffine3;
    use mullion_common::scene::{ChunkId, LeafRecord, MaterialId};

    #[test]
    fn leaves_are_found_by_their_objects() {
        let leaf = |object: u32| LeafRecord {
            object: ObjectId(object),
            chunk: ChunkId(0),
            material: MaterialId(0),
            triangle_count: 1,
            local_min: [0.0; 3],
            local_max: [1.0; 3],
        };
        let owners = [3, 3, 0, 3, 1, 1, 1, 0];
        let transforms = vec![DAffine3::IDENTITY.into(); 5];
        let leaves =
            ObjectLeaves::of(&SceneManifest { leaves: owners.map(leaf).to_vec(), transforms, ..SceneManifest::default() });
        for object in 0..7 {
            let found: Vec<u32> = leaves.ranges(ObjectId(object)).iter().flat_map(|range| range.start..range.end).collect();
            let owned: Vec<u32> = (0..8).filter(|leaf| owners[*leaf as usize] == object).collect();
            assert_eq!(found, owned, "object {object}");
        }
        assert_eq!(leaves.ranges(ObjectId(3)).len(), 2);
    }
}
