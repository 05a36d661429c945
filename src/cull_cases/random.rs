//! Numbers from a seed in the ranges that cases need.

use glam::{DQuat, DVec3};
use mullion_server::generate;

/// A stream of pseudorandom numbers.
#[derive(Clone, Debug)]
pub struct Random(generate::Random);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(generate::Random::new(seed))
    }

    pub fn next(&mut self) -> u64 {
        self.0.bits()
    }

    /// Uniform in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In `low..=high`, small numbers as often as large ones.
    pub fn magnitude(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// A count in `low..=high`, small ones as often as large ones.
    pub fn count(&mut self, low: u32, high: u32) -> u32 {
        (self.magnitude(f64::from(low), f64::from(high) + 1.0) as u32).clamp(low, high)
    }

    pub fn pick<T: Copy>(&mut self, list: &[T]) -> T {
        list[(self.next() % list.len() as u64) as usize]
    }

    pub fn chance(&mut self, one_in: u64) -> bool {
        self.next().is_multiple_of(one_in)
    }

    /// In a cube about the origin, each coordinate within `reach` of zero.
    pub fn point(&mut self, reach: f64) -> DVec3 {
        DVec3::new(self.between(-reach, reach), self.between(-reach, reach), self.between(-reach, reach))
    }

    pub fn turn(&mut self) -> DQuat {
        DQuat::from_scaled_axis(self.point(3.2))
    }
}
