//! The planner of a frame: which leaves each view draws, in which order. Plain data out, results in; no GPU.
//!
//! Nothing in a plan depends on which other leaves are drawn: opaque and masked leaves come in ascending order, and
//! blended ones by their distance from the eye that all tiles of the wall share. A tile drawn from its visible set
//! is then the same picture as a tile drawn from all leaves.

mod completer;

use glam::DVec3;
use mullion_common::geometry::Aabb;
use mullion_common::scene::{AlphaMode, ChunkId, LeafRecord, ObjectId, SceneManifest, Transform};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Projection, ViewId};

use crate::missing::WhenMissing;
use crate::occlusion::unit::{Counts, Footprint};
use crate::occlusion::view::CulledView;
use crate::occlusion::worth::Worth;
use crate::occlusion::{Adaptive, BoxTest, Occlusion};
use crate::parts::Parts;
use crate::plp::{Estimate, Share};

pub use completer::Completer;

/// What the planner needs to know of one frame.
pub struct FrameInput<'a> {
    /// The views to draw.
    pub views: &'a [ViewInput<'a>],
    /// The eye from which blended leaves are sorted, in the world: the same for all tiles of a wall.
    pub shared_eye: DVec3,
    /// The scene.
    pub manifest: &'a SceneManifest,
    /// Where the objects stand in this frame, by `ObjectId`.
    pub transforms: &'a [Transform],
    /// Whether a chunk is on the GPU.
    pub resident: &'a dyn Fn(ChunkId) -> bool,
    /// What becomes of the views' missing leaves. All but boxes are left out.
    pub when_missing: WhenMissing,
    /// An object stands elsewhere than in the last frame, or is drawn otherwise.
    pub has_changed: bool,
}

/// What the planner needs to know of one view.
#[derive(Clone, Copy)]
#[allow(missing_docs)]
pub struct ViewInput<'a> {
    pub view: ViewId,
    pub projection: Projection,
    pub visible: &'a VisibleSet,
    /// Leaves of `visible` of which not all chunks have come: none of them is drawn as it is.
    pub missing: &'a VisibleSet,
    /// An estimate of what is visible, which limits what is drawn of opaque and masked leaves. Pictures change.
    pub estimate: Option<Estimate<'a>>,
    /// With [`Occlusion::Hiz`]: leaves to be drawn at once beside those that were seen last, and before any is known instead of all. The
    /// picture is the same.
    pub occluders: Option<&'a VisibleSet>,
    /// Objects that are drawn by their cuts, ascending. `visible` has none of their leaves.
    pub cuts: &'a [ObjectId],
}

impl<'a> ViewInput<'a> {
    /// A view of which all that it sees is drawn.
    pub fn new(view: ViewId, projection: Projection, visible: &'a VisibleSet, missing: &'a VisibleSet) -> Self {
        Self { view, projection, visible, missing, estimate: None, occluders: None, cuts: &[] }
    }
}

/// What to draw in one round. Executed by [`crate::gpu::Renderer::draw`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FramePlan {
    /// One after the other.
    pub passes: Vec<PassPlan>,
}

/// What to draw into one view.
#[derive(Clone, Debug, PartialEq)]
pub struct PassPlan {
    /// Where.
    pub view: ViewId,
    /// From where.
    pub projection: Projection,
    /// 0: the picture begins with this. Later rounds draw beyond what is there.
    pub round: u32,
    /// Opaque and masked leaves, drawn in ascending order.
    pub opaque: VisibleSet,
    /// Those of them that are not drawn whole. Needs [`crate::gpu::Renderer::keep_indices`].
    pub parts: Parts,
    /// With occlusion culling those of `opaque` that are drawn at once. The others, and blended ones, are drawn where their boxes are seen
    /// beyond these.
    pub first: Option<VisibleSet>,
    /// With occlusion culling leaves that are tested piece by piece if they wait. Needs [`crate::gpu::Renderer::keep_pieces`].
    pub in_pieces: VisibleSet,
    /// Tested against what this round draws, or in two turns against `first`.
    pub bounds: Vec<Bound>,
    /// Opaque and masked leaves of which a pixel is looked for once this round is drawn, where nothing is tested or counted then.
    pub look_for: VisibleSet,
    /// What is counted once this round is drawn.
    pub footprints: Vec<Footprint>,
    /// How boxes are tested, with occlusion culling.
    pub test: BoxTest,
    /// Whether it is told how long it took, though nothing is tested. It is waited for then.
    pub is_timed: bool,
    /// Objects that are drawn by their cuts whatever hides them, each in the place of its first leaf. Their leaves are in none of the other lists.
    /// Ascending.
    pub cuts: Vec<ObjectId>,
    /// Blended leaves, drawn in this order: back to front, ties by leaf.
    pub blended: Vec<u32>,
    /// Leaves drawn as boxes, whatever their material: opaque, after all that is opaque and before all that is blended. Ascending.
    pub boxes: Vec<u32>,
    /// Leaves left out: not all of their chunks are there, and no box is drawn for them.
    pub missing: u32,
}

