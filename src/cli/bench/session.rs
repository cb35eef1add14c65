//! `twinrig bench session`.
use crate::cli::exit::Exit;

/// Session
#[derive(Debug, clap::Args)]
pub struct Args {}

impl Args {
    /// Runs the benchmark.
    pub async fn run(self) -> Exit {
        Exit::Done
    }
}
