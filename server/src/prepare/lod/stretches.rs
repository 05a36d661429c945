//! In which order vertices are numbered: coarse first, and of those that are about as coarse, neighbours one behind the other. What a frame
//! refines lies in some places of a mesh, and so in few places of memory.

use std::collections::HashMap;
use std::ops::Range;

use glam::Vec3;
use mullion_common::scene::Link;
use rayon::prelude::*;

use super::collapse::Collapses;
use super::source::LodMesh;
use crate::tree::regroup::morton;

/// No turn: a vertex of the base.
const NONE: u32 = u32::MAX;

/// Collapses as splits: turn 0 undoes the last one.
struct Turns<'a> {
    mesh: &'a LodMesh,
    collapses: &'a Collapses,
    /// Where the link of each collapse starts, and once more.
    link_starts: &'a [usize],
    /// By vertex of the mesh.
    of_vertex: Vec<u32>,
    least: Vec3,
    /// Above 0.
    size: f64,
}

/// Which collapses are undone, one after the other: each behind all that its link needs, and those of one vertex coarse first, as they were.
///
/// Neighbours come together within stretches, each of as many vertices as are before it: however far an object has been streamed, no part of it
/// has half as many vertices as it would have if all came coarse first.
pub(super) fn order(mesh: &LodMesh, collapses: &Collapses, link_starts: &[usize], base_count: usize) -> Vec<u32> {
    let count = collapses.vertices.len();
    let mut of_vertex = vec![NONE; mesh.positions.len()];
    (0..).zip(collapses.vertices.iter().rev()).for_each(|(turn, vertex)| of_vertex[*vertex as usize] = turn);
    let (least, greatest) = mesh.bounds();
    let size = f64::from((greatest - least).max_element()).max(f64::MIN_POSITIVE);
    let turns = Turns { mesh, collapses, link_starts, of_vertex, least, size };
    let mut stretches = Vec::new();
    let mut start = 0;
    while start < count {
        let mut end = (start + (base_count + start).max(1)).min(count);
        while end < count && turns.is_follower(end as u32) {
            end += 1;
        }
        stretches.push(start as u32..end as u32);
        start = end;
    }
    let ordered: Vec<Vec<u32>> = stretches.into_par_iter().map(|stretch| turns.order(stretch)).collect();
    ordered.into_iter().flatten().map(|turn| turns.collapse(turn) as u32).collect()
}

