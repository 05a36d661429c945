//! The package: a prepared scene as a versioned container of typed sections.
//!
//! ```text
//! "MULLION\x1a"  version u32  section count u32
//! per section: kind u32, reserved u32, offset u64, length u64, BLAKE3 of its bytes
//! the sections' bytes
//! ```
//! All numbers little-endian. A reader skips sections of a kind it does not know.

use std::io::{self, Write};
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use thiserror::Error;

use super::chunk_data::ChunkData;
use super::{
    AlphaMode, ChunkHash, ChunkId, HierarchyError, HierarchyTable, LeafRecord, LodForm, LodTables, MAX_CHUNK_BYTES, Material,
    Object, ObjectHierarchy, OhNode, SceneSize, Tessellation, TessellationError, Transform, VertexHierarchyError,
};
use crate::wire::codec::{self, CodecError};

const MAGIC: [u8; 8] = *b"MULLION\x1a";
/// Version of the container and its sections. A reader takes only its own.
pub const PACKAGE_VERSION: u32 = 2;
const MAX_SECTIONS: u32 = 1024;
/// Most bytes in a package.
pub const MAX_PACKAGE_BYTES: u64 = 64 << 30;
/// Most bytes of a section that is not chunk data.
pub const MAX_SECTION_BYTES: usize = 4 << 30;

/// What a section holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(u32)]
pub enum SectionKind {
    /// `Vec<OhNode>`, through the codec.
    Hierarchy = 1,
    /// `Vec<Object>`, through the codec.
    Objects = 2,
    /// [`Transform`]s, raw: one for each object.
    Transforms = 3,
    /// [`LeafRecord`]s, raw.
    Leaves = 4,
    /// `Vec<Material>`, through the codec.
    Materials = 5,
    /// [`ChunkRecord`]s, raw.
    Chunks = 6,
    /// `Sources`, through the codec: which triangles of the source file each leaf holds.
    Sources = 7,
    /// The bytes of all chunks, one after the other.
    ChunkData = 8,
    /// A [`Tessellation`], in its own form. Not in every package.
    Tessellation = 9,
    /// A [`HierarchyTable`] of hierarchies of vertices, in its own form. Not in every package.
    VertexHierarchies = 10,
    /// One of hierarchies of clusters. Not in every package.
    ClusterHierarchies = 11,
}

impl SectionKind {
    /// What a tile needs before it can draw.
    pub const FOR_TILES: [Self; 4] = [Self::Transforms, Self::Leaves, Self::Materials, Self::Chunks];

    fn from_u32(value: u32) -> Option<Self> {
        use SectionKind as K;
        const ALL: [K; 11] = [
            K::Hierarchy,
            K::Objects,
            K::Transforms,
            K::Leaves,
            K::Materials,
            K::Chunks,
            K::Sources,
            K::ChunkData,
            K::Tessellation,
            K::VertexHierarchies,
            K::ClusterHierarchies,
        ];
        ALL.into_iter().find(|kind| *kind as u32 == value)
    }
}

/// What a chunk's bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum ChunkKind {
    /// A [`super::GeometryChunk`].
    Geometry = 1,
    /// A PNG or JPEG file.
    Texture = 2,
}

/// A chunk's name, place and size. 48 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ChunkRecord {
    /// Name.
    pub hash: ChunkHash,
    /// Where its bytes start in the package's chunk data.
    pub offset: u64,
    /// How many bytes.
    pub length: u32,
    kind: u32,
}
const _: () = assert!(size_of::<ChunkRecord>() == 48);

impl ChunkRecord {
    /// A record for `bytes` at `offset`.
    pub fn new(hash: ChunkHash, offset: u64, length: u32, kind: ChunkKind) -> Self {
        Self { hash, offset, length, kind: kind as u32 }
    }

    /// The same at another offset.
    pub fn moved_to(self, offset: u64) -> Self {
        Self { offset, ..self }
    }

    /// What its bytes are; `None` for a kind of a later version.
    pub fn kind(&self) -> Option<ChunkKind> {
        [ChunkKind::Geometry, ChunkKind::Texture].into_iter().find(|kind| *kind as u32 == self.kind)
    }
}

