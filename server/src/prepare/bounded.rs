//! Files from outside: regular ones, of bounded size.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// Reads the first `wanted` bytes of a file, or all where it is shorter.
///
/// # Errors
/// When it cannot be read, is no regular file (opening a pipe would wait for ever), or has more than `cap` bytes.
pub fn read_start(path: &Path, wanted: u64, cap: u64) -> io::Result<Vec<u8>> {
    // Asked before it is opened: opening a pipe already waits.
    let metadata = fs::metadata(path)?;
    let refuse = |reason: String| Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
    if metadata.is_dir() {
        return refuse("is a directory".to_owned());
    }
    if !metadata.is_file() {
        return refuse("is no regular file".to_owned());
    }
    if metadata.len() > cap {
        return refuse(format!("has {} bytes, at most {cap} are read", metadata.len()));
    }
    let mut bytes = Vec::with_capacity(metadata.len().min(wanted) as usize);
    File::open(path)?.take(wanted.min(cap)).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a whole file. See [`read_start`].
///
/// # Errors
/// As [`read_start`].
pub fn read(path: &Path, cap: u64) -> io::Result<Vec<u8>> {
    read_start(path, cap, cap)
}
