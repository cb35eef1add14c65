//! `twinrig bench`: how fast it is, measured on this machine. One file for each benchmark.

mod distribution;
mod elastomer;
mod load;
mod optics;
mod optics_plot;
mod session;
mod stop;

use super::exit::Exit;

/// Measure this machine: stops, sessions, elastomer, optics
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig bench stop\n  twinrig bench session --json\n  twinrig bench elastomer --quick\n  twinrig bench optics --out bench/optics"
)]
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
    Optics(optics::Args),
}

impl Args {
    /// Runs the benchmark.
    pub async fn run(self) -> Exit {
        match self.what {
            What::Stop(args) => args.run().await,
            What::Session(args) => args.run().await,
            What::Elastomer(args) => args.run(),
            What::Optics(args) => args.run(),
        }
    }
}
