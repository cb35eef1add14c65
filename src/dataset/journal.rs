//! An append-only journal: the truth about one side of a dataset.
//!
//! One JSON document a line. A line counts when it is complete; the last one may be torn by a power cut
//! and is then cut off when the journal is opened for writing. A capture that was done again has
//! several lines: the last one holds.

use super::Error;
use super::atomic::{Interrupt, Moment, sync_folder};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A stored file and its sum.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredFile {
    /// Path relative to the dataset.
    pub path: String,
    /// BLAKE3 in hex.
    pub blake3: String,
    /// Length in bytes.
    pub bytes: u64,
}

/// One line: a capture, its files, what is known about it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line<R> {
    /// Index in the trajectory.
    pub capture: u32,
    /// Its files, in a fixed order.
    pub files: Vec<StoredFile>,
    /// What is known.
    pub record: R,
}

/// A journal and what it says.
#[derive(Debug)]
pub struct Journal<R> {
    path: PathBuf,
    file: Option<File>,
    lines: BTreeMap<u32, Line<R>>,
}

impl<R: Serialize + DeserializeOwned + Clone> Journal<R> {
    /// Reads a journal; a missing one is empty. Writing needs [`Journal::open`].
    pub fn read(path: &Path) -> Result<Self, Error> {
        let (lines, _) = parse(path)?;
        Ok(Self { path: path.to_owned(), file: None, lines })
    }

    /// Opens a journal for appending, cutting off a torn last line.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let failed = |e: std::io::Error| Error::write(path, &e);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(failed)?;
        }
        let (lines, whole) = parse(path)?;
        let mut file =
            OpenOptions::new().create(true).truncate(false).write(true).open(path).map_err(failed)?;
        file.set_len(whole).map_err(failed)?;
        file.seek(SeekFrom::End(0)).map_err(failed)?;
        file.sync_all().map_err(failed)?;
        sync_folder(path.parent().unwrap_or(Path::new("."))).map_err(failed)?;
        Ok(Self { path: path.to_owned(), file: Some(file), lines })
    }

    /// Appends a line and makes it durable. When this fails nothing of the line remains.
    pub fn append(&mut self, line: Line<R>, interrupt: Option<&Interrupt>) -> Result<(), Error> {
        let mut text = serde_json::to_vec(&line)
            .map_err(|e| Error::Encode { what: "journal line", why: e.to_string() })?;
        text.push(b'\n');
        let path = self.path.clone();
        let failed = |e: std::io::Error| Error::write(&path, &e);
        let file = self.file.as_mut().ok_or_else(|| Error::ReadOnly { path: path.clone() })?;
        let before = file.stream_position().map_err(failed)?;
        let written = (|| {
            let at = |moment| interrupt.map_or(Ok(()), |i| i(moment));
            let (first, second) = text.split_at(text.len() / 2);
            file.write_all(first)?;
            at(Moment::LineTorn)?;
            file.write_all(second)?;
            at(Moment::LineWritten)?;
            file.sync_data()
        })();
        if let Err(e) = written {
            if interrupt.is_none() {
                // A full disk leaves half a line: take it back, so that the journal stays readable.
                let _ = file.set_len(before);
                let _ = file.seek(SeekFrom::Start(before));
            }
            return Err(failed(e));
        }
        self.lines.insert(line.capture, line);
        Ok(())
    }

    /// What holds, by capture.
    pub fn lines(&self) -> &BTreeMap<u32, Line<R>> {
        &self.lines
    }

    /// Forgets a capture in memory, so that it is done again; the journal keeps its line.
    pub fn forget(&mut self, capture: u32) {
        self.lines.remove(&capture);
    }
}

type Lines<R> = BTreeMap<u32, Line<R>>;

/// The complete lines of a journal, and how many bytes they take.
fn parse<R: DeserializeOwned>(path: &Path) -> Result<(Lines<R>, u64), Error> {
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok((BTreeMap::new(), 0)),
        Err(e) => return Err(Error::read(path, &e)),
    };
    let mut lines = BTreeMap::new();
    let mut whole = 0;
    for (number, text) in bytes.split_inclusive(|b| *b == b'\n').enumerate() {
        if !text.ends_with(b"\n") {
            break;
        }
        let line: Line<R> = serde_json::from_slice(text).map_err(|e| Error::Journal {
            path: path.to_owned(),
            line: number + 1,
            why: e.to_string(),
        })?;
        lines.insert(line.capture, line);
        whole += text.len() as u64;
    }
    Ok((lines, whole))
}
