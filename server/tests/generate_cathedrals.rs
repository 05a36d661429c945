//! Goal: the generated cathedrals have the triangles that the paper counts, and hide each other from whoever stands inside
//! one. Method: count on the file that a user gets and on what preparation makes of it; draw what six views around eyes
//! in a nave see, and look for holes.
use glam::{DAffine3, DVec3, dvec3};
use mullion_server::generate::{GeneratedScene, glb, write_glb};
use mullion_server::prepare::gltf::{SourceScene, load};
use mullion_server::prepare::{PrepareOptions, prepare, statistics};

const EACH: usize = 416_763;

fn loaded(seed: u64) -> SourceScene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cathedrals.glb");
    let report = write_glb(GeneratedScene::Cathedrals, seed, &path).unwrap();
    println!("seed {seed}: {report:?}");
    assert_eq!(report.triangles, 3_334_104);
    assert!(report.bytes <= 10_000_000, "{report:?}");
    let scene = load(&path, &|_, _, _| {}).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_eq!(scene.nodes.len() as u64, report.nodes);
    scene
}

/// Calls `visit` for every node below `top` that has a mesh, with its place in the world.
fn visit(scene: &SourceScene, top: u32, visit: &mut dyn FnMut(u32, DAffine3)) {
    let mut open = vec![(top, DAffine3::IDENTITY)];
    while let Some((id, parent)) = open.pop() {
        let node = &scene.nodes[id as usize];
        let world = parent * node.parent_from_local;
        open.extend(node.children.iter().map(|child| (*child, world)));
        if let Some(mesh) = node.mesh {
            visit(mesh, world);
        }
    }
}

#[test]
fn eight_cathedrals_have_the_papers_triangles() {
    for seed in [0, 1, 20061213] {
        let scene = loaded(seed);
        assert_eq!(scene.roots.len(), 8);
        for root in &scene.roots {
            let (mut triangles, mut low, mut high) = (0, DVec3::INFINITY, DVec3::NEG_INFINITY);
            visit(&scene, *root, &mut |mesh, world| {
                assert!(world.matrix3.determinant() > 0.0, "what faces outwards in a mesh does so in the world");
                for primitive in &scene.meshes[mesh as usize].primitives {
                    triangles += primitive.indices.len() / 3;
                    for position in &primitive.positions {
                        assert!(position.is_finite());
                        let at = world.transform_point3(position.as_dvec3());
                        (low, high) = (low.min(at), high.max(at));
                    }
                }
            });
            assert_eq!(triangles, EACH);
            let size = high - low;
            assert!(size.cmpgt(dvec3(110.0, 80.0, 50.0)).all() && size.cmplt(dvec3(140.0, 100.0, 65.0)).all(), "{size}");
        }
    }
}

#[test]
fn cathedrals_stand_apart() {
    let scene = loaded(1);
    let boxes: Vec<(DVec3, DVec3)> = scene
        .roots
        .iter()
        .map(|root| {
            let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            visit(&scene, *root, &mut |mesh, world| {
                for position in scene.meshes[mesh as usize].primitives.iter().flat_map(|primitive| &primitive.positions) {
                    let at = world.transform_point3(position.as_dvec3());
                    bounds = (bounds.0.min(at), bounds.1.max(at));
                }
            });
            bounds
        })
        .collect();
    for (k, a) in boxes.iter().enumerate() {
        for b in &boxes[..k] {
            assert!((a.0.cmpgt(b.1) | b.0.cmpgt(a.1)).any(), "{a:?} meets {b:?}");
        }
    }
}

#[test]
fn they_prepare_without_trouble() {
    let prepared = prepare(loaded(1), &PrepareOptions::default(), &|_, _, _| {}).unwrap();
    assert!(prepared.warnings.is_empty(), "{:?}", prepared.warnings);
    let counts = statistics(&prepared.package);
    assert_eq!(counts.triangles_instanced, 8 * EACH as u64);
    assert!(counts.triangles_unique < 150_000, "meshes are shared: {}", counts.triangles_unique);
    assert!(counts.leaves > 8 * 300, "{}", counts.leaves);
}

#[test]
fn same_seed_same_bytes() {
    let (first, report) = glb(GeneratedScene::Cathedrals, 7);
    assert_eq!(first, glb(GeneratedScene::Cathedrals, 7).0);
    assert_ne!(first, glb(GeneratedScene::Cathedrals, 8).0);
    assert_eq!(report.bytes, first.len() as u64);
}

#[test]
fn the_gltf_crate_reads_them_too() {
    let (bytes, report) = glb(GeneratedScene::Cathedrals, 3);
    let (document, _, _) = gltf::import_slice(&bytes).unwrap();
    assert_eq!(document.nodes().len() as u64, report.nodes);
}

/// Pixels along a side of a view.
const SIDE: usize = 192;

/// What is drawn in a square view of 90° along −Z.
struct Coverage(Vec<bool>);

