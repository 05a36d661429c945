//! Figures 5, 7 and 9 (Bartz, Meißner, Hüttner 1999): frame rate and share culled, frame by frame; and what adaptive culling culls and costs
//! at each threshold.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::table::{Row, Table};
use crate::files::file_name;
use crate::plot::{self, Frame, Scale, Series};

/// Draws two figures of each table, and one of its thresholds, into a folder, which must be there; gives the files.
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
        if let Some(figure) = by_threshold(table)? {
            let file = folder.join(format!("{}-threshold.svg", file_name(&table.scene)));
            fs::write(&file, figure).with_context(|| format!("cannot write {}", file.display()))?;
            files.push(file);
        }
    }
    Ok(files)
}

/// Share culled and wrong pixels against the threshold, where there are several.
fn by_threshold(table: &Table) -> Result<Option<String>> {
    let rows: Vec<(&Row, f64)> = table.rows.iter().filter_map(|row| Some((row, row.threshold?))).collect();
    if rows.len() < 2 {
        return Ok(None);
    }
    let frame = Frame {
        title: &format!("{}: what contributes less than a threshold is left out", table.scene),
        x_title: "threshold, share of the view plane",
        y_title: "%",
        y_scale: Scale::Log,
    };
    let groups: Vec<String> = rows.iter().map(|(_, threshold)| threshold.to_string()).collect();
    let series = |name: &str, value: fn(&Row) -> f64| Series {
        name: name.to_owned(),
        values: rows.iter().map(|(row, _)| value(row)).collect(),
    };
    let series = [series("model culled", |row| row.culled_percent), series("wrong pixels", |row| row.wrong_percent)];
    Ok(Some(plot::bars(&frame, &groups, &series)?))
}
