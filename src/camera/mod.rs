//! Where the room stands in the world: `world_from_room`, frame by frame.

use glam::{DAffine3, DMat3, DVec3};
use mullion_common::geometry::Aabb;
use mullion_common::scene::Package;
use mullion_common::wall::Wall;

/// Reads `X,Y,Z`.
pub fn parse_point(text: &str) -> Result<DVec3, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers.as_slice() {
        [x, y, z] if text.matches(',').count() == 2 && numbers.iter().all(|n| n.is_finite()) => Ok(DVec3::new(*x, *y, *z)),
        _ => Err(format!("{text:?} is not three numbers X,Y,Z")),
    }
}

/// The room with its origin at `origin`, its −Z axis towards `look_at` where one is given, Y up as far as that goes.
pub fn place_room(origin: DVec3, look_at: Option<DVec3>) -> DAffine3 {
    let matrix3 = look_at.and_then(|target| (origin - target).try_normalize()).map_or(DMat3::IDENTITY, facing);
    DAffine3 { matrix3, translation: origin }
}

/// A rotation whose Z axis is `back`.
fn facing(back: DVec3) -> DMat3 {
    let right = DVec3::Y.cross(back).try_normalize().unwrap_or(DVec3::X);
    DMat3::from_cols(right, back.cross(right), back)
}

/// A walk round a scene that ends closer to it, with the whole of it in view at the start.
pub struct Orbit {
    center: DVec3,
    size: DVec3,
    radius_m: f64,
    /// Metres of the world in a metre of the room: below 1 for scenes smaller than a person.
    scale: f64,
    eye_in_room: DVec3,
    frames: u64,
}

impl Orbit {
    /// A walk of so many frames round what fills most of the scene; a few far objects do not count.
    pub fn new(package: &Package, wall: &Wall, frames: u64) -> Self {
        let middle = populated_box(package);
        let size = middle.size();
        let radius_m = (size.length() * 0.5).max(1e-3);
        Self {
            center: middle.center(),
            size,
            radius_m,
            scale: (radius_m / 2.0).min(1.0),
            eye_in_room: wall.default_eyes().first().copied().unwrap_or_default(),
            frames,
        }
    }

    /// What the walk goes round.
    pub fn center(&self) -> DVec3 {
        self.center
    }

    /// Width, height and depth of what fills most of the scene, metres.
    pub fn size(&self) -> DVec3 {
        self.size
    }

    /// Metres of the world in a metre of the room.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// `world_from_room` at a frame; past the end the walk begins anew.
    pub fn pose(&self, frame: u64) -> DAffine3 {
        let last = self.frames.max(2) - 1;
        self.at((frame % (last + 1)) as f64 / last as f64)
    }

    fn at(&self, share: f64) -> DAffine3 {
        const START: f64 = -0.9;
        const TURN: f64 = 0.9;
        let mix = |from: f64, to: f64, share: f64| from + (to - from) * share;
        // A city is walked into; a statue is walked round.
        let flatness = self.size.y / self.size.x.max(self.size.z).max(f64::MIN_POSITIVE);
        let compact = ((flatness - 0.2) / 0.2).clamp(0.0, 1.0);
        let (first, last) = (mix(1.7, 4.2, compact), mix(0.95, 3.0, compact));
        let distance_m = self.radius_m * mix(first, last, share);
        let height_m = distance_m * mix(mix(0.47, 0.3, compact), mix(0.38, 0.2, compact), share);
        let angle = START + TURN * share;
        let eye = self.center + DVec3::new(angle.sin() * distance_m, height_m, angle.cos() * distance_m);
        let matrix3 = facing((eye - self.center).normalize()) * self.scale;
        DAffine3 { matrix3, translation: eye - matrix3 * self.eye_in_room }
    }
}

/// The box that holds the middle nine tenths of the leaves along each axis.
fn populated_box(package: &Package) -> Aabb {
    let bounds: Vec<Aabb> =
        package.scene.hierarchy.nodes().iter().filter(|n| n.leaves.len() == 1).map(|n| n.bound.aabb()).collect();
    if bounds.is_empty() {
        return Aabb { min: DVec3::NEG_ONE, max: DVec3::ONE };
    }
    let percentile = |share: f64, value: &dyn Fn(&Aabb) -> f64| {
        let mut values: Vec<f64> = bounds.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values[((values.len() - 1) as f64 * share).round() as usize]
    };
    let low = |axis: usize| percentile(0.05, &|b| b.min[axis]);
    let high = |axis: usize| percentile(0.95, &|b| b.max[axis]);
    let (min, max) = (DVec3::new(low(0), low(1), low(2)), DVec3::new(high(0), high(1), high(2)));
    Aabb { min: min.min(max), max: max.max(min) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_room_faces_what_it_looks_at() {
        let room = place_room(DVec3::new(1.0, 2.0, 3.0), Some(DVec3::new(4.0, 2.0, -1.0)));
        let ahead = room.transform_vector3(DVec3::NEG_Z);
        assert!((ahead - DVec3::new(0.6, 0.0, -0.8)).length() < 1e-12, "{ahead}");
        assert!((room.transform_vector3(DVec3::Y) - DVec3::Y).length() < 1e-12);
        assert!((room.matrix3.determinant() - 1.0).abs() < 1e-12, "not mirrored");
        assert!(parse_point("1,2").is_err() && parse_point("1,2,x").is_err() && parse_point("1, -2, 3e2").is_ok());
    }
}
