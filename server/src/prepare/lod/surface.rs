//! A mesh while it is collapsed: which triangles are around a vertex, and in which order.

use mullion_common::scene::MAX_LINK;

use super::source::LodMesh;

const NONE: u32 = u32::MAX;

/// Triangles around vertices, as lists of corners. Corner 3 t + k is the k-th of triangle t.
pub(super) struct Surface {
    /// The vertex of each corner; [`NONE`] where the triangle is gone.
    corners: Vec<u32>,
    first: Vec<u32>,
    next: Vec<u32>,
}

/// The triangles around a vertex in order, counterclockwise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fan {
    path: [u32; MAX_LINK + 1],
    length: usize,
    is_ring: bool,
}

impl Fan {
    /// Its rim: a ring of all vertices around, or a path from the first to the last.
    pub fn path(&self) -> &[u32] {
        &self.path[..self.length]
    }

    pub fn is_ring(&self) -> bool {
        self.is_ring
    }

    pub fn triangles(&self) -> usize {
        self.length - usize::from(!self.is_ring)
    }

    /// The edges opposite the vertex.
    pub fn edges(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        (0..self.triangles()).map(|k| (self.path[k], self.path[(k + 1) % self.length]))
    }

    /// Puts these edges of triangles in order; `None` where they are no single fan, or too many.
    fn of_edges(edges: &[(u32, u32)]) -> Option<Self> {
        if edges.is_empty() || edges.len() > MAX_LINK {
            return None;
        }
        let starts_somewhere = |(a, _): &(u32, u32)| !edges.iter().any(|(_, b)| a == b);
        let first = edges.iter().position(starts_somewhere);
        let mut fan = Self { path: [NONE; MAX_LINK + 1], length: 1, is_ring: first.is_none() };
        let mut at = edges[first.unwrap_or(0)];
        fan.path[0] = at.0;
        for step in 1..=edges.len() {
            let closes = step == edges.len() && fan.is_ring;
            if fan.path[..fan.length].contains(&at.1) {
                return (closes && at.1 == fan.path[0]).then_some(fan);
            }
            fan.path[fan.length] = at.1;
            fan.length += 1;
            if step < edges.len() {
                at = *edges.iter().find(|(a, _)| *a == at.1)?;
            }
        }
        (!fan.is_ring && fan.length == edges.len() + 1).then_some(fan)
    }
}

impl Surface {
    pub fn of(mesh: &LodMesh) -> Self {
        Self::of_triangles(&mesh.triangles, mesh.positions.len())
    }

    /// Triangles between so many vertices.
    pub fn of_triangles(triangles: &[[u32; 3]], vertices: usize) -> Self {
        let corners: Vec<u32> = triangles.as_flattened().to_vec();
        let mut first = vec![NONE; vertices];
        let mut next = vec![NONE; corners.len()];
        // Last to first, so that lists run along the memory.
        for (corner, vertex) in corners.iter().enumerate().rev() {
            next[corner] = first[*vertex as usize];
            first[*vertex as usize] = corner as u32;
        }
        Self { corners, first, next }
    }

    /// The triangles around a vertex: for each the edge opposite, and the corner that is the vertex's.
    #[inline]
    pub fn around(&self, vertex: u32) -> impl Iterator<Item = (u32, u32, u32)> + '_ {
        let step = |corner: &u32| Some(self.next[*corner as usize]).filter(|next| *next != NONE);
        let start = Some(self.first[vertex as usize]).filter(|corner| *corner != NONE);
        std::iter::successors(start, step).filter_map(|corner| {
            if self.corners[corner as usize] == NONE {
                return None;
            }
            let at = corner as usize / 3 * 3;
            let (b, c) = match corner as usize - at {
                0 => (at + 1, at + 2),
                1 => (at + 2, at),
                _ => (at, at + 1),
            };
            Some((self.corners[b], self.corners[c], corner))
        })
    }

    /// The fan of a vertex; `None` where the triangles around it are no single one, or too many.
    pub fn fan(&self, vertex: u32) -> Option<Fan> {
        let mut edges = [(0, 0); MAX_LINK];
        let mut count = 0;
        for (a, b, _) in self.around(vertex) {
            *edges.get_mut(count)? = (a, b);
            count += 1;
        }
        Fan::of_edges(&edges[..count])
    }

    /// Moves a vertex's triangles to another vertex; those that have both are gone.
    pub fn collapse(&mut self, vertex: u32, onto: u32) {
        self.forget_gone(onto);
        let mut corner = self.first[vertex as usize];
        while corner != NONE {
            let next = self.next[corner as usize];
            let at = corner as usize / 3 * 3;
            if self.corners[corner as usize] != NONE {
                if self.corners[at..at + 3].contains(&onto) {
                    self.corners[at..at + 3].fill(NONE);
                } else {
                    self.corners[corner as usize] = onto;
                    self.next[corner as usize] = self.first[onto as usize];
                    self.first[onto as usize] = corner;
                }
            }
            corner = next;
        }
        self.first[vertex as usize] = NONE;
        self.forget_gone(onto);
    }

    /// Takes corners of triangles that are gone out of a vertex's list.
    pub fn forget_gone(&mut self, vertex: u32) {
        let mut before = NONE;
        let mut corner = self.first[vertex as usize];
        while corner != NONE {
            let next = self.next[corner as usize];
            if self.corners[corner as usize] != NONE {
                before = corner;
            } else if before == NONE {
                self.first[vertex as usize] = next;
            } else {
                self.next[before as usize] = next;
            }
            corner = next;
        }
    }

    /// The triangles that are left.
    pub fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.corners.chunks_exact(3).filter(|t| t[0] != NONE).map(|t| [t[0], t[1], t[2]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_become_fans() {
        let path = |edges: &[(u32, u32)]| Fan::of_edges(edges).map(|fan| (fan.path().to_vec(), fan.is_ring()));
        assert_eq!(path(&[(5, 7), (9, 5), (7, 8)]), Some((vec![9, 5, 7, 8], false)));
        assert_eq!(path(&[(5, 7), (7, 9), (9, 5)]), Some((vec![5, 7, 9], true)));
        assert_eq!(path(&[(5, 7)]), Some((vec![5, 7], false)));
        assert_eq!(path(&[(5, 7), (8, 9)]), None, "two fans");
        assert_eq!(path(&[(5, 7), (5, 9)]), None, "two triangles on one side of an edge");
        assert_eq!(path(&[(5, 7), (7, 9), (9, 5), (1, 2)]), None, "a ring and more");
        assert_eq!(path(&[(5, 7), (7, 9), (9, 5), (1, 2), (2, 1)]), None, "two rings");
        assert_eq!(path(&[(5, 7), (5, 7)]), None, "a face twice");
        assert_eq!(path(&[]), None);
    }

    #[test]
    fn a_collapse_moves_triangles() {
        let positions: Vec<glam::Vec3> = (0..6).map(|k| glam::Vec3::new(k as f32, (k * k) as f32, 0.0)).collect();
        let mesh = LodMesh::of_triangles(&positions, &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [1, 5, 2]]);
        let mut surface = Surface::of(&mesh);
        assert!(surface.fan(0).is_some_and(|fan| fan.is_ring() && fan.triangles() == 4));
        surface.collapse(0, 1);
        let mut left: Vec<_> = surface.triangles().collect();
        left.sort_unstable();
        assert_eq!(left, [[1, 2, 3], [1, 3, 4], [1, 5, 2]]);
        assert_eq!(surface.fan(1).expect("a path").path(), [5, 2, 3, 4]);
        assert!(surface.fan(0).is_none());
    }
}
