//! `twinrig simulate RIG PLAN --out DIR`: the twin alone.
//!
//! Writes `captures.jsonl`, a line for each capture with its pose, the forces, the solver's account and
//! the seconds it took. With `--surface` the displaced surface of each capture goes to
//! `surface/<capture>.npy` (float32 [ny][nx][3], mm, pad frame) and nothing is rendered unless `--render`
//! asks for it too; without `--surface` pictures and depth maps are rendered.

use super::exit::Exit;
use super::options::RigAndPlan;
use std::path::PathBuf;

/// Run the twin alone and write surfaces, forces and pictures
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  twinrig simulate rig_configs/virtual.toml rig_configs/plans/slip.toml --out /tmp/slip --surface\n  twinrig simulate rig_configs/virtual.toml rig_configs/plans/small.toml --out /tmp/small --captures 0-2 --set elastomer.mode=quasi_static")]
pub struct Args {
    #[command(flatten)]
    pub files: RigAndPlan,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Write the displaced surface of each capture; render nothing unless --render is given too
    #[arg(long)]
    pub surface: bool,
    /// Render pictures and depth maps (the default without --surface)
    #[arg(long)]
    pub render: bool,
    /// Picture of the untouched sensor to wear as texture
    #[arg(long, value_name = "PNG")]
    pub background: Option<PathBuf>,
    /// Only these captures, e.g. 0,4,8-11
    #[arg(long, value_name = "LIST")]
    pub captures: Option<String>,
    /// Print the summary as one JSON document
    #[arg(long)]
    pub json: bool,
}
