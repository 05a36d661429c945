//! Sums of squared distances to planes (Garland, Heckbert 1997, section 3), about a vertex of their own: in `f32` that loses nothing, wherever
//! the mesh is.

use std::ops::AddAssign;

use glam::Vec3;

/// p ↦ pᵀ A p + 2 b·p + c, with p relative to the vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Quadric {
    /// xx, yy, zz.
    diagonal: Vec3,
    /// yz, zx, xy.
    off_diagonal: Vec3,
    b: Vec3,
    c: f32,
}

impl Quadric {
    /// The plane through `point` (relative to the vertex) with a unit normal.
    pub fn plane(normal: Vec3, point: Vec3, weight: f32) -> Self {
        let d = -normal.dot(point);
        Self {
            diagonal: normal * normal * weight,
            off_diagonal: Vec3::new(normal.y * normal.z, normal.z * normal.x, normal.x * normal.y) * weight,
            b: normal * (d * weight),
            c: d * d * weight,
        }
    }

    /// The squared distance to the vertex itself.
    pub fn point(weight: f32) -> Self {
        Self { diagonal: Vec3::splat(weight), ..Self::default() }
    }

    fn product(&self, p: Vec3) -> Vec3 {
        let (d, o) = (self.diagonal, self.off_diagonal);
        Vec3::new(d.x * p.x + o.z * p.y + o.y * p.z, o.z * p.x + d.y * p.y + o.x * p.z, o.y * p.x + o.x * p.y + d.z * p.z)
    }

    /// Its value at p, no less than 0.
    pub fn at(&self, p: Vec3) -> f32 {
        (p.dot(self.product(p) + 2.0 * self.b) + self.c).max(0.0)
    }

    /// The same about a vertex that is at `p`.
    pub fn moved_to(&self, p: Vec3) -> Self {
        Self { b: self.b + self.product(p), c: self.at(p), ..*self }
    }
}

impl AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        self.diagonal += other.diagonal;
        self.off_diagonal += other.off_diagonal;
        self.b += other.b;
        self.c += other.c;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_squared_distance_and_moves_with_its_vertex() {
        let normal = Vec3::new(2.0, -1.0, 2.0) / 3.0;
        let point = Vec3::new(0.5, 1.0, -2.0);
        let mut quadric = Quadric::plane(normal, point, 3.0);
        quadric += Quadric::point(0.25);
        for p in [Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 0.5, 1.0)] {
            let expected = 3.0 * normal.dot(p - point).powi(2) + 0.25 * p.length_squared();
            assert!((quadric.at(p) - expected).abs() < 1e-4 * expected.max(1.0));
            let by = Vec3::new(0.5, -0.25, 2.0);
            assert!((quadric.moved_to(by).at(p - by) - expected).abs() < 1e-3 * expected.max(1.0));
        }
    }
}
