//! One pipeline for each way that a leaf can be drawn, and the layouts that they share.

use std::borrow::Cow;

use mullion_common::scene::{AlphaMode, Material};

use super::arena::Vertex;
use super::bindings::pipeline_layout;
use super::device::Gpu;
use super::draws::Instance;
use super::targets::{Attachments, COLOR_FORMAT, DEPTH_FORMAT, IDS_FORMAT};
use crate::occlusion::ROUNDED_BITS;

/// What a pipeline does with alpha.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coverage {
    Opaque,
    Masked,
    Blended,
}

/// Which faces a pipeline drops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sides {
    Both,
    Front,
    /// The front, of an object whose transform turns the winding around.
    FrontMirrored,
}

/// Whether a pipeline draws beyond what was drawn first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    First,
    /// Solid leaves: each wins where it is as near as a later one of the first turn, as if all had been drawn in ascending order.
    Late,
}

/// Where a pipeline's base colour comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Surface {
    /// Factor and vertices alone: to sample a white texel costs a software renderer more than all the rest of a fragment.
    Plain,
    Textured,
}

/// A pipeline's number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PipelineKey(u8);

/// All that a pipeline is made for.
type Kind = (Coverage, Surface, Sides, Turn);

impl PipelineKey {
    /// How many pipelines there are before those of the late turn.
    const FIRST_TURN: u8 = 18;

    pub fn new(coverage: Coverage, surface: Surface, sides: Sides) -> Self {
        Self((coverage as u8 * 2 + surface as u8) * 3 + sides as u8)
    }

    /// The same in another turn. Blended leaves have but one.
    pub fn in_turn(self, turn: Turn) -> Self {
        let is_solid = self.0 < Coverage::Blended as u8 * 6;
        if turn == Turn::Late && is_solid { Self(self.0 + Self::FIRST_TURN) } else { self }
    }

    /// Every kind of a turn, in the order of the numbers.
    fn kinds(turn: Turn) -> impl Iterator<Item = Kind> {
        let coverages = match turn {
            Turn::First => &[Coverage::Opaque, Coverage::Masked, Coverage::Blended][..],
            Turn::Late => &[Coverage::Opaque, Coverage::Masked],
        };
        let sides = move |coverage, surface| {
            [Sides::Both, Sides::Front, Sides::FrontMirrored].map(move |sides| (coverage, surface, sides, turn))
        };
        let surfaces = move |coverage| [Surface::Plain, Surface::Textured].into_iter().flat_map(move |s| sides(coverage, s));
        coverages.iter().flat_map(move |&coverage| surfaces(coverage))
    }
}

impl Sides {
    pub fn of(double_sided: bool, mirrored: bool) -> Self {
        match (double_sided, mirrored) {
            (true, _) => Self::Both,
            (false, false) => Self::Front,
            (false, true) => Self::FrontMirrored,
        }
    }

    /// Triangles of these sides.
    pub fn primitive(self) -> wgpu::PrimitiveState {
        wgpu::PrimitiveState {
            front_face: if self == Self::FrontMirrored { wgpu::FrontFace::Cw } else { wgpu::FrontFace::Ccw },
            cull_mode: (self != Self::Both).then_some(wgpu::Face::Back),
            ..Default::default()
        }
    }
}

impl Coverage {
    pub fn of(material: &Material) -> Self {
        match material.alpha {
            AlphaMode::Opaque => Self::Opaque,
            AlphaMode::Mask { .. } => Self::Masked,
            AlphaMode::Blend => Self::Blended,
        }
    }
}

/// Layouts and pipelines for one choice of attachments.
pub(super) struct Pipelines {
    /// View, records.
    pub view_layout: wgpu::BindGroupLayout,
    /// Texture and sampler.
    pub texture_layout: wgpu::BindGroupLayout,
    module: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    plain: Vec<wgpu::RenderPipeline>,
    /// With ids, of both turns.
    culled: Vec<wgpu::RenderPipeline>,
}

