//! The report: one self-contained page that shows a dataset to somebody who was not there.
//!
//! [`write`] pairs the dataset, rebuilds its tables with the scores, and writes `report.html`. The page says
//! first what was done and how well the simulation did, then shows every capture as real | simulated |
//! difference, then plots, timing and provenance. Every score stands beside that of the null predictor.
//!
//! The page needs no network and no other file: pictures are embedded, scaled so that the page
//! stays below about 25 MB however many captures there are; plots are SVG that follow the reader's light or
//! dark colours. Sections about single indenters are folded up until they are opened.

mod facts;
mod gallery;
mod numbers;
mod page;
mod plots;
mod tables;

use crate::dataset::{self, Dataset};
use crate::pairing::{self, Alignment};
use facts::Facts;
pub use numbers::{Numbers, Refused, Score};
use std::path::PathBuf;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The dataset could not be read or finalised.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The sides could not be compared.
    #[error(transparent)]
    Pairing(#[from] pairing::Error),
    /// The page could not be written.
    #[error("cannot write {path}: {source}; make room or mend permissions, then run `twinrig report`")]
    Write {
        /// The page.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
}

/// A report that was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// The page.
    pub path: PathBuf,
    /// What it says, for scripts.
    pub numbers: Numbers,
}

/// Pairs a dataset, rebuilds its tables, writes its report; answers where the report is and what it says.
///
/// # Errors
/// When the dataset cannot be read, its sides cannot be compared, or the disk refuses.
pub fn write(dataset: &Dataset) -> Result<Written, Error> {
    let pairing = pairing::pair(dataset, Alignment::Off)?;
    dataset.finalise(&pairing.metrics())?;
    let path = dataset.root().join("report.html");
    let facts = Facts::gather(dataset, &pairing);
    let page = html(dataset, &facts);
    std::fs::write(&path, page).map_err(|source| Error::Write { path: path.clone(), source })?;
    Ok(Written { path, numbers: Numbers::of(&facts) })
}

/// The page itself.
fn html(dataset: &Dataset, facts: &Facts) -> String {
    let mut body = String::new();
    body += &tables::opening(facts);
    body += &tables::scores(facts);
    body += &gallery::highlights(dataset, facts);
    body += &plots::sections(facts);
    body += &gallery::all(dataset, facts);
    body += &tables::course(facts);
    body += &tables::provenance(facts);
    page::document(&format!("{} on {}", facts.provenance.plan, facts.provenance.rig), &body)
}

#[cfg(test)]
mod tests;
