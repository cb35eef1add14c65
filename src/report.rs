//! tmp
#![allow(missing_docs)]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error(transparent)]
    Dataset(#[from] crate::dataset::Error),
}
pub fn write(d: &crate::dataset::Dataset) -> Result<std::path::PathBuf, Error> {
    d.finalise(&Default::default())?;
    Ok(d.root().join("report.html"))
}
