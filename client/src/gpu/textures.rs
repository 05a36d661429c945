//! Images from outside to textures with mipmaps.

use std::io::Cursor;
use std::sync::LazyLock;

use image::{ImageReader, Limits, RgbaImage};

use super::device::Gpu;

/// Most pixels along an edge of an encoded image.
const MAX_IMAGE_PX: u32 = 16_384;
/// Most memory that the decoder of one image may take.
const MAX_DECODE_BYTES: u64 = 2 << 30;

/// Decodes a PNG or JPEG file. Never takes more memory than the cap, whatever the header says.
pub(super) fn decode(bytes: &[u8]) -> Result<RgbaImage, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_IMAGE_PX);
    limits.max_image_height = Some(MAX_IMAGE_PX);
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    reader.limits(limits);
    let image = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
    if image.width() == 0 || image.height() == 0 { Err("an image without pixels".to_owned()) } else { Ok(image) }
}

/// Makes the texture and its mipmaps; images larger than the GPU takes lose their finest levels. Returns its bytes
/// too.
pub(super) fn create(gpu: &Gpu, mut image: RgbaImage) -> (wgpu::TextureView, u64) {
    let most = gpu.device.limits().max_texture_dimension_2d;
    while image.width().max(image.height()) > most {
        image = half(&image);
    }
    let size = wgpu::Extent3d { width: image.width(), height: image.height(), depth_or_array_layers: 1 };
    let levels = size.max_mips(wgpu::TextureDimension::D2);
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("base colour"),
        size,
        mip_level_count: levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8UnormSrgb,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let mut bytes = 0;
    for mip_level in 0..levels {
        if mip_level > 0 {
            image = half(&image);
        }
        let (width, height) = image.dimensions();
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 4), rows_per_image: None };
        let extent = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let place = wgpu::TexelCopyTextureInfo { mip_level, ..texture.as_image_copy() };
        gpu.queue.write_texture(place, &image, layout, extent);
        bytes += image.len() as u64;
    }
    (texture.create_view(&wgpu::TextureViewDescriptor::default()), bytes)
}

/// One white texel: for materials without a texture.
pub(super) fn white() -> RgbaImage {
    RgbaImage::from_pixel(1, 1, image::Rgba([255; 4]))
}

/// Magenta and black: for textures that cannot be read.
pub(super) fn checker() -> RgbaImage {
    RgbaImage::from_fn(8, 8, |x, y| image::Rgba(if (x + y) % 2 == 0 { [255, 0, 255, 255] } else { [0, 0, 0, 255] }))
}

/// sRGB to linear, 16 bits.
static LINEAR: LazyLock<[u16; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let encoded = i as f64 / 255.0;
        let linear = if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
        (linear * 65_535.0).round() as u16
    })
});

/// The sRGB value whose linear value is nearest: `LINEAR` is ascending and every one of its values differs.
fn encode(linear: u16) -> u8 {
    let above = LINEAR.partition_point(|&v| v < linear).min(255);
    let below = above.saturating_sub(1);
    if linear.abs_diff(LINEAR[below]) < linear.abs_diff(LINEAR[above]) { below as u8 } else { above as u8 }
}

/// The next mipmap: averages of two by two pixels in linear light. Of an odd edge the last pixel is left out.
fn half(image: &RgbaImage) -> RgbaImage {
    let (width, height) = image.dimensions();
    let (last_x, last_y) = (width - 1, height - 1);
    RgbaImage::from_fn((width / 2).max(1), (height / 2).max(1), |x, y| {
        let (left, right) = ((2 * x).min(last_x), (2 * x + 1).min(last_x));
        let (top, bottom) = ((2 * y).min(last_y), (2 * y + 1).min(last_y));
        let four = [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| image.get_pixel(x, y).0);
        let color = |channel: usize| {
            let sum: u32 = four.iter().map(|p| u32::from(LINEAR[usize::from(p[channel])])).sum();
            encode(((sum + 2) / 4) as u16)
        };
        let alpha: u32 = four.iter().map(|p| u32::from(p[3])).sum();
        image::Rgba([color(0), color(1), color(2), ((alpha + 2) / 4) as u8])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_inverts_and_mipmaps_average_light() {
        for value in 0..=255u8 {
            assert_eq!(encode(LINEAR[usize::from(value)]), value);
        }
        let image = RgbaImage::from_fn(3, 2, |x, _| image::Rgba(if x == 0 { [255, 0, 9, 255] } else { [0, 0, 9, 0] }));
        let small = half(&image);
        assert_eq!(small.dimensions(), (1, 1));
        assert_eq!(small.get_pixel(0, 0).0, [188, 0, 9, 128], "half the light of white is 188");
        assert_eq!(half(&small).dimensions(), (1, 1));
    }

    #[test]
    fn hostile_images_are_refused() {
        assert!(decode(b"").is_err());
        assert!(decode(b"\x89PNG\r\n\x1a\n garbage").is_err());
        let mut huge = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\x7f\xff\xff\xff\x7f\xff\xff\xff\x08\x06\0\0\0".to_vec();
        huge.extend_from_slice(&[0; 64]);
        assert!(decode(&huge).is_err());
    }
}
