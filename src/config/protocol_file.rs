//! A protocol by itself: by the path of a file, or by the name of a shipped one.

use super::document::{Document, Reading};
use super::lookup::{Kind, NotFound, SourceFile, by_path};
use super::report::{ConfigError, Finding};
use crate::protocol::Spec;
use std::path::Path;
use std::sync::Arc;

/// A protocol file that was read and is sound.
#[derive(Debug, Clone)]
pub struct ProtocolFile {
    /// What it says.
    pub spec: Arc<Spec>,
    /// The file; its keys still know their lines.
    pub document: Document,
}

/// Reads and checks a protocol.
///
/// # Errors
/// When there is none of that path or name, or with everything that is wrong in it.
pub fn protocol(path_or_name: &str) -> Result<Arc<Spec>, ConfigError> {
    protocol_file(path_or_name).map(|file| file.spec)
}

/// As [`protocol`], with the file itself.
///
/// # Errors
/// As [`protocol`].
pub fn protocol_file(path_or_name: &str) -> Result<ProtocolFile, ConfigError> {
    let mut findings = Vec::new();
    match by_path(Kind::Protocol, Path::new(path_or_name)) {
        Ok(source) => {
            if let Some(file) = read(source, &mut findings) {
                return Ok(file);
            }
        }
        Err(NotFound { asked, allowed, next }) => {
            let (file, key) = (path_or_name.to_owned(), String::new());
            findings.push(Finding { file, at: None, key, value: asked, allowed, next });
        }
    }
    Err(ConfigError { findings })
}

/// Names of the shipped protocols.
pub fn shipped_protocols() -> Vec<&'static str> {
    super::builtin::names(Kind::Protocol).collect()
}

/// Reads the text of a protocol; everything wrong goes to `findings`, in the order of the lines.
pub(super) fn read(source: SourceFile, findings: &mut Vec<Finding>) -> Option<ProtocolFile> {
    let mut found = Vec::new();
    let file = Document::parse(source, &mut found).and_then(|document| {
        let read = document.read(|spec: &Spec, problems| spec.check(problems), &mut found);
        let read = read.filter(Reading::is_sound)?;
        Some(ProtocolFile { spec: Arc::new(read.value), document })
    });
    found.sort_by_key(Finding::line);
    findings.extend(found);
    file
}
