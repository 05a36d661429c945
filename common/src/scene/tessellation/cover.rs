//! What a cell's triangles cover of the faces by which one looks out of it.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

const STEPS: f32 = 15.0;

/// Of the lines along an axis that leave a cell by one of its faces, the share that meets a front in the cell, in fifteenths: four bits for
/// each of +X, −X, +Y, −Y, +Z and −Z, and each face, from the lowest up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Cover(pub [u8; 12]);

impl Cover {
    /// From shares 0 to 1: by direction, then by face.
    pub fn new(shares: [[f32; 4]; 6]) -> Self {
        let mut bytes = [0; 12];
        for (at, share) in shares.as_flattened().iter().enumerate() {
            let steps = (share * STEPS).round().clamp(0.0, STEPS) as u8;
            bytes[at / 2] |= steps << (at % 2 * 4);
        }
        Self(bytes)
    }

    /// The share, 0 to 1, that is covered of a face, looking along `view`. `out` is the face's normal, out of the cell; both of any length. The
    /// directions next to the view count as they count for how large the face appears. 0 for a face that is not looked out of.
    #[inline]
    pub fn of_face(&self, face: usize, out: Vec3, view: Vec3) -> f32 {
        let (mut sum, mut all) = (0.0, 0.0);
        for axis in 0..3 {
            let weight = (out[axis] * view[axis]).max(0.0);
            let at = (2 * axis + usize::from(view[axis] < 0.0)) * 4 + face;
            sum += weight * f32::from(self.0[at / 2] >> (at % 2 * 4) & 15);
            all += weight;
        }
        if all > 0.0 { sum / (all * STEPS) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_found_where_they_were_put() {
        let shares: [[f32; 4]; 6] =
            std::array::from_fn(|direction| std::array::from_fn(|face| ((direction * 4 + face) % 16) as f32 / STEPS));
        let cover = Cover::new(shares);
        for (k, share) in shares.as_flattened().iter().enumerate() {
            let (direction, face) = (k / 4, k % 4);
            let mut view = Vec3::ZERO;
            view[direction / 2] = if direction % 2 == 0 { 3.0 } else { -3.0 };
            let out = view + Vec3::ONE * 0.1;
            assert!((cover.of_face(face, out, view) - share).abs() < 1e-6);
            assert_eq!(cover.of_face(face, -view, view), 0.0);
        }
        let even = cover.of_face(2, Vec3::new(1.0, 2.0, 0.0), Vec3::new(2.0, 1.0, -5.0));
        assert!((even - (shares[0][2] + shares[2][2]) / 2.0).abs() < 1e-6);
    }
}
