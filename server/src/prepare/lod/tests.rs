//! Goal: hierarchies hold the mesh that they are of, and their bounds what they say. Method: small meshes of every kind; all splits made must
//! give the mesh back, and every node is held against each triangle of its subtree by brute force.

use std::collections::{BTreeMap, HashMap};

use glam::Vec3;
use mullion_common::scene::{MaterialId, TrianglePlace, VertexAttributes, VertexHierarchy, VertexId};

use super::source::Welder;
use super::*;
use crate::generate::Random;

/// A grid of quads over a unit square, lifted; its last column and row are its first where it is closed that way.
pub(super) fn grid(
    columns: u32,
    rows: u32,
    [close_u, close_v]: [bool; 2],
    at: impl Fn(f32, f32) -> Vec3,
) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (width, height) = (columns + u32::from(!close_u), rows + u32::from(!close_v));
    let positions =
        (0..width * height).map(|k| at((k % width) as f32 / columns as f32, (k / width) as f32 / rows as f32)).collect();
    let vertex = |u: u32, v: u32| u % width + v % height * width;
    let triangles = (0..columns * rows)
        .flat_map(|k| {
            let (u, v) = (k % columns, k / columns);
            let [a, b, c, d] = [vertex(u, v), vertex(u + 1, v), vertex(u + 1, v + 1), vertex(u, v + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    (positions, triangles)
}

pub(super) fn torus() -> LodMesh {
    let (positions, triangles) = grid(40, 24, [true; 2], |u, v| {
        let (sin_u, cos_u) = (u * std::f32::consts::TAU).sin_cos();
        let (sin_v, cos_v) = (v * std::f32::consts::TAU).sin_cos();
        let radius = 3.0 + cos_v;
        Vec3::new(radius * cos_u, radius * sin_u, 1.3 * sin_v)
    });
    LodMesh::of_triangles(&positions, &triangles)
}

fn hills() -> LodMesh {
    let mut random = Random::new(3);
    let heights: Vec<f32> = (0..64).map(|_| random.range(0.0, 1.0)).collect();
    let (positions, triangles) = grid(30, 20, [false; 2], |u, v| {
        let height = heights[(u * 7.0) as usize * 8 + (v * 7.0) as usize];
        Vec3::new(u * 30.0, v * 20.0, height + (u * 9.0).sin() * 2.0)
    });
    LodMesh::of_triangles(&positions, &triangles)
}

/// A tube of two materials along it, and texture coordinates that start anew around it: closed but for its ends, with two seams.
pub(super) fn seams() -> LodMesh {
    let (columns, rows) = (24u32, 30u32);
    let mut welder = Welder::new(4000, VertexAttributes { uvs: true, colors: false }, vec![MaterialId(4), MaterialId(7)]);
    let at = |u: u32, v: u32| {
        let (sin, cos) = ((u % columns) as f32 / columns as f32 * std::f32::consts::TAU).sin_cos();
        Vec3::new(cos * (2.0 + 0.3 * (v as f32 * 0.5).sin()), sin * 2.0, v as f32 * 0.4)
    };
    for v in 0..rows {
        for u in 0..columns {
            let part = u8::from(u >= columns / 2);
            let corner = |u: u32, v: u32| (at(u, v), [u as f32, v as f32]);
            let corners = [corner(u, v), corner(u + 1, v), corner(u + 1, v + 1), corner(u, v + 1)];
            let [a, b, c, d] = corners.map(|(p, uv)| welder.vertex(p, uv, [0; 4], part));
            welder.triangle([a, b, c]);
            welder.triangle([a, c, d]);
        }
    }
    welder.finish()
}

pub(super) fn all() -> [(&'static str, LodMesh); 3] {
    [("torus", torus()), ("hills", hills()), ("seams", seams())]
}

fn hierarchy(mesh: &LodMesh) -> VertexHierarchy {
    vertex_hierarchy(mesh, &LodOptions { block_vertices: 100, ..LodOptions::default() }).expect("it is one")
}

fn bits(p: Vec3) -> [u32; 3] {
    p.to_array().map(f32::to_bits)
}

/// Triangles by their corners' places, the least first, each with how often it is there.
pub(super) fn by_place(triangles: impl Iterator<Item = [Vec3; 3]>) -> BTreeMap<[[u32; 3]; 3], u32> {
    let mut counts = BTreeMap::new();
    for triangle in triangles {
        let [a, b, c] = triangle.map(bits);
        let least = [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().expect("three");
        *counts.entry(least).or_default() += 1;
    }
    counts
}

/// The triangles once every split is made, by a replay of its own.
fn finest(hierarchy: &VertexHierarchy) -> Vec<[VertexId; 3]> {
    let mut alive: HashMap<TrianglePlace, [VertexId; 3]> = HashMap::new();
    for vertex in (0..hierarchy.vertex_count()).map(VertexId) {
        if !hierarchy.is_base(vertex) {
            let link = hierarchy.link(vertex);
            for (a, b) in link.floor() {
                let place = hierarchy.places([link.parent(), a, b]).find(|place| alive.contains_key(place)).expect("it is there");
                alive.remove(&place);
            }
        }
        for number in 0..hierarchy.made_count(vertex) {
            let place = TrianglePlace { maker: vertex, number };
            alive.insert(place, hierarchy.triangle(place));
        }
    }
    alive.into_values().collect()
}

#[test]
fn all_splits_give_the_mesh_back() {
    for (name, mesh) in all() {
        let hierarchy = hierarchy(&mesh);
        let found = by_place(finest(&hierarchy).into_iter().map(|t| t.map(|v| hierarchy.position(v))));
        let expected = by_place(mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])));
        assert_eq!(found, expected, "{name}");
        let base = hierarchy.base();
        assert!(base.triangles.len() * 8 < mesh.triangles.len(), "{name}: {} triangles are left", base.triangles.len());
        let bytes = hierarchy.structure_bytes() as f64 / f64::from(hierarchy.vertex_count());
        assert!(bytes <= 40.0, "{name}: {bytes} bytes a vertex");
        assert_eq!(hierarchy.triangle_count() as usize, mesh.triangles.len());
        println!("{name}: {} of {} triangles in the base, {bytes:.1} bytes a vertex", base.triangles.len(), mesh.triangles.len());
    }
}

#[test]
fn seams_split_together_and_parts_stay() {
    let mesh = seams();
    let hierarchy = hierarchy(&mesh);
    let followers = (0..hierarchy.vertex_count()).map(VertexId).filter(|v| hierarchy.is_follower(*v)).count();
    assert!(followers > 40, "{followers} followers");
    let found = finest(&hierarchy);
    for material in [MaterialId(4), MaterialId(7)] {
        let here = found.iter().filter(|t| hierarchy.material(t[0]) == material).count();
        assert_eq!(here, mesh.triangles.len() / 2);
    }
    for t in found {
        assert!(t.iter().all(|v| hierarchy.material(*v) == hierarchy.material(t[0])), "a triangle is of one material");
    }
}

/// By regions of few triangles, whose borders cross everything: as if the mesh were a large one.
#[test]
fn regions_give_the_mesh_back_and_leave_no_more() {
    for (name, mesh) in all() {
        for triangles in [90, 400] {
            let options = LodOptions { block_vertices: 100, ..LodOptions::default() };
            let parts = simplify(&mesh, &options, Regions { least_triangles: 0, triangles }).expect("it is one");
            let by_regions = joined(parts).expect("every split finds what it takes");
            let found = by_place(finest(&by_regions).into_iter().map(|t| t.map(|v| by_regions.position(v))));
            assert_eq!(found, by_place(mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize]))), "{name}");
            let (whole, parts) = (hierarchy(&mesh).base().triangles.len(), by_regions.base().triangles.len());
            assert!(parts <= 2 * whole + 20, "{name}: {parts} triangles in the base, {whole} without regions");
        }
    }
}

