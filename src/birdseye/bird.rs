//! Where the bird is.

use glam::{DAffine3, DMat3, DVec2, DVec3};
use mullion_common::wall::Projection;

/// How far it looks down, degrees below the horizon.
const DOWN_DEGREES: f64 = 50.0;
/// Height of what it sees, as an angle.
const HEIGHT_DEGREES: f64 = 32.0;
/// What is to be seen fills so much of the picture's width or height.
const FILLED: f64 = 0.96;
/// It looks so far past an axis of the world: scenes mostly stand along those, and are seen from a corner.
const ASIDE_DEGREES: f64 = 20.0;

/// Looks down on a scene.
pub struct Bird {
    projection: Projection,
    size_px: [u32; 2],
    near_m: f64,
    /// Into the picture.
    forward: DVec3,
    eye: DVec3,
}

impl Bird {
    /// The nearest place from which all points are seen, roughly along `ahead`.
    pub fn above(points: impl Iterator<Item = DVec3>, ahead: DVec3, size_px: [u32; 2]) -> Self {
        let world_from_bird = looking_down(heading(ahead));
        let half_height = (HEIGHT_DEGREES / 2.0).to_radians().tan();
        let half = DVec2::new(half_height * f64::from(size_px[0]) / f64::from(size_px[1]), half_height);
        // Along an axis, a bird at x and z sees what is at most `half * (z - point.z)` aside of x. The greatest of these sums, to either
        // side, are where it may stand.
        let inside = half * FILLED;
        let mut reach = [DVec2::NEG_INFINITY; 2];
        let mut nearest_z = f64::NEG_INFINITY;
        for point in points {
            let p = world_from_bird.transpose() * point;
            reach = [reach[0].max(p.truncate() + inside * p.z), reach[1].max(inside * p.z - p.truncate())];
            nearest_z = nearest_z.max(p.z);
        }
        if !nearest_z.is_finite() {
            (reach, nearest_z) = ([DVec2::ONE; 2], 0.0); // an empty scene
        }
        let z = ((reach[0] + reach[1]) / (2.0 * inside)).max_element();
        let z = z.max(nearest_z + (z - nearest_z).abs() * 1e-3 + 1e-6);
        let eye = world_from_bird * ((reach[0] - reach[1]) / 2.0).extend(z);
        let near_m = (z - nearest_z) / 2.0;
        let corner = |x: f64, y: f64| DVec3::new(x * half.x, y * half.y, -1.0);
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)];
        let world_from_room = DAffine3 { matrix3: world_from_bird, translation: eye };
        let projection = Projection::through_rectangle(DVec3::ZERO, corners, near_m, &world_from_room);
        Self { projection, size_px, near_m, forward: -world_from_bird.z_axis, eye }
    }

    /// What it sees the scene through.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Where a point is in the picture, pixels from the top left; none where it is behind the bird or almost.
    pub fn place(&self, world: DVec3) -> Option<DVec2> {
        (self.depth_m(world) >= self.near_m).then(|| {
            let clip = self.projection.clip_from_offset * (world - self.eye).extend(1.0);
            let [width, height] = self.size_px.map(f64::from);
            DVec2::new((clip.x / clip.w + 1.0) * width / 2.0, (1.0 - clip.y / clip.w) * height / 2.0)
        })
    }

    /// A line in the picture, as far as it is before the bird.
    pub fn segment(&self, from: DVec3, to: DVec3) -> Option<[DVec2; 2]> {
        let depths_m = [from, to].map(|point| self.depth_m(point) - self.near_m * 1.001);
        let cut = || from + (to - from) * (depths_m[0] / (depths_m[0] - depths_m[1]));
        let (from, to) = match depths_m.map(|depth_m| depth_m >= 0.0) {
            [true, true] => (from, to),
            [true, false] => (from, cut()),
            [false, true] => (cut(), to),
            [false, false] => return None,
        };
        Some([self.place(from)?, self.place(to)?])
    }

    fn depth_m(&self, world: DVec3) -> f64 {
        (world - self.eye).dot(self.forward)
    }
}

/// Level, and near to `ahead`: a little past one of the world's axes.
fn heading(ahead: DVec3) -> DVec3 {
    let (sin, cos) = ASIDE_DEGREES.to_radians().sin_cos();
    let axes = [DVec3::NEG_Z, DVec3::X, DVec3::Z, DVec3::NEG_X];
    let headings = axes.map(|axis| axis * cos + axis.cross(DVec3::Y) * sin);
    headings.into_iter().max_by(|a, b| a.dot(ahead).total_cmp(&b.dot(ahead))).unwrap_or(DVec3::NEG_Z)
}

/// A rotation whose −Z axis points down from `heading`, which is level.
fn looking_down(heading: DVec3) -> DMat3 {
    let (sin, cos) = DOWN_DEGREES.to_radians().sin_cos();
    let back = DVec3::Y * sin - heading * cos;
    let right = heading.cross(DVec3::Y);
    DMat3::from_cols(right, back.cross(right), back)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mullion_common::geometry::Aabb;

    #[test]
    fn a_scene_fills_the_picture_and_no_more() {
        let bounds = Aabb { min: DVec3::new(-100.0, 3.0, 7.0), max: DVec3::new(250.0, 42.0, 260.0) };
        for ahead in [DVec3::X, DVec3::new(-0.2, 0.9, 1.0), DVec3::NEG_Y, DVec3::ZERO] {
            let bird = Bird::above(bounds.corners().into_iter(), ahead, [960, 720]);
            let places = bounds.corners().map(|corner| bird.place(corner).expect("it is before the bird"));
            let least = places.into_iter().fold(DVec2::INFINITY, DVec2::min) / DVec2::new(960.0, 720.0);
            let most = places.into_iter().fold(DVec2::NEG_INFINITY, DVec2::max) / DVec2::new(960.0, 720.0);
            assert!(least.min_element() > 0.0 && most.max_element() < 1.0, "{least} {most}");
            assert!((most - least).max_element() > 0.9, "one axis is filled: {least} {most}");
        }
    }

    #[test]
    fn one_point_or_none_is_a_scene_too() {
        for points in [vec![], vec![DVec3::new(1.0, 2.0, 3.0)]] {
            let bird = Bird::above(points.iter().copied(), DVec3::X, [960, 720]);
            assert!(bird.projection().clip_from_offset.is_finite());
            assert!(points.iter().all(|point| bird.place(*point).is_some()));
        }
    }

    #[test]
    fn lines_end_where_the_bird_is() {
        let bounds = Aabb { min: DVec3::ZERO, max: DVec3::new(10.0, 1.0, 20.0) };
        let bird = Bird::above(bounds.corners().into_iter(), DVec3::X, [960, 720]);
        let behind = bird.eye - bird.forward * 100.0;
        assert!(bird.place(behind).is_none());
        assert!(bird.segment(bounds.max, behind).is_some() && bird.segment(behind, bounds.max).is_some());
        assert!(bird.segment(behind, behind + DVec3::X).is_none());
    }
}
