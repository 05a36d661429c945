//! How a scene grows: objects, leaves, materials and chunks come behind those that are there, which keep their numbers.

use std::ops::Range;

use super::package::{decode_section, encode_section, records};
use super::{PackageError, SceneManifest, SectionKind};

/// How many of everything that has a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[allow(missing_docs)]
pub struct SceneSize {
    pub objects: u32,
    pub leaves: u32,
    pub materials: u32,
    pub chunks: u32,
}

impl SceneManifest {
    /// How large it is.
    pub fn size(&self) -> SceneSize {
        SceneSize {
            objects: self.transforms.len() as u32,
            leaves: self.leaves.len() as u32,
            materials: self.materials.len() as u32,
            chunks: self.chunks.len() as u32,
        }
    }

    /// The bytes of one section of what came since the scene was `since`, which was no larger; empty for kinds that are not for tiles.
    ///
    /// # Errors
    /// Never for a checked scene.
    pub fn section_since(&self, kind: SectionKind, since: SceneSize) -> Result<Vec<u8>, PackageError> {
        Ok(match kind {
            SectionKind::Transforms => bytemuck::cast_slice(&self.transforms[since.objects as usize..]).to_vec(),
            SectionKind::Leaves => bytemuck::cast_slice(&self.leaves[since.leaves as usize..]).to_vec(),
            SectionKind::Materials => encode_section(kind, &&self.materials[since.materials as usize..])?,
            SectionKind::Chunks => bytemuck::cast_slice(&self.chunks[since.chunks as usize..]).to_vec(),
            _ => Vec::new(),
        })
    }

    /// Takes what came, as [`SceneManifest::section_since`] gives it, in the order of [`SectionKind::FOR_TILES`]. Where that fails, nothing
    /// is taken. What is there already is not looked at again.
    ///
    /// # Errors
    /// When a section is malformed, or what came names what is not there.
    pub fn grow(&mut self, [transforms, leaves, materials, chunks]: [&[u8]; 4]) -> Result<(), PackageError> {
        let before = self.size();
        let transforms = records(SectionKind::Transforms, transforms)?;
        let leaves = records(SectionKind::Leaves, leaves)?;
        let materials = decode_section(SectionKind::Materials, materials)?;
        let chunks = records(SectionKind::Chunks, chunks)?;
        append(&mut self.transforms, transforms);
        append(&mut self.leaves, leaves);
        append(&mut self.materials, materials);
        append(&mut self.chunks, chunks);
        let checked = self.check_since(before);
        if checked.is_err() {
            self.transforms.truncate(before.objects as usize);
            self.leaves.truncate(before.leaves as usize);
            self.materials.truncate(before.materials as usize);
            self.chunks.truncate(before.chunks as usize);
        }
        checked
    }
}

fn append<T>(all: &mut Vec<T>, mut added: Vec<T>) {
    if all.is_empty() {
        *all = added;
    } else {
        all.append(&mut added);
    }
}

impl SceneSize {
    /// The numbers of the objects that a larger scene has beyond these.
    pub fn new_objects(&self, larger: &Self) -> Range<u32> {
        self.objects..larger.objects
    }

    /// The numbers of the leaves that a larger scene has beyond these.
    pub fn new_leaves(&self, larger: &Self) -> Range<u32> {
        self.leaves..larger.leaves
    }
}
