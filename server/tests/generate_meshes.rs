//! Goal: the large meshes have the counts of the paper's, and are what simplification wants to be tried on: closed, or with one border; facing
//! outwards. Method: small planets are looked at edge by edge, the others as our importer reads them.
use std::collections::HashMap;

use glam::{DVec3, Vec3};
use mullion_server::generate::{GeneratedScene, MAX_PLANET_VERTICES, Planet, glb, write_glb};
use mullion_server::prepare::gltf::load;

fn loaded(scene: GeneratedScene, seed: u64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.glb");
    let report = write_glb(scene, seed, &path).unwrap();
    assert_eq!(report.bytes, path.metadata().unwrap().len());
    let mut file = load(&path, &|_, _, _| {}).unwrap();
    assert!(file.warnings.is_empty(), "{:?}", file.warnings);
    assert_eq!((file.nodes.len(), file.meshes.len(), file.meshes[0].primitives.len()), (1, 1, 1));
    let primitive = file.meshes.remove(0).primitives.remove(0);
    let triangles: Vec<[u32; 3]> = primitive.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    assert_eq!(report.triangles, triangles.len() as u64);
    (primitive.positions, triangles)
}

/// How many edges have a triangle on one side only; none has two on one side.
fn border_edges(triangles: &[[u32; 3]]) -> usize {
    let mut sides: HashMap<(u32, u32), u32> = HashMap::new();
    for [a, b, c] in triangles {
        for edge in [(*a, *b), (*b, *c), (*c, *a)] {
            *sides.entry(edge).or_default() += 1;
        }
    }
    assert!(sides.values().all(|count| *count == 1), "two triangles on one side of an edge");
    sides.keys().filter(|(a, b)| !sides.contains_key(&(*b, *a))).count()
}

fn volume(positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    let corner = |v: u32| positions[v as usize].as_dvec3();
    let tetrahedron = |[a, b, c]: &[u32; 3]| corner(*a).dot(corner(*b).cross(corner(*c))) / 6.0;
    triangles.iter().map(tetrahedron).sum()
}

#[test]
fn planets_are_closed_and_as_large_as_asked_for() {
    assert_eq!((Planet::DEFAULT.vertices(), 2 * (Planet::DEFAULT.vertices() - 2)), (16_777_218, 33_554_432));
    for (asked, vertices) in [(6, 6), (7, 6), (18, 18), (1000, 1026), (40_000, 40_002)] {
        let planet = Planet::new(asked).unwrap();
        assert_eq!(planet.vertices(), vertices);
        let (positions, triangles) = loaded(GeneratedScene::Planet(planet), 1);
        assert_eq!((positions.len() as u32, triangles.len() as u32), (vertices, 2 * vertices - 4));
        assert_eq!(border_edges(&triangles), 0);
        assert!(positions.iter().all(|p| (60.0..140.0).contains(&p.length())), "{asked}");
        // A triangle's front is away from the middle, mountains or not.
        let is_outward = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| positions[v as usize].as_dvec3());
            (b - a).cross(c - a).dot(a + b + c) > 0.0
        };
        assert!(triangles.iter().all(is_outward), "{asked}");
    }
    for refused in [0, 5, u64::from(MAX_PLANET_VERTICES) + 1] {
        assert!(Planet::new(refused).is_err());
    }
    assert_eq!("planet:1000".parse::<GeneratedScene>().unwrap(), GeneratedScene::Planet(Planet::new(1000).unwrap()));
    assert!("planet:many".parse::<GeneratedScene>().is_err());
}

#[test]
fn a_planet_is_rough() {
    let (positions, triangles) = loaded(GeneratedScene::Planet(Planet::new(40_000).unwrap()), 1);
    let tilt = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| positions[v as usize].as_dvec3());
        (b - a).cross(c - a).normalize().dot((a + b + c).normalize())
    };
    let steep = triangles.iter().filter(|t| tilt(t) < 0.9).count();
    assert!(steep * 4 > triangles.len(), "{steep} of {} triangles are steeper than 26°", triangles.len());
}

#[test]
fn the_creature_is_as_large_as_the_armadillo_and_hides_itself() {
    let (positions, triangles) = loaded(GeneratedScene::Organic, 1);
    assert_eq!((positions.len(), triangles.len()), (172_974, 345_944));
    assert_eq!(border_edges(&triangles), 0);
    assert!(volume(&positions, &triangles) > 0.5);
    // From the front, many triangles lie behind others on the same line: more fronts than a convex body has on any.
    let mut fronts: HashMap<(i32, i32), u32> = HashMap::new();
    for t in &triangles {
        let [a, b, c] = t.map(|v| positions[v as usize].as_dvec3());
        if (b - a).cross(c - a).dot(DVec3::Z) > 0.0 && (a.max(b).max(c) - a.min(b).min(c)).max_element() < 0.05 {
            *fronts.entry(((a.x * 8.0).floor() as i32, (a.y * 8.0).floor() as i32)).or_default() |=
                1 << ((a.z * 2.5) as i32 + 12);
        }
    }
    let hidden = fronts.values().filter(|depths| (*depths & (*depths >> 1)).count_ones() + depths.count_ones() > 2).count();
    assert!(hidden * 8 > fronts.len(), "{hidden} of {} places have several fronts", fronts.len());
}

#[test]
fn hills_have_one_border() {
    let (positions, triangles) = loaded(GeneratedScene::Hills, 1);
    assert_eq!((positions.len(), triangles.len()), (513 * 513, 524_288));
    assert_eq!(border_edges(&triangles), 4 * 512);
    let is_upward = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        (b - a).cross(c - a).y > 0.0
    };
    assert!(triangles.iter().all(is_upward));
    let heights = positions.iter().map(|p| p.y);
    let relief = heights.clone().fold(f32::MIN, f32::max) - heights.fold(f32::MAX, f32::min);
    assert!(relief > 60.0, "{relief} m");
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    for scene in [GeneratedScene::Planet(Planet::new(2000).unwrap()), GeneratedScene::Hills, GeneratedScene::Organic] {
        assert_eq!(glb(scene, 3).0, glb(scene, 3).0);
        assert_ne!(glb(scene, 3).0, glb(scene, 4).0);
    }
}
