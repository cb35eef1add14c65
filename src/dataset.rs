//! Datasets on disk: what is written, in which order, and what may be believed after a power cut.
//!
//! ```text
//! DIR/dataset.json                      provenance, written once
//! DIR/trajectory.json                   the trajectory both sides followed
//! DIR/journal/{real,sim,sessions}.ndjson append-only truth
//! DIR/data/<split>/{real,sim,contact}/NNNNNN.png, depth/NNNNNN.tiff
//! DIR/data/<split>/metadata.parquet     rebuilt from the journals, one row per pair
//! DIR/background/                       untouched sensor and touch-off frames, never rows
//! DIR/README.md, MANIFEST.blake3, report.html
//! ```
//!
//! *Order.* A capture's files are placed atomically ([`atomic`]), then its line is appended to the journal of
//! its side and synced ([`journal`]). A capture exists when its line does and its files have the sums the line
//! gives; a pair exists when both sides do. A process killed at any instant loses at most the capture in flight.
//!
//! *Sides.* Real and simulated captures have journals of their own, so that the twin may run ahead or behind,
//! and so that simulating again never touches a real file.
//!
//! What this module does not do: encode pictures, compare them, or know a device.

pub mod atomic;
pub mod card;
pub mod columns;
pub mod depth;
pub mod journal;
pub mod provenance;
pub mod record;
pub mod table;
pub mod verify;

pub use journal::{Line, StoredFile};
pub use provenance::{Provenance, SCHEMA};
pub use record::{AxisRecord, ImageScores, PairMetrics, RealRecord, SimRecord};
pub use verify::{Finding, Verification};

use crate::motion::Trajectory;
use atomic::{Interrupt, place};
use journal::Journal;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Why a dataset could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The system refused to write.
    #[error(
        "cannot write {path}: {why}; nothing that was stored is lost: make room or mend permissions and resume, or choose another folder"
    )]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        why: String,
    },
    /// No room is left.
    #[error(
        "the disk is full: {path} could not be written. What was stored before is whole; free some space (`twinrig check RIG PLAN` says how much a plan needs) and run the same command with --resume"
    )]
    DiskFull {
        /// The file or folder.
        path: PathBuf,
    },
    /// The system refused to read.
    #[error("cannot read {path}: {why}; check the path and its permissions")]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        why: String,
    },
    /// A complete journal line is not what it should be.
    #[error(
        "{path} line {line} is damaged: {why}; restore the file from a backup, or move the dataset aside and collect again"
    )]
    Journal {
        /// The journal.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// What is wrong.
        why: String,
    },
    /// Something could not be encoded.
    #[error("a {what} could not be encoded: {why}")]
    Encode {
        /// What.
        what: &'static str,
        /// Why.
        why: String,
    },
    /// A stored file could not be decoded.
    #[error(
        "{path} cannot be decoded: {why}; `twinrig verify` tells what else is damaged, `collect --resume` does it again"
    )]
    Decode {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// What says to what the dataset belongs cannot be read.
    #[error(
        "{path} is damaged: {why}; restore it from a copy (its text names rig, plan and simulation, so it cannot be made again), or move the folder aside and collect anew; the pictures in it are as they were"
    )]
    Head {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// The folder holds something already.
    #[error("{path} already holds a dataset; add --resume to continue it, or choose another --out")]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// The folder holds something that is no dataset.
    #[error("{path} is not empty and holds no dataset; choose another --out")]
    NotADataset {
        /// The folder.
        path: PathBuf,
    },
    /// There is no dataset.
    #[error("{path} holds no dataset (no dataset.json); check the path")]
    Missing {
        /// The folder.
        path: PathBuf,
    },
    /// The dataset was begun with something else.
    #[error(
        "{dataset} was begun with {what}: {how}; use the files and --set it was begun with (dataset.json holds them verbatim) or choose another --out"
    )]
    Belongs {
        /// The folder.
        dataset: PathBuf,
        /// What differs.
        what: &'static str,
        /// Which names or keys, what they were and what they are now.
        how: String,
    },
    /// Another process writes.
    #[error("{path} is being written by another process; wait for it or stop it")]
    Locked {
        /// The folder.
        path: PathBuf,
    },
    /// Opened for reading only.
    #[error("{path} was opened for reading only")]
    ReadOnly {
        /// The journal.
        path: PathBuf,
    },
}

