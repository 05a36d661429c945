//! What is checked before anything is decoded: version, extensions, buffers, buffer views, accessors.
//!
//! The outcome is an [`Asset`]: JSON, buffers and buffer views whose ranges are known to lie in
//! memory, and a budget that every decoded array is taken from.
use super::accessor::Accessor;
use super::container::{Container, MAX_FILE_BYTES};
use super::error::{Fault, invalid, over_cap, resolve};
use super::json::Root;
use super::{meshopt, uri};
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Most bytes that all decoded arrays of one file, its instances and leaves may take, whatever its size.
pub const MAX_DECODED_BYTES: u64 = 16 << 30;
/// Decoded bytes granted to any file, however small.
pub const DECODED_BYTES_FLOOR: u64 = 256 << 20;
/// Decoded bytes granted per byte of the file's JSON and buffers. Shared accessors are decoded once for each
/// primitive that uses them, and compressed views grow, so honest files need more than one.
pub const DECODED_BYTES_PER_FILE_BYTE: u64 = 64;

/// Extensions read in full.
const READ: &[&str] = &[
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_materials_pbrSpecularGlossiness",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
];

/// The bytes behind a buffer view.
pub(super) enum ViewBytes<'a> {
    /// In memory, exactly the view's length.
    Here(Cow<'a, [u8]>),
    /// The buffer has no URI and is no binary chunk: legal until something reads it.
    Absent,
}

pub(super) struct View<'a> {
    pub bytes: ViewBytes<'a>,
    pub byte_length: usize,
    pub byte_stride: Option<usize>,
}

/// A checked file, ready to decode from.
pub(super) struct Asset<'a> {
    pub json: &'a Root<'a>,
    pub views: Vec<View<'a>>,
    pub budget: Budget,
    pub quantized: bool,
}

/// Bytes that may still be decoded.
pub(super) struct Budget {
    left: AtomicU64,
    limit: u64,
}

impl Budget {
    pub fn new(file_bytes: u64) -> Budget {
        let limit =
            file_bytes.saturating_mul(DECODED_BYTES_PER_FILE_BYTE).saturating_add(DECODED_BYTES_FLOOR).min(MAX_DECODED_BYTES);
        Budget { left: AtomicU64::new(limit), limit }
    }

    /// Takes `count` elements of `element_bytes`, before memory is taken for them.
    pub fn take(&self, count: usize, element_bytes: usize, place: impl Fn() -> String) -> Result<(), Fault> {
        let bytes = (count as u64).checked_mul(element_bytes as u64);
        bytes
            .and_then(|bytes| self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(bytes)).ok())
            .map(|_| ())
            .ok_or_else(|| {
                let reason = "decoding would take more memory than the file's size justifies";
                over_cap(place(), reason, "DECODED_BYTES", self.limit)
            })
    }
}

/// Version and extensions. Runs first, so that a file for another reader says so instead of failing on a detail.
pub(super) fn asset_header(json: &Root, warnings: &mut Vec<String>) -> Result<(), Fault> {
    let asset = json.asset.as_ref().ok_or_else(|| Fault::Version("the `asset` object is missing".into()))?;
    let version = asset.version.as_deref().ok_or_else(|| Fault::Version("`version` is missing".into()))?;
    let parse = |key: &str, text: &str| {
        parse_version(text).ok_or_else(|| Fault::Version(format!("{key} {:?} is not `major.minor`", short(text))))
    };
    let (major, minor) = parse("version", version)?;
    if major != 2 {
        return Err(Fault::Version(format!("version {version}, only 2.x is read")));
    }
    match asset.min_version.as_deref() {
        Some(text) => {
            let least = parse("minVersion", text)?;
            if least > (major, minor) {
                return Err(Fault::Version(format!("minVersion {text} is above its own version {version}")));
            }
            if least > (2, 0) {
                return Err(Fault::Version(format!("minVersion {text}, only 2.0 is read")));
            }
        }
        None if minor > 0 => warnings.push(format!("asset version {version} is read as 2.0")),
        None => {}
    }
    for name in json.extensions_required.iter() {
        if !READ.contains(&name.as_str()) {
            return Err(Fault::Extension(short(name)));
        }
    }
    for name in json.extensions_used.iter() {
        if !READ.contains(&name.as_str()) {
            warnings.push(format!("optional extension {} is not read", short(name)));
        }
    }
    Ok(())
}

fn parse_version(text: &str) -> Option<(u32, u32)> {
    let (major, minor) = text.split_once('.')?;
    let digits = |part: &str| (!part.is_empty() && part.bytes().all(|b| b.is_ascii_digit())).then(|| part.parse().ok())?;
    Some((digits(major)?, digits(minor)?))
}

fn short(text: &str) -> String {
    super::error::one_line(text.chars().take(80).collect::<String>())
}

/// A buffer's bytes. Buffers that name one file share them.
#[derive(Clone)]
pub(super) enum Buffer<'a> {
    Chunk(&'a [u8]),
    Read(Arc<Vec<u8>>),
}

