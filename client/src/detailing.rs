//! Level of detail on a node: from the hierarchies that have come and a frame's order to the cuts that its views draw in place of leaves.
//!
//! All nodes refine for all of the wall, from the shared eye and into the primary frustum, and what they find is a function of these alone: so
//! an object across a seam has the same vertices on both sides. Where blobs are still to come nodes may differ, until they have.

use glam::{DAffine3, DVec3};
use mullion_common::geometry::Frustum;
use mullion_common::scene::{ObjectId, SceneManifest, Transform, VertexHierarchy};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::Projection;
use mullion_common::wire::{Detail, Primary, ViewSpec};

use crate::gpu::{CutObject, GpuError, Renderer};
use crate::lod::{
    BoundsKind, DepthOccluder, LodObject, LodOptions, LodSight, Occluder, OccluderCourse, OccluderFrom, Refinement,
};
use crate::tile_session::FrameToDraw;

/// Width and height of the occluder's picture: of the whole wall, whatever its shape.
const OCCLUDER_PX: [u32; 2] = [256, 256];
/// After so many splits the occluder is drawn: the paper's two (section 4), and on for cuts that are larger than the paper's.
const OCCLUDERS: [u32; 4] = [300, 2500, 20_000, 160_000];
/// No node counts as nearer than this, metres.
const NEAR_M: f64 = 1e-3;

/// What a painter keeps of it.
#[derive(Default)]
pub(crate) struct Detailing {
    /// By number, as far as they have come.
    hierarchies: Vec<Option<VertexHierarchy>>,
    /// By object, ascending.
    parts: Vec<Part>,
    /// Leaves of all parts.
    covered: VisibleSet,
    refinement: Refinement,
    occluder: Option<DepthOccluder>,
    course: OccluderCourse,
    /// Whether the cuts were found with an occluder of this view, or nothing could hide.
    is_final: bool,
    /// By place of the view: the objects that are drawn by their cuts.
    cuts: Vec<Vec<ObjectId>>,
    /// Hierarchies have come or gone, or objects have moved.
    has_changed: bool,
    /// For what the cuts were found that are on the GPU.
    found: Option<(DVec3, Primary, Detail)>,
}

/// An object that a hierarchy stands for.
struct Part {
    object: ObjectId,
    hierarchy: usize,
    leaves: VisibleSet,
    is_double_sided: bool,
}

impl Detailing {
    /// Takes the next blob of a hierarchy; how many bytes it takes now, or `None` where the blob is none of its.
    pub fn take(&mut self, manifest: &SceneManifest, (number, objects): (u32, &[ObjectId]), blob: &[u8]) -> Option<u64> {
        let number = number as usize;
        self.hierarchies.resize_with(self.hierarchies.len().max(number + 1), || None);
        self.has_changed = true;
        let place = &mut self.hierarchies[number];
        let taken = match place {
            Some(hierarchy) => hierarchy.decode_block(blob),
            None => VertexHierarchy::decode_base(blob, manifest.materials.len() as u32).map(|base| *place = Some(base)),
        };
        if let Err(error) = taken {
            tracing::warn!("vertex hierarchy {number}: {error}");
            self.forget(number as u32);
            return None;
        }
        let hierarchy = place.as_ref()?;
        if hierarchy.block_count() == 0 {
            let is_double_sided = hierarchy.base().materials.iter().any(|m| manifest.materials[m.0 as usize].double_sided);
            let bytes = hierarchy.memory_bytes();
            self.add_parts(manifest, number, objects, is_double_sided);
            return Some(bytes);
        }
        Some(hierarchy.memory_bytes())
    }

    fn add_parts(&mut self, manifest: &SceneManifest, hierarchy: usize, objects: &[ObjectId], is_double_sided: bool) {
        let mut leaves: Vec<(ObjectId, u32)> = (0..).zip(&manifest.leaves).map(|(leaf, of)| (of.object, leaf)).collect();
        leaves.sort_unstable();
        for object in objects {
            let start = leaves.partition_point(|(of, _)| of < object);
            let own = leaves[start..].iter().take_while(|(of, _)| of == object);
            let leaves = VisibleSet::from_ranges(own.map(|(_, leaf)| LeafRange::new(*leaf, leaf + 1)));
            self.parts.push(Part { object: *object, hierarchy, leaves, is_double_sided });
        }
        self.parts.sort_unstable_by_key(|part| part.object);
        self.count_parts();
    }

    /// Forgets a hierarchy: its objects are drawn from their leaves.
    pub fn forget(&mut self, number: u32) {
        if let Some(place) = self.hierarchies.get_mut(number as usize) {
            *place = None;
        }
        self.parts.retain(|part| part.hierarchy != number as usize);
        self.count_parts();
    }

    fn count_parts(&mut self) {
        self.covered = VisibleSet::from_ranges(self.parts.iter().flat_map(|part| part.leaves.ranges().iter().copied()));
        self.refinement.forget();
        self.course = OccluderCourse::default();
        self.has_changed = true;
    }

    /// Something stands elsewhere than in the frame before.
    pub fn note_moved(&mut self) {
        self.has_changed = true;
    }

