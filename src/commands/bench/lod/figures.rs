//! Figures 2 to 7 (Birkholz, Rahn): the first frame without occlusion and with, from the eye, from above and from the side.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::table::Table;
use crate::files::file_name;

/// Writes a view's pictures into a folder, which must be there; gives the files.
///
/// # Errors
/// When a file cannot be written.
pub fn draw(table: &Table, folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for (of, picture) in &table.pictures {
        let file = folder.join(format!("{}-{of}.png", file_name(&table.view)));
        picture.save(&file).with_context(|| format!("cannot write {}", file.display()))?;
        files.push(file);
    }
    Ok(files)
}
