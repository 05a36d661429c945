//! The table of one scene on one wall.

use serde::Serialize;

use super::measure::Row;
use crate::say::say;

/// One scene on one wall, measured.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    pub scene: String,
    pub grid: String,
    pub tiles: u32,
    pub leaves: u32,
    /// Of the object hierarchy.
    pub nodes: u32,
    /// Memory of the hierarchy and of its wide form.
    pub tree_bytes: usize,
    pub path: String,
    pub frames: u64,
    pub rows: Vec<ComparedRow>,
}

/// A row and what it is held against.
#[derive(Clone, Debug, Serialize)]
pub struct ComparedRow {
    #[serde(flatten)]
    pub row: Row,
    /// Median over the median of `oh`, where that was measured.
    pub median_over_oh: Option<f64>,
    /// Median over the median of `adaptive`, where that was measured.
    pub median_over_adaptive: Option<f64>,
}

/// Puts beside each row how many times as long as `oh` and `adaptive` it takes.
pub fn compare(rows: Vec<Row>) -> Vec<ComparedRow> {
    let median_of = |name: &str| rows.iter().find(|row| row.name == name).map(|row| row.cull_us.median);
    let (oh, adaptive) = (median_of("oh"), median_of("adaptive"));
    let over = |row: &Row, base: Option<f64>| base.filter(|us| *us > 0.0).map(|us| row.cull_us.median / us);
    let compared = |row: Row| ComparedRow { median_over_oh: over(&row, oh), median_over_adaptive: over(&row, adaptive), row };
    rows.into_iter().map(compared).collect()
}

impl Table {
    /// Prints it. Counts are means of a frame, all tiles together.
    pub fn print(&self) {
        let Self { scene, grid, tiles, leaves, nodes, tree_bytes, path, frames, .. } = self;
        let mib = *tree_bytes as f64 / f64::from(1 << 20);
        say!("{scene}, {leaves} leaves in {nodes} nodes ({mib:.1} MiB), on {grid} ({tiles} tiles): {path}, {frames} frames");
        say!(
            "{:21} {:>10} {:>10} {:>10} {:>12} {:>11} {:>8} {:>7} {:>6} {:>10}",
            "algorithm",
            "median µs",
            "p99 µs",
            "nodes",
            "plane tests",
            "pairs",
            "ranges",
            "excess",
            "/ oh",
            "/ adaptive"
        );
        for ComparedRow { row, median_over_oh, median_over_adaptive } in &self.rows {
            say!(
                "{:21} {:10.1} {:10.1} {:10.0} {:12.0} {:11.0} {:8.0} {:>7} {:>6} {:>10}",
                row.name,
                row.cull_us.median,
                row.cull_us.p99,
                row.nodes_visited,
                row.plane_tests,
                row.leaf_tile_pairs,
                row.ranges,
                format!("{:.2}%", row.excess_percent),
                or_dash(*median_over_oh),
                or_dash(*median_over_adaptive)
            );
        }
        say!("");
    }
}

fn or_dash(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}
