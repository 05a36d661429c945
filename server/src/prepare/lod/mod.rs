//! Hierarchies of detail for a package, of vertices or of clusters.
//!
//! For one of vertices each mesh is collapsed, half edge by half edge, to a coarse one (Garland, Heckbert: *Surface
//! Simplification Using Quadric Error Metrics*, 1997), and the collapses in reverse are its hierarchy.
//!
//! ```text
//! leaves ─ source ─→ mesh ─ surface, quadric ─→ collapse (fitness says which may be) ─ order (stretches) ─→ vertices, links ─ bounds ─→ splits
//! ```
//! What a cut of such a hierarchy may show is decided here: a collapse is refused where it would join what was apart, or turn a triangle away
//! from the surface that it stands for. Borders, seams between materials or texture coordinates stay where they are, and so does whatever is
//! no surface: edges of three triangles and more, faces that are there twice. Clusters: [`clusters`].

mod bounds;
mod clusters;
mod collapse;
mod fitness;
mod looks;
mod order;
mod quadric;
mod source;
mod statistics;
mod stretches;
mod surface;

use mullion_common::scene::{
    BaseMesh, BlockParts, ClusterBlock, ClusterHierarchy, HierarchyTable, LodForm, MAX_BLOCK_VERTICES, Package, PackedBounds,
    Split, VertexHierarchy, VertexHierarchyError,
};
use thiserror::Error;

pub use source::{LodMesh, MAX_LOD_TRIANGLES};
pub use statistics::LodStatistics;

use super::ProgressFn;
use collapse::{Collapses, Regions};
use order::Ordered;

/// What is worth a hierarchy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LodOptions {
    /// Objects of fewer triangles have none: they are drawn whole.
    pub least_triangles: u32,
    /// Vertices that are sent together, 1 to [`MAX_BLOCK_VERTICES`], or those of one group of clusters. Fewer: an object sharpens in smaller
    /// steps.
    pub block_vertices: u32,
    /// What meshes are made into.
    pub form: LodForm,
}

impl Default for LodOptions {
    fn default() -> Self {
        Self { least_triangles: 2048, block_vertices: 16_384, form: LodForm::Vertices }
    }
}

/// Why a package got no hierarchies.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum LodError {
    #[error("{found} vertices to a block, allowed are 1 to {MAX_BLOCK_VERTICES}")]
    Block { found: u32 },
    #[error(transparent)]
    Hierarchy(#[from] VertexHierarchyError),
}

/// Puts a hierarchy of the options' form into the package for each mesh that is large enough, in the place of those of this form that it has.
/// The same package and options give the same hierarchies.
///
/// An object has one if all of its leaves are of materials that do not blend; objects with the same leaves share it.
///
/// # Errors
/// For an option out of range.
pub fn add_hierarchies(package: &mut Package, options: &LodOptions, progress: ProgressFn<'_>) -> Result<LodStatistics, LodError> {
    let groups = source::groups(package, options.least_triangles);
    let mut table = HierarchyTable::default();
    let mut statistics = LodStatistics::default();
    const STAGE: &str = "simplifying meshes";
    let total = groups.len() as u64;
    for (done, group) in groups.into_iter().enumerate() {
        progress(STAGE, done as u64, total);
        let Some(mesh) = source::mesh(package, &group) else { continue };
        let mut blobs = Vec::new();
        match options.form {
            LodForm::Vertices => {
                let (base, blocks) = simplify(&mesh, options, Regions::default())?;
                statistics.add(&base, &blocks);
                blobs.push(base.encode());
                blobs.extend(blocks.iter().map(BlockParts::encode));
            }
            LodForm::Clusters => {
                options.check()?;
                let (base, blocks) = clusters::clustered(&mesh, options.block_vertices);
                statistics.add_clusters(&base, &blocks);
                blobs.push(base.encode());
                blobs.extend(blocks.iter().map(ClusterBlock::encode));
            }
        }
        table.push(group.objects, &blobs);
    }
    progress(STAGE, total, total);
    package.scene.hierarchies.set(options.form, table);
    Ok(statistics)
}

/// The hierarchy of one mesh, whole and checked.
///
/// # Errors
/// For an option out of range.
pub fn vertex_hierarchy(mesh: &LodMesh, options: &LodOptions) -> Result<VertexHierarchy, LodError> {
    joined(simplify(mesh, options, Regions::default())?)
}

/// The cluster hierarchy of one mesh, whole and checked.
///
/// # Errors
/// For an option out of range, and where the mesh has more clusters than a hierarchy.
pub fn cluster_hierarchy(mesh: &LodMesh, options: &LodOptions) -> Result<ClusterHierarchy, LodError> {
    options.check()?;
    let (base, blocks) = clusters::clustered(mesh, options.block_vertices);
    let mut hierarchy = ClusterHierarchy::new(base)?;
    blocks.into_iter().try_for_each(|block| hierarchy.append(block))?;
    Ok(hierarchy)
}

impl LodOptions {
    fn check(&self) -> Result<(), LodError> {
        let found = self.block_vertices;
        if (1..=MAX_BLOCK_VERTICES).contains(&found) { Ok(()) } else { Err(LodError::Block { found }) }
    }
}

fn joined((base, blocks): (BaseMesh, Vec<BlockParts>)) -> Result<VertexHierarchy, LodError> {
    let mut hierarchy = VertexHierarchy::new(base)?;
    blocks.into_iter().try_for_each(|block| hierarchy.append(block))?;
    Ok(hierarchy)
}

fn simplify(mesh: &LodMesh, options: &LodOptions, regions: Regions) -> Result<(BaseMesh, Vec<BlockParts>), LodError> {
    options.check()?;
    let collapses = Collapses::of(mesh, regions);
    let ordered = Ordered::new(mesh, &collapses);
    drop(collapses);
    let bounds = bounds::node_bounds(mesh, &ordered);
    Ok(blocks(mesh, &ordered, &bounds, options.block_vertices))
}

/// The base, and the other vertices in blocks: never between two that split together.
fn blocks(mesh: &LodMesh, ordered: &Ordered, bounds: &[PackedBounds], block_vertices: u32) -> (BaseMesh, Vec<BlockParts>) {
    let base_count = ordered.base_count;
    let total = ordered.source.len() as u32;
    let mut blocks = Vec::new();
    let mut first = base_count;
    while first < total {
        let mut end = (first + block_vertices).min(total);
        while end < total && ordered.head(end).is_follower {
            end += 1;
        }
        let splits = (first..end).map(|v| {
            let head = ordered.head(v);
            Split::new(bounds[(v - base_count) as usize], head.length, head.shape, head.is_follower)
        });
        blocks.push(BlockParts {
            first,
            vertices: mesh.vertex_data(&ordered.source[first as usize..end as usize]),
            splits: splits.collect(),
            links: ordered.links_of(first..end).to_vec(),
        });
        first = end;
    }
    let (local_min, local_max) = mesh.bounds();
    let base = BaseMesh {
        vertices: mesh.vertex_data(&ordered.source[..base_count as usize]),
        triangles: ordered.base_triangles.clone(),
        materials: mesh.materials.clone(),
        attributes: mesh.attributes(),
        vertex_total: total,
        triangle_total: mesh.triangles.len() as u32,
        block_count: blocks.len() as u32,
        local_min: local_min.to_array(),
        local_max: local_max.to_array(),
    };
    (base, blocks)
}

#[cfg(test)]
mod tests;
