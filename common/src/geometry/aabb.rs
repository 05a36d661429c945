//! Axis-aligned boxes.

use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::RELATIVE_SLACK;

/// An axis-aligned box. Empty when any `min` exceeds its `max`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// Least coordinates, metres.
    pub min: DVec3,
    /// Greatest coordinates, metres.
    pub max: DVec3,
}

impl Aabb {
    /// The box of nothing: the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The least box that holds all `points`; empty for none.
    pub fn of_points(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |aabb, p| Self { min: aabb.min.min(p), max: aabb.max.max(p) })
    }

    /// The least box that holds both.
    #[inline]
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Whether it holds no point.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// Its middle. Meaningless when empty.
    pub fn center(&self) -> DVec3 {
        self.min * 0.5 + self.max * 0.5
    }

    /// Edge lengths, metres.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Half its surface, m²: what a ray, or the edge of a view, meets it by. Meaningless when empty.
    #[inline]
    pub fn half_area(&self) -> f64 {
        let s = self.size();
        s.x * s.y + s.y * s.z + s.z * s.x
    }

    /// The same box elsewhere.
    pub fn moved(&self, by: DVec3) -> Self {
        Self { min: self.min + by, max: self.max + by }
    }

    /// The same box, `by_m` metres larger on every side.
    pub fn grown(&self, by_m: f64) -> Self {
        Self { min: self.min - by_m, max: self.max + by_m }
    }

    /// Its eight corners; bit 0 of the index chooses x, bit 1 y, bit 2 z.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, low: f64, high: f64| if i & bit == 0 { low } else { high };
            DVec3::new(pick(1, self.min.x, self.max.x), pick(2, self.min.y, self.max.y), pick(4, self.min.z, self.max.z))
        })
    }

    /// How far from its place, metres of the world, a GPU's `f32` may put what is in this box of an object's space: the terms of
    /// `clip_from_local` are as large as coordinates there, and cancel where they lie far from the object's origin.
    /// `reach`: lengths of the object's axes in the world, as [`axis_lengths`] gives them.
    #[inline]
    pub fn rounding_m(&self, reach: DVec3) -> f64 {
        RELATIVE_SLACK * reach.dot(self.min.abs().max(self.max.abs()))
    }

    /// The least axis-aligned box in another space that holds this one there.
    pub fn transformed(&self, to_from_here: &DAffine3) -> Self {
        Self::of_points(self.corners().map(|c| to_from_here.transform_point3(c)))
    }
}

/// How long the axes of one space are in another.
#[inline]
pub fn axis_lengths(to_from_here: &DMat3) -> DVec3 {
    DVec3::new(to_from_here.x_axis.length(), to_from_here.y_axis.length(), to_from_here.z_axis.length())
}