/// What a tile must know to draw, without the geometry itself. All ids in it are in range.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneManifest {
    /// `world_from_local` of each object, by `ObjectId`.
    pub transforms: Vec<Transform>,
    /// Leaves in depth-first order.
    pub leaves: Vec<LeafRecord>,
    /// Materials, by `MaterialId`.
    pub materials: Vec<Material>,
    /// Chunks, by `ChunkId`.
    pub chunks: Vec<ChunkRecord>,
}

/// Where the leaves come from in the source file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sources {
    /// For each leaf.
    pub leaves: Vec<LeafSource>,
    /// For each piece, one past its last entry in `triangles`.
    pub piece_ends: Vec<u32>,
    /// Indices of triangles in their primitive, piece by piece.
    pub triangles: Vec<u32>,
}

/// Which part of the source file a leaf holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeafSource {
    /// Index of the mesh in the source file.
    pub mesh: u32,
    /// Index of the primitive in that mesh.
    pub primitive: u32,
    /// Which piece of that primitive: the place in [`Sources::piece_ends`].
    pub piece: u32,
}

impl Sources {
    /// The source triangles of a leaf: indices in its primitive.
    pub fn triangles_of(&self, leaf: u32) -> &[u32] {
        let piece = self.leaves[leaf as usize].piece as usize;
        let start = if piece == 0 { 0 } else { self.piece_ends[piece - 1] };
        &self.triangles[start as usize..self.piece_ends[piece] as usize]
    }

    fn check(&self, leaf_count: usize) -> Result<(), PackageError> {
        let pieces_ordered =
            self.piece_ends.is_sorted() && self.piece_ends.last().copied().unwrap_or(0) as usize == self.triangles.len();
        let named = self.leaves.iter().all(|leaf| (leaf.piece as usize) < self.piece_ends.len());
        if pieces_ordered && named && self.leaves.len() == leaf_count {
            Ok(())
        } else {
            inconsistent("sources do not match leaves")
        }
    }
}

/// A prepared scene, all but the chunks' bytes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The tree that the cull walks.
    pub hierarchy: Arc<ObjectHierarchy>,
    /// What a tile needs.
    pub manifest: SceneManifest,
    /// Names and parents of objects, by `ObjectId`.
    pub objects: Vec<Object>,
    /// Where leaves come from.
    pub sources: Sources,
    /// Which cells of space each triangle touches, where that was asked for. Of a scene that grew: of the leaves that it began with.
    pub tessellation: Option<Arc<Tessellation>>,
    /// How coarsely objects may be drawn, where that was asked for. Of a scene that grew: of the objects that it began with.
    pub hierarchies: LodTables,
}

/// A scene with its chunks. Packages that grew from one another share the bytes of their chunks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Package {
    /// The scene.
    pub scene: Scene,
    chunk_data: ChunkData,
}

