//! How far a triangle lies open, by direction, and how large it is, in two bytes.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

const LEVELS: f32 = 3.0;
const SIZE_SHIFT: u32 = 12;
/// Sizes are powers of 4: the least one, m².
const LEAST_AREA_M2: f32 = 1.0 / (1 << 22) as f32;
const SIZES: u16 = 16;

/// Which share of short ways from a triangle's front towards +X, −X, +Y, −Y, +Z and −Z meets nothing: two bits each, 0 to 3 thirds, from the
/// lowest up; a prior for how likely a triangle is seen from somewhere in that direction, once the eye is in front of it. In the highest four
/// bits its area, as a power of 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Exposure(pub u16);

impl Exposure {
    /// From shares 0 to 1, for +X, −X, +Y, −Y, +Z, −Z, and an area.
    pub fn new(shares: [f32; 6], area_m2: f32) -> Self {
        let level = |share: f32| (share * LEVELS).round().clamp(0.0, LEVELS) as u16;
        let mut size = 0;
        while size + 1 < SIZES && Self::area_of(size) * 2.0 < area_m2 {
            size += 1;
        }
        Self(shares.iter().rev().fold(size, |bits, share| bits << 2 | level(*share)))
    }

    /// The triangle's area, within a factor of 2 where it is between 10⁻⁷ m² and 500 m².
    #[inline]
    pub fn area_m2(self) -> f32 {
        Self::area_of(self.0 >> SIZE_SHIFT)
    }

    #[inline]
    fn area_of(size: u16) -> f32 {
        LEAST_AREA_M2 * (1u32 << (2 * size)) as f32
    }

    /// The greatest share in any direction, 0 to 1.
    #[inline]
    pub fn most(self) -> f32 {
        f32::from((0..6).map(|k| self.0 >> (2 * k) & 3).fold(0, u16::max)) / LEVELS
    }

    /// The share, 0 to 1, for an eye in the direction `towards`, of any length but 0: the three directions next to it by the squares of its
    /// coordinates, which together are 1 for a unit vector.
    #[inline]
    pub fn towards(self, towards: Vec3) -> f32 {
        ExposureWeights::towards(towards).of(self)
    }
}

/// How much each direction of an [`Exposure`] counts for an eye: made once, asked of many.
#[derive(Clone, Copy, Debug)]
pub struct ExposureWeights {
    weights: [f32; 3],
    shifts: [u32; 3],
}

impl ExposureWeights {
    /// For an eye in the direction `towards`, of any length but 0.
    #[inline]
    pub fn towards(towards: Vec3) -> Self {
        let square = towards * towards;
        let scale = 1.0 / (LEVELS * square.element_sum().max(f32::MIN_POSITIVE));
        let shift = |axis: u32, along: f32| 4 * axis + if along < 0.0 { 2 } else { 0 };
        Self { weights: (square * scale).to_array(), shifts: [shift(0, towards.x), shift(1, towards.y), shift(2, towards.z)] }
    }

    /// The share, 0 to 1.
    #[inline]
    pub fn of(&self, exposure: Exposure) -> f32 {
        let level = |k: usize| f32::from(exposure.0 >> self.shifts[k] & 3) * self.weights[k];
        level(0) + level(1) + level(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_found_where_they_were_put() {
        let exposure = Exposure::new([1.0, 0.0, 0.3, 0.7, 0.0, 1.0], 0.3);
        assert_eq!(exposure.towards(Vec3::X), 1.0);
        assert_eq!(exposure.towards(-Vec3::X * 7.0), 0.0);
        let close = |found: f32, right: f32| assert!((found - right).abs() < 1e-6, "{found}, {right}");
        close(exposure.towards(Vec3::Y), 1.0 / 3.0);
        close(exposure.towards(-Vec3::Y), 2.0 / 3.0);
        close(exposure.towards(Vec3::Z), 0.0);
        close(exposure.towards(-Vec3::Z), 1.0);
        close(exposure.towards(Vec3::new(3.0, 0.0, 4.0)), 9.0 / 25.0);
        close(Exposure::new([1.0; 6], 1.0).towards(Vec3::new(-1.0, 2.0, -5.0)), 1.0);
        assert!(exposure.towards(Vec3::ZERO).is_finite());
        assert_eq!([exposure.most(), Exposure::new([0.0, 0.3, 0.0, 0.7, 0.3, 0.0], 1.0).most()], [1.0, 2.0 / 3.0]);
        for area_m2 in [1.5e-7, 1e-6, 3.3e-4, 0.3, 1.0, 7.0, 450.0] {
            let ratio = Exposure::new([0.0; 6], area_m2).area_m2() / area_m2;
            assert!((0.49..2.01).contains(&ratio), "{area_m2}: {ratio}");
        }
        assert!(Exposure::new([0.0; 6], 0.0).area_m2() > 0.0 && Exposure::new([0.0; 6], 1e9).area_m2() < 1e9);
    }
}
