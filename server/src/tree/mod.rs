//! The trees that the cull walks.

mod build;
mod file;
pub(crate) mod regroup;
mod wide;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use mullion_common::scene::ObjectHierarchy;

pub use build::hierarchy_over;
pub use file::FileTree;
pub use wide::{LANES, WideNode, WideTree};

/// The object hierarchy in every form that an algorithm walks.
///
/// Shares the hierarchy with the package that holds it.
#[derive(Debug, Default)]
pub struct CullTree {
    hierarchy: Arc<ObjectHierarchy>,
    wide: Arc<WideTree>,
    stamp: u64,
}

/// Stamps given so far.
static STAMPS: AtomicU64 = AtomicU64::new(1);

impl CullTree {
    /// The tree over a hierarchy.
    pub fn new(hierarchy: Arc<ObjectHierarchy>) -> Self {
        let wide = Arc::new(WideTree::new(&hierarchy));
        Self { hierarchy, wide, stamp: STAMPS.fetch_add(1, Ordering::Relaxed) }
    }

    /// The object hierarchy, which the paper's algorithms walk.
    pub fn hierarchy(&self) -> &ObjectHierarchy {
        &self.hierarchy
    }

    /// Never the same for two trees, nor for one before and after an edit.
    pub(crate) fn stamp(&self) -> u64 {
        self.stamp
    }

    /// Both forms, for a thread of its own.
    pub(crate) fn shared(&self) -> (Arc<ObjectHierarchy>, Arc<WideTree>) {
        (Arc::clone(&self.hierarchy), Arc::clone(&self.wide))
    }

    /// The same as wide nodes, which the sweep walks.
    pub fn wide(&self) -> &WideTree {
        &self.wide
    }
}
