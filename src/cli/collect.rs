//! `twinrig collect RIG PLAN --out DIR`: the main job.
//!
//! Performs the plan on the bench and runs the twin beside it, stores both sides of every capture as it
//! comes, pairs them, and writes the report. On a virtual bench nothing else is needed; on a real one each
//! indenter is asked for by name before it is used. A session that was interrupted, by a signal, a
//! fault or a power cut, continues with `--resume`: nothing is lost, doubled or torn.

use super::at_bench::answer_others;
use super::exit::Exit;
use super::options::{RigAndPlan, Speed};
use super::screen;
use super::signals::{AtOnce, Signals};
use crate::assemble::{self, BenchOptions};
use crate::collection::{BACKGROUND, Collection, CollectionError, Progress, SessionPart};
use crate::config::{PlanSetup, Setup};
use crate::control::Board;
use crate::dataset::{self, Dataset};
use crate::device::virtual_bench::World;
use crate::session::perform::Operator;
use crate::session::{Session, StopSwitch};
use indicatif::ProgressBar;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::mpsc::UnboundedReceiver;

/// Perform a plan, simulate it, and store the paired dataset
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig collect rig_configs/virtual.toml rig_configs/plans/slip.toml --out data/slip\n  twinrig collect rig_configs/virtual.toml rig_configs/plans/slip.toml --out data/slip --resume\n  twinrig collect rig_configs/gelsight_printer.toml rig_configs/plans/press.toml --out data/press --dry-run"
)]
pub struct Args {
    #[command(flatten)]
    pub files: RigAndPlan,
    /// Folder of the dataset
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Continue an interrupted collection in the same folder
    #[arg(long)]
    pub resume: bool,
    /// Check everything and print the bytes that would be sent; touch nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Do not ask for confirmation of indenters (they are mounted as the plan says)
    #[arg(long)]
    pub yes: bool,
    /// Only the bench, no simulation
    #[arg(long, conflicts_with = "sim_only")]
    pub real_only: bool,
    /// Only the simulation of what is missing in an existing dataset, no bench
    #[arg(long)]
    pub sim_only: bool,
    #[command(flatten)]
    pub speed: Speed,
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
        if self.dry_run {
            return super::dry_run::show(&setup, self.json);
        }
        setup.warnings.iter().for_each(screen::warning);
        let stop = StopSwitch::new();
        let at_once = if self.sim_only { AtOnce::Dataset } else { AtOnce::Rig };
        let signals = match Signals::listen(stop.clone(), at_once) {
            Ok(signals) => signals,
            Err(e) => {
                screen::error(format_args!("signals cannot be caught: {e}"));
                return Exit::Failed;
            }
        };
        let (board, _control) = answer_others("collect", &setup, &self.files.rig, &stop, &signals);
        board.show_out(self.out.clone());
        match self.collect(&setup, stop, &board).await {
            Ok(summary) => {
                if self.json {
                    screen::json(&summary);
                } else {
                    screen::result(&summary);
                }
                match signals.exit() {
                    Some(exit) => exit,
                    None if summary.is_complete() => Exit::Done,
                    None => Exit::Failed,
                }
            }
            Err(e) => {
                screen::error(&e);
                if e.nothing_was_touched() {
                    return Exit::Refused;
                }
                if Dataset::open(&self.out).is_ok_and(|dataset| !dataset.is_untouched()) {
                    screen::note(format_args!(
                        "what was collected is stored; continue with the same command and --resume"
                    ));
                }
                signals.exit().unwrap_or(Exit::Failed)
            }
        }
    }

    async fn collect(&self, setup: &Setup, stop: StopSwitch, board: &Board) -> Result<Summary, CollectError> {
        let begun = Instant::now();
        let plan = setup.plan.as_ref().ok_or(CollectError::NoPlan)?;
        if !setup.rig.is_virtual() && !self.sim_only && !self.yes && !console::user_attended() {
            return Err(CollectError::NobodyThere { rig: setup.rig.name.clone() });
        }

        let speed = self.speed.speed;
        if !assemble::can_run_at(setup, speed) {
            return Err(assemble::BenchError::RealTimeOnly { speed, rig: setup.rig.name.clone() }.into());
        }

        // The dataset comes first: what does not belong is refused before anything is opened.
        let asked = assemble::provenance(setup)?;
        let dataset = match (self.resume, self.out.join("dataset.json").exists()) {
            (true, true) if !Dataset::open(&self.out)?.holds_nothing() => {
                let (dataset, damaged) = Dataset::resume(&self.out, &asked)?;
                if !damaged.is_empty() {
                    screen::warning(format_args!("captures {damaged:?} were damaged and are done again"));
                }
                dataset
            }
            _ if self.sim_only => Dataset::resume(&self.out, &asked)?.0,
            (true, false) => {
                screen::note(format_args!("{} holds nothing to resume: begun", self.out.display()));
                Dataset::create(&self.out, asked, &plan.trajectory).map_err(CollectError::Begin)?
            }
            _ => Dataset::create(&self.out, asked, &plan.trajectory).map_err(CollectError::Begin)?,
        };
        let dataset = Arc::new(dataset);
        if let Some(bytes) = dataset.background(BACKGROUND)
            && let Err(e) = crate::image::png::decode(&bytes)
        {
            let path = self.out.join(format!("background/{BACKGROUND}.png"));
            return Err(CollectError::Background { path, why: e.to_string() });
        }
        let is_real_done = dataset.done_real().len() == plan.trajectory.captures.len();
        let twin = if self.real_only { None } else { Some(Arc::new(assemble::twin(setup)?)) };

        // Watchers: bars on a terminal, lines in a log.
        let (progress, watched) = tokio::sync::mpsc::unbounded_channel();
        let watching = tokio::spawn(watch(
            watched,
            plan.trajectory.captures.len() as u64,
            (!self.sim_only).then(|| dataset.done_real().len() as u64),
            twin.is_some().then(|| dataset.done_sim().len() as u64),
            board.clone(),
        ));

        let run = session_name();
        let ending = if self.sim_only || is_real_done {
            let collection = Collection { dataset: dataset.clone(), session: None, twin, stop, progress };
            collection.run().await?
        } else {
            let logs = self.out.join("logs").join(&run);
            let options = BenchOptions { speed: self.speed.speed, logs: Some(logs), no_camera: false };
            let mut assembled = assemble::bench(setup, &options, stop.clone()).await?;
            board.show_devices(assembled.bench.observers());
            dataset.note_session(&assemble::session_note(&run, setup, &assembled))?;
            let (events, received) = tokio::sync::mpsc::channel(8);
            let session = Session {
                settings: assemble::session_settings(setup, plan),
                operator: operator(plan, assembled.world.clone(), self.yes),
                contact_zero_mm: std::collections::BTreeMap::new(),
                bench: &mut assembled.bench,
                trajectory: &plan.trajectory,
                events,
            };
            let part = SessionPart { session, events: received, run: assemble::run_notes(&run, setup, plan) };
            let collection =
                Collection { dataset: dataset.clone(), session: Some(part), twin, stop, progress };
            let ending = collection.run().await;
            let how = match &ending {
                Ok(ending) if ending.stopped => "stopped".to_owned(),
                Ok(_) => "complete".to_owned(),
                Err(e) => e.to_string(),
            };
            dataset.note_session(&serde_json::json!({ "session": run, "ended": how }))?;
            ending?
        };
        _ = watching.await;

        // Tables and report are rebuilt from what is stored, however far it got.
        let report = tokio::task::spawn_blocking({
            let dataset = dataset.clone();
            move || crate::report::write(&dataset)
        });
        let report = report.await.map_err(|e| CollectError::Vanished(e.to_string()))??;
        Ok(Summary {
            dataset: self.out.clone(),
            report: report.path,
            captures: plan.trajectory.captures.len(),
            real: dataset.done_real().len(),
            simulated: dataset.done_sim().len(),
            pairs: dataset.rows().iter().filter(|row| row.real.is_some() && row.sim.is_some()).count(),
            rows: dataset.rows().len(),
            wants_real: !self.sim_only,
            wants_sim: !self.real_only,
            not_simulated: ending.not_simulated,
            stopped: ending.stopped,
            seconds: begun.elapsed().as_secs_f64(),
        })
    }
}

