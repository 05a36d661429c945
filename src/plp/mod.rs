//! How good estimates are: drawn to budgets, and held against the exact visible set.

mod drawing;

use std::time::{Duration, Instant};

use glam::{DAffine3, DMat4, DQuat, DVec3};
use mullion_client::plp::{Frame, Sight, Solidity, Traversal};
use mullion_common::geometry::Frustum;
use mullion_common::scene::{Package, Tessellation};
use mullion_common::wall::{Projection, ViewId, Wall};

pub use drawing::Drawing;

use crate::item_buffer::{ItemBuffer, ItemScene, NOTHING};

/// What an estimate is compared by to the one before, 0.1 degrees away.
const TURN_DEGREES: f64 = 0.1;

/// Draws frames of a tile, its wall's only one, and counts.
pub struct Judge<'a> {
    package: &'a Package,
    tessellation: &'a Tessellation,
    scene: ItemScene,
    buffer: ItemBuffer,
    wall: &'a Wall,
    eye_in_room: DVec3,
    pixels_per_radian: f32,
}

/// A frame as the eye sees it.
pub struct Seen {
    pub projection: Projection,
    frustum: Frustum,
    clip_from_world: DMat4,
    /// The slots of V, ascending.
    visible: Vec<u32>,
    items: Vec<u32>,
}

/// How an estimate is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Verdict {
    /// ε_k.
    pub coverage: f64,
    /// Share of pixels that show something else.
    pub wrong_pixels: f64,
}

impl<'a> Judge<'a> {
    pub fn new(package: &'a Package, tessellation: &'a Tessellation, wall: &'a Wall, size_px: [u32; 2]) -> Self {
        let eye_in_room = wall.default_eyes().first().copied().unwrap_or_default();
        Self {
            package,
            tessellation,
            scene: ItemScene::of_leaves(package, tessellation.origin(), tessellation.leaves().iter().copied()),
            buffer: ItemBuffer::new(size_px),
            wall,
            eye_in_room,
            // The screen is as far from the eye as it is high.
            pixels_per_radian: size_px[1] as f32,
        }
    }

    /// Triangles that are judged.
    pub fn triangles(&self) -> usize {
        self.scene.len()
    }

    /// The exact visible set.
    pub fn look(&mut self, world_from_room: &DAffine3) -> Seen {
        let view = ViewId(0);
        let frustum = self.wall.frustum(view, self.eye_in_room, world_from_room);
        let projection = self.wall.projection(view, self.eye_in_room, world_from_room);
        let clip_from_eye = projection.clip_from_local(&DAffine3::from_translation(frustum.eye)).as_dmat4();
        let clip_from_world = clip_from_eye * DMat4::from_translation(-frustum.eye);
        self.buffer.draw(&self.scene, &clip_from_world, |_| true);
        let items = self.buffer.items().to_vec();
        let mut visible = items.clone();
        visible.sort_unstable();
        visible.dedup();
        visible.retain(|slot| *slot != NOTHING);
        Seen { projection, frustum, clip_from_world, visible, items }
    }

    /// The same place, turned a little about the vertical.
    pub fn turned(&self, world_from_room: &DAffine3) -> DAffine3 {
        let eye = world_from_room.transform_point3(self.eye_in_room);
        let turn = DAffine3::from_quat(DQuat::from_rotation_y(TURN_DEGREES.to_radians()));
        DAffine3::from_translation(eye) * turn * DAffine3::from_translation(-eye) * *world_from_room
    }

    /// As a traversal is told of it.
    pub fn frame<'f>(&'f self, seen: &'f Seen) -> Frame<'f> {
        let sight = Sight { eye: seen.frustum.eye, planes: &seen.frustum.planes, pixels_per_radian: self.pixels_per_radian };
        Frame { tessellation: self.tessellation, scene: &self.package.scene.manifest, sight }
    }

    /// Starts an estimate of a frame; how long that took.
    pub fn begin(&self, traversal: &mut Traversal, seen: &Seen, solidity: Solidity) -> Duration {
        let start = Instant::now();
        traversal.begin(&self.frame(seen), solidity);
        start.elapsed()
    }

    /// Goes on with it up to a budget; how long that took.
    pub fn project(&self, traversal: &mut Traversal, seen: &Seen, budget: u32) -> Duration {
        let start = Instant::now();
        traversal.project(&self.frame(seen), budget);
        start.elapsed()
    }

    /// How good a set of triangles is.
    pub fn judge(&mut self, seen: &Seen, holds: impl Fn(u32) -> bool) -> Verdict {
        self.buffer.draw(&self.scene, &seen.clip_from_world, &holds);
        let wrong = self.buffer.items().iter().zip(&seen.items).filter(|(a, b)| a != b).count();
        let found = seen.visible.iter().filter(|slot| holds(**slot)).count();
        Verdict {
            coverage: found as f64 / seen.visible.len().max(1) as f64,
            wrong_pixels: wrong as f64 / seen.items.len().max(1) as f64,
        }
    }

    /// Slots, ascending, as numbers of triangles by leaf.
    pub fn by_leaf(&self, slots: &[u32]) -> Vec<(u32, Vec<u16>)> {
        let mut by_leaf: Vec<(u32, Vec<u16>)> = Vec::new();
        let mut place = 0;
        for slot in slots {
            while self.tessellation.slots(place).end <= *slot {
                place += 1;
            }
            let (leaf, number) = (self.tessellation.leaves()[place as usize], slot - self.tessellation.slots(place).start);
            match by_leaf.last_mut() {
                Some((last, numbers)) if *last == leaf => numbers.push(number as u16),
                _ => by_leaf.push((leaf, vec![number as u16])),
            }
        }
        by_leaf
    }

    /// Triangles whose middles are in the frustum and whose fronts are towards the eye, by how near their middles are: the paper's basis
    /// of comparison.
    pub fn nearest(&self, seen: &Seen) -> Vec<u32> {
        let in_sight = |middle: DVec3| seen.frustum.planes.iter().all(|plane| plane.distance_m(middle) >= 0.0);
        let distance = |slot: u32| (self.scene.middle(slot) - seen.frustum.eye).length_squared();
        let faces = |slot: &u32| self.scene.is_seen_from(*slot, seen.frustum.eye) && in_sight(self.scene.middle(*slot));
        let mut order: Vec<u32> = (0..self.scene.len() as u32).filter(faces).collect();
        order.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
        order
    }

    /// The first of an order, as a set of slots.
    pub fn first_of(&self, order: &[u32], budget: u32) -> Vec<bool> {
        let mut held = vec![false; self.scene.len()];
        order.iter().take(budget as usize).for_each(|slot| held[*slot as usize] = true);
        held
    }
}

impl Seen {
    /// |V|.
    pub fn visible(&self) -> &[u32] {
        &self.visible
    }
}

/// Which share of the first of two ascending sets is not in both, on either side.
pub fn change(a: &[u32], b: &[u32]) -> f64 {
    let both = a.iter().filter(|slot| b.binary_search(slot).is_ok()).count();
    (a.len() + b.len() - 2 * both) as f64 / a.len().max(1) as f64
}
