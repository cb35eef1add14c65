//! `twinrig drive RIG PLAN`: the motion alone.
//!
//! Homes the rig and visits every waypoint of the plan as `collect` would, with the same checks and the
//! same order of moves, but takes no picture, finds no contact and stores nothing: heights are relative to
//! the nominal contact of the rig file.

use super::exit::Exit;
use super::options::{RigAndPlan, Speed};

/// Perform the motion of a plan, without camera and dataset
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  twinrig drive rig_configs/virtual.toml rig_configs/plans/small.toml --speed 10")]
pub struct Args {
    #[command(flatten)]
    pub files: RigAndPlan,
    #[command(flatten)]
    pub speed: Speed,
    /// Do not ask for confirmation
    #[arg(long)]
    pub yes: bool,
    /// Print the positions reached as one JSON document
    #[arg(long)]
    pub json: bool,
}
