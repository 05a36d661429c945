//! Boxes, prisms and quads, counterclockwise from outside, metres, Y up.
use glam::{Vec2, Vec3, vec3};

/// Linear RGBA, 8 bits a channel, as `COLOR_0` holds it.
pub type Color = [u8; 4];

/// Linear from an sRGB triple as people write it. Gamma 2 instead of sRGB's curve: exact everywhere.
pub const fn srgb(r: u8, g: u8, b: u8) -> Color {
    const fn linear(c: u8) -> u8 {
        ((c as u32 * c as u32 + 127) / 255) as u8
    }
    [linear(r), linear(g), linear(b), 255]
}

/// What a solid is covered with: colours or texture coordinates, one kind for a whole [`Geometry`].
#[derive(Debug, Clone, Default)]
pub struct Geometry {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub colors: Vec<Color>,
    pub indices: Vec<u32>,
}

impl Geometry {
    pub fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    fn fan(&mut self, corners: &[Vec3]) {
        let first = self.positions.len() as u32;
        self.positions.extend_from_slice(corners);
        for k in 1..corners.len() as u32 - 1 {
            self.indices.extend([first, first + k, first + k + 1]);
        }
    }

    /// A convex polygon of one colour.
    pub fn polygon(&mut self, corners: &[Vec3], color: Color) {
        self.fan(corners);
        self.colors.extend(corners.iter().map(|_| color));
    }

    /// A quad with texture coordinates from `low` (first corner) to `high` (third corner).
    pub fn textured(&mut self, corners: [Vec3; 4], low: Vec2, high: Vec2) {
        self.fan(&corners);
        self.uvs.extend([low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)]);
    }

    /// A box from `low` to `high`: 12 triangles.
    pub fn cuboid(&mut self, low: Vec3, high: Vec3, color: Color) {
        for corners in faces(low, high) {
            self.polygon(&corners, color);
        }
    }

    /// A box by the middle of its base and its size.
    pub fn block(&mut self, base: Vec3, size: Vec3, color: Color) {
        let half = vec3(size.x / 2.0, 0.0, size.z / 2.0);
        self.cuboid(base - half, base + half + vec3(0.0, size.y, 0.0), color);
    }

    /// A box without its bottom, textured on top with `repeat_m` metres to a repeat: 10 triangles.
    pub fn paving(&mut self, low: Vec3, high: Vec3, repeat_m: f32) {
        for (k, corners) in faces(low, high).into_iter().enumerate().filter(|(k, _)| *k != BOTTOM) {
            let size = if k == TOP {
                Vec2::new(high.x - low.x, high.z - low.z)
            } else {
                Vec2::new((corners[1] - corners[0]).length(), high.y - low.y)
            };
            self.textured(corners, Vec2::ZERO, size / repeat_m);
        }
    }

    /// A prism or, where `top_radius` is 0, a pyramid on `sides` (see [`ring`]) around the vertical through `base`.
    pub fn prism(&mut self, base: Vec3, radius: f32, top_radius: f32, height: f32, sides: usize, color: Color) {
        let ring = ring(sides);
        let at = |k: usize, radius: f32, y: f32| base + vec3(ring[k % sides].x * radius, y, -ring[k % sides].y * radius);
        for k in 0..sides {
            let (a, b) = (at(k, radius, 0.0), at(k + 1, radius, 0.0));
            if top_radius == 0.0 {
                self.polygon(&[a, b, base + vec3(0.0, height, 0.0)], color);
            } else {
                self.polygon(&[a, b, at(k + 1, top_radius, height), at(k, top_radius, height)], color);
            }
        }
        let floor: Vec<_> = (0..sides).rev().map(|k| at(k, radius, 0.0)).collect();
        self.polygon(&floor, color);
        if top_radius != 0.0 {
            let roof: Vec<_> = (0..sides).map(|k| at(k, top_radius, height)).collect();
            self.polygon(&roof, color);
        }
    }

    /// A ball of 80 triangles (an icosahedron divided once) with smooth normals.
    pub fn ball(&mut self, center: Vec3, radius: Vec3, color: Color) {
        for [a, b, c] in icosahedron() {
            let (ab, bc, ca) = ((a + b).normalize(), (b + c).normalize(), (c + a).normalize());
            for corners in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
                self.polygon(&corners.map(|corner| center + corner * radius), color);
                self.normals.extend(corners.map(|corner| (corner / radius).normalize()));
            }
        }
    }
}

const TOP: usize = 4;
const BOTTOM: usize = 5;

