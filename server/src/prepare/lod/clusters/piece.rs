//! What is simplified as one: the triangles of a group's clusters, and what they may become.
//!
//! The crate's collapses keep borders, but not all that a surface is: they may pinch it, or fold it onto itself. What comes out is held against
//! what went in, edge by edge, and where it does not hold, the vertices around stay and it is tried again.

use super::super::source::LodMesh;
use super::meshing::{self, Looks, Unit};
use super::surface::Surface;

/// A piece is tried so often, with more vertices that stay each time.
const TRIES: usize = 5;
/// What is left of a piece that is worth a group, of its triangles.
const MOST_LEFT: f64 = 0.85;

/// Some triangles with vertices of their own.
pub(super) struct Piece<'a> {
    mesh: &'a LodMesh,
    /// The mesh's vertices, ascending.
    vertices: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

impl<'a> Piece<'a> {
    pub fn new(mesh: &'a LodMesh, triangles: &[[u32; 3]]) -> Self {
        let mut vertices = triangles.as_flattened().to_vec();
        vertices.sort_unstable();
        vertices.dedup();
        // Every corner is there.
        let local = |v: u32| vertices.partition_point(|other| *other < v) as u32;
        let triangles = triangles.iter().map(|t| t.map(local)).collect();
        Self { mesh, vertices, triangles }
    }

    fn unit(&self) -> Unit {
        Unit::of(self.vertices.iter().map(|v| self.mesh.positions[*v as usize]))
    }

    fn of_mesh(&self, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
        triangles.iter().map(|t| t.map(|v| self.vertices[v as usize])).collect()
    }

    /// Its triangles as clusters, each of one material.
    pub fn clusters(&self) -> Vec<Vec<[u32; 3]>> {
        let unit = self.unit();
        let part = |t: &[u32; 3]| self.mesh.parts.get(self.vertices[t[0] as usize] as usize).copied().unwrap_or(0);
        let mut triangles = self.triangles.clone();
        triangles.sort_by_key(part);
        let of_part = triangles.chunk_by(|a, b| part(a) == part(b));
        of_part.flat_map(|own| meshing::clusters(&unit, own)).map(|cluster| self.of_mesh(&cluster)).collect()
    }

    /// About half as many triangles with the same border, and how far they may be from these, metres; `None` where that saves little. Vertices
    /// that are shared with others stay: `is_shared` tells by the weld.
    pub fn simplified(&self, is_shared: impl Fn(u32) -> bool) -> Option<(Vec<[u32; 3]>, f32)> {
        let welds: Vec<u32> = self.vertices.iter().map(|v| self.mesh.welds[*v as usize]).collect();
        let surface = Surface::new(self.mesh, &self.vertices, &welds, &self.triangles, is_shared);
        let (unit, data) = (self.unit(), self.mesh.vertex_data(&self.vertices));
        let looks = Looks::of(&data.uvs, &data.colors);
        let mut stays = surface.shared().to_vec();
        for _ in 0..TRIES {
            let locked: Vec<bool> = (0..self.vertices.len() as u32).map(|v| stays[surface.place(v)]).collect();
            let (left, error) = meshing::simplify(&unit, &looks, &self.triangles, &locked, self.triangles.len() / 2);
            if left.len() as f64 > self.triangles.len() as f64 * MOST_LEFT || !error.is_finite() {
                return None;
            }
            let wrong = surface.wrong(&left);
            if !wrong.contains(&true) {
                return Some((self.of_mesh(&left), error));
            }
            for places in self.triangles.iter().map(|t| t.map(|v| surface.place(v))) {
                if places.iter().any(|place| wrong[*place]) {
                    places.iter().for_each(|place| stays[*place] = true);
                }
            }
        }
        None
    }
}
