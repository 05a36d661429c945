//! Packages on the master's disk that may be inserted into a running show.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use mullion_common::scene::{ChunkHash, MAX_PACKAGE_BYTES, Package, PackageError, SectionKind};
use mullion_common::wire::{Insertion, MAX_PACKAGE_NAME_BYTES};
use thiserror::Error;

use crate::prepare::bounded;

/// A folder of packages, known by their files' names.
#[derive(Clone, Debug)]
pub struct Library {
    folder: PathBuf,
}

/// Why a package is not there.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum LibraryError {
    #[error("package {0:?}: not a name; give that of a file in the library, without a folder")]
    Name(String),
    #[error("package {name:?}: {error}")]
    Io { name: String, error: io::Error },
    #[error("package {name:?}: {error}")]
    Package { name: String, error: PackageError },
    #[error("package {name:?} is another one than was inserted")]
    Another { name: String },
}

impl Library {
    /// The packages of a folder, whatever is in it.
    ///
    /// # Errors
    /// When there is no such folder.
    pub fn open(folder: &Path) -> io::Result<Self> {
        if fs::metadata(folder)?.is_dir() {
            Ok(Self { folder: folder.to_owned() })
        } else {
            Err(io::Error::new(io::ErrorKind::NotADirectory, "is no folder"))
        }
    }

    /// Reads a package.
    ///
    /// # Errors
    /// When the name is none, or the file is no package.
    pub fn read(&self, name: &str) -> Result<Package, LibraryError> {
        check_name(name)?;
        let bytes = bounded::read(&self.folder.join(name), MAX_PACKAGE_BYTES)
            .map_err(|error| LibraryError::Io { name: name.to_owned(), error })?;
        Package::read(&bytes).map_err(|error| LibraryError::Package { name: name.to_owned(), error })
    }

    /// Reads the package of an insertion.
    ///
    /// # Errors
    /// As [`Library::read`], and when it is another one than was inserted.
    pub fn inserted(&self, insertion: &Insertion) -> Result<Package, LibraryError> {
        let name = &insertion.package;
        let package = self.read(name)?;
        let hash = content_hash(&package).map_err(|error| LibraryError::Package { name: name.clone(), error })?;
        if hash == insertion.hash { Ok(package) } else { Err(LibraryError::Another { name: name.clone() }) }
    }
}

/// Whether a name is that of a file in the folder itself, on every system.
///
/// # Errors
/// When it is none.
pub fn check_name(name: &str) -> Result<(), LibraryError> {
    let is_plain = !name.contains(['/', '\\', ':']) && !name.chars().any(char::is_control);
    if is_plain && !matches!(name, "" | "." | "..") && name.len() <= MAX_PACKAGE_NAME_BYTES {
        Ok(())
    } else {
        Err(LibraryError::Name(name.chars().take(64).collect()))
    }
}

/// Says whether two packages hold the same: made of their tables' hashes, and those name the chunks.
///
/// # Errors
/// Never for a checked package.
pub fn content_hash(package: &Package) -> Result<ChunkHash, PackageError> {
    use SectionKind as K;
    let mut hashes = Vec::new();
    for kind in [K::Hierarchy, K::Objects, K::Transforms, K::Leaves, K::Materials, K::Chunks] {
        hashes.extend_from_slice(&ChunkHash::of(&package.scene.section_bytes(kind)?).0);
    }
    Ok(ChunkHash::of(&hashes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_nowhere_else() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("inside");
        fs::create_dir(&inside).unwrap();
        let mut bytes = Vec::new();
        Package::default().write_to(&mut bytes).unwrap();
        for path in [inside.join("chair.mullion"), folder.path().join("secret.mullion")] {
            fs::write(path, &bytes).unwrap();
        }
        fs::write(inside.join("text"), "no package").unwrap();
        let library = Library::open(&inside).unwrap();
        assert_eq!(library.read("chair.mullion").unwrap(), Package::default());
        let absolute = folder.path().join("secret.mullion").display().to_string();
        let long = "x".repeat(MAX_PACKAGE_NAME_BYTES + 1);
        for name in ["", ".", "..", "../secret.mullion", "..\\secret.mullion", "a/b", "c:d", "new\nline", &absolute, &long] {
            assert!(matches!(library.read(name), Err(LibraryError::Name(_))), "{name}");
        }
        assert!(matches!(library.read("none.mullion"), Err(LibraryError::Io { .. })));
        assert!(matches!(library.read("text"), Err(LibraryError::Package { .. })));
        assert!(Library::open(&inside.join("text")).is_err());
    }
}
