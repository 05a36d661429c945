//! The Delaunay tetrahedralisation: the only user of simple_delaunay_lib.

use glam::Vec3;
use mullion_common::geometry::Aabb;
use simple_delaunay_lib::delaunay_3d::delaunay_struct_3d::DelaunayStructure3D;
use simple_delaunay_lib::delaunay_3d::simplicial_struct_3d::Node;

use super::mesh::{CellMesh, NO_CELL};
use crate::tree::regroup::morton;

/// The cells of distinct points, in the order of a Morton curve through their middles: neighbours lie near in memory.
///
/// # Errors
/// For points in one plane, and where a cell has no volume.
pub(super) fn tetrahedra(points: &[Vec3]) -> Result<CellMesh, String> {
    let mut delaunay = DelaunayStructure3D::new();
    let coordinates: Vec<[f64; 3]> = points.iter().map(|p| p.as_dvec3().to_array()).collect();
    delaunay.insert_vertices(&coordinates, true).map_err(|e| e.to_string())?;
    let simplices = delaunay.get_simplicial();
    let mut found: Vec<([u32; 4], [usize; 4])> = Vec::with_capacity(simplices.get_nb_tetrahedra());
    let mut number: Vec<u32> = vec![NO_CELL; simplices.get_nb_tetrahedra()];
    for (k, number) in number.iter_mut().enumerate() {
        let cell = simplices.get_tetrahedron(k).map_err(|e| e.to_string())?;
        let mut corners = [0; 4];
        if cell.nodes().into_iter().zip(&mut corners).all(|(node, corner)| match node {
            Node::Value(vertex) => {
                *corner = vertex as u32;
                true
            }
            Node::Infinity => false,
        }) {
            *number = found.len() as u32;
            found.push((corners, cell.halftriangles().map(|face| face.opposite().tetrahedron().ind())));
        }
    }
    let cells = found
        .into_iter()
        .map(|(corners, beyond)| upright(points, corners, beyond.map(|k| number[k])).ok_or("a cell without volume"))
        .collect::<Result<Vec<_>, _>>()?;
    Ok(ordered(points, cells))
}

/// Corners in their order, with the neighbours beyond the faces opposite to them.
fn upright(points: &[Vec3], mut corners: [u32; 4], mut beyond: [u32; 4]) -> Option<([u32; 4], [u32; 4])> {
    let [a, b, c, d] = corners.map(|k| points[k as usize].as_dvec3());
    let volume = (b - a).dot((c - a).cross(d - a));
    if volume < 0.0 {
        corners.swap(2, 3);
        beyond.swap(2, 3);
    }
    (volume != 0.0).then_some((corners, beyond))
}

fn ordered(points: &[Vec3], cells: Vec<([u32; 4], [u32; 4])>) -> CellMesh {
    let all = Aabb::of_points(points.iter().map(|p| p.as_dvec3()));
    let middle = |corners: &[u32; 4]| corners.iter().map(|k| points[*k as usize].as_dvec3()).sum::<glam::DVec3>() / 4.0;
    let mut order: Vec<(u64, u32)> =
        cells.iter().enumerate().map(|(k, (corners, _))| (morton((middle(corners) - all.min) / all.size()), k as u32)).collect();
    order.sort_unstable();
    let mut renumbered = vec![NO_CELL; cells.len()];
    order.iter().zip(0..).for_each(|((_, old), new)| renumbered[*old as usize] = new);
    let new_number = |old: u32| renumbered.get(old as usize).copied().unwrap_or(NO_CELL);
    let (corners, neighbours) = order
        .iter()
        .map(|(_, old)| {
            let (corners, beyond) = cells[*old as usize];
            (corners, beyond.map(new_number))
        })
        .unzip();
    CellMesh::new(points.to_vec(), corners, neighbours)
}