/// What may be hidden as one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// A leaf's box.
    Leaf(u32),
    /// A box along the world's axes, metres.
    World(Aabb),
}

impl Bound {
    /// The box along the world's axes, if it is one.
    pub fn in_world(&self) -> Option<Aabb> {
        match self {
            Self::World(bounds) => Some(*bounds),
            Self::Leaf(_) => None,
        }
    }
}

/// What came of a plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassResults {
    /// For each pass.
    pub passes: Vec<PassResult>,
}

/// What came of one pass.
#[derive(Clone, Debug, PartialEq)]
pub struct PassResult {
    /// The view drawn.
    pub view: ViewId,
    /// Leaves drawn, boxes aside.
    pub leaves: u32,
    /// Boxes drawn.
    pub boxes: u32,
    /// Triangles drawn, those of boxes among them.
    pub triangles: u64,
    /// Triangles of leaves that waited, and are hidden.
    pub hidden_triangles: u64,
    /// Runs of leaves drawn with one state.
    pub batches: u32,
    /// With occlusion culling what the next frame had better begin with: leaves of which there is a pixel with [`BoxTest::Sifted`], else, and
    /// blended ones, leaves whose boxes are seen beyond what was drawn at once. Of a round, what was looked for and has a pixel.
    pub seen: Option<VisibleSet>,
    /// And of what waited, what was drawn.
    pub late: VisibleSet,
    /// Of each of the plan's bounds whether it is seen beyond what it is tested against, or could not be tested.
    pub bounds_seen: Vec<bool>,
    /// Of each of the plan's footprints.
    pub counts: Vec<Counts>,
    /// With occlusion culling, or where it was asked for, if the GPU has a clock.
    pub times: Option<Times>,
}

/// What a pass took, microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// To list, to encode and to hand over, by the CPU's clock; where all passes of a plan are measured, its share of all else, too.
    pub plan_us: f64,
    /// To draw, by the GPU's clock.
    pub draw_us: f64,
    /// To test boxes, by the GPU's clock.
    pub test_us: f64,
}

impl std::ops::AddAssign for Times {
    fn add_assign(&mut self, other: Self) {
        self.plan_us += other.plan_us;
        self.draw_us += other.draw_us;
        self.test_us += other.test_us;
    }
}

impl Times {
    /// Of CPU and GPU, one after the other.
    pub fn all_us(&self) -> f64 {
        self.plan_us + self.draw_us + self.test_us
    }
}

/// Plans frames. Keeps its memory from frame to frame.
#[derive(Debug, Default)]
pub struct Planner {
    plan: FramePlan,
    spare_passes: Vec<PassPlan>,
    /// Squared distance and leaf.
    keyed: Vec<(f64, u32)>,
    occlusion: Occlusion,
    worth: Option<Worth>,
    adaptive: Option<Adaptive>,
    culled: Vec<CulledView>,
}

impl Planner {
    /// A planner that has planned nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same with occlusion culling.
    #[must_use]
    pub fn culling(self, occlusion: Occlusion) -> Self {
        Self { occlusion, ..self }
    }

    /// The same, but what hardly contributes is left out too. Pictures change.
    #[must_use]
    pub fn adaptive(self, adaptive: Adaptive) -> Self {
        Self { occlusion: Occlusion::Adaptive, adaptive: Some(adaptive), ..self }
    }

