//! `twinrig simulate RIG PLAN --out DIR`: the twin alone.
//!
//! Writes `captures.jsonl`, a line for each capture with its pose, the forces, the solver's account and
//! the seconds it took, or with its pose and why it failed. With `--surface` the displaced surface of each capture goes to
//! `surface/<capture>.npy` (float32 [ny][nx][3], mm, pad frame) and nothing is rendered unless `--render`
//! or `--basis` asks for it too; without `--surface` pictures and depth maps are rendered. With `--basis` the light of each
//! capture goes to a folder `basis/<capture>/` as `render --basis` writes one, for [`relight`](super::relight). With `--judge` its
//! lines tell how far each picture's light is from the truth.

mod account;
mod desk;
mod mark;
mod verdict;

use super::exit::Exit;
use super::options::{self, RigAndPlan};
use super::screen;
use super::signals::{AtOnce, Signals};
use crate::assemble;
use crate::config::Setup;
use crate::image::png;
use crate::optics::basis_folder;
use crate::optics::sensor::{CameraSpec, TextureMode};
use crate::session::{StopLevel, StopSwitch};
use crate::twin::branches::grow;
use crate::twin::{Twin, Walk, Wear};
use account::Account;
use desk::Desk;
use mark::Mark;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use verdict::{Found, Verdicts};

