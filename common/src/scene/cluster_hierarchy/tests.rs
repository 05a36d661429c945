//! Goal: a hierarchy goes round to the bit, and no bytes bring the decoder to a panic or to a hierarchy that names what is not there. Method:
//! fans of few triangles in three groups and two blocks, bent word by word and cut at every length.

use super::*;
use crate::scene::Hierarchy;
use crate::scene::vertex_hierarchy::{NodeExtent, VertexHierarchyError};

fn record(error: f32, members: u8, results: u16) -> GroupRecord {
    let extent = NodeExtent { error, radius: 2.0, half_box: Vec3::new(1.0, 2.0, 0.5), ..NodeExtent::default() };
    GroupRecord { center: [1.0, 2.0, 0.0], bounds: PackedBounds::new(&extent), members, results }
}

fn clusters(clusters: &[(&[u32], &[[u8; 3]])]) -> ClusterParts {
    let mut parts = ClusterParts::default();
    clusters.iter().for_each(|(vertices, triangles)| parts.push(vertices.iter().copied(), triangles));
    parts
}

/// Two roots, of a material each. Group 0 has members 2 and 3 for both of them, groups 1 and 2 a member for one of these each.
fn parts() -> (ClusterBase, [ClusterBlock; 2]) {
    let vertices = |first: u32, parts: &[u8]| VertexData {
        positions: (first..).zip(parts).map(|(k, _)| [k as f32, (k * k % 7) as f32, (k % 3) as f32]).collect(),
        uvs: parts.iter().map(|part| [f32::from(*part), 0.5]).collect(),
        colors: parts.iter().map(|part| [*part; 4]).collect(),
        parts: parts.to_vec(),
    };
    let base = ClusterBase {
        vertices: vertices(0, &[0, 0, 0, 1, 1, 1]),
        roots: clusters(&[(&[0, 1, 2], &[[0, 1, 2]]), (&[5, 4, 3], &[[2, 1, 0]])]),
        materials: vec![MaterialId(1), MaterialId(0)],
        attributes: VertexAttributes { uvs: true, colors: true },
        vertex_total: 9,
        triangle_total: 6,
        group_total: 3,
        block_count: 2,
        local_min: [0.0; 3],
        local_max: [9.0, 7.0, 3.0],
    };
    let first = ClusterBlock {
        first: 0,
        vertices: vertices(6, &[0]),
        groups: vec![record(0.5, 2, 2)],
        results: vec![ClusterId(1), ClusterId(0)],
        members: clusters(&[(&[0, 1, 2, 6], &[[0, 1, 3], [0, 3, 2]]), (&[3, 4, 5], &[[0, 1, 2]])]),
    };
    let second = ClusterBlock {
        first: 1,
        vertices: vertices(7, &[1, 0]),
        groups: vec![record(0.25, 1, 1), record(0.0, 1, 1)],
        results: vec![ClusterId(3), ClusterId(2)],
        members: clusters(&[
            (&[3, 4, 5, 7], &[[0, 1, 3], [1, 2, 3], [2, 0, 3]]),
            (&[0, 1, 2, 6, 8], &[[0, 1, 3], [0, 3, 4], [0, 4, 2]]),
        ]),
    };
    (base, [first, second])
}

fn joined(base: ClusterBase, blocks: [ClusterBlock; 2]) -> Result<ClusterHierarchy, VertexHierarchyError> {
    let mut hierarchy = ClusterHierarchy::new(base)?;
    blocks.into_iter().try_for_each(|block| hierarchy.append(block))?;
    Ok(hierarchy)
}

fn whole() -> ClusterHierarchy {
    let (base, blocks) = parts();
    joined(base, blocks).expect("it is one")
}

