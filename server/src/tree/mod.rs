//! The trees that the cull walks.

use std::sync::Arc;

use mullion_common::scene::ObjectHierarchy;

/// The object hierarchy in every form that an algorithm walks.
///
/// Cheap to make from a hierarchy that a package holds: both share it.
#[derive(Debug, Default)]
pub struct CullTree {
    hierarchy: Arc<ObjectHierarchy>,
}

impl CullTree {
    /// The tree over a hierarchy.
    pub fn new(hierarchy: Arc<ObjectHierarchy>) -> Self {
        Self { hierarchy }
    }

    /// The object hierarchy, which the paper's algorithms walk.
    pub fn hierarchy(&self) -> &ObjectHierarchy {
        &self.hierarchy
    }
}