/// After every split at most one triangle is on either side of an edge: with regions, no two of them make the same one.
#[test]
fn every_prefix_is_a_surface() {
    for (name, mesh) in all() {
        for regions in [Regions::default(), Regions { least_triangles: 0, triangles: 60 }] {
            let parts = simplify(&mesh, &LodOptions::default(), regions).expect("it is one");
            let hierarchy = joined(parts).expect("it is one");
            let mut sides: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
            // All that a split takes goes before what it puts comes: no side has two at any time.
            let mut change = |corners: [u32; 3], by: i32| {
                let t = corners.map(|v| bits(hierarchy.position(VertexId(v))));
                for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                    let count = sides.entry([t[a], t[b]]).or_default();
                    *count += by;
                    assert!((0..=1).contains(count), "{name}: {corners:?}");
                }
            };
            hierarchy.base().triangles.iter().for_each(|t| change(*t, 1));
            let leads = (hierarchy.base_count()..hierarchy.vertex_count()).map(VertexId).filter(|v| !hierarchy.is_follower(*v));
            for lead in leads {
                for link in hierarchy.together(lead).map(|v| hierarchy.link(v)) {
                    link.floor().for_each(|(a, b)| change([link.parent(), a, b], -1));
                }
                for vertex in hierarchy.together(lead) {
                    hierarchy.link(vertex).edges().for_each(|(a, b)| change([vertex.0, a, b], 1));
                }
            }
        }
    }
}