#[test]
fn groups_name_each_other() {
    let h = whole();
    assert_eq!((h.group_count(), h.cluster_count(), h.vertex_count(), h.root_triangles(), h.triangle_count()), (3, 6, 9, 2, 6));
    assert_eq!(h.roots().collect::<Vec<_>>(), [ClusterId(0), ClusterId(1)]);
    assert_eq!([0, 1, 2].map(|g| h.needs(GroupId(g)).to_vec()), [vec![], vec![GroupId(0)], vec![GroupId(0)]]);
    assert_eq!([0, 1, 2].map(|g| h.below(GroupId(g)).to_vec()), [vec![GroupId(1), GroupId(2)], vec![], vec![]]);
    assert_eq!((h.first_groups(), h.added_triangles(GroupId(0)), h.added_triangles(GroupId(1))), (&[GroupId(0)][..], 1, 2));
    assert_eq!(h.members(GroupId(0)).collect::<Vec<_>>(), [ClusterId(2), ClusterId(3)]);
    assert_eq!(h.results(GroupId(0)), [ClusterId(1), ClusterId(0)]);
    assert_eq!([0, 2, 4].map(|c| h.group(ClusterId(c))), [None, Some(GroupId(0)), Some(GroupId(1))]);
    assert_eq!([0, 2, 4].map(|c| h.maker(ClusterId(c))), [Some(GroupId(0)), Some(GroupId(2)), None]);
    assert_eq!(h.triangles(ClusterId(1)).collect::<Vec<_>>(), [[3, 4, 5]]);
    assert_eq!([0, 1].map(|c| h.material(ClusterId(c))), [MaterialId(1), MaterialId(0)]);
    assert_eq!((h.sphere(GroupId(1)), h.error_m(GroupId(1))), ((Vec3::new(1.0, 2.0, 0.0), 2.0), 0.25));
    assert!(h.local_box(GroupId(1)).min.distance(DVec3::new(0.0, 0.0, -0.5)) < 0.02);
    assert_sound(&h);
}

#[test]
fn bytes_go_round() {
    let (base, blocks) = parts();
    let mut decoded = Hierarchy::decode_base(&base.encode(), 2).expect("it is one");
    for block in &blocks {
        decoded.decode_block(&block.encode()).expect("it is one");
    }
    assert_eq!((decoded.block_count(), decoded.block_total(), decoded.triangle_count()), (2, 2, 6));
    assert_eq!(decoded.materials(), [MaterialId(1), MaterialId(0)]);
    assert!(decoded.decode_block(&blocks[1].encode()).is_err());
    assert_eq!(decoded.into_clusters(), Some(whole()));
    assert!(ClusterHierarchy::decode_base(&base.encode(), 1).is_err(), "a material that the scene lacks");
}

#[test]
fn bent_and_cut_bytes_are_read_or_refused() {
    let (base, blocks) = parts();
    let base_bytes = base.encode();
    let block_bytes = blocks.each_ref().map(ClusterBlock::encode);
    let roots = ClusterHierarchy::decode_base(&base_bytes, 2).expect("it is one");
    let mut coarse = roots.clone();
    coarse.decode_block(&block_bytes[0]).expect("it is one");
    for cut in 0..base_bytes.len() {
        assert!(Hierarchy::decode_base(&base_bytes[..cut], 2).is_err(), "base cut at {cut}");
    }
    for (before, bytes) in [&roots, &coarse].into_iter().zip(&block_bytes) {
        for cut in 0..bytes.len() {
            assert!(before.clone().decode_block(&bytes[..cut]).is_err(), "block cut at {cut}");
        }
    }
    let values = [0, 1, 2, 3, 4, 5, 6, 9, 0x0001_0101, 0x0304_0506, 0x7fff_ffff, 0x7fc0_0000, u32::MAX - 1, u32::MAX];
    let bent = |bytes: &[u8], word: usize, value: u32| {
        let mut bent = bytes.to_vec();
        bent[word * 4..][..4].copy_from_slice(&u32::to_le_bytes(value));
        bent
    };
    let mut read = 0;
    for value in values {
        for word in 0..base_bytes.len() / 4 {
            if let Ok(mut hierarchy) = ClusterHierarchy::decode_base(&bent(&base_bytes, word, value), 2) {
                block_bytes.iter().for_each(|bytes| drop(hierarchy.decode_block(bytes)));
                assert_sound(&hierarchy);
                read += 1;
            }
        }
        for (before, bytes) in [&roots, &coarse].into_iter().zip(&block_bytes) {
            for word in 0..bytes.len() / 4 {
                let mut hierarchy = before.clone();
                if hierarchy.decode_block(&bent(bytes, word, value)).is_err() {
                    assert_eq!(&hierarchy, before, "a refused block changes nothing");
                } else {
                    read += 1;
                }
                let _ = hierarchy.decode_block(&block_bytes[1]);
                assert_sound(&hierarchy);
            }
        }
    }
    assert!(read > 100, "{read} were read");
}

