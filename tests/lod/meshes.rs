//! Meshes that take the whole way: a file's scene, a package with leaves of few triangles, its bytes, a hierarchy.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec2, Vec3};
use mullion_common::scene::{ClusterHierarchy, Hierarchy, LodForm, Package, VertexHierarchy};
use mullion_server::prepare::gltf::{SourceAlpha, SourceMaterial, SourceMesh, SourceNode, SourcePrimitive, SourceScene};
use mullion_server::prepare::lod::{LodOptions, add_hierarchies};
use mullion_server::prepare::plp::{TessellateOptions, tessellate};
use mullion_server::prepare::{PrepareOptions, prepare};

/// A mesh and its hierarchy.
pub struct Mesh {
    pub name: &'static str,
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    pub hierarchy: VertexHierarchy,
    pub clusters: ClusterHierarchy,
    /// The hierarchy's base and blocks.
    pub blobs: Vec<Vec<u8>>,
}

const PLAIN: SourceMaterial =
    SourceMaterial { name: None, base_color: [1.0; 4], texture: None, alpha: SourceAlpha::Opaque, double_sided: false };

type Raw = (Vec<Vec3>, Vec<[u32; 3]>);

fn primitive((positions, triangles): Raw, uvs: Option<Vec<Vec2>>, number: u32) -> SourcePrimitive {
    let indices = triangles.as_flattened().to_vec();
    SourcePrimitive { gltf_primitive: number, positions, normals: None, uvs, colors: None, indices, material: None }
}

/// Objects of a primitive each, or more, and where they stand.
fn package(objects: Vec<(Vec<SourcePrimitive>, DAffine3)>) -> Package {
    let node = |(mesh, (_, world_from_local)): (u32, &(Vec<SourcePrimitive>, DAffine3))| SourceNode {
        name: None,
        parent: None,
        children: Vec::new(),
        parent_from_local: *world_from_local,
        mesh: Some(mesh),
        instances: Vec::new(),
    };
    let nodes: Vec<SourceNode> = (0..).zip(&objects).map(node).collect();
    let mesh = |(gltf_mesh, (primitives, _))| SourceMesh { name: None, gltf_mesh, primitives };
    let scene = SourceScene {
        roots: (0..nodes.len() as u32).collect(),
        nodes,
        meshes: (0..).zip(objects).map(mesh).collect(),
        materials: vec![PLAIN; 2],
        images: Vec::new(),
        warnings: Vec::new(),
    };
    let options = PrepareOptions { max_leaf_triangles: 60, ..PrepareOptions::default() };
    prepare(scene, &options, &|_, _, _| {}).expect("it is a scene").package
}

fn simplify(package: &mut Package, form: LodForm) {
    let lod = LodOptions { least_triangles: 1, block_vertices: 150, form };
    add_hierarchies(package, &lod, &|_, _, _| {}).expect("it has a hierarchy");
}

/// Meshes that stand in places, with hierarchies of vertices and a tessellation.
pub fn scene(objects: &[(&Mesh, DVec3)]) -> Package {
    let of_mesh = |mesh: &Mesh| vec![primitive((mesh.positions.clone(), mesh.triangles.clone()), None, 0)];
    let mut package = package(objects.iter().map(|(mesh, at)| (of_mesh(mesh), DAffine3::from_translation(*at))).collect());
    simplify(&mut package, LodForm::Vertices);
    let tessellation = tessellate(&package, &TessellateOptions::default(), &|_, _, _| {}).expect("it has space");
    package.scene.tessellation = Some(Arc::new(tessellation));
    package
}