/// Run the twin alone and write surfaces, forces and pictures
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig simulate rig_configs/virtual.toml rig_configs/plans/slip.toml --out /tmp/slip --surface\n  twinrig simulate rig_configs/virtual.toml rig_configs/plans/small.toml --out /tmp/small --captures 0-2 --set elastomer.mode=quasi_static\n  twinrig simulate rig_configs/virtual.toml rig_configs/plans/small.toml --out /tmp/small --basis\n  twinrig simulate rig_configs/virtual.toml rig_configs/plans/press.toml --out /tmp/press --captures 10,21 --judge 16"
)]
pub struct Args {
    #[command(flatten)]
    pub files: RigAndPlan,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Write the displaced surface of each capture; render nothing unless --render or --basis is given too
    #[arg(long)]
    pub surface: bool,
    /// Render pictures and depth maps (the default without --surface)
    #[arg(long)]
    pub render: bool,
    /// Render light by light, and write one picture a light (linear light, float32) of each capture to DIR/basis/<capture>,
    /// for relight. 640 x 480 pixels take 3.7 MB a light and capture. The tolerance is asked of their sum: what each alone may be off is told
    /// in its basis.json. An image of the untouched sensor that is worn is not
    /// in them
    #[arg(long)]
    pub basis: bool,
    /// Also render each picture twice by the reference mode, with so many samples a pixel, and tell how far its light is from the
    /// truth beside what it states. 640 x 480 pixels take half a minute for 16 samples; more know it more exactly
    #[arg(long, value_name = "SAMPLES", value_parser = options::whole::<u32>(1..=65_536))]
    pub judge: Option<u32>,
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

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        let setup =
            match crate::config::load(&self.files.rig, Some(&self.files.plan), &self.files.overrides.set) {
                Ok(setup) => setup,
                Err(e) => {
                    screen::error(e);
                    return Exit::Refused;
                }
            };
        setup.warnings.iter().for_each(screen::warning);
        let stop = StopSwitch::new();
        let signals = match Signals::listen(stop.clone(), AtOnce::Account) {
            Ok(signals) => signals,
            Err(e) => {
                screen::error(format_args!("signals cannot be caught: {e}"));
                return Exit::Failed;
            }
        };
        let cancel = Arc::new(AtomicBool::new(false));
        tokio::spawn({
            let cancel = cancel.clone();
            async move {
                stop.raised_to(StopLevel::Controlled).await;
                cancel.store(true, Ordering::Relaxed);
            }
        });
        let json = self.json;
        let simulated = tokio::task::spawn_blocking(move || self.simulate(&setup, &cancel)).await;
        match simulated {
            Ok(Ok(summary)) => {
                if json {
                    screen::json(&summary);
                } else {
                    screen::result(&summary);
                }
                match signals.exit() {
                    Some(exit) => exit,
                    None if summary.failed > 0 => Exit::Failed,
                    None => Exit::Done,
                }
            }
            Ok(Err(e)) => {
                let exit = e.exit();
                screen::error(e);
                exit
            }
            Err(e) => {
                screen::error(format_args!("the simulation ended unexpectedly: {e}"));
                Exit::Failed
            }
        }
    }

    fn simulate(&self, setup: &Setup, cancel: &Arc<AtomicBool>) -> Result<Summary, SimulateError> {
        let begun = Instant::now();
        let is_rendered = self.render || self.basis || !self.surface;
        if let Some(path) = self.background.clone().filter(|_| !is_rendered) {
            return Err(SimulateError::Unworn { path });
        }
        if let Some(samples) = self.judge.filter(|_| !is_rendered) {
            return Err(SimulateError::Unjudged { samples });
        }
        let plan = setup.plan.as_ref().ok_or(SimulateError::NoPlan)?;
        let trajectory = &plan.trajectory;
        let twin = assemble::twin(setup)?;
        let wears_none = twin.view.sensor.texture == TextureMode::None;
        if let Some(path) = self.background.clone().filter(|_| wears_none) {
            return Err(SimulateError::Bare { path });
        }
        let wanted = self.wanted(trajectory.captures.len() as u32)?;
        let mark = Mark::of(trajectory, setup);
        mark.belongs_in(&self.out)?;
        let wear = if is_rendered { Some(self.wear(&twin)?) } else { None };

        mark.leave_in(&self.out)?;
        let folders = [(true, ""), (self.surface, "surface"), (is_rendered, "sim"), (is_rendered, "depth")];
        for (_, name) in folders.into_iter().filter(|(needed, _)| *needed) {
            let path = self.out.join(name);
            std::fs::create_dir_all(&path).map_err(|e| SimulateError::Write { path, why: e.to_string() })?;
        }

        self.clear_earlier()?;
        let bars = screen::bars();
        let bar = screen::bar(&bars, "simulated", wanted.len() as u64);
        let account = Account::begin(&self.out.join("captures.jsonl"))?;
        let (wear, verdicts) = (wear.as_ref(), Verdicts::default());
        let desk = Desk { args: self, twin: &twin, wear, trajectory, bar: &bar, account, verdicts };
        let roots = grow(trajectory, &wanted, &twin.model.settings, |i| trajectory.waypoints[i].pose);
        let emit = |outcome| desk.take(outcome);
        let (model, crew) = (&twin.model, &twin.crew);
        Walk { model, lattice: model.settings.surface, crew, cancel, emit: &emit }.run(&roots);
        bar.finish_and_clear();
        let (simulated, failed) = desk.account.close()?;
        let (captures, seconds) = (wanted.len(), begun.elapsed().as_secs_f64());
        let is_complete = simulated == captures;
        let judged = desk.verdicts.found();
        Ok(Summary { out: self.out.clone(), captures, simulated, failed, is_complete, judged, seconds })
    }

    /// Removes what an earlier run left in the same folder, so that nothing of it is taken for this one's.
    fn clear_earlier(&self) -> Result<(), SimulateError> {
        for entry in std::fs::read_dir(self.out.join("basis")).into_iter().flatten().flatten() {
            let is_ours = entry.file_name().to_str().is_some_and(is_of_capture);
            if is_ours && entry.path().is_dir() {
                basis_folder::remove(&entry.path())?;
            }
        }
        for (folder, extension) in [("surface", "npy"), ("sim", "png"), ("depth", "tiff")] {
            for entry in std::fs::read_dir(self.out.join(folder)).into_iter().flatten().flatten() {
                let path = entry.path();
                let is_ours = path.extension().is_some_and(|e| e == extension)
                    && path.file_stem().and_then(|stem| stem.to_str()).is_some_and(is_of_capture);
                if is_ours {
                    std::fs::remove_file(&path)
                        .map_err(|e| SimulateError::Write { path: path.clone(), why: e.to_string() })?;
                }
            }
        }
        Ok(())
    }

    fn wear(&self, twin: &Twin) -> Result<Wear, SimulateError> {
        if self.basis && twin.view.sensor.lights.is_empty() {
            return Err(SimulateError::NoLight);
        }
        let untouched = match &self.background {
            None => None,
            Some(path) => Some(untouched_picture(path, &twin.view.sensor.camera)?),
        };
        let wear = twin.crew.together(|| twin.wear(untouched.as_ref())).map_err(SimulateError::Sensor)?;
        Ok(if self.basis { wear.light_by_light() } else { wear })
    }

    /// The captures of `--captures`, or all.
    fn wanted(&self, captures: u32) -> Result<BTreeSet<u32>, SimulateError> {
        let Some(list) = &self.captures else { return Ok((0..captures).collect()) };
        let wrong = || SimulateError::Captures { list: list.clone(), last: captures.saturating_sub(1) };
        let mut wanted = BTreeSet::new();
        for part in list.split(',') {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let first: u32 = first.trim().parse().map_err(|_| wrong())?;
            let last: u32 = last.trim().parse().map_err(|_| wrong())?;
            if first > last || last >= captures {
                return Err(wrong());
            }
            wanted.extend(first..=last);
        }
        Ok(wanted)
    }
}