    /// The same, but where occlusion culling costs more than it saves it is left off for a while, by what it
    /// takes with and without. Of [`Occlusion::Hiz`] alone.
    #[must_use]
    pub fn while_worth(self) -> Self {
        Self { worth: Some(Worth::default()), ..self }
    }

    /// Starts a frame and returns its first round. A frame that was not complete is dropped.
    pub fn begin(&mut self, input: FrameInput<'_>) -> &FramePlan {
        self.spare_passes.append(&mut self.plan.passes);
        for view in input.views {
            let mut pass = self.plan_pass(&input, view);
            if self.occlusion == Occlusion::Off {
                pass.first = None;
            } else {
                let at = self.culled.iter().position(|culled| culled.view() == view.view).unwrap_or_else(|| {
                    self.culled.push(CulledView::new(view.view, self.occlusion, self.worth, self.adaptive));
                    self.culled.len() - 1
                });
                self.culled[at].begin(&input, &mut pass);
            }
            self.plan.passes.push(pass);
        }
        &self.plan
    }

    /// Takes the results of the last round and returns the next, or `None` when the frame is complete.
    pub fn feed(&mut self, results: &PassResults) -> Option<&FramePlan> {
        debug_assert_eq!(results.passes.len(), self.plan.passes.len(), "results of another plan");
        let mut at = 0;
        for result in &results.passes {
            let culled = self.culled.iter_mut().find(|culled| culled.view() == result.view);
            if culled.is_some_and(|culled| culled.go_on(result, &mut self.plan.passes[at])) {
                at += 1;
            } else {
                self.spare_passes.push(self.plan.passes.remove(at));
            }
        }
        (!self.plan.passes.is_empty()).then_some(&self.plan)
    }

    fn plan_pass(&mut self, input: &FrameInput<'_>, view: &ViewInput<'_>) -> PassPlan {
        let mut pass = self.spare_passes.pop().unwrap_or_else(|| PassPlan::new(view.view, view.projection));
        (pass.view, pass.projection, pass.missing) = (view.view, view.projection, 0);
        pass.round = 0;
        pass.is_timed = false;
        pass.opaque.clear();
        pass.parts.clear();
        pass.in_pieces.clear();
        pass.bounds.clear();
        pass.look_for.clear();
        pass.footprints.clear();
        pass.cuts.clear();
        pass.cuts.extend_from_slice(view.cuts);
        pass.blended.clear();
        pass.boxes.clear();
        self.keyed.clear();
        let leaf_count = input.manifest.leaves.len() as u32;
        let mut shares = view.estimate.map(Estimate::shares);
        for leaf in view.visible.leaves().take_while(|&leaf| leaf < leaf_count) {
            let record = &input.manifest.leaves[leaf as usize];
            let share = shares.as_mut().map_or(Share::All, |shares| shares.of(leaf));
            if share == Share::None {
                continue;
            }
            if !view.missing.is_empty() && view.missing.contains(leaf) {
                match input.when_missing {
                    WhenMissing::Box => pass.boxes.push(leaf),
                    WhenMissing::Hold | WhenMissing::Nothing => pass.missing += 1,
                }
                continue;
            }
            if !(input.resident)(record.chunk) {
                pass.missing += 1;
                continue;
            }
            match input.manifest.materials[record.material.0 as usize].alpha {
                AlphaMode::Blend => self.keyed.push((distance_squared(input, record), leaf)),
                AlphaMode::Opaque | AlphaMode::Mask { .. } => {
                    pass.opaque.push(LeafRange::new(leaf, leaf + 1));
                    if let (Share::Some(place), Some(estimate)) = (share, view.estimate) {
                        pass.parts.push(leaf, estimate.triangles(place));
                    }
                }
            }
        }
        self.keyed.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        pass.blended.extend(self.keyed.iter().map(|&(_, leaf)| leaf));
        pass
    }
}

impl PassPlan {
    /// Whether it is drawn in rounds.
    pub fn is_round(&self) -> bool {
        self.round > 0 || !self.bounds.is_empty() || !self.footprints.is_empty() || !self.look_for.is_empty()
    }

