//! What was found, frame by frame, and how it is told.

use serde::Serialize;

use crate::say::say;

/// A scene's figures.
#[derive(Serialize)]
pub struct Table {
    pub scene: String,
    pub path: String,
    pub size_px: [u32; 2],
    pub triangles: usize,
    /// Shares of all triangles.
    pub budgets: Vec<f64>,
    pub tessellation: TessellationFigures,
    /// Sizes of the visible set, frame by frame.
    pub visible: Vec<usize>,
    pub ways: Vec<WayFigures>,
    pub drawing: Option<DrawingFigures>,
    pub completion: Option<CompletionFigures>,
    /// Occlusion culling, with and without an estimate's leaves drawn first.
    pub occluders: Vec<OccluderFigures>,
    /// Of a frame in the middle, where pictures are wanted: the exact one, and each way's at the largest budget.
    #[serde(skip)]
    pub pictures: Vec<(String, image::RgbaImage)>,
}

#[derive(Serialize)]
pub struct TessellationFigures {
    pub cells: u64,
    pub references_per_triangle: f64,
    /// Memory, as a share of the geometry on the GPU.
    pub share_of_geometry: f64,
    /// The same with every instance apart.
    pub share_of_instances: f64,
    pub time_ms: f64,
}

/// A way to choose triangles.
#[derive(Default, Serialize)]
pub struct WayFigures {
    pub name: String,
    /// For each budget.
    pub budgets: Vec<BudgetFigures>,
    /// Frame by frame: what share of the estimate changes when the view turns by 0.1 degrees, beyond that of the visible set.
    pub popping: Vec<f64>,
}

/// Frame by frame.
#[derive(Default, Serialize)]
pub struct BudgetFigures {
    /// ε_k.
    pub coverage: Vec<f64>,
    /// Share of the picture.
    pub wrong_pixels: Vec<f64>,
    /// Up to this budget.
    pub traversal_ms: Vec<f64>,
    pub draw_ms: Vec<f64>,
}

/// Frame by frame.
#[derive(Default, Serialize)]
pub struct DrawingFigures {
    pub gpu: String,
    /// The visible set.
    pub exact_ms: Vec<f64>,
    /// All leaves, whether in the frustum or not.
    pub all_ms: Vec<f64>,
    /// All that is in the frustum, by leaves.
    pub whole_ms: Vec<f64>,
    /// The same by numbers of triangles.
    pub by_numbers_ms: Vec<f64>,
}

/// Frame by frame.
#[derive(Default, Serialize)]
pub struct OccluderFigures {
    pub name: &'static str,
    pub time_ms: Vec<f64>,
    pub triangles: Vec<u64>,
}

/// Frame by frame.
#[derive(Default, Serialize)]
pub struct CompletionFigures {
    /// From which way and budget on.
    pub from: String,
    pub time_ms: Vec<f64>,
    pub rounds: Vec<u32>,
    pub triangles: Vec<u64>,
    pub wrong_pixels: Vec<usize>,
}

pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

impl Table {
    /// k/|V|: the best that any order could find, mean over the frames.
    fn bound(&self, budget: f64) -> f64 {
        let count = (budget * self.triangles as f64).floor();
        mean(&self.visible.iter().map(|visible| (count / (*visible).max(1) as f64).min(1.0)).collect::<Vec<_>>())
    }

    pub fn print(&self) {
        let Self { scene, path, triangles, visible, tessellation, .. } = self;
        let [width, height] = self.size_px;
        let seen = mean(&visible.iter().map(|count| *count as f64).collect::<Vec<_>>());
        say!(
            "{scene}, path {path}, {} frames of {width}x{height}: {triangles} triangles, {seen:.0} of them visible",
            visible.len()
        );
        say!(
            "{} cells, {:.2} references a triangle, {:.1} % of the geometry ({:.1} % of it with every instance apart), tessellated in {:.1} s",
            tessellation.cells,
            tessellation.references_per_triangle,
            tessellation.share_of_geometry * 100.0,
            tessellation.share_of_instances * 100.0,
            tessellation.time_ms / 1e3
        );
        let line = |name: &str, values: Vec<f64>, rest: &str| {
            let cells: String = values.iter().map(|value| format!("{value:>8.1}")).collect();
            say!("{name:<32}{cells}{rest}");
        };
        line("budget, %", self.budgets.iter().map(|share| share * 100.0).collect(), "");
        line("found at best, %", self.budgets.iter().map(|share| self.bound(*share) * 100.0).collect(), "");
        let percent = |share: f64| share * 100.0;
        let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
        for way in &self.ways {
            let each = |of: &dyn Fn(&BudgetFigures) -> f64| way.budgets.iter().map(of).collect::<Vec<f64>>();
            let worst = way.popping.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let popping = match way.popping[..] {
                [] => String::new(),
                _ => format!("   popping {:.2} %, at worst {:.2} %", percent(mean(&way.popping)), percent(worst)),
            };
            line(&format!("{}: found, %", way.name), each(&|b| percent(mean(&b.coverage))), &popping);
            line("  in the worst frame", each(&|b| percent(least(&b.coverage))), "");
            line("  wrong pixels, %", each(&|b| percent(mean(&b.wrong_pixels))), "");
            line("  in the worst frame", each(&|b| percent(greatest(&b.wrong_pixels))), "");
            if way.budgets.iter().all(|budget| !budget.traversal_ms.is_empty()) {
                line("  traversal, ms", each(&|b| median(b.traversal_ms.clone())), "");
            }
            if let Some(drawing) = &self.drawing
                && way.budgets.iter().all(|budget| !budget.draw_ms.is_empty())
            {
                line("  drawing, ms", each(&|b| median(b.draw_ms.clone())), "");
                line("  times as fast as all", each(&|b| median(ratios(&drawing.all_ms, &b.draw_ms))), "");
                line("  as what is in the frustum", each(&|b| median(ratios(&drawing.whole_ms, &b.draw_ms))), "");
            }
        }
        if let Some(drawing) = &self.drawing {
            let by_numbers = median(ratios(&drawing.by_numbers_ms, &drawing.whole_ms));
            say!(
                "all: {:.1} ms; in the frustum: {:.1} ms, by numbers of triangles {by_numbers:.2} times that; the visible set: {:.1} ms, {:.1} times as fast as all",
                median(drawing.all_ms.clone()),
                median(drawing.whole_ms.clone()),
                median(drawing.exact_ms.clone()),
                median(ratios(&drawing.all_ms, &drawing.exact_ms))
            );
        }
        if let Some(done) = &self.completion {
            say!(
                "completed from {}: {:.1} ms, {:.1} rounds, {:.0} triangles drawn at last; {} pixels differ in all frames",
                done.from,
                median(done.time_ms.clone()),
                mean(&done.rounds.iter().map(|rounds| f64::from(*rounds)).collect::<Vec<_>>()),
                mean(&done.triangles.iter().map(|count| *count as f64).collect::<Vec<_>>()),
                done.wrong_pixels.iter().sum::<usize>()
            );
        }
        for way in &self.occluders {
            let triangles: Vec<f64> = way.triangles.iter().map(|count| *count as f64).collect();
            say!("{:<32}{:>8.1} ms{:>10.0} triangles", way.name, median(way.time_ms.clone()), mean(&triangles));
        }
        say!("");
    }
}

fn ratios(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a / b.max(f64::MIN_POSITIVE)).collect()
}
