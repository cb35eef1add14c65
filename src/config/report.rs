//! Everything that is wrong with a set of configuration files, for a person to read.

use super::tree::Origin;
use serde::{Serialize, Serializer};
use std::fmt;

/// One thing that is wrong, and where it was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// The file, as it was found.
    pub file: String,
    /// Line of the file, or the `--set` on the command line; absent where no line can be named.
    pub at: Option<Origin>,
    /// Dotted key path; empty where the whole file is meant.
    pub key: String,
    /// What was written.
    pub value: String,
    /// What would be accepted.
    pub allowed: String,
    /// What to do about it.
    pub next: String,
}

/// The file of what was written on the command line and belongs to no file.
pub const COMMAND_LINE: &str = "command line";

/// All findings of one load; nothing was opened, nothing moved.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, thiserror::Error)]
pub struct ConfigError {
    /// In order of files, then of discovery.
    pub findings: Vec<Finding>,
}

impl Finding {
    /// Line of the file, where there is one.
    pub fn line(&self) -> Option<usize> {
        match self.at {
            Some(Origin::Line(line)) => Some(line),
            _ => None,
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.at {
            Some(Origin::Line(line)) => write!(f, "{}:{line}: ", self.file)?,
            Some(Origin::Set(setting)) if self.file == COMMAND_LINE => write!(f, "--set {setting}: ")?,
            Some(Origin::Set(setting)) => write!(f, "--set {setting} (for {}): ", self.file)?,
            None => write!(f, "{}: ", self.file)?,
        }
        // A literal reads as in the file, a description after a colon.
        let value = &self.value;
        let is_literal = value.starts_with(['"', '[']) || !value.contains(' ') && value != "missing";
        match (self.key.is_empty(), is_literal) {
            (true, _) => writeln!(f, "{value}")?,
            (false, true) => writeln!(f, "{} = {value}", self.key)?,
            (false, false) => writeln!(f, "{}: {value}", self.key)?,
        }
        writeln!(f, "    allowed: {}", self.allowed)?;
        write!(f, "    next:    {}", self.next)
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.findings.len();
        writeln!(f, "{count} {} in the configuration", if count == 1 { "problem" } else { "problems" })?;
        for (i, finding) in self.findings.iter().enumerate() {
            write!(f, "{}{finding}", if i > 0 { "\n" } else { "" })?;
        }
        Ok(())
    }
}

impl Serialize for Finding {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut s = serializer.serialize_struct("Finding", 7)?;
        s.serialize_field("file", &self.file)?;
        s.serialize_field("line", &self.line())?;
        let setting = match &self.at {
            Some(Origin::Set(setting)) => Some(setting),
            _ => None,
        };
        s.serialize_field("set", &setting)?;
        s.serialize_field("key", &self.key)?;
        s.serialize_field("value", &self.value)?;
        s.serialize_field("allowed", &self.allowed)?;
        s.serialize_field("next", &self.next)?;
        s.end()
    }
}
