//! The primary frustum alone: the planes that have all of a wall's views inside, for who wants no more of the frustum hierarchy.

use glam::{DAffine3, DVec3};
use mullion_common::geometry::{Frustum, FrustumSide, Plane};
use mullion_common::wall::Wall;

use super::frustum_hierarchy::{holds_all, primary_sides};
use super::room_frusta_iter;

/// Follows a wall's eyes and its room. Takes memory only in the first frame.
pub struct PrimaryFrustum {
    /// By `ViewId`, room space.
    room: Vec<Frustum>,
    eyes: Vec<DVec3>,
    sides: Vec<(u16, FrustumSide)>,
    planes: Vec<Plane>,
}

impl PrimaryFrustum {
    /// Of a wall with its own eyes, placed nowhere yet.
    pub fn new(wall: &Wall) -> Self {
        let eyes = wall.default_eyes();
        let room: Vec<Frustum> = room_frusta_iter(wall, &eyes).collect();
        Self { sides: primary_sides(&room), room, eyes, planes: Vec::new() }
    }

    /// Its planes in the world, all that any view sees on their positive side, at most 8: few or none where views look all around.
    ///
    /// `eyes` in room space, by `ViewId`; `world_from_room` is a similarity without mirroring.
    pub fn place(&mut self, wall: &Wall, eyes: &[DVec3], world_from_room: &DAffine3) {
        if eyes != self.eyes {
            self.eyes.clear();
            self.eyes.extend_from_slice(eyes);
            self.room.clear();
            self.room.extend(room_frusta_iter(wall, eyes));
            if !self.sides.iter().all(|(view, side)| holds_all(&self.room, *view, *side)) {
                self.sides = primary_sides(&self.room);
            }
        }
        let placed = |(view, side): &(u16, FrustumSide)| self.room[usize::from(*view)].plane(*side).transformed(world_from_room);
        self.planes.clear();
        self.planes.extend(self.sides.iter().map(placed));
    }

    /// Those planes.
    pub fn planes(&self) -> &[Plane] {
        &self.planes
    }
}

#[cfg(test)]
mod tests {
    use mullion_common::wall::{ViewId, WallConfig};

    use super::*;

    fn wall(text: &str) -> Wall {
        WallConfig::parse(text).unwrap()
    }

    const GRID: &str = "[grid]\ncolumns = 3\nrows = 2\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";

    #[test]
    fn what_any_view_sees_is_inside_and_what_is_beside_the_wall_is_not() {
        let wall = wall(GRID);
        let mut primary = PrimaryFrustum::new(&wall);
        let turned = DAffine3::from_rotation_y(0.7) * DAffine3::from_translation(DVec3::new(20.0, -3.0, 5.0));
        let start = wall.default_eyes();
        for (world_from_room, by) in
            [(DAffine3::IDENTITY, DVec3::ZERO), (turned, DVec3::new(0.3, -0.2, 0.4)), (turned, DVec3::ZERO)]
        {
            let eyes: Vec<DVec3> = start.iter().map(|eye| *eye + by).collect();
            primary.place(&wall, &eyes, &world_from_room);
            assert_eq!(primary.planes().len(), 5, "a pyramid and a near plane");
            let is_inside = |p: DVec3| primary.planes().iter().all(|plane| plane.distance_m(p) > -1e-9);
            for (view, eye) in (0..).zip(&eyes) {
                let frustum = wall.frustum(ViewId(view), *eye, &world_from_room);
                assert!(frustum.rays.iter().all(|ray| is_inside(frustum.eye + *ray * 7.0)), "view {view}");
            }
            let [left, right, top] = wall.screens()[0].corners;
            let beside = [left - (right - left) * 0.01, top + (top - left) * 0.01];
            let out = |p: &DVec3| !is_inside(world_from_room.transform_point3(eyes[0] + (*p - eyes[0]) * 7.0));
            assert!(beside.iter().all(out));
        }
    }

    #[test]
    fn two_walls_back_to_back_have_none_around_them() {
        let text = "eye = [0.0, 1.0, 0.0]\n\n[[screens]]\nname = \"front\"\nbottom_left = [-1.0, 0.0, -1.0]\nbottom_right = [1.0, 0.0, -1.0]\ntop_left = [-1.0, 2.0, -1.0]\n\
                    tile_px = [64, 48]\n\n[[screens]]\nname = \"back\"\nbottom_left = [1.0, 0.0, 1.0]\nbottom_right = [-1.0, 0.0, 1.0]\n\
                    top_left = [1.0, 2.0, 1.0]\ntile_px = [64, 48]\n";
        let wall = wall(text);
        let mut primary = PrimaryFrustum::new(&wall);
        primary.place(&wall, &wall.default_eyes(), &DAffine3::IDENTITY);
        let is_inside = |p: DVec3| primary.planes().iter().all(|plane| plane.distance_m(p) > -1e-9);
        assert!(is_inside(DVec3::new(0.1, 1.2, -9.0)) && is_inside(DVec3::new(0.1, 1.2, 9.0)), "{:?}", primary.planes());
    }
}
