//! `captures.jsonl`: a line is there as soon as its capture is, and in the end they are in order.

use super::SimulateError;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What was simulated and what failed, written by several walkers.
pub(super) struct Account {
    path: PathBuf,
    books: Mutex<Books>,
}

struct Books {
    file: std::fs::File,
    lines: BTreeMap<u32, String>,
    failed: usize,
    failure: Option<SimulateError>,
}

/// How a capture ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ended {
    Simulated,
    Failed,
}

impl Account {
    pub fn begin(path: &Path) -> Result<Self, SimulateError> {
        let file = std::fs::File::create(path).map_err(|e| unwritten(path, &e))?;
        let books = Books { file, lines: BTreeMap::new(), failed: 0, failure: None };
        Ok(Self { path: path.to_owned(), books: Mutex::new(books) })
    }

    pub fn add(&self, capture: u32, ended: Ended, line: String) -> Result<(), SimulateError> {
        let mut books = self.books();
        writeln!(books.file, "{line}").map_err(|e| unwritten(&self.path, &e))?;
        books.lines.insert(capture, line);
        books.failed += usize::from(ended == Ended::Failed);
        Ok(())
    }

    /// Notes what ended the work. The first is kept: what others fail of follows from it.
    pub fn fail(&self, error: SimulateError) {
        self.books().failure.get_or_insert(error);
    }

    /// Puts the lines in the order of the plan, which readers expect. Answers how many captures were simulated, and
    /// how many failed.
    pub fn close(self) -> Result<(usize, usize), SimulateError> {
        let books = self.books.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some(failure) = books.failure {
            return Err(failure);
        }
        let text: String = books.lines.values().flat_map(|line| [line.as_str(), "\n"]).collect();
        crate::dataset::atomic::place(&self.path, text.as_bytes(), None).map_err(SimulateError::Dataset)?;
        Ok((books.lines.len() - books.failed, books.failed))
    }

    fn books(&self) -> MutexGuard<'_, Books> {
        // Whoever panicked leaves whole lines behind.
        self.books.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

pub(super) fn unwritten(path: &Path, error: &std::io::Error) -> SimulateError {
    SimulateError::Write { path: path.to_owned(), why: error.to_string() }
}
