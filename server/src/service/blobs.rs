//! Bytes by their names: the chunks of a package, the sections that tiles need, and what hierarchies of detail consist of.

use std::collections::HashMap;
use std::sync::{Arc, PoisonError, RwLock};

use mullion_common::scene::{
    BlobRef, ChunkHash, ChunkId, HierarchyIndex, HierarchyTable, LodForm, Package, PackageError, SceneSize, SectionKind,
};
use mullion_common::wire::{MAX_TILE_SECTION_BYTES, SectionRef};

use super::ServiceError;

#[derive(Clone, Copy, Debug)]
enum Place {
    Chunk(ChunkId),
    Section(usize),
    /// Of a hierarchy, by its number, the base or a block.
    OfHierarchy(usize, usize),
}

/// What a scene has beyond an older, smaller one: names of chunks, and sections of their own.
#[derive(Debug)]
pub(super) struct Part {
    sections: Vec<Vec<u8>>,
    places: HashMap<ChunkHash, Place>,
    /// Whose bases and blocks it names.
    hierarchies: Option<Arc<HierarchyTable>>,
}

impl Part {
    /// All that came since a package's scene was so large, and what nodes fetch of it first.
    ///
    /// # Errors
    /// When a section is larger than nodes take.
    pub fn since(size: SceneSize, package: &Package) -> Result<(Self, Vec<SectionRef>), ServiceError> {
        let manifest = &package.scene.manifest;
        let chunks = (0..).zip(&manifest.chunks).skip(size.chunks as usize);
        let places = chunks.map(|(id, chunk)| (chunk.hash, Place::Chunk(ChunkId(id)))).collect();
        let mut part = Self { sections: Vec::new(), places, hierarchies: None };
        let add = |kind| part.add(kind, manifest.section_since(kind, size)?);
        let sections = SectionKind::FOR_TILES.into_iter().map(add).collect::<Result<_, ServiceError>>()?;
        Ok((part, sections))
    }

    /// Adds the scene's tessellation, if it has one.
    ///
    /// # Errors
    /// When it is larger than nodes take.
    pub fn add_tessellation(&mut self, package: &Package) -> Result<Option<SectionRef>, ServiceError> {
        let tessellation = package.scene.tessellation.as_ref();
        tessellation.map(|tessellation| self.add(SectionKind::Tessellation, tessellation.encode())).transpose()
    }

    /// Adds the scene's hierarchies of a form, or of another where it has none of that: their index, which is named, and all that is named there.
    ///
    /// # Errors
    /// When something of them is larger than nodes take.
    pub fn add_hierarchies(&mut self, package: &Package, form: LodForm) -> Result<Option<BlobRef>, ServiceError> {
        let Some(table) = package.scene.hierarchies.preferring(form) else { return Ok(None) };
        let index = HierarchyIndex::of(table).map_err(PackageError::from)?;
        for (number, hierarchy) in index.hierarchies.iter().enumerate() {
            let places = (0..).map(|blob| Place::OfHierarchy(number, blob));
            self.places.extend(hierarchy.blobs.iter().map(|blob| blob.hash).zip(places));
        }
        self.hierarchies = Some(Arc::clone(table));
        let SectionRef { hash, length, .. } = self.add(SectionKind::VertexHierarchies, index.encode())?;
        Ok(Some(BlobRef { hash, length: length as u32 })) // sendable, and so below 2³²
    }

    /// Those that were added.
    pub fn hierarchies(&self) -> Option<&HierarchyTable> {
        self.hierarchies.as_deref()
    }

    fn add(&mut self, kind: SectionKind, bytes: Vec<u8>) -> Result<SectionRef, ServiceError> {
        let length = sendable(kind, bytes.len() as u64)?;
        let hash = ChunkHash::of(&bytes);
        self.places.insert(hash, Place::Section(self.sections.len()));
        self.sections.push(bytes);
        Ok(SectionRef { kind, hash, length })
    }
}

/// All blobs of a scene that may grow. Holds the package by reference, and only its sections twice.
#[derive(Debug)]
pub(super) struct Blobs {
    known: RwLock<Known>,
}

#[derive(Debug)]
struct Known {
    package: Arc<Package>,
    parts: Vec<Arc<Part>>,
}

