//! A node of the wide tree: eight boxes in 128 bytes.

use glam::DVec3;
use mullion_common::geometry::Aabb;
use mullion_common::visible_set::LeafRange;

/// Children of a node.
pub const LANES: usize = 8;

/// Up to eight boxes and what they hold.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct WideNode {
    /// Least x of all lanes, then y, then z, in steps from `origin`; 255, and above `max`, in an empty lane.
    pub min: [[u8; LANES]; 3],
    /// Greatest coordinates, in the same steps.
    pub max: [[u8; LANES]; 3],
    /// From the tree's origin, metres.
    pub origin: [f32; 3],
    /// A step along each axis is two to this power, metres.
    pub exponent: [i8; 3],
    /// A bit for each lane that is a leaf.
    pub leaf_lanes: u8,
    /// First leaf of each lane, `u32::MAX` in an unused one. A lane ends where the next one starts or the node ends.
    pub first_leaf: [u32; LANES],
    /// Below each lane: a wide node, or with [`WideNode::LEAF`] set the hierarchy's node of a leaf, with
    /// [`WideNode::ORIENTED`] set where its oriented box is much smaller than the lane's.
    pub child: [u32; LANES],
}
const _: () = assert!(size_of::<WideNode>() == 128);

/// The oriented boxes in a node's lanes, for leaves: half-axes about the middles of their lanes. 72 bytes.
///
/// A coordinate is in 127ths of half the lane's edge, off by half of one at most; the middle is off by half a step of the node.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeafAxes {
    /// By half-axis, then coordinate, then lane.
    pub shares: [[[i8; LANES]; 3]; 3],
}
const _: () = assert!(size_of::<LeafAxes>() == 72);

/// Where a node's steps begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Room {
    /// At the least coordinate: nothing moves.
    None,
    /// So far before it that as many are left after the greatest one: what moves a little can be measured in the same steps.
    Around,
}

impl LeafAxes {
    /// Parts of half an edge.
    pub const PARTS: f32 = 127.0;

    /// Takes the half-axes of a lane of `node`, which must have the box around them.
    pub(super) fn set(&mut self, lane: usize, half_axes: &[DVec3; 3], node: &WideNode) {
        for axis in 0..3 {
            let steps = node.max[axis][lane].saturating_sub(node.min[axis][lane]);
            let half_m = f64::from(steps) * 0.5 * power_of_two_f64(node.exponent[axis].into());
            // No half-axis is longer than half the lane; where that has no extent, neither have they.
            let per_m = if half_m > 0.0 { f64::from(Self::PARTS) / half_m } else { 0.0 };
            for (shares, half) in self.shares.iter_mut().zip(half_axes) {
                let share = half[axis] * per_m;
                // To the nearest.
                let rounded = (share + 0.5_f64.copysign(share)) as i32;
                shares[axis][lane] = rounded.clamp(-127, 127) as i8;
            }
        }
    }
}

impl Default for WideNode {
    /// A node with nothing in it.
    fn default() -> Self {
        Self {
            min: [[EMPTY.0; LANES]; 3],
            max: [[EMPTY.1; LANES]; 3],
            origin: [0.0; 3],
            exponent: [0; 3],
            leaf_lanes: 0,
            first_leaf: [u32::MAX; LANES],
            child: [0; LANES],
        }
    }
}

impl WideNode {
    /// Marks a child that is a leaf.
    pub const LEAF: u32 = 1 << 31;
    /// Marks a leaf whose oriented box is worth a test of its own.
    pub const ORIENTED: u32 = 1 << 30;
    /// What remains without the marks.
    pub const NODE: u32 = Self::ORIENTED - 1;
    /// Steps along an axis.
    const STEPS: f64 = 255.0;
    /// Least exponent: a step of a tenth of a nanometre, for nodes without extent.
    const MIN_EXPONENT: i32 = -33;
    /// Greatest exponent: a step that `f32` still has. Lanes that end further out are infinite there, and always cut.
    const MAX_EXPONENT: i32 = 127;

