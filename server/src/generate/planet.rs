//! The rough planet of Birkholz and Rahn (*Adaptive Level of Detail with Occlusion Culling*, Table 1): a sphere of 16 777 218 vertices and
//! 33 554 432 triangles, displaced so that mountains hide each other and hardly any part of the surface faces one way.
//!
//! An octahedron whose edges are divided, row by row from pole to pole: row i below the pole has 4 i vertices.
use super::GenerateError;
use super::noise::Noise;
use super::streamed::StreamedMesh;
use glam::Vec3;

/// Most vertices: a GLB of twice as many is just below 4 GiB.
pub const MAX_PLANET_VERTICES: u32 = 1 << 26;
/// Without mountains, metres.
const RADIUS_M: f32 = 100.0;
/// Highest mountain above the lowest valley, as a share of the radius.
const RELIEF: f32 = 0.5;

/// How finely a planet is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Planet {
    /// Parts of an octahedron's edge.
    side: u32,
}

impl Planet {
    /// As large as the paper's.
    pub const DEFAULT: Planet = Planet { side: 2048 };

    /// The planet whose number of vertices, 4 n² + 2, is closest to that.
    ///
    /// # Errors
    /// If `vertices` is not 6 to [`MAX_PLANET_VERTICES`].
    pub fn new(vertices: u64) -> Result<Planet, GenerateError> {
        if !(6..=u64::from(MAX_PLANET_VERTICES)).contains(&vertices) {
            return Err(GenerateError::Vertices { vertices });
        }
        Ok(Planet { side: (((vertices - 2) as f64 / 4.0).sqrt().round() as u32).max(1) })
    }

    /// Number of vertices.
    pub fn vertices(self) -> u32 {
        4 * self.side * self.side + 2
    }
}

/// A planet with its mountains.
pub(super) struct Relief {
    planet: Planet,
    ridges: Noise,
    rough: Noise,
}

impl Relief {
    pub fn new(planet: Planet, seed: u64) -> Self {
        // Down to about two vertices a wave.
        let octaves = planet.side.max(2).ilog2().max(2) - 1;
        let ridges = Noise { seed, frequency: 1.7, octaves: octaves.min(6) };
        Self { planet, ridges, rough: Noise { seed: seed ^ 0x5851_F42D, frequency: 3.1, octaves } }
    }

    /// The first vertex of a row below the north pole, which is row 0.
    fn row_start(&self, row: u32) -> u32 {
        let n = self.planet.side;
        if row == 0 {
            0
        } else if row <= n {
            1 + 2 * row * (row - 1)
        } else {
            // As many from here to the south pole as from the north pole to the row as far away from it.
            self.planet.vertices() - (1 + 2 * (2 * n - row) * (2 * n - row + 1))
        }
    }

    /// Vertices of a quarter of a row.
    fn quarter(&self, row: u32) -> u32 {
        row.min(2 * self.planet.side - row)
    }

    fn row_of(&self, vertex: u32) -> u32 {
        let (mut low, mut high) = (0, 2 * self.planet.side);
        while low < high {
            let middle = (low + high).div_ceil(2);
            if self.row_start(middle) <= vertex { low = middle } else { high = middle - 1 }
        }
        low
    }

    /// A vertex by its row, and its place from a quarter's beginning on.
    fn vertex(&self, row: u32, quarter: u32, place: u32) -> u32 {
        let count = self.quarter(row);
        if count == 0 { self.row_start(row) } else { self.row_start(row) + (quarter * count + place) % (4 * count) }
    }

    /// Triangles between the north pole and a row no further down than the equator.
    fn triangles_above(row: u32) -> u32 {
        4 * row * row
    }
}

impl StreamedMesh for Relief {
    fn name(&self) -> &'static str {
        "planet"
    }

    fn vertices(&self) -> u32 {
        self.planet.vertices()
    }

    fn triangles(&self) -> u32 {
        8 * self.planet.side * self.planet.side
    }

    fn position(&self, vertex: u32) -> Vec3 {
        const AROUND: [Vec3; 4] = [Vec3::X, Vec3::NEG_Z, Vec3::NEG_X, Vec3::Z];
        let row = self.row_of(vertex);
        let count = self.quarter(row);
        let n = self.planet.side as f32;
        let up = Vec3::Y * (1.0 - row as f32 / n);
        let in_row = vertex - self.row_start(row);
        let flat = match in_row.checked_div(count) {
            Some(quarter) => {
                let (from, to, place) = (AROUND[quarter as usize], AROUND[(quarter as usize + 1) % 4], in_row % count);
                (from * (count - place) as f32 + to * place as f32) / n
            }
            None => Vec3::ZERO,
        };
        let direction = (up + flat).normalize();
        let height = 0.6 * self.ridges.ridges(direction) + 0.4 * self.rough.at(direction);
        direction * (RADIUS_M * (1.0 + RELIEF * 0.5 * height))
    }

    fn triangle(&self, triangle: u32) -> [u32; 3] {
        // The southern half is the northern one upside down.
        let half = self.triangles() / 2;
        let (is_south, number) = (triangle >= half, triangle % half);
        let above = f64::from(number / 4).sqrt() as u32;
        let row = (above.saturating_sub(1)..=above + 1).rev().find(|row| Self::triangles_above(*row) <= number).unwrap_or(0);
        let in_row = number - Self::triangles_above(row);
        let (quarter, place) = (in_row / (2 * row + 1), in_row % (2 * row + 1));
        let upper = |place: u32| (row, place);
        let lower = |place: u32| (row + 1, place);
        let corners = if place <= row {
            [upper(place), lower(place), lower(place + 1)]
        } else {
            let place = place - row - 1;
            [upper(place), lower(place + 1), upper(place + 1)]
        };
        let [a, b, c] = corners.map(|(row, place)| {
            let row = if is_south { 2 * self.planet.side - row } else { row };
            self.vertex(row, quarter, place)
        });
        if is_south { [a, c, b] } else { [a, b, c] }
    }

    fn color(&self) -> [f32; 3] {
        [0.42, 0.33, 0.26]
    }
}
