//! Textures: found, recognised, and decoded once to prove that they can be. What is wrong with a
//! picture is a warning and a stand-in; what is wrong with its place (a URI that climbs out) is a fault.
use super::error::{Fault, invalid, one_line, resolve};
use super::validate::{Asset, ViewBytes};
use super::{ImageKind, SourceImage, json, uri};
use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Largest width and height of a texture, in pixels.
pub const MAX_IMAGE_SIDE_PX: u32 = 16384;
/// Most memory that decoding one texture may take, in bytes.
pub const MAX_IMAGE_DECODE_BYTES: u64 = 5 << 28;
/// Most pixels that all textures of a file may have together.
pub const MAX_IMAGE_PIXELS: u64 = 1 << 30;
/// Largest encoded picture, in bytes.
pub const MAX_IMAGE_FILE_BYTES: u64 = 1 << 30;
/// Most bytes that all encoded pictures outside the buffers may have together.
pub const MAX_IMAGE_TOTAL_BYTES: u64 = 4 << 30;

enum Source {
    Gltf(usize),
    None(String),
}

/// Where a picture's bytes lie: glTF images with the same place are one picture.
#[derive(PartialEq, Eq, Hash)]
enum Origin<'j> {
    File(PathBuf),
    Uri(&'j str),
    View(u64),
}

impl<'j> Origin<'j> {
    fn of(image: &'j json::Image, folder: &Path) -> Option<Origin<'j>> {
        let Some(text) = &image.uri else {
            return image.buffer_view.map(|view| Origin::View(view.0));
        };
        // What leads nowhere is reported when it is loaded.
        let file = (!is_data(&text.0)).then(|| uri::locate(&text.0, folder)).flatten();
        Some(file.map_or(Origin::Uri(&text.0), Origin::File))
    }
}

/// The pictures that base colour textures use, each once, in order of first use.
pub(super) struct ImageTable<'j> {
    images: &'j [json::Image<'j>],
    folder: &'j Path,
    sources: Vec<Source>,
    by_gltf: HashMap<usize, u32>,
    by_origin: HashMap<Origin<'j>, u32>,
}

impl<'j> ImageTable<'j> {
    pub fn new(json: &'j json::Root, folder: &'j Path) -> ImageTable<'j> {
        let (by_gltf, by_origin) = (HashMap::new(), HashMap::new());
        ImageTable { images: &json.images, folder, sources: Vec::new(), by_gltf, by_origin }
    }

    pub fn index_of(&mut self, gltf_image: usize) -> u32 {
        *self.by_gltf.entry(gltf_image).or_insert_with(|| {
            let next = self.sources.len() as u32;
            let index = match Origin::of(&self.images[gltf_image], self.folder) {
                Some(origin) => *self.by_origin.entry(origin).or_insert(next),
                None => next,
            };
            if index == next {
                self.sources.push(Source::Gltf(gltf_image));
            }
            index
        })
    }

    pub fn without_source(&mut self, place: &str, warnings: &mut Vec<String>) -> u32 {
        let why = format!("{place} has no image that is read (PNG and JPEG are)");
        warnings.push(why.clone());
        self.sources.push(Source::None(why));
        self.sources.len() as u32 - 1
    }
}

/// Loads and proves every image of `table`; `done` is told after each.
pub(super) fn load_all(
    asset: &Asset,
    table: &ImageTable,
    warnings: &mut Vec<String>,
    done: impl Fn(usize, usize),
) -> Result<Vec<SourceImage>, Fault> {
    for (k, image) in asset.json.images.iter().enumerate() {
        // Every URI is held to the folder, used or not; data URIs are decoded only when used.
        if let Some(text) = image.uri.as_ref().filter(|text| !is_data(&text.0)) {
            uri::parse(&text.0, &format!("image {k}"))?;
        }
    }
    let mut left = Left { pixels: MAX_IMAGE_PIXELS, bytes: MAX_IMAGE_TOTAL_BYTES };
    let mut images = Vec::with_capacity(table.sources.len());
    for (at, source) in table.sources.iter().enumerate() {
        let image = match source {
            Source::None(why) => SourceImage::Missing { why: why.clone() },
            Source::Gltf(k) => load(asset, *k, table.folder, &mut left)?.unwrap_or_else(|why| {
                let why = format!("image {k}: {why}");
                warnings.push(why.clone());
                SourceImage::Missing { why }
            }),
        };
        images.push(image);
        done(at + 1, table.sources.len());
    }
    Ok(images)
}

fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

/// What the pictures still to be loaded may take.
struct Left {
    pixels: u64,
    bytes: u64,
}

/// Outer error: the file is unsafe or broken. Inner error: the picture is missing or not one that we read.
fn load(asset: &Asset, k: usize, folder: &Path, left: &mut Left) -> Result<Result<SourceImage, String>, Fault> {
    let raw = &asset.json.images[k];
    let place = format!("image {k}");
    let bytes = match (&raw.uri, raw.buffer_view) {
        (Some(text), _) => match uri::read(&text.0, folder, &place, MAX_IMAGE_FILE_BYTES.min(left.bytes)) {
            // A data URI is bounded by the file that holds it, but not by what is left.
            Ok(bytes) if bytes.len() as u64 > left.bytes => {
                return Ok(Err(format!("all textures together exceed {MAX_IMAGE_TOTAL_BYTES} bytes")));
            }
            Ok(bytes) => {
                left.bytes -= bytes.len() as u64;
                bytes
            }
            Err(Fault::Io { path, reason }) => {
                return Ok(Err(format!("cannot read {path}: {reason}")));
            }
            Err(fault @ Fault::Invalid { .. }) if is_data(&text.0) => {
                return Ok(Err(fault.to_string()));
            }
            Err(fault) => return Err(fault),
        },
        (None, Some(view)) => {
            let (_, view) = resolve(&asset.views, view.0, "bufferView", &place)?;
            match &view.bytes {
                ViewBytes::Here(bytes) => {
                    asset.budget.take(bytes.len(), 1, || place.clone())?;
                    bytes.to_vec()
                }
                ViewBytes::Absent => return Ok(Err("its buffer has no data".into())),
            }
        }
        (None, None) => return Err(invalid(place, "has neither uri nor bufferView")),
    };
    Ok(prove(bytes, raw.mime_type.as_deref(), &mut left.pixels))
}

/// Recognises `bytes` by their magic, checks the size in the header, and decodes them once.
fn prove(bytes: Vec<u8>, stated: Option<&str>, pixels_left: &mut u64) -> Result<SourceImage, String> {
    let (format, mime) = match image::guess_format(&bytes) {
        Ok(image::ImageFormat::Png) => (image::ImageFormat::Png, ImageKind::Png),
        Ok(image::ImageFormat::Jpeg) => (image::ImageFormat::Jpeg, ImageKind::Jpeg),
        _ => {
            return Err(format!("is neither PNG nor JPEG (stated: {})", one_line(stated.unwrap_or("nothing"))));
        }
    };
    let mut reader = image::ImageReader::with_format(Cursor::new(&bytes), format);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_IMAGE_SIDE_PX);
    limits.max_image_height = Some(MAX_IMAGE_SIDE_PX);
    limits.max_alloc = Some(MAX_IMAGE_DECODE_BYTES);
    let size = image::ImageReader::with_format(Cursor::new(&bytes), format).into_dimensions();
    let (width, height) = size.map_err(|e| one_line(format_args!("header: {e}")))?;
    if width > MAX_IMAGE_SIDE_PX || height > MAX_IMAGE_SIDE_PX {
        return Err(format!("{width} x {height} pixels, at most {MAX_IMAGE_SIDE_PX} a side are read"));
    }
    let pixels = u64::from(width) * u64::from(height);
    *pixels_left =
        pixels_left.checked_sub(pixels).ok_or_else(|| format!("all textures together exceed {MAX_IMAGE_PIXELS} pixels"))?;
    reader.limits(limits);
    reader.decode().map_err(|e| one_line(format_args!("does not decode: {e}")))?;
    Ok(SourceImage::Encoded { bytes, mime, width, height })
}
