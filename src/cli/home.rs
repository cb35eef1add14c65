//! `twinrig home RIG`: reference all axes.
//!
//! Verifies who is connected, then homes the pressing axis first (which lifts the indenter away) and the
//! others after it.

use super::at_bench::{AtBench, Wanted, show, whereabouts};
use super::exit::Exit;
use super::options::{RigOptions, Speed};

/// Home all axes of a rig
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  twinrig home rig_configs/virtual.toml")]
pub struct Args {
    #[command(flatten)]
    pub rig: RigOptions,
    #[command(flatten)]
    pub speed: Speed,
    /// Print the position after homing as one JSON document
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        let wanted = Wanted::by_hand("home", &self.rig, &self.speed);
        let mut at = match AtBench::open(wanted).await {
            Ok(at) => at,
            Err(exit) => return exit,
        };
        let bench = &mut at.assembled.bench;
        let homed = async {
            bench.home().await?;
            show(&whereabouts(bench).await?, self.json);
            Ok(())
        };
        let homed = homed.await;
        at.finish(homed)
    }
}
