//! A pass in several rounds: what a round draws comes beyond what is there, and what it asks is answered before the next. Every pixel is as
//! if all had been drawn at once.

use glam::DAffine3;
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::culled::HAS_PIXEL;
use super::device::GpuError;
use super::pipelines::Turn;
use super::renderer::{Load, Renderer};
use super::test_box::{Grower, LocalScale, TestBox};
use super::timer::{Pass, Timer};
use crate::frame::{Bound, PassPlan, PassResult, Times};

impl Renderer {
    /// Draws one round of a target that is prepared.
    pub(super) fn draw_round(&mut self, at: usize, pass: &PassPlan) -> Result<PassResult, GpuError> {
        let (turn, load) = if pass.round == 0 { (Turn::First, Load::Clear) } else { (Turn::Late, Load::Keep) };
        self.list.clear();
        self.pass += 1;
        self.list_solid(pass, pass.opaque.leaves(), turn);
        self.list_boxes(pass);
        self.list_leaves(pass, pass.blended.iter().copied(), turn);
        let mut boxes = std::mem::take(&mut self.culling.boxes);
        boxes.clear();
        boxes.extend((0..).zip(pass.look_for.leaves()).map(|(number, leaf)| TestBox::none(number).of_leaf(leaf, false)));
        let boxes = self.list_bounds(at, pass, boxes, 0);
        let have_tests = !boxes.is_empty() && pass.look_for.is_empty();
        self.hand_over(at, pass, true)?;
        let asked = if pass.look_for.is_empty() { pass.bounds.len() as u32 } else { pass.look_for.len() };
        self.hand_over_boxes(at, boxes, asked)?;
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("round") });
        self.encode(&self.targets[at], &mut encoder, (load, Some(Pass::Draws)), 0..self.list.batches.len());
        if !pass.bounds.is_empty() || !pass.footprints.is_empty() {
            self.encode_tests(at, &mut encoder, pass.test, false);
            self.encode_answers(at, &mut encoder);
        } else if !pass.look_for.is_empty() {
            self.encode_look(at, &mut encoder);
            self.encode_answers(at, &mut encoder);
        }
        self.encode_times(at, &mut encoder, if have_tests { 2 } else { 1 });
        self.last_submission = Some(self.gpu.submit(Some(encoder.finish())));
        Ok(self.result(pass))
    }

    /// Waits until a round is drawn, and tells which of its bounds are seen.
    pub(super) fn note_bounds(&mut self, at: usize, pass: &PassPlan, result: &mut PassResult) -> Result<(), GpuError> {
        if !pass.footprints.is_empty() {
            result.counts = self.count_boxes(pass.view, &pass.footprints)?;
        }
        let target = &self.targets[at];
        let Some(first) = &target.first else { return Ok(()) };
        target.timer.as_ref().inspect(|timer| timer.ask());
        first.read_seen(&self.gpu, &mut self.culling.seen)?;
        let have_bounds = first.have_boxes() && pass.look_for.is_empty();
        let times = target.timer.as_ref().map(Timer::times_us).transpose()?;
        result.times = times.map(|[drawn, _, all]| Times {
            draw_us: drawn,
            test_us: if have_bounds { (all - drawn).max(0.0) } else { 0.0 },
            ..Times::default()
        });
        result.bounds_seen.clear();
        if !pass.look_for.is_empty() {
            let looked_for = pass.look_for.leaves().zip(&self.culling.seen).filter(|(_, word)| **word & HAS_PIXEL != 0);
            result.seen = Some(VisibleSet::from_ranges(looked_for.map(|(leaf, _)| LeafRange::new(leaf, leaf + 1))));
            return Ok(());
        }
        if first.is_queried() {
            let mut answers = self.culling.seen.iter().map(|word| *word != 0);
            result.bounds_seen.extend(first.untested.iter().map(|is_untested| *is_untested || answers.next().unwrap_or(true)));
        } else {
            let answers = self.culling.seen.iter().map(|word| *word != 0);
            result.bounds_seen.extend(answers.zip(&first.untested).map(|(is_seen, is_untested)| is_seen || *is_untested));
        }
        Ok(())
    }

    /// Adds the boxes of a plan's bounds, whose answers begin with that number. Those that reach the near plane are seen.
    pub(super) fn list_bounds(&mut self, at: usize, pass: &PassPlan, mut boxes: Vec<TestBox>, answers: u32) -> Vec<TestBox> {
        let target = &mut self.targets[at];
        let grower = Grower::new(&pass.projection, target.size_px);
        let Some(first) = &mut target.first else { return boxes };
        let mut untested = std::mem::take(&mut first.untested);
        untested.clear();
        let eye = pass.projection.eye;
        let mut of_world: Option<u32> = None;
        for (number, bound) in (answers..).zip(&pass.bounds) {
            let (bounds, record, scale, is_mirrored) = match *bound {
                Bound::World(bounds) => {
                    let record = *of_world.get_or_insert_with(|| {
                        let from_eye = DAffine3::from_translation(eye);
                        self.list.records.push(pass.projection.clip_from_local(&from_eye).to_cols_array());
                        self.list.records.len() as u32 - 1
                    });
                    (bounds.moved(-eye), record, LocalScale::WORLD, false)
                }
                Bound::Leaf(leaf) => {
                    let leaf = self.manifest.leaves[leaf as usize];
                    let object = leaf.object.0 as usize;
                    let world_from_local = self.transforms[object].affine();
                    let record = self.record(pass, leaf.object);
                    (leaf.local_aabb(), record, LocalScale::of(&world_from_local), self.mirrored[object])
                }
            };
            let clip_from_local = glam::Mat4::from_cols_array(&self.list.records[record as usize]);
            let grown = grower.test(&bounds, &clip_from_local, &scale);
            boxes.extend(grown.map(|grown| TestBox::new(grown, record, number, is_mirrored).asked()));
            untested.push(grown.is_none());
        }
        if let Some(first) = &mut self.targets[at].first {
            first.untested = untested;
        }
        boxes
    }
}
