//! Shadow frusta: what large occluders hide from an eye (section 1, use 2, after Hudson, Manocha, Cohen, Lin, Hoff, Zhang:
//! *Accelerated occlusion culling using shadow frusta*, 1997).
//!
//! Behind an occluder, seen from the eye, lies its shadow: a frustum whose near plane is the occluder's own. What is
//! wholly inside is hidden from that eye, whatever view looks. The shadows make a frustum hierarchy, so that a node of the object
//! hierarchy meets O(log m) of m shadows (section 2).

use glam::{DAffine3, DVec3};
use mullion_common::geometry::{Containment, Frustum, Obb, Plane};
use mullion_common::scene::ObjectHierarchy;
use mullion_common::visible_set::VisibleSet;
use thiserror::Error;

use super::{CullStats, FrustumHierarchy, FrustumNode, Overlap};

/// Most occluders: what a frustum hierarchy of bounded depth takes.
pub const MAX_OCCLUDERS: usize = 1024;

/// Least sine of the angles under which an occluder's sides are seen, and of the one between its plane and the way to it. Below,
/// its shadow would be rounding.
const LEAST_SINE: f64 = 1e-6;

/// An opaque rectangle or other parallelogram: three of its corners in the world, metres; the first is between the other two.
/// Both of its faces hide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Occluder {
    #[allow(missing_docs)]
    pub corners: [DVec3; 3],
}

/// Why there are no shadows.
#[derive(Debug, Error, PartialEq)]
#[allow(missing_docs)]
pub enum ShadowError {
    #[error("{count} occluders; at most {MAX_OCCLUDERS} are allowed")]
    TooMany { count: usize },
    #[error("occluder {occluder}: corner {corner}: coordinates must be finite")]
    NotFinite { occluder: usize, corner: DVec3 },
}

/// The shadows that occluders cast from one eye.
///
/// ```
/// use glam::{DAffine3, DVec3};
/// use mullion_common::geometry::Obb;
/// use mullion_common::scene::{ObjectHierarchy, OhNode};
/// use mullion_common::visible_set::{LeafRange, VisibleSet};
/// use mullion_server::cull::shadow::{Occluder, Shadows};
///
/// // A wall of 4 × 2 m, three metres before an eye, and a point behind it.
/// let corners = [DVec3::new(-2.0, -1.0, -3.0), DVec3::new(2.0, -1.0, -3.0), DVec3::new(-2.0, 1.0, -3.0)];
/// let mut shadows = Shadows::new(DVec3::ZERO, &[Occluder { corners }])?;
/// let bound = Obb::of_point(DVec3::new(0.5, 0.2, -9.0));
/// let scene = ObjectHierarchy::new(vec![OhNode { bound, subtree_end: 1, leaves: LeafRange::new(0, 1) }])?;
///
/// let mut hidden = VisibleSet::default();
/// shadows.hide(&scene, &mut hidden);
/// // What a view of that eye may see, without what is hidden from it.
/// let (seen, mut left) = (VisibleSet::all(1), VisibleSet::default());
/// seen.difference_into(&hidden, &mut left);
/// assert!(left.is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Shadows {
    frusta: FrustumHierarchy,
    /// Memory of [`Shadows::hide`]: where the subtrees around the present node end, and where in the frustum hierarchy they
    /// stopped.
    open: Vec<(u32, u32)>,
}

impl Shadows {
    /// The shadows from `eye`, in the world.
    ///
    /// An occluder hides only where it is drawn: it must belong to the scene, be opaque, and lie beyond the near planes of the
    /// views from which the hidden leaves are then taken. One that has no area, or whose plane the eye is in, casts none.
    /// Costs O(m²) for m occluders.
    ///
    /// # Errors
    /// For more than [`MAX_OCCLUDERS`], and for corners that are not finite.
    pub fn new(eye: DVec3, occluders: &[Occluder]) -> Result<Self, ShadowError> {
        if occluders.len() > MAX_OCCLUDERS {
            return Err(ShadowError::TooMany { count: occluders.len() });
        }
        let mut frusta = Vec::with_capacity(occluders.len());
        for (index, occluder) in occluders.iter().enumerate() {
            if let Some(corner) = occluder.corners.into_iter().find(|corner| !corner.is_finite()) {
                return Err(ShadowError::NotFinite { occluder: index, corner });
            }
            frusta.extend(occluder.shadow(eye));
        }
        let mut frusta = FrustumHierarchy::new(frusta, Overlap::TerminalCheck);
        frusta.place(&DAffine3::IDENTITY);
        Ok(Self { frusta, open: Vec::new() })
    }

    /// The shadows: from the occluders on, without end.
    pub fn frusta(&self) -> &[Frustum] {
        self.frusta.views()
    }

