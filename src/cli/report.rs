//! `twinrig report DATASET`: writes the report of a dataset.
//!
//! One self-contained page, `<dataset>/report.html`, made from what is stored; `collect` calls it at its end.

use super::exit::Exit;
use super::screen;
use crate::dataset::Dataset;
use std::path::PathBuf;

/// Write the report of a dataset
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  twinrig report data/slip")]
pub struct Args {
    /// Folder of the dataset
    pub dataset: PathBuf,
    /// Print the path of the report as one JSON document (the metrics are in the Parquet files)
    #[arg(long)]
    pub json: bool,
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
            Ok(path) if self.json => {
                screen::json(&serde_json::json!({ "report": path }));
                Exit::Done
            }
            Ok(path) => {
                screen::result(path.display());
                Exit::Done
            }
            Err(e) => {
                screen::error(e);
                Exit::Failed
            }
        }
    }
}
