//! Scenes from above: a wall's frusta drawn into them, and what occlusion culling left out in yellow, as figures 4, 6, 8 and 10 show it
//! (Bartz, Meißner, Hüttner 1999).

mod bird;
mod canvas;
mod wedge;

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};
use image::imageops::{self, FilterType};
use image::{Rgba, RgbaImage};
use mullion_client::frame::Planner;
use mullion_client::gpu::{Attachments, Gpu, Renderer, ViewTarget};
use mullion_client::occlusion::Occlusion;
use mullion_client::output::headless::write_png;
use mullion_common::camera_path::CameraPath;
use mullion_common::geometry::{Aabb, Frustum};
use mullion_common::scene::{ObjectId, Package, Transform};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{ViewId, Wall};
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::tree::CullTree;

use self::bird::Bird;
use self::canvas::{Canvas, Veil};
use self::wedge::Wedge;
use crate::drawn;
use crate::files::{self, file_name, is_standard_output};

const SIZE_PX: [u32; 2] = [960, 720];
/// The scene is drawn so many times as wide and high: edges become smooth.
const OVERSAMPLING: u32 = 2;
/// Frames that are drawn before a picture is taken: what is seen, and what became hidden, is known by then.
const FRAMES: u64 = 8;
/// What is further out than so many half diagonals of the scene does not count when the bird looks for its place.
const FAR_EYE: f64 = 3.0;

const YELLOW: Rgba<u8> = Rgba([255, 216, 0, 255]);
/// How much of it there is where one box stands, and most where many do.
const VEIL: [f64; 2] = [0.45, 0.75];
const BOX_EDGE: Rgba<u8> = Rgba([150, 110, 0, 255]);
const BOX_EDGE_OPACITY: f64 = 0.12;
const FRUSTUM: Rgba<u8> = Rgba([214, 20, 60, 255]);
const HALO: Rgba<u8> = Rgba([255, 255, 255, 255]);
const LINE_PX: f64 = 2.4;
const HALO_PX: f64 = 5.0;
const EYE_PX: f64 = 6.0;

/// Creates the file that a picture will go to, so that long work does not end with nowhere to write it.
///
/// # Errors
/// When the file cannot be made, and for standard output.
pub fn claim(path: &Path) -> Result<()> {
    ensure!(!is_standard_output(path), "--birdseye: a picture goes to a file, not to standard output");
    files::claim(path).context("--birdseye")
}

/// Where the picture of one of several scenes goes.
pub fn file_of(path: &Path, scene: &str) -> PathBuf {
    let stem = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let end = path.extension().map_or_else(String::new, |end| format!(".{}", end.to_string_lossy()));
    path.with_file_name(format!("{stem}-{}{end}", file_name(scene)))
}

/// The way of a wall through a scene in which nothing moves.
pub struct Flight<'a> {
    pub package: &'a Package,
    pub wall: &'a Wall,
    pub path: &'a CameraPath,
    /// The frame that is looked at.
    pub last: u64,
    pub occlusion: Occlusion,
}

/// What a picture shows in yellow.
pub struct LeftOut {
    frame: u64,
    occlusion: Occlusion,
    leaves: u32,
    of: u32,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frame, occlusion, leaves, of } = self;
        write!(f, "frame {frame}, occlusion culling {occlusion}: {leaves} of the {of} leaves in the frustum left out")
    }
}

