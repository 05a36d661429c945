//! Level of detail on a node: from the hierarchies that have come and a frame's order to the cuts that its views draw in place of leaves.
//!
//! All nodes refine for all of the wall, from the shared eye and into the primary frustum, and what they find is a function of these and of an
//! occluder that all draw in the same frames: so an object across a seam has the same vertices on both sides. Nodes differ where blobs are
//! still to come, or have no room, and until the occluder is drawn anew where one missed the frame that drew or renewed it.

use glam::{DAffine3, DVec3};
use mullion_common::geometry::Frustum;
use mullion_common::scene::{AlphaMode, Hierarchy, Material, ObjectId, Presence, SceneManifest, Transform};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::Projection;
use mullion_common::wire::{Detail, Primary, ViewSpec};

use crate::gpu::{CutObject, GpuError, Renderer};
use crate::lod::{
    BoundsKind, DepthOccluder, KeptOccluder, LodObject, LodOptions, LodSight, OCCLUDER_PX, Refinement, Tessellated,
};
use crate::tile_session::FrameToDraw;

/// After so many splits the occluder is drawn: the paper's two (section 4), and on for cuts that are larger than the paper's.
const OCCLUDERS: [u32; 4] = [300, 2500, 20_000, 160_000];
/// No node counts as nearer than this, metres.
const NEAR_M: f64 = 1e-3;

/// What a painter keeps of it.
#[derive(Default)]
pub(crate) struct Detailing {
    /// By number, as far as they have come.
    hierarchies: Vec<Option<Hierarchy>>,
    /// By object, ascending.
    parts: Vec<Part>,
    /// All leaves, by object; made when the first hierarchy comes.
    by_object: Vec<(ObjectId, u32)>,
    /// Leaves of all parts, if they are the same as when that was found.
    covered: Option<VisibleSet>,
    refinement: Refinement,
    /// Empty between refinements: their memory.
    objects: Vec<LodObject<'static>>,
    occluder: Option<KeptOccluder>,
    /// Whether the cuts were found with an occluder of their own view, or nothing could hide.
    is_final: bool,
    /// By place of the view.
    frusta: Vec<Frustum>,
    /// By place of the view: the objects that are drawn by their cuts.
    cuts: Vec<Vec<ObjectId>>,
    /// All of them, ascending; and those whose cuts are on the GPU.
    named: Vec<ObjectId>,
    staged: Vec<ObjectId>,
    /// Hierarchies have come or gone, or objects have moved, come or gone.
    has_changed: bool,
    /// For what the cuts were found.
    found: Option<(DVec3, Primary, Detail)>,
    others: VisibleSet,
}

/// An object that a hierarchy stands for.
struct Part {
    object: ObjectId,
    hierarchy: usize,
    leaves: VisibleSet,
    is_double_sided: bool,
    is_solid: bool,
    /// In the frame that was found last.
    presence: Presence,
}

impl Part {
    /// Its first one.
    fn leaf(&self) -> Option<u32> {
        self.leaves.ranges().first().map(|range| range.start)
    }

    /// Whether a frame has it in the scene and draws it: its leaves go together.
    fn presence_in(&self, frame: &FrameToDraw) -> Presence {
        let is_away = self.leaf().is_some_and(|leaf| frame.away.contains(leaf) || frame.dropped.contains(leaf));
        if is_away { Presence::Away } else { Presence::There }
    }
}

impl Detailing {
    /// Takes the next blob of a hierarchy; how many bytes it takes now, or `None` where the blob is none of its, or it cannot be drawn: then it is
    /// forgotten.
    pub fn take(&mut self, manifest: &SceneManifest, (number, objects): (u32, &[ObjectId]), blob: &[u8]) -> Option<u64> {
        let at = number as usize;
        self.hierarchies.resize_with(self.hierarchies.len().max(at + 1), || None);
        self.has_changed = true;
        let place = &mut self.hierarchies[at];
        let taken = match place {
            Some(hierarchy) => hierarchy.decode_block(blob),
            None => Hierarchy::decode_base(blob, manifest.materials.len() as u32).map(|base| *place = Some(base)),
        };
        if let Err(error) = taken {
            tracing::warn!("hierarchy {number}: {error}");
            self.forget(number);
            return None;
        }
        let hierarchy = place.as_ref()?;
        let bytes = hierarchy.memory_bytes();
        if hierarchy.block_count() == 0 {
            let materials: Vec<&Material> = hierarchy.materials().iter().map(|m| &manifest.materials[m.0 as usize]).collect();
            // Cuts are drawn among solid leaves.
            if materials.iter().any(|material| material.alpha == AlphaMode::Blend) {
                tracing::warn!("hierarchy {number}: of a material that blends");
                self.forget(number);
                return None;
            }
            let is_double_sided = materials.iter().any(|material| material.double_sided);
            let is_solid = materials.iter().all(|material| material.alpha == AlphaMode::Opaque);
            self.add_parts(manifest, at, objects, (is_double_sided, is_solid));
        }
        Some(bytes)
    }

