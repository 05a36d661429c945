//! Off-axis projections: from the world to a tile's clip space.

use glam::{DAffine3, DMat3, DMat4, DVec2, DVec3, Mat4, Vec4};

use crate::geometry::{Frustum, Plane};

/// How one view projects the world.
///
/// Clip space is wgpu's (x right, y up, depth 0 to 1) with reversed depth and no far plane: depth is
/// `near / distance`, 1 at the near plane and 0 at infinity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// The eye in the world, metres.
    pub eye: DVec3,
    /// `clip_from_offset`: applied to a world position minus the eye.
    pub clip_from_offset: DMat4,
}

impl Projection {
    /// The projection from `eye` through a rectangle.
    ///
    /// `corners` (bottom left, bottom right, top left as the eye sees them) and `eye` in room space; `near_m` in
    /// metres of the room, along the rectangle's normal; `world_from_room` a similarity without mirroring.
    pub fn through_rectangle(eye: DVec3, corners: [DVec3; 3], near_m: f64, world_from_room: &DAffine3) -> Self {
        let [bottom_left, bottom_right, top_left] = corners;
        let right = (bottom_right - bottom_left).normalize();
        let towards_eye = (bottom_right - bottom_left).cross(top_left - bottom_left).normalize();
        let up = towards_eye.cross(right);
        let distance_m = (eye - bottom_left).dot(towards_eye);
        let (left_m, right_m) = ((bottom_left - eye).dot(right), (bottom_right - eye).dot(right));
        let (bottom_m, top_m) = ((bottom_left - eye).dot(up), (top_left - eye).dot(up));
        let (width_m, height_m) = (right_m - left_m, top_m - bottom_m);
        let clip_from_screen = DMat4::from_cols(
            DVec3::new(2.0 * distance_m / width_m, 0.0, 0.0).extend(0.0),
            DVec3::new(0.0, 2.0 * distance_m / height_m, 0.0).extend(0.0),
            DVec3::new((right_m + left_m) / width_m, (top_m + bottom_m) / height_m, 0.0).extend(-1.0),
            DVec3::new(0.0, 0.0, near_m).extend(0.0),
        );
        let screen_from_room = DMat3::from_cols(right, up, towards_eye).transpose();
        let room_from_offset = world_from_room.matrix3.inverse();
        Self {
            eye: world_from_room.transform_point3(eye),
            clip_from_offset: clip_from_screen * DMat4::from_mat3(screen_from_room * room_from_offset),
        }
    }

    /// A projection of all that planes through an eye have on their positive side; others are not asked. `None` where that is too wide for
    /// one picture, or nothing, or where planes do not go through the eye.
    ///
    /// Every machine finds the same, whatever tiles the planes come from.
    pub fn within(eye: DVec3, planes: &[Plane], near_m: f64) -> Option<Self> {
        /// The least cosine between the picture's middle and a corner: a right angle from edge to edge, and a half.
        const LEAST_COSINE: f64 = 0.35;
        const SLACK: f64 = 1e-6;
        const MOST_SIDES: usize = 8;
        let scale = 1.0 + eye.abs().max_element();
        let mut sides = [DVec3::ZERO; MOST_SIDES];
        let through_eye = planes.iter().filter(|plane| plane.distance_m(eye).abs() < SLACK * scale);
        let count = sides.iter_mut().zip(through_eye).map(|(side, plane)| *side = plane.normal).count();
        let sides = &sides[..count];
        // Where two sides meet, if no third cuts that off.
        let rays = || {
            let pairs = sides.iter().enumerate().flat_map(|(k, a)| sides[k + 1..].iter().map(move |b| a.cross(*b)));
            let both_ways = pairs.filter_map(DVec3::try_normalize).flat_map(|edge| [edge, -edge]);
            both_ways.filter(|ray| sides.iter().all(|side| side.dot(*ray) > -SLACK))
        };
        let forward = rays().sum::<DVec3>().try_normalize().filter(|_| rays().count() > 2)?;
        if rays().any(|ray| ray.dot(forward) < LEAST_COSINE) {
            return None;
        }
        // Along the first side, so that a wall stands upright in the picture or lies.
        let back = -forward;
        let right = sides.first()?.reject_from_normalized(back).try_normalize()?;
        let up = back.cross(right);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for ray in rays() {
            let at = DVec2::new(ray.dot(right), ray.dot(up)) / ray.dot(forward);
            (low, high) = (low.min(at), high.max(at));
        }
        let room = DAffine3 { matrix3: DMat3::from_cols(right, up, back), translation: eye };
        let corner = |x: f64, y: f64| DVec3::new(x, y, -1.0);
        let corners = [corner(low.x, low.y), corner(high.x, low.y), corner(low.x, high.y)];
        Some(Self::through_rectangle(DVec3::ZERO, corners, near_m, &room))
    }

