//! Cluster hierarchies: the mesh is cut into clusters, neighbouring ones are put into groups, each is simplified as one with its border locked
//! and cut anew, level by level (Karis, Stubbe, Wihlidal: *A Deep Dive into Nanite*, 2021).
//!
//! ```text
//! mesh ─ cut ─→ clusters ─ groups ─→ pieces ─ simplified (surface says which may be) ─ cut ─→ fewer clusters ─ … ─→ roots ─ order ─→ blocks
//!                  ↑                                                                            │
//!                  └────────────────────────────── the next level ─────────────────────────────┘
//! ```

mod bounds;
mod meshing;
mod order;
mod piece;
mod surface;

use mullion_common::scene::{ClusterBase, ClusterBlock, MAX_GROUP_MEMBERS, MAX_GROUP_RESULTS};
use rayon::prelude::*;

use super::source::LodMesh;
use bounds::GroupBounds;
use piece::Piece;

/// Clusters that are simplified together: fewer, and most vertices are on a border that stays; more, and a cut is refined in larger steps.
const GROUP_CLUSTERS: usize = 12;
/// A cluster that did not become coarser in so many groups is a root.
const TRIES: u8 = 3;
/// No group.
const NONE: u32 = u32::MAX;

/// A cluster by vertices of the mesh, of one material.
struct Cluster {
    triangles: Vec<[u32; 3]>,
    /// The group that made it, or [`NONE`].
    maker: u32,
    /// Groups that it was in, and that saved nothing.
    tries: u8,
}

struct Group {
    members: Vec<Cluster>,
    bounds: GroupBounds,
    /// Metres, as it is before it is packed.
    error_m: f32,
}

/// What a mesh is made into.
struct Levels<'a> {
    mesh: &'a LodMesh,
    /// Fine to coarse.
    groups: Vec<Group>,
    roots: Vec<Cluster>,
    /// By weld: whether a root has it, which stays.
    is_fixed: Vec<bool>,
}

/// What a hierarchy of a mesh is sent as. The same mesh gives the same.
pub(super) fn clustered(mesh: &LodMesh, block_vertices: u32) -> (ClusterBase, Vec<ClusterBlock>) {
    let mut levels = Levels { mesh, groups: Vec::new(), roots: Vec::new(), is_fixed: vec![false; mesh.positions.len()] };
    let whole = Piece::new(mesh, &mesh.triangles).clusters();
    let mut clusters: Vec<Cluster> = whole.into_iter().map(|triangles| Cluster { triangles, maker: NONE, tries: 0 }).collect();
    while clusters.len() > 1 {
        let before = levels.groups.len();
        clusters = levels.coarsen(clusters);
        if levels.groups.len() == before {
            break;
        }
    }
    levels.roots.extend(clusters);
    order::blocks(mesh, levels.roots, levels.groups, block_vertices)
}

impl Levels<'_> {
    /// Makes the groups of a level; gives back what the next one begins with.
    fn coarsen(&mut self, clusters: Vec<Cluster>) -> Vec<Cluster> {
        let groups = self.group(clusters);
        let shared = self.shared(&groups);
        let mesh = self.mesh;
        let simplified: Vec<_> = groups
            .par_iter()
            .map(|members| {
                let triangles: Vec<[u32; 3]> = members.iter().flat_map(|member| member.triangles.iter().copied()).collect();
                let (left, error) = Piece::new(mesh, &triangles).simplified(|weld| shared[weld as usize])?;
                let results = Piece::new(mesh, &left).clusters();
                (results.len() <= MAX_GROUP_RESULTS as usize).then_some((results, error))
            })
            .collect();
        let mut next = Vec::new();
        for (members, simplified) in groups.into_iter().zip(simplified) {
            match simplified {
                Some((results, error)) => {
                    let maker = self.groups.len() as u32;
                    self.add_group(members, error);
                    next.extend(results.into_iter().map(|triangles| Cluster { triangles, maker, tries: 0 }));
                }
                None => {
                    for mut member in members {
                        member.tries += 1;
                        if member.tries < TRIES { next.push(member) } else { self.retire(member) }
                    }
                }
            }
        }
        next
    }

    /// Puts clusters into groups of neighbours.
    fn group(&self, clusters: Vec<Cluster>) -> Vec<Vec<Cluster>> {
        let mut welds: Vec<u32> = clusters.iter().flat_map(|c| c.triangles.as_flattened()).map(|v| self.weld(*v)).collect();
        welds.sort_unstable();
        welds.dedup();
        let local = |v: u32| welds.partition_point(|weld| *weld < self.weld(v)) as u32;
        let by_place: Vec<Vec<[u32; 3]>> =
            clusters.par_iter().map(|c| c.triangles.iter().map(|t| t.map(local)).collect()).collect();
        let unit = meshing::Unit::of(welds.iter().map(|weld| self.mesh.positions[*weld as usize]));
        let numbers = meshing::groups(&unit, &by_place, GROUP_CLUSTERS);
        let mut numbered: Vec<(u32, Cluster)> = numbers.into_iter().zip(clusters).collect();
        numbered.sort_by_key(|(number, _)| *number);
        let mut groups: Vec<Vec<Cluster>> = Vec::new();
        let mut last = None;
        for (number, cluster) in numbered {
            match groups.last_mut() {
                Some(group) if last == Some(number) && group.len() < MAX_GROUP_MEMBERS as usize => group.push(cluster),
                _ => groups.push(vec![cluster]),
            }
            last = Some(number);
        }
        groups
    }

    /// By weld: whether several groups have it, or a root.
    fn shared(&self, groups: &[Vec<Cluster>]) -> Vec<bool> {
        let mut shared = self.is_fixed.clone();
        let mut users = vec![NONE; self.mesh.positions.len()];
        for (number, members) in (0..).zip(groups) {
            for vertex in members.iter().flat_map(|member| member.triangles.as_flattened()) {
                let weld = self.weld(*vertex) as usize;
                shared[weld] |= users[weld] != NONE && users[weld] != number;
                users[weld] = number;
            }
        }
        shared
    }

    fn weld(&self, vertex: u32) -> u32 {
        self.mesh.welds[vertex as usize]
    }

    fn add_group(&mut self, members: Vec<Cluster>, error: f32) {
        let mut makers: Vec<u32> = members.iter().map(|member| member.maker).filter(|maker| *maker != NONE).collect();
        makers.sort_unstable();
        makers.dedup();
        let of_maker = |maker: &u32| &self.groups[*maker as usize];
        // What is off already, and what comes to it.
        let error_m = (makers.iter().map(|maker| of_maker(maker).error_m).fold(0.0, f32::max) + error).min(f32::MAX);
        let makers: Vec<GroupBounds> = makers.iter().map(|maker| of_maker(maker).bounds).collect();
        let triangles = members.iter().flat_map(|member| member.triangles.iter().copied());
        let bounds = GroupBounds::new(self.mesh, triangles, &makers, error_m);
        self.groups.push(Group { members, bounds, error_m });
    }

    fn retire(&mut self, cluster: Cluster) {
        for vertex in cluster.triangles.as_flattened() {
            let weld = self.weld(*vertex) as usize;
            self.is_fixed[weld] = true;
        }
        self.roots.push(cluster);
    }
}

#[cfg(test)]
mod tests;
