//! From a chunk's bytes to what the GPU holds of it.

use std::collections::HashMap;

use mullion_common::scene::{AlphaMode, ChunkError, ChunkId, Filter, GeometryChunk, Material, SceneManifest, TextureRef, Wrap};
use thiserror::Error;

use super::arena::{Arena, Slot, Vertex};
use super::device::{Gpu, GpuError};
use super::draws::Instance;
use super::pipelines::{Coverage, Surface, bind_texture};
use super::textures;

/// Why a chunk was not taken.
#[derive(Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum UploadError {
    #[error("chunk {0} is not in the scene")]
    Unknown(u32),
    #[error("geometry: {0}")]
    Geometry(#[from] ChunkError),
    #[error("geometry: the position of vertex {vertex} is not finite")]
    NotFinite { vertex: usize },
    #[error("geometry: {bytes} bytes in one buffer, the GPU's limit is {limit}")]
    TooLarge { bytes: u64, limit: u64 },
    #[error("texture: {0}; a checker stands in for it")]
    Image(String),
}

/// What a material asks of the state and of its leaves' instances.
#[derive(Clone, Copy, Debug)]
pub(super) struct MaterialState {
    base_color: [f32; 4],
    alpha_cutoff: f32,
    pub coverage: Coverage,
    pub double_sided: bool,
    /// Index in [`Materials::bindings`].
    pub texture: u32,
}

impl MaterialState {
    pub fn instance(&self, record: u32, leaf: u32) -> Instance {
        Instance { base_color: self.base_color, record, leaf, alpha_cutoff: self.alpha_cutoff }
    }

    pub fn surface(&self) -> Surface {
        if self.texture == Materials::NO_TEXTURE { Surface::Plain } else { Surface::Textured }
    }
}

/// Materials and their textures.
pub(super) struct Materials {
    pub states: Vec<MaterialState>,
    /// For each distinct use of a texture; the first is of no texture.
    pub bindings: Vec<wgpu::BindGroup>,
    uses: Vec<TextureRef>,
    /// Of each use, its binding.
    numbers: HashMap<(ChunkId, Wrap, Wrap, Filter), u32>,
    layout: wgpu::BindGroupLayout,
    white: wgpu::TextureView,
    checker: wgpu::TextureView,
    resident: HashMap<ChunkId, ResidentTexture>,
}

struct ResidentTexture {
    view: wgpu::TextureView,
    bytes: u64,
}

impl Materials {
    /// The binding of what has no texture.
    pub const NO_TEXTURE: u32 = 0;

    pub fn new(gpu: &Gpu, manifest: &SceneManifest, layout: &wgpu::BindGroupLayout) -> Self {
        let (white, _) = textures::create(gpu, textures::white());
        let (checker, _) = textures::create(gpu, textures::checker());
        let no_texture = gpu.device.create_sampler(&wgpu::SamplerDescriptor::default());
        let mut materials = Self {
            states: Vec::new(),
            bindings: vec![bind_texture(&gpu.device, layout, &white, &no_texture)],
            uses: Vec::new(),
            numbers: HashMap::new(),
            layout: layout.clone(),
            white,
            checker,
            resident: HashMap::new(),
        };
        materials.add(gpu, &manifest.materials);
        materials
    }

    /// Takes the materials of a scene that has more of them, behind those that are here.
    pub fn grow(&mut self, gpu: &Gpu, manifest: &SceneManifest) {
        self.add(gpu, &manifest.materials[self.states.len().min(manifest.materials.len())..]);
    }

    fn add(&mut self, gpu: &Gpu, materials: &[Material]) {
        for material in materials {
            let texture = material.texture.map_or(Self::NO_TEXTURE, |texture| self.number(gpu, texture));
            self.states.push(MaterialState {
                base_color: material.base_color,
                alpha_cutoff: if let AlphaMode::Mask { cutoff } = material.alpha { cutoff } else { 0.0 },
                coverage: Coverage::of(material),
                double_sided: material.double_sided,
                texture,
            });
        }
    }

    /// The number of a use among the bindings, added where it is new.
    fn number(&mut self, gpu: &Gpu, texture: TextureRef) -> u32 {
        let next = self.bindings.len() as u32;
        let number = *self.numbers.entry((texture.chunk, texture.wrap_u, texture.wrap_v, texture.filter)).or_insert(next);
        if number == next {
            let view = self.resident.get(&texture.chunk).map_or(&self.white, |resident| &resident.view);
            self.bindings.push(bind_texture(&gpu.device, &self.layout, view, &sampler(gpu, texture)));
            self.uses.push(texture);
        }
        number
    }