/// Every accessor, and what the module's documentation says of them.
fn assert_sound(h: &ClusterHierarchy) {
    let clusters = || (0..h.cluster_count()).map(ClusterId);
    let mut members = 0;
    for group in (0..h.group_count()).map(GroupId) {
        assert!(h.needs(group).iter().all(|need| *need < group && h.below(*need).contains(&group)));
        assert!(h.needs(group).iter().all(|need| h.error_m(*need) >= h.error_m(group)));
        assert!(h.below(group).iter().all(|below| h.needs(*below).contains(&group)));
        assert_eq!(h.needs(group).is_empty(), h.first_groups().contains(&group));
        assert!(h.members(group).all(|member| h.group(member) == Some(group)));
        for result in h.results(group) {
            assert_eq!(h.maker(*result), Some(group));
            assert!(h.group(*result).is_none_or(|need| h.needs(group).contains(&need)));
        }
        members += h.members(group).len();
        let triangles = |cluster: ClusterId| h.triangles(cluster).len() as u32;
        let (more, less): (u32, u32) =
            (h.members(group).map(triangles).sum(), h.results(group).iter().copied().map(triangles).sum());
        assert_eq!(more, less + h.added_triangles(group));
        assert!(h.sphere(group).0.is_finite() && h.sphere(group).1.is_finite() && h.bounds(group).extent.half_box.is_finite());
        h.cone(group);
    }
    assert_eq!(h.roots().len() + members, clusters().count());
    let added: u32 = (0..h.group_count()).map(|g| h.added_triangles(GroupId(g))).sum();
    assert_eq!(h.root_triangles() + added, h.triangle_count());
    for cluster in clusters() {
        assert!(h.triangles(cluster).flatten().all(|vertex| h.position(vertex).is_finite()));
        assert!(h.materials().contains(&h.material(cluster)));
        assert!(h.cluster_bounds(cluster).center.is_finite() && h.memory_bytes() > 0);
    }
    assert!(h.local_aabb().min.is_finite());
}

#[test]
fn what_does_not_hold_is_refused() {
    let refused = |bend: &dyn Fn(&mut ClusterBase, &mut [ClusterBlock; 2])| {
        let (mut base, mut blocks) = parts();
        bend(&mut base, &mut blocks);
        joined(base, blocks).expect_err("it does not hold").to_string()
    };
    assert_eq!(refused(&|_, b| b[1].results[1] = ClusterId(5)), "group 2: a result is not there before it");
    assert_eq!(refused(&|_, b| b[1].results[1] = ClusterId(0)), "group 2: a result is of another group, or there twice");
    let greater = "group 1: its error is greater than that of a group that it needs";
    assert_eq!(refused(&|_, b| b[1].groups[0] = record(0.75, 1, 1)), greater);
    assert_eq!(refused(&|_, b| b[1].groups[0] = record(0.25, 0, 1)), "members: 2, expected are 1");
    assert_eq!(refused(&|_, b| b[1].groups[0] = record(0.25, 1, 0)), "results: 2, expected are 1");
    assert_eq!(refused(&|_, b| b[1].first = 2), "first group of the block: 2, expected are 1");
    assert_eq!(refused(&|base, _| base.triangle_total = 7), "triangles: 6, expected are 7");
    assert_eq!(refused(&|base, _| base.group_total = 4), "groups: 3, expected are 4");
    assert_eq!(refused(&|base, _| base.vertices.positions[1][0] = f32::NAN), "a coordinate is not finite");
    assert_eq!(refused(&|base, _| base.roots.vertices[2] = 6), "cluster 0: it names a vertex that is not there");
    assert_eq!(refused(&|base, _| base.roots.vertices[2] = 3), "cluster 0: it is of several materials");
    assert_eq!(refused(&|_, b| b[0].members.triangles[0] = [0, 1, 4]), "cluster 2: a corner is not there, or there twice");
    assert_eq!(refused(&|_, b| b[0].members.triangles[0] = [0, 1, 1]), "cluster 2: a corner is not there, or there twice");
    let fewer = "group 2: it has fewer triangles than its results";
    let swapped = |_: &mut ClusterBase, b: &mut [ClusterBlock; 2]| {
        b[1].members.sizes[1].triangles = 1;
        b[1].members.triangles.truncate(4);
    };
    assert_eq!(refused(&swapped), fewer);
}

#[test]
fn a_cluster_is_enclosed() {
    let h = whole();
    for cluster in (0..h.cluster_count()).map(ClusterId) {
        let bounds = h.cluster_bounds(cluster);
        let axis = bounds.extent.axis.direction();
        for corners in h.triangles(cluster).map(|t| t.map(|v| h.position(v))) {
            for way in corners.map(|p| p - bounds.center) {
                assert!(way.length() <= bounds.extent.radius && way.abs().cmple(bounds.extent.half_box).all());
                assert!((way - axis * way.dot(axis)).length() <= bounds.extent.cylinder_radius);
            }
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            let sine = (1.0 - axis.dot(normal).powi(2)).max(0.0).sqrt();
            assert!(bounds.cone_sine.is_none_or(|cone| axis.dot(normal) > 0.0 && sine <= cone + 1e-4));
        }
    }
}