impl Error {
    fn write(path: &Path, e: &std::io::Error) -> Self {
        let path = path.to_owned();
        match e.kind() {
            std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => Error::DiskFull { path },
            _ => Error::Write { path, why: e.to_string() },
        }
    }

    fn read(path: &Path, e: &std::io::Error) -> Self {
        Error::Read { path: path.to_owned(), why: e.to_string() }
    }
}

/// A dataset open for writing or reading.
pub struct Dataset {
    root: PathBuf,
    provenance: Provenance,
    trajectory: Trajectory,
    real: Mutex<Journal<RealRecord>>,
    sim: Mutex<Journal<SimRecord>>,
    interrupt: Option<Interrupt>,
    _lock: Option<File>,
}

impl std::fmt::Debug for Dataset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Dataset({})", self.root.display())
    }
}

/// A capture of which both sides are there (or the one side a one-sided dataset has).
#[derive(Debug, Clone)]
pub struct Row {
    /// Index in the trajectory.
    pub capture: u32,
    /// The real side.
    pub real: Option<Line<RealRecord>>,
    /// The simulated side.
    pub sim: Option<Line<SimRecord>>,
}

impl Dataset {
    /// Begins a dataset in a folder that is empty or does not exist.
    pub fn create(root: &Path, provenance: Provenance, trajectory: &Trajectory) -> Result<Dataset, Error> {
        let holds_nothing = || Self::open(root).is_ok_and(|dataset| dataset.holds_nothing());
        if root.join("dataset.json").exists() {
            if !holds_nothing() {
                return Err(Error::Exists { path: root.to_owned() });
            }
            return Self::begin_anew(root, provenance, trajectory);
        }
        std::fs::create_dir_all(root).map_err(|e| Error::write(root, &e))?;
        let occupied = std::fs::read_dir(root)
            .map_err(|e| Error::read(root, &e))?
            .flatten()
            .any(|e| !is_our_leftover(&e.file_name().to_string_lossy()));
        if occupied {
            return Err(Error::NotADataset { path: root.to_owned() });
        }
        Self::begin(root, provenance, trajectory, lock(root)?)
    }

