//! What a surface is, asked the dull way: by places, edges and the triangles on either side of each.

use std::collections::{HashMap, HashSet};

use glam::Vec3;
use mullion_client::lod::VertexCut;
use mullion_common::scene::VertexHierarchy;

use super::meshes::Mesh;

type Place = [u32; 3];

fn place(p: Vec3) -> Place {
    (p + 0.0).to_array().map(f32::to_bits)
}

/// What stays when a mesh becomes coarser.
pub struct Surface {
    /// Vertices − edges + triangles.
    euler: i64,
    /// Borders, each a closed way.
    borders: usize,
    components: usize,
    on_border: HashSet<Place>,
    /// The mesh's normal at each place from whose tip all triangles around are seen from the front.
    normals: HashMap<Place, Vec3>,
    triangles: usize,
}

impl Surface {
    pub fn of_mesh(mesh: &Mesh) -> Self {
        let corners = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize]);
        let triangles: Vec<[Vec3; 3]> = mesh.triangles.iter().map(corners).collect();
        let mut normals: HashMap<Place, Vec3> = HashMap::new();
        for t in &triangles {
            t.iter().for_each(|p| *normals.entry(place(*p)).or_default() += normal(t));
        }
        for t in &triangles {
            for p in t {
                let sum = normals[&place(*p)];
                if sum.dot(normal(t)) <= 0.0 {
                    normals.insert(place(*p), Vec3::ZERO);
                }
            }
        }
        let mut surface = Self::measured(&triangles, mesh.name);
        surface.normals = normals;
        surface
    }

    /// Holds triangles against the mesh: edges are closed but for those along its borders, and no triangle is there twice.
    pub fn assert_is_whole(&self, triangles: &[[Vec3; 3]], what: &str) {
        let next = sides(triangles, what);
        for (a, b) in next.keys().filter(|(a, b)| !next.contains_key(&(*b, *a))) {
            assert!(self.on_border.contains(a) && self.on_border.contains(b), "{what}: a crack");
        }
        let mut seen = HashSet::new();
        for t in triangles {
            let mut corners = t.map(place);
            corners.sort_unstable();
            assert!(seen.insert(corners), "{what}: a triangle is there twice");
            assert!(normal(t) != Vec3::ZERO, "{what}: a triangle without area");
        }
    }

    /// Counts, having found that the triangles are a surface: at most one triangle on either side of an edge, one fan around each vertex.
    fn measured(triangles: &[[Vec3; 3]], what: &str) -> Self {
        let next = sides(triangles, what);
        let mut around: HashMap<Place, Vec<(Place, Place)>> = HashMap::new();
        for t in triangles {
            let [a, b, c] = t.map(place);
            for (a, b, c) in [(a, b, c), (b, c, a), (c, a, b)] {
                around.entry(a).or_default().push((b, c));
            }
        }
        let mut border: HashMap<Place, Place> = HashMap::new();
        for (a, b) in next.keys().filter(|(a, b)| !next.contains_key(&(*b, *a))) {
            assert!(border.insert(*b, *a).is_none(), "{what}: two borders meet in a vertex");
        }
        for edges in around.values() {
            // One fan: from where it starts, or from anywhere on a ring, a walk comes by all.
            let ends: HashMap<Place, Place> = edges.iter().copied().collect();
            let start = edges.iter().find(|(a, _)| !edges.iter().any(|(_, b)| a == b)).unwrap_or(&edges[0]).0;
            let (mut at, mut steps) = (start, 0);
            while let Some(to) = ends.get(&at) {
                at = *to;
                steps += 1;
                if at == start {
                    break;
                }
            }
            assert_eq!(steps, edges.len(), "{what}: several fans at a vertex");
        }
        let edges = next.keys().filter(|(a, b)| a < b || !next.contains_key(&(*b, *a))).count();
        let (borders, components) = (count_ways(&border), count_components(&around));
        Self {
            euler: around.len() as i64 - edges as i64 + triangles.len() as i64,
            borders,
            components,
            on_border: border.keys().copied().collect(),
            normals: HashMap::new(),
            triangles: triangles.len(),
        }
    }

    /// Holds a cut against the mesh: a surface of the same kind, of triangles that face as the mesh does.
    pub fn assert_is_coarser(&self, hierarchy: &VertexHierarchy, cut: &VertexCut, what: &str) {
        let triangles: Vec<[Vec3; 3]> = cut.triangles(hierarchy).map(|t| t.map(|v| hierarchy.position(v))).collect();
        assert_eq!(triangles.len(), cut.triangle_count() as usize, "{what}");
        assert!(triangles.len() <= self.triangles, "{what}");
        let found = Self::measured(&triangles, what);
        assert_eq!((found.euler, found.borders, found.components), (self.euler, self.borders, self.components), "{what}");
        assert!(found.on_border.is_subset(&self.on_border), "{what}: a border where the mesh has none");
        for t in &triangles {
            let normal = normal(t);
            let longest = t[0].distance_squared(t[1]).max(t[1].distance_squared(t[2])).max(t[2].distance_squared(t[0]));
            assert!(normal.length() > 1e-3 * longest, "{what}: a triangle without area: {t:?}");
            for p in t {
                let expected = self.normals[&place(*p)];
                assert!(expected == Vec3::ZERO || expected.dot(normal) > 0.0, "{what}: an inverted triangle: {t:?}");
            }
        }
    }
}

/// For each side of an edge that has a triangle its third corner: one at most.
fn sides(triangles: &[[Vec3; 3]], what: &str) -> HashMap<(Place, Place), Place> {
    let mut next = HashMap::new();
    for t in triangles {
        let [a, b, c] = t.map(place);
        assert!(a != b && b != c && c != a, "{what}: a triangle without area");
        for (a, b, c) in [(a, b, c), (b, c, a), (c, a, b)] {
            assert!(next.insert((a, b), c).is_none(), "{what}: two triangles on one side of an edge");
        }
    }
    next
}

fn normal(t: &[Vec3; 3]) -> Vec3 {
    (t[1] - t[0]).cross(t[2] - t[0])
}

fn count_ways(border: &HashMap<Place, Place>) -> usize {
    let mut seen = HashSet::new();
    let mut ways = 0;
    for start in border.keys() {
        let mut at = *start;
        ways += usize::from(!seen.contains(&at));
        while seen.insert(at) {
            at = border[&at];
        }
    }
    ways
}

fn count_components(around: &HashMap<Place, Vec<(Place, Place)>>) -> usize {
    let mut seen = HashSet::new();
    let mut components = 0;
    for start in around.keys() {
        components += usize::from(!seen.contains(start));
        let mut open = vec![*start];
        while let Some(at) = open.pop() {
            if seen.insert(at) {
                open.extend(around[&at].iter().flat_map(|(a, b)| [*a, *b]));
            }
        }
    }
    components
}
