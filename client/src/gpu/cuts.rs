//! Cuts of hierarchies on the GPU: the vertices and triangles that are there, written anew when they change. A cut is as large as its
//! budget, however large its mesh.

use mullion_common::scene::{Hierarchy, MaterialId, ObjectId};

use super::arena::Vertex;
use super::device::{Gpu, GpuError};
use super::draws::{GrowingBuffer, Indices, State};
use super::pipelines::{PipelineKey, Sides, Turn};
use super::renderer::Renderer;
use crate::frame::PassPlan;
use crate::lod::Cut;

/// An object that is drawn by a cut in place of its leaves.
#[derive(Clone, Copy, Debug)]
pub struct CutObject<'a> {
    /// Which.
    pub object: ObjectId,
    /// The first of its leaves: whose number its pixels bear, and in whose place it is drawn.
    pub leaf: u32,
    /// Its mesh.
    pub hierarchy: &'a Hierarchy,
    /// What of it is drawn.
    pub cut: &'a Cut,
}

/// Some of an object's triangles, of one material.
#[derive(Clone, Copy, Debug)]
struct CutDraw {
    object: ObjectId,
    leaf: u32,
    material: MaterialId,
    first_index: u32,
    index_count: u32,
    first_vertex: u32,
}

/// What a renderer keeps of cuts. Keeps its memory.
pub(super) struct Cuts {
    pub vertices: GrowingBuffer,
    pub indices: GrowingBuffer,
    /// In the order in which they are drawn: by leaf, ascending.
    draws: Vec<CutDraw>,
    staged_vertices: Vec<Vertex>,
    staged_indices: Vec<u32>,
    /// Of an object of several materials, by place: numbers of its vertices.
    placed: Vec<u32>,
}

impl Cuts {
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            vertices: GrowingBuffer::new(gpu, "vertices of cuts", wgpu::BufferUsages::VERTEX),
            indices: GrowingBuffer::new(gpu, "indices of cuts", wgpu::BufferUsages::INDEX),
            draws: Vec::new(),
            staged_vertices: Vec::new(),
            staged_indices: Vec::new(),
            placed: Vec::new(),
        }
    }

    /// Stages an object's triangles, one draw for each material.
    fn stage(&mut self, CutObject { object, leaf, hierarchy, cut }: &CutObject<'_>) {
        let first_vertex = self.staged_vertices.len() as u32;
        let data = hierarchy.vertices();
        self.staged_vertices.extend(cut.vertices(hierarchy).map(|v| v as usize).map(|v| Vertex {
            position: data.positions[v],
            uv: data.uvs.get(v).copied().unwrap_or_default(),
            color: data.colors.get(v).copied().unwrap_or([255; 4]),
        }));
        let materials = hierarchy.materials();
        let mut put = |material: MaterialId, triangles: &mut dyn Iterator<Item = [u32; 3]>| {
            let first_index = self.staged_indices.len() as u32;
            triangles.for_each(|t| self.staged_indices.extend(t));
            let index_count = self.staged_indices.len() as u32 - first_index;
            self.draws.push(CutDraw { object: *object, leaf: *leaf, material, first_index, index_count, first_vertex });
        };
        if let [material] = materials[..] {
            put(material, &mut cut.placed_triangles(hierarchy));
            return;
        }
        self.placed.clear();
        self.placed.extend(cut.vertices(hierarchy));
        for material in materials {
            let is_of_material = |t: &[u32; 3]| hierarchy.material(self.placed[t[0] as usize]) == *material;
            put(*material, &mut cut.placed_triangles(hierarchy).filter(is_of_material));
        }
    }
}

impl Renderer {
    /// From the next draw on, passes that name these objects draw them by their cuts; others have none any more. Objects ascend.
    ///
    /// # Errors
    /// When cuts are larger than the GPU's buffers.
    pub fn set_cuts<'a>(&mut self, objects: impl Iterator<Item = CutObject<'a>>) -> Result<(), GpuError> {
        let cuts = &mut self.cuts;
        cuts.draws.clear();
        cuts.staged_vertices.clear();
        cuts.staged_indices.clear();
        objects.for_each(|object| cuts.stage(&object));
        cuts.draws.sort_unstable_by_key(|draw| (draw.leaf, draw.first_index));
        let limit = self.gpu.device.limits().max_buffer_size;
        cuts.vertices.write(&self.gpu, bytemuck::cast_slice(&cuts.staged_vertices), limit)?;
        cuts.indices.write(&self.gpu, bytemuck::cast_slice(&cuts.staged_indices), limit)
    }

    /// Lists solid leaves, which ascend, and among them the cuts that a pass names, each in the place of its own first leaf: where cuts and leaves
    /// coincide, the lower number is seen as everywhere else.
    pub(super) fn list_solid(&mut self, pass: &PassPlan, leaves: impl Iterator<Item = u32>, turn: Turn) {
        let mut leaves = leaves.peekable();
        let draws = if pass.cuts.is_empty() { 0 } else { self.cuts.draws.len() };
        for at in 0..draws {
            let draw = self.cuts.draws[at];
            if draw.index_count > 0 && pass.cuts.binary_search(&draw.object).is_ok() {
                self.list_leaves(pass, std::iter::from_fn(|| leaves.next_if(|leaf| *leaf < draw.leaf)), turn);
                self.list_cut(pass, draw);
            }
        }
        self.list_leaves(pass, leaves, turn);
    }

    fn list_cut(&mut self, pass: &PassPlan, draw: CutDraw) {
        let CutDraw { object, leaf, material, first_index, index_count, first_vertex } = draw;
        let material = self.materials.states[material.0 as usize];
        let record = self.record(pass, object);
        let sides = Sides::of(material.double_sided, self.mirrored[object.0 as usize]);
        let pipeline = PipelineKey::new(material.coverage, material.surface(), sides);
        let state = State { pipeline, texture: material.texture, page: 0, indices: Indices::Cuts };
        self.list.push(state, material.instance(record, leaf), (first_index, index_count), first_vertex);
        self.list.cut_draws += 1;
    }
}
