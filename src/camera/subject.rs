//! What a walk goes round or through.

use glam::DVec3;
use mullion_common::geometry::Aabb;
use mullion_common::scene::Package;

/// Eyes of someone who stands, metres above the floor.
const EYE_HEIGHT_M: f64 = 1.65;

/// Where a scene is and where most of it is. All in the world, metres.
pub struct Subject {
    leaves: Vec<Aabb>,
    all: Aabb,
    populated: Aabb,
    core: Aabb,
}

impl Subject {
    /// Of a scene's leaves; a box of 2 m around the origin for a scene without any.
    pub fn of(package: &Package) -> Self {
        let nodes = package.scene.hierarchy.nodes();
        let bounds: Vec<Aabb> = nodes.iter().filter(|n| n.leaves.len() == 1).map(|n| n.bound.aabb()).collect();
        if bounds.is_empty() {
            let nothing = Aabb { min: DVec3::NEG_ONE, max: DVec3::ONE };
            return Self { leaves: bounds, all: nothing, populated: nothing, core: nothing };
        }
        let all = bounds.iter().fold(Aabb::EMPTY, |all, bound| all.union(bound));
        let [populated, core] = [0.9, 0.5].map(|share| middle_share(&bounds, share));
        Self { leaves: bounds, all, populated, core }
    }

    /// The box around all leaves' bounds.
    pub fn all(&self) -> &Aabb {
        &self.all
    }

    /// The box that holds the middle half of the leaves along each axis: the populated places.
    pub fn core(&self) -> &Aabb {
        &self.core
    }

    /// The middle of what fills most of the scene; a few far objects do not count.
    pub fn center(&self) -> DVec3 {
        self.populated.center()
    }

    /// Width, height and depth of what fills most of the scene.
    pub fn size(&self) -> DVec3 {
        self.populated.size()
    }

    /// Half the diagonal of what fills most of the scene.
    pub fn radius_m(&self) -> f64 {
        (self.size().length() * 0.5).max(1e-3)
    }

    /// Metres of the world in a metre of the room: below 1 for scenes smaller than a person.
    pub fn scale(&self) -> f64 {
        (self.radius_m() / 2.0).min(1.0)
    }

    /// Height of the eyes of someone who stands on the floor of what fills most of the scene.
    pub fn eye_height_y(&self) -> f64 {
        self.populated.min.y + EYE_HEIGHT_M * self.scale()
    }

    /// The boxes of leaves that are as high and as low as that: what one may bump into.
    pub fn at_eye_height(&self) -> impl Iterator<Item = &Aabb> {
        let y = self.eye_height_y();
        self.leaves.iter().filter(move |leaf| (leaf.min.y..=leaf.max.y).contains(&y))
    }
}

/// The box that holds the middle `share` of the boxes along each axis.
fn middle_share(bounds: &[Aabb], share: f64) -> Aabb {
    let percentile = |share: f64, value: &dyn Fn(&Aabb) -> f64| {
        let mut values: Vec<f64> = bounds.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values[((values.len() - 1) as f64 * share).round() as usize]
    };
    let outside = (1.0 - share) / 2.0;
    let low = |axis: usize| percentile(outside, &|b| b.min[axis]);
    let high = |axis: usize| percentile(1.0 - outside, &|b| b.max[axis]);
    let (min, max) = (DVec3::new(low(0), low(1), low(2)), DVec3::new(high(0), high(1), high(2)));
    Aabb { min: min.min(max), max: max.max(min) }
}
