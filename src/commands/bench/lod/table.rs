//! What was found, frame by frame, and how it is told.

use serde::Serialize;

use crate::lod::{Distances, ImageError};
use crate::say::say;

/// A view's figures.
#[derive(Serialize)]
pub struct Table {
    pub view: String,
    pub scene: String,
    pub copies: u32,
    pub size_px: [u32; 2],
    /// Of the whole meshes.
    pub triangles: u64,
    pub budget: u32,
    pub is_drawn: bool,
    /// How often the frames were gone: times are those of the quickest run of each but the first; all else is of the first round.
    pub rounds: u32,
    /// Without occlusion first.
    pub ways: Vec<WayFigures>,
    pub fine: FineFigures,
    /// Of the first frame, from the eye, from above and from the side.
    #[serde(skip)]
    pub pictures: Vec<(String, image::RgbaImage)>,
}

/// Frame by frame.
#[derive(Default, Serialize)]
pub struct WayFigures {
    pub name: String,
    /// Triangles of which there is a pixel.
    pub visible: Vec<usize>,
    pub triangles: Vec<u32>,
    pub questions: Vec<u32>,
    pub refine_ms: Vec<f64>,
    /// Refinement and drawing.
    pub frame_ms: Vec<f64>,
    /// Of the first frame.
    pub error: ImageError,
}

/// Of the first frame, whatever the budget.
#[derive(Serialize)]
pub struct FineFigures {
    pub pixel_error: f32,
    pub triangles: u32,
    pub error: ImageError,
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

impl Table {
    /// VT_OC / VT_LOD − 1 of a way in a frame.
    fn improvement(&self, way: &WayFigures, frame: usize) -> f64 {
        way.visible[frame] as f64 / (self.ways[0].visible[frame] as f64).max(1.0) - 1.0
    }

    pub fn print(&self) {
        let Self { view, scene, copies, triangles, budget, fine, .. } = self;
        let [width, height] = self.size_px;
        let frames = self.ways[0].visible.len();
        let copies = if *copies > 1 { format!(", {copies} in a row") } else { String::new() };
        say!("{view}: {scene}{copies}, {frames} frames of {width}x{height}: {triangles} triangles, {budget} of them drawn");
        say!(
            "{:<17}{:>8}{:>9}{:>10}{:>10}{:>11}{:>11}{:>11}{:>9}{:>9}{:>9}{:>9}",
            "bounds",
            "drawn",
            "visible",
            "IR, %",
            "IR, mean",
            "questions",
            "refine, ms",
            "frame, ms",
            "cost, %",
            "cold, ms",
            "off, px",
            "p99, px"
        );
        for way in &self.ways {
            let improvements: Vec<f64> = (0..frames).map(|frame| self.improvement(way, frame) * 100.0).collect();
            // In the mean: a frame that draws occluders costs more than those that keep them. The first is told apart.
            let sum = |way: &WayFigures| way.frame_ms.iter().skip(1).sum::<f64>();
            let cost = (sum(way) / sum(&self.ways[0]) - 1.0) * 100.0;
            say!(
                "{:<17}{:>8}{:>9}{:>10.1}{:>10.1}{:>11.0}{:>11.2}{:>11.2}{:>9.1}{:>9.1}{:>9.2}{:>9.2}",
                way.name,
                way.triangles.iter().max().copied().unwrap_or(0),
                way.visible[0],
                improvements[0],
                mean(improvements.iter().copied()),
                mean(way.questions.iter().map(|count| f64::from(*count))),
                median(way.refine_ms.iter().copied()),
                median(way.frame_ms.iter().copied()),
                cost,
                way.frame_ms[0],
                way.error.all.mean_px,
                way.error.all.p99_px
            );
        }
        let ImageError { all, simplified } = &fine.error;
        let off = |of: &Distances| {
            format!("{:.2} pixels in the mean, {:.2} at the 99th percentile of {} pixels", of.mean_px, of.p99_px, of.pixels)
        };
        say!("wrong by at most {} pixels: {} triangles, off by {}", fine.pixel_error, fine.triangles, off(all));
        match simplified.pixels {
            0 => say!("nothing of what is simplified is seen"),
            pixels if pixels < all.pixels => say!("of what is simplified alone: {}", off(simplified)),
            _ => {}
        }
        say!("");
    }
}