fn mesh(name: &'static str, primitives: Vec<SourcePrimitive>) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for primitive in &primitives {
        let first = positions.len() as u32;
        positions.extend_from_slice(&primitive.positions);
        triangles.extend(primitive.indices.chunks_exact(3).map(|t| [t[0] + first, t[1] + first, t[2] + first]));
    }
    let mut package = package(vec![(primitives, DAffine3::IDENTITY)]);
    let mut packed = |form| -> (Hierarchy, Vec<Vec<u8>>) {
        simplify(&mut package, form);
        let mut bytes = Vec::new();
        package.write_to(&mut bytes).expect("memory takes all bytes");
        let package = Package::read(&bytes).expect("it is one");
        let table = package.scene.hierarchies.of(form).expect("it has some");
        assert_eq!(table.entries().len(), 1);
        let hierarchy = table.decode(0, &package.scene.manifest).expect("it is one");
        (hierarchy, table.blobs(0).map(<[u8]>::to_vec).collect())
    };
    let (hierarchy, blobs) = packed(LodForm::Vertices);
    let hierarchy = hierarchy.into_vertices().expect("what was asked for");
    let clusters = packed(LodForm::Clusters).0.into_clusters().expect("what was asked for");
    Mesh { name, positions, triangles, hierarchy, clusters, blobs }
}

