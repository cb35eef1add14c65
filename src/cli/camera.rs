//! `twinrig camera RIG`: look at the rig's camera, and lock it.
//!
//! Without options, its modes and controls are listed, with what the rig file locks and what it leaves to automatics.
//! `--preview FILE.png` takes one picture. `--lock` lets exposure, gain, white balance and focus settle on
//! what is in view, switches their automatics off at these values, and reads everything back; `--save` writes
//! the lock into the rig file, keeping its comments. Show the camera the untouched, lit sensor while locking.

use super::exit::Exit;
use super::options::RigOptions;
use super::screen;
use crate::clock::Clock;
use crate::config::edit::{controls_toml, write_controls};
use crate::config::{ConfigError, Setup};
use crate::device::camera::freeze::{freeze, left_on};
use crate::device::camera::list::{self, CameraListing};
use crate::device::camera::settings::{CameraSettings, CameraSource};
use crate::device::camera::{Camera, CameraError, controls, open};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

/// Look at the rig's camera, lock it, save the lock
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig camera rig_configs/skin_marlin_grbl.toml\n  twinrig camera rig_configs/virtual.toml --preview /tmp/now.png\n  twinrig camera my_rig.toml --lock --save --preview locked.png"
)]
pub struct Args {
    #[command(flatten)]
    pub rig: RigOptions,
    /// Write one picture
    #[arg(long, value_name = "PNG")]
    pub preview: Option<PathBuf>,
    /// Lock exposure, gain, white balance and focus at what their automatics settle on
    #[arg(long)]
    pub lock: bool,
    /// Write the lock into the rig file
    #[arg(long, requires = "lock")]
    pub save: bool,
    /// How long the automatics have to settle, s
    #[arg(long, default_value_t = 2.0, value_parser = parse_settle)]
    pub settle: f64,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

fn parse_settle(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=60.0).contains(&seconds) => Ok(seconds),
        _ => Err(format!("{text:?} is not a time from 0 to 60 s")),
    }
}

/// How long a frame may take.
const WITHIN: Duration = Duration::from_secs(5);

