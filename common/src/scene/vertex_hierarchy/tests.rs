//! Goal: a hierarchy goes round to the bit, and no bytes bring the decoder to a panic or to a hierarchy that names what is not there. Method:
//! a tetrahedron, two fans and a seam, bent word by word and cut at every length.

use super::*;
use crate::scene::{Hierarchy, ObjectId, SceneManifest, Transform};

fn split(length: usize, shape: LinkShape, is_follower: bool) -> Split {
    let extent = NodeExtent { error: 0.5, radius: 2.0, ..NodeExtent::default() };
    Split::new(PackedBounds::new(&extent), length, shape, is_follower)
}

/// A tetrahedron; 4 splits from 3 over a face, 5 from 4 over two.
fn closed() -> (BaseMesh, BlockParts) {
    let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
    let base = BaseMesh {
        vertices: VertexData { positions, ..VertexData::default() },
        triangles: vec![[2, 1, 0], [3, 0, 1], [3, 1, 2], [3, 2, 0]],
        materials: vec![MaterialId(0)],
        vertex_total: 6,
        triangle_total: 8,
        block_count: 1,
        local_max: [1.0, 2.0, 3.0],
        ..BaseMesh::default()
    };
    let block = BlockParts {
        first: 4,
        vertices: VertexData { positions: vec![[0.4, 0.8, 1.0], [0.5, 0.5, 1.0]], ..VertexData::default() },
        splits: vec![split(3, LinkShape::Ring, false), split(4, LinkShape::Ring, false)],
        links: vec![3, 1, 2, 4, 1, 2, 3],
    };
    (base, block)
}

