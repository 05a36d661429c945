//! The item buffer: which triangle is seen at each pixel, by a plain rasteriser with a depth buffer. What is exact about the visible set is
//! held against it, as in the paper's section 4.

use glam::{DAffine3, DMat4, DVec3, Vec3, Vec4};
use mullion_common::scene::{GeometryChunk, Package};

/// No triangle.
pub const NOTHING: u32 = u32::MAX;

/// Triangles in the world, by slot.
pub struct ItemScene {
    origin: DVec3,
    triangles: Vec<[Vec3; 3]>,
    double_sided: Vec<bool>,
}

impl ItemScene {
    /// The triangles of these leaves, leaf by leaf.
    pub fn of_leaves(package: &Package, origin: DVec3, leaves: impl Iterator<Item = u32>) -> Self {
        let manifest = &package.scene.manifest;
        let mut scene = Self { origin, triangles: Vec::new(), double_sided: Vec::new() };
        for leaf in leaves {
            let record = &manifest.leaves[leaf as usize];
            let transform = manifest.transforms[record.object.0 as usize];
            let from_local = DAffine3::from_translation(-scene.origin) * transform.affine();
            // A package's chunks were checked when it was made.
            let chunk = GeometryChunk::decode(package.chunk(record.chunk)).unwrap_or_default();
            let corner = |k: u16| from_local.transform_point3(Vec3::from(chunk.positions[k as usize]).as_dvec3()).as_vec3();
            let turned = transform.is_mirrored();
            scene.triangles.extend(chunk.indices.chunks_exact(3).map(|t| {
                let [a, b, c] = [corner(t[0]), corner(t[1]), corner(t[2])];
                if turned { [a, c, b] } else { [a, b, c] }
            }));
            scene.double_sided.resize(scene.triangles.len(), manifest.materials[record.material.0 as usize].double_sided);
        }
        scene
    }

    /// Triangles relative to an origin, each with whether it has two fronts.
    pub fn of_triangles(origin: DVec3, triangles: impl Iterator<Item = ([Vec3; 3], bool)>) -> Self {
        let (triangles, double_sided) = triangles.unzip();
        Self { origin, triangles, double_sided }
    }

    /// With another scene's triangles behind its own.
    pub fn and(mut self, other: &Self) -> Self {
        let way = (other.origin - self.origin).as_vec3();
        self.triangles.extend(other.triangles.iter().map(|corners| corners.map(|corner| corner + way)));
        self.double_sided.extend(&other.double_sided);
        self
    }

    /// A triangle's corners relative to the origin.
    pub fn corners(&self, slot: u32) -> [Vec3; 3] {
        self.triangles[slot as usize]
    }

    /// How many triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// The middle of a triangle, metres of the world.
    pub fn middle(&self, slot: u32) -> DVec3 {
        let [a, b, c] = self.triangles[slot as usize];
        self.origin + ((a + b + c) / 3.0).as_dvec3()
    }

    /// Whether an eye sees a triangle's front, or it has two.
    pub fn is_seen_from(&self, slot: u32, eye: DVec3) -> bool {
        let [a, b, c] = self.triangles[slot as usize];
        self.double_sided[slot as usize] || (b - a).cross(c - a).dot((eye - self.origin).as_vec3() - a) > 0.0
    }
}

/// A picture of slots.
pub struct ItemBuffer {
    width: usize,
    height: usize,
    depths: Vec<f32>,
    items: Vec<u32>,
}

impl ItemBuffer {
    /// A picture of this size, pixels.
    pub fn new([width, height]: [u32; 2]) -> Self {
        let (width, height) = (width as usize, height as usize);
        Self { width, height, depths: vec![0.0; width * height], items: vec![NOTHING; width * height] }
    }

    /// Draws all triangles for which `is_drawn` holds, fronts only but for double-sided ones. Depth is reversed: the greatest `z / w` wins,
    /// and of equal ones the first.
    pub fn draw(&mut self, scene: &ItemScene, clip_from_world: &DMat4, mut is_drawn: impl FnMut(u32) -> bool) {
        self.depths.fill(0.0);
        self.items.fill(NOTHING);
        let clip_from_here = (*clip_from_world * DMat4::from_translation(scene.origin)).as_mat4();
        for (slot, triangle) in (0..).zip(&scene.triangles) {
            if is_drawn(slot) {
                let corners = triangle.map(|p| clip_from_here * p.extend(1.0));
                self.clipped(&corners, slot, scene.double_sided[slot as usize]);
            }
        }
    }

    /// The slot at each pixel, row by row, or [`NOTHING`].
    pub fn items(&self) -> &[u32] {
        &self.items
    }

    /// How near what is seen is, row by row: reversed depth, 0 for nothing.
    pub fn depths(&self) -> &[f32] {
        &self.depths
    }

    fn clipped(&mut self, corners: &[Vec4; 3], slot: u32, double_sided: bool) {
        let outside = |side: fn(&Vec4) -> bool| corners.iter().all(side);
        if outside(|p| p.x > p.w) || outside(|p| p.x < -p.w) || outside(|p| p.y > p.w) || outside(|p| p.y < -p.w) {
            return;
        }
        // Nearer than the near plane: z above w, as depth is reversed.
        if corners.iter().all(|p| p.z <= p.w && p.w > 0.0) {
            self.triangle(corners, slot, double_sided);
            return;
        }
        let mut kept: Vec<Vec4> = Vec::with_capacity(4);
        for k in 0..3 {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let (a, b) = (from.w - from.z, to.w - to.z);
            if a >= 0.0 {
                kept.push(from);
            }
            if (a >= 0.0) != (b >= 0.0) {
                kept.push(from + (to - from) * (a / (a - b)));
            }
        }
        for k in 2..kept.len() {
            self.triangle(&[kept[0], kept[k - 1], kept[k]], slot, double_sided);
        }
    }

    fn triangle(&mut self, corners: &[Vec4; 3], slot: u32, double_sided: bool) {
        let (width, height) = (self.width as f32, self.height as f32);
        let place = |p: &Vec4| Vec3::new((p.x / p.w * 0.5 + 0.5) * width, (0.5 - p.y / p.w * 0.5) * height, p.z / p.w);
        let [a, mut b, mut c] = [place(&corners[0]), place(&corners[1]), place(&corners[2])];
        let area = |a: Vec3, b: Vec3, c: Vec3| (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        let mut doubled = area(a, b, c);
        // Fronts are counterclockwise in clip space, and pixels count downwards.
        if doubled > 0.0 {
            if !double_sided {
                return;
            }
        } else {
            (b, c) = (c, b);
            doubled = -doubled;
        }
        if doubled.is_nan() || doubled <= 0.0 {
            return;
        }
        let span = |low: f32, high: f32, size: usize| {
            let first = (low - 0.5).ceil().clamp(0.0, size as f32) as usize;
            let end = ((high - 0.5).floor() + 1.0).clamp(0.0, size as f32) as usize;
            first..end
        };
        let columns = span(a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x), self.width);
        for y in span(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y), self.height) {
            for x in columns.clone() {
                let p = Vec3::new(x as f32 + 0.5, y as f32 + 0.5, 0.0);
                let weights = [area(b, c, p), area(c, a, p), area(a, b, p)];
                if weights.iter().any(|weight| *weight < 0.0) {
                    continue;
                }
                let depth = (weights[0] * a.z + weights[1] * b.z + weights[2] * c.z) / doubled;
                let at = y * self.width + x;
                if depth > self.depths[at] {
                    self.depths[at] = depth;
                    self.items[at] = slot;
                }
            }
        }
    }
}
