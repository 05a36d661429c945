//! Shown tiles on a window's surface.

use std::collections::HashMap;
use std::sync::Arc;

use mullion_common::wall::ViewId;
use thiserror::Error;

use super::device::{Gpu, GpuError};
use super::pipelines::{bind_texture, texture_layout};
use super::targets::Shown;

/// Where a tile appears among the others, in any unit, from the top left. The whole is scaled to fit the window.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs)]
pub struct TileRect {
    pub view: ViewId,
    pub x: f32,
    pub y: f32,
    pub w: f32,
    pub h: f32,
}

/// Why a window shows nothing.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum PresentError {
    #[error("no surface on this window: {0}")]
    Surface(String),
    #[error("the GPU {0} cannot draw on this window")]
    Unsupported(String),
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// Draws the latest picture of each tile on a window.
pub struct Presenter {
    gpu: Arc<Gpu>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    tiles: Vec<TileRect>,
    latest: HashMap<ViewId, wgpu::BindGroup>,
}

impl Presenter {
    /// A presenter on `window`, `size_px` large.
    ///
    /// # Errors
    /// When the GPU cannot draw on it.
    pub fn new(
        gpu: Arc<Gpu>,
        window: impl Into<wgpu::SurfaceTarget<'static>>,
        size_px: [u32; 2],
        tiles: Vec<TileRect>,
    ) -> Result<Self, PresentError> {
        let surface = gpu.instance.create_surface(window).map_err(|e| PresentError::Surface(e.to_string()))?;
        let unsupported = || PresentError::Unsupported(gpu.describe());
        let [width, height] = size_px.map(|edge| edge.max(1));
        let mut config = surface.get_default_config(&gpu.adapter, width, height).ok_or_else(unsupported)?;
        let formats = surface.get_capabilities(&gpu.adapter).formats;
        config.format = formats.iter().copied().find(wgpu::TextureFormat::is_srgb).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        gpu.configure(&surface, &config);
        let layout = texture_layout(&gpu.device);
        let pipeline = pipeline(&gpu.device, &layout, config.format);
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        gpu.check()?;
        Ok(Self { gpu, surface, config, pipeline, layout, sampler, tiles, latest: HashMap::new() })
    }

    /// Follows the window's size.
    pub fn resize(&mut self, size_px: [u32; 2]) {
        let size_px = size_px.map(|edge| edge.max(1));
        if size_px == [self.config.width, self.config.height] {
            return;
        }
        [self.config.width, self.config.height] = size_px;
        self.gpu.configure(&self.surface, &self.config);
    }

    /// Places the tiles anew.
    pub fn lay_out(&mut self, tiles: Vec<TileRect>) {
        self.tiles = tiles;
    }

    /// Takes a tile's latest picture. It appears with the next [`Presenter::present`].
    pub fn update(&mut self, shown: &Shown) {
        let binding = bind_texture(&self.gpu.device, &self.layout, &shown.texture, &self.sampler);
        self.latest.insert(shown.view, binding);
    }

    /// Puts the latest pictures on the window. A window that is hidden or about to change is skipped.
    ///
    /// # Errors
    /// When the surface or the GPU is lost.
    pub fn present(&mut self) -> Result<(), PresentError> {
        use wgpu::CurrentSurfaceTexture as Current;
        let frame = match self.surface.get_current_texture() {
            Current::Success(frame) | Current::Suboptimal(frame) => frame,
            Current::Outdated => {
                self.gpu.configure(&self.surface, &self.config);
                return Ok(self.gpu.check()?);
            }
            Current::Timeout | Current::Occluded | Current::Validation => return Ok(self.gpu.check()?),
            Current::Lost => return Err(PresentError::Surface("it was lost".to_owned())),
        };
        let view = frame.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("present") });
        self.encode(&mut encoder, &view, [frame.texture.width() as f32, frame.texture.height() as f32]);
        self.gpu.submit(Some(encoder.finish()));
        self.gpu.queue.present(frame);
        Ok(self.gpu.check()?)
    }

    fn encode(&self, encoder: &mut wgpu::CommandEncoder, view: &wgpu::TextureView, window_px: [f32; 2]) {
        let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store };
        let attachment = wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("present"),
            color_attachments: &[Some(attachment)],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        for tile in &self.tiles {
            let Some([x, y, w, h]) = place(&self.tiles, tile, window_px) else { continue };
            if let Some(binding) = self.latest.get(&tile.view) {
                pass.set_viewport(x, y, w, h, 0.0, 1.0);
                pass.set_bind_group(0, binding, &[]);
                pass.draw(0..3, 0..1);
            }
        }
    }
}

/// Where a tile lies on the window, in whole pixels: x, y, width, height. All tiles together are scaled to fit and
/// centred; `None` for a tile that would have no pixel.
fn place(tiles: &[TileRect], tile: &TileRect, window_px: [f32; 2]) -> Option<[f32; 4]> {
    let least = tiles.iter().fold([f32::INFINITY; 2], |[x, y], t| [x.min(t.x), y.min(t.y)]);
    let most = tiles.iter().fold([f32::NEG_INFINITY; 2], |[x, y], t| [x.max(t.x + t.w), y.max(t.y + t.h)]);
    let extent = [most[0] - least[0], most[1] - least[1]];
    let scale = (window_px[0] / extent[0]).min(window_px[1] / extent[1]);
    let along = |axis: usize, at: f32| {
        let margin = (window_px[axis] - extent[axis] * scale) / 2.0;
        ((at - least[axis]) * scale + margin).round().clamp(0.0, window_px[axis])
    };
    let (left, top) = (along(0, tile.x), along(1, tile.y));
    let (width, height) = (along(0, tile.x + tile.w) - left, along(1, tile.y + tile.h) - top);
    (width >= 1.0 && height >= 1.0).then_some([left, top, width, height])
}

fn pipeline(device: &wgpu::Device, layout: &wgpu::BindGroupLayout, format: wgpu::TextureFormat) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::include_wgsl!("shaders/present.wgsl"));
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("present"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    let constants = [("encode_srgb", f64::from(u8::from(!format.is_srgb())))];
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("present"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_fit_the_window_and_keep_their_shape() {
        let tile = |view, x, w| TileRect { view: ViewId(view), x, y: 5.0, w, h: 9.0 };
        let tiles = [tile(0, 10.0, 16.0), tile(1, 27.0, 15.0)]; // 32 by 9
        assert_eq!(place(&tiles, &tiles[0], [320.0, 200.0]), Some([0.0, 55.0, 160.0, 90.0]));
        assert_eq!(place(&tiles, &tiles[1], [320.0, 200.0]), Some([170.0, 55.0, 150.0, 90.0]));
        assert_eq!(place(&tiles, &tiles[0], [640.0, 90.0]), Some([160.0, 0.0, 160.0, 90.0]));
        let empty = [tile(0, 0.0, 0.0)];
        assert_eq!(place(&empty, &empty[0], [320.0, 200.0]), None);
    }
}
