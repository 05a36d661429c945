//! Goal: a surface that is flat, but painted, is as fine as its paint wants. Method: sheets whose colours or texture coordinates say where a vertex
//! belongs, refined to a pixel, and held at each of their vertices against what they were.

use std::ops::{Add, Mul};

use glam::{DVec3, Vec2, Vec3, Vec4};
use mullion_client::lod::{LodOptions, Refinement};
use mullion_common::scene::{Hierarchy, LodForm};

use super::meshes::{self, SHEET_CELL_M, SHEET_CELLS, SHEET_M};
use super::{Mesh, clusters, looking, seen_from_all_sides, vertices};

/// The eye is so far above the sheet, and a pixel so large there.
const AWAY_M: f64 = 20.0;
const PIXEL_M: f32 = 0.02;

/// A sheet refined to a pixel.
struct Fine {
    form: LodForm,
    hierarchy: Hierarchy,
    triangles: Vec<[u32; 3]>,
}

/// Of both forms: finer than nothing but the sheet's corners, coarser than all of it.
fn refined(mesh: &Mesh) -> [Fine; 2] {
    [(LodForm::Vertices, vertices(mesh)), (LodForm::Clusters, clusters(mesh))].map(|(form, hierarchy)| {
        let mut refinement = Refinement::new();
        let options = LodOptions { budget: u32::MAX, least_pixels: 1.0, ..LodOptions::default() };
        refinement.refine(&[seen_from_all_sides(&hierarchy)], &looking(DVec3::Z * AWAY_M), &options, None);
        let cut = &refinement.cuts()[0];
        let named: Vec<u32> = cut.vertices(&hierarchy).collect();
        let triangles: Vec<_> = cut.placed_triangles(&hierarchy).map(|t| t.map(|place| named[place as usize])).collect();
        let (found, all) = (triangles.len(), mesh.triangles.len());
        assert!((20..all * 3 / 4).contains(&found), "{form}: {found} of {all} triangles");
        Fine { form, hierarchy, triangles }
    })
}

impl Fine {
    /// What is seen at a place, of what is known of each vertex.
    fn seen<T: Copy + Mul<f32, Output = T> + Add<Output = T>>(&self, of: &[T], at: Vec2) -> T {
        let place = |v: u32| Vec3::from(self.hierarchy.vertices().positions[v as usize]).truncate();
        let found = self.triangles.iter().find_map(|t| {
            let [a, b, c] = t.map(place);
            let share = |from: Vec2, to: Vec2| (to - from).perp_dot(at - from) / (b - a).perp_dot(c - a);
            let shares = [share(b, c), share(c, a), share(a, b)];
            shares.iter().all(|share| *share > -1e-4).then(|| {
                let [a, b, c] = t.map(|v| of[v as usize]);
                a * shares[0] + b * shares[1] + c * shares[2]
            })
        });
        found.expect("the sheet is whole")
    }
}

/// The most of what is off at any of the sheet's vertices.
fn worst(off: impl Fn(Vec2) -> f32) -> f32 {
    let step = |k: u32| k as f32 * SHEET_CELL_M - SHEET_M / 2.0;
    let row = |y: u32| (0..=SHEET_CELLS).map(move |x| Vec2::new(step(x), step(y)));
    (0..=SHEET_CELLS).flat_map(row).map(off).fold(0.0, f32::max)
}

#[test]
fn colours_are_where_they_were() {
    let color = |c: [u8; 4]| Vec4::from_array(c.map(f32::from)) / 255.0;
    for fine in refined(&meshes::sheet_of_colours()) {
        let colors: Vec<Vec4> = fine.hierarchy.vertices().colors.iter().map(|c| color(*c)).collect();
        let worst = worst(|at| (fine.seen(&colors, at) - color(meshes::sheet_color(at))).abs().max_element());
        // A cell is six pixels wide: what is wrong by a sixth of the way from black to white counts as a pixel.
        assert!(worst < 1.5 * PIXEL_M / SHEET_CELL_M, "{}: a colour is off by {worst}", fine.form);
    }
}

#[test]
fn textures_are_where_they_were() {
    let sheets = [Vec2::ONE, Vec2::new(1.0, 20.0), Vec2::new(0.1, 0.005)].map(|times| (times, meshes::sheet_of_texture(times)));
    for (times, fine) in sheets.iter().flat_map(|(times, sheet)| refined(sheet).map(|fine| (*times, fine))) {
        let uvs: Vec<Vec2> = fine.hierarchy.vertices().uvs.iter().map(|uv| Vec2::from(*uv) / times).collect();
        let worst = worst(|at| fine.seen(&uvs, at).distance(meshes::sheet_uv(at)) * SHEET_M / PIXEL_M);
        // Clusters: by the estimate of who simplifies them.
        let most = if fine.form == LodForm::Vertices { 1.5 } else { 4.0 };
        assert!(worst < most, "{}, {times} times: the texture is off by {worst} pixels", fine.form);
    }
}
