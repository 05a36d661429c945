//! Opens what users name: scenes and walls.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use mullion_common::identity::{IdentityFile, MAX_IDENTITY_BYTES};
use mullion_common::scene::Package;
use mullion_common::wall::{Wall, WallConfig};
use mullion_server::generate::{GenerateError, GeneratedScene, write_glb};
use mullion_server::prepare::{self, PrepareOptions, bounded};
use serde::Serialize;

use crate::progress::Progress;

/// Opens a package, or prepares a glTF or GLB file on the way; prints warnings.
pub fn open_scene(path: &Path, options: &PrepareOptions) -> Result<Package> {
    let progress = Progress::new();
    let prepared = prepare::open(path, options, &|stage, done, total| progress.show(stage, done, total));
    progress.finish();
    let prepared = prepared?;
    for warning in &prepared.warnings {
        eprintln!("warning: {warning}");
    }
    Ok(prepared.package)
}

/// The file that was named, or that of a generated scene, which is written into `folder`.
pub fn scene_file(scene: &str, folder: &Path) -> Result<PathBuf> {
    const SEED: u64 = 1;
    if Path::new(scene).exists() {
        return Ok(PathBuf::from(scene));
    }
    match scene.parse::<GeneratedScene>() {
        Ok(generated) => {
            let path = folder.join(format!("{}.glb", file_name(scene)));
            write_glb(generated, SEED, &path)?;
            Ok(path)
        }
        Err(GenerateError::Unknown { .. }) => Ok(PathBuf::from(scene)),
        Err(error) => Err(error).with_context(|| scene.to_owned()),
    }
}

/// Opens a scene file, or generates the scene of that name and prepares it.
pub fn open_named_scene(scene: &str, options: &PrepareOptions) -> Result<Package> {
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    open_scene(&scene_file(scene, folder.path())?, options)
}

/// A name for a file: letters, digits, `-`, `_` and `.` stay, anything else becomes `-`.
pub fn file_name(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' }).collect()
}

/// Makes way for a new file: one of that name that is there becomes `NAME.1`, or the next number that is free. Gives its new name.
pub fn set_aside(path: &Path) -> Result<Option<PathBuf>> {
    if !path.is_file() {
        return Ok(None); // nothing, or no file that could be lost: a pipe, a device
    }
    let numbered = |n: u32| {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".{n}"));
        PathBuf::from(name)
    };
    let free = (1..).map(numbered).find(|other| !other.exists()).context("no number is free")?;
    fs::rename(path, &free).with_context(|| format!("{}: cannot be renamed", path.display()))?;
    Ok(Some(free))
}

/// Reads and checks a wall file.
pub fn open_wall(path: &Path) -> Result<Wall> {
    const MAX_WALL_BYTES: u64 = 1 << 20;
    let shown = path.display();
    let bytes = bounded::read(path, MAX_WALL_BYTES).with_context(|| shown.to_string())?;
    let text = String::from_utf8(bytes).map_err(|_| anyhow!("{shown}: is no text: a wall file is TOML in UTF-8"))?;
    WallConfig::parse(&text).map_err(|error| anyhow!("{shown}: {error}"))
}

/// Reads the certificate, key and authority of a master or a node.
pub fn open_identity(path: &Path) -> Result<IdentityFile> {
    let shown = path.display();
    let bytes = bounded::read(path, MAX_IDENTITY_BYTES).with_context(|| shown.to_string())?;
    IdentityFile::parse(&bytes).map_err(|error| anyhow!("{shown}: {error}"))
}

/// Whether a user named standard output.
pub fn is_standard_output(path: &Path) -> bool {
    path == Path::new("-")
}

/// Creates the file that a report will go to, so that a long show does not end with nowhere to write it.
pub fn claim(path: &Path) -> Result<()> {
    if is_standard_output(path) {
        return Ok(());
    }
    fs::File::create(path).map(drop).with_context(|| path.display().to_string())
}

/// Writes a value as JSON to a file, or to standard output for `-`.
pub fn write_json(value: &impl Serialize, path: &Path) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    write_text(&text, path)
}

/// Writes text to a file, or to standard output for `-`.
pub fn write_text(text: &str, path: &Path) -> Result<()> {
    if is_standard_output(path) {
        return match std::io::stdout().lock().write_all(text.as_bytes()) {
            Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error).context("standard output"),
            _ => Ok(()), // whoever reads it has had enough
        };
    }
    fs::write(path, text).with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_set_aside_is_never_lost() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("show.rec");
        assert_eq!(set_aside(&file).unwrap(), None);
        for (n, text) in ["first", "second", "third"].iter().enumerate() {
            fs::write(&file, text).unwrap();
            let aside = folder.path().join(format!("show.rec.{}", n + 1));
            assert_eq!(set_aside(&file).unwrap(), Some(aside.clone()));
            assert_eq!(fs::read_to_string(aside).unwrap(), *text);
        }
        assert!(!file.exists());
        assert_eq!(fs::read_to_string(folder.path().join("show.rec.1")).unwrap(), "first");
    }
}