impl std::ops::Deref for Buffer<'_> {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        match self {
            Buffer::Chunk(bytes) => bytes,
            Buffer::Read(bytes) => bytes,
        }
    }
}

/// The buffers of a file; `None` for one without data.
pub(super) struct Buffers<'a> {
    pub list: Vec<Option<Buffer<'a>>>,
    /// Bytes of the JSON and of all buffers, those that buffers share counted once.
    file_bytes: u64,
}

/// Loads the buffers that `json` names: the GLB's chunk, embedded data, files beside the asset.
pub(super) fn load_buffers<'a>(json: &Root, container: &'a Container, folder: &Path) -> Result<Buffers<'a>, Fault> {
    let mut total = 0u64;
    let mut files: HashMap<PathBuf, Buffer> = HashMap::new();
    let mut list = Vec::new();
    for (k, buffer) in json.buffers.iter().enumerate() {
        let place = format!("buffer {k}");
        let length = buffer.byte_length.ok_or_else(|| invalid(&place, "byteLength is missing"))?.0;
        let bytes = match (&buffer.uri, container.bin()) {
            (Some(text), _) => {
                let file = uri::locate(&text.0, folder);
                match file.as_ref().and_then(|file| files.get(file)) {
                    Some(shared) => Some(shared.clone()),
                    None => {
                        let bytes = uri::read(&text.0, folder, &place, MAX_FILE_BYTES.saturating_sub(total))?;
                        total += bytes.len() as u64;
                        let bytes = Buffer::Read(Arc::new(bytes));
                        files.extend(file.map(|file| (file, bytes.clone())));
                        Some(bytes)
                    }
                }
            }
            (None, Some(bin)) if k == 0 => Some(Buffer::Chunk(bin)),
            (None, _) => None,
        };
        let held = bytes.as_ref().map_or(u64::MAX, |bytes| bytes.len() as u64);
        if length > held {
            return Err(invalid(place, format_args!("byteLength {length}, but only {held} bytes are there")));
        }
        list.push(bytes);
    }
    let container = container.json().len() + container.bin().map_or(0, <[u8]>::len);
    Ok(Buffers { list, file_bytes: total + container as u64 })
}

impl<'a> Asset<'a> {
    pub fn new(json: &'a Root<'a>, buffers: &'a Buffers<'a>) -> Result<Asset<'a>, Fault> {
        let budget = Budget::new(buffers.file_bytes);
        let views = (0..json.buffer_views.len()).map(|k| view(json, &buffers.list, k, &budget)).collect::<Result<Vec<_>, _>>()?;
        let quantized =
            json.extensions_used.iter().chain(json.extensions_required.iter()).any(|name| name == "KHR_mesh_quantization");
        let asset = Asset { json, views, budget, quantized };
        for k in 0..json.accessors.len() {
            Accessor::resolve(&asset, k as u64, format_args!("accessor {k}"))?.check_sparse(&asset.budget)?;
        }
        Ok(asset)
    }
}

fn view<'a>(json: &'a Root, buffers: &'a [Option<Buffer<'a>>], k: usize, budget: &Budget) -> Result<View<'a>, Fault> {
    let raw = &json.buffer_views[k];
    let place = format!("bufferView {k}");
    let buffer = raw.buffer.ok_or_else(|| invalid(&place, "buffer is missing"))?;
    let length = raw.byte_length.ok_or_else(|| invalid(&place, "byteLength is missing"))?.0;
    let offset = raw.byte_offset.0;
    let (b, declared) = resolve(&json.buffers, buffer.0, "buffer", &place)?;
    let declared = declared.byte_length.unwrap_or_default().0;
    if offset.checked_add(length).is_none_or(|end| end > declared) {
        return Err(invalid(place, format_args!("bytes {offset} + {length} lie past the {declared} bytes of buffer {b}")));
    }
    let byte_stride = match raw.byte_stride {
        Some(stride) if stride.0 == 0 || stride.0 > 252 => {
            // 4 to 252 by the specification; small odd strides are read as they stand.
            return Err(invalid(place, format_args!("byteStride {}, allowed are 4 to 252", stride.0)));
        }
        Some(stride) => Some(stride.0 as usize),
        None => None,
    };
    let compressed = raw.extensions.as_ref().and_then(|e| e.meshopt.as_ref());
    let bytes = match (compressed, &buffers[b]) {
        (Some(compressed), _) => ViewBytes::Here(Cow::Owned(meshopt::decode(compressed, buffers, length, &place, budget)?)),
        // In range: `offset + length <= declared <= bytes.len()`.
        (None, Some(bytes)) => ViewBytes::Here(Cow::Borrowed(&bytes[offset as usize..(offset + length) as usize])),
        (None, None) => ViewBytes::Absent,
    };
    let byte_length = usize::try_from(length).map_err(|_| invalid(&place, "byteLength is beyond this machine"))?;
    Ok(View { bytes, byte_length, byte_stride })
}
