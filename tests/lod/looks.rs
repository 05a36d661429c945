//! Goal: a surface that is flat, but painted, is as fine as its paint wants. Method: sheets whose colours or texture coordinates say where a vertex
//! belongs, refined to a pixel, and held at each of their vertices against what they were.

use glam::{DVec3, Vec2, Vec3, Vec4};
use mullion_client::lod::{LodOptions, Refinement};
use mullion_common::scene::{Hierarchy, LodForm, VertexData};

use super::meshes::{self, SHEET_CELL_M, SHEET_CELLS, SHEET_M};
use super::{Mesh, clusters, looking, seen_from_all_sides, vertices};

/// The eye is so far above the sheet, and a pixel so large there.
const AWAY_M: f64 = 20.0;
const PIXEL_M: f32 = 0.02;

/// Where each cut triangle lies, and what it looks like at a place of it.
fn seen_at<T: Copy>(hierarchy: &Hierarchy, triangles: &[[u32; 3]], of: &[T], at: Vec2, mix: impl Fn([T; 3], [f32; 3]) -> T) -> T {
    let place = |v: u32| Vec3::from(hierarchy.vertices().positions[v as usize]).truncate();
    let found = triangles.iter().find_map(|t| {
        let [a, b, c] = t.map(place);
        let share = |from: Vec2, to: Vec2| (to - from).perp_dot(at - from) / (b - a).perp_dot(c - a);
        let shares = [share(b, c), share(c, a), share(a, b)];
        shares.iter().all(|share| *share > -1e-4).then(|| mix(t.map(|v| of[v as usize]), shares))
    });
    found.expect("the sheet is whole")
}

/// The sheet's triangles, refined to a pixel.
fn refined(hierarchy: &Hierarchy) -> Vec<[u32; 3]> {
    let mut refinement = Refinement::new();
    let options = LodOptions { budget: u32::MAX, least_pixels: 1.0, ..LodOptions::default() };
    refinement.refine(&[seen_from_all_sides(hierarchy)], &looking(DVec3::Z * AWAY_M), &options, None);
    let cut = &refinement.cuts()[0];
    let named: Vec<u32> = cut.vertices(hierarchy).collect();
    cut.placed_triangles(hierarchy).map(|t| t.map(|place| named[place as usize])).collect()
}

fn places() -> impl Iterator<Item = Vec2> {
    let step = |k: u32| k as f32 * SHEET_CELL_M - SHEET_M / 2.0;
    (0..=SHEET_CELLS).flat_map(move |y| (0..=SHEET_CELLS).map(move |x| Vec2::new(step(x), step(y))))
}

fn forms(mesh: &Mesh) -> [(LodForm, Hierarchy); 2] {
    [(LodForm::Vertices, vertices(mesh)), (LodForm::Clusters, clusters(mesh))]
}

#[test]
fn colours_are_where_they_were() {
    for (form, hierarchy) in forms(&meshes::sheet_of_colours()) {
        let triangles = refined(&hierarchy);
        let most = (SHEET_CELLS * SHEET_CELLS * 2) as usize;
        assert!((20..most * 3 / 4).contains(&triangles.len()), "{form}: {} of {most} triangles", triangles.len());
        let VertexData { colors, .. } = hierarchy.vertices();
        let color = |c: [u8; 4]| Vec4::from_array(c.map(f32::from)) / 255.0;
        let colors: Vec<Vec4> = colors.iter().map(|c| color(*c)).collect();
        let mix = |[a, b, c]: [Vec4; 3], [i, j, k]: [f32; 3]| a * i + b * j + c * k;
        let off = |at: Vec2| seen_at(&hierarchy, &triangles, &colors, at, mix).distance(color(meshes::sheet_color(at)));
        // A cell is six pixels wide: colours that were as far off would be wrong by more than a pixel of black in white.
        let worst = places().map(off).fold(0.0, f32::max);
        assert!(worst < 3.0 * PIXEL_M / SHEET_CELL_M, "{form}: a colour is off by {worst}");
    }
}

#[test]
fn textures_are_where_they_were() {
    for (form, hierarchy) in forms(&meshes::sheet_of_texture()) {
        let triangles = refined(&hierarchy);
        let most = (SHEET_CELLS * SHEET_CELLS * 2) as usize;
        assert!((20..most * 3 / 4).contains(&triangles.len()), "{form}: {} of {most} triangles", triangles.len());
        let uvs: Vec<Vec2> = hierarchy.vertices().uvs.iter().map(|uv| Vec2::from(*uv)).collect();
        let mix = |[a, b, c]: [Vec2; 3], [i, j, k]: [f32; 3]| a * i + b * j + c * k;
        let off = |at: Vec2| seen_at(&hierarchy, &triangles, &uvs, at, mix).distance(meshes::sheet_uv(at)) * SHEET_M / PIXEL_M;
        let worst = places().map(off).fold(0.0, f32::max);
        assert!(worst < 4.0, "{form}: the texture is off by {worst} pixels");
    }
}