    fn add_parts(
        &mut self,
        manifest: &SceneManifest,
        hierarchy: usize,
        objects: &[ObjectId],
        (is_double_sided, is_solid): (bool, bool),
    ) {
        if self.by_object.len() != manifest.leaves.len() {
            self.by_object.clear();
            self.by_object.extend((0..).zip(&manifest.leaves).map(|(leaf, of)| (of.object, leaf)));
            self.by_object.sort_unstable();
        }
        for object in objects {
            let start = self.by_object.partition_point(|(of, _)| of < object);
            let own = self.by_object[start..].iter().take_while(|(of, _)| of == object);
            let leaves = VisibleSet::from_ranges(own.map(|(_, leaf)| LeafRange::new(*leaf, leaf + 1)));
            let at = self.parts.partition_point(|part| part.object < *object);
            let presence = Presence::There;
            self.parts.insert(at, Part { object: *object, hierarchy, leaves, is_double_sided, is_solid, presence });
        }
        self.note_parts();
    }

    /// Forgets a hierarchy: its objects are drawn from their leaves.
    pub fn forget(&mut self, number: u32) {
        if let Some(place) = self.hierarchies.get_mut(number as usize) {
            *place = None;
        }
        self.parts.retain(|part| part.hierarchy != number as usize);
        self.note_parts();
    }

    fn note_parts(&mut self) {
        self.covered = None;
        self.refinement.forget();
        if let Some(occluder) = &mut self.occluder {
            occluder.forget();
        }
        self.has_changed = true;
    }

    /// An object stands elsewhere than in the frame before.
    pub fn note_moved(&mut self, object: ObjectId) {
        self.has_changed |= self.parts.binary_search_by_key(&object, |part| part.object).is_ok();
    }

    /// Whether the frame that was found last would be found the same again, as long as nothing comes and nothing moves.
    pub fn is_final(&self) -> bool {
        self.is_final || self.named.is_empty()
    }

    /// Finds the cuts of a frame, hands them to the renderer, and takes from what the views draw what they stand for. Nothing, where the frame
    /// orders none.
    ///
    /// # Errors
    /// When the GPU cannot take the cuts.
    pub fn find(
        &mut self,
        renderer: &mut Renderer,
        tessellated: Option<Tessellated<'_>>,
        specs: &[ViewSpec],
        frame: &FrameToDraw,
        drawn: &mut [VisibleSet],
    ) -> Result<(), GpuError> {
        self.cuts.resize_with(specs.len(), Vec::new);
        self.cuts.iter_mut().for_each(Vec::clear);
        self.named.clear();
        let (Some(detail), Some(primary)) = (&frame.detail, &frame.primary) else { return Ok(()) };
        if self.parts.is_empty() {
            return Ok(());
        }
        self.note_presence(frame);
        self.choose(renderer, specs, frame);
        let is_known = self.found.as_ref().is_some_and(|(eye, of, by)| (eye, of, by) == (&frame.shared_eye, primary, detail));
        let has_turn = self.occluder.as_ref().is_none_or(|occluder| occluder.has_turn(frame.number));
        let is_found = is_known && !self.has_changed && (self.is_final || !has_turn);
        if !is_found {
            if let Some(occluder) = self.occluder.as_mut().filter(|_| is_known && has_turn) {
                // The view rests: what is found now is final, and all nodes find it.
                occluder.draw_anew();
            }
            self.refine((renderer.transforms(), tessellated), frame, (primary, detail));
        }
        if !is_found || self.named != self.staged {
            let objects = self.parts.iter().zip(self.refinement.cuts()).filter_map(|(part, cut)| {
                self.named.binary_search(&part.object).ok()?;
                let hierarchy = self.hierarchies[part.hierarchy].as_ref()?;
                Some(CutObject { object: part.object, leaf: part.leaf()?, hierarchy, cut })
            });
            renderer.set_cuts(objects)?;
            self.staged.clone_from(&self.named);
        }
        self.take_covered(frame, drawn);
        Ok(())
    }