fn faces(l: Vec3, h: Vec3) -> [[Vec3; 4]; 6] {
    let (x0, y0, z0, x1, y1, z1) = (l.x, l.y, l.z, h.x, h.y, h.z);
    [
        [vec3(x1, y0, z1), vec3(x1, y0, z0), vec3(x1, y1, z0), vec3(x1, y1, z1)],
        [vec3(x0, y0, z0), vec3(x0, y0, z1), vec3(x0, y1, z1), vec3(x0, y1, z0)],
        [vec3(x0, y0, z1), vec3(x1, y0, z1), vec3(x1, y1, z1), vec3(x0, y1, z1)],
        [vec3(x1, y0, z0), vec3(x0, y0, z0), vec3(x0, y1, z0), vec3(x1, y1, z0)],
        [vec3(x0, y1, z1), vec3(x1, y1, z1), vec3(x1, y1, z0), vec3(x0, y1, z0)],
        [vec3(x0, y0, z0), vec3(x1, y0, z0), vec3(x1, y0, z1), vec3(x0, y0, z1)],
    ]
}

/// The outward walls of a box, without floor and ceiling: +X, −X, +Z, −Z.
pub fn walls(low: Vec3, high: Vec3) -> [[Vec3; 4]; 4] {
    let [a, b, c, d, ..] = faces(low, high);
    [a, b, c, d]
}

/// Corners of a regular polygon of 4 or 6 sides, doubled any number of times. From square roots only, which IEEE 754
/// rounds exactly.
pub fn ring(sides: usize) -> Vec<Vec2> {
    let (half, s3) = (0.5, 0.75f32.sqrt());
    let mut corners: Vec<Vec2> = match sides % 3 {
        0 => [(1.0, 0.0), (half, s3), (-half, s3), (-1.0, 0.0), (-half, -s3), (half, -s3)].map(Vec2::from).to_vec(),
        _ => [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)].map(Vec2::from).to_vec(),
    };
    while corners.len() < sides {
        let next = |k: usize| corners[(k + 1) % corners.len()];
        corners = (0..corners.len()).flat_map(|k| [corners[k], (corners[k] + next(k)).normalize()]).collect();
    }
    assert_eq!(corners.len(), sides, "4 or 6, doubled");
    corners
}

fn icosahedron() -> Vec<[Vec3; 3]> {
    let g = (1.0 + 5f32.sqrt()) / 2.0;
    let corner = [
        vec3(-1.0, g, 0.0),
        vec3(1.0, g, 0.0),
        vec3(-1.0, -g, 0.0),
        vec3(1.0, -g, 0.0),
        vec3(0.0, -1.0, g),
        vec3(0.0, 1.0, g),
        vec3(0.0, -1.0, -g),
        vec3(0.0, 1.0, -g),
        vec3(g, 0.0, -1.0),
        vec3(g, 0.0, 1.0),
        vec3(-g, 0.0, -1.0),
        vec3(-g, 0.0, 1.0),
    ];
    const FACES: [[usize; 3]; 20] = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    FACES.iter().map(|face| face.map(|k| corner[k].normalize())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The signed volume of a closed surface is positive where its triangles face outwards.
    fn volume(geometry: &Geometry) -> f32 {
        let p = |k: u32| geometry.positions[k as usize];
        geometry.indices.chunks_exact(3).map(|t| p(t[0]).dot(p(t[1]).cross(p(t[2]))) / 6.0).sum()
    }

    #[test]
    fn solids_face_outwards_and_have_their_volume() {
        let mut cuboid = Geometry::default();
        cuboid.cuboid(vec3(1.0, 2.0, 3.0), vec3(2.0, 4.0, 6.0), srgb(0, 0, 0));
        assert!((volume(&cuboid) - 6.0).abs() < 1e-4);
        assert_eq!(cuboid.triangles(), 12);
        for (sides, area) in [(6, 1.5 * 3f32.sqrt()), (8, 2.0 * 2f32.sqrt()), (12, 3.0)] {
            let mut prism = Geometry::default();
            prism.prism(vec3(5.0, 1.0, -2.0), 1.0, 1.0, 2.0, sides, srgb(0, 0, 0));
            assert!((volume(&prism) - 2.0 * area).abs() < 1e-3, "{sides}");
            let mut pyramid = Geometry::default();
            pyramid.prism(vec3(5.0, 1.0, -2.0), 1.0, 0.0, 3.0, sides, srgb(0, 0, 0));
            assert!((volume(&pyramid) - area).abs() < 1e-3, "{sides}");
        }
        let mut ball = Geometry::default();
        ball.ball(vec3(1.0, 1.0, 1.0), vec3(1.0, 2.0, 3.0), srgb(0, 0, 0));
        assert_eq!(ball.triangles(), 80);
        assert!(volume(&ball) > 0.8 * 6.0 * 4.18 && volume(&ball) < 6.0 * 4.19);
    }
}
