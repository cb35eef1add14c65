//! `twinrig verify DATASET`: is everything there, and as it was written?
//!
//! Checks every checksum, the journals, the pairs, and that the tables agree with the journals. Lists
//! every problem; the exit code is 1 when there is one.

use super::exit::Exit;
use std::path::PathBuf;

/// Verify a dataset
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  twinrig verify data/slip")]
pub struct Args {
    /// Folder of the dataset
    pub dataset: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}
