//! Goal: a cluster hierarchy holds the mesh that it is of, whatever that is, and the same mesh gives the same bytes. Method: meshes of every
//! kind, and what is no surface; all groups refined must give the mesh back.

use glam::Vec3;
use mullion_common::scene::{ClusterHierarchy, ClusterId, GroupId, MAX_CLUSTER_TRIANGLES};

use super::super::tests::{all, by_place, grid, seams, soup, torus};
use super::super::{LodError, LodMesh, LodOptions, cluster_hierarchy};
use super::clustered;

fn hierarchy(mesh: &LodMesh) -> ClusterHierarchy {
    cluster_hierarchy(mesh, &LodOptions { block_vertices: 100, ..LodOptions::default() }).expect("it is one")
}

/// What is drawn once every group is refined.
fn finest(hierarchy: &ClusterHierarchy) -> Vec<[u32; 3]> {
    let made_by_none = (0..hierarchy.cluster_count()).map(ClusterId).filter(|cluster| hierarchy.maker(*cluster).is_none());
    made_by_none.flat_map(|cluster| hierarchy.triangles(cluster)).collect()
}

/// The hierarchy of a mesh, having found that it gives the mesh back.
fn given_back(name: &str, mesh: &LodMesh) -> ClusterHierarchy {
    let hierarchy = hierarchy(mesh);
    let found = by_place(finest(&hierarchy).into_iter().map(|t| t.map(|v| hierarchy.position(v))));
    assert_eq!(found, by_place(mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize]))), "{name}");
    assert_eq!(
        (hierarchy.triangle_count(), hierarchy.triangle_total() as usize),
        (hierarchy.triangle_total(), mesh.triangles.len())
    );
    for cluster in (0..hierarchy.cluster_count()).map(ClusterId) {
        let part = |v: u32| hierarchy.vertices().parts.get(v as usize);
        let vertices = hierarchy.cluster_vertices(cluster);
        assert!(vertices.iter().all(|v| part(*v) == part(vertices[0])), "{name}: a cluster of several materials");
    }
    hierarchy
}

#[test]
fn all_groups_give_the_mesh_back() {
    for (name, mesh) in all() {
        let hierarchy = given_back(name, &mesh);
        let (roots, all) = (hierarchy.root_triangles(), hierarchy.triangle_count());
        assert!(roots * 4 < all, "{name}: {roots} of {all} triangles are left");
        assert!(hierarchy.group_count() > 1 && (0..hierarchy.group_count()).all(|g| hierarchy.added_triangles(GroupId(g)) > 0));
    }
}

#[test]
fn whatever_is_no_surface_is_kept() {
    given_back("soup", &soup());
    assert!(hierarchy(&LodMesh::of_triangles(&[], &[])).cluster_count() == 0);
    // All of it together with a surface: three sheets at an edge, faces twice, both ways round.
    let (mut positions, mut triangles) = grid(30, 20, [false; 2], |u, v| Vec3::new(u, v, (u * 9.0).sin() * 0.1));
    let sheet = triangles.clone();
    triangles.extend(sheet.iter().step_by(7));
    triangles.extend(sheet.iter().step_by(5).map(|[a, b, c]| [*a, *c, *b]));
    let first = positions.len() as u32;
    positions.extend((0..30).map(|k| Vec3::new(k as f32 / 30.0, 0.5, 2.0)));
    triangles.extend((0..29).map(|k| [first + k, 31 * 10 + k, 31 * 10 + k + 1]));
    triangles.extend((0..29).map(|k| [first + k, first + k + 1, 31 * 10 + k]));
    given_back("sheets", &LodMesh::of_triangles(&positions, &triangles));
    // Coordinates at the ends of what floats hold, and far from 0.
    for scale in [1e-30f32, 1e18, f32::MAX / 4.0] {
        let (positions, triangles) = grid(19, 17, [false; 2], |u, v| Vec3::new(u, v, u * v) * scale);
        given_back("scaled", &LodMesh::of_triangles(&positions, &triangles));
    }
    let (positions, triangles) = grid(19, 17, [false; 2], |u, v| Vec3::new(1e9 + u, v, u * v));
    given_back("far", &LodMesh::of_triangles(&positions, &triangles));
}

/// Closed components end as closed ones, and none vanishes.
#[test]
fn components_stay() {
    let (positions, triangles) = grid(8, 6, [true; 2], |u, v| {
        let (sin_u, cos_u) = (u * std::f32::consts::TAU).sin_cos();
        let (sin_v, cos_v) = (v * std::f32::consts::TAU).sin_cos();
        Vec3::new((3.0 + cos_v) * cos_u, (3.0 + cos_v) * sin_u, sin_v)
    });
    const COPIES: u32 = 60;
    let (mut all, mut all_triangles) = (Vec::new(), Vec::new());
    for copy in 0..COPIES {
        all.extend(positions.iter().map(|p| *p + Vec3::X * 10.0 * copy as f32));
        all_triangles.extend(triangles.iter().map(|t| t.map(|v| v + 48 * copy)));
    }
    let hierarchy = given_back("components", &LodMesh::of_triangles(&all, &all_triangles));
    let mut seen = vec![false; COPIES as usize];
    for vertex in hierarchy.roots().flat_map(|root| hierarchy.cluster_vertices(root)) {
        seen[((hierarchy.position(*vertex).x + 5.0) / 10.0) as usize] = true;
    }
    assert!(seen.iter().all(|there| *there) && hierarchy.root_triangles() < hierarchy.triangle_count());
    // Nothing of it can go, and nothing takes long.
    let corner = |k: u32| Vec3::new((k % 3) as f32 * 0.1, (k / 3 % 100) as f32, (k / 300) as f32 + (k % 2) as f32 * 0.1);
    let positions: Vec<Vec3> = (0..30_000).map(corner).collect();
    let triangles: Vec<[u32; 3]> = (0..10_000).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let hierarchy = given_back("triangles", &LodMesh::of_triangles(&positions, &triangles));
    assert_eq!((hierarchy.group_count(), hierarchy.root_triangles()), (0, 10_000));
    assert!(hierarchy.roots().all(|root| hierarchy.triangles(root).len() <= MAX_CLUSTER_TRIANGLES as usize));
}

#[test]
fn the_same_mesh_gives_the_same_bytes() {
    let bytes = || {
        let (base, blocks) = clustered(&seams(), 100);
        (base.encode(), blocks.iter().map(|block| block.encode()).collect::<Vec<_>>())
    };
    assert_eq!(bytes(), bytes());
    let options = LodOptions { block_vertices: 0, ..LodOptions::default() };
    assert!(matches!(cluster_hierarchy(&torus(), &options), Err(LodError::Block { found: 0 })));
}