/// Why bytes are no package.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum PackageError {
    #[error("not a Mullion package: it does not start with MULLION")]
    Magic,
    #[error("package version {found}; this program reads version {PACKAGE_VERSION}: prepare the scene again")]
    Version { found: u32 },
    #[error("truncated: {what} needs {needed} bytes, the file has {found}")]
    Truncated { what: String, needed: u64, found: u64 },
    #[error("section {0:?} is missing")]
    Missing(SectionKind),
    #[error("section {0:?} is damaged: its bytes do not match its hash")]
    Damaged(SectionKind),
    #[error("section {0:?}: {1}")]
    Section(SectionKind, CodecError),
    #[error("section {kind:?}: {length} bytes are no whole number of records of {record}")]
    Records { kind: SectionKind, length: usize, record: usize },
    #[error("hierarchy: {0}")]
    Hierarchy(#[from] HierarchyError),
    #[error("tessellation: {0}")]
    Tessellation(#[from] TessellationError),
    #[error("hierarchies of detail: {0}")]
    Lod(#[from] VertexHierarchyError),
    #[error("inconsistent: {0}")]
    Inconsistent(String),
}

fn inconsistent<T>(what: impl Into<String>) -> Result<T, PackageError> {
    Err(PackageError::Inconsistent(what.into()))
}

impl SceneManifest {
    /// Checks that every id is in range and every number that places something is finite.
    ///
    /// # Errors
    /// Naming the first record that fails.
    pub fn check(&self) -> Result<(), PackageError> {
        self.check_since(SceneSize::default())
    }

    /// The same of what came since the scene was so large.
    pub(super) fn check_since(&self, since: SceneSize) -> Result<(), PackageError> {
        for (i, leaf) in self.leaves.iter().enumerate().skip(since.leaves as usize) {
            let chunk = self.chunks.get(leaf.chunk.0 as usize);
            let in_range = (leaf.object.0 as usize) < self.transforms.len()
                && (leaf.material.0 as usize) < self.materials.len()
                && chunk.is_some_and(|c| c.kind() == Some(ChunkKind::Geometry));
            let finite = leaf.local_min.iter().chain(&leaf.local_max).all(|v| v.is_finite());
            if !(in_range && finite) {
                return inconsistent(format!("leaf {i} names an object, chunk or material that is not there"));
            }
        }
        if let Some((i, _)) = self.transforms.iter().enumerate().skip(since.objects as usize).find(|(_, t)| !t.is_finite()) {
            return inconsistent(format!("object {i} has a transform that is not finite"));
        }
        for (i, material) in self.materials.iter().enumerate().skip(since.materials as usize) {
            let texture = material.texture.map(|t| self.chunks.get(t.chunk.0 as usize).and_then(ChunkRecord::kind));
            let finite = material.base_color.iter().all(|v| v.is_finite())
                && !matches!(material.alpha, AlphaMode::Mask { cutoff } if !cutoff.is_finite());
            if !finite || texture.is_some_and(|kind| kind != Some(ChunkKind::Texture)) {
                return inconsistent(format!("material {i} has a colour that is not finite or a texture that is not there"));
            }
        }
        Ok(())
    }

    /// Reads a manifest from its sections' bytes, given in the order of [`SectionKind::FOR_TILES`].
    ///
    /// # Errors
    /// When a section is malformed or the manifest fails its check.
    pub fn from_sections(sections: [&[u8]; 4]) -> Result<Self, PackageError> {
        let mut manifest = Self::default();
        manifest.grow(sections)?;
        Ok(manifest)
    }
}

impl Scene {
    /// Number of leaves.
    pub fn leaf_count(&self) -> u32 {
        self.manifest.leaves.len() as u32
    }

    /// The bytes of one section. Empty for [`SectionKind::ChunkData`], which the package holds, and for a tessellation or
    /// hierarchies that are not there.
    ///
    /// # Errors
    /// Never for a checked scene.
    pub fn section_bytes(&self, kind: SectionKind) -> Result<Vec<u8>, PackageError> {
        match kind {
            SectionKind::Hierarchy => encode_section(kind, &self.hierarchy.nodes()),
            SectionKind::Objects => encode_section(kind, &self.objects),
            SectionKind::Sources => encode_section(kind, &self.sources),
            SectionKind::Tessellation => Ok(self.tessellation.as_ref().map(|t| t.encode()).unwrap_or_default()),
            SectionKind::VertexHierarchies => Ok(self.table_bytes(LodForm::Vertices)),
            SectionKind::ClusterHierarchies => Ok(self.table_bytes(LodForm::Clusters)),
            for_tiles => self.manifest.section_since(for_tiles, SceneSize::default()),
        }
    }

    fn table_bytes(&self, form: LodForm) -> Vec<u8> {
        self.hierarchies.of(form).map(|table| table.section_bytes()).unwrap_or_default()
    }
}

impl Package {
    /// Joins a scene and the bytes of its chunks.
    ///
    /// # Errors
    /// When an id is out of range, a chunk lies outside the data, or leaves, hierarchy, objects and sources disagree.
    pub fn new(scene: Scene, chunk_data: Vec<u8>) -> Result<Self, PackageError> {
        Self::checked(scene, ChunkData::default().with(chunk_data))
    }

    /// The package that a larger scene makes of this one: its chunks lie where they do here, and the new ones in `added`, as if that
    /// came behind the bytes that are here.
    ///
    /// # Errors
    /// As [`Package::new`].
    pub fn grown(&self, scene: Scene, added: Vec<u8>) -> Result<Self, PackageError> {
        Self::checked(scene, self.chunk_data.with(added))
    }

    fn checked(scene: Scene, chunk_data: ChunkData) -> Result<Self, PackageError> {
        scene.manifest.check()?;
        scene.sources.check(scene.manifest.leaves.len())?;
        if scene.hierarchy.leaf_count() as usize != scene.manifest.leaves.len() {
            return inconsistent("hierarchy and leaf table count different leaves");
        }
        if scene.objects.len() != scene.manifest.transforms.len() {
            return inconsistent("objects and transforms differ in number");
        }
        let leaf_count = scene.leaf_count();
        for (i, object) in scene.objects.iter().enumerate() {
            // Parents come first: a walk to the root ends.
            if object.parent.is_some_and(|parent| parent.0 as usize >= i) {
                return inconsistent(format!("object {i} does not come after its parent"));
            }
            if object.leaves.iter().any(|range| range.is_empty() || range.end > leaf_count) {
                return inconsistent(format!("object {i} names leaves that are not there"));
            }
        }
        for (i, chunk) in scene.manifest.chunks.iter().enumerate() {
            if chunk.length as usize > MAX_CHUNK_BYTES {
                return inconsistent(format!("chunk {i} has {} bytes, at most {MAX_CHUNK_BYTES} are allowed", chunk.length));
            }
            if chunk_data.get(chunk.offset, chunk.length).is_none() {
                return inconsistent(format!("chunk {i} lies outside the chunk data"));
            }
        }
        Ok(Self { scene, chunk_data })
    }

    /// The bytes of a chunk.
    pub fn chunk(&self, id: ChunkId) -> &[u8] {
        let record = &self.scene.manifest.chunks[id.0 as usize];
        self.chunk_data.get(record.offset, record.length).expect("a checked package holds its chunks")
    }

    /// Bytes of all chunks together.
    pub fn chunk_bytes(&self) -> u64 {
        self.chunk_data.len()
    }

    /// Writes the container. The same package gives the same bytes.
    ///
    /// # Errors
    /// What `out` gives, and `InvalidData` when a section cannot be encoded.
    pub fn write_to(&self, out: &mut impl Write) -> io::Result<()> {
        const KINDS: [SectionKind; 7] = [
            SectionKind::Hierarchy,
            SectionKind::Objects,
            SectionKind::Transforms,
            SectionKind::Leaves,
            SectionKind::Materials,
            SectionKind::Chunks,
            SectionKind::Sources,
        ];
        let mut sections = Vec::with_capacity(KINDS.len());
        for kind in KINDS {
            sections.push((kind, self.scene.section_bytes(kind).map_err(io::Error::other)?));
        }
        if let Some(tessellation) = &self.scene.tessellation {
            sections.push((SectionKind::Tessellation, tessellation.encode()));
        }
        for form in LodForm::ALL.into_iter().filter(|form| self.scene.hierarchies.of(*form).is_some()) {
            sections.push((form.section(), self.scene.table_bytes(form)));
        }
        let mut all: Vec<(SectionKind, Vec<&[u8]>)> =
            sections.iter().map(|(kind, bytes)| (*kind, vec![bytes.as_slice()])).collect();
        all.push((SectionKind::ChunkData, self.chunk_data.slices().collect()));
        let count = sections.len() + 1;
        out.write_all(&MAGIC)?;
        out.write_all(&PACKAGE_VERSION.to_le_bytes())?;
        out.write_all(&(count as u32).to_le_bytes())?;
        let mut offset = (16 + count * size_of::<SectionEntry>()) as u64;
        for (kind, slices) in &all {
            let length = slices.iter().map(|bytes| bytes.len() as u64).sum();
            let hash = ChunkHash::of_slices(slices.iter().copied());
            let entry = SectionEntry { kind: *kind as u32, reserved: 0, offset, length, hash };
            out.write_all(bytemuck::bytes_of(&entry))?;
            offset += length;
        }
        all.iter().flat_map(|(_, slices)| slices).try_for_each(|bytes| out.write_all(bytes))
    }

    /// Reads and checks a container. Sections of unknown kinds are skipped.
    ///
    /// # Errors
    /// When the bytes are no package of this version, are cut off or damaged, or what they hold is inconsistent.
    pub fn read(bytes: &[u8]) -> Result<Self, PackageError> {
        let sections = Sections::read(bytes)?;
        let get = |kind| sections.get(kind);
        let manifest = SceneManifest::from_sections([
            get(SectionKind::Transforms)?,
            get(SectionKind::Leaves)?,
            get(SectionKind::Materials)?,
            get(SectionKind::Chunks)?,
        ])?;
        let nodes: Vec<OhNode> = decode_section(SectionKind::Hierarchy, get(SectionKind::Hierarchy)?)?;
        let tessellation = match get(SectionKind::Tessellation) {
            Ok(bytes) => Some(Arc::new(Tessellation::decode(bytes, &manifest)?)),
            Err(_) => None,
        };
        let mut hierarchies = LodTables::default();
        for form in LodForm::ALL {
            if let Ok(bytes) = get(form.section()) {
                hierarchies.take(form, HierarchyTable::from_section(bytes, &manifest)?)?;
            }
        }
        let scene = Scene {
            hierarchy: Arc::new(ObjectHierarchy::new(nodes)?),
            tessellation,
            hierarchies,
            manifest,
            objects: decode_section(SectionKind::Objects, get(SectionKind::Objects)?)?,
            sources: decode_section(SectionKind::Sources, get(SectionKind::Sources)?)?,
        };
        Self::new(scene, get(SectionKind::ChunkData)?.to_vec())
    }

    /// Whether a file that starts with these bytes claims to be a package.
    pub fn has_magic(bytes: &[u8]) -> bool {
        bytes.starts_with(&MAGIC)
    }
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SectionEntry {
    kind: u32,
    reserved: u32,
    offset: u64,
    length: u64,
    hash: ChunkHash,
}
const _: () = assert!(size_of::<SectionEntry>() == 56);

/// The sections of known kinds, their hashes checked.
struct Sections<'a>(Vec<(SectionKind, &'a [u8])>);

impl<'a> Sections<'a> {
    fn read(bytes: &'a [u8]) -> Result<Self, PackageError> {
        if !Package::has_magic(bytes) {
            return Err(PackageError::Magic);
        }
        let truncated =
            |what: &str, needed: u64| PackageError::Truncated { what: what.to_owned(), needed, found: bytes.len() as u64 };
        let word = |at: usize| bytes.get(at..at + 4).map(bytemuck::pod_read_unaligned::<u32>).ok_or(truncated("header", 16));
        let (found, count) = (word(8)?, word(12)?);
        if found != PACKAGE_VERSION {
            return Err(PackageError::Version { found });
        }
        if count > MAX_SECTIONS {
            return inconsistent(format!("{count} sections, at most {MAX_SECTIONS} are allowed"));
        }
        let mut known = Vec::new();
        for i in 0..count as usize {
            let at = 16 + i * size_of::<SectionEntry>();
            let entry = bytes.get(at..at + size_of::<SectionEntry>()).ok_or(truncated("table of sections", at as u64 + 56))?;
            let entry: SectionEntry = bytemuck::pod_read_unaligned(entry);
            let end = entry.offset.saturating_add(entry.length);
            let body = (end <= bytes.len() as u64).then(|| &bytes[entry.offset as usize..end as usize]);
            let body = body.ok_or(truncated(&format!("section {i}"), end))?;
            let Some(kind) = SectionKind::from_u32(entry.kind) else { continue };
            if entry.reserved != 0 {
                return inconsistent(format!("section {kind:?}: its reserved word is {}, it must be 0", entry.reserved));
            }
            if ChunkHash::of(body) != entry.hash {
                return Err(PackageError::Damaged(kind));
            }
            known.push((kind, body));
        }
        Ok(Self(known))
    }

    fn get(&self, kind: SectionKind) -> Result<&'a [u8], PackageError> {
        self.0.iter().find(|(k, _)| *k == kind).map(|(_, bytes)| *bytes).ok_or(PackageError::Missing(kind))
    }
}

pub(super) fn records<T: Pod>(kind: SectionKind, bytes: &[u8]) -> Result<Vec<T>, PackageError> {
    if bytes.len().is_multiple_of(size_of::<T>()) {
        Ok(bytemuck::pod_collect_to_vec(bytes))
    } else {
        Err(PackageError::Records { kind, length: bytes.len(), record: size_of::<T>() })
    }
}

/// A section's bytes, for sections that go through the codec.
pub(super) fn encode_section<T: Serialize>(kind: SectionKind, value: &T) -> Result<Vec<u8>, PackageError> {
    codec::encode(value).map_err(|e| PackageError::Section(kind, e))
}

/// Reads a section that went through the codec.
pub(super) fn decode_section<T: DeserializeOwned>(kind: SectionKind, bytes: &[u8]) -> Result<T, PackageError> {
    codec::decode::<T, MAX_SECTION_BYTES>(bytes).map_err(|e| PackageError::Section(kind, e))
}
