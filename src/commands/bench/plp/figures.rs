//! Figures 8 and 9 (Klosowski, Silva 1999): what was found and how long it took to draw, frame by frame, and the exact picture beside the
//! estimates.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::table::{BudgetFigures, Table, WayFigures};
use crate::files::file_name;
use crate::plot::{self, Frame, Scale, Series};

/// Draws the figures of each table into a folder, which must be there; gives the files.
///
/// # Errors
/// When a file cannot be written.
pub fn draw(tables: &[Table], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for table in tables {
        let name = file_name(&table.scene);
        for way in table.ways.iter().filter(|way| way.budgets.iter().all(|budget| !budget.traversal_ms.is_empty())) {
            let file = folder.join(format!("{name}-{}-found.svg", way.name));
            fs::write(&file, found(table, way)?).with_context(|| format!("cannot write {}", file.display()))?;
            files.push(file);
            if let Some(figure) = times(table, way)? {
                let file = folder.join(format!("{name}-{}-times.svg", way.name));
                fs::write(&file, figure).with_context(|| format!("cannot write {}", file.display()))?;
                files.push(file);
            }
        }
        for (of, picture) in &table.pictures {
            let file = folder.join(format!("{name}-{of}.png"));
            picture.save(&file).with_context(|| format!("cannot write {}", file.display()))?;
            files.push(file);
        }
    }
    Ok(files)
}

fn series(table: &Table, way: &WayFigures, of: fn(&Table, &BudgetFigures) -> Vec<f64>) -> Vec<Series> {
    let of_budget = |(share, figures): (&f64, &BudgetFigures)| Series {
        name: format!("{} at {} %", way.name, share * 100.0),
        values: of(table, figures),
    };
    table.budgets.iter().zip(&way.budgets).rev().map(of_budget).collect()
}

fn found(table: &Table, way: &WayFigures) -> Result<String> {
    let title = format!("{}: visible triangles found", table.scene);
    let frame = Frame { title: &title, x_title: "frame", y_title: "triangles", y_scale: Scale::Linear };
    let count = |table: &Table, figures: &BudgetFigures| {
        table.visible.iter().zip(&figures.coverage).map(|(visible, share)| *visible as f64 * share).collect()
    };
    let exact = Series { name: "exact".to_owned(), values: table.visible.iter().map(|visible| *visible as f64).collect() };
    let nearest = table.ways.iter().find(|way| way.name == "nearest");
    let nearest = nearest.and_then(|nearest| series(table, nearest, count).into_iter().next());
    let lines: Vec<Series> = [exact].into_iter().chain(series(table, way, count)).chain(nearest).collect();
    Ok(plot::lines(&frame, &lines)?)
}

fn times(table: &Table, way: &WayFigures) -> Result<Option<String>> {
    let Some(drawing) = &table.drawing else { return Ok(None) };
    let title = format!("{}: time to draw", table.scene);
    let frame = Frame { title: &title, x_title: "frame", y_title: "milliseconds", y_scale: Scale::Log };
    let whole = Series { name: "the whole".to_owned(), values: drawing.whole_ms.clone() };
    let lines: Vec<Series> = [whole].into_iter().chain(series(table, way, |_, figures| figures.draw_ms.clone())).collect();
    Ok(Some(plot::lines(&frame, &lines)?))
}
