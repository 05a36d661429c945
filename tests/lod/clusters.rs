//! Goal: whatever closed set of groups is refined, what is drawn has no cracks. Method: thousands of cuts by random groups with what they
//! need, each held against a dull test of edges; and every group against everything finer, by brute force.

use std::collections::BTreeSet;

use glam::Vec3;
use mullion_client::lod::ClusterCut;
use mullion_common::scene::{ClusterHierarchy, ClusterId, GroupId};
use mullion_server::generate::Random;

use super::meshes::{self, Mesh};
use super::surface::Surface;

fn all() -> [Mesh; 5] {
    let [sphere, torus, painted] = [meshes::sphere(22), meshes::torus(90, 60), meshes::painted_torus(80, 60)];
    [sphere, torus, painted, meshes::hills(90, 60), meshes::seamed_tube(60, 70)]
}

fn groups(hierarchy: &ClusterHierarchy) -> impl Iterator<Item = GroupId> + use<> {
    (0..hierarchy.group_count()).map(GroupId)
}

/// A group, and all that it needs.
fn refine(hierarchy: &ClusterHierarchy, set: &mut BTreeSet<GroupId>, group: GroupId) {
    if set.insert(group) {
        hierarchy.needs(group).iter().for_each(|need| refine(hierarchy, set, *need));
    }
}

/// A group no more, and none that needs it.
fn coarsen(hierarchy: &ClusterHierarchy, set: &mut BTreeSet<GroupId>, group: GroupId) {
    if set.remove(&group) {
        hierarchy.below(group).iter().for_each(|below| coarsen(hierarchy, set, *below));
    }
}

fn triangles(hierarchy: &ClusterHierarchy, clusters: &[ClusterId]) -> Vec<[Vec3; 3]> {
    clusters.iter().flat_map(|c| hierarchy.triangles(*c)).map(|t| t.map(|v| hierarchy.position(v))).collect()
}

/// Holds a cut of a set against what it must draw, and that against the mesh.
fn assert_follows(mesh: &Mesh, whole: &Surface, cut: &ClusterCut, set: &BTreeSet<GroupId>, what: &str) {
    let h = &mesh.clusters;
    let is_drawn = |cluster: &ClusterId| {
        h.group(*cluster).is_none_or(|group| set.contains(&group)) && !h.maker(*cluster).is_some_and(|maker| set.contains(&maker))
    };
    assert!(cut.clusters().iter().copied().eq((0..h.cluster_count()).map(ClusterId).filter(is_drawn)), "{what}");
    assert_eq!(cut.groups().len(), set.len(), "{what}");
    let triangles = triangles(h, cut.clusters());
    assert_eq!(triangles.len(), cut.triangle_count() as usize, "{what}");
    whole.assert_is_whole(&triangles, what);
}

#[test]
fn any_closed_set_has_no_cracks() {
    const CUTS: usize = 400;
    for mesh in all() {
        let h = &mesh.clusters;
        assert!(h.group_count() >= 8, "{}: {} groups", mesh.name, h.group_count());
        let whole = Surface::of_mesh(&mesh);
        let mut random = Random::new(12);
        let (mut set, mut cut) = (BTreeSet::new(), ClusterCut::new(h));
        assert_follows(&mesh, &whole, &cut, &set, mesh.name);
        let (mut fewest, mut most) = (u32::MAX, 0);
        for number in 0..CUTS {
            for _ in 0..1 + random.below(3) {
                let group = GroupId(random.below(h.group_count() as usize) as u32);
                let change = if random.chance(if number / 40 % 2 == 0 { 0.7 } else { 0.3 }) { refine } else { coarsen };
                change(h, &mut set, group);
            }
            let groups: Vec<GroupId> = set.iter().copied().collect();
            cut.follow(h, groups.iter().copied(), |group| set.contains(&group));
            assert_follows(&mesh, &whole, &cut, &set, &format!("{}, cut {number}", mesh.name));
            (fewest, most) = (fewest.min(cut.triangle_count()), most.max(cut.triangle_count()));
        }
        assert!(fewest * 3 < most, "{}: {fewest} to {most} triangles", mesh.name);
        let everything: Vec<GroupId> = groups(h).collect();
        cut.follow(h, everything.iter().copied(), |_| true);
        assert_eq!((cut.triangle_count() as usize, h.triangle_total() as usize), (mesh.triangles.len(), mesh.triangles.len()));
        cut.reset(h);
        assert_follows(&mesh, &whole, &cut, &BTreeSet::new(), mesh.name);
    }
}

/// The groups that made a group's members, those that made theirs, and so on; itself first.
fn finer(hierarchy: &ClusterHierarchy, group: GroupId) -> BTreeSet<GroupId> {
    let mut seen = BTreeSet::new();
    let mut open = vec![group];
    while let Some(group) = open.pop() {
        if seen.insert(group) {
            open.extend(hierarchy.members(group).filter_map(|member| hierarchy.maker(member)));
        }
    }
    seen
}

#[test]
fn groups_enclose_everything_finer() {
    let (mut cones, mut count) = (0, 0);
    for mesh in all() {
        let h = &mesh.clusters;
        for group in groups(h) {
            let what = format!("{} {group:?}", mesh.name);
            let (bounds, (center, radius)) = (h.bounds(group), h.sphere(group));
            let finer = finer(h, group);
            for below in &finer {
                assert!(h.error_m(*below) <= h.error_m(group), "{what}: error");
                let (other, other_radius) = h.sphere(*below);
                let reach = other.as_dvec3().distance(center.as_dvec3()) + f64::from(other_radius);
                assert!(*below == group || reach <= f64::from(radius), "{what}: sphere");
            }
            let members: Vec<ClusterId> = finer.iter().flat_map(|below| h.members(*below)).collect();
            for corners in triangles(h, &members) {
                for corner in corners {
                    assert!(corner.distance(center) <= radius, "{what}: sphere");
                    assert!((corner - center).abs().cmple(bounds.extent.half_box).all(), "{what}: box");
                }
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
                let is_within = |(axis, cone): (Vec3, f32)| {
                    axis.dot(normal) > 0.0 && (1.0 - axis.dot(normal).powi(2)).max(0.0).sqrt() <= cone + 1e-4
                };
                assert!(h.cone(group).is_none_or(is_within), "{what}: cone");
            }
            cones += u32::from(h.cone(group).is_some());
        }
        count += h.group_count();
    }
    assert!(cones * 8 > count, "{cones} of {count} groups have a cone");
}

/// Cuts take no memory once buffers have grown.
#[test]
fn following_takes_no_memory() {
    let mesh = meshes::torus(90, 60);
    let h = &mesh.clusters;
    let sets: Vec<Vec<GroupId>> = (0..4).map(|k| (0..h.group_count() * k / 3).map(GroupId).collect()).collect();
    let mut cut = ClusterCut::new(h);
    let mut follow = |number: usize| {
        let set = &sets[number % sets.len()];
        // Groups of lower numbers alone are needed: all below a number are closed.
        cut.follow(h, set.iter().copied(), |group| group.index() < set.len());
    };
    (0..8).for_each(&mut follow);
    let counted = allocation_counter::measure(|| (0..8).for_each(&mut follow));
    assert_eq!(counted.count_total, 0);
}
