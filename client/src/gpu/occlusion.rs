//! Whether boxes are seen beyond what was drawn first, and draws that wait for it, all on the GPU.
//!
//! ```text
//! first draws → copies of depth and leaf ids → pyramid → sift → boxes → is_seen, a word for each → release: instance counts → late draws
//!   → glance: leaves with a pixel → note: in the same words
//! ```
//! Conservative: something that waits is taken for hidden only where its whole box is, and never where that reaches the near plane.

use bytemuck::{Pod, Zeroable};

use super::bindings::{Kind, bind, compute, layout, module, pipeline_layout};
use super::culled::Tested;
use super::device::{Gpu, GpuError};
use super::draws::GrowingBuffer;
use super::glance::Glancer;
use super::pyramid::{Pyramid, PyramidMaker};
use super::queries::Queries;
use super::targets::{COLOR_FORMAT, DEPTH_FORMAT, IDS_FORMAT, Target, texture, view_of};
use super::test_box::TestBox;
use super::timer::{Pass, Timer};
use crate::occlusion::rounds::MAX_QUERIES;
use crate::occlusion::{BoxTest, DEPTH_SLACK};

const WORKGROUP: u32 = 64;
/// Corners of the triangles of a box.
const BOX_VERTICES: u32 = 36;

/// What the shaders know of all boxes.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Work {
    boxes: u32,
    /// Of how many spans of the picture one is looked at, and from which on.
    every: u32,
    phase: u32,
    picture: u32,
}
const _: () = assert!(size_of::<Work>() == 16);

/// What tests boxes.
pub(super) struct BoxTester {
    /// What was drawn first: depth, leaf ids.
    pub first_layout: wgpu::BindGroupLayout,
    drawn_layout: wgpu::BindGroupLayout,
    sifted_layout: wgpu::BindGroupLayout,
    released_layout: wgpu::BindGroupLayout,
    all: wgpu::RenderPipeline,
    chosen: wgpu::RenderPipeline,
    /// Without a shader that notes what is seen.
    queried: wgpu::RenderPipeline,
    release: wgpu::ComputePipeline,
    note: wgpu::ComputePipeline,
    pyramids: PyramidMaker,
    pub glancer: Glancer,
}

/// A view's part in it.
pub(super) struct First {
    depth: wgpu::Texture,
    leaves: wgpu::Texture,
    pub bindings: wgpu::BindGroup,
    pyramid: Pyramid,
    boxes: GrowingBuffer,
    /// A word for each thing that is asked for.
    seen: GrowingBuffer,
    /// The boxes that are left after sifting, and how they are drawn.
    chosen: GrowingBuffer,
    chosen_draw: wgpu::Buffer,
    work: wgpu::Buffer,
    read: Option<wgpu::Buffer>,
    /// Made when they are first asked, and whether they were asked last.
    queries: Option<Queries>,
    is_queried: bool,
    /// Of which generations of their buffers.
    groups: Option<([u64; 6], Groups)>,
    /// Of which generation of what is noted by leaf.
    glance: Option<(u64, wgpu::BindGroup)>,
    asked: u32,
    box_count: u32,
    /// By draw, with draws that wait; none for what is in the place of a leaf.
    pub tested: Vec<Option<Tested>>,
    /// By bound: it reaches the near plane.
    pub untested: Vec<bool>,
}

struct Groups {
    drawn: wgpu::BindGroup,
    sifted: wgpu::BindGroup,
    released: wgpu::BindGroup,
}

