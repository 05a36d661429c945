//! Turned and swept solids, faceted, counterclockwise from outside, metres, Y up.
use super::solid::{Color, Geometry, ring};
use glam::{Vec3, vec3};

impl Geometry {
    /// The surface that `profile`, radii and heights from bottom to top, sweeps around the vertical through `base`.
    /// It is open where the first or last radius is not 0. `sides` as [`ring`] has them.
    pub fn lathe(&mut self, base: Vec3, profile: &[(f32, f32)], sides: usize, color: Color) {
        let ring = ring(sides);
        let at = |(radius, y): (f32, f32), k: usize| {
            let corner = ring[k % sides] * radius;
            base + vec3(corner.x, y, -corner.y)
        };
        for band in profile.windows(2) {
            let (low, high) = (band[0], band[1]);
            for k in 0..sides {
                match (low.0 == 0.0, high.0 == 0.0) {
                    (true, true) => {}
                    (true, false) => self.polygon(&[at(low, k), at(high, k + 1), at(high, k)], color),
                    (false, true) => self.polygon(&[at(low, k), at(low, k + 1), at(high, k)], color),
                    (false, false) => self.polygon(&[at(low, k), at(low, k + 1), at(high, k + 1), at(high, k)], color),
                }
            }
        }
    }

    /// A round bar along `path`, closed at both ends: `sides` · 2 triangles a stretch and `sides` − 2 an end.
    pub fn tube(&mut self, path: &[Vec3], radius: f32, sides: usize, color: Color) {
        let ring = ring(sides);
        let last = path.len() - 1;
        let mut across = (path[1] - path[0]).any_orthogonal_vector();
        let rings: Vec<Vec<Vec3>> = (0..=last)
            .map(|k| {
                let along = (path[(k + 1).min(last)] - path[k.saturating_sub(1)]).normalize();
                // Carried along, so that the tube does not twist.
                across = (across - along * across.dot(along)).normalize();
                let other = along.cross(across);
                ring.iter().map(|corner| path[k] + (across * corner.x + other * corner.y) * radius).collect()
            })
            .collect();
        for (from, to) in rings.iter().zip(&rings[1..]) {
            for k in 0..sides {
                let next = (k + 1) % sides;
                self.polygon(&[from[k], from[next], to[next], to[k]], color);
            }
        }
        let start: Vec<Vec3> = rings[0].iter().rev().copied().collect();
        self.polygon(&start, color);
        self.polygon(&rings[last], color);
    }

    /// A ring of round section about the vertical through `center`.
    pub fn torus(&mut self, center: Vec3, radius: f32, thickness: f32, [around, section]: [usize; 2], color: Color) {
        let mut profile: Vec<(f32, f32)> =
            ring(section).iter().map(|corner| (radius + corner.x * thickness, corner.y * thickness)).collect();
        profile.push(profile[0]);
        self.lathe(center, &profile, around, color);
    }

    /// A bar of rectangular section from `from` to `to`, closed: 12 triangles. `width` is across, `depth` upwards as far
    /// as that goes.
    pub fn bar(&mut self, from: Vec3, to: Vec3, [width, depth]: [f32; 2], color: Color) {
        let along = (to - from).normalize();
        let side = along.cross(if along.y.abs() > 0.99 { Vec3::Z } else { Vec3::Y }).normalize();
        let up = side.cross(along);
        let place = |p: Vec3| from + along * p.x + up * p.y + side * p.z;
        let mut bar = Geometry::default();
        let half = vec3(0.0, depth, width) / 2.0;
        bar.cuboid(-half, half + vec3((to - from).length(), 0.0, 0.0), color);
        self.copy(&bar, place);
    }

    /// Appends a coloured, faceted solid, moved by `place`, which must not mirror.
    pub fn copy(&mut self, solid: &Geometry, place: impl Fn(Vec3) -> Vec3) {
        let first = self.positions.len() as u32;
        self.positions.extend(solid.positions.iter().map(|p| place(*p)));
        self.colors.extend_from_slice(&solid.colors);
        self.indices.extend(solid.indices.iter().map(|k| first + k));
    }

    /// The solid laid down: what stood along +Y lies along +X.
    pub fn laid(mut self) -> Geometry {
        self.positions.iter_mut().for_each(|p| *p = vec3(p.y, -p.x, p.z));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::solid::srgb;

    fn volume(geometry: &Geometry) -> f32 {
        let p = |k: u32| geometry.positions[k as usize];
        geometry.indices.chunks_exact(3).map(|t| p(t[0]).dot(p(t[1]).cross(p(t[2]))) / 6.0).sum()
    }

    #[test]
    fn solids_face_outwards_and_have_their_volume() {
        let color = srgb(1, 2, 3);
        let close = |found: f32, right: f32| assert!((found / right - 1.0).abs() < 0.02, "{found}, {right}");
        let pi = std::f32::consts::PI;
        let mut cone = Geometry::default();
        cone.lathe(vec3(3.0, 1.0, -2.0), &[(0.0, 0.0), (2.0, 0.0), (1.0, 3.0), (0.0, 3.0)], 48, color);
        close(volume(&cone), pi * 7.0);
        close(volume(&cone.laid()), pi * 7.0);
        let mut tube = Geometry::default();
        tube.tube(&[vec3(1.0, 0.0, 0.0), vec3(1.0, 2.0, 0.0), vec3(1.0, 3.0, 0.2)], 0.5, 24, color);
        close(volume(&tube), pi * 0.25 * 3.02);
        assert_eq!(tube.triangles(), 2 * 48 + 2 * 22);
        let mut torus = Geometry::default();
        torus.torus(vec3(0.0, 5.0, 1.0), 2.0, 0.3, [64, 32], color);
        close(volume(&torus), 2.0 * pi * 2.0 * pi * 0.09);
        let mut bar = Geometry::default();
        bar.bar(vec3(1.0, 1.0, 1.0), vec3(3.0, 2.0, -1.0), [0.5, 0.25], color);
        close(volume(&bar), 3.0 * 0.125);
        let mut post = Geometry::default();
        post.bar(vec3(1.0, 1.0, 1.0), vec3(1.0, 5.0, 1.0), [0.5, 0.25], color);
        close(volume(&post), 0.5);
    }

    #[test]
    fn rings_are_regular() {
        for sides in [4, 6, 8, 12, 16, 24, 32, 48] {
            let ring = ring(sides);
            let edge = (ring[1] - ring[0]).length();
            for k in 0..sides {
                assert!((ring[k].length() - 1.0).abs() < 1e-6);
                assert!(((ring[(k + 1) % sides] - ring[k]).length() - edge).abs() < 1e-6, "{sides}: {k}");
            }
        }
    }
}
