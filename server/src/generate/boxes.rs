//! Boxes by the million, for culling at sizes that no file at hand has: clusters of boxes over three decades of size,
//! turned at random.
//!
//! The world grows with the number of boxes and their density stays: 100 000 fill about a square kilometre, up to a
//! hundred metres high, so that a view from within sees a share of them and a view from outside all.
use super::GenerateError;
use super::glb_writer::{Alpha, Glb, GlbWriter, INSTANCE_BYTES, Instance, MeshId, NodeId, Place, Sides};
use super::random::Random;
use super::solid::{Geometry, srgb};
use glam::{Vec3, vec3};
use std::cmp::Ordering;
use std::fmt;
use std::str::FromStr;

/// Most boxes of a scene: the JSON of so many as a tree, 510 MB, is just below what the importer reads.
pub const MAX_BOXES: u32 = 10_000_000;

// The lengths of a GLB file have 32 bits; the other half is left to the JSON.
const _: () = assert!(MAX_BOXES as u64 * INSTANCE_BYTES as u64 <= u32::MAX as u64 / 2);

/// Boxes on a square kilometre.
const BOXES_PER_KM2: f64 = 100_000.0;
/// Boxes of a town: `SMALLEST_TOWN` and up to so many more.
const SMALLEST_TOWN: u32 = 500;
const TOWN_SPREAD: u32 = 3000;
/// Longest edge of the smallest boxes. The largest are 2^[`OCTAVES`], a thousand times, as long.
const SMALLEST_M: f32 = 0.03;
const OCTAVES: usize = 10;
/// Boxes of one node, and children of a group, in [`BoxesShape::Tree`].
const FANOUT: usize = 8;

/// How the boxes stand in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum BoxesShape {
    /// All are instances of a single node: the file knows nothing of space.
    #[default]
    Flat,
    /// Groups of about eight, made by halving at the median of the longest axis; eight boxes to a node of instances.
    Tree,
}

impl FromStr for BoxesShape {
    type Err = GenerateError;

    fn from_str(name: &str) -> Result<Self, GenerateError> {
        match name {
            "flat" => Ok(BoxesShape::Flat),
            "tree" => Ok(BoxesShape::Tree),
            _ => Err(GenerateError::UnknownShape { name: name.chars().take(80).collect() }),
        }
    }
}

impl fmt::Display for BoxesShape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            BoxesShape::Flat => "flat",
            BoxesShape::Tree => "tree",
        })
    }
}

/// How many boxes, and how they stand in the file. The same seed gives the same boxes in either shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Boxes {
    leaves: u32,
    shape: BoxesShape,
}

impl Boxes {
    /// What is made where nothing else is asked for.
    pub const DEFAULT: Boxes = Boxes { leaves: 100_000, shape: BoxesShape::Flat };

    /// `leaves` boxes, each of which is one leaf of the object hierarchy.
    ///
    /// # Errors
    /// If `leaves` is not 1 to [`MAX_BOXES`].
    pub fn new(leaves: u64, shape: BoxesShape) -> Result<Boxes, GenerateError> {
        match u32::try_from(leaves) {
            Ok(count @ 1..=MAX_BOXES) => Ok(Boxes { leaves: count, shape }),
            _ => Err(GenerateError::Leaves { leaves }),
        }
    }

    /// Number of boxes.
    pub fn leaves(self) -> u32 {
        self.leaves
    }

    /// How they stand in the file.
    pub fn shape(self) -> BoxesShape {
        self.shape
    }
}

/// The boxes as a file.
pub fn generate(boxes: Boxes, seed: u64) -> Glb {
    let mut glb = GlbWriter::default();
    let clay = glb.material("clay", [1.0; 4], None, Alpha::Opaque, Sides::One);
    let mut geometry = Geometry::default();
    let half = vec3(1.0, 2.0, 3.0) / 6.0;
    geometry.cuboid(-half, half, srgb(206, 148, 110));
    let mesh = glb.mesh("box", &[(&geometry, clay)]);
    let mut instances = scatter(boxes.leaves, seed);
    match boxes.shape {
        BoxesShape::Flat => _ = glb.instances(None, "boxes".into(), mesh, &instances),
        BoxesShape::Tree => group(&mut glb, None, mesh, &mut instances),
    }
    glb.finish("mullion generate boxes")
}

