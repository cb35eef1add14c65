//! A protocol by itself: by the path of a file, or by the name of a shipped one.

use super::lookup::{Kind, by_path};
use crate::protocol::Spec;
use crate::protocol::spec::SpecError;
use std::path::Path;
use std::sync::Arc;

/// Why a protocol cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProtocolFileError {
    /// There is no such file and no shipped protocol of that name.
    #[error("protocol {asked}: {problem}; allowed: {allowed}; {next}")]
    NotFound {
        /// As it was asked for.
        asked: String,
        /// What is wrong.
        problem: String,
        /// What would do.
        allowed: String,
        /// What to do.
        next: String,
    },
    /// The file is wrong.
    #[error(transparent)]
    Spec(#[from] SpecError),
}

/// Reads and checks a protocol.
///
/// # Errors
/// When there is none, or with everything that is wrong in it.
pub fn protocol(path_or_name: &str) -> Result<Arc<Spec>, ProtocolFileError> {
    let source =
        by_path(Kind::Protocol, Path::new(path_or_name)).map_err(|e| ProtocolFileError::NotFound {
            asked: path_or_name.to_owned(),
            problem: e.asked,
            allowed: e.allowed,
            next: e.next,
        })?;
    Ok(Arc::new(Spec::parse(&source.path, &source.text)?))
}