impl Flight<'_> {
    /// Draws the frames up to the last again, on all tiles, and writes a picture of what was drawn in that; tells how much was left out.
    ///
    /// # Errors
    /// When the GPU fails, or the file cannot be written.
    pub fn write(&self, gpu: &Arc<Gpu>, path: &Path) -> Result<LeftOut> {
        let Self { package, wall, last, occlusion, .. } = *self;
        let (sets, drawn) = self.draw(gpu)?;
        let mut visible = VisibleSet::default();
        sets.iter().flat_map(VisibleSet::ranges).for_each(|range| visible.push_unordered(*range));
        visible.normalize();
        let eyes = wall.default_eyes();
        let world_from_room = self.path.pose(last);
        let frusta: Vec<Frustum> =
            (0..).zip(&eyes).map(|(view, eye)| wall.frustum(ViewId(view), *eye, &world_from_room)).collect();
        let transforms = &package.scene.manifest.transforms;
        let scene = Above { package, transforms, frusta: &frusta, visible: &visible, drawn: &drawn };
        write_png(path, &scene.picture(gpu)?)?;
        Ok(LeftOut { frame: last, occlusion, leaves: visible.len() - drawn.len(), of: visible.len() })
    }

    /// What each view may see in the last frame, and what was drawn for any.
    fn draw(&self, gpu: &Arc<Gpu>) -> Result<(Vec<VisibleSet>, VisibleSet)> {
        let Self { package, wall, path, last, occlusion } = *self;
        let size_of = |view: usize| wall.tile(wall.views()[view].tile).size_px;
        // One target for all tiles of a size: they are drawn one after the other.
        let mut sizes: Vec<[u32; 2]> = (0..wall.views().len()).map(size_of).collect();
        sizes.sort_unstable();
        sizes.dedup();
        let targets: Vec<ViewTarget> =
            (0..).zip(&sizes).map(|(at, size)| ViewTarget { view: ViewId(at), size_px: *size }).collect();
        let mut renderer = drawn::upload(gpu, package, &targets, Attachments::ColorAndIds)?;
        let mut planners: Vec<Planner> = wall.views().iter().map(|_| Planner::new().culling(occlusion)).collect();
        let mut culler = Culler::new(Algorithm::Sweep, wall);
        let tree = CullTree::new(Arc::clone(&package.scene.hierarchy));
        let (eyes, mut sets) = (wall.default_eyes(), vec![VisibleSet::default(); wall.views().len()]);
        let mut union = VisibleSet::default();
        for frame in last.saturating_sub(FRAMES - 1)..=last {
            let world_from_room = path.pose(frame);
            sets.iter_mut().for_each(VisibleSet::clear);
            culler.cull(&tree, wall, &eyes, &world_from_room, &mut sets);
            union.clear();
            for (view, set) in sets.iter().enumerate() {
                let target = ViewId(sizes.binary_search(&size_of(view)).unwrap_or(0) as u16); // every size is in there
                let projection = wall.projection(ViewId(view as u16), eyes[view], &world_from_room);
                let drawn = drawn::draw(&mut renderer, &mut planners[view], package, (target, projection, set))?.leaves;
                drawn.ranges().iter().for_each(|range| union.push_unordered(*range));
            }
            union.normalize();
        }
        Ok((sets, union))
    }
}

/// A frame, to be looked at from above.
pub struct Above<'a> {
    pub package: &'a Package,
    /// Where the objects stand.
    pub transforms: &'a [Transform],
    /// What the views see.
    pub frusta: &'a [Frustum],
    /// Leaves in any of the frusta.
    pub visible: &'a VisibleSet,
    /// Those of them that were drawn.
    pub drawn: &'a VisibleSet,
}

impl Above<'_> {
    /// The whole scene, its frusta, and boxes of what is in the frusta and was not drawn.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn picture(&self, gpu: &Arc<Gpu>) -> Result<RgbaImage> {
        let corners: Vec<[DVec3; 8]> = (0..self.package.scene.leaf_count()).map(|leaf| self.corners(leaf)).collect();
        let bounds = Aabb::of_points(corners.iter().flatten().copied());
        let wedges: Vec<Wedge> = wedge::cones(self.frusta).iter().map(|cone| cone.within(&bounds)).collect();
        let bird = self.bird(&corners, &bounds, &wedges);
        let mut canvas = Canvas::new(self.scene(gpu, &bird)?);
        self.veil_hidden(&bird, &corners, &mut canvas);
        outline(&wedges, &bird, &mut canvas);
        Ok(canvas.into_picture())
    }

    /// A leaf's box as it stands.
    fn corners(&self, leaf: u32) -> [DVec3; 8] {
        let record = &self.package.scene.manifest.leaves[leaf as usize];
        let world_from_local = self.transforms[record.object.0 as usize].affine();
        record.local_aabb().corners().map(|corner| world_from_local.transform_point3(corner))
    }

    /// One that sees all of the scene, and what the frusta cut out of it.
    fn bird(&self, corners: &[[DVec3; 8]], bounds: &Aabb, wedges: &[Wedge]) -> Bird {
        let reach_m = FAR_EYE * bounds.size().length() / 2.0;
        let ends = wedges.iter().flat_map(|wedge| wedge.edges.iter().flatten().chain([&wedge.eye]));
        let near = ends.copied().filter(|end| end.distance(bounds.center()) < reach_m);
        let ahead = self.frusta.iter().flat_map(|frustum| frustum.rays).map(DVec3::normalize_or_zero).sum();
        Bird::above(corners.iter().flatten().copied().chain(near), ahead, SIZE_PX)
    }

    /// All leaves.
    fn scene(&self, gpu: &Arc<Gpu>, bird: &Bird) -> Result<RgbaImage> {
        const VIEW: ViewId = ViewId(0);
        let targets = [ViewTarget { view: VIEW, size_px: SIZE_PX.map(|edge| edge * OVERSAMPLING) }];
        let mut renderer: Renderer = drawn::upload(gpu, self.package, &targets, Attachments::Color)?;
        for (object, transform) in (0..).zip(self.transforms) {
            renderer.set_transform(ObjectId(object), *transform);
        }
        let all = VisibleSet::all(self.package.scene.leaf_count());
        drawn::draw(&mut renderer, &mut Planner::new(), self.package, (VIEW, bird.projection(), &all))?;
        Ok(imageops::resize(&renderer.read_color(VIEW)?, SIZE_PX[0], SIZE_PX[1], FilterType::Triangle))
    }

    fn veil_hidden(&self, bird: &Bird, corners: &[[DVec3; 8]], canvas: &mut Canvas) {
        let mut hidden = VisibleSet::default();
        self.visible.difference_into(self.drawn, &mut hidden);
        let hull = |leaf: u32| canvas::hull(corners[leaf as usize].iter().filter_map(|corner| bird.place(*corner)).collect());
        let hulls: Vec<Vec<DVec2>> = hidden.leaves().map(hull).collect();
        let mut veil = Veil::new(SIZE_PX);
        hulls.iter().for_each(|hull| veil.cover(hull));
        canvas.draw_veil(&veil, YELLOW, VEIL);
        hulls.iter().for_each(|hull| canvas.outline(hull, (BOX_EDGE, BOX_EDGE_OPACITY), 1.0));
    }
}

