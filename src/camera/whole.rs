//! `whole`: the whole scene in view of the whole wall at every frame, the paper's worst case (Nirnimesh, Harish, Narayanan
//! 2006, section 5).

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use mullion_common::geometry::Frustum;
use mullion_common::wall::{Screen, Wall};

use super::{Stand, Subject, facing};

/// Length of the walk if nobody says: once round, in a minute at 60 Hz.
pub const FRAMES: usize = 3600;
/// How high the eye stands over the middle of the scene, as an angle: 25°.
const ELEVATION: f64 = 0.436;
/// Further away than the scene needs, by this share: what fills the wall to its edge is not to hang on rounding.
const MARGIN: f64 = 0.01;
/// Screens are one flat wall while their corners are this near to one plane, metres.
const FLAT_WITHIN_M: f64 = 1e-3;

/// Slowly round the scene, a tenth of a degree a frame, at each frame as near as the box around all leaves' bounds allows: it is inside
/// every side of [`outer_frustum`], seen from the wall's own eye.
pub fn walk(subject: &Subject, wall: &Wall) -> impl Fn(usize) -> Stand + use<> {
    let eye_in_room = wall.default_eyes().first().copied().unwrap_or_default();
    let frustum = outer_frustum(wall, eye_in_room);
    let axis = frustum.rays.iter().map(|ray| ray.normalize()).sum::<DVec3>().normalize();
    // Turns the frustum's axis to −Z and keeps what is level level.
    let towards_axis = facing(-axis).transpose();
    let (all, scale) = (*subject.all(), subject.scale());
    let near_m = wall.near_m() * scale;
    move |frame| {
        let angle = TAU * (frame % FRAMES) as f64 / FRAMES as f64;
        let back = DVec3::new(ELEVATION.cos() * angle.sin(), ELEVATION.sin(), ELEVATION.cos() * angle.cos());
        let rotation: DMat3 = facing(back) * towards_axis;
        let distance_to = |corner: DVec3, side: usize| {
            let normal = frustum.planes[side].normal;
            let inside_m = if side == NEAR { near_m } else { 0.0 };
            (inside_m - (rotation * normal).dot(corner - all.center())) / normal.dot(axis)
        };
        let needed = all.corners().into_iter().flat_map(|corner| (0..=NEAR).map(move |side| (corner, side)));
        let distance_m = needed.map(|(corner, side)| distance_to(corner, side)).fold(0.0, f64::max) * (1.0 + MARGIN);
        Stand { eye: all.center() + back * distance_m, rotation }
    }
}

const NEAR: usize = mullion_common::geometry::FrustumSide::Near as usize;

/// What the whole of a flat wall sees from `eye`, room space: through the rectangle around all its screens. A room whose
/// screens look around has no such rectangle: there it is what the screen that faces +Z most sees, so that the scene is in
/// view of that screen as a whole, and the others see what their views share with it.
pub fn outer_frustum(wall: &Wall, eye: DVec3) -> Frustum {
    let screens = wall.screens();
    // A wall has a screen or more.
    let front = screens.iter().max_by(|a, b| towards_eye(a).z.total_cmp(&towards_eye(b).z)).unwrap_or(&screens[0]);
    let [origin, bottom_right, top_left] = front.corners;
    let axes = [(bottom_right - origin).normalize(), (top_left - origin).normalize(), towards_eye(front)];
    let corners = screens.iter().flat_map(all_corners);
    let in_axes: Vec<DVec3> = corners.map(|corner| DVec3::from(axes.map(|axis| axis.dot(corner - origin)))).collect();
    if in_axes.iter().any(|corner| corner.z.abs() > FLAT_WITHIN_M) {
        return Frustum::through_rectangle(eye, front.corners, wall.near_m());
    }
    let low = in_axes.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let high = in_axes.iter().copied().reduce(DVec3::max).unwrap_or_default();
    let at = |x: f64, y: f64| origin + axes[0] * x + axes[1] * y;
    Frustum::through_rectangle(eye, [at(low.x, low.y), at(high.x, low.y), at(low.x, high.y)], wall.near_m())
}

fn towards_eye(screen: &Screen) -> DVec3 {
    let [bottom_left, bottom_right, top_left] = screen.corners;
    (bottom_right - bottom_left).cross(top_left - bottom_left).normalize()
}

fn all_corners(screen: &Screen) -> [DVec3; 4] {
    let [bottom_left, bottom_right, top_left] = screen.corners;
    [bottom_left, bottom_right, top_left, bottom_right + top_left - bottom_left]
}