    /// Takes the lanes' boxes, relative to the tree's origin, metres; empty ones for lanes with nothing in them. Boxes are
    /// rounded outwards.
    pub(super) fn set_boxes(&mut self, boxes: &[Aabb; LANES], room: Room) {
        let all = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(b));
        if all.is_empty() {
            (self.min, self.max) = ([[EMPTY.0; LANES]; 3], [[EMPTY.1; LANES]; 3]);
            return;
        }
        for axis in 0..3 {
            let mut origin = floor_f32(all.min[axis]);
            let exponent = exponent_for((all.max[axis] - f64::from(origin)) / Self::STEPS);
            if room == Room::Around {
                let steps = (all.max[axis] - f64::from(origin)) * power_of_two_f64(-exponent);
                let shifted = floor_f32(f64::from(origin) - ((Self::STEPS - steps) * 0.5).floor() * power_of_two_f64(exponent));
                let reaches = (all.max[axis] - f64::from(shifted)) * power_of_two_f64(-exponent) <= Self::STEPS;
                origin = if reaches { shifted } else { origin };
            }
            let from = f64::from(origin);
            self.origin[axis] = origin;
            self.exponent[axis] = exponent as i8;
            for (lane, b) in boxes.iter().enumerate() {
                (self.min[axis][lane], self.max[axis][lane]) = match in_steps(b, axis, from, exponent) {
                    // Neither is negative, nor above 255, but where boxes have no measure.
                    Some((low, high)) => (clamped(low), clamped(high)),
                    None => EMPTY,
                };
            }
        }
    }

    /// Gives one lane a box, relative to the tree's origin, metres. Whether the node's steps reach that far; where not, the node is
    /// to be given all boxes.
    pub(super) fn set_box(&mut self, lane: usize, b: &Aabb) -> bool {
        let mut fits = true;
        for axis in 0..3 {
            let (low, high) = match in_steps(b, axis, f64::from(self.origin[axis]), self.exponent[axis].into()) {
                Some(steps) => steps,
                None => (i32::from(EMPTY.0), i32::from(EMPTY.1)),
            };
            fits &= low >= 0 && high <= u8::MAX.into();
            (self.min[axis][lane], self.max[axis][lane]) = (clamped(low), clamped(high));
        }
        fits
    }

    /// Whether the lanes take up so many steps along each axis that half as long ones would not do.
    pub(super) fn is_measured_well(&self) -> bool {
        (0..3).all(|axis| {
            let (least, greatest) = self.extent(axis);
            least > greatest || greatest - least > u8::MAX / 2 || i32::from(self.exponent[axis]) <= Self::MIN_EXPONENT
        })
    }

    /// The least and the greatest coordinate of all lanes, in steps.
    fn extent(&self, axis: usize) -> (u8, u8) {
        let least = self.min[axis].iter().fold(u8::MAX, |least, steps| least.min(*steps));
        (least, self.max[axis].iter().fold(0, |greatest, steps| greatest.max(*steps)))
    }

    /// The leaves of a lane; `end` is one past the node's last leaf.
    #[inline(always)]
    pub fn leaves(&self, lane: usize, end: u32) -> LeafRange {
        // Read either way, so that nothing branches on the lane.
        let next = self.first_leaf[(lane + 1) % LANES].min(end);
        LeafRange::new(self.first_leaf[lane], if lane + 1 < LANES { next } else { end })
    }

    /// How many lanes are used; they are the first ones.
    pub fn lane_count(&self) -> usize {
        self.first_leaf.iter().take_while(|first| **first != u32::MAX).count()
    }

    /// The lanes that are used, a bit each.
    pub(super) fn used_lanes(&self) -> u8 {
        (0..LANES).fold(0, |bits, lane| bits | (u8::from(self.first_leaf[lane] != u32::MAX) << lane))
    }

    /// The lane that begins with a leaf, as a bit.
    pub(super) fn lane_from(&self, leaf: u32) -> u8 {
        (0..LANES).fold(0, |bits, lane| bits | (u8::from(self.first_leaf[lane] == leaf) << lane))
    }

    /// The lane with a wide node below it, as a bit.
    pub(super) fn lane_to(&self, child: u32) -> u8 {
        (0..LANES).fold(0, |bits, lane| bits | (u8::from(self.child[lane] == child) << lane)) & !self.leaf_lanes
    }

    /// The box around all lanes relative to the tree's origin, metres; empty where they all are.
    pub fn bound(&self) -> Aabb {
        let mut bound = Aabb::EMPTY;
        for axis in 0..3 {
            let (least, greatest) = self.extent(axis);
            if least > greatest {
                return Aabb::EMPTY;
            }
            let (origin, step_m) = (f64::from(self.origin[axis]), power_of_two_f64(self.exponent[axis].into()));
            bound.min[axis] = origin + f64::from(least) * step_m;
            bound.max[axis] = origin + f64::from(greatest) * step_m;
        }
        bound
    }

    /// Length of a step along each axis, metres.
    #[inline(always)]
    pub fn step_m(&self) -> [f32; 3] {
        self.exponent.map(|exponent| f32::from_bits(((i32::from(exponent) + 127) as u32) << 23))
    }
}

