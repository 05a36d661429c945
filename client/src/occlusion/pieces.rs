//! Boxes around the pieces of a leaf: together they hold less that is not the leaf than the box around all of it, and so they are hidden where
//! that is not (Bartz, Meißner, Hüttner 1999, section 6.1, has that tighter bounds would help).

use glam::{DVec3, Vec3};
use mullion_common::geometry::Aabb;

/// Most pieces of a leaf, and triangles of a piece at least: more boxes cost more than what they save.
const MOST_PIECES: usize = 32;
const LEAST_TRIANGLES: usize = 16;

/// Boxes in the leaf's own space that together hold every triangle, three indices each. Conservative: each triangle is in one of them, whole. None
/// where the leaf is too small to be divided, or an index has no position.
pub fn pieces(positions: &[[f32; 3]], indices: &[u16]) -> Box<[Aabb]> {
    let corner = |index: &u16| positions.get(usize::from(*index)).map(|p| Vec3::from(*p).as_dvec3());
    let count = (indices.len() / 3 / LEAST_TRIANGLES).min(MOST_PIECES);
    let Some(corners) = indices.iter().map(corner).collect::<Option<Vec<DVec3>>>().filter(|_| count > 1) else {
        return Box::default();
    };
    let mut triangles: Vec<Aabb> = corners.as_chunks::<3>().0.iter().map(|triangle| Aabb::of_points(*triangle)).collect();
    let mut found = Vec::with_capacity(count);
    divide(&mut triangles, count, &mut found);
    found.into()
}

/// Halves what is there where its middles lie furthest apart, until there are so many pieces.
fn divide(triangles: &mut [Aabb], count: usize, found: &mut Vec<Aabb>) {
    if count == 1 {
        found.push(triangles.iter().fold(Aabb::EMPTY, |all, triangle| all.union(triangle)));
        return;
    }
    let axis = Aabb::of_points(triangles.iter().map(Aabb::center)).size().max_position();
    let left = count / 2;
    let at = triangles.len() * left / count;
    triangles.select_nth_unstable_by(at, |a, b| a.center()[axis].total_cmp(&b.center()[axis]));
    let (near, far) = triangles.split_at_mut(at);
    divide(near, left, found);
    divide(far, count - left, found);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A band of triangles along a diagonal.
    fn diagonal(count: u16) -> (Vec<[f32; 3]>, Vec<u16>) {
        let corner = |k: u16| [f32::from(k / 2), f32::from(k / 2) + 0.5 * f32::from(k % 2), 0.25 * f32::from(k % 2)];
        ((0..count + 2).map(corner).collect(), (0..count).flat_map(|k| [k, k + 1, k + 2]).collect())
    }

    #[test]
    fn pieces_hold_all_triangles_and_far_less_else() {
        for count in [32, 33, 250, 4096] {
            let (positions, indices) = diagonal(count);
            let found = pieces(&positions, &indices);
            assert_eq!(found.len(), (usize::from(count) / LEAST_TRIANGLES).min(MOST_PIECES));
            for triangle in indices.as_chunks::<3>().0 {
                let corners = triangle.map(|index| Vec3::from(positions[usize::from(index)]).as_dvec3());
                let holds = |piece: &&Aabb| corners.iter().all(|p| p.cmpge(piece.min).all() && p.cmple(piece.max).all());
                assert!(found.iter().any(|piece| holds(&piece)), "{corners:?}");
            }
            let whole = Aabb::of_points(positions.iter().map(|p| Vec3::from(*p).as_dvec3())).half_area();
            let sum: f64 = found.iter().map(Aabb::half_area).sum();
            assert!(sum < 1.5 * whole / found.len() as f64 + 2.0 * f64::from(count), "{sum} of {whole}");
        }
    }

    #[test]
    fn what_is_small_or_broken_has_none() {
        let (positions, indices) = diagonal(31);
        assert!(pieces(&positions, &indices).is_empty());
        assert!(pieces(&positions, &[]).is_empty());
        let (positions, indices) = diagonal(100);
        assert!(pieces(&positions[..50], &indices).is_empty());
        // All in one place: any division is as good.
        assert_eq!(pieces(&[[1.0; 3]], &[0; 300]).len(), 6);
    }
}
