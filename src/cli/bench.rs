//! `twinrig bench`: how fast it is, measured on this machine. One file for each benchmark.

mod distribution;
mod elastomer;
mod load;
mod session;
mod stop;

use super::exit::Exit;

/// Measure this machine: stops, sessions, the elastomer
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  twinrig bench stop\n  twinrig bench session --json\n  twinrig bench elastomer --quick")]
pub struct Args {
    #[command(subcommand)]
    pub what: What,
}

/// The benchmarks.
#[derive(Debug, clap::Subcommand)]
pub enum What {
    Stop(stop::Args),
    Session(session::Args),
    Elastomer(elastomer::Args),
}

impl Args {
    /// Runs the benchmark.
    pub async fn run(self) -> Exit {
        match self.what {
            What::Stop(args) => args.run().await,
            What::Session(args) => args.run().await,
            What::Elastomer(args) => args.run(),
        }
    }
}
