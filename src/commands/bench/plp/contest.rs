//! All ways to choose triangles on the same frames, held against the visible set.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use glam::DAffine3;
use mullion_client::frame::Planner;
use mullion_client::gpu::Gpu;
use mullion_client::occlusion::Occlusion;
use mullion_client::plp::{Solidity, Traversal};
use mullion_common::scene::{Package, Tessellation};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Projection, Wall};
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::generate::Random;
use mullion_server::prepare::plp::TessellationStatistics;
use mullion_server::tree::CullTree;

use super::table::{BudgetFigures, CompletionFigures, DrawingFigures, OccluderFigures, Table, TessellationFigures, WayFigures};
use crate::plp::{Drawing, Judge, Seen, change};

/// Width and height of the picture.
pub const SIZE_PX: [u32; 2] = [1024, 1024];
/// At this budget, or the nearest one above, popping is measured and completion begins.
const MIDDLE: f64 = 0.05;
/// What is drawn at random is drawn in the order that comes of this seed and the frame's number.
const SEED: u64 = 0x6d75_6c6c_696f_6e21;

/// Occlusion culling: whether nothing is known of the frame before, and whether an estimate's leaves are drawn first.
const CULLED: [(&str, bool, bool); 4] = [
    ("culled", false, false),
    ("culled, estimate first", false, true),
    ("culled anew", true, false),
    ("culled anew, estimate first", true, true),
];

fn culling() -> Planner {
    Planner::new().culling(Occlusion::Hiz)
}

/// One scene's.
pub struct Contest<'a> {
    package: &'a Package,
    tessellation: &'a Tessellation,
    wall: &'a Wall,
    judge: Judge<'a>,
    drawing: Option<Drawing<'a>>,
    culler: Culler,
    tree: CullTree,
    /// Those that the tessellation covers.
    covered: VisibleSet,
    solidities: Vec<Solidity>,
    traversals: Vec<Traversal>,
    budgets: Vec<f64>,
    /// By way: solidities, then the nearest, then at random.
    ways: Vec<WayFigures>,
    visible: Vec<usize>,
    drawn: DrawingFigures,
    completed: CompletionFigures,
    occluders: Vec<(Planner, OccluderFigures)>,
    /// The frame of which pictures are kept.
    pub pictures_of: Option<u64>,
    pictures: Vec<(String, image::RgbaImage)>,
}

impl<'a> Contest<'a> {
    /// Uploads the scene, which has a tessellation.
    pub fn new(
        package: &'a Package,
        wall: &'a Wall,
        gpu: Option<&Arc<Gpu>>,
        (solidities, budgets): (&[Solidity], &[f64]),
    ) -> Result<Self> {
        let tessellation = package.scene.tessellation.as_deref().context("the scene was tessellated")?;
        let names = solidities.iter().map(|solidity| solidity.name()).chain(["nearest", "random"]);
        let way = |name: &str| WayFigures {
            name: name.to_owned(),
            budgets: budgets.iter().map(|_| BudgetFigures::default()).collect(),
            popping: Vec::new(),
        };
        let ranges = tessellation.leaves().iter().map(|leaf| LeafRange::new(*leaf, leaf + 1));
        Ok(Self {
            judge: Judge::new(package, tessellation, wall, SIZE_PX),
            drawing: gpu.map(|gpu| Drawing::new(gpu, package, SIZE_PX)).transpose()?,
            culler: Culler::new(Algorithm::Sweep, wall),
            tree: CullTree::new(Arc::clone(&package.scene.hierarchy)),
            covered: VisibleSet::from_ranges(ranges),
            ways: names.map(way).collect(),
            traversals: solidities.iter().map(|_| Traversal::new()).collect(),
            solidities: solidities.to_vec(),
            budgets: budgets.to_vec(),
            visible: Vec::new(),
            drawn: DrawingFigures { gpu: gpu.map(|gpu| gpu.describe()).unwrap_or_default(), ..DrawingFigures::default() },
            completed: CompletionFigures::default(),
            occluders: CULLED.map(|(name, ..)| (culling(), OccluderFigures { name, ..OccluderFigures::default() })).into(),
            pictures_of: None,
            pictures: Vec::new(),
            package,
            tessellation,
            wall,
        })
    }