    /// `clip_from_local` of an object, rounded once to `f32`: the products are taken in `f64` relative to the eye,
    /// so that kilometres of translation cost no precision nearby.
    pub fn clip_from_local(&self, world_from_local: &DAffine3) -> Mat4 {
        (self.clip_from_offset * DMat4::from(self.offset_from_local(world_from_local))).as_mat4()
    }

    /// World axes, origin at the eye.
    pub fn offset_from_local(&self, world_from_local: &DAffine3) -> DAffine3 {
        DAffine3 { matrix3: world_from_local.matrix3, translation: world_from_local.translation - self.eye }
    }

    /// Clip coordinates of a world position.
    pub fn clip(&self, world: DVec3) -> Vec4 {
        (self.clip_from_offset * (world - self.eye).extend(1.0)).as_vec4()
    }
}

/// Of how many pixels a length is, on a screen, that is as far from the eye as it is long: along the axis of view, in the finer of the
/// picture's two directions. `corners` as of [`Projection::through_rectangle`].
pub fn pixels_per_radian(eye: DVec3, [bottom_left, bottom_right, top_left]: [DVec3; 3], size_px: [u32; 2]) -> f64 {
    let (across, up) = (bottom_right - bottom_left, top_left - bottom_left);
    let distance_m = across.cross(up).normalize().dot(eye - bottom_left).abs();
    let [columns, rows] = size_px.map(f64::from);
    distance_m * (columns / across.length()).max(rows / up.length())
}