/// A quad of two materials whose border runs along 0–1 and 2–3, both at the same places; 4 and 5 split together.
fn seam() -> (BaseMesh, BlockParts) {
    let positions = vec![[0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [3.0, 1.0, 0.0], [-3.0, 1.0, 0.0]];
    let base = BaseMesh {
        vertices: VertexData { positions, parts: vec![0, 0, 1, 1, 0, 1], uvs: vec![[0.0, 1.0]; 6], colors: vec![[9; 4]; 6] },
        triangles: vec![[4, 1, 0], [5, 2, 3]],
        materials: vec![MaterialId(1), MaterialId(0)],
        attributes: VertexAttributes { uvs: true, colors: true },
        vertex_total: 8,
        triangle_total: 4,
        block_count: 1,
        local_min: [-3.0, 0.0, 0.0],
        local_max: [3.0, 4.0, 0.0],
    };
    let vertices = VertexData {
        positions: vec![[0.0, 2.0, 0.0]; 2],
        parts: vec![0, 1],
        uvs: vec![[0.5, 0.5]; 2],
        colors: vec![[1, 2, 3, 4]; 2],
    };
    let block = BlockParts {
        first: 6,
        vertices,
        splits: vec![split(3, LinkShape::PathFromParent, false), split(3, LinkShape::PathToParent, true)],
        links: vec![1, 0, 4, 5, 2, 3],
    };
    (base, block)
}

fn joined((base, block): (BaseMesh, BlockParts)) -> Result<VertexHierarchy, VertexHierarchyError> {
    let mut hierarchy = VertexHierarchy::new(base)?;
    hierarchy.append(block)?;
    Ok(hierarchy)
}

#[test]
fn splits_stand_in_a_tree() {
    let hierarchy = joined(closed()).expect("it is one");
    assert_eq!((hierarchy.triangle_count(), hierarchy.vertex_count(), hierarchy.base_count()), (8, 6, 4));
    assert_eq!(hierarchy.first_child(VertexId(3)), Some(VertexId(4)));
    assert_eq!(hierarchy.first_child(VertexId(4)), Some(VertexId(5)));
    assert_eq!(hierarchy.first_child(VertexId(5)), None);
    assert_eq!(hierarchy.next_sibling(VertexId(4)), None);
    assert_eq!(hierarchy.bounds(VertexId(5)).center, hierarchy.position(VertexId(4)));
    let triangle = hierarchy.places([3, 4, 2]).next().expect("4 made it");
    assert_eq!(triangle, TrianglePlace { maker: VertexId(4), number: 2 });
    assert_eq!(hierarchy.triangle(triangle), [VertexId(4), VertexId(2), VertexId(3)]);

    let hierarchy = joined(seam()).expect("it is one");
    assert_eq!(hierarchy.together(VertexId(6)).collect::<Vec<_>>(), [VertexId(6), VertexId(7)]);
    assert_eq!((hierarchy.added_triangles(VertexId(6)), hierarchy.lead(VertexId(7))), (2, VertexId(6)));
    assert_eq!((hierarchy.first_child(VertexId(1)), hierarchy.first_child(VertexId(3))), (Some(VertexId(6)), None));
    assert_eq!([6, 7].map(|v| hierarchy.material(VertexId(v))), [MaterialId(1), MaterialId(0)]);
}

#[test]
fn bytes_go_round() {
    for (base, block) in [closed(), seam()] {
        let (base_bytes, block_bytes) = (base.encode(), block.encode());
        let mut decoded = VertexHierarchy::decode_base(&base_bytes, 2).expect("it is one");
        assert!(!decoded.is_complete());
        decoded.decode_block(&block_bytes).expect("it is one");
        assert_eq!(Ok(&decoded), joined((base, block)).as_ref());
        assert!(decoded.is_complete() && decoded.decode_block(&block_bytes).is_err());
    }
}

#[test]
fn bent_and_cut_bytes_are_read_or_refused() {
    for (base, block) in [closed(), seam()] {
        let (base_bytes, block_bytes) = (base.encode(), block.encode());
        let whole = VertexHierarchy::decode_base(&base_bytes, 2).expect("it is one");
        for cut in 0..base_bytes.len() {
            assert!(VertexHierarchy::decode_base(&base_bytes[..cut], 2).is_err(), "base cut at {cut}");
        }
        for cut in 0..block_bytes.len() {
            assert!(whole.clone().decode_block(&block_bytes[..cut]).is_err(), "block cut at {cut}");
        }
        let values = [0, 1, 2, 3, 4, 5, 6, 7, 0x0304_0506, 0x7fff_ffff, 0x7fc0_0000, u32::MAX - 1, u32::MAX];
        let bent = |bytes: &[u8], word: usize, value: u32| {
            let mut bent = bytes.to_vec();
            bent[word * 4..][..4].copy_from_slice(&u32::to_le_bytes(value));
            bent
        };
        for value in values {
            for word in 0..base_bytes.len() / 4 {
                if let Ok(mut hierarchy) = VertexHierarchy::decode_base(&bent(&base_bytes, word, value), 2) {
                    let _ = hierarchy.decode_block(&block_bytes);
                    assert_sound(&hierarchy);
                }
            }
            for word in 0..block_bytes.len() / 4 {
                let mut hierarchy = whole.clone();
                if hierarchy.decode_block(&bent(&block_bytes, word, value)).is_err() {
                    assert_eq!(hierarchy, whole, "a refused block changes nothing");
                }
                assert_sound(&hierarchy);
            }
        }
    }
}

fn assert_sound(hierarchy: &VertexHierarchy) {
    let mut children = 0;
    for vertex in (0..hierarchy.vertex_count()).map(VertexId) {
        assert!(hierarchy.position(vertex).is_finite());
        hierarchy.material(vertex);
        for number in 0..hierarchy.made_count(vertex) {
            assert_eq!(hierarchy.triangle(TrianglePlace { maker: vertex, number })[0], vertex);
        }
        let mut child = hierarchy.first_child(vertex);
        while let Some(lead) = child {
            assert!(lead > vertex && hierarchy.parent(lead) == vertex);
            assert!(hierarchy.bounds(lead).extent.radius.is_finite());
            children += hierarchy.together(lead).count() as u32;
            child = hierarchy.next_sibling(lead);
        }
    }
    assert_eq!(children + hierarchy.base_count(), hierarchy.vertex_count());
}

#[test]
fn what_does_not_hold_is_refused() {
    let refused = |bend: &dyn Fn(&mut BaseMesh, &mut BlockParts)| {
        let (mut base, mut block) = closed();
        bend(&mut base, &mut block);
        joined((base, block)).expect_err("it does not hold").to_string()
    };
    assert_eq!(refused(&|_, block| block.links[1] = 0), "vertex 4: a triangle that it takes is not there");
    assert_eq!(refused(&|_, block| block.links[1] = 2), "vertex 4: its link names a vertex twice, or one that is not there");
    assert_eq!(refused(&|_, block| block.links[4] = 5), "vertex 5: its link names a vertex twice, or one that is not there");
    assert_eq!(refused(&|_, block| block.links[5..].swap(0, 1)), "vertex 5: a triangle that it takes is not there");
    let follows = "vertex 4: it follows no lead of its block";
    assert_eq!(refused(&|_, block| block.splits[0] = split(3, LinkShape::PathToParent, true)), follows);
    let elsewhere = "vertex 5: it is not where its lead is, or a link is no path";
    assert_eq!(refused(&|_, block| block.splits[1] = split(4, LinkShape::PathToParent, true)), elsewhere);
    assert_eq!(refused(&|base, _| base.triangles.swap(0, 1)), "base triangle 1: triangles do not ascend");
    assert_eq!(refused(&|base, _| base.triangles[0] = [1, 0, 2]), "base triangle 0: its greatest vertex is not first");
    assert_eq!(refused(&|base, _| base.triangle_total = 9), "triangles: 8, expected are 9");
    assert_eq!(refused(&|base, _| base.vertices.positions[1][0] = f32::NAN), "a coordinate is not finite");
}

#[test]
fn tables_go_round_and_bad_ones_are_refused() {
    let scene = SceneManifest {
        transforms: vec![Transform::from(glam::DAffine3::IDENTITY); 4],
        materials: vec![crate::scene::Material {
            base_color: [1.0; 4],
            texture: None,
            alpha: crate::scene::AlphaMode::Opaque,
            double_sided: false,
        }],
        ..SceneManifest::default()
    };
    let (base, block) = closed();
    let mut table = HierarchyTable::default();
    table.push(vec![ObjectId(1), ObjectId(3)], &[base.encode(), block.encode()]);
    table.push(vec![ObjectId(0)], &[base.encode(), block.encode()]);
    let bytes = table.section_bytes();
    assert_eq!(HierarchyTable::from_section(&bytes, &scene), Ok(table.clone()));
    assert_eq!(table.decode(1, &scene), joined(closed()).map(Hierarchy::Vertices));
    for cut in 0..bytes.len() {
        assert!(HierarchyTable::from_section(&bytes[..cut], &scene).is_err(), "cut at {cut}");
    }
    for word in 0..16 {
        for value in [0, 1, 2, 3, 4, 0x00ff_ffff, u32::MAX] {
            let mut bent = bytes.clone();
            bent[word * 4..][..4].copy_from_slice(&u32::to_le_bytes(value));
            if let Ok(table) = HierarchyTable::from_section(&bent, &scene) {
                (0..table.entries().len()).for_each(|k| drop(table.decode(k, &scene)));
            }
        }
    }
}
