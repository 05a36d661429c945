//! Goal: a tessellation goes round to the bit, and no bytes bring the decoder to a panic or to more memory than they have. Method: two cells
//! that share a face, bent word by word and cut at every length.

use glam::DAffine3;

use super::*;
use crate::scene::{
    AlphaMode, ChunkHash, ChunkId, ChunkKind, ChunkRecord, LeafRecord, Material, MaterialId, ObjectId, SceneManifest, Transform,
};

fn scene() -> SceneManifest {
    let leaf = |chunk, triangle_count| LeafRecord {
        object: ObjectId(0),
        chunk: ChunkId(chunk),
        material: MaterialId(0),
        triangle_count,
        local_min: [0.0; 3],
        local_max: [1.0, 2.0, 3.0],
    };
    SceneManifest {
        transforms: vec![Transform::from(DAffine3::IDENTITY)],
        leaves: vec![leaf(1, 3), leaf(0, 9), leaf(1, 3), leaf(0, 9)],
        materials: vec![Material { base_color: [1.0; 4], texture: None, alpha: AlphaMode::Opaque, double_sided: false }],
        chunks: vec![ChunkRecord::new(ChunkHash([0; 32]), 0, 0, ChunkKind::Geometry); 2],
    }
}

/// Two tetrahedra above and below a triangle; leaves 0, 2 and 3 are covered.
fn parts() -> TessellationParts {
    let none = CellId::NONE;
    let cell = |corners, neighbours, run_end, triangle_count| Cell {
        corners,
        neighbours,
        run_end,
        triangle_count,
        cover: Cover([0, 1, 2, 3, 4, 255, 6, 7, 8, 9, 10, 11]),
    };
    TessellationParts {
        origin: DVec3::new(1e6, 2.0, 3.0),
        vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y * 2.0, Vec3::Z * 3.0, Vec3::NEG_Z],
        cells: vec![
            cell([0, 1, 2, 3], [none, none, none, CellId(1)], 2, 3),
            cell([0, 2, 1, 4], [none, none, none, CellId(0)], 4, 4),
        ],
        runs: [(0, 2), (2, 3), (0, 4), (1, 6)].map(|(place, end)| LeafRun { place, end }).to_vec(),
        words: vec![0, 2, 8, 1, 0x8000, 2],
        leaves: vec![0, 2, 3],
        exposures: (0..15).map(Exposure).collect(),
        facings: (0..12).map(|k| Facing([k, 0, 255])).collect(),
    }
}

#[test]
fn bytes_go_round() {
    let tessellation = Tessellation::new(parts(), &scene()).expect("it is one");
    let bytes = tessellation.encode();
    assert_eq!(Tessellation::decode(&bytes, &scene()), Ok(tessellation.clone()));
    assert_eq!(tessellation.rho_mean(), 4);
    assert_eq!((tessellation.slot_count(), tessellation.reference_count()), (15, 7));
    let runs = |cell| {
        tessellation.runs(CellId(cell)).map(|(place, numbers)| (place, numbers.flatten().collect::<Vec<_>>())).collect::<Vec<_>>()
    };
    assert_eq!(runs(0), [(0, vec![0, 2]), (2, vec![8])]);
    assert_eq!(runs(1), [(0, vec![1]), (1, vec![0, 1, 2])]);
    assert_eq!([0, 1, 2].map(|place| tessellation.slots(place)), [0..3, 3..6, 6..15]);
    // Chunk 0 comes first, though the first leaf has chunk 1.
    assert_eq!([0, 1, 2].map(|place| tessellation.facings(place)[0].0[0]), [9, 9, 0]);
    let mut grown = scene();
    grown.leaves.push(grown.leaves[0]);
    assert!(Tessellation::decode(&bytes, &grown).is_ok(), "what comes behind changes nothing");
}

#[test]
fn nothing_is_a_tessellation_too() {
    let empty = Tessellation::new(TessellationParts::default(), &SceneManifest::default()).expect("it names nothing");
    assert_eq!(Tessellation::decode(&empty.encode(), &SceneManifest::default()), Ok(empty.clone()));
    assert_eq!((empty.slot_count(), empty.rho_mean()), (0, 1));
}

#[test]
fn bent_and_cut_bytes_are_read_or_refused() {
    let bytes = Tessellation::new(parts(), &scene()).expect("it is one").encode();
    for cut in 0..bytes.len() {
        assert!(Tessellation::decode(&bytes[..cut], &scene()).is_err(), "cut at {cut}");
    }
    let values = [0, 1, 2, 3, 4, 7, 0x7fff_ffff, 0x7fc0_0000, u32::MAX - 1, u32::MAX];
    for word in 0..bytes.len() / 4 {
        for value in values {
            let mut bent = bytes.clone();
            bent[word * 4..][..4].copy_from_slice(&u32::to_le_bytes(value));
            if let Ok(tessellation) = Tessellation::decode(&bent, &scene()) {
                for cell in 0..tessellation.cells().len() as u32 {
                    let id = CellId(cell);
                    let named: u32 = tessellation
                        .runs(id)
                        .map(|(place, rows)| tessellation.slots(place).len() as u32 + rows.count() as u32)
                        .sum();
                    assert!(named > 0 || tessellation.cell(id).triangle_count == 0);
                    assert!(tessellation.corners(id).iter().all(|corner| corner.is_finite()));
                }
            }
        }
    }
}

#[test]
fn what_does_not_hold_is_refused() {
    let refused = |bend: &dyn Fn(&mut TessellationParts)| {
        let mut parts = parts();
        bend(&mut parts);
        Tessellation::new(parts, &scene()).expect_err("it does not hold").to_string()
    };
    assert_eq!(
        refused(&|p| p.cells[0].neighbours[0] = CellId(1)),
        "cell 0: a neighbour is not there, has another face or does not name it"
    );
    assert_eq!(refused(&|p| p.cells[0].corners.swap(0, 1)), "cell 0: it is flat or inside out");
    assert_eq!(refused(&|p| p.cells[1].triangle_count = 9), "cell 1: its runs do not hold as many triangles as it says");
    assert_eq!(refused(&|p| p.words[1] = 0), "run 0: its triangles do not ascend or are not in the leaf");
    assert_eq!(refused(&|p| p.words[5] = 3), "run 3: its triangles do not ascend or are not in the leaf");
    assert_eq!(refused(&|p| p.words.push(0)), "run 4: it is in no cell, or words are left that are in no run");
    assert_eq!(refused(&|p| p.leaves[2] = 4), "leaf 4: it is not in the scene");
    assert_eq!(refused(&|p| p.leaves[2] = 2), "leaf 2: leaves do not ascend");
    assert_eq!(refused(&|p| p.facings.truncate(11)), "11 facings, the scene asks for 12");
    assert_eq!(refused(&|p| p.exposures.truncate(11)), "11 exposures, the scene asks for 15");
    assert_eq!(refused(&|p| p.vertices[4].x = f32::NAN), "a coordinate is not finite");
    let mut differing = scene();
    differing.leaves[2].triangle_count = 2;
    let error = Tessellation::new(parts(), &differing).expect_err("its chunk has three").to_string();
    assert_eq!(error, "leaf 0: leaves of its chunk differ in how many triangles it has");
}
