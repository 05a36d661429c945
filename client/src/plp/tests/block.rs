//! A block of cubes, six tetrahedra each, with random triangles: for tests, and for the benchmark that has no prepared scene.

use std::collections::HashMap;

use glam::{DAffine3, DVec3, Vec3};
use mullion_common::scene::{
    AlphaMode, Cell, CellId, ChunkHash, ChunkId, ChunkKind, ChunkRecord, Cover, Exposure, FACES, Facing, LeafRecord, LeafRun,
    Material, MaterialId, ObjectId, SceneManifest, Tessellation, TessellationParts, Transform, push_numbers,
};

const CUBE_M: Vec3 = Vec3::new(1.0, 2.0, 1.5);
pub const TRIANGLES_IN_LEAF: u32 = 37;
pub const ORIGIN: DVec3 = DVec3::new(1000.0, -50.0, 3.0);

/// A scene, its tessellation, and its triangles by slot, from the tessellation's origin.
pub struct Block {
    pub scene: SceneManifest,
    pub tessellation: Tessellation,
    pub triangles: Vec<[Vec3; 3]>,
}

/// SplitMix64, from 0 up to 1.
pub fn next(state: &mut u64) -> f32 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb) >> 40) as f32 / (1 << 24) as f32
}

/// How large a block of so many cubes is.
pub fn size_m(cubes: [usize; 3]) -> Vec3 {
    Vec3::from(cubes.map(|n| n as f32)) * CUBE_M
}

/// Six tetrahedra to a cube, along its diagonal: one for each order of the axes.
fn cells([nx, ny, nz]: [usize; 3]) -> (Vec<Vec3>, Vec<[u32; 4]>) {
    let index = |p: [usize; 3]| (p[0] + (nx + 1) * (p[1] + (ny + 1) * p[2])) as u32;
    let mut vertices = Vec::new();
    let mut corners = Vec::new();
    for z in 0..=nz {
        for y in 0..=ny {
            for x in 0..=nx {
                vertices.push(Vec3::new(x as f32, y as f32, z as f32) * CUBE_M);
                if x == nx || y == ny || z == nz {
                    continue;
                }
                for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
                    let mut at = [x, y, z];
                    let mut cell = [index(at); 4];
                    for (k, axis) in order.into_iter().enumerate() {
                        at[axis] += 1;
                        cell[k + 1] = index(at);
                    }
                    corners.push(cell);
                }
            }
        }
    }
    for cell in &mut corners {
        let [a, b, c, d] = cell.map(|k| vertices[k as usize]);
        if (b - a).dot((c - a).cross(d - a)) < 0.0 {
            cell.swap(2, 3);
        }
    }
    (vertices, corners)
}

fn neighbours(corners: &[[u32; 4]]) -> Vec<[CellId; 4]> {
    let key = |cell: &[u32; 4], face: usize| {
        let mut key = FACES[face].map(|k| cell[k]);
        key.sort_unstable();
        key
    };
    let mut by_face: HashMap<[u32; 3], Vec<u32>> = HashMap::new();
    for (k, cell) in corners.iter().enumerate() {
        (0..4).for_each(|face| by_face.entry(key(cell, face)).or_default().push(k as u32));
    }
    let beyond = |k: u32, cell: &[u32; 4], face| {
        by_face[&key(cell, face)].iter().find(|other| **other != k).map_or(CellId::NONE, |other| CellId(*other))
    };
    (0..).zip(corners).map(|(k, cell)| [0, 1, 2, 3].map(|face| beyond(k, cell, face))).collect()
}

/// A block of so many cubes and leaves of [`TRIANGLES_IN_LEAF`].
pub fn block(seed: u64, cubes: [usize; 3], leaves: u32) -> Block {
    let mut state = seed;
    let size_m = size_m(cubes);
    let (vertices, corners) = cells(cubes);
    let mut vector = |low: Vec3, size: Vec3| low + Vec3::new(next(&mut state), next(&mut state), next(&mut state)) * size;
    let mut triangles: Vec<[Vec3; 3]> = Vec::new();
    let mut scene = SceneManifest {
        transforms: vec![Transform::from(DAffine3::from_translation(ORIGIN))],
        materials: [false, true]
            .map(|double_sided| Material { base_color: [1.0; 4], texture: None, alpha: AlphaMode::Opaque, double_sided })
            .to_vec(),
        chunks: vec![ChunkRecord::new(ChunkHash([0; 32]), 0, 0, ChunkKind::Geometry); leaves as usize],
        leaves: Vec::new(),
    };
    let mut facings = Vec::new();
    for leaf in 0..leaves {
        let at = vector(Vec3::ZERO, size_m);
        let own: Vec<[Vec3; 3]> = (0..TRIANGLES_IN_LEAF)
            .map(|_| [(); 3].map(|()| vector(at - 0.4, Vec3::splat(0.8)).clamp(Vec3::splat(0.001), size_m - 0.001)))
            .collect();
        let (low, high) =
            own.as_flattened().iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let record = LeafRecord {
            object: ObjectId(0),
            chunk: ChunkId(leaf),
            material: MaterialId(leaf % 2),
            triangle_count: TRIANGLES_IN_LEAF,
            local_min: low.to_array(),
            local_max: high.to_array(),
        };
        let (middle, radius) = record.middle_and_radius();
        facings.extend(own.iter().map(|t| Facing::new(*t, middle, radius)));
        scene.leaves.push(record);
        triangles.extend(own);
    }
    let exposures = triangles
        .iter()
        .map(|_| Exposure::new(vector(Vec3::ZERO, Vec3::ONE).to_array().repeat(2).try_into().unwrap_or_default(), 0.01));
    let mut parts = TessellationParts {
        origin: ORIGIN,
        leaves: (0..leaves).collect(),
        exposures: exposures.collect(),
        facings,
        ..TessellationParts::default()
    };
    for (cell, neighbours) in corners.iter().zip(neighbours(&corners)) {
        let ends = cell.map(|k| vertices[k as usize]);
        let (low, high) = ends.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let mut triangle_count = 0;
        for (place, own) in triangles.chunks(TRIANGLES_IN_LEAF as usize).enumerate() {
            // As by their boxes: more than touch it.
            let meets = |t: &[Vec3; 3]| (0..3).all(|k| t.iter().any(|p| p[k] >= low[k]) && t.iter().any(|p| p[k] <= high[k]));
            let leaf = &scene.leaves[place];
            if (0..3).any(|k| leaf.local_max[k] < low[k] || leaf.local_min[k] > high[k]) {
                continue;
            }
            let numbers: Vec<u16> = (0..).zip(own).filter(|(_, t)| meets(t)).map(|(number, _)| number).collect();
            if !numbers.is_empty() {
                push_numbers(&mut parts.words, &numbers);
                parts.runs.push(LeafRun { place: place as u32, end: parts.words.len() as u32 });
                triangle_count += numbers.len() as u32;
            }
        }
        let cover = Cover([(37 * parts.cells.len()) as u8; 12]);
        parts.cells.push(Cell { corners: *cell, neighbours, run_end: parts.runs.len() as u32, triangle_count, cover });
    }
    parts.vertices = vertices;
    Block { tessellation: Tessellation::new(parts, &scene).expect("it is one"), scene, triangles }
}
