//! `twinrig capture RIG --out FILE.png`: one picture from the rig's camera.
//!
//! Takes a frame exposed after now, with the controls of the rig file locked. Nothing moves.

use super::exit::Exit;
use super::options::RigOptions;
use std::path::PathBuf;

/// Take one picture
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  twinrig capture rig_configs/virtual.toml --out /tmp/now.png")]
pub struct Args {
    #[command(flatten)]
    pub rig: RigOptions,
    /// Where to write the picture
    #[arg(long, value_name = "PNG")]
    pub out: PathBuf,
    /// Print what is known about the frame as one JSON document
    #[arg(long)]
    pub json: bool,
}