fn grid(columns: u32, rows: u32, [close_u, close_v]: [bool; 2], at: impl Fn(f32, f32) -> Vec3) -> Raw {
    let (width, height) = (columns + u32::from(!close_u), rows + u32::from(!close_v));
    let positions =
        (0..width * height).map(|k| at((k % width) as f32 / columns as f32, (k / width) as f32 / rows as f32)).collect();
    let vertex = |u: u32, v: u32| u % width + v % height * width;
    let triangles = (0..columns * rows)
        .flat_map(|k| {
            let (u, v) = (k % columns, k / columns);
            let [a, b, c, d] = [vertex(u, v), vertex(u + 1, v), vertex(u + 1, v + 1), vertex(u, v + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    (positions, triangles)
}

/// A cube's faces as grids, blown up; vertices at its edges are in one place and not one. Closed.
pub fn sphere(side: u32) -> Mesh {
    let axes = [
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::NEG_X, Vec3::Z, Vec3::Y),
        (Vec3::Y, Vec3::Z, Vec3::X),
        (Vec3::NEG_Y, Vec3::X, Vec3::Z),
        (Vec3::Z, Vec3::X, Vec3::Y),
        (Vec3::NEG_Z, Vec3::Y, Vec3::X),
    ];
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (front, right, up) in axes {
        let (face, face_triangles) = grid(side, side, [false; 2], |u, v| {
            // To the bit the same on both faces at an edge: whole steps.
            let step = |x: f32| (x * side as f32).round() * 2.0 / side as f32 - 1.0;
            let p = front + right * step(u) + up * step(v);
            let radius = 2.0 + 0.3 * p.x * p.y + 0.2 * p.z;
            p / p.length() * radius
        });
        let first = positions.len() as u32;
        positions.extend(face);
        triangles.extend(face_triangles.iter().map(|t| t.map(|v| v + first)));
    }
    mesh("sphere", vec![primitive((positions, triangles), None, 0)])
}

pub fn torus(around: u32, section: u32) -> Mesh {
    let raw = grid(around, section, [true; 2], |u, v| {
        let (sin_u, cos_u) = (u * std::f32::consts::TAU).sin_cos();
        let (sin_v, cos_v) = (v * std::f32::consts::TAU).sin_cos();
        let radius = 3.0 + cos_v * (1.0 + 0.2 * sin_u);
        Vec3::new(radius * cos_u, radius * sin_u, 1.3 * sin_v)
    });
    mesh("torus", vec![primitive(raw, None, 0)])
}

/// With a border.
pub fn hills(columns: u32, rows: u32) -> Mesh {
    let raw = grid(columns, rows, [false; 2], |u, v| {
        Vec3::new(u * 6.0 - 3.0, v * 4.0 - 2.0, 0.4 * (u * 11.0).sin() + 0.3 * (v * 9.0 + u * 3.0).cos())
    });
    mesh("hills", vec![primitive(raw, None, 0)])
}

/// Two primitives that meet along two lines, texture coordinates that start anew at one of them; open at both ends.
pub fn seamed_tube(around: u32, along: u32) -> Mesh {
    let half = |from: u32| {
        let at = |u: u32, v: f32| {
            let angle = (u % around) as f32 / around as f32 * std::f32::consts::TAU;
            Vec3::new(angle.cos() * (1.5 + 0.2 * (v * 9.0).sin()), angle.sin() * 1.5, v * 5.0 - 2.5)
        };
        let columns = around / 2;
        let raw = grid(columns, along, [false; 2], |u, v| at(from + (u * columns as f32).round() as u32, v));
        let uvs = raw.0.iter().map(|p| Vec2::new(p.x, p.z)).collect();
        primitive(raw, Some(uvs), from)
    };
    mesh("seamed tube", vec![half(0), half(around / 2)])
}

/// Of two materials, a half each, with texture coordinates that start anew once around: closed by position alone.
pub fn painted_torus(around: u32, section: u32) -> Mesh {
    let half = |number: u32| {
        let columns = around / 2;
        let unwrapped =
            |u: f32, v: f32| [(u * columns as f32).round() as u32 + number * columns, (v * section as f32).round() as u32];
        let at = |u: f32, v: f32| {
            let [u, v] = unwrapped(u, v);
            let (sin_u, cos_u) = ((u % around) as f32 / around as f32 * std::f32::consts::TAU).sin_cos();
            let (sin_v, cos_v) = ((v % section) as f32 / section as f32 * std::f32::consts::TAU).sin_cos();
            let radius = 3.0 + cos_v * (1.0 + 0.3 * sin_u);
            Vec3::new(radius * cos_u, radius * sin_u, 1.2 * sin_v)
        };
        let raw = grid(columns, section, [false; 2], at);
        let width = columns + 1;
        let uv = |k: u32| Vec2::new((k % width + number * columns) as f32 / around as f32, (k / width) as f32 / section as f32);
        let uvs = (0..raw.0.len() as u32).map(uv).collect();
        SourcePrimitive { material: Some(number), ..primitive(raw, Some(uvs), number) }
    };
    mesh("painted torus", vec![half(0), half(1)])
}

/// A flat square, so many cells a side.
pub const SHEET_CELLS: u32 = 48;
pub const SHEET_CELL_M: f32 = 0.12;
pub const SHEET_M: f32 = SHEET_CELLS as f32 * SHEET_CELL_M;

fn sheet() -> Raw {
    grid(SHEET_CELLS, SHEET_CELLS, [false; 2], |u, v| Vec3::new((u - 0.5) * SHEET_M, (v - 0.5) * SHEET_M, 0.0))
}

/// Black dots in white.
pub fn sheet_color(at: Vec2) -> [u8; 4] {
    let is_dark = at.length() < 1.0 || at.distance(Vec2::new(1.7, 1.5)) < 0.5;
    if is_dark { [0, 0, 0, 255] } else { [255; 4] }
}

pub fn sheet_of_colours() -> Mesh {
    let raw = sheet();
    let colors = raw.0.iter().map(|p| sheet_color(p.truncate())).collect();
    mesh("sheet of colours", vec![SourcePrimitive { colors: Some(colors), ..primitive(raw, None, 0) }])
}

/// Stretched here and there.
pub fn sheet_uv(at: Vec2) -> Vec2 {
    let bulge = (-(at * 1.5).length_squared()).exp() * 0.08;
    at / SHEET_M + Vec2::new(bulge, -bulge)
}

/// With a texture so many times as small along either side.
pub fn sheet_of_texture(times: Vec2) -> Mesh {
    let raw = sheet();
    let uvs = raw.0.iter().map(|p| sheet_uv(p.truncate()) * times).collect();
    mesh("sheet of texture", vec![primitive(raw, Some(uvs), 0)])
}
