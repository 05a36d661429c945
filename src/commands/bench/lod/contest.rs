//! Refinement without occlusion and with, on the same frames.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use image::RgbaImage;
use mullion_client::frame::Planner;
use mullion_client::gpu::{Attachments, Gpu, QueryOccluder, Renderer, ViewTarget};
use mullion_client::lod::{BoundsKind, DepthOccluder, KeptOccluder, LodOptions, LodSight, OCCLUDER_PX, OccluderFrom, Refinement};
use mullion_common::scene::ObjectId;
use mullion_common::wall::ViewId;
use mullion_common::wire::DetailWeight;

use super::table::{FineFigures, Table, WayFigures};
use super::views::View;
use super::{Answers, Options};
use crate::drawn::{self, Hints};
use crate::lod::{ImageError, Look, Seen, Subject};

const VIEW: ViewId = ViewId(0);

/// One view's.
pub struct Contest<'a> {
    options: &'a Options,
    view: &'a View,
    subject: &'a Subject,
    ways: Vec<Way>,
    drawing: Option<Drawing<'a>>,
    gpu: Option<&'a Arc<Gpu>>,
    ids: Vec<ObjectId>,
}

struct Way {
    asked: Option<(Answers, BoundsKind)>,
    refinement: Refinement,
    occluder: Asked,
    weight: DetailWeight,
    figures: WayFigures,
}

/// What a frame took.
#[derive(Clone, Copy)]
struct Taken {
    refine_ms: f64,
    /// Refinement and drawing.
    frame_ms: f64,
}

/// What says what is hidden.
enum Asked {
    Nothing,
    Depths(Box<KeptOccluder>),
    Queries(Box<QueryOccluder>),
}

impl Asked {
    fn new(asked: Option<(Answers, BoundsKind)>, options: &Options, gpu: Option<&Arc<Gpu>>) -> Result<Self> {
        Ok(match (asked, gpu) {
            (Some((Answers::Depths, kind)), _) => {
                let depths = DepthOccluder::new([options.occluder_px.unwrap_or(OCCLUDER_PX); 2], kind);
                Self::Depths(Box::new(KeptOccluder::new(depths)))
            }
            (Some((Answers::Queries, kind)), Some(gpu)) => {
                Self::Queries(Box::new(QueryOccluder::new(gpu, [options.occluder_px.unwrap_or(options.size); 2], kind)?))
            }
            _ => Self::Nothing,
        })
    }
}

impl Way {
    fn new(asked: Option<(Answers, BoundsKind)>, options: &Options, gpu: Option<&Arc<Gpu>>) -> Result<Self> {
        let name = match asked {
            None => "without".to_owned(),
            Some((Answers::Depths, kind)) => format!("{kind:?}").to_lowercase(),
            Some((Answers::Queries, kind)) => format!("{kind:?}-queries").to_lowercase(),
        };
        let occluder = Asked::new(asked, options, gpu)?;
        let weight = options.lod_weight;
        Ok(Self { asked, refinement: Refinement::new(), occluder, weight, figures: WayFigures { name, ..WayFigures::default() } })
    }

    /// As before the first frame, but for its figures.
    fn forget(&mut self, options: &Options, gpu: Option<&Arc<Gpu>>) -> Result<()> {
        self.refinement = Refinement::new();
        self.occluder = Asked::new(self.asked, options, gpu)?;
        Ok(())
    }

    /// How long it takes.
    fn refine(&mut self, subject: &Subject, look: &Look, options: &LodOptions, frame: u64) -> Result<Duration> {
        let start = Instant::now();
        let sight = LodSight {
            eye: look.projection.eye,
            planes: &look.frustum.planes,
            pixels_per_radian: look.pixels_per_radian,
            near_m: look.near_m as f32,
        };
        let (mut objects, refinement) = (subject.objects(), &mut self.refinement);
        match &mut self.occluder {
            Asked::Depths(occluder) => {
                let view = (&look.projection, frame);
                occluder.refine(refinement, &mut objects, (&sight, options), view, (self.weight, subject.tessellated()));
            }
            Asked::Queries(occluder) => {
                occluder.look(&look.projection);
                refinement.refine(&objects, &sight, options, Some((&mut **occluder, OccluderFrom::ThisFrameAlone)));
                occluder.check()?;
            }
            Asked::Nothing => refinement.refine(&objects, &sight, options, None),
        }
        Ok(start.elapsed())
    }