/// A blob's bytes, which stay whatever comes.
#[derive(Debug)]
pub(super) enum Blob {
    Chunk(Arc<Package>, ChunkId),
    Section(Arc<Part>, usize),
    OfHierarchy(Arc<HierarchyTable>, usize, usize),
}

impl Blob {
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::Chunk(package, id) => package.chunk(*id),
            Self::Section(part, place) => &part.sections[*place],
            // They were named by counting them.
            Self::OfHierarchy(table, number, blob) => table.blobs(*number).nth(*blob).unwrap_or_default(),
        }
    }
}

impl Blobs {
    /// For a package and the parts that it grew by.
    pub fn new(package: Arc<Package>, parts: Vec<Arc<Part>>) -> Self {
        Self { known: RwLock::new(Known { package, parts }) }
    }

    /// Takes a package that grew from the newest one, by that part.
    pub fn grow(&self, package: Arc<Package>, part: Arc<Part>) {
        let mut known = self.known.write().unwrap_or_else(PoisonError::into_inner);
        known.package = package;
        known.parts.push(part);
    }

    pub fn get(&self, hash: ChunkHash) -> Option<Blob> {
        let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
        let (part, place) = known.parts.iter().find_map(|part| Some((part, *part.places.get(&hash)?)))?;
        Some(match place {
            Place::Chunk(id) => Blob::Chunk(Arc::clone(&known.package), id),
            Place::Section(place) => Blob::Section(Arc::clone(part), place),
            Place::OfHierarchy(number, blob) => Blob::OfHierarchy(Arc::clone(part.hierarchies.as_ref()?), number, blob),
        })
    }
}

/// The length of a section that nodes take. They would leave at the manifest, again and again, for a larger one.
fn sendable(kind: SectionKind, length: u64) -> Result<u64, ServiceError> {
    match kind {
        _ if length <= MAX_TILE_SECTION_BYTES => Ok(length),
        SectionKind::Tessellation => Err(ServiceError::TessellationTooLarge { length }),
        SectionKind::VertexHierarchies => Err(ServiceError::IndexTooLarge { length }),
        kind => Err(ServiceError::SectionTooLarge { kind, length }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a scene with hierarchies of both forms, nodes hear of those that are best for the detail; of one with those of one form, of these.
    #[test]
    fn hierarchies_of_the_wanted_form_are_named_or_those_that_there_are() {
        let blob = |form: LodForm| form.name().as_bytes().to_vec();
        let package_of = |forms: &[LodForm]| {
            let mut package = Package::default();
            for form in forms {
                let mut table = HierarchyTable::default();
                table.push(Vec::new(), &[blob(*form)]);
                package.scene.hierarchies.set(*form, table);
            }
            package
        };
        let named = |forms: &[LodForm], wanted: LodForm| {
            let package = package_of(forms);
            let (mut part, _) = Part::since(SceneSize::default(), &package).unwrap();
            let index = part.add_hierarchies(&package, wanted).unwrap();
            let is_named = |form: &LodForm| part.places.contains_key(&ChunkHash::of(&blob(*form)));
            (index.is_some(), LodForm::ALL.into_iter().filter(is_named).collect::<Vec<_>>())
        };
        for wanted in LodForm::ALL {
            assert_eq!(named(&LodForm::ALL, wanted), (true, vec![wanted]));
            assert_eq!(named(&[], wanted), (false, Vec::new()));
            for only in LodForm::ALL {
                assert_eq!(named(&[only], wanted), (true, vec![only]));
            }
        }
    }

    #[test]
    fn a_section_that_no_node_takes_is_an_error_before_the_show() {
        assert_eq!(sendable(SectionKind::Leaves, MAX_TILE_SECTION_BYTES).unwrap(), MAX_TILE_SECTION_BYTES);
        let error = sendable(SectionKind::Leaves, MAX_TILE_SECTION_BYTES + 1).unwrap_err();
        assert_eq!(
            error.to_string(),
            "scene: its section Leaves has 1073741825 bytes; nodes take at most 1073741824: prepare it with fewer, larger leaves"
        );
        let error = sendable(SectionKind::Tessellation, MAX_TILE_SECTION_BYTES + 1).unwrap_err();
        assert_eq!(
            error.to_string(),
            "scene: its tessellation has 1073741825 bytes; nodes take at most 1073741824: prepare it with a larger --plp-leaf"
        );
    }
}