    fn budget(&self, at: usize) -> u32 {
        (self.budgets[at] * self.judge.triangles() as f64) as u32
    }

    fn middle(&self) -> usize {
        self.budgets.iter().position(|share| *share >= MIDDLE).unwrap_or(self.budgets.len() - 1)
    }

    /// Measures a frame.
    pub fn measure(&mut self, number: u64, world_from_room: &DAffine3) -> Result<()> {
        let turned = self.judge.turned(world_from_room);
        let (seen, next) = (self.judge.look(world_from_room), self.judge.look(&turned));
        self.visible.push(seen.visible().len());
        let mut sets = [VisibleSet::default()];
        self.culler.cull(&self.tree, self.wall, &self.wall.default_eyes(), world_from_room, &mut sets);
        let mut in_frustum = VisibleSet::default();
        sets[0].intersection_into(&self.covered, &mut in_frustum);
        let has_pictures = self.pictures_of == Some(number);
        let exact = self.draw_whole(&seen, &in_frustum, has_pictures)?;
        for way in 0..self.solidities.len() {
            self.estimate(way, (&seen, &next), (&in_frustum, exact.as_ref()), has_pictures)?;
        }
        let nearest = self.judge.nearest(&seen);
        let mut at_random = nearest.clone();
        shuffle(&mut at_random, &mut Random::new(SEED ^ number));
        for (order, way) in [nearest, at_random].iter().zip(self.solidities.len()..) {
            for at in 0..self.budgets.len() {
                let held = self.judge.first_of(order, self.budget(at));
                let verdict = self.judge.judge(&seen, |slot| held[slot as usize]);
                self.ways[way].budgets[at].coverage.push(verdict.coverage);
                self.ways[way].budgets[at].wrong_pixels.push(verdict.wrong_pixels);
            }
        }
        Ok(())
    }

    /// Draws all that is in the frustum, in both ways. Gives the picture, where one is needed.
    fn draw_whole(&mut self, seen: &Seen, visible: &VisibleSet, has_pictures: bool) -> Result<Option<image::RgbaImage>> {
        let Some(drawing) = &mut self.drawing else { return Ok(None) };
        if self.drawn.whole_ms.is_empty() {
            // What is drawn first pays for what is made then.
            drawing.draw_by_numbers(&seen.projection, visible)?;
            drawing.draw(&seen.projection, visible, None)?;
        }
        self.drawn.all_ms.push(ms(drawing.draw(&seen.projection, &self.covered, None)?.time));
        let exact = self.judge.by_leaf(seen.visible());
        self.drawn.exact_ms.push(ms(drawing.draw_parts(&seen.projection, &exact)?.time));
        self.drawn.by_numbers_ms.push(ms(drawing.draw_by_numbers(&seen.projection, visible)?.time));
        self.drawn.whole_ms.push(ms(drawing.draw(&seen.projection, visible, None)?.time));
        let exact = drawing.picture()?;
        if has_pictures {
            self.pictures.push(("exact".to_owned(), exact.clone()));
        }
        Ok(Some(exact))
    }

