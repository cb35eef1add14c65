//! `twinrig render SCENE.json`: renders a scene of the tactile-bench format; `twinrig render SENSOR`: a sensor untouched.
//!
//! The result is linear RGB float32 [h][w][3], row 0 on top. `--size` changes the camera's raster only, never
//! the mesh. `--repeat N` renders N times and `--json` prints the seconds of what is done once and of each
//! frame, so that cost can be compared with error, and the error that the fast mode expects, with whether that is within
//! `--tolerance`: where it is not, a warning says so. A frame's seconds fall into what makes the changed pad ready (its
//! tree or heights; as long for any number of samples) and the light itself. `--basis FOLDER` renders one picture a
//! light, whose colours [`relight`](super::relight) changes without rendering; the fast mode states the error of each, and of
//! their sum. A sensor's PNG is what its camera would give, without noise.

use super::exit::Exit;
use super::{options, picture_file, screen};
use crate::config::{ConfigError, sensor_file};
use crate::optics::basis_folder::{self, Contents};
use crate::optics::bench_scene::Variant;
use crate::optics::imager::Notice;
use crate::optics::render_file::{Mode, Rendered, Request, Times, render_file, render_sensor};
use crate::optics::sensor_basis::SensorCamera;
use crate::optics::{Error, imaging};
use crate::twin::untouched_face;
use glam::Vec3;
use std::path::{Path, PathBuf};