    pub fn is_resident(&self, chunk: ChunkId) -> bool {
        self.resident.contains_key(&chunk)
    }

    /// Decodes and takes a texture. An image that cannot be read is resident too, as a checker: it will not get
    /// better by being sent again.
    pub fn insert(&mut self, gpu: &Gpu, chunk: ChunkId, bytes: &[u8]) -> Result<u64, UploadError> {
        if let Some(resident) = self.resident.get(&chunk) {
            return Ok(resident.bytes);
        }
        let decoded = textures::decode(bytes);
        let (view, bytes) = match decoded {
            Ok(image) => textures::create(gpu, image),
            Err(problem) => {
                let checker = self.checker.clone();
                self.bind(gpu, chunk, &checker);
                self.resident.insert(chunk, ResidentTexture { view: checker, bytes: 0 });
                return Err(UploadError::Image(problem));
            }
        };
        self.bind(gpu, chunk, &view);
        self.resident.insert(chunk, ResidentTexture { view, bytes });
        Ok(bytes)
    }

    pub fn remove(&mut self, gpu: &Gpu, chunk: ChunkId) {
        if self.resident.remove(&chunk).is_some() {
            let white = self.white.clone();
            self.bind(gpu, chunk, &white);
        }
    }

    fn bind(&mut self, gpu: &Gpu, chunk: ChunkId, view: &wgpu::TextureView) {
        for (texture, binding) in self.uses.iter().zip(&mut self.bindings[1..]).filter(|(texture, _)| texture.chunk == chunk) {
            *binding = bind_texture(&gpu.device, &self.layout, view, &sampler(gpu, *texture));
        }
    }
}

fn sampler(gpu: &Gpu, texture: TextureRef) -> wgpu::Sampler {
    let address = |wrap| match wrap {
        Wrap::Repeat => wgpu::AddressMode::Repeat,
        Wrap::Mirror => wgpu::AddressMode::MirrorRepeat,
        Wrap::Clamp => wgpu::AddressMode::ClampToEdge,
    };
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("base colour"),
        address_mode_u: address(texture.wrap_u),
        address_mode_v: address(texture.wrap_v),
        mag_filter: match texture.filter {
            Filter::Nearest => wgpu::FilterMode::Nearest,
            Filter::Linear => wgpu::FilterMode::Linear,
        },
        min_filter: wgpu::FilterMode::Linear,
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        ..Default::default()
    })
}

/// The cube from 0 to 1 along each axis, white: what boxes are drawn with.
pub(super) fn unit_cube(gpu: &Gpu, arena: &mut Arena) -> Result<Slot, GpuError> {
    let corner = |i: u8| Vertex { position: [i & 1, i >> 1 & 1, i >> 2].map(f32::from), uv: [0.0; 2], color: [255; 4] };
    // Two triangles a face, counterclockwise from outside: −x, +x, −y, +y, −z, +z.
    const FACES: [[u16; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let indices = FACES.map(|[a, b, c, d]| [a, b, c, a, c, d]);
    let limit =
        |e: super::arena::TooLarge| GpuError::Limit { what: "buffer of geometry in bytes", value: e.bytes, limit: e.limit };
    arena.insert(gpu, (0..8).map(corner), indices.as_flattened()).map_err(limit)
}

/// Decodes and takes a leaf's geometry. Attributes that the chunk lacks become zero and white; texture coordinates
/// that are not finite become zero. Gives where it lies, too.
pub(super) fn geometry(gpu: &Gpu, arena: &mut Arena, bytes: &[u8]) -> Result<(Slot, GeometryChunk), UploadError> {
    let chunk = GeometryChunk::decode(bytes)?;
    if let Some(vertex) = chunk.positions.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
        return Err(UploadError::NotFinite { vertex });
    }
    let finite = |uv: [f32; 2]| if uv.iter().all(|v| v.is_finite()) { uv } else { [0.0; 2] };
    let vertices = chunk.positions.iter().enumerate().map(|(i, &position)| Vertex {
        position,
        uv: chunk.uvs.get(i).copied().map_or([0.0; 2], finite),
        color: chunk.colors.get(i).copied().unwrap_or([255; 4]),
    });
    let too_large = |e: super::arena::TooLarge| UploadError::TooLarge { bytes: e.bytes, limit: e.limit };
    let slot = arena.insert(gpu, vertices, &chunk.indices).map_err(too_large)?;
    Ok((slot, chunk))
}
