//! Blobs on disk, by hash, so that a node that starts again fetches only what is new. Several nodes of a machine may share a folder.
//!
//! Nothing in it is trusted: an entry whose bytes do not bear its name is dropped. Where the disk fails, a node goes on without.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use mullion_common::scene::ChunkHash;

/// Ends the names of entries that are being written.
const PART: &str = "part";
/// An entry that is being written so long is of a node that died.
const STALE_AFTER: Duration = Duration::from_secs(3600);

/// A folder of blobs.
#[derive(Debug)]
pub struct DiskCache {
    folder: PathBuf,
    cap_bytes: u64,
    /// What all entries take, as far as this node knows: others write, too.
    taken_bytes: AtomicU64,
    parts: AtomicU64,
    has_complained: AtomicBool,
}

/// An entry.
struct Entry {
    path: PathBuf,
    bytes: u64,
    used: SystemTime,
}

impl DiskCache {
    /// The cache in a folder, which is made if it is not there. Entries that were not used for longest go when all take more than
    /// `cap_bytes`.
    ///
    /// # Errors
    /// When the folder cannot be made or read.
    pub fn open(folder: impl Into<PathBuf>, cap_bytes: u64) -> io::Result<Self> {
        let folder = folder.into();
        fs::create_dir_all(&folder)?;
        let cache = Self {
            folder,
            cap_bytes,
            taken_bytes: AtomicU64::new(0),
            parts: AtomicU64::new(0),
            has_complained: AtomicBool::new(false),
        };
        cache.shrink_to(cap_bytes)?;
        Ok(cache)
    }

    /// The blob, if it is here and whole.
    pub fn get(&self, hash: ChunkHash, length: u64) -> Option<Vec<u8>> {
        let path = self.path_of(hash);
        let file = File::open(&path).ok()?; // most often: not here
        let mut bytes = Vec::new();
        // No more than was asked for, whatever stands there.
        let read = (&file).take(length.saturating_add(1)).read_to_end(&mut bytes);
        if read.is_err() || bytes.len() as u64 != length || ChunkHash::of(&bytes) != hash {
            tracing::warn!("{}: damaged, and dropped from the cache", path.display());
            let _ = fs::remove_file(&path); // another node was quicker
            return None;
        }
        let _ = file.set_modified(SystemTime::now()); // it goes a little earlier than it might
        Some(bytes)
    }

    /// Keeps a blob, if its bytes bear its name and it fits. Replaces what is there in one step.
    pub fn put(&self, hash: ChunkHash, bytes: &[u8]) {
        if bytes.len() as u64 > self.cap_bytes || ChunkHash::of(bytes) != hash {
            return;
        }
        if let Err(error) = self.write(&self.path_of(hash), bytes)
            && !self.has_complained.swap(true, Ordering::Relaxed)
        {
            tracing::warn!("{}: cannot keep chunks: {error}; going on without", self.folder.display());
        }
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let folder = path.parent().unwrap_or(&self.folder);
        fs::create_dir_all(folder)?;
        let part = folder.join(format!("{}-{}.{PART}", std::process::id(), self.parts.fetch_add(1, Ordering::Relaxed)));
        let written = File::create(&part).and_then(|mut file| {
            file.write_all(bytes)?;
            file.set_modified(SystemTime::now())
        });
        if let Err(error) = written.and_then(|()| fs::rename(&part, path)) {
            let _ = fs::remove_file(&part); // it may never have been made
            return Err(error);
        }
        let taken = self.taken_bytes.fetch_add(bytes.len() as u64, Ordering::Relaxed) + bytes.len() as u64;
        if taken > self.cap_bytes {
            // A little more than must be, lest every blob looks through the folder.
            self.shrink_to(self.cap_bytes / 10 * 9)?;
        }
        Ok(())
    }

    /// Drops the entries that were not used for longest until the rest take no more than that.
    fn shrink_to(&self, bytes: u64) -> io::Result<()> {
        let mut entries = self.entries()?;
        let mut taken: u64 = entries.iter().map(|entry| entry.bytes).sum();
        entries.sort_by_key(|entry| entry.used);
        for entry in entries {
            if taken <= bytes {
                break;
            }
            match fs::remove_file(&entry.path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => taken -= entry.bytes,
            }
        }
        self.taken_bytes.store(taken, Ordering::Relaxed);
        Ok(())
    }