    /// Of all objects, those that are drawn.
    fn ids(&self, all: &[ObjectId]) -> Vec<ObjectId> {
        all.iter().enumerate().filter(|(at, _)| self.refinement.is_in_sight(*at)).map(|(_, object)| *object).collect()
    }

    fn seen(&self, subject: &Subject, look: &Look, size_px: [u32; 2]) -> Seen {
        subject.seen(look, self.refinement.cuts(), size_px)
    }
}

/// Draws one view of a subject.
struct Drawing<'a> {
    subject: &'a Subject,
    renderer: Renderer,
    planner: Planner,
}

impl<'a> Drawing<'a> {
    fn new(gpu: &Arc<Gpu>, subject: &'a Subject, size_px: [u32; 2]) -> Result<Self> {
        let targets = [ViewTarget { view: VIEW, size_px }];
        let mut renderer = Renderer::new(Arc::clone(gpu), subject.manifest(), &targets, Attachments::Color)?;
        for leaf in subject.others.leaves() {
            let leaf = subject.package.scene.manifest.leaves[leaf as usize];
            renderer.upload(leaf.chunk, subject.package.chunk(leaf.chunk))?;
        }
        Ok(Self { subject, renderer, planner: Planner::new() })
    }

    /// How long it takes.
    fn draw(&mut self, look: &Look, way: &Way, ids: &[ObjectId]) -> Result<Duration> {
        let start = Instant::now();
        self.renderer.set_cuts(self.subject.cut_objects(way.refinement.cuts()))?;
        let ids = way.ids(ids);
        let hints = Hints { cuts: &ids, ..Hints::default() };
        let view = (VIEW, look.projection, &self.subject.others);
        drawn::draw_with(&mut self.renderer, &mut self.planner, &self.subject.package, view, hints)?;
        self.renderer.wait()?;
        Ok(start.elapsed())
    }

    fn picture(&self) -> Result<RgbaImage> {
        Ok(self.renderer.read_color(VIEW)?)
    }
}

impl<'a> Contest<'a> {
    /// Readies what is drawn.
    pub fn new(options: &'a Options, view: &'a View, subject: &'a Subject, gpu: Option<&'a Arc<Gpu>>) -> Result<Self> {
        let kinds = |answers: Answers| options.bounds.iter().map(move |bounds| Some((answers, bounds.kind())));
        let asked = std::iter::once(None).chain(options.answers.iter().flat_map(|answers| kinds(*answers)));
        let ways = asked.map(|asked| Way::new(asked, options, gpu)).collect::<Result<_>>()?;
        let drawing = gpu.map(|gpu| Drawing::new(gpu, subject, [options.size; 2])).transpose()?;
        Ok(Self { options, view, subject, ways, drawing, gpu, ids: subject.ids() })
    }

    fn lod_options(&self, budget: u32, least_pixels: f32) -> LodOptions {
        let mut occluders = LodOptions::NEVER;
        occluders.iter_mut().zip(&self.options.occluders).for_each(|(to, steps)| *to = *steps);
        LodOptions { budget, least_pixels, occluders, odd_levels: self.options.odd_levels }
    }

