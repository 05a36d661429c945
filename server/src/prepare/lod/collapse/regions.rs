//! Large meshes, region by region: each on a thread of its own and within its caches, all vertices that other regions share staying where they
//! are. What is left of all of them is then collapsed as one mesh.

use glam::Vec3;
use rayon::prelude::*;

use super::{Collapses, Fitness, Head, Queue, State};
use crate::prepare::lod::quadric::Quadric;
use crate::prepare::lod::source::{LodMesh, pick};
use crate::prepare::lod::surface::Surface;

/// How meshes are divided.
#[derive(Clone, Copy)]
pub(in crate::prepare::lod) struct Regions {
    /// Meshes of fewer triangles are collapsed as a whole.
    pub least_triangles: usize,
    /// Triangles of a region.
    pub triangles: usize,
}

impl Default for Regions {
    /// What belongs to a region is about what a core's own cache holds; where it pays.
    fn default() -> Self {
        Self { least_triangles: 1 << 19, triangles: 1 << 15 }
    }
}

/// Of a region so many times fewer triangles are left: fewer, and its border would show.
const SHARE: usize = 16;
/// Regions between two writings of what they found.
const AT_A_TIME: usize = 64;

/// No vertex, or one of several regions.
const NONE: u32 = u32::MAX;
const SHARED: u32 = u32::MAX - 1;

/// A region as a mesh of its own.
struct Region {
    mesh: LodMesh,
    /// For each vertex its number in the whole mesh.
    source: Vec<u32>,
    /// For each vertex its place in the whole mesh; [`NONE`] if it is not the first here.
    places: Vec<u32>,
    /// By place.
    fixed: Vec<bool>,
}

/// What is left of a region, and what became of its places.
struct Outcome {
    places: Vec<u32>,
    collapses: Collapses,
    quadrics: Vec<Quadric>,
    errors: Vec<f32>,
}

/// Collapses all regions of a mesh.
pub(super) fn collapse(mesh: &LodMesh, state: &mut State, size: usize) -> Collapses {
    let owners = owners(mesh, size);
    let regions: Vec<&[[u32; 3]]> = mesh.triangles.chunks(size).collect();
    let mut all = Vec::with_capacity(regions.len());
    for batch in regions.chunks(AT_A_TIME) {
        let outcomes: Vec<Outcome> =
            batch.par_iter().map(|triangles| collapse_region(Region::new(mesh, triangles, &owners), state)).collect();
        for outcome in outcomes {
            // What came onto a fixed place came from several regions.
            let found = outcome.places.iter().zip(&outcome.quadrics).zip(&outcome.errors);
            for ((place, quadric), error) in found.filter(|((place, _), _)| **place != NONE) {
                let place = *place as usize;
                if owners[place] == SHARED {
                    state.quadrics[place] += *quadric;
                    state.errors[place] = state.errors[place].max(*error);
                } else {
                    (state.quadrics[place], state.errors[place]) = (*quadric, *error);
                }
            }
            all.push(outcome.collapses);
        }
    }
    merged(all)
}

/// By place: the region that all of its triangles are in.
fn owners(mesh: &LodMesh, size: usize) -> Vec<u32> {
    let mut owners = vec![NONE; mesh.positions.len()];
    for (region, triangles) in (0..).zip(mesh.triangles.chunks(size)) {
        for vertex in triangles.as_flattened() {
            let owner = &mut owners[mesh.welds[*vertex as usize] as usize];
            *owner = if *owner == NONE || *owner == region { region } else { SHARED };
        }
    }
    owners
}