impl Pipelines {
    pub fn new(gpu: &Gpu, attachments: Attachments) -> Self {
        let device = &gpu.device;
        let view_layout = view_layout(device);
        let texture_layout = texture_layout(device);
        let mut source = Cow::Borrowed(include_str!("shaders/scene.wgsl"));
        if gpu.early_depth {
            source = source.replace("// EARLY_DEPTH\n", "@early_depth_test(less_equal)\n").into();
        }
        let source = wgpu::ShaderSource::Wgsl(source);
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some("scene"), source });
        let layout = pipeline_layout(device, "scene", &[&view_layout, &texture_layout]);
        let plain = PipelineKey::kinds(Turn::First).map(|kind| pipeline(device, &module, &layout, attachments, kind)).collect();
        Self { view_layout, texture_layout, module, layout, plain, culled: Vec::new() }
    }

    /// Makes those of passes with occlusion culling, if they are not there.
    pub fn add_culled(&mut self, gpu: &Gpu, first_layout: &wgpu::BindGroupLayout) {
        if !self.culled.is_empty() {
            return;
        }
        let groups = [&self.view_layout, &self.texture_layout, first_layout];
        let late = pipeline_layout(&gpu.device, "late", &groups);
        for (layout, turn) in [(&self.layout, Turn::First), (&late, Turn::Late)] {
            let of_turn = PipelineKey::kinds(turn);
            let made = of_turn.map(|kind| pipeline(&gpu.device, &self.module, layout, Attachments::ColorAndIds, kind));
            self.culled.extend(made);
        }
    }

    /// One of a pass without occlusion culling, or with.
    pub fn get(&self, key: PipelineKey, is_culled: bool) -> &wgpu::RenderPipeline {
        let by_key = if is_culled { &self.culled } else { &self.plain };
        &by_key[usize::from(key.0)]
    }
}

fn pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    attachments: Attachments,
    (coverage, surface, sides, turn): Kind,
) -> wgpu::RenderPipeline {
    let (entry_point, blend) = match (coverage, turn) {
        (Coverage::Opaque, Turn::First) => ("opaque", None),
        (Coverage::Opaque, Turn::Late) => ("opaque_late", None),
        (Coverage::Masked, Turn::First) => ("masked", None),
        (Coverage::Masked, Turn::Late) => ("masked_late", None),
        (Coverage::Blended, _) => ("blended", Some(wgpu::BlendState::ALPHA_BLENDING)),
    };
    let solid = coverage != Coverage::Blended;
    let ids_mask = if solid { wgpu::ColorWrites::ALL } else { wgpu::ColorWrites::empty() };
    let color = wgpu::ColorTargetState { format: COLOR_FORMAT, blend, write_mask: wgpu::ColorWrites::ALL };
    let ids = wgpu::ColorTargetState { format: IDS_FORMAT, blend: None, write_mask: ids_mask };
    let targets = [Some(color), Some(ids)];
    let targets = match attachments {
        Attachments::Color => &targets[..1],
        Attachments::ColorAndIds => &targets[..],
    };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(entry_point),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[
                Some(wgpu::VertexBufferLayout {
                    array_stride: size_of::<Vertex>() as u64,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x2, 2 => Unorm8x4],
                }),
                Some(wgpu::VertexBufferLayout {
                    array_stride: size_of::<Instance>() as u64,
                    step_mode: wgpu::VertexStepMode::Instance,
                    attributes: &wgpu::vertex_attr_array![3 => Float32x4, 4 => Uint32x2, 5 => Float32],
                }),
            ],
        },
        primitive: sides.primitive(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(solid),
            // Strict, so that of coplanar faces the first leaf wins, whatever else is drawn.
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &[
                    ("is_textured", f64::from(u8::from(surface == Surface::Textured))),
                    ("ROUNDED_BITS", f64::from(ROUNDED_BITS)),
                ],
                ..Default::default()
            },
            targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn view_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let buffer = |binding, visibility, ty| wgpu::BindGroupLayoutEntry {
        binding,
        visibility,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    let read_only = wgpu::BufferBindingType::Storage { read_only: true };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("view"),
        entries: &[
            buffer(0, wgpu::ShaderStages::FRAGMENT, wgpu::BufferBindingType::Uniform),
            buffer(1, wgpu::ShaderStages::VERTEX, read_only),
        ],
    })
}

/// One texture and one sampler, for fragments.
pub(super) fn texture_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::FRAGMENT, ty, count: None };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("texture"),
        entries: &[
            entry(
                0,
                wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Float { filterable: true },
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
            ),
            entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
        ],
    })
}

/// Binds a texture and a sampler to [`texture_layout`].
pub(super) fn bind_texture(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    texture: &wgpu::TextureView,
    sampler: &wgpu::Sampler,
) -> wgpu::BindGroup {
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("texture"),
        layout,
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(texture) },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(sampler) },
        ],
    })
}