    /// Measures all frames.
    pub fn run(mut self, scene: &str) -> Result<Table> {
        let size_px = [self.options.size; 2];
        let lod = self.lod_options(self.options.triangles, 0.0);
        let mut pictures = Vec::new();
        let first = self.view.look(self.subject, 0, self.options.size);
        let whole = self.subject.seen_whole(&first, size_px);
        let fine = self.refine_finely(&first, &whole)?;
        for frame in 0..self.options.frames {
            let look = self.view.look(self.subject, frame, self.options.size);
            for at in turns(frame, self.ways.len()) {
                let taken = self.go(at, &look, &lod, frame)?;
                let way = &mut self.ways[at];
                let seen = way.seen(self.subject, &look, size_px);
                if frame == 0 {
                    way.figures.error = ImageError::between(&first, &seen, &whole);
                    if let Some(drawing) = self.drawing.as_mut().filter(|_| self.options.plots.is_some()) {
                        pictures.push((way.figures.name.clone(), drawing.picture()?));
                        let above = ("above", self.view.above(self.subject, self.options.size));
                        let aside = ("aside", self.view.aside(self.subject, self.options.size));
                        for (from, look) in [above, aside] {
                            drawing.draw(&look, way, &self.ids)?;
                            pictures.push((format!("{}-{from}", way.figures.name), drawing.picture()?));
                        }
                    }
                }
                way.figures.visible.push(seen.triangles());
                way.figures.triangles.push(way.refinement.triangle_count());
                way.figures.questions.push(way.refinement.question_count());
                way.figures.refine_ms.push(taken.refine_ms);
                way.figures.frame_ms.push(taken.frame_ms);
            }
        }
        // Of a single frame nothing is compared but how it is when all is cold.
        let rounds = if self.options.frames > 1 { self.options.rounds } else { 1 };
        for _ in 1..rounds {
            self.go_again(&lod)?;
        }
        Ok(Table {
            view: self.view.name.to_owned(),
            scene: scene.to_owned(),
            copies: self.view.copies,
            size_px,
            triangles: self.subject.triangle_count(),
            budget: self.options.triangles,
            is_drawn: self.drawing.is_some(),
            rounds,
            ways: self.ways.into_iter().map(|way| way.figures).collect(),
            fine,
            pictures,
        })
    }

    /// A frame, one way.
    fn go(&mut self, at: usize, look: &Look, lod: &LodOptions, frame: u64) -> Result<Taken> {
        let way = &mut self.ways[at];
        let refined = way.refine(self.subject, look, lod, frame)?;
        let drawn = self.drawing.as_mut().map(|drawing| drawing.draw(look, way, &self.ids)).transpose()?;
        Ok(Taken { refine_ms: ms(refined), frame_ms: ms(refined + drawn.unwrap_or_default()) })
    }

    /// All frames once more: of each the quickest run counts, whatever else the machine did in the others. The first is told as it was when all was cold.
    fn go_again(&mut self, lod: &LodOptions) -> Result<()> {
        for way in &mut self.ways {
            way.forget(self.options, self.gpu)?;
        }
        for frame in 0..self.options.frames {
            let look = self.view.look(self.subject, frame, self.options.size);
            for at in turns(frame, self.ways.len()) {
                let taken = self.go(at, &look, lod, frame)?;
                let WayFigures { refine_ms, frame_ms, .. } = &mut self.ways[at].figures;
                if frame > 0 && taken.frame_ms < frame_ms[frame as usize] {
                    (refine_ms[frame as usize], frame_ms[frame as usize]) = (taken.refine_ms, taken.frame_ms);
                }
            }
        }
        Ok(())
    }

    /// Refines until no surface is wrong by so many pixels.
    fn refine_finely(&mut self, look: &Look, whole: &Seen) -> Result<FineFigures> {
        let lod = self.lod_options(u32::MAX, self.options.pixel_error);
        let mut way = Way::new(self.ways.get(1).and_then(|way| way.asked), self.options, self.gpu)?;
        way.refine(self.subject, look, &lod, 0)?;
        let seen = way.seen(self.subject, look, whole.size_px());
        Ok(FineFigures {
            pixel_error: self.options.pixel_error,
            triangles: way.refinement.triangle_count(),
            error: ImageError::between(look, &seen, whole),
        })
    }
}

/// Whoever comes first has the colder caches: ways take turns.
fn turns(frame: u64, ways: usize) -> impl Iterator<Item = usize> {
    (0..ways).map(move |turn| (turn + frame as usize) % ways)
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
