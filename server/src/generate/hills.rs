//! Hills behind hills: a square of land with a border, 512 by 512 cells, for views along the ground.
use super::noise::Noise;
use super::streamed::StreamedMesh;
use glam::{Vec3, vec3};

/// Cells along a side.
const SIDE: u32 = 512;
/// A cell's side, metres.
const CELL_M: f32 = 4.0;
/// Highest hill above the deepest valley, metres, nearly.
const RELIEF_M: f32 = 260.0;

pub(super) struct Hills {
    ridges: Noise,
    rough: Noise,
}

impl Hills {
    pub fn new(seed: u64) -> Self {
        let rough = Noise { seed: seed ^ 0x2545_F491, frequency: 1.0 / 60.0, octaves: 4 };
        Self { ridges: Noise { seed, frequency: 1.0 / 420.0, octaves: 3 }, rough }
    }
}

impl StreamedMesh for Hills {
    fn name(&self) -> &'static str {
        "hills"
    }

    fn vertices(&self) -> u32 {
        (SIDE + 1) * (SIDE + 1)
    }

    fn triangles(&self) -> u32 {
        2 * SIDE * SIDE
    }

    fn position(&self, vertex: u32) -> Vec3 {
        let (x, z) = (vertex % (SIDE + 1), vertex / (SIDE + 1));
        let half_m = SIDE as f32 * CELL_M / 2.0;
        let flat = vec3(x as f32 * CELL_M - half_m, 0.0, z as f32 * CELL_M - half_m);
        let height = 0.85 * self.ridges.at(flat) + 0.15 * self.rough.ridges(flat);
        flat + Vec3::Y * (height * RELIEF_M * 0.5)
    }

    fn triangle(&self, triangle: u32) -> [u32; 3] {
        let (cell, is_second) = (triangle / 2, triangle % 2 == 1);
        let corner = cell / SIDE * (SIDE + 1) + cell % SIDE;
        let [a, b, c, d] = [corner, corner + SIDE + 1, corner + SIDE + 2, corner + 1];
        if is_second { [a, c, d] } else { [a, b, c] }
    }

    fn color(&self) -> [f32; 3] {
        [0.22, 0.34, 0.12]
    }
}
