//! The table of one scene.

use serde::Serialize;

use crate::say::say;
use crate::show::Spread;

/// One scene, measured. Shares are of its triangles, means of all frames.
#[derive(Serialize)]
pub struct Table {
    pub scene: String,
    pub path: String,
    pub frames: u64,
    pub triangles: u64,
    pub leaves: u32,
    /// How much faster frames could be by their triangles: those in the frustum over those of leaves of which a pixel is seen.
    pub bound: f64,
    /// Of all leaves in the frustum, those of which no pixel is seen.
    pub without_pixel_percent: f64,
    /// Of all leaves in the frustum, those whose whole box is hidden in the final picture.
    pub box_hidden_percent: f64,
    pub rows: Vec<Row>,
}

/// One way to draw it.
#[derive(Serialize)]
pub struct Row {
    pub mode: String,
    pub culled_percent: f64,
    /// From the pose to the picture.
    pub frame_ms: Spread,
    /// All frames with frustum culling alone, over all frames with this.
    pub speed_up: f64,
    /// Of a frame's time: culling to the frustum, and by the GPU's clock testing and drawing; between them all else, which is planning and waiting.
    pub shares_percent: Option<[f64; 4]>,
    /// Bounds that were tested, in a frame.
    pub tests: f64,
    /// Of the leaves whose whole box is hidden in the final picture, those that were left out.
    pub hidden_culled_percent: f64,
    /// Of the leaves that were drawn, those of which no pixel is seen.
    pub false_visible_percent: f64,
    /// In all frames together.
    pub wrong_pixels: u64,
    /// Of all pixels.
    pub wrong_percent: f64,
    /// Of adaptive culling.
    pub threshold: Option<f64>,
    /// Frame by frame: frames a second, and the share culled.
    pub by_frame: Vec<[f64; 2]>,
}

impl Table {
    /// Prints it.
    pub fn print(&self) {
        let Self { scene, path, frames, triangles, leaves, bound, .. } = self;
        say!("{scene}: {triangles} triangles in {leaves} leaves, {path}, {frames} frames");
        say!(
            "by triangles {bound:.2} times as fast as frustum culling alone could be; of the leaves in the frustum {:.1} % have no pixel,",
            self.without_pixel_percent
        );
        say!("{:.1} % a hidden box", self.box_hidden_percent);
        say!(
            "{:16} {:>8} {:>10} {:>9} {:>8} {:>29} {:>8} {:>12} {:>13} {:>7}",
            "",
            "culled",
            "median ms",
            "p99 ms",
            "speed-up",
            "frustum/plan/test/draw",
            "tests",
            "boxes culled",
            "false visible",
            "wrong"
        );
        self.rows.iter().for_each(Row::print);
        say!("");
    }
}

impl Row {
    fn print(&self) {
        let shares = self.shares_percent.map_or_else(
            || "—".to_owned(),
            |[frustum, plan, test, draw]| format!("{frustum:.1} / {plan:.1} / {test:.1} / {draw:.1} %"),
        );
        say!(
            "{:16} {:7.2}% {:10.2} {:9.2} {:8.2} {shares:>29} {:8.0} {:11.2}% {:12.2}% {:7}",
            self.mode,
            self.culled_percent,
            self.frame_ms.median,
            self.frame_ms.p99,
            self.speed_up,
            self.tests,
            self.hidden_culled_percent,
            self.false_visible_percent,
            self.wrong_pixels,
        );
    }
}
