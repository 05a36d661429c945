//! From a glTF file to a package: objects, leaves of bounded size, chunks, and the object hierarchy.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use mullion_common::scene::{MAX_PACKAGE_BYTES, Package, PackageError};
use thiserror::Error;

mod assemble;
pub mod bounded;
mod chunks;
mod divide;
pub mod gltf;
mod graft;
mod hierarchy;
pub mod lod;
pub mod plp;
mod refine;
mod statistics;

pub use assemble::prepare;
pub use graft::{GraftError, Placement, graft};
pub use statistics::{SceneStatistics, scene_bounds, statistics};

/// Told how far a stage has come: its name, steps done, steps in all. Called from several threads.
pub type ProgressFn<'a> = &'a (dyn Fn(&'static str, u64, u64) + Sync);

/// Greatest choice for [`PrepareOptions::max_leaf_triangles`]: every triangle may bring three vertices of its own,
/// and a chunk's indices are 16 bits wide.
pub const MAX_LEAF_TRIANGLES: u32 = 21_845;

/// How a scene is prepared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrepareOptions {
    /// Larger meshes are divided into leaves of at most so many triangles, 1 to [`MAX_LEAF_TRIANGLES`]. Smaller
    /// leaves cull more finely and cost more draws.
    pub max_leaf_triangles: u32,
    /// Triangles with an edge longer than this, in metres of the world, are cut at the middle of the edge until
    /// none is: for floors that span the scene. None by default: no triangle is cut.
    pub split_larger_than_m: Option<f64>,
}

impl Default for PrepareOptions {
    fn default() -> Self {
        Self { max_leaf_triangles: 4096, split_larger_than_m: None }
    }
}

/// Why a scene could not be prepared.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum PrepareError {
    #[error(transparent)]
    Import(#[from] gltf::ImportError),
    #[error("{file}: {error}")]
    Package { file: String, error: PackageError },
    #[error("{file}: {error}")]
    Io { file: String, error: io::Error },
    #[error("node {node}: its transform in the world is not finite")]
    Transform { node: u32 },
    #[error("more than {cap} {what}")]
    TooMany { what: &'static str, cap: u64 },
}

/// A scene ready to be served, and what the file's author should know.
pub struct Prepared {
    /// The scene.
    pub package: Package,
    /// What was left out or replaced, a line each.
    pub warnings: Vec<String>,
}

/// Opens a scene: a package as it is, a glTF or GLB prepared on the way.
///
/// # Errors
/// When the file cannot be read or holds no scene.
pub fn open(path: &Path, options: &PrepareOptions, progress: ProgressFn<'_>) -> Result<Prepared, PrepareError> {
    const MAGIC_BYTES: u64 = 8;
    let io_error = |error| PrepareError::Io { file: path.display().to_string(), error };
    let start = bounded::read_start(path, MAGIC_BYTES, MAX_PACKAGE_BYTES).map_err(io_error)?;
    if Package::has_magic(&start) {
        let bytes = bounded::read(path, MAX_PACKAGE_BYTES).map_err(io_error)?;
        let package = Package::read(&bytes).map_err(|error| PrepareError::Package { file: path.display().to_string(), error })?;
        let mut warnings = Vec::new();
        if *options != PrepareOptions::default() {
            warnings.push(format!("{}: is prepared already; the choices of preparation are not used", path.display()));
        }
        return Ok(Prepared { package, warnings });
    }
    prepare(gltf::load(path, progress)?, options, progress)
}

/// Writes a package to a file, which appears whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_package(package: &Package, path: &Path) -> Result<(), PrepareError> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".part");
    let partial = Path::new(&partial);
    let write = || -> io::Result<()> {
        let mut out = BufWriter::new(fs::File::create(partial)?);
        package.write_to(&mut out)?;
        out.flush()?;
        fs::rename(partial, path)
    };
    write().map_err(|error| {
        let _ = fs::remove_file(partial); // what is there is of no use
        PrepareError::Io { file: path.display().to_string(), error }
    })
}
