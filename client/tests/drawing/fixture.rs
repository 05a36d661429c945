//! Small scenes built by hand, and a rig that draws them.

use std::io::Cursor;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use image::RgbaImage;
use mullion_client::frame::{FrameInput, FramePlan, Planner, ViewInput};
use mullion_client::gpu::{Attachments, Gpu, GpuOptions, Renderer, ViewTarget};
use mullion_client::missing::WhenMissing;
use mullion_common::geometry::{Aabb, Containment, Frustum, Obb};
use mullion_common::scene::{
    AlphaMode, ChunkHash, ChunkId, ChunkKind, ChunkRecord, Filter, GeometryChunk, LeafRecord, Material, MaterialId, ObjectId,
    SceneManifest, TextureRef, Wrap,
};
use mullion_common::visible_set::{LeafRange, VisibleSet};
use mullion_common::wall::{Projection, ViewId};

/// The GPU, or `None` and a line that says so.
pub fn gpu() -> Option<Arc<Gpu>> {
    match Gpu::open(GpuOptions::default()) {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            println!("skipped: {error}");
            None
        }
    }
}

/// Numbers that look random and are the same each time.
pub struct Numbers(pub u64);

impl Numbers {
    pub fn next(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as u32
    }

    /// In `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.next()) / f64::from(1u32 << 31)
    }

    pub fn vector(&mut self, low: f64, high: f64) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| self.between(low, high)))
    }
}

/// A manifest with the bytes of its chunks.
#[derive(Default)]
pub struct Scene {
    pub manifest: SceneManifest,
    pub chunks: Vec<Vec<u8>>,
}

impl Scene {
    fn chunk(&mut self, kind: ChunkKind, bytes: Vec<u8>) -> ChunkId {
        self.manifest.chunks.push(ChunkRecord::new(ChunkHash::of(&bytes), 0, bytes.len() as u32, kind));
        self.chunks.push(bytes);
        ChunkId(self.chunks.len() as u32 - 1)
    }

    /// Moves every mesh in its object's space, and every object back by as much: all stands where it stood.
    pub fn push_meshes_away(&mut self, by: DVec3) {
        let far = by.as_vec3();
        for (bytes, record) in self.chunks.iter_mut().zip(&mut self.manifest.chunks) {
            if record.kind() != Some(ChunkKind::Geometry) {
                continue;
            }
            let mut chunk = GeometryChunk::decode(bytes).expect("a chunk made here");
            chunk.positions.iter_mut().for_each(|position| *position = (glam::Vec3::from(*position) + far).to_array());
            *bytes = chunk.encode();
            *record = ChunkRecord::new(ChunkHash::of(bytes), 0, bytes.len() as u32, ChunkKind::Geometry);
        }
        for transform in &mut self.manifest.transforms {
            *transform = (transform.affine() * DAffine3::from_translation(-by)).into();
        }
        for leaf in &mut self.manifest.leaves {
            let geometry = GeometryChunk::decode(&self.chunks[leaf.chunk.0 as usize]).expect("a chunk made here");
            let bounds = Aabb::of_points(geometry.positions.iter().map(|p| glam::Vec3::from(*p).as_dvec3()));
            (leaf.local_min, leaf.local_max) = (bounds.min.as_vec3().to_array(), bounds.max.as_vec3().to_array());
        }
    }

    pub fn mesh(&mut self, chunk: &GeometryChunk) -> ChunkId {
        self.chunk(ChunkKind::Geometry, chunk.encode())
    }

    pub fn texture(&mut self, bytes: Vec<u8>) -> TextureRef {
        let chunk = self.chunk(ChunkKind::Texture, bytes);
        TextureRef { chunk, wrap_u: Wrap::Repeat, wrap_v: Wrap::Mirror, filter: Filter::Linear }
    }

    pub fn material(&mut self, material: Material) -> MaterialId {
        self.manifest.materials.push(material);
        MaterialId(self.manifest.materials.len() as u32 - 1)
    }

    pub fn object(&mut self, world_from_local: DAffine3) -> ObjectId {
        self.manifest.transforms.push(world_from_local.into());
        ObjectId(self.manifest.transforms.len() as u32 - 1)
    }

