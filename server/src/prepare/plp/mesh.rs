//! Tetrahedra with their neighbours, and where points are in them.

use glam::{DVec3, Vec3};
use mullion_common::scene::FACES;

/// No cell: beyond the hull.
pub(super) const NO_CELL: u32 = u32::MAX;

/// Cells, as [`mullion_common::scene::Cell`] has them.
pub(super) struct CellMesh {
    /// Metres from the scene's origin.
    pub vertices: Vec<Vec3>,
    /// (b − a) · ((c − a) × (d − a)) is above 0.
    pub corners: Vec<[u32; 4]>,
    /// Beyond the face without that corner.
    pub neighbours: Vec<[u32; 4]>,
    planes: Vec<[FacePlane; 4]>,
}

/// A face's plane: the unit normal points out of the cell.
#[derive(Clone, Copy)]
pub(super) struct FacePlane {
    normal: DVec3,
    offset_m: f64,
}

impl FacePlane {
    /// How far a point is outside.
    pub fn height_m(&self, p: DVec3) -> f64 {
        self.normal.dot(p) + self.offset_m
    }
}

impl CellMesh {
    /// The mesh of cells; every one must have a volume and its corners in order.
    pub fn new(vertices: Vec<Vec3>, corners: Vec<[u32; 4]>, neighbours: Vec<[u32; 4]>) -> Self {
        let planes = corners
            .iter()
            .map(|cell| {
                FACES.map(|face| {
                    let [a, b, c] = face.map(|k| vertices[cell[k] as usize].as_dvec3());
                    let normal = (b - a).cross(c - a).normalize_or_zero();
                    FacePlane { normal, offset_m: -normal.dot(a) }
                })
            })
            .collect();
        Self { vertices, corners, neighbours, planes }
    }

    pub fn planes(&self, cell: u32) -> &[FacePlane; 4] {
        &self.planes[cell as usize]
    }

    pub fn tetrahedron(&self, cell: u32) -> [DVec3; 4] {
        self.corners[cell as usize].map(|k| self.vertices[k as usize].as_dvec3())
    }

    /// A cell that holds the point, or one that it is within rounding of: a walk from `near` through the face that it is furthest beyond
    /// (Devillers, Pion, Teillaud: *Walking in a Triangulation*, 2001; in a Delaunay mesh a walk ends). Where rounding leads it astray,
    /// every cell is asked.
    pub fn locate(&self, p: DVec3, near: u32) -> u32 {
        let furthest = |cell: u32| {
            let heights = self.planes(cell).map(|plane| plane.height_m(p));
            (0..4)
                .map(|face| (heights[face], face))
                .fold((f64::NEG_INFINITY, 0), |best, next| if next.0 > best.0 { next } else { best })
        };
        let (mut cell, mut before) = (near, NO_CELL);
        // A walk is hardly longer than a few times the cells along a line.
        for _ in 0..64 + self.corners.len() / 16 {
            let (height_m, face) = furthest(cell);
            let beyond = self.neighbours[cell as usize][face];
            // Back and forth: the point is within rounding of the face between two cells.
            if height_m <= 0.0 || beyond == NO_CELL || beyond == before {
                return cell;
            }
            (before, cell) = (cell, beyond);
        }
        let all = 0..self.corners.len() as u32;
        all.min_by(|a, b| furthest(*a).0.total_cmp(&furthest(*b).0)).unwrap_or(near)
    }
}
