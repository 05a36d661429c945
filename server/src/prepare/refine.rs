//! Cuts triangles that are larger than a length, so that a floor that spans the scene can be culled in parts.

use std::collections::HashMap;

use glam::Vec3;

use super::gltf::SourcePrimitive;

/// Most triangles that cutting makes of one primitive; past it the rest stays whole.
const MAX_TRIANGLES: usize = 1 << 26;

/// Cuts each edge longer than `limit` (local units, positive) at its middle, until none is longer. Both triangles at
/// an edge are cut at the same vertex: no crack opens.
///
/// Gives, for each triangle of the result, the triangle that it came from; `None` where nothing was cut.
pub(super) fn refine(primitive: &mut SourcePrimitive, limit: f32) -> Option<Vec<u32>> {
    let longest = |p: &SourcePrimitive, t: [u32; 3]| {
        let length = |a: u32, b: u32| p.positions[a as usize].distance(p.positions[b as usize]);
        let lengths = [length(t[0], t[1]), length(t[1], t[2]), length(t[2], t[0])];
        let k = (0..3).max_by(|&a, &b| lengths[a].total_cmp(&lengths[b])).unwrap_or(0);
        (lengths[k] > limit).then_some(k)
    };
    let whole: Vec<[u32; 3]> = primitive.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    if whole.iter().all(|t| longest(primitive, *t).is_none()) {
        return None;
    }
    let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
    let (mut indices, mut from) = (Vec::new(), Vec::new());
    for (source, triangle) in whole.into_iter().enumerate() {
        let mut open = vec![triangle];
        while let Some(t) = open.pop() {
            match longest(primitive, t) {
                Some(k) if indices.len() / 3 + open.len() < MAX_TRIANGLES => {
                    let (a, b, c) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
                    let middle = *middles.entry((a.min(b), a.max(b))).or_insert_with(|| add_middle(primitive, a, b));
                    open.push([middle, b, c]);
                    open.push([a, middle, c]);
                }
                _ => {
                    indices.extend(t);
                    from.push(source as u32);
                }
            }
        }
    }
    primitive.indices = indices;
    Some(from)
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

    #[test]
    fn a_floor_is_cut_without_cracks() {
        let corners = [Vec3::ZERO, Vec3::new(10.0, 0.0, 0.0), Vec3::new(10.0, 0.0, 7.0), Vec3::new(0.0, 0.0, 7.0)];
        let mut floor = SourcePrimitive {
            gltf_primitive: 0,
            positions: corners.to_vec(),
            normals: None,
            uvs: None,
            colors: None,
            indices: vec![0, 2, 1, 0, 3, 2],
            material: None,
        };
        let from = refine(&mut floor, 1.0).expect("it is larger than a metre");
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
        assert_eq!(refine(&mut floor, 1.0), None);
    }
}