    /// Finds the leaves that lie wholly in one of the shadows; to be taken out of the sets of all views of the eye.
    ///
    /// Conservative: a leaf within rounding of a shadow's plane is not hidden, nor is one that only several shadows together
    /// hold. The set is overwritten.
    pub fn hide(&mut self, hierarchy: &ObjectHierarchy, hidden: &mut VisibleSet) -> CullStats {
        let mut stats = CullStats::default();
        hidden.clear();
        if self.frusta().is_empty() {
            return stats;
        }
        let nodes = hierarchy.nodes();
        let mut at = 0;
        self.open.clear();
        while at < nodes.len() as u32 {
            while self.open.last().is_some_and(|(subtree_end, _)| *subtree_end <= at) {
                self.open.pop();
            }
            let node = &nodes[at as usize];
            stats.nodes_visited += 1;
            let start = self.open.last().map_or(0, |(_, fh)| *fh);
            at = match self.meet(&node.bound, start, &mut stats) {
                Meeting::Hidden => {
                    hidden.push(node.leaves);
                    node.subtree_end
                }
                Meeting::Lit => node.subtree_end,
                Meeting::Cut { fh } => {
                    self.open.push((node.subtree_end, fh));
                    at + 1
                }
            };
        }
        stats
    }

    /// Takes a box down the frustum hierarchy from `fh`. A shadow that holds the box lies on the same side of a bisection plane as
    /// the box; where the plane cuts the box it cuts that shadow too, which then stands below both halves: one way leads
    /// to it, whichever half is taken.
    fn meet(&self, bound: &Obb, mut fh: u32, stats: &mut CullStats) -> Meeting {
        let mut first_cut = None;
        loop {
            match *self.frusta.node(fh) {
                FrustumNode::Split { cell, side, negative, positive } => {
                    let frustum = &self.frusta()[usize::from(cell)];
                    fh = match classify(frustum.plane(side), bound, frustum.eye, stats) {
                        Containment::Inside => positive,
                        Containment::Outside => negative,
                        Containment::Cut => {
                            first_cut.get_or_insert(fh);
                            negative
                        }
                    };
                }
                FrustumNode::Cells { start, end } => {
                    let mut is_lit = true;
                    for (cell, _) in self.frusta.cells_of(start, end) {
                        match contain(&self.frusta()[usize::from(cell)], bound, stats) {
                            Containment::Inside => return Meeting::Hidden,
                            Containment::Cut => is_lit = false,
                            Containment::Outside => {}
                        }
                    }
                    // Beyond a cut, other shadows than these may hold parts of the box.
                    return match first_cut {
                        Some(fh) => Meeting::Cut { fh },
                        None if is_lit => Meeting::Lit,
                        None => Meeting::Cut { fh },
                    };
                }
            }
        }
    }
}

/// How a box lies to the shadows.
enum Meeting {
    /// Wholly in one.
    Hidden,
    /// In none, nor is any part of it.
    Lit,
    /// Parts of it may be, and are to start at this node of the frustum hierarchy.
    Cut { fh: u32 },
}

fn contain(shadow: &Frustum, bound: &Obb, stats: &mut CullStats) -> Containment {
    let mut found = Containment::Inside;
    for plane in &shadow.planes {
        match classify(plane, bound, shadow.eye, stats) {
            Containment::Outside => return Containment::Outside,
            Containment::Cut => found = Containment::Cut,
            Containment::Inside => {}
        }
    }
    found
}

fn classify(plane: &Plane, bound: &Obb, eye: DVec3, stats: &mut CullStats) -> Containment {
    stats.plane_tests += 1;
    plane.classify(bound, eye)
}

impl Occluder {
    /// The space behind it, where there is one to speak of.
    fn shadow(&self, eye: DVec3) -> Option<Frustum> {
        let [corner, a, b] = self.corners;
        let front = (a - corner).cross(b - corner).try_normalize()?;
        let distance_m = front.dot(eye - corner);
        // Seen from behind, the sides change places.
        let corners = if distance_m > 0.0 { [corner, a, b] } else { [corner, b, a] };
        let shadow = Frustum::through_rectangle(eye, corners, distance_m.abs());
        let rays: Vec<DVec3> = shadow.rays.iter().map(|ray| ray.try_normalize()).collect::<Option<_>>()?;
        let is_side_seen = |k: usize| rays[k].cross(rays[(k + 1) % 4]).length() >= LEAST_SINE;
        let is_face_seen = rays.iter().all(|ray| front.dot(*ray).abs() >= LEAST_SINE);
        (is_face_seen && (0..4).all(is_side_seen)).then_some(shadow)
    }
}
