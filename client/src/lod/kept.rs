//! An occluder over frames: drawn anew at its turns, renewed and kept between them, and what objects weigh by it.

use glam::DAffine3;
use mullion_common::scene::Presence;
use mullion_common::wall::Projection;
use mullion_common::wire::DetailWeight;

use super::course::OccluderCourse;
use super::weigher::{Tessellated, Weigher};
use super::{DepthOccluder, LodObject, LodOptions, LodSight, Occluder, OccluderFrom, Refinement};

/// No object weighs less, however little of it is seen: what is known of that is an estimate.
const LEAST_WEIGHT: f32 = 1.0 / 16.0;

/// A corner of an object's box that is farther from where it was than this share of the box's diagonal: the object has moved.
const MOST_MOVED: f64 = 0.25;

/// Depths, when they are drawn, and weights.
#[derive(Debug)]
pub struct KeptOccluder {
    occluder: DepthOccluder,
    course: OccluderCourse,
    weigher: Weigher,
    /// By object, as the last turn found them, and by what.
    weights: Vec<f32>,
    weighed_by: DetailWeight,
    /// By object, as it was when the occluder was drawn.
    drawn: Vec<AsDrawn>,
    /// Whether one of them is elsewhere now.
    has_moved: bool,
}

/// How an object was when the occluder was drawn.
#[derive(Clone, Copy, Debug)]
struct AsDrawn {
    world_from_local: DAffine3,
    is_in_sight: bool,
    /// Whether it is in the picture, in sight or not.
    is_inside: bool,
}

impl KeptOccluder {
    /// One that nothing was drawn into.
    pub fn new(occluder: DepthOccluder) -> Self {
        let (course, weigher) = (OccluderCourse::default(), Weigher::default());
        Self {
            occluder,
            course,
            weigher,
            weights: Vec::new(),
            weighed_by: DetailWeight::None,
            drawn: Vec::new(),
            has_moved: false,
        }
    }

    /// Whether a frame draws the occluder anew or renews it, as long as the view looks about the same way and nothing goes away, or moves from where it was in
    /// the last frame.
    pub fn has_turn(&self, frame: u64) -> bool {
        let follows = self.has_moved && self.course.follows_at(frame);
        follows || matches!(self.course.at(frame), Some(OccluderFrom::ThisFrame | OccluderFrom::EarlierFrameRenewed))
    }

    /// The next frame draws the occluder anew, whatever its number.
    pub fn draw_anew(&mut self) {
        self.course = OccluderCourse::default();
    }

    /// Objects are others, or in another order: the next frame draws the occluder anew.
    pub fn forget(&mut self) {
        self.draw_anew();
        self.weights.clear();
        self.drawn.clear();
    }

    /// Refines a frame that is seen by a projection. Whether it drew the occluder anew, and what it found depends on no frame before it.
    ///
    /// An occluder that hides enough to be kept is drawn anew at once where something is in it that has gone away since, or the view is another, and
    /// at the next of a few frames where an object in sight has moved by a share of its size. Where objects are weighed it is drawn anew where it would
    /// be renewed. Weights are found anew where another way of weighing is wanted and where the view looks another way, whether the occluder
    /// hides enough to be drawn or not.
    ///
    /// By [`DetailWeight::None`] objects keep the weights that they come with. By [`DetailWeight::Nohc`] they get others, which a frame that
    /// draws the occluder finds after having refined as they came; then it refines once more. So what such a frame finds depends on no
    /// frame before it, and the frames that follow find the same while nothing moves. By [`DetailWeight::Plp`] such a frame finds them before
    /// it refines; where there is no tessellation they keep theirs.
    pub fn refine(
        &mut self,
        refinement: &mut Refinement,
        objects: &mut [LodObject<'_>],
        (sight, options): (&LodSight<'_>, &LodOptions),
        (projection, frame): (&Projection, u64),
        (weight, tessellated): (DetailWeight, Option<Tessellated<'_>>),
    ) -> bool {
        let Self { occluder, course, weigher, weights, weighed_by, drawn, has_moved } = self;
        let by_boxes = weight == DetailWeight::Nohc;
        let by_estimate = tessellated.filter(|_| weight == DetailWeight::Plp);
        *has_moved = false;
        let mut is_gone = false;
        for (number, (object, was)) in objects.iter().zip(&*drawn).enumerate() {
            if object.presence == Presence::Away {
                is_gone |= was.is_inside;
            } else if was.is_in_sight || refinement.is_in_sight(number) {
                // What is out of sight may move as it likes.
                *has_moved |= has_left(object, &was.world_from_local);
            }
        }
        let is_outdated = is_gone || *has_moved && course.follows_at(frame);
        let weighs = by_boxes || by_estimate.is_some();
        let holds = occluder.look(projection) && !is_outdated && (!weighs || *weighed_by == weight);
        let from = match course.at(frame) {
            Some(OccluderFrom::EarlierFrameRenewed) if weighs => Some(OccluderFrom::ThisFrame),
            from if holds => from,
            None if !weighs => None,
            _ => Some(OccluderFrom::ThisFrame),
        };
        let is_drawn = from == Some(OccluderFrom::ThisFrame);
        let is_renewed = from == Some(OccluderFrom::EarlierFrameRenewed);
        if let Some(tessellated) = by_estimate.filter(|_| is_drawn) {
            weights.clear();
            weights.extend(weigher.weigh(tessellated, sight, objects).map(weight_of));
        }
        if by_estimate.is_some() || by_boxes && !is_drawn {
            give(weights, objects);
        }
        refinement.refine(objects, sight, options, from.map(|from| (&mut *occluder as &mut dyn Occluder, from)));
        if is_drawn {
            *weighed_by = weight;
            course.note(frame, refinement);
        }
        if is_renewed {
            course.note_renewed(frame);
        }
        if is_drawn || is_renewed {
            drawn.clear();
            drawn.extend(objects.iter().enumerate().map(|(number, object)| AsDrawn {
                world_from_local: object.world_from_local,
                is_in_sight: refinement.is_in_sight(number),
                is_inside: object.is_solid && object.presence == Presence::There,
            }));
            *has_moved = false;
        }
        if by_boxes && is_drawn {
            let share = |object: &LodObject<'_>| occluder.visible_share(&object.world_from_local, &object.hierarchy.local_aabb());
            weights.clear();
            weights.extend(objects.iter().map(share).map(weight_of));
            give(weights, objects);
            // What is answered now is kept, like the picture.
            occluder.look(projection);
            refinement.refine(objects, sight, options, Some((occluder, OccluderFrom::EarlierFrame)));
        }
        is_drawn
    }
}

/// Whether an object is far from a place where it was.
fn has_left(object: &LodObject<'_>, place: &DAffine3) -> bool {
    if object.world_from_local == *place {
        return false;
    }
    let corners = object.hierarchy.local_aabb().corners();
    let [were, are] = [place, &object.world_from_local].map(|place| corners.map(|corner| place.transform_point3(corner)));
    let [first, .., last] = were;
    let most = MOST_MOVED * first.distance(last);
    were.iter().zip(are).any(|(was, is)| was.distance(is) > most)
}

/// By the share of it that is seen, as far as that is known.
fn weight_of(share: Option<f32>) -> f32 {
    share.map_or(1.0, |share| share.max(LEAST_WEIGHT))
}

fn give(weights: &[f32], objects: &mut [LodObject<'_>]) {
    objects.iter_mut().zip(weights).for_each(|(object, weight)| object.weight = *weight);
}