impl BoxTester {
    /// None where the GPU cannot.
    pub fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.can_cull() {
            return None;
        }
        use wgpu::ShaderStages as On;
        let device = &gpu.device;
        let first_layout = layout(device, "first", &[(On::FRAGMENT | On::COMPUTE, Kind::Depth), (On::FRAGMENT, Kind::Numbers)]);
        let (vertex, fragment, all) = (On::VERTEX, On::FRAGMENT, On::COMPUTE);
        let drawn_layout = layout(
            device,
            "drawn boxes",
            &[
                (vertex, Kind::Read),
                (vertex, Kind::Read),
                (fragment, Kind::Write),
                (fragment, Kind::Uniform),
                (vertex, Kind::Read),
            ],
        );
        let sifted = [Kind::Read, Kind::Read, Kind::Uniform, Kind::Write, Kind::Write].map(|kind| (all, kind));
        let sifted_layout = layout(device, "sifted boxes", &sifted);
        let released = [Kind::Read, Kind::Write, Kind::Write, Kind::Uniform, Kind::Read].map(|kind| (all, kind));
        let released_layout = layout(device, "released draws", &released);
        let pyramids = PyramidMaker::new(device, &sifted_layout, &first_layout);
        let release = module(device, "release", concat!(include_str!("shaders/box.wgsl"), include_str!("shaders/release.wgsl")));
        Some(Self {
            all: boxes_pipeline(gpu, &drawn_layout, &first_layout, Boxes::All),
            chosen: boxes_pipeline(gpu, &drawn_layout, &first_layout, Boxes::Chosen),
            queried: boxes_pipeline(gpu, &drawn_layout, &first_layout, Boxes::Queried),
            note: compute(device, &release, "note", &[&released_layout], &[("DEPTH_SLACK", DEPTH_SLACK)]),
            release: compute(device, &release, "release", &[&released_layout], &[("DEPTH_SLACK", DEPTH_SLACK)]),
            glancer: Glancer::new(gpu),
            first_layout,
            drawn_layout,
            sifted_layout,
            released_layout,
            pyramids,
        })
    }

    /// Tests a target's boxes, as they were handed over, against what was drawn first, and lets draws through.
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &mut Target,
        buffers: Buffers<'_>,
        test: BoxTest,
    ) {
        self.ready(gpu, encoder, target, buffers, test);
        let Some(first) = &mut target.first else { return };
        first.is_queried = test == BoxTest::Queried && first.box_count > 0;
        first.keep(encoder, &target.depth, target.ids.as_ref().map(|(ids, _)| ids));
        if first.box_count > 0 {
            let Some((_, groups)) = &first.groups else { return };
            if test == BoxTest::Sifted {
                self.sift(encoder, first, groups);
            }
            let timer = target.timer.as_ref().filter(|_| !buffers.have_late);
            if first.is_queried {
                let queries = first.queries.get_or_insert_with(|| Queries::new(gpu, MAX_QUERIES as u32));
                self.query(encoder, &target.depth_view, (target.timer.as_ref(), groups, queries), first.box_count);
            } else {
                self.draw(gpu, encoder, (&target.color_view, &target.depth_view, timer), (first, groups), test);
            }
        }
        if let (true, Some((_, groups))) = (buffers.have_late && first.box_count > 0, &first.groups) {
            let mut pass = encoder.begin_compute_pass(&compute_pass("release"));
            pass.set_pipeline(&self.release);
            pass.set_bind_group(0, &groups.released, &[]);
            pass.dispatch_workgroups(first.box_count.div_ceil(WORKGROUP), 1, 1);
        }
    }

    /// Readies a target for what comes of its boxes: nothing is seen yet.
    pub fn ready(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, target: &mut Target, buffers: Buffers<'_>, test: BoxTest) {
        let Some(first) = target.first.as_mut() else { return };
        encoder.clear_buffer(&first.seen.buffer, 0, None);
        if first.box_count > 0 {
            let (every, phase) = match test {
                BoxTest::Sampled { every, phase } => (every, phase),
                _ => (1, 0),
            };
            let work = Work { boxes: first.box_count, every, phase, picture: buffers.picture };
            gpu.queue.write_buffer(&first.work, 0, bytemuck::bytes_of(&work));
            first.bind(gpu, self, &buffers);
        }
    }

    /// Notes of all that was handed over for a target which leaves have a pixel in its picture, by that picture's number.
    pub fn encode_glance(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, target: &mut Target, picture: u32) {
        let (Some(first), Some((_, ids))) = (&mut target.first, &target.ids) else { return };
        if first.box_count == 0 {
            return;
        }
        let size_px = target.size_px;
        let last_seen = &self.glancer.last_seen;
        if first.glance.as_ref().is_none_or(|(bound, _)| *bound != last_seen.generation) {
            first.glance = Some((last_seen.generation, self.glancer.bind(gpu, ids)));
        }
        let (Some((_, glance)), Some((_, groups))) = (&first.glance, &first.groups) else { return };
        let mut pass = encoder.begin_compute_pass(&compute_pass("glance"));
        self.glancer.encode(gpu, &mut pass, glance, (picture, size_px));
        pass.set_pipeline(&self.note);
        pass.set_bind_group(0, &groups.released, &[]);
        pass.dispatch_workgroups(first.box_count.div_ceil(WORKGROUP), 1, 1);
    }

    fn sift(&self, encoder: &mut wgpu::CommandEncoder, first: &First, groups: &Groups) {
        const INSTANCE_COUNT: u64 = 4;
        encoder.clear_buffer(&first.chosen_draw, INSTANCE_COUNT, Some(4));
        let mut pass = encoder.begin_compute_pass(&compute_pass("sift"));
        let boxes = (&groups.sifted, first.box_count.div_ceil(WORKGROUP));
        self.pyramids.encode(&mut pass, &first.pyramid, &first.bindings, boxes);
    }

    fn query(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        depth: &wgpu::TextureView,
        (timer, groups, queries): (Option<&Timer>, &Groups, &mut Queries),
        count: u32,
    ) {
        let set = queries.set().clone();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("queries"),
            depth_stencil_attachment: Some(read_only(depth)),
            timestamp_writes: timer.map(|timer| timer.stamps(Pass::Second)),
            occlusion_query_set: Some(&set),
            ..Default::default()
        });
        pass.set_bind_group(0, &groups.drawn, &[]);
        pass.set_pipeline(&self.queried);
        queries.ask(&mut pass, count, |pass, at| pass.draw(0..BOX_VERTICES, at..at + 1));
        drop(pass);
        queries.resolve(encoder);
    }

    /// `color` is drawn into, but nothing is written; nor is depth.
    fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (color, depth, timer): (&wgpu::TextureView, &wgpu::TextureView, Option<&Timer>),
        (first, groups): (&First, &Groups),
        test: BoxTest,
    ) {
        let attachment = wgpu::RenderPassColorAttachment {
            view: color,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("boxes"),
            color_attachments: &[Some(attachment)],
            depth_stencil_attachment: gpu.early_depth.then(|| read_only(depth)),
            timestamp_writes: timer.map(|timer| timer.stamps(Pass::Second)),
            ..Default::default()
        });
        pass.set_bind_group(0, &groups.drawn, &[]);
        if !gpu.early_depth {
            pass.set_bind_group(1, &first.bindings, &[]);
        }
        if test == BoxTest::Sifted {
            pass.set_pipeline(&self.chosen);
            pass.draw_indirect(&first.chosen_draw, 0);
        } else {
            pass.set_pipeline(&self.all);
            pass.draw(0..BOX_VERTICES, 0..first.box_count);
        }
    }
}

