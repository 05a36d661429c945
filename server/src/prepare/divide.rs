//! Divides meshes into leaves: a sloppy n-ary space partitioning (Bartz, Meißner, Hüttner 1999, section 3). Triangles
//! go whole to one leaf by their barycentre, so that leaves may overlap and none is cut.

use glam::Vec3;
use mullion_common::geometry::Aabb;
use mullion_common::scene::GeometryChunk;
use rayon::prelude::*;

use super::gltf::SourcePrimitive;
use crate::tree::regroup::{Tree, morton};

/// Runs of the Morton order that make up a leaf at the least: more runs follow the surface-area heuristic more
/// closely, fewer build faster.
const RUNS_PER_LEAF: u32 = 64;

/// One leaf's triangles.
pub(super) struct Piece {
    /// Indices in the primitive, ascending.
    pub triangles: Vec<u32>,
    /// Encoded geometry.
    pub bytes: Vec<u8>,
    /// Bounds of its vertices, local space.
    pub local: (Vec3, Vec3),
}

/// A primitive as pieces and a tree over them.
pub(super) struct Division {
    pub pieces: Vec<Piece>,
    /// Over `pieces`, which stand in its order.
    pub tree: Tree,
}

/// Divides a primitive into pieces of at most `max_triangles` triangles.
pub(super) fn divide(primitive: &SourcePrimitive, max_triangles: u32) -> Division {
    let triangle_count = (primitive.indices.len() / 3) as u32;
    if triangle_count == 0 {
        return Division { pieces: Vec::new(), tree: Tree::default() };
    }
    let groups = if triangle_count <= max_triangles {
        vec![(0..triangle_count).collect()]
    } else {
        group_triangles(primitive, triangle_count, max_triangles)
    };
    let mut pieces: Vec<Piece> = groups.into_par_iter().map(|triangles| extract(primitive, triangles)).collect();
    let boxes: Vec<Aabb> = pieces.iter().map(|p| Aabb { min: p.local.0.as_dvec3(), max: p.local.1.as_dvec3() }).collect();
    let tree = Tree::over(&boxes);
    let mut place = vec![0; pieces.len()];
    let mut nodes = tree.nodes;
    for (i, node) in nodes.iter_mut().filter(|n| n.item.is_some()).enumerate() {
        if let Some(item) = node.item.replace(i as u32) {
            place[item as usize] = i;
        }
    }
    let mut order: Vec<_> = place.into_iter().zip(pieces.drain(..)).collect();
    order.sort_unstable_by_key(|(at, _)| *at);
    Division { pieces: order.into_iter().map(|(_, piece)| piece).collect(), tree: Tree { nodes } }
}

/// Sorts triangles along a Morton curve through their barycentres, builds a tree over short runs of that order, and
/// cuts it into the largest subtrees that fit.
fn group_triangles(primitive: &SourcePrimitive, triangle_count: u32, max_triangles: u32) -> Vec<Vec<u32>> {
    let corner = |i: u32| primitive.positions[i as usize];
    let corners = |t: u32| {
        let at = t as usize * 3;
        [corner(primitive.indices[at]), corner(primitive.indices[at + 1]), corner(primitive.indices[at + 2])]
    };
    let barycentre = |t: u32| {
        let [a, b, c] = corners(t);
        (a.as_dvec3() + b.as_dvec3() + c.as_dvec3()) / 3.0
    };
    let bounds =
        primitive.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)));
    let size = (bounds.1.as_dvec3() - bounds.0.as_dvec3()).max_element().max(f64::MIN_POSITIVE);
    let mut order: Vec<(u64, u32)> =
        (0..triangle_count).into_par_iter().map(|t| (morton((barycentre(t) - bounds.0.as_dvec3()) / size), t)).collect();
    order.par_sort_unstable();
    let run = (max_triangles / RUNS_PER_LEAF).max(1) as usize;
    let boxes: Vec<Aabb> = order
        .par_chunks(run)
        .map(|run| Aabb::of_points(run.iter().flat_map(|(_, t)| corners(*t)).map(|p| p.as_dvec3())))
        .collect();
    let tree = Tree::over(&boxes);
    let max_runs = (max_triangles as usize / run) as u32;
    let mut groups = Vec::new();
    let mut at = 0;
    while at < tree.nodes.len() {
        let node = tree.nodes[at];
        if node.item_count > max_runs {
            at += 1;
            continue;
        }
        let runs = tree.items(at as u32).flat_map(|item| {
            let start = item as usize * run;
            &order[start..(start + run).min(order.len())]
        });
        let mut triangles: Vec<u32> = runs.map(|(_, t)| *t).collect();
        triangles.sort_unstable();
        groups.push(triangles);
        at = node.subtree_end as usize;
    }
    groups
}