    /// Takes over a folder in which a run ended before its first capture, whatever rig and plan it had. Its
    /// logs stay.
    fn begin_anew(root: &Path, provenance: Provenance, trajectory: &Trajectory) -> Result<Dataset, Error> {
        let lock = lock(root)?;
        atomic::sweep(root)?;
        // Pictures of an untouched sensor that may be another one.
        let background = root.join("background");
        match std::fs::remove_dir_all(&background) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::write(&background, &e)),
            _ => Self::begin(root, provenance, trajectory, lock),
        }
    }

    fn begin(
        root: &Path,
        provenance: Provenance,
        trajectory: &Trajectory,
        lock: File,
    ) -> Result<Dataset, Error> {
        let json = |value: serde_json::Result<Vec<u8>>| {
            value.map_err(|e| Error::Encode { what: "provenance", why: e.to_string() })
        };
        place(&root.join("trajectory.json"), &json(serde_json::to_vec(trajectory))?, None)?;
        // Last of all: from here on the folder is a dataset.
        place(&root.join("dataset.json"), &json(serde_json::to_vec_pretty(&provenance))?, None)?;
        Self::with_journals(root, provenance, trajectory.clone(), Some(lock))
    }

    /// Continues a dataset that the same rig, plan and simulation began. Captures whose files are missing or
    /// differ from their sums are forgotten, and so will be done again; their numbers are returned.
    pub fn resume(root: &Path, asked: &Provenance) -> Result<(Dataset, BTreeSet<u32>), Error> {
        let (provenance, trajectory) = read_head(root)?;
        provenance.must_match(asked, root)?;
        let lock = lock(root)?;
        atomic::sweep(root)?;
        let dataset = Self::with_journals(root, provenance, trajectory, Some(lock))?;
        let mut damaged = BTreeSet::new();
        let intact = |files: &[StoredFile]| files.iter().all(|f| verify::sum_matches(root, f));
        let mut forget_damaged = |lines: Vec<(u32, Vec<StoredFile>)>, forget: &mut dyn FnMut(u32)| {
            for (capture, files) in lines {
                if !intact(&files) {
                    damaged.insert(capture);
                    forget(capture);
                }
            }
        };
        {
            let mut real = locked(&dataset.real);
            let lines = real.lines().iter().map(|(c, l)| (*c, l.files.clone())).collect();
            forget_damaged(lines, &mut |c| real.forget(c));
            let mut sim = locked(&dataset.sim);
            let lines = sim.lines().iter().map(|(c, l)| (*c, l.files.clone())).collect();
            forget_damaged(lines, &mut |c| sim.forget(c));
        }
        Ok((dataset, damaged))
    }

    /// Opens a dataset for reading; nothing is locked or changed.
    pub fn open(root: &Path) -> Result<Dataset, Error> {
        let (provenance, trajectory) = read_head(root)?;
        let real = Mutex::new(Journal::read(&journal_path(root, "real"))?);
        let sim = Mutex::new(Journal::read(&journal_path(root, "sim"))?);
        Ok(Dataset { root: root.to_owned(), provenance, trajectory, real, sim, interrupt: None, _lock: None })
    }

    fn with_journals(
        root: &Path,
        provenance: Provenance,
        trajectory: Trajectory,
        lock: Option<File>,
    ) -> Result<Dataset, Error> {
        let real = Mutex::new(Journal::open(&journal_path(root, "real"))?);
        let sim = Mutex::new(Journal::open(&journal_path(root, "sim"))?);
        Ok(Dataset { root: root.to_owned(), provenance, trajectory, real, sim, interrupt: None, _lock: lock })
    }

    /// Lets a test end the process at any [`atomic::Moment`].
    pub fn interrupt_with(&mut self, interrupt: Interrupt) {
        self.interrupt = Some(interrupt);
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Where it comes from.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// What both sides followed.
    pub fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// Whether no capture of either side is stored yet.
    pub fn is_untouched(&self) -> bool {
        locked(&self.real).lines().is_empty() && locked(&self.sim).lines().is_empty()
    }

    /// Whether nothing would be lost if it were begun anew: no line in a journal, not even a damaged one, and
    /// no picture.
    pub fn holds_nothing(&self) -> bool {
        let is_empty = |side: &str| {
            std::fs::metadata(journal_path(&self.root, side)).map_or(true, |journal| journal.len() == 0)
        };
        let has_data = std::fs::read_dir(self.root.join("data")).is_ok_and(|mut d| d.next().is_some());
        is_empty("real") && is_empty("sim") && !has_data
    }

    /// Captures whose real side is stored.
    pub fn done_real(&self) -> BTreeSet<u32> {
        locked(&self.real).lines().keys().copied().collect()
    }

    /// Captures whose simulated side is stored.
    pub fn done_sim(&self) -> BTreeSet<u32> {
        locked(&self.sim).lines().keys().copied().collect()
    }

    /// Real side of a capture as stored.
    pub fn real(&self, capture: u32) -> Option<Line<RealRecord>> {
        locked(&self.real).lines().get(&capture).cloned()
    }

    /// Stores the real side of a capture: a PNG and what is known.
    pub fn append_real(&self, capture: u32, record: RealRecord, png: &[u8]) -> Result<(), Error> {
        let file = self.store(format!("data/{}/real/{capture:06}.png", self.split_of(capture)), png)?;
        locked(&self.real).append(Line { capture, files: vec![file], record }, self.interrupt.as_ref())
    }

    /// Stores the simulated side of a capture: a PNG, a depth TIFF, a contact mask (PNG), and what is known.
    pub fn append_sim(
        &self,
        capture: u32,
        record: SimRecord,
        png: &[u8],
        depth_tiff: &[u8],
        contact_png: &[u8],
    ) -> Result<(), Error> {
        let split = self.split_of(capture);
        let picture = self.store(format!("data/{split}/sim/{capture:06}.png"), png)?;
        let depth = self.store(format!("data/{split}/depth/{capture:06}.tiff"), depth_tiff)?;
        let contact = self.store(format!("data/{split}/contact/{capture:06}.png"), contact_png)?;
        locked(&self.sim)
            .append(Line { capture, files: vec![picture, depth, contact], record }, self.interrupt.as_ref())
    }

    /// Stores a picture of the untouched sensor or of a touch-off.
    pub fn put_background(&self, name: &str, png: &[u8]) -> Result<(), Error> {
        self.store(format!("background/{name}.png"), png).map(drop)
    }

    /// A picture under `background/`, if it is there.
    pub fn background(&self, name: &str) -> Option<Vec<u8>> {
        std::fs::read(self.root.join(format!("background/{name}.png"))).ok()
    }

    /// Notes the beginning or the end of a run: identities, camera, settings, how it ended.
    pub fn note_session(&self, note: &serde_json::Value) -> Result<(), Error> {
        use std::io::Write;
        let path = self.root.join("journal/sessions.ndjson");
        let mut file = std::fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(&path)
            .map_err(|e| Error::write(&path, &e))?;
        let written = file.write_all(format!("{note}\n").as_bytes()).and_then(|()| file.sync_data());
        written.map_err(|e| Error::write(&path, &e))
    }

    /// Reads a stored file of this dataset.
    pub fn read_file(&self, file: &StoredFile) -> Result<Vec<u8>, Error> {
        let path = self.root.join(&file.path);
        std::fs::read(&path).map_err(|e| Error::read(&path, &e))
    }

    /// The rows: captures with both sides, or with the only side there is when the other has none at all.
    pub fn rows(&self) -> Vec<Row> {
        let (real, sim) = (locked(&self.real), locked(&self.sim));
        let (real, sim) = (real.lines(), sim.lines());
        let all: BTreeSet<u32> = real.keys().chain(sim.keys()).copied().collect();
        all.into_iter()
            .map(|capture| Row {
                capture,
                real: real.get(&capture).cloned(),
                sim: sim.get(&capture).cloned(),
            })
            .filter(|row| (row.real.is_some() || real.is_empty()) && (row.sim.is_some() || sim.is_empty()))
            .collect()
    }

    /// Rebuilds the tables, the card and the manifest from the journals.
    pub fn finalise(&self, metrics: &BTreeMap<u32, PairMetrics>) -> Result<(), Error> {
        let rows = self.rows();
        let mut by_split: BTreeMap<String, Vec<&Row>> = BTreeMap::new();
        for row in &rows {
            by_split.entry(self.split_of(row.capture).to_owned()).or_default().push(row);
        }
        for (split, rows) in &by_split {
            let table = table::pairs(self, split, rows, metrics);
            place(&self.root.join(format!("data/{split}/metadata.parquet")), &table.to_parquet()?, None)?;
        }
        let pairs = by_split.iter().map(|(split, rows)| (split.clone(), rows.len())).collect();
        place(&self.root.join("README.md"), card::card(&self.provenance, &pairs).as_bytes(), None)?;
        place(&self.root.join(MANIFEST), self.manifest(&rows)?.as_bytes(), None)
    }

    /// Sums of all files of all rows and of all that describes them, in the format of `b3sum`.
    fn manifest(&self, rows: &[Row]) -> Result<String, Error> {
        let mut text = String::new();
        for row in rows {
            let real = row.real.iter().flat_map(|l| &l.files);
            for file in real.chain(row.sim.iter().flat_map(|l| &l.files)) {
                text.push_str(&format!("{}  {}\n", file.blake3, file.path));
            }
        }
        let mut described =
            vec!["README.md".to_owned(), "dataset.json".to_owned(), "trajectory.json".to_owned()];
        let splits: BTreeSet<&str> = rows.iter().map(|row| self.split_of(row.capture)).collect();
        described.extend(splits.into_iter().map(|split| format!("data/{split}/metadata.parquet")));
        described.extend(self.backgrounds()?.into_iter().map(|name| format!("background/{name}.png")));
        for path in described {
            let file = self.root.join(&path);
            let bytes = std::fs::read(&file).map_err(|e| Error::read(&file, &e))?;
            text.push_str(&format!("{}  {path}\n", blake3::hash(&bytes).to_hex()));
        }
        Ok(text)
    }

    /// Names of the pictures under `background/`, in order.
    pub fn backgrounds(&self) -> Result<Vec<String>, Error> {
        let folder = self.root.join("background");
        let entries = match std::fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(e) => return Err(Error::read(&folder, &e)),
        };
        let names = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned());
        let mut names: Vec<String> = names
            .filter(|n| !n.starts_with('.'))
            .filter_map(|n| n.strip_suffix(".png").map(str::to_owned))
            .collect();
        names.sort();
        Ok(names)
    }

    /// Split of a capture.
    pub fn split_of(&self, capture: u32) -> &str {
        self.provenance.splits.get(capture as usize).map_or("train", String::as_str)
    }

    fn store(&self, path: String, bytes: &[u8]) -> Result<StoredFile, Error> {
        place(&self.root.join(&path), bytes, self.interrupt.as_ref())?;
        Ok(StoredFile { path, blake3: blake3::hash(bytes).to_hex().to_string(), bytes: bytes.len() as u64 })
    }
}

