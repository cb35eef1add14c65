//! `twinrig verify DATASET`: is everything there, and as it was written?
//!
//! Checks every checksum, the journals, the pairs, and that the tables agree with the journals. Lists
//! every problem; the exit code is 1 when there is one.

use super::exit::Exit;
use super::screen;
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

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        let found = match crate::dataset::verify::verify(&self.dataset) {
            Ok(found) => found,
            Err(e) => {
                screen::error(e);
                return Exit::Refused;
            }
        };
        if self.json {
            screen::json(&found);
        } else {
            for finding in &found.findings {
                screen::result(format_args!("{}: {}", finding.path, finding.problem));
            }
            screen::result(format_args!(
                "{}: {} real and {} simulated of {} captures, {} rows, {} files checked, {} problems",
                self.dataset.display(),
                found.real,
                found.sim,
                found.captures,
                found.rows,
                found.files,
                found.findings.len()
            ));
        }
        if found.findings.is_empty() { Exit::Done } else { Exit::Failed }
    }
}
