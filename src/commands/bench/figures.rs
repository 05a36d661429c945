//! The paper's figures 4, 5b and 6 (Nirnimesh, Harish, Narayanan 2006, section 5), from what was measured.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::moving::MovingTable;
use super::table::Table;
use crate::files::file_name;
use crate::plot::{self, Frame, Scale, Series};

/// Algorithms whose times are shown against the number of tiles.
const BY_TILES: [&str; 2] = ["adaptive", "sweep"];

/// Draws all figures of the tables into a folder, which must be there; gives the files.
///
/// # Errors
/// When a file cannot be written.
pub fn draw(tables: &[Table], moving: &[MovingTable], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for table in tables {
        let name = format!("{}-{}-frames.svg", file_name(&table.scene), table.grid);
        files.push(write(&frame_by_frame(table)?, folder.join(name))?);
    }
    for of_scene in tables.chunk_by(|a, b| a.scene == b.scene).filter(|tables| tables.len() > 1) {
        if let Some(figure) = by_tiles(of_scene)? {
            files.push(write(&figure, folder.join(format!("{}-tiles.svg", file_name(&of_scene[0].scene))))?);
        }
    }
    for of_wall in moving.chunk_by(|a, b| (&a.scene, &a.grid) == (&b.scene, &b.grid)) {
        let name = format!("{}-{}-moving.svg", file_name(&of_wall[0].scene), of_wall[0].grid);
        files.push(write(&by_moving(of_wall)?, folder.join(name))?);
    }
    Ok(files)
}

/// Figure 6: moving, refitting and culling against the share of objects that move.
fn by_moving(tables: &[MovingTable]) -> Result<String> {
    let frame = Frame {
        title: &format!("{} on {}: objects move before every frame", tables[0].scene, tables[0].grid),
        x_title: "moving objects, %",
        y_title: "median of moving, refitting and culling, µs",
        y_scale: Scale::Log,
    };
    let groups: Vec<String> = tables.iter().map(|table| table.percent.to_string()).collect();
    let series = tables[0].rows.iter().enumerate().map(|(at, row)| Series {
        name: row.name.clone(),
        values: tables.iter().map(|table| table.rows[at].total_us.median).collect(),
    });
    Ok(plot::bars(&frame, &groups, &series.collect::<Vec<_>>())?)
}

/// Figure 4: cull time of each algorithm, frame by frame, on a logarithmic axis.
fn frame_by_frame(table: &Table) -> Result<String> {
    let frame = Frame {
        title: &format!("{} on {}: {}", table.scene, table.grid, table.path),
        x_title: "frame",
        y_title: "cull time, all tiles together, µs",
        y_scale: Scale::Log,
    };
    let series = table.rows.iter().map(|row| Series { name: row.row.name.clone(), values: row.row.frame_us.clone() });
    Ok(plot::lines(&frame, &series.collect::<Vec<_>>())?)
}

/// Figure 5b: cull time against the tiles of the wall; `None` where none of [`BY_TILES`] was measured.
fn by_tiles(tables: &[Table]) -> Result<Option<String>> {
    let frame = Frame {
        title: &format!("{}: {}", tables[0].scene, tables[0].path),
        x_title: "tiles of the wall",
        y_title: "median cull time, all tiles together, µs",
        y_scale: Scale::Linear,
    };
    let groups: Vec<String> = tables.iter().map(|table| table.grid.clone()).collect();
    let median = |table: &Table, name: &str| Some(table.rows.iter().find(|row| row.row.name == name)?.row.cull_us.median);
    let series = BY_TILES.into_iter().filter_map(|name| {
        let values = tables.iter().map(|table| median(table, name)).collect::<Option<Vec<f64>>>()?;
        Some(Series { name: name.to_owned(), values })
    });
    let series: Vec<Series> = series.collect();
    if series.is_empty() { Ok(None) } else { Ok(Some(plot::bars(&frame, &groups, &series)?)) }
}

fn write(svg: &str, path: PathBuf) -> Result<PathBuf> {
    fs::write(&path, svg).with_context(|| path.display().to_string())?;
    Ok(path)
}
