//! `twinrig emulate PROTOCOL --link PATH`: a firmware emulator for other people's clients.
//!
//! Opens a pseudo-terminal, links its far end at PATH, and answers there as the firmware would, in its own
//! time, until it is interrupted. PROTOCOL is the name of a shipped protocol (`grbl`, `marlin`, ...) or the
//! path of a protocol file with an `[emulator]` table.

use super::exit::Exit;
use super::options::Speed;
use std::path::PathBuf;

/// Serve a firmware emulator on a pseudo-terminal
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig emulate marlin --link /tmp/printer\n  twinrig emulate grbl --link /tmp/stage --speed 10\n  twinrig emulate ./my_stage.toml --link /tmp/mine"
)]
pub struct Args {
    /// Name of a shipped protocol, or path of a protocol file
    pub protocol: String,
    /// Where to link the pseudo-terminal
    #[arg(long, value_name = "PATH")]
    pub link: PathBuf,
    #[command(flatten)]
    pub speed: Speed,
}

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        Exit::Failed
    }
}
