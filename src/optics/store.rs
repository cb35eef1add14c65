//! Where what a sensor needs once is kept between runs: a folder of files, one a sensor.
//!
//! The optics read no environment and no configuration: whoever puts the program together (`assemble`) says which
//! folder, or none. A file is named by the hash of everything its content follows from; it carries its own sum, is written
//! beside its place and then renamed, so a torn or altered file is noticed, told, and made anew. Failing to write is told,
//! too, and costs nothing but the time of the next run.

use super::fast::Precomputed;
use super::{Error, Scene};
use std::io;
use std::path::{Path, PathBuf};

/// A folder of prepared sensors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Store {
    folder: PathBuf,
}

/// Of every file.
const MAGIC: &[u8; 16] = b"twinrig optics 1";

impl Store {
    /// In a folder, which is made when something is to be kept.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// Takes the sensor from the folder, or prepares it and keeps it; and whether it was there.
    ///
    /// # Errors
    /// When the scene is none for the fast mode.
    pub fn prepare(&self, untouched: &Scene) -> Result<(Precomputed, bool), Error> {
        let key = Precomputed::key(untouched);
        let path = self.folder.join(format!("{}.bin", blake3::Hash::from(key).to_hex()));
        match read(&path, &key) {
            Ok(Some(content)) => match Precomputed::decode(untouched, &content)? {
                Some(once) => return Ok((once, true)),
                None => tracing::warn!("{} does not fit its sensor; it is made anew", path.display()),
            },
            Ok(None) => {}
            Err(e) => tracing::warn!("{} cannot be used ({e}); it is made anew", path.display()),
        }
        let once = Precomputed::new(untouched)?;
        if let Err(e) = write(&path, &key, &once.encode()) {
            tracing::warn!(
                "the prepared sensor cannot be kept in {} ({e}); the next run prepares it again",
                path.display()
            );
        }
        Ok((once, false))
    }
}

/// The content of a file; None when there is none.
fn read(path: &Path, key: &[u8; 32]) -> io::Result<Option<Vec<u8>>> {
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(e),
    };
    let fault = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| fault("it has another format"))?;
    let rest = rest.strip_prefix(key).ok_or_else(|| fault("it belongs to another sensor"))?;
    let (sum, content) = rest.split_at_checked(32).ok_or_else(|| fault("it is cut short"))?;
    if blake3::hash(content).as_bytes() != sum {
        return Err(fault("it is cut short or altered"));
    }
    Ok(Some(content.to_vec()))
}

/// Writes beside the place, then renames: readers see all or nothing.
fn write(path: &Path, key: &[u8; 32], content: &[u8]) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let beside = path.with_extension(format!("{}.tmp", std::process::id()));
    let mut bytes = Vec::with_capacity(80 + content.len());
    for part in [MAGIC.as_slice(), key, blake3::hash(content).as_bytes(), content] {
        bytes.extend_from_slice(part);
    }
    let written = std::fs::write(&beside, bytes).and_then(|()| std::fs::rename(&beside, path));
    if written.is_err() {
        // What is left beside is of no use to anybody; that it cannot be removed either changes nothing.
        drop(std::fs::remove_file(&beside));
    }
    written
}
