//! Numbers from a seed, the same on every machine: SplitMix64 (Steele, Lea, Flood: "Fast splittable
//! pseudorandom number generators", OOPSLA 2014, figure 17). No libm function is used in this folder for the same reason.

/// A stream of pseudorandom numbers.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Random {
        Random(seed)
    }

    /// Any 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// An independent stream, so that a change in one part of a scene leaves the others alone.
    pub fn fork(&mut self) -> Random {
        Random(self.bits())
    }

    /// 0 up to, not including, 1.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u32 << 24) as f32
    }

    /// `low` up to, not including, `high`.
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// 0 up to, not including, `n`; `n` is small, so the bias of the modulus is too.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() >> 33) as usize % n
    }

    /// True in that share of all calls.
    pub fn chance(&mut self, probability: f32) -> bool {
        self.unit() < probability
    }

    /// One of a list, which must not be empty.
    pub fn pick<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }

    /// A unit quaternion x, y, z, w, all rotations equally likely: a direction in four dimensions (Shoemake, "Uniform
    /// random rotations", Graphics Gems III, 1992), here by rejection, which needs no trigonometry.
    pub fn rotation(&mut self) -> [f32; 4] {
        loop {
            let q = [(); 4].map(|()| self.range(-1.0, 1.0));
            let length_squared: f32 = q.iter().map(|c| c * c).sum();
            if (0.01..=1.0).contains(&length_squared) {
                return q.map(|c| c / length_squared.sqrt());
            }
        }
    }
}
