//! A folder of files, each named by the hash of everything its content follows from.
//!
//! A file carries its own sum, is written beside its place and then renamed, so a torn or altered file is noticed, told, and
//! made anew. Failing to write is told, too, and costs nothing but the time of the next run. What was not used for longest
//! makes room for what is new.

use std::fs::OpenOptions;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

/// What a folder holds.
#[derive(Debug, PartialEq, Eq)]
pub struct Kind {
    /// Begins every file: the kind and the version of its format.
    pub magic: [u8; 16],
    /// One of them, for people.
    pub what: &'static str,
    /// Most that the folder holds, bytes.
    pub most_bytes: u64,
}

/// A folder of files of one kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Store {
    folder: PathBuf,
    kind: &'static Kind,
}

impl Store {
    /// In a folder, which is made when something is to be kept.
    pub fn new(folder: impl Into<PathBuf>, kind: &'static Kind) -> Self {
        Self { folder: folder.into(), kind }
    }

    /// Takes from the folder what `decode` finds in the file of that key; what it finds nothing in is told.
    pub fn take<T>(&self, key: &[u8; 32], decode: impl FnOnce(&[u8]) -> Option<T>) -> Option<T> {
        let path = self.path(key);
        match read(&path, &self.kind.magic, key) {
            Ok(content) => match decode(&content?) {
                Some(found) => {
                    touch(&path);
                    return Some(found);
                }
                None => {
                    tracing::warn!("{} does not fit its {}; it is made anew", path.display(), self.kind.what)
                }
            },
            Err(e) => tracing::warn!("{} cannot be used ({e}); it is made anew", path.display()),
        }
        None
    }

    /// Keeps something for later runs.
    pub fn keep(&self, key: &[u8; 32], content: &[u8]) {
        let path = self.path(key);
        if let Err(e) = write(&path, &self.kind.magic, key, content) {
            tracing::warn!(
                "the prepared {} cannot be kept in {} ({e}); the next run prepares it again",
                self.kind.what,
                path.display()
            );
        }
        prune(&self.folder, &path, self.kind.most_bytes);
    }

    fn path(&self, key: &[u8; 32]) -> PathBuf {
        self.folder.join(format!("{}.bin", blake3::Hash::from(*key).to_hex()))
    }
}

/// Marks a file as used now. Where that fails it merely seems older than it is.
fn touch(path: &Path) {
    if let Ok(file) = OpenOptions::new().append(true).open(path) {
        drop(file.set_modified(SystemTime::now()));
    }
}

/// Removes files, the oldest first, until the rest and `kept` have at most so many bytes together.
fn prune(folder: &Path, kept: &Path, most: u64) {
    let ours = |path: &Path| path.extension().is_some_and(|e| e == "bin" || e == "tmp");
    let mut files: Vec<(SystemTime, u64, PathBuf)> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| ours(&entry.path()))
        .filter_map(|entry| {
            let about = entry.metadata().ok().filter(std::fs::Metadata::is_file)?;
            Some((about.modified().ok()?, about.len(), entry.path()))
        })
        .collect();
    files.sort();
    let mut total: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
    for (_, bytes, path) in files.iter().filter(|(_, _, path)| path != kept) {
        if total <= most {
            return;
        }
        match std::fs::remove_file(path) {
            Ok(()) => total -= bytes,
            // Another process may have made room meanwhile.
            Err(e) => tracing::debug!("{} cannot be removed: {e}", path.display()),
        }
    }
}

/// The content of a file; None when there is none.
fn read(path: &Path, magic: &[u8; 16], key: &[u8; 32]) -> io::Result<Option<Vec<u8>>> {
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(e),
    };
    let fault = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    let rest = bytes.strip_prefix(magic).ok_or_else(|| fault("it has another format"))?;
    let rest = rest.strip_prefix(key).ok_or_else(|| fault("it belongs to something else"))?;
    let (sum, content) = rest.split_at_checked(32).ok_or_else(|| fault("it is cut short"))?;
    if blake3::hash(content).as_bytes() != sum {
        return Err(fault("it is cut short or altered"));
    }
    Ok(Some(content.to_vec()))
}

/// Writes beside the place, then renames: readers see all or nothing.
fn write(path: &Path, magic: &[u8; 16], key: &[u8; 32], content: &[u8]) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    static WRITTEN: AtomicU64 = AtomicU64::new(0);
    let number = WRITTEN.fetch_add(1, Ordering::Relaxed);
    let beside = path.with_extension(format!("{}-{number}.tmp", std::process::id()));
    let mut bytes = Vec::with_capacity(80 + content.len());
    for part in [magic.as_slice(), key, blake3::hash(content).as_bytes(), content] {
        bytes.extend_from_slice(part);
    }
    let written = std::fs::write(&beside, bytes).and_then(|()| std::fs::rename(&beside, path));
    if written.is_err() {
        // What is left beside is of no use to anybody; that it cannot be removed either changes nothing.
        drop(std::fs::remove_file(&beside));
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn what_was_not_used_for_longest_makes_room_and_what_is_not_ours_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let long_ago = SystemTime::now() - Duration::from_secs(1000);
        for (age, name) in ["a.bin", "b.bin", "c.1.tmp", "d.bin", "notes.txt"].into_iter().enumerate() {
            std::fs::write(at(name), [0; 100]).unwrap();
            let file = OpenOptions::new().append(true).open(at(name)).unwrap();
            file.set_modified(long_ago + Duration::from_secs(age as u64)).unwrap();
        }
        let left = || {
            let names = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name());
            let mut names: Vec<String> = names.map(|n| n.into_string().unwrap()).collect();
            names.sort();
            names
        };
        prune(folder.path(), &at("d.bin"), 400);
        assert_eq!(left().len(), 5);
        touch(&at("a.bin"));
        prune(folder.path(), &at("d.bin"), 200);
        assert_eq!(left(), ["a.bin", "d.bin", "notes.txt"]);
        // What was just written stays, however large.
        prune(folder.path(), &at("d.bin"), 1);
        assert_eq!(left(), ["d.bin", "notes.txt"]);
    }
}