    pub fn leaf(&mut self, object: ObjectId, chunk: ChunkId, material: MaterialId) -> u32 {
        let geometry = GeometryChunk::decode(&self.chunks[chunk.0 as usize]).expect("a chunk made here");
        let bound = |start: f32, pick: fn(f32, f32) -> f32| {
            geometry.positions.iter().fold([start; 3], |b, p| std::array::from_fn(|i| pick(b[i], p[i])))
        };
        self.manifest.leaves.push(LeafRecord {
            object,
            chunk,
            material,
            triangle_count: geometry.indices.len() as u32 / 3,
            local_min: bound(f32::INFINITY, f32::min),
            local_max: bound(f32::NEG_INFINITY, f32::max),
        });
        self.manifest.leaves.len() as u32 - 1
    }

    /// Takes all that another scene has.
    pub fn join(&mut self, other: &Self) {
        let numbers =
            [self.manifest.transforms.len(), self.chunks.len(), self.manifest.materials.len()].map(|count| count as u32);
        let [objects, chunks, materials] = numbers;
        self.manifest.transforms.extend_from_slice(&other.manifest.transforms);
        self.manifest.chunks.extend_from_slice(&other.manifest.chunks);
        self.chunks.extend(other.chunks.iter().cloned());
        self.manifest.materials.extend(other.manifest.materials.iter().cloned());
        self.manifest.leaves.extend(other.manifest.leaves.iter().map(|leaf| LeafRecord {
            object: ObjectId(leaf.object.0 + objects),
            chunk: ChunkId(leaf.chunk.0 + chunks),
            material: MaterialId(leaf.material.0 + materials),
            ..*leaf
        }));
    }

    pub fn all(&self) -> VisibleSet {
        VisibleSet::all(self.manifest.leaves.len() as u32)
    }

    /// Leaves whose boxes are not outside the frustum.
    pub fn visible(&self, frustum: &Frustum) -> VisibleSet {
        let seen = |leaf: &&LeafRecord| {
            let world_from_local = self.manifest.transforms[leaf.object.0 as usize].affine();
            let world = leaf.local_aabb().transformed(&world_from_local);
            frustum.classify(&Obb::from(world)) != Containment::Outside
        };
        let leaves = self.manifest.leaves.iter();
        let numbers = leaves.enumerate().filter(|(_, leaf)| seen(leaf)).map(|(i, _)| i as u32);
        VisibleSet::from_ranges(numbers.map(|i| LeafRange::new(i, i + 1)))
    }
}

pub fn plain(base_color: [f32; 4]) -> Material {
    Material { base_color, texture: None, alpha: AlphaMode::Opaque, double_sided: false }
}

pub fn png(image: &RgbaImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    image.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).expect("memory takes everything");
    bytes
}

/// An image without any symmetry.
pub fn pattern(size: u32) -> Vec<u8> {
    png(&RgbaImage::from_fn(size, size, |x, y| {
        let cell = (x * 8 / size) * 3 + (y * 8 / size) * 5;
        image::Rgba([
            (cell * 29 % 256) as u8,
            (cell * 53 % 200) as u8,
            (x * 255 / size) as u8,
            if cell.is_multiple_of(3) { 40 } else { 255 },
        ])
    }))
}

/// A rectangle in the plane z = 0, from `min` to `max`, facing +Z, with texture coordinates.
pub fn rectangle(min: [f32; 2], max: [f32; 2]) -> GeometryChunk {
    GeometryChunk {
        positions: vec![[min[0], min[1], 0.0], [max[0], min[1], 0.0], [max[0], max[1], 0.0], [min[0], max[1], 0.0]],
        vertex_ids: vec![0, 1, 2, 3],
        uvs: vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        indices: vec![0, 1, 2, 0, 2, 3],
        ..Default::default()
    }
}

/// A band of 40 triangles from one corner of a square of so many metres to the other, seen from both sides if its material is.
pub fn diagonal_band(edge_m: f32) -> GeometryChunk {
    let at = |k: u16| {
        let along = edge_m * f32::from(k / 2) / 20.0;
        let aside = if k.is_multiple_of(2) { 0.1 } else { -0.1 };
        [along + aside, edge_m - along + aside, 0.0]
    };
    GeometryChunk {
        positions: (0..42).map(at).collect(),
        vertex_ids: (0..42).collect(),
        indices: (0..40).flat_map(|k| [k, k + 1, k + 2]).collect(),
        ..Default::default()
    }
}