/// The least and the greatest coordinate of an empty lane.
const EMPTY: (u8, u8) = (u8::MAX, 0);

/// A box's coordinates along an axis in steps of two to the power of `exponent`, rounded outwards; none of an empty one.
#[inline]
fn in_steps(b: &Aabb, axis: usize, from: f64, exponent: i32) -> Option<(i32, i32)> {
    // Exact: steps are powers of two.
    let per_step = power_of_two_f64(-exponent);
    let (low, high) = ((b.min[axis] - from) * per_step, (b.max[axis] - from) * per_step);
    // A cast rounds towards zero.
    let (low_floor, high_floor) = (low as i32, high as i32);
    let low_steps = low_floor.saturating_sub(i32::from(f64::from(low_floor) > low));
    let high_steps = high_floor.saturating_add(i32::from(f64::from(high_floor) < high));
    (b.min[axis] <= b.max[axis]).then_some((low_steps, high_steps))
}

/// As a byte: steps past the last one are where lanes are infinite.
fn clamped(steps: i32) -> u8 {
    steps.clamp(0, 255) as u8
}

/// Two to the power of `exponent`, in the range of normal numbers.
fn power_of_two_f64(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// The least power of two, as an exponent, that is not below `step_m`.
fn exponent_for(step_m: f64) -> i32 {
    let bits = step_m.max(power_of_two_f64(WideNode::MIN_EXPONENT)).to_bits();
    let floor = (bits >> 52) as i32 - 1023;
    let is_above = bits & ((1 << 52) - 1) != 0;
    (floor + i32::from(is_above)).min(WideNode::MAX_EXPONENT)
}

/// The greatest `f32` that is not above `value`.
fn floor_f32(value: f64) -> f32 {
    let near = value as f32;
    if f64::from(near) > value { near.next_down() } else { near }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Infinite for the lanes, so that every plane cuts them; never empty.
    #[test]
    fn boxes_without_measure_are_not_lost() {
        for far in [1e39, 1e60, 1e300] {
            let mut boxes = [Aabb::EMPTY; LANES];
            boxes[0] = Aabb { min: DVec3::splat(-far), max: DVec3::splat(far) };
            boxes[1] = Aabb { min: DVec3::ZERO, max: DVec3::ONE };
            let mut node = WideNode::default();
            node.set_boxes(&boxes, Room::None);
            for lane in 0..2 {
                assert!((0..3).all(|axis| node.min[axis][lane] <= node.max[axis][lane]), "{far} lane {lane}: {node:?}");
            }
            assert!(!node.bound().is_empty());
        }
    }

    proptest! {
        #[test]
        fn boxes_are_rounded_outwards_by_less_than_a_step(
            places in proptest::collection::vec((-1e6..1e6f64, -1e-3..1e-3f64, 5.0..6.0f64, 0.0..1e3f64), 1..9),
        ) {
            let mut boxes = [Aabb::EMPTY; LANES];
            for (b, (x, y, z, size)) in boxes.iter_mut().zip(&places) {
                let min = DVec3::new(*x, *y, *z);
                *b = Aabb { min, max: min + DVec3::new(*size, size * 1e-6, 0.0) };
            }
            let mut node = WideNode::default();
            node.set_boxes(&boxes, Room::None);
            for axis in 0..3 {
                let step = f64::from(node.step_m()[axis]);
                let at = |steps: u8| f64::from(node.origin[axis]) + f64::from(steps) * step;
                for (lane, b) in boxes.iter().enumerate().take(places.len()) {
                    let (low, high) = (at(node.min[axis][lane]), at(node.max[axis][lane]));
                    prop_assert!(low <= b.min[axis] && b.min[axis] < low + step, "{low} {b:?} {step}");
                    prop_assert!(high >= b.max[axis] && b.max[axis] > high - step, "{high} {b:?} {step}");
                }
                for lane in places.len()..LANES {
                    prop_assert!(node.min[axis][lane] > node.max[axis][lane]);
                }
            }
            let all = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(b));
            let bound = node.bound();
            prop_assert!(bound.min.cmple(all.min).all() && bound.max.cmpge(all.max).all());
            prop_assert!(WideNode::default().bound().is_empty());
        }
    }
}
