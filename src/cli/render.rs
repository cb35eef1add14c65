//! `twinrig render SCENE.json`: renders a scene of the tactile-bench format.
//!
//! The result is linear RGB float32 [h][w][3], row 0 on top. `--size` changes the camera's raster only, never
//! the mesh. `--repeat N` renders N times and `--json` prints the seconds of what is done once and of each
//! frame, so that cost can be compared with error, and the error that the fast mode expects, with whether that is within
//! `--tolerance`: where it is not, a warning says so. A frame's seconds fall into what makes the changed pad ready (its
//! tree or heights; as long for any number of samples) and the light itself. `--basis FOLDER` renders one picture a
//! light, whose colours [`relight`](super::relight) changes without rendering.

use super::exit::Exit;
use super::{picture_file, screen};
use crate::optics::Error;
use crate::optics::basis_folder;
use crate::optics::bench_scene::Variant;
use crate::optics::imager::Notice;
use crate::optics::render_file::{Mode, Rendered, Request, Times, render_file};
use std::path::PathBuf;

/// Render a benchmark scene to linear RGB
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  twinrig render tests/data/optics/tactile-bench-1.json --variant Ac --mode reference --spp 64 --size 320x240 --out /tmp/ac.npy --json"
)]
pub struct Args {
    /// Scene file
    pub scene: PathBuf,
    /// Which variant: Ac (constant albedo), At (textured), B (with the plate)
    #[arg(long, default_value = "Ac", value_parser = parse_variant)]
    pub variant: Variant,
    /// How: reference (path tracing) or fast
    #[arg(long, default_value = "reference", value_parser = parse_mode)]
    pub mode: Mode,
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
    pub seed: u32,
    /// Where to write the picture (.npy, or .png for a look)
    #[arg(long, value_name = "FILE", value_parser = picture_file::parse)]
    pub out: PathBuf,
    /// Render one picture a light and write them here; the picture is then made of them
    #[arg(long, value_name = "FOLDER")]
    pub basis: Option<PathBuf>,
    /// Print one JSON document with the seconds
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        match self.render() {
            Ok(times) if times.meets_tolerance == Some(false) => {
                let estimated = times.estimated_error.unwrap_or_default();
                screen::warning(Notice::AboveTolerance { estimated, tolerance: self.tolerance });
                self.tell(&times)
            }
            Ok(times) => self.tell(&times),
            Err(e) => {
                screen::error(e);
                Exit::Refused
            }
        }
    }

    fn tell(&self, times: &Times) -> Exit {
        if self.json {
            screen::json(times);
            return Exit::Done;
        }
        let ([width, height], frames) = (times.size, times.per_frame_s.len());
        screen::result(format_args!(
            "{}: {width} x {height}, {:.3} s once, {:.3} s a frame (best of {frames}; {:.3} s of it before any light){}{}",
            self.out.display(),
            times.one_off_s,
            times.best_frame_s,
            times.best_structure_s,
            times.best_recolour_s.map_or_else(String::new, |s| format!(", {:.2} ms to recolour", 1e3 * s)),
            times.estimated_error.map_or_else(String::new, |e| format!(", relRMSE about {:.2} %", 100.0 * e)),
        ));
        Exit::Done
    }

    fn render(&self) -> Result<Times, Error> {
        let request = Request {
            variant: self.variant,
            mode: self.mode,
            samples: self.spp,
            tolerance: self.tolerance,
            size: self.size.as_deref().map(raster).transpose()?,
            repeat: self.repeat,
            seed: self.seed,
            basis: self.basis.is_some(),
            store: crate::assemble::cache::optics_store(),
        };
        let Rendered { picture, basis, times } = render_file(&self.scene, &request)?;
        picture_file::write(&self.out, &picture)?;
        if let (Some(folder), Some(basis)) = (&self.basis, &basis) {
            basis_folder::write(folder, basis, &times.radiances)?;
        }
        Ok(times)
    }
}

fn raster(size: &str) -> Result<[usize; 2], Error> {
    let parsed = size.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    parsed.filter(|raster| raster.iter().all(|n| (1..=16_384).contains(n))).ok_or_else(|| Error::Setting {
        key: "size",
        value: size.to_owned(),
        why: "write WIDTHxHEIGHT with 1 to 16384 each, e.g. 640x480".to_owned(),
    })
}

fn parse_variant(text: &str) -> Result<Variant, String> {
    match text {
        "Ac" => Ok(Variant::Ac),
        "At" => Ok(Variant::At),
        "B" => Ok(Variant::B),
        other => Err(format!(
            "{other:?} is no variant; choose Ac (constant albedo), At (textured) or B (with the plate)"
        )),
    }
}

fn parse_mode(text: &str) -> Result<Mode, String> {
    match text {
        "reference" => Ok(Mode::Reference),
        "fast" => Ok(Mode::Fast),
        other => Err(format!("{other:?} is no mode; choose reference or fast")),
    }
}
