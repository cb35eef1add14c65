//! `twinrig check RIG [PLAN]`: what a plan would do, and whether it may.
//!
//! Loads and checks every file involved, expands the plan, walks every pose against the limits of the
//! axes, and estimates time and disk. No device is touched. All problems are reported at once, each with
//! file, line, key, value, allowed range and the next move; the exit code is then 2.

use super::exit::Exit;
use super::options::Overrides;
use super::screen;
use std::path::PathBuf;

/// Show what a plan would do, and refuse it if it is unsafe; touches no device
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig check rig_configs/virtual.toml rig_configs/plans/slip.toml\n  twinrig check rig_configs/virtual.toml --json\n  twinrig check rig_configs/virtual.toml rig_configs/plans/press.toml --set elastomer.tolerance=0.002"
)]
pub struct Args {
    /// Rig file
    rig: PathBuf,
    /// Plan file
    plan: Option<PathBuf>,
    #[command(flatten)]
    overrides: Overrides,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        let report = match crate::config::check(&self.rig, self.plan.as_deref(), &self.overrides.set) {
            Ok(report) => report,
            Err(e) => {
                screen::error(e);
                return Exit::Refused;
            }
        };
        if self.json {
            screen::json(&report);
        } else {
            screen::result(&report);
        }
        Exit::Done
    }
}
