//! Smooth noise in space, the same on every machine: sums and products alone.
use glam::{IVec3, Vec3};

/// Sums of noise of doubled frequency and halved height: as rough near as far.
#[derive(Clone, Copy)]
pub struct Noise {
    pub seed: u64,
    /// Waves to a metre of the first one.
    pub frequency: f32,
    pub octaves: u32,
}

impl Noise {
    /// About −1 to 1.
    pub fn at(&self, p: Vec3) -> f32 {
        let (mut sum, mut height, mut frequency) = (0.0, 0.5, self.frequency);
        for octave in 0..u64::from(self.octaves) {
            sum += height * wave(self.seed.wrapping_add(octave.wrapping_mul(0x9E37_79B9_7F4A_7C15)), p * frequency);
            height *= 0.5;
            frequency *= 2.0;
        }
        sum
    }

    /// The same with creases where it would go through 0: ridges, −1 to 1.
    pub fn ridges(&self, p: Vec3) -> f32 {
        let (mut sum, mut height, mut frequency) = (0.0, 0.5, self.frequency);
        for octave in 0..u64::from(self.octaves) {
            let value = wave(self.seed.wrapping_add(octave.wrapping_mul(0x9E37_79B9_7F4A_7C15)), p * frequency);
            sum += height * (1.0 - 2.0 * value.abs());
            height *= 0.5;
            frequency *= 2.0;
        }
        sum
    }
}

/// −1 to 1: random at whole numbers, smooth between them.
fn wave(seed: u64, p: Vec3) -> f32 {
    let low = p.floor();
    let cell = low.as_ivec3();
    let t = p - low;
    let s = t * t * (3.0 - 2.0 * t);
    let corner = |x: i32, y: i32, z: i32| random(seed, cell + IVec3::new(x, y, z));
    let along_x = |y: i32, z: i32| {
        let (a, b) = (corner(0, y, z), corner(1, y, z));
        a + (b - a) * s.x
    };
    let along_y = |z: i32| {
        let (a, b) = (along_x(0, z), along_x(1, z));
        a + (b - a) * s.y
    };
    let (a, b) = (along_y(0), along_y(1));
    a + (b - a) * s.z
}

fn random(seed: u64, at: IVec3) -> f32 {
    let [x, y, z] = at.to_array().map(|c| u64::from(c as u32));
    let mut bits = seed ^ x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F).rotate_left(21);
    bits = (bits ^ z.wrapping_mul(0x1656_67B1_9E37_79F9).rotate_left(42)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ bits >> 29).wrapping_mul(0x94D0_49BB_1331_11EB);
    (bits >> 40) as f32 / (1u32 << 23) as f32 - 1.0
}