    /// Finds the cuts of a frame, hands them to the renderer, and takes from what the views draw what they stand for. Nothing, where the frame
    /// orders none.
    pub fn find(
        &mut self,
        renderer: &mut Renderer,
        specs: &[ViewSpec],
        frame: &FrameToDraw,
        drawn: &mut [VisibleSet],
    ) -> Result<(), GpuError> {
        self.cuts.resize_with(specs.len(), Vec::new);
        self.cuts.iter_mut().for_each(Vec::clear);
        let (Some(detail), Some(primary)) = (&frame.detail, &frame.primary) else { return Ok(()) };
        if self.parts.is_empty() {
            return Ok(());
        }
        let is_known = self.found.as_ref().is_some_and(|(eye, of, by)| (eye, of, by) == (&frame.shared_eye, primary, detail));
        let from = self.course.at(frame.number);
        if !is_known || self.has_changed || (!self.is_final && from == Some(OccluderFrom::ThisFrame)) {
            self.refine(renderer.transforms(), frame.shared_eye, (primary, detail), from);
            let objects = self.parts.iter().zip(self.refinement.cuts()).filter_map(|(part, cut)| {
                let hierarchy = self.hierarchies[part.hierarchy].as_ref()?;
                let leaf = part.leaves.ranges().first()?.start;
                Some(CutObject { object: part.object, leaf, hierarchy, cut })
            });
            renderer.set_cuts(objects)?;
            match &mut self.found {
                Some((eye, of, by)) => {
                    (*eye, *by) = (frame.shared_eye, *detail);
                    of.clone_from(primary);
                }
                None => self.found = Some((frame.shared_eye, primary.clone(), *detail)),
            }
            self.has_changed = false;
        }
        self.choose(renderer.transforms(), specs, frame, drawn);
        let mut others = VisibleSet::default();
        for set in drawn {
            set.difference_into(&self.covered, &mut others);
            std::mem::swap(set, &mut others);
        }
        Ok(())
    }

    fn refine(
        &mut self,
        transforms: &[Transform],
        eye: DVec3,
        (primary, detail): (&Primary, &Detail),
        from: Option<OccluderFrom>,
    ) {
        let objects: Vec<LodObject<'_>> = (self.parts.iter())
            .filter_map(|part| {
                Some(LodObject {
                    hierarchy: self.hierarchies[part.hierarchy].as_ref()?,
                    world_from_local: transforms[part.object.0 as usize].affine(),
                    is_double_sided: part.is_double_sided,
                })
            })
            .collect();
        let sight =
            LodSight { eye, planes: &primary.planes, pixels_per_radian: primary.pixels_per_radian, near_m: NEAR_M as f32 };
        let options = LodOptions {
            budget: detail.triangles.unwrap_or(u32::MAX),
            least_pixels: detail.least_pixels,
            occluders: OCCLUDERS,
            odd_levels: false,
        };
        // A wall that looks all around has no picture of its own: nothing is taken to be hidden.
        let projection = if detail.hides { Projection::within(eye, &primary.planes, NEAR_M) } else { None };
        self.is_final = projection.is_none() || from == Some(OccluderFrom::ThisFrame);
        let occluder = projection.zip(from).map(|(projection, from)| {
            let occluder = self.occluder.get_or_insert_with(|| DepthOccluder::new(OCCLUDER_PX, BoundsKind::default()));
            occluder.look(&projection);
            (occluder as &mut dyn Occluder, from)
        });
        let is_drawn = occluder.as_ref().is_some_and(|(_, from)| *from == OccluderFrom::ThisFrame);
        self.refinement.refine(&objects, &sight, &options, occluder);
        if is_drawn {
            self.course.note(&self.refinement);
        }
    }

    /// Which objects each view draws by their cuts: those that any view of the node sees, where they are in its frustum. A cut may reach into
    /// a tile in which no leaf of the whole mesh is, but not out of the mesh's box.
    fn choose(&mut self, transforms: &[Transform], specs: &[ViewSpec], frame: &FrameToDraw, drawn: &[VisibleSet]) {
        for part in &self.parts {
            let Some(hierarchy) = self.hierarchies[part.hierarchy].as_ref() else { continue };
            if !drawn.iter().any(|set| set.meets(&part.leaves)) {
                continue;
            }
            let world_from_local = transforms[part.object.0 as usize].affine();
            let corners = hierarchy.local_aabb().corners().map(|corner| world_from_local.transform_point3(corner));
            for ((spec, view), cuts) in specs.iter().zip(&frame.views).zip(&mut self.cuts) {
                if may_see(&frustum(spec, view.eye, &frame.world_from_room), &corners) {
                    cuts.push(part.object);
                }
            }
        }
    }

    /// What a view draws by cuts, ascending.
    pub fn of_view(&self, place: usize) -> &[ObjectId] {
        self.cuts.get(place).map_or(&[], Vec::as_slice)
    }
}

fn frustum(spec: &ViewSpec, eye: DVec3, world_from_room: &DAffine3) -> Frustum {
    Frustum::through_rectangle(eye, spec.corners.map(DVec3::from), spec.near_m).transformed(world_from_room)
}

fn may_see(frustum: &Frustum, corners: &[DVec3; 8]) -> bool {
    frustum.planes.iter().all(|plane| corners.iter().any(|corner| plane.distance_m(*corner) >= 0.0))
}