/// What a pass draws from: records and the draws' arguments.
#[derive(Clone, Copy)]
pub(super) struct Buffers<'a> {
    pub records: &'a GrowingBuffer,
    pub arguments: &'a GrowingBuffer,
    /// Whether draws wait for what comes of their boxes.
    pub have_late: bool,
    /// The number of the picture in which pixels are looked for; 0: of what was drawn boxes are tested, too.
    pub picture: u32,
}

impl First {
    pub fn new(gpu: &Gpu, tester: &BoxTester, size_px: [u32; 2]) -> Self {
        use wgpu::BufferUsages as Use;
        use wgpu::TextureUsages as Textures;
        let usage = Textures::COPY_DST | Textures::TEXTURE_BINDING;
        let depth = texture(gpu, "first depth", size_px, DEPTH_FORMAT, usage);
        let leaves = texture(gpu, "first leaf ids", size_px, IDS_FORMAT, usage);
        let views = [view_of(&depth), view_of(&leaves)];
        let bindings = bind(gpu, &tester.first_layout, &views.each_ref().map(wgpu::BindingResource::TextureView));
        let fixed = |label, size, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
        };
        let chosen_draw = fixed("chosen draw", 16, Use::INDIRECT | Use::STORAGE | Use::COPY_DST);
        gpu.queue.write_buffer(&chosen_draw, 0, bytemuck::cast_slice(&[BOX_VERTICES, 0, 0, 0]));
        Self {
            depth,
            leaves,
            bindings,
            pyramid: tester.pyramids.pyramid(gpu, size_px),
            boxes: GrowingBuffer::new(gpu, "boxes", Use::STORAGE),
            seen: GrowingBuffer::new(gpu, "is seen", Use::STORAGE | Use::COPY_SRC),
            chosen: GrowingBuffer::new(gpu, "chosen boxes", Use::STORAGE),
            chosen_draw,
            work: fixed("work", size_of::<Work>() as u64, Use::UNIFORM | Use::COPY_DST),
            read: None,
            queries: None,
            is_queried: false,
            groups: None,
            glance: None,
            asked: 0,
            box_count: 0,
            tested: Vec::new(),
            untested: Vec::new(),
        }
    }

    /// Fetches what came of all that was asked for.
    pub fn fetch(&self, encoder: &mut wgpu::CommandEncoder) {
        if let Some(read) = self.read.as_ref().filter(|_| self.asked > 0) {
            encoder.copy_buffer_to_buffer(&self.seen.buffer, 0, read, 0, u64::from(self.asked) * 4);
        }
    }

    /// Whether there were any boxes in the last pass.
    pub fn have_boxes(&self) -> bool {
        self.box_count > 0
    }

    /// Whether the last boxes were queried: then there is an answer for each box, else a word for each thing that was asked for.
    pub fn is_queried(&self) -> bool {
        self.is_queried
    }

    /// Hands over the boxes of a pass, and makes room for what comes of them: a word for each of `asked`.
    pub fn write(&mut self, gpu: &Gpu, boxes: &[TestBox], asked: u32) -> Result<(), GpuError> {
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        self.boxes.write(gpu, bytemuck::cast_slice(boxes), limit)?;
        self.chosen.reserve(gpu, boxes.len() as u64 * 4, limit)?;
        self.seen.reserve(gpu, u64::from(asked) * 4, limit)?;
        (self.asked, self.box_count, self.is_queried) = (asked, boxes.len() as u32, false);
        let size = self.seen.buffer.size();
        if self.read.as_ref().is_none_or(|read| read.size() != size) {
            let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
            let descriptor = wgpu::BufferDescriptor { label: Some("seen"), size, usage, mapped_at_creation: false };
            self.read = Some(gpu.device.create_buffer(&descriptor));
        }
        Ok(())
    }

    /// Binds all buffers, anew where one was replaced.
    fn bind(&mut self, gpu: &Gpu, tester: &BoxTester, buffers: &Buffers<'_>) {
        let last_seen = &tester.glancer.last_seen;
        let generations =
            [buffers.records, buffers.arguments, &self.boxes, &self.seen, &self.chosen, last_seen].map(|b| b.generation);
        if self.groups.as_ref().is_some_and(|(bound, _)| *bound == generations) {
            return;
        }
        let (records, arguments) = (buffers.records.buffer.as_entire_binding(), buffers.arguments.buffer.as_entire_binding());
        let [boxes, seen, chosen] = [&self.boxes, &self.seen, &self.chosen].map(|b| b.buffer.as_entire_binding());
        let (work, draw) = (self.work.as_entire_binding(), self.chosen_draw.as_entire_binding());
        let last_seen = last_seen.buffer.as_entire_binding();
        let groups = Groups {
            drawn: bind(gpu, &tester.drawn_layout, &[&records, &boxes, &seen, &work, &chosen].map(Clone::clone)),
            sifted: bind(gpu, &tester.sifted_layout, &[&records, &boxes, &work, &chosen, &draw].map(Clone::clone)),
            released: bind(gpu, &tester.released_layout, &[&boxes, &seen, &arguments, &work, &last_seen].map(Clone::clone)),
        };
        self.groups = Some((generations, groups));
    }

    /// Keeps what a target holds now.
    fn keep(&self, encoder: &mut wgpu::CommandEncoder, depth: &wgpu::Texture, leaves: Option<&wgpu::Texture>) {
        for (from, to) in [(Some(depth), &self.depth), (leaves, &self.leaves)] {
            let Some(from) = from else { continue };
            encoder.copy_texture_to_texture(from.as_image_copy(), to.as_image_copy(), to.size());
        }
    }

    /// What was asked for and seen, a word for each. Waits for the GPU.
    pub fn read_seen(&self, gpu: &Gpu, seen: &mut Vec<u32>) -> Result<(), GpuError> {
        seen.clear();
        let queries = self.queries.as_ref().filter(|_| self.is_queried);
        queries.inspect(|queries| queries.want());
        let read = self.read.as_ref().filter(|_| self.asked > 0 && !self.is_queried);
        let range = 0..u64::from(self.asked) * 4;
        if let Some(read) = read {
            read.map_async(wgpu::MapMode::Read, range.clone(), |_| {}); // a failure shows when the range is asked for
        }
        gpu.wait(None)?;
        if let Some(queries) = queries {
            queries.take(seen)?;
        }
        let Some(read) = read else { return Ok(()) };
        let mapped = read.get_mapped_range(range).map_err(|e| GpuError::Refused(e.to_string()))?;
        seen.extend(mapped.chunks_exact(size_of::<u32>()).map(bytemuck::pod_read_unaligned::<u32>));
        drop(mapped);
        read.unmap();
        Ok(())
    }
}

