//! A pass with occlusion culling: what was planned to be first is drawn, then what is seen beyond it. Every pixel is as without.

use mullion_common::geometry::Aabb;
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::device::GpuError;
use super::occlusion::{BoxTester, Buffers, First};
use super::pipelines::{Coverage, Turn};
use super::renderer::{Load, Renderer};
use super::test_box::{Grower, LocalScale, TestBox};
use super::timer::{Pass, Timer};
use crate::frame::{PassPlan, PassResult, Times};
use crate::occlusion::BoxTest;

/// What a renderer keeps for it.
#[derive(Default)]
pub(super) struct Culling {
    /// Looked for when a plan first wants it.
    pub tester: Option<BoxTester>,
    /// Opaque leaves that wait.
    late: VisibleSet,
    pub boxes: Vec<TestBox>,
    pub seen: Vec<u32>,
}

/// Leaves are tested piece by piece as long as there are no more boxes than this.
const MOST_BOXES: usize = 1 << 16;

/// What the GPU says of a draw.
const BOX_IS_SEEN: u32 = 1;
pub(super) const HAS_PIXEL: u32 = 2;

/// A draw whose box was tested, or need not be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tested {
    leaf: u32,
    triangles: u32,
    is_late: bool,
    /// Whatever the GPU says of it.
    is_seen: bool,
    /// Whether its pixels can be looked for: blended leaves leave no ids.
    has_id: bool,
}

impl Renderer {
    /// Makes what a target needs to be drawn with occlusion culling, once. The GPU must be one that can.
    pub(super) fn prepare_culling(&mut self, at: usize) -> Result<(), GpuError> {
        if self.culling.tester.is_none() {
            let tester = BoxTester::new(&self.gpu);
            if let Some(tester) = &tester {
                self.pipelines.add_culled(&self.gpu, &tester.first_layout);
            }
            self.culling.tester = tester;
        }
        if let Some(tester) = &mut self.culling.tester {
            let target = &mut self.targets[at];
            target.first.get_or_insert_with(|| First::new(&self.gpu, tester, target.size_px));
            tester.glancer.reserve(&self.gpu, self.manifest.leaves.len())?;
        }
        Ok(())
    }

