//! How good simplified meshes are: what is seen of a cut, and how far it is from the whole mesh.

mod error;
mod subject;

use glam::{DAffine3, DMat4, DVec3};
use mullion_common::geometry::Frustum;
use mullion_common::wall::Projection;

use crate::camera::place_room;
use crate::item_buffer::{ItemBuffer, ItemScene};

pub use error::{Distances, ImageError};
pub use subject::Subject;

/// The screen is as far from the eye as it is high.
const HALF: f64 = 0.5;

/// Where an eye is and what it sees.
pub struct Look {
    pub projection: Projection,
    pub frustum: Frustum,
    /// Of a picture of that height.
    pub pixels_per_radian: f32,
    pub near_m: f64,
}

impl Look {
    /// From a place towards another, upright, in a square picture this high.
    pub fn new(eye: DVec3, at: DVec3, near_m: f64, height_px: u32) -> Self {
        let world_from_room = place_room(eye, Some(at));
        let corner = |x: f64, y: f64| DVec3::new(x * HALF, y * HALF, -1.0);
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)];
        Self {
            projection: Projection::through_rectangle(DVec3::ZERO, corners, near_m, &world_from_room),
            frustum: Frustum::through_rectangle(DVec3::ZERO, corners, near_m).transformed(&world_from_room),
            pixels_per_radian: height_px as f32,
            near_m,
        }
    }

    /// `clip_from_world`, relative to the eye.
    fn clip_from_world(&self) -> DMat4 {
        let eye = self.projection.eye;
        self.projection.clip_from_local(&DAffine3::from_translation(eye)).as_dmat4() * DMat4::from_translation(-eye)
    }
}

/// Which triangles of a scene are seen, and where.
pub struct Seen {
    pub scene: ItemScene,
    /// So many are of what is simplified: the first.
    simplified: u32,
    size_px: [u32; 2],
    items: Vec<u32>,
    depths: Vec<f32>,
}

impl Seen {
    /// Draws a scene in software, of which so many triangles, the first, are of what is simplified.
    pub fn new(look: &Look, scene: ItemScene, simplified: u32, size_px: [u32; 2]) -> Self {
        let mut buffer = ItemBuffer::new(size_px);
        buffer.draw(&scene, &look.clip_from_world(), |_| true);
        Self { size_px, simplified, items: buffer.items().to_vec(), depths: buffer.depths().to_vec(), scene }
    }

    /// Of the picture.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// How many triangles of what is simplified are seen at a pixel at least.
    pub fn triangles(&self) -> usize {
        let mut visible = self.items.clone();
        visible.sort_unstable();
        visible.dedup();
        visible.iter().filter(|slot| **slot < self.simplified).count()
    }
}