impl Region {
    fn new(whole: &LodMesh, triangles: &[[u32; 3]], owners: &[u32]) -> Self {
        let mut source: Vec<u32> = triangles.as_flattened().to_vec();
        source.sort_unstable();
        source.dedup();
        let local = |v: u32| source.partition_point(|s| *s < v) as u32;
        let mut mesh = LodMesh {
            positions: pick(&whole.positions, &source),
            uvs: pick(&whole.uvs, &source),
            colors: pick(&whole.colors, &source),
            triangles: triangles.iter().map(|t| t.map(local)).collect(),
            ..LodMesh::default()
        };
        // The first vertex in a place that is here; it may not be the first of all.
        let first_here = |v: u32| whole.wedges_of(v).filter(|w| source.binary_search(w).is_ok()).min().unwrap_or(v);
        mesh.welds = source.iter().map(|v| local(first_here(*v))).collect();
        if !whole.wedges.is_empty() {
            mesh.link_wedges();
        }
        let place = |v: &u32| whole.welds[*v as usize];
        let fixed = source.iter().map(|v| owners[place(v) as usize] == SHARED).collect();
        let is_first = |k: &usize| mesh.welds[*k] as usize == *k;
        let places = (0..source.len()).map(|k| Some(k).filter(is_first).map_or(NONE, |k| place(&source[k]))).collect();
        Self { mesh, source, places, fixed }
    }
}

fn collapse_region(region: Region, state: &State) -> Outcome {
    let Region { mesh, source, places, fixed } = region;
    // Everything of a place is in one region, or the place is fixed: then only what comes onto it is summed up here.
    let is_own = |place: u32, fixed: bool| place != NONE && !fixed;
    let quadric =
        |(place, fixed): (&u32, &bool)| if is_own(*place, *fixed) { state.quadrics[*place as usize] } else { Quadric::default() };
    let quadrics: Vec<Quadric> = places.iter().zip(&fixed).map(quadric).collect();
    let normal = |place: &u32| if *place == NONE { Vec3::ZERO } else { state.normals[*place as usize] };
    let normals: Vec<Vec3> = places.iter().map(normal).collect();
    let errors = vec![0.0; source.len()];
    let least = mesh.triangles.len() / SHARE;
    let mut fitness = Fitness::new(&mesh, normals);
    fitness.fixed = fixed;
    let mut queue = Queue::new(&mesh, Surface::of(&mesh), quadrics, errors);
    let mut collapses = Collapses::default();
    collapses.run(&mut queue, &mut fitness, least);
    let (quadrics, errors) = (queue.quadrics, queue.errors);
    for vertex in collapses.vertices.iter_mut().chain(&mut collapses.links).chain(collapses.triangles.as_flattened_mut()) {
        *vertex = source[*vertex as usize];
    }
    Outcome { places, collapses, quadrics, errors }
}

/// The collapses of all regions, by their costs: so a mesh becomes finer everywhere at once.
fn merged(all: Vec<Collapses>) -> Collapses {
    let mut order: Vec<(u32, u32, u32)> = Vec::with_capacity(all.iter().map(|c| c.vertices.len()).sum());
    for (region, collapses) in (0..).zip(&all) {
        order.extend((0..).zip(&collapses.costs).map(|(number, cost)| (cost.to_bits(), region, number)));
    }
    order.par_sort_unstable();
    let mut starts: Vec<Vec<u32>> = Vec::with_capacity(all.len());
    for collapses in &all {
        let mut end = 0;
        let start = |head: &Head| {
            end += head.length as u32;
            end - head.length as u32
        };
        starts.push(collapses.heads.iter().map(start).collect());
    }
    let mut merged = Collapses::default();
    merged.links.reserve_exact(all.iter().map(|c| c.links.len()).sum());
    for (cost, region, number) in order {
        let (collapses, number) = (&all[region as usize], number as usize);
        let (start, head) = (starts[region as usize][number] as usize, collapses.heads[number]);
        merged.links.extend_from_slice(&collapses.links[start..start + head.length]);
        merged.vertices.push(collapses.vertices[number]);
        merged.heads.push(head);
        merged.errors.push(collapses.errors[number]);
        merged.costs.push(f32::from_bits(cost));
    }
    merged.triangles = all.into_iter().flat_map(|collapses| collapses.triangles).collect();
    merged
}