    /// Draws one pass of a target that is prepared. All that is listed counts as drawn until [`Renderer::note_seen`].
    pub(super) fn draw_culled(&mut self, at: usize, pass: &PassPlan, first: &VisibleSet) -> Result<PassResult, GpuError> {
        let (late_draws, late_batches) = self.list_turns(pass, first);
        let boxes = self.list_boxes_to_test(at, pass, late_draws);
        let draws = self.list.arguments.len() as u32;
        let boxes = self.list_bounds(at, pass, boxes, draws);
        self.hand_over(at, pass, true)?;
        self.hand_over_boxes(at, boxes, draws + pass.bounds.len() as u32)?;
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("pass") });
        let load = if pass.round == 0 { Load::Clear } else { Load::Keep };
        self.encode(&self.targets[at], &mut encoder, (load, Some(Pass::Draws)), 0..late_batches);
        self.encode_tests(at, &mut encoder, pass.test, true);
        let late = late_batches..self.list.batches.len();
        self.encode(&self.targets[at], &mut encoder, (Load::Keep, Some(Pass::Second)), late);
        let picture = self.picture();
        if let (BoxTest::Sifted, Some(tester)) = (pass.test, &self.culling.tester) {
            tester.encode_glance(&self.gpu, &mut encoder, &mut self.targets[at], picture);
        }
        self.encode_answers(at, &mut encoder);
        self.encode_times(at, &mut encoder, 2);
        self.last_submission = Some(self.gpu.submit(Some(encoder.finish())));
        Ok(self.result(pass))
    }

    /// Hands a target's boxes to the GPU, which is to tell of so many things whether they are seen. Keeps their memory.
    pub(super) fn hand_over_boxes(&mut self, at: usize, boxes: Vec<TestBox>, asked: u32) -> Result<(), GpuError> {
        let first = self.targets[at].first.as_mut();
        let written = first.map_or(Ok(()), |first| first.write(&self.gpu, &boxes, asked));
        self.culling.boxes = boxes;
        written
    }

    /// Tests the boxes that were handed over for a target.
    pub(super) fn encode_tests(&mut self, at: usize, encoder: &mut wgpu::CommandEncoder, test: BoxTest, have_late: bool) {
        let Some(tester) = &self.culling.tester else { return };
        let picture = if test == BoxTest::Sifted { self.picture() } else { 0 };
        let buffers = Buffers { records: &self.buffers.records, arguments: &self.buffers.arguments, have_late, picture };
        tester.encode(&self.gpu, encoder, &mut self.targets[at], buffers, test);
    }

    /// Looks for leaves that have a pixel, where nothing was tested before.
    pub(super) fn encode_look(&mut self, at: usize, encoder: &mut wgpu::CommandEncoder) {
        let picture = self.picture();
        let Some(tester) = &self.culling.tester else { return };
        let buffers = Buffers { records: &self.buffers.records, arguments: &self.buffers.arguments, have_late: false, picture };
        tester.ready(&self.gpu, encoder, &mut self.targets[at], buffers, BoxTest::Sifted);
        tester.encode_glance(&self.gpu, encoder, &mut self.targets[at], picture);
    }

    /// What this pass's picture is called among leaves that have a pixel: never 0.
    fn picture(&self) -> u32 {
        (self.pass as u32).max(1)
    }

    /// Fetches what came of all tests.
    pub(super) fn encode_answers(&self, at: usize, encoder: &mut wgpu::CommandEncoder) {
        self.targets[at].first.as_ref().inspect(|first| first.fetch(encoder));
    }

    pub(super) fn encode_times(&self, at: usize, encoder: &mut wgpu::CommandEncoder, passes: u32) {
        self.targets[at].timer.as_ref().inspect(|timer| timer.resolve(encoder, passes));
    }

    /// Waits until a target is drawn, takes what was not from its result, and tells what is seen.
    pub(super) fn note_seen(&mut self, at: usize, test: BoxTest, result: &mut PassResult) -> Result<(), GpuError> {
        let by_pixels = test == BoxTest::Sifted;
        let target = &self.targets[at];
        let Some(first) = &target.first else { return Ok(()) };
        target.timer.as_ref().inspect(|timer| timer.ask());
        first.read_seen(&self.gpu, &mut self.culling.seen)?;
        let times = target.timer.as_ref().map(Timer::times_us).transpose()?;
        let times = times.map(|[first, tested, all]| Times {
            draw_us: first + all - tested,
            test_us: tested - first,
            ..Times::default()
        });
        result.times = times;
        let (mut seen, mut late) = (VisibleSet::default(), VisibleSet::default());
        for (tested, word) in first.tested.iter().zip(&self.culling.seen) {
            let Some(Tested { leaf, triangles, is_late, is_seen, has_id }) = *tested else { continue };
            let leaves = LeafRange::new(leaf, leaf + 1);
            let box_is_seen = is_seen || word & BOX_IS_SEEN != 0;
            if is_seen || if by_pixels && has_id { word & HAS_PIXEL != 0 } else { box_is_seen } {
                seen.push_unordered(leaves);
            }
            if is_late && box_is_seen {
                late.push_unordered(leaves);
            } else if is_late {
                result.leaves -= 1;
                result.triangles -= u64::from(triangles);
                result.hidden_triangles += u64::from(triangles);
            }
        }
        let of_bounds = self.culling.seen.iter().skip(first.tested.len()).zip(&first.untested);
        result.bounds_seen.extend(of_bounds.map(|(word, is_untested)| word & BOX_IS_SEEN != 0 || *is_untested));
        seen.normalize();
        late.normalize();
        (result.seen, result.late) = (Some(seen), late);
        Ok(())
    }

    /// Waits until a target is drawn, and tells how long that took.
    pub(super) fn note_times(&mut self, at: usize, result: &mut PassResult) -> Result<(), GpuError> {
        let Some(timer) = &self.targets[at].timer else { return Ok(()) };
        timer.ask();
        self.gpu.wait(None)?;
        let [draw_us, ..] = timer.times_us()?;
        result.times = Some(Times { draw_us, ..Times::default() });
        Ok(())
    }

    /// Fills the draw list. Gives the draw and the batch with which the late turn begins.
    fn list_turns(&mut self, pass: &PassPlan, first: &VisibleSet) -> (u32, usize) {
        let mut late = std::mem::take(&mut self.culling.late);
        pass.opaque.difference_into(first, &mut late);
        self.list.clear();
        self.pass += 1;
        self.list_solid(pass, first.leaves(), Turn::First);
        self.list.next_turn();
        let begin = (self.list.arguments.len() as u32, self.list.batches.len());
        self.list_leaves(pass, late.leaves(), Turn::Late);
        self.list_boxes(pass);
        self.list_leaves(pass, pass.blended.iter().copied(), Turn::Late);
        self.culling.late = late;
        begin
    }

    /// The boxes of all that is listed, or that waits; draws that wait for what comes of theirs are held back. What is in the place of
    /// leaves is drawn whatever hides it.
    fn list_boxes_to_test(&mut self, at: usize, pass: &PassPlan, late_draws: u32) -> Vec<TestBox> {
        let target = &mut self.targets[at];
        let grower = Grower::new(&pass.projection, target.size_px);
        let by_pixels = pass.test == BoxTest::Sifted;
        let mut boxes = std::mem::take(&mut self.culling.boxes);
        boxes.clear();
        let Some(first) = &mut target.first else { return boxes };
        first.tested.clear();
        let mut scale: Option<(u32, LocalScale)> = None;
        let draws = (0..).zip(self.list.instances.iter().zip(&mut self.list.arguments));
        for (draw, (instance, arguments)) in draws {
            let leaf = &self.manifest.leaves[instance.leaf as usize];
            if self.list.stand_ins.contains(&draw) || pass.cuts.binary_search(&leaf.object).is_ok() {
                first.tested.push(None);
                continue;
            }
            let triangles = arguments.index_count / 3;
            let is_late = draw >= late_draws;
            if by_pixels && !is_late {
                boxes.push(TestBox::none(draw).of_leaf(instance.leaf, is_late));
                first.tested.push(Some(Tested { leaf: instance.leaf, triangles, is_late, is_seen: false, has_id: true }));
                continue;
            }
            let has_id = self.materials.states[leaf.material.0 as usize].coverage != Coverage::Blended;
            let object = leaf.object.0 as usize;
            let (_, scale) = match scale {
                Some(known) if known.0 == leaf.object.0 => known,
                _ => *scale.insert((leaf.object.0, LocalScale::of(&self.transforms[object].affine()))),
            };
            let clip_from_local = glam::Mat4::from_cols_array(&self.list.records[instance.record as usize]);
            let before = boxes.len();
            let mut test = |bounds: &Aabb| {
                let grown = grower.test(bounds, &clip_from_local, &scale);
                let tested =
                    |grown| TestBox::new(grown, instance.record, draw, self.mirrored[object]).of_leaf(instance.leaf, is_late);
                boxes.extend(grown.map(tested));
                grown.is_some()
            };
            let is_in_pieces = has_id && pass.in_pieces.contains(instance.leaf);
            let pieces = if is_in_pieces { self.pieces.of(leaf.chunk) } else { &[] };
            let is_tested = if pieces.is_empty() || before + pieces.len() > MOST_BOXES {
                test(&leaf.local_aabb())
            } else {
                pieces.iter().all(test)
            };
            if is_tested {
                arguments.instance_count = u32::from(!is_late);
            } else {
                boxes.truncate(before);
            }
            first.tested.push(Some(Tested { leaf: instance.leaf, triangles, is_late, is_seen: !is_tested, has_id }));
        }
        boxes
    }
}