/// A box of 1 by 2 by 3, one corner at the origin, with texture coordinates and a colour for each face.
pub fn asymmetric_box() -> GeometryChunk {
    let size = [1.0, 2.0, 3.0];
    let mut chunk = GeometryChunk::default();
    for face in 0..6u8 {
        let (axis, far) = (usize::from(face / 2), face % 2 == 1);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let first = chunk.positions.len() as u16;
        for [s, t] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            let mut position = [0.0; 3];
            (position[axis], position[u], position[v]) = (if far { size[axis] } else { 0.0 }, s * size[u], t * size[v]);
            chunk.positions.push(position);
            chunk.vertex_ids.push(chunk.positions.len() as u32);
            chunk.uvs.push([s * 1.5, t * 2.5]);
            chunk.colors.push([255 - face * 20, 155 + face * 20, 255, 255]);
        }
        let quad = if far { [0, 1, 2, 0, 2, 3] } else { [0, 2, 1, 0, 3, 2] };
        chunk.indices.extend(quad.map(|i| first + i));
    }
    chunk
}

/// Boxes of all kinds of material, many mirrored, all around the origin.
pub fn clutter(count: u32) -> Scene {
    let mut numbers = Numbers(7);
    let mut scene = Scene::default();
    let mesh = scene.mesh(&asymmetric_box());
    let texture = scene.texture(pattern(64));
    let looks = [
        plain([0.8, 0.4, 0.2, 1.0]),
        Material { texture: Some(texture), ..plain([1.0; 4]) },
        Material { texture: Some(texture), alpha: AlphaMode::Mask { cutoff: 0.5 }, double_sided: true, ..plain([1.0; 4]) },
        Material { alpha: AlphaMode::Blend, ..plain([0.2, 0.5, 1.0, 0.4]) },
        Material { double_sided: true, ..plain([0.3, 0.7, 0.3, 1.0]) },
    ];
    let materials = looks.map(|look| scene.material(look));
    for i in 0..count {
        let mirror = if numbers.next().is_multiple_of(3) { -1.0 } else { 1.0 };
        let scale = numbers.vector(0.3, 1.2) * DVec3::new(mirror, 1.0, 1.0);
        let turn = DQuat::from_scaled_axis(numbers.vector(-2.0, 2.0));
        let object = scene.object(DAffine3::from_scale_rotation_translation(scale, turn, numbers.vector(-12.0, 12.0)));
        scene.leaf(object, mesh, materials[i as usize % materials.len()]);
    }
    scene
}

/// Faces given twice: each sheet coincides with another object's, of another size, turned in its plane and elsewhere in
/// its own space, as parts of real models do.
pub fn coinciding_sheets(count: u32) -> Scene {
    let mut scene = Scene::default();
    let mut numbers = Numbers(5);
    let one = scene.mesh(&rectangle([-2.0, -1.0], [2.0, 3.0]));
    let other = scene.mesh(&rectangle([37.0, -52.0], [42.0, -48.0]));
    for _ in 0..count {
        let turn = DQuat::from_scaled_axis(numbers.vector(-2.5, 2.5));
        let place = DAffine3::from_rotation_translation(turn, numbers.vector(-12.0, 12.0));
        let within = DAffine3::from_translation(DVec3::new(-40.0, 50.0, 0.0));
        let turned = DAffine3::from_rotation_z(numbers.between(0.0, 6.0));
        for (mesh, transform) in [(one, place), (other, place * turned * within)] {
            let shade = |numbers: &mut Numbers| numbers.between(0.1, 1.0) as f32;
            let base_color = [shade(&mut numbers), shade(&mut numbers), shade(&mut numbers), 1.0];
            let material = scene.material(Material { double_sided: true, ..plain(base_color) });
            let object = scene.object(transform);
            scene.leaf(object, mesh, material);
        }
    }
    scene
}

/// A screen and the eye that looks through it.
#[derive(Clone, Copy)]
pub struct Look {
    pub eye: DVec3,
    pub corners: [DVec3; 3],
    pub size_px: [u32; 2],
}

pub const NEAR_M: f64 = 0.05;

