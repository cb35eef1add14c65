//! Files that exist whole or not at all.
//!
//! A file is written under a temporary name in its own folder, synced, renamed, and the folder is synced:
//! after a power cut either the old state or the new one is there. A failing disk leaves at most a
//! temporary file, which the next opening removes.

use super::Error;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The moments of a write at which a process may die; a test interrupts at each of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// The temporary file exists and holds half of the bytes.
    HalfWritten,
    /// The temporary file is complete but may not be on the disk.
    Written,
    /// The temporary file is on the disk.
    Synced,
    /// The file has its name, which may not be on the disk.
    Renamed,
    /// The file is there for good.
    Placed,
    /// Half of the journal line is written.
    LineTorn,
    /// The journal line is written but may not be on the disk.
    LineWritten,
}

/// Is asked at every [`Moment`]; an error stands for the death of the process.
pub type Interrupt = Box<dyn Fn(Moment) -> std::io::Result<()> + Send + Sync>;

/// Marks temporary files.
const TEMPORARY: &str = ".partial";

/// Writes `bytes` to `path` atomically, making folders as needed.
pub fn place(path: &Path, bytes: &[u8], interrupt: Option<&Interrupt>) -> Result<(), Error> {
    let failed = |e: std::io::Error| Error::write(path, &e);
    let at = |moment| interrupt.map_or(Ok(()), |i| i(moment)).map_err(failed);
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(failed)?;
    let temporary = temporary_name(path);

    let mut file = File::create(&temporary).map_err(failed)?;
    let (first, second) = bytes.split_at(bytes.len() / 2);
    file.write_all(first).map_err(failed)?;
    at(Moment::HalfWritten)?;
    file.write_all(second).map_err(failed)?;
    at(Moment::Written)?;
    file.sync_all().map_err(failed)?;
    at(Moment::Synced)?;
    fs::rename(&temporary, path).map_err(failed)?;
    at(Moment::Renamed)?;
    sync_folder(folder).map_err(failed)?;
    at(Moment::Placed)
}

fn temporary_name(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(TEMPORARY);
    path.with_file_name(name)
}

/// Makes the names in a folder durable.
pub fn sync_folder(folder: &Path) -> std::io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Removes what an interrupted write left behind, in the whole tree below `root`.
pub fn sweep(root: &Path) -> Result<(), Error> {
    let entries = match fs::read_dir(root) {
        Ok(entries) => entries,
        Err(e) => return Err(Error::read(root, &e)),
    };
    for entry in entries {
        let path = entry.map_err(|e| Error::read(root, &e))?.path();
        if path.is_dir() {
            sweep(&path)?;
        } else if path.file_name().is_some_and(|n| n.to_string_lossy().ends_with(TEMPORARY)) {
            fs::remove_file(&path).map_err(|e| Error::write(&path, &e))?;
        }
    }
    Ok(())
}
