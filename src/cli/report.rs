//! `twinrig report DATASET`: writes the report of a dataset.
//!
//! One self-contained page, `<dataset>/report.html`, made from what is stored; `collect` calls it at its end.

use super::exit::Exit;
use super::screen;
use crate::dataset::Dataset;
use crate::report::{Numbers, Written};
use std::path::PathBuf;

/// Write the report of a dataset
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig report data/slip\n  twinrig report data/slip --json | jq '.scores[] | select(.indenter == null)'"
)]
pub struct Args {
    /// Folder of the dataset
    pub dataset: PathBuf,
    /// Print the path and the numbers of the report as one JSON document (those of each capture are in the Parquet files)
    #[arg(long)]
    pub json: bool,
}

/// What `--json` prints.
#[derive(Debug, serde::Serialize)]
struct Document {
    report: PathBuf,
    #[serde(flatten)]
    numbers: Numbers,
}

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        let dataset = match Dataset::open(&self.dataset) {
            Ok(dataset) => dataset,
            Err(e) => {
                screen::error(e);
                return Exit::Refused;
            }
        };
        match crate::report::write(&dataset) {
            Ok(written) if self.json => {
                let Written { path: report, numbers } = written;
                screen::json(&Document { report, numbers });
                Exit::Done
            }
            Ok(written) => {
                screen::result(written.path.display());
                Exit::Done
            }
            Err(e) => {
                screen::error(e);
                Exit::Failed
            }
        }
    }
}
