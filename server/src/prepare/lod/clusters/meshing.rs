//! The meshopt crate: it cuts meshes into clusters, puts clusters into groups, and simplifies what a group is. It gets positions about 0 and of
//! size 1, whatever the mesh's are.

use glam::{DVec3, Vec3};
use meshopt::{SimplifyOptions, VertexDataAdapter};
use mullion_common::scene::{MAX_CLUSTER_TRIANGLES, MAX_CLUSTER_VERTICES};

/// Clusters of at least so many triangles may end where they would become much larger than they must.
const LEAST_CLUSTER_TRIANGLES: usize = 40;
/// How much larger, in radii of a full one.
const SPLIT_FACTOR: f32 = 2.0;
/// What a texture coordinate counts beside a position: of its range in the piece, as positions of theirs.
const UV_WEIGHT: f32 = 0.25;
/// What a colour counts.
const COLOR_WEIGHT: f32 = 0.25;

/// Vertices about 0 and of size 1.
pub struct Unit {
    positions: Vec<[f32; 3]>,
    /// Metres of a unit.
    scale: f64,
}

impl Unit {
    /// Of some positions.
    pub fn of(positions: impl Iterator<Item = Vec3> + Clone) -> Self {
        let (low, high) = positions
            .clone()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p.as_dvec3()), high.max(p.as_dvec3())));
        let (center, size) = (low.midpoint(high), (high - low).max_element());
        let scale = if size > 0.0 { size } else { 1.0 };
        Self { positions: positions.map(|p| ((p.as_dvec3() - center) / scale).as_vec3().to_array()).collect(), scale }
    }

    fn adapter(&self) -> VertexDataAdapter<'_> {
        let bytes = bytemuck::cast_slice(&self.positions);
        VertexDataAdapter::new(bytes, size_of::<[f32; 3]>(), 0).expect("whole positions, from the first byte")
    }
}

/// Cuts triangles into clusters.
pub fn clusters(unit: &Unit, triangles: &[[u32; 3]]) -> Vec<Vec<[u32; 3]>> {
    let (most_vertices, most_triangles) = (MAX_CLUSTER_VERTICES as usize, MAX_CLUSTER_TRIANGLES as usize);
    let (indices, least) = (triangles.as_flattened(), LEAST_CLUSTER_TRIANGLES);
    let cut = meshopt::build_meshlets_flex(indices, &unit.adapter(), most_vertices, least, most_triangles, 0.0, SPLIT_FACTOR);
    let triangles = |cluster: meshopt::Meshlet<'_>| {
        cluster.triangles.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|place| cluster.vertices[usize::from(place)])).collect()
    };
    cut.iter().map(triangles).collect()
}

/// Puts clusters into groups of about `size`, by the vertices that they share and by where they are; for each cluster its group's number.
pub fn groups(unit: &Unit, clusters: &[Vec<[u32; 3]>], size: usize) -> Vec<u32> {
    let indices: Vec<u32> = clusters.iter().flat_map(|cluster| cluster.as_flattened()).copied().collect();
    let counts: Vec<u32> = clusters.iter().map(|cluster| 3 * cluster.len() as u32).collect();
    let mut groups = vec![0; clusters.len()];
    meshopt::partition_clusters_with_positions(&mut groups, &indices, &counts, &unit.adapter(), size);
    groups
}

/// What vertices look like: numbers for each, the same for all.
pub struct Looks {
    values: Vec<f32>,
    weights: Vec<f32>,
}

impl Looks {
    /// Of texture coordinates and colours; either may be empty.
    pub fn of(uvs: &[[f32; 2]], colors: &[[u8; 4]]) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for uv in uvs {
            for axis in 0..2 {
                low[axis] = low[axis].min(uv[axis].into());
                high[axis] = high[axis].max(uv[axis].into());
            }
        }
        let size = (high[0] - low[0]).max(high[1] - low[1]);
        let scale = if size > 0.0 { size } else { 1.0 };
        let mut values = Vec::new();
        for vertex in 0..uvs.len().max(colors.len()) {
            if let Some(uv) = uvs.get(vertex) {
                values.extend([0, 1].map(|axis| ((f64::from(uv[axis]) - low[axis]) / scale) as f32));
            }
            if let Some(color) = colors.get(vertex) {
                values.extend(color.map(|channel| f32::from(channel) / 255.0));
            }
        }
        let mut weights = vec![UV_WEIGHT; if uvs.is_empty() { 0 } else { 2 }];
        weights.resize(weights.len() + if colors.is_empty() { 0 } else { 4 }, COLOR_WEIGHT);
        Self { values, weights }
    }
}

/// Simplifies triangles towards a count; locked vertices stay where they are. Also how far the surface may be from what it was, metres: an
/// estimate, that of what it looks like in it.
pub fn simplify(unit: &Unit, looks: &Looks, triangles: &[[u32; 3]], locked: &[bool], target: usize) -> (Vec<[u32; 3]>, f32) {
    let mut error = 0.0;
    let stride = looks.weights.len() * size_of::<f32>();
    let left = meshopt::simplify_with_attributes_and_locks(
        triangles.as_flattened(),
        &unit.adapter(),
        &looks.values,
        &looks.weights,
        stride,
        locked,
        target * 3,
        f32::MAX,
        SimplifyOptions::ErrorAbsolute,
        Some(&mut error),
    );
    let triangles = left.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    (triangles, (f64::from(error) * unit.scale) as f32)
}
