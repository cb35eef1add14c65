//! Options that several subcommands share.

use clap::Args;
use std::path::PathBuf;

/// A rig file with overrides.
#[derive(Debug, Clone, Args)]
pub struct RigOptions {
    /// Rig file, e.g. rig_configs/virtual.toml
    pub rig: PathBuf,
    #[command(flatten)]
    pub overrides: Overrides,
}

/// A rig file and a plan with overrides.
#[derive(Debug, Clone, Args)]
pub struct RigAndPlan {
    /// Rig file, e.g. rig_configs/virtual.toml
    pub rig: PathBuf,
    /// Plan file, e.g. rig_configs/plans/slip.toml
    pub plan: PathBuf,
    #[command(flatten)]
    pub overrides: Overrides,
}

/// Settings overridden on the command line.
#[derive(Debug, Clone, Args)]
pub struct Overrides {
    /// Override a setting (may be repeated): a key of the rig file, or of the plan or the sensor after plan. or
    /// sensor., e.g. --set elastomer.tolerance=0.002 --set plan.repeats=2
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// How fast a virtual bench runs.
#[derive(Debug, Clone, Args)]
pub struct Speed {
    /// Run a virtual bench this many times faster than real time (waits are shortened, never skipped)
    #[arg(long, default_value_t = 1.0, value_parser = parse_speed)]
    pub speed: f64,
}

fn parse_speed(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(speed) if (0.1..=1000.0).contains(&speed) => Ok(speed),
        _ => Err(format!("{text:?} is not a speed from 0.1 to 1000; 1 is real time")),
    }
}