impl Turns<'_> {
    fn collapse(&self, turn: u32) -> usize {
        self.collapses.vertices.len() - 1 - turn as usize
    }

    fn is_follower(&self, turn: u32) -> bool {
        self.collapses.heads[self.collapse(turn)].is_follower
    }

    fn lead(&self, turn: u32) -> u32 {
        turn - u32::from(self.is_follower(turn))
    }

    /// A lead and what follows it.
    fn together(&self, lead: u32, end: u32) -> Range<u32> {
        let next = lead + 1;
        lead..if next < end && self.is_follower(next) { next + 1 } else { next }
    }

    fn link(&self, turn: u32) -> &[u32] {
        let at = self.collapse(turn);
        &self.collapses.links[self.link_starts[at]..self.link_starts[at + 1]]
    }

    /// The vertex that a turn's splits from.
    fn parent(&self, turn: u32) -> u32 {
        let head = &self.collapses.heads[self.collapse(turn)];
        Link::new(self.link(turn), head.shape).parent()
    }

    fn code(&self, turn: u32) -> u64 {
        let vertex = self.collapses.vertices[self.collapse(turn)];
        morton((self.mesh.positions[vertex as usize] - self.least).as_dvec3() / self.size)
    }

    /// The turns of a stretch along a Morton curve, but that each takes what it needs before it.
    fn order(&self, stretch: Range<u32>) -> Vec<u32> {
        let Range { start, end } = stretch;
        let leads = || (start..end).filter(|turn| !self.is_follower(*turn));
        let mut along: Vec<(u64, u32)> = leads().map(|lead| (self.code(lead), lead)).collect();
        along.sort_unstable();
        // By turn: the one before it that splits from the same vertex.
        let mut elder = vec![NONE; stretch.len()];
        let mut youngest = HashMap::new();
        for lead in leads() {
            elder[(lead - start) as usize] = youngest.insert(self.parent(lead), lead).unwrap_or(NONE);
        }
        let mut is_placed = vec![false; stretch.len()];
        let mut placed = Vec::with_capacity(stretch.len());
        let mut stack = Vec::new();
        for (_, lead) in along {
            stack.push(lead);
            while let Some(lead) = stack.last().copied() {
                let links = self.together(lead, end).flat_map(|turn| self.link(turn));
                let of_links = links.map(|vertex| self.of_vertex[*vertex as usize]);
                let needed = std::iter::once(elder[(lead - start) as usize]).chain(of_links).filter(|turn| *turn != NONE);
                let waits = |turn: &u32| *turn >= start && *turn < lead && !is_placed[(turn - start) as usize];
                if is_placed[(lead - start) as usize] {
                    stack.pop();
                } else if let Some(first) = needed.map(|turn| self.lead(turn)).find(waits) {
                    stack.push(first);
                } else {
                    for turn in self.together(lead, end) {
                        is_placed[(turn - start) as usize] = true;
                        placed.push(turn);
                    }
                    stack.pop();
                }
            }
        }
        placed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::lod::collapse::Regions;
    use crate::prepare::lod::order::link_starts;
    use crate::prepare::lod::tests::{all, grid, soup};

    /// The order of a mesh, as collapses and as turns by vertex, and how many vertices its base has.
    fn ordered(mesh: &LodMesh) -> (Collapses, Vec<u32>, usize) {
        let collapses = Collapses::of(mesh, Regions::default());
        let base_count = mesh.positions.len() - collapses.vertices.len();
        let order = order(mesh, &collapses, &link_starts(&collapses), base_count);
        (collapses, order, base_count)
    }

    #[test]
    fn each_comes_behind_what_it_needs() {
        for (name, mesh) in all().into_iter().chain([("soup", soup())]) {
            let (collapses, order, _) = ordered(&mesh);
            let starts = link_starts(&collapses);
            let mut at = vec![0; mesh.positions.len()];
            (1..).zip(&order).for_each(|(turn, collapse)| at[collapses.vertices[*collapse as usize] as usize] = turn);
            let mut all = order.clone();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..collapses.vertices.len() as u32), "{name}: each once");
            let mut youngest = HashMap::new();
            for (turn, collapse) in (1..).zip(order.iter().map(|collapse| *collapse as usize)) {
                let (link, head) = (&collapses.links[starts[collapse]..starts[collapse + 1]], collapses.heads[collapse]);
                assert!(link.iter().all(|vertex| at[*vertex as usize] < turn), "{name}: turn {turn}");
                if head.is_follower {
                    assert_eq!(order[turn - 2] as usize, collapse + 1, "{name}: turn {turn}");
                    continue;
                }
                let parent = Link::new(link, head.shape).parent();
                let elder = youngest.insert(parent, collapse);
                assert!(elder.is_none_or(|elder| elder > collapse), "{name}: turn {turn} is coarser than the one before it");
            }
        }
    }

    /// Each holds what was given up last of what is not before it, and in a walk from neighbour to neighbour.
    #[test]
    fn stretches_are_walks_along_the_mesh() {
        let lift = |u: f32, v: f32| Vec3::new(u * 60.0, v * 60.0, (u * 31.0).sin() + (v * 23.0).cos());
        let (positions, triangles) = grid(60, 60, [false; 2], lift);
        let mesh = LodMesh::of_triangles(&positions, &triangles);
        let (collapses, order, base_count) = ordered(&mesh);
        let last_first: Vec<u32> = (0..order.len() as u32).rev().collect();
        let mut start = 0;
        while start < order.len() {
            let end = (2 * start + base_count).min(order.len());
            let sorted = |order: &[u32]| {
                let mut stretch = order[start..end].to_vec();
                stretch.sort_unstable();
                stretch
            };
            assert_eq!(sorted(&order), sorted(&last_first), "vertices {start} to {end} are not those that were given up last");
            let walk = |order: &[u32]| -> f32 {
                let place = |collapse: u32| mesh.positions[collapses.vertices[collapse as usize] as usize];
                order[start..end].windows(2).map(|pair| place(pair[0]).distance(place(pair[1]))).sum()
            };
            let (along, across) = (walk(&order), walk(&last_first));
            assert!(end - start < 500 || along * 4.0 < across, "{along} m of {across} for vertices {start} to {end}");
            start = end;
        }
    }
}