/// The geometry of some triangles, with the vertices that they use in ascending order.
fn extract(primitive: &SourcePrimitive, triangles: Vec<u32>) -> Piece {
    let corners = triangles.iter().flat_map(|t| &primitive.indices[*t as usize * 3..][..3]);
    let mut vertex_ids: Vec<u32> = corners.clone().copied().collect();
    vertex_ids.sort_unstable();
    vertex_ids.dedup();
    let place = |v: &u32| vertex_ids.partition_point(|id| id < v) as u16;
    let indices = corners.map(place).collect();
    let positions: Vec<[f32; 3]> = vertex_ids.iter().map(|&v| primitive.positions[v as usize].to_array()).collect();
    let local = positions
        .iter()
        .map(|p| Vec3::from(*p))
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)));
    let snorm = |n: Vec3| {
        let q = |c: f32| (c.clamp(-1.0, 1.0) * 127.0).round() as i8;
        [q(n.x), q(n.y), q(n.z), 0]
    };
    let pick = |v: &u32| *v as usize;
    let chunk = GeometryChunk {
        uvs: primitive.uvs.iter().flat_map(|uvs| vertex_ids.iter().map(|v| uvs[pick(v)].to_array())).collect(),
        colors: primitive.colors.iter().flat_map(|colors| vertex_ids.iter().map(|v| colors[pick(v)])).collect(),
        normals: primitive.normals.iter().flat_map(|normals| vertex_ids.iter().map(|v| snorm(normals[pick(v)]))).collect(),
        positions,
        vertex_ids,
        indices,
    };
    Piece { triangles, bytes: chunk.encode(), local }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bumpy strip of `2n` triangles.
    fn strip(n: u32) -> SourcePrimitive {
        let positions: Vec<Vec3> = (0..=n)
            .flat_map(|i| {
                let x = i as f32;
                [Vec3::new(x, 0.0, (x * 0.7).sin()), Vec3::new(x, 2.0, (x * 0.3).cos())]
            })
            .collect();
        let indices = (0..n).flat_map(|i| [2 * i, 2 * i + 2, 2 * i + 1, 2 * i + 1, 2 * i + 2, 2 * i + 3]).collect();
        SourcePrimitive { gltf_primitive: 0, positions, normals: None, uvs: None, colors: None, indices, material: None }
    }

    #[test]
    fn every_triangle_lands_in_one_piece() {
        let primitive = strip(500);
        for max in [1, 7, 64, 100, 999, 1000, 5000] {
            let division = divide(&primitive, max);
            let mut seen: Vec<u32> = division.pieces.iter().flat_map(|p| p.triangles.iter().copied()).collect();
            seen.sort_unstable();
            assert_eq!(seen, (0..1000).collect::<Vec<_>>(), "max {max}");
            assert!(division.pieces.iter().all(|p| p.triangles.len() as u32 <= max), "max {max}");
            let order: Vec<_> = division.tree.items(0).collect();
            assert_eq!(order, (0..division.pieces.len() as u32).collect::<Vec<_>>());
            for piece in &division.pieces {
                let chunk = GeometryChunk::decode(&piece.bytes).expect("a chunk");
                for (k, t) in piece.triangles.iter().enumerate() {
                    for c in 0..3 {
                        let source = primitive.indices[*t as usize * 3 + c];
                        let here = usize::from(chunk.indices[k * 3 + c]);
                        assert_eq!(chunk.vertex_ids[here], source);
                        assert_eq!(chunk.positions[here], primitive.positions[source as usize].to_array());
                    }
                }
            }
        }
    }

    #[test]
    fn pieces_are_compact() {
        let division = divide(&strip(500), 100);
        let length: f32 = division.pieces.iter().map(|p| p.local.1.x - p.local.0.x).sum();
        assert!(length < 900.0, "a strip of 500 m was divided into pieces of {length} m in all");
    }
}
