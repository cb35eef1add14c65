//! `twinrig render SCENE.json`: renders a scene of the tactile-bench format.
//!
//! The result is linear RGB float32 [h][w][3], row 0 on top. `--size` changes the camera's raster only, never
//! the mesh. `--repeat N` renders N times and `--json` prints the seconds of what is done once and of each
//! frame, so that cost can be compared with error.

use super::exit::Exit;
use super::screen;
use crate::optics::bench_scene::{self, Variant};
use crate::optics::reference::{self, Renderer};
use crate::optics::{Error, Film};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

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

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        match self.render() {
            Ok(report) if self.json => {
                screen::json(&report);
                Exit::Done
            }
            Ok(report) => {
                screen::result(format_args!(
                    "{}: {} x {}, {:.3} s once, {:.3} s a frame (median of {})",
                    self.out.display(),
                    report.width,
                    report.height,
                    report.once_s,
                    report.frame_s,
                    report.frames_s.len()
                ));
                Exit::Done
            }
            Err(e) => {
                screen::error(e);
                Exit::Refused
            }
        }
    }

    fn render(&self) -> Result<Report, Error> {
        let variant = match self.variant.as_str() {
            "Ac" => Variant::Ac,
            "At" => Variant::At,
            "B" => Variant::B,
            other => {
                return Err(Error::Setting {
                    key: "variant",
                    value: other.to_owned(),
                    why: "choose Ac (constant albedo), At (textured) or B (with the plate)".to_owned(),
                });
            }
        };
        let mut scene = bench_scene::load(&self.scene, variant)?;
        if let Some(size) = &self.size {
            let (width, height) = raster(size)?;
            scene.camera = scene.camera.with_raster(width, height);
        }
        let begun = Instant::now();
        let renderer = Renderer::new(&scene)?;
        let once_s = begun.elapsed().as_secs_f64();
        let settings = reference::Settings { samples: self.spp, seed: self.seed as u32 };
        let mut frames_s = Vec::new();
        let mut film = None;
        for _ in 0..self.repeat {
            let begun = Instant::now();
            film = Some(renderer.render(&settings));
            frames_s.push(begun.elapsed().as_secs_f64());
        }
        let film = film.expect("clap refuses --repeat 0");
        self.write(&film)?;
        let mut sorted = frames_s.clone();
        sorted.sort_by(f64::total_cmp);
        Ok(Report {
            scene: self.scene.display().to_string(),
            variant: self.variant.clone(),
            mode: self.mode.clone(),
            width: film.width,
            height: film.height,
            spp: self.spp,
            once_s,
            frame_s: sorted[sorted.len() / 2],
            frames_s,
            out: self.out.display().to_string(),
        })
    }

    fn write(&self, film: &Film) -> Result<(), Error> {
        if self.out.extension().is_some_and(|e| e == "png") {
            let failed = |reason: String| Error::File { action: "write", path: self.out.display().to_string(), reason };
            let rgb = film.to_srgb8(PREVIEW_EXPOSURE);
            let png = crate::image::encode_png(film.width as u32, film.height as u32, &rgb).map_err(|e| failed(e.to_string()))?;
            return std::fs::write(&self.out, png).map_err(|e| failed(e.to_string()));
        }
        film.write_npy(&self.out)
    }
}

/// Exposure of a picture for a look: that of the benchmark scene's 8-bit metric.
const PREVIEW_EXPOSURE: f32 = 0.573_248_4;

#[derive(Debug, Serialize)]
struct Report {
    scene: String,
    variant: String,
    mode: String,
    width: usize,
    height: usize,
    spp: u32,
    /// Seconds for what is done once for a scene.
    once_s: f64,
    /// Median of `frames_s`.
    frame_s: f64,
    /// Seconds of each frame, with every structure that a frame needs.
    frames_s: Vec<f64>,
    out: String,
}

fn raster(size: &str) -> Result<(usize, usize), Error> {
    let parsed = size.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match parsed {
        Some((w, h)) if (1..=16_384).contains(&w) && (1..=16_384).contains(&h) => Ok((w, h)),
        _ => Err(Error::Setting {
            key: "size",
            value: size.to_owned(),
            why: "write WIDTHxHEIGHT with 1 to 16384 each, e.g. 640x480".to_owned(),
        }),
    }
}
