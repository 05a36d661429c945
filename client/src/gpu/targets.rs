//! What a view is drawn into.

use mullion_common::wall::{Projection, ViewId};

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3};

use super::device::{Gpu, GpuError};
use super::occlusion::First;
use super::timer::Timer;

pub(super) const COLOR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
pub(super) const IDS_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
/// A pale sky, linear.
pub(super) const CLEAR_COLOR: wgpu::Color = wgpu::Color { r: 0.42, g: 0.53, b: 0.66, a: 1.0 };

/// What a pass without occlusion culling draws; one with it draws both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attachments {
    /// Colour.
    Color,
    /// Colour, and which leaf is seen in each pixel.
    ColorAndIds,
}

/// The last picture of a view that is meant to be seen.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Whose.
    pub view: ViewId,
    /// Its size.
    pub size_px: [u32; 2],
    pub(super) texture: wgpu::TextureView,
}

/// Where light comes from, and how much of it.
const TOWARDS_SUN: DVec3 = DVec3::new(0.3521, 0.8049, 0.4778);
const SUN: f64 = 0.45;

/// What the fragment shader knows of a view: see there.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct ViewUniform {
    row_1: [f32; 4],
    row_2: [f32; 4],
    from_sun: [f32; 4],
}
const _: () = assert!(size_of::<ViewUniform>() == 48);

impl ViewUniform {
    /// Of a projection whose picture is this large.
    fn new(projection: &Projection, size_px: [u32; 2]) -> Self {
        let clip_from_offset = [0, 1, 3].map(|row| projection.clip_from_offset.row(row).truncate());
        let offset_from_clip = DMat3::from_cols_array_2d(&clip_from_offset.map(|row| row.to_array())).transpose().inverse();
        let [width, height] = size_px.map(f64::from);
        // Columns of offset_from_pixel: the ray of a pixel is their sum weighted by (x, y, 1).
        let (right, down) = (offset_from_clip.x_axis * (2.0 / width), offset_from_clip.y_axis * (-2.0 / height));
        let corner = offset_from_clip.z_axis - offset_from_clip.x_axis + offset_from_clip.y_axis;
        let first = right.normalize();
        let second = down.reject_from_normalized(first).normalize();
        let across = first.cross(second);
        let third = if corner.dot(across) < 0.0 { -across } else { across };
        let depth = corner.dot(third);
        let [r11, r12, r13] = [right, down, corner].map(|column| column.dot(first) / depth);
        let [r22, r23] = [down, corner].map(|column| column.dot(second) / depth);
        let from_sun = [first, second, third].map(|axis| -SUN * TOWARDS_SUN.dot(axis));
        let narrow = |row: [f64; 4]| row.map(|number| number as f32);
        Self {
            row_1: narrow([r11, r12, r13, 1.0 / r11]),
            row_2: narrow([r22, r23, 1.0 / r22, 0.0]),
            from_sun: narrow([from_sun[0], from_sun[1], from_sun[2], 0.0]),
        }
    }
}

/// The textures of one view.
pub(super) struct Target {
    pub view: ViewId,
    pub size_px: [u32; 2],
    pub color: wgpu::Texture,
    pub color_view: wgpu::TextureView,
    pub depth: wgpu::Texture,
    pub depth_view: wgpu::TextureView,
    /// Leaves plus one. Made when they are first drawn.
    pub ids: Option<(wgpu::Texture, wgpu::TextureView)>,
    /// Whether passes without occlusion culling draw them, too.
    pub always_ids: bool,
    /// Whether they are of the last picture.
    pub ids_are_new: bool,
    /// Whether the pass that was begun last is drawn with occlusion culling.
    pub is_culled: bool,
    /// Where the GPU has a clock.
    pub timer: Option<Timer>,
    /// Made when it is first drawn with occlusion culling.
    pub first: Option<First>,
    /// Made when it is first shown.
    pub shown: Option<wgpu::Texture>,
    uniform: wgpu::Buffer,
    /// View and records; of which generation of the records' buffer.
    pub bindings: Option<(u64, wgpu::BindGroup)>,
}

impl Target {
    pub fn new(gpu: &Gpu, view: ViewId, size_px: [u32; 2], attachments: Attachments) -> Result<Self, GpuError> {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if let Some(&edge) = size_px.iter().find(|&&edge| edge == 0 || edge > limit) {
            return Err(GpuError::Limit { what: "edge of a view in pixels", value: edge.into(), limit: limit.into() });
        }
        use wgpu::TextureUsages as Use;
        let color = texture(gpu, "colour", size_px, COLOR_FORMAT, Use::RENDER_ATTACHMENT | Use::COPY_SRC);
        let depth = texture(gpu, "depth", size_px, DEPTH_FORMAT, Use::RENDER_ATTACHMENT | Use::COPY_SRC);
        let uniform = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("view"),
            size: size_of::<ViewUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(Self {
            view,
            size_px,
            color_view: view_of(&color),
            color,
            depth_view: view_of(&depth),
            depth,
            first: None,
            ids: None,
            always_ids: attachments == Attachments::ColorAndIds,
            ids_are_new: false,
            is_culled: false,
            timer: Timer::new(gpu),
            shown: None,
            uniform,
            bindings: None,
        })
    }

    /// Begins a pass, with ids or without.
    pub fn begin(&mut self, gpu: &Gpu, is_culled: bool) {
        use wgpu::TextureUsages as Use;
        self.is_culled = is_culled;
        self.ids_are_new = is_culled || self.always_ids;
        if self.ids_are_new && self.ids.is_none() {
            let usage = Use::RENDER_ATTACHMENT | Use::COPY_SRC | Use::TEXTURE_BINDING;
            let ids = texture(gpu, "leaf ids", self.size_px, IDS_FORMAT, usage);
            self.ids = Some((ids.clone(), view_of(&ids)));
        }
    }

    pub fn write_uniform(&self, gpu: &Gpu, projection: &Projection) {
        let uniform = ViewUniform::new(projection, self.size_px);
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    /// Binds view and records, anew when the records have moved to another buffer.
    pub fn bind(&mut self, gpu: &Gpu, layout: &wgpu::BindGroupLayout, (generation, records): (u64, &wgpu::Buffer)) {
        if self.bindings.as_ref().is_some_and(|(bound, _)| *bound == generation) {
            return;
        }
        let entries = [(0, &self.uniform), (1, records)]
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() });
        let descriptor = wgpu::BindGroupDescriptor { label: Some("view"), layout, entries: &entries };
        self.bindings = Some((generation, gpu.device.create_bind_group(&descriptor)));
    }

    /// Queues a copy of what was drawn to what is shown.
    pub fn show(&mut self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder) -> Shown {
        use wgpu::TextureUsages as Use;
        let usage = Use::COPY_DST | Use::COPY_SRC | Use::TEXTURE_BINDING;
        let shown = self.shown.get_or_insert_with(|| texture(gpu, "shown", self.size_px, COLOR_FORMAT, usage));
        encoder.copy_texture_to_texture(self.color.as_image_copy(), shown.as_image_copy(), shown.size());
        Shown { view: self.view, size_px: self.size_px, texture: view_of(shown) }
    }
}

pub(super) fn texture(
    gpu: &Gpu,
    label: &str,
    [width, height]: [u32; 2],
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

pub(super) fn view_of(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