/// All vertices of a node: its parent, and what comes of it by this split and later ones.
fn node_vertices(hierarchy: &VertexHierarchy, lead: VertexId) -> Vec<VertexId> {
    let mut vertices = vec![hierarchy.parent(lead)];
    let mut open = Vec::new();
    let mut sibling = Some(lead);
    while let Some(lead) = sibling {
        open.push(lead);
        sibling = hierarchy.next_sibling(lead);
    }
    while let Some(lead) = open.pop() {
        for vertex in hierarchy.together(lead) {
            vertices.push(vertex);
            let mut child = hierarchy.first_child(vertex);
            while let Some(lead) = child {
                open.push(lead);
                child = hierarchy.next_sibling(lead);
            }
        }
    }
    vertices
}

/// The mesh's triangles by the places of their corners.
fn triangles_around(mesh: &LodMesh) -> HashMap<[u32; 3], Vec<[Vec3; 3]>> {
    let mut around: HashMap<[u32; 3], Vec<[Vec3; 3]>> = HashMap::new();
    for triangle in &mesh.triangles {
        let corners = triangle.map(|v| mesh.positions[v as usize]);
        corners.iter().for_each(|corner| around.entry(bits(*corner)).or_default().push(corners));
    }
    around
}

/// Holds a node's bounds against every triangle of the mesh at its vertices. How far from their middle these reach.
fn assert_encloses(
    hierarchy: &VertexHierarchy,
    around: &HashMap<[u32; 3], Vec<[Vec3; 3]>>,
    (lead, vertices): (VertexId, &[VertexId]),
    name: &str,
) -> f32 {
    let bounds = hierarchy.bounds(lead);
    let (extent, axis) = (bounds.extent, bounds.extent.axis.direction());
    let mut reach = 0.0f32;
    for triangle in vertices.iter().flat_map(|v| &around[&bits(hierarchy.position(*v))]) {
        for corner in triangle {
            let way = *corner - bounds.center;
            let height = way.dot(axis);
            reach = reach.max(way.length());
            assert!(way.length() <= extent.radius, "{name} {lead:?}: sphere");
            assert!((way.abs().cmple(extent.half_box)).all(), "{name} {lead:?}: box");
            assert!((way - axis * height).length() <= extent.cylinder_radius * 1.00001, "{name} {lead:?}: cylinder");
            assert!(height <= extent.cylinder_above * 1.00001 && height >= -extent.cylinder_below * 1.00001, "{name}");
        }
        let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).normalize();
        let sine = (1.0 - axis.dot(normal).powi(2)).max(0.0).sqrt();
        assert!(bounds.cone_sine.is_none_or(|cone| axis.dot(normal) > 0.0 && sine <= cone + 1e-4), "{name} {lead:?}: cone");
    }
    for vertex in &vertices[1..] {
        assert!(hierarchy.error(hierarchy.lead(*vertex)) <= extent.error, "{name} {lead:?}: error");
    }
    reach
}

#[test]
fn bounds_enclose_every_triangle_of_their_subtree() {
    for (name, mesh) in all() {
        let hierarchy = hierarchy(&mesh);
        let around = triangles_around(&mesh);
        let (mut looseness, mut nodes, mut cones) = (0.0, 0, 0);
        for lead in (hierarchy.base_count()..hierarchy.vertex_count()).map(VertexId).filter(|v| !hierarchy.is_follower(*v)) {
            let bounds = hierarchy.bounds(lead);
            let reach = assert_encloses(&hierarchy, &around, (lead, &node_vertices(&hierarchy, lead)), name);
            looseness += bounds.extent.radius / reach;
            nodes += 1;
            cones += u32::from(bounds.cone_sine.is_some());
        }
        let looseness = looseness / nodes as f32;
        assert!(looseness < 1.3, "{name}: spheres reach {looseness} times as far as they must");
        assert!(cones * 4 > nodes, "{name}: {cones} of {nodes} nodes have a cone");
    }
}

#[test]
fn large_nodes_are_enclosed_by_stretches() {
    // Enough places that nodes near the root take them by the stretch.
    let (positions, triangles) = grid(220, 160, [true; 2], |u, v| {
        let (sin_u, cos_u) = (u * std::f32::consts::TAU).sin_cos();
        let (sin_v, cos_v) = (v * std::f32::consts::TAU).sin_cos();
        Vec3::new((3.0 + cos_v) * cos_u, (3.0 + cos_v) * sin_u, sin_v)
    });
    let mesh = LodMesh::of_triangles(&positions, &triangles);
    let hierarchy = hierarchy(&mesh);
    let around = triangles_around(&mesh);
    let mut large = 0;
    for vertex in (0..hierarchy.base_count()).map(VertexId) {
        let Some(lead) = hierarchy.first_child(vertex) else { continue };
        let vertices = node_vertices(&hierarchy, lead);
        large += u32::from(vertices.len() > 64 * 64);
        assert_encloses(&hierarchy, &around, (lead, &vertices), "torus");
    }
    assert!(large > 0);
}