impl Look {
    /// From `eye` straight along −Z, 90° across.
    pub fn ahead(eye: DVec3, size_px: [u32; 2]) -> Self {
        let aspect = f64::from(size_px[1]) / f64::from(size_px[0]);
        let corner = |x: f64, y: f64| eye + DVec3::new(x, y * aspect, -1.0);
        Self { eye, corners: [corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)], size_px }
    }

    pub fn projection(&self) -> Projection {
        Projection::through_rectangle(self.eye, self.corners, NEAR_M, &DAffine3::IDENTITY)
    }

    pub fn frustum(&self) -> Frustum {
        Frustum::through_rectangle(self.eye, self.corners, NEAR_M)
    }

    /// The tiles of a grid without bezels, row by row from the top left.
    pub fn tiles(&self, [columns, rows]: [u32; 2]) -> Vec<Self> {
        let [bottom_left, bottom_right, top_left] = self.corners;
        let (across, up) = (bottom_right - bottom_left, top_left - bottom_left);
        let at =
            |x: u32, y: u32| bottom_left + across * (f64::from(x) / f64::from(columns)) + up * (f64::from(y) / f64::from(rows));
        let tile = |column, row| Self {
            corners: [at(column, row), at(column + 1, row), at(column, row + 1)],
            size_px: [self.size_px[0] / columns, self.size_px[1] / rows],
            ..*self
        };
        (0..rows).rev().flat_map(|row| (0..columns).map(move |column| (column, row))).map(|(c, r)| tile(c, r)).collect()
    }
}

/// What was drawn.
pub struct Picture {
    pub color: RgbaImage,
    pub ids: Vec<u32>,
    pub plan: FramePlan,
}

impl Picture {
    pub fn rgb(&self, x: u32, y: u32) -> [u8; 3] {
        let [r, g, b, _] = self.color.get_pixel(x, y).0;
        [r, g, b]
    }

    pub fn id(&self, x: u32, y: u32) -> u32 {
        self.ids[(y * self.color.width() + x) as usize]
    }
}

/// A renderer with everything resident that can be.
pub fn renderer(gpu: &Arc<Gpu>, scene: &Scene, size_px: [u32; 2]) -> Renderer {
    renderer_of(gpu, scene, &[ViewTarget { view: ViewId(4), size_px }])
}

/// The same of several views.
pub fn renderer_of(gpu: &Arc<Gpu>, scene: &Scene, views: &[ViewTarget]) -> Renderer {
    scene.manifest.check().expect("a manifest made here");
    let manifest = Arc::new(scene.manifest.clone());
    let mut renderer = Renderer::new(Arc::clone(gpu), manifest, views, Attachments::ColorAndIds).expect("a renderer");
    renderer.keep_pieces();
    for (i, bytes) in scene.chunks.iter().enumerate() {
        let _ = renderer.upload(ChunkId(i as u32), bytes); // some tests want bad ones
    }
    renderer
}

/// Draws one view.
pub fn draw(renderer: &mut Renderer, scene: &Scene, look: &Look, visible: &VisibleSet) -> Picture {
    draw_without(renderer, scene, look, visible, (WhenMissing::Hold, &VisibleSet::default()))
}

/// Draws one view, some of whose leaves are missing.
pub fn draw_without(
    renderer: &mut Renderer,
    scene: &Scene,
    look: &Look,
    visible: &VisibleSet,
    (when_missing, missing): (WhenMissing, &VisibleSet),
) -> Picture {
    let views = [ViewInput::new(ViewId(4), look.projection(), visible, missing)];
    let mut planner = Planner::new();
    let plan = planner
        .begin(FrameInput {
            views: &views,
            shared_eye: look.eye,
            manifest: &scene.manifest,
            transforms: renderer.transforms(),
            resident: &|chunk| renderer.is_resident(chunk),
            when_missing,
            has_changed: true,
        })
        .clone();
    let results = renderer.draw(&plan).expect("drawn");
    assert!(planner.feed(&results).is_none());
    let color = renderer.read_color(ViewId(4)).expect("read");
    Picture { color, ids: renderer.read_ids(ViewId(4)).expect("read"), plan }
}

/// Draws everything once, in a renderer of its own.
pub fn draw_all(gpu: &Arc<Gpu>, scene: &Scene, look: &Look) -> Picture {
    draw(&mut renderer(gpu, scene, look.size_px), scene, look, &scene.all())
}