    fn refine(
        &mut self,
        (transforms, tessellated): (&[Transform], Option<Tessellated<'_>>),
        frame: &FrameToDraw,
        (primary, detail): (&Primary, &Detail),
    ) {
        let mut objects = emptied(std::mem::take(&mut self.objects));
        objects.extend(self.parts.iter().filter_map(|part| {
            Some(LodObject {
                id: part.object,
                hierarchy: self.hierarchies[part.hierarchy].as_ref()?,
                world_from_local: transforms[part.object.0 as usize].affine(),
                is_double_sided: part.is_double_sided,
                is_solid: part.is_solid,
                presence: part.presence,
                weight: 1.0,
            })
        }));
        let sight = LodSight {
            eye: frame.shared_eye,
            planes: &primary.planes,
            pixels_per_radian: primary.pixels_per_radian,
            near_m: NEAR_M as f32,
        };
        let options = LodOptions {
            budget: detail.triangles.unwrap_or(u32::MAX),
            least_pixels: detail.least_pixels,
            occluders: OCCLUDERS,
            odd_levels: false,
        };
        // A wall that looks all around has no picture of its own: nothing is taken to be hidden.
        let projection = if detail.hides { Projection::within(frame.shared_eye, &primary.planes, NEAR_M) } else { None };
        self.is_final = match &projection {
            Some(projection) => {
                let depths = || KeptOccluder::new(DepthOccluder::new([OCCLUDER_PX; 2], BoundsKind::default()));
                let view = (projection, frame.number);
                let occluder = self.occluder.get_or_insert_with(depths);
                occluder.refine(&mut self.refinement, &mut objects, (&sight, &options), view, (detail.weight, tessellated))
            }
            None => {
                self.refinement.refine(&objects, &sight, &options, None);
                true
            }
        };
        self.objects = emptied(objects);
        self.has_changed = false;
        match &mut self.found {
            Some((eye, of, by)) => {
                (*eye, *by) = (frame.shared_eye, *detail);
                of.clone_from(primary);
            }
            None => self.found = Some((frame.shared_eye, primary.clone(), *detail)),
        }
    }

    /// Which objects come into the scene with a frame, or go.
    fn note_presence(&mut self, frame: &FrameToDraw) {
        for part in &mut self.parts {
            let presence = part.presence_in(frame);
            self.has_changed |= std::mem::replace(&mut part.presence, presence) != presence;
        }
    }

    /// Which objects each view draws by their cuts: those that are there, where they are in its frustum and nothing of them is missing. A cut may
    /// reach into a tile in which no leaf of the whole mesh is, but not out of the mesh's box: so leaves do not tell who sees it.
    fn choose(&mut self, renderer: &Renderer, specs: &[ViewSpec], frame: &FrameToDraw) {
        self.frusta.clear();
        let views = specs.iter().zip(&frame.views);
        self.frusta.extend(views.map(|(spec, view)| frustum(spec, view.eye, &frame.world_from_room)));
        for part in self.parts.iter().filter(|part| part.presence == Presence::There) {
            let Some(hierarchy) = self.hierarchies[part.hierarchy].as_ref() else { continue };
            let has_textures = renderer.has_textures(hierarchy.materials());
            let world_from_local = renderer.transforms()[part.object.0 as usize].affine();
            let corners = hierarchy.local_aabb().corners().map(|corner| world_from_local.transform_point3(corner));
            for ((frustum, view), cuts) in self.frusta.iter().zip(&frame.views).zip(&mut self.cuts) {
                // A view that sees no leaf of it lacks none, and may lack a texture.
                let is_whole = (has_textures || view.leaves.meets(&part.leaves)) && !view.missing.meets(&part.leaves);
                if is_whole && may_see(frustum, &corners) {
                    cuts.push(part.object);
                    if self.named.last() != Some(&part.object) {
                        self.named.push(part.object);
                    }
                }
            }
        }
    }

    /// Takes leaves that cuts stand for; those of objects of which something is missing stay, to be drawn as what is missing is.
    fn take_covered(&mut self, frame: &FrameToDraw, drawn: &mut [VisibleSet]) {
        let parts = &self.parts;
        let covered = self
            .covered
            .get_or_insert_with(|| VisibleSet::from_ranges(parts.iter().flat_map(|part| part.leaves.ranges().iter().copied())));
        for (set, view) in drawn.iter_mut().zip(&frame.views) {
            set.difference_into(covered, &mut self.others);
            if view.missing.meets(covered) {
                let lacking = parts.iter().filter(|part| view.missing.meets(&part.leaves));
                for leaf in lacking.flat_map(|part| part.leaves.leaves()).filter(|leaf| set.contains(*leaf)) {
                    self.others.push_unordered(LeafRange::new(leaf, leaf + 1));
                }
                self.others.normalize();
            }
            std::mem::swap(set, &mut self.others);
        }
    }

    /// What a view draws by cuts, ascending.
    pub fn of_view(&self, place: usize) -> &[ObjectId] {
        self.cuts.get(place).map_or(&[], Vec::as_slice)
    }
}

/// The memory of objects, for others: collecting in place keeps it.
fn emptied<'a>(objects: Vec<LodObject<'_>>) -> Vec<LodObject<'a>> {
    objects.into_iter().map_while(|_| None).collect()
}

fn frustum(spec: &ViewSpec, eye: DVec3, world_from_room: &DAffine3) -> Frustum {
    Frustum::through_rectangle(eye, spec.corners.map(DVec3::from), spec.near_m).transformed(world_from_room)
}

fn may_see(frustum: &Frustum, corners: &[DVec3; 8]) -> bool {
    frustum.planes.iter().all(|plane| corners.iter().any(|corner| plane.distance_m(*corner) >= 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_objects_is_kept() {
        let objects: Vec<LodObject<'_>> = Vec::with_capacity(9);
        let memory = objects.as_ptr().addr();
        let others = emptied(objects);
        assert_eq!((others.as_ptr().addr(), others.capacity()), (memory, 9));
    }
}