/// A panic elsewhere leaves a journal as consistent as the disk is.
fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|e| e.into_inner())
}

fn journal_path(root: &Path, side: &str) -> PathBuf {
    root.join("journal").join(format!("{side}.ndjson"))
}

/// What a creation that was interrupted leaves behind.
fn is_our_leftover(name: &str) -> bool {
    name == LOCK || name == "trajectory.json" || name.ends_with(".partial")
}

const LOCK: &str = ".lock";

const MANIFEST: &str = "MANIFEST.blake3";

/// An exclusive lock that the system releases when the process ends, however it ends.
fn lock(root: &Path) -> Result<File, Error> {
    let path = root.join(LOCK);
    let file = File::create(&path).map_err(|e| Error::write(&path, &e))?;
    match rustix::fs::flock(&file, rustix::fs::FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(file),
        Err(rustix::io::Errno::WOULDBLOCK) => Err(Error::Locked { path: root.to_owned() }),
        // Some network file systems have no locks; the journal is still append-only.
        Err(rustix::io::Errno::OPNOTSUPP | rustix::io::Errno::NOSYS) => Ok(file),
        Err(e) => Err(Error::write(&path, &e.into())),
    }
}

fn read_head(root: &Path) -> Result<(Provenance, Trajectory), Error> {
    let read = |name: &str| {
        let path = root.join(name);
        match std::fs::read(&path) {
            Ok(bytes) => Ok(bytes),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                Err(Error::Missing { path: root.to_owned() })
            }
            Err(e) => Err(Error::read(&path, &e)),
        }
    };
    let damaged =
        |name: &str, e: serde_json::Error| Error::Head { path: root.join(name), why: e.to_string() };
    let provenance =
        serde_json::from_slice(&read("dataset.json")?).map_err(|e| damaged("dataset.json", e))?;
    let trajectory =
        serde_json::from_slice(&read("trajectory.json")?).map_err(|e| damaged("trajectory.json", e))?;
    Ok((provenance, trajectory))
}
