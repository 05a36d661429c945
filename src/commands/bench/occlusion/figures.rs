//! Figures 5, 7 and 9 (Bartz, Meißner, Hüttner 1999): frame rate and share culled, frame by frame.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::table::Table;
use crate::files::file_name;
use crate::plot::{self, Frame, Scale, Series};

/// Draws two figures of each table into a folder, which must be there; gives the files.
///
/// # Errors
/// When a file cannot be written.
pub fn draw(tables: &[Table], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for table in tables {
        let title = format!("{}: {}", table.scene, table.path);
        for (at, what, y_title, y_scale) in
            [(0, "frame-rate", "frames a second", Scale::Log), (1, "culled", "share of the model culled, %", Scale::Linear)]
        {
            let frame = Frame { title: &title, x_title: "frame", y_title, y_scale };
            let series: Vec<Series> = (table.rows.iter())
                .map(|row| Series { name: row.mode.clone(), values: row.by_frame.iter().map(|values| values[at]).collect() })
                .collect();
            let file = folder.join(format!("{}-{what}.svg", file_name(&table.scene)));
            fs::write(&file, plot::lines(&frame, &series)?).with_context(|| format!("cannot write {}", file.display()))?;
            files.push(file);
        }
    }
    Ok(files)
}
