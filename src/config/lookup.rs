//! Where files are found.
//!
//! A rig or plan is given by path; if nothing is there, its name among the shipped ones counts
//! (`virtual`, `virtual.toml` and `rig_configs/virtual.toml` all mean the shipped virtual bench).
//! Sensors, indenters and protocols are given by name, and the first that exists is taken:
//! 1. beside the rig file: `sensors/NAME.toml`, `indenters/NAME.toml`, `firmware_protocols/NAME.toml`;
//! 2. one folder above the rig file (so a folder of rigs can lie beside `firmware_protocols/`);
//! 3. beside the plan file, and one folder above it;
//! 4. in the current directory: `rig_configs/sensors/`, `rig_configs/indenters/`, `firmware_protocols/`;
//! 5. the copies built into the program, so that it works from any directory.
//!
//! Which file was taken is part of every dataset, with its text and hash.

use super::builtin;
use super::suggest::closest;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What kind of file is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A bench.
    Rig,
    /// What to do.
    Plan,
    /// Pad, optics and camera geometry.
    Sensor,
    /// A rigid body.
    Indenter,
    /// How a firmware is spoken to.
    Protocol,
}

impl Kind {
    /// The folder such files live in, seen from the top of the repository.
    pub fn folder(self) -> &'static str {
        match self {
            Kind::Rig => "rig_configs",
            Kind::Plan => "rig_configs/plans",
            Kind::Sensor => "rig_configs/sensors",
            Kind::Indenter => "rig_configs/indenters",
            Kind::Protocol => "firmware_protocols",
        }
    }

    /// The word for it in messages.
    pub fn word(self) -> &'static str {
        match self {
            Kind::Rig => "rig",
            Kind::Plan => "plan",
            Kind::Sensor => "sensor",
            Kind::Indenter => "indenter",
            Kind::Protocol => "protocol",
        }
    }
}

/// A file that was read, word for word.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SourceFile {
    /// What it describes.
    pub kind: Kind,
    /// Its name: the stem.
    pub name: String,
    /// Where it was found; `built in: ...` for the program's own copy.
    pub path: String,
    /// The folder it lies in, for files that it names; absent for the program's own copy.
    #[serde(skip)]
    pub folder: Option<PathBuf>,
    /// Its text.
    pub text: String,
    /// BLAKE3 of the text, hexadecimal.
    pub blake3: String,
}

/// Why a file could not be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotFound {
    /// What was asked for.
    pub asked: String,
    /// What would be accepted.
    pub allowed: String,
    /// What to do.
    pub next: String,
}

impl SourceFile {
    fn new(kind: Kind, path: &Path, text: String) -> Self {
        let folder = path.parent().map(Path::to_path_buf);
        let name = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        Self::with(kind, name, path.display().to_string(), folder, text)
    }

    fn built_in(kind: Kind, name: &str, text: &str) -> Self {
        let path = format!("built in: {}/{name}.toml", kind.folder());
        Self::with(kind, name.to_owned(), path, None, text.to_owned())
    }

    fn with(kind: Kind, name: String, path: String, folder: Option<PathBuf>, text: String) -> Self {
        let blake3 = blake3::hash(text.as_bytes()).to_hex().to_string();
        Self { kind, name, path, folder, text, blake3 }
    }
}

/// Reads a rig or plan that was given by path (or by the name of a shipped one).
pub fn by_path(kind: Kind, path: &Path) -> Result<SourceFile, NotFound> {
    match std::fs::read_to_string(path) {
        Ok(text) => Ok(SourceFile::new(kind, path, text)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            shipped_by_path(kind, path).ok_or_else(|| {
                let stem = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
                let shipped: Vec<&str> = builtin::names(kind).collect();
                let next = match closest(&stem, shipped.iter().copied()) {
                    Some(near) => format!("did you mean {}/{near}.toml?", kind.folder()),
                    None => "check the path".to_owned(),
                };
                NotFound {
                    asked: "there is no such file".to_owned(),
                    allowed: format!("a {} file, or a shipped one: {}", kind.word(), shipped.join(", ")),
                    next,
                }
            })
        }
        Err(error) => Err(NotFound {
            asked: format!("cannot be read: {error}"),
            allowed: format!("a readable {} file", kind.word()),
            next: "check its permissions and that it is a text file".to_owned(),
        }),
    }
}