/// A name for this run that sorts by time.
fn session_name() -> String {
    let now = jiff::Timestamp::now();
    format!("s{}", now.strftime("%Y%m%dT%H%M%SZ"))
}

/// Mounts indenters: on a virtual bench by itself, on a real one by asking.
pub(super) fn operator(plan: &PlanSetup, world: Option<World>, yes: bool) -> Operator {
    let bodies = plan.bodies();
    Box::new(move |indenter| {
        let name = indenter.to_owned();
        if let Some(world) = &world {
            world.mount(bodies.get(indenter).cloned());
            return Box::pin(std::future::ready(true));
        }
        if yes {
            return Box::pin(std::future::ready(true));
        }
        Box::pin(async move {
            let question = format!("mount indenter {name}, then press Enter (or type no to end here):");
            let answer = tokio::task::spawn_blocking(move || screen::ask(&question)).await;
            answer.ok().flatten().is_some_and(|a| !a.to_lowercase().starts_with('n'))
        })
    })
}

/// Without a terminal, how often a line tells how far it is.
const TOLD_EVERY: Duration = Duration::from_secs(10);

/// Shows progress until there is none any more: bars on a terminal, now and then a line elsewhere.
async fn watch(
    mut progress: UnboundedReceiver<Progress>,
    captures: u64,
    real: Option<u64>,
    sim: Option<u64>,
    board: Board,
) {
    board.update(|p| {
        (p.captures, p.real, p.simulated) = (captures, real.unwrap_or(0), sim.unwrap_or(0));
    });
    let bars = screen::bars();
    let bar = |label, done: Option<u64>| done.map(|d| screen::bar(&bars, label, captures).with_position(d));
    let (real, sim) = (bar("real", real), bar("simulated", sim));
    let sides: Vec<&ProgressBar> = real.iter().chain(&sim).collect();
    let is_terminal = !bars.is_hidden();
    let note = |text: String| match is_terminal {
        false => screen::note(text),
        true => bars.suspend(|| screen::note(text)),
    };
    let mut tick = tokio::time::interval(TOLD_EVERY);
    let mut told = Vec::new();
    loop {
        let event = tokio::select! {
            event = progress.recv() => event,
            _ = tick.tick(), if !is_terminal => {
                let now: Vec<u64> = sides.iter().map(|b| b.position()).collect();
                if now != told {
                    note(screen::progress_line(&sides));
                    told = now;
                }
                continue;
            }
        };
        let Some(event) = event else { break };
        match event {
            Progress::Note(text) => note(text),
            Progress::Indenter(name) => {
                if let Some(bar) = &real {
                    bar.set_message(name.clone());
                }
                board.update(|p| p.indenter = Some(name.clone()));
                note(format!("indenter {name}"));
            }
            Progress::Real { .. } => {
                real.iter().for_each(|b| b.inc(1));
                board.update(|p| p.real += 1);
            }
            Progress::Simulated { .. } => {
                sim.iter().for_each(|b| b.inc(1));
                board.update(|p| p.simulated += 1);
            }
            Progress::NotSimulated { captures, why } => {
                sim.iter().for_each(|b| b.inc(captures.len() as u64));
                note(format!("captures {captures:?} have no simulated side: {why}"));
            }
        }
    }
    for bar in real.into_iter().chain(sim) {
        bar.finish_and_clear();
    }
}