/// Draws the frusta: first what is around the lines, so that none is cut where two cross.
fn outline(wedges: &[Wedge], bird: &Bird, canvas: &mut Canvas) {
    let edges = wedges.iter().flat_map(|wedge| wedge.edges.iter().chain(&wedge.approach));
    let lines: Vec<[DVec2; 2]> = edges.filter_map(|[from, to]| bird.segment(*from, *to)).collect();
    for (color, width) in [(HALO, HALO_PX), (FRUSTUM, LINE_PX)] {
        lines.iter().for_each(|line| canvas.line(*line, (color, 1.0), width));
        for eye in wedges.iter().filter_map(|wedge| bird.place(wedge.eye)) {
            canvas.disc(eye, color, EYE_PX + (width - LINE_PX) / 2.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DAffine3;
    use mullion_client::gpu::GpuOptions;
    use mullion_common::visible_set::LeafRange;
    use mullion_server::prepare::PrepareOptions;

    #[test]
    fn files_of_several_scenes_are_told_apart() {
        assert_eq!(file_of(Path::new("out/above.png"), "a/b"), Path::new("out/above-a-b.png"));
        assert_eq!(file_of(Path::new("above"), "city"), Path::new("above-city"));
    }

    #[test]
    fn a_box_is_yellow_where_its_object_stands_now() {
        let Ok(gpu) = Gpu::open(GpuOptions::default()) else {
            println!("skipped: no GPU");
            return;
        };
        let package = files::open_named_scene("boxes:40", &PrepareOptions::default()).expect("a scene");
        let mut transforms = package.scene.manifest.transforms.clone();
        let record = package.scene.manifest.leaves[7];
        let object = record.object.0 as usize;
        let (all, without) = (VisibleSet::all(40), VisibleSet::from_ranges([LeafRange::new(0, 7), LeafRange::new(8, 40)]));
        for moved_m in [DVec3::ZERO, DVec3::new(-30.0, 80.0, 20.0)] {
            let moved = DAffine3::from_translation(moved_m) * package.scene.manifest.transforms[object].affine();
            transforms[object] = moved.into();
            let above = |drawn| Above { package: &package, transforms: &transforms, frusta: &[], visible: &all, drawn };
            let corners: Vec<[DVec3; 8]> = (0..40).map(|leaf| above(&all).corners(leaf)).collect();
            let bounds = Aabb::of_points(corners.iter().flatten().copied());
            let bird = above(&all).bird(&corners, &bounds, &[]);
            let [plain, marked] = [&all, &without].map(|drawn| above(drawn).picture(&gpu).expect("drawn"));
            let differing = plain.enumerate_pixels().zip(marked.pixels()).filter(|((.., a), b)| a != b);
            let places: Vec<DVec2> = differing.map(|((x, y, _), _)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).collect();
            assert!(!places.is_empty());
            let expected = canvas::hull(corners[7].iter().filter_map(|corner| bird.place(*corner)).collect());
            let ends = |places: &[DVec2]| {
                let [none, all] = [DVec2::INFINITY, DVec2::NEG_INFINITY];
                places.iter().fold([none, all], |[least, most], place| [least.min(*place), most.max(*place)])
            };
            for (found, expected) in ends(&places).into_iter().zip(ends(&expected)) {
                assert!(found.distance(expected) < 3.0, "moved by {moved_m}: {found}, not {expected}");
            }
        }
    }
}
