//! `twinrig home RIG`: reference all axes.
//!
//! Verifies who is connected, then homes the pressing axis first (which lifts the indenter away) and the
//! others after it.

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
