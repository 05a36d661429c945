//! Meshes of several levels of detail, of either form: vertices or clusters. A base's magic tells which.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use thiserror::Error;

use super::cluster_hierarchy::{ClusterHierarchy, is_cluster_base};
use super::package::SectionKind;
use super::vertex_hierarchy::{VertexData, VertexHierarchy, VertexHierarchyError};
use super::{HierarchyTable, MaterialId};
use crate::geometry::Aabb;

/// A form of hierarchies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LodForm {
    /// Refined a vertex at a time: the fewest triangles for a picture as good, and what is hidden stays coarse.
    #[default]
    Vertices,
    /// Refined a group of clusters at a time: next to nothing to find, and three to five times as many triangles for a picture as good.
    Clusters,
}

impl LodForm {
    /// All.
    pub const ALL: [Self; 2] = [Self::Vertices, Self::Clusters];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vertices => "vertices",
            Self::Clusters => "clusters",
        }
    }

    /// The section of a package that has the tables of this form.
    pub(super) fn section(self) -> SectionKind {
        match self {
            Self::Vertices => SectionKind::VertexHierarchies,
            Self::Clusters => SectionKind::ClusterHierarchies,
        }
    }
}

impl fmt::Display for LodForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// No form has this name.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("a form is vertices or clusters")]
pub struct UnknownForm;

impl FromStr for LodForm {
    type Err = UnknownForm;

    fn from_str(text: &str) -> Result<Self, UnknownForm> {
        Self::ALL.into_iter().find(|form| form.name() == text).ok_or(UnknownForm)
    }
}

/// The hierarchies of a scene, those of each form apart. An object may have one of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LodTables {
    tables: [Option<Arc<HierarchyTable>>; LodForm::ALL.len()],
}

impl LodTables {
    /// Takes those of a form, in the place of what was there.
    pub fn set(&mut self, form: LodForm, table: HierarchyTable) {
        self.tables[form as usize] = (!table.entries().is_empty()).then(|| Arc::new(table));
    }

    /// Takes those of a form that come from outside.
    ///
    /// # Errors
    /// When one is of another form.
    pub(super) fn take(&mut self, form: LodForm, table: HierarchyTable) -> Result<(), VertexHierarchyError> {
        let is_wrong = |at: &usize| is_cluster_base(table.blobs(*at).next().unwrap_or_default()) != (form == LodForm::Clusters);
        if let Some(at) = (0..table.entries().len()).find(is_wrong) {
            return Err(VertexHierarchyError::Entry { hierarchy: at as u32, problem: "it is of another form than its section" });
        }
        self.set(form, table);
        Ok(())
    }

    /// Those of a form, if there are any.
    pub fn of(&self, form: LodForm) -> Option<&Arc<HierarchyTable>> {
        self.tables[form as usize].as_ref()
    }

    /// Those of a form, or where there are none those of another.
    pub fn preferring(&self, form: LodForm) -> Option<&Arc<HierarchyTable>> {
        self.of(form).or_else(|| LodForm::ALL.into_iter().find_map(|other| self.of(other)))
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        LodForm::ALL.into_iter().all(|form| self.of(form).is_none())
    }
}

/// A hierarchy as far as it is there: the base and the first blocks.
#[derive(Clone, Debug, PartialEq)]
pub enum Hierarchy {
    /// Refined a vertex at a time.
    Vertices(VertexHierarchy),
    /// Refined a group of clusters at a time.
    Clusters(ClusterHierarchy),
}

impl Hierarchy {
    /// Reads and checks a base from outside; `material_count` is how many the scene has.
    ///
    /// # Errors
    /// When the bytes are cut off, or name what is not there.
    pub fn decode_base(bytes: &[u8], material_count: u32) -> Result<Self, VertexHierarchyError> {
        if is_cluster_base(bytes) {
            ClusterHierarchy::decode_base(bytes, material_count).map(Self::Clusters)
        } else {
            VertexHierarchy::decode_base(bytes, material_count).map(Self::Vertices)
        }
    }

    /// Reads and checks the next block from outside, and puts it behind what is there. Where that fails, nothing changes.
    ///
    /// # Errors
    /// As [`VertexHierarchy::decode_block`] and [`ClusterHierarchy::decode_block`].
    pub fn decode_block(&mut self, bytes: &[u8]) -> Result<(), VertexHierarchyError> {
        match self {
            Self::Vertices(hierarchy) => hierarchy.decode_block(bytes),
            Self::Clusters(hierarchy) => hierarchy.decode_block(bytes),
        }
    }

    /// What it takes of memory as far as it is there, bytes.
    pub fn memory_bytes(&self) -> u64 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.memory_bytes(),
            Self::Clusters(hierarchy) => hierarchy.memory_bytes(),
        }
    }

    /// Blocks that are there.
    pub fn block_count(&self) -> u32 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.block_count(),
            Self::Clusters(hierarchy) => hierarchy.block_count(),
        }
    }

    /// Blocks of the whole.
    pub fn block_total(&self) -> u32 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.base().block_count,
            Self::Clusters(hierarchy) => hierarchy.block_total(),
        }
    }

    /// What its triangles look like. One at least.
    pub fn materials(&self) -> &[MaterialId] {
        match self {
            Self::Vertices(hierarchy) => &hierarchy.base().materials,
            Self::Clusters(hierarchy) => hierarchy.materials(),
        }
    }

    /// All vertices that are there.
    pub fn vertices(&self) -> &VertexData {
        match self {
            Self::Vertices(hierarchy) => hierarchy.vertices(),
            Self::Clusters(hierarchy) => hierarchy.vertices(),
        }
    }

    /// What a triangle with this vertex looks like.
    pub fn material(&self, vertex: u32) -> MaterialId {
        let part = self.vertices().parts.get(vertex as usize).copied().unwrap_or(0);
        self.materials()[usize::from(part)]
    }

    /// What encloses whatever is drawn of it.
    pub fn local_aabb(&self) -> Aabb {
        match self {
            Self::Vertices(hierarchy) => hierarchy.local_aabb(),
            Self::Clusters(hierarchy) => hierarchy.local_aabb(),
        }
    }

    /// Triangles once all that is there is refined.
    pub fn triangle_count(&self) -> u32 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.triangle_count(),
            Self::Clusters(hierarchy) => hierarchy.triangle_count(),
        }
    }

    /// The hierarchy, if it is one of vertices.
    pub fn into_vertices(self) -> Option<VertexHierarchy> {
        match self {
            Self::Vertices(hierarchy) => Some(hierarchy),
            Self::Clusters(_) => None,
        }
    }

    /// The hierarchy, if it is one of clusters.
    pub fn into_clusters(self) -> Option<ClusterHierarchy> {
        match self {
            Self::Vertices(_) => None,
            Self::Clusters(hierarchy) => Some(hierarchy),
        }
    }
}
