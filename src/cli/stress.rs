//! `twinrig stress`: whether it breaks, and how. One file for each sweep.

mod optics;

use super::exit::Exit;

/// Look for wrong answers, hangs and panics over hundreds of cases
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  twinrig stress optics\n  twinrig stress optics --quick --json")]
pub struct Args {
    #[command(subcommand)]
    pub what: What,
}

/// The sweeps.
#[derive(Debug, clap::Subcommand)]
pub enum What {
    Optics(optics::Args),
}

impl Args {
    /// Runs the sweep.
    pub async fn run(self) -> Exit {
        match self.what {
            What::Optics(args) => args.run(),
        }
    }
}
