//! `twinrig move RIG --z 5`: go to one pose.
//!
//! Coordinates are those of the pad frame, relative to the nominal contact of the rig file; what is not
//! given stays. The rig is homed first when it does not know where it is and `--home` allows it. Every
//! limit is checked before a byte is sent, and a pose below the surface needs `--press`.

use super::exit::Exit;
use super::options::{RigOptions, Speed};

/// Move to a pose in the pad frame
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  twinrig move rig_configs/virtual.toml --z 5 --home\n  twinrig move rig_configs/virtual.toml --x 1.5 --theta 10 --home")]
pub struct Args {
    #[command(flatten)]
    pub rig: RigOptions,
    /// To the right in the image, mm
    #[arg(long, allow_negative_numbers = true)]
    pub x: Option<f64>,
    /// Down in the image, mm
    #[arg(long, allow_negative_numbers = true)]
    pub y: Option<f64>,
    /// Height of the tip above the nominal contact, mm
    #[arg(long, allow_negative_numbers = true)]
    pub z: Option<f64>,
    /// Rotation, clockwise in the image, degrees
    #[arg(long, allow_negative_numbers = true)]
    pub theta: Option<f64>,
    /// Feed along lines, mm/s
    #[arg(long, default_value_t = 2.0)]
    pub feed: f64,
    /// Feed of the rotation, deg/s
    #[arg(long, default_value_t = 10.0)]
    pub turn: f64,
    /// Home first if the position is not known
    #[arg(long)]
    pub home: bool,
    /// Allow a height below the nominal contact
    #[arg(long)]
    pub press: bool,
    #[command(flatten)]
    pub speed: Speed,
    /// Print the pose reached as one JSON document
    #[arg(long)]
    pub json: bool,
}
