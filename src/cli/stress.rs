//! `twinrig stress`: whether it breaks, and how. One file for each sweep.

mod elastomer;
mod optics;

use super::exit::Exit;

/// Look for wrong answers, hangs and panics over hundreds of cases
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig stress elastomer\n  twinrig stress elastomer --only 137\n  twinrig stress optics --quick --json"
)]
pub struct Args {
    #[command(subcommand)]
    pub what: What,
}

/// The sweeps.
#[derive(Debug, clap::Subcommand)]
pub enum What {
    Elastomer(elastomer::Args),
    Optics(optics::Args),
}

impl Args {
    /// Runs the sweep.
    pub async fn run(self) -> Exit {
        match self.what {
            What::Elastomer(args) => args.run().await,
            What::Optics(args) => args.run(),
        }
    }
}