/// Whether a name is that of a capture.
fn is_of_capture(name: &str) -> bool {
    name.len() == 6 && name.bytes().all(|digit| digit.is_ascii_digit())
}

/// The picture of the untouched sensor, in the camera's size.
fn untouched_picture(path: &Path, camera: &CameraSpec) -> Result<crate::image::Picture, SimulateError> {
    let unread = |why: String| SimulateError::Read { path: path.to_owned(), why };
    let bytes = std::fs::read(path).map_err(|e| unread(e.to_string()))?;
    let picture = png::decode(&bytes).map_err(|e| unread(e.to_string()))?;
    let (wanted, found) = ([camera.width_px, camera.height_px], [picture.width, picture.height]);
    if found.map(|n| n as usize) != wanted {
        return Err(SimulateError::Size { path: path.to_owned(), found, wanted });
    }
    Ok(picture)
}

/// What was done.
#[derive(Debug, serde::Serialize)]
struct Summary {
    out: PathBuf,
    captures: usize,
    simulated: usize,
    failed: usize,
    /// Whether every capture asked for was simulated.
    is_complete: bool,
    /// What was found of the pictures, where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    judged: Option<Found>,
    seconds: f64,
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {} of {} captures simulated", self.out.display(), self.simulated, self.captures)?;
        if self.simulated + self.failed < self.captures {
            write!(f, ", stopped (--captures with the others, into another --out, goes on)")?;
        }
        if self.failed > 0 {
            write!(f, ", {} failed (captures.jsonl says why)", self.failed)?;
        }
        write!(f, ", {:.2} s", self.seconds)?;
        self.judged.as_ref().map_or(Ok(()), |judged| write!(f, "\n{judged}"))
    }
}

impl SimulateError {
    /// What is wrong with the request leaves everything as it was.
    fn exit(&self) -> Exit {
        match self {
            Self::Optics(_) | Self::Image(_) | Self::Dataset(_) | Self::Write { .. } => Exit::Failed,
            Self::NoPlan
            | Self::Occupied { .. }
            | Self::Twin(_)
            | Self::Unworn { .. }
            | Self::Unjudged { .. }
            | Self::Bare { .. }
            | Self::NoLight
            | Self::Read { .. }
            | Self::Size { .. }
            | Self::Sensor(_)
            | Self::Captures { .. } => Exit::Refused,
        }
    }
}

/// Why nothing, or not everything, could be simulated.
#[derive(Debug, thiserror::Error)]
enum SimulateError {
    #[error("no plan was given")]
    NoPlan,
    #[error("{} holds {by}; choose another --out, or remove that folder", path.display())]
    Occupied { path: PathBuf, by: String },
    #[error(transparent)]
    Twin(#[from] assemble::TwinError),
    #[error(transparent)]
    Optics(#[from] crate::optics::Error),
    #[error(transparent)]
    Image(#[from] crate::image::Error),
    #[error(transparent)]
    Dataset(#[from] crate::dataset::Error),
    #[error("cannot write {}: {why}; check --out and the space left", path.display())]
    Write { path: PathBuf, why: String },
    #[error(
        "--background {}: with --surface nothing is rendered that could wear it; add --render, or leave it out",
        path.display()
    )]
    Unworn { path: PathBuf },
    #[error(
        "--judge {samples}: with --surface nothing is rendered that could be judged; add --render, or leave it out"
    )]
    Unjudged { samples: u32 },
    #[error(
        "--background {}: the sensor's optics.texture is \"none\", which wears no picture; give --set \
         sensor.optics.texture=ratio (or lit), or leave it out",
        path.display()
    )]
    Bare { path: PathBuf },
    #[error(
        "--basis renders one picture a light, and the sensor has no light; leave it out, or give the sensor a light"
    )]
    NoLight,
    #[error("--background {}: {why}; give a PNG of the untouched sensor", path.display())]
    Read { path: PathBuf, why: String },
    #[error(
        "--background {} is {} x {}, the sensor's camera {} x {}; take it in that size, or change the sensor file's optics.camera",
        path.display(), found[0], found[1], wanted[0], wanted[1]
    )]
    Size { path: PathBuf, found: [u32; 2], wanted: [usize; 2] },
    #[error(transparent)]
    Sensor(crate::optics::Error),
    #[error("--captures {list:?} is no list of captures from 0 to {last}; write e.g. 0,4,8-11")]
    Captures { list: String, last: u32 },
}
