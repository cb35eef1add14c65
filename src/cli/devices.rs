//! `twinrig devices`: what is connected.
//!
//! Lists serial ports with their USB identity and stable path, and cameras with their formats and
//! controls, in the words that a rig file takes. Nothing is opened for writing and nothing moves.

use super::exit::Exit;

/// List serial ports and cameras
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  twinrig devices\n  twinrig devices --json")]
pub struct Args {
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        Exit::Failed
    }
}