/// What was found and done.
#[derive(Debug, Default, serde::Serialize)]
struct Outcome {
    /// The camera as it is listed; absent where its source lists none.
    camera: Option<CameraListing>,
    /// Keys and values of the rig file, or of the new lock.
    controls: BTreeMap<String, i64>,
    /// As they read back after locking.
    reads_back: Vec<(String, i64)>,
    /// Automatics that nothing switches off.
    left_on: Vec<String>,
    preview: Option<PathBuf>,
    saved: Option<PathBuf>,
}

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        let done = match crate::config::load(&self.rig.rig, None, &self.rig.overrides.set) {
            Ok(setup) => self.look(&setup).await,
            Err(e) => Err(e.into()),
        };
        match done {
            Ok(outcome) if self.json => screen::json(&json!(outcome)),
            Ok(outcome) => self.show(&outcome),
            Err(e) => {
                screen::error(&e);
                return if e.nothing_was_touched() { Exit::Refused } else { Exit::Failed };
            }
        }
        Exit::Done
    }

    async fn look(&self, setup: &Setup) -> Result<Outcome, Problem> {
        let mut settings = setup.rig.camera.clone();
        if self.lock && settings.source != CameraSource::V4l {
            return Err(Problem::NoControls { kind: format!("{:?}", settings.source).to_lowercase() });
        }
        if self.save && !self.rig.rig.is_file() {
            return Err(Problem::BuiltIn { rig: self.rig.rig.display().to_string() });
        }
        let mut outcome = Outcome { camera: listed(&settings), ..Outcome::default() };
        let is_real = matches!(settings.source, CameraSource::V4l | CameraSource::Nokhwa);
        if is_real && settings.device.is_some() && outcome.camera.is_none() {
            let found: Vec<String> = list::list().into_iter().map(|c| c.device).collect();
            let found = if found.is_empty() { "none".to_owned() } else { found.join(", ") };
            return Err(Problem::Absent { camera: settings.label(), found });
        }
        if self.lock {
            let lock = self.find_lock(&settings).await?;
            // The same control under another name is replaced, not doubled.
            let is_same = |a: &str, b: &str| a != b && controls::parse(a) == controls::parse(b);
            let keys: Vec<String> = settings.controls.keys().cloned().collect();
            let replaced: Vec<String> =
                keys.into_iter().filter(|k| lock.keys().any(|l| is_same(k, l))).collect();
            settings.controls.retain(|key, _| !replaced.contains(key));
            settings.controls.extend(lock.clone());
            let mut camera = open::open(&settings, Clock::real_time()).await?;
            outcome.reads_back = camera.description().controls.clone();
            outcome.camera = listed(&settings);
            self.take_preview(camera.as_mut(), &mut outcome).await?;
            if self.save {
                write_controls(&self.rig.rig, &lock, &replaced)?;
                outcome.saved = Some(self.rig.rig.clone());
            }
        } else if self.preview.is_some() {
            let mut camera = crate::assemble::camera_alone(setup, Clock::real_time()).await?;
            outcome.reads_back = camera.description().controls.clone();
            self.take_preview(camera.as_mut(), &mut outcome).await?;
        }
        if let Some(camera) = &outcome.camera {
            outcome.left_on = left_on(&camera.controls, &settings.controls);
        }
        outcome.controls = settings.controls;
        Ok(outcome)
    }

    /// Lets the automatics settle and answers what they settled on.
    async fn find_lock(&self, settings: &CameraSettings) -> Result<BTreeMap<String, i64>, Problem> {
        let free = CameraSettings { controls: BTreeMap::new(), ..settings.clone() };
        let clock = Clock::real_time();
        let mut camera = open::open(&free, clock).await?;
        let end = clock.now().after(Duration::from_secs_f64(self.settle));
        while clock.now() < end {
            camera.frame_after(clock.now(), WITHIN).await?;
        }
        // Read while it streams: some cameras run their automatics only then.
        let listing = listed(settings);
        drop(camera);
        let lock = listing.map(|l| freeze(&l.controls)).unwrap_or_default();
        if lock.is_empty() {
            return Err(Problem::NothingToLock { camera: settings.label() });
        }
        Ok(lock)
    }

    async fn take_preview(&self, camera: &mut dyn Camera, outcome: &mut Outcome) -> Result<(), Problem> {
        let Some(path) = &self.preview else { return Ok(()) };
        let frame = camera.frame_after(Clock::real_time().now(), WITHIN).await?;
        let bytes = crate::image::png::encode(&frame)?;
        std::fs::write(path, bytes)
            .map_err(|e| Problem::Write { path: path.display().to_string(), why: e.to_string() })?;
        outcome.preview = Some(path.clone());
        Ok(())
    }

    fn show(&self, outcome: &Outcome) {
        match &outcome.camera {
            Some(camera) => screen::result(camera),
            None => screen::result("this rig's camera has no modes and controls to list"),
        }
        if !outcome.controls.is_empty() {
            screen::result(if self.lock { "locked:" } else { "the rig file locks:" });
            screen::result(controls_toml(&outcome.controls));
        }
        if !outcome.left_on.is_empty() {
            screen::warning(format_args!(
                "left to automatics: {}; lock them with --lock --save before collecting",
                outcome.left_on.join(", ")
            ));
        }
        if let Some(path) = &outcome.preview {
            screen::result(format_args!("preview: {}", path.display()));
        }
        match &outcome.saved {
            Some(path) => screen::result(format_args!("saved in {}", path.display())),
            None if self.lock => {
                screen::note("not saved; add --save, or copy the lines above into the rig file")
            }
            None => {}
        }
    }
}

/// The rig's camera among those that are connected.
fn listed(settings: &CameraSettings) -> Option<CameraListing> {
    if !matches!(settings.source, CameraSource::V4l | CameraSource::Nokhwa) {
        return None;
    }
    let wanted = settings.device.as_deref()?;
    let node = std::fs::canonicalize(wanted).map_or_else(|_| wanted.to_owned(), |p| p.display().to_string());
    let by_number = format!("/dev/video{wanted}");
    let is_it = |c: &CameraListing| {
        c.node == node || c.device == wanted || c.name == wanted || c.node == by_number || c.node == wanted
    };
    list::list().into_iter().find(is_it)
}

/// Why not.
#[derive(Debug, thiserror::Error)]
enum Problem {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(
        "a camera with source = \"{kind}\" has no controls to lock; on Linux set source = \"v4l\" in [camera]"
    )]
    NoControls { kind: String },
    #[error("{rig} is no file that can be written; copy the shipped rig file and name the copy")]
    BuiltIn { rig: String },
    #[error(
        "camera {camera} is not connected; connected: {found}. Plug it in, or correct camera.device in the rig file"
    )]
    Absent { camera: String, found: String },
    #[error("camera {camera}: it has no exposure, gain, white balance or focus that could be locked")]
    NothingToLock { camera: String },
    #[error(transparent)]
    Camera(#[from] CameraError),
    #[error(transparent)]
    Image(#[from] crate::image::Error),
    #[error(transparent)]
    Edit(#[from] crate::config::edit::EditError),
    #[error("cannot write {path}: {why}; check --preview")]
    Write { path: String, why: String },
}

impl Problem {
    fn nothing_was_touched(&self) -> bool {
        matches!(self, Problem::Config(_) | Problem::NoControls { .. } | Problem::BuiltIn { .. })
    }
}
