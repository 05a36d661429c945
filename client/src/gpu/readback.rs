//! From textures on the GPU to images in memory.

use image::RgbaImage;
use mullion_common::wall::ViewId;

use super::device::{Gpu, GpuError};
use super::renderer::Renderer;
use super::targets::Target;

impl Renderer {
    /// The colours last drawn into a view. Waits for them.
    ///
    /// # Errors
    /// When the view is not this renderer's, or the GPU fails.
    pub fn read_color(&self, view: ViewId) -> Result<RgbaImage, GpuError> {
        let target = self.target(view)?;
        read_image(&self.gpu, &target.color, target.size_px)
    }

    /// The colours that a view shows, or `None` when it has shown nothing yet. Waits for them.
    ///
    /// # Errors
    /// When the view is not this renderer's, or the GPU fails.
    pub fn read_shown(&self, view: ViewId) -> Result<Option<RgbaImage>, GpuError> {
        let target = self.target(view)?;
        target.shown.as_ref().map(|shown| read_image(&self.gpu, shown, target.size_px)).transpose()
    }

    /// For each pixel last drawn, row by row from the top left, the object seen plus one; 0 for none. Blended leaves
    /// are not seen here.
    ///
    /// # Errors
    /// When the view is not this renderer's or has no ids, or the GPU fails.
    pub fn read_ids(&self, view: ViewId) -> Result<Vec<u32>, GpuError> {
        let object = |leaf: u32| self.manifest.leaves[leaf as usize].object.0 + 1;
        let leaves = self.read_leaves(view)?;
        Ok(leaves.into_iter().map(|id| id.checked_sub(1).map_or(0, object)).collect())
    }

    /// The same of leaves.
    ///
    /// # Errors
    /// As [`Renderer::read_ids`].
    pub fn read_leaves(&self, view: ViewId) -> Result<Vec<u32>, GpuError> {
        let target = self.target(view)?;
        let (ids, _) = target.ids.as_ref().filter(|_| target.ids_are_new).ok_or(GpuError::NoIds)?;
        Ok(bytemuck::pod_collect_to_vec(&read_texture(&self.gpu, ids)?))
    }

    /// For each pixel last drawn, row by row from the top left, its depth, reversed: 1 at the near plane, 0 where nothing is.
    ///
    /// # Errors
    /// When the view is not this renderer's, or the GPU fails.
    pub fn read_depth(&self, view: ViewId) -> Result<Vec<f32>, GpuError> {
        Ok(bytemuck::pod_collect_to_vec(&read_texture(&self.gpu, &self.target(view)?.depth)?))
    }

    fn target(&self, view: ViewId) -> Result<&Target, GpuError> {
        self.targets.iter().find(|t| t.view == view).ok_or(GpuError::UnknownView(view.0))
    }
}

fn read_image(gpu: &Gpu, texture: &wgpu::Texture, [width, height]: [u32; 2]) -> Result<RgbaImage, GpuError> {
    let bytes = read_texture(gpu, texture)?;
    RgbaImage::from_raw(width, height, bytes).ok_or(GpuError::Refused("a picture shorter than its size".to_owned()))
}

/// The bytes of a texture with four bytes per texel, without padding.
fn read_texture(gpu: &Gpu, texture: &wgpu::Texture) -> Result<Vec<u8>, GpuError> {
    let row = texture.width() * 4;
    let padded_row = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("readback"),
        size: u64::from(padded_row) * u64::from(texture.height()),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("readback") });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded_row), rows_per_image: None };
    let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    let submission = gpu.submit(Some(encoder.finish()));
    buffer.map_async(wgpu::MapMode::Read, .., |_| {}); // a failure shows when the range is asked for
    gpu.wait(Some(submission))?;
    let mapped = buffer.get_mapped_range(..).map_err(|e| GpuError::Refused(e.to_string()))?;
    let mut bytes = Vec::with_capacity(row as usize * texture.height() as usize);
    for padded in mapped.chunks_exact(padded_row as usize) {
        bytes.extend_from_slice(&padded[..row as usize]);
    }
    Ok(bytes)
}
