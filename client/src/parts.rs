//! Of some leaves, some triangles.

/// Leaves of which not all triangles are drawn, ascending, and of each those that are, ascending. Keeps its memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    leaves: Vec<Part>,
    numbers: Vec<u16>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Part {
    leaf: u32,
    /// One past its last among the numbers; its first comes after the last of the leaf before.
    end: u32,
}

impl Parts {
    /// None: every leaf is drawn whole.
    pub fn clear(&mut self) {
        self.leaves.clear();
        self.numbers.clear();
    }

    /// Whether every leaf is drawn whole.
    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    /// Of this leaf, which comes after all that are there, these triangles are drawn, by their numbers in it, ascending.
    pub fn push(&mut self, leaf: u32, triangles: impl Iterator<Item = u16>) {
        debug_assert!(self.leaves.last().is_none_or(|last| last.leaf < leaf), "leaf {leaf} is out of order");
        self.numbers.extend(triangles);
        self.leaves.push(Part { leaf, end: self.numbers.len() as u32 });
    }

    /// Which triangles of a leaf are drawn; `None`: all.
    pub fn of(&self, leaf: u32) -> Option<&[u16]> {
        let at = self.leaves.binary_search_by_key(&leaf, |part| part.leaf).ok()?;
        let start = at.checked_sub(1).map_or(0, |before| self.leaves[before].end);
        Some(&self.numbers[start as usize..self.leaves[at].end as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_leaf_has_its_own_triangles() {
        let mut parts = Parts::default();
        parts.push(3, [0, 7].into_iter());
        parts.push(4, std::iter::empty());
        parts.push(9, [1].into_iter());
        assert_eq!([3, 4, 5, 9].map(|leaf| parts.of(leaf)), [Some(&[0, 7][..]), Some(&[]), None, Some(&[1])]);
        parts.clear();
        assert!(parts.is_empty() && parts.of(3).is_none());
    }
}