/// Town after town until there are enough.
fn scatter(count: u32, seed: u64) -> Vec<Instance> {
    let mut random = Random::new(seed);
    let half_side_m = (f64::from(count) / BOXES_PER_KM2).sqrt() as f32 * 500.0;
    let mut instances = Vec::with_capacity(count as usize);
    while instances.len() < count as usize {
        let mut random = random.fork();
        let center = vec3(random.range(-half_side_m, half_side_m), 0.0, random.range(-half_side_m, half_side_m));
        let size = (SMALLEST_TOWN + random.below(TOWN_SPREAD as usize) as u32) as usize;
        let radius_m = (size as f32).sqrt() * random.range(0.7, 1.4);
        let height_m = random.range(20.0, 100.0);
        let left = count as usize - instances.len();
        instances.extend((0..size.min(left)).map(|_| draw(&mut random, center, radius_m, height_m)));
    }
    instances
}

/// A box of a town: dense in the middle and near the ground, low at the edge; small ones are many.
fn draw(random: &mut Random, center: Vec3, radius_m: f32, height_m: f32) -> Instance {
    let mut triangular = || random.unit() + random.unit() - 1.0;
    let (x, z) = (triangular(), triangular());
    let y = random.unit() * random.unit() * (1.0 - (x * x + z * z) / 2.0);
    let octave = random.below(OCTAVES).min(random.below(OCTAVES));
    let size_m = SMALLEST_M * (1u32 << octave) as f32 * random.range(1.0, 2.0);
    Instance {
        translation: (center + vec3(x * radius_m, y * height_m, z * radius_m)).to_array(),
        rotation: random.rotation().map(|c| (c * f32::from(i16::MAX)).round() as i16),
        scale: [size_m * random.range(0.6, 1.2), size_m * random.range(0.6, 1.2), size_m],
    }
}

/// A node over `boxes`: instances where they fit one node, else up to [`FANOUT`] groups.
fn group(glb: &mut GlbWriter, parent: Option<NodeId>, mesh: MeshId, boxes: &mut [Instance]) {
    if boxes.len() <= FANOUT {
        // Halving leaves them in an order of its own; this one depends on the boxes alone.
        boxes.sort_unstable_by(|a, b| along(0, a, b));
        glb.instances(parent, String::new(), mesh, boxes);
        return;
    }
    let node = glb.node(parent, String::new(), None, Place::at(Vec3::ZERO));
    let mut parts = vec![boxes];
    while parts.len() < FANOUT && parts.iter().any(|part| part.len() > FANOUT) {
        parts = parts.into_iter().flat_map(halve).collect();
    }
    for part in parts {
        group(glb, Some(node), mesh, part);
    }
}

/// Two halves at the median of the longest axis, the first a multiple of [`FANOUT`], so that nodes of instances are
/// full. What fits one node stays whole.
fn halve(boxes: &mut [Instance]) -> Vec<&mut [Instance]> {
    if boxes.len() <= FANOUT {
        return vec![boxes];
    }
    let (low, high) = boxes.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), instance| {
        let at = Vec3::from_array(instance.translation);
        (low.min(at), high.max(at))
    });
    let axis = (high - low).max_position();
    let middle = (boxes.len() / 2).next_multiple_of(FANOUT);
    boxes.select_nth_unstable_by(middle, |a, b| along(axis, a, b));
    let (first, second) = boxes.split_at_mut(middle);
    vec![first, second]
}

/// Order along an axis. Boxes at the same place stand in the order of their rotations, so that the order is total.
fn along(axis: usize, a: &Instance, b: &Instance) -> Ordering {
    let by = |axis: usize| a.translation[axis].total_cmp(&b.translation[axis]);
    by(axis).then_with(|| by((axis + 1) % 3)).then_with(|| by((axis + 2) % 3)).then_with(|| a.rotation.cmp(&b.rotation))
}
