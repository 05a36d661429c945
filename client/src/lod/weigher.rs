//! What objects weigh by an estimate of what is visible: the last proposal of Prioritized-Layered Projection (Klosowski, Silva: *Rendering on a
//! Budget*, 1999, in its conclusions), to let the order of projection choose levels of detail.

use mullion_common::scene::{Presence, SceneManifest, Tessellation};

use super::sight::LocalSight;
use super::{LodObject, LodSight};
use crate::plp::{Frame, Sight, Solidity, Traversal};

/// Triangles are looked at as in a picture so many times as wide and high: of meshes that are simplified most are smaller than a pixel, and
/// hardly likely to have one. As they are, of objects that are far nothing is taken to be seen; in a finer picture yet near ones lose.
const FINER: f32 = 4.0;
/// What is as likely seen there is taken to be seen (`mullion bench lod --lod-weight plp`): a number of triangles is too few for one scene and
/// all of another.
const LEAST_LIKELY: f32 = 0.25;
/// Of that so many triangles, for the time that it takes.
const MOST_TRIANGLES: u32 = 1 << 18;

/// A scene, and the space around it as the package has it.
#[derive(Clone, Copy, Debug)]
pub struct Tessellated<'a> {
    /// The cells.
    pub tessellation: &'a Tessellation,
    /// The scene that they are of.
    pub scene: &'a SceneManifest,
}

/// Finds what objects weigh. Takes memory in its first frames only.
#[derive(Debug, Default)]
pub struct Weigher {
    traversal: Traversal,
    /// By object of the scene.
    known: Vec<Known>,
    /// By place in the tessellation: leaves of what is elsewhere.
    left_out: Vec<bool>,
    weighed: Vec<Weighed>,
}

/// What is known of an object of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    /// It is not weighed.
    Nothing,
    /// It is away, or stands elsewhere than the tessellation knows it.
    Elsewhere,
    /// It stands there, and has this number among those that are weighed.
    Home(u32),
}

#[derive(Debug, Default)]
struct Weighed {
    sight: LocalSight,
    /// Triangles with their fronts to the eye, of leaves whose boxes are in sight, and of these those that are taken to be seen.
    all: u32,
    seen: u32,
}

impl Weigher {
    /// Finds for each object, 0 to 1, which share of its triangles is taken to be seen, of those that face the eye and are of leaves whose boxes
    /// are in sight: what reaches far out of the picture weighs less. `None`: it has none there, the tessellation does not know it, or it
    /// stands elsewhere than the package has it, as what is away does: that stands before nothing.
    ///
    /// Depends on the scene, its tessellation, the sight and the objects alone.
    pub fn weigh<'a>(
        &'a mut self,
        Tessellated { tessellation, scene }: Tessellated<'_>,
        sight: &LodSight<'_>,
        objects: &[LodObject<'_>],
    ) -> impl Iterator<Item = Option<f32>> + use<'a> {
        let Self { traversal, known, left_out, weighed } = self;
        known.clear();
        known.resize(scene.transforms.len(), Known::Nothing);
        weighed.clear();
        for (number, object) in (0..).zip(objects) {
            if let Some(home) = scene.transforms.get(object.id.0 as usize) {
                let is_home = object.presence == Presence::There && home.affine() == object.world_from_local;
                known[object.id.0 as usize] = if is_home { Known::Home(number) } else { Known::Elsewhere };
            }
            weighed.push(Weighed { sight: LocalSight::new(sight, object), all: 0, seen: 0 });
        }
        let LodSight { eye, planes, pixels_per_radian, .. } = *sight;
        let sight = Sight { eye, planes, pixels_per_radian: pixels_per_radian * FINER };
        let frame = Frame { tessellation, scene, sight };
        let known = |leaf: &u32| known[scene.leaves[*leaf as usize].object.0 as usize];
        left_out.clear();
        left_out.extend(tessellation.leaves().iter().map(|leaf| known(leaf) == Known::Elsewhere));
        traversal.leave_out(left_out);
        traversal.begin(&frame, Solidity::default());
        traversal.project_likely(&frame, MOST_TRIANGLES, LEAST_LIKELY);
        for (place, leaf) in (0..).zip(tessellation.leaves()) {
            let Known::Home(number) = known(leaf) else { continue };
            let Weighed { sight, all, seen } = &mut weighed[number as usize];
            if sight.of_box(&scene.leaves[*leaf as usize].local_aabb()).is_some() {
                *all += traversal.front_count(&frame, place);
                *seen += traversal.drawn().count_of(place);
            }
        }
        weighed.iter().map(|Weighed { all, seen, .. }| (*all > 0).then(|| *seen as f32 / *all as f32))
    }
}
