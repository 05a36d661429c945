//! The triangles that a tessellation covers, in the world.

use glam::{DVec3, Vec3};
use mullion_common::geometry::Aabb;
use mullion_common::scene::{AlphaMode, ChunkId, Facing, GeometryChunk, MAX_COVERED_TRIANGLES, Package};
use rayon::prelude::*;

/// A leaf in the world.
pub(super) struct WorldLeaf {
    /// Its number.
    pub leaf: u32,
    /// Metres from [`WorldLeaves::origin`], counterclockwise from the front.
    pub triangles: Vec<[Vec3; 3]>,
    pub surface: Surface,
}

/// What a leaf hides, and from where it is seen.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Surface {
    pub double_sided: bool,
    /// Nothing shines through.
    pub opaque: bool,
}

/// The leaves that a tessellation covers: all but those of blended materials and those whose coordinates are not finite.
pub(super) struct WorldLeaves {
    /// The middle of the scene's box.
    pub origin: DVec3,
    /// Half its sides, metres.
    pub half_m: Vec3,
    /// Its longest side, metres; above 0.
    pub longest_m: f32,
    /// In the order of leaves, each with a triangle at least.
    pub leaves: Vec<WorldLeaf>,
}

impl WorldLeaves {
    pub fn of(package: &Package) -> Self {
        let manifest = &package.scene.manifest;
        let boxes: Vec<Option<Aabb>> = manifest
            .leaves
            .par_iter()
            .map(|leaf| {
                let world_from_local = manifest.transforms[leaf.object.0 as usize].affine();
                let aabb = leaf.local_aabb().transformed(&world_from_local);
                let is_covered = manifest.materials[leaf.material.0 as usize].alpha != AlphaMode::Blend
                    && (1..=MAX_COVERED_TRIANGLES).contains(&leaf.triangle_count)
                    && aabb.min.is_finite()
                    && aabb.max.is_finite();
                is_covered.then_some(aabb)
            })
            .collect();
        let all = boxes.iter().flatten().fold(Aabb::EMPTY, |all, b| all.union(b));
        let origin = if all.is_empty() { DVec3::ZERO } else { all.center() };
        let mut leaves: Vec<WorldLeaf> = boxes
            .par_iter()
            .enumerate()
            .filter(|(_, aabb)| aabb.is_some())
            .filter_map(|(leaf, _)| world_leaf(package, leaf as u32, origin))
            .collect();
        leaves.shrink_to_fit();
        let corners = leaves.iter().flat_map(|leaf| leaf.triangles.as_flattened());
        let half_m = corners.fold(Vec3::ZERO, |half, p| half.max(p.abs()));
        // What has no extent gets some: far from the origin, as much as coordinates there tell apart.
        let least_m = (origin.abs().max_element() * 1e-9).max(1e-6) as f32;
        Self { origin, half_m, longest_m: (half_m.max_element() * 2.0).max(least_m), leaves }
    }
}

fn world_leaf(package: &Package, number: u32, origin: DVec3) -> Option<WorldLeaf> {
    let manifest = &package.scene.manifest;
    let leaf = &manifest.leaves[number as usize];
    let material = &manifest.materials[leaf.material.0 as usize];
    let chunk = GeometryChunk::decode(package.chunk(leaf.chunk)).ok()?;
    let world_from_local = manifest.transforms[leaf.object.0 as usize].affine();
    let place = |p: &[f32; 3]| (world_from_local.transform_point3(Vec3::from(*p).as_dvec3()) - origin).as_vec3();
    let positions: Vec<Vec3> = chunk.positions.iter().map(place).collect();
    let is_whole = chunk.indices.len() == 3 * leaf.triangle_count as usize && positions.iter().all(|p| p.is_finite());
    let mirrored = manifest.transforms[leaf.object.0 as usize].is_mirrored();
    is_whole.then(|| WorldLeaf {
        leaf: number,
        triangles: chunk
            .indices
            .chunks_exact(3)
            .map(|t| {
                let [a, b, c] = [t[0], t[1], t[2]].map(|k| positions[k as usize]);
                if mirrored { [a, c, b] } else { [a, b, c] }
            })
            .collect(),
        surface: Surface { double_sided: material.double_sided, opaque: material.alpha == AlphaMode::Opaque },
    })
}

/// Which way the triangles of all covered chunks face, by [`ChunkId`]; double-sided ones are not asked.
pub(super) fn facings(package: &Package, world: &WorldLeaves) -> Vec<Facing> {
    let manifest = &package.scene.manifest;
    let mut chunks: Vec<(ChunkId, u32)> =
        world.leaves.iter().map(|leaf| (manifest.leaves[leaf.leaf as usize].chunk, leaf.leaf)).collect();
    chunks.sort_unstable();
    chunks.dedup_by_key(|(chunk, _)| *chunk);
    let of_chunks: Vec<Vec<Facing>> = chunks
        .into_par_iter()
        .map(|(chunk, leaf)| {
            let (middle, radius) = manifest.leaves[leaf as usize].middle_and_radius();
            let Ok(chunk) = GeometryChunk::decode(package.chunk(chunk)) else { return Vec::new() };
            let corner = |k: u16| Vec3::from(chunk.positions[k as usize]);
            let facing = |t: &[u16]| Facing::new([corner(t[0]), corner(t[1]), corner(t[2])], middle, radius);
            chunk.indices.chunks_exact(3).map(facing).collect()
        })
        .collect();
    of_chunks.concat()
}
