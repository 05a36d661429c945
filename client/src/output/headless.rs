//! Pictures as PNG files.

use std::fs;
use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ImageEncoder, RgbaImage};
use thiserror::Error;

/// Why a picture was not written.
#[derive(Debug, Error)]
#[error("{}: {reason}", path.display())]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// What went wrong.
    pub reason: String,
}

/// Writes a picture to `path`, making the folders above it. The file appears whole or not at all.
///
/// # Errors
/// When the file system refuses.
pub fn write_png(path: &Path, image: &RgbaImage) -> Result<(), WriteError> {
    let failed = |e: &dyn std::fmt::Display| WriteError { path: path.to_owned(), reason: e.to_string() };
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|e| failed(&e))?;
    }
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(image, image.width(), image.height(), image::ExtendedColorType::Rgba8)
        .map_err(|e| failed(&e))?;
    let mut partial = path.as_os_str().to_owned();
    partial.push(format!(".{}.part", std::process::id()));
    let partial = PathBuf::from(partial);
    fs::write(&partial, bytes).and_then(|()| fs::rename(&partial, path)).map_err(|e| failed(&e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_come_back_from_their_files() {
        let folder = std::env::temp_dir().join(format!("mullion-headless-{}", std::process::id()));
        let image = RgbaImage::from_fn(5, 3, |x, y| image::Rgba([x as u8 * 50, y as u8 * 80, 7, 255]));
        let path = folder.join("tiles/t0x0.png");
        write_png(&path, &image).expect("written");
        assert_eq!(image::open(&path).expect("readable").into_rgba8(), image);
        let listed = fs::read_dir(folder.join("tiles")).expect("a folder").count();
        assert_eq!(listed, 1, "nothing partial is left");
        assert!(write_png(&path.join("below a file.png"), &image).is_err());
        fs::remove_dir_all(folder).expect("removable");
    }
}
