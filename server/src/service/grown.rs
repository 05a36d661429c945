//! What a show's scene has grown to.

use std::fmt;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use mullion_common::scene::{BlobRef, LodForm, Package, SceneSize};
use mullion_common::wire::{Insertion, SectionRef};
use thiserror::Error;

use super::blobs::{Blobs, Part};
use super::{OfferError, ServiceError};
use crate::library::{Library, LibraryError};
use crate::master::{Hierarchies, HierarchyLeaves, ObjectLeaves};
use crate::prepare::{Placement, graft};
use crate::tree::{Bounds, DynamicScene};

/// A scene with what was inserted into it, in order. A clone shares all that is large.
#[derive(Clone, Debug)]
pub(super) struct Grown {
    package: Arc<Package>,
    parts: Vec<Arc<Part>>,
    sections: Vec<SectionRef>,
    /// Of what the show began with.
    tessellation: Option<SectionRef>,
    /// The index of the hierarchies of what the show began with.
    hierarchies: Option<BlobRef>,
    insertions: Vec<Insertion>,
}

/// A scene that has grown by one insertion.
#[derive(Debug)]
pub(super) struct Joined {
    pub insertion: Insertion,
    /// The whole scene.
    pub package: Arc<Package>,
    /// The numbers of the objects that are new.
    pub objects: Range<u32>,
    /// Of the whole scene.
    pub object_leaves: Arc<ObjectLeaves>,
    /// Of the whole scene.
    pub triangles: u32,
    pub part: Arc<Part>,
    /// What nodes fetch of the part.
    pub sections: Vec<SectionRef>,
}

impl Joined {
    /// Takes long.
    pub fn new(base: &Package, added: &Package, insertion: Insertion) -> Result<Self, OfferError> {
        let before = base.scene.manifest.size();
        let package = Arc::new(graft(base, added, &Placement::of(&insertion))?);
        let (part, sections) = Part::since(before, &package)?;
        let objects = before.new_objects(&package.scene.manifest.size());
        let object_leaves = Arc::new(ObjectLeaves::of(&package.scene.manifest));
        let triangles = triangles(&package);
        Ok(Self { insertion, package, objects, object_leaves, triangles, part: Arc::new(part), sections })
    }
}

/// Triangles that a scene shows, each instance's for itself; as far as a `u32` goes.
fn triangles(package: &Package) -> u32 {
    let leaves = &package.scene.manifest.leaves;
    leaves.iter().fold(0, |sum, leaf| sum.saturating_add(leaf.triangle_count))
}

/// Why a standby's scene does not grow as its master's.
#[derive(Debug, Error)]
pub(super) enum GrowError {
    #[error("package {name:?}: the standby has no library; start it with --library")]
    NoLibrary { name: String },
    #[error(transparent)]
    Library(#[from] LibraryError),
    #[error("package {name:?}: {error}")]
    Offer { name: String, error: OfferError },
}

impl Grown {
    /// What a show begins with, where it draws by hierarchies with those of this form if there are some.
    ///
    /// # Errors
    /// When a section is larger than nodes take.
    pub fn new(package: Arc<Package>, form: Option<LodForm>) -> Result<Self, ServiceError> {
        let (mut part, sections) = Part::since(SceneSize::default(), &package)?;
        let tessellation = part.add_tessellation(&package)?;
        let hierarchies = form.map_or(Ok(None), |form| part.add_hierarchies(&package, form))?;
        Ok(Self { package, parts: vec![Arc::new(part)], sections, tessellation, hierarchies, insertions: Vec::new() })
    }

    pub fn grow(&mut self, joined: &Joined) {
        self.package = Arc::clone(&joined.package);
        self.parts.push(Arc::clone(&joined.part));
        self.sections.extend_from_slice(&joined.sections);
        self.insertions.push(joined.insertion.clone());
    }

    /// The same with one insertion more, from a library. Takes long.
    pub fn with(mut self, insertion: &Insertion, library: Option<&Library>) -> Result<Self, GrowError> {
        let name = || insertion.package.clone();
        let library = library.ok_or_else(|| GrowError::NoLibrary { name: name() })?;
        let added = library.inserted(insertion)?;
        let joined = Joined::new(&self.package, &added, insertion.clone());
        self.grow(&joined.map_err(|error| GrowError::Offer { name: name(), error })?);
        Ok(self)
    }

    /// The whole scene.
    pub fn package(&self) -> &Arc<Package> {
        &self.package
    }

    pub fn objects(&self) -> usize {
        self.package.scene.objects.len()
    }

    /// Takes as long as there are leaves.
    pub fn object_leaves(&self) -> Arc<ObjectLeaves> {
        Arc::new(ObjectLeaves::of(&self.package.scene.manifest))
    }

    /// Takes as long as there are leaves.
    pub fn triangles(&self) -> u32 {
        triangles(&self.package)
    }

    pub fn sections(&self) -> &[SectionRef] {
        &self.sections
    }

    pub fn tessellation(&self) -> Option<SectionRef> {
        self.tessellation
    }

    /// Takes as long as there are leaves, and objects above each.
    pub fn hierarchies(&self) -> Option<Hierarchies> {
        let (index, table) = self.hierarchies.zip(self.parts.first().and_then(|first| first.hierarchies()))?;
        let objects = table.entries().iter().flat_map(|entry| entry.objects.iter().copied());
        Some(Hierarchies { index, leaves: Arc::new(HierarchyLeaves::of(&self.package.scene, objects)) })
    }

    pub fn insertions(&self) -> &[Insertion] {
        &self.insertions
    }

    pub fn blobs(&self) -> Blobs {
        Blobs::new(Arc::clone(&self.package), self.parts.clone())
    }
}

/// A scene that a show grew to under another master, to be shown in the place of what there was. Nothing was done to it yet.
pub struct FreshScene {
    insertions: Vec<Insertion>,
    package: Arc<Package>,
    scene: Mutex<Option<DynamicScene>>,
}

impl FreshScene {
    /// For a package that these insertions made. Takes long.
    pub fn new(package: Arc<Package>, insertions: Vec<Insertion>) -> Self {
        let scene = Mutex::new(Some(DynamicScene::new(Arc::clone(&package), Bounds::default())));
        Self { insertions, package, scene }
    }

    /// What was inserted since the show began, in order.
    pub fn insertions(&self) -> &[Insertion] {
        &self.insertions
    }

    /// The whole scene.
    pub fn package(&self) -> &Arc<Package> {
        &self.package
    }

    /// The scene; once.
    pub fn take(&self) -> Option<DynamicScene> {
        self.scene.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl PartialEq for FreshScene {
    fn eq(&self, other: &Self) -> bool {
        self.insertions == other.insertions
    }
}

impl fmt::Debug for FreshScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FreshScene").field("insertions", &self.insertions).finish_non_exhaustive()
    }
}