/// Whatever is no surface.
pub(super) fn soup() -> LodMesh {
    let mut random = Random::new(5);
    let mut soup: Vec<Vec3> = (0..300).map(|_| Vec3::new(random.unit(), random.unit(), random.unit())).collect();
    soup.extend([Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::splat(9.0)]);
    let mut triangles: Vec<[u32; 3]> = (0..100).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    // Three triangles at an edge, a face twice, once the other way round, one without area, one that names a vertex twice.
    triangles.extend([[0, 1, 5], [0, 1, 8], [3, 4, 5], [3, 5, 4], [300, 301, 302], [7, 7, 8]]);
    LodMesh::of_triangles(&soup, &triangles)
}

#[test]
fn whatever_is_no_surface_is_kept() {
    let mesh = soup();
    assert_eq!(mesh.triangles.len(), 105);
    let hierarchy = hierarchy(&mesh);
    let found = by_place(finest(&hierarchy).into_iter().map(|t| t.map(|v| hierarchy.position(v))));
    assert_eq!(found, by_place(mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize]))));
    for empty in [LodMesh::of_triangles(&[], &[]), LodMesh::of_triangles(&mesh.positions, &[])] {
        assert_eq!((vertex_hierarchy(&empty, &LodOptions::default()).expect("it is one").vertex_count()), 0);
    }
    // Coordinates at the ends of what floats hold.
    for scale in [1e-30f32, 1e18, f32::MAX / 4.0] {
        let (positions, triangles) = grid(9, 7, [false; 2], |u, v| Vec3::new(u, v, u * v) * scale);
        let hierarchy = hierarchy_of(&positions, &triangles);
        assert_eq!(hierarchy.triangle_count(), 126, "{scale}");
    }
}

fn hierarchy_of(positions: &[Vec3], triangles: &[[u32; 3]]) -> VertexHierarchy {
    hierarchy(&LodMesh::of_triangles(positions, triangles))
}

/// Closed components end as closed ones, open ones as triangles: nothing vanishes.
#[test]
fn components_stay() {
    let (positions, triangles) = grid(8, 6, [true; 2], |u, v| {
        let (sin_u, cos_u) = (u * std::f32::consts::TAU).sin_cos();
        let (sin_v, cos_v) = (v * std::f32::consts::TAU).sin_cos();
        Vec3::new((3.0 + cos_v) * cos_u, (3.0 + cos_v) * sin_u, sin_v)
    });
    let (flat, flat_triangles) = grid(3, 3, [false; 2], |u, v| Vec3::new(u, v * 2.0, 50.0));
    let (mut all, mut all_triangles) = (Vec::new(), Vec::new());
    for copy in 0..20 {
        let shift = Vec3::new(copy as f32 * 20.0, 0.0, 0.0);
        for (positions, triangles) in [(&positions, &triangles), (&flat, &flat_triangles)] {
            let first = all.len() as u32;
            all.extend(positions.iter().map(|p| *p + shift));
            all_triangles.extend(triangles.iter().map(|t| t.map(|v| v + first)));
        }
    }
    let hierarchy = hierarchy_of(&all, &all_triangles);
    let base = &hierarchy.base().triangles;
    let far = base.iter().filter(|t| t.iter().all(|v| hierarchy.position(VertexId(*v)).z == 50.0)).count();
    assert_eq!(far, 20, "a square is a triangle at last");
    assert!(base.len() < 20 * (2 + 40), "{} triangles", base.len());
}

/// Nothing of it can go, and nothing takes long.
#[test]
fn many_components_are_all_kept() {
    const COUNT: u32 = 1_000_000;
    let corner = |k: u32| Vec3::new((k % 3) as f32 * 0.1, (k / 3 % 900) as f32, (k / 2700) as f32 + (k % 2) as f32 * 0.1);
    let positions: Vec<Vec3> = (0..3 * COUNT).map(corner).collect();
    let triangles: Vec<[u32; 3]> = (0..COUNT).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let hierarchy = hierarchy_of(&positions, &triangles);
    assert_eq!((hierarchy.base().triangles.len() as u32, hierarchy.triangle_count()), (COUNT, COUNT));
}

#[test]
fn the_same_mesh_gives_the_same_hierarchy() {
    assert_eq!(hierarchy(&seams()), hierarchy(&seams()));
    assert!(matches!(
        vertex_hierarchy(&torus(), &LodOptions { block_vertices: 0, ..LodOptions::default() }),
        Err(LodError::Block { found: 0 })
    ));
}