    /// All entries; removes what nodes that died left half written.
    fn entries(&self) -> io::Result<Vec<Entry>> {
        let mut entries = Vec::new();
        for folder in fs::read_dir(&self.folder)? {
            let folder = folder?.path();
            if !folder.is_dir() {
                continue;
            }
            for file in fs::read_dir(folder)? {
                let file = file?;
                // Another node may have removed it meanwhile.
                let Ok(metadata) = file.metadata() else { continue };
                let (path, used) = (file.path(), metadata.modified()?);
                if path.extension().is_some_and(|extension| extension == PART) {
                    if used.elapsed().is_ok_and(|age| age > STALE_AFTER) {
                        let _ = fs::remove_file(&path); // another node was quicker
                    }
                } else {
                    entries.push(Entry { path, bytes: metadata.len(), used });
                }
            }
        }
        Ok(entries)
    }

    fn path_of(&self, hash: ChunkHash) -> PathBuf {
        let name = hash.to_string();
        self.folder.join(&name[..2]).join(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tempfile::TempDir;

    fn blob(i: u8) -> (ChunkHash, Vec<u8>) {
        let bytes = vec![i; 100];
        (ChunkHash::of(&bytes), bytes)
    }

    fn has(cache: &DiskCache, i: u8) -> bool {
        let (hash, bytes) = blob(i);
        cache.path_of(hash).exists() && cache.get(hash, 100) == Some(bytes)
    }

    #[test]
    fn what_is_put_is_there_for_others_and_later() {
        let folder = TempDir::new().expect("a folder");
        let at = folder.path().join("not/there/yet");
        let cache = DiskCache::open(&at, 1000).expect("a cache");
        let (hash, bytes) = blob(1);
        assert_eq!(cache.get(hash, 100), None);
        cache.put(hash, &bytes);
        cache.put(blob(2).0, &bytes); // not its name
        assert!(has(&cache, 1) && !has(&cache, 2));
        assert!(has(&DiskCache::open(&at, 1000).expect("a cache"), 1));
    }

    #[test]
    fn what_is_damaged_is_dropped() {
        let folder = TempDir::new().expect("a folder");
        let cache = DiskCache::open(folder.path(), 1000).expect("a cache");
        let (hash, bytes) = blob(1);
        for spoil in [&bytes[..99], &[], &[1; 101], &[2; 100]] {
            cache.put(hash, &bytes);
            fs::write(cache.path_of(hash), spoil).expect("spoilt");
            assert_eq!(cache.get(hash, 100), None);
            assert!(!cache.path_of(hash).exists());
        }
        cache.put(hash, &bytes);
        assert_eq!(cache.get(hash, 7), None, "the manifest says another length");
    }

    #[test]
    fn what_was_not_used_for_longest_goes() {
        let folder = TempDir::new().expect("a folder");
        let cache = DiskCache::open(folder.path(), 1000).expect("a cache");
        (0..10).for_each(|i| cache.put(blob(i).0, &blob(i).1));
        assert!((0..10).all(|i| has(&cache, i)));
        assert!(has(&cache, 0), "used last");
        cache.put(blob(10).0, &blob(10).1);
        let left: Vec<u8> = (0..11).filter(|i| has(&cache, *i)).collect();
        assert_eq!(left, [0, 3, 4, 5, 6, 7, 8, 9, 10], "nine tenths");
        let smaller = DiskCache::open(folder.path(), 250).expect("a cache");
        assert_eq!((0..11).filter(|i| has(&smaller, *i)).count(), 2);
        smaller.put(ChunkHash::of(&[7; 300]), &[7; 300]);
        assert_eq!(smaller.get(ChunkHash::of(&[7; 300]), 300), None, "larger than all");
    }

    #[test]
    fn what_a_dead_node_left_half_written_goes_in_time() {
        let folder = TempDir::new().expect("a folder");
        let (old, new) = (folder.path().join("ab/1-0.part"), folder.path().join("ab/2-0.part"));
        fs::create_dir(folder.path().join("ab")).expect("a folder");
        for (path, age) in [(&old, 2 * STALE_AFTER), (&new, Duration::ZERO)] {
            let file = File::create(path).expect("a part");
            file.set_modified(SystemTime::now() - age).expect("its age");
        }
        DiskCache::open(folder.path(), 1000).expect("a cache");
        assert!(!old.exists() && new.exists());
    }

    #[test]
    fn a_folder_that_is_none_is_told() {
        let folder = TempDir::new().expect("a folder");
        let file = folder.path().join("file");
        fs::write(&file, "x").expect("written");
        assert!(DiskCache::open(&file, 1000).is_err());
    }
}
