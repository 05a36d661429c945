//! What was done to a scene, done again to one that has grown from it: so much a frame, while both go on.

use mullion_common::visible_set::LeafRange;

use super::DynamicScene;

/// Moves done again in a frame: about a millisecond's work.
const MOVES_A_STEP: usize = 1 << 12;
/// Leaves looked at in a frame for whether they were removed.
const LEAVES_A_STEP: u32 = 1 << 14;

/// How far that is.
///
/// What happens meanwhile is to be done to both scenes at once. Objects and leaves have the same numbers in both.
#[derive(Clone, Copy, Debug, Default)]
pub struct CarryOver {
    moves: usize,
    leaves: u32,
}

impl CarryOver {
    /// Does the next step; whether it was the last. The same scenes take the same steps.
    pub fn step(&mut self, from: &DynamicScene, to: &mut DynamicScene) -> bool {
        let moves = from.placed().len();
        let end = moves.min(self.moves + MOVES_A_STEP);
        for (object, world_from_local) in &from.placed()[self.moves..end] {
            to.move_object(*object, world_from_local);
        }
        self.moves = end;
        let leaf_count = from.tree().hierarchy().leaf_count();
        let end = leaf_count.min(self.leaves.saturating_add(LEAVES_A_STEP));
        if let Some(removed) = from.tree().removed() {
            let ranges = removed.ranges();
            let first = ranges.partition_point(|range| range.end <= self.leaves);
            let within = ranges[first..].iter().take_while(|range| range.start < end);
            let away: Vec<LeafRange> =
                within.map(|range| LeafRange::new(range.start.max(self.leaves), range.end.min(end))).collect();
            to.tree_mut().remove_leaves(&away);
        }
        self.leaves = end;
        self.moves == moves && self.leaves == leaf_count
    }
}
