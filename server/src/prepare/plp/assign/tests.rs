//! Goal: every cell lists every triangle that touches it, and hardly any other. Method: triangles of all sizes against an oracle that clips
//! them by a cell's planes, one cell after another.

use glam::Vec3;

use super::super::delaunay;
use super::super::world::Surface;
use super::*;
use crate::generate::Random;

/// Whether what four planes leave of a triangle, each moved outwards by `slack_m`, is something.
fn is_left(triangle: &[DVec3; 3], mesh: &CellMesh, cell: u32, slack_m: f64) -> bool {
    let mut polygon = triangle.to_vec();
    for plane in mesh.planes(cell) {
        let mut kept = Vec::new();
        for (k, &from) in polygon.iter().enumerate() {
            let to = polygon[(k + 1) % polygon.len()];
            let (a, b) = (plane.height_m(from) - slack_m, plane.height_m(to) - slack_m);
            if a <= 0.0 {
                kept.push(from);
            }
            if (a <= 0.0) != (b <= 0.0) {
                kept.push(from + (to - from) * (a / (a - b)));
            }
        }
        polygon = kept;
    }
    !polygon.is_empty()
}

#[test]
fn every_cell_lists_what_touches_it() {
    for seed in 0..4 {
        let mut random = Random::new(seed);
        let half_m = Vec3::new(10.0, 20.0, 5.0);
        let mut vector = |half: Vec3| Vec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0)) * half;
        let mut points: Vec<Vec3> = (0..80).map(|_| vector(half_m)).collect();
        points
            .extend((0..8).map(|k| half_m * 1.1 * (Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32) * 2.0 - 1.0)));
        let mesh = delaunay::tetrahedra(&points).expect("they fill space");
        let sizes = [0.05, 0.5, 3.0, 40.0];
        let mut leaves: Vec<WorldLeaf> = (0..6)
            .map(|leaf| {
                let triangle = |k: usize| {
                    let at = vector(half_m);
                    [(); 3].map(|()| (at + vector(Vec3::splat(sizes[k % 4]))).clamp(-half_m, half_m))
                };
                let surface = Surface { double_sided: false, opaque: true };
                WorldLeaf { leaf, triangles: (0..30).map(triangle).collect(), surface }
            })
            .collect();
        // Along edges and in faces of cells, and what is no triangle at all.
        let corner = |cell: usize, k: usize| mesh.vertices[mesh.corners[cell][k] as usize];
        let within = |p: Vec3| p.clamp(-half_m, half_m);
        leaves[0].triangles.extend((0..20).map(|cell| [0, 1, 2].map(|k| within(corner(cell, k)))));
        leaves[1].triangles.extend((0..20).map(|cell| [0, 1, 1].map(|k| within(corner(cell, k)))));
        leaves[2].triangles.extend((0..20).map(|cell| [within(corner(cell, 0)); 3]));
        let world = WorldLeaves { origin: DVec3::ZERO, half_m, longest_m: 40.0, leaves };
        let assigned = assign(&world, &mesh).expect("few");
        check(&world, &mesh, &assigned);
    }
}

fn check(world: &WorldLeaves, mesh: &CellMesh, assigned: &Assigned) {
    let slack_m = f64::from(world.longest_m) * SLACK_SHARE;
    let (mut run, mut start, mut listed_in_all) = (0, 0, 0);
    for cell in 0..mesh.corners.len() as u32 {
        let mut listed = Vec::new();
        while run < assigned.run_ends[cell as usize] as usize {
            let (place, end) = (assigned.runs[run].place, assigned.ends[run]);
            listed.extend(assigned.triangles[start..end as usize].iter().map(|number| (place, *number)));
            (run, start) = (run + 1, end as usize);
        }
        assert!(listed.is_sorted_by(|a, b| a < b), "leaves and triangles ascend");
        for (place, leaf) in world.leaves.iter().enumerate() {
            for (number, triangle) in leaf.triangles.iter().enumerate() {
                let triangle = triangle.map(|p| p.as_dvec3());
                let is_listed = listed.contains(&(place as u32, number as u16));
                assert!(is_listed || !is_left(&triangle, mesh, cell, 0.0), "cell {cell} lacks {number} of {place}");
                // Planes that meet at a sharp edge leave more than what is within the slack.
                assert!(!is_listed || is_left(&triangle, mesh, cell, 1000.0 * slack_m), "cell {cell} has {number} of {place}");
            }
        }
        listed_in_all += listed.len();
    }
    assert_eq!(start, assigned.triangles.len());
    assert!(listed_in_all > world.leaves.iter().map(|leaf| leaf.triangles.len()).sum::<usize>());
}

#[test]
fn a_walk_ends_where_the_point_is() {
    let mut random = Random::new(9);
    let mut vector = |size: f32| Vec3::new(random.range(-size, size), random.range(-size, size), random.range(-size, 2.0 * size));
    let points: Vec<Vec3> = (0..200).map(|_| vector(1.0)).collect();
    let mesh = delaunay::tetrahedra(&points).expect("they fill space");
    for k in 0..500u32 {
        let p = vector(0.5).as_dvec3();
        let cell = mesh.locate(p, k % mesh.corners.len() as u32);
        let height_m = |cell: u32| mesh.planes(cell).iter().map(|plane| plane.height_m(p)).fold(f64::NEG_INFINITY, f64::max);
        let is_inside = (0..mesh.corners.len() as u32).any(|c| height_m(c) <= 0.0);
        assert!(height_m(cell) <= 0.0 || !is_inside);
    }
}