impl Coverage {
    /// A triangle in view space; back faces are drawn where `is_two_sided`.
    fn draw(&mut self, corners: [DVec3; 3], is_two_sided: bool) {
        let [a, b, c] = corners;
        let ahead = corners.iter().filter(|p| -p.z > NEAR).count();
        if ahead == 0 || (b - a).cross(c - a).dot(a) >= 0.0 && !is_two_sided {
            return;
        }
        let clipped = match ahead {
            3 => corners.to_vec(),
            _ => clip(&corners),
        };
        let flat: Vec<(f64, f64)> = clipped.iter().map(|p| (pixel(p.x / -p.z), pixel(p.y / -p.z))).collect();
        for k in 1..flat.len() - 1 {
            self.fill([flat[0], flat[k], flat[k + 1]]);
        }
    }

    /// Pixels whose middle is inside or on an edge.
    fn fill(&mut self, [a, b, c]: [(f64, f64); 3]) {
        let range = |values: [f64; 3]| {
            let (low, high) = (values[0].min(values[1]).min(values[2]), values[0].max(values[1]).max(values[2]));
            (low - 0.5).ceil().max(0.0) as usize..((high - 0.5).floor() + 1.0).clamp(0.0, SIDE as f64) as usize
        };
        let edge = |p: (f64, f64), q: (f64, f64), x: f64, y: f64| (q.0 - p.0) * (y - p.1) - (q.1 - p.1) * (x - p.0);
        let sign = edge(a, b, c.0, c.1).signum();
        for row in range([a.1, b.1, c.1]) {
            for column in range([a.0, b.0, c.0]) {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                if [(a, b), (b, c), (c, a)].iter().all(|(p, q)| edge(*p, *q, x, y) * sign >= 0.0) {
                    self.0[row * SIDE + column] = true;
                }
            }
        }
    }
}

const NEAR: f64 = 0.01;

fn pixel(tangent: f64) -> f64 {
    (tangent + 1.0) / 2.0 * SIDE as f64
}

/// The part of a polygon that is ahead of the eye.
fn clip(corners: &[DVec3]) -> Vec<DVec3> {
    let mut kept = Vec::new();
    for (k, from) in corners.iter().enumerate() {
        let to = corners[(k + 1) % corners.len()];
        if -from.z > NEAR {
            kept.push(*from);
        }
        if (-from.z > NEAR) != (-to.z > NEAR) {
            kept.push(from.lerp(to, (-NEAR - from.z) / (to.z - from.z)));
        }
    }
    kept
}

/// Holes as seen from `eye`, as directions.
fn holes(triangles: &[([DVec3; 3], bool)], eye: DVec3) -> Vec<DVec3> {
    let mut holes = Vec::new();
    let views = [(DVec3::X, DVec3::Y), (DVec3::Y, DVec3::Z), (DVec3::Z, DVec3::X)];
    for (ahead, up) in views.into_iter().flat_map(|(ahead, up)| [(ahead, up), (-ahead, up)]) {
        let right = ahead.cross(up);
        let mut view = Coverage(vec![false; SIDE * SIDE]);
        for (corners, is_two_sided) in triangles {
            let seen = corners.map(|p| dvec3((p - eye).dot(right), (p - eye).dot(up), -(p - eye).dot(ahead)));
            view.draw(seen, *is_two_sided);
        }
        for k in (0..SIDE * SIDE).filter(|k| !view.0[*k]) {
            let at = |k: usize| (k as f64 + 0.5) / SIDE as f64 * 2.0 - 1.0;
            holes.push((ahead + right * at(k % SIDE) + up * at(k / SIDE)).normalize());
        }
    }
    holes
}

/// Whoever is inside sees walls, vaults, floors and opaque glass whatever the direction: nothing of the other seven.
#[test]
fn nobody_inside_sees_out() {
    let scene = loaded(1);
    let mut triangles = Vec::new();
    let first = scene.nodes[scene.roots[0] as usize].parent_from_local.translation;
    visit(&scene, scene.roots[0], &mut |mesh, world| {
        for primitive in &scene.meshes[mesh as usize].primitives {
            let is_glass = scene.materials[primitive.material.unwrap() as usize].name.as_deref() == Some("glass");
            let at = |k: u32| world.transform_point3(primitive.positions[k as usize].as_dvec3()) - first;
            triangles.extend(primitive.indices.chunks_exact(3).map(|t| ([at(t[0]), at(t[1]), at(t[2])], is_glass)));
        }
    });
    assert_eq!(triangles.len(), EACH);
    for eye in
        [dvec3(20.1, 1.7, 0.2), dvec3(3.2, 15.3, -1.1), dvec3(-4.7, 1.7, 0.6), dvec3(55.4, 1.8, 0.9), dvec3(94.3, 1.7, 1.2)]
    {
        let holes = holes(&triangles, eye);
        assert!(holes.is_empty(), "from {eye}: {} holes, towards {:?}", holes.len(), &holes[..holes.len().min(12)]);
    }
}