    /// A pass that draws nothing.
    pub fn new(view: ViewId, projection: Projection) -> Self {
        Self {
            view,
            projection,
            round: 0,
            opaque: VisibleSet::default(),
            parts: Parts::default(),
            first: None,
            in_pieces: VisibleSet::default(),
            bounds: Vec::new(),
            look_for: VisibleSet::default(),
            footprints: Vec::new(),
            test: BoxTest::Drawn,
            is_timed: false,
            cuts: Vec::new(),
            blended: Vec::new(),
            boxes: Vec::new(),
            missing: 0,
        }
    }
}

/// From the shared eye to the middle of the leaf's box.
fn distance_squared(input: &FrameInput<'_>, leaf: &LeafRecord) -> f64 {
    let world_from_local = input.transforms[leaf.object.0 as usize].affine();
    world_from_local.transform_point3(leaf.local_aabb().center()).distance_squared(input.shared_eye)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DMat4};
    use mullion_common::scene::{ChunkHash, ChunkKind, ChunkRecord, Filter, Material, MaterialId, ObjectId, TextureRef, Wrap};

    /// Chunk 0 is a texture; leaf `i` has chunk `i + 1`, object `i` and its place along −Z, and a material.
    fn manifest(leaves: &[(f64, AlphaMode, bool)]) -> SceneManifest {
        let mut manifest = SceneManifest::default();
        let record = |kind| ChunkRecord::new(ChunkHash([0; 32]), 0, 0, kind);
        manifest.chunks.push(record(ChunkKind::Texture));
        for (i, &(distance_m, alpha, textured)) in leaves.iter().enumerate() {
            let texture = TextureRef { chunk: ChunkId(0), wrap_u: Wrap::Repeat, wrap_v: Wrap::Clamp, filter: Filter::Linear };
            manifest.chunks.push(record(ChunkKind::Geometry));
            manifest.transforms.push(DAffine3::from_translation(DVec3::new(0.0, 0.0, -distance_m)).into());
            let texture = textured.then_some(texture);
            manifest.materials.push(Material { base_color: [1.0; 4], texture, alpha, double_sided: false });
            manifest.leaves.push(LeafRecord {
                object: ObjectId(i as u32),
                chunk: ChunkId(i as u32 + 1),
                material: MaterialId(i as u32),
                triangle_count: 1,
                local_min: [-1.0, -2.0, -3.0],
                local_max: [1.0, 2.0, 3.0],
            });
        }
        manifest
    }

    fn plan(
        planner: &mut Planner,
        manifest: &SceneManifest,
        visible: &VisibleSet,
        resident: &dyn Fn(ChunkId) -> bool,
    ) -> FramePlan {
        plan_without(planner, manifest, visible, resident, (WhenMissing::Hold, &VisibleSet::default()))
    }

    fn plan_without(
        planner: &mut Planner,
        manifest: &SceneManifest,
        visible: &VisibleSet,
        resident: &dyn Fn(ChunkId) -> bool,
        (when_missing, missing): (WhenMissing, &VisibleSet),
    ) -> FramePlan {
        let projection = Projection { eye: DVec3::new(5.0, 0.0, 0.0), clip_from_offset: DMat4::IDENTITY };
        let views = [ViewInput::new(ViewId(3), projection, visible, missing)];
        let transforms = &manifest.transforms;
        let shared_eye = DVec3::ZERO;
        planner
            .begin(FrameInput { views: &views, shared_eye, manifest, transforms, resident, when_missing, has_changed: true })
            .clone()
    }

    const MASK: AlphaMode = AlphaMode::Mask { cutoff: 0.5 };

    #[test]
    fn opaque_leaves_ascend_and_blended_ones_come_back_to_front() {
        let scene = manifest(&[
            (2.0, AlphaMode::Blend, false),
            (9.0, AlphaMode::Opaque, false),
            (7.0, AlphaMode::Blend, false),
            (1.0, MASK, false),
            (2.0, AlphaMode::Blend, false), // as far as leaf 0
            (8.0, AlphaMode::Blend, false),
        ]);
        let mut planner = Planner::new();
        let all = VisibleSet::all(6);
        let of_all = plan(&mut planner, &scene, &all, &|_| true);
        assert_eq!(of_all.passes[0].view, ViewId(3));
        assert_eq!(of_all.passes[0].opaque.leaves().collect::<Vec<_>>(), [1, 3]);
        assert_eq!(of_all.passes[0].blended, [5, 2, 0, 4]);
        assert_eq!(of_all.passes[0].missing, 0);

        // A subset keeps the order of the rest; the planner's memory leaves no trace.
        let some = VisibleSet::from_ranges([LeafRange::new(2, 5)]);
        let of_some = plan(&mut planner, &scene, &some, &|_| true);
        assert_eq!(of_some.passes[0].blended, [2, 4]);
        assert_eq!(of_some.passes[0].opaque.leaves().collect::<Vec<_>>(), [3]);
        assert_eq!(plan(&mut planner, &scene, &all, &|_| true), of_all);
        assert_eq!(planner.feed(&PassResults { passes: vec![result(); 1] }), None);
    }

    fn result() -> PassResult {
        PassResult {
            view: ViewId(3),
            leaves: 6,
            boxes: 0,
            triangles: 6,
            hidden_triangles: 0,
            batches: 2,
            seen: None,
            late: VisibleSet::default(),
            bounds_seen: Vec::new(),
            counts: Vec::new(),
            times: None,
        }
    }

    #[test]
    fn leaves_without_geometry_are_left_out_and_counted() {
        let scene = manifest(&[(1.0, AlphaMode::Opaque, true), (2.0, AlphaMode::Blend, true), (3.0, MASK, false)]);
        let mut planner = Planner::new();
        let beyond = VisibleSet::all(9); // leaves past the table are ignored
        let found = plan(&mut planner, &scene, &beyond, &|chunk| chunk.0 == 2);
        assert_eq!(found.passes[0].missing, 2);
        assert_eq!(found.passes[0].blended, [1]);
        assert!(found.passes[0].opaque.is_empty());
        assert_eq!(plan(&mut planner, &scene, &VisibleSet::default(), &|_| true).passes[0].missing, 0);
    }

    #[test]
    fn missing_leaves_are_boxes_or_left_out_and_the_others_as_they_were() {
        let scene = manifest(&[
            (2.0, AlphaMode::Blend, false),
            (9.0, AlphaMode::Opaque, false),
            (7.0, AlphaMode::Blend, true),
            (1.0, MASK, true),
            (4.0, AlphaMode::Opaque, true),
        ]);
        let mut planner = Planner::new();
        let (all, missing) = (VisibleSet::all(5), VisibleSet::from_ranges([LeafRange::new(2, 4)]));
        let there = |chunk: ChunkId| chunk.0 != 4; // leaf 3's geometry; of leaf 2 only the texture lacks
        let boxes = plan_without(&mut planner, &scene, &all, &there, (WhenMissing::Box, &missing)).passes.remove(0);
        assert_eq!((boxes.boxes.as_slice(), boxes.missing), ([2, 3].as_slice(), 0));
        let nothing = plan_without(&mut planner, &scene, &all, &there, (WhenMissing::Nothing, &missing)).passes.remove(0);
        assert_eq!((nothing.boxes.as_slice(), nothing.missing), ([].as_slice(), 2));
        for pass in [boxes, nothing] {
            assert_eq!(pass.opaque.leaves().collect::<Vec<_>>(), [1, 4]);
            assert_eq!(pass.blended, [0]);
        }
    }

    #[test]
    fn moved_objects_are_sorted_where_they_stand() {
        let scene = manifest(&[(1.0, AlphaMode::Blend, false), (2.0, AlphaMode::Blend, false)]);
        let moved = [scene.transforms[1], scene.transforms[0]];
        let projection = Projection { eye: DVec3::ZERO, clip_from_offset: DMat4::IDENTITY };
        let visible = VisibleSet::all(2);
        let missing = VisibleSet::default();
        let views = [ViewInput::new(ViewId(0), projection, &visible, &missing)];
        let mut planner = Planner::new();
        let input = FrameInput {
            views: &views,
            shared_eye: DVec3::ZERO,
            manifest: &scene,
            transforms: &moved,
            resident: &|_| true,
            when_missing: WhenMissing::Hold,
            has_changed: true,
        };
        assert_eq!(planner.begin(input).passes[0].blended, [0, 1]);
    }
}