/// What was collected.
#[derive(Debug, serde::Serialize)]
struct Summary {
    dataset: PathBuf,
    report: PathBuf,
    captures: usize,
    real: usize,
    simulated: usize,
    pairs: usize,
    rows: usize,
    #[serde(skip)]
    wants_real: bool,
    #[serde(skip)]
    wants_sim: bool,
    not_simulated: Vec<(Vec<u32>, String)>,
    stopped: bool,
    seconds: f64,
}

impl Summary {
    fn is_complete(&self) -> bool {
        (!self.wants_real || self.real == self.captures)
            && (!self.wants_sim || self.simulated == self.captures)
    }
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (dataset, captures) = (self.dataset.display(), self.captures);
        writeln!(
            f,
            "{dataset}: {} real and {} simulated of {captures} captures, {} rows",
            self.real, self.simulated, self.rows
        )?;
        for (captures, why) in &self.not_simulated {
            writeln!(f, "not simulated: captures {captures:?}: {why}")?;
        }
        if self.stopped {
            writeln!(f, "stopped; continue with --resume")?;
        }
        write!(f, "report: {}   ({:.1} s)", self.report.display(), self.seconds)
    }
}

/// Why nothing, or not everything, was collected.
#[derive(Debug, thiserror::Error)]
enum CollectError {
    #[error("no plan was given")]
    NoPlan,
    #[error(
        "{path}, the picture of the untouched sensor that the twin wears, is damaged ({why}); restore it, or delete it and all under data/*/sim, and resume: the next picture is worn from then on"
    )]
    Background { path: PathBuf, why: String },
    #[error(
        "{rig} is a real bench and nobody is at the terminal to confirm indenters; mount them and add --yes, or run it in a terminal"
    )]
    NobodyThere { rig: String },
    /// No dataset could be begun, so nothing was.
    #[error(transparent)]
    Begin(dataset::Error),
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    #[error(transparent)]
    Twin(#[from] assemble::TwinError),
    #[error(transparent)]
    Bench(#[from] assemble::BenchError),
    #[error(transparent)]
    Collection(#[from] CollectionError),
    #[error(transparent)]
    Report(#[from] crate::report::Error),
    #[error(transparent)]
    Provenance(#[from] assemble::ProvenanceError),
    #[error("the report ended unexpectedly: {0}")]
    Vanished(String),
}

impl CollectError {
    /// Whether it was refused before any device was opened and any file was written.
    fn nothing_was_touched(&self) -> bool {
        use dataset::Error::{Belongs, Exists, Locked, Missing, NotADataset};
        match self {
            CollectError::NoPlan
            | CollectError::NobodyThere { .. }
            | CollectError::Begin(_)
            | CollectError::Provenance(_)
            | CollectError::Background { .. } => true,
            CollectError::Dataset(e) => {
                matches!(
                    e,
                    Belongs { .. } | Exists { .. } | Locked { .. } | Missing { .. } | NotADataset { .. }
                )
            }
            CollectError::Bench(assemble::BenchError::RealTimeOnly { .. }) => true,
            _ => false,
        }
    }
}