/// Render a benchmark scene, or a sensor untouched, to linear RGB
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  twinrig render tests/data/optics/tactile-bench-1.json --variant Ac --mode reference --spp 64 --size 320x240 --out /tmp/ac.npy --json\n  twinrig render gelsight --mode fast --out /tmp/untouched.png\n  twinrig render rig_configs/sensors/digit.toml --mode fast --basis /tmp/digit --out /tmp/digit.png"
)]
pub struct Args {
    /// Scene file (.json), or a sensor: its file (.toml) or its name
    #[arg(value_name = "SCENE|SENSOR")]
    pub scene: PathBuf,
    /// Which variant of a scene: Ac (constant albedo; the default), At (textured), B (with the plate)
    #[arg(long, value_parser = parse_variant)]
    pub variant: Option<Variant>,
    /// How: reference (path tracing) or fast
    #[arg(long, default_value = "reference", value_parser = parse_mode)]
    pub mode: Mode,
    /// Samples per pixel (reference mode; 64 unless given)
    #[arg(long, value_parser = options::whole::<u32>(1..=1_000_000))]
    pub spp: Option<u32>,
    /// Error asked for (fast mode; 0.005 unless given); from 0.002 to 0.01 it picks the work. What the method leaves out does not shrink
    /// with work: under four even lights 0.002 is stated at the least, under one 0.004, under more less. To ask for less than 0.002 takes
    /// longer and is hardly nearer to the truth: --mode reference is. To ask for more than 0.01 saves
    /// nothing of most pictures
    #[arg(long, value_parser = options::tolerance)]
    pub tolerance: Option<f64>,
    /// Raster as WIDTHxHEIGHT; the scene's or sensor's own by default
    #[arg(long, value_name = "WxH", value_parser = |text: &str| options::raster(text, 1..=16_384))]
    pub size: Option<[usize; 2]>,
    /// Render this many times
    #[arg(long, default_value_t = 1, value_parser = options::whole::<u32>(1..=10_000))]
    pub repeat: u32,
    /// Seed of the samples (reference mode; 0 unless given)
    #[arg(long, value_parser = options::whole(0..=u32::MAX))]
    pub seed: Option<u32>,
    /// Where to write the picture (.npy, or .png for a look; of a sensor as its camera gives it, but for the noise)
    #[arg(long, value_name = "FILE", value_parser = picture_file::parse)]
    pub out: PathBuf,
    /// Render one picture a light and write them here; the picture is then made of them. estimated_error
    /// is that of their sum, of which the tolerance is asked, and basis_errors are those of the pictures in turn
    #[arg(long, value_name = "FOLDER")]
    pub basis: Option<PathBuf>,
    /// Print one JSON document with the seconds
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        let rendered = self.render();
        if self.mode == Mode::Fast && rendered.is_ok() {
            Notice::of_tolerance(self.tolerance()).into_iter().for_each(screen::warning);
        }
        if let Some(why) = rendered.as_ref().ok().and_then(why_dark) {
            screen::warning(format_args!("the picture of {} is black: {why}", self.scene.display()));
        }
        match rendered {
            Ok(times) => {
                if times.meets_tolerance == Some(false) {
                    let estimated = times.estimated_error.unwrap_or_default();
                    Notice::of_error(estimated, self.tolerance()).into_iter().for_each(screen::warning);
                }
                self.tell(&times)
            }
            Err((e, exit)) => {
                screen::error(e);
                exit
            }
        }
    }

    fn tolerance(&self) -> f64 {
        self.tolerance.unwrap_or(0.005)
    }

    /// Refuses options of the other mode: who gives one expects it to do something.
    fn options_of_its_mode(&self) -> Result<(), Error> {
        let given = [
            ("--tolerance", self.tolerance.map(|v| v.to_string()), Mode::Fast, "fast"),
            ("--spp", self.spp.map(|v| v.to_string()), Mode::Reference, "reference"),
            ("--seed", self.seed.map(|v| v.to_string()), Mode::Reference, "reference"),
        ];
        for (name, value, mode, its) in given {
            if let Some(value) = value.filter(|_| mode != self.mode) {
                let why = format!("only the {its} mode has it; leave it out, or render with --mode {its}");
                return Err(Error::Argument { name, value, why });
            }
        }
        Ok(())
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
            times.estimated_error.map_or_else(String::new, |e| {
                let what = if times.mode == Mode::Fast { "relRMSE" } else { "noise" };
                format!(", {what} about {:.2} %", 100.0 * e)
            }),
        ));
        Exit::Done
    }

    /// Whether a sensor is meant: by its file, or by a name that is no file's.
    fn is_of_sensor(&self) -> bool {
        match self.scene.extension() {
            Some(ending) => ending == "toml",
            None => !self.scene.is_file(),
        }
    }

    /// Renders and writes. What can be told beforehand is refused; once there is a picture, losing it is a failure.
    pub(super) fn render(&self) -> Result<Times, (RenderError, Exit)> {
        let refused = |e: Error| (RenderError::from(e), Exit::Refused);
        let failed = |e: Error| (RenderError::from(e), Exit::Failed);
        self.options_of_its_mode().map_err(refused)?;
        picture_file::can_be_written(&self.out).map_err(refused)?;
        if let Some(folder) = &self.basis {
            picture_file::can_be_filled(folder).map_err(refused)?;
        }
        let request = Request {
            variant: self.variant.unwrap_or(Variant::Ac),
            mode: self.mode,
            samples: self.spp.unwrap_or(64),
            tolerance: self.tolerance(),
            size: self.size,
            repeat: self.repeat,
            seed: self.seed.unwrap_or(0),
            basis: self.basis.is_some(),
            store: crate::assemble::optics_store(),
        };
        let rendered = match self.is_of_sensor() {
            true => self.render_sensor(&self.scene, &request),
            false => render_file(&self.scene, &request).map(|r| (r, None)).map_err(RenderError::from),
        };
        let (Rendered { picture, basis, times }, camera) = rendered.map_err(|e| (e, Exit::Refused))?;
        picture_file::write(&self.out, &picture, camera.as_ref()).map_err(failed)?;
        if let (Some(folder), Some(basis)) = (&self.basis, basis) {
            let (radiances, errors) = (times.radiances.clone(), times.basis_errors.clone());
            let error_of_sum = times.estimated_error;
            let contents = Contents { basis, radiances, errors, error_of_sum, camera };
            basis_folder::write(folder, &contents).map_err(failed)?;
        }
        Ok(times)
    }

    fn render_sensor(
        &self,
        path: &Path,
        request: &Request,
    ) -> Result<(Rendered, Option<SensorCamera>), RenderError> {
        if let Some(variant) = self.variant {
            return Err(RenderError::VariantOfSensor(variant));
        }
        let sensor = sensor_file(path)?;
        let rendered = render_sensor(&sensor.optics, &untouched_face(&sensor.pad), request)?;
        let image_mean = sensor.untouched.as_ref().map(|p| imaging::mean_light(&p.rgb, &sensor.optics.image));
        let camera = SensorCamera::new(&sensor.optics, &rendered.picture, image_mean);
        Ok((rendered, Some(camera)))
    }
}

/// Why nothing was rendered.
#[derive(Debug, thiserror::Error)]
pub(super) enum RenderError {
    /// The sensor's file.
    #[error(transparent)]
    Sensor(#[from] ConfigError),
    /// The light or the files of pictures.
    #[error(transparent)]
    Optics(Error),
    /// Sessions fall back by themselves; here a mode was asked for.
    #[error("{0}: choose --mode reference (a session's twin does so by itself, and says so)")]
    NotFast(Error),
    /// An option that sensors do not have.
    #[error("--variant {0:?}: a sensor has no variants, only scene files have; leave it out")]
    VariantOfSensor(Variant),
}

impl From<Error> for RenderError {
    fn from(e: Error) -> Self {
        match e {
            Error::NotFast { .. } => Self::NotFast(e),
            e => Self::Optics(e),
        }
    }
}

/// Why a picture is black, if it is, and what to do about it.
fn why_dark(times: &Times) -> Option<&'static str> {
    let shines = times.radiances.iter().any(|radiance| *radiance != Vec3::ZERO);
    times.is_dark.then_some(match shines {
        true => {
            "what it shows reflects no light to the camera; give the pad an albedo above 0, or let a light reach it"
        }
        false => "no light of it shines; give one a radiance above 0",
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