    fn estimate(
        &mut self,
        way: usize,
        (seen, next): (&Seen, &Seen),
        (visible, exact): (&VisibleSet, Option<&image::RgbaImage>),
        has_pictures: bool,
    ) -> Result<()> {
        let (solidity, middle) = (self.solidities[way], self.middle());
        let mut time = self.judge.begin(&mut self.traversals[way], seen, solidity);
        let mut held = Vec::new();
        for at in 0..self.budgets.len() {
            let budget = self.budget(at);
            let traversal = &mut self.traversals[way];
            time += self.judge.project(traversal, seen, budget);
            let verdict = self.judge.judge(seen, |slot| traversal.drawn().holds(slot));
            let figures = &mut self.ways[way].budgets[at];
            figures.coverage.push(verdict.coverage);
            figures.wrong_pixels.push(verdict.wrong_pixels);
            figures.traversal_ms.push(ms(time));
            if at == middle {
                held = slots(traversal, self.judge.triangles());
            }
            if at == 0 && way + 1 == self.solidities.len() {
                self.cull(way, &seen.projection, visible)?;
            }
            let Some(drawing) = &mut self.drawing else { continue };
            let estimate = self.traversals[way].estimate(self.tessellation);
            let cost = drawing.draw(&seen.projection, visible, Some(estimate))?;
            self.ways[way].budgets[at].draw_ms.push(ms(cost.time));
            if has_pictures && at + 1 == self.budgets.len() {
                let name = format!("{}-{}", solidity.name(), self.budgets[at] * 100.0);
                self.pictures.push((name, drawing.picture()?));
            }
            if let Some(exact) = exact.filter(|_| at == middle && way + 1 == self.solidities.len() && drawing.can_complete()) {
                let frame = self.judge.frame(seen);
                let cost = drawing.complete(&seen.projection, visible, &frame, &self.traversals[way])?;
                let wrong = drawing.picture()?.pixels().zip(exact.pixels()).filter(|(a, b)| a != b).count();
                self.completed.from = format!("{} at {} %", solidity.name(), self.budgets[at] * 100.0);
                self.completed.time_ms.push(ms(cost.time));
                self.completed.rounds.push(cost.rounds);
                self.completed.triangles.push(cost.triangles);
                self.completed.wrong_pixels.push(wrong);
            }
        }
        let (budget, traversal) = (self.budget(middle), &mut self.traversals[way]);
        self.judge.begin(traversal, next, solidity);
        self.judge.project(traversal, next, budget);
        let popping = change(&held, &slots(traversal, self.judge.triangles())) - change(seen.visible(), next.visible());
        self.ways[way].popping.push(popping);
        Ok(())
    }

    /// Culls what is hidden, with the leaves of an estimate drawn first, and without.
    fn cull(&mut self, way: usize, projection: &Projection, visible: &VisibleSet) -> Result<()> {
        let Some(drawing) = self.drawing.as_mut().filter(|drawing| drawing.can_complete()) else { return Ok(()) };
        let found = self.traversals[way].drawn().leaves().map(|(place, _)| self.tessellation.leaves()[place as usize]);
        let found = VisibleSet::from_ranges(found.map(|leaf| LeafRange::new(leaf, leaf + 1)));
        for ((planner, figures), (_, is_cold, has_occluders)) in self.occluders.iter_mut().zip(CULLED) {
            if is_cold {
                *planner = culling();
            }
            let cost = drawing.cull(planner, projection, visible, has_occluders.then_some(&found))?;
            figures.time_ms.push(ms(cost.time));
            figures.triangles.push(cost.triangles);
        }
        Ok(())
    }

    /// What was found in all frames.
    pub fn table(self, (scene, path): (&str, &str), tessellation_ms: f64) -> Result<Table> {
        let statistics = TessellationStatistics::of(self.package).context("the scene was tessellated")?;
        Ok(Table {
            scene: scene.to_owned(),
            path: path.to_owned(),
            size_px: SIZE_PX,
            triangles: self.judge.triangles(),
            budgets: self.budgets,
            tessellation: TessellationFigures {
                cells: statistics.cells,
                references_per_triangle: statistics.references_per_triangle(),
                share_of_geometry: statistics.share_of_geometry(),
                share_of_instances: statistics.share_of_instances(),
                time_ms: tessellation_ms,
            },
            visible: self.visible,
            ways: self.ways,
            drawing: self.drawing.is_some().then_some(self.drawn),
            completion: (!self.completed.rounds.is_empty()).then_some(self.completed),
            occluders: self.occluders.into_iter().map(|(_, figures)| figures).filter(|f| !f.time_ms.is_empty()).collect(),
            pictures: self.pictures,
        })
    }
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

fn slots(traversal: &Traversal, triangles: usize) -> Vec<u32> {
    (0..triangles as u32).filter(|slot| traversal.drawn().holds(*slot)).collect()
}

/// Fisher and Yates.
fn shuffle(order: &mut [u32], random: &mut Random) {
    for at in (1..order.len()).rev() {
        order.swap(at, random.below(at + 1));
    }
}
