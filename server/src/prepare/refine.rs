//! Cuts triangles that are larger than a length, so that a floor that spans the scene can be culled in parts.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::Vec3;

use super::gltf::SourcePrimitive;

/// Most triangles that cutting adds to a scene: each takes about a hundred bytes while its mesh is divided.
pub(super) const MAX_ADDED_TRIANGLES: u64 = 1 << 24;

/// Cutting would add more triangles than it may. The primitive is then as it was but for vertices that nothing uses.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct TooManyAdded;

/// Cuts each edge longer than `limit` (local units, positive) at its middle, until none is longer. Both triangles at
/// an edge are cut at the same vertex: no crack opens. `left` is how many triangles may still be added, to this
/// primitive and to all that share it.
///
/// Gives, for each triangle of the result, the triangle that it came from; `None` where nothing was cut.
///
/// # Errors
/// When `left` is spent before every edge is short enough: stopping halfway would open cracks.
pub(super) fn refine(primitive: &mut SourcePrimitive, limit: f32, left: &AtomicU64) -> Result<Option<Vec<u32>>, TooManyAdded> {
    let longest = |p: &SourcePrimitive, t: [u32; 3]| {
        let length = |a: u32, b: u32| p.positions[a as usize].distance(p.positions[b as usize]);
        let lengths = [length(t[0], t[1]), length(t[1], t[2]), length(t[2], t[0])];
        let k = (0..3).max_by(|&a, &b| lengths[a].total_cmp(&lengths[b])).unwrap_or(0);
        (lengths[k] > limit).then_some(k)
    };
    let whole: Vec<[u32; 3]> = primitive.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    if whole.iter().all(|t| longest(primitive, *t).is_none()) {
        return Ok(None);
    }
    if least_added(primitive, &whole, limit) > left.load(Ordering::Relaxed) as f64 {
        return Err(TooManyAdded);
    }
    let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
    let (mut indices, mut from) = (Vec::new(), Vec::new());
    for (source, triangle) in whole.into_iter().enumerate() {
        let mut open = vec![triangle];
        while let Some(t) = open.pop() {
            match longest(primitive, t) {
                Some(k) => {
                    let taken = left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
                    taken.map_err(|_| TooManyAdded)?;
                    let (a, b, c) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
                    let middle = *middles.entry((a.min(b), a.max(b))).or_insert_with(|| add_middle(primitive, a, b));
                    open.push([middle, b, c]);
                    open.push([a, middle, c]);
                }
                None => {
                    indices.extend(t);
                    from.push(source as u32);
                }
            }
        }
    }
    primitive.indices = indices;
    Ok(Some(from))
}

/// No more than cutting will add, found without doing it: no piece is larger than the equilateral triangle of side `limit`.
fn least_added(p: &SourcePrimitive, whole: &[[u32; 3]], limit: f32) -> f64 {
    let largest_piece = 3f64.sqrt() / 4.0 * f64::from(limit).powi(2);
    let pieces = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|corner| p.positions[corner as usize].as_dvec3());
        (b - a).cross(c - a).length() * 0.5 / largest_piece
    };
    // The factor leaves room for pieces that rounding makes larger than they should be.
    whole.iter().map(|t| (pieces(t) * 0.9 - 1.0).max(0.0)).sum()
}

fn add_middle(p: &mut SourcePrimitive, a: u32, b: u32) -> u32 {
    let (a, b) = (a.min(b) as usize, a.max(b) as usize);
    let id = p.positions.len() as u32;
    p.positions.push((p.positions[a] + p.positions[b]) * 0.5);
    if let Some(normals) = &mut p.normals {
        normals.push((normals[a] + normals[b]).normalize_or(Vec3::Y));
    }
    if let Some(uvs) = &mut p.uvs {
        uvs.push((uvs[a] + uvs[b]) * 0.5);
    }
    if let Some(colors) = &mut p.colors {
        colors.push(std::array::from_fn(|k| u8::midpoint(colors[a][k], colors[b][k])));
    }
    id
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles, 10 by 7 m.
    fn floor() -> SourcePrimitive {
        let corners = [Vec3::ZERO, Vec3::new(10.0, 0.0, 0.0), Vec3::new(10.0, 0.0, 7.0), Vec3::new(0.0, 0.0, 7.0)];
        SourcePrimitive {
            gltf_primitive: 0,
            positions: corners.to_vec(),
            normals: None,
            uvs: None,
            colors: None,
            indices: vec![0, 2, 1, 0, 3, 2],
            material: None,
        }
    }

    #[test]
    fn what_may_be_added_is_shared_and_not_exceeded() {
        let left = AtomicU64::new(MAX_ADDED_TRIANGLES);
        let needed = refine(&mut floor(), 1.0, &left).unwrap().expect("it is larger than a metre").len() as u64 - 2;
        assert_eq!(left.load(Ordering::Relaxed), MAX_ADDED_TRIANGLES - needed);
        let twice_but_one = AtomicU64::new(2 * needed - 1);
        assert!(refine(&mut floor(), 1.0, &twice_but_one).is_ok());
        let mut second = floor();
        assert_eq!(refine(&mut second, 1.0, &twice_but_one), Err(TooManyAdded));
        assert_eq!(second.indices, floor().indices);
        // No length is short enough: it ends all the same.
        assert_eq!(refine(&mut floor(), 0.0, &AtomicU64::new(10_000)), Err(TooManyAdded));
    }

    #[test]
    fn a_floor_is_cut_without_cracks() {
        let mut floor = floor();
        let left = AtomicU64::new(MAX_ADDED_TRIANGLES);
        let from = refine(&mut floor, 1.0, &left).unwrap().expect("it is larger than a metre");
        assert_eq!(from.len(), floor.indices.len() / 3);
        let mut area = 0.0;
        let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
        for t in floor.indices.chunks_exact(3) {
            let p = |k: usize| floor.positions[t[k] as usize];
            area += (p(1) - p(0)).cross(p(2) - p(0)).y * 0.5;
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                assert!(p(k).distance(p((k + 1) % 3)) <= 1.0);
                *edges.entry((a.min(b), a.max(b))).or_default() += 1;
            }
        }
        assert!((area - 70.0).abs() < 1e-3, "{area}");
        // Inside the floor every edge has two triangles: a T-junction would leave edges with one.
        for ((a, b), count) in edges {
            let (a, b) = (floor.positions[a as usize], floor.positions[b as usize]);
            let border =
                [(a.x, b.x, 0.0), (a.x, b.x, 10.0), (a.z, b.z, 0.0), (a.z, b.z, 7.0)].iter().any(|(p, q, at)| p == at && q == at);
            assert_eq!(count, if border { 1 } else { 2 }, "{a} {b}");
        }
        assert_eq!(refine(&mut floor, 1.0, &left), Ok(None));
    }
}
