//! How much an object adds to the picture of a wall: equation 1 of Bartz, Meißner, Hüttner 1999 (section 4.3). An estimate, never a visible
//! set.

/// The view plane of equation 1: the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewPlane {
    /// `SizeOfViewplane`: pixels of the whole wall, so that a box counts as much on whichever tile. More than 0.
    pub pixels: u64,
    /// `Dist(Eye)`: from the eye to the plane, metres of the room, more than 0.
    pub eye_m: f64,
}

/// `m = pixels / SizeOfViewplane · (Dist(Eye) + Dist(Obj)) / Dist(Eye)`, a number without unit: the share of the wall that an object's box
/// takes, times how much farther away than the wall it is. Farther boxes are larger for the same pixels, and count more.
///
/// `pixels`: those of the box that are visible (NOHC), as the paper's text has it; as the equation is printed, those of its projection (PHC).
/// `object_m`: `Dist(Obj)`, from the plane to the box's nearest point, metres of the room. What reaches through the plane is at 0, and so is
/// all before it.
///
/// Boxes say little of how much of what they hold is seen. Never 0 where there is a pixel. Contributions of one box to the tiles of a wall
/// add up.
pub fn contribution(pixels: u32, plane: &ViewPlane, object_m: f64) -> f64 {
    if pixels == 0 {
        return 0.0; // also infinitely far away, as what is not on the tile
    }
    f64::from(pixels) / plane.pixels as f64 * ((plane.eye_m + object_m.max(0.0)) / plane.eye_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_grows_with_distance_and_with_what_is_visible_and_adds_up() {
        let wall = ViewPlane { pixels: 4 * 1920 * 1080, eye_m: 2.0 };
        // As far behind the wall as the eye is before it: twice the share of the wall. 829 440 of 8 294 400 pixels are a tenth.
        assert!((contribution(829_440, &wall, 2.0) - 0.2).abs() < 1e-12);
        assert!((contribution(829_440, &wall, 6.0) - 0.4).abs() < 1e-12);
        assert!(contribution(1, &wall, 0.0) > 0.0);
        assert_eq!([50.0, f64::INFINITY].map(|object_m| contribution(0, &wall, object_m)), [0.0; 2]);
        let (one, other) = (contribution(300, &wall, 3.0), contribution(200, &wall, 3.0));
        assert!((one + other - contribution(500, &wall, 3.0)).abs() < 1e-15);
        assert_eq!(contribution(100, &wall, -0.001), contribution(100, &wall, 0.0), "before the plane");
    }
}
