//! The ring or path of vertices around one, and the triangles that its split takes and puts.

use bytemuck::{Pod, Zeroable};

/// Most vertices in a link: what triangles of a vertex are drawn is a mask of 32 bits.
pub const MAX_LINK: usize = 31;

/// How a link runs, counterclockwise around its vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinkShape {
    /// A ring; the parent is first.
    #[default]
    Ring,
    /// A path, of a vertex on a border or a seam; the parent is first.
    PathFromParent,
    /// A path; the parent is last.
    PathToParent,
}

/// How many vertices a link has, 5 bits; its shape, 2 bits; whether its vertex follows the one before, 1 bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct LinkHead(u8);

impl LinkHead {
    /// Packs them; `length` is at most [`MAX_LINK`].
    pub fn new(length: usize, shape: LinkShape, is_follower: bool) -> Self {
        assert!(length <= MAX_LINK, "a link of {length} vertices");
        let shape = match shape {
            LinkShape::Ring => 0,
            LinkShape::PathFromParent => 1,
            LinkShape::PathToParent => 2,
        };
        Self(length as u8 | shape << 5 | u8::from(is_follower) << 7)
    }

    pub fn length(self) -> usize {
        usize::from(self.0 & 31)
    }

    /// The shape, or `None` for a number that is none.
    pub fn checked_shape(self) -> Option<LinkShape> {
        match self.0 >> 5 & 3 {
            0 => Some(LinkShape::Ring),
            1 => Some(LinkShape::PathFromParent),
            2 => Some(LinkShape::PathToParent),
            _ => None,
        }
    }

    /// The shape of a link that has been checked.
    #[inline]
    pub fn shape(self) -> LinkShape {
        self.checked_shape().unwrap_or_default()
    }

    #[inline]
    pub fn is_follower(self) -> bool {
        self.0 >> 7 != 0
    }
}

/// A vertex's neighbours at its split.
#[derive(Clone, Copy, Debug)]
pub struct Link<'a> {
    path: &'a [u32],
    shape: LinkShape,
}

impl<'a> Link<'a> {
    /// A link; a ring has three vertices at least, a path two.
    #[inline]
    pub fn new(path: &'a [u32], shape: LinkShape) -> Self {
        Self { path, shape }
    }

    /// Its vertices, counterclockwise.
    #[inline]
    pub fn path(&self) -> &'a [u32] {
        self.path
    }

    /// How it runs.
    pub fn shape(&self) -> LinkShape {
        self.shape
    }

    /// The vertex that its own splits from.
    #[inline]
    pub fn parent(&self) -> u32 {
        match self.shape {
            LinkShape::PathToParent => self.path[self.path.len() - 1],
            _ => self.path[0],
        }
    }

    /// The ceiling: for each triangle of the vertex its edge opposite.
    #[inline]
    pub fn edges(&self) -> impl ExactSizeIterator<Item = (u32, u32)> + use<'a> {
        let (path, count) = (self.path, self.edge_count());
        (0..count).map(move |k| (path[k], path[if k + 1 == path.len() { 0 } else { k + 1 }]))
    }

    #[inline]
    fn edge_count(&self) -> usize {
        self.path.len() - usize::from(self.shape != LinkShape::Ring)
    }

    /// The floor: the parent's triangles, each by its edge opposite.
    #[inline]
    pub fn floor(&self) -> impl Iterator<Item = (u32, u32)> + use<'a> {
        let others = match self.shape {
            LinkShape::PathToParent => &self.path[..self.path.len() - 1],
            _ => &self.path[1..],
        };
        others.windows(2).map(|pair| (pair[0], pair[1]))
    }

    /// How many triangles more the ceiling has than the floor.
    #[inline]
    pub fn added_triangles(&self) -> u32 {
        if self.shape == LinkShape::Ring { 2 } else { 1 }
    }

    /// One of [`Link::edges`].
    #[inline]
    pub fn edge(&self, number: u32) -> (u32, u32) {
        let next = if number as usize + 1 == self.path.len() { 0 } else { number as usize + 1 };
        (self.path[number as usize], self.path[next])
    }

    /// The number of an edge among [`Link::edges`].
    #[inline]
    pub fn number_of(&self, a: u32, b: u32) -> Option<u32> {
        let at = self.path.iter().position(|vertex| *vertex == a)?;
        (at < self.edge_count() && self.edge(at as u32).1 == b).then_some(at as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floors_and_ceilings() {
        let of = |path: &[u32], shape| {
            let link = Link::new(path, shape);
            (link.parent(), link.edges().collect::<Vec<_>>(), link.floor().collect::<Vec<_>>())
        };
        assert_eq!(of(&[9, 4, 5, 6], LinkShape::Ring), (9, vec![(9, 4), (4, 5), (5, 6), (6, 9)], vec![(4, 5), (5, 6)]));
        assert_eq!(of(&[9, 4, 5], LinkShape::PathFromParent), (9, vec![(9, 4), (4, 5)], vec![(4, 5)]));
        assert_eq!(of(&[4, 5, 9], LinkShape::PathToParent), (9, vec![(4, 5), (5, 9)], vec![(4, 5)]));
        assert_eq!(of(&[4, 9], LinkShape::PathToParent), (9, vec![(4, 9)], vec![]));
        let ring = Link::new(&[9, 4, 5, 6], LinkShape::Ring);
        assert_eq!([(9, 4), (6, 9), (4, 9), (7, 9)].map(|(a, b)| ring.number_of(a, b)), [Some(0), Some(3), None, None]);
        assert_eq!(Link::new(&[4, 5, 9], LinkShape::PathToParent).number_of(9, 4), None);
    }

    #[test]
    fn heads_go_round() {
        for shape in [LinkShape::Ring, LinkShape::PathFromParent, LinkShape::PathToParent] {
            for (length, is_follower) in [(0, false), (2, true), (MAX_LINK, true)] {
                let head = LinkHead::new(length, shape, is_follower);
                assert_eq!((head.length(), head.checked_shape(), head.is_follower()), (length, Some(shape), is_follower));
            }
        }
        assert_eq!(LinkHead(0x7f).checked_shape(), None);
    }
}