/// `virtual`, `virtual.toml`, `rig_configs/virtual.toml`; not `elsewhere/virtual.toml`.
fn shipped_by_path(kind: Kind, path: &Path) -> Option<SourceFile> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let is_ours = folder.as_os_str().is_empty() || folder == Path::new(kind.folder());
    let is_toml = path.extension().is_none_or(|e| e == "toml");
    let stem = path.file_stem()?.to_str()?;
    let text = builtin::text(kind, stem).filter(|_| is_ours && is_toml)?;
    Some(SourceFile::built_in(kind, stem, text))
}

/// Finds sensors, indenters and protocols by name.
#[derive(Debug, Clone, Default)]
pub struct Lookup {
    rig_folder: Option<PathBuf>,
    plan_folder: Option<PathBuf>,
}

impl Lookup {
    /// A lookup for a rig and a plan.
    pub fn new(rig: Option<&SourceFile>, plan: Option<&SourceFile>) -> Self {
        let folder = |file: Option<&SourceFile>| file.and_then(|f| f.folder.clone());
        Self { rig_folder: folder(rig), plan_folder: folder(plan) }
    }

    /// Folders that are searched for files of a kind, in order.
    fn folders(&self, kind: Kind) -> Vec<PathBuf> {
        let own = Path::new(kind.folder()).file_name().map_or_else(PathBuf::new, PathBuf::from);
        let mut folders = Vec::new();
        for base in [&self.rig_folder, &self.plan_folder].into_iter().flatten() {
            folders.push(base.join(&own));
            folders.push(base.join("..").join(&own));
        }
        folders.push(PathBuf::from(kind.folder()));
        folders
    }

    /// The file of that name.
    pub fn find(&self, kind: Kind, name: &str) -> Result<SourceFile, NotFound> {
        let is_name = !name.is_empty() && !name.contains(['/', '\\']) && !name.starts_with('.');
        for folder in self.folders(kind).into_iter().filter(|_| is_name) {
            let path = folder.join(format!("{name}.toml"));
            match std::fs::read_to_string(&path) {
                Ok(text) => return Ok(SourceFile::new(kind, &path, text)),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
                Err(error) => {
                    return Err(NotFound {
                        asked: format!("{} cannot be read: {error}", path.display()),
                        allowed: format!("a readable {} file", kind.word()),
                        next: "check its permissions and that it is a text file".to_owned(),
                    });
                }
            }
        }
        if let Some(text) = builtin::text(kind, name) {
            return Ok(SourceFile::built_in(kind, name, text));
        }
        let known = self.names(kind);
        let next = match closest(name, known.iter().map(String::as_str)) {
            Some(near) => format!("did you mean \"{near}\"?"),
            None if !is_name => "write a plain name, without folders".to_owned(),
            None => format!("write {}/{name}.toml, or choose one of them", kind.folder()),
        };
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        Err(NotFound { asked: format!("\"{name}\""), allowed: format!("one of {}", known.join(", ")), next })
    }

    /// Names of a kind that [`find`](Self::find) would find.
    pub fn names(&self, kind: Kind) -> BTreeSet<String> {
        let mut names: BTreeSet<String> = builtin::names(kind).map(str::to_owned).collect();
        for folder in self.folders(kind) {
            let files = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path());
            let stems = files
                .filter(|p| p.extension().is_some_and(|e| e == "toml"))
                .filter_map(|p| Some(p.file_stem()?.to_str()?.to_owned()));
            names.extend(stems);
        }
        names
    }
}
