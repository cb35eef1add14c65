//! `twinrig render SCENE.json`: renders a scene of the tactile-bench format.
//!
//! The result is linear RGB float32 [h][w][3], row 0 on top. `--size` changes the camera's raster only, never
//! the mesh. `--repeat N` renders N times and `--json` prints the seconds of what is done once and of each
//! frame, so that cost can be compared with error.

use super::exit::Exit;
use std::path::PathBuf;

/// Render a benchmark scene to linear RGB
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  twinrig render tests/data/optics/tactile-bench-1.json --variant Ac --mode reference --spp 64 --size 320x240 --out /tmp/ac.npy --json")]
pub struct Args {
    /// Scene file
    pub scene: PathBuf,
    /// Which variant: Ac (constant albedo), At (textured), B (with the plate)
    #[arg(long, default_value = "Ac")]
    pub variant: String,
    /// How: reference (path tracing) or fast
    #[arg(long, default_value = "reference")]
    pub mode: String,
    /// Samples per pixel (reference mode)
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub spp: u32,
    /// Error asked for (fast mode)
    #[arg(long, default_value_t = 0.005)]
    pub tolerance: f64,
    /// Raster as WIDTHxHEIGHT; the scene's own by default
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// Render this many times
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeat: u32,
    /// Seed of the samples
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Where to write the picture (.npy, or .png for a look)
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Print one JSON document with the seconds
    #[arg(long)]
    pub json: bool,
}
