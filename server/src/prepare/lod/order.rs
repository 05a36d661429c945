//! Vertices in the order of their splits: what is left first, then what was given up, by stretches from last to first.

use std::ops::Range;

use mullion_common::scene::greatest_first;

use super::collapse::{Collapses, Head};
use super::source::LodMesh;
use super::stretches;

/// Where the link of each collapse starts, and once more.
pub(super) fn link_starts(collapses: &Collapses) -> Vec<usize> {
    let ends = collapses.heads.iter().scan(0, |end, head| {
        *end += head.length;
        Some(*end)
    });
    std::iter::once(0).chain(ends).collect()
}

/// A hierarchy's numbers.
#[derive(Default)]
pub(super) struct Ordered {
    pub base_count: u32,
    /// For each vertex its number in the mesh.
    pub source: Vec<u32>,
    /// Of the vertices behind the base.
    heads: Vec<Head>,
    starts: Vec<u32>,
    links: Vec<u32>,
    /// How far the surface may be from the mesh before each is split.
    errors: Vec<f32>,
    pub base_triangles: Vec<[u32; 3]>,
}

impl Ordered {
    pub fn new(mesh: &LodMesh, collapses: &Collapses) -> Self {
        const UNUSED: u32 = u32::MAX;
        const USED: u32 = u32::MAX - 1;
        let mut number = vec![UNUSED; mesh.positions.len()];
        collapses.triangles.as_flattened().iter().for_each(|v| number[*v as usize] = USED);
        let mut source = Vec::with_capacity(mesh.positions.len());
        for (vertex, number) in (0..).zip(&mut number) {
            if *number == USED {
                *number = source.len() as u32;
                source.push(vertex);
            }
        }
        let base_count = source.len() as u32;
        let link_starts = link_starts(collapses);
        let order = stretches::order(mesh, collapses, &link_starts, source.len());
        for at in &order {
            let vertex = collapses.vertices[*at as usize];
            number[vertex as usize] = source.len() as u32;
            source.push(vertex);
        }
        let mut links = Vec::with_capacity(collapses.links.len());
        let mut starts = Vec::with_capacity(order.len() + 1);
        for at in order.iter().map(|at| *at as usize) {
            starts.push(links.len() as u32);
            let link = &collapses.links[link_starts[at]..link_starts[at + 1]];
            links.extend(link.iter().map(|v| number[*v as usize]));
        }
        starts.push(links.len() as u32);
        let mut base_triangles: Vec<[u32; 3]> =
            collapses.triangles.iter().map(|t| greatest_first(t.map(|v| number[v as usize]))).collect();
        base_triangles.sort_unstable();
        let heads = order.iter().map(|at| collapses.heads[*at as usize]).collect();
        let errors = order.iter().map(|at| collapses.errors[*at as usize]).collect();
        Self { base_count, source, heads, starts, links, errors, base_triangles }
    }

    pub fn count(&self) -> u32 {
        self.source.len() as u32
    }

    /// Of a vertex behind the base.
    pub fn head(&self, vertex: u32) -> &Head {
        &self.heads[(vertex - self.base_count) as usize]
    }

    pub fn error(&self, vertex: u32) -> f32 {
        self.errors[(vertex - self.base_count) as usize]
    }

    pub fn is_lead(&self, vertex: u32) -> bool {
        vertex >= self.base_count && !self.head(vertex).is_follower
    }

    /// The links of vertices behind the base.
    pub fn links_of(&self, vertices: Range<u32>) -> &[u32] {
        let [start, end] = [vertices.start, vertices.end].map(|v| self.starts[(v - self.base_count) as usize] as usize);
        &self.links[start..end]
    }

    /// The vertex from which one behind the base splits.
    pub fn parent(&self, vertex: u32) -> u32 {
        use mullion_common::scene::Link;
        Link::new(self.links_of(vertex..vertex + 1), self.head(vertex).shape).parent()
    }
}