fn compute_pass(label: &str) -> wgpu::ComputePassDescriptor<'_> {
    wgpu::ComputePassDescriptor { label: Some(label), timestamp_writes: None }
}

/// Which boxes a pipeline draws, and who notes what is seen of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Boxes {
    All,
    Chosen,
    /// One at a time, and a query does.
    Queried,
}

/// Depth that is held against, not written.
pub(super) fn read_only(depth: &wgpu::TextureView) -> wgpu::RenderPassDepthStencilAttachment<'_> {
    wgpu::RenderPassDepthStencilAttachment { view: depth, depth_ops: None, stencil_ops: None }
}

/// Draws boxes: all, or those that sifting left. Where the GPU can be made to test depth first, hidden fragments never come to a shader.
fn boxes_pipeline(gpu: &Gpu, drawn: &wgpu::BindGroupLayout, first: &wgpu::BindGroupLayout, boxes: Boxes) -> wgpu::RenderPipeline {
    let device = &gpu.device;
    let source = concat!(include_str!("shaders/box.wgsl"), include_str!("shaders/boxes.wgsl"));
    let forced = source.replace("// FORCED_DEPTH\n", "@early_depth_test(force)\n");
    let module = &module(device, "boxes", if gpu.early_depth { &forced } else { source });
    let (groups, has_depth) = ([drawn, first], gpu.early_depth || boxes == Boxes::Queried);
    let nothing = wgpu::ColorTargetState { format: COLOR_FORMAT, blend: None, write_mask: wgpu::ColorWrites::empty() };
    let depth = wgpu::DepthStencilState {
        format: DEPTH_FORMAT,
        depth_write_enabled: Some(false),
        depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
        stencil: Default::default(),
        bias: wgpu::DepthBiasState { constant: 0, slope_scale: 1.0, clamp: 0.0 },
    };
    let compilation_options = wgpu::PipelineCompilationOptions {
        constants: &[("is_sifted", f64::from(u8::from(boxes == Boxes::Chosen))), ("DEPTH_SLACK", DEPTH_SLACK)],
        ..Default::default()
    };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("boxes"),
        layout: Some(&pipeline_layout(device, "boxes", if has_depth { &groups[..1] } else { &groups })),
        vertex: wgpu::VertexState { module, entry_point: Some("vertex"), compilation_options, buffers: &[] },
        primitive: wgpu::PrimitiveState { cull_mode: Some(wgpu::Face::Back), ..Default::default() },
        depth_stencil: has_depth.then_some(depth),
        multisample: Default::default(),
        fragment: (boxes != Boxes::Queried).then_some(wgpu::FragmentState {
            module,
            entry_point: Some(if gpu.early_depth { "tested" } else { "compared" }),
            compilation_options: Default::default(),
            targets: &[Some(nothing)],
        }),
        multiview_mask: None,
        cache: None,
    })
}
