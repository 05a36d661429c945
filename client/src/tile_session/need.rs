//! Which chunks a frame lacks, the ones needed first in front.

use glam::DVec3;
use mullion_common::scene::{ChunkId, SceneManifest, Transform};
use mullion_common::visible_set::VisibleSet;

/// The chunks that the leaves of `sets` need and that are not `held`, without repetition: leaves by their distance
/// from the eye that all views share, each leaf's geometry and then its texture. All leaves must be in the manifest.
/// `transforms` are the objects' newest; `eye` is in world space, metres.
pub fn missing_in_order_of_need<'a>(
    manifest: &SceneManifest,
    transforms: &[Transform],
    sets: impl Iterator<Item = &'a VisibleSet>,
    eye: DVec3,
    held: impl Fn(ChunkId) -> bool,
    missing: &mut Vec<ChunkId>,
) {
    let mut seen = vec![false; manifest.chunks.len()];
    let mut wanted: Vec<(f64, u32)> = Vec::new();
    for leaf in sets.flat_map(VisibleSet::leaves) {
        let record = &manifest.leaves[leaf as usize];
        let texture = manifest.materials[record.material.0 as usize].texture.map(|t| t.chunk);
        let lacks = |id: ChunkId| !held(id) && !seen[id.0 as usize];
        if !lacks(record.chunk) && !texture.is_some_and(lacks) {
            continue;
        }
        let bounds = record.local_aabb();
        let center = transforms[record.object.0 as usize].affine().transform_point3((bounds.min + bounds.max) * 0.5);
        wanted.push((center.distance_squared(eye), leaf));
    }
    wanted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    missing.clear();
    for (_, leaf) in wanted {
        let record = &manifest.leaves[leaf as usize];
        let texture = manifest.materials[record.material.0 as usize].texture.map(|t| t.chunk);
        for id in [Some(record.chunk), texture].into_iter().flatten() {
            if !held(id) && !std::mem::replace(&mut seen[id.0 as usize], true) {
                missing.push(id);
            }
        }
    }
}