/// The frustum that the same view culls with, in the world.
pub fn world_frustum(eye: DVec3, corners: [DVec3; 3], near_m: f64, world_from_room: &DAffine3) -> Frustum {
    Frustum::through_rectangle(eye, corners, near_m).transformed(world_from_room)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    #[test]
    fn pixels_are_counted_along_the_axis() {
        // 2 m wide and 1 m high, seen off its axis from 3 m away.
        let corners = [DVec3::new(1.0, 0.0, 0.0), DVec3::new(3.0, 0.0, 0.0), DVec3::new(1.0, 1.0, 0.0)];
        let of = |size_px| pixels_per_radian(DVec3::new(0.0, 0.0, 3.0), corners, size_px);
        assert!((of([1000, 400]) - 1500.0).abs() < 1e-9 && (of([1000, 600]) - 1800.0).abs() < 1e-9);
    }

    proptest! {
        /// What projects into the clip volume is what the frustum's planes call inside.
        #[test]
        fn projection_and_frustum_agree(
            eye in (-3.0..3.0f64, -2.0..2.0f64, 0.5..4.0f64),
            point in (-20.0..20.0f64, -20.0..20.0f64, -30.0..5.0f64),
            turn in 0.0..6.0f64,
            scale in 0.1..10.0f64,
        ) {
            let corners = [DVec3::new(-1.0, -0.5, 0.0), DVec3::new(0.5, -0.5, 0.0), DVec3::new(-1.0, 0.7, 0.0)];
            let world_from_room = DAffine3::from_scale_rotation_translation(
                DVec3::splat(scale), DQuat::from_rotation_y(turn), DVec3::new(100.0, -5.0, 3.0));
            let eye = DVec3::from(eye);
            let world = world_from_room.transform_point3(point.into());
            let projection = Projection::through_rectangle(eye, corners, 0.1, &world_from_room);
            let frustum = world_frustum(eye, corners, 0.1, &world_from_room);
            let clip = projection.clip(world);
            let sides = [clip.w + clip.x, clip.w - clip.x, clip.w + clip.y, clip.w - clip.y, clip.w - clip.z];
            for (plane, value) in frustum.planes.iter().zip(sides) {
                let distance_m = plane.distance_m(world);
                prop_assert!(distance_m.abs() < 1e-3 || (distance_m > 0.0) == (value > 0.0), "{distance_m} {value}");
            }
        }
    }

    proptest! {
        /// The picture within a frustum's sides holds what the frustum does.
        #[test]
        fn what_is_within_planes_is_in_the_picture(
            eye in (-1.0..1.0f64, -1.0..1.0f64, 0.8..4.0f64),
            (x, y) in (0.01..0.99f64, 0.01..0.99f64),
            turn in 0.0..6.0f64,
            away in 1.0..50.0f64,
        ) {
            let corners = [DVec3::new(-1.0, -0.5, 0.0), DVec3::new(1.5, -0.5, 0.0), DVec3::new(-1.0, 0.7, 0.0)];
            let world_from_room = DAffine3::from_rotation_translation(DQuat::from_rotation_y(turn), DVec3::new(100.0, -5.0, 3.0));
            let eye = DVec3::from(eye);
            let planes = world_frustum(eye, corners, 0.1, &world_from_room).planes;
            let world_eye = world_from_room.transform_point3(eye);
            let Some(within) = Projection::within(world_eye, &planes, 0.01) else {
                prop_assume!(false);
                unreachable!()
            };
            let on_wall = corners[0] + (corners[1] - corners[0]) * x + (corners[2] - corners[0]) * y;
            let clip = within.clip(world_from_room.transform_point3(eye + (on_wall - eye) * away));
            prop_assert!(clip.w > 0.0 && clip.x.abs() <= clip.w * 1.0001 && clip.y.abs() <= clip.w * 1.0001, "{clip}");
            // And not much more.
            let corner = within.clip(world_from_room.transform_point3(corners[0]));
            prop_assert!((corner.x / corner.w).abs().max((corner.y / corner.w).abs()) > 0.6, "{corner}");
        }
    }

    #[test]
    fn what_is_too_wide_for_a_picture_has_none() {
        let eye = DVec3::new(1.0, 2.0, 3.0);
        let plane = |x: f64, y: f64, z: f64| Plane::through(eye, DVec3::new(x, y, z).normalize());
        assert!(Projection::within(eye, &[], 0.1).is_none());
        assert!(Projection::within(eye, &[plane(0.0, 0.0, -1.0)], 0.1).is_none(), "a half space");
        let wide = [plane(0.1, 0.0, -1.0), plane(-0.1, 0.0, -1.0), plane(0.0, 0.1, -1.0), plane(0.0, -0.1, -1.0)];
        assert!(Projection::within(eye, &wide, 0.1).is_none());
        let right_angle = [plane(1.0, 0.0, -1.0), plane(-1.0, 0.0, -1.0), plane(0.0, 1.0, -1.0), plane(0.0, -1.0, -1.0)];
        assert!(Projection::within(eye, &right_angle, 0.1).is_some());
        assert!(Projection::within(eye + DVec3::X, &right_angle, 0.1).is_none(), "planes of another eye");
    }

    #[test]
    fn corners_land_on_the_corners_of_clip_space() {
        let corners = [DVec3::new(-1.0, -0.5, -2.0), DVec3::new(0.5, -0.5, -2.0), DVec3::new(-1.0, 0.7, -2.0)];
        let projection = Projection::through_rectangle(DVec3::new(0.3, 0.1, 1.0), corners, 0.1, &DAffine3::IDENTITY);
        let ndc = corners.map(|c| projection.clip(c)).map(|c| c / c.w);
        for (found, wanted) in ndc.iter().zip([(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)]) {
            assert!((found.x - wanted.0).abs() < 1e-6 && (found.y - wanted.1).abs() < 1e-6, "{ndc:?}");
        }
        assert!((ndc[0].z - 0.1 / 3.0).abs() < 1e-6, "reversed depth: near over distance");
    }
}
