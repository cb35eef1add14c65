//! `twinrig report DATASET`: writes the report of a dataset.
//!
//! One self-contained page, `<dataset>/report.html`, made from what is stored; `collect` calls it at its end.

use super::exit::Exit;
use std::path::PathBuf;

/// Write the report of a dataset
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  twinrig report data/slip")]
pub struct Args {
    /// Folder of the dataset
    pub dataset: PathBuf,
    /// Print the metrics as one JSON document
    #[arg(long)]
    pub json: bool,
}
