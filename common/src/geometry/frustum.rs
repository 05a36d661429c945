//! A view's frustum: four planes through the eye and a near plane, open towards the far.

use glam::{DAffine3, DVec3};

use super::{Containment, Obb, Plane};

/// One of the bounding planes of a [`Frustum`], in the order in which they are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum FrustumSide {
    Left,
    Right,
    Bottom,
    Top,
    Near,
}

impl FrustumSide {
    /// The four planes that pass through the eye.
    pub const AROUND_EYE: [Self; 4] = [Self::Left, Self::Right, Self::Bottom, Self::Top];
}

/// The space that one view sees: a convex cone from the eye through a rectangle, cut by a near plane, without
/// a far plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    /// Where the view is seen from.
    pub eye: DVec3,
    /// Directions from the eye through the rectangle: bottom left, bottom right, top right, top left.
    /// Not normalised.
    pub rays: [DVec3; 4],
    /// Planes, indexed by [`FrustumSide`], positive inside.
    pub planes: [Plane; 5],
}

impl Frustum {
    /// The off-axis frustum from `eye` through the rectangle with the given corners.
    ///
    /// `corners` are bottom left, bottom right and top left, seen from the eye; the rectangle must not pass
    /// through the eye. `near_m` is measured along the rectangle's normal.
    pub fn through_rectangle(eye: DVec3, [bottom_left, bottom_right, top_left]: [DVec3; 3], near_m: f64) -> Self {
        let top_right = bottom_right + (top_left - bottom_left);
        let rays = [bottom_left - eye, bottom_right - eye, top_right - eye, top_left - eye];
        let towards_eye = (bottom_right - bottom_left).cross(top_left - bottom_left).normalize();
        let side = |a: DVec3, b: DVec3| Plane::through(eye, a.cross(b).normalize());
        Self {
            eye,
            rays,
            planes: [
                side(rays[0], rays[3]),
                side(rays[2], rays[1]),
                side(rays[1], rays[0]),
                side(rays[3], rays[2]),
                Plane::through(eye - towards_eye * near_m, -towards_eye),
            ],
        }
    }

    /// The plane on the given side.
    pub fn plane(&self, side: FrustumSide) -> &Plane {
        &self.planes[side as usize]
    }

    /// The frustum in another space. `to_from_here` must be a similarity without mirroring.
    pub fn transformed(&self, to_from_here: &DAffine3) -> Self {
        Self {
            eye: to_from_here.transform_point3(self.eye),
            rays: self.rays.map(|r| to_from_here.transform_vector3(r)),
            planes: self.planes.map(|p| p.transformed(to_from_here)),
        }
    }

    /// Classifies a box by the five planes, one by one. Conservative: a box near an edge of the frustum may be
    /// outside and still be called `Cut`.
    pub fn classify(&self, obb: &Obb) -> Containment {
        let mut all_inside = true;
        for plane in &self.planes {
            match plane.classify(obb, self.eye) {
                Containment::Outside => return Containment::Outside,
                Containment::Cut => all_inside = false,
                Containment::Inside => {}
            }
        }
        if all_inside { Containment::Inside } else { Containment::Cut }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Aabb;

    fn off_axis() -> Frustum {
        // A 1 × 2 m screen at z = −3, seen from far to the right.
        let corners = [DVec3::new(-0.5, -1.0, -3.0), DVec3::new(0.5, -1.0, -3.0), DVec3::new(-0.5, 1.0, -3.0)];
        Frustum::through_rectangle(DVec3::new(4.0, 0.5, 0.0), corners, 0.1)
    }

    #[test]
    fn the_screen_is_inside_and_its_neighbours_are_not() {
        let frustum = off_axis();
        let inside = |x: f64, y: f64, z: f64| frustum.planes.iter().all(|p| p.distance_m(DVec3::new(x, y, z)) >= 0.0);
        assert!(inside(0.0, 0.0, -3.0) && inside(0.49, -0.99, -3.0));
        assert!(!inside(0.51, 0.0, -3.0) && !inside(-0.51, 0.0, -3.0) && !inside(0.0, 1.01, -3.0) && !inside(0.0, -1.01, -3.0));
        assert!(!inside(4.0, 0.5, -0.05), "in front of the near plane");
        assert!(!inside(8.0, 1.0, 3.0), "behind the eye");
        let behind_screen = DVec3::new(4.0, 0.5, 0.0) + (DVec3::new(0.0, 0.0, -3.0) - DVec3::new(4.0, 0.5, 0.0)) * 50.0;
        assert!(inside(behind_screen.x, behind_screen.y, behind_screen.z), "no far plane");
    }

    #[test]
    fn boxes_classify() {
        let frustum = off_axis();
        let cube = |center: DVec3, half: f64| Obb::from(Aabb { min: center - half, max: center + half });
        assert_eq!(frustum.classify(&cube(DVec3::new(0.0, 0.0, -3.0), 0.1)), Containment::Inside);
        assert_eq!(frustum.classify(&cube(DVec3::new(0.5, 0.0, -3.0), 0.1)), Containment::Cut);
        assert_eq!(frustum.classify(&cube(DVec3::new(2.0, 0.0, -3.0), 0.1)), Containment::Outside);
        assert_eq!(frustum.classify(&cube(DVec3::new(4.0, 0.5, 0.0), 100.0)), Containment::Cut, "the eye is in the box");
    }
}
