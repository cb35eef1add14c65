//! `twinrig collect RIG PLAN --out DIR`: the main job.
//!
//! Performs the plan on the bench and runs the twin beside it, stores both sides of every capture as it
//! comes, pairs them, and writes the report. On a virtual bench nothing else is needed; on a real one each
//! indenter is asked for by name before it is used. A session that was interrupted, by a signal, a
//! fault or a power cut, continues with `--resume`: nothing is lost, doubled or torn.

use super::exit::Exit;
use super::options::{RigAndPlan, Speed};
use std::path::PathBuf;

/// Perform a plan, simulate it, and store the paired dataset
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  twinrig collect rig_configs/virtual.toml rig_configs/plans/slip.toml --out data/slip\n  twinrig collect rig_configs/virtual.toml rig_configs/plans/slip.toml --out data/slip --resume\n  twinrig collect rig_configs/gelsight_printer.toml rig_configs/plans/press.toml --out data/press --dry-run")]
pub struct Args {
    #[command(flatten)]
    pub files: RigAndPlan,
    /// Folder of the dataset
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Continue an interrupted collection in the same folder
    #[arg(long)]
    pub resume: bool,
    /// Check everything and print the bytes that would be sent; touch nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Do not ask for confirmation of indenters (they are mounted as the plan says)
    #[arg(long)]
    pub yes: bool,
    /// Only the bench, no simulation
    #[arg(long, conflicts_with = "sim_only")]
    pub real_only: bool,
    /// Only the simulation of what is missing in an existing dataset, no bench
    #[arg(long)]
    pub sim_only: bool,
    #[command(flatten)]
    pub speed: Speed,
    /// Print the summary as one JSON document
    #[arg(long)]
    pub json: bool,
}
